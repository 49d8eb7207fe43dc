"""``geoident predict``: what the gauges will show, from a fit that is there."""

from __future__ import annotations

import time
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from math import isclose
from typing import Any

import numpy as np

from geoident.errors import ExitCode, Fault, InputError, Location, ModelError, Term, UsageError
from geoident.fem.solvers.threads import one_thread
from geoident.forward.external.table import TableModel
from geoident.forward.observed import ObservedModel, Survey
from geoident.forward.reduced.case_model import ReducedCaseModel
from geoident.identify.assessment.diagnostics import effective_sd
from geoident.identify.assessment.profile_path import Nonlinearity
from geoident.identify.assessment.uncertainty import Assessment, assess
from geoident.identify.problem.outcome import Outcome
from geoident.identify.problem.problem import Problem
from geoident.io.result.file import read_result
from geoident.io.text.yaml_reader import parse_yaml
from geoident.model.arrays import Bools, Ints
from geoident.model.case import Case
from geoident.model.gauges import Channel, Reading, ReadingTable
from geoident.model.ground import RandomField
from geoident.model.results.bands import Prediction
from geoident.model.results.findings import Finding
from geoident.model.results.result import ParameterTable, Provenance, Result
from geoident.workflow.estimating.accuracies import Possible, with_found, with_scatter
from geoident.workflow.estimating.diagnosis import at_used
from geoident.workflow.estimating.estimate import assess_fit, later_errors, predicted
from geoident.workflow.estimating.fields import require_same_modes
from geoident.workflow.estimating.finished import Finished, at_hand, write
from geoident.workflow.estimating.model_error import FittedModelError
from geoident.workflow.estimating.predictions import (
    KnownErrors,
    chosen_stages,
    collapse_findings,
    follow_bound,
    predict_stages,
    predicted_stages,
    score,
)
from geoident.workflow.estimating.rivals import mixed_prediction
from geoident.workflow.estimating.setup import (
    Setup,
    model_error_of_result,
    problem_of_result,
)
from geoident.workflow.estimating.surface_error import surface_sources, with_surface_error
from geoident.workflow.running.computed import accuracies, gauge_table, with_computed
from geoident.workflow.running.control import Control
from geoident.workflow.running.jobs import (
    Inputs,
    build_model,
    inputs_of_result,
    load_inputs,
    of_fit,
    provenance,
)
from geoident.workflow.running.kept_reduced import answer_note, answered, restored_of
from geoident.workflow.running.outputs import Existing, Target, existing, require_free, target
from geoident.workflow.running.readings import bad_notes, reading_table, used_rows, why_useless
from geoident.workflow.running.result_files import case_path, files_of_result

POOR = " Its model does not fit the readings: these predictions are not to be relied on."
"""What is said of predictions from a poor fit."""

LEFT_OUT = (
    "The fit has {} minima beside its answer that are nearly as low, which these bands leave out "
    "({}): they are too narrow."
)
"""What is said where other minima cannot be asked."""


@dataclass(frozen=True)
class PredictRequest:
    """What to predict.

    Args:
        result: path of a fit.
        stages: names of the stages to predict; all that took no part in the fit if empty.
        case: path of a case to predict in place of that of the fit, or None.
        overrides: of that case.
        output: a file or an existing folder; None for beside the result.
        solver: name of the sparse solver, or ``auto``.
        force: overwrite a prediction of other input.
        fresh: compute again what is up to date.
        text: of that case where it stands in no file.
    """

    result: str
    stages: tuple[str, ...] = ()
    case: str | None = None
    overrides: tuple[str, ...] = ()
    output: str | None = None
    solver: str = "auto"
    force: bool = False
    fresh: bool = False
    text: str | None = None


@dataclass(frozen=True)
class FitKnowledge:
    """What a fit knows of the parameters of the case to predict.

    Args:
        parameters: their table, in the order of that case.
        assessment: likewise.
        readings: of the fit.
        problem: of the fit: its used readings with the accuracies that its loss leaves them.
        errors: what its readings tell of errors that later ones share; None where none do.
        model_error: of the fit; None for none.
        nonlinearity: how readings deviate from linear where a bound truncates a parameter, or None.
    """

    parameters: ParameterTable
    assessment: Assessment
    readings: ReadingTable
    problem: Problem
    errors: KnownErrors | None = None
    model_error: FittedModelError | None = None
    nonlinearity: Nonlinearity | None = None


