"""How much of the posterior a minimum holds, and how well a model explains readings (theory 12).

Around a minimum x_0 with residuals r and Jacobian J in the scaled parameters (see `discrepancy`),
phi is that of the linearised model, and the parameters stay within their bounds:

    M = integral over the bounds of exp(-|r + J (x - x_0)|^2 / 2) dx
      = exp(-phi_m / 2) (2 pi)^(n/2) |H|^(-1/2) P,         H = J^T J + R^-2

with phi_m the least value of the linearised phi, at x_m, wherever that is, and P the probability
that a normal x with mean x_m and covariance H^-1 keeps to the bounds. So a minimum on a bound, or a
parameter that the readings hardly see, holds what lies within the bounds and no more. R is
`FLAT` ranges of each parameter: it makes H invertible and changes nothing else. Where the
minimum lies inside and its spread is small, P is one and this is Laplace's approximation.

The evidence of a model, the probability density of the readings before the parameters are known, is

    Z = M / (prior volume) / (normalisation of the readings' density)

where the prior volume is the integral over the bounds of exp(-|prior residuals|^2/2) dx: the width
between the bounds where there is no prior. The normalisation holds log|Sigma|: models of
which one counts on larger errors are compared as they must be.

P is computed by conditioning one parameter after the other (Genz 1992) on the points of a rank-one
lattice: the same in every run.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.special import gammaln, log_ndtr, ndtr, ndtri

from geoident.identify.assessment.diagnostics import effective_sd
from geoident.identify.assessment.uncertainty import UNBOUNDED_RANGE
from geoident.identify.primes import first_primes
from geoident.identify.problem.errors import Covariance
from geoident.identify.problem.problem import Linearization, Problem
from geoident.identify.problem.scaling import Scaling
from geoident.model.arrays import Floats
from geoident.model.methods import HuberOptions, LossOptions, SquaredOptions, StudentOptions
from geoident.model.parameter import Parameter

FLAT = 100.0
"""Standard deviation, in ranges, of what makes the curvature invertible."""

_FAR = 8.0
"""Bounds that are further away than this, in standard deviations, cut nothing off."""

_POINTS = 4096
"""Of the lattice."""

_JITTER = 1e-12
"""Added to a correlation matrix, so that rounding cannot make it indefinite."""

_LOG_2PI = float(np.log(2.0 * np.pi))


@dataclass(frozen=True)
class LaplaceMass:
    """What a minimum holds.

    Args:
        log_mass: logarithm of M.
        covariance_x: (n, n) H^-1 in the scaled parameters, before the bounds.
    """

    log_mass: float
    covariance_x: Floats


def laplace_mass(found: Linearization, x: Floats, scaling: Scaling) -> LaplaceMass:
    """What the minimum at x (n,) holds.

    Args:
        found: residuals and Jacobian there.
        x: (n,) scaled parameters.
        scaling: of them.
    """
    J, r, n = found.jacobian, found.residual, len(x)
    width = scaling.upper - scaling.lower
    width = np.where(np.isfinite(width) & (width > 0.0), width, UNBOUNDED_RANGE)
    A = np.concatenate([J * width, np.eye(n) / FLAT])  # in ranges, for the numbers' sake
    _, S, Vt = np.linalg.svd(A, full_matrices=False)
    inverse = (Vt.T / S**2) @ Vt
    to_mean = -inverse @ (width * (J.T @ r))
    change = A @ to_mean
    lowest = found.objective - float(change @ change)
    covariance = inverse * np.outer(width, width)
    log_root = float(np.log(S).sum() - np.log(width).sum())
    mean = x + width * to_mean
    inside = log_box_probability(mean, covariance, scaling.lower, scaling.upper)
    log_mass = -0.5 * lowest + 0.5 * n * _LOG_2PI - log_root + inside
    return LaplaceMass(log_mass, covariance)


def log_box_probability(mean: Floats, covariance: Floats, lower: Floats, upper: Floats) -> float:
    """Logarithm of the probability that a normal vector lies between two.

    Args:
        mean: (n,).
        covariance: (n, n), positive definite.
        lower: (n,) lowest values; may be infinite.
        upper: (n,) highest values.
    """
    sd = np.sqrt(np.diag(covariance))
    a, b = (lower - mean) / sd, (upper - mean) / sd
    kept = np.flatnonzero((a > -_FAR) | (b < _FAR))
    if not len(kept):
        return 0.0
    # what the bounds cut most comes first: the later integrals then vary little
    order = kept[np.argsort(_log_between(a[kept], b[kept]), kind="stable")]
    correlation = (covariance / np.outer(sd, sd))[np.ix_(order, order)]
    L = np.linalg.cholesky(correlation + _JITTER * np.eye(len(order)))
    a, b = a[order], b[order]
    if len(order) == 1:
        return float(_log_between(a / L[0, 0], b / L[0, 0])[0])
    u = _lattice(len(order) - 1)
    y = np.zeros((len(order), _POINTS))
    log_weight = np.zeros(_POINTS)
    for i, row in enumerate(L):
        before = row[:i] @ y[:i]
        low, high = (a[i] - before) / row[i], (b[i] - before) / row[i]
        log_weight += _log_between(low, high)
        if i + 1 < len(order):
            y[i] = _within(low, high, u[i])
    top = float(log_weight.max())
    return top + float(np.log(np.mean(np.exp(log_weight - top))))


def _log_between(low: Floats, high: Floats) -> Floats:
    """Logarithm of the standard normal probability between low and high, both (m,)."""
    flip = low > 0.0
    a, b = np.where(flip, -high, low), np.where(flip, -low, high)
    with np.errstate(divide="ignore"):
        share = log_ndtr(a) - log_ndtr(b)
        found = log_ndtr(b) + np.log1p(-np.exp(np.minimum(share, 0.0)))
    return np.asarray(np.maximum(found, -1e300), dtype=np.float64)


def _within(low: Floats, high: Floats, u: Floats) -> Floats:
    """The quantiles u (m,) of standard normal numbers between low and high, both (m,).

    From the upper end where both are above zero, so that all is computed in the lower tail.
    """
    flip = low > 0.0
    a, b = np.where(flip, -high, low), np.where(flip, -low, high)
    found = ndtri(ndtr(a) + u * (ndtr(b) - ndtr(a)))
    found = np.clip(found, a, b)
    return np.asarray(np.where(flip, -found, found), dtype=np.float64)


def _lattice(n: int) -> Floats:
    """Points (n, _POINTS) in the unit cube: Richtmyer's lattice, folded so that it is periodic."""
    steps = np.sqrt(np.array(first_primes(n), dtype=np.float64))
    share = np.outer(steps, np.arange(1, _POINTS + 1)) % 1.0
    return np.asarray(np.clip(1.0 - np.abs(2.0 * share - 1.0), 1e-12, 1.0 - 1e-12))


