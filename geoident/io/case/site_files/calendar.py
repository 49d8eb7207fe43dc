"""The calendar of a case: its stages, their dates, and what its channels read since when."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property

from geoident.io.case.case import CaseSection
from geoident.io.case.durations import Timetable
from geoident.model.case import VIRGIN
from geoident.model.gauges import Channel, Reading
from geoident.model.moments import chosen_moments, moment_name, usual_moments


@dataclass(frozen=True)
class Calendar:
    """The states of a case in their order, their dates, and when channels are zero.

    Args:
        timetable: when the stages begin and end.
        channels: by name.
        moments: stage that lasts to its moments, s since its beginning, before its end; none until
            the readings are known.
        independent: names of the stages that are load cases on the side.
    """

    timetable: Timetable
    channels: Mapping[str, Channel]
    moments: Mapping[str, Sequence[float]] = field(default_factory=dict)
    independent: frozenset[str] = frozenset()

    @cached_property
    def owners(self) -> dict[str, str]:
        """State to its stage, the virgin state first: the moments of a stage before its end."""
        return {
            state: stage
            for stage in self.timetable.stages
            for state in (*(moment_name(stage, t) for t in self.moments.get(stage, ())), stage)
        }

    @cached_property
    def stages(self) -> tuple[str, ...]:
        """Names of all states, the virgin state first: stages and their moments."""
        return tuple(self.owners)

    @cached_property
    def dates(self) -> dict[str, float]:
        """State to seconds since 1970, for those that have a date."""
        dates = dict(self.timetable.dates)
        for stage, times in self.moments.items():
            begin = self.timetable.begin(stage)
            if begin is not None:
                dates |= {moment_name(stage, time): begin + time for time in times}
        return dates

    @property
    def is_timed(self) -> bool:
        """Whether durations say when all states are, where no date does."""
        return bool(self.timetable.lasts) and not self.timetable.dates

    @cached_property
    def zeros(self) -> dict[str, str]:
        """Channel to the stage at whose end it reads zero."""
        return {name: channel.zero for name, channel in self.channels.items()}

    @cached_property
    def zeroed(self) -> dict[str, str]:
        """The same without channels that read a value: these have no zero."""
        return {name: c.zero for name, c in self.channels.items() if c.is_zeroed}

    @cached_property
    def dimensions(self) -> dict[str, str]:
        """Channel to the dimension of its readings."""
        return {name: channel.dimension for name, channel in self.channels.items()}

    @property
    def last(self) -> str | None:
        """The last stage, if it lasts and has a date: what is read later belongs to no stage."""
        last = [name for name in self.timetable.stages if name not in self.independent][-1]
        return last if last in self.timetable.lasts and last in self.timetable.dates else None

    def stage_at(self, time: float) -> str:
        """The state to which a reading at a time (seconds since 1970) belongs.

        The moment of the stage in which it is, if that lasts; else the last stage that was
        complete; the virgin state before all.
        """
        within = self.within(time)
        if within is not None:
            return self.moment_of(*within)
        dates = self.timetable.dates
        done = [s for s in self.timetable.stages if s in dates and dates[s] <= time]
        return done[-1] if done else VIRGIN

    def within(self, time: float) -> tuple[str, float] | None:
        """The stage that goes on at a date, and the time since its beginning; None for none."""
        for stage, begin, end in self._spans:
            if begin < time <= end:
                return stage, time - begin
        return None

    @cached_property
    def _spans(self) -> list[tuple[str, float, float]]:
        """Stages that last, with the dates of beginning and end."""
        spans = []
        for stage in self.timetable.lasts:
            begin = self.timetable.begin(stage)
            if begin is not None and stage not in self.independent:
                spans.append((stage, begin, self.timetable.dates[stage]))
        return spans

    def moment_of(self, stage: str, time: float) -> str:
        """The state of a stage that is nearest to a time since its beginning, s."""
        times = (*self.moments.get(stage, ()), self.timetable.lasts[stage])
        nearest = min(times, key=lambda one: abs(one - time))
        return self.timetable.name_of(stage, nearest)

    def before_zero(self, channel: str, stage: str) -> bool:
        """Whether a stage comes before the zero of a channel."""
        order = self.stages.index
        zero = self.zeros.get(channel, VIRGIN)
        return stage in self.owners and zero in self.owners and order(stage) < order(zero)

    def with_moments(
        self,
        section: CaseSection,
        readings: Iterable[Reading],
        named: Mapping[str, Sequence[float]],
    ) -> Calendar:
        """The same with the moments of its stages.

        Args:
            section: the case, whose stages may state moments.
            readings: of all files, with a date, or a stage and a time.
            named: stage to the times of moments that the case names, s since its beginning.
        """
        read: dict[str, list[float]] = {}
        for row in readings:
            at = None if row.time is None else self.within(row.time)
            if row.since is not None:
                at = row.stage, row.since
            if at is not None and at[0] in self.timetable.lasts:
                read.setdefault(at[0], []).append(at[1])
        moments, water = {}, _has(section, _WATER)
        conducts = section.initial_temperature is not None
        takes_time = water or conducts or _has(section, *_CREEP)
        for stage in section.stages:
            lasts = self.timetable.lasts.get(stage.name)
            if lasts is None:
                continue
            stated = None if stage.moments is None else [time.factor for time in stage.moments]
            fixed = [*named.get(stage.name, ()), *(stated or ())]
            usual = stated is None and takes_time
            shown = usual_moments(lasts, water=water) if usual else ()
            moments[stage.name] = chosen_moments(lasts, read.get(stage.name, ()), fixed, shown)
        return replace(self, moments=moments)


_WATER = "hydraulic"
"""Key of materials through which water flows in stages that last."""

_CREEP = ("creep", "ageing")
"""Keys of materials whose ground changes by itself in stages that last."""


def _has(section: CaseSection, *keys: str) -> bool:
    """Whether any material of a case has one of some keys."""
    materials = section.materials.values()
    return any(getattr(one, key) is not None for one in materials for key in keys)