@dataclass(frozen=True)
class Task:
    """A prediction that can be made.

    Args:
        request: what was asked for.
        fit: the fit to predict from.
        origin: the case of the fit, with its mesh as it is now.
        inputs: the case to predict.
        place: of the result.
        identity: hash of everything that the result depends on.
        existing: what stands at its place.
        others: why the gauges of another case are not those of the fit; empty where they are.
    """

    request: PredictRequest
    fit: Result
    origin: Inputs
    inputs: Inputs
    place: Target
    identity: str
    existing: Existing
    others: str = ""

    @property
    def files_read(self) -> tuple[str, ...]:
        """Paths of the fit, of the case to predict, and of what they name."""
        return (*files_of_result(self.fit, self.request.result), *self.inputs.files)

    @property
    def provenance(self) -> Provenance:
        """Where the result comes from."""
        origin = provenance(
            self.inputs,
            command="predict",
            identity=self.identity,
            seed=self.fit.provenance.seed,
            output=self.place.path,
        )
        return of_fit(origin, self.fit, self.request.result, self.place.path)


def plan_prediction(request: PredictRequest) -> Task:
    """Read a fit and the case to predict, and look at what stands where the result goes.

    Raises:
        InputError: the result is no fit, its mesh has changed, or a parameter is not in it.
        OutputError: the result could not be written, or another one would be lost.
        UsageError: there is no such stage.
    """
    fit = _read_fit(request.result)
    origin = inputs_of_result(fit, case_path(request.result, fit.provenance.case_file))
    inputs = _inputs(request, origin, fit)
    _require_stages(request.stages, inputs.case)
    require_identified(fit, inputs)
    _require_same_fields(fit, origin.case, inputs)
    others = "" if request.case is None else why_other_gauges(fit, origin, inputs)
    if request.case is not None and not others:
        inputs = _with_gauges_of_fit(inputs, origin, fit)
    place = target(request.result, "predict", output=request.output)
    purpose = f"predict {fit.fingerprint} {request.stages}"
    identity = inputs.identity(purpose, (), seed=fit.provenance.seed)
    state = existing(place, identity, kind="predict", case=inputs.path)
    return Task(request, fit, origin, inputs, place, identity, state, others)


@one_thread()
def predict(task: Task, control: Control) -> Finished:
    """Predict readings with their bands and write them; keep a result that is up to date."""
    request, place, existing = task.request, task.place, task.existing
    before = at_hand(place, task.identity, existing, force=request.force, fresh=request.fresh)
    if before is not None:
        return before
    require_free(existing, place, force=request.force, inputs=task.files_read)
    model = _model(task)
    task = _with_other_surfaces(task, model)
    known = what_is_known(task.fit, task.origin.case, model, task.inputs.case, task.others)
    require_same_modes(task.fit, model, task.inputs.case, known.parameters.values)
    control.stop.check()
    survey = model.survey(known.parameters.values, fields=True, partial=True)
    if isinstance(model, ReducedCaseModel) and not model.by_model:  # the fit has it all
        fit = task.fit
        survey = replace(
            survey,
            fields=fit.fields,
            members=fit.members,
            reactions=fit.reactions,
            yielded=fit.yielded,
            mechanism=fit.mechanism,
            reaction=fit.reaction,
            advance=fit.advance,
        )
    result = _result(task, _followed(task, known, survey, model), survey, model)
    took = time.monotonic() - control.started
    result = replace(result, provenance=replace(result.provenance, seconds=took))
    return write(result, place, existing, inputs=task.files_read, force=request.force)


def _model(task: Task) -> ObservedModel:
    """The case to predict, answered by the reduced model that its fit keeps where there is one."""

    def build() -> ObservedModel:
        return build_model(task.inputs, solver=task.request.solver)

    case = task.inputs.case
    same = task.request.case is None and case.fit.reduced
    restored = restored_of(task.fit, case) if same else None
    return build() if restored is None else answered(restored, case, build)


