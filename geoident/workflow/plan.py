"""``geoident plan``: the gauges that tell most of a prediction or a parameter (theory 17)."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from scipy.special import ndtr

from geoident.errors import ExitCode, Fault, InputError, ModelError, Term, UsageError
from geoident.fem.solvers.threads import one_thread
from geoident.identify.assessment.design import Gauges, choose
from geoident.io.case.candidates import Candidates, read_candidates
from geoident.io.case.decisions import read_place
from geoident.io.result.file import read_identity
from geoident.io.text.wording import Refusal, did_you_mean, shorten
from geoident.io.text.yaml_reader import parse_yaml
from geoident.model.arrays import Floats, Ints
from geoident.model.case import Case
from geoident.model.gauges import named_channels
from geoident.model.in_service import SeasonalModel
from geoident.model.results.plan import GaugePlan, PlannedGauge, PlanTarget
from geoident.model.results.result import Result
from geoident.workflow.estimating.diagnosis import parameter_table
from geoident.workflow.estimating.finished import Finished, job_at_hand, write
from geoident.workflow.estimating.from_fit import plan_on_fit, read_fit, require_same_mesh
from geoident.workflow.estimating.outlooks import (
    ASSUMED,
    Linearised,
    Plannable,
    Wanted,
    last_read,
    linearised,
)
from geoident.workflow.estimating.surface_error import with_surface_error
from geoident.workflow.running.computed import accuracies, gauge_table
from geoident.workflow.running.control import Control
from geoident.workflow.running.cost import free_memory
from geoident.workflow.running.jobs import (
    NO_READINGS,
    Inputs,
    Job,
    Request,
    build_model,
    inputs_of_result,
    job_provenance,
    load_inputs,
    of_fit,
    require_stages,
    sha256,
    start_values,
)
from geoident.workflow.running.outputs import require_free
from geoident.workflow.running.readings import reading_table
from geoident.workflow.scoring.left_out import left_out_rows

_SURE = 1.6448536269514722
"""Standard deviations from the limit at which a chance of being beyond is 5 % or 95 %."""

_TELLS = 0.01
"""Part by which a standard deviation grows without the reading of a stage that is worth a word."""

_COPIES = 6.0
"""Matrices of readings by readings that are in memory at a time, for each outlook."""


@dataclass(frozen=True)
class PlanRequest:
    """Which gauges are to be chosen from, and what for.

    Args:
        request: with the path of a case, or of the result of a fit, as its case.
        candidates: path of a candidates file.
        budget: that the costs of the chosen gauges must not exceed.
        wanted: what is to be known, such as ``CV1 at bench 5``.
        draws: parameter vectors at which the model is linearised, beside that of the case.
    """

    request: Request
    candidates: str
    budget: float
    wanted: tuple[str, ...]
    draws: int = 4


@dataclass(frozen=True)
class PlanTask:
    """A plan that can be made.

    Args:
        asked: what was asked for.
        job: the case without candidates, and the place of the result.
        candidates: to choose from.
        wanted: what for.
        fit: what was found so far, or None.
    """

    asked: PlanRequest
    job: Job
    candidates: Candidates
    wanted: tuple[Wanted, ...]
    fit: Result | None

    def with_gauges(self, names: Sequence[str]) -> Inputs:
        """The case with some of the candidates among its gauges.

        Raises:
            InputError: they cannot be; at their places in the candidates file.
        """
        inputs, request = self.job.inputs, self.job.request
        data = parse_yaml(inputs.loaded.resolved, inputs.path).data
        assert isinstance(data, dict)
        added = self.candidates.overrides(data, names)
        with self.candidates.located():
            if self.fit is not None:
                return inputs_of_result(self.fit, inputs.path, added)
            overrides = [*request.overrides, NO_READINGS, *added]
            return load_inputs(request.case, overrides=overrides, text=request.text)

    @property
    def files_read(self) -> tuple[str, ...]:
        """Paths of all that was read."""
        return (self.job.request.case, self.asked.candidates, *self.job.inputs.files)


def plan_gauges(asked: PlanRequest) -> PlanTask:
    """Read a case or a fit, the candidates and what they are for.

    Raises:
        InputError: one of the files is wrong.
        OutputError: the result could not be written, or another one would be lost.
        UsageError: there is nothing of that kind to be known, or the budget buys nothing.
    """
    request, fit = asked.request, None
    source = request.case
    if request.text is None and (Path(source).suffix == ".h5" or read_identity(source)):
        if request.overrides:
            raise UsageError("Overrides do not apply: the case of a fit is what it was.")
        fit, inputs = read_fit(source, "planned")
        require_same_mesh(fit, inputs, "Run the fit again.")
    else:
        overrides = [*request.overrides, NO_READINGS]
        inputs = load_inputs(source, overrides=overrides, text=request.text)
    case = inputs.case
    require_stages(case)
    if isinstance(case.elsewhere, SeasonalModel) or not (case.parameters or case.fields):
        message = "there are no parameters, so no reading tells of another one"
        hint = "Write what is unknown under 'parameters'."
        raise InputError([case.source.fault(("parameters",), "no-parameters",
                                            message, hint)])  # fmt: skip
    stages = [stage.name for stage in case.stages]
    taken = list(dict.fromkeys(channel.gauge for channel in case.channels))
    candidates = read_candidates(asked.candidates, taken, stages)
    cheapest = min(one.cost for one in candidates.each)
    if not asked.budget >= cheapest:
        message = f"The budget of {asked.budget:g} buys nothing: the cheapest candidate costs "
        raise UsageError(f"{message}{cheapest:g}. Give {Term.BUDGET} at least that.")
    names = [parameter.name for parameter in case.parameters]
    wanted = read_wanted(asked.wanted, case, names, last_read(fit))
    purpose = repr((sha256(candidates.text.encode()), asked.budget, asked.draws, asked.wanted))
    job = plan_on_fit("plan", purpose, request, fit, inputs)
    return PlanTask(asked, job, candidates, wanted, fit)


def read_wanted(
    texts: Sequence[str], case: Case, names: Sequence[str], last: int
) -> tuple[Wanted, ...]:
    """What is to be known, from what the user wrote.

    Args:
        texts: such as ``CV1 at bench 5``, ``CV1 > 40 mm at bench 5``, ``E_rock``.
        case: with the gauges that are spoken of.
        names: of the parameters.
        last: number of the last stage that a fit has read; -1 before any.

    Raises:
        UsageError: there is no such thing, or it was read already.
    """
    channels = {channel.name: channel for channel in case.channels}
    stages, wanted = [stage.name for stage in case.stages], list[Wanted]()
    for text in texts:
        if text in names:
            wanted.append(Wanted(text, list(names).index(text), -1, len(stages)))
            continue
        try:
            if " at " not in text:
                hint = did_you_mean(text, names, what="Parameters")
                hint += " A reading is written 'CV1 at bench 5'."
                raise Refusal("unknown", "this is neither a parameter nor a reading", hint)
            name, stage, condition = read_place(text, channels, stages)
            row, column = list(channels).index(name), stages.index(stage)
            if column <= last:
                message = f"'{stage}' is past: the fit has readings of it, or of later stages"
                raise Refusal("past", message, "Name a stage still to come.")
        except Refusal as error:
            told = f"{Term.WANTED} '{shorten(text)}': {error.message}. {error.hint}"
            raise UsageError(told) from error
        wanted.append(Wanted(text, None, row, column, condition))
    return tuple(wanted)


@one_thread()
def make_plan(task: PlanTask, control: Control) -> Finished:
    """Choose gauges and write the plan; keep one that is up to date.

    Raises:
        InputError: a candidate is wrong, or none can be read.
        ModelError: the model has no solution.
    """
    job, request = task.job, task.job.request
    if (before := job_at_hand(job)) is not None:
        return before
    require_free(job.existing, job.place, force=request.force, inputs=task.files_read)
    inputs = task.with_gauges([one.name for one in task.candidates.each])
    with task.candidates.located():
        model = build_model(inputs, solver=request.solver)
    case = inputs.case if task.fit is not None else model.case
    p = start_values(case, model) if task.fit is None else task.fit.parameters.values
    planned = Plannable(model, with_surface_error(case, model, p), p, task.fit, job.inputs.case)
    _refuse_past(task, planned)
    control.monitor.detail("computing what all gauges would read")
    survey = planned.survey(p, fields=True)
    choice = _Choice.of(task, planned, survey.computed)
    _require_room(
        len(choice.places), (1 + task.asked.draws) * len({one.stage for one in task.wanted})
    )
    all_at, skipped = [linearised(planned, p, survey, task.wanted, choice.places)], 0
    for draw in planned.drawn(planned.known(survey)[0], task.asked.draws, request.seed):
        control.stop.check()
        try:
            there = planned.survey(draw)
            all_at.append(linearised(planned, draw, there, task.wanted, choice.places))
        except ModelError:
            skipped += 1
    plan = _plan(task, planned, choice, all_at)
    kept = task.with_gauges([one.gauge for one in plan.chosen])
    names = {channel.name for channel in kept.case.channels}
    rows = [k for k, channel in enumerate(planned.case.channels) if channel.name in names]
    shown = replace(planned.case, channels=tuple(planned.case.channels[k] for k in rows))
    if task.fit is None:
        readings = reading_table(replace(shown, readings=()), ())
        parameters = parameter_table(case.parameters, p, planned.known(survey)[0])
    else:
        readings, parameters = task.fit.gauges.readings, task.fit.parameters
    provenance = job_provenance(job)
    if task.fit is not None:
        provenance = of_fit(provenance, task.fit, request.case, job.place.path)
    result = Result(
        kind="plan",
        status="done",
        exit_code=ExitCode.DONE,
        method="greedy choice and exchange",
        reason=f"{len(plan.chosen)} of {len(plan.gauges)} candidates for {plan.cost:g} of "
        f"{plan.budget:g}.",
        objective=float("nan"),
        findings=(),
        case_text=job.inputs.loaded.text,
        case_resolved=kept.loaded.resolved,
        provenance=provenance,
        parameters=parameters,
        gauges=gauge_table(shown, readings, survey.computed[rows]),
        counts=model.counts,
        fields=survey.fields,
        reaction=survey.reaction,
        plan=plan,
        notes=tuple(_notes(task, planned, choice, skipped)),
    )
    return write(result, job.place, job.existing, inputs=task.files_read, force=request.force)


def _refuse_past(task: PlanTask, planned: Plannable) -> None:
    """Refuse candidates that would have been zeroed before the last stage that was read.

    Raises:
        InputError: with these.
    """
    if planned.last < 0:
        return
    case, faults, now = planned.case, list[Fault](), planned.case.stages[planned.last].name
    for channel in case.channels:
        late = channel.is_zeroed and case.zero_of(channel) <= planned.last
        if channel.gauge in task.candidates.gauges and late:
            message = f"it would have been zeroed at '{channel.zero}', which is past"
            hint = f"Write 'zero: {now}', the last stage that was read, or a later one."
            faults.append(task.candidates.refuse(channel.gauge, "past-zero", message, hint))
    if faults:
        raise InputError(dict.fromkeys(faults))


def _require_room(readings: int, outlooks: int) -> None:
    """Refuse more readings than the memory holds.

    Raises:
        UsageError: they are more.
    """
    needed, free = _COPIES * 8.0 * outlooks * float(readings) ** 2, free_memory()
    if free is not None and needed > free:
        message = f"{readings} readings to come need {needed / 1e9:.1f} GB of memory, of which "
        message += f"{free / 1e9:.1f} GB are free."
        raise UsageError(
            f"{message} Give fewer candidates, fewer 'stages' of each, or {Term.DRAWS}."
        )


@dataclass(frozen=True)
class _Choice:
    """Readings to come.

    Args:
        places: (m, 2) their channels and stages.
        of_case: numbers of those of the gauges of the case.
        of_candidates: numbers of those of each candidate.
    """

    places: Ints
    of_case: Ints
    of_candidates: tuple[Ints, ...]

    @classmethod
    def of(cls, task: PlanTask, planned: Plannable, computed: Floats) -> _Choice:
        """All readings that can be taken before something is due."""
        case = planned.case
        due = max(one.stage for one in task.wanted)
        possible = np.isfinite(computed) & np.isfinite(accuracies(case))
        possible[:, : planned.last + 1] = possible[:, due:] = False
        possible[left_out_rows(case)] = False
        wanted = {one.name: one.stages for one in task.candidates.each}
        for row, channel in enumerate(case.channels):
            if (read := wanted.get(channel.gauge)) is not None:
                possible[row] &= [stage.name in read for stage in case.stages]
        places = np.argwhere(possible)
        gauge = np.array([case.channels[i].gauge for i in places[:, 0].tolist()], dtype=object)
        each = tuple(np.flatnonzero(gauge == name) for name in wanted)
        of_case = np.flatnonzero([name not in wanted for name in gauge.tolist()])
        return cls(places, of_case.astype(np.int64), each)


def _plan(
    task: PlanTask, planned: Plannable, choice: _Choice, all_at: Sequence[Linearised]
) -> GaugePlan:
    """The gauges to take, what each adds, and what is known then."""
    begun = tuple(
        outlook.given(choice.of_case).begun() for one in all_at for outlook in one.outlooks
    )
    costs = np.array([one.cost for one in task.candidates.each])
    gauges = Gauges(begun, choice.of_candidates, costs)
    chosen = choose(gauges, task.asked.budget)
    after, left = gauges.after(chosen), gauges.part(chosen)
    ranks = {c: k for k, (c, _) in enumerate(gauges.in_order(chosen), start=1)}
    parts = [1.0, *(part for _, part in gauges.in_order(chosen))]
    kinds = {channel.gauge: channel.kind for channel in planned.case.channels}
    rows = []
    for c, one in enumerate(task.candidates.each):
        rank = ranks.get(c, 0)
        without = gauges.part([x for x in chosen if x != c])
        adds = parts[rank - 1] - parts[rank] if rank else left - after.part([c])
        rows.append(
            PlannedGauge(
                gauge=one.name,
                kind=kinds[one.name],
                cost=one.cost,
                rank=rank,
                adds=adds,
                alone=1.0 - gauges.part([c]),
                loss=np.sqrt(without / left) - 1.0 if rank and left > 0.0 else 0.0,
                stages=", ".join(_telling_stages(planned.case, choice, gauges, chosen, c))
                if rank
                else "",
            )
        )
    rows = sorted(rows, key=lambda row: (row.rank or len(rows) + 1, -row.adds))
    return GaugePlan(
        targets=tuple(_targets(task, planned.case, choice, all_at, chosen)),
        gauges=tuple(rows),
        budget=task.asked.budget,
        draws=len(all_at),
        model_error=planned.model_error,
    )


def _telling_stages(
    case: Case, choice: _Choice, gauges: Gauges, chosen: Sequence[int], c: int
) -> list[str]:
    """Stages without whose reading of a gauge less would be known, the most telling first."""
    own, left = choice.of_candidates[c], gauges.part(chosen)
    losses = {
        stage: gauges.without_readings(chosen, own[choice.places[own, 1] == stage])
        for stage in np.unique(choice.places[own, 1]).tolist()
    }
    order = sorted(losses, key=lambda stage: -losses[stage])
    telling = [s for s in order if losses[s] > left * (1.0 + _TELLS) ** 2]
    return [case.stages[stage].name for stage in telling or order[:1]]


def _targets(
    task: PlanTask, case: Case, choice: _Choice, all_at: Sequence[Linearised], chosen: Sequence[int]
) -> Iterator[PlanTarget]:
    """What is known of all that is wanted, now, with the gauges of the case, and with the plan."""
    every = np.concatenate([choice.of_case, *(choice.of_candidates[c] for c in chosen)])

    def sd(one: Linearised, readings: Ints) -> Floats:
        return one.of_wanted([outlook.left(readings) for outlook in one.outlooks])

    first = all_at[0]
    now = first.of_wanted([outlook.variances for outlook in first.outlooks])
    with_case, with_plan = sd(first, choice.of_case), sd(first, every)
    ratios = np.array([sd(one, every) / sd(one, choice.of_case) for one in all_at])
    for k, one in enumerate(task.wanted):
        parameter = None if one.parameter is None else case.parameters[one.parameter]
        source = case.channels[one.row] if parameter is None else parameter
        chance, settled = np.nan, [np.nan, np.nan]
        if (condition := one.condition) is not None:
            away = condition.value - first.mean[k]
            beyond = 1.0 - ndtr(away / now[k])
            chance = 1.0 - beyond if condition.below else beyond
            settled = [_settled(away, now[k], left[k]) for left in (with_case, with_plan)]
        yield PlanTarget(
            text=one.text,
            expected=float(first.mean[k]),
            sd=float(now[k]),
            sd_case=float(with_case[k]),
            sd_plan=float(with_plan[k]),
            least_ratio=float(ratios[:, k].min()),
            largest_ratio=float(ratios[:, k].max()),
            probability=float(chance),
            settled_case=settled[0],
            settled_plan=settled[1],
            unit=source.unit,
            dimension=source.dimension,
        )


def _settled(away: float, now: float, left: float) -> float:
    """Chance that readings which leave a standard deviation settle which side of a limit it is.

    Args:
        away: distance of the limit from what is expected, SI.
        now: standard deviation now.
        left: standard deviation after the readings.
    """
    moves = np.sqrt(max(now**2 - left**2, 0.0))
    ends = np.array([away - _SURE * left, away + _SURE * left])
    if moves == 0.0:
        return float(ends[0] > 0.0 or ends[1] < 0.0)
    low, high = ndtr(ends / moves)
    return float(low + 1.0 - high)


def _notes(
    task: PlanTask, planned: Plannable, choice: _Choice, skipped: int
) -> Iterator[str]:  # fmt: skip
    """What the plan takes for granted."""
    case = planned.case
    if planned.fit is None:
        flat = [q.name for q in case.parameters if q.prior is None and not q.field]
        if flat:
            names = ", ".join(flat)
            yield f"Without a prior any value within the bounds counts as possible: {names}."
        if case.fit.model_error.kind == "estimate":
            yield (
                f"A model error of {100 * ASSUMED:g} % of the computed motion is assumed; "
                "'model_error' under 'fit' says another."
            )
        written = parse_yaml(task.job.inputs.loaded.text, "").data
        if isinstance(written, dict) and written.get("readings"):
            yield "Readings of the case do not count: plan from its fit to take them into account."
    elif planned.fit.rivals is not None:
        yield (
            f"The fit has {len(planned.fit.rivals)} minima that are nearly as low; the plan is for "
            "the first, so plan again when readings have told which it is."
        )
    read = {case.channels[i].gauge for i in choice.places[choice.of_case, 0].tolist()}
    if read:
        yield (
            f"{named_channels(sorted(read))} of the case count as read at each stage to come, "
            "before what is to be known is due. Gauges in 'predict_gauges' do not."
        )
    late = [one.text for one in task.wanted if not (choice.places[:, 1] < one.stage).any()]
    if late:
        yield f"Nothing can be read before it is due: {', '.join(late)}."
    silent = [
        one.name
        for one, rows in zip(task.candidates.each, choice.of_candidates, strict=True)
        if not len(rows)
    ]
    if silent:
        yield f"Candidates that cannot be read in time: {', '.join(silent)}."
    if skipped:
        yield (
            f"At {skipped} of {task.asked.draws} draws of the parameters the model has no "
            "solution; they are left out."
        )
