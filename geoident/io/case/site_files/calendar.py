"""The calendar of a case: its stages, their dates, and what its channels read since when."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property

from geoident.io.case.case import CaseSection
from geoident.io.case.gauges.gauge import GaugeBase
from geoident.io.case.gauges.kinds import sections_of_channels
from geoident.io.text.dates import date_text, read_date
from geoident.io.text.faults import Faults
from geoident.model.case import VIRGIN
from geoident.model.gauges import Reads


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
        changes = (name for name, g in self.channels.items() if g.reads is Reads.CHANGE)
        return {name: self.zeros[name] for name in changes}

    @cached_property
    def dimensions(self) -> dict[str, str]:
        """Channel to the dimension of its readings."""
        return {name: gauge.dimension for name, gauge in self.channels.items()}

    def stage_at(self, time: float) -> str:
        """The last stage that was complete at a time; the virgin state before all."""
        done = [s for s in self.stages if s in self.dates and self.dates[s] <= time]
        return done[-1] if done else VIRGIN

    def before_zero(self, channel: str, stage: str) -> bool:
        """Whether a stage comes before the zero of a channel."""
        order = self.stages.index
        zero = self.zeros.get(channel, VIRGIN)
        return stage in self.stages and zero in self.stages and order(stage) < order(zero)


def calendar_of(section: CaseSection, faults: Faults) -> Calendar:
    """The stages and dates of a case.

    Args:
        section: the case.
        faults: is told of dates of no stage, and of those earlier than one before.
    """
    stages = (VIRGIN, *(stage.name for stage in section.stages))
    dates: dict[str, float] = {}
    for name, text in section.dates.items():
        if name in stages:
            dates[name] = read_date(text)
        else:
            faults.add_unknown(("dates", name), "stage", name, stages, key=True)
    before: str | None = None
    for name in (stage for stage in stages if stage in dates):
        if before is not None and dates[name] < dates[before]:
            message = f"'{name}' ends before '{before}' ({date_text(dates[before])})"
            faults.add(("dates", name), "dates-order", message, "Correct one of the dates.")
        before = name
    return Calendar(stages, dates, sections_of_channels(section.gauges))