def _with_other_surfaces(task: Task, model: ObservedModel) -> Task:
    """The same with the error of the response surfaces of another case than that of the fit.

    Another table knows other things: its errors have nothing to do with those of the fit's.
    """
    if task.request.case is None or not isinstance(model, TableModel):
        return task
    known = dict(zip(task.fit.parameters.names, task.fit.parameters.values, strict=True))
    p = np.array([known[name] for name in model.names], dtype=np.float64)
    after = surface_sources(task.origin.case)
    case = with_surface_error(task.inputs.case, model, p, after=after)
    return replace(task, inputs=replace(task.inputs, loaded=replace(task.inputs.loaded, case=case)))


def _read_fit(path: str) -> Result:
    result = read_result(path)
    if result.kind == "fit" and result.gauges.readings.sensitivity is not None:
        return result
    message = f"A {result.kind} cannot be predicted from; the result of a fit is expected."
    raise InputError([Fault("not-a-fit", message, location=Location(path))])


def _inputs(request: PredictRequest, origin: Inputs, fit: Result) -> Inputs:
    if request.case is not None:
        return load_inputs(request.case, overrides=request.overrides, text=request.text)
    if origin.mesh_sha256 == fit.provenance.mesh_sha256:
        return origin
    fault = Fault(
        "changed-mesh",
        "The mesh is not the one that the fit was made with.",
        f"Run the fit again, or give the case to predict with {Term.OTHER_CASE}.",
        Location(origin.loaded.mesh_path or origin.path),
    )
    raise InputError([fault])


def _require_stages(stages: Sequence[str], case: Case) -> None:
    names = [stage.name for stage in case.stages]
    unknown = [stage for stage in stages if stage not in names]
    if unknown:
        raise UsageError(f"There is no stage {unknown[0]!r}; the stages are: {', '.join(names)}.")


def require_identified(fit: Result, inputs: Inputs) -> None:
    """Refuse a case with parameters that a fit does not know.

    Raises:
        InputError: with those parameters.
    """
    known = fit.parameters.names
    faults = [
        inputs.case.source.fault(
            ("parameters", parameter.name),
            code="not-identified",
            message=f"the fit knows no parameter {parameter.name!r}",
            hint=f"It identified {', '.join(known)}; give a number instead.",
        )
        for parameter in inputs.case.parameters
        if parameter.name not in known
    ]
    if faults:
        raise InputError(faults)


def _require_same_fields(fit: Result, origin: Case, inputs: Inputs) -> None:
    """Refuse another case whose fields, or their modes, are not those of the fit.

    Raises:
        InputError: with those fields.
    """
    known = {_unplaced(field) for field in origin.fields}
    same_mesh = inputs.mesh_sha256 == fit.provenance.mesh_sha256
    faults = [
        inputs.case.source.fault(
            field.path,
            code="other-field",
            message=f"the modes of {field.name} are not those of the fit"
            + ("" if same_mesh else ", which was made on another mesh"),
            hint="Modes are of one mesh, covariance and set of tests: keep these as they were.",
        )
        for field in inputs.case.fields
        if not same_mesh or _unplaced(field) not in known
    ]
    if faults:
        raise InputError(faults)


def why_other_gauges(fit: Result, origin: Inputs, inputs: Inputs) -> str:
    """Why the gauges of another case are not those of a fit; empty where they are.

    They are where the case has every reading that the fit has used, at a gauge that is written as
    it was. Names tell nothing: gauges of two sections are often called alike.

    Args:
        fit: the result.
        origin: its case.
        inputs: the other case.
    """
    written, now = (_gauges_as_written(each) for each in (origin, inputs))
    channels = {channel.name: channel for channel in inputs.case.channels}
    values: dict[tuple[str, str], list[float]] = {}
    for reading in inputs.case.readings:
        if reading.value is not None and not reading.bad:
            values.setdefault((reading.channel, reading.stage), []).append(reading.value)
    for channel, reading in used_rows(origin.case, fit.gauges.readings.used):
        other = channels.get(channel.name)
        if other is None:
            return f"it has no gauge '{channel.name}'"
        if written.get(channel.gauge) != now.get(channel.gauge) or _placed(channel) != _placed(
            other
        ):
            return f"the gauge '{channel.gauge}' is written otherwise"
        read = values.get((reading.channel, reading.stage), [])
        if not any(isclose(value, reading.value or 0.0, rel_tol=1e-9) for value in read):
            return f"the reading of {reading.channel} at {reading.stage} is not in it"
    return ""


