"""Readings against the case that they belong to."""

from __future__ import annotations

from collections.abc import Iterable

from geoident.errors import Fault, Location
from geoident.io.case_gauges import channel_names
from geoident.io.case_schema import CaseSection
from geoident.io.faults import Faults
from geoident.io.readings_file import PlacedReading
from geoident.io.wording import listing
from geoident.model.case import VIRGIN, KeyPath, format_path
from geoident.model.gauges import Reading


def inline_readings(section: CaseSection, faults: Faults) -> tuple[PlacedReading, ...]:
    """The readings that are written in the case itself."""
    found = []
    given = section.readings
    for n, entry in enumerate(given if isinstance(given, list) else ()):
        path: KeyPath = ("readings", n)
        reading = Reading(
            entry.gauge,
            entry.stage,
            entry.value.factor if entry.value else None,
            entry.accuracy.factor if entry.accuracy else None,
            faults.places.locate((*path, "gauge")),
        )
        found.append(PlacedReading(reading, faults.places.locate((*path, "stage")), path))
    return tuple(found)


def check_readings(section: CaseSection, readings: Iterable[PlacedReading], faults: Faults) -> None:
    """Note readings of unknown gauges or stages, before the zero of a gauge, or given twice."""
    check = _Check(section, faults)
    for placed in readings:
        check.gauge(placed)
        check.stage(placed)
        check.twice(placed)


class _Check:
    """What readings are held against.

    ``zeros`` maps channels to the stage where they are zero, ``order`` stages to their order.
    """

    def __init__(self, section: CaseSection, faults: Faults) -> None:
        self.section = section
        self.faults = faults
        self.zeros = channel_names(section)
        stages = (VIRGIN, *(stage.name for stage in section.stages))
        self.order = {name: n for n, name in enumerate(stages)}
        self.seen: dict[tuple[str, str], PlacedReading] = {}

    def gauge(self, placed: PlacedReading) -> None:
        """The gauge exists."""
        name = placed.reading.channel
        if name in self.zeros:
            return
        gauge = self.section.gauges.get(name)
        if gauge is not None and gauge.kind == "extensometer":
            anchors = listing(f"{name}.{anchor}" for anchor in gauge.anchors)
            hint = f"An extensometer has one reading per anchor: {anchors}."
        else:
            hint = self.faults.did_you_mean(name, self.zeros, what="Gauges")
        self._refuse(placed, "unknown-gauge", f"there is no gauge '{name}' to read", hint)

    def stage(self, placed: PlacedReading) -> None:
        """The stage exists, and is not before the zero of the gauge."""
        name = placed.reading.stage
        zero = self.zeros.get(placed.reading.channel, VIRGIN)
        if name == VIRGIN:
            message = f"nothing can be read in the state '{VIRGIN}', before the first stage"
            code, hint = "unknown-stage", "Readings stand at the end of stages."
        elif name not in self.order:
            message, code = f"there is no stage '{name}'", "unknown-stage"
            hint = self.faults.did_you_mean(name, list(self.order)[1:], what="Stages")
        elif self.order[name] < self.order.get(zero, 0):
            message = f"'{placed.reading.channel}' is read at '{name}', before its zero at '{zero}'"
            code, hint = "before-zero", "Correct the stage of the reading or the gauge's 'zero'."
        else:
            return
        self._refuse(placed, code, message, hint, key="stage")

    def twice(self, placed: PlacedReading) -> None:
        """No channel is read twice at a stage."""
        reading = placed.reading
        first = self.seen.setdefault((reading.channel, reading.stage), placed)
        if first is not placed:
            message = f"a second reading of '{reading.channel}' at '{reading.stage}', "
            message += f"first at {first.reading.location}"
            self._refuse(placed, "duplicate-reading", message, "Keep one of them.")

    def _refuse(
        self, placed: PlacedReading, code: str, message: str, hint: str, *, key: str = "gauge"
    ) -> None:
        location: Location = placed.reading.location
        if key == "stage":
            location = placed.stage_location
        path = format_path((*placed.path, key)) if placed.path else ""
        self.faults.extend([Fault(code, message, hint, location, path)])
