"""``geoident control``: new readings of a structure in service held against its fit."""

from __future__ import annotations

import json
import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import groupby
from pathlib import Path

import numpy as np
from scipy.special import log_ndtr

from geoident.errors import ExitCode, Fault, InputError, Location, Term, UsageError
from geoident.fem.solvers.threads import one_thread
from geoident.forward.in_service.seasonal import Effects
from geoident.forward.in_service.structure import ServiceModel
from geoident.forward.observed import ObservedModel
from geoident.identify.in_time.detection import Change, Detector
from geoident.identify.in_time.innovations import Filter, single_wrong
from geoident.identify.in_time.regression import GaugeState
from geoident.io.text.dates import date_text
from geoident.io.text.yaml_reader import parse_yaml
from geoident.model.arrays import Floats, Ints
from geoident.model.case import Case
from geoident.model.gauges import ReadingTable
from geoident.model.in_service import YEAR
from geoident.model.results.alarms import AlarmState
from geoident.model.results.bands import NORMAL_95
from geoident.model.results.costs import NO_COST
from geoident.model.results.findings import Finding
from geoident.model.results.in_service import ChangeRow, ParameterChangeRow, PowerRow
from geoident.model.results.result import GaugeTable, Result
from geoident.units import UnitError, read_quantity
from geoident.workflow.estimating.finished import Finished, job_at_hand
from geoident.workflow.estimating.from_fit import CONTROLLED, FitTask, plan_on_fit, read_fit
from geoident.workflow.in_service.effects import channel_rows, effects_of_fit
from geoident.workflow.in_service.fit import (
    explained,
    far_readings,
    judged,
    rows_in_time,
    unknown_later,
    with_reasons,
)
from geoident.workflow.in_service.fitted_gauges import (
    STANDARD,
    FittedGauge,
    Sound,
    fitted_gauges,
)
from geoident.workflow.in_service.limits import Ahead, with_next_year
from geoident.workflow.in_service.parameter_changes import ChangingStructure
from geoident.workflow.in_service.power import PlannedChange, power_of, read_change
from geoident.workflow.running.computed import gauge_table
from geoident.workflow.running.control import Control
from geoident.workflow.running.jobs import Request, build_model, job_provenance, load_inputs
from geoident.workflow.running.readings import LATER, select_readings, unused_notes
from geoident.workflow.scoring.alarms import alarm_findings, alarm_states

_FAR = 4.0
"""Innovation from which on it is asked whether a single reading is wrong."""

_SURE = 0.9
"""Probability of a kind of change from which on it is said without doubt."""

GREEN, AMBER, RED, NOT_JUDGED = "green", "amber", "red", "not judged"


@dataclass(frozen=True)
class ControlRequest:
    """What to hold against a fit.

    Args:
        result: path of the fit.
        readings: path of a file with new readings; None for those of the case.
        false_alarms: time between two false alarms of all gauges together, s, on the average.
        power: changes of which is asked whether they would be seen, in words.
        output: a file or an existing folder; None for beside the result.
        seed: of the simulated noise.
        force: overwrite a result of other input.
        fresh: compute again what is up to date.
    """

    result: str
    readings: str | None = None
    false_alarms: float = 10.0 * YEAR
    power: tuple[str, ...] = ()
    output: str | None = None
    seed: int = 0
    force: bool = False
    fresh: bool = False


def time_between(text: str) -> float:
    """The time between two false alarms, s, of a rate such as ``1 per 10 years``.

    >>> time_between("1 per 10 years") / YEAR
    10.0

    Raises:
        UsageError: the text is no rate.
    """
    match = re.fullmatch(r"\s*([0-9.]+)\s+(?:per|in)\s+(.+)", text)
    try:
        if match is None:
            raise ValueError
        number = float(match[1])
        time = read_quantity(match[2], "time").value
        if not (number > 0.0 and time > 0.0):
            raise ValueError
    except (ValueError, UnitError):
        message = f"'{text}' is not a rate of false alarms; expected one such as '1 per 10 years'."
        raise UsageError(message) from None
    return time / number


@dataclass(frozen=True, kw_only=True)
class ControlTask(FitTask):
    """New readings that can be judged.

    Args:
        request: what was asked for.
        planned: changes of which is asked whether they would be seen.
    """

    request: ControlRequest
    planned: tuple[PlannedChange, ...]


