"""Readings as a long table: which take part and why not, and what the model says of each.

From the case to the weighted residual a reading is a row of one `ReadingTable`: the search takes
the values and standard deviations of the rows that are used, the result holds the whole table.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from geoident.errors import InputError
from geoident.forward.gauges.instrument_errors import ReadingPlaces
from geoident.forward.protocols import CaseModel, Survey
from geoident.identify.problem.problem import HasIncrements, Problem
from geoident.model.arrays import Bools, Floats, Ints
from geoident.model.case import Case
from geoident.model.gauges import Channel, Reading, ReadingTable, named_channels
from geoident.model.results.result import GaugeTable
from geoident.workflow.running.errors import own_sd, total_sd

FLAGGED = "flagged as bad: "
"""Beginning of the reason why a reading that is known to be wrong is not used."""


def select_readings(case: Case, model: CaseModel) -> ReadingTable:
    """The readings of a case, and which of them an identification uses.

    Args:
        case: with its readings.
        model: tells what can be read.
    """
    return reading_table(case, [_why_unused(case, reading, model) for reading in case.readings])


def _why_unused(case: Case, reading: Reading, model: CaseModel) -> str:
    """Why a reading takes no part; empty if it does."""
    useless = why_useless(reading)
    if useless:
        return useless
    if case.fit.stages is not None and reading.stage not in case.fit.stages:
        return "the stage is not in fit.stages"
    return model.unreadable(reading.channel, reading.stage) or ""


def why_useless(reading: Reading) -> str:
    """Why nothing can use a reading; empty if something can."""
    if reading.value is None:
        return "no value was read"
    return f"{FLAGGED}{reading.bad}" if reading.bad else ""


def reading_table(case: Case, reasons: Sequence[str]) -> ReadingTable:
    """The readings of a case as a table.

    Args:
        case: with its readings.
        reasons: for each, why it is not used; empty for one that is.
    """
    readings = case.readings
    channels = {channel.name: channel for channel in case.channels}
    owners = [channels[reading.channel] for reading in readings]
    return ReadingTable(
        channel=tuple(reading.channel for reading in readings),
        gauge=tuple(channel.gauge for channel in owners),
        stage=tuple(reading.stage for reading in readings),
        time=_numbers([reading.time for reading in readings]),
        value=_numbers([reading.value for reading in readings]),
        sd=_numbers([total_sd(*row) for row in zip(owners, readings, strict=True)]),
        used=np.array([not reason for reason in reasons], dtype=np.bool_),
        bad=np.array([bool(reading.bad) for reading in readings], dtype=np.bool_),
        reason=tuple(reasons),
        computed=np.full(len(readings), np.nan),
        note=tuple(r.note for r in readings) if any(r.note for r in readings) else (),
        **(_shares(owners, readings) if any(c.errors for c in owners) else {}),
    )


def stated_sd(case: Case, readings: ReadingTable) -> Floats:
    """Standard deviations (k,) of the readings of a case as it states them, before any estimate.

    Args:
        case: as it was read.
        readings: the same, perhaps with accuracies that were estimated.
    """
    return reading_table(case, readings.reason).sd


def _shares(owners: Sequence[Channel], readings: Sequence[Reading]) -> dict[str, Any]:
    """What a table says beside, where readings share errors."""
    own = [own_sd(*row) for row in zip(owners, readings, strict=True)]
    epochs = np.array([reading.epochs for reading in readings], dtype=np.int64)
    return {"own_sd": _numbers(own), "epochs": epochs}


def readings_of(table: ReadingTable) -> tuple[Reading, ...]:
    """The readings that a table holds, as a case has them."""
    return tuple(
        Reading(
            table.channel[k],
            table.stage[k],
            None if np.isnan(table.value[k]) else float(table.value[k]),
            float(table.sd[k] if table.own_sd is None else table.own_sd[k]),
            time=None if np.isnan(table.time[k]) else float(table.time[k]),
            bad=table.reason[k].removeprefix(FLAGGED) if table.bad[k] else "",
            note=table.notes[k],
            epochs=1 if table.epochs is None else int(table.epochs[k]),
        )
        for k in range(len(table))
    )


def _numbers(values: Sequence[float | None]) -> Floats:
    return np.array([np.nan if value is None else value for value in values], dtype=np.float64)


def times_of(table: ReadingTable, rows: Bools) -> tuple[float | None, ...]:
    """When some readings were taken, seconds since 1970, where it is known.

    Args:
        table: of k readings.
        rows: (k,) which of them.
    """
    return tuple(None if np.isnan(time) else float(time) for time in table.time[rows])


def with_computed(
    readings: ReadingTable, case: Case, model: CaseModel, survey: Survey, p: Floats
) -> ReadingTable:
    """The readings with what the model says of each at p, and its derivatives.

    The survey has one value a channel and stage, at the mean of the times of its readings. What
    drift adds between that and the time of a reading is added here.

    Args:
        readings: k of them.
        case: of the model.
        model: knows the drift.
        survey: of the model at p.
        p: (n,) parameters, SI.
    """
    place, more = _drift(readings, case, model, p)
    return replace(
        readings,
        computed=survey.computed[place] + more[:, 0],
        sensitivity=survey.sensitivity[place] + more[:, 1:],
    )


def survey_of_used(
    readings: ReadingTable, case: Case, model: CaseModel, problem: Problem, p: Floats
) -> Survey:
    """What the search knows of the model at p: the readings used, and nothing of the others.

    Args:
        readings: k of them, of which g are used.
        case: of the model.
        model: knows the drift.
        problem: of the search.
        p: (n,) parameters, SI, that it has evaluated.

    Raises:
        TimeIsUp: it has not, and there is no time for it.
    """
    v, J = problem.response.evaluate(p)
    (rows, stages), more = _drift(readings, case, model, p)
    place, more = (rows[readings.used], stages[readings.used]), more[readings.used]
    shape = len(case.channels), len(case.stages)
    computed, sensitivity = np.full(shape, np.nan), np.full((*shape, len(p)), np.nan)
    computed[place], sensitivity[place] = v - more[:, 0], J - more[:, 1:]
    response = problem.response
    steps = response.increments(p) if isinstance(response, HasIncrements) else np.zeros((0, 0))
    return Survey(computed, sensitivity, None, notes=(NO_TIME_LEFT,), increments=steps)


NO_TIME_LEFT = (
    "No time was left to compute all stages at the answer: the result has the fitted readings "
    "alone, no predictions, forces and fields."
)


def _drift(
    readings: ReadingTable, case: Case, model: CaseModel, p: Floats
) -> tuple[tuple[Ints, Ints], Floats]:
    """Channels and stages of k readings, and what drift adds at their own times, (k, 1 + n)."""
    common = ReadingPlaces.of(case, readings.pairs, ())
    own = replace(common, times=readings.time)
    values = model.values(p)
    at_own, at_common = (
        model.instrument_errors.added(values, model.names, places) for places in (own, common)
    )
    return (common.rows, common.states - 1), at_own - at_common  # without the virgin state


def gauge_table(case: Case, readings: ReadingTable, computed: Floats) -> GaugeTable:
    """The channels of a case with their readings, and what the model says at all stages.

    Args:
        case: the case.
        readings: all of them.
        computed: (n_channels, n_stages) SI.
    """
    channels = case.channels
    return GaugeTable(
        channels=tuple(channel.name for channel in channels),
        stages=tuple(stage.name for stage in case.stages),
        computed=computed,
        first=_points([channel.first for channel in channels], case),
        second=_points([channel.second for channel in channels], case),
        readings=readings,
        gauges=tuple(channel.gauge for channel in channels),
        dimensions=tuple(channel.dimension for channel in channels),
        units=tuple(channel.unit for channel in channels),
        accuracy=np.array([channel.accuracy for channel in channels], dtype=np.float64),
        errors=tuple(channel.errors for channel in channels),
    )


def _points(points: Sequence[tuple[float, ...] | None], case: Case) -> Floats:
    none = (np.nan,) * case.analysis.dim
    table = [point or none for point in points]  # a plain reading is nowhere
    return np.array(table, dtype=np.float64).reshape(len(table), case.analysis.dim)


def accuracies(case: Case) -> Floats:
    """Standard deviation of a reading of each channel (n_channels, n_stages), SI.

    NaN at the stage at which a channel is zeroed: it reads nothing there.
    """
    each = np.array([channel.accuracy for channel in case.channels], dtype=np.float64)
    zero = [
        [channel.is_zeroed and channel.zero == stage.name for stage in case.stages]
        for channel in case.channels
    ]
    at_zero = np.array(zero, dtype=np.bool_).reshape(len(case.channels), len(case.stages))
    return np.where(at_zero, np.nan, each[:, None])


def require_enough(case: Case, readings: ReadingTable) -> None:
    """Refuse readings and priors that are fewer than the parameters.

    Raises:
        InputError: they are.
    """
    parameters, used = case.parameters, int(np.count_nonzero(readings.used))
    priors = sum(1 for parameter in parameters if parameter.prior is not None)
    estimated = any(c.errors and c.errors.estimated for c in case.channels)
    if used + priors >= len(parameters) + estimated and used:
        return
    known = _count(used, "usable reading")
    known += f" and {_count(priors, 'prior')}" if priors else ""
    fault = case.source.fault(
        ("readings",),
        code="too-few-readings",
        message=f"{known} cannot determine {_count(len(parameters), 'parameter')}"
        f" ({', '.join(parameter.name for parameter in parameters)})"
        + (" and how accurate the gauges are" if estimated else ""),
        hint=_remedy(readings),
    )
    raise InputError([fault])


def _remedy(readings: ReadingTable) -> str:
    remedy = "Add readings, give priors, or make some parameters given numbers."
    reasons = sorted({readings.reason[k] for k in readings.unused})
    if not reasons:
        return remedy
    return f"{remedy} {_not_used(len(readings.unused))}: {'; '.join(reasons)}."


def _not_used(number: int) -> str:
    return f"{_count(number, 'reading')} {'is' if number == 1 else 'are'} not used"


def _count(number: int, noun: str) -> str:
    return f"{number} {noun}" if number == 1 else f"{number} {noun}s"


def unused_by_stage(readings: ReadingTable) -> tuple[str, ...]:
    """The unused readings in words, those of one stage and reason together."""
    together: dict[tuple[str, str], list[str]] = {}
    for k in readings.unused:
        key = readings.stage[k], readings.reason[k]
        together.setdefault(key, []).append(readings.channel[k])
    return tuple(
        f"{', '.join(channels)} at {stage}: {reason}"
        for (stage, reason), channels in together.items()
    )


def unused_notes(readings: ReadingTable) -> tuple[str, ...]:
    """One sentence for every reason for which readings are not used."""
    reasons = Counter(readings.reason[k] for k in readings.unused if not readings.bad[k])
    counted = (f"{_not_used(number)}: {why}." for why, number in reasons.items())
    return (*counted, *bad_notes(readings))


def bad_notes(readings: ReadingTable) -> tuple[str, ...]:
    """Readings that are known to be wrong: a sentence for every stage and reason."""
    together: dict[tuple[str, str], list[str]] = {}
    for k in readings.unused:
        if readings.bad[k] and not np.isnan(readings.value[k]):
            at = readings.stage[k], readings.reason[k]
            together.setdefault(at, []).append(readings.channel[k])
    return tuple(
        f"{named_channels(names)} at {stage} {'is' if len(names) == 1 else 'are'} not used, {why}."
        for (stage, why), names in together.items()
    )
