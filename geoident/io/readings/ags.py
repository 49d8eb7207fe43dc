"""Readings from the monitoring groups of AGS4 files (MONG, MOND), by the python-ags4 library.

Which rows belong to which channel is declared in the case by the values of headings, since a file
of a site has many instruments:

    channels: {EX1.a5: {LOCA_ID: BH7, MONG_ID: EXT1, MONG_DIS: "5.00", sign: -1}}

MOND_DTIM gives the date in the format that the file's UNIT row declares, MOND_RDNG the value and
MOND_UNIT its unit.
"""

from __future__ import annotations

import csv
import io
from collections.abc import Mapping
from typing import Any

from geoident.errors import Fault, InputError, Location
from geoident.io.readings.table import (
    ENCODING_HINT,
    Cell,
    FaultyReadings,
    Layout,
    Origin,
    Table,
    UnitScale,
)
from geoident.io.text.dates import ISO, DateError, format_problem, read_date
from geoident.io.text.faults import shortened
from geoident.io.text.text_file import decode, read_bytes
from geoident.io.text.wording import did_you_mean, listing
from geoident.model.gauges import Reading
from geoident.units import UnitError, read_quantity

HEADINGS = ("LOCA_ID", "MONG_ID", "MONG_DIS", "MOND_TYPE", "MOND_REF", "MOND_INST")
_TELLING = ("LOCA_ID", "MONG_ID", "MONG_DIS", "MOND_TYPE")
"""Headings of which all rows of one channel have one value; where two rows have the same date and
time, the reference of the reading (MOND_REF) as well."""
MAX_BYTES = 200_000_000
_NEEDED = ("MOND_DTIM", "MOND_RDNG")
_INSTALL = 'Install the library that reads it: pip install "geoident[ags]".'


def read_ags(path: str, layout: Layout) -> tuple[Reading, ...]:
    """The readings of the declared channels in the file's group MOND.

    Raises:
        InputError: with all that is wrong in the file, or no library to read it.
    """
    data = read_bytes(path, limit=MAX_BYTES, what="AGS file")
    text = decode(data, path, encoding=layout.encoding, hint=ENCODING_HINT)
    groups = _groups(text, path)
    group = _monitoring(groups, path)
    table = Table(path, layout)
    if not layout.channels:
        hint = "Write channels: {CHANNEL: {MONG_ID: ...}}, with as many headings as it takes."
        table.refuse((0, 0), "no-channels", "which readings are whose is not declared", hint)
    missing = [name for name in _NEEDED if name not in group]
    if missing:
        table.refuse((0, 0), "bad-header", f"group MOND has no heading {listing(missing)}")
    readings: list[Reading] = []
    if not table.faults:
        reader = _Reader(table, group, groups.get("MONG", {}))
        reader.require_date_format()
    if not table.faults:
        for channel, origin in layout.channels.items():
            readings += reader.channel(channel, origin)
    if table.faults:
        raise FaultyReadings(shortened(table.faults), readings)
    return tuple(readings)


def _groups(text: str, path: str) -> Mapping[str, Any]:
    """All groups of a file: heading to its cells, those of UNIT and TYPE first."""
    try:
        from python_ags4 import AGS4  # noqa: PLC0415 - optional, and it brings pandas
    except ImportError:
        message = "AGS files cannot be read here"
        raise InputError([Fault("no-library", message, _INSTALL, Location(path))]) from None
    AGS4.logger.disabled = True  # what it says is said here
    lines = io.StringIO(text.replace("\r\n", "\n").replace("\r", "\n"))
    try:
        groups: Mapping[str, Any] = AGS4.AGS4_to_dict(lines, get_line_numbers=True)[0]
    except (AGS4.AGS4Error, csv.Error, LookupError, TypeError, ValueError) as error:
        message = f"not a readable AGS4 file: {error}"
        raise InputError([Fault("bad-ags", message, location=Location(path))]) from error
    return groups


def _monitoring(groups: Mapping[str, Any], path: str) -> Mapping[str, list[Any]]:
    if "MOND" in groups and len(groups["MOND"].get("HEADING", ())) > 0:
        group: Mapping[str, list[Any]] = groups["MOND"]
        return group
    message = "there is no group MOND, which holds monitoring readings"
    hint = f"Groups in the file: {listing(groups)}."
    raise InputError([Fault("no-readings", message, hint, Location(path))])


def _date_format(unit: str) -> str:
    """Our form of the date format in a UNIT row.

    >>> _date_format("yyyy-mm-ddThh:mm:ss"), _date_format("dd/mm/yyyy hh:mm")
    ('YYYY-MM-DD', 'DD/MM/YYYY hh:mm')
    """
    day, hours, rest = unit.strip().partition("hh")
    day = day.replace("yyyy", "YYYY").replace("dd", "DD").replace("mm", "MM")
    return ISO if day.startswith(ISO) or not day else day + hours + rest