def plan_control(request: ControlRequest) -> ControlTask:
    """Read a fit and the new readings, and look at what stands where the result goes.

    Raises:
        InputError: the result is no fit of a seasonal model, or the readings are wrong.
        OutputError: the result could not be written, or another one would be lost.
        UsageError: the words of a change are wrong.
    """
    fit, origin = read_fit(request.result, CONTROLLED)
    if fit.seasonal is None:
        message = "the fit is of no structure in service"
        hint = "Fit a case with 'model: {kind: seasonal}', or with 'service' on a mesh."
        place = Location(request.result)
        raise InputError([Fault("not-seasonal", message, hint, place)])
    if request.readings is not None and not Path(request.readings).is_file():
        hint = "Check the path of the new readings."
        place = Location(request.readings)
        raise InputError([Fault("missing-file", "there is no such file", hint, place)])
    overrides = [] if request.readings is None else [_in_place(fit, request.readings)]
    inputs = load_inputs(origin.path, overrides=overrides, text=fit.case_resolved)
    asked = Request(
        case=request.result,
        output=request.output,
        seed=request.seed,
        force=request.force,
        fresh=request.fresh,
    )
    planned = tuple(read_change(text, inputs.case, fit) for text in request.power)
    purpose = "; ".join([f"{request.false_alarms:g}", *request.power])
    job = plan_on_fit("control", purpose, asked, fit, inputs)
    return ControlTask(fit=fit, job=job, request=request, planned=planned)


@one_thread()
def control(task: ControlTask, controlling: Control) -> Finished:
    """Judge new readings and write what they show; keep a result that is up to date."""
    if (before := job_at_hand(task.job)) is not None:
        return before
    task.require_free()
    case, fit = task.job.inputs.case, task.fit.seasonal
    assert fit is not None
    assert case.in_time is not None
    model = build_model(task.job.inputs)
    effects_of = effects_of_fit(case, model, task.fit)
    table = select_readings(case, model)
    effects = effects_of(channel_rows(case, table), table.time)
    table = _new_readings(with_reasons(table, case.in_time, effects.known), task.fit)
    fitted = fitted_gauges(task.fit, effects_of)
    watched = [
        new for gauge in fitted if (new := _watched(gauge, task.fit, table, effects)) is not None
    ]
    if not watched and not task.planned:
        raise InputError([_nothing_new(case, task, table)])
    rng = np.random.default_rng(task.request.seed)
    controlling.monitor.detail("simulating false alarms")
    structure = ChangingStructure(model, task.fit) if isinstance(model, ServiceModel) else None

    def sound_of(gauges: Sequence[FittedGauge]) -> Sound:
        parameters = [
            structure.derivatives(gauge, gauge.standard, STANDARD)
            for gauge in gauges
            if structure is not None
        ]
        return Sound(gauges, task.request.false_alarms, rng, parameters)

    parameter_rows: list[ParameterChangeRow] = []
    changes: list[Change] = []
    if watched:
        sound = sound_of([new.gauge for new in watched])
        parameters = [
            structure.derivatives(new.gauge, new.filter) for new in watched if structure is not None
        ]
        detector = Detector([new.filter for new in watched], sound.detector.together, parameters)
        left = [new.e for new in watched]
        if structure is not None:
            parameter_rows, left = _parameter_changes(
                structure, detector, left, sound.threshold, [new.gauge for new in watched]
            )
        changes = detector.changes(left, sound.threshold)
    number = len({row.change for row in parameter_rows})
    rows = (
        *_rows(changes, watched, case, number),
        *_wrong_rows(watched, case, table, number + len(changes)),
    )
    power: tuple[PowerRow, ...] = ()
    if task.planned:
        if len(watched) < len(fitted):
            sound = sound_of(fitted)
        power = tuple(
            power_of(one, sound, effects, case.channels, structure) for one in task.planned
        )
    table = replace(table, computed=explained(fit, task.fit.gauges.channels, table, effects))
    gauges = gauge_table(case, table, np.full((len(case.channels), len(case.stages)), np.nan))
    alarms = with_next_year(
        alarm_states(case, _counting(gauges, watched), None),
        {case.channels[new.gauge.number].name: new.ahead for new in watched},
        case.in_time,
        effects_of,
        rng,
    )
    state = _state(changes, parameter_rows, alarms) if watched else NOT_JUDGED
    return task.write(
        Result(
            kind="control",
            status=state,
            exit_code=ExitCode.ALARM if state in (AMBER, RED) else ExitCode.DONE,
            method="likelihood ratio",
            reason=_reason(state, table, watched, task.request),
            objective=float("nan"),
            findings=(
                *alarm_findings(alarms, dated=True),
                *_parameter_findings(parameter_rows),
                *_findings(rows),
                *_wrong_findings(watched, case),
            ),
            case_text=task.job.inputs.loaded.text,
            case_resolved=task.job.inputs.loaded.resolved,
            provenance=job_provenance(task.job),
            parameters=task.fit.parameters,
            gauges=gauges,
            counts=NO_COST,
            judged=judged(table, [(new.rows, new.filter) for new in watched]),
            changes=rows,
            parameter_changes=tuple(parameter_rows),
            power=power,
            alarms=alarms,
            notes=(*case.notes, *unused_notes(table)),
        )
    )


