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

**A bound limits, it does not inform.** Of a parameter on its bound only one side is unknown, not
nothing. Intervals and bands are those of the normal posterior truncated at the bounds (see
`truncated_normal`), with its mode where the estimate is: a parameter on a bound has the gradient of
phi that holds it there. Its interval is one-sided, from the bound on, and what depends on it is as
uncertain as that makes it. Whether parameters are determined is judged as if none was on a bound,
or a bound would hide that two parameters cannot be told apart. (The influence of readings alone is
judged with parameters on bounds held there: without a reading they would not move.)

A prediction with Jacobian J_l is J_l dx with the error s_l of the gauge beside. Where the part of
the undetermined directions is larger than all the rest, J_l cov J_l^T + s_l^2, the prediction is
not determined and its standard deviation infinite. A prediction that does not depend on what is
undetermined keeps its band.

Computed once, from the Jacobian at the estimate; no evaluation of the model.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import scipy.sparse as sp

from geoident.identify.assessment.conflicts import (
    conflict_sentences,
    prior_conflicts,
    tied_sentences,
)
from geoident.identify.assessment.findings import Knowledge, describe_gaps, join
from geoident.identify.assessment.spectrum import SingularDirections
from geoident.identify.assessment.truncated_normal import Posterior, truncated_normal
from geoident.identify.assessment.unknown_variances import OverAccuracies
from geoident.identify.problem.errors import Covariance, SharedErrors
from geoident.identify.problem.problem import Problem
from geoident.identify.problem.scaling import Scaling
from geoident.model.arrays import Bools, Floats
from geoident.model.parameter import Parameter
from geoident.model.results.bands import NORMAL_95

UNBOUNDED_RANGE = 10.0
"""Admissible range in x of a parameter without finite bounds: ten references, or a factor e^10."""

PRIOR_SHARE = 0.95
"""Posterior by prior standard deviation from which on a parameter is known from its prior only."""


FLAT = 10.0
"""Standard deviation of an undetermined direction, in admissible extents: flat between bounds."""


