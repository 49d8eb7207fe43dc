"""How well the parameters are known at the estimate, and what a prediction is worth (theory 6).

With the Jacobian J of the readings at the estimate and each parameter measured by its admissible
range R (see `spectrum`),

    B = (1/s) J (dp/dx) R          readings alone            (g, n)
    A = [B ; prior rows R]         readings and priors       (g + k, n)

the singular values of A tell determined from undetermined directions. Their parts are kept apart:

    cov_x   = R (sum over determined v v^T / S^2) R                   (n, n)
    gaps_x  = R v min(1/S, L), one column for each undetermined v     (n, u)

A parameter is *determined* if 1.96 times its total standard deviation, the root of the diagonal of
cov_x + gaps_x gaps_x^T, is at most half its range, and the part of it that comes from undetermined
directions, so from the bounds of other parameters, at most a quarter; and if, having a prior, it is
better known than that, its standard deviation below 0.95 of the prior's. What one parameter
lacks does not touch the number of another that has no part in it.

A parameter on its bound is fixed in cov_x: the numbers of the others hold for that value. Whether
it and the others are determined is judged as if it were free, or a bound would hide that two
parameters cannot be told apart.

A prediction with Jacobian J_l has the variance J_l cov J_l^T + s_l^2, with the part of the
undetermined directions on top. Where that part is larger than all the rest, the prediction is not
determined and its standard deviation infinite. A prediction that does not depend on what is
undetermined keeps its band.

Computed once, from the Jacobian at the estimate; no evaluation of the model.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from geoident.identify.assessment.findings import Knowledge, describe_gaps
from geoident.identify.assessment.spectrum import SingularDirections
from geoident.identify.problem.problem import Problem, Scaling
from geoident.model.arrays import Bools, Floats
from geoident.model.parameter import Parameter
from geoident.model.result import NORMAL_95

UNBOUNDED_RANGE = 10.0
"""Admissible range in x of a parameter without finite bounds: ten references, or a factor e^10."""

PRIOR_SHARE = 0.95
"""Posterior by prior standard deviation from which on a parameter is known from its prior only."""


@dataclass(frozen=True)
class Assessment:
    """How well each of n parameters is known.

    Args:
        sd: (n,) standard deviation, SI; NaN where at a bound, or where neither
            readings nor prior determine it.
        lower95: (n,) lower end of the 95 % interval, SI, symmetric in x (so in the logarithm of a
            parameter scaled by it), not cut at the bounds; NaN where ``sd`` is.
        upper95: (n,) its upper end.
        beyond_bounds: (n,) the interval reaches beyond a bound.
        covariance: (n, n) SI; NaN rows and columns where ``sd`` is NaN.
        correlation: (n, n) likewise.
        at_bound: (n,) the value lies on a bound; treated as fixed there.
        determined: (n,) readings, or readings and priors together, determine it.
        from_prior: (n,) not determined by readings, but known from its prior: nothing is missing.
        singular_values: (min(g, n),) of B, the readings alone, largest first.
        findings: sentences on what is not determined and what only a prior fixes.
        slope: (n,) dp/dx, SI.
        covariance_x: (n, n) of the determined directions in x; zero rows at bounds.
        gaps_x: (n, u) the undetermined directions in x, one standard deviation long each.
    """

    sd: Floats
    lower95: Floats
    upper95: Floats
    beyond_bounds: Bools
    covariance: Floats
    correlation: Floats
    at_bound: Bools
    determined: Bools
    from_prior: Bools
    singular_values: Floats
    findings: tuple[str, ...]
    slope: Floats
    covariance_x: Floats
    gaps_x: Floats


def assess(problem: Problem, values: Floats, jacobian: Floats) -> Assessment:
    """Covariance, intervals and what is not determined, theory 6.

    Args:
        problem: standard deviations of the readings, and the parameters.
        values: (n,) the estimate, SI.
        jacobian: (g, n) derivative of the readings there, SI.
    """
    scaling = Scaling(problem.parameters)
    slope, width = scaling.slope(values), _ranges(scaling)
    B = problem.whiten(jacobian * slope) * width
    P = scaling.prior_jacobian(values) * width
    A, varies = np.concatenate([B, P]), width > 0.0
    at_bound = ~varies | _on_bound(problem.parameters, values, slope * width)
    whole, readings = SingularDirections.of(A, varies), SingularDirections.of(B, varies)
    covariance_x, gaps_x = _scaled(SingularDirections.of(A, ~at_bound), width)
    undetermined = np.linalg.norm(whole.undetermined_columns, axis=1)
    total = np.hypot(np.sqrt(np.diag(whole.determined_covariance)), undetermined)
    from_prior = _only_from_prior(P, total)
    known_enough = (NORMAL_95 * total <= 0.5) & (NORMAL_95 * undetermined <= 0.25)
    determined = known_enough & ~from_prior
    known = Knowledge(
        problem.parameters, values, at_bound, from_prior, P, slope * width, whole, readings
    )
    covariance = covariance_x + gaps_x @ gaps_x.T
    every_x, every_gap_x = _scaled(whole, width)
    # a prior is knowledge too: what is known from it alone has its number, and says so
    numbered = (determined | (known_enough & from_prior)) & ~at_bound
    sd_x = np.where(numbered, np.sqrt(np.diag(covariance)), np.nan)
    lower95, upper95 = _interval(scaling, values, sd_x)
    return Assessment(
        sd=slope * sd_x,
        lower95=lower95,
        upper95=upper95,
        beyond_bounds=_beyond(problem.parameters, lower95, upper95),
        covariance=_only(np.isfinite(sd_x), np.outer(slope, slope) * covariance),
        correlation=_only(np.isfinite(sd_x), covariance / np.outer(sd_x, sd_x)),
        at_bound=at_bound,
        determined=determined,
        from_prior=known_enough & from_prior,
        singular_values=readings.S[: min(B.shape)],
        findings=describe_gaps(
            known, np.outer(slope, slope) * (every_x + every_gap_x @ every_gap_x.T)
        ),
        slope=slope,
        covariance_x=covariance_x,
        gaps_x=gaps_x,
    )


def predict_band(assessment: Assessment, jacobian: Floats, sd: Floats) -> Floats:
    """Standard deviation of later readings, sqrt(diag(J_l cov J_l^T) + s_l^2), theory 6.

    Args:
        assessment: how well the parameters are known.
        jacobian: (l, n) derivative of the later readings at the estimate, SI.
        sd: (l,) accuracy of the later readings, SI.

    Returns:
        (l,) SI; infinite where the reading depends mainly on what is not determined.
    """
    rows = jacobian * assessment.slope
    known = np.einsum("li,ij,lj->l", rows, assessment.covariance_x, rows) + sd**2
    undetermined = np.sum((rows @ assessment.gaps_x) ** 2, axis=1)
    return np.where(undetermined > known, np.inf, np.sqrt(known + undetermined))


def _scaled(spectrum: SingularDirections, width: Floats) -> tuple[Floats, Floats]:
    """Covariance (n, n) of the determined directions and the undetermined ones (n, u), in x.

    Both from one spectrum: no direction may fall between those of two.
    """
    return spectrum.determined_covariance * np.outer(
        width, width
    ), spectrum.undetermined_columns * width[:, None]


def _ranges(scaling: Scaling) -> Floats:
    """Admissible range (n,) of each parameter in x."""
    width = scaling.upper - scaling.lower
    return np.where(np.isfinite(width), width, UNBOUNDED_RANGE)


def _on_bound(parameters: tuple[Parameter, ...], values: Floats, width: Floats) -> Bools:
    """Parameters (n,) on a bound, up to rounding."""
    ends = np.array([(q.lower, q.upper) for q in parameters]).reshape(-1, 2)
    return np.asarray(np.abs(values[:, None] - ends).min(axis=1) <= 1e-12 * width, dtype=np.bool_)


def _only_from_prior(P: Floats, total: Floats) -> Bools:
    """Parameters (n,) hardly better known than by their prior: rows P (k, n) and sd (n,) in z."""
    precision = np.abs(P).max(axis=0, initial=0.0)
    return np.asarray(precision * total >= PRIOR_SHARE, dtype=np.bool_)


def _interval(scaling: Scaling, values: Floats, sd_x: Floats) -> tuple[Floats, Floats]:
    """Ends of the 95 % interval (n,), (n,), SI."""
    half = NORMAL_95 * sd_x
    factor = np.exp(half)
    lower = np.where(scaling.log, values / factor, values - half * scaling.reference)
    upper = np.where(scaling.log, values * factor, values + half * scaling.reference)
    return lower, upper


def _beyond(parameters: tuple[Parameter, ...], lower95: Floats, upper95: Floats) -> Bools:
    lower = np.array([q.lower for q in parameters])
    upper = np.array([q.upper for q in parameters])
    return (lower95 < lower) | (upper95 > upper)


def _only(kept: Bools, matrix: Floats) -> Floats:
    """The matrix (n, n) with NaN in the rows and columns that are not kept (n,)."""
    return np.where(np.outer(kept, kept), matrix, np.nan)
