"""Readings from tables: ``gauge,stage,value,unit[,accuracy][,bad][,remarks]``, one reading a row.

The rows are those of a CSV file or of a sheet of an Excel workbook.

``date`` may stand in place of ``stage``, and columns may have other names if the case declares
them. Lines that begin with ``#`` and blank lines are passed over. A blank value is a reading that
was not taken: it is kept, and counted later. The wide layout, one column a gauge, is in
`geoident.io.readings.wide`, that of surveyed coordinates in `geoident.io.readings.coordinates`.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from itertools import chain, islice
from pathlib import Path
from typing import Protocol

from geoident.errors import Fault, InputError, Location
from geoident.io.readings.ags import read_ags
from geoident.io.readings.coordinates import CoordinateReader
from geoident.io.readings.table import (
    COLUMNS,
    ENCODING_HINT,
    Cell,
    FaultyReadings,
    Layout,
    Origin,
    Row,
    Table,
    UnitScale,
    flag,
    joined_header,
    lines,
)
from geoident.io.readings.wide import WideReader
from geoident.io.readings.workbook import open_sheet
from geoident.io.text.dates import utc_offset
from geoident.io.text.faults import shortened
from geoident.io.text.text_file import decode, read_bytes
from geoident.io.text.wording import did_you_mean, listing, shorten
from geoident.model.gauges import Reading

REQUIRED = ("gauge", "stage", "value", "unit")
MAX_ROWS = 1_000_000
MAX_BYTES = 200_000_000
_MOST_FAULTS = 1000
_DELIMITERS = {",": "commas", ";": "semicolons", "\t": "tabs", "|": "bars"}


@dataclass(frozen=True)
class Format:
    """A format of files of readings.

    Args:
        read: the readings of a file that is laid out as declared.
        many: what a file of it is called in a message, if it has readings of many instruments, so
            that it must be declared which are whose.
        sheets: a file of it is a workbook.
    """

    read: Callable[[str, Layout], tuple[Reading, ...]]
    many: str = ""
    sheets: bool = False


def format_of(path: str) -> Format:
    """The format of a file, by its suffix; CSV if it is none of `FORMATS`."""
    return FORMATS.get(Path(path).suffix.lower(), CSV)


def read_readings(path: str, layout: Layout | None = None) -> tuple[Reading, ...]:
    """Read a CSV file of readings.

    Raises:
        InputError: with all that is wrong in the file.
    """
    return parse_readings(read_bytes(path, limit=MAX_BYTES, what="readings file"), path, layout)


def parse_readings(content: bytes, file: str, layout: Layout | None = None) -> tuple[Reading, ...]:
    """Readings from the bytes of a CSV file; see `read_readings`.

    Args:
        content: of the file.
        file: its path, for messages.
        layout: how it is written; None for the default.

    Raises:
        InputError: with all faults; it stops at a thousand of them.
    """
    table = Table(file, layout or Layout())
    if content.count(b"\n") > MAX_ROWS:
        table.refuse((0, 0), "too-large", f"the file has more than {MAX_ROWS:,} rows")
        raise InputError(table.faults)
    text = decode(content, file, encoding=table.layout.encoding, hint=ENCODING_HINT)
    found = lines(text, table.layout.delimiter)
    given = (row for row in found if row[0] >= table.layout.header_row)
    first = next(given, None)
    if first is not None and _separated_otherwise(table, *first):
        raise InputError(table.faults)
    rest = () if first is None else chain((first,), given)
    return read_rows(table, ((line, table.split(line, text)) for line, text in rest))


def read_workbook(path: str, layout: Layout) -> tuple[Reading, ...]:
    """Read a sheet of an Excel workbook; see `geoident.io.readings.workbook`.

    Raises:
        InputError: with all that is wrong in it.
    """
    table = Table(path, layout)
    sheet = open_sheet(path, layout)
    table.sheet = sheet.name
    return read_rows(table, sheet.rows(layout.header_row))


def refuse_old(path: str, layout: Layout) -> tuple[Reading, ...]:
    """Refuse a workbook of another format than .xlsx.

    Raises:
        InputError: always.
    """
    suffix = Path(path).suffix.lower()
    message = f"a {suffix} workbook cannot be read; .xlsx or CSV is expected"
    hint = "Save it as 'Excel Workbook (.xlsx)' from Excel or LibreOffice."
    raise InputError([Fault("unknown-format", message, hint, Location(path))])


def read_rows(table: Table, rows: Iterable[Row]) -> tuple[Reading, ...]:
    """Readings from the rows of a file, the header among them.

    Args:
        table: the file; rows before its header row are left out already.
        rows: that hold something.

    Raises:
        FaultyReadings: with all faults; it stops at a thousand of them.
    """
    layout, rest = table.layout, iter(rows)
    header = joined_header(list(islice(rest, layout.header_rows)))
    if header is None:
        hint = f"The first line names the columns: {','.join(_expected(layout))}."
        table.refuse((0, 0), "empty", "the file is empty", hint)
        raise InputError(table.faults)
    reader = _reader(table)
    if not table.faults:
        reader.header(*header)
    readings: list[Reading] = []
    for line, cells in rest if not table.faults else ():
        if line < layout.data_row and not reader.units_follow:
            continue
        blank = layout.blank and any(cell.text in layout.blank for cell in cells)
        readings += reader.row(line, _without(cells, layout.blank) if blank else cells)
        if len(table.faults) > _MOST_FAULTS:
            break
    if table.faults:
        raise FaultyReadings(shortened(table.faults), readings)
    return tuple(readings)


class _Rows(Protocol):
    """A layout: makes readings of rows."""

    units_follow: bool

    def header(self, line: int, cells: list[Cell]) -> None: ...

    def row(self, line: int, cells: list[Cell]) -> list[Reading]: ...


def _reader(table: Table) -> _Rows:
    if table.layout.survey is not None:
        return CoordinateReader(table, table.layout.survey)
    return WideReader(table) if table.layout.wide else _LongReader(table)


def _expected(layout: Layout) -> tuple[str, ...]:
    if layout.survey is not None:
        return ("point", "date", "east", "north", "height")
    return ("date", "CHANNEL", "CHANNEL", "...") if layout.wide else REQUIRED


def _without(cells: list[Cell], blank: tuple[str, ...]) -> list[Cell]:
    return [Cell("", cell.column) if cell.text in blank else cell for cell in cells]


def _separated_otherwise(table: Table, line: int, text: str) -> bool:
    """Note a header that is separated by something else than declared."""
    wanted = table.layout.delimiter
    others = [d for d in _DELIMITERS if d != wanted and d in text]
    if wanted in text or not others:
        return False
    if wanted == ",":
        message = "the columns are separated by semicolons or tabs; commas are expected"
        hint = "Export as comma-separated values, with decimal points, or declare them in the case:"
        hint += " readings: {file: ..., delimiter: ';', decimal: ','}."
    else:
        message = f"there are no {_DELIMITERS[wanted]} in the header; they are declared"
        hint = f"It has {listing(_DELIMITERS[d] for d in others)}: correct 'delimiter' in the case."
    table.refuse((line, 1), "bad-header", message, hint)
    return True


CSV = Format(read_readings)
FORMATS = {
    ".ags": Format(read_ags, many="an AGS file"),
    ".xlsx": Format(read_workbook, sheets=True),
    ".xlsm": Format(read_workbook, sheets=True),
    ".xls": Format(refuse_old, sheets=True),
    ".xlsb": Format(refuse_old, sheets=True),
    ".ods": Format(refuse_old, sheets=True),
}
"""Suffix to format. What reads a new one stands in its own module, and here in a line."""


_BLANK = Cell("", 1)


class _LongReader:
    """One reading a row."""

    def __init__(self, table: Table) -> None:
        self.table = table
        layout = table.layout
        self.names = {layout.header(key): key for key in COLUMNS}
        self.by_name_in_file = {
            origin.name or channel: (channel, origin) for channel, origin in layout.channels.items()
        }
        self.required: tuple[str, ...] = REQUIRED
        self.keys: tuple[str, ...] = ()
        self.units_follow = False
        self.temperatures: dict[str, int] = {}
        self.nameless: dict[int, bool] = {}

    def header(self, line: int, cells: list[Cell]) -> None:
        """Note the columns, and what is wrong with them."""
        expected = ",".join(self.table.layout.header(key) for key in REQUIRED)
        if self.table.refuse_missing(line, cells, self.names, expected):
            return
        found = tuple(cell.text.lower() for cell in cells)
        if not self._leaves_aside(""):
            self.nameless = {n: False for n, name in enumerate(found) if not name}
        self.table.require_ignored(line, cells)
        self.temperatures = self.table.temperature_columns(line, cells)
        for n, cell in enumerate(cells):
            self._check_column(line, cell, found[:n])
        self.keys = tuple(self.names.get(name, "") for name in found)
        dated = "date" in self.keys and "stage" not in self.keys
        self.required = tuple("date" if dated and k == "stage" else k for k in REQUIRED)
        calibrated = [origin.calibration for _, origin in self.by_name_in_file.values()]
        if self.table.layout.unit or (calibrated and None not in calibrated):
            self.required = tuple(key for key in self.required if key != "unit")
        self._require_columns(line)

    def _check_column(self, line: int, cell: Cell, before: tuple[str, ...]) -> None:
        name = cell.text.lower()
        if not name or name in self.table.layout.ignore or name in self.temperatures:
            return
        if name not in self.names:
            if self._leaves_aside(name):
                return
            hint = did_you_mean(name, COLUMNS, what="Columns")
            if not hint.startswith("Did"):
                hint += f" If it is not to be read, declare it: ignore: [{shorten(cell.text)}]."
            message = f"there is no column '{shorten(cell.text)}'"
            self.table.refuse((line, cell.column), "bad-header", message, hint)
        elif name in before:
            message = f"the column '{name}' is there twice"
            self.table.refuse((line, cell.column), "bad-header", message)

    def _leaves_aside(self, name: str) -> bool:
        """Whether a column of another name is left aside, as whoever names the columns may."""
        return bool(self.table.layout.columns) or (bool(self.table.sheet) and not name)

    def _require_columns(self, line: int) -> None:
        missing = [self.table.layout.header(k) for k in self.required if k not in self.keys]
        if missing:
            hint = f"The first line names the columns: {','.join(REQUIRED)}[,accuracy]."
            if missing == [self.table.layout.header("unit")]:
                hint += " One unit for all may stand in the case: readings: {file: ..., unit: mm}."
            message = f"columns missing in the header: {listing(missing)}"
            self.table.refuse((line, 1), "bad-header", message, hint)

    def row(self, line: int, cells: list[Cell]) -> list[Reading]:
        """The reading of a row, if it is right."""
        table = self.table
        if not cells or table.refuse_nameless(line, cells, self.nameless):
            return []
        if not self._has_width(line, cells):
            return []
        end = cells[-1].column + len(cells[-1].text)
        cells = [*cells, *[Cell("", end)] * (len(self.keys) - len(cells))]
        row = {key: cell for key, cell in zip(self.keys, cells, strict=False) if key}
        before = len(table.faults)
        self._check_names(line, row)
        channel, origin = self._channel(row["gauge"].text)
        if not channel and row["gauge"].text:
            return []  # of an instrument that is not asked for
        time = table.date(line, row["date"]) if "date" in self.required else None
        scale = self._scale(line, row, origin, table.layout.dimension(channel))
        value = table.measured(line, row["value"])
        accuracy = table.accuracy(line, row.get("accuracy"))
        calibration = origin.calibration
        temperature = None
        if calibration is not None and value is not None:
            temperature = table.temperature(line, cells, self.temperatures, calibration)
        if not channel:
            return []
        if len(table.faults) > before or scale is None:
            if time is None and not row.get("stage", _BLANK).text:
                return []
            # A faulty row is kept without its value, so that its names are still checked.
            scale, value, accuracy = UnitScale(), None, None
        when = row["date" if "date" in self.required else "stage"]
        return [
            Reading(
                channel=channel,
                stage="" if "date" in self.required else row["stage"].text,
                value=None if value is None else scale.reading(value, temperature),
                accuracy=None if accuracy is None else scale.accuracy(accuracy, value),
                bad=flag(row["bad"].text) if "bad" in row else "",
                location=table.place(line, row["gauge"]),
                time=time,
                zone=utc_offset(when.text) if time is not None else None,
                when=table.place(line, when),
                note=row["remarks"].text if "remarks" in row else "",
            )
        ]

    def _channel(self, name: str) -> tuple[str, Origin]:
        """Channel of a name in the file, and its origin; no channel where none is asked for."""
        if not self.by_name_in_file:
            return name, Origin()
        return self.by_name_in_file.get(name, ("", Origin()))

    def _check_names(self, line: int, row: Mapping[str, Cell]) -> None:
        for name in ("gauge", *(key for key in ("stage", "date") if key in self.required)):
            if not row[name].text:
                message = f"the name of the {name} is missing"
                message = "the date is missing" if name == "date" else message
                self.table.refuse((line, row[name].column), "missing-name", message)

    def _has_width(self, line: int, cells: list[Cell]) -> bool:
        table, width = self.table, len(self.keys)
        needed = max(n for n, name in enumerate(self.keys) if name in self.required) + 1
        if len(cells) > width and any(cell.text for cell in cells[width:]):
            message = f"the row has {len(cells)} columns, the header {width}"
            hint = "If a number has a decimal comma, write a point; quote texts that hold commas."
            table.refuse((line, cells[width].column), "too-many-columns", message, hint)
            return False
        if len(cells) < needed:
            expected = ",".join(self.keys)
            message = f"the row has {len(cells)} columns; {expected} expected"
            end = cells[-1].column + len(cells[-1].text)
            hint = "Leave a missing value blank: ,,"
            table.refuse((line, end), "too-few-columns", message, hint)
            return False
        return True

    def _scale(
        self, line: int, row: Mapping[str, Cell], origin: Origin, dimension: str
    ) -> UnitScale | None:
        """How values become SI; as they are where there is no unit and none is needed."""
        cell = row.get("unit", Cell("", 1))
        unit = origin.unit or ("" if origin.calibration else self.table.layout.unit)
        if not cell.text and unit:
            cell = Cell(unit, cell.column)
        accuracy = row.get("accuracy")
        blank = not row["value"].text and (accuracy is None or not accuracy.text)
        if not cell.text and blank:
            return UnitScale()
        return self.table.scale(line, cell, dimension, origin)
