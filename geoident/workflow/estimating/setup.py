"""A model and the readings that it is to meet, and the problem that they make."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from functools import partial

from geoident.errors import InputError
from geoident.forward.model import StagedModel
from geoident.forward.observed import ObservedModel
from geoident.forward.reduced.kept import RestoredModel
from geoident.forward.reduced.response import ReducedResponse
from geoident.forward.reducible import ReducibleResponse
from geoident.identify.problem.methods import refusals
from geoident.identify.problem.problem import Problem
from geoident.identify.problem.shared_errors import ErrorStructure
from geoident.model.case import Case
from geoident.model.gauges import ReadingTable
from geoident.model.methods import MethodOptions
from geoident.model.response import Response
from geoident.model.results.costs import NO_COST, Counts
from geoident.model.results.model_error import ModelErrorTable
from geoident.model.results.result import AccuracyTable, Result
from geoident.model.results.surface import SurfaceTable
from geoident.workflow.estimating.fitted_mesh import FittedMesh
from geoident.workflow.estimating.model_error import FittedModelError, of_result, require_room
from geoident.workflow.estimating.step_error import FittedSteps
from geoident.workflow.running.cached_response import CachedResponse, part_evaluator
from geoident.workflow.running.control import Control
from geoident.workflow.running.evaluation_log import Log
from geoident.workflow.running.jobs import Job, build_model
from geoident.workflow.running.kept_reduced import restored_for
from geoident.workflow.running.prefetching import ResponseBeside
from geoident.workflow.running.readings import (
    errors_of_used,
    problem_of_readings,
    reading_table,
    require_enough,
    select_readings,
    times_of,
    used_rows,
)
from geoident.workflow.running.reduced_scan import ReducedInLog
from geoident.workflow.running.workers import ModelParts, ModelWorkers, runs_on_cluster


@dataclass(frozen=True)
class Setup:
    """A model and the readings that it is to meet.

    Args:
        model: the staged model of the case.
        case: the case.
        readings: all of them, and which take part.
        accuracies: those that were estimated; None where all are given.
        model_error: that of the fit; None where there is none.
        mesh: what the mesh does to the readings, or did at the end of another fit; None where
            it was not asked.
        steps: what the steps in time do to them, likewise.
        stated: the case before errors of gauges were found with the model error; None where none
            were.
        kept: a reduced model of the case that a result keeps, to be asked first; None for none.
        surface: response surfaces of a table of runs, at the end of a search; None for none.
        workers: processes that have the model, too; None for none.
    """

    model: ObservedModel
    case: Case
    readings: ReadingTable
    accuracies: AccuracyTable | None = None
    model_error: FittedModelError | None = None
    mesh: FittedMesh | None = None
    steps: FittedSteps | None = None
    stated: Case | None = None
    kept: RestoredModel | None = None
    surface: SurfaceTable | None = None
    workers: ModelWorkers | None = field(default=None, compare=False)

    def as_stated(self) -> Setup:
        """Without model error, with the errors of gauges as they were before it was found."""
        if self.stated is None:
            return replace(self, model_error=None)
        return replace(self.with_case(self.stated), model_error=None, stated=None)

    def with_case(self, case: Case) -> Setup:
        """With another version of the case, of the same readings with other errors."""
        return replace(self, case=case, readings=reading_table(case, self.readings.reason))

    @property
    def errors(self) -> ErrorStructure:
        """The errors of the readings that are used."""
        return errors_of_used(self.case, self.readings.used)

    def not_asked_of_the_mesh(self) -> Setup:
        """The same where this fit has not asked the mesh: what that has cost was another's."""
        if self.mesh is None:
            return self
        return replace(self, mesh=replace(self.mesh, spent=NO_COST))

    def not_asked_of_the_steps(self) -> Setup:
        """The same where this fit has not asked for more steps in time, likewise."""
        if self.steps is None:
            return self
        return replace(self, steps=replace(self.steps, spent=NO_COST))

    @property
    def spent(self) -> Counts:
        """What the finer mesh and the further steps in time have cost."""
        mesh = NO_COST if self.mesh is None else self.mesh.spent
        return mesh if self.steps is None else mesh + self.steps.spent

    @property
    def model_error_table(self) -> ModelErrorTable | None:
        """The model error for a result."""
        return None if self.model_error is None else self.model_error.table(self.readings.used)


def prepare(job: Job) -> Setup:
    """Build the model of a job and select its readings.

    Raises:
        InputError: the case does not fit its mesh, there are too few readings, or the reduced
            model that is to be asked is of another case.
        ModelError: the model moves freely somewhere.
    """
    request = job.request
    model = build_model(job.inputs, solver=request.solver, fresh=request.fresh)
    case = model.case
    readings = select_readings(case, model)
    require_enough(case, readings)
    require_room(case, readings, job.methods)
    require_possible(model, case, job.methods)
    reduced = job.request.reduced
    kept = None if reduced is None else restored_for(reduced, job.inputs)
    return Setup(model, case, readings, kept=kept)


