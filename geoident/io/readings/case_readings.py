"""The readings of a case, from wherever it says they are, held against the case."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field

from geoident.errors import Fault, InputError, Location
from geoident.io.case.case import CaseSection
from geoident.io.case.gauges import channel_names
from geoident.io.readings.ags import read_ags
from geoident.io.readings.file import read_readings
from geoident.io.readings.layout import FieldReading
from geoident.io.readings.schema import ReadingSection, ReadingsFileSection, entries
from geoident.io.readings.stages import Calendar, assign
from geoident.io.text.dates import date_text, read_date
from geoident.io.text.faults import Faults
from geoident.io.text.wording import listing
from geoident.model.case import VIRGIN, KeyPath, format_path
from geoident.model.gauges import Reading

Find = Callable[[str, KeyPath], str]
"""Path of a file that the case names at a key; notes a fault if it is not there."""


@dataclass(frozen=True)
class ReadReadings:
    """The readings of a case.

    Args:
        readings: in the order of the files.
        paths: of the files.
        dates: stage to the date of its end, seconds since 1970.
        notes: what is to be known of how they were understood.
    """

    readings: tuple[Reading, ...] = ()
    paths: tuple[str, ...] = ()
    dates: Mapping[str, float] = field(default_factory=dict)
    notes: tuple[str, ...] = ()


def read_all(section: CaseSection, find: Find, faults: Faults) -> ReadReadings:
    """Read what the case gives as readings; what is wrong in it is noted.

    Args:
        section: the whole case as it is written.
        find: leads from a path in the case to a file.
        faults: takes what is wrong.
    """
    calendar = _calendar(section, faults)
    paths: list[str] = []
    notes: list[str] = []
    check = _Check(section, calendar, faults)
    found: list[FieldReading] = []
    for path, entry in entries(section.readings):
        if isinstance(entry, ReadingSection):
            batch, alone = [_inline(entry, path, faults)], True
        else:
            batch, alone = _of_file(entry, path, (find, calendar, check), paths, notes)
        check.all(batch, alone=alone)
        found += batch
    check.bad()
    readings = tuple(_reading(section, reading) for reading in found)
    return ReadReadings(readings, tuple(paths), calendar.dates, tuple(notes))


def _calendar(section: CaseSection, faults: Faults) -> Calendar:
    """Stages and dates, of which every one is later than those before."""
    stages = (VIRGIN, *(stage.name for stage in section.stages))
    dates: dict[str, float] = {}
    for name, text in section.dates.items():
        if name in stages:
            dates[name] = read_date(text)
        else:
            hint = faults.did_you_mean(name, stages, what="Stages")
            message = f"there is no stage '{name}'"
            faults.add(("dates", name), "unknown-stage", message, hint, key=True)
    before: str | None = None
    for name in (stage for stage in stages if stage in dates):
        if before is not None and dates[name] < dates[before]:
            message = f"'{name}' ends before '{before}' ({date_text(dates[before])})"
            faults.add(("dates", name), "dates-order", message, "Correct one of the dates.")
        before = name
    return Calendar(stages, dates, channel_names(section.gauges))


def _inline(entry: ReadingSection, path: KeyPath, faults: Faults) -> FieldReading:
    return FieldReading(
        channel=entry.gauge,
        stage=entry.stage,
        time=None,
        value=entry.value.factor if entry.value else None,
        accuracy=entry.accuracy.factor if entry.accuracy else None,
        bad="",
        location=faults.places.locate((*path, "gauge")),
        when=faults.places.locate((*path, "stage")),
        path=path,
    )


def _of_file(
    entry: str | ReadingsFileSection,
    path: KeyPath,
    tools: tuple[Find, Calendar, _Check],
    paths: list[str],
    notes: list[str],
) -> tuple[list[FieldReading], bool]:
    """The readings of a file, each with its stage, and whether one a stage is expected."""
    find, calendar, check = tools
    described = ReadingsFileSection(file=entry) if isinstance(entry, str) else entry
    before = len(check.faults.found)
    key = path if isinstance(entry, str) else (*path, "file")
    paths.append(find(described.file, key))
    if len(check.faults.found) > before:
        return [], True
    try:
        layout = described.described()
        rows = read_ags(paths[-1], layout) if described.is_ags else read_readings(paths[-1], layout)
    except InputError as error:
        check.faults.extend(error.faults)
        return [], True
    check.mapped(described, path)
    dated = any(row.time is not None for row in rows)
    if dated and not calendar.dates:
        message = f"the readings of '{described.file}' have dates, but the stages have none"
        hint = "Write dates: {STAGE: 2024-03-01, ...}, the day at which each was complete."
        check.faults.add(key, "missing-dates", message, hint)
        return [], True
    several = described.several or ("last" if dated else "")
    assigned = assign(rows, calendar, several=several, rezero=described.rezero)
    notes += assigned.notes
    check.zeroed(assigned.unzeroed)
    return assigned.readings, not several


def _reading(section: CaseSection, row: FieldReading) -> Reading:
    """For the model; a mean of n readings has the accuracy of one divided by sqrt(n)."""
    accuracy = row.accuracy
    gauge = section.gauges.get(row.channel) or section.gauges.get(row.channel.rpartition(".")[0])
    if row.count > 1 and accuracy is None and gauge is not None:
        accuracy = gauge.accuracy.factor / math.sqrt(row.count)
    bad = row.bad or _bad_reason(section, row)
    stage = row.stage or VIRGIN
    return Reading(row.channel, stage, row.value, accuracy, row.location, row.time, bad)


def _bad_reason(section: CaseSection, row: FieldReading) -> str:
    for entry in section.bad:
        whole_gauge = row.channel.startswith(f"{entry.gauge}.")
        if entry.stage in {None, row.stage} and (entry.gauge == row.channel or whole_gauge):
            return entry.reason
    return ""


class _Check:
    """What readings are held against.

    ``zeros`` maps channels to the stage where they are zero, ``order`` stages to their order.
    """

    def __init__(self, section: CaseSection, calendar: Calendar, faults: Faults) -> None:
        self.section = section
        self.faults = faults
        self.zeros = calendar.zeros
        self.dates = calendar.dates
        self.order = {name: n for n, name in enumerate(calendar.stages)}
        self.seen: dict[tuple[str, str | None], FieldReading] = {}
        self.undated: set[tuple[str, str]] = set()

    def all(self, readings: Iterable[FieldReading], *, alone: bool) -> None:
        """Note readings of unknown gauges or stages, before the zero of a gauge, or given twice."""
        for reading in readings:
            self._gauge(reading)
            self._stage(reading)
            self._drift(reading)
            if not reading.bad:
                self._twice(reading, alone=alone)

    def mapped(self, described: ReadingsFileSection, path: KeyPath) -> None:
        """The channels that a file is said to hold exist."""
        for name in described.channels:
            if name not in self.zeros:
                hint = self.faults.did_you_mean(name, self.zeros, what="Gauges")
                place = (*path, "channels", name)
                message = f"there is no gauge '{name}' to read"
                self.faults.add(place, "unknown-gauge", message, hint, key=True)

    def zeroed(self, readings: Iterable[FieldReading]) -> None:
        """Every channel has a reading at its zero, if that is to be subtracted."""
        for reading in readings:
            zero = self.zeros.get(reading.channel, VIRGIN)
            since = f" ({date_text(self.dates[zero])})" if zero in self.dates else ""
            message = f"'{reading.channel}' was not read at its zero, '{zero}'{since}"
            hint = "Correct the gauge's 'zero' or the dates, or leave out 'rezero'."
            self._refuse(reading, "no-zero-reading", message, hint)

    def bad(self) -> None:
        """The gauges and stages that are said to be bad exist."""
        gauges = {*self.zeros, *self.section.gauges}
        for n, entry in enumerate(self.section.bad):
            if entry.gauge not in gauges:
                hint = self.faults.did_you_mean(entry.gauge, gauges, what="Gauges")
                message = f"there is no gauge '{entry.gauge}'"
                self.faults.add(("bad", n, "gauge"), "unknown-gauge", message, hint)
            if entry.stage is not None and entry.stage not in self.order:
                hint = self.faults.did_you_mean(entry.stage, list(self.order)[1:], what="Stages")
                message = f"there is no stage '{entry.stage}'"
                self.faults.add(("bad", n, "stage"), "unknown-stage", message, hint)

    def _gauge(self, placed: FieldReading) -> None:
        name = placed.channel
        if name in self.zeros:
            return
        gauge = self.section.gauges.get(name)
        if gauge is not None and gauge.kind == "extensometer":
            anchors = listing(f"{name}.{anchor}" for anchor in gauge.anchors)
            hint = f"An extensometer has one reading per anchor: {anchors}."
        else:
            hint = self.faults.did_you_mean(name, self.zeros, what="Gauges")
        self._refuse(placed, "unknown-gauge", f"there is no gauge '{name}' to read", hint)

    def _stage(self, placed: FieldReading) -> None:
        """The stage exists, and is not before the zero of the gauge."""
        name = placed.stage or VIRGIN
        zero = self.zeros.get(placed.channel, VIRGIN)
        if name == VIRGIN:
            message = f"nothing can be read in the state '{VIRGIN}', before the first stage"
            code, hint = "unknown-stage", "Readings stand at the end of stages."
        elif name not in self.order:
            message, code = f"there is no stage '{name}'", "unknown-stage"
            hint = self.faults.did_you_mean(name, list(self.order)[1:], what="Stages")
        elif self.order[name] < self.order.get(zero, 0):
            message = f"'{placed.channel}' is read at '{name}', before its zero at '{zero}'"
            code, hint = "before-zero", "Correct the stage of the reading or the gauge's 'zero'."
        else:
            return
        self._refuse(placed, code, message, hint, key="stage")

    def _drift(self, placed: FieldReading) -> None:
        """The times of a gauge that drifts are known."""
        gauge = placed.channel if placed.channel in self.section.gauges else ""
        gauge = gauge or placed.channel.rpartition(".")[0]
        if gauge not in self.section.gauges or self.section.gauges[gauge].drift is None:
            return
        needed = {self.zeros.get(placed.channel, VIRGIN)}
        needed |= {placed.stage or VIRGIN} if placed.time is None else set()
        for stage in sorted(needed - self.dates.keys()):
            if (gauge, stage) not in self.undated:
                self.undated.add((gauge, stage))
                message = f"'{gauge}' drifts in time, but the stage '{stage}' has no date"
                hint = f"Add it: dates: {{{stage}: 2024-03-01}}; or use drift_per_stage."
                self.faults.add(("gauges", gauge, "drift"), "missing-dates", message, hint)

    def _twice(self, placed: FieldReading, *, alone: bool) -> None:
        """No channel is read twice at a stage, unless one file says what that means."""
        first = self.seen.setdefault((placed.channel, placed.stage), placed)
        same_file = first.location.file == placed.location.file
        if first is placed or (same_file and not alone):
            return
        message = f"a second reading of '{placed.channel}' at '{placed.stage}', "
        message += f"first at {first.location}"
        self._refuse(placed, "duplicate-reading", message, "Keep one of them.")

    def _refuse(
        self, placed: FieldReading, code: str, message: str, hint: str, *, key: str = "gauge"
    ) -> None:
        location: Location = placed.when if key == "stage" else placed.location
        path = format_path((*placed.path, key)) if placed.path else ""
        self.faults.extend([Fault(code, message, hint, location, path)])
