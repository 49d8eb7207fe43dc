"""The calendar of a case: its stages, their dates, and what its channels read since when."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property

from geoident.io.case.case import CaseSection
from geoident.io.text.dates import date_text, read_date
from geoident.io.text.faults import Faults
from geoident.model.case import VIRGIN
from geoident.model.gauges import Channel


@dataclass(frozen=True)
class Calendar:
    """The stages of a case in their order, their dates, and when channels are zero.

    Args:
        stages: names, the virgin state first.
        dates: stage to seconds since 1970, for those that have a date, increasing.
        channels: by name.
    """

    stages: tuple[str, ...]
    dates: Mapping[str, float]
    channels: Mapping[str, Channel]

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

    def stage_at(self, time: float) -> str:
        """The last stage that was complete at a time; the virgin state before all."""
        done = [s for s in self.stages if s in self.dates and self.dates[s] <= time]
        return done[-1] if done else VIRGIN

    def before_zero(self, channel: str, stage: str) -> bool:
        """Whether a stage comes before the zero of a channel."""
        order = self.stages.index
        zero = self.zeros.get(channel, VIRGIN)
        return stage in self.stages and zero in self.stages and order(stage) < order(zero)


def calendar_of(section: CaseSection, channels: Sequence[Channel], faults: Faults) -> Calendar:
    """The stages and dates of a case.

    Args:
        section: the case.
        channels: of all its gauges.
        faults: is told of dates of no stage, and of those earlier than one before.
    """
    stages = (VIRGIN, *(stage.name for stage in section.stages))
    dates: dict[str, float] = {}
    for name, text in section.dates.items():
        if name in stages:
            dates[name] = read_date(text)
        else:
            faults.add_unknown(("dates", name), "stage", name, stages, key=True)
    if section.service_stage is not None and section.service_since is not None:
        dates.setdefault(section.service_stage, read_date(section.service_since))
    before: str | None = None
    for name in (stage for stage in stages if stage in dates):
        if before is not None and dates[name] < dates[before]:
            message = f"'{name}' ends before '{before}' ({date_text(dates[before])})"
            faults.add(("dates", name), "dates-order", message, "Correct one of the dates.")
        before = name
    return Calendar(stages, dates, {channel.name: channel for channel in channels})
