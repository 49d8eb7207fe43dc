"""``geoident fit``: the parameters that meet the readings, and what they say of later stages."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from functools import partial

import numpy as np

from geoident.errors import ExitCode
from geoident.fem.solvers.threads import one_thread
from geoident.identify.problem.outcome import Outcome
from geoident.identify.problem.problem import Problem
from geoident.model.arrays import Bools
from geoident.model.in_service import SeasonalModel
from geoident.model.methods import method_name
from geoident.model.parameter import Parameter
from geoident.model.results.findings import Finding
from geoident.model.results.result import STOPPED, GaugeTable, ParameterTable, Result
from geoident.workflow.estimating.accuracies import accuracy_findings, freedom_notes
from geoident.workflow.estimating.correlated_residuals import correlated_findings
from geoident.workflow.estimating.diagnosis import (
    bound_findings,
    misfit_findings,
    opened,
    over_all_stages,
    parameter_table,
    remarks,
    why_poor,
    with_effect_of,
)
from geoident.workflow.estimating.estimate import (
    Estimate,
    assess_fit,
    details_of,
    predicted,
    searched,
)
from geoident.workflow.estimating.fields import field_estimates
from geoident.workflow.estimating.finished import Finished
from geoident.workflow.estimating.mistakes import MistakenReadings, mistakes_of_fit
from geoident.workflow.estimating.model_error import model_error_findings, model_error_notes
from geoident.workflow.estimating.predictions import (
    collapse_findings,
    correlations,
    predicted_places,
    predicted_stages,
    pull_findings,
    score,
    strength_findings,
)
from geoident.workflow.estimating.reading_patterns import (
    sign_findings,
    size_findings,
    still_findings,
)
from geoident.workflow.estimating.rivals import not_settled, rival_findings, with_rivals
from geoident.workflow.estimating.setup import Setup
from geoident.workflow.estimating.surface_error import surface_findings, surface_notes
from geoident.workflow.estimating.wrong_readings import (
    accuracy_residuals,
    gross_findings,
    gross_readings,
)
from geoident.workflow.in_service.fit import fit_seasonal
from geoident.workflow.in_service.structure import fit_structure
from geoident.workflow.running.computed import gauge_table
from geoident.workflow.running.control import Control
from geoident.workflow.running.evaluation_log import Log
from geoident.workflow.running.jobs import Job, job_provenance
from geoident.workflow.running.kept_reduced import NONE, made_to_keep
from geoident.workflow.running.plausible import implausible_findings
from geoident.workflow.running.readings import as_stated, unused_notes
from geoident.workflow.scoring.alarms import alarm_findings, alarm_states
from geoident.workflow.scoring.convergence import convergence_notes, convergence_states
from geoident.workflow.scoring.decisions import with_decisions
from geoident.workflow.scoring.extrapolation import extrapolation_findings, stress_levels
from geoident.workflow.scoring.ladder import fit_ladder
from geoident.workflow.scoring.left_out import left_out_rows, left_out_table
from geoident.workflow.scoring.settlement import settlement_notes, settlement_states
from geoident.workflow.scoring.trials import LastStage, last_stage


@one_thread()
def fit(job: Job, control: Control) -> Finished:
    """Identify the parameters of a case and write the result; keep one that is up to date.

    Raises:
        InputError, ModelError, OutputError: see the commands' exit codes.
        Interrupted: a stop was asked for; a checkpoint is there.
    """
    if isinstance(job.inputs.case.elsewhere, SeasonalModel):
        return fit_seasonal(job, control)
    if job.inputs.case.service is not None:
        return fit_structure(job, control)
    if job.inputs.case.fit.ladder:
        return fit_ladder(job, control, _fit)
    return _fit(job, control)


def _fit(job: Job, control: Control) -> Finished:
    """The fit of one model."""

    def result(setup: Setup, problem: Problem, outcome: Outcome, log: Log) -> Result:
        estimate = assess_fit(setup, problem, outcome, fields=True)
        last = _last_stage(job, setup, problem, outcome, log, control)
        stated = job.inputs.case
        wrong = mistakes_of_fit(stated, setup, problem, outcome, job.methods)
        doubts = () if wrong else _unit_findings(setup, estimate, log)
        together: tuple[Finding, ...] = ()
        if not wrong and outcome.status != STOPPED:  # a missed zero moves neighbours together, too
            p, readings = outcome.values, estimate.readings
            together = correlated_findings(setup.case, problem, p, readings)
        written = _result(job, setup, estimate, last, wrong, doubts, together)
        return _with_reduced(written, setup, control) if setup.case.fit.keep_reduced else written

    return searched(job, control, result)


def _with_reduced(result: Result, setup: Setup, control: Control) -> Result:
    """The same with a reduced model made around the answer, or with the finding why not."""
    if result.status == STOPPED:
        return _without_reduced(result, NONE.format("the search was cut short"))
    control.monitor.detail("making a reduced model")
    rivals, before = result.rivals, setup.model.counts
    others = () if rivals is None else tuple(rivals.values[1:])
    clock = replace(control, out_of_time=False)  # running out of time here undoes no fit
    reduced = made_to_keep(setup.model, setup.case, result.parameters, clock, others)
    counts = result.counts.joined(setup.model.counts.since(before))
    if isinstance(reduced, str):
        return _without_reduced(replace(result, counts=counts), reduced)
    return replace(result, counts=counts, reduced=reduced)


def _without_reduced(result: Result, why: str) -> Result:
    return replace(result, findings=(*result.findings, Finding("no-reduced-model", "", why)))


def _last_stage(
    job: Job, setup: Setup, problem: Problem, outcome: Outcome, log: Log, control: Control
) -> LastStage:
    """The last fitted stage, predicted from those before it: the cheapest backtest."""
    if not setup.case.fit.backtest or outcome.status == STOPPED:
        return LastStage()
    left = replace(control, out_of_time=False)  # that this runs out of time does not undo the fit
    return last_stage(setup, job.methods, outcome.values, log, left, problem.response)


def _unit_findings(setup: Setup, estimate: Estimate, log: Log) -> tuple[Finding, ...]:
    """Readings whose unit is suspected, the search having begun at the start."""
    stated = [parameter.start for parameter in setup.case.parameters]
    if not estimate.outcome.iterations:
        return ()
    start = estimate.outcome.iterations[0].values  # of a scaled parameter, to the last bit
    if not np.allclose(start, stated):
        return ()
    known = log.find("evaluate", start) or log.find("readings", start)
    if known is None or len(known["v"]) != np.count_nonzero(setup.readings.used):
        return ()
    met = estimate.outcome.status == "converged" and not estimate.assessment.at_bound.any()
    return size_findings(setup.case, setup.readings, known["v"], met=met)


def _result(
    job: Job,
    setup: Setup,
    estimate: Estimate,
    last: LastStage,
    wrong: MistakenReadings,
    doubts: Sequence[Finding],
    together: Sequence[Finding],
) -> Result:
    case, survey = setup.case, estimate.survey
    gauges = gauge_table(case, estimate.readings, survey.computed)
    parameters = opened(
        parameter_table(case.parameters, estimate.outcome.values, estimate.assessment),
        estimate.outcome.certificate,
    )
    parameters = with_rivals(parameters, case.parameters, estimate.rivals)
    left_out = left_out_rows(case)
    prediction = predicted(setup, estimate, predicted_places(gauges, left_out))
    scored = left_out_table(case, gauges, prediction)
    stated = as_stated(job.inputs.case, estimate.readings)
    gross = gross_readings(stated)
    gross = gross[~wrong.explained[gross]]
    # estimated accuracies are said themselves
    by_accuracy = not (len(gross) or wrong) and setup.accuracies is None
    poor = why_poor(estimate.diagnostics, gross, setup.model_error_table, mistaken=wrong.poor)
    status, named = _status(estimate, poor), parameters.named
    from_readings = (estimate.assessment.determined & ~estimate.assessment.from_prior)[named]
    judged = named[from_readings]  # of others no reading changes what is known
    correlated = len(together) > 0
    few, rests = _freedom(setup, estimate, parameters)
    known = {
        name: float(parameters.values[i])
        for i, name in enumerate(parameters.names)
        if np.isfinite(parameters.sd[i])
    }
    alarms = alarm_states(case, gauges, prediction)
    convergence = convergence_states(setup.model, estimate)
    settlement = settlement_states(setup, estimate)
    result = Result(
        kind="fit",
        status=status,
        exit_code=ExitCode.DONE if status == "converged" else ExitCode.NOT_CONVERGED,
        method=" + ".join(method_name(options) for options in job.methods),
        reason=_reason(estimate, case.parameters) + poor,
        objective=estimate.outcome.objective,
        findings=(
            *collapse_findings(survey),
            *wrong.findings,
            *gross_findings(gross, estimate.readings, case),
            *(() if wrong else still_findings(case, stated) or sign_findings(case, stated)),
            *strength_findings(survey),
            *pull_findings(case, survey),
            *alarm_findings(alarms),
            *doubts,
            *(
                ()
                if wrong or len(gross)
                else misfit_findings(estimate.diagnostics, correlated=correlated)
            ),
            *together,
            *(accuracy_residuals(replace(gauges, readings=stated)) if by_accuracy else ()),
            *rival_findings(estimate.rivals, parameters),
            *with_effect_of(
                estimate.assessment.findings, survey.sensitivity, case, parameters.names
            ),
            *bound_findings(estimate.outcome.certificate, case.parameters),
            *remarks(
                replace(
                    estimate.diagnostics, influence=estimate.diagnostics.influence[..., judged]
                ),
                gauges,
                parameters.picked(judged).names,
            ),
            *last.findings,
            *_extrapolation(setup, estimate, gauges),
            *(setup.mesh.findings if setup.mesh is not None else ()),
            *(setup.steps.findings if setup.steps is not None else ()),
            *surface_findings(setup.surface),
            *implausible_findings(case, known),
            *(
                accuracy_findings(setup.accuracies, correlated=correlated)
                if setup.accuracies is not None
                else ()
            ),
            *few,
            *(
                finding
                for finding in model_error_findings(setup.model_error, correlated=correlated)
                if not (wrong and finding.kind == "model-error-doubt")  # known what it is
            ),
        ),
        case_text=job.inputs.loaded.text,
        case_resolved=job.inputs.loaded.resolved,
        provenance=job_provenance(job),
        parameters=parameters,
        gauges=gauges,
        counts=estimate.counts.joined(last.counts),
        sensitivity=survey.sensitivity,
        prediction=prediction if np.isfinite(prediction.mean).any() else None,
        history=estimate.outcome.iterations,
        **details_of(survey, setup.case),
        singular_values=estimate.assessment.singular_values,
        diagnostics=estimate.diagnostics,
        accuracies=setup.accuracies,
        model_error=setup.model_error_table,
        surface=setup.surface,
        rivals=estimate.rivals,
        evidence=estimate.evidence,
        varied=field_estimates(setup.model, estimate.outcome.values, estimate.assessment),
        backtest=last.backtest,
        left_out=scored,
        alarms=alarms,
        convergence=convergence,
        settlement=settlement,
        certificate=over_all_stages(estimate.outcome.certificate, survey),
        notes=(
            *case.notes,
            *dict.fromkeys((*setup.model.notes, *estimate.survey.notes, *estimate.outcome.remarks)),
            *model_error_notes(setup.model_error, case, estimate.readings, job.methods),
            *surface_notes(setup.surface),
            *convergence_notes(convergence),
            *settlement_notes(settlement),
            *unused_notes(estimate.readings),
            *score(gauges, prediction, left_out),
            *(scored.sentences if scored else ()),
            *rests,
            *last.notes,
            *(setup.mesh.notes if setup.mesh is not None else ()),
            *(setup.steps.notes if setup.steps is not None else ()),
        ),
    )
    hang_together = partial(
        correlations,
        survey,
        estimate.assessment,
        known=estimate.errors,
        nonlinearity=estimate.nonlinearity,
    )
    return with_decisions(result, case, prediction, hang_together)


def _freedom(
    setup: Setup, estimate: Estimate, parameters: ParameterTable
) -> tuple[tuple[Finding, ...], tuple[str, ...]]:
    """On how many degrees of freedom the intervals rest: findings and notes."""
    known = [i for i in parameters.named.tolist() if np.isfinite(parameters.sd[i])]
    if setup.accuracies is None or not known:
        return (), ()
    names = [parameters.names[i] for i in known]
    return freedom_notes(setup.accuracies, estimate.assessment.wider[known], names)


def _extrapolation(setup: Setup, estimate: Estimate, gauges: GaugeTable) -> tuple[Finding, ...]:
    """Whether predicted stages load the ground more than the fitted ones did."""
    fitted = np.flatnonzero(~predicted_stages(gauges))
    if not fitted.size:
        return ()
    later = np.arange(len(gauges.stages)) > fitted[-1]
    levels = stress_levels(setup.model, setup.case, estimate.survey.fields)
    states = np.concatenate([[False], later])
    return extrapolation_findings(levels, setup.case, int(fitted[-1]) + 1, states)


def _status(estimate: Estimate, poor: str) -> str:
    if estimate.outcome.status != "converged":
        return estimate.outcome.status
    if poor:
        return "poor-fit"
    return "not-determined" if _undetermined(estimate).any() else "converged"


def _undetermined(estimate: Estimate) -> Bools:
    """Parameters (n,) that neither readings nor priors determine, or that rivals put apart."""
    loose = ~(estimate.assessment.determined | estimate.assessment.from_prior)
    differs = not_settled(estimate.rivals)
    return loose if differs is None else loose | differs


def _reason(estimate: Estimate, parameters: Sequence[Parameter]) -> str:
    loose = [parameters[i].name for i in np.flatnonzero(_undetermined(estimate)).tolist()]
    also = f" Not determined: {', '.join(loose)}." if loose else ""
    return estimate.outcome.reason + also
