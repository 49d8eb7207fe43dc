"""Scaled parameters, in which identifiers search, and the priors (theory 6).

Identifiers work on scaled parameters x that are all of the order of one, so that one step length,
one trust radius and one tolerance serve a Young's modulus in Pa and a stress ratio alike:

    scale ``log``       x = ln p           a step of 0.1 is ten per cent of p
    scale ``linear``    x = p / r,         r = min(width, max(|start|, width / 10))

with width = upper - lower. The reference r is the size of the parameter; a tenth of the width
where the start is near zero (an angle, a tectonic stress), and the width itself where the bounds
are tighter than the parameter is large. Without finite bounds r is |start|, or 1.

The prior (theory 6) adds rows to the residuals, so that phi is the negative logarithm of the
posterior density (times two, up to a constant):

    normal      (p - mean) / sd
    lognormal   (ln p - ln mean) / (sd / mean)

Computed once: references, bounds and start in x. Per trial: elementwise maps only.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from geoident.model.arrays import Bools, Floats
from geoident.model.parameter import Parameter, Prior


class Scaling:
    """The map between natural parameters p (SI) and scaled parameters x (dimensionless).

    Args:
        parameters: the n unknowns.

    Attributes:
        log: (n,) the parameter is scaled by its logarithm.
        reference: (n,) reference r of linear parameters, SI; 1 for logarithmic ones.
        bounds: lower and upper bounds (n,), (n,), SI.
        lower: (n,) lower bounds in x.
        upper: (n,) upper bounds in x.
        start: (n,) start in x, inside the bounds.
        priors: index and prior of the k parameters that have one.

    >>> from geoident.model.parameter import Parameter
    >>> scaling = Scaling([Parameter("K0", start=1.0, lower=0.5, upper=3.0)])
    >>> scaling.to_natural(scaling.start)
    array([1.])
    """

    def __init__(self, parameters: Sequence[Parameter]) -> None:
        self.log: Bools = np.array([q.scale == "log" for q in parameters], dtype=np.bool_)
        self.reference: Floats = np.array([_reference(q) for q in parameters], dtype=np.float64)
        lower: Floats = np.array([q.lower for q in parameters], dtype=np.float64)
        upper: Floats = np.array([q.upper for q in parameters], dtype=np.float64)
        self.bounds = lower, upper
        self.lower: Floats = self._scale(lower)
        self.upper: Floats = self._scale(upper)
        self.start: Floats = self.to_scaled(np.array([q.start for q in parameters], dtype=float))
        self.priors: tuple[tuple[int, Prior], ...] = tuple(
            (i, q.prior) for i, q in enumerate(parameters) if q.prior is not None
        )

    def __len__(self) -> int:
        return int(self.reference.shape[0])

    def clip(self, x: Floats) -> Floats:
        """The nearest x (n,) inside the bounds."""
        return np.clip(x, self.lower, self.upper)

    def to_scaled(self, p: Floats) -> Floats:
        """Scaled x (n,) of natural p (n,), SI; p outside the bounds is clipped."""
        return self._scale(np.clip(p, *self.bounds))

    def to_natural(self, x: Floats) -> Floats:
        """Natural p (n,), SI, of scaled x (n,); exact on the bounds, never outside."""
        p = x * self.reference
        p[self.log] = np.exp(x[self.log])
        lower, upper = self.bounds
        p[x <= self.lower] = lower[x <= self.lower]
        p[x >= self.upper] = upper[x >= self.upper]
        return np.clip(p, *self.bounds)

    def away(self, p: Floats, step: Floats) -> Floats:
        """Natural p (n,) at steps (n,) in x from p (n,), never outside the bounds."""
        with np.errstate(over="ignore"):
            moved = np.where(self.log, p * np.exp(step), p + step * self.reference)
        return np.clip(moved, *self.bounds)

    def dp_dx(self, p: Floats) -> Floats:
        """dp/dx (n,), the diagonal, SI: a Jacobian in p times it is the Jacobian in x."""
        return np.where(self.log, p, self.reference)

    def prior_residuals(self, p: Floats) -> Floats:
        """Rows (k,) that the priors add to the weighted residuals, dimensionless.

        Infinite where a lognormal prior excludes p.
        """
        return np.array([prior.score(p[i]) for i, prior in self.priors], dtype=float)

    def prior_jacobian(self, p: Floats) -> Floats:
        """Derivative of `prior_residuals` in x, (k, n)."""
        rows = np.zeros((len(self.priors), len(self)))
        dp_dx = self.dp_dx(p)
        for row, (i, prior) in zip(rows, self.priors, strict=True):
            row[i] = prior.slope(p[i]) * dp_dx[i]
        return rows

    def _scale(self, p: Floats) -> Floats:
        x = p / self.reference
        with np.errstate(divide="ignore"):
            x[self.log] = np.log(p[self.log])
        return x


def _reference(parameter: Parameter) -> float:
    """The size of a linear parameter, SI; 1 for a logarithmic one."""
    if parameter.scale == "log":
        return 1.0
    size = abs(parameter.start)
    width = parameter.upper - parameter.lower
    if not np.isfinite(width) or width <= 0.0:
        return size or 1.0
    return min(width, max(size, 0.1 * width))
