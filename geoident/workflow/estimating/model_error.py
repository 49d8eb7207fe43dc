"""The error of the model as errors that readings share (theory 9).

What a stage adds to a computed reading may be wrong by a part eta of itself, alike where gauges are
near to each other, and three quarters of it alike in all stages:

    C = eta^2 [ (1 - t) sum_j (D_j R D_j + F_j M F_j) + t (sum_j D_j) R (sum_j D_j) + ... ]

D_j are the signed steps, so nothing depends on which direction counts as positive. R is the
correlation of relative errors. F_j M F_j is an error that a reading has however little it changes:
of a field of displacements as large as a tenth of what the gauges feel, at the points of the gauge.

An error is known by its rows: the steps of each reading and where its gauge is. Rows of the
readings used and of later ones together give the columns of shared errors (theory 7), in which
both are one.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
import scipy.sparse as sp

from geoident.forward.gauges.observation import reads_displacements
from geoident.forward.protocols import CaseModel
from geoident.identify.assessment.diagnostics import effective_sd
from geoident.identify.assessment.findings import join
from geoident.identify.assessment.model_error import (
    PRIOR_SD,
    SIZES,
    SizeWeights,
    at_size,
    weigh_sizes,
)
from geoident.identify.assessment.variance_components import (
    RestrictedLikelihood,
    VarianceComponents,
    estimate_components,
    likelihood_at,
)
from geoident.identify.problem.errors import ErrorStructure
from geoident.identify.problem.problem import STOPPED, HasIncrements, Outcome, Problem
from geoident.model.arrays import Bools, Floats, Ints
from geoident.model.case import Case
from geoident.model.gauges import Channel, ReadingTable
from geoident.model.methods import (
    ComplementarityOptions,
    MethodOptions,
    ModelErrorOptions,
    ScanOptions,
    SquaredOptions,
)
from geoident.model.results.model_error import USUAL, ModelErrorTable
from geoident.model.structures import Bars
from geoident.units import in_unit, shown_unit
from geoident.workflow.estimating.accuracies import after

PERSISTENT = 0.75
"""Part t of the variance of a relative error that is the same in all stages."""

ALIGNED = 0.5
"""Part of the correlation that motions in one direction share, and those across do not."""

FLOOR = 0.1
"""Error of a reading that hardly changes, in parts of that of the others."""

ENOUGH = 5
"""Readings more than parameters that can tell how large the model error is."""

ROUNDS = 12
"""At most so many times parameters and size of the model error take turns."""

AT_REST = 0.002
"""Change of the logarithm of the size that ends it."""

NAME = "model error"
"""Of its component of variance."""

TELLS = 3.84
"""Difference of -2 l from which on one explanation is better than another: 95 %, one factor."""


@dataclass(frozen=True)
class ReadingSteps:
    """What the model error of g readings is made of.

    Args:
        channels: of each reading.
        states: names of the J states.
        steps: (g, J) what each step adds to each computed reading, SI.
        floors: (g, J) the error at eta = 1 that a reading has of a step in any case, SI.
    """

    channels: tuple[Channel, ...]
    states: tuple[str, ...]
    steps: Floats
    floors: Floats

    def any(self) -> bool:
        """Whether any reading has a model error."""
        return bool(np.any(self.steps))


def reading_steps(
    case: Case,
    model: CaseModel,
    increments: Floats,
    pairs: Sequence[tuple[str, str]],
    length: float,
) -> ReadingSteps:
    """What the model error of some readings is made of.

    Args:
        case: of the model.
        model: tells which steps make a reading.
        increments: (n_states, n_channels) what each step changes in what the channels see, SI.
        pairs: channel and stage of each of the g readings.
        length: over which it is correlated, m.
    """
    found = np.where(_given(case), 0.0, increments)
    number = {channel.name: k for k, channel in enumerate(case.channels)}
    rows = np.array([number[channel] for channel, _ in pairs], dtype=np.int64)
    weight = model.steps(pairs)
    floors = _floors(case.channels, found, length)
    return ReadingSteps(
        tuple(case.channels[k] for k in rows.tolist()),
        case.stage_names,
        (weight * found[:, rows]).T,
        (weight * floors[:, rows]).T,
    )


def _given(case: Case) -> Bools:
    """(n_states, n_channels) what the case gives, so that no model can be wrong there.

    The force to which a jack brings a bar; the pressure of water, which is a table.
    """
    given = np.zeros((len(case.stages) + 1, len(case.channels)), dtype=np.bool_)
    for k, channel in enumerate(case.channels):
        if channel.kind == "piezometer":
            given[:, k] = True
        bars = case.structures.get(channel.structure)
        if channel.kind != "load-cell" or not isinstance(bars, Bars):
            continue
        for j, stage in enumerate(case.stages, start=1):
            locked = channel.structure in stage.prestress
            built = channel.structure in stage.build and bars.prestress is not None
            given[j, k] = locked or built
    return given


def _floors(channels: Sequence[Channel], increments: Floats, length: float) -> Floats:
    """(n_states, n_channels) error at eta = 1 of a channel that a step hardly moves, SI.

    In each step a tenth of the root mean square of what the gauges of one family feel, each in
    proportion to the difference that a field of errors would make between its points.
    """
    floors = np.zeros_like(increments)
    for members in _families(channels):
        _, between = _correlations([channels[k] for k in members], length)
        size = np.sqrt(np.maximum(np.diag(between), 0.0))
        steps = increments[:, members]
        felt = np.divide(steps, size, out=np.zeros_like(steps), where=size > 0.0)
        moved = felt != 0.0
        count = np.maximum(moved.sum(axis=1), 1)
        mean = np.sqrt((felt**2).sum(axis=1) / count)
        floors[:, members] = FLOOR * mean[:, None] * moved
    return floors


def _family(channel: Channel) -> str:
    """Channels whose errors have to do with each other: motions; stresses; forces; ..."""
    return "motion" if reads_displacements(channel) else channel.dimension


def _families(channels: Sequence[Channel]) -> list[Ints]:
    """Numbers of the channels of each family."""
    names = [_family(channel) for channel in channels]
    return [
        np.flatnonzero([other == name for other in names]).astype(np.int64)
        for name in dict.fromkeys(names)
    ]


def _correlations(channels: Sequence[Channel], length: float) -> tuple[Floats, Floats]:
    """Of m channels of one family: R of relative errors, and M of errors of their points (m, m).

    The kernel is exp(-distance / length) of two points, its mean over the points of two channels,
    normalised; half of it only as far as they move in one direction. M is what a field of
    displacements with that kernel, alike in all directions, makes of the motions of a channel; of
    other readings the kernel itself.
    """
    if _family(channels[0]) != "motion":
        points = np.array([channel.second for channel in channels], dtype=np.float64)
        kernel = np.exp(-_distances(points) / length)
        kinds = [(channel.quantity, channel.kind) for channel in channels]
        same = np.array([[a == b for b in kinds] for a in kinds], dtype=np.float64)
        return kernel * (1.0 - ALIGNED + ALIGNED * same), kernel * same
    motions = [(k, *motion) for k, c in enumerate(channels) for motion in c.motions]
    owner = np.array([k for k, _, _ in motions])
    points, point = np.unique(
        np.array([place for _, place, _ in motions]), axis=0, return_inverse=True
    )
    vector = np.array([v for _, _, v in motions], dtype=np.float64)
    size = np.linalg.norm(vector, axis=1)
    unit = vector / np.where(size > 0.0, size, 1.0)[:, None]
    kernel = np.exp(-_distances(points) / length)
    shape = (len(channels), len(points))

    def together(weight: Floats) -> Floats:
        """Of two channels the sum of weight times kernel times weight over their points (m, m)."""
        spread = sp.csr_array((weight, (owner, point.ravel())), shape=shape)
        return np.asarray(spread @ kernel @ spread.T)

    axes = range(vector.shape[1])
    relative = (1.0 - ALIGNED) * together(np.ones(len(owner)))
    for p in axes:
        for q in axes:
            relative = relative + ALIGNED * together(unit[:, p] * unit[:, q])
    root = np.sqrt(np.diag(relative))
    between = np.sum([together(vector[:, p]) for p in axes], axis=0)
    return relative / np.outer(root, root), np.asarray(between)


def _distances(points: Floats) -> Floats:
    """(k, k) of points (k, dim), m."""
    return np.asarray(np.linalg.norm(points[:, None] - points[None], axis=2))


def correlation_length(case: Case, options: ModelErrorOptions) -> float:
    """Over how far the model error is correlated, m.

    Without other word the root mean square distance of the points of the gauges from their middle,
    which is about the size of what is excavated between them.
    """
    if options.length is not None:
        return options.length
    places = [
        place
        for channel in case.channels
        for place in (
            [point for point, _ in channel.motions]
            if reads_displacements(channel)
            else [channel.second]
        )
    ]
    points = np.array(places, dtype=np.float64)
    spread = float(np.sqrt(np.mean(np.sum((points - points.mean(axis=0)) ** 2, axis=1))))
    return max(spread, 1e-6)


def shared_columns(parts: Sequence[ReadingSteps], length: float) -> sp.csr_array:
    """Columns (g, K) of shared errors at eta = 1, for readings of several parts, one below another.

    Readings of one channel at one stage have one row, however many there are.

    Args:
        parts: the readings used, and later ones, maybe of another case.
        length: over which it is correlated, m.
    """
    states = tuple(dict.fromkeys(state for part in parts for state in part.states))
    steps, floors = (
        np.concatenate([_by_state(getattr(part, name), part.states, states) for part in parts])
        for name in ("steps", "floors")
    )
    channels: dict[Channel, int] = {}
    owner = np.array(
        [channels.setdefault(c, len(channels)) for part in parts for c in part.channels]
    )
    table = np.column_stack([owner, steps, floors])
    _, first, place = np.unique(table, axis=0, return_index=True, return_inverse=True)
    order = np.argsort(np.argsort(first))  # places in the order in which they come
    first, place = np.sort(first), order[place.ravel()]
    steps, floors, owner = steps[first], floors[first], owner[first]
    whole = np.zeros((len(first), len(first)))
    known = tuple(channels)
    for members in _families(known):
        mine = np.flatnonzero(np.isin(owner, members))
        relative, between = _correlations([known[k] for k in members], length)
        number = np.searchsorted(members, owner[mine])
        at = np.ix_(number, number)
        found = _over_stages(steps[mine]) * relative[at] + _over_stages(floors[mine]) * between[at]
        whole[np.ix_(mine, mine)] = found
    return sp.csr_array(_root(whole)[place])


def _by_state(values: Floats, states: Sequence[str], wanted: Sequence[str]) -> Floats:
    """Columns of values (g, J) in the order of other names of states; 0 for those without."""
    found = np.zeros((len(values), len(wanted)))
    found[:, [wanted.index(state) for state in states]] = values
    return found


def _over_stages(steps: Floats) -> Floats:
    """(g, g) of steps (g, J): errors of one stage, and what is alike in all."""
    whole = steps.sum(axis=1)
    return (1.0 - PERSISTENT) * (steps @ steps.T) + PERSISTENT * np.outer(whole, whole)


def _root(matrix: Floats) -> Floats:
    """A root (k, r) of a semidefinite matrix (k, k): matrix = root root^T."""
    scale = np.sqrt(np.diag(matrix))
    here = np.flatnonzero(scale > 0.0)
    inner = matrix[np.ix_(here, here)] / np.outer(scale[here], scale[here])
    size, vectors = np.linalg.eigh(inner)
    kept = size > _NOTHING * size.max(initial=0.0)
    root = np.zeros((len(matrix), int(np.count_nonzero(kept))))
    root[here] = scale[here, None] * vectors[:, kept] * np.sqrt(size[kept])
    return root


_NOTHING = 1e-12


def no_model_error(
    case: Case, readings: ReadingTable, methods: Sequence[MethodOptions]
) -> str | None:
    """Why a fit has no model error, a sentence; empty where the case says so, None if it has one.

    Args:
        case: with its parameters.
        readings: of which some are used.
        methods: by which it is fitted.
    """
    options = case.fit.model_error
    if options.kind == "none":
        return ""
    last = methods[-1]
    if isinstance(last, ScanOptions):
        return "A scan shows the misfit without model error."
    if isinstance(last, ComplementarityOptions) and last.formulation == "global":
        return (
            "The bound that the formulation global proves holds without model error, so none is "
            "estimated."
        )
    if options.kind == "given":
        return None
    places = {pair for pair, used in zip(readings.pairs, readings.used, strict=True) if used}
    unknown = sum(not parameter.field for parameter in case.parameters)
    if len(places) >= unknown + ENOUGH:
        return None
    return (
        f"{len(places)} readings are too few beside {unknown} parameters to say how well the model "
        f"describes the ground ({ENOUGH} more than parameters would do): intervals and bands are "
        "those of a model without error. 'model_error: 15 %' under 'fit' takes one for granted."
    )


# The estimation ----------------------------------------------------------------------------------


@dataclass(frozen=True)
class FittedModelError:
    """The model error that goes with the parameters of a fit.

    Args:
        used: what it is made of at the readings used.
        size: eta.
        length: over which it is correlated, m.
        weighed: what the residuals say of the size; None where it is given.
        findings: sentences on what cannot be told from it.
    """

    used: ReadingSteps
    size: float
    length: float
    weighed: SizeWeights | None = None
    findings: tuple[str, ...] = ()

    def of_channels(self, channels: tuple[Channel, ...]) -> FittedModelError:
        """The same for the channels (g) with the accuracies that were estimated."""
        return replace(self, used=replace(self.used, channels=channels))

    def with_later(self, structure: ErrorStructure, *later: ReadingSteps) -> ErrorStructure:
        """The errors of the readings used, and of later ones below them, with the model error.

        Args:
            structure: without it.
            *later: what it is made of there.
        """
        columns = self.size * shared_columns([self.used, *later], self.length)
        return structure.with_component(sp.csr_array(columns), NAME)

    def table(self, used: Bools) -> ModelErrorTable:
        """For a result, with rows for all readings (k,) of which some are used."""
        shape = (len(used), len(self.used.states))
        steps, floors = np.zeros(shape), np.zeros(shape)
        steps[used], floors[used] = self.used.steps, self.used.floors
        weighed = self.weighed
        return ModelErrorTable(
            kind="given" if weighed is None else "estimated",
            size=self.size,
            lower95=self.size if weighed is None else weighed.quantile(0.025),
            upper95=self.size if weighed is None else weighed.quantile(0.975),
            length=self.length,
            sizes=np.array([self.size]) if weighed is None else SIZES,
            weights=np.ones(1) if weighed is None else weighed.weights,
            states=self.used.states,
            steps=steps,
            floors=floors,
            sentence=self.sentence(),
            findings=self.findings,
        )

    def sentence(self) -> str:
        """Its size in words."""
        what = "motion" if all(_family(c) == "motion" for c in self.used.channels) else "change"
        within = f"The model meets the readings within {_accuracies(self.used.channels)}"
        if self.weighed is None:
            taken = f"{_percent(self.size)} of the computed {what}"
            return f"The model is taken to be right within {taken}, as the case says."
        low, high = (self.weighed.quantile(part) for part in (0.025, 0.975))
        if low <= _NONE:
            return (
                f"{within} and at most {_percent(high)} of the computed {what} (95 %): the "
                "residuals hardly show a model error."
            )
        return (
            f"{within} and {_percent(self.size)} of the computed {what} "
            f"(95 %: {_percent(low)} to {_percent(high)})."
        )


_NONE = 0.01
"""Lower end of the interval of the size below which no model error shows."""


def _percent(part: float) -> str:
    """A part in words.

    >>> _percent(0.0123), _percent(0.997), _percent(2.0)
    ('1.2 %', '100 %', '200 %')
    """
    return f"{100.0 * part:.2g} %" if part < _WHOLE else f"{100.0 * part:.0f} %"


_WHOLE = 0.995
"""From here on two digits would be 1e+02."""


def _accuracies(channels: Sequence[Channel]) -> str:
    """The accuracies of channels: one number or a range for each unit."""
    sizes: dict[tuple[str, str], list[float]] = {}
    for channel in channels:
        sizes.setdefault((channel.unit, channel.dimension), []).append(channel.accuracy)
    said = []
    for (unit, dimension), found in sizes.items():
        low, high = (f"{in_unit(x, unit, dimension):.2g}" for x in (min(found), max(found)))
        spread = low if low == high else f"{low} to {high}"
        said.append(f"{spread} {shown_unit(unit, dimension)}".rstrip())
    return join(said)


def model_error_findings(found: FittedModelError | None) -> tuple[str, ...]:
    """Sentences on a model error that is larger than usual, or not told from other errors."""
    if found is None:
        return ()
    large = found.weighed is not None and found.weighed.quantile(0.025) > USUAL
    return (*((found.sentence(),) if large else ()), *found.findings)


def model_error_notes(
    found: FittedModelError | None,
    case: Case,
    readings: ReadingTable,
    methods: Sequence[MethodOptions],
) -> tuple[str, ...]:
    """Why there is no model error, where nobody said that there should be none.

    Args:
        found: the model error of a fit, None for none.
        case: of the fit.
        readings: of which some were used.
        methods: of the fit.
    """
    if found is not None:
        return ()
    why = no_model_error(case, readings, methods)
    return (why,) if why else ()


@dataclass(frozen=True)
class LaterModelError:
    """The model error of a fit, and what it is made of at later readings.

    Args:
        fitted: of the fit.
        later: of (channel, stage) pairs.
    """

    fitted: FittedModelError
    later: Callable[[Sequence[tuple[str, str]]], ReadingSteps]


def of_result(
    found: ModelErrorTable, channels: Sequence[Channel], rows: Bools | Ints
) -> FittedModelError:
    """The model error that a result holds.

    Args:
        found: in the result.
        channels: of the g readings used.
        rows: (k,) which of the readings they are, or (g,) their numbers.
    """
    used = ReadingSteps(tuple(channels), found.states, found.steps[rows], found.floors[rows])
    return FittedModelError(used, found.size, found.length)


@dataclass(frozen=True)
class WithModelError:
    """Parameters, accuracies and model error that go together.

    Args:
        problem: with the accuracies and the model error.
        outcome: of the search for the parameters.
        components: what is known of the accuracies that are estimated.
        found: the model error.
    """

    problem: Problem
    outcome: Outcome
    components: VarianceComponents
    found: FittedModelError


@dataclass(frozen=True)
class ModelErrorSearch:
    """Parameters and size of the model error, in turns.

    Args:
        options: what the case says.
        length: over which it is correlated, m.
        structure: the errors of the readings without it.
        channels: of the readings.
        steps_at: what it is made of where each step changes what the channels see by increments
            (n_states, n_channels), SI.
        search: for the parameters, from where the problem begins.
    """

    options: ModelErrorOptions
    length: float
    structure: ErrorStructure
    channels: tuple[Channel, ...]
    steps_at: Callable[[Floats], ReadingSteps]
    search: Callable[[Problem], Outcome]

    def run(self, problem: Problem, outcome: Outcome) -> WithModelError | None:
        """Both, in turns, until neither changes; None where no reading can have a model error.

        With a robust loss readings that are far off lose their weight, so the first turn takes a
        model error for granted: what it explains is not wrong.

        Args:
            problem: without model error.
            outcome: of the search without it.
        """
        t = np.zeros(len(self.structure.names))
        used = self._steps(problem, outcome.values)
        if not used.any():
            return None
        size, given = PRIOR_SD, self.options.kind == "given"
        if given:
            size = self.options.size
        elif isinstance(problem.loss, SquaredOptions):
            weighed = self._weighed(problem, outcome, used, t)
            size, t = weighed.size, weighed.components.log_factor
        for _ in range(ROUNDS):
            problem, outcome = self._again(problem, outcome, used, t, size)
            now = self._steps(problem, outcome.values)
            weighed = self._weighed(problem, outcome, now, t, size if given else None)
            known = FittedModelError(used, size, self.length, None if given else weighed)
            known = replace(known, findings=explanations(problem, outcome, self, known))
            # the accuracies of the problem, so that all that is said of it comes from one posterior
            components = replace(weighed.components, log_factor=t)
            found = WithModelError(problem, outcome, components, known)
            rest = given or _near(weighed.size, size)
            if outcome.status == STOPPED or (
                rest and _alike(now, used) and _close(weighed.components.log_factor, t)
            ):
                return found
            used, t = now, weighed.components.log_factor
            size = size if given else weighed.size
        remark = f"parameters and model error did not come to rest in {ROUNDS} rounds"
        return replace(found, outcome=replace(outcome, remarks=(*outcome.remarks, remark)))

    def _steps(self, problem: Problem, values: Floats) -> ReadingSteps:
        """What the model error is made of at parameters (n,), SI."""
        assert isinstance(problem.response, HasIncrements)
        return self.steps_at(problem.response.increments(values))

    def _structure(self, used: ReadingSteps) -> ErrorStructure:
        """The errors of the readings, the model error last."""
        return self.structure.with_component(shared_columns([used], self.length), NAME)

    def _weighed(
        self,
        problem: Problem,
        outcome: Outcome,
        used: ReadingSteps,
        t: Floats,
        size: float | None = None,
    ) -> SizeWeights:
        """What the residuals say of the sizes; of the accuracies alone where the size is given."""
        likelihood = self._likelihood(problem, outcome, self._structure(used))
        if size is None:
            return weigh_sizes(likelihood, t)
        components = at_size(likelihood, size, t)
        return SizeWeights(np.zeros(len(SIZES)), np.zeros(len(SIZES)), components)

    def _likelihood(
        self, problem: Problem, outcome: Outcome, structure: ErrorStructure
    ) -> RestrictedLikelihood:
        readings, jacobian = problem.response.evaluate(outcome.values)
        left = effective_sd(problem, readings) / problem.sd  # of a robust loss
        weakened = replace(structure, sd=structure.sd * left)
        return likelihood_at(problem, weakened, outcome.values, readings, jacobian)

    def others(self, problem: Problem, outcome: Outcome) -> list[_Explanation]:
        """What else may be behind the residuals, one after the other, without model error.

        Args:
            problem: with the accuracies that were estimated.
            outcome: its solution.
        """
        plain = replace(self.structure, sd=problem.sd)
        found = []
        if not self.structure.names:
            worse = self._likelihood(problem, outcome, plain.with_one_factor("accuracies"))
            factor = estimate_components(worse, np.zeros(1))
            times = float(np.exp(0.5 * factor.log_factor[0]))
            if times > 1.0:
                words = f"gauges {times:.2g} times less accurate than stated"
                found.append(_Explanation(words, factor.minus_two_l))
            zeros = self._zeros()
            if zeros is not None:
                off = self._likelihood(problem, outcome, plain.with_component(zeros, "zeros"))
                size = estimate_components(off, np.zeros(1))
                times = float(np.exp(0.5 * size.log_factor[0]))
                words = f"errors of the zeros {times:.2g} times as large as the accuracies"
                found.append(_Explanation(words, size.minus_two_l))
        return found

    def _zeros(self) -> sp.csr_array | None:
        """Errors of the zeros (g, channels) as large as the accuracies; None if they are known."""
        channels = self.channels
        if any(c.errors is not None and c.errors.zero > 0.0 for c in channels):
            return None
        number = {name: k for k, name in enumerate(dict.fromkeys(c.name for c in channels))}
        at = np.array([number[c.name] for c in channels])
        if len(number) == len(at):
            return None  # one reading of each: no other than errors of the readings
        size = np.array([c.accuracy for c in channels])
        return sp.csr_array((size, (np.arange(len(at)), at)), shape=(len(at), len(number)))

    def _again(
        self, problem: Problem, outcome: Outcome, used: ReadingSteps, t: Floats, size: float
    ) -> tuple[Problem, Outcome]:
        """The problem with these accuracies (c,) and this size, and its solution."""
        factors = np.append(t, 2.0 * np.log(max(size, SIZES[0])))
        sd, shared = self._structure(used).at(factors)
        problem = replace(problem, sd=sd, shared=shared).begun_at(outcome.values)
        return problem, after(outcome, self.search(problem))


def _near(size: float, other: float) -> bool:
    least = 0.01  # below one per cent of the motion nothing changes any more
    return bool(abs(np.log(max(size, least) / max(other, least))) <= AT_REST)


def _alike(now: ReadingSteps, before: ReadingSteps) -> bool:
    size = np.abs(before.steps).max(axis=0, initial=0.0)
    return bool(np.all(np.abs(now.steps - before.steps) <= AT_REST * size))


def _close(t: Floats, before: Floats) -> bool:
    return float(np.abs(t - before).max(initial=0.0)) <= AT_REST


# What cannot be told from it ---------------------------------------------------------------------


@dataclass(frozen=True)
class _Explanation:
    """Something that may be behind the residuals: the words for it, and its -2 l."""

    words: str
    minus_two_l: float


def explanations(
    problem: Problem, outcome: Outcome, search: ModelErrorSearch, found: FittedModelError
) -> tuple[str, ...]:
    """Sentences on what explains the residuals as well as the model error, or better.

    Args:
        problem: of the fit, with the model error.
        outcome: its solution.
        search: that found it.
        found: the model error.
    """
    if found.weighed is None:
        return ()
    nothing, with_error = found.weighed.minus_two_l[0], float(found.weighed.minus_two_l.min())
    others = [e for e in search.others(problem, outcome) if e.minus_two_l < nothing - TELLS]
    best = min([with_error, *(e.minus_two_l for e in others)])
    said = f"a model error of {_percent(found.size)}"
    better = [e.words for e in others if e.minus_two_l < with_error - TELLS]
    alike = [e.words for e in others if abs(e.minus_two_l - with_error) <= TELLS]
    if better:
        return (
            f"{_capital(join(better, 'or'))} would explain the residuals better than {said}: check "
            f"that first. {_REMEDY}",
        )
    if alike and nothing - best > TELLS:
        return (
            f"The readings cannot tell {said} from {join(alike, 'or')}: intervals and bands are "
            f"those of the model error. {_REMEDY}",
        )
    return ()


_REMEDY = (
    "'accuracies: estimate' under 'fit' lets the residuals say how accurate the gauges are; "
    "'zero: estimate' in the accuracy of a gauge, what its zero is worth."
)


def _capital(text: str) -> str:
    return text[:1].upper() + text[1:]
