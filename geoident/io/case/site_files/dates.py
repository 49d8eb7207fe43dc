"""What went where: when the readings of each stage were taken, and what looks wrong with it.

A dated reading counts for a moment of the stage that lasted when it was taken, or for the last
stage that was complete. Dates of stages that take no time and are a few days late therefore move
readings to the stage before, without any other sign than these: readings shortly before the next
stage was complete, stages without readings, and readings that change inside a stage, in which
nothing is said to happen.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from itertools import pairwise
from pathlib import Path

from geoident.io.case.site_files.calendar import Calendar
from geoident.io.text.dates import date_text, day_and_month_exchanged, exchanged_format
from geoident.model.case import VIRGIN
from geoident.model.gauges import DAY, Reading, StageReadings
from geoident.units import DIMENSIONS, in_unit

_MOST_NOTES = 3
"""Stages of which each has its note on late readings; of more there is one for all."""

STRONG = 4.0
"""A change inside a stage is strong from this many standard deviations of a difference of two
readings on; errors alone exceed it once in 16 000 channels and stages."""


def when_read(dated: Sequence[Reading], calendar: Calendar) -> tuple[StageReadings, ...]:
    """When the readings of each stage were taken; none where no reading has a date.

    The virgin state is shown if readings were taken before the first stage was complete.

    Args:
        dated: the good readings of all files that have a date, with their stages.
        calendar: stages and dates.
    """
    if not dated:
        return ()
    together: dict[str, list[Reading]] = {}
    for row in dated:
        together.setdefault(calendar.owners.get(row.stage, row.stage), []).append(row)
    return tuple(
        StageReadings(
            stage=stage,
            complete=calendar.timetable.dates.get(stage),
            number=len(rows),
            channels=len({row.channel for row in rows}),
            first=min(map(_time, rows), default=None),
            last=max(map(_time, rows), default=None),
            between=sum(_between(row.stage, _time(row), calendar) for row in rows),
        )
        for stage in calendar.timetable.stages
        for rows in (together.get(stage, []),)
        if rows or stage != VIRGIN
    )


def exchanged(rows: Sequence[Reading], pattern: str, calendar: Calendar) -> list[str]:
    """A sentence on dates in which day and month seem to be in each other's place.

    It is so where the dates of the channels go back, or lie outside those of the stages, as they
    are read, and neither of it the other way round.

    Args:
        rows: of files of one layout, in their order.
        pattern: how their dates are written.
        calendar: stages and dates.
    """
    dated = [row for row in rows if row.time is not None]
    other = [day_and_month_exchanged(_time(row)) for row in dated]
    turned = [
        replace(row, time=time) for row, time in zip(dated, other, strict=True) if time is not None
    ]
    if not dated or len(turned) < len(dated) or not calendar.dates:
        return []
    back, outside = _going_back(dated), _outside(dated, calendar)
    if not (back or outside) or _going_back(turned) or _outside(turned, calendar):
        return []
    file = Path(dated[0].location.file).name
    seen = []
    if back:
        before, after = back[0]
        seen.append(
            f"go back (from {date_text(_time(before))} to {date_text(_time(after))} in "
            f"{after.when})"
        )
    if outside:
        first, last = (date_text(date) for date in _span(calendar))
        number = "one of them is" if len(outside) == 1 else f"{len(outside)} of them are"
        seen.append(
            f"lie outside those of the stages, {first} to {last} ({number}, the first in "
            f"{outside[0].when})"
        )
    return [
        f"The dates of '{file}', read as {pattern}, {' and '.join(seen)}. Read as "
        f"{exchanged_format(pattern)} they are in order and within: check 'date_format', day and "
        "month."
    ]


def _going_back(rows: Sequence[Reading]) -> list[tuple[Reading, Reading]]:
    """Readings of a channel that are earlier than the one before them in the file, with that."""
    last: dict[str, Reading] = {}
    back = []
    for row in rows:
        before = last.get(row.channel)
        if before is not None and _time(row) < _time(before):
            back.append((before, row))
        last[row.channel] = row
    return back


def _span(calendar: Calendar) -> tuple[float, float]:
    """The first and the last date of the stages."""
    return min(calendar.dates.values()), max(calendar.dates.values())


def _outside(rows: Sequence[Reading], calendar: Calendar) -> list[Reading]:
    """Readings before the first date of a stage, or after the last one and as long as it took."""
    first, last = _span(calendar)
    margin = max(last - first, _MONTH)
    return [row for row in rows if not first - _MONTH <= _time(row) <= last + margin]


_MONTH = 31 * DAY
"""Seconds before the first stage, or after the last, in which readings are usual."""


def gaps(
    dated: Sequence[Reading],
    by_stage: Sequence[StageReadings],
    calendar: Calendar,
    counting: Sequence[Reading],
) -> list[str]:
    """What looks wrong with the dates, in sentences.

    Args:
        dated: the good readings of all files that have a date, with their stages.
        by_stage: as `when_read` found them.
        calendar: stages and dates.
        counting: the readings that are left when several of a stage are made into one.
    """
    notes = _without_readings(by_stage, calendar, counting)
    notes += _between_stages(calendar, counting)
    for stage in calendar.timetable.stages:
        if stage not in calendar.timetable.lasts:
            notes += _changing(stage, [row for row in dated if row.stage == stage], calendar)
    return notes


def _next(stage: str, calendar: Calendar) -> str | None:
    """The next stage that has a date, where it does not last since the end of this one."""
    stages, dates = calendar.timetable.stages, calendar.timetable.dates
    later = stages[stages.index(stage) + 1 :]
    after = next((name for name in later if name in dates), None)
    return None if after in calendar.timetable.lasts else after


def _between(stage: str, time: float, calendar: Calendar) -> bool:
    """Whether a reading is nearer to the end of the next stage than to that of its own."""
    stages, dates = calendar.timetable.stages, calendar.timetable.dates
    after = _next(stage, calendar) if stage in stages else None
    if after is None or stage not in dates:
        return False
    return calendar.dates[after] - time < time - calendar.dates[stage]


def _without_readings(
    by_stage: Sequence[StageReadings], calendar: Calendar, counting: Sequence[Reading]
) -> list[str]:
    """Stages with a date, or before others that were read, of which no reading counts."""
    owners, stages = calendar.owners, calendar.timetable.stages
    read = {owners.get(r.stage, "") for r in counting if r.value is not None}
    if not by_stage:
        return []
    last = max((n for n, name in enumerate(stages) if name in read), default=0)
    zeros = [owners[zero] for zero in calendar.zeros.values()]
    started = min(map(stages.index, zeros), default=0)
    notes = []
    for n, stage in enumerate(stages):
        if n <= started or stage in read:
            continue
        if stage in calendar.timetable.lasts:
            notes.append(f"The stage '{stage}' has no reading while it lasts.")
        elif stage in calendar.dates:
            when = date_text(calendar.dates[stage])
            notes.append(f"The stage '{stage}' has no reading since it was complete ({when}).")
        elif n < last:
            notes.append(f"The stage '{stage}' has no date, so no dated reading counts for it.")
    return notes


def _between_stages(calendar: Calendar, counting: Sequence[Reading]) -> list[str]:
    """Readings that count for a stage, but were taken shortly before the next one was complete."""
    notes, counts = list[str](), dict[str, int]()
    for stage in calendar.timetable.stages:
        times = [
            reading.time
            for reading in counting
            if reading.stage == stage and reading.time is not None and reading.value is not None
        ]
        late = [time for time in times if _between(stage, time, calendar)]
        after = _next(stage, calendar) if late else None
        if after is None:
            continue
        counts[stage] = len(late)
        days = (calendar.dates[after] - max(late)) / DAY
        one = len(late) == 1
        counted = "1 reading counts" if one else f"{len(late)} readings count"
        contain = "it contains" if one else "they contain"
        which = "It was taken" if one else "They were taken"
        latest = "" if one else "the latest "
        notes.append(
            f"{counted} for '{stage}' ({date_text(calendar.dates[stage])}), the last stage that "
            f"was complete. {which} {_period(late)}, {latest}{_days(days)} before '{after}' was "
            f"complete ({date_text(calendar.dates[after])}). If {contain} "
            f"motion of '{after}', the date of '{after}' is too late."
        )
    if len(notes) <= _MOST_NOTES:
        return notes
    shown = ", ".join(f"'{stage}' ({count})" for stage, count in [*counts.items()][:_MOST_NOTES])
    return [
        f"{sum(counts.values())} readings of {len(counts)} stages were taken nearer to the end of "
        f"the next stage than to that of their own: {shown} and {len(counts) - _MOST_NOTES} more. "
        "If they contain motion of the next stage, its date is too late."
    ]


def _changing(stage: str, rows: Sequence[Reading], calendar: Calendar) -> list[str]:
    """The sentence on channels that change strongly inside a stage, if there are any."""
    together: dict[str, list[Reading]] = {}
    for row in rows:
        together.setdefault(row.channel, []).append(row)
    strong: dict[str, float] = {}
    several = 0
    for channel, series in together.items():
        series.sort(key=_time)
        if len(series) < 2 or channel not in calendar.channels:
            continue
        several += 1
        errors = calendar.channels[channel].error_parts
        first, last = series[0], series[-1]
        sd = math.hypot(*(errors.total(own=row.accuracy) for row in (first, last)))
        relative = abs(_value(last) - _value(first)) / sd
        if relative > STRONG:
            strong[channel] = relative
    if not strong:
        return []
    worst = max(strong, key=lambda channel: strong[channel])
    read = together[worst]
    before, after = max(pairwise(read), key=lambda pair: abs(_value(pair[1]) - _value(pair[0])))
    dimension = calendar.dimensions[worst]
    change, step = (
        _shown(_value(b) - _value(a), dimension) for a, b in ((read[0], read[-1]), (before, after))
    )
    who = "the channel" if several == 1 else f"{len(strong)} of {several} channels"
    verb = "changes" if several == 1 or len(strong) == 1 else "change"
    where = f"Inside '{stage}'" if stage != VIRGIN else "Before the first stage was complete"
    step_text = ""
    if len(read) > 2:
        step_text = (
            f", {step} of it between {date_text(_time(before))} and {date_text(_time(after))}"
        )
    since, until = (date_text(_time(row)) for row in (read[0], read[-1]))
    return [
        f"{where} {who} {verb} by more than {STRONG:g} standard deviations of a difference of two "
        f"readings, most {worst}: {change} from {since} to {until}{step_text}. "
        "According to the case nothing is built in between: check the dates of the stages."
    ]


def _value(row: Reading) -> float:
    return row.value or 0.0


def _time(row: Reading) -> float:
    assert row.time is not None  # it is one with a date
    return row.time


def _shown(value: float, dimension: str) -> str:
    unit = {"length": "mm", "pressure": "kPa", "force": "kN", "strain": "microstrain"}.get(
        dimension, DIMENSIONS[dimension]
    )
    return f"{in_unit(value, unit, dimension):+.3g} {unit}".rstrip()


def _days(days: float) -> str:
    return "less than a day" if days < 1 else f"{days:.0f} day{'s' if round(days) > 1 else ''}"


def _period(times: Sequence[float]) -> str:
    first, last = (date_text(time).partition(" ")[0] for time in (min(times), max(times)))
    return f"on {first}" if first == last else f"from {first} to {last}"
