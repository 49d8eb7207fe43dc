"""Other minima of a fit: kept up with the final weights, weighed against each other, and said.

A search hands on all minima that it came to (`Outcome.minima`). With accuracies or a model error
that are estimated afterwards phi changes, so a descent goes on from each; what is then not far
above the lowest is a rival (theory 12.1).
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np

from geoident.errors import ModelError
from geoident.identify.assessment.findings import join
from geoident.identify.assessment.laplace import laplace_mass, log_normalisation, log_prior_volume
from geoident.identify.assessment.normal_mixture import mixture_interval
from geoident.identify.least_squares.acceptance import Iterate
from geoident.identify.least_squares.several_starts import RIVAL, Angles, distinct_minima
from geoident.identify.problem.outcome import LocalMinimum, Outcome
from geoident.identify.problem.problem import Discrepancy, Problem
from geoident.model.arrays import Bools, Floats
from geoident.model.parameter import Parameter
from geoident.model.results.bands import Prediction
from geoident.model.results.findings import Finding
from geoident.model.results.result import STOPPED, ParameterTable
from geoident.model.results.rivals import SETTLED, Evidence, Rivals
from geoident.units import in_unit, shown_unit

APART = 2.0
"""Values of two minima that differ by more than this, in standard deviations, stand apart."""

MOST_SHOWN = 6
"""Parameters that are all named with a minimum; of more, those that stand apart."""

LOWER = 0.1
"""A minimum counts as lower than another one from this difference of phi on."""


def kept_up(
    problem: Problem,
    outcome: Outcome,
    minima: Sequence[LocalMinimum],
    search: Callable[[Problem], Outcome],
) -> Outcome:
    """An outcome with minima that were found with other weights, where these are now.

    Args:
        problem: with the final weights.
        outcome: of the search with them.
        minima: found before.
        search: goes down from where a problem begins.
    """
    history = list(outcome.iterations)
    moved = []
    for minimum in minima:
        if outcome.status == STOPPED:
            break
        try:
            again = search(problem.begun_at(minimum.values))
        except ModelError:  # which it had a solution of before: at the edge of collapse
            continue
        history += again.iterations
        if again.status == "converged":
            moved.append(LocalMinimum(again.values, again.objective))
    return replace(
        outcome,
        minima=tuple(sorted(moved, key=lambda minimum: minimum.objective)),
        iterations=tuple(history),
    )


def weighed_minima(
    problem: Problem, outcome: Outcome, computed: Floats, jacobian: Floats
) -> tuple[Rivals | None, Evidence | None]:
    """The rivals of an answer, None where it has none, and the evidence of the model.

    Args:
        problem: with the final weights.
        outcome: of the search; None is known of the evidence where it did not converge.
        computed: (g,) what the model says at the answer, SI.
        jacobian: (g, n) its derivative, SI.
    """
    if outcome.status != "converged":
        return None, None
    discrepancy = Discrepancy(problem)
    scaling, p = discrepancy.scaling, outcome.values
    best = Iterate(scaling.to_scaled(p), p, discrepancy.linearization_of(p, computed, jacobian))
    points = [best, *_near(discrepancy, outcome.minima, best.phi + RIVAL)]
    points = distinct_minima(points, Angles(problem.parameters, scaling))
    masses = [laplace_mass(point.linearization, point.x, scaling) for point in points]
    log_mass = np.array([mass for mass, _ in masses])
    evidence = _evidence(problem, best, computed, log_mass)
    if len(points) == 1:
        return None, evidence
    odds = np.exp(log_mass - log_mass.max())
    slopes = np.array([scaling.dp_dx(point.p) for point in points])
    covariance = np.array([covariance_x for _, covariance_x in masses])
    rivals = Rivals(
        values=np.array([point.p for point in points]),
        objectives=np.array([point.phi for point in points]),
        odds=odds / odds.sum(),
        covariance=slopes[:, :, None] * covariance * slopes[:, None, :],
    )
    return rivals, evidence


def _near(
    discrepancy: Discrepancy, minima: Sequence[LocalMinimum], highest: float
) -> list[Iterate]:
    """The minima with a phi of no more than the highest."""
    near = []
    for minimum in minima:
        if minimum.objective <= highest:
            p = minimum.values
            model = discrepancy.linearize(p)
            near.append(Iterate(discrepancy.scaling.to_scaled(p), p, model))
    return near


def _evidence(
    problem: Problem, best: Iterate, computed: Floats, log_mass: Floats
) -> Evidence | None:
    """The evidence of a model; None where a parameter has neither bounds nor a prior."""
    volume = log_prior_volume(problem.parameters)
    if not np.isfinite(volume):
        return None
    top = float(log_mass.max())
    total = top + float(np.log(np.exp(log_mass - top).sum()))
    constant = log_normalisation(problem, computed)
    prior = Discrepancy(problem).scaling.prior_residuals(best.p)
    likelihood = -0.5 * (best.phi - float(prior @ prior))
    return Evidence(
        log_evidence=total - volume - constant,
        log_likelihood=likelihood - constant,
        readings=len(problem.measured),
    )


def stand_apart(rivals: Rivals) -> Bools:
    """Parameters (n,) of which the minima that matter say different things."""
    sd = np.sqrt(np.diagonal(rivals.covariance, axis1=1, axis2=2))
    apart = np.sqrt(sd**2 + sd[0] ** 2)  # zero where bounds coincide, and with them the values
    distance = np.abs(rivals.values - rivals.values[0]) / np.maximum(apart, 1e-300)
    counts = rivals.odds >= min(0.5 * (1.0 - SETTLED), float(rivals.odds[0]))
    return np.asarray((distance > APART)[counts].any(axis=0), dtype=np.bool_)


def not_settled(rivals: Rivals | None) -> Bools | None:
    """Parameters (n,) that are not determined, as another minimum is too likely; None for none."""
    if rivals is None or rivals.settled:
        return None
    apart = stand_apart(rivals)
    return apart if apart.any() else None


def with_rivals(
    table: ParameterTable, parameters: Sequence[Parameter], rivals: Rivals | None
) -> ParameterTable:
    """The parameters with intervals that hold 95 % of the posterior of all minima.

    Where the lowest minimum is not settled as the answer, what the minima say differently of is not
    determined.

    Args:
        table: of the lowest minimum.
        parameters: the n unknowns.
        rivals: None where there are none.
    """
    if rivals is None:
        return table
    sd = np.sqrt(np.diagonal(rivals.covariance, axis1=1, axis2=2)).copy()
    sd[0] = np.where(np.isfinite(table.sd), table.sd, sd[0])
    log = np.array([q.scale == "log" for q in parameters])
    with np.errstate(divide="ignore", invalid="ignore"):
        centre = np.where(log, np.log(np.abs(rivals.values)), rivals.values)
        spread = np.where(log, sd / np.abs(rivals.values), sd)
    low, high = mixture_interval(rivals.odds, centre, spread)
    with np.errstate(over="ignore"):  # of what is no logarithm, and not taken
        low, high = np.where(log, np.exp(low), low), np.where(log, np.exp(high), high)
    known = np.isfinite(table.lower95) & np.isfinite(table.upper95)
    differs = not_settled(rivals)
    lost = np.zeros(len(known), dtype=np.bool_) if differs is None else differs
    known &= ~lost
    nothing = np.where(np.outer(~lost, ~lost), 0.0, np.nan)
    return replace(
        table,
        sd=np.where(lost, np.nan, table.sd),
        lower95=np.where(known, np.minimum(low, table.lower95), np.nan),
        upper95=np.where(known, np.maximum(high, table.upper95), np.nan),
        determined=table.determined & ~lost,
        covariance=table.covariance + nothing,
        correlation=table.correlation + nothing,
    )


def mixed_prediction(odds: Floats, parts: Sequence[Prediction]) -> Prediction:
    """Predictions of several minima as one: the means of the first, the bands of all.

    Args:
        odds: (k,) of the minima.
        parts: k predictions.
    """
    means, sds = np.array([q.mean for q in parts]), np.array([q.sd for q in parts])
    low, high = mixture_interval(odds / odds.sum(), means, sds)
    first = parts[0]
    weight = (odds / odds.sum()).reshape(-1, 1, 1)
    sd = np.sqrt((weight * (sds**2 + (means - first.mean) ** 2)).sum(axis=0))
    kept = np.isfinite(low) & np.isfinite(first.sd)
    return Prediction(
        mean=first.mean,
        sd=np.where(np.isfinite(first.sd), sd, first.sd),
        lower95=np.where(kept, np.minimum(low, first.lower95), first.lower95),
        upper95=np.where(kept, np.maximum(high, first.upper95), first.upper95),
    )


def rival_findings(rivals: Rivals | None, table: ParameterTable) -> tuple[Finding, ...]:
    """The other minima.

    Args:
        rivals: None where there are none.
        table: of the n parameters, in whose units they are said.
    """
    if rivals is None:
        return ()
    apart = stand_apart(rivals)
    shown = apart if len(apart) > MOST_SHOWN and apart.any() else np.ones_like(apart)
    count = "another minimum" if len(rivals) == 2 else f"{len(rivals) - 1} other minima"
    sentences = [
        f"The misfit has {count} nearly as low as that at {_place(rivals.values[0], shown, table)} "
        f"(misfit {rivals.objectives[0]:.4g}): {_others(rivals, shown, table)}."
    ]
    if rivals.settled:
        sentences.append("The intervals and bands cover all minima at 95 %.")
    elif apart.any():
        names = join([name for name, far in zip(table.names, apart, strict=True) if far])
        sentences.append(
            f"The readings cannot decide between them, so {names} "
            f"{'is' if apart.sum() == 1 else 'are'} not determined: an interval around one of them "
            "would hold less than 95 %. A reading where the predictions of the two differ, or a "
            "prior, would decide."
        )
    subject = ", ".join(name for name, far in zip(table.names, apart, strict=True) if far)
    numbers = {"minima": float(len(rivals))}
    return (Finding("other-minimum", subject, " ".join(sentences), numbers),)


def _others(rivals: Rivals, shown: Bools, table: ParameterTable) -> str:
    rest = zip(rivals.values[1:], rivals.objectives[1:], rivals.odds[1:], strict=True)
    return "; ".join(
        f"{_place(values, shown, table)} (misfit {phi:.4g}, odds {_ratio(part / rivals.odds[0])})"
        for values, phi, part in rest
    )


def _place(values: Floats, shown: Bools, table: ParameterTable) -> str:
    parts = []
    for i in np.flatnonzero(shown).tolist():
        unit = table.units[i], table.dimensions[i]
        text = f"{table.names[i]} {in_unit(float(values[i]), *unit):.3g} {shown_unit(*unit)}"
        parts.append(text.rstrip())
    return ", ".join(parts)


def _ratio(odds: float) -> str:
    """Odds in words.

    >>> _ratio(0.25), _ratio(1.6), _ratio(1e-9)
    ('1 to 4', '1.6 to 1', '1 to over 1000')
    """
    if odds >= 1.0:
        return f"{odds:.2g} to 1"
    return f"1 to {1.0 / odds:.2g}" if odds > 1e-3 else "1 to over 1000"
