"""Readings as a long table: which take part and why not, and what their errors share (theory 7).

A reading of the case is a row of the `ReadingTable` of its result. A `Problem` takes the values of
the rows that are used from the table, and their errors, row by row, from the channels of the case
(`errors_of_used`): whoever changes these makes a new table (`Setup.with_case`).

Shared errors are named by what shares them: the zero of a channel; the head of a gauge, the set-up
of a survey or a step along a casing at an epoch. An epoch is a day of a stage, or the stage
where no dates are known.
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace

import numpy as np
import scipy.sparse as sp

from geoident.errors import InputError
from geoident.forward.observed import ObservedModel
from geoident.identify.problem.problem import Problem
from geoident.identify.problem.shared_errors import ErrorStructure
from geoident.model.arrays import Bools, Floats, Ints
from geoident.model.case import Case
from geoident.model.gauges import DAY, Channel, ErrorParts, Reading, ReadingTable, named_channels
from geoident.model.in_service import SeasonalModel
from geoident.model.response import Response
from geoident.model.results.result import AccuracyTable

FLAGGED = "flagged as bad: "
"""Beginning of the reason why a reading that is known to be wrong is not used."""

LATER = "it was read after fit.until"
"""Why a reading is not used that is only predicted."""

MESH = "mesh"
"""The error of the mesh: one factor for all readings, and one for each channel."""

STEPS = "steps"
"""The error by the steps in time, likewise."""

SURFACE = "surface"
"""The errors of response surfaces: independent ones that all readings share."""

ErrorSource = tuple[str | float, ...]
"""What a shared error is that of, such as ``("zero", "EX1.a5")``."""

ChannelReading = tuple[Channel, Reading]
"""A reading and its channel."""


def select_readings(case: Case, model: ObservedModel) -> ReadingTable:
    """The readings of a case, and which of them an identification uses.

    Args:
        case: with its readings.
        model: tells what can be read.
    """
    channels = {channel.name: channel for channel in case.channels}

    def why_unused(reading: Reading) -> str:
        """Why a reading takes no part; empty if it does."""
        if useless := why_useless(reading):
            return useless
        if case.fit.stages is not None and reading.stage not in case.fit.stages:
            return "the stage is not in fit.stages"
        if case.service is not None and reading.stage != case.stages[-1].name:
            return "it was read before the service"
        time = case.times.get(reading.stage, -math.inf) if reading.time is None else reading.time
        if case.fit.until is not None and time > case.fit.until:
            return LATER
        channel = channels[reading.channel]
        if not {channel.gauge, channel.name}.isdisjoint(case.fit.predict_gauges):
            return "the gauge is in fit.predict_gauges"
        # Another number at that stage is a second reading, which has errors.
        at_zero = channel.is_zeroed and channel.zero == reading.stage
        if at_zero and reading.value == 0.0 and channel.drift is None:
            return "it is zeroed at this stage"
        return model.unreadable(reading.channel, reading.stage) or ""

    return reading_table(case, [why_unused(reading) for reading in case.readings])


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
    rows = [(channels[reading.channel], reading) for reading in readings]
    independent = not any(channel.errors for channel, _ in rows)
    return ReadingTable(
        channel=tuple(reading.channel for reading in readings),
        gauge=tuple(channel.gauge for channel, _ in rows),
        stage=tuple(reading.stage for reading in readings),
        time=_numbers([reading.time for reading in readings]),
        value=_numbers([reading.value for reading in readings]),
        sd=_numbers([channel.sd(reading) for channel, reading in rows]),
        used=np.array([not reason for reason in reasons], dtype=np.bool_),
        bad=np.array([bool(reading.bad) for reading in readings], dtype=np.bool_),
        reason=tuple(reasons),
        computed=np.full(len(readings), np.nan),
        note=tuple(r.note for r in readings) if any(r.note for r in readings) else (),
        own_sd=None if independent else _numbers([c.own_sd(r) for c, r in rows]),
        epochs=None if independent else np.array([r.epochs for r in readings], dtype=np.int64),
    )


def as_stated(case: Case, readings: ReadingTable) -> ReadingTable:
    """Readings with the accuracies that their case states, before any estimate.

    Args:
        case: as it was read.
        readings: the same, perhaps with accuracies that were estimated.
    """
    stated = reading_table(case, readings.reason)
    return replace(readings, sd=stated.sd, own_sd=stated.own_sd)


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


def require_enough(case: Case, readings: ReadingTable) -> None:
    """Refuse readings that are fewer than the parameters, unless there is a prior.

    Beside one, the fit says what is known from it, and what is not determined.

    Raises:
        InputError: they are.
    """
    parameters, used = case.parameters, int(np.count_nonzero(readings.used))
    priors = sum(1 for parameter in parameters if parameter.prior is not None)
    estimated = any(c.errors and c.errors.estimated for c in case.channels)
    if used and (used + priors >= len(parameters) + estimated or (priors and not estimated)):
        return
    known = _count(used, "usable reading")
    known += f" and {_count(priors, 'prior')}" if priors else ""
    hint = "Add readings, give priors, or make some parameters given numbers."
    if isinstance(case.elsewhere, SeasonalModel):
        hint = "Add readings, or change fit.until or model.since."
    if reasons := sorted({readings.reason[k] for k in readings.unused}):
        hint += f" {_not_used(len(readings.unused))}: {'; '.join(reasons)}."
    if case.when_read and case.notes:  # why dated readings are not where they should be
        hint += f" {' '.join(case.notes)}"
    message = (
        f"{known} cannot determine {_count(len(parameters), 'parameter')}"
        f" ({', '.join(parameter.name for parameter in parameters)})"
    ) + (" and how accurate the gauges are" if estimated else "")
    if isinstance(case.elsewhere, SeasonalModel):
        message = "there is no reading to which the model could be fitted"
    at = ("readings",)
    raise InputError([case.source.fault(at, "too-few-readings", message, hint)])


def _not_used(number: int) -> str:
    return f"{_count(number, 'reading')} {'is' if number == 1 else 'are'} not used"


def _count(number: int, noun: str) -> str:
    return f"{number} {noun}" if number == 1 else f"{number} {noun}s"


def unused_by_stage(readings: ReadingTable) -> tuple[str, ...]:
    """The unused readings in words, those of one stage and reason together.

    So are many stages in which the same channels are left out for one reason.
    """
    together: dict[tuple[str, str], list[str]] = {}
    for k in readings.unused:
        key = readings.stage[k], readings.reason[k]
        together.setdefault(key, []).append(readings.channel[k])
    alike: dict[tuple[str, str], list[str]] = {}
    for (stage, reason), channels in together.items():
        alike.setdefault((", ".join(dict.fromkeys(channels)), reason), []).append(stage)
    return tuple(
        f"{channels} at {at}: {reason}"
        for (channels, reason), stages in alike.items()
        for at in (stages if len(stages) <= _FEW else [_first_to_last(stages)])
    )


_FEW = 4
"""Stages that are named one by one."""


def _first_to_last(stages: Sequence[str]) -> str:
    return f"{stages[0]} to {stages[-1]} ({len(stages)} stages)"


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


def problem_of_readings(case: Case, readings: ReadingTable, response: Response) -> Problem:
    """The readings of a case that are used, to be met by a model.

    Args:
        case: with its parameters, its loss, and what its gauges share of their errors.
        readings: all of them, and which are used.
        response: the model in those that are used.
    """
    used = readings.used
    sd, shared = errors_of_used(case, used).stated
    return Problem(response, readings.value[used], sd, case.parameters, case.fit.loss, shared)


def used_rows(case: Case, used: Bools) -> tuple[ChannelReading, ...]:
    """The used readings (k,) of a case with their channels."""
    channels = {channel.name: channel for channel in case.channels}
    taken = [reading for reading, flag in zip(case.readings, used, strict=True) if flag]
    return tuple((channels[reading.channel], reading) for reading in taken)


def errors_of_used(case: Case, used: Bools) -> ErrorStructure:
    """The errors of the used readings (k,) of a case."""
    return error_structure(used_rows(case, used))


def error_structure(
    rows: Sequence[ChannelReading],
    estimated: AccuracyTable | None = None,
    own_components: Ints | None = None,
) -> ErrorStructure:
    """The errors of readings, whether they share any or not.

    Args:
        rows: readings with their channels.
        estimated: accuracies that were estimated, whose components are wanted; None for the
            components that the case wants estimated.
        own_components: (m,) numbers of these components to which the own errors of the first m
            readings belong, -1 for none; None where the channels say it.
    """
    numbers = {name: k for k, name in enumerate(() if estimated is None else estimated.names)}

    def component(channel: Channel, part: str) -> int:
        """Number of the component of a part of the error of a channel; -1 where it is given."""
        if channel.errors is None:
            return -1
        if estimated is not None:
            return numbers.get(dict(channel.errors.already_estimated).get(part, ""), -1)
        name = channel.errors.component(part)
        return numbers.setdefault(name, len(numbers)) if name else -1

    steps, columns = _steps(rows), dict[ErrorSource, int]()
    of_readings, of_columns = [], []
    entries: list[tuple[int, int, float]] = []  # of B: reading, column, standard deviation
    for k, (channel, reading) in enumerate(rows):
        own = channel.errors is not None and reading.accuracy is None
        of_readings.append(component(channel, "reading") if own else -1)
        for part, source, size in _shared_terms(channel, reading, steps):
            if size != 0.0:
                if source not in columns:
                    columns[source] = len(columns)
                    of_columns.append(component(channel, part))
                entries.append((k, columns[source], size))
    if own_components is not None:
        of_readings[: len(own_components)] = own_components.tolist()
    i, j, sd = np.array(entries, dtype=np.float64).reshape(-1, 3).T
    at = i.astype(np.int64), j.astype(np.int64)
    return ErrorStructure(
        sd=np.array([channel.own_sd(reading) for channel, reading in rows], dtype=np.float64),
        component=np.array(of_readings, dtype=np.int64),
        columns=sp.csr_array((sd, at), shape=(len(rows), len(columns))),
        column_component=np.array(of_columns, dtype=np.int64),
        names=tuple(numbers),
    )


def _shared_terms(
    channel: Channel, reading: Reading, steps: Mapping[str, tuple[float, ...]]
) -> Iterator[tuple[str, ErrorSource, float]]:
    """The shared errors of a reading: part, what it is that of, and standard deviation.

    The set-up at a zero is taken as independent of that of readings on the same day.
    """
    parts = channel.errors
    if parts is None:
        return
    averaging = 1.0 / math.sqrt(reading.epochs)
    day = -1.0 if reading.time is None else reading.time // DAY
    yield "zero", ("zero", channel.name), parts.zero
    for part, errors in ((MESH, parts.mesh), (STEPS, parts.steps)):
        for stage, error, doubt in errors:
            if stage == reading.stage:
                yield part, (part,), error
                yield part, (part, channel.name), doubt
    for stage, sizes in parts.surface:
        if stage == reading.stage:
            for number, size in enumerate(sizes):
                yield SURFACE, (SURFACE, number), size
    yield from _of_epoch(channel, parts, (reading.stage, day), averaging, steps)
    yield from _of_epoch(channel, parts, ("zero at", channel.zero), parts.zero_surveyed, steps)


def _of_epoch(
    channel: Channel,
    parts: ErrorParts,
    epoch: ErrorSource,
    averaging: float,
    steps: Mapping[str, tuple[float, ...]],
) -> Iterator[tuple[str, ErrorSource, float]]:
    """What a survey shares: of an epoch of readings, or of that of the zero.

    Args:
        channel: the channel.
        parts: what its errors are made of.
        epoch: of the survey.
        averaging: factor on the errors of a mean over several days.
        steps: run to the places of its channels, m.
    """
    yield "head", ("head", channel.gauge, channel.probe, *epoch), parts.head * averaging
    yield (
        "epoch",
        ("epoch", parts.survey or channel.gauge, channel.probe, *epoch),
        parts.epoch * averaging,
    )
    before = 0.0
    for place in steps.get(channel.run, (channel.along,)):
        if place > channel.along:
            break
        size = parts.along * math.sqrt(place - before) * averaging
        yield "along", ("along", channel.run or channel.name, *epoch, place), size
        before = place


def _steps(rows: Sequence[ChannelReading]) -> dict[str, tuple[float, ...]]:
    """Run to the places of its channels, from the reference end on, m."""
    places_of: dict[str, set[float]] = {}
    for channel, _ in rows:
        if channel.run:
            places_of.setdefault(channel.run, set()).add(channel.along)
    return {run: tuple(sorted(places)) for run, places in places_of.items()}