def mixture_interval(odds: Floats, means: Floats, sds: Floats) -> tuple[Floats, Floats]:
    """The 95 % intervals of mixtures of k normal distributions, by bisection.

    Args:
        odds: (k,) parts, whose sum is one.
        means: (k, ...).
        sds: (k, ...); NaN or infinite where a component says nothing.

    Returns:
        Lower and upper ends, both (...); NaN or infinite where a component has no number.
    """
    weight = odds.reshape(-1, *(1,) * (means.ndim - 1))
    known = np.isfinite(means).all(axis=0) & np.isfinite(sds).all(axis=0)
    mean, sd = np.where(known, means, 0.0), np.where(known, np.maximum(sds, 1e-300), 1.0)

    def quantile(level: float) -> Floats:
        low, high = (mean - 9.0 * sd).min(axis=0), (mean + 9.0 * sd).max(axis=0)
        for _ in range(100):
            middle = 0.5 * (low + high)
            below = (weight * ndtr((middle - mean) / sd)).sum(axis=0) < level
            low, high = np.where(below, middle, low), np.where(below, high, middle)
        return np.asarray(np.where(known, 0.5 * (low + high), np.nan), dtype=np.float64)

    return quantile(0.025), quantile(0.975)


def log_prior_volume(parameters: tuple[Parameter, ...]) -> float:
    """Logarithm of the integral of the priors' density, not normalised, between the bounds.

    Args:
        parameters: the n unknowns; infinite where one has neither bounds nor a prior.
    """
    scaling = Scaling(parameters)
    width = scaling.upper - scaling.lower
    held = {i for i, _ in scaling.priors}
    with np.errstate(divide="ignore"):
        total = sum(float(np.log(w)) for i, w in enumerate(width) if i not in held and w > 0.0)
    return total + sum(_log_prior_integral(parameters[i]) for i in held)


def _log_prior_integral(parameter: Parameter) -> float:
    """Of one parameter with a prior, in x."""
    scaling, prior = Scaling([parameter]), parameter.prior
    assert prior is not None
    lower, upper = float(scaling.lower[0]), float(scaling.upper[0])
    if scaling.log[0] == (prior.kind == "lognormal"):  # a normal density in x
        mean = np.log(prior.mean) if scaling.log[0] else prior.mean / scaling.reference[0]
        sd = prior.sd / (prior.mean if scaling.log[0] else float(scaling.reference[0]))
        between = _log_between(np.array([(lower - mean) / sd]), np.array([(upper - mean) / sd]))
        return float(np.log(sd) + 0.5 * _LOG_2PI + between[0])
    x, w = np.polynomial.legendre.leggauss(400)
    x = 0.5 * (upper - lower) * (x + 1.0) + lower
    rho = np.array([scaling.prior_residuals(scaling.to_natural(np.array([k])))[0] for k in x])
    least = float((rho**2).min())
    inside = float(w @ np.exp(-0.5 * (rho**2 - least))) * 0.5 * (upper - lower)
    return float(np.log(inside)) - 0.5 * least


def log_normalisation(problem: Problem, readings: Floats) -> float:
    """Logarithm of the integral of exp(-phi/2) over all readings (g,) that might have been, SI.

    With a robust loss and shared errors by Laplace's approximation for these, at the readings (g,)
    of the model.
    """
    own = float(np.log(problem.sd).sum()) + len(problem.sd) * _log_of_loss(problem.loss)
    if problem.covariance is None:
        return own
    if isinstance(problem.loss, SquaredOptions):
        sd, sigma = problem.sd, problem.covariance
    else:
        assert problem.shared is not None
        sd = effective_sd(problem, readings)
        sigma = Covariance(sd, problem.shared)
    return own + 0.5 * sigma.log_determinant() - float(np.log(sd).sum())


def _log_of_loss(options: LossOptions) -> float:
    """Logarithm of the integral of exp(-rho(r)/2) over r."""
    match options:
        case HuberOptions(delta):
            middle = np.sqrt(2.0 * np.pi) * (2.0 * ndtr(delta) - 1.0)
            return float(np.log(middle + 2.0 / delta * np.exp(-0.5 * delta**2)))
        case StudentOptions(nu):
            ratio = gammaln(0.5 * nu) - gammaln(0.5 * (nu + 1.0))
            return float(0.5 * np.log(nu * np.pi) + ratio)
        case _:
            return 0.5 * _LOG_2PI
