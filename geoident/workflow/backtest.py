"""``geoident backtest``: fit the stages up to each one that was read, and predict the later ones.

The model is built once. Every fit does all that ``fit`` does (it estimates accuracies and model
error too), analyses no farther than its last stage, and begins where the one before ended, but for
the last, which is that of ``fit``; one more analysis of all stages gives its predictions.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from functools import reduce

import numpy as np

from geoident.errors import ExitCode, InputError, ModelError, TimeIsUp
from geoident.fem.solvers.threads import one_thread
from geoident.identify.assessment.findings import join
from geoident.model.case import Case
from geoident.model.gauges import ReadingTable
from geoident.model.methods import MethodOptions, method_name
from geoident.model.results.backtest import Backtest, Skipped
from geoident.model.results.costs import Counts
from geoident.model.results.findings import Finding, sentences_of
from geoident.model.results.result import STOPPED, Result
from geoident.workflow.estimating.accuracies import accuracy_findings
from geoident.workflow.estimating.diagnosis import bare_parameter_table, opened, parameter_table
from geoident.workflow.estimating.finished import Finished, run_job
from geoident.workflow.estimating.predictions import collapse_findings
from geoident.workflow.estimating.setup import Setup, require_possible
from geoident.workflow.running.computed import gauge_table
from geoident.workflow.running.control import OUT_OF_TIME, Control
from geoident.workflow.running.evaluation_log import Log
from geoident.workflow.running.jobs import Job, build_model, job_provenance
from geoident.workflow.running.plausible import implausible_findings
from geoident.workflow.running.readings import reading_table, select_readings, unused_notes
from geoident.workflow.scoring.trials import (
    FitLog,
    PartialFit,
    backtest_of,
    begins_of_fits,
    clause,
    hand_on,
    nearby,
    of_full_errors,
    tried,
    variances,
)
from geoident.workflow.scoring.verdict import Verdict, settling, verdict

LEFT_OUT = "the stage is left out of fit.stages"
"""Why a backtest does not use a reading of a stage before the last one of fit.stages."""

BANDS_FAIL = "bands-fail"
"""Status of a backtest more of whose readings lie outside of their bands than chance explains."""


@one_thread()
def backtest(job: Job, control: Control) -> Finished:
    """Fit and predict for every number of stages, score, and write; keep what is up to date.

    Raises:
        InputError, ModelError, OutputError: see the commands' exit codes.
        Interrupted: a stop was asked for; a checkpoint is there.
    """

    def result(setup: Setup, log: Log) -> Result:
        trials, skipped = run_trials(setup, job.methods, log, control)
        return _result(job, setup, trials, skipped, out_of_time=control.out_of_time)

    return run_job(job, control, prepare_backtest, result)


def prepare_backtest(job: Job) -> Setup:
    """Build the model of a job and select all usable readings.

    Raises:
        InputError: the case does not fit its mesh, or fewer than two stages were read.
        ModelError: the model moves freely somewhere.
    """
    model = build_model(job.inputs, solver=job.request.solver)
    case = model.case
    require_possible(model, case, job.methods)
    setup = Setup(model, case, select_readings(case, model))
    readings = all_readings(setup)
    read = {name for name, used in zip(readings.stage, readings.used, strict=True) if used}
    if len(read) < 2:
        count = "one stage" if read else "no stage"
        fault = case.source.fault(
            ("readings",),
            "too-few-stages",
            f"usable readings of {count}: a backtest fits the readings of some stages and "
            "compares its predictions with those of later ones",
            "Give readings of two stages at least.",
        )
        raise InputError([fault])
    return replace(setup, readings=readings)


def all_readings(setup: Setup) -> ReadingTable:
    """All readings that can be used, those of stages after the last one of fit.stages too.

    ``fit.stages`` says how far a fit goes; a backtest goes on. A stage that it leaves out before
    its last one is left out on purpose, and takes no part.

    Args:
        setup: with the readings of a fit.
    """
    case, fitted = setup.case, setup.case.fit.stages
    if fitted is None:
        return setup.readings
    names = [stage.name for stage in case.stages]
    last = max(names.index(name) for name in fitted)
    open_case = replace(case, fit=replace(case.fit, stages=None))
    table = select_readings(open_case, setup.model)
    left_out = {name for name in names[:last] if name not in fitted}
    reasons = [
        why or (LEFT_OUT if stage in left_out else "")
        for why, stage in zip(table.reason, table.stage, strict=True)
    ]
    return reading_table(case, reasons)


def run_trials(
    setup: Setup, methods: Sequence[MethodOptions], log: Log, control: Control
) -> tuple[list[PartialFit], list[Skipped]]:
    """A fit for each of the stages that were read, with its predictions.

    Args:
        setup: model and all usable readings.
        methods: of the first fit and the last; the others begin at the answer before.
        log: of the evaluations of all.
        control: progress, budget and stops.

    Returns:
        The fits, and what was skipped. Fewer where the time was used up.

    Raises:
        Interrupted: a stop was asked for.
    """
    trials: list[PartialFit] = []
    skipped: list[Skipped] = []
    stages = begins_of_fits(setup)
    for last in stages:
        control.stop.check()
        name = setup.case.stages[last].name
        # the last is what `fit` finds in the same readings: near another answer may be another one
        alone = not trials or last == stages[-1]
        start = None if alone else trials[-1].estimate.outcome.values
        chain = methods if alone else (nearby(methods[-1]),)
        try:
            until = stages[-1] if last != stages[-1] else None  # the last also predicts unread ones
            part = FitLog(log, f"to {last}:")
            if not alone:
                hand_on(trials[-1], setup, last, part)
            trial = tried(setup, last, chain, part, control, start=start, until=until)
        except TimeIsUp:
            break
        except (InputError, ModelError) as error:
            skipped.append(Skipped(name, clause(error)))
            control.monitor.inform(f"up to {name}: skipped, {skipped[-1].why}")
            continue
        if trial.step.status == STOPPED:
            break
        trials.append(trial)
        if trial.setup.mesh is not None:
            setup = replace(setup, mesh=trial.setup.mesh)  # the next need not ask the mesh again
        if trial.setup.steps is not None:
            setup = replace(setup, steps=trial.setup.steps)
        control.monitor.inform(_progress(trial, name))
    return trials, skipped


def _progress(trial: PartialFit, name: str) -> str:
    step, ahead = trial.step, trial.bands.only(trial.next)
    line = f"up to {name}: {step.status}, {step.readings} readings, "
    line += f"{step.counts.factorizations} factorizations"
    count = np.count_nonzero(ahead.scored)
    inside = f"; next stage: {np.count_nonzero(ahead.inside)} of {count} inside"
    return line + (inside if count else "")


def _result(
    job: Job,
    setup: Setup,
    trials: Sequence[PartialFit],
    skipped: Sequence[Skipped],
    *,
    out_of_time: bool,
) -> Result:
    """What the fits say together; without fits, that the time was used up before.

    Raises:
        InputError: all fits were skipped.
    """
    case, start = setup.case, setup.case.start
    if not trials and not out_of_time:
        reasons = "; ".join(f"up to {one.stage}: {one.why}" for one in skipped)
        message = f"no fit could be made: {reasons}"
        raise InputError([case.source.fault(("readings",), "no-fit", message)])
    p = np.array([start[parameter.name] for parameter in case.parameters], dtype=np.float64)
    nothing = np.full((len(case.channels), len(case.stages)), np.nan)
    without = Result(
        kind="backtest",
        status=STOPPED,
        exit_code=ExitCode.NOT_CONVERGED,
        method=" + ".join(method_name(options) for options in job.methods),
        reason=f"{OUT_OF_TIME} No fit was done.",
        objective=float("nan"),
        findings=(),
        case_text=job.inputs.loaded.text,
        case_resolved=job.inputs.loaded.resolved,
        provenance=job_provenance(job),
        parameters=bare_parameter_table(case.parameters, p),
        gauges=gauge_table(case, setup.readings, nothing),
        counts=setup.model.counts,
        notes=(*case.notes, *unused_notes(setup.readings)),
    )
    if not trials:
        return without
    last, estimate = trials[-1], trials[-1].estimate
    fits = backtest_of(setup, trials, skipped)
    judged = _judged(setup, trials, fits)
    settled = of_full_errors(trials) if fits.horizons else trials
    restless, others = settling(
        case,
        [trial.step for trial in settled],
        variances(settled),
        estimated=last.setup.accuracies is not None,
    )
    status, reason = ending(case, fits, judged, out_of_time=out_of_time)
    outcome = estimate.outcome
    table = parameter_table(case.parameters, outcome.values, estimate.assessment)
    collapses = [one for trial in trials for one in collapse_findings(trial.estimate.survey)]
    bands = Finding("bands", "", judged.sentence)
    return replace(
        without,
        status=status,
        exit_code=ExitCode.DONE if status == "done" else ExitCode.NOT_CONVERGED,
        reason=reason,
        objective=outcome.objective,
        findings=(
            *((bands,) if judged.remarkable and reason != judged.sentence else ()),
            *restless,
            *last.extrapolates,  # to stages that nobody has read yet
            *dict.fromkeys(collapses),
            *implausible_findings(case),
        ),
        parameters=opened(table, outcome.certificate),
        gauges=last.gauges,
        counts=reduce(Counts.joined, (trial.step.counts for trial in trials)),
        accuracies=last.setup.accuracies,
        backtest=fits,
        notes=(
            *others,
            *(
                f"The fit up to {case.stages[trial.step.last].name} extrapolates. {one.sentence}"
                for trial in trials[:-1]
                for one in trial.extrapolates
            ),
            *(f"No fit of the readings up to {one.stage}: {one.why}." for one in skipped),
            *sentences_of(
                accuracy_findings(last.setup.accuracies) if last.setup.accuracies else ()
            ),
            *case.notes,
            *setup.model.notes,
            *unused_notes(setup.readings),
        ),
    )


def _judged(setup: Setup, trials: Sequence[PartialFit], fits: Backtest) -> Verdict:
    """Whether the bands hold; fits that know no model error, beside others, do not decide it.

    Fits of the first stages have often too few readings to estimate one. Their bands are those of a
    model without error, as each says, and are no test of the later ones.

    Args:
        setup: with all usable readings.
        trials: the fits.
        fits: what they say together.
    """
    whole = verdict(fits, trials[-1].gauges)
    full = of_full_errors(trials)
    if whole.holds or len(full) == len(trials):
        return whole
    rest = verdict(backtest_of(setup, full, ()), trials[-1].gauges)
    if not rest.holds:
        return whole
    bare = [trial for trial in trials if trial.setup.model_error is None]
    names = join([setup.case.stages[trial.step.last].name for trial in bare], "and")
    text = (
        f"{rest.sentence} Predictions from the readings up to {names} alone are not counted: these "
        "are too few to estimate a model error, and bands without it do not hold."
    )
    return Verdict(True, text, remarkable=True)


def ending(case: Case, fits: Backtest, judged: Verdict, *, out_of_time: bool) -> tuple[str, str]:
    """Status and reason of a backtest.

    Args:
        case: names of the stages.
        fits: what its fits say together.
        judged: whether the bands hold.
        out_of_time: the time was used up.
    """
    if out_of_time:
        return STOPPED, f"{OUT_OF_TIME} Fits that were done: {len(fits.steps)}."
    failed = [step for step in fits.steps if step.status != "converged"]
    if failed:
        names = ", ".join(case.stages[step.last].name for step in failed)
        return failed[0].status, f"The fit up to {names} is not finished: {failed[0].reason}"
    if not fits.next.readings:
        return "not-determined", judged.sentence
    return ("done" if judged.holds else BANDS_FAIL), judged.sentence
