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

from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import scipy.sparse as sp

from geoident.identify.assessment.conflicts import conflict_findings, prior_conflicts, tied_findings
from geoident.identify.assessment.findings import Knowledge, describe_gaps, join, only_prior
from geoident.identify.assessment.spectrum import SingularDirections, admissible_ranges
from geoident.identify.assessment.truncated_normal import Posterior, truncated_normal
from geoident.identify.assessment.unknown_variances import OverAccuracies
from geoident.identify.problem.problem import Problem
from geoident.identify.problem.scaling import Scaling
from geoident.identify.problem.shared_errors import Covariance, SharedErrors
from geoident.model.arrays import Bools, Floats
from geoident.model.parameter import Parameter
from geoident.model.results.bands import NORMAL_95
from geoident.model.results.findings import Finding
from geoident.units import in_unit, shown_unit

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
        findings: what is not determined and what only a prior fixes.
        dp_dx: (n,) derivatives of the parameters by the scaled ones, SI.
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
    findings: tuple[Finding, ...]
    dp_dx: Floats
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
    dp_dx, width = scaling.dp_dx(values), admissible_ranges(scaling)
    B = problem.whiten(jacobian * dp_dx) * width
    P = scaling.prior_jacobian(values) * width
    A, varies = np.concatenate([B, P]), width > 0.0
    below, above = values - problem.bounds[0], problem.bounds[1] - values
    on_bound = np.minimum(np.abs(below), np.abs(above)) <= 1e-12 * dp_dx * width  # by rounding
    at_bound = ~varies | on_bound
    whole, held = SingularDirections.of(A, varies), SingularDirections.of(A, ~at_bound)
    undetermined = np.linalg.norm(whole.undetermined_columns, axis=1)
    total = np.hypot(np.linalg.norm(whole.determined_columns, axis=1), undetermined)
    from_prior = np.abs(P).max(axis=0, initial=0.0) * total >= PRIOR_SHARE
    known_enough = (NORMAL_95 * wider.max(axis=1) * total <= 0.5) & (
        NORMAL_95 * undetermined <= 0.25
    )
    determined = known_enough & ~from_prior
    named = np.array([not q.field for q in problem.parameters], dtype=np.bool_)
    held_x = held.determined_covariance * np.outer(width, width)
    pressed = np.zeros(len(values))
    conflicts: tuple[Finding, ...] = ()
    if readings is not None:
        of_priors, rows = scaling.prior_residuals(values), scaling.prior_jacobian(values)
        r = np.concatenate([problem.whiten(readings - problem.measured), of_priors])
        gradient = A.T @ r
        inwards = np.where(below <= above, 1.0, -1.0)
        pressed = np.where(on_bound & (gradient * inwards > 0.0), gradient, 0.0)
        # to the least misfit: a point of a grid is beside it
        step = -held_x @ np.divide(gradient, width, out=np.zeros_like(width), where=varies)
        contradicting = prior_conflicts(
            scaling.to_scaled(values) + step, rows, of_priors + rows @ step, held_x, named
        )
        conflicts = conflict_findings(contradicting, problem.parameters, scaling.reference)
    mean, factor = _uncut(scaling, whole, width, pressed)
    x = scaling.to_scaled(values)
    posterior = truncated_normal(
        mean,
        factor,
        np.where(varies, np.minimum(scaling.lower - x, 0.0), -np.inf),
        np.where(varies, np.maximum(scaling.upper - x, 0.0), np.inf),
    )
    # a prior is knowledge too: what is known from it alone has its number, and says so
    numbered = (determined | (known_enough & from_prior)) & varies
    numbers = _numbers(scaling, values, posterior, numbered, wider)
    half = NORMAL_95 * np.linalg.norm(factor, axis=1)[:, None] * wider
    beyond = (x + mean - half[:, 0] < scaling.lower) | (x + mean + half[:, 1] > scaling.upper)
    known = _knowledge(problem.parameters, values, at_bound, from_prior, B, P, dp_dx * width)
    size, square = dp_dx * width, np.ix_(named, named)
    every = whole.determined_covariance + whole.undetermined_columns @ whole.undetermined_columns.T
    gaps = describe_gaps(known, (np.outer(size, size) * every)[square])
    tied = tied_findings(known.parameters, numbers["correlation"][square], gaps)
    said = {q for gap in gaps if gap.kind in _GAPS for q in gap.subject.split(", ")}
    unsaid = np.array([q.name not in said for q in problem.parameters], dtype=np.bool_)
    leaning = named & varies & ~numbered & ~from_prior & unsaid
    by_bounds = _by_bounds_of_others(problem, values, posterior, leaning, wider)
    return Assessment(
        **numbers,
        beyond_bounds=numbered & beyond,
        at_bound=at_bound,
        determined=determined,
        from_prior=known_enough & from_prior,
        singular_values=known.readings.S[: min(len(B), len(known.parameters))],
        findings=(*gaps, *by_bounds, *conflicts, *tied),
        dp_dx=dp_dx,
        posterior=posterior,
        uncut_mean=mean,
        uncut_factor=factor,
        determined_x=whole.determined_columns * width[:, None],
        gaps_x=whole.undetermined_columns * width[:, None],
        held_covariance_x=held_x,
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
        width: (n,) admissible ranges, SI.
    """
    named = np.array([not q.field for q in parameters], dtype=np.bool_)
    if not named.all():
        rows = np.abs(P[:, ~named]).max(axis=1, initial=0.0) > 0.0
        scaled = B[:, ~named] / np.abs(P[rows][:, ~named]).max(axis=0)
        modes = Covariance(np.ones(len(B)), SharedErrors(sp.csr_array(scaled)))
        B, P = modes.whiten(B[:, named]), P[~rows][:, named]
    varies = width[named] > 0.0
    return Knowledge(
        tuple(q for q in parameters if not q.field),
        values[named],
        at_bound[named],
        from_prior[named],
        P,
        width[named],
        SingularDirections.of(np.concatenate([B, P]), varies),
        SingularDirections.of(B, varies),
    )


def _by_bounds_of_others(
    problem: Problem, values: Floats, posterior: Posterior, leaning: Bools, wider: Floats
) -> Iterator[Finding]:
    """Why parameters (n,) have no number though draws of the posterior know them.

    What they lack is in directions that only bounds of other parameters limit.
    """
    scaling = Scaling(problem.parameters)
    low, high = _ends(scaling, values, posterior, wider)
    narrow = high - low <= 0.5 * admissible_ranges(scaling)
    ends = scaling.away(values, low), scaling.away(values, high)
    for i in np.flatnonzero(leaning & narrow).tolist():
        parameter = problem.parameters[i]
        unit = parameter.unit, parameter.dimension
        least, most = (f"{in_unit(float(end[i]), *unit):.3g}" for end in ends)
        between = f"{least} to {most} {shown_unit(*unit)}".rstrip()
        sentence = (
            f"{parameter.name} is not determined by itself: it depends on parameters of which only "
            f"their bounds are known. As far as these bounds are right, 95 % of `geoident sample` "
            f"lie within {between}."
        )
        yield Finding("not-determined", parameter.name, sentence)


def _uncut(
    scaling: Scaling, whole: SingularDirections, width: Floats, pressed: Floats
) -> tuple[Floats, Floats]:
    """Mean (n,) and factor (n, q) of the normal posterior in x, from the estimate, before the cut.

    Args:
        scaling: with the bounds.
        whole: directions of readings and priors in z.
        width: (n,) of the parameters in x.
        pressed: (n,) the gradient of phi / 2 in z that holds parameters on their bounds; else zero.
    """
    unbounded = ~np.isfinite(scaling.upper - scaling.lower)
    open_ended = np.abs(whole.V[unbounded]).max(axis=0, initial=0.0) > 0.01
    widest = np.where(open_ended, 1.0, FLAT) * whole.extent
    size = 1.0 / np.maximum(whole.S, 1.0 / widest)
    factor = width[:, None] * whole.V * size
    return -factor @ (size * (whole.V.T @ pressed)), factor


def with_posterior(
    assessment: Assessment, problem: Problem, values: Floats, posterior: Posterior
) -> Assessment:
    """An assessment with the numbers of another posterior.

    What the linearised model takes as determined stays so only as far as its interval agrees: to
    no side more than half of the range from the estimate. What it takes as not determined is, if
    its interval has at most half of the range and is narrower than that of its prior: at a bound a
    model may hardly depend on what it depends on beyond.

    Args:
        assessment: as it was.
        problem: the parameters.
        values: (n,) the estimate, SI.
        posterior: of x, from the estimate.
    """
    scaling, named = Scaling(problem.parameters), ~is_field(problem)
    low, high = _ends(scaling, values, posterior, assessment.wider)
    width = admissible_ranges(scaling)
    lost = named & assessment.determined & (np.maximum(-low, high) > 0.5 * width)
    rows = np.abs(scaling.prior_jacobian(values)).max(axis=0, initial=0.0)
    by_prior = rows * np.sqrt(np.diag(posterior.covariance)) >= PRIOR_SHARE
    numbered = np.isfinite(assessment.sd)
    gained = named & ~numbered & ~by_prior & (high - low <= 0.5 * width) & (width > 0.0)
    numbers = _numbers(scaling, values, posterior, (numbered & ~lost) | gained, assessment.wider)
    # known from its prior, or better, other than the linearised model says
    held = named & assessment.determined & ~lost & by_prior
    freed = named & assessment.from_prior & ~by_prior & (high - low <= 0.5 * width)
    determined = (assessment.determined & ~lost & ~held) | gained | freed
    names = [q.name for q in problem.parameters]
    known = {name for name, is_known in zip(names, determined.tolist(), strict=True) if is_known}
    findings = tuple(
        finding
        for finding in assessment.findings
        if finding.kind not in _GAPS or not gained.any() or set(finding.subject.split(", ")) - known
    )
    better = {names[i] for i in np.flatnonzero(freed)}
    findings = tuple(
        one for one in findings if one.kind != "only-prior" or one.subject not in better
    )
    findings += tuple(only_prior(names[i]) for i in np.flatnonzero(held))
    if lost.any():
        undetermined = [names[i] for i in np.flatnonzero(lost)]
        verb, seem = ("is", "it seems") if len(undetermined) == 1 else ("are", "they seem")
        sentence = (
            f"{join(undetermined)} {verb} not determined: near the estimate {seem} to be known, "
            "but values far from it fit the readings nearly as well."
        )
        findings += (Finding("not-determined", ", ".join(undetermined), sentence),)
    return replace(
        assessment,
        posterior=posterior,
        determined=determined,
        from_prior=(assessment.from_prior & ~freed) | held,
        beyond_bounds=assessment.beyond_bounds & ~lost,
        gaps_x=np.where(gained[:, None], 0.0, assessment.gaps_x),
        findings=findings,
        **numbers,
    )


def with_numbers_of(known: Assessment, own: Assessment, j: int, problem: Problem) -> Assessment:
    """An assessment with what another knows of parameter j.

    Args:
        known: of all parameters.
        own: of the same, by a posterior that is right for j.
        j: the parameter.
        problem: the parameters.
    """
    name = problem.parameters[j].name

    def taken(of_all: Any, of_own: Any) -> Any:
        of_all = of_all.copy()
        of_all[j] = of_own[j]
        return of_all

    columns = (
        "sd", "lower95", "upper95", "beyond_bounds", "determined", "from_prior", "gaps_x"
    )  # fmt: skip
    numbers = {each: taken(getattr(known, each), getattr(own, each)) for each in columns}
    correlation = known.correlation
    if not np.isfinite(correlation[j, j]):  # else that with the others is of one posterior
        correlation = taken(taken(correlation, own.correlation).T, own.correlation.T).T
    numbers["correlation"] = correlation
    numbers["covariance"] = correlation * np.outer(numbers["sd"], numbers["sd"])
    before = {finding for finding in known.findings if finding.subject == name}
    of_own = {finding for finding in own.findings if finding.subject == name}
    findings = [one for one in known.findings if one not in before or one in of_own]
    findings += [one for one in own.findings if one in of_own and one not in before]
    return replace(known, findings=tuple(findings), **numbers)


_GAPS = ("not-determined", "not-separated")
"""Findings on what the readings leave open."""


def is_field(problem: Problem) -> Bools:
    """(n,) the parameter is a mode of a field, of which nothing single is said."""
    return np.array([bool(q.field) for q in problem.parameters], dtype=np.bool_)


def _numbers(
    scaling: Scaling, values: Floats, posterior: Posterior, numbered: Bools, wider: Floats
) -> dict[str, Any]:
    """Deviations, intervals and covariance, SI, of the parameters (n,) that have numbers."""
    dp_dx = scaling.dp_dx(values)
    sd_x = np.where(numbered, np.sqrt(np.diag(posterior.covariance)), np.nan)
    low, high = _ends(scaling, values, posterior, wider)
    C = np.where(np.outer(numbered, numbered), posterior.covariance, np.nan)
    return {
        "sd": dp_dx * sd_x,
        "lower95": np.where(numbered, scaling.away(values, low), np.nan),
        "upper95": np.where(numbered, scaling.away(values, high), np.nan),
        "covariance": np.outer(dp_dx, dp_dx) * C,
        "correlation": C / np.outer(sd_x, sd_x),
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
