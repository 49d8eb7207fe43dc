"""``geoident fit``: the parameters that meet the readings, and what they say of later stages."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from geoident.errors import ExitCode
from geoident.identify.problem.problem import STOPPED, Outcome, Problem
from geoident.model.arrays import Bools
from geoident.model.methods import method_name
from geoident.model.result import GaugeTable, Result
from geoident.workflow.running.accuracies import accuracy_findings
from geoident.workflow.running.control import Control
from geoident.workflow.running.diagnosis import (
    bound_findings,
    opened,
    over_all_stages,
    parameter_table,
    remarks,
)
from geoident.workflow.running.estimate import (
    Estimate,
    Finished,
    Setup,
    look,
    predicted,
    searched,
)
from geoident.workflow.running.evaluation_log import Log
from geoident.workflow.running.extrapolation import extrapolation_findings, stress_levels
from geoident.workflow.running.jobs import Job, job_provenance
from geoident.workflow.running.model_error import model_error_findings, model_error_notes
from geoident.workflow.running.predictions import (
    collapse_findings,
    predicted_stages,
    score,
)
from geoident.workflow.running.readings import gauge_table, unused_notes
from geoident.workflow.running.trials import LastStage, added, last_stage

MISFIT = 3.0
"""Scatter of the residuals, in accuracies, from which on the outcome says it at once."""


def fit(job: Job, control: Control) -> Finished:
    """Identify the parameters of a case and write the result; keep one that is up to date.

    Raises:
        InputError, ModelError, OutputError: see the commands' exit codes.
        Interrupted: a stop was asked for; a checkpoint is there.
    """

    def result(setup: Setup, problem: Problem, outcome: Outcome, log: Log) -> Result:
        found = look(setup, problem, outcome, fields=True)
        return _result(job, setup, found, _last_stage(setup, outcome, log, control))

    return searched(job, control, result)


def _last_stage(setup: Setup, outcome: Outcome, log: Log, control: Control) -> LastStage:
    """The last fitted stage, predicted from those before it: the cheapest backtest."""
    if not setup.case.fit.backtest or outcome.status == STOPPED:
        return LastStage()
    left = replace(control, out_of_time=False)  # that this runs out of time does not undo the fit
    return last_stage(setup, outcome.values, log, left)


def _result(job: Job, setup: Setup, found: Estimate, last: LastStage) -> Result:
    case, survey = setup.case, found.survey
    gauges = gauge_table(case, found.readings, survey.computed)
    parameters = opened(
        parameter_table(case.parameters, found.outcome.values, found.assessment),
        found.outcome.certificate,
    )
    prediction = predicted(setup, found, predicted_stages(gauges))
    status = _status(found)
    return Result(
        kind="fit",
        status=status,
        exit_code=ExitCode.DONE if status == "converged" else ExitCode.NOT_CONVERGED,
        method=" + ".join(method_name(options) for options in job.methods),
        reason=_reason(found, parameters.names),
        objective=found.outcome.objective,
        findings=(
            *collapse_findings(survey),
            *found.assessment.findings,
            *bound_findings(found.outcome.certificate, case.parameters),
            *remarks(found.diagnostics, gauges, parameters.names),
            *last.findings,
            *_extrapolation(setup, found, gauges),
            *(accuracy_findings(setup.accuracies) if setup.accuracies is not None else ()),
            *model_error_findings(setup.model_error),
        ),
        case_text=job.inputs.loaded.text,
        case_resolved=job.inputs.loaded.resolved,
        provenance=job_provenance(job),
        parameters=parameters,
        gauges=gauges,
        counts=added(found.counts, last.counts),
        sensitivity=survey.sensitivity,
        prediction=prediction if np.isfinite(prediction.mean).any() else None,
        history=found.outcome.iterations,
        fields=survey.fields,
        members=survey.members,
        singular_values=found.assessment.singular_values,
        diagnostics=found.diagnostics,
        accuracies=setup.accuracies,
        model_error=setup.model_error_table,
        backtest=last.backtest,
        certificate=over_all_stages(found.outcome.certificate, survey),
        notes=(
            *case.notes,
            *dict.fromkeys((*setup.model.notes, *found.survey.notes, *found.outcome.remarks)),
            *model_error_notes(setup.model_error, case, found.readings, job.methods),
            *unused_notes(found.readings),
            *score(gauges, prediction),
            *last.notes,
        ),
    )


def _extrapolation(setup: Setup, found: Estimate, gauges: GaugeTable) -> tuple[str, ...]:
    """Whether predicted stages load the ground more than the fitted ones did."""
    fitted = np.flatnonzero(~predicted_stages(gauges))
    if not fitted.size:
        return ()
    later = np.arange(len(gauges.stages)) > fitted[-1]
    levels = stress_levels(setup.model, setup.case, found.survey.fields)
    states = np.concatenate([[False], later])
    return extrapolation_findings(levels, setup.case, int(fitted[-1]) + 1, states)


def _status(found: Estimate) -> str:
    if found.outcome.status != "converged":
        return found.outcome.status
    return "not-determined" if _undetermined(found).any() else "converged"


def _scatter(found: Estimate) -> float:
    """Root mean square of the residuals in accuracies; 0 if the loss is robust to a few far off."""
    if found.diagnostics.loss != "squared":
        return 0.0
    used = int(np.isfinite(found.diagnostics.standardized).sum())
    freedom = max(used - len(found.outcome.values), 1)
    return float(np.sqrt(found.outcome.objective / freedom))


def _undetermined(found: Estimate) -> Bools:
    """Parameters (n,) that neither readings nor priors determine."""
    return ~(found.assessment.determined | found.assessment.from_prior)


def _reason(found: Estimate, names: tuple[str, ...]) -> str:
    loose = [names[i] for i in np.flatnonzero(_undetermined(found))]
    also = f" Not determined: {', '.join(loose)}." if loose else ""
    off = max(found.diagnostics.scale, _scatter(found))
    misfit = f" The model does not fit the readings: the residuals are {off:.0f} times as large as "
    misfit += "the stated accuracies (see the findings)."
    return found.outcome.reason + also + (misfit if off > MISFIT else "")