def _gauges_as_written(inputs: Inputs) -> dict[str, Any]:
    """What a case says of each gauge, by its name."""
    data = parse_yaml(inputs.loaded.resolved, inputs.path).data
    gauges = data.get("gauges") if isinstance(data, dict) else None
    return gauges if isinstance(gauges, dict) else {}


def _placed(channel: Channel) -> Channel:
    """A channel without its errors, which a fit may have estimated."""
    return replace(channel, accuracy=0.0, errors=None, key=())


def _with_gauges_of_fit(inputs: Inputs, origin: Inputs, fit: Result) -> Inputs:
    """A case with the gauges of a fit, with the accuracies that this has found.

    Gauges that the fit does not have are as accurate as it found those of their kind.

    Args:
        inputs: of the case.
        origin: of the case of the fit.
        fit: the result.
    """
    case, fitted = inputs.case, {channel.name: channel for channel in origin.case.channels}
    same_mesh = inputs.mesh_sha256 == fit.provenance.mesh_sha256
    if fit.model_error is not None:
        case = with_scatter(case, fit.model_error.factor, fit.model_error.zero)
    if fit.accuracies is not None:
        case = with_found(case, fit.accuracies)

    def as_fitted(channel: Channel) -> Channel:
        before = fitted.get(channel.name)
        if before is None or _placed(before) != _placed(channel):
            return channel
        errors = before.errors
        if errors is not None and not same_mesh:
            errors = replace(errors, mesh=())
        return replace(channel, accuracy=before.accuracy, errors=errors)

    case = replace(case, channels=tuple(as_fitted(channel) for channel in case.channels))
    return replace(inputs, loaded=replace(inputs.loaded, case=case))


def _unplaced(field: RandomField) -> RandomField:
    """A field without where it is written."""
    measured = tuple(replace(test, path=(), origin="") for test in field.measured)
    return replace(field, path=(), measured=measured)


def what_is_known(
    fit: Result, origin: Case, model: ObservedModel, case: Case, others: str = ""
) -> FitKnowledge:
    """What a fit knows, for the parameters of the case of a model, matched by name.

    How well they are known is assessed again from the sensitivities that the fit holds.

    Args:
        fit: the result.
        origin: the case of the fit.
        model: of the case to predict.
        case: to predict.
        others: why its gauges are others than those of the fit, of whose errors this then knows
            nothing, nor of the model error where they are; empty where they are the same.
    """
    readings = fit.gauges.readings
    used = readings.used
    computed, jacobian = at_used(readings)
    problem = problem_of_result(fit, origin, model.response(()))
    problem = replace(problem, sd=effective_sd(problem, computed))
    p, rows = fit.parameters.values, used_rows(origin, used)
    model_error = model_error_of_result(fit, origin)
    possible, over = Possible.of(fit.accuracies, used), None
    if possible is not None:
        structure = possible.structure(rows)
        if model_error is not None:
            structure = model_error.with_later(structure)
        over = possible.over(problem, structure, p, computed, jacobian)
    assessment = assess(problem, p, jacobian, computed, over)
    order = np.array([fit.parameters.names.index(name) for name in model.names], dtype=np.int64)
    parameters = fit.parameters.picked(order)
    known = KnownErrors(case, problem, computed, jacobian[:, order], rows, possible=possible)
    shares = any(channel.errors for channel in (*origin.channels, *case.channels))
    if others:
        nothing = replace(problem, measured=problem.measured[:0], sd=problem.sd[:0], shared=None)
        known = KnownErrors(case, nothing, computed[:0], jacobian[:0, order], ())
        model_error = None if model_error is None else model_error.of_nothing_used()
    return FitKnowledge(
        parameters,
        pick_assessment(assessment, order),
        readings,
        problem,
        known if shares or model_error is not None else None,
        model_error,
    )


def _followed(
    task: Task, known: FitKnowledge, survey: Survey, model: ObservedModel
) -> FitKnowledge:
    """With the posterior where a bound truncates it, as the fit has it; not for another case.

    Args:
        task: the prediction.
        known: what the fit knows.
        survey: the model at the estimate.
        model: of the case to predict.
    """
    if task.request.case is not None:
        return known
    case, p = task.inputs.case, known.parameters.values
    readings = with_computed(known.readings, case, model, survey, p)
    assessment, nonlinearity = follow_bound(
        model, case, known.problem, p, survey, readings, known.assessment
    )
    return replace(known, assessment=assessment, nonlinearity=nonlinearity)


