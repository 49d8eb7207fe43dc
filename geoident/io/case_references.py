"""Names in a case that refer to something else in it: materials, stages, gauges, parameters."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

from geoident.errors import Fault, Location
from geoident.io.case_gauges import channel_names
from geoident.io.case_schema import CaseSection
from geoident.io.case_sequence import ABSENT, check_sequence
from geoident.io.case_ties import check_ties
from geoident.io.case_values import Given
from geoident.io.faults import Faults
from geoident.io.fit_schema import AxisSection
from geoident.io.readings_file import PlacedReading
from geoident.io.wording import did_you_mean, listing
from geoident.model.case import VIRGIN, KeyPath, format_path
from geoident.model.gauges import Reading
from geoident.units import with_article


def check_references(section: CaseSection, faults: Faults) -> None:
    """Note every name in the case that refers to nothing, and every impossible sequence."""
    check_ties(section, faults)
    _check_materials(section, faults)
    _check_stages(section, faults)
    _check_fit(section, faults)
    check_sequence(section, faults)


def _check_materials(section: CaseSection, faults: Faults) -> None:
    known = section.materials
    if ABSENT in known:
        message = f"'{ABSENT}' says that a group is not there; no material can have this name"
        faults.add(("materials", ABSENT), "reserved-name", message, "Rename it.", key=True)
    uses: list[tuple[KeyPath, str]] = [
        (("groups", group), name) for group, name in section.groups.items() if name != ABSENT
    ]
    for n, stage in enumerate(section.stages):
        for key, mapping in (("install", stage.install), ("change", stage.change)):
            uses += [(("stages", n, key, group), name) for group, name in mapping.items()]
    for path, name in uses:
        if name not in known:
            hint = did_you_mean(name, known, what="Materials")
            faults.add(path, "unknown-material", f"there is no material '{name}'", hint)


def _check_stages(section: CaseSection, faults: Faults) -> None:
    names = [stage.name for stage in section.stages]
    for n, name in enumerate(names):
        if name in names[:n]:
            first = format_path(("stages", names.index(name)))
            message = f"two stages are named '{name}', the first is {first}"
            faults.add(("stages", n, "name"), "duplicate-stage", message, "Rename one.")
    for name, gauge in section.gauges.items():
        if gauge.zero not in (VIRGIN, *names):
            path = ("gauges", name, "zero")
            _unknown_stage(path, gauge.zero, (VIRGIN, *names), faults)
    for n, name in enumerate(section.fit.stages or ()):
        if name not in names:
            _unknown_stage(("fit", "stages", n), name, names, faults)


def _unknown_stage(path: KeyPath, name: str, known: Sequence[str], faults: Faults) -> None:
    hint = did_you_mean(name, known, what="Stages")
    faults.add(path, "unknown-stage", f"there is no stage '{name}'", hint)


def _check_fit(section: CaseSection, faults: Faults) -> None:
    grid: dict[str, AxisSection] = getattr(section.fit.options("scan"), "grid", {})
    path: KeyPath = ("fit", "scan", "grid")
    if len(grid) > 2:
        message = f"found {len(grid)} axes; a scan has one or two"
        faults.add(path, "too-many-axes", message, "Remove some.", key=True)
    for name, axis in grid.items():
        parameter = section.parameters.get(name)
        if parameter is None:
            hint = did_you_mean(name, section.parameters, what="Parameters")
            message = f"there is no parameter '{name}'"
            faults.add((*path, name), "unknown-parameter", message, hint, key=True)
            continue
        for key, given in (("from", axis.start), ("to", axis.stop)):
            _check_dimension((*path, name, key), given, parameter.start, faults)
        if axis.start.factor == axis.stop.factor:
            message = f"the axis begins and ends at '{axis.stop.text}'"
            faults.add((*path, name, "to"), "zero-length", message, "Let them differ.")


def _check_dimension(path: KeyPath, given: Given, start: Given, faults: Faults) -> None:
    if given.dimension != start.dimension:
        message = f"'{given.text}' is {with_article(given.dimension)}; "
        message += f"{with_article(start.dimension)} is expected, as for the start '{start.text}'"
        faults.add(path, "unit", message)


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
    zeros = channel_names(section)
    order = {name: n for n, name in enumerate((VIRGIN, *(s.name for s in section.stages)))}
    seen: dict[tuple[str, str], Location] = {}
    for placed in readings:
        reading = placed.reading
        if reading.channel not in zeros:
            faults.extend([_unknown_gauge(section, placed, zeros)])
        if reading.stage not in order or reading.stage == VIRGIN:
            faults.extend([_unknown_reading_stage(placed, list(order)[1:])])
        elif order[reading.stage] < order.get(zeros.get(reading.channel, VIRGIN), 0):
            faults.extend([_before_zero(placed, zeros[reading.channel])])
        first = seen.setdefault((reading.channel, reading.stage), reading.location)
        if first != reading.location:
            message = f"a second reading of '{reading.channel}' at '{reading.stage}', "
            hint = "Keep one of them."
            faults.extend([_fault(placed, "duplicate-reading", f"{message}first at {first}", hint)])


def _fault(
    placed: PlacedReading, code: str, message: str, hint: str, *, key: str = "gauge"
) -> Fault:
    location = placed.stage_location if key == "stage" else placed.reading.location
    path = format_path((*placed.path, key)) if placed.path else ""
    return Fault(code, message, hint, location, path)


def _unknown_gauge(section: CaseSection, placed: PlacedReading, known: Iterable[str]) -> Fault:
    name = placed.reading.channel
    hint = did_you_mean(name, known, what="Gauges")
    if name in section.gauges:
        anchors = [channel for channel in known if channel.startswith(f"{name}.")]
        hint = f"An extensometer has one reading per anchor: {listing(anchors)}."
    return _fault(placed, "unknown-gauge", f"there is no gauge '{name}' to read", hint)


def _unknown_reading_stage(placed: PlacedReading, known: Sequence[str]) -> Fault:
    name = placed.reading.stage
    if name == VIRGIN:
        message = f"nothing can be read in the state '{VIRGIN}', before the first stage"
        hint = "Readings stand at the end of stages."
        return _fault(placed, "unknown-stage", message, hint, key="stage")
    hint = did_you_mean(name, known, what="Stages")
    return _fault(placed, "unknown-stage", f"there is no stage '{name}'", hint, key="stage")


def _before_zero(placed: PlacedReading, zero: str) -> Fault:
    reading = placed.reading
    message = f"'{reading.channel}' is read at '{reading.stage}', before its zero at '{zero}'"
    hint = "Correct the stage of the reading or the 'zero' of the gauge."
    return _fault(placed, "before-zero", message, hint, key="stage")
