"""To which stage a reading belongs, and what counts of several.

A reading with a date belongs to the stage that was complete then: the last whose date is not later.
Within a stage the last good reading counts, or their mean, or all of them, as the case says.
What is not used here is counted and said, never dropped in silence.
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property

from geoident.io.case.gauges.accuracy import error_parts
from geoident.io.case.gauges.gauge import GaugeBase
from geoident.io.schema.values import Given
from geoident.io.text.dates import date_text
from geoident.model.case import VIRGIN
from geoident.model.gauges import Reading, Reads, named_channels

DAY = 86400.0
"""Seconds; readings of one day are of one epoch."""


@dataclass(frozen=True)
class Calendar:
    """The stages of a case in their order, their dates, and when channels are zero.

    Args:
        stages: names, the virgin state first.
        dates: stage to seconds since 1970, for those that have a date, increasing.
        channels: name to what the case says of the gauge of a channel.
    """

    stages: tuple[str, ...]
    dates: Mapping[str, float]
    channels: Mapping[str, GaugeBase]

    @cached_property
    def zeros(self) -> dict[str, str]:
        """Channel to the stage at whose end it reads zero."""
        return {name: gauge.zero_stage for name, gauge in self.channels.items()}

    @cached_property
    def zeroed(self) -> dict[str, str]:
        """The same without channels that read a value: these have no zero."""
        changes = (name for name, g in self.channels.items() if g.made_of is Reads.CHANGE)
        return {name: self.zeros[name] for name in changes}

    @cached_property
    def dimensions(self) -> dict[str, str]:
        """Channel to the dimension of its readings."""
        return {name: gauge.dimension for name, gauge in self.channels.items()}

    def accuracy(self, reading: Reading) -> float | None:
        """Standard deviation of a reading, SI; None where its channel is unknown."""
        gauge = self.channels.get(reading.channel)
        if reading.accuracy is not None or gauge is None:
            return reading.accuracy
        parts = error_parts(gauge.accuracy, gauge.kind_name, "")
        if parts is None:
            return gauge.accuracy.factor if isinstance(gauge.accuracy, Given) else None
        return parts.total()

    def stage_at(self, time: float) -> str:
        """The last stage that was complete at a time; the virgin state before all."""
        done = [s for s in self.stages if s in self.dates and self.dates[s] <= time]
        return done[-1] if done else VIRGIN

    def stage_of(self, reading: Reading) -> str:
        """The stage of a dated reading.

        What reads the stress of the virgin ground is read before the first stage, too, and counts
        with it.
        """
        found = self.stage_at(reading.time) if reading.time is not None else reading.stage
        gauge = self.channels.get(reading.channel)
        of_virgin = gauge is not None and gauge.made_of is Reads.VIRGIN
        return self.stages[1] if found == VIRGIN and of_virgin and len(self.stages) > 1 else found

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
        zeros: channel to what was subtracted.
    """

    readings: list[Reading]
    notes: list[str] = field(default_factory=list)
    unzeroed: list[Reading] = field(default_factory=list)
    zeros: dict[str, Reading] = field(default_factory=dict)


def assign(
    readings: Sequence[Reading], calendar: Calendar, *, several: str, zero: str = ""
) -> Assigned:
    """Give dated readings their stages, subtract what was read at zero, and reduce several to one.

    Args:
        readings: of one file.
        calendar: stages and dates.
        several: ``last``, ``mean`` or ``all``.
        zero: subtract from each channel what was read at its zero: the ``first`` or ``last`` of
            the stage, or the mean for anything else; nothing if empty.
    """
    staged = [
        reading
        if reading.time is None or reading.stage
        else replace(reading, stage=calendar.stage_of(reading))
        for reading in readings
    ]
    found = Assigned(staged)
    if zero:
        zeros = _take_zeros(found, calendar, zero)
    _leave_out_early(found, calendar)
    found.readings = [r for group in _groups(found.readings) for r in _reduced(group, several)]
    if zero:
        _subtract_zeros(found, zeros)
    return found


