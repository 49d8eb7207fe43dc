"""``geoident scan``: the discrepancy on a grid."""

from __future__ import annotations

from geoident.errors import ExitCode
from geoident.fem.solvers.threads import one_thread
from geoident.identify.problem.outcome import Outcome
from geoident.identify.problem.problem import Problem
from geoident.model.methods import method_name
from geoident.model.results.costs import Counts
from geoident.model.results.result import GaugeTable, Result
from geoident.workflow.estimating.diagnosis import bare_parameter_table
from geoident.workflow.estimating.estimate import searched, surveyed
from geoident.workflow.estimating.finished import Finished
from geoident.workflow.estimating.setup import Setup
from geoident.workflow.running.computed import gauge_table
from geoident.workflow.running.control import Control
from geoident.workflow.running.evaluation_log import Log
from geoident.workflow.running.jobs import Job, job_provenance
from geoident.workflow.running.plausible import implausible_findings
from geoident.workflow.running.readings import unused_notes
from geoident.workflow.running.reduced_scan import ReadingsByReduced


@one_thread()
def scan(job: Job, control: Control) -> Finished:
    """Compute the discrepancy on a grid and write the result; keep one that is up to date.

    Raises:
        Interrupted: a stop was asked for; a checkpoint is there.
    """

    def result(setup: Setup, problem: Problem, outcome: Outcome, log: Log) -> Result:
        survey, readings, counts = surveyed(setup, problem, outcome, fields=False)
        gauges = gauge_table(setup.case, readings, survey.computed)
        response = problem.response
        notes = (response.note,) if isinstance(response, ReadingsByReduced) else ()
        return _result(job, setup, outcome, counts, notes, gauges=gauges)

    return searched(job, control, result)


def _result(
    job: Job,
    setup: Setup,
    outcome: Outcome,
    counts: Counts,
    notes: tuple[str, ...],
    *,
    gauges: GaugeTable,
) -> Result:
    cut_short = outcome.status == "out-of-budget"
    return Result(
        kind="scan",
        status=outcome.status if cut_short else "done",
        exit_code=ExitCode.NOT_CONVERGED if cut_short else ExitCode.DONE,
        method=" + ".join(method_name(options) for options in job.methods),
        reason=outcome.reason,
        objective=outcome.objective,
        findings=implausible_findings(setup.case),
        case_text=job.inputs.loaded.text,
        case_resolved=job.inputs.loaded.resolved,
        provenance=job_provenance(job),
        parameters=bare_parameter_table(setup.case.parameters, outcome.values),
        gauges=gauges,
        counts=counts,
        history=outcome.iterations,
        grid=outcome.grid,
        notes=(*notes, *job.inputs.case.notes, *setup.model.notes, *unused_notes(gauges.readings)),
    )