@contextmanager
def with_workers(job: Job, setup: Setup, control: Control) -> Iterator[Setup]:
    """A setup with the processes that may work on it; at the end none is left.

    Args:
        job: what it was prepared for.
        setup: without them.
        control: says how many there may be, or on which cluster they are.
    """
    parts = ModelParts.of(setup.model, job.inputs.case, job.request.solver)
    if parts is None:
        with runs_on_cluster(setup.model, control):
            yield setup
        return
    if control.jobs == 1 and control.cluster is None:
        yield setup
        return
    begin = partial(part_evaluator, parts)
    with ModelWorkers(begin, control, setup.model, job.request.solver) as workers:
        yield replace(setup, workers=workers)


def require_possible(model: ObservedModel, case: Case, methods: Sequence[MethodOptions]) -> None:
    """Refuse methods that need what the model cannot offer.

    Args:
        model: of the case.
        case: the case.
        methods: their options.

    Raises:
        InputError: with the reasons.
    """
    response, loss = model.response(()), case.fit.loss
    faults = [
        case.source.fault(("fit", "method"), "method-not-possible", reason)
        for reason in refusals(response, methods, loss)
    ]
    if faults:
        raise InputError(faults)


def problem_of(setup: Setup, log: Log, control: Control) -> Problem:
    """The readings of a setup and its model, whose evaluations are logged.

    Args:
        setup: model and selected readings.
        log: takes what is evaluated, and gives it again.
        control: is told of stages, and stops the run.
    """
    case, names = setup.case, setup.case.stage_names

    def on_state(n: int) -> None:
        control.monitor.stage(names[n], n, len(names) - 1)
        control.within()
        if case.elsewhere is not None:  # a run may take hours, and those that ended are kept
            control.stop.check()

    setup.model.on_state = on_state
    response = used_response(setup)
    # only staged models are logged here: programs log their own runs, the rest is cheap
    if isinstance(response, ReducibleResponse):
        if case.fit.reduced:
            response.record()
        pairs, times = _asked(setup)
        where = None if setup.workers is None else ResponseBeside(setup.workers, pairs, times)
        response = CachedResponse(response, log, before=control.stop.check, elsewhere=where)
    return problem_of_readings(case, setup.readings, response)


def used_response(setup: Setup) -> Response:
    """The model of a setup in the readings that are used, not logged."""
    return setup.model.response(*_asked(setup))


def _asked(setup: Setup) -> tuple[list[tuple[str, str]], Sequence[float | None]]:
    """Channel and stage of the readings that are used, and when each was read."""
    readings = setup.readings
    return readings.used_pairs, times_of(readings, readings.used)


def kept_response(setup: Setup) -> ReducedResponse | None:
    """The readings that are used by a reduced model that was kept; None where it gives not all."""
    pairs, times = _asked(setup)
    if setup.kept is None or not setup.kept.covers(pairs):
        return None
    return setup.kept.response(pairs, times)


def reduced_in_log(setup: Setup, log: Log) -> ReducedInLog | None:
    """The reduced model of a scan in its checkpoint; None where the model is no staged one."""
    if not isinstance(setup.model, StagedModel):
        return None
    return ReducedInLog(log, setup.model, *_asked(setup))


def problem_of_result(fit: Result, case: Case, response: Response) -> Problem:
    """The problem that a fit ended with, from its result: the readings used and all their errors.

    What is computed from it is what the fit computed: accuracies and model error are those that
    were estimated with the parameters.

    Args:
        fit: the result.
        case: of the fit, as `geoident.workflow.running.jobs.inputs_of_result` gives it.
        response: in the readings used, or of a model whose readings are not asked for.
    """
    readings = fit.gauges.readings
    used = readings.used
    structure = errors_of_used(case, used)
    model_error = model_error_of_result(fit, case)
    if model_error is not None:
        structure = model_error.with_later(structure)
    _, shared = structure.stated
    own = (readings.sd if readings.own_sd is None else readings.own_sd)[used]
    return Problem(response, readings.value[used], own, case.parameters, case.fit.loss, shared)


def setup_of_result(fit: Result, case: Case, model: ObservedModel) -> Setup:
    """What a fit ended with, from its result.

    Args:
        fit: the result.
        case: of the fit.
        model: of that case, or of another one that is predicted.
    """
    readings = fit.gauges.readings
    return Setup(model, case, readings, fit.accuracies, model_error_of_result(fit, case))


def model_error_of_result(fit: Result, case: Case) -> FittedModelError | None:
    """The model error of a fit, from its result; None for none.

    Args:
        fit: the result.
        case: of the fit.
    """
    if fit.model_error is None:
        return None
    used = fit.gauges.readings.used
    return of_result(fit.model_error, [channel for channel, _ in used_rows(case, used)], used)
