"""The readings of a case: from wherever it says they are, to its stages, held against the case."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

from geoident.errors import Fault, InputError, Location
from geoident.io.case.case import CaseSection
from geoident.io.case.gauges.kinds import sections_of_channels
from geoident.io.case.readings import ReadingSection
from geoident.io.case.site_files.assignment import Calendar, assign
from geoident.io.case.site_files.dates import gaps, when_read
from geoident.io.case.site_files.file import ReadingsFileSection
from geoident.io.case.site_files.surveyed import surveyed
from geoident.io.readings.file import format_of
from geoident.io.readings.table import FaultyReadings, Layout
from geoident.io.text.dates import date_text, offset_text, read_date
from geoident.io.text.faults import Faults
from geoident.io.text.wording import listing
from geoident.model.case import VIRGIN, KeyPath, format_path
from geoident.model.gauges import Reading, StageReadings
from geoident.units import UnitError, read_quantity, require_dimension, with_article

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
        zeros: channel to the measured zero that was subtracted from its readings.
        by_stage: when the dated readings were taken, stage by stage.
    """

    readings: tuple[Reading, ...] = ()
    paths: tuple[str, ...] = ()
    dates: Mapping[str, float] = field(default_factory=dict)
    notes: tuple[str, ...] = ()
    zeros: Mapping[str, Reading] = field(default_factory=dict)
    by_stage: tuple[StageReadings, ...] = ()


def read_all(section: CaseSection, find: Find, faults: Faults) -> ReadReadings:
    """Read what the case gives as readings; what is wrong in it is noted.

    Args:
        section: the case.
        find: finds the files that it names.
        faults: is told what is wrong.
    """
    calendar = _calendar(section, faults)
    paths: list[str] = []
    notes: list[str] = []
    check = _Check(section, calendar, faults)
    found: list[Reading] = []
    for path, entry in _entries(section.readings):
        if isinstance(entry, ReadingSection):
            batch, alone = _inline(entry, path, calendar, faults), True
        else:
            batch, alone = _of_file(entry, path, (find, calendar, check), paths, notes)
        check.all(batch, alone=alone)
        found += batch
    check.bad()
    readings = tuple(replace(row, bad=row.bad or _bad_reason(section, row)) for row in found)
    by_stage = when_read(check.dated, calendar)
    if by_stage and not faults.found:
        notes += gaps(check.dated, by_stage, calendar, readings)
    return ReadReadings(
        readings, tuple(paths), calendar.dates, tuple(notes), check.measured_zeros, by_stage
    )


def _entries(readings: Any) -> list[tuple[KeyPath, Any]]:
    """What ``readings`` names, each with its path of keys: paths, files or single readings."""
    if readings is None:
        return []
    if isinstance(readings, list):
        return [(("readings", n), entry) for n, entry in enumerate(readings)]
    return [(("readings",), readings)]


def _calendar(section: CaseSection, faults: Faults) -> Calendar:
    """Stages and dates, of which every one is later than those before."""
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
                quantity = require_dimension(read_quantity(given.text), wanted, given.text)
                known[name] = quantity.value
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
    )
    return [reading]


def _of_file(
    entry: str | ReadingsFileSection,
    path: KeyPath,
    tools: tuple[Find, Calendar, _Check],
    paths: list[str],
    notes: list[str],
) -> tuple[list[Reading], bool]:
    """The readings of a file, each with its stage, and whether one a stage is expected."""
    find, calendar, check = tools
    described = ReadingsFileSection(file=entry) if isinstance(entry, str) else entry
    before = len(check.faults.found)
    key = path if isinstance(entry, str) else (*path, "file")
    found = [find(name, key) for name in described.paths]
    paths += found
    if len(check.faults.found) > before:
        return [], True
    survey = surveyed(described, check.section, check.faults, path)
    check.mapped(described, path)
    declared = len(check.faults.found)
    rows = _rows(found, described.described(calendar.dimensions, survey), check.faults, notes)
    if declared > before:
        return [], True
    sound = len(check.faults.found) == before
    dated = any(row.time is not None for row in rows)
    if dated and not calendar.dates:
        message = f"the readings of '{described.paths[0]}' have dates, but the stages have none"
        hint = "Write dates: {STAGE: 2024-03-01, ...}, the day at which each was complete."
        check.faults.add(key, "missing-dates", message, hint)
        return [], True
    several = described.several or ("last" if dated else "")
    check.dated += [
        row if row.stage else replace(row, stage=calendar.stage_at(row.time))
        for row in rows
        if row.time is not None and row.value is not None and not row.bad
    ]
    zero = "first" if survey is not None else several if described.rezero else ""
    assigned = assign(rows, calendar, several=several, zero=zero)
    notes += assigned.notes
    check.zeroed(assigned.unzeroed if sound else ())
    check.measured_zeros |= assigned.zeros
    return assigned.readings, not several


