"""The search for the parameters, kept in a checkpoint as it goes, and how it ends.

Its result, where that stands, and what is said of the readings.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import asdict, dataclass, replace

import numpy as np

from geoident.errors import InputError, Interrupted, ModelError
from geoident.forward.model import StagedModel, StagedResponse
from geoident.forward.protocols import CaseModel, Survey
from geoident.identify import descend, identify, refusals
from geoident.identify.assessment.diagnostics import effective_sd
from geoident.identify.assessment.uncertainty import Assessment
from geoident.identify.assessment.variance_components import VarianceComponents
from geoident.identify.problem.errors import ErrorStructure
from geoident.identify.problem.methods import continued
from geoident.identify.problem.problem import STOPPED, LocalMinimum, Outcome, Problem
from geoident.io.result.checkpoint import EvaluationLog
from geoident.io.result.file import read_identity, read_result, write_result
from geoident.model.arrays import Bools, Floats
from geoident.model.case import Case
from geoident.model.gauges import ReadingTable
from geoident.model.methods import (
    ComplementarityOptions,
    MethodOptions,
    ScanOptions,
    SquaredOptions,
)
from geoident.model.response import Response
from geoident.model.results.model_error import ModelErrorTable
from geoident.model.results.result import AccuracyTable, Counts, Diagnostics, Prediction, Result
from geoident.model.results.rivals import Evidence, Rivals
from geoident.workflow.estimating.accuracies import (
    accuracy_table,
    after,
    weighed,
    with_accuracies,
    with_scatter,
)
from geoident.workflow.estimating.diagnosis import assess_robustly, at_used, diagnostics_table
from geoident.workflow.estimating.mesh_error import (
    FittedMesh,
    fitted_mesh,
    judged_mesh,
    with_mesh_error,
)
from geoident.workflow.estimating.model_error import (
    FittedModelError,
    LaterModelError,
    no_model_error,
    of_result,
)
from geoident.workflow.estimating.model_error_covariance import (
    ReadingSteps,
    correlation_length,
    reading_steps,
)
from geoident.workflow.estimating.model_error_search import ModelErrorSearch
from geoident.workflow.estimating.predictions import (
    Bends,
    KnownErrors,
    follow_open_bound,
    predict_stages,
)
from geoident.workflow.estimating.rivals import LOWER, kept_up, mixed_prediction, weighed_minima
from geoident.workflow.running.control import Control
from geoident.workflow.running.errors import ChannelReading, error_structure, gauge_errors
from geoident.workflow.running.evaluation_log import Log, Remembered
from geoident.workflow.running.jobs import Job, build_model
from geoident.workflow.running.outputs import Standing, Target
from geoident.workflow.running.readings import (
    accuracies,
    reading_table,
    require_enough,
    select_readings,
    times_of,
    unused_by_stage,
    with_computed,
)


@dataclass(frozen=True)
class Setup:
    """A model and the readings that it is to meet.

    Args:
        model: the staged model of the case.
        case: the case.
        readings: all of them, and which take part.
        accuracies: those that were estimated; None where all are given.
        model_error: that of the fit; None where there is none.
        mesh: what the mesh does to the readings; None where it was not asked.
        stated: the case before errors of gauges were found with the model error; None where none
            were.
    """

    model: CaseModel
    case: Case
    readings: ReadingTable
    accuracies: AccuracyTable | None = None
    model_error: FittedModelError | None = None
    mesh: FittedMesh | None = None
    stated: Case | None = None

    def as_stated(self) -> Setup:
        """Without model error, with the errors of gauges as they were before it was found."""
        if self.stated is None:
            return replace(self, model_error=None)
        table = reading_table(self.stated, self.readings.reason)
        return replace(self, case=self.stated, readings=table, model_error=None, stated=None)

    @property
    def model_error_table(self) -> ModelErrorTable | None:
        """The model error for a result."""
        return None if self.model_error is None else self.model_error.table(self.readings.used)


def prepare(job: Job) -> Setup:
    """Build the model of a job and select its readings.

    Raises:
        InputError: the case does not fit its mesh, or there are too few readings.
        ModelError: the model moves freely somewhere.
    """
    model = build_model(job.inputs, solver=job.request.solver)
    case = model.case
    readings = select_readings(case, model)
    require_enough(case, readings)
    require_possible(model, case, job.methods)
    return Setup(model, case, readings)


def require_possible(model: CaseModel, case: Case, methods: Sequence[MethodOptions]) -> None:
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
        case.source.fault(("fit", "method"), code="method-not-possible", message=reason)
        for reason in refusals(response, methods, loss)
    ]
    if faults:
        raise InputError(faults)


@contextmanager
def evaluation_log(job: Job, control: Control) -> Iterator[EvaluationLog]:
    """The log of a job's evaluations; kept if the run is cut short, removed when it is done.

    Raises:
        Interrupted: the run was; says how to go on.
    """
    if job.request.fresh:
        job.place.checkpoint.unlink(missing_ok=True)
    log = EvaluationLog.open(str(job.place.checkpoint), job.identity)
    if log.trouble:
        control.monitor.warn(log.trouble)
    elif len(log):
        kept = "blocks of evaluations" if job.command == "sample" else "evaluations"
        control.monitor.inform(f"Going on from {job.place.checkpoint}: {len(log)} {kept}")
    try:
        yield log
    except Interrupted as stop:
        log.close()
        raise Interrupted(_how_to_go_on(job), exit_code=stop.exit_code) from stop
    except (InputError, ModelError):
        log.remove()  # it would end the same way again
        raise
    except BaseException:
        log.close()
        raise
    if control.out_of_time:
        log.close()
    else:
        log.remove()


def _how_to_go_on(job: Job) -> str:
    same = "The same command without --fresh" if job.request.fresh else "The same command"
    return (
        f"Interrupted. What was computed is kept in {job.place.checkpoint}.\n"
        f"    {same} goes on from there."
    )


def problem_of(setup: Setup, log: Log, control: Control) -> Problem:
    """The readings of a setup and its model, whose evaluations are logged.

    Args:
        setup: model and selected readings.
        log: takes what is evaluated, and gives it again.
        control: is told of stages, and stops the run.
    """
    case, readings, used = setup.case, setup.readings, setup.readings.used
    names = case.stage_names
    setup.model.on_state = lambda n: control.monitor.stage(names[n], n, len(names) - 1)
    pairs = [pair for pair, taken in zip(readings.pairs, used, strict=True) if taken]
    staged = setup.model.response(pairs, times_of(readings, used))
    # the closed form costs nothing: there is nothing to remember
    response: Response = staged
    if isinstance(staged, StagedResponse):
        response = Remembered(staged, log, before=control.stop.check)
    structure = structure_of_used(case, used)
    if structure is None:
        sd, shared = readings.sd[used], None
    else:
        sd, shared = structure.at(np.zeros(len(structure.names)))
    return Problem(response, readings.value[used], sd, case.parameters, case.fit.loss, shared)


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
    structure = gauge_errors(used_rows(case, used))
    found = model_error_of_result(fit, case)
    if found is not None:
        structure = found.with_later(structure)
    _, shared = structure.at(np.zeros(len(structure.names)))
    own = (readings.sd if readings.own_sd is None else readings.own_sd)[used]
    return Problem(response, readings.value[used], own, case.parameters, case.fit.loss, shared)


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


def structure_of_used(case: Case, used: Bools) -> ErrorStructure | None:
    """The errors of the used readings of a case; None where all are independent.

    Args:
        case: with k readings.
        used: (k,) which of them.
    """
    return error_structure(used_rows(case, used))


def used_rows(case: Case, used: Bools) -> tuple[ChannelReading, ...]:
    """The used readings (k,) of a case with their channels."""
    channels = {channel.name: channel for channel in case.channels}
    taken = [reading for reading, flag in zip(case.readings, used, strict=True) if flag]
    return tuple((channels[reading.channel], reading) for reading in taken)


def surveyed(
    setup: Setup, problem: Problem, outcome: Outcome, *, fields: bool, last: int | None = None
) -> tuple[Survey, ReadingTable, Counts]:
    """The model at the end of a search, what it says of each reading, and what both have cost.

    Args:
        setup: model and readings.
        problem: of the search.
        outcome: of the search.
        fields: whether displacements and stresses are wanted.
        last: index of the last state wanted; None for all.
    """
    model, p = setup.model, outcome.values
    before = model.counts
    survey = model.survey(p, fields=fields, partial=True, last=last)
    counts = further(problem.response.counts, before, model.counts)
    return survey, with_computed(setup.readings, setup.case, model, survey, p), counts


@dataclass(frozen=True)
class Estimate:
    """What a search found, and what the model says there.

    Args:
        outcome: of the identifiers.
        assessment: how well the parameters are known.
        readings: with what the model says of each.
        diagnostics: the influence of each of them on the parameters.
        survey: the model at the parameters.
        counts: of all.
        errors: what the used readings tell of those that later ones share; None where none do.
        bends: how readings deviate from linear where a bound leaves a parameter open, or None.
        rivals: other minima, with the lowest; None where there are none.
        others: what is known at the rivals, in their order without the first.
        evidence: of the model, None where the search did not converge.
    """

    outcome: Outcome
    assessment: Assessment
    readings: ReadingTable
    diagnostics: Diagnostics
    survey: Survey
    counts: Counts
    errors: KnownErrors | None = None
    bends: Bends | None = None
    rivals: Rivals | None = None
    others: tuple[Estimate, ...] = ()
    evidence: Evidence | None = None


def look(
    setup: Setup, problem: Problem, outcome: Outcome, *, fields: bool, last: int | None = None
) -> Estimate:
    """One survey of the model at the end of a search says everything else.

    Args:
        setup: model and readings, as `estimated` gives them.
        problem: likewise.
        outcome: likewise.
        fields: whether displacements and stresses are wanted.
        last: index of the last state wanted; None for all.
    """
    survey, readings, counts = surveyed(setup, problem, outcome, fields=fields, last=last)
    computed, jacobian = at_used(readings)
    assessment = assess_robustly(problem, outcome.values, computed, jacobian)
    diagnostics = diagnostics_table(problem, readings, outcome.values, assessment)
    before = setup.model.counts
    assessment, bends = follow_open_bound(
        setup.model, setup.case, problem, outcome.values, survey, readings, assessment
    )
    counts = further(counts, before, setup.model.counts)
    left = replace(problem, sd=effective_sd(problem, computed))
    known = known_errors(setup, left, survey, computed, jacobian)
    found = Estimate(outcome, assessment, readings, diagnostics, survey, counts, known, bends)
    rivals, evidence = weighed_minima(problem, outcome, computed, jacobian)
    weighed = None if setup.model_error is None else setup.model_error.weighed
    if evidence is not None and weighed is not None:
        over_sizes = evidence.log_evidence + weighed.log_gain
        evidence = replace(evidence, log_evidence=over_sizes)
    if rivals is None:
        return replace(found, evidence=evidence)
    places = zip(rivals.values[1:], rivals.objectives[1:], strict=True)
    elsewhere = [
        replace(outcome, values=p, objective=float(phi), minima=(), certificate=None)
        for p, phi in places
    ]
    others = tuple(look(setup, problem, other, fields=False) for other in elsewhere)
    spent = with_further(counts, [other.counts for other in others], problem.response.counts)
    return replace(found, rivals=rivals, others=others, evidence=evidence, counts=spent)


def further(counts: Counts, before: Counts, after: Counts) -> Counts:
    """Costs with those of a model between two moments.

    Args:
        counts: so far, such as those of a search.
        before: of the model at the first moment.
        after: at the second.
    """
    return Counts(
        evaluations=counts.evaluations + after.evaluations - before.evaluations,
        analyses=max(counts.analyses, after.analyses),
        factorizations=counts.factorizations + after.factorizations - before.factorizations,
        solves=counts.solves + after.solves - before.solves,
    )


def with_further(counts: Counts, further: Sequence[Counts], each: Counts) -> Counts:
    """Costs with those of further surveys.

    Args:
        counts: of the search and the first survey.
        further: of the search and each other survey.
        each: of the search.
    """
    return Counts(
        **{
            name: value + sum(getattr(more, name) - getattr(each, name) for more in further)
            for name, value in asdict(counts).items()
        }
    )


def known_errors(
    setup: Setup, problem: Problem, survey: Survey, computed: Floats, jacobian: Floats
) -> KnownErrors | None:
    """What the used readings tell of the errors of later ones; None where none have to do with it.

    Args:
        setup: model and readings.
        problem: the used readings, with their own standard deviations as the loss leaves them.
        survey: the model at the estimate.
        computed: (g,) what it says of the used readings, SI.
        jacobian: (g, n) its derivative, SI.
    """
    case, found = setup.case, setup.model_error
    if found is None and not any(channel.errors for channel in case.channels):
        return None
    rows = used_rows(case, setup.readings.used)
    return KnownErrors(
        case, problem, computed, jacobian, rows, later_errors(setup.model, case, survey, found)
    )


def later_errors(
    model: CaseModel, case: Case, survey: Survey, found: FittedModelError | None
) -> LaterModelError | None:
    """The model error of a fit in later readings.

    Args:
        model: of the case to predict.
        case: to predict.
        survey: of that model at the estimate.
        found: the model error of the fit, or None for none.
    """
    if found is None:
        return None

    def later(pairs: Sequence[tuple[str, str]]) -> ReadingSteps:
        return reading_steps(case, model, survey.increments, pairs, found.length)

    return LaterModelError(found, later)


def predicted(setup: Setup, found: Estimate, stages: Bools) -> Prediction:
    """Bands of the readings at some stages, from an estimate and its rivals.

    Args:
        setup: model and readings.
        found: the estimate.
        stages: (n_stages,) which.
    """
    sd = accuracies(setup.case)
    first = predict_stages(found.survey, found.assessment, sd, stages, found.errors, found.bends)
    if found.rivals is None:
        return first
    others = [predicted(setup, other, stages) for other in found.others]
    return mixed_prediction(found.rivals.odds, [first, *others])


@dataclass(frozen=True)
class Finished:
    """A result and where it stands.

    Args:
        result: what was found, now or before.
        paths: the files that hold it, the result file first.
        up_to_date: it stood there already and was not computed again.
    """

    result: Result
    paths: tuple[str, ...]
    up_to_date: bool = False


def keep(place: Target) -> Finished:
    """A result that is up to date."""
    return Finished(read_result(place.path), (str(place.path),), up_to_date=True)


def write(result: Result, place: Target, found: Standing, *, inputs: Sequence[str]) -> Finished:
    """Put a result in its place.

    Args:
        result: what was found.
        place: of the result.
        found: what stands there.
        inputs: paths that were read, and so must not be written.
    """
    overwrite = found is not Standing.NOTHING
    if not overwrite:  # the same may have been computed by another run meanwhile
        other = read_identity(place.path) if place.path.exists() else None
        if other is not None and other.identity == result.provenance.identity:
            if other.status != STOPPED:
                return keep(place)
            overwrite = True
    return Finished(result, write_result(result, place.path, overwrite=overwrite, inputs=inputs))


def searched(
    job: Job, control: Control, result: Callable[[Setup, Problem, Outcome, Log], Result]
) -> Finished:
    """Runs the search of a command and writes its result; keeps one that is up to date.

    Args:
        job: what to do.
        control: progress, budget and stops.
        result: what is written of the case, its problem and the outcome of the search; it may
            evaluate more, and log that.

    Raises:
        Interrupted: a stop was asked for; a checkpoint is there.
    """
    if job.up_to_date:
        return keep(job.place)
    setup = prepare(job)
    _tell_readings(setup, control)
    with evaluation_log(job, control) as log:
        written = result(*estimated(setup, job.methods, log, control), log)
        return write(written, job.place, job.found, inputs=job.inputs.files)


def estimated(
    setup: Setup,
    methods: Sequence[MethodOptions],
    log: Log,
    control: Control,
    *,
    start: Floats | None = None,
) -> tuple[Setup, Problem, Outcome]:
    """The parameters that meet the readings of a setup, and all that is estimated with them.

    Everything that is said of an estimate (assessment, diagnostics, predictions) is computed from
    the problem that comes back.

    Args:
        setup: model and selected readings.
        methods: the identifiers to run, one after the other.
        log: takes what is evaluated, and gives it again.
        control: progress, budget and stops.
        start: (n,) where to begin, SI; None for the start values of the case.

    Returns:
        The setup with the accuracies that were estimated, the problem, and the outcome.

    Raises:
        Interrupted: a stop was asked for.
    """
    setup = setup.as_stated()  # what was estimated may be of other readings
    problem = problem_of(setup, log, control)
    if start is not None:
        problem = problem.begun_at(start)
    first = _search(problem, methods, control)
    setup, weighted, begun = _with_mesh(setup, problem, first, methods, control)
    found, final, outcome = _with_errors(setup, weighted, begun, methods, control)
    mesh = _mesh_beside_accuracies(found, problem, outcome)
    if mesh is not None:
        setup, weighted, begun = _counted(setup, mesh, problem, begun, methods, control)
        found, final, outcome = _with_errors(setup, weighted, begun, methods, control)
    if final is problem or not first.minima:
        return found, final, outcome
    # the weights are others now, and so are the minima

    def again(elsewhere: Problem) -> Outcome:
        return _descent(elsewhere, methods, control)

    outcome = kept_up(final, outcome, first.minima, again)
    lowest = outcome.minima[0] if outcome.minima else None
    if lowest is None or lowest.objective >= outcome.objective - LOWER:
        return found, final, outcome
    # what was estimated with the parameters belongs to another minimum
    former = LocalMinimum(outcome.values, outcome.objective)
    moved = weighted.begun_at(lowest.values)
    found, final, outcome = _with_errors(setup, moved, again(moved), methods, control)
    return found, final, kept_up(final, outcome, [former, *first.minima], again)


def _with_mesh(
    setup: Setup,
    problem: Problem,
    outcome: Outcome,
    methods: Sequence[MethodOptions],
    control: Control,
) -> tuple[Setup, Problem, Outcome]:
    """The same with the error of the mesh among those of the readings, where it matters."""
    case, model = setup.case, setup.model
    asked = case.fit.mesh_error and not any(c.errors and c.errors.mesh for c in case.channels)
    plain = not isinstance(methods[-1], ScanOptions) and not _proves(methods[-1])
    if not (asked and plain and isinstance(model, StagedModel)) or outcome.status == STOPPED:
        return setup, problem, outcome
    found = fitted_mesh(model, problem, _used_pairs(setup), outcome)
    if found is None or not found.counts:
        return replace(setup, mesh=found), problem, outcome
    return _counted(setup, found, problem, outcome, methods, control)


def _used_pairs(setup: Setup) -> list[tuple[str, str]]:
    """Channel and stage of the used readings (g)."""
    readings = setup.readings
    return [pair for pair, used in zip(readings.pairs, readings.used, strict=True) if used]


def _mesh_beside_accuracies(found: Setup, problem: Problem, outcome: Outcome) -> FittedMesh | None:
    """The mesh, where it counts beside the accuracies that were estimated and not before.

    Gauges that turn out to be better than stated notice a mesh that was fine enough before.

    Args:
        found: with the accuracies that were estimated.
        problem: the readings, without errors of mesh and model.
        outcome: of the search.
    """
    mesh, case = found.mesh, found.case
    if mesh is None or mesh.counts or found.accuracies is None or outcome.status == STOPPED:
        return None
    structure = gauge_errors(used_rows(case, found.readings.used))
    sd, shared = structure.at(np.zeros(len(structure.names)))
    accuracy = np.array([channel.accuracy for channel in case.channels], dtype=np.float64)
    estimated = replace(mesh.found, accuracy=accuracy)
    again = replace(problem, sd=sd, shared=shared)
    judged = judged_mesh(estimated, again, _used_pairs(found), outcome)
    return judged if judged.counts else None


def _counted(
    setup: Setup,
    found: FittedMesh,
    problem: Problem,
    outcome: Outcome,
    methods: Sequence[MethodOptions],
    control: Control,
) -> tuple[Setup, Problem, Outcome]:
    """The same with the error of the mesh among those of the readings."""
    case = with_mesh_error(setup.case, found.found)
    structure = structure_of_used(case, setup.readings.used)
    assert structure is not None  # the mesh is in it
    sd, shared = structure.at(np.zeros(len(structure.names)))
    problem = replace(problem, sd=sd, shared=shared).begun_at(outcome.values)
    again = after(outcome, _descent(problem, methods, control))
    table = reading_table(case, setup.readings.reason)
    return replace(setup, case=case, readings=table, mesh=found), problem, again


def _proves(options: MethodOptions) -> bool:
    """Whether a method proves a bound, of the problem as it is given."""
    return isinstance(options, ComplementarityOptions) and options.formulation == "global"


def _with_errors(
    setup: Setup,
    problem: Problem,
    outcome: Outcome,
    methods: Sequence[MethodOptions],
    control: Control,
) -> tuple[Setup, Problem, Outcome]:
    """The same with all errors that are estimated: those of the model and those of the gauges."""
    if no_model_error(setup.case, setup.readings, methods) is None:
        found = _with_model_error(setup, problem, outcome, methods, control)
        if found is not None:
            return found
    return _with_accuracies(setup, problem, outcome, methods, control)


def _descent(problem: Problem, methods: Sequence[MethodOptions], control: Control) -> Outcome:
    """One descent from where a problem begins, by the last method's steps.

    Raises:
        Interrupted: a stop was asked for.
    """
    outcome = descend(problem, methods[-1], control.observe)
    control.stop.check()
    return outcome


def _with_model_error(
    setup: Setup,
    problem: Problem,
    outcome: Outcome,
    methods: Sequence[MethodOptions],
    control: Control,
) -> tuple[Setup, Problem, Outcome] | None:
    """The same with the model error, and with accuracies that the case wants estimated.

    None where no reading can have a model error.
    """
    case, readings = setup.case, setup.readings
    length = correlation_length(case, case.fit.model_error)
    rows = used_rows(case, readings.used)
    pairs = [pair for pair, taken in zip(readings.pairs, readings.used, strict=True) if taken]

    structure = gauge_errors(rows)
    search = ModelErrorSearch(
        case.fit.model_error,
        length,
        structure,
        tuple(channel for channel, _ in rows),
        lambda increments: reading_steps(case, setup.model, increments, pairs, length),
        lambda again: _descent(again, methods, control),
        isinstance(case.fit.loss, SquaredOptions),
    )
    found = search.run(problem, outcome)
    if found is None:
        return None
    again = replace(setup, model_error=found.found)
    if structure.names:
        again = _sized(again, structure, found.components)
    elif search.scatters:
        again = _scattering(again, found.found)
    channels = tuple(channel for channel, _ in used_rows(again.case, readings.used))
    again = replace(again, model_error=found.found.of_channels(channels))
    return again, found.problem, found.outcome


def _scattering(setup: Setup, found: FittedModelError) -> Setup:
    """The setup with the errors of gauges that were found with the model error."""
    case = with_scatter(setup.case, found.factor, found.zero)
    table = reading_table(case, setup.readings.reason)
    return replace(setup, case=case, readings=table, stated=setup.case)


def _sized(setup: Setup, structure: ErrorStructure, found: VarianceComponents) -> Setup:
    """The setup with the accuracies that were estimated."""
    root = np.exp(0.5 * found.log_factor)
    factors = dict(zip(structure.names, map(float, root), strict=True))
    sized = with_accuracies(setup.case, factors)
    return replace(
        setup,
        case=sized,
        readings=reading_table(sized, setup.readings.reason),
        accuracies=accuracy_table(setup.case, structure.names, found),
    )


def _with_accuracies(
    setup: Setup,
    problem: Problem,
    outcome: Outcome,
    methods: Sequence[MethodOptions],
    control: Control,
) -> tuple[Setup, Problem, Outcome]:
    """The same with the accuracies that the case wants estimated; as it is where there are none."""
    case, used = setup.case, setup.readings.used
    structure = structure_of_used(case, used)
    if structure is None or not structure.names:
        return setup, problem, outcome
    found = weighed(
        problem, structure, outcome, lambda again: _search(again, continued(methods), control)
    )
    return _sized(setup, structure, found.components), found.problem, found.outcome


def _search(problem: Problem, methods: Sequence[MethodOptions], control: Control) -> Outcome:
    """Run the identifiers, one after the other.

    Raises:
        Interrupted: a stop was asked for.
    """
    outcome = identify(problem, methods, control.observe)
    control.stop.check()
    return outcome


def _tell_readings(setup: Setup, control: Control) -> None:
    """Say how many readings are used, which are not, and why."""
    readings = setup.readings
    control.monitor.detail(f"{np.count_nonzero(readings.used)} readings are used")
    for unused in unused_by_stage(readings):
        control.monitor.detail(f"not used: {unused}")
