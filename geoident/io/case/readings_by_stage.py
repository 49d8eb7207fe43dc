"""The readings of a case, from wherever it says they are to its stages.

A reading with a date belongs to a moment of the stage that lasted then, else to the stage that was
complete: the last whose date is not later. So all readings are read before the moments of stages
are known, and only then given to them. Within a stage, or a moment of one, the last good reading
counts, or their mean, or all of them, as the case says. What is not used here is counted and said,
never dropped in silence.
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Callable, Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

from geoident.errors import Fault, InputError
from geoident.io.case.case import CaseSection
from geoident.io.case.durations import Timetable
from geoident.io.case.readings import ReadingSection
from geoident.io.case.site_files.calendar import Calendar
from geoident.io.case.site_files.checks import ReadingChecks
from geoident.io.case.site_files.dates import exchanged, gaps, when_read
from geoident.io.case.site_files.file import ReadingsFileSection
from geoident.io.case.site_files.surveyed import surveyed
from geoident.io.readings.file import read_readings
from geoident.io.readings.layout import Layout
from geoident.io.readings.table import FaultyReadings
from geoident.io.text.dates import date_text, offset_text
from geoident.io.text.faults import Faults
from geoident.io.text.wording import Refusal
from geoident.model.case import VIRGIN, Case, KeyPath, format_path
from geoident.model.gauges import DAY, Channel, Reading, Reads, StageReadings, named_channels
from geoident.units import UnitError, read_quantity

Find = Callable[[str, KeyPath], str]
"""Path of a file that the case names at a key; notes a fault if it is not there."""


@dataclass
class ReadReadings:
    """The readings of a case.

    Args:
        readings: in the order of the files, each with its stage.
        paths: of the files.
        dates: stage to the date of its end, seconds since 1970.
        notes: what is to be known of how they were understood.
        zeros: channel to the measured zero that was subtracted from its readings.
        dated: the good ones that have a date, before several of a stage become one.
        by_stage: when these were taken, stage by stage.
        moments: stage that lasts to the times of its moments, s since its beginning.
    """

    readings: list[Reading] = field(default_factory=list)
    paths: list[str] = field(default_factory=list)
    dates: Mapping[str, float] = field(default_factory=dict)
    notes: list[str] = field(default_factory=list)
    zeros: dict[str, Reading] = field(default_factory=dict)
    dated: list[Reading] = field(default_factory=list)
    by_stage: tuple[StageReadings, ...] = ()
    moments: Mapping[str, Sequence[float]] = field(default_factory=dict)

    def given_to(self, case: Case) -> Case:
        """The case with its readings, and when they and its stages were."""
        return replace(
            case,
            readings=tuple(self.readings),
            dates=self.dates,
            notes=tuple(self.notes),
            when_read=self.by_stage,
        )


@dataclass(frozen=True)
class _FileRows:
    """The readings of files of one layout.

    Args:
        described: how the files are said to be.
        path: of the key that names them.
        rows: the readings, those with a date without their stages.
        surveyed: they are coordinates of points.
        sound: nothing is wrong with them.
    """

    described: ReadingsFileSection
    path: KeyPath
    rows: Sequence[Reading]
    surveyed: bool
    sound: bool


def read_all(
    section: CaseSection,
    times: Timetable,
    channels: Sequence[Channel],
    named: Mapping[str, Sequence[float]],
    find: Find,
    faults: Faults,
) -> ReadReadings:
    """Read what the case gives as readings; what is wrong in it is noted.

    Args:
        section: the case.
        times: of its stages.
        channels: of its gauges.
        named: stage to the times of moments that the case names, s since its beginning.
        find: finds the files that it names.
        faults: takes what is wrong.
    """
    aside = frozenset(stage.name for stage in section.stages if stage.independent)
    calendar = Calendar(times, {channel.name: channel for channel in channels}, independent=aside)
    checks = ReadingChecks(section, calendar, faults)
    read = ReadReadings()
    given: Any = section.readings
    entries: list[tuple[KeyPath, Any]] = [(("readings",), given)] if given is not None else []
    if isinstance(given, list):
        entries = [(("readings", n), entry) for n, entry in enumerate(given)]
    parts: list[_FileRows | list[Reading]] = []
    for path, entry in entries:
        if isinstance(entry, ReadingSection):
            parts.append(_at_moments(_inline(entry, path, calendar, faults), calendar, faults))
        else:
            parts.append(_of_file(entry, path, find, checks, read))
    rows = [row for part in parts for row in (part if isinstance(part, list) else part.rows)]
    calendar = calendar.with_moments(section, rows, named)
    read.dates, read.moments = calendar.dates, calendar.moments
    checks = ReadingChecks(section, calendar, faults)
    for part in parts:
        if isinstance(part, list):
            readings, alone = _in_stages(part, calendar), True
        else:
            readings, alone = _reduced_rows(part, checks, read)
        checks.all(readings, alone=alone)
        read.readings += readings
    checks.bad()
    checks.lasting()
    read.notes += checks.begun_with_zero(read.readings)
    read.notes += checks.copies(read.readings)
    read.notes += checks.drifts(read.readings)
    read.readings = [replace(r, bad=r.bad or _why_bad(r, section, calendar)) for r in read.readings]
    read.by_stage = when_read(read.dated, calendar)
    if read.by_stage and not faults.found and section.in_stages:
        read.notes += gaps(read.dated, read.by_stage, calendar, read.readings)
    return read


def _at_moments(rows: Iterable[Reading], calendar: Calendar, faults: Faults) -> list[Reading]:
    """Readings with a time since the beginning of their stage, if they have that or name it so.

    Of those that name a moment that there is not, only the fault is left.
    """
    times, kept = calendar.timetable, []
    for row in rows:
        at = row.when if row.since is None or row.key else row.location
        try:
            moment = None if row.stage in times.stages else times.moment(row.stage)
            stage, since = moment or (row.stage, row.since)
            if moment is not None and row.since is not None:
                message = f"'{row.stage}' is a moment already, and the reading has a time"
                raise Refusal("contradiction", message, "Leave one of them out.")
            if since is not None and stage in times.stages[1:]:
                times.require_within(stage, since)
        except Refusal as error:
            path = format_path((*row.key, "time" if row.since is not None else "stage"))
            faults.extend(
                [Fault(error.code, error.message, error.hint, at, path if row.key else "")]
            )
            continue
        kept.append(row if since is row.since else replace(row, stage=stage, since=since))
    return kept


def _in_stages(rows: Iterable[Reading], calendar: Calendar) -> list[Reading]:
    """Readings, each with its stage or moment."""
    return [replace(row, stage=_stage_of(row, calendar)) for row in rows]


def _inline(
    entry: ReadingSection, path: KeyPath, calendar: Calendar, faults: Faults
) -> list[Reading]:
    """A reading that stands in the case; its quantities must be those that its channel reads.

    Where there is but one stage, it is of that one. Nothing, with a fault, where it may be of any.
    """
    stage = entry.stage
    if stage is None and len(calendar.stages) > 2:
        hint = "Add 'stage: ...', the stage at whose end it was read."
        faults.add(path, "missing-key", "'stage' is missing", hint)
        return []
    wanted = calendar.dimensions.get(entry.gauge)
    known: dict[str, float] = {}
    for name, given in (("value", entry.value), ("accuracy", entry.accuracy)):
        if given is None:
            continue
        known[name] = given.factor
        if wanted is not None:
            try:
                known[name] = read_quantity(given.text, wanted).value
            except UnitError as error:
                faults.add((*path, name), "unit", error.message, error.hint)
    reading = Reading(
        channel=entry.gauge,
        stage=stage or calendar.stages[1],
        value=known.get("value"),
        accuracy=known.get("accuracy"),
        location=faults.places.locate((*path, "gauge")),
        when=faults.places.locate((*path, "gauge" if stage is None else "stage")),
        key=path,
        since=None if entry.time is None else entry.time.factor,
    )
    return [reading]


def _of_file(
    entry: str | ReadingsFileSection,
    path: KeyPath,
    find: Find,
    checks: ReadingChecks,
    read: ReadReadings,
) -> _FileRows:
    """The readings of a file; none where it cannot be said to which stages they belong."""
    calendar, faults = checks.calendar, checks.faults
    # what a file must declare by its format is asked for where it is read
    described = ReadingsFileSection.model_construct(file=entry) if isinstance(entry, str) else entry
    before = len(faults.found)
    key = path if isinstance(entry, str) else (*path, "file")
    none = _FileRows(described, path, (), surveyed=False, sound=False)
    paths = [find(name, key) for name in described.paths]
    read.paths += paths
    if len(faults.found) > before:
        return none
    survey = surveyed(described, checks.section, calendar.channels.values(), faults, path)
    checks.mapped(described, path)
    declared = len(faults.found)
    rows = rows_of(paths, described.described(calendar.dimensions, survey), faults, read.notes)
    if declared > before:
        return none
    sound = len(faults.found) == before
    if any(row.time is not None for row in rows) and not calendar.dates:
        message = f"the readings of '{described.paths[0]}' have dates, but the stages have none"
        hint = "Write dates: {STAGE: 2024-03-01, ...}, the day at which each was complete."
        if calendar.timetable.lasts:
            hint = f"Write dates: {{{VIRGIN}: 2024-03-01}}, when the first stage begins."
        faults.add(key, "missing-dates", message, hint)
        return none
    if described.several:
        note = "the key 'several' of the readings is called 'repeated_readings' now"
        read.notes += [note] if note not in read.notes else []
    if sound:
        read.notes += exchanged(rows, described.date_format, calendar)
    placed = _at_moments(rows, calendar, faults)
    checks.after_the_end(placed)
    return _FileRows(described, path, placed, surveyed=survey is not None, sound=sound)


def _reduced_rows(
    part: _FileRows, checks: ReadingChecks, read: ReadReadings
) -> tuple[list[Reading], bool]:
    """The readings of a file, each with its stage, and whether one a stage is expected."""
    described, calendar = part.described, checks.calendar
    rows = _in_stages(part.rows, calendar)
    dated = any(row.time is not None for row in rows)
    usual = "last" if checks.section.service_stage is None else "all"
    by_time = dated or any(row.since is not None for row in rows)
    stated = described.repeated_readings or described.several
    repeated = stated or (usual if by_time else "")
    lasts = calendar.timetable.lasts
    apart = set() if stated else {name for name, whole in calendar.owners.items() if whole in lasts}
    read.dated += [
        row if row.stage else replace(row, stage=calendar.stage_at(row.time))
        for row in part.rows
        if row.time is not None and row.value is not None and not row.bad
    ]
    zero = "first" if part.surveyed else repeated if described.rezero else ""
    readings, unzeroed = _by_stage(rows, repeated, zero, calendar, read, apart)
    checks.zeroed(unzeroed if part.sound else ())
    return readings, not repeated


def rows_of(
    paths: Sequence[str], layout: Layout, faults: Faults, notes: list[str]
) -> tuple[Reading, ...]:
    """The readings of files of one layout; what several of them repeat counts once."""
    rows: list[Reading] = []
    for path in paths:
        try:
            rows += read_readings(path, layout)
        except FaultyReadings as error:
            faults.extend(error.faults)
            rows += error.rows
        except InputError as error:
            faults.extend(error.faults)
    rows = _on_one_clock(rows, notes)
    if len(paths) == 1:
        return tuple(rows)

    def what(row: Reading) -> tuple[object, ...]:
        return row.channel, row.stage, row.time, row.value

    once: dict[tuple[object, ...], str] = {}
    # twice in one file it was read twice, which `repeated_readings` or a fault deals with
    kept = [
        row for row in rows if once.setdefault(what(row), row.location.file) == row.location.file
    ]
    why = {what(row): row.bad for row in rows if row.bad}
    repeated = len(rows) - len(kept)
    if repeated:
        readings = "reading stands" if repeated == 1 else "readings stand"
        notes.append(f"{repeated} {readings} in several files alike, and count once.")
    return tuple(replace(row, bad=row.bad or why.get(what(row), "")) for row in kept)


def _on_one_clock(rows: list[Reading], notes: list[str]) -> list[Reading]:
    """Readings whose dates say an offset from UTC, on the clock of the first of them.

    The dates of stages are local time, so that clock is taken to be the one of the site.
    """
    zones = {row.zone: row for row in reversed(rows) if row.zone is not None}
    if not zones:
        return rows
    clock = next(row.zone for row in rows if row.zone is not None)
    others = [offset_text(zone) for zone in sorted(zones) if zone != clock]
    file = Path(zones[clock].location.file).name
    note = f"Dates of '{file}' are taken as local time of the site at {offset_text(clock)}"
    moved = f"; those at {', '.join(others)} are converted to it" if others else ""
    notes.append(f"{note}{moved}.")
    return [
        row
        if row.zone is None or row.time is None
        else replace(row, time=row.time - row.zone + clock)
        for row in rows
    ]


def _why_bad(row: Reading, section: CaseSection, calendar: Calendar) -> str:
    """Why the key `bad` says that a reading is bad; empty for a good one.

    Of a stage all moments are meant.
    """
    stages = {None, row.stage, calendar.owners.get(row.stage)}
    for entry in section.bad:
        whole_gauge = row.channel.startswith(f"{entry.gauge}.")
        if entry.stage in stages and (entry.gauge == row.channel or whole_gauge):
            return entry.reason
    return ""


def _by_stage(
    rows: Iterable[Reading],
    repeated: str,
    zero: str,
    calendar: Calendar,
    read: ReadReadings,
    apart: Collection[str],
) -> tuple[list[Reading], list[Reading]]:
    """Give dated readings their stages, subtract what was read at zero, and reduce several to one.

    The error of a zero is that of all readings of its channel, `geoident.model.gauges.ErrorParts`:
    the variance of one is the sum of both (ISO/IEC Guide 98-3, 5.1.2), and the readings of the
    channel are correlated.

    Args:
        rows: of files of one layout.
        repeated: ``last``, ``mean`` or ``all``.
        zero: subtract from each channel what was read at its zero: the ``first`` or ``last`` of
            the stage, or the mean for anything else; nothing if empty.
        calendar: stages and dates.
        read: takes the zeros, and notes on readings that are left out.
        apart: moments of which readings of different times all count.

    Returns:
        The readings; and one of each channel that was not read at its zero, where that is to be
        subtracted.
    """
    rows = list(rows)
    zeros: dict[str, Reading] = {}
    unzeroed: dict[str, Reading] = {}
    if zero:
        at = calendar.zeroed
        good = [
            r for r in rows if at.get(r.channel) == r.stage and r.value is not None and not r.bad
        ]
        which = zero if zero in {"first", "last"} else "mean"
        zeros = {group[0].channel: _reduced(group, which, calendar)[0] for group in _groups(good)}
        rows = [r for r in rows if at.get(r.channel) != r.stage]
        unzeroed = {
            r.channel: r
            for r in rows
            if r.channel in at and r.channel not in zeros and r.value is not None
        }

    def is_early(row: Reading) -> bool:
        return row.time is not None and (
            row.stage in ("", VIRGIN) or calendar.before_zero(row.channel, row.stage)
        )

    read.notes += _early_notes(filter(is_early, rows), calendar)
    readings = [
        reading
        for group in _groups((row for row in rows if not is_early(row)), apart)
        for reading in _reduced(group, repeated, calendar)
    ]
    channels = list(dict.fromkeys(r.channel for r in readings if r.channel in zeros))
    if channels:
        read.zeros |= {name: zeros[name] for name in channels}
        read.notes.append(
            f"The readings of {named_channels(channels)} are differences from a measured zero "
            "(rezero): their standard deviation is the root of the sum of the squares of both. All "
            "readings of a channel share the error of its zero, and count as correlated."
        )
    readings = [
        replace(row, value=row.value - (zeros[row.channel].value or 0.0))
        if row.value is not None and row.channel in zeros
        else row
        for row in readings
    ]
    return readings, list(unzeroed.values())


def _stage_of(reading: Reading, calendar: Calendar) -> str:
    """The stage of a reading, or its moment in a stage that lasts.

    What reads the stress of the virgin ground is read before the first stage, too, and counts with
    it.
    """
    if reading.since is not None:
        known = reading.stage in calendar.timetable.lasts
        return calendar.moment_of(reading.stage, reading.since) if known else reading.stage
    if reading.time is None or reading.stage:
        return reading.stage
    stage = calendar.stage_at(reading.time)
    channel = calendar.channels.get(reading.channel)
    of_virgin = channel is not None and channel.reads is Reads.VIRGIN
    return (
        calendar.stages[1] if stage == VIRGIN and of_virgin and len(calendar.stages) > 1 else stage
    )


def _groups(readings: Iterable[Reading], lasting: Collection[str] = ()) -> list[list[Reading]]:
    """Readings of the same channel and stage together, in the order of the file.

    Args:
        readings: any.
        lasting: names of moments whose readings are together only if they are of the same time.
    """
    together: dict[tuple[object, ...], list[Reading]] = {}
    for reading in readings:
        time = (reading.time, reading.since) if reading.stage in lasting else ()
        together.setdefault((reading.channel, reading.stage, *time), []).append(reading)
    return list(together.values())


def _reduced(group: list[Reading], repeated: str, calendar: Calendar) -> list[Reading]:
    """The bad readings of a group, and what is left of the good ones; a blank if there are none."""
    bad = [reading for reading in group if reading.bad]
    good = [reading for reading in group if not reading.bad and reading.value is not None]
    if not good:
        return bad or group[:1]
    if repeated == "first":
        good = [min(good, key=lambda reading: reading.time or 0.0)]
    elif repeated == "last":
        # of equal dates, and where none is known, the last in the file
        latest = max(reversed(good), key=lambda r: (r.time is not None, r.time or 0.0))
        good = [latest]
    elif repeated == "mean":
        good = [_mean(good, calendar)]
    return [*good, *bad]


def _mean(good: list[Reading], calendar: Calendar) -> Reading:
    """One reading for several, of which some may have accuracies of their own.

    `mean` in a case is the plain mean, which people can check on the sheet. Readings that all count
    are weighted by their accuracies where one number is shown for them (`taken_together`).

    What readings of a day share, such as a set-up, is averaged over the days only.
    """
    n = len(good)
    times = [reading.time for reading in good if reading.time is not None]
    accuracy, gauge = None, calendar.channels.get(good[0].channel)
    if gauge is not None and any(reading.accuracy is not None for reading in good):
        each = (gauge.own_accuracy if r.accuracy is None else r.accuracy for r in good)
        accuracy = math.hypot(*each) / n
    return replace(
        good[-1],
        value=sum(reading.value or 0.0 for reading in good) / n,
        time=sum(times) / n if len(times) == n else None,
        accuracy=accuracy,
        count=n,
        epochs=len({time // DAY for time in times}) if len(times) == n else 1,
    )


def _early_notes(early: Iterable[Reading], calendar: Calendar) -> list[str]:
    """What is said of dated readings that are left out: of the time before a channel's zero."""
    before: dict[str, list[tuple[str, int]]] = {}
    for channel, number in Counter(reading.channel for reading in early).items():
        zero = calendar.zeros.get(channel, VIRGIN)
        what = "the first stage"
        if zero != VIRGIN:
            when = f" ({date_text(calendar.dates[zero])})" if zero in calendar.dates else ""
            what = f"its zero at the end of '{zero}'{when}"
        before.setdefault(what, []).append((channel, number))
    notes = []
    for what, counted in before.items():
        number = sum(count for _, count in counted)
        names = named_channels([channel for channel, _ in counted])
        readings = "reading" if number == 1 else "readings"
        notes.append(f"{number} {readings} of {names} before {what} left out.")
    return notes
