"""From readings as they come from the field to readings of stages.

A reading with a date belongs to the stage that was complete then: the last whose date is not later.
Within a stage the last good reading counts, or their mean, or all of them, as the case says.
What is not used here is counted and said, never dropped in silence.
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace

from geoident.io.readings.layout import FieldReading
from geoident.io.text.dates import date_text
from geoident.model.case import VIRGIN


@dataclass(frozen=True)
class Calendar:
    """The stages of a case in their order, their dates, and when channels are zero.

    Args:
        stages: names, the virgin state first.
        dates: stage to seconds since 1970, for those that have a date, increasing.
        zeros: channel to the stage at whose end it reads zero.
    """

    stages: tuple[str, ...]
    dates: Mapping[str, float]
    zeros: Mapping[str, str]

    def stage_at(self, time: float) -> str:
        """The last stage that was complete at a time; the virgin state before all."""
        done = [s for s in self.stages if s in self.dates and self.dates[s] <= time]
        return done[-1] if done else VIRGIN

    def before_zero(self, channel: str, stage: str) -> bool:
        """Whether a stage comes before the zero of a channel."""
        order = self.stages.index
        zero = self.zeros.get(channel, VIRGIN)
        return stage in self.stages and zero in self.stages and order(stage) < order(zero)


@dataclass
class Assigned:
    """Readings by stage, and what has to be said about the others.

    Args:
        readings: with their stages.
        notes: sentences.
        unzeroed: channels that have no reading at their zero to be subtracted.
    """

    readings: list[FieldReading]
    notes: list[str] = field(default_factory=list)
    unzeroed: list[FieldReading] = field(default_factory=list)


def assign(
    readings: Sequence[FieldReading], calendar: Calendar, *, several: str, rezero: bool
) -> Assigned:
    """Give dated readings their stages, subtract what was read at zero, and reduce several to one.

    Args:
        readings: of one file.
        calendar: stages and dates.
        several: ``last``, ``mean`` or ``all``.
        rezero: subtract from each channel what was read at its zero.
    """
    staged = [
        reading
        if reading.time is None or reading.stage is not None
        else replace(reading, stage=calendar.stage_at(reading.time))
        for reading in readings
    ]
    found = Assigned(staged)
    if rezero:
        _rezero(found, calendar, several)
    _leave_out_early(found, calendar)
    found.readings = [
        kept for group in _groups(found.readings) for kept in _reduced(group, several)
    ]
    return found


def _groups(readings: Iterable[FieldReading]) -> list[list[FieldReading]]:
    """Readings of the same channel and stage together, in the order of the file."""
    together: dict[tuple[str, str | None], list[FieldReading]] = {}
    for reading in readings:
        together.setdefault((reading.channel, reading.stage), []).append(reading)
    return list(together.values())


def _reduced(group: list[FieldReading], several: str) -> list[FieldReading]:
    """The bad readings of a group, and what is left of the good ones; a blank if there are none."""
    bad = [reading for reading in group if reading.bad]
    good = [reading for reading in group if not reading.bad and reading.value is not None]
    if not good:
        return bad or group[:1]
    if several == "last":
        good = [max(good, key=lambda reading: (reading.time is not None, reading.time or 0.0))]
        if good[0].time is None:
            good = [[r for r in group if not r.bad and r.value is not None][-1]]
    elif several == "mean":
        good = [_mean(good)]
    return [*good, *bad]


def _mean(good: list[FieldReading]) -> FieldReading:
    """One reading for several; `io.readings.case_readings` divides the gauge's accuracy."""
    n = len(good)
    times = [reading.time for reading in good if reading.time is not None]
    own = [reading.accuracy for reading in good if reading.accuracy is not None]
    accuracy = math.sqrt(sum(a**2 for a in own)) / n if len(own) == n else None
    return replace(
        good[-1],
        value=sum(reading.value or 0.0 for reading in good) / n,
        time=sum(times) / n if len(times) == n else None,
        accuracy=accuracy,
        count=n,
    )


def _rezero(found: Assigned, calendar: Calendar, several: str) -> None:
    """Subtract what was read at zero; readings at the zero itself say nothing more."""
    at_zero = [r for r in found.readings if calendar.zeros.get(r.channel) == r.stage]
    base = {
        group[0].channel: _reduced(group, "last" if several == "last" else "mean")[0].value
        for group in _groups(at_zero)
    }
    rest = [r for r in found.readings if calendar.zeros.get(r.channel) != r.stage]
    lacking = {r.channel: r for r in rest if base.get(r.channel) is None and r.value is not None}
    found.unzeroed = list(lacking.values())
    found.readings = [
        r if r.value is None else replace(r, value=r.value - (base.get(r.channel) or 0.0))
        for r in rest
    ]


def _leave_out_early(found: Assigned, calendar: Calendar) -> None:
    """Leave out dated readings of the time before the zero of their channel."""
    early = [r for r in found.readings if r.time is not None and _is_early(r, calendar)]
    left_out = {id(reading) for reading in early}
    found.readings = [r for r in found.readings if id(r) not in left_out]
    for channel, number in Counter(reading.channel for reading in early).items():
        zero = calendar.zeros.get(channel, VIRGIN)
        since = calendar.dates.get(zero if zero != VIRGIN else "", None)
        when = f" ({date_text(since)})" if since is not None else ""
        what = f"its zero at the end of '{zero}'{when}" if zero != VIRGIN else "the first stage"
        readings = "reading" if number == 1 else "readings"
        found.notes.append(f"{number} {readings} of {channel} before {what} left out.")


def _is_early(reading: FieldReading, calendar: Calendar) -> bool:
    stage = reading.stage or VIRGIN
    return stage == VIRGIN or calendar.before_zero(reading.channel, stage)
