"""``geoident fit``: the parameters that meet the readings, and what they say of later stages."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from geoident.errors import ExitCode
from geoident.forward.protocols import Survey
from geoident.identify.assessment.diagnostics import effective_sd
from geoident.identify.assessment.uncertainty import Assessment
from geoident.identify.problem.problem import Outcome, Problem
from geoident.model.arrays import Bools
from geoident.model.gauges import ReadingTable
from geoident.model.methods import method_name
from geoident.model.result import Counts, Diagnostics, Result
from geoident.workflow.running.accuracies import accuracy_findings
from geoident.workflow.running.control import Control
from geoident.workflow.running.diagnosis import (
    assess_robustly,
    at_used,
    bound_findings,
    diagnostics_table,
    opened,
    over_all_stages,
    parameter_table,
    remarks,
)
from geoident.workflow.running.estimate import Finished, Setup, searched, surveyed, used_rows
from geoident.workflow.running.jobs import Job, job_provenance
from geoident.workflow.running.predictions import (
    KnownErrors,
    collapse_findings,
    predict_stages,
    predicted_stages,
    score,
)
from geoident.workflow.running.readings import accuracies, gauge_table, unused_notes

MISFIT = 3.0
"""Scatter of the residuals, in accuracies, from which on the outcome says it at once."""


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
    """

    outcome: Outcome
    assessment: Assessment
    readings: ReadingTable
    diagnostics: Diagnostics
    survey: Survey
    counts: Counts
    errors: KnownErrors | None = None


def fit(job: Job, control: Control) -> Finished:
    """Identify the parameters of a case and write the result; keep one that is up to date.

    Raises:
        InputError, ModelError, OutputError: see the commands' exit codes.
        Interrupted: a stop was asked for; a checkpoint is there.
    """

    def result(setup: Setup, problem: Problem, outcome: Outcome) -> Result:
        return _result(job, setup, _look(setup, problem, outcome))

    return searched(job, control, result)


def _look(setup: Setup, problem: Problem, outcome: Outcome) -> Estimate:
    """One survey of the model at the end of the search says everything else."""
    survey, readings, counts = surveyed(setup, problem, outcome, fields=True)
    computed, jacobian = at_used(readings)
    assessment = assess_robustly(problem, outcome.values, computed, jacobian)
    diagnostics = diagnostics_table(problem, readings, outcome.values, assessment)
    known = None
    if any(channel.errors for channel in setup.case.channels):
        left = replace(problem, sd=effective_sd(problem, computed))
        rows = used_rows(setup.case, readings.used)
        known = KnownErrors(setup.case, left, computed, jacobian, rows)
    return Estimate(outcome, assessment, readings, diagnostics, survey, counts, known)


def _result(job: Job, setup: Setup, found: Estimate) -> Result:
    case, survey = setup.case, found.survey
    gauges = gauge_table(case, found.readings, survey.computed)
    parameters = opened(
        parameter_table(case.parameters, found.outcome.values, found.assessment),
        found.outcome.certificate,
    )
    stages = predicted_stages(gauges)
    prediction = predict_stages(survey, found.assessment, accuracies(case), stages, found.errors)
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
            *(accuracy_findings(setup.accuracies) if setup.accuracies is not None else ()),
        ),
        case_text=job.inputs.loaded.text,
        case_resolved=job.inputs.loaded.resolved,
        provenance=job_provenance(job),
        parameters=parameters,
        gauges=gauges,
        counts=found.counts,
        sensitivity=survey.sensitivity,
        prediction=prediction if np.isfinite(prediction.mean).any() else None,
        history=found.outcome.iterations,
        fields=survey.fields,
        members=survey.members,
        singular_values=found.assessment.singular_values,
        diagnostics=found.diagnostics,
        accuracies=setup.accuracies,
        certificate=over_all_stages(found.outcome.certificate, survey),
        notes=(
            *case.notes,
            *dict.fromkeys((*setup.model.notes, *found.survey.notes, *found.outcome.remarks)),
            *unused_notes(found.readings),
            *score(gauges, prediction),
        ),
    )


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
