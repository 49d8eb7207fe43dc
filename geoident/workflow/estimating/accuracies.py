"""Accuracies that a case wants estimated: found with the parameters, and put in their place.

Parameters and variance components take turns: at the parameters of least misfit the components of
highest restricted likelihood, with these the parameters again, until neither changes.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from geoident.identify.assessment.findings import join
from geoident.identify.assessment.variance_components import (
    VarianceComponents,
    estimate_components,
    likelihood_at,
)
from geoident.identify.problem.errors import ErrorStructure
from geoident.identify.problem.outcome import Outcome
from geoident.identify.problem.problem import Problem
from geoident.model.arrays import Floats
from geoident.model.case import Case
from geoident.model.gauges import PARTS, Channel, ErrorParts, Reads
from geoident.model.results.result import STOPPED, AccuracyTable
from geoident.units import DIMENSIONLESS

ROUNDS = 30
"""At most so many times parameters and accuracies take turns."""

AT_REST = 1e-3
"""Change of the logarithm of a variance that ends it."""

WORTH_SAYING = 1.5
"""Factor on stated accuracies, as sure as 95 %, from which on it is said."""


@dataclass(frozen=True)
class Weighed:
    """Parameters and accuracies that go together.

    Args:
        problem: with the accuracies.
        outcome: of the search for the parameters.
        components: what is known of the accuracies.
    """

    problem: Problem
    outcome: Outcome
    components: VarianceComponents


def weighed(
    problem: Problem,
    structure: ErrorStructure,
    outcome: Outcome,
    search: Callable[[Problem], Outcome],
) -> Weighed:
    """Parameters and accuracies, in turns.

    Args:
        problem: with the accuracies to begin with.
        structure: the errors of its readings.
        outcome: of the first search.
        search: for the parameters, from where the problem begins.
    """
    t = np.zeros(len(structure.names))
    found = _components(problem, structure, outcome, t)
    for _ in range(ROUNDS):
        if outcome.status == STOPPED or np.abs(found.log_factor - t).max() <= AT_REST:
            return Weighed(problem, outcome, found)
        t = found.log_factor
        sd, shared = structure.at(t)
        problem = replace(problem, sd=sd, shared=shared).begun_at(outcome.values)
        outcome = after(outcome, search(problem))
        found = _components(problem, structure, outcome, t)
    remark = f"parameters and estimated accuracies did not come to rest in {ROUNDS} rounds"
    return Weighed(problem, replace(outcome, remarks=(*outcome.remarks, remark)), found)


def _components(
    problem: Problem, structure: ErrorStructure, outcome: Outcome, t: Floats
) -> VarianceComponents:
    readings, jacobian = problem.response.evaluate(outcome.values)
    likelihood = likelihood_at(problem, structure, outcome.values, readings, jacobian)
    return estimate_components(likelihood, t)


def after(first: Outcome, second: Outcome) -> Outcome:
    """The second of two searches, with the history of both.

    Args:
        first: the search before.
        second: from where that ended.
    """
    return replace(
        second,
        remarks=tuple(dict.fromkeys((*first.remarks, *second.remarks))),
        iterations=(*first.iterations, *second.iterations),
        grid=second.grid or first.grid,
    )


def with_accuracies(case: Case, factors: Mapping[str, float]) -> Case:
    """A case with the accuracies that were estimated.

    Args:
        case: as it was written.
        factors: component to the factor on the standard deviations that belong to it.
    """
    return replace(case, channels=tuple(_sized(c, factors) for c in case.channels))


def _sized(channel: Channel, factors: Mapping[str, float]) -> Channel:
    parts = channel.errors
    if parts is None or not parts.estimated:
        return channel
    sizes = {
        part: getattr(parts, part) * factors.get(parts.component(part) or "", 1.0) for part in PARTS
    }
    sized = replace(parts, **sizes, estimated=())
    return replace(channel, errors=sized, accuracy=sized.total(channel.along))


def with_scatter(case: Case, factor: float, zero: float) -> Case:
    """A case whose gauges have errors beside what it states.

    Args:
        case: as it is.
        factor: on all standard deviations.
        zero: error of the zero of each channel that has one, in accuracies of a reading as it
            scatters then; 0 for what is stated.
    """

    def scattering(channel: Channel) -> Channel:
        if channel.errors is None and (zero == 0.0 or channel.reads is not Reads.CHANGE):
            return replace(channel, accuracy=factor * channel.accuracy)
        parts = channel.errors or ErrorParts(channel.accuracy)
        sizes = {part: factor * getattr(parts, part) for part in PARTS}
        if zero > 0.0 and channel.reads is Reads.CHANGE:
            sizes["zero"] = zero * sizes["reading"]
        mesh = tuple((stage, factor * size, factor * doubt) for stage, size, doubt in parts.mesh)
        errors = replace(parts, **sizes, mesh=mesh)
        return replace(channel, errors=errors, accuracy=errors.total(channel.along))

    return replace(
        case,
        channels=tuple(scattering(channel) for channel in case.channels),
        readings=tuple(
            r if r.accuracy is None else replace(r, accuracy=factor * r.accuracy)
            for r in case.readings
        ),
    )


def accuracy_table(
    case: Case, names: Sequence[str], components: VarianceComponents
) -> AccuracyTable:
    """What was estimated, in standard deviations.

    Args:
        case: before the estimation.
        names: of the components.
        components: what is known of them.
    """
    owners = [_owner(case, name) for name in names]
    base = np.array([size for _, _, size in owners], dtype=np.float64)
    lower, value, upper = (
        base * np.exp(0.5 * t) for t in (components.lower, components.log_factor, components.upper)
    )
    return AccuracyTable(
        names=tuple(names),
        values=value,
        lower95=lower,
        upper95=upper,
        parts=tuple(part for _, part, _ in owners),
        dimensions=tuple(c.dimension if part else DIMENSIONLESS for c, part, _ in owners),
        units=tuple(c.unit if part else "" for c, part, _ in owners),
    )


def _owner(case: Case, name: str) -> tuple[Channel, str, float]:
    """A channel with a component, the part (empty for a common factor) and its size before, SI."""
    channels = [c for c in case.channels if c.errors and name in dict(c.errors.estimated).values()]
    kind, _, part = name.partition(": ")
    # gauges of another kind that share a set-up come last: their size of it may be another
    for channel in sorted(channels, key=lambda c: c.kind != kind):
        if part and channel.errors and channel.errors.component(part) == name:
            return channel, part, float(getattr(channel.errors, part))
    return channels[0], "", 1.0


def accuracy_findings(table: AccuracyTable) -> tuple[str, ...]:
    """Sentences on accuracies that cannot be told apart, or are not as they were stated."""
    apart = [name for name, known in zip(table.names, table.determined, strict=True) if not known]
    said = []
    if len(apart) > 1:
        said.append(
            f"The readings cannot separate the errors {join(apart)}: their ratio is as it was "
            "assumed, and only what they make up together is estimated."
        )
    elif apart:
        said.append(f"The readings do not determine the errors {apart[0]}: it is as assumed.")
    for k, name in enumerate(table.names):
        factor = f"{table.values[k]:.2g} times"
        interval = f"(95 %: {table.lower95[k]:.2g} to {table.upper95[k]:.2g})"
        if table.parts[k] or not table.determined[k]:
            continue
        if table.lower95[k] > WORTH_SAYING or table.upper95[k] < 1.0 / WORTH_SAYING:
            said.append(
                f"The errors of gauges of the kind {name} are {factor} what their accuracy states "
                f"{interval}; all intervals and bands are those of the estimated accuracies."
            )
    return tuple(said)
