"""The sections of a project in a process: each is set up once there, and asked from then on."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from functools import cached_property
from itertools import product
from pathlib import Path

import numpy as np

from geoident.errors import GeoidentError, Interrupted, ModelError
from geoident.fem.solvers.kept_solutions import KeepsSolutions
from geoident.forward.model import StagedModel
from geoident.forward.observed import ObservedModel
from geoident.identify.problem.responses import HasDifferences, HasIncrements
from geoident.identify.problem.shared_errors import SharedErrors
from geoident.io.result.checkpoint import EvaluationLog
from geoident.model.arrays import Bools, Floats, Ints
from geoident.model.case import Case
from geoident.model.methods import ModelErrorOptions
from geoident.model.parameter import Parameter
from geoident.model.project.project import ProjectSection
from geoident.model.response import Response
from geoident.model.results.costs import NO_COST, Counts
from geoident.model.results.findings import Finding, sentences_of
from geoident.model.results.many.project import SectionReading
from geoident.model.results.result import STOPPED
from geoident.workflow.estimating.correlated_residuals import correlated_findings
from geoident.workflow.estimating.diagnosis import parameter_table
from geoident.workflow.estimating.estimate import Estimate, assess_fit
from geoident.workflow.estimating.mistakes import MistakenReadings, mistakes_of_fit
from geoident.workflow.estimating.model_error_covariance import (
    CorrelationTime,
    ReadingSteps,
    correlation_length,
    correlation_time,
    family,
    reading_steps,
)
from geoident.workflow.estimating.search import SearchState, estimated
from geoident.workflow.estimating.setup import Setup, problem_of, require_possible, used_response
from geoident.workflow.estimating.step_error import (
    counts_alone,
    step_error,
    steps_sentence,
    takes_steps,
    with_step_error,
)
from geoident.workflow.executing.stop import StopRequest
from geoident.workflow.executing.worker import STOP
from geoident.workflow.running.control import Control
from geoident.workflow.running.jobs import build_model, load_inputs
from geoident.workflow.running.plausible import implausible_findings
from geoident.workflow.running.readings import (
    ChannelReading,
    select_readings,
    times_of,
)

PREPARE, EVALUATE, SHARPEN, SHOWN = "prepare", "evaluate", "sharpen", "shown"
STEPS = "steps"
"""What a section is asked: its own fit, its readings with derivatives, better derivatives, all
readings that are shown, and what their model error is made of."""


@dataclass(frozen=True)
class SectionSources:
    """From what all sections are set up.

    Args:
        sections: of the project.
        identities: of each section, hash of all that its own fit depends on.
        solver: name of the sparse solver.
        checkpoint: of the project; each section has its own beside it.
        max_time: seconds after which the own fit of a section ends with what it has.
        fresh: what was computed before is forgotten.
    """

    sections: tuple[ProjectSection, ...]
    identities: tuple[str, ...]
    solver: str
    checkpoint: Path
    max_time: float | None = None
    fresh: bool = False

    def log_path(self, number: int) -> Path:
        """The checkpoint of the own fit of a section."""
        return self.checkpoint.with_name(f"{self.checkpoint.name}-{number + 1}")


@dataclass(frozen=True)
class SectionTask:
    """What a section is asked.

    Args:
        number: of the section.
        what: `PREPARE`, `EVALUATE`, `SHARPEN`, `SHOWN` or `STEPS`.
        p: (n,) its parameters, SI; None to prepare it.
    """

    number: int
    what: str
    p: Floats | None = None


@dataclass(frozen=True)
class ShownReading:
    """A reading that is shown of a section: one that was taken, or may be.

    Args:
        gauge: name of the channel.
        stage: name of the stage.
        measured: SI; NaN where none was taken.
        sd: its standard deviation with all that it shares, as the case states it, SI.
        used: it takes part in the fit.
        unit: in which people see it.
        dimension: key of `geoident.units.DIMENSIONS`.
    """

    gauge: str
    stage: str
    measured: float
    sd: float
    used: bool
    unit: str
    dimension: str

    def row(self, section: str, computed: float, lower95: float, upper95: float) -> SectionReading:
        """The same with what a fit says of it.

        Args:
            section: its name.
            computed: SI.
            lower95: lower end of the 95 % band, SI; NaN of a reading that took part.
            upper95: upper end.
        """
        return SectionReading(
            section, self.gauge, self.stage, self.measured, self.sd, self.used, float(computed),
            float(lower95), float(upper95), self.unit, self.dimension,
        )  # fmt: skip


@dataclass(frozen=True)
class SectionErrors:
    """What is known of the errors of the readings of a section.

    Args:
        rows: the l readings that are shown, with their channels, as accurate as the case states or
            wants estimated.
        used: (l,) which of them are used.
        steps: what their model error is made of, all zero: the parameters say how large.
        length: over which it is correlated, m.
        stated: what the case says of it.
        scatters: whether all gauges may scatter more than stated.
        time: over which it is correlated; None where it is one of steps.
    """

    rows: tuple[ChannelReading, ...]
    used: Bools
    steps: ReadingSteps
    length: float
    stated: ModelErrorOptions
    scatters: bool
    time: CorrelationTime | None = None

    @property
    def families(self) -> tuple[str, ...]:
        """(l,) of what the readings are: motions; stresses; ..."""
        return tuple(family(channel) for channel, _ in self.rows)

    def of(self, kept: Ints) -> SectionErrors:
        """Of some of the readings (m,)."""
        steps, moments = self.steps, self.steps.moments
        rows = tuple(self.rows[k] for k in kept.tolist())
        channels = tuple(channel for channel, _ in rows)
        moments = None if moments is None else moments[kept]
        steps = replace(
            steps, channels=channels, steps=steps.steps[kept], floors=steps.floors[kept],
            moments=moments,
        )  # fmt: skip
        return replace(self, rows=rows, used=self.used[kept], steps=steps)

    @property
    def moments(self) -> Floats:
        """(l,) log(1 + t / T) of the times since the zeros; 0 where the error is one of steps."""
        return np.zeros(len(self.rows)) if self.steps.moments is None else self.steps.moments

    @property
    def follows(self) -> Bools:
        """(l,) which readings may be off in their course in time: what a model computes."""
        asked = self.stated.kind == "estimate" and self.time is not None
        computed = [
            asked and channel.kind not in ("piezometer", "thermometer") for channel, _ in self.rows
        ]
        return np.array(computed, dtype=np.bool_)


@dataclass(frozen=True)
class PreparedSection:
    """A section after its own fit.

    Args:
        parameters: the n of its case.
        measured: (g,) readings that are used, SI.
        sd: (g,) standard deviation of what each has by itself, as its own fit found it, SI.
        shared: what they share of their errors, the model error among it; None for nothing.
        shown: all readings that are shown of it.
        errors: of its readings.
        values: (n,) of its own fit, SI.
        alone: (3, n) the same where it determines them, lower and upper ends of 95 %; else NaN.
        status: how its own fit ended; empty where there was none.
        notes: sentences.
        findings: on the residuals of its own fit, and on errors of what is computed.
        mistaken: mistakes in its readings and priors that its own fit shows.
    """

    parameters: tuple[Parameter, ...]
    measured: Floats
    sd: Floats
    shared: SharedErrors | None
    shown: tuple[ShownReading, ...]
    errors: SectionErrors
    values: Floats
    alone: Floats
    status: str
    notes: tuple[str, ...] = ()
    findings: tuple[Finding, ...] = ()
    mistaken: MistakenReadings | None = None


@dataclass(frozen=True)
class SectionAnswer:
    """What a section has answered.

    Args:
        prepared: after its own fit, where that was asked.
        v: (g,) readings, SI; of `STEPS` (g, n_states) what each step adds to them.
        J: (g, n) their derivatives, SI; of `STEPS` (g, n_states) the floors of their model error.
        sharper: derivatives are better now.
        error: why there is no answer: an error to be raised.
        counts: what it has cost.
    """

    prepared: PreparedSection | None = None
    v: Floats = field(default_factory=lambda: np.zeros(0))
    J: Floats = field(default_factory=lambda: np.zeros((0, 0)))
    sharper: bool = False
    error: GeoidentError | None = None
    counts: Counts = NO_COST


class SectionsInProcess:
    """Answers tasks; sets a section up when it is asked first.

    Args:
        sources: of all sections.
        stop: the wish to stop; None for that of a worker.
        begin: is told of the model of each section as it is set up.
    """

    def __init__(
        self,
        sources: SectionSources,
        stop: StopRequest | None = None,
        begin: Callable[[ObservedModel], None] = lambda model: None,
    ) -> None:
        self._sources, self._stop, self._begin = sources, stop or STOP, begin
        self._known: dict[int, _OneSection] = {}

    def __call__(self, task: SectionTask) -> SectionAnswer:
        """The answer to a task; errors of input and model are part of it."""
        before = NO_COST
        try:
            one = self._section(task.number)
            before = one.counts
            answer = one.answer(task, self._stop)
        except Interrupted:
            raise
        except GeoidentError as error:
            return SectionAnswer(error=error)
        return replace(answer, counts=one.counts - before)

    def _section(self, number: int) -> _OneSection:
        if number not in self._known:
            self._known[number] = _OneSection(self._sources, number)
            self._begin(self._known[number].model)
        return self._known[number]


def set_up_sections(sources: SectionSources) -> Callable[[SectionTask], SectionAnswer]:
    """What a process does with its tasks.

    Args:
        sources: of all sections.
    """
    return SectionsInProcess(sources)


class _OneSection:
    """A section that is set up."""

    def __init__(self, sources: SectionSources, number: int) -> None:
        self._all, self._number = sources, number
        self._section = sources.sections[number]
        inputs = load_inputs(self._section.case, overrides=self._section.overrides)
        model = build_model(inputs, solver=sources.solver, fresh=sources.fresh)
        readings = select_readings(model.case, model)
        if self._section.predicted:
            readings = replace(readings, used=np.zeros(len(readings), dtype=np.bool_))
        self._setup = Setup(model, model.case, readings)

    @property
    def model(self) -> ObservedModel:
        """Its model."""
        return self._setup.model

    @property
    def counts(self) -> Counts:
        """Costs so far."""
        return self._setup.model.counts

    def answer(self, task: SectionTask, stop: StopRequest) -> SectionAnswer:
        if task.p is None:
            return SectionAnswer(self._prepared(stop))
        if (why := self._setup.model.admissible(task.p)) is not None:
            raise ModelError(f"{self._section.name}: {why}")
        if task.what == STEPS:
            steps = self._steps(self._setup.case, self._increments(task.p))
            return SectionAnswer(None, steps.steps, steps.floors)
        response = self._used if task.what in (EVALUATE, SHARPEN) else self._shown
        if task.what == SHARPEN:
            sharper = isinstance(response, HasDifferences) and response.sharpen(task.p)
            return SectionAnswer(sharper=sharper)
        return SectionAnswer(None, *response.evaluate(task.p))

    def _increments(self, p: Floats) -> Floats:
        """What the step of each state changes in what all channels see, (n_states, n_channels), SI.

        Of all readings that are shown; of those that are used where a later stage has no solution.
        """
        try:
            return _increments_of(self._shown, p)
        except ModelError:
            if not self._setup.readings.used.any():
                raise
            return _increments_of(self._used, p)

    @cached_property
    def _used(self) -> Response:
        return used_response(self._setup)

    @cached_property
    def _shown(self) -> Response:
        readings, rows = self._setup.readings, self._rows
        times = times_of(readings, rows)
        free = self._shown_pairs[len(times) :]
        return self._setup.model.response(self._shown_pairs, (*times, *(None for _ in free)))

    @cached_property
    def _rows(self) -> Bools:
        """Which readings are shown: those with a value that the model can tell."""
        readings, model = self._setup.readings, self._setup.model
        flags = [
            np.isfinite(value) and not bad and model.unreadable(*pair) is None
            for value, bad, pair in zip(readings.value, readings.bad, readings.pairs, strict=True)
        ]
        return np.array(flags, dtype=np.bool_)

    @cached_property
    def _shown_pairs(self) -> list[tuple[str, str]]:
        """Channel and stage of readings that were taken; without any, of all that may be."""
        case, model = self._setup.case, self._setup.model
        taken = [self._setup.readings.pairs[k] for k in np.flatnonzero(self._rows).tolist()]
        if taken or not self._section.predicted:
            return taken
        places = product((channel.name for channel in case.channels), case.stage_names[1:])
        return [place for place in places if model.unreadable(*place) is None]

    def _shown_in(self, case: Case) -> tuple[ChannelReading, ...]:
        """The readings that are shown with their channels, as a case has these."""
        channels = {channel.name: channel for channel in case.channels}
        taken = [case.readings[k] for k in np.flatnonzero(self._rows).tolist()]
        free = [
            case.reading_at(channels[name], stage)
            for name, stage in self._shown_pairs[len(taken) :]
        ]
        return tuple((channels[reading.channel], reading) for reading in (*taken, *free))

    def _shown_rows(self) -> tuple[ShownReading, ...]:
        readings, used = self._setup.readings, np.flatnonzero(self._rows)
        rows = self._shown_in(self._setup.case)
        free = np.full(len(rows) - len(used), np.nan)
        return tuple(
            ShownReading(
                channel.name, reading.stage, float(value), channel.sd(reading),
                bool(taken), channel.unit, channel.dimension,
            )
            for (channel, reading), value, taken in zip(
                rows,
                (*readings.value[used], *free),
                (*readings.used[used], *np.isfinite(free)),
                strict=True,
            )
        )  # fmt: skip

    @property
    def _notes(self) -> tuple[str, ...]:
        """What is to be known of the case, whatever its readings."""
        case = self._setup.case
        return (*sentences_of(implausible_findings(case)), *case.notes)

    def _together(self, state: SearchState, estimate: Estimate) -> tuple[Finding, ...]:
        """Residuals of its own fit that come in runs of one sign.

        Args:
            state: how that ended.
            estimate: what is known there.
        """
        if state.outcome.status == STOPPED:
            return ()
        values, name = estimate.outcome.values, self._section.name
        found = correlated_findings(state.setup.case, state.problem, values, estimate.readings)
        return tuple(
            replace(
                one,
                subject=f"{name}, {one.subject}",
                sentence=f"In the section {name} by itself: {one.sentence}",
            )
            for one in found
        )

    def _computed(self, setup: Setup) -> tuple[Finding, ...]:
        """Errors by the mesh and the steps in time that its own fit counts: the project does, too.

        Args:
            setup: at the end of that fit.
        """
        name = self._section.name
        tables = (one for one in (setup.mesh, setup.steps) if one is not None)
        return tuple(
            replace(one, subject=name, sentence=f"In the section {name}: {one.sentence}")
            for table in tables
            for one in table.findings
        )

    def _steps(self, case: Case, increments: Floats) -> ReadingSteps:
        """What the model error of the readings that are shown is made of.

        Args:
            case: with the accuracies that go with it.
            increments: (n_states, n_channels) what each step changes in what channels see, SI.
        """
        length = correlation_length(case, case.fit.model_error)
        pairs, time = self._shown_pairs, self._time(case)
        return reading_steps(case, self._setup.model, increments, pairs, length, time)

    def _time(self, case: Case) -> CorrelationTime | None:
        return correlation_time(case, case.fit.model_error, self._setup.readings.used_pairs)

    def _errors(self, setup: Setup) -> SectionErrors:
        """The errors of readings after an own fit, or as they are stated without one."""
        setup = setup.as_stated()
        case, options = setup.case, setup.case.fit.model_error
        nothing = np.zeros((len(case.stage_names), len(case.channels)))
        rows, taken = self._shown_in(case), setup.readings.used[self._rows]
        used = np.zeros(len(rows), dtype=np.bool_)
        used[: len(taken)] = taken
        return SectionErrors(
            rows,
            used,
            self._steps(case, nothing),
            correlation_length(case, options),
            options,
            options.kind == "estimate" and not setup.errors.names,
            self._time(case),
        )

    def _prepared(self, stop: StopRequest) -> PreparedSection:
        setup, case = self._setup, self._setup.case
        n = len(case.parameters)
        start = np.array([q.start for q in case.parameters], dtype=np.float64)
        readings, used = setup.readings, setup.readings.used
        control = Control(stop=stop, max_time=self._all.max_time)
        path = self._all.log_path(self._number)
        if self._all.fresh:
            path.unlink(missing_ok=True)
        log = EvaluationLog.open(path, self._all.identities[self._number])
        if isinstance(setup.model, KeepsSolutions):
            setup.model.keep_solutions(log)
        enough = int(np.count_nonzero(used)) >= n
        nothing = np.full((3, n), np.nan)
        if self._section.predicted or not enough:
            setup, notes = _with_steps_at(setup, start)
            with log:
                problem = problem_of(setup, log, control)
            path.unlink(missing_ok=True)
            return PreparedSection(
                case.parameters, readings.value[used], problem.sd, problem.shared,
                self._shown_rows(), self._errors(setup), start, nothing, "",
                (*self._notes, *notes),
            )  # fmt: skip
        require_possible(setup.model, case, case.fit.methods)
        with log:
            state = estimated(setup, case.fit.methods, log, control)
            estimate = assess_fit(*state, fields=False)
            mistaken = mistakes_of_fit(case, *state, case.fit.methods)
        table = parameter_table(case.parameters, estimate.outcome.values, estimate.assessment)
        alone = np.array([table.values, table.lower95, table.upper95])
        alone[:, ~table.determined] = np.nan
        problem = state.problem
        return PreparedSection(
            case.parameters, readings.value[used], problem.sd, problem.shared,
            self._shown_rows(), self._errors(state.setup), estimate.outcome.values, alone,
            estimate.outcome.status, (*self._notes, *setup.model.notes, *_notes_of(state.setup)),
            (*self._computed(state.setup), *(() if mistaken else self._together(state, estimate))),
            mistaken,
        )  # fmt: skip


def _notes_of(setup: Setup) -> tuple[str, ...]:
    """How large errors of what is computed are where they do not count."""
    return () if setup.steps is None else setup.steps.notes


def _with_steps_at(setup: Setup, p: Floats) -> tuple[Setup, tuple[str, ...]]:
    """A section without a fit of its own with the error by the steps in time, where that counts.

    Args:
        setup: the section.
        p: (n,) where to look for it, its start values: what a project finds comes later.

    Returns:
        The section, and what to note.
    """
    case, model = setup.case, setup.model
    if not (isinstance(model, StagedModel) and takes_steps(case)):
        return setup, ()
    try:
        error = step_error(model, p)
    except ModelError:
        return setup, ()
    said = f"{steps_sentence(error)} That is at its start values."
    if counts_alone(error):
        setup = replace(setup, case=with_step_error(case, error))
    return setup, (said,)


def _increments_of(response: Response, p: Floats) -> Floats:
    assert isinstance(response, HasIncrements)
    return response.increments(p)
