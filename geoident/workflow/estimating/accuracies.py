"""Accuracies that a case wants estimated: found with the parameters, and put in their place.

Parameters and variance components take turns: at the parameters of least misfit the components of
highest restricted likelihood, with these the parameters again, until neither changes.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from geoident.identify.assessment.findings import join
from geoident.identify.assessment.unknown_variances import freedom, with_possible
from geoident.identify.assessment.variance_components import (
    Likelihood,
    VarianceComponents,
    estimate_components,
    likelihood_at,
)
from geoident.identify.problem.outcome import Outcome
from geoident.identify.problem.problem import Problem
from geoident.identify.problem.shared_errors import ErrorStructure
from geoident.model.arrays import Bools, Floats, Ints
from geoident.model.case import Case
from geoident.model.gauges import PARTS, Channel, Reads
from geoident.model.results.findings import Finding
from geoident.model.results.result import STOPPED, AccuracyTable
from geoident.units import DIMENSIONLESS
from geoident.workflow.running.readings import ChannelReading, error_structure

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
    likelihood, components = _components(problem, structure, outcome, t)
    for _ in range(ROUNDS):
        if outcome.status == STOPPED or np.abs(components.log_factor - t).max() <= AT_REST:
            return Weighed(problem, outcome, with_possible(likelihood, components))
        t = components.log_factor
        sd, shared = structure.at(t)
        problem = replace(problem, sd=sd, shared=shared).begun_at(outcome.values)
        outcome = after(outcome, search(problem))
        likelihood, components = _components(problem, structure, outcome, t)
    remark = f"parameters and estimated accuracies did not come to rest in {ROUNDS} rounds"
    outcome = replace(outcome, remarks=(*outcome.remarks, remark))
    return Weighed(problem, outcome, with_possible(likelihood, components))


def _components(
    problem: Problem, structure: ErrorStructure, outcome: Outcome, t: Floats
) -> tuple[Likelihood, VarianceComponents]:
    readings, jacobian = problem.response.evaluate(outcome.values)
    likelihood = likelihood_at(problem, structure, outcome.values, readings, jacobian)
    return likelihood, estimate_components(likelihood, t)


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
    sized = replace(parts, **sizes, estimated=(), already_estimated=parts.estimated)
    return replace(channel, errors=sized, accuracy=sized.total(channel.along))


def with_found(case: Case, table: AccuracyTable) -> Case:
    """A case with gauges of the kinds whose accuracies were estimated from other readings.

    Args:
        case: as it was written.
        table: what was estimated.
    """
    known = list(zip(table.names, table.parts, table.values.tolist(), strict=True))

    def sized(channel: Channel) -> Channel:
        parts = channel.errors
        if parts is None:
            return channel
        before = {name: getattr(parts, part) if part else 1.0 for name, part, _ in known}
        return _sized(channel, {name: v / before[name] for name, _, v in known if before[name]})

    return replace(case, channels=tuple(sized(channel) for channel in case.channels))


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
        parts = channel.error_parts
        sizes = {part: factor * getattr(parts, part) for part in PARTS}
        if zero > 0.0 and channel.reads is Reads.CHANGE:
            sizes["zero"] = zero * sizes["reading"]
        mesh, steps = (
            tuple((stage, factor * size, factor * doubt) for stage, size, doubt in computed)
            for computed in (parts.mesh, parts.steps)
        )
        errors = replace(parts, **sizes, mesh=mesh, steps=steps)
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
    possible = components.possible
    numbers = {name: number for number, name in enumerate(names)}
    own = {c.name: c.errors.component("reading") for c in case.channels if c.errors is not None}
    of_reading = [
        numbers.get(own.get(r.channel) or "", -1) if r.accuracy is None else -1
        for r in case.readings
    ]
    beside = {} if possible is None else possible._asdict()
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
        of_reading=np.array(of_reading, dtype=np.int64),
        **beside,
    )


@dataclass(frozen=True)
class Possible:
    """Accuracies that were estimated, and those that are possible beside them.

    Args:
        table: of the estimates.
        own: (g,) numbers of the components of the own errors of the g readings that are used.
    """

    table: AccuracyTable
    own: Ints

    @classmethod
    def of(cls, table: AccuracyTable | None, used: Bools) -> Possible | None:
        """Of the readings (k,) that are used; None where there is nothing beside the estimates."""
        if table is None or not len(table.odds):
            return None
        return cls(table, table.of_reading[used])

    def structure(self, rows: Sequence[ChannelReading]) -> ErrorStructure:
        """The errors of the readings used, and of later ones below them, by these components."""
        return error_structure(rows, self.table, self.own)

    def problems(self, problem: Problem, structure: ErrorStructure) -> list[Problem]:
        """The problem at the estimates and at all that is possible beside them.

        Args:
            problem: the readings used.
            structure: their errors by these components, and maybe others.
        """
        return [problem, *(self._at(problem, structure, t) for t in self.padded(structure))]

    def padded(self, structure: ErrorStructure) -> Floats:
        """Logarithms of factors (K, c) on all components of a structure."""
        more = len(structure.names) - len(self.table.names)
        return np.pad(self.table.points, ((0, 0), (0, more)))

    def _at(self, problem: Problem, structure: ErrorStructure, t: Floats) -> Problem:
        sd, shared = structure.at(t)
        return replace(problem, sd=sd, shared=shared)


def _owner(case: Case, name: str) -> tuple[Channel, str, float]:
    """A channel with a component, the part (empty for a common factor) and its size before, SI."""
    channels = [c for c in case.channels if c.errors and name in dict(c.errors.estimated).values()]
    kind, _, part = name.partition(": ")
    # gauges of another kind that share a set-up come last: their size of it may be another
    for channel in sorted(channels, key=lambda c: c.kind != kind):
        if part and channel.errors and channel.errors.component(part) == name:
            return channel, part, float(getattr(channel.errors, part))
    return channels[0], "", 1.0


FEW = 5.0
"""Degrees of freedom below which intervals are said to be rough."""


def freedom_notes(
    table: AccuracyTable, wider: Floats, names: Sequence[str]
) -> tuple[tuple[Finding, ...], tuple[str, ...]]:
    """On how many degrees of freedom intervals rest: findings where these are few, else notes.

    Args:
        table: of the accuracies.
        wider: (n, 2) by how much the ends of the intervals are farther out for that.
        names: of the n parameters.
    """
    if not len(table.odds):
        return (), ()
    size = wider.mean(axis=1)
    nu = freedom(size)
    each = [f"{name} {_count(one)}" for name, one in zip(names, nu.tolist(), strict=True)]
    same = len({_count(one) for one in nu.tolist()}) == 1
    on = f"{_count(float(nu[0]))}" if same else join(each)
    note = (
        f"The accuracies are estimated from the residuals, and intervals and bands allow for "
        f"their uncertainty: they have {on} degrees of freedom (Student's t), so the "
        f"intervals are {_times(size)} as wide as with these accuracies given."
    )
    if nu.min() >= FEW:
        return (), (note,)
    sentence = (
        f"{note} So few determine the accuracies poorly: the intervals may hold a few per cent "
        "less than 95 %. More readings, or accuracies that are stated, would do."
    )
    numbers = {"degrees_of_freedom": float(nu.min())}
    return (Finding("degrees-of-freedom", ", ".join(names), sentence, numbers),), ()


def _count(freedom: float) -> str:
    return f"{freedom:.2g}" if freedom < 100.0 else "over 100"


def _times(size: Floats) -> str:
    low, high = (f"{x:.3g}" for x in (size.min(), size.max()))
    return f"{low} times" if low == high else f"{low} to {high} times"


def accuracy_findings(table: AccuracyTable, *, correlated: bool = False) -> Iterator[Finding]:
    """Accuracies that cannot be told apart, or are not as they were stated.

    Args:
        table: those that were estimated.
        correlated: residuals of neighbours go together, which no accuracy explains.
    """
    apart = [name for name, known in zip(table.names, table.determined, strict=True) if not known]
    if len(apart) > 1:
        yield Finding(
            "accuracy",
            ", ".join(apart),
            f"The readings cannot separate the errors {join(apart)}: their ratio is as it was "
            "assumed, and only what they make up together is estimated.",
        )
    elif apart:
        sentence = f"The readings do not determine the errors {apart[0]}: it is as assumed."
        yield Finding("accuracy", apart[0], sentence)
    for k, name in enumerate(table.names):
        factor = f"{table.values[k]:.2g} times"
        interval = f"(95 %: {table.lower95[k]:.2g} to {table.upper95[k]:.2g})"
        if table.parts[k] or not table.determined[k]:
            continue
        if table.lower95[k] > WORTH_SAYING or table.upper95[k] < 1.0 / WORTH_SAYING:
            sentence = (
                f"The errors of gauges of the kind {name} are {factor} what their accuracy states "
                f"{interval}; all intervals and bands are those of the estimated accuracies."
            )
            if correlated:
                sentence = (
                    f"As scatter the residuals of the kind {name} would be {factor} what their "
                    f"accuracy states {interval}. But they go together, so it is the model that "
                    "differs: intervals and bands by these accuracies are too narrow."
                )
            yield Finding(
                "accuracy",
                name,
                sentence,
                {
                    "factor": float(table.values[k]),
                    "lower95": float(table.lower95[k]),
                    "upper95": float(table.upper95[k]),
                },
            )