def _rows(
    paths: Sequence[str], layout: Layout, faults: Faults, notes: list[str]
) -> tuple[Reading, ...]:
    """The readings of files of one layout; what several of them repeat counts once."""
    rows: list[Reading] = []
    for path in paths:
        try:
            rows += format_of(path).read(path, layout)
        except FaultyReadings as error:
            faults.extend(error.faults)
            rows += error.rows
        except InputError as error:
            faults.extend(error.faults)
    rows = _on_one_clock(rows, notes)
    if len(paths) == 1:
        return tuple(rows)
    once: dict[tuple[object, ...], Reading] = {}
    # twice in one file it was read twice, which `several` or a fault deals with
    kept = [row for row in rows if _same_file(once.setdefault(_what_was_read(row), row), row)]
    why = {_what_was_read(row): row.bad for row in rows if row.bad}
    repeated = len(rows) - len(kept)
    if repeated:
        readings = "reading stands" if repeated == 1 else "readings stand"
        notes.append(f"{repeated} {readings} in several files alike, and count once.")
    return tuple(replace(row, bad=row.bad or why.get(_what_was_read(row), "")) for row in kept)


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


def _what_was_read(row: Reading) -> tuple[object, ...]:
    return row.channel, row.stage, row.time, row.value


def _same_file(one: Reading, other: Reading) -> bool:
    return one.location.file == other.location.file


def _bad_reason(section: CaseSection, row: Reading) -> str:
    for entry in section.bad:
        whole_gauge = row.channel.startswith(f"{entry.gauge}.")
        if entry.stage in {None, row.stage} and (entry.gauge == row.channel or whole_gauge):
            return entry.reason
    return ""


