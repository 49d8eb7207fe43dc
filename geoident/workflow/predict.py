"""``geoident predict``: what the gauges will show, from a fit that is there."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from geoident.errors import ExitCode, ModelError, Term, UsageError
from geoident.fem.solvers.threads import one_thread
from geoident.forward.external.table import TableModel
from geoident.forward.model import StagedModel
from geoident.forward.observed import ObservedModel, Survey
from geoident.forward.reduced.case_model import ReducedCaseModel
from geoident.model.arrays import Bools
from geoident.model.case import Case
from geoident.model.results.bands import Prediction
from geoident.model.results.findings import Finding
from geoident.model.results.result import Result
from geoident.workflow.estimating.another_case import (
    readings_as_used,
    require_identified,
    require_same_fields,
    why_other_gauges,
    with_gauges_of_fit,
)
from geoident.workflow.estimating.estimate import details_of
from geoident.workflow.estimating.fields import require_same_modes
from geoident.workflow.estimating.finished import Finished, job_at_hand
from geoident.workflow.estimating.from_fit import (
    FitTask,
    KnownByFit,
    known_by_fit,
    plan_on_fit,
    read_fit,
    require_same_mesh,
)
from geoident.workflow.estimating.predictions import (
    chosen_stages,
    collapse_findings,
    correlations,
    predict_stages,
    predicted_places,
    pull_findings,
    score,
    strength_findings,
)
from geoident.workflow.estimating.rivals import mixed_prediction
from geoident.workflow.estimating.step_error import (
    counts_alone,
    step_error,
    steps_sentence,
    takes_steps,
    with_step_error,
)
from geoident.workflow.estimating.surface_error import surface_sources, with_surface_error
from geoident.workflow.running.computed import accuracies, gauge_table, with_computed
from geoident.workflow.running.control import Control
from geoident.workflow.running.jobs import Inputs, Request, build_model, job_provenance, load_inputs
from geoident.workflow.running.kept_reduced import answer_note, answered, restored_of
from geoident.workflow.running.readings import bad_notes
from geoident.workflow.scoring.alarms import alarm_findings, alarm_states
from geoident.workflow.scoring.decisions import with_decisions
from geoident.workflow.scoring.left_out import left_out_rows, left_out_table

POOR = " Its model does not fit the readings: these predictions are not to be relied on."
"""What is said of predictions from a poor fit."""

_OWN = ("collapse", "strength", "alarm", "decision")
"""Kinds of findings of which a prediction has its own, in place of those of the fit."""

LEFT_OUT = (
    "The fit has {} minima beside its answer that are nearly as low, which these bands leave out "
    "({}): they are too narrow."
)
"""What is said where other minima cannot be asked."""


@dataclass(frozen=True)
class PredictRequest:
    """What to predict.

    Args:
        request: with the path of a fit as its case; overrides and text are those of another case.
        stages: names of the stages to predict; all that took no part in the fit if empty.
        case: path of another case to predict in place of that of the fit, or None.
    """

    request: Request
    stages: tuple[str, ...] = ()
    case: str | None = None


@dataclass(frozen=True, kw_only=True)
class PredictTask(FitTask):
    """A prediction that can be made.

    Args:
        asked: what was asked for.
        origin: the case of the fit, with its mesh as it is now.
        others: why the gauges of another case are not those of the fit; empty where they are.
    """

    asked: PredictRequest
    origin: Inputs
    others: str = ""


def plan_prediction(asked: PredictRequest) -> PredictTask:
    """Read a fit and the case to predict, and look at what stands where the result goes.

    Raises:
        InputError: the result is no fit, its mesh has changed, or a parameter is not in it.
        OutputError: the result could not be written, or another one would be lost.
        UsageError: there is no such stage.
    """
    request = asked.request
    fit, origin = read_fit(request.case, "predicted")
    if asked.case is None:
        hint = f"Run the fit again, or give the case to predict with {Term.OTHER_CASE}."
        require_same_mesh(fit, origin, hint)
        inputs = origin
    else:
        inputs = load_inputs(asked.case, overrides=request.overrides, text=request.text)
    names = [stage.name for stage in inputs.case.stages]
    if unknown := [stage for stage in asked.stages if stage not in names]:
        raise UsageError(f"There is no stage {unknown[0]!r}; the stages are: {', '.join(names)}.")
    require_identified(fit, inputs)
    require_same_fields(fit, origin.case, inputs)
    others = ""
    if asked.case is not None:
        others = why_other_gauges(fit, origin, inputs)
        if not others:
            inputs = with_gauges_of_fit(inputs, origin, fit)
    seeded = replace(request, seed=fit.provenance.seed)
    job = plan_on_fit("predict", str(asked.stages), seeded, fit, inputs)
    return PredictTask(fit=fit, job=job, asked=asked, origin=origin, others=others)


@one_thread()
def predict(task: PredictTask, control: Control) -> Finished:
    """Predict readings with their bands and write them; keep a result that is up to date."""
    if (before := job_at_hand(task.job)) is not None:
        return before
    task.require_free()
    fit, same_case = task.fit, task.asked.case is None
    model, case = _model(task)
    parameters = fit.parameters.of(model.names)
    p = parameters.values
    require_same_modes(fit, model, case, p)
    control.stop.check()
    steps: tuple[str, ...] = ()
    if not same_case and isinstance(model, StagedModel) and takes_steps(case):
        error = step_error(model, p)  # the fit knows that of its own stages and steps
        steps = (steps_sentence(error),)
        if counts_alone(error):
            case = with_step_error(case, error)
    survey = model.survey(p, fields=True, partial=True)
    if isinstance(model, ReducedCaseModel) and not model.by_model:  # the fit has it all
        survey = replace(survey, **details_of(fit, case))
    table = fit.gauges.readings
    if not same_case:
        table = readings_as_used(case, table, others=bool(task.others))
    readings = with_computed(table, case, model, survey, p)
    gauges = gauge_table(case, readings, survey.computed)
    chosen = task.asked.stages
    rows = left_out_rows(case)
    places = chosen_stages(gauges, chosen) if chosen else predicted_places(gauges, rows)
    prediction, known, left_out = _prediction(task, model, case, survey, places)
    scored = left_out_table(case, gauges, prediction)
    inherited = [one for one in fit.findings if one.kind not in _OWN]
    if task.others:  # its gauges may have the same names
        inherited = [replace(one, sentence=f"Of the fit: {one.sentence}") for one in inherited]
    alarms = alarm_states(case, gauges, prediction)
    by_reduced: tuple[str, ...] = ()
    if isinstance(model, ReducedCaseModel):
        by_reduced = (answer_note(model, task.job.request.case),)
    poor = fit.status == "poor-fit"
    result = Result(
        kind="predict",
        status="poor-fit" if poor else "done",
        exit_code=ExitCode.NOT_CONVERGED if poor else ExitCode.DONE,
        method=fit.method,
        reason=f"Predicted from {task.job.request.case} ({fit.status})." + (POOR if poor else ""),
        objective=fit.objective,
        findings=(
            *_whose_gauges(task),
            *collapse_findings(survey),
            *strength_findings(survey),
            *pull_findings(model.case, survey),
            *alarm_findings(alarms),
            *inherited,
        ),
        case_text=task.job.inputs.loaded.text,
        case_resolved=task.job.inputs.loaded.resolved,
        provenance=job_provenance(task.job),
        parameters=parameters,
        gauges=gauges,
        counts=model.counts,
        sensitivity=survey.sensitivity,
        prediction=prediction,
        alarms=alarms,
        **details_of(survey, case),
        singular_values=fit.singular_values,
        varied=fit.varied if same_case else (),
        notes=(
            *left_out,
            *steps,
            *by_reduced,
            *bad_notes(readings),
            *score(gauges, prediction, rows),
            *(scored.sentences if scored else ()),
        ),
        left_out=scored,
    )
    together = partial(
        correlations, survey, known.assessment, known=known.errors, nonlinearity=known.nonlinearity
    )
    return task.write(with_decisions(result, case, prediction, together))


def _model(task: PredictTask) -> tuple[ObservedModel, Case]:
    """The model of the case to predict, and that case with the errors that count there.

    The case of the fit itself is answered by the reduced model that the fit keeps. Another table of
    runs has response surfaces of its own, whose errors have nothing to do with those of the fit.
    """
    case, inputs = task.job.inputs.case, task.job.inputs

    def build() -> ObservedModel:
        return build_model(inputs, solver=task.job.request.solver)

    if task.asked.case is None:
        restored = restored_of(task.fit, case) if case.fit.reduced else None
        return (build() if restored is None else answered(restored, case, build)), case
    model = build()
    if isinstance(model, TableModel):
        table = task.fit.parameters
        known = dict(zip(table.names, table.values, strict=True))
        p = np.array([known[name] for name in model.names], dtype=np.float64)
        case = with_surface_error(case, model, p, after=surface_sources(task.origin.case))
    return model, case


def _prediction(
    task: PredictTask, model: ObservedModel, case: Case, survey: Survey, places: Bools
) -> tuple[Prediction, KnownByFit, tuple[str, ...]]:
    """What all minima of a fit predict, what is known at the first, and a note on rivals left out.

    What is known at a rival of another case is assessed by the model of the case of the fit.

    Args:
        task: the prediction.
        model: of the case to predict.
        case: to predict.
        survey: of the model at the answer of the fit.
        places: (n_channels, n_stages) which to predict, or (n_stages,) of all channels.
    """
    fit, origin, same_case = task.fit, task.origin, task.asked.case is None
    (first, known), rivals = _of_one_minimum(task, fit, model, case, survey, places), fit.rivals
    if rivals is None:
        return first, known, ()
    if not same_case and origin.mesh_sha256 != fit.provenance.mesh_sha256:
        return first, known, (LEFT_OUT.format(len(rivals) - 1, "the mesh of the fit has changed"),)
    fitted = model if same_case else build_model(origin, solver=task.job.request.solver)
    order = [fit.parameters.names.index(name) for name in model.names]
    others = []
    try:
        for values in rivals.values[1:]:
            of_fit = fitted.survey(values, fields=False, partial=True)
            table = with_computed(fit.gauges.readings, origin.case, fitted, of_fit, values)
            at_rival = replace(
                fit,
                parameters=replace(fit.parameters, values=values),
                gauges=replace(fit.gauges, readings=table),
            )
            there = of_fit
            if not same_case:
                there = model.survey(values[order], fields=False, partial=True)
            others.append(_of_one_minimum(task, at_rival, model, case, there, places)[0])
    except ModelError as error:
        why = f"with the values of one of them {error}"
        return first, known, (LEFT_OUT.format(len(rivals) - 1, why),)
    return mixed_prediction(rivals.odds, [first, *others]), known, ()


def _of_one_minimum(
    task: PredictTask, fit: Result, model: ObservedModel, case: Case, survey: Survey, places: Bools
) -> tuple[Prediction, KnownByFit]:
    """What a fit predicts at its parameters, or at those of a rival that stands in their place.

    Args:
        task: the prediction.
        fit: the fit, with the parameters.
        model: of the case to predict.
        case: to predict.
        survey: of the model there.
        places: (n_channels, n_stages) which to predict, or (n_stages,) of all channels.
    """
    same_case, others = task.asked.case is None, bool(task.others)
    known = known_by_fit(
        fit, task.origin.case, model, case, survey, same_case=same_case, others=others
    )
    prediction = predict_stages(
        survey, known.assessment, accuracies(case), places, known.errors, known.nonlinearity
    )
    return prediction, known


def _whose_gauges(task: PredictTask) -> Iterator[Finding]:
    """Whether what the fit knows of its gauges holds in another case."""
    name, fit = task.asked.case, task.fit
    if name is None:
        return
    if not task.others:
        yield Finding(
            "other-case",
            "",
            f"{name} has all readings that the fit has used, so its gauges are those of the fit. "
            "The estimated errors of zeros, heads and set-ups and of the model apply to it, too.",
        )
        return
    estimated = fit.accuracies is not None
    estimated |= fit.model_error is not None and fit.model_error.factor != 1.0
    more = " Accuracies that the fit has estimated are not used either." if estimated else ""
    yield Finding(
        "other-case",
        "",
        f"{name} counts as another section, since {task.others}. The errors of gauges that the fit "
        "has estimated are not used. The bands include the errors of zeros and set-ups of this "
        f"section, and of the model there.{more} If the gauges are the same, repeat them and the "
        "readings of the fit unchanged in this case.",
    )
