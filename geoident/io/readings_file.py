"""Readings from CSV: ``gauge,stage,value,unit[,accuracy]``, one reading a row.

Lines that begin with ``#`` and blank lines are passed over. A blank value is a reading that was
not taken: it is kept, and counted later.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field

from geoident.errors import Fault, InputError, Location
from geoident.io.faults import shortened
from geoident.io.text_file import decode, read_bytes
from geoident.io.wording import did_you_mean, listing, shorten
from geoident.model.case import KeyPath
from geoident.model.gauges import Reading
from geoident.units import UNITS, UnitError, normal_unit, read_quantity, unit_list, with_article

REQUIRED = ("gauge", "stage", "value", "unit")
COLUMNS = (*REQUIRED, "accuracy")
MAX_ROWS = 1_000_000
MAX_BYTES = 200_000_000
_MOST_FAULTS = 1000
_CELL = re.compile(r'\s*+(?:"((?:[^"]|"")*+)"\s*+|([^",]*+))(,|$)')


@dataclass(frozen=True)
class PlacedReading:
    """A reading and where its parts are written.

    Args:
        reading: the reading; its location is that of the gauge's name.
        stage_location: where the name of the stage is written.
        path: path of keys in the case, empty for a row of a file.
    """

    reading: Reading
    stage_location: Location
    path: KeyPath = ()


@dataclass(frozen=True)
class _Cell:
    text: str
    column: int


@dataclass
class _Table:
    """The file being read: its columns and its faults."""

    file: str
    columns: tuple[str, ...] = ()
    faults: list[Fault] = field(default_factory=list)

    def refuse(self, place: tuple[int, int], code: str, message: str, hint: str = "") -> None:
        """Note a fault at a line and column."""
        self.faults.append(Fault(code, message, hint, Location(self.file, *place)))


def read_readings(path: str) -> tuple[PlacedReading, ...]:
    """Read a CSV file of readings.

    Raises:
        InputError: with all that is wrong in the file.
    """
    return parse_readings(read_bytes(path, limit=MAX_BYTES, what="readings file"), path)


def parse_readings(content: bytes, file: str) -> tuple[PlacedReading, ...]:
    """Readings from the bytes of a CSV file; see `read_readings`.

    Raises:
        InputError: with all faults; it stops at a thousand of them.
    """
    table = _Table(file)
    if content.count(b"\n") > MAX_ROWS:
        table.refuse((0, 0), "too-large", f"the file has more than {MAX_ROWS:,} rows")
        raise InputError(table.faults)
    lines = _lines(decode(content, file))
    header = next(lines, None)
    if header is None:
        hint = f"The first line names the columns: {','.join(REQUIRED)}."
        table.refuse((0, 0), "empty", "the file is empty", hint)
    else:
        _read_header(table, *header)
    if table.faults:
        raise InputError(shortened(table.faults))
    rows = []
    for line in lines:
        if len(table.faults) > _MOST_FAULTS:
            break
        rows.append(_read_row(table, *line))
    if table.faults:
        raise InputError(shortened(table.faults))
    return tuple(row for row in rows if row is not None)


def _lines(text: str) -> Iterator[tuple[int, str]]:
    """Number and text of the lines that hold something."""
    for number, line in enumerate(text.replace("\r\n", "\n").replace("\r", "\n").split("\n"), 1):
        if line.strip(" \t,") and not line.lstrip().startswith("#"):
            yield number, line


def _read_header(table: _Table, number: int, line: str) -> None:
    if "," not in line and (";" in line or "\t" in line):
        message = "the columns are separated by semicolons or tabs; commas are expected"
        hint = "Export as comma-separated values, with decimal points."
        table.refuse((number, 1), "bad-header", message, hint)
        return
    cells = _split(table, number, line)
    table.columns = tuple(cell.text.lower() for cell in cells)
    for n, cell in enumerate(cells):
        name = table.columns[n]
        if name not in COLUMNS:
            hint = did_you_mean(name, COLUMNS, what="Columns")
            message = f"there is no column '{shorten(cell.text)}'"
            table.refuse((number, cell.column), "bad-header", message, hint)
        elif name in table.columns[:n]:
            message = f"the column '{name}' is there twice"
            table.refuse((number, cell.column), "bad-header", message)
    _require_columns(table, number)


def _require_columns(table: _Table, number: int) -> None:
    missing = [name for name in REQUIRED if name not in table.columns]
    if missing:
        hint = f"The first line names the columns: {','.join(REQUIRED)}[,accuracy]."
        message = f"columns missing in the header: {listing(missing)}"
        table.refuse((number, 1), "bad-header", message, hint)


def _split(table: _Table, number: int, line: str) -> list[_Cell]:
    """The cells of a line, with quotes removed."""
    cells: list[_Cell] = []
    at = 0
    while True:
        match = _CELL.match(line, at)
        if match is None:
            message = "a quote is not closed on its line, or stands inside a text"
            hint = 'Double quotes enclose a whole cell; inside one write "" for ".'
            table.refuse((number, at + 1), "bad-quote", message, hint)
            return []
        quoted = match[1] is not None
        text = match[1].replace('""', '"') if quoted else match[2].strip()
        cells.append(_Cell(text, match.start(1 if quoted else 2) + 1))
        at = match.end()
        if match[3] == "":
            return cells


def _read_row(table: _Table, number: int, line: str) -> PlacedReading | None:
    cells = _split(table, number, line)
    width = len(table.columns)
    if not cells or not _has_width(table, number, cells):
        return None
    cells += [_Cell("", len(line) + 1)] * (width - len(cells))
    row = dict(zip(table.columns, cells, strict=False))
    before = len(table.faults)
    for name in ("gauge", "stage"):
        if not row[name].text:
            message = f"the name of the {name} is missing"
            table.refuse((number, row[name].column), "missing-name", message)
    factor = _unit_factor(table, number, row)
    value = _number(table, number, row["value"])
    accuracy = _accuracy(table, number, row)
    if len(table.faults) > before or factor is None:
        return None
    return PlacedReading(
        Reading(
            row["gauge"].text,
            row["stage"].text,
            None if value is None else value * factor,
            None if accuracy is None else accuracy * factor,
            Location(table.file, number, row["gauge"].column),
        ),
        Location(table.file, number, row["stage"].column),
    )


def _has_width(table: _Table, number: int, cells: list[_Cell]) -> bool:
    width = len(table.columns)
    needed = max(n for n, name in enumerate(table.columns) if name in REQUIRED) + 1
    if len(cells) > width and any(cell.text for cell in cells[width:]):
        message = f"the row has {len(cells)} columns, the header {width}"
        hint = "If a number has a decimal comma, write a point; quote texts that hold commas."
        table.refuse((number, cells[width].column), "too-many-columns", message, hint)
        return False
    if len(cells) < needed:
        message = f"the row has {len(cells)} columns; {','.join(table.columns)} expected"
        end = cells[-1].column + len(cells[-1].text)
        table.refuse((number, end), "too-few-columns", message, "Leave a missing value blank: ,,")
        return False
    return True


def _unit_factor(table: _Table, number: int, row: Mapping[str, _Cell]) -> float | None:
    """Size of the unit in m; 1 where there is none and none is needed."""
    cell = row["unit"]
    if not cell.text and not row["value"].text:
        accuracy = row.get("accuracy")
        if accuracy is None or not accuracy.text:
            return 1.0
    try:
        dimension, factor = UNITS[normal_unit(cell.text)]
    except UnitError as error:
        comma = cell.text.replace(".", "").isdigit()
        hint = "If the value has a decimal comma, write a point." if comma else error.hint
        table.refuse((number, cell.column), "unit", error.message, hint)
        return None
    if dimension == "length":
        return factor
    found = f"'{cell.text}' is the unit of {with_article(dimension)}" if cell.text else "no unit"
    hint = f"Units of length: {unit_list('length')}."
    table.refuse((number, cell.column), "unit", f"{found}; a length is expected", hint)
    return None


def _number(table: _Table, number: int, cell: _Cell) -> float | None:
    if not cell.text:
        return None
    try:
        quantity = read_quantity(cell.text)
    except UnitError as error:
        table.refuse((number, cell.column), "bad-number", error.message, error.hint)
        return None
    if quantity.unit:
        message = f"'{shorten(cell.text)}' has a unit; a number is expected"
        hint = "Units stand in the column 'unit'."
        table.refuse((number, cell.column), "bad-number", message, hint)
        return None
    return quantity.value


def _accuracy(table: _Table, number: int, row: Mapping[str, _Cell]) -> float | None:
    cell = row.get("accuracy")
    if cell is None:
        return None
    accuracy = _number(table, number, cell)
    if accuracy is not None and accuracy <= 0:
        message = f"the accuracy '{cell.text}' is not positive"
        table.refuse((number, cell.column), "out-of-range", message)
    return accuracy
