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
from collections.abc import Iterator, Mapping
from dataclasses import replace
from typing import Any

from geoident.errors import Fault, InputError, Location
from geoident.io.readings.layout import Layout, Origin
from geoident.io.readings.table import Table
from geoident.io.text.cells import Cell, Row
from geoident.io.text.dates import ISO, DateError, format_problem, read_date
from geoident.io.text.text_file import decode, read_bytes
from geoident.io.text.wording import did_you_mean, listing
from geoident.units import UnitError, read_quantity

HEADINGS = ("LOCA_ID", "MONG_ID", "MONG_DIS", "MOND_TYPE", "MOND_REF", "MOND_INST")
_TELLING = ("LOCA_ID", "MONG_ID", "MONG_DIS", "MOND_TYPE")
"""Headings of which all rows of one channel have one value; where two rows have the same date and
time, the reference of the reading (MOND_REF) as well."""
MAX_BYTES = 200_000_000
_COLUMNS = {"date": "MOND_DTIM", "value": "MOND_RDNG", "unit": "MOND_UNIT", "remarks": "MOND_REM"}
_Group = Mapping[str, Any]
"""Heading to its cells, those of UNIT and TYPE first."""


def ags_rows(table: Table) -> Iterator[Row]:
    """The rows of the file's group MOND that belong to declared channels, as a long table.

    Raises:
        InputError: it is no AGS4 file, or there is no library to read it.
    """
    data = read_bytes(table.file, limit=MAX_BYTES, what="AGS file")
    text = decode(data, table.file, encoding=table.layout.encoding, hint=table.layout.encoding_hint)
    groups = _groups(text, table.file)
    group, channels = groups.get("MOND", {}), table.layout.channels
    if not len(group.get("HEADING", ())):
        message = "there is no group MOND, which holds monitoring readings"
        hint = f"Groups in the file: {listing(groups)}."
        raise InputError([Fault("no-readings", message, hint, Location(table.file))])
    if not channels:
        hint = "Write channels: {CHANNEL: {MONG_ID: ...}}, with as many headings as it takes."
        table.refuse(0, 0, "no-channels", "which readings are whose is not declared", hint)
    missing = [name for name in ("MOND_DTIM", "MOND_RDNG") if name not in group]
    if missing:
        table.refuse(0, 0, "bad-header", f"group MOND has no heading {listing(missing)}")
    if table.faults:
        return
    units = [n for n, kind in enumerate(group["HEADING"]) if kind == "UNIT"]
    date_format = _date_format(group["MOND_DTIM"][units[0]]) if units else ISO
    if problem := format_problem(date_format):
        message = f"MOND_DTIM has no date format in the UNIT row, '{date_format}': {problem}"
        table.refuse(0, 0, "bad-date-format", message)
        return
    given = table.layout
    table.layout = Layout(
        decimal=given.decimal,
        unit=given.unit,
        date_format=date_format,
        channels={name: replace(origin, name="", fields={}) for name, origin in channels.items()},
        dimensions=given.dimensions,
        blank=given.blank,
    )
    columns = {key: name for key, name in _COLUMNS.items() if name in group}
    columns = columns if "unit" in columns else {**columns, "unit": ""}
    yield 0, [Cell(key, 1) for key in ("gauge", *columns)]
    for channel, origin in channels.items():
        for n in _rows_of(table, group, groups.get("MONG", {}), channel, origin):
            line = int(group["line_number"][n])
            cells = [str(group[name][n]).strip() if name else "" for name in columns.values()]
            try:
                read_date(cells[0], date_format)
            except DateError as error:
                hint = f"The UNIT row of the group declares '{date_format}'."
                table.refuse(line, 1, "bad-date", f"MOND_DTIM: {error}", hint)
                continue
            yield line, [Cell(cell, 1) for cell in (channel, *cells)]


def _groups(text: str, path: str) -> Mapping[str, _Group]:
    """All groups of a file."""
    try:
        from python_ags4 import AGS4  # noqa: PLC0415 - optional, and it brings pandas
    except ImportError:
        message = "AGS files cannot be read here"
        hint = 'Install the library that reads it: pip install "geoident[ags]".'
        raise InputError([Fault("no-library", message, hint, Location(path))]) from None
    AGS4.logger.disabled = True  # what it says is said here
    lines = io.StringIO(text.replace("\r\n", "\n").replace("\r", "\n"))
    try:
        groups: Mapping[str, _Group] = AGS4.AGS4_to_dict(lines, get_line_numbers=True)[0]
    except (AGS4.AGS4Error, csv.Error, LookupError, TypeError, ValueError) as error:
        message = f"not a readable AGS4 file: {error}"
        raise InputError([Fault("bad-ags", message, location=Location(path))]) from error
    return groups


def _date_format(unit: str) -> str:
    """Our form of the date format in a UNIT row.

    >>> _date_format("yyyy-mm-ddThh:mm:ss"), _date_format("dd/mm/yyyy hh:mm")
    ('YYYY-MM-DD', 'DD/MM/YYYY hh:mm')
    """
    day, hours, rest = unit.strip().partition("hh")
    day = day.replace("yyyy", "YYYY").replace("dd", "DD").replace("mm", "MM")
    return ISO if day.startswith(ISO) or not day else day + hours + rest


def _rows_of(
    table: Table, group: _Group, installed: _Group, channel: str, origin: Origin
) -> list[int]:
    """The rows of a channel; none, with a fault, where they are none or of several instruments.

    Args:
        table: the file.
        group: MOND.
        installed: MONG, which lists the instruments; empty if there is none.
        channel: its name.
        origin: what its rows must have.
    """
    unknown = [name for name in origin.fields if name not in group]
    if unknown:
        message = f"group MOND has no heading {listing(unknown)}, by which '{channel}' is found"
        table.refuse(0, 0, "bad-header", message)
        return []
    data = [n for n, kind in enumerate(group["HEADING"]) if kind == "DATA"]
    rows = [n for n in data if all(_same(group[h][n], v) for h, v in origin.fields.items())]
    if not rows:
        asked = ", ".join(f"{name} {value}" for name, value in origin.fields.items())
        hint = ""
        for name, value in origin.fields.items():
            known = sorted({str(group[name][n]) for n in data})
            if not any(_same(each, value) for each in known):
                hint = did_you_mean(value, known, what=f"{name} in the file")
                if value in map(str, installed.get(name, ())):
                    hint = f"The group MONG has {name} {value}, but without readings here."
                break
        message = f"no row of group MOND has {asked} for '{channel}'"
        table.refuse(0, 0, "no-readings", message, hint)
    times = {str(group["MOND_DTIM"][n]) for n in rows}
    telling = _TELLING if len(times) == len(rows) else (*_TELLING, "MOND_REF")
    for name in (name for name in telling if name in group):
        values = list(dict.fromkeys(str(group[name][n]).strip() for n in rows))
        if len(values) > 1:
            message = f"the rows of '{channel}' have several {name}: {listing(values)}"
            hint = f"Say which: channels: {{{channel}: {{{name}: '{values[0]}', ...}}}}."
            table.refuse(int(group["line_number"][rows[0]]), 1, "ambiguous", message, hint)
            return []
    return rows


def _same(cell: object, wanted: str) -> bool:
    """Equal texts, or equal numbers: 5.00 is 5."""
    text = str(cell).strip()
    if text == wanted:
        return True
    try:
        return read_quantity(text) == read_quantity(wanted)
    except UnitError:
        return False
