"""The sections of a project in a process: each is set up once there, and asked from then on."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from functools import cached_property
from pathlib import Path

import numpy as np

from geoident.errors import GeoidentError, Interrupted, ModelError
from geoident.fem.solvers.kept_solutions import KeepsSolutions
from geoident.forward.observed import ObservedModel
from geoident.identify.problem.responses import HasDifferences
from geoident.identify.problem.shared_errors import SharedErrors
from geoident.io.result.checkpoint import EvaluationLog
from geoident.model.arrays import Bools, Floats
from geoident.model.parameter import Parameter
from geoident.model.project.project import ProjectSection
from geoident.model.response import Response
from geoident.model.results.costs import NO_COST, Counts
from geoident.model.results.many.project import SectionReading
from geoident.workflow.estimating.diagnosis import parameter_table
from geoident.workflow.estimating.estimate import assess_fit
from geoident.workflow.estimating.mistakes import MistakenReadings, mistakes_of_fit
from geoident.workflow.estimating.search import estimated
from geoident.workflow.estimating.setup import Setup, problem_of, require_possible, used_response
from geoident.workflow.executing.stop import StopRequest
from geoident.workflow.executing.worker import STOP
from geoident.workflow.running.control import Control
from geoident.workflow.running.jobs import build_model, load_inputs
from geoident.workflow.running.readings import select_readings, times_of

PREPARE, EVALUATE, SHARPEN, SHOWN = "prepare", "evaluate", "sharpen", "shown"
"""What a section is asked: its own fit, its readings with derivatives, better derivatives, and all
readings that are shown."""


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
        what: `PREPARE`, `EVALUATE`, `SHARPEN` or `SHOWN`.
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
        sd: its standard deviation with all that it shares, SI.
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
class PreparedSection:
    """A section after its own fit.

    Args:
        parameters: the n of its case.
        measured: (g,) readings that are used, SI.
        sd: (g,) standard deviation of what each has by itself, as its own fit found it, SI.
        shared: what they share of their errors, the model error among it; None for nothing.
        shown: all readings that are shown of it.
        values: (n,) of its own fit, SI.
        alone: (3, n) the same where it determines them, lower and upper ends of 95 %; else NaN.
        status: how its own fit ended; empty where there was none.
        notes: sentences.
        mistaken: mistakes in its readings and priors that its own fit shows.
    """

    parameters: tuple[Parameter, ...]
    measured: Floats
    sd: Floats
    shared: SharedErrors | None
    shown: tuple[ShownReading, ...]
    values: Floats
    alone: Floats
    status: str
    notes: tuple[str, ...] = ()
    mistaken: MistakenReadings | None = None


@dataclass(frozen=True)
class SectionAnswer:
    """What a section has answered.

    Args:
        prepared: after its own fit, where that was asked.
        v: (g,) readings, SI.
        J: (g, n) their derivatives, SI.
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
        response = self._used if task.what in (EVALUATE, SHARPEN) else self._shown
        if task.what == SHARPEN:
            sharper = isinstance(response, HasDifferences) and response.sharpen(task.p)
            return SectionAnswer(sharper=sharper)
        return SectionAnswer(None, *response.evaluate(task.p))

    @cached_property
    def _used(self) -> Response:
        return used_response(self._setup)

    @cached_property
    def _shown(self) -> Response:
        readings, rows = self._setup.readings, self._rows
        pairs = [pair for pair, taken in zip(readings.pairs, rows, strict=True) if taken]
        free = [(one.gauge, one.stage) for one in self._shown_rows() if np.isnan(one.measured)]
        times = times_of(readings, rows)
        return self._setup.model.response([*pairs, *free], (*times, *(None for _ in free)))

    @cached_property
    def _rows(self) -> Bools:
        """Which readings are shown: those with a value that the model can tell."""
        readings, model = self._setup.readings, self._setup.model
        flags = [
            np.isfinite(value) and not bad and model.unreadable(*pair) is None
            for value, bad, pair in zip(readings.value, readings.bad, readings.pairs, strict=True)
        ]
        return np.array(flags, dtype=np.bool_)

    def _shown_rows(self) -> tuple[ShownReading, ...]:
        """Readings that were taken; of a section without any, all that its gauges will read."""
        case, readings = self._setup.case, self._setup.readings
        channels = {channel.name: channel for channel in case.channels}
        rows = tuple(
            ShownReading(
                readings.channel[k], readings.stage[k], float(readings.value[k]),
                float(readings.sd[k]), bool(readings.used[k]),
                channels[readings.channel[k]].unit, channels[readings.channel[k]].dimension,
            )
            for k in np.flatnonzero(self._rows).tolist()
        )  # fmt: skip
        if rows or not self._section.predicted:
            return rows
        unreadable = self._setup.model.unreadable
        return tuple(
            ShownReading(
                channel.name, stage, float("nan"),
                channel.sd(case.reading_at(channel, stage)), False,
                channel.unit, channel.dimension,
            )
            for channel in case.channels
            for stage in case.stage_names[1:]
            if unreadable(channel.name, stage) is None
        )  # fmt: skip

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
            with log:
                problem = problem_of(setup, log, control)
            path.unlink(missing_ok=True)
            return PreparedSection(
                case.parameters, readings.value[used], problem.sd, problem.shared,
                self._shown_rows(), start, nothing, "", case.notes,
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
            self._shown_rows(), estimate.outcome.values, alone, estimate.outcome.status,
            (*case.notes, *setup.model.notes), mistaken,
        )  # fmt: skip