def _in_place(fit: Result, path: str) -> str:
    """The override that reads another file as that of the case is read."""
    given = json.dumps(str(Path(path).absolute()))
    case = parse_yaml(fit.case_resolved, "").data
    readings = case.get("readings") if isinstance(case, Mapping) else None
    files = readings if isinstance(readings, list) else [readings]
    layouts = [
        {key: value for key, value in file.items() if key != "file"} if "file" in file else {}
        for file in files
        if isinstance(file, Mapping)
    ]
    layouts += [{} for file in files if isinstance(file, str)]
    if any(layout != layouts[0] for layout in layouts):
        message = (
            "the files of readings in the case are laid out differently, so it is not known how "
            "this one is"
        )
        hint = f"Add the new readings to the files of the case, and leave out {Term.READINGS}."
        raise InputError([Fault("several-files", message, hint, Location(path))])
    layout = json.dumps(layouts[0], ensure_ascii=False)[1:-1] if layouts else ""
    return f"readings={{file: {given}, {layout}}}" if layout else f"readings={given}"


def watched_gauges(
    fit: Result, case: Case, model: ObservedModel, table: ReadingTable
) -> list[WatchedGauge]:
    """The gauges that have new readings.

    Args:
        fit: of a structure in service.
        case: with the new readings.
        model: of the case.
        table: of these, used.
    """
    effects_of = effects_of_fit(case, model, fit)
    effects = effects_of(channel_rows(case, table), table.time)
    held = (_watched(gauge, fit, table, effects) for gauge in fitted_gauges(fit, effects_of))
    return [new for new in held if new is not None]


@dataclass(frozen=True)
class WatchedGauge:
    """A gauge with new readings.

    Args:
        gauge: as the fit left it.
        rows: (m,) rows of its new readings.
        filter: over them; it skips those that are wrong alone.
        predicted: (m,) what they were expected to be, SI.
        e: (m,) their innovations.
        end: what is known after them.
    """

    gauge: FittedGauge
    rows: Ints
    filter: Filter
    predicted: Floats
    e: Floats
    end: GaugeState

    @property
    def wrong(self) -> Ints:
        """Numbers of the new readings that are far off alone."""
        return np.flatnonzero(self.filter.skipped)

    @property
    def ahead(self) -> Ahead:
        """What the next year follows from."""
        gauge = self.gauge
        return Ahead(gauge.number, self.end, gauge.terms, gauge.likely, gauge.read_in_a_year)


def _watched(
    gauge: FittedGauge, fit: Result, table: ReadingTable, effects: Effects
) -> WatchedGauge | None:
    """A gauge that has new readings; None for others."""
    rows = rows_in_time(table, fit.gauges.channels[gauge.number], table.used)
    if not rows.size:
        return None
    times, X, y = table.time[rows], effects.columns[rows][:, gauge.terms], table.value[rows]
    filtered = Filter(gauge.state, times, X, single_wrong(gauge.state, times, X, y, _FAR))
    predicted = filtered.predicted(y)
    e = (y - predicted) / filtered.sd
    return WatchedGauge(gauge, rows, filtered, predicted, e, filtered.end(y))