def _at_rivals(
    task: Task, known: FitKnowledge, model: ObservedModel, stages: Bools
) -> list[Prediction]:
    """What the other minima of a fit predict, in their order, as the fit has it.

    Args:
        task: the prediction.
        known: what the fit knows.
        model: of its case.
        stages: (n_stages,) which to predict.
    """
    rivals, case = task.fit.rivals, task.inputs.case
    assert rivals is not None
    setup = Setup(model, case, known.readings, task.fit.accuracies, known.model_error)
    problem = problem_of_result(task.fit, case, model.response(()))
    predictions = []
    for values, phi in zip(rivals.values[1:], rivals.objectives[1:], strict=True):
        outcome = Outcome(values, float(phi), task.fit.status, "", ())
        predictions.append(
            predicted(setup, assess_fit(setup, problem, outcome, fields=False), stages)
        )
    return predictions


def _others(
    task: Task, known: FitKnowledge, model: ObservedModel, stages: Bools
) -> tuple[list[Prediction], tuple[str, ...]]:
    """What the other minima of a fit predict, and a note where they have to be left out.

    Args:
        task: the prediction.
        known: what the fit knows.
        model: of the case to predict.
        stages: (n_stages,) which to predict.
    """
    if task.fit.rivals is None:
        return [], ()
    if task.request.case is None:
        return _at_rivals(task, known, model, stages), ()
    if task.origin.mesh_sha256 != task.fit.provenance.mesh_sha256:
        why = "the mesh of the fit has changed"
        return [], (LEFT_OUT.format(len(task.fit.rivals) - 1, why),)
    try:
        return _of_another_case(task, model, stages), ()
    except ModelError as error:
        why = f"with the values of one of them {error}"
        return [], (LEFT_OUT.format(len(task.fit.rivals) - 1, why),)


def _of_another_case(task: Task, model: ObservedModel, stages: Bools) -> list[Prediction]:
    """What the other minima predict of another case.

    The model of the fit tells how well each knows its parameters and the errors that are shared.

    Args:
        task: the prediction.
        model: of the case to predict.
        stages: (n_stages,) which to predict.

    Raises:
        ModelError: a model has no solution at one of them.
    """
    fit, origin, case = task.fit, task.origin.case, task.inputs.case
    rivals = fit.rivals
    assert rivals is not None
    fitted = build_model(task.origin, solver=task.request.solver)
    predictions = []
    for values in rivals.values[1:]:
        at_rival = fitted.survey(values, fields=False, partial=True)
        readings = with_computed(fit.gauges.readings, origin, fitted, at_rival, values)
        known = what_is_known(
            replace(
                fit,
                parameters=replace(fit.parameters, values=values),
                gauges=replace(fit.gauges, readings=readings),
            ),
            origin,
            model,
            case,
            task.others,
        )
        survey = model.survey(known.parameters.values, fields=False, partial=True)
        errors = _with_later(known, model, case, survey)
        predictions.append(
            predict_stages(survey, known.assessment, accuracies(case), stages, errors)
        )
    return predictions


def _with_later(
    known: FitKnowledge, model: ObservedModel, case: Case, survey: Survey
) -> KnownErrors | None:
    """What is known of shared errors, with the model error in the readings of a case."""
    if known.errors is None:
        return None
    later = later_errors(model, case, survey, known.model_error)
    return replace(known.errors, model_error=later)


def pick_assessment(assessment: Assessment, order: Ints) -> Assessment:
    """What is known of some parameters, by their numbers (k,), whatever the others are."""
    intervals = ("sd", "lower95", "upper95", "beyond_bounds", "dp_dx")
    columns = (*intervals, "at_bound", "determined", "from_prior")
    square = np.ix_(order, order)
    return replace(
        assessment,
        covariance=assessment.covariance[square],
        correlation=assessment.correlation[square],
        posterior=assessment.posterior.pick(order),
        uncut_mean=assessment.uncut_mean[order],
        uncut_factor=assessment.uncut_factor[order],
        determined_x=assessment.determined_x[order],
        gaps_x=assessment.gaps_x[order],
        held_covariance_x=assessment.held_covariance_x[square],
        over=None if assessment.over is None else assessment.over.pick(order),
        wider=assessment.wider[order],
        **{name: getattr(assessment, name)[order] for name in columns},
    )