class _Check:
    """What readings are held against.

    ``zeros`` maps channels to the stage where they are zero, ``order`` stages to their order,
    ``owners`` channels to their gauges, ``measured_zeros`` channels to what was read at their zero
    and subtracted; ``hints`` what to write in place of a name that refers to nothing.
    """

    def __init__(self, section: CaseSection, calendar: Calendar, faults: Faults) -> None:
        self.section = section
        self.faults = faults
        self.zeros = calendar.zeros
        self.dimensions = calendar.dimensions
        self.dates = calendar.dates
        self.order = {name: n for n, name in enumerate(calendar.stages)}
        self.owners = {
            channel: name
            for name, gauge in section.gauges.items()
            for channel in gauge.channel_names(name)
        }
        self.seen: dict[tuple[str, str], Reading] = {}
        self.undated: set[tuple[str, str]] = set()
        self.hints: dict[tuple[str, str], str] = {}
        self.measured_zeros: dict[str, Reading] = {}
        self.dated: list[Reading] = []

    def all(self, readings: Iterable[Reading], *, alone: bool) -> None:
        """Note readings of unknown gauges or stages, before the zero of a gauge, or given twice."""
        for reading in readings:
            self._gauge(reading)
            self._stage(reading)
            self._drift(reading)
            known = reading.channel in self.zeros and (reading.stage or VIRGIN) in self.order
            if known and not reading.bad:
                self._twice(reading, alone=alone)

    def mapped(self, described: ReadingsFileSection, path: KeyPath) -> None:
        """The channels that a file is said to hold exist, and read what calibrations give."""
        if described.layout == "coordinates":
            return  # it has points, see `surveyed`
        for name, origin in described.channels.items():
            calibration = None if isinstance(origin, str) else origin.calibration
            wanted = self.dimensions.get(name)
            if calibration is not None and wanted not in {None, calibration.dimension}:
                message = f"the calibration gives {with_article(calibration.dimension)}, "
                message += f"'{name}' reads {with_article(str(wanted))}"
                place = (*path, "channels", name, "calibration")
                self.faults.add(place, "unit", message, "Correct its units, or the channel.")
            if name not in self.zeros:
                hint = self.faults.did_you_mean(name, self.zeros, what="Gauges")
                place = (*path, "channels", name)
                message = f"there is no gauge '{name}' to read"
                self.faults.add(place, "unknown-gauge", message, hint, key=True)

    def zeroed(self, readings: Iterable[Reading]) -> None:
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
                self.faults.add_unknown(("bad", n, "gauge"), "gauge", entry.gauge, gauges)
            if entry.stage is not None and entry.stage not in self.order:
                stages = list(self.order)[1:]
                self.faults.add_unknown(("bad", n, "stage"), "stage", entry.stage, stages)

    def _gauge(self, placed: Reading) -> None:
        name = placed.channel
        if name in self.zeros:
            return
        hint = self.hints.get(("gauge", name))
        if hint is None:
            hint = self.hints["gauge", name] = self._gauge_hint(name)
        self._refuse(placed, "unknown-gauge", f"there is no gauge '{name}' to read", hint)

    def _gauge_hint(self, name: str) -> str:
        """What to write in place of the name of a gauge that there is not."""
        gauge = self.section.gauges.get(name)
        if gauge is not None and gauge.kind == "extensometer":
            anchors = listing(f"{name}.{anchor}" for anchor in gauge.anchors)
            return f"An extensometer has one reading per anchor: {anchors}."
        if gauge is not None:
            channels = listing(gauge.channel_names(name))
            return f"It has readings of its own for each of its channels: {channels}."
        return self.faults.did_you_mean(name, self.zeros, what="Gauges")

    def _stage(self, placed: Reading) -> None:
        """The stage exists, and is not before the zero of the gauge."""
        name = placed.stage or VIRGIN
        zero = self.zeros.get(placed.channel, VIRGIN)
        if name == VIRGIN:
            message = f"nothing can be read in the state '{VIRGIN}', before the first stage"
            code, hint = "unknown-stage", "Readings stand at the end of stages."
        elif name not in self.order:
            message, code = f"there is no stage '{name}'", "unknown-stage"
            hint = self.hints.get(("stage", name), "")
            if not hint:
                hint = self.faults.did_you_mean(name, list(self.order)[1:], what="Stages")
                self.hints["stage", name] = hint
        elif self.order[name] < self.order.get(zero, 0):
            message = f"'{placed.channel}' is read at '{name}', before its zero at '{zero}'"
            code, hint = "before-zero", "Correct the stage of the reading or the gauge's 'zero'."
        else:
            return
        self._refuse(placed, code, message, hint, key="stage")

    def _drift(self, placed: Reading) -> None:
        """The times of a gauge that drifts are known."""
        gauge = self.owners.get(placed.channel, "")
        if not gauge or self.section.gauges[gauge].drift is None:
            return
        needed = {self.zeros.get(placed.channel, VIRGIN)}
        needed |= {placed.stage or VIRGIN} if placed.time is None else set()
        for stage in sorted(needed - self.dates.keys()):
            if (gauge, stage) not in self.undated:
                self.undated.add((gauge, stage))
                message = f"'{gauge}' drifts in time, but the stage '{stage}' has no date"
                hint = f"Add it: dates: {{{stage}: 2024-03-01}}; or use drift_per_stage."
                self.faults.add(("gauges", gauge, "drift"), "missing-dates", message, hint)

    def _twice(self, placed: Reading, *, alone: bool) -> None:
        """No channel is read twice at a stage, unless one file says what that means."""
        first = self.seen.setdefault((placed.channel, placed.stage), placed)
        same_file = first.location.file == placed.location.file
        if first is placed or (same_file and not alone):
            return
        message = f"a second reading of '{placed.channel}' at '{placed.stage}', "
        message += f"first at {first.location}"
        self._refuse(placed, "duplicate-reading", message, "Keep one of them.")

    def _refuse(
        self, placed: Reading, code: str, message: str, hint: str, *, key: str = "gauge"
    ) -> None:
        location: Location = placed.when if key == "stage" else placed.location
        path = format_path((*placed.key, key)) if placed.key else ""
        self.faults.extend([Fault(code, message, hint, location, path)])
