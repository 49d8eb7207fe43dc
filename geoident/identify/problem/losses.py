"""How much a large residual counts.

With the weighted residual r of a reading (in its standard deviations) a loss rho replaces r^2:

    squared      rho = r^2
    huber        rho = r^2                       for |r| <= delta      (Huber 1964)
                       2 delta |r| - delta^2     beyond
    student-t    rho = (nu + 1) ln(1 + r^2/nu)   twice the negative log likelihood, less its
                                                 constant (Lange, Little & Taylor 1989)

Written as the square of a transformed residual f = sign(r) sqrt(rho), every discrepancy stays a
sum of squares: phi = |f|^2, with the Jacobian f'(r) dr/dx, f' = rho' / (2 f). Its gradient is that
of phi exactly. Gauss-Newton on f, with the trust region on phi itself, is a robust Gauss-Newton:
its curvature f'^2 lies between the true one, rho''/2, and the weight of iteratively reweighted
least squares,

    w = rho' / (2 r)        1 or min(1, delta/|r|) or (nu + 1)/(nu + r^2),

so it converges faster than reweighting, and unlike the true curvature it is never zero or negative.
Priors keep their squares: they are no readings that could be wrong.
"""

from __future__ import annotations

import numpy as np

from geoident.model.arrays import Floats
from geoident.model.methods import HuberOptions, LossOptions, StudentOptions

_MAD = 1.482602218505602
"""Standard deviation by median of absolute values, for a normal distribution."""


def transformed(options: LossOptions, r: Floats) -> tuple[Floats, Floats]:
    """Transformed residual f = sign(r) sqrt(rho(r)) and its derivative, each (g,), for r (g,)."""
    match options:
        case HuberOptions(delta):
            tail = np.sqrt(2.0 * delta * np.maximum(np.abs(r), delta) - delta**2)
            inside = np.abs(r) <= delta
            return np.where(inside, r, np.sign(r) * tail), np.where(inside, 1.0, delta / tail)
        case StudentOptions(nu):
            u = r**2 / nu
            safe = np.where(u > 0.0, u, 1.0)
            part = np.sqrt((nu + 1.0) / nu * np.where(u > 0.0, np.log1p(safe) / safe, 1.0))
            return r * part, (nu + 1.0) / nu / (1.0 + u) / part
        case _:
            return r, np.ones_like(r)


def full_weights(options: LossOptions, r: Floats) -> Floats:
    """rho'/(2 r), (g,), not cut: the weight with which reweighted least squares goes down."""
    match options:
        case HuberOptions(delta):
            return np.asarray(delta / np.maximum(np.abs(r), delta), dtype=np.float64)
        case StudentOptions(nu):
            return np.asarray((nu + 1.0) / (nu + r**2))
        case _:
            return np.ones_like(r)


def weights(options: LossOptions, r: Floats) -> Floats:
    """Weight w = rho'/(2 r), (g,), that a reading with residual r (g,) keeps, never above 1.

    Student's weight in the middle is (nu+1)/nu; it is cut at 1 because no reading tells more than
    its accuracy says.
    """
    return np.minimum(1.0, full_weights(options, r))


def curvature(options: LossOptions, r: Floats) -> Floats:
    """rho''/2, (g,)."""
    match options:
        case HuberOptions(delta):
            return np.asarray(np.abs(r) <= delta, dtype=np.float64)
        case StudentOptions(nu):
            return np.asarray((nu + 1.0) * (nu - r**2) / (nu + r**2) ** 2)
        case _:
            return np.ones_like(r)


def robust_scale(r: Floats) -> float:
    """Scatter of the residuals r (g,), in standard deviations, by the median of their sizes.

    Near 1 if the accuracies are right, whatever a minority of wrong readings says; NaN for none.

    >>> round(robust_scale(np.array([-1.0, 0.2, 0.7, 0.5, 90.0])), 3)
    1.038
    """
    return float(_MAD * np.median(np.abs(r))) if r.size else np.nan