def _new_readings(table: ReadingTable, fit: Result) -> ReadingTable:
    """Readings of which those are used that came after the last one of the fit, of each gauge."""
    assert fit.seasonal is not None
    last = dict(zip(fit.gauges.channels, fit.seasonal.last.tolist(), strict=True))
    reasons = list(table.reason)
    for k, name in enumerate(table.channel):
        if reasons[k] not in ("", LATER):
            continue
        new = table.time[k] > last[name]  # of a gauge that was not fitted nothing is
        reasons[k] = "" if new else "it is no later than the fit"
    used = np.array([not reason for reason in reasons], dtype=np.bool_)
    return replace(table, reason=tuple(reasons), used=used)


def _parameter_changes(
    structure: ChangingStructure,
    detector: Detector,
    e: Sequence[Floats],
    threshold: float,
    gauges: Sequence[FittedGauge],
) -> tuple[list[ParameterChangeRow], list[Floats]]:
    """One parameter after the other that has changed, and the innovations that they leave."""
    rows: list[ParameterChangeRow] = []
    left = list(e)
    for number in range(1, len(structure.known) + 1):
        change = detector.parameter_change(left, threshold)
        if change is None:
            break
        own, effects = structure.rows(change, number, detector, gauges)
        rows += own
        left = [x - effect for x, effect in zip(left, effects, strict=True)]
    return rows, left


def _rows(
    changes: Sequence[Change], watched: Sequence[WatchedGauge], case: Case, before: int
) -> Iterator[ChangeRow]:
    """Steps and drifts, numbered after the changes that went before."""
    for number, change in enumerate(changes, before + 1):
        for i, size, sd in zip(change.gauges, change.size, change.sd, strict=True):
            channel = case.channels[watched[i].gauge.number]
            yield ChangeRow(
                kind=change.kind, gauge=channel.name, change=number, shown=change.shown,
                since=change.since, earliest=change.earliest, latest=change.latest, size=size,
                sd=sd, odds=change.odds, surprise=change.surprise, lasts=change.lasts,
                unit=channel.unit, dimension=channel.dimension,
            )  # fmt: skip


def _wrong_rows(
    watched: Sequence[WatchedGauge], case: Case, table: ReadingTable, before: int
) -> Iterator[ChangeRow]:
    """Single wrong readings, numbered after the changes that went before."""
    wrong = [(gauge, int(k)) for gauge in watched for k in gauge.wrong]
    for number, (gauge, k) in enumerate(wrong, before + 1):
        channel, time = case.channels[gauge.gauge.number], float(gauge.filter.times[k])
        surprise = -(np.log(2.0) + float(log_ndtr(-abs(gauge.e[k])))) / np.log(10.0)
        yield ChangeRow(
            kind="reading", gauge=channel.name, change=number, shown=time, since=time,
            earliest=time, latest=time, size=float(table.value[gauge.rows[k]] - gauge.predicted[k]),
            sd=float(gauge.filter.sd[k]), odds=1.0, surprise=float(surprise), lasts=False,
            unit=channel.unit, dimension=channel.dimension,
        )  # fmt: skip


def _state(
    changes: Sequence[Change],
    parameters: Sequence[ParameterChangeRow],
    alarms: Sequence[AlarmState],
) -> str:
    """Red where the last readings show that the structure has changed, amber where gauges have.

    A single wrong reading is over with the next one, and a change that is no longer seen as well.
    Alarm values add their states.
    """
    lasting = [len(change.gauges) for change in changes if change.lasts]
    states = {alarm.state for alarm in alarms} | {RED if n > 1 else AMBER for n in lasting}
    states |= {RED for row in parameters if row.lasts}
    return next((state for state in (RED, AMBER) if state in states), GREEN)


def _counting(gauges: GaugeTable, watched: Sequence[WatchedGauge]) -> GaugeTable:
    """New readings that are not wrong alone: those that may reach an alarm value."""
    counts = np.zeros(len(gauges.readings), dtype=np.bool_)
    for gauge in watched:
        counts[gauge.rows[~gauge.filter.skipped]] = True
    value = np.where(counts, gauges.readings.value, np.nan)
    return replace(gauges, readings=replace(gauges.readings, value=value))


def _reason(
    state: str, table: ReadingTable, watched: Sequence[WatchedGauge], request: ControlRequest
) -> str:
    if not watched:
        return "There are no new readings."
    words = {
        GREEN: "The last readings show no change",
        AMBER: "A gauge has changed",
        RED: "The structure or what acts on it has changed, or an alarm value is reached",
    }
    number = sum(len(gauge.rows) for gauge in watched)
    first, last = (date_text(float(f(table.time[table.used]))) for f in (np.min, np.max))
    years = request.false_alarms / YEAR
    return (
        f"{words[state]}: {number} readings of {len(watched)} gauges, {first} to {last}. "
        f"Chance alone raises an alarm once in {years:.3g} years."
    )


