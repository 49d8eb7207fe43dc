"""A fit of the first stages, what it says of later ones, and whether that came true (theory 13).

``backtest`` makes one for every stage that was read, ``fit`` one for all but its last stage.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from geoident.errors import InputError, ModelError
from geoident.forward.ground.field import named_parameters
from geoident.identify.assessment.scores import Innovations, p_value, scores
from geoident.identify.problem.ahead import starts_warm
from geoident.identify.problem.problem import Problem
from geoident.identify.problem.scaling import Scaling
from geoident.model.arrays import Bools, Floats
from geoident.model.methods import ComplementarityOptions, GaussNewtonOptions, MethodOptions
from geoident.model.response import Response
from geoident.model.results.backtest import Backtest, BacktestStep, Reach, Skipped
from geoident.model.results.bands import NORMAL_95, Bands, next_read
from geoident.model.results.costs import Counts
from geoident.model.results.findings import Finding
from geoident.model.results.result import GaugeTable
from geoident.workflow.estimating.diagnosis import assess_robustly, opened, parameter_table
from geoident.workflow.estimating.estimate import Estimate, assess_fit, predicted
from geoident.workflow.estimating.predictions import correlations
from geoident.workflow.estimating.search import estimated
from geoident.workflow.estimating.setup import Setup
from geoident.workflow.running.cached_response import CachedResponse
from geoident.workflow.running.computed import gauge_table
from geoident.workflow.running.control import Control
from geoident.workflow.running.evaluation_log import EvaluationArrays, Log, carry_over
from geoident.workflow.running.readings import errors_of_used, reading_table, require_enough
from geoident.workflow.scoring.extrapolation import extrapolation_findings, stress_levels
from geoident.workflow.scoring.horizon import Clock, asked_ahead, begin_of_test, horizons_of
from geoident.workflow.scoring.verdict import verdict

SPARE = 4
"""Readings more than parameters, for each accuracy that is estimated, with which a fit of the first
stages is made: with fewer the accuracy is known within a factor of two at best."""

LATER = "later than the fitted stages"
"""Why a fit of the first stages does not use a reading."""


@dataclass(frozen=True)
class FitLog:
    """A log as one fit of several sees it: what it keeps is not that of the others.

    Args:
        log: of all.
        name: of the fit.
    """

    log: Log
    name: str

    def find(self, kind: str, p: Floats) -> EvaluationArrays | None:
        """What was kept for this kind of evaluation at p (n,), or None."""
        return self.log.find(f"{self.name} {kind}", p)

    def add(self, kind: str, p: Floats, arrays: EvaluationArrays) -> None:
        """Keep an evaluation.

        Args:
            kind: of evaluation.
            p: (n,) where.
            arrays: (...) what was found, by name.
        """
        self.log.add(f"{self.name} {kind}", p, arrays)


@dataclass(frozen=True)
class PartialFit:
    """A fit of part of the readings, and what it says of those that came later.

    Args:
        setup: model, readings, and accuracies as estimated.
        problem: the fitted readings and their errors.
        estimate: the estimate.
        gauges: what was read and computed.
        step: what is kept of it.
        bands: of the readings that were predicted, (n_channels, n_stages).
        correlation: (l, l) of the errors of those predictions that are judged.
        next: (n_channels, n_stages) predictions of the next stage that was read.
        judged: (n_channels, n_stages) those of them by which it is judged what chance would do.
        extrapolates: stresses that fitted stages did not reach.
    """

    setup: Setup
    problem: Problem
    estimate: Estimate
    gauges: GaugeTable
    step: BacktestStep
    bands: Bands
    correlation: Floats
    next: Bools
    judged: Bools
    extrapolates: tuple[Finding, ...]


def nearby(options: MethodOptions) -> MethodOptions:
    """How to search from an answer that is near: no other starts."""
    if isinstance(options, GaussNewtonOptions):
        return replace(options, starts=1)
    if isinstance(options, ComplementarityOptions):
        return replace(options, restarts=0)
    return options


def read_stages(setup: Setup) -> list[int]:
    """Numbers of the stages of which readings are used."""
    readings = setup.readings
    read = {stage for stage, used in zip(readings.stage, readings.used, strict=True) if used}
    return [n for n, stage in enumerate(setup.case.stages) if stage.name in read]


MOST_MOMENTS = 16
"""Moments of stages that last up to which a backtest fits; of more, evenly spaced ones."""


def begins_of_fits(setup: Setup) -> list[int]:
    """Numbers of the stages up to which a backtest fits, the last of all that were read included.

    Stages that were read; of the many moments of stages that last, some, with that from which a
    fit looks as far ahead as the prediction does.
    """
    stages = read_stages(setup)
    if not setup.case.lasts or len(stages) <= MOST_MOMENTS:
        return stages
    chosen = {stages[k] for k in np.linspace(0, len(stages) - 1, MOST_MOMENTS).round().astype(int)}
    begin = begin_of_test(setup.case, setup.readings, stages)
    return sorted(chosen | ({begin} if begin is not None else set()))


def up_to(setup: Setup, last: int) -> Setup:
    """The same with the readings of the stages up to one.

    Args:
        setup: with all usable readings.
        last: number of the stage.

    Raises:
        InputError: they are fewer than the parameters, or too few to tell how accurate the gauges
            are: a fit could be made, but its bands would be those of an accident.
    """
    case = setup.case
    number = {stage.name: n for n, stage in enumerate(case.stages)}
    pairs = zip(setup.readings.reason, setup.readings.stage, strict=True)
    reasons = [why or (LATER if number[stage] > last else "") for why, stage in pairs]
    table = reading_table(case, reasons)
    require_enough(case, table)
    sizes = len(errors_of_used(case, table.used).names)
    used, n = int(np.count_nonzero(table.used)), len(named_parameters(case))
    if sizes and used - n < SPARE * sizes:
        message = (
            f"{used} usable readings say too little of {sizes} accuracies that are to be estimated "
            f"beside {n} parameters"
        )
        raise InputError([case.source.fault(("readings",), "too-few-readings", message)])
    return replace(setup, readings=table)


def tried(
    setup: Setup,
    last: int,
    methods: Sequence[MethodOptions],
    log: Log,
    control: Control,
    *,
    start: Floats | None,
    until: int | None = None,
    near: bool = False,
) -> PartialFit:
    """One fit and its predictions.

    Args:
        setup: model and all usable readings.
        last: number of the last stage to fit.
        methods: of the search.
        log: of its evaluations.
        control: progress, budget and stops.
        start: (n,) where to begin, SI; None for the start values of the case.
        until: number of the last stage to predict; None for all.
        near: a fit of the same model has ended there.

    Raises:
        InputError: there are fewer readings than parameters.
        ModelError: the model has no solution there.
        Interrupted: a stop was asked for.
    """
    part, before = up_to(setup, last), setup.model.counts
    fitted, problem, outcome = estimated(part, methods, log, control, start=start, near=near)
    end = None if until is None else until + 1
    estimate = assess_fit(fitted, problem, outcome, fields=True, last=end)
    levels = stress_levels(setup.model, setup.case, estimate.survey.fields)
    # fields are large, and not needed any more
    estimate = replace(estimate, survey=replace(estimate.survey, fields=None))
    gauges = gauge_table(fitted.case, estimate.readings, estimate.survey.computed)
    later = np.arange(len(gauges.stages)) > last
    prediction = predicted(fitted, estimate, later)
    usable = gauge_table(setup.case, setup.readings, gauges.computed)
    measured = np.where(usable.used, usable.measured, np.nan)
    bands = Bands(measured, prediction.mean, prediction.lower95, prediction.upper95)
    ahead = next_read(bands)
    judged = _thinned(ahead & bands.scored)
    excess = np.full(len(later), np.nan)
    if levels is not None:
        excess = np.fmax(*levels.excess(last + 1))[1:]
    states = np.concatenate([[False], later])
    table = opened(
        parameter_table(setup.case.parameters, outcome.values, estimate.assessment),
        outcome.certificate,
    )
    step = BacktestStep(
        last=last,
        readings=int(np.count_nonzero(part.readings.used)),
        status=estimate.outcome.status,
        reason=estimate.outcome.reason,
        values=outcome.values,
        sd=table.sd,
        lower95=table.lower95,
        upper95=table.upper95,
        determined=table.determined,
        prediction=prediction,
        log_density=bands.log_density,
        excess=excess,
        counts=estimate.counts.since(before),
    )
    return PartialFit(
        fitted,
        problem,
        estimate,
        gauges,
        step,
        bands,
        correlations(
            estimate.survey,
            estimate.assessment,
            prediction,
            judged,
            estimate.errors,
            estimate.nonlinearity,
        ),
        ahead,
        judged,
        extrapolation_findings(levels, setup.case, last + 1, states),
    )


_MOST_JUDGED = 1000
"""Predictions by which it is judged what chance would do: more say no more, as they hang together,
and their correlations would fill the memory."""


def hand_on(before: PartialFit, setup: Setup, last: int, log: Log) -> None:
    """Give a fit of more stages what the one before has computed at its answer, where it begins.

    An elastic analysis is kept, and goes on where it was left; one in which ground yields is not.

    Args:
        before: the fit of fewer stages.
        setup: model and all usable readings.
        last: number of the last stage that the other one fits.
        log: of the evaluations of that.
    """
    p, table = before.estimate.outcome.values, before.estimate.readings
    if not starts_warm(before.problem.response) or table.sensitivity is None:
        return
    try:
        rows = up_to(setup, last).readings.used
    except InputError:  # it is skipped
        return
    v, dv_dp = table.computed[rows], table.sensitivity[rows]
    if log.find("evaluate", p) is None and np.isfinite(v).all() and np.isfinite(dv_dp).all():
        increments = before.estimate.survey.increments[: last + 2]  # with the virgin state
        log.add("evaluate", p, {"v": v, "dv_dp": dv_dp, "increments": increments})


def backtest_of(setup: Setup, trials: Sequence[PartialFit], skipped: Sequence[Skipped]) -> Backtest:
    """What trials say together.

    Args:
        setup: with all usable readings.
        trials: one at least.
        skipped: the fits that could not be made.
    """
    ahead = np.stack([trial.next for trial in trials], axis=1)
    whole = Bands(
        *(
            np.stack([getattr(trial.bands, name) for trial in trials], axis=1)
            for name in ("measured", "mean", "lower95", "upper95")
        )
    )
    accuracy = setup.as_stated().case.accuracies[:, None]  # whatever was fitted
    kinds = [channel.dimension for channel in setup.case.channels]
    by_chance = p_value([_innovations(trial, trial.judged, trial.correlation) for trial in trials])
    stages, clock = read_stages(setup), Clock.of(setup.case)
    by_last = [(trial.step.last, trial.bands) for trial in of_full_errors(trials)]
    return Backtest(
        steps=tuple(trial.step for trial in trials),
        skipped=tuple(skipped),
        next=scores(whole.only(ahead), accuracy, kinds),
        further=scores(whole.only(~ahead), accuracy, kinds),
        few=by_chance.few,
        far=by_chance.far,
        measured=trials[0].bands.measured,
        horizons=horizons_of(by_last, stages, clock),
        reach=_reach(setup, trials),
    )


def of_full_errors(trials: Sequence[PartialFit]) -> Sequence[PartialFit]:
    """Trials without those that had too few readings for a model error, where others had enough.

    Their bands and intervals are those of a model without error.
    """
    full = [trial for trial in trials if trial.setup.model_error is not None]
    return full or trials


def _reach(setup: Setup, trials: Sequence[PartialFit]) -> Reach | None:
    """The test that looks as far ahead as the prediction does; None where no trial does.

    Args:
        setup: with all usable readings.
        trials: the fits.
    """
    case, stages = setup.case, read_stages(setup)
    begin = begin_of_test(case, setup.readings, stages)
    trial = next((one for one in trials if one.step.last == begin), None)
    if begin is None or trial is None or not trial.bands.scored.any():
        return None
    places = _thinned(trial.bands.scored)
    known = correlations(
        trial.estimate.survey,
        trial.estimate.assessment,
        trial.step.prediction,
        places,
        trial.estimate.errors,
        trial.estimate.nonlinearity,
    )
    by_chance = p_value([_innovations(trial, places, known)])
    clock, scored = Clock.of(case), trial.bands.scored
    return Reach(
        step=begin,
        stages=sum(stage > begin for stage in stages),
        far=float(clock.ahead(begin)[stages[-1]]),
        asked=asked_ahead(case, stages),
        dated=clock.dated,
        readings=int(np.count_nonzero(scored)),
        inside=int(np.count_nonzero(trial.bands.inside)),
        rms=float(np.sqrt(np.mean(trial.bands.z[scored] ** 2))),
        few=by_chance.few,
        large=by_chance.far,
        independent=len(known) ** 2 / float(np.sum(known**2)),
    )


def _thinned(places: Bools) -> Bools:
    """Those of (n_channels, n_stages) places by which it is judged what chance would do."""
    some = np.zeros_like(places)
    at = np.flatnonzero(places)
    some.flat[at[:: -(-len(at) // _MOST_JUDGED) or 1]] = True
    return some


def variances(trials: Sequence[PartialFit]) -> Floats:
    """Of each parameter, scaled, after each fit (k, n), all linearised at the last answer.

    How much a fit has gained on the one before is a small difference: it is lost where each is
    linearised at an answer of its own.

    Args:
        trials: k fits, of which the last has the readings of all.
    """
    last = trials[-1].estimate.readings
    assert last.sensitivity is not None
    values = trials[-1].estimate.outcome.values
    scale = Scaling(trials[-1].setup.case.parameters).dp_dx(values)
    squares = []
    for trial in trials:
        rows = trial.estimate.readings.used
        known = assess_robustly(trial.problem, values, last.computed[rows], last.sensitivity[rows])
        ratio = known.dp_dx / scale  # each search is scaled by where it began
        squares.append(ratio**2 * np.sum(known.determined_x**2, axis=1))
    return np.array(squares)


def _innovations(trial: PartialFit, places: Bools, correlation: Floats) -> Innovations:
    """The errors of some predictions of a fit.

    Args:
        trial: the fit.
        places: (n_channels, n_stages) of the l predictions.
        correlation: (l, l) of their errors.
    """
    z = trial.bands.z[places]
    estimated = trial.setup.accuracies
    if estimated is None:
        return Innovations(z, correlation)
    # the bands are those of Student's t already, and that is what is drawn by the freedom
    width = (trial.bands.upper95 - trial.bands.lower95)[places]
    z = z * width / (2.0 * NORMAL_95 * trial.step.prediction.sd[places])
    spare = trial.step.readings - len(trial.step.values)
    return Innovations(z, correlation, max(spare / len(estimated.names), 1.0))


NEARBY = GaussNewtonOptions(tolerance=1e-4, max_iterations=10, starts=1)
"""How a fit searches from its own answer for that of all but its last stage: its intervals are
thousands of times wider than this tolerance matters. It is no more exact than that of the fit."""


def near_answer(options: MethodOptions) -> GaussNewtonOptions:
    """How to search near the answer that a method has found.

    It is never sharper than that method.
    """
    own = options.tolerance if isinstance(options, ComplementarityOptions) else 0.0
    return replace(NEARBY, tolerance=max(NEARBY.tolerance, own))


@dataclass(frozen=True)
class LastStage:
    """What a fit of all but the last stage says of that, beside the fit of all.

    Args:
        backtest: of one step; None where it could not be made.
        findings: what the user should know.
        notes: other sentences.
        counts: what it has cost.
    """

    backtest: Backtest | None = None
    findings: tuple[Finding, ...] = ()
    notes: tuple[str, ...] = ()
    counts: Counts = field(default_factory=Counts)


def last_stage(
    setup: Setup,
    methods: Sequence[MethodOptions],
    answer: Floats,
    log: Log,
    control: Control,
    response: Response,
) -> LastStage:
    """The readings of the last fitted stage, predicted from those before it.

    Of a series as many of the last stages as the prediction looks ahead (`begin_of_test`).
    Accuracies that the fit has estimated are kept.

    Args:
        setup: model and readings of the fit, with its accuracies.
        methods: of the fit.
        answer: (n,) its parameters, SI.
        log: of its evaluations.
        control: progress, budget and stops.
        response: of its search: what that knows at the answer, and of the analyses that its reduced
            model is made of, is not computed again.

    Raises:
        Interrupted: a stop was asked for.
    """
    stages = read_stages(setup)
    if len(stages) < 2:
        return LastStage()
    begin = begin_of_test(setup.case, setup.readings, stages)
    series = begin is not None
    until = begin if begin is not None else stages[-2]
    first, last = (setup.case.stages[n].name for n in (stages[stages.index(until) + 1], stages[-1]))
    tested = last if first == last else f"{first} to {last}"
    what = f"Backtest of {tested} from the readings up to {setup.case.stages[until].name}"
    part = FitLog(log, "all but the last stage:")
    readings = setup.readings
    numbers = [setup.case.stage_names.index(stage) for stage in readings.stage]
    earlier = np.array(numbers)[readings.used] <= until + 1
    if isinstance(response, CachedResponse):
        known, visited = response.exact_answer(answer), response.visited()
        carry_over(known, part, answer, earlier, until + 2, visited)
    try:
        trial = tried(
            setup,
            until,
            (nearby(methods[-1]) if series else near_answer(methods[-1]),),
            part,
            control,
            start=answer,
            until=stages[-1],
            near=not series,  # of a part of a series the answer may be far
        )
    except (InputError, ModelError) as error:
        return LastStage(notes=(f"{what}: none, {clause(error)}.",))
    counts = trial.step.counts
    if control.out_of_time:
        return LastStage(notes=(f"{what}: the time was used up.",), counts=counts)
    backtest = backtest_of(setup, [trial], ())
    judged = verdict(backtest, trial.gauges)
    text = f"{what}: {judged.sentence[0].lower()}{judged.sentence[1:]}"
    if not backtest.next.readings:
        return LastStage(notes=(text,), counts=counts)
    if judged.remarkable:
        return LastStage(backtest, (Finding("bands", last, text),), (), counts)
    return LastStage(backtest, (), (text,), counts)


def clause(error: InputError | ModelError) -> str:
    """What is wrong, for the middle of a sentence."""
    message = error.faults[0].message if isinstance(error, InputError) else error.message
    return message.rstrip(".")