def _groups(readings: Iterable[Reading]) -> list[list[Reading]]:
    """Readings of the same channel and stage together, in the order of the file."""
    together: dict[tuple[str, str], list[Reading]] = {}
    for reading in readings:
        together.setdefault((reading.channel, reading.stage), []).append(reading)
    return list(together.values())


def _reduced(group: list[Reading], several: str) -> list[Reading]:
    """The bad readings of a group, and what is left of the good ones; a blank if there are none."""
    bad = [reading for reading in group if reading.bad]
    good = [reading for reading in group if not reading.bad and reading.value is not None]
    if not good:
        return bad or group[:1]
    if several == "first":
        good = [min(good, key=lambda reading: reading.time or 0.0)]
    elif several == "last":
        good = [max(good, key=lambda reading: (reading.time is not None, reading.time or 0.0))]
        if good[0].time is None:
            good = [[r for r in group if not r.bad and r.value is not None][-1]]
    elif several == "mean":
        good = [_mean(good)]
    return [*good, *bad]


def _mean(good: list[Reading]) -> Reading:
    """One reading for several; its accuracy is that of the gauge unless each has its own.

    What readings of a day share, such as a set-up, is averaged over the days only.
    """
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
        epochs=len({time // DAY for time in times}) if len(times) == n else 1,
    )


def _take_zeros(found: Assigned, calendar: Calendar, several: str) -> dict[str, Reading]:
    """Channel to what was read at its zero; these readings say nothing more."""
    at = calendar.zeroed
    at_zero = [r for r in found.readings if at.get(r.channel) == r.stage]
    good = [r for r in at_zero if r.value is not None and not r.bad]
    which = several if several in {"first", "last"} else "mean"
    zeros = {group[0].channel: _reduced(group, which)[0] for group in _groups(good)}
    found.readings = [r for r in found.readings if at.get(r.channel) != r.stage]
    lacking = {
        r.channel: r
        for r in found.readings
        if r.channel in at and r.channel not in zeros and r.value is not None
    }
    found.unzeroed = list(lacking.values())
    return zeros


def _subtract_zeros(found: Assigned, zeros: Mapping[str, Reading]) -> None:
    """Subtract what was read at zero from the readings that are left.

    The error of a zero is that of all readings of its channel, `geoident.model.gauges.ErrorParts`:
    the variance of one is the sum of both (ISO/IEC Guide 98-3, 5.1.2), and the readings of the
    channel are correlated.
    """
    found.readings = [
        replace(row, value=row.value - (zeros[row.channel].value or 0.0))
        if row.value is not None and row.channel in zeros
        else row
        for row in found.readings
    ]
    channels = dict.fromkeys(row.channel for row in found.readings if row.channel in zeros)
    found.zeros = {name: zeros[name] for name in channels}
    if channels:
        names = named_channels(list(channels))
        found.notes.append(
            f"The readings of {names} are differences from a measured zero (rezero): their "
            "standard deviation is the root of the sum of the squares of both. All readings of a "
            "channel share the error of its zero, and count as correlated."
        )


def _leave_out_early(found: Assigned, calendar: Calendar) -> None:
    """Leave out dated readings of the time before the zero of their channel."""
    early = [
        r
        for r in found.readings
        if r.time is not None
        and (r.stage in ("", VIRGIN) or calendar.before_zero(r.channel, r.stage))
    ]
    left_out = {id(reading) for reading in early}
    found.readings = [r for r in found.readings if id(r) not in left_out]
    before: dict[str, list[tuple[str, int]]] = {}
    for channel, number in Counter(reading.channel for reading in early).items():
        zero = calendar.zeros.get(channel, VIRGIN)
        since = calendar.dates.get(zero if zero != VIRGIN else "", None)
        when = f" ({date_text(since)})" if since is not None else ""
        what = f"its zero at the end of '{zero}'{when}" if zero != VIRGIN else "the first stage"
        before.setdefault(what, []).append((channel, number))
    for what, counted in before.items():
        number = sum(count for _, count in counted)
        names = named_channels([channel for channel, _ in counted])
        readings = "reading" if number == 1 else "readings"
        found.notes.append(f"{number} {readings} of {names} before {what} left out.")