def _readings(task: Task, known: FitKnowledge) -> ReadingTable:
    """The readings of the case to predict, those of which the fit knows used as it did."""
    if task.request.case is None:
        return known.readings
    case, table = task.inputs.case, known.readings
    left: dict[tuple[str, str], list[float]] = {}
    if not task.others:
        for k in np.flatnonzero(table.used).tolist():
            left.setdefault((table.channel[k], table.stage[k]), []).append(float(table.value[k]))

    def why_unused(reading: Reading) -> str:
        """Why the fit did not use it; empty if it did."""
        useless, values = why_useless(reading), left.get((reading.channel, reading.stage), [])
        if useless:
            return useless
        for value in values:
            if isclose(value, reading.value or 0.0, rel_tol=1e-9):
                values.remove(value)
                return ""
        return "the fit has not used it"

    return reading_table(case, [why_unused(reading) for reading in case.readings])


def _result(task: Task, known: FitKnowledge, survey: Survey, model: ObservedModel) -> Result:
    case, fit = task.inputs.case, task.fit
    p = known.parameters.values
    readings = with_computed(_readings(task, known), case, model, survey, p)
    gauges = gauge_table(case, readings, survey.computed)
    poor = fit.status == "poor-fit"
    names = task.request.stages
    stages = chosen_stages(gauges, names) if names else predicted_stages(gauges)
    errors = _with_later(known, model, case, survey)
    prediction = predict_stages(
        survey, known.assessment, accuracies(case), stages, errors, known.nonlinearity
    )
    inherited = [one for one in fit.findings if one.kind != "collapse"]  # it has its own
    if task.others:  # its gauges may have the same names
        inherited = [replace(one, sentence=f"Of the fit: {one.sentence}") for one in inherited]
    others, left_out = _others(task, known, model, stages)
    if fit.rivals is not None and others:
        prediction = mixed_prediction(fit.rivals.odds, [prediction, *others])
    return Result(
        kind="predict",
        status="poor-fit" if poor else "done",
        exit_code=ExitCode.NOT_CONVERGED if poor else ExitCode.DONE,
        method=fit.method,
        reason=f"Predicted from {task.request.result} ({fit.status})." + (POOR if poor else ""),
        objective=fit.objective,
        findings=(*_whose_gauges(task), *collapse_findings(survey), *inherited),
        case_text=task.inputs.loaded.text,
        case_resolved=task.inputs.loaded.resolved,
        provenance=task.provenance,
        parameters=known.parameters,
        gauges=gauges,
        counts=model.counts,
        sensitivity=survey.sensitivity,
        prediction=prediction,
        fields=survey.fields,
        members=survey.members,
        reactions=survey.reactions,
        yielded=survey.yielded,
        mechanism=survey.mechanism,
        reaction=survey.reaction,
        advance=survey.advance,
        singular_values=fit.singular_values,
        varied=fit.varied if task.request.case is None else (),
        notes=(
            *left_out,
            *_by_reduced(task, model),
            *bad_notes(readings),
            *score(gauges, prediction),
        ),
    )


def _whose_gauges(task: Task) -> Iterator[Finding]:
    """Whether what the fit knows of its gauges holds in another case."""
    name, fit = task.request.case, task.fit
    if name is None:
        return
    if not task.others:
        yield Finding(
            "other-case",
            "",
            f"{name} has all readings that the fit has used, so its gauges are those of the fit: "
            "what these readings tell of errors of zeros, heads and set-ups, and of the model, "
            "holds for it, too.",
        )
        return
    estimated = fit.accuracies is not None
    estimated |= fit.model_error is not None and fit.model_error.factor != 1.0
    more = " Accuracies that the fit has estimated are not either." if estimated else ""
    yield Finding(
        "other-case",
        "",
        f"{name} counts as another section, since {task.others}: no error of a gauge is taken over "
        "from the fit, and bands hold those of its own zeros and set-ups and of the model there."
        f"{more} If the gauges are the same, let it have them and the readings of the fit "
        "unchanged.",
    )


def _by_reduced(task: Task, model: ObservedModel) -> tuple[str, ...]:
    """Whose the readings are, where a reduced model was asked."""
    if not isinstance(model, ReducedCaseModel):
        return ()
    return (answer_note(model, task.request.result),)
