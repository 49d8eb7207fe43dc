"""How much of the posterior a minimum holds, and how well a model explains readings (theory 12).

Around a minimum x_0 with residuals r and Jacobian J in the scaled parameters (see
`problem.problem`), phi is that of the linearised model and the parameters stay within their bounds:

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

P is computed by `truncated_normal`.
"""

from __future__ import annotations

import numpy as np
from scipy.special import gammaln, ndtr

from geoident.identify.assessment.diagnostics import effective_sd
from geoident.identify.assessment.spectrum import admissible_ranges
from geoident.identify.assessment.truncated_normal import log_probability_within
from geoident.identify.problem.problem import Linearization, Problem
from geoident.identify.problem.scaling import Scaling
from geoident.identify.problem.shared_errors import Covariance
from geoident.model.arrays import Floats
from geoident.model.methods import HuberOptions, LossOptions, SquaredOptions, StudentOptions
from geoident.model.parameter import Parameter

FLAT = 100.0
"""Standard deviation R, in ranges: wide enough to change no density between the bounds by more than
a ten-thousandth, narrow enough to make the curvature invertible."""

_LOG_2PI = float(np.log(2.0 * np.pi))  # of normal densities


def laplace_mass(at: Linearization, x: Floats, scaling: Scaling) -> tuple[float, Floats]:
    """What the minimum at x (n,) holds.

    Args:
        at: residuals and Jacobian there.
        x: (n,) scaled parameters.
        scaling: of them.

    Returns:
        The logarithm of M, and H^-1 (n, n) in the scaled parameters, before the bounds; zero for
        parameters whose bounds coincide, which take no part.
    """
    free = np.flatnonzero(scaling.upper > scaling.lower)
    lower, upper, n = scaling.lower[free], scaling.upper[free], len(free)
    J, r = at.jacobian[:, free], at.residual
    width = admissible_ranges(scaling)[free]
    A = np.concatenate([J * width, np.eye(n) / FLAT])  # in ranges, for the numbers' sake
    _, S, Vt = np.linalg.svd(A, full_matrices=False)
    inverse = (Vt.T / S**2) @ Vt
    to_mean = -inverse @ (width * (J.T @ r))
    change = A @ to_mean
    lowest = at.objective - float(change @ change)
    covariance = inverse * np.outer(width, width)
    log_root = float(np.log(S).sum() - np.log(width).sum())
    mean = x[free] + width * to_mean
    inside = log_probability_within(mean, covariance, lower, upper)
    log_mass = -0.5 * lowest + 0.5 * n * _LOG_2PI - log_root + inside
    covariance_x = np.zeros((len(x), len(x)))
    covariance_x[np.ix_(free, free)] = covariance
    return log_mass, covariance_x


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
    if scaling.log[0] == (prior.kind == "lognormal"):  # a normal density in x
        mean = np.log(prior.mean) if scaling.log[0] else prior.mean / scaling.reference[0]
        sd = prior.sd / (prior.mean if scaling.log[0] else float(scaling.reference[0]))
        inside = log_probability_within(
            np.array([mean]), np.array([[sd**2]]), scaling.lower, scaling.upper
        )
        return float(np.log(sd)) + 0.5 * _LOG_2PI + inside
    x, w = np.polynomial.legendre.leggauss(400)
    lower, upper = float(scaling.lower[0]), float(scaling.upper[0])
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