class _Reader:
    """Rows of the group MOND on their way to readings.

    Args:
        table: the file.
        group: heading to cells.
        installed: the same of the group MONG, which lists the instruments; empty if there is none.
    """

    def __init__(
        self, table: Table, group: Mapping[str, list[Any]], installed: Mapping[str, list[Any]]
    ) -> None:
        self.table = table
        self.group = group
        self.installed = installed
        self.rows = [n for n, kind in enumerate(group["HEADING"]) if kind == "DATA"]
        units = [n for n, kind in enumerate(group["HEADING"]) if kind == "UNIT"]
        self.date_format = _date_format(group["MOND_DTIM"][units[0]]) if units else ISO

    def require_date_format(self) -> None:
        """Note a UNIT row that declares no date format."""
        problem = format_problem(self.date_format)
        if problem:
            message = (
                f"MOND_DTIM has no date format in the UNIT row, '{self.date_format}': {problem}"
            )
            self.table.refuse((0, 0), "bad-date-format", message)

    def channel(self, channel: str, origin: Origin) -> list[Reading]:
        """The readings of one channel."""
        unknown = [name for name in origin.fields if name not in self.group]
        if unknown:
            message = f"group MOND has no heading {listing(unknown)}, by which '{channel}' is found"
            self.table.refuse((0, 0), "bad-header", message)
            return []
        rows = [n for n in self.rows if self._matches(n, origin)]
        if not rows:
            self._refuse_nothing(channel, origin)
        elif self._refuse_several(channel, rows):
            return []
        found = (self._reading(n, channel, origin) for n in rows)
        return [reading for reading in found if reading is not None]

    def _refuse_several(self, channel: str, rows: list[int]) -> bool:
        """Note a channel whose rows are of several instruments, depths or types of readings."""
        times = [str(self.group["MOND_DTIM"][n]) for n in rows]
        telling = _TELLING if len(set(times)) == len(times) else (*_TELLING, "MOND_REF")
        for name in (name for name in telling if name in self.group):
            values = list(dict.fromkeys(str(self.group[name][n]).strip() for n in rows))
            if len(values) > 1:
                message = f"the rows of '{channel}' have several {name}: {listing(values)}"
                hint = f"Say which: channels: {{{channel}: {{{name}: '{values[0]}', ...}}}}."
                line = int(self.group["line_number"][rows[0]])
                self.table.refuse((line, 1), "ambiguous", message, hint)
                return True
        return False

    def _matches(self, n: int, origin: Origin) -> bool:
        return all(_same(self.group[name][n], value) for name, value in origin.fields.items())

    def _refuse_nothing(self, channel: str, origin: Origin) -> None:
        asked = ", ".join(f"{name} {value}" for name, value in origin.fields.items())
        hint = ""
        for name, value in origin.fields.items():
            known = sorted({str(self.group[name][n]) for n in self.rows})
            if not any(_same(each, value) for each in known):
                hint = did_you_mean(value, known, what=f"{name} in the file")
                if value in map(str, self.installed.get(name, ())):
                    hint = f"The group MONG has {name} {value}, but without readings here."
                break
        message = f"no row of group MOND has {asked} for '{channel}'"
        self.table.refuse((0, 0), "no-readings", message, hint)

    def _reading(self, n: int, channel: str, origin: Origin) -> Reading | None:
        line = int(self.group["line_number"][n])
        text = str(self.group["MOND_RDNG"][n]).strip()
        cell = Cell("" if text in self.table.layout.blank else text, 1)
        try:
            time = read_date(self.group["MOND_DTIM"][n], self.date_format)
        except DateError as error:
            hint = f"The UNIT row of the group declares '{self.date_format}'."
            self.table.refuse((line, 1), "bad-date", f"MOND_DTIM: {error}", hint)
            return None
        value = self.table.read_number(line, cell)
        dimension = self.table.layout.dimension(channel)
        scale = self._scale(n, line, origin, dimension) if value is not None else UnitScale()
        if (value is None and cell.text) or scale is None:
            return None
        here = Location(self.table.file, line, 1)
        known = None if value is None else scale.reading(value)
        note = str(self.group["MOND_REM"][n]).strip() if "MOND_REM" in self.group else ""
        return Reading(channel, "", known, location=here, time=time, when=here, note=note)

    def _scale(self, n: int, line: int, origin: Origin, dimension: str) -> UnitScale | None:
        """How a value becomes SI: by the unit of its row, or else by the declared one."""
        given = str(self.group.get("MOND_UNIT", {n: ""})[n]).strip()
        unit = given or origin.unit or ("" if origin.calibration else self.table.layout.unit)
        return self.table.scale(line, Cell(unit, 1), dimension, origin)


def _same(found: object, wanted: str) -> bool:
    """Equal texts, or equal numbers: 5.00 is 5."""
    text = str(found).strip()
    if text == wanted:
        return True
    try:
        return read_quantity(text) == read_quantity(wanted)
    except UnitError:
        return False
