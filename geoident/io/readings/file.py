"""Readings from files: a format yields rows of cells, a layout makes readings of rows.

A text or a sheet of a workbook is long (`geoident.io.readings.long`), wide
(`geoident.io.readings.wide`) or has coordinates of points (`geoident.io.readings.coordinates`).
The monitoring group of an AGS file is read as a long table.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass
from itertools import chain, islice
from pathlib import Path

from geoident.errors import Fault, InputError, Location
from geoident.io.readings.ags import ags_rows
from geoident.io.readings.coordinates import CoordinateRows
from geoident.io.readings.layout import Layout
from geoident.io.readings.long import LongRows
from geoident.io.readings.table import FaultyReadings, Table
from geoident.io.readings.wide import WideRows
from geoident.io.readings.workbook import sheet_rows
from geoident.io.text.cells import Cell, Row, cells_of, stray_quote, written_lines
from geoident.io.text.faults import shortened
from geoident.io.text.text_file import decode, read_bytes
from geoident.io.text.wording import listing
from geoident.model.gauges import Reading

MAX_ROWS = 1_000_000
MAX_BYTES = 200_000_000
_MOST_FAULTS = 1000
_DELIMITERS = {",": "commas", ";": "semicolons", "\t": "tabs", "|": "bars"}


@dataclass(frozen=True)
class Format:
    """A format of files of readings.

    Args:
        rows: the rows of a file, in their order. It notes what is wrong in the table that it is
            given, or raises `InputError`.
        many: what a file of it is called in a message, if it has readings of many instruments, so
            that it must be declared which are whose.
        sheets: a file of it is a workbook.
    """

    rows: Callable[[Table], Iterable[Row]]
    many: str = ""
    sheets: bool = False


def format_of(path: str) -> Format:
    """The format of a file, by its suffix; text if it is none of `FORMATS`."""
    return FORMATS.get(Path(path).suffix.lower(), TEXT)


def read_readings(path: str, layout: Layout | None = None) -> tuple[Reading, ...]:
    """Read a file of readings.

    Args:
        path: of the file; its suffix tells the format.
        layout: how it is written; None for the default.

    Raises:
        InputError: with all that is wrong in the file.
    """
    table = Table(path, layout or Layout())
    return _readings(table, format_of(path).rows(table))


def parse_readings(content: bytes, file: str, layout: Layout | None = None) -> tuple[Reading, ...]:
    """Readings from the bytes of a text, whatever its name; see `read_readings`.

    Args:
        content: of the file.
        file: its path, for messages.
        layout: how it is written; None for the default.

    Raises:
        InputError: with all faults; it stops at a thousand of them.
    """
    table = Table(file, layout or Layout())
    return _readings(table, _parsed(table, content))


def _readings(table: Table, rows: Iterable[Row]) -> tuple[Reading, ...]:
    """Readings from the rows of a file, the header among them.

    Raises:
        FaultyReadings: with all faults; it stops at a thousand of them.
    """
    written = (row for row in rows if any(cell.text for cell in row[1]))
    first = list(islice(written, 1))
    layout = table.layout  # which a format may complete before its first row
    below = (row for row in chain(first, written) if row[0] >= layout.header_row)
    header = joined_header(list(islice(below, layout.header_rows)))
    kind = CoordinateRows if layout.survey else WideRows if layout.wide else LongRows
    readings: list[Reading] = []
    if header is None and not table.faults:
        hint = f"The first line names the columns: {','.join(kind.expected)}."
        table.refuse(0, 0, "empty", "the file is empty", hint)
    if header is None or table.faults:
        raise FaultyReadings(shortened(table.faults), ())
    reader = kind(table, *header)
    if table.faults:
        raise FaultyReadings(shortened(table.faults), ())
    body = ((line, _without(cells, layout.blank)) for line, cells in below)
    if isinstance(reader, WideRows) and layout.unit_row:
        for units in islice(body, 1):
            reader.units(*units)
    for line, cells in body:
        if line >= layout.data_row:
            readings += reader.readings(line, cells)
        if len(table.faults) > _MOST_FAULTS:
            break
    if table.faults:
        raise FaultyReadings(shortened(table.faults), readings)
    return tuple(readings)


def _without(cells: list[Cell], blank: tuple[str, ...]) -> list[Cell]:
    """Cells of a row, of which those that stand for a missing reading are blank."""
    if not any(cell.text in blank for cell in cells):
        return cells
    return [Cell("", cell.column) if cell.text in blank else cell for cell in cells]


def joined_header(rows: Sequence[Row]) -> Row | None:
    """One header of the rows over which it is spread: ``EX1`` above ``a5`` is ``EX1 a5``.

    A name that stands above several columns counts for those right of it that have none of their
    own in its row, as cells do that were joined and then exported.

    >>> rows = [(1, [Cell("EX1", 1), Cell("", 5)]), (2, [Cell("a5", 1), Cell("a9", 4)])]
    >>> [cell.text for cell in joined_header(rows)[1]]
    ['EX1 a5', 'EX1 a9']
    """
    if not rows:
        return None
    line, last = rows[-1]
    width = max(len(cells) for _, cells in rows)
    names: list[list[str]] = [[] for _ in range(width)]
    for n, (_, cells) in enumerate(rows):
        above = ""
        for column in range(width):
            own = cells[column].text if column < len(cells) else ""
            above = own or above
            lower = any(column < len(other) and other[column].text for _, other in rows[n + 1 :])
            text = above if lower and not own else own
            names[column] += [text] if text else []
    places = [*last, *(Cell("", 0) for _ in range(width - len(last)))]
    return line, [
        Cell(" ".join(parts), cell.column) for parts, cell in zip(names, places, strict=True)
    ]


def _text_rows(table: Table) -> Iterator[Row]:
    """Rows of a text, CSV by another name."""
    return _parsed(table, read_bytes(table.file, limit=MAX_BYTES, what=table.layout.what))


def _parsed(table: Table, content: bytes) -> Iterator[Row]:
    """Rows of the bytes of a text; notes quotes out of place, and another delimiter."""
    layout = table.layout
    if content.count(b"\n") > MAX_ROWS:
        table.refuse(0, 0, "too-large", f"the file has more than {MAX_ROWS:,} rows")
        return
    text = decode(content, table.file, encoding=layout.encoding, hint=layout.encoding_hint)
    header = True
    for line, written in written_lines(text):
        if line < layout.header_row or not written.strip(f" \t{layout.delimiter}"):
            continue
        if header and _separated_otherwise(table, line, written):
            return
        header = False
        cells = cells_of(written, layout.delimiter)
        if stray := stray_quote(written, cells):
            message = "a quote is not closed on its line, or stands inside a text"
            hint = 'Double quotes enclose a whole cell; inside one write "" for ".'
            table.refuse(line, stray, "bad-quote", message, hint)
        else:
            yield line, cells
        if len(table.faults) > _MOST_FAULTS:
            return


def _separated_otherwise(table: Table, line: int, header: str) -> bool:
    """Note a header that is separated by something else than declared."""
    layout = table.layout
    wanted = layout.delimiter
    others = [d for d in _DELIMITERS if d != wanted and d in header]
    if wanted in header or not others:
        return False
    if wanted == ",":
        message = "the columns are separated by semicolons or tabs; expected commas"
        hint = "Export as comma-separated values, with decimal points, or declare them in the case:"
        hint += " " + layout.declaring("delimiter: ';', decimal: ','") + "."
    else:
        message = f"there are no {_DELIMITERS[wanted]} in the header; they are declared"
        hint = f"It has {listing(_DELIMITERS[d] for d in others)}: correct 'delimiter' in the case."
    table.refuse(line, 1, "bad-header", message, hint)
    return True


def _old_workbook(table: Table) -> Iterable[Row]:
    """No rows: a workbook of another format than .xlsx.

    Raises:
        InputError: always.
    """
    suffix = Path(table.file).suffix.lower()
    message = f"a {suffix} workbook cannot be read; expected .xlsx or CSV"
    hint = "Save it as 'Excel Workbook (.xlsx)' from Excel or LibreOffice."
    raise InputError([Fault("unknown-format", message, hint, Location(table.file))])


TEXT = Format(_text_rows)
FORMATS = {
    ".ags": Format(ags_rows, many="an AGS file"),
    ".xlsx": Format(sheet_rows, sheets=True),
    ".xlsm": Format(sheet_rows, sheets=True),
    ".xls": Format(_old_workbook, sheets=True),
    ".xlsb": Format(_old_workbook, sheets=True),
    ".ods": Format(_old_workbook, sheets=True),
}
"""Suffix to format. A new one is a function that yields rows, and a line here."""