@dataclass(frozen=True)
class Assessment:
    """How well each of n parameters is known.

    Args:
        sd: (n,) root of the mean square deviation from the estimate, SI; where no bound is near,
            the standard deviation. NaN where neither readings nor prior determine it, or given.
        lower95: (n,) lower end of the 95 % interval, SI: symmetric in x (so in the logarithm of a
            parameter scaled by it) where no bound is near, never beyond a bound; NaN where ``sd``
            is.
        upper95: (n,) its upper end.
        beyond_bounds: (n,) a bound cuts the interval.
        covariance: (n, n) SI, mean products of deviations; NaN rows and columns where ``sd`` is.
        correlation: (n, n) likewise.
        at_bound: (n,) the value lies on a bound.
        determined: (n,) readings, or readings and priors together, determine it.
        from_prior: (n,) not determined by readings, but known from its prior: nothing is missing.
        singular_values: (min(g, n),) of B, the readings alone, largest first; where there are
            fields, of the parameters that the case names, with the fields free.
        findings: sentences on what is not determined and what only a prior fixes.
        slope: (n,) dp/dx, SI.
        posterior: of x, from the estimate, cut at the bounds.
        uncut_mean: (n,) mean of the normal that is cut, from the estimate.
        uncut_factor: (n, q) F: its covariance is F F^T.
        determined_x: (n, d) the determined directions in x, one standard deviation long each.
        gaps_x: (n, u) the undetermined directions, likewise.
        held_covariance_x: (n, n) of the determined directions in x while parameters on bounds are
            held there; zero rows of these.
        over: the same at other accuracies that the residuals leave possible, where these were
            estimated: intervals are wider by that. None where they are given.
        wider: (n, 2) by how much the ends of the intervals are therefore farther out.
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
    posterior: Posterior
    uncut_mean: Floats
    uncut_factor: Floats
    determined_x: Floats
    gaps_x: Floats
    held_covariance_x: Floats
    over: OverAccuracies | None
    wider: Floats


def assess(
    problem: Problem,
    values: Floats,
    jacobian: Floats,
    readings: Floats | None = None,
    over: OverAccuracies | None = None,
) -> Assessment:
    """Covariance, intervals and what is not determined, theory 6.

    Args:
        problem: standard deviations of the readings, and the parameters.
        values: (n,) the estimate, SI.
        jacobian: (g, n) derivative of the readings there, SI.
        readings: (g,) v there, SI, from which is known how strongly a parameter is pressed against
            its bound; None for readings that are met.
        over: what is known at other accuracies; None where they are given.
    """
    wider = np.ones((len(values), 2))
    if over is not None:
        wider = np.stack(over.wider(np.eye(len(values))), axis=1)
    scaling = Scaling(problem.parameters)
    slope, width = scaling.slope(values), _ranges(scaling)
    B = problem.whiten(jacobian * slope) * width
    P = scaling.prior_jacobian(values) * width
    A, varies = np.concatenate([B, P]), width > 0.0
    on_bound = _on_bound(problem.parameters, values, slope * width)
    at_bound = ~varies | on_bound
    whole = SingularDirections.of(A, varies)
    undetermined = np.linalg.norm(whole.undetermined_columns, axis=1)
    total = np.hypot(np.sqrt(np.diag(whole.determined_covariance)), undetermined)
    from_prior = _only_from_prior(P, total)
    known_enough = (NORMAL_95 * wider.max(axis=1) * total <= 0.5) & (
        NORMAL_95 * undetermined <= 0.25
    )
    determined = known_enough & ~from_prior
    named = np.array([not q.field for q in problem.parameters], dtype=np.bool_)
    known = _knowledge(problem.parameters, values, at_bound, from_prior, B, P, slope * width)
    pressed = np.zeros(len(values))
    held = SingularDirections.of(A, ~at_bound)
    conflicts: tuple[str, ...] = ()
    if readings is not None:
        of_priors = scaling.prior_residuals(values)
        r = np.concatenate([problem.whiten(readings - problem.measured), of_priors])
        rows, free = scaling.prior_jacobian(values), _scaled(held, width)[0]
        gradient = np.divide(A.T @ r, width, out=np.zeros_like(width), where=width > 0.0)
        step = -free @ gradient  # to the least misfit: a point of a grid is beside it
        contradicting = prior_conflicts(
            scaling.to_scaled(values) + step, rows, of_priors + rows @ step, free, named
        )
        conflicts = conflict_sentences(contradicting, problem.parameters, scaling.reference)
        pressed = _pressed(A.T @ r, problem.parameters, values, on_bound)
    mean, factor = _uncut(scaling, whole, width, pressed)
    posterior = truncated_normal(mean, factor, *_bounds_from_estimate(scaling, width, values))
    every_x, every_gap_x = _scaled(whole, width)
    # a prior is knowledge too: what is known from it alone has its number, and says so
    numbered = (determined | (known_enough & from_prior)) & varies
    numbers = _numbers(scaling, values, posterior, numbered, wider)
    square = np.ix_(named, named)
    gaps = describe_gaps(
        known, (np.outer(slope, slope) * (every_x + every_gap_x @ every_gap_x.T))[square]
    )
    tied = tied_sentences(known.parameters, numbers["correlation"][square], gaps)
    return Assessment(
        **numbers,
        beyond_bounds=numbered & _reaches_beyond(scaling, values, mean, factor, wider),
        at_bound=at_bound,
        determined=determined,
        from_prior=known_enough & from_prior,
        singular_values=known.readings.S[: min(len(B), len(known.parameters))],
        findings=(*gaps, *conflicts, *tied),
        slope=slope,
        posterior=posterior,
        uncut_mean=mean,
        uncut_factor=factor,
        determined_x=whole.determined_columns * width[:, None],
        gaps_x=every_gap_x,
        held_covariance_x=_scaled(held, width)[0],
        over=over,
        wider=wider,
    )


def _knowledge(
    parameters: tuple[Parameter, ...],
    values: Floats,
    at_bound: Bools,
    from_prior: Bools,
    B: Floats,
    P: Floats,
    width: Floats,
) -> Knowledge:
    """The singular directions of the parameters that the case names.

    The modes of fields, of which nothing single is said, are left free within their priors: with
    B_m their columns and P_m^T P_m their precision, the readings have the covariance
    I + B_m (P_m^T P_m)^-1 B_m^T beside (theory 10.4).

    Args:
        parameters: all n.
        values: (n,) SI.
        at_bound: (n,) on a bound.
        from_prior: (n,) known from the prior only.
        B: (g, n) whitened readings by z.
        P: (k, n) rows of the priors by z.
        width: (n,) range by slope, SI.
    """
    named = np.array([not q.field for q in parameters], dtype=np.bool_)
    if not named.all():
        rows = np.abs(P[:, ~named]).max(axis=1, initial=0.0) > 0.0
        scaled = B[:, ~named] / np.abs(P[rows][:, ~named]).max(axis=0)
        modes = Covariance(np.ones(len(B)), SharedErrors(sp.csr_array(scaled)))
        B, P = modes.whiten(B[:, named]), P[~rows][:, named]
    taken, varies = np.flatnonzero(named), width[named] > 0.0
    return Knowledge(
        tuple(parameters[i] for i in taken),
        values[named],
        at_bound[named],
        from_prior[named],
        P,
        width[named],
        SingularDirections.of(np.concatenate([B, P]), varies),
        SingularDirections.of(B, varies),
    )


def _pressed(
    gradient: Floats, parameters: tuple[Parameter, ...], values: Floats, on_bound: Bools
) -> Floats:
    """The gradient (n,) of phi / 2 in z that holds parameters on their bounds; zero elsewhere."""
    middle = np.array([0.5 * (q.lower + q.upper) for q in parameters])
    inwards = np.where(values <= middle, 1.0, -1.0)
    return np.where(on_bound & (gradient * inwards > 0.0), gradient, 0.0)


def _uncut(
    scaling: Scaling, whole: SingularDirections, width: Floats, pressed: Floats
) -> tuple[Floats, Floats]:
    """Mean (n,) and factor (n, q) of the normal posterior in x, from the estimate, before the cut.

    Args:
        scaling: with the bounds.
        whole: directions of readings and priors in z.
        width: (n,) of the parameters in x.
        pressed: (n,) the gradient in z that bounds hold.
    """
    unbounded = ~np.isfinite(scaling.upper - scaling.lower)
    open_ended = np.abs(whole.V[unbounded]).max(axis=0, initial=0.0) > 0.01
    widest = np.where(open_ended, 1.0, FLAT) * whole.extent
    size = 1.0 / np.maximum(whole.S, 1.0 / widest)
    factor = width[:, None] * whole.V * size
    return -factor @ (size * (whole.V.T @ pressed)), factor


def _bounds_from_estimate(scaling: Scaling, width: Floats, values: Floats) -> tuple[Floats, Floats]:
    """The bounds (n,), (n,) in x from the estimate; infinite for parameters that are given."""
    x, fixed = scaling.to_scaled(values), width <= 0.0
    return (
        np.where(fixed, -np.inf, np.minimum(scaling.lower - x, 0.0)),
        np.where(fixed, np.inf, np.maximum(scaling.upper - x, 0.0)),
    )


def with_posterior(
    assessment: Assessment, problem: Problem, values: Floats, posterior: Posterior
) -> Assessment:
    """An assessment with the numbers of another posterior.

    What the linearised model takes as determined stays so only as far as its interval agrees: to
    no side more than half of the range from the estimate.

    Args:
        assessment: as it was.
        problem: the parameters.
        values: (n,) the estimate, SI.
        posterior: of x, from the estimate.
    """
    scaling, numbered = Scaling(problem.parameters), np.isfinite(assessment.sd)
    low, high = _ends(scaling, values, posterior, assessment.wider)
    lost = assessment.determined & (np.maximum(-low, high) > 0.5 * _ranges(scaling))
    lost &= np.array([not q.field for q in problem.parameters], dtype=np.bool_)
    numbers = _numbers(scaling, values, posterior, numbered & ~lost, assessment.wider)
    findings = assessment.findings
    if lost.any():
        names = [problem.parameters[i].name for i in np.flatnonzero(lost)]
        verb, seem = ("is", "it seems") if len(names) == 1 else ("are", "they seem")
        findings += (
            f"{join(names)} {verb} not determined: near the estimate {seem} to be known, but "
            "values far from it fit the readings nearly as well.",
        )
    return replace(
        assessment,
        posterior=posterior,
        determined=assessment.determined & ~lost,
        beyond_bounds=assessment.beyond_bounds & ~lost,
        findings=findings,
        **numbers,
    )


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


def _numbers(
    scaling: Scaling, values: Floats, posterior: Posterior, numbered: Bools, wider: Floats
) -> dict[str, Any]:
    """Deviations, intervals and covariance, SI, of the parameters (n,) that have numbers."""
    slope = scaling.slope(values)
    sd_x = np.where(numbered, np.sqrt(np.diag(posterior.covariance)), np.nan)
    low, high = _ends(scaling, values, posterior, wider)
    return {
        "sd": slope * sd_x,
        "lower95": np.where(numbered, scaling.away(values, low), np.nan),
        "upper95": np.where(numbered, scaling.away(values, high), np.nan),
        "covariance": _only(numbered, np.outer(slope, slope) * posterior.covariance),
        "correlation": _only(numbered, posterior.covariance / np.outer(sd_x, sd_x)),
    }


def _ends(
    scaling: Scaling, values: Floats, posterior: Posterior, wider: Floats
) -> tuple[Floats, Floats]:
    """Ends (n,) of the 95 % intervals in x, from the estimate, which is among them.

    They are farther out by factors (n, 2), but not beyond the bounds.
    """
    n, x = len(values), scaling.to_scaled(values)
    first, last = scaling.lower - x, scaling.upper - x
    drawn = posterior.summary(np.eye(n), limits=(first, last))
    low = np.maximum(drawn.lower95 * wider[:, 0], first)
    high = np.minimum(drawn.upper95 * wider[:, 1], last)
    return np.minimum(low, 0.0), np.maximum(high, 0.0)


def _reaches_beyond(
    scaling: Scaling, values: Floats, mean: Floats, factor: Floats, wider: Floats
) -> Bools:
    """Whether the normal interval of a parameter (n,) goes beyond a bound, where it is cut."""
    half = NORMAL_95 * np.linalg.norm(factor, axis=1)[:, None] * wider
    x = scaling.to_scaled(values) + mean
    below, above = x - half[:, 0] < scaling.lower, x + half[:, 1] > scaling.upper
    return np.asarray(below | above, dtype=np.bool_)


def _only(kept: Bools, matrix: Floats) -> Floats:
    """The matrix (n, n) with NaN in the rows and columns that are not kept (n,)."""
    return np.where(np.outer(kept, kept), matrix, np.nan)