def _dates(row: ChangeRow | ParameterChangeRow) -> tuple[str, str]:
    """When a change began, with the interval of that, and since when it was seen."""
    when = date_text(row.since)[:10]
    if row.latest > row.earliest:
        when += f" ({date_text(row.earliest)[:10]} to {date_text(row.latest)[:10]})"
    return when, f"seen since {date_text(row.shown)[:10]}"


def _parameter_findings(rows: Sequence[ParameterChangeRow]) -> Iterator[Finding]:
    """A sentence for each change of parameters, with all that it may be."""
    for _, group in groupby(rows, key=lambda row: row.change):
        one, *others = group
        when, seen = _dates(one)
        sentence = f"{one.parameter} {one.text} since {when}, {seen} by {one.gauges}. "
        sentence += "The structure, or what acts on it, has changed."
        for row in others:
            sentence += (
                f" It cannot be told from {row.parameter}: that {row.text}, with a probability of "
                f"{row.odds:.0%}."
            )
        if (rest := 1.0 - one.odds - sum(row.odds for row in others)) > 1.0 - _SURE:
            sentence += f" With a probability of {rest:.0%} gauges have moved by themselves."
        if not one.lasts:
            sentence += _GONE
        names = ", ".join(row.parameter for row in (one, *others))
        yield Finding("change", names, sentence, {"since": one.since})


_GONE = " The last readings do not show it any more."


def _findings(rows: Sequence[ChangeRow]) -> Iterator[Finding]:
    """A sentence for each step and drift."""
    changes = (row for row in rows if row.kind != "reading")
    for _, group in groupby(changes, key=lambda row: row.change):
        own = list(group)
        one = own[0]
        when, seen = _dates(one)
        sizes = ", ".join(f"{row.gauge} {row.text}" for row in own)
        as_none = len(own) == 1 and abs(one.size) < NORMAL_95 * one.sd
        if as_none:
            sentence = f"{one.gauge} moves otherwise since {when}, {seen}, but as no {one.kind} "
            sentence += f"would ({one.text} at best). The other gauges do not show it: check "
            sentence += "this one."
        elif len(own) == 1:
            sentence = f"A {one.kind} of {sizes} since {when}, {seen}. "
            sentence += "The other gauges do not show it: check this one."
        else:
            sentence = f"A {one.kind} of several gauges since {when}, {seen}: {sizes}. "
            sentence += "The structure, or what acts on it, has changed."
        if one.odds < _SURE and not as_none:
            other = "drift" if one.kind == "step" else "step"
            sentence += f" It may also be a {other}: more readings will tell."
        if not one.lasts:
            sentence += _GONE
        yield Finding("change", ", ".join(row.gauge for row in own), sentence, {"since": one.since})


def _wrong_findings(watched: Sequence[WatchedGauge], case: Case) -> Iterator[Finding]:
    """A sentence for each gauge with single wrong readings."""
    for gauge in watched:
        if gauge.wrong.size:
            yield _wrong_finding(gauge, case)


def _wrong_finding(gauge: WatchedGauge, case: Case) -> Finding:
    """Readings of a gauge that are far off alone."""
    channel = case.channels[gauge.gauge.number]
    at = gauge.wrong
    what = "A single reading" if len(at) == 1 else "Single readings"
    return Finding(
        "far-reading",
        channel.name,
        f"{what} of {channel.name} far off, after which all is as before: "
        f"{far_readings(gauge.filter.times[at], gauge.e[at])}. Repeat them, or mark them as bad.",
    )


def _nothing_new(case: Case, task: ControlTask, table: ReadingTable) -> Fault:
    message = "there is no reading later than those of the fit, of a gauge that was fitted"
    hint = f"Give new ones with {Term.READINGS}, or add them to the file of the case."
    if why := sorted({reason for reason in table.reason if reason}):
        hint += f" Not used: {'; '.join(why)}."
    hint = " ".join([hint, *unknown_later(case, table)])
    if task.request.readings is not None:
        place = Location(task.request.readings)
        return Fault("no-new-readings", message, hint, place)
    return case.source.fault(("readings",), "no-new-readings", message, hint)
