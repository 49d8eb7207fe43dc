"""What the readings of a case are held against: its gauges, stages and zeros, and each other."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence

from geoident.errors import Fault, Location
from geoident.io.case.case import CaseSection
from geoident.io.case.site_files.calendar import Calendar
from geoident.io.case.site_files.file import ReadingsFileSection
from geoident.io.schema.values import CaseNumber
from geoident.io.text.dates import date_text
from geoident.io.text.faults import Faults
from geoident.io.text.wording import listing
from geoident.model.case import VIRGIN, KeyPath, format_path
from geoident.model.gauges import DAY, Reading, named_channels
from geoident.model.moments import time_text
from geoident.units import with_article

_DIFFERENT = 4
"""So many different values of two channels are not the same by chance."""


class ReadingChecks:
    """Holds readings against their case; what is wrong with them is noted.

    Args:
        section: the case.
        calendar: its stages and dates.
        faults: is told what is wrong.

    Attributes:
        order: stage to its number, 0 for the virgin state.
        seen: channel and stage to the first reading of them.
        hints: kind (gauge or stage) and unknown name to what to write in its place.
    """

    def __init__(self, section: CaseSection, calendar: Calendar, faults: Faults) -> None:
        self.section = section
        self.calendar = calendar
        self.faults = faults
        self.order = {name: n for n, name in enumerate(calendar.stages)}
        self.seen: dict[tuple[str, str], Reading] = {}
        self.hints: dict[tuple[str, str], str] = {}

    def all(self, readings: Iterable[Reading], *, alone: bool) -> None:
        """Note readings of unknown gauges or stages, before the zero of a gauge, or given twice."""
        for reading in readings:
            self._gauge(reading)
            self._stage(reading)
            known = (
                reading.channel in self.calendar.zeros and (reading.stage or VIRGIN) in self.order
            )
            if known and not reading.bad:
                self._twice(reading, alone=alone)

    def mapped(self, described: ReadingsFileSection, path: KeyPath) -> None:
        """The channels that a file is said to hold exist, and read what calibrations give."""
        if described.layout == "coordinates":
            return  # it has points, see `surveyed`
        for name, origin in described.channels.items():
            calibration = None if isinstance(origin, str) else origin.calibration
            wanted = self.calendar.dimensions.get(name)
            if calibration is not None and wanted not in {None, calibration.dimension}:
                message = f"the calibration gives {with_article(calibration.dimension)}, "
                message += f"'{name}' reads {with_article(str(wanted))}"
                place = (*path, "channels", name, "calibration")
                self.faults.add(place, "unit", message, "Correct its units, or the channel.")
            if name not in self.calendar.zeros:
                hint = self.faults.did_you_mean(name, self.calendar.zeros, what="Gauges")
                place = (*path, "channels", name)
                message = f"there is no gauge '{name}' to read"
                self.faults.add(place, "unknown-gauge", message, hint, key=True)

    def after_the_end(self, readings: Iterable[Reading]) -> None:
        """No reading is later than the end of a last stage that lasts; of a file one fault."""
        last = self.calendar.last
        if last is None:
            return
        end = self.calendar.timetable.dates[last]
        late = [
            row for row in readings if row.time is not None and not row.stage and row.time > end
        ]
        if not late:
            return
        first, times = late[0], [row.time or 0.0 for row in late]
        more = f", and {len(late) - 1} more" if len(late) > 1 else ""
        message = (
            f"'{first.channel}' was read on {date_text(times[0])}{more}, after the end of the "
        )
        message += f"last stage, '{last}' ({date_text(end)})"
        begin = self.calendar.timetable.begin(last) or end
        needed = time_text(math.ceil((max(times) - begin) / DAY) * DAY)
        hint = f"Let it last until then (lasts: {needed}, or its date), or add a stage."
        self._refuse(first, "after-stage", message, hint, key="stage")

    def zeroed(self, readings: Iterable[Reading]) -> None:
        """Every channel has a reading at its zero, if that is to be subtracted."""
        for reading in readings:
            zero = self.calendar.zeros.get(reading.channel, VIRGIN)
            since = (
                f" ({date_text(self.calendar.dates[zero])})" if zero in self.calendar.dates else ""
            )
            message = f"'{reading.channel}' was not read at its zero, '{zero}'{since}"
            hint = "Correct the gauge's 'zero' or the dates, or leave out 'rezero'."
            self._refuse(reading, "no-zero-reading", message, hint)

    def begun_with_zero(self, readings: Sequence[Reading]) -> list[str]:
        """A sentence on channels whose first reading is 0 at a stage that is not their zero."""
        first: dict[str, Reading] = {}
        for reading in readings:
            if reading.value is None or reading.bad or reading.stage not in self.order:
                continue
            known = first.get(reading.channel)
            if known is None or self.order[reading.stage] < self.order[known.stage]:
                first[reading.channel] = reading
        later = {r.channel for r in readings if r.value}
        begun: dict[tuple[str, str], list[str]] = {}
        for name, reading in first.items():
            zero = self.calendar.zeroed.get(name)
            if reading.value == 0.0 and name in later and zero not in (None, reading.stage):
                begun.setdefault((reading.stage, str(zero)), []).append(name)
        return [
            f"The first reading of {named_channels(names)}, at '{stage}', is 0. It is used as a "
            f"reading: no motion since the zero at '{zero}'. If it is the zero reading itself, "
            f"write 'zero: {stage}' at the gauge; if nothing was read then, leave its value empty."
            for (stage, zero), names in begun.items()
        ]

    def copies(self, readings: Sequence[Reading]) -> list[str]:
        """A sentence on channels that have the same readings, as when a column was copied."""
        own: dict[str, dict[tuple[str, float | None], float]] = {}
        for reading in readings:
            if reading.value is not None and not reading.bad:
                own.setdefault(reading.channel, {})[reading.stage, reading.time] = reading.value
        alike: dict[tuple[object, ...], list[str]] = {}
        for channel, values in own.items():
            if len(set(values.values())) >= _DIFFERENT:
                alike.setdefault(tuple(sorted(values.items(), key=str)), []).append(channel)
        return [
            f"{named_channels(names)} have the same {len(values)} readings, and count as "
            "independent of each other. If one is a copy, take it out of the readings."
            for values, names in alike.items()
            if len(names) > 1
        ]

    def drifts(self, readings: Sequence[Reading]) -> list[str]:
        """What is to be known of gauges that drift in time at stages without a date.

        Without the date of its zero nothing of such a gauge can be computed, with readings or
        without: a fault. So is a reading whose time is not known. At other stages without a date
        it is not computed.
        """
        notes: dict[str, dict[str, None]] = {}
        refused: set[tuple[KeyPath, str]] = set()
        read: dict[str, list[Reading]] = {}
        for reading in readings:
            read.setdefault(reading.channel, []).append(reading)
        for channel in self.calendar.channels.values():
            if channel.drift is None:
                continue
            gauge, zero = channel.gauge, channel.zero
            own = ("distortions",) if channel.probe == "distortions" else ()
            own_readings = [r for r in read.get(channel.name, ()) if r.value is not None]
            needed = {zero, *(r.stage or VIRGIN for r in own_readings if r.time is None)}
            unknown = set() if self.calendar.is_timed else needed - self.calendar.dates.keys()
            for stage in sorted(unknown):
                path: KeyPath = ("gauges", gauge, *own, "drift")
                if (path, stage) in refused:
                    continue
                refused.add((path, stage))
                message = f"'{gauge}' drifts in time, but the stage '{stage}' has no date"
                hint = f"Add it: dates: {{{stage}: 2024-03-01}}; or use drift_per_stage."
                self.faults.add(path, "missing-dates", message, hint)
            known = {*self.calendar.dates, *needed, *(r.stage for r in own_readings)}
            for stage, n in self.order.items():
                timed = stage in known or self.calendar.is_timed
                if not timed and n > self.order.get(zero, 0):
                    notes.setdefault(gauge, {})[stage] = None
        return [
            f"'{gauge}' drifts in time and is not computed at stages without a date: "
            + listing(map(repr, stages))
            for gauge, stages in notes.items()
        ]

    def lasting(self) -> None:
        """A time over which the model error is correlated needs the dates of all stages."""
        given = self.section.fit.model_error
        if isinstance(given, CaseNumber) or given is None or given.time is None:
            return
        missing = [name for name in self.calendar.stages[1:] if name not in self.calendar.dates]
        if missing and not self.calendar.is_timed:
            message = f"the stage '{missing[0]}' has no date"
            hint = f"Add it: dates: {{{missing[0]}: 2024-03-01}}; or leave out 'time'."
            self.faults.add(("fit", "model_error", "time"), "missing-dates", message, hint)

    def bad(self) -> None:
        """The gauges and stages that are said to be bad exist."""
        gauges = {*self.calendar.zeros, *self.section.gauges}
        for n, entry in enumerate(self.section.bad):
            if entry.gauge not in gauges:
                self.faults.add_unknown(("bad", n, "gauge"), "gauge", entry.gauge, gauges)
            if entry.stage is not None and entry.stage not in self.order:
                stages = self.calendar.timetable.stages[1:]
                self.faults.add_unknown(("bad", n, "stage"), "stage", entry.stage, stages)

    def _gauge(self, placed: Reading) -> None:
        name = placed.channel
        if name in self.calendar.zeros:
            return
        hint = self.hints.get(("gauge", name))
        if hint is None:
            hint = self.hints["gauge", name] = self._gauge_hint(name)
        self._refuse(placed, "unknown-gauge", f"there is no gauge '{name}' to read", hint)

    def _gauge_hint(self, name: str) -> str:
        """What to write in place of the name of a gauge that there is not."""
        channels = [c.name for c in self.calendar.channels.values() if c.gauge == name]
        if channels:
            return f"It has one reading for each of its channels: {listing(channels)}."
        return self.faults.did_you_mean(name, self.calendar.zeros, what="Gauges")

    def _stage(self, placed: Reading) -> None:
        """The stage exists, and is not before the zero of the gauge."""
        name = placed.stage or VIRGIN
        zero = self.calendar.zeros.get(placed.channel, VIRGIN)
        if name == VIRGIN:
            message = f"nothing can be read in the state '{VIRGIN}', before the first stage"
            code, hint = "unknown-stage", "Readings belong to the end of stages."
        elif name not in self.order:
            message, code = f"there is no stage '{name}'", "unknown-stage"
            hint = self.hints.get(("stage", name), "")
            if not hint:
                known = self.calendar.timetable.stages[1:]
                hint = self.faults.did_you_mean(name, known, what="Stages")
                if self.section.service_stage is not None:
                    hint = "Readings of a structure in service have dates: name the column 'date'."
                self.hints["stage", name] = hint
        elif self.order[name] < self.order.get(zero, 0):
            message = f"'{placed.channel}' is read at '{name}', before its zero at '{zero}'"
            code, hint = "before-zero", "Correct the stage of the reading or the gauge's 'zero'."
        else:
            return
        self._refuse(placed, code, message, hint, key="stage")

    def _twice(self, placed: Reading, *, alone: bool) -> None:
        """No channel is read twice at a stage, unless one file says what that means."""
        first = self.seen.setdefault((placed.channel, placed.stage), placed)
        same_file = first.location.file == placed.location.file
        in_time = placed.stage == self.section.service_stage
        if first is placed or in_time or (same_file and not alone):
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
