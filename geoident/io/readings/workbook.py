"""Sheets of Excel workbooks (.xlsx, .xlsm), by the openpyxl library, as rows of cells.

A cell keeps the number or date that it holds, so that decimal marks and formats of dates do not
matter; what failed, or was never computed, stays a text that no reader takes for a number. A cell
that joins several rows holds for each of them.
"""

from __future__ import annotations

import io
import re
import struct
import warnings
import zipfile
import zlib
from collections.abc import Iterator
from datetime import date, datetime
from typing import Any
from xml.etree.ElementTree import ParseError

from geoident.errors import Fault, InputError, Location
from geoident.io.readings.layout import Layout
from geoident.io.readings.table import Table
from geoident.io.text.cells import Cell, Row
from geoident.io.text.dates import date_text
from geoident.io.text.text_file import read_bytes
from geoident.io.text.wording import did_you_mean, listing

MAX_BYTES = 100_000_000
MAX_UNPACKED = 300_000_000
MAX_CELLS = 5_000_000
MAX_JOINED = 200_000
_OLD = b"\xd0\xcf\x11\xe0"
_RANGE = re.compile(r"([A-Za-z]{1,3})([1-9][0-9]{0,6}):([A-Za-z]{1,3})([1-9][0-9]{0,6})")
_MERGED = re.compile(
    rb"mergeCell [^>]*ref=[\"']([A-Za-z]{1,3})([0-9]{1,7}):([A-Za-z]{1,3})([0-9]{1,7})"
)
_BROKEN = (
    zipfile.BadZipFile, zlib.error, struct.error, ParseError, LookupError, ValueError, TypeError,
    AttributeError, ArithmeticError, OSError, EOFError, NotImplementedError, MemoryError,
    RecursionError,
)  # fmt: skip
"""What openpyxl raises on files that are none."""


def range_problem(text: str) -> str | None:
    """Why a text is no range of cells, or None if it is one.

    >>> range_problem("B4:H60")
    >>> range_problem("H4:B60")
    'its first cell is not the upper left one'
    """
    match = _RANGE.fullmatch(text.strip())
    if match is None:
        return "it is made of two cells"
    ordered = _column(match[1]) <= _column(match[3]) and int(match[2]) <= int(match[4])
    return None if ordered else "its first cell is not the upper left one"


def _column(letters: str) -> int:
    number = 0
    for letter in letters.upper():
        number = 26 * number + ord(letter) - ord("A") + 1
    return number


def sheet_rows(table: Table) -> Iterator[Row]:
    """The rows of the sheet of a workbook that is declared, or of its only one.

    Args:
        table: the workbook; is told which sheet it is.

    Raises:
        InputError: no workbook, or no such sheet, or one of several that is not named.
    """
    path, layout = table.file, table.layout
    data = read_bytes(path, limit=MAX_BYTES, what="workbook")
    if data.startswith(_OLD):
        hint = "Remove its password, or save it as 'Excel Workbook (.xlsx)'."
        raise _refused(path, "bad-workbook", "the workbook is encrypted or of the old .xls", hint)
    has_formulas = _looked_through(data, path)
    sheet = _find(_open(data, path), layout, path)
    table.sheet = sheet.title
    cells = sheet.max_row * sheet.max_column
    if cells > MAX_CELLS:
        message = f"the sheet '{sheet.title}' spans {cells:,} cells, more than {MAX_CELLS:,}"
        hint = "Something stands far off; delete the rows and columns that are not needed."
        raise _refused(path, "too-large", message, hint)
    formulas = _open(data, path, data_only=False)[sheet.title] if has_formulas else sheet
    first_of = {
        (row, span.min_col): (span.min_row, span.min_col)
        for span in sheet.merged_cells.ranges
        for row in range(span.min_row, span.max_row + 1)
    }
    top, left, bottom, right = 1, 1, sheet.max_row, sheet.max_column
    if match := _RANGE.fullmatch(layout.cells.strip()):
        top, left = int(match[2]), _column(match[1])
        bottom, right = min(int(match[4]), bottom), min(_column(match[3]), right)
    for row in _written(data, path, sheet.title, (top, bottom, left, right)):
        columns = range(left, right + 1)
        yield row, [_cell(sheet, formulas, first_of.get((row, k)), row, k) for k in columns]


def _open(data: bytes, path: str, *, data_only: bool = True, read_only: bool = False) -> Any:
    """The workbook, with the stored values of formulas or with the formulas themselves."""
    import openpyxl  # noqa: PLC0415 - a fifth of a second, for workbooks only

    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # of what a workbook has besides cells
            return openpyxl.load_workbook(
                io.BytesIO(data), read_only=read_only, data_only=data_only, keep_links=False
            )
    except _BROKEN as error:
        raise _no_workbook(path, error) from error


def _written(data: bytes, path: str, name: str, box: tuple[int, int, int, int]) -> list[int]:
    """Numbers of the rows that hold something: asking for cells of others would make these."""
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            sheet = _open(data, path, read_only=True)[name]
            sheet.reset_dimensions()  # files may state them wrongly
            rows = enumerate(sheet.iter_rows(*box, values_only=True), box[0])
            return [row for row, cells in rows if any(cell is not None for cell in cells)]
    except _BROKEN as error:
        raise _no_workbook(path, error) from error


def _no_workbook(path: str, error: BaseException) -> InputError:
    message = f"not a readable Excel workbook: {error or type(error).__name__}"
    hint = "Open it in Excel and save it again as 'Excel Workbook (.xlsx)'."
    return _refused(path, "bad-workbook", " ".join(message.split()), hint)


def _looked_through(data: bytes, path: str) -> bool:
    """Whether a sheet has formulas; refuses one that joins more cells than there is memory for."""
    formulas = False
    try:
        with zipfile.ZipFile(io.BytesIO(data)) as archive:
            if sum(part.file_size for part in archive.infolist()) > MAX_UNPACKED:
                message = f"the workbook is larger than {MAX_UNPACKED // 10**6} MB, unpacked"
                raise _refused(path, "too-large", message)
            for name in archive.namelist():
                if not name.startswith("xl/worksheets/"):
                    continue
                text = archive.read(name)
                formulas |= b"<f" in text
                spans = [[part.decode() for part in m.groups()] for m in _MERGED.finditer(text)]
                joined = sum(
                    (_column(right) - _column(left) + 1) * (int(bottom) - int(top) + 1)
                    for left, top, right, bottom in spans
                )
                if joined > MAX_JOINED:
                    message = f"a sheet joins {joined:,} cells, more than {MAX_JOINED:,}"
                    raise _refused(path, "too-large", message, "Join only cells that are needed.")
    except _BROKEN as error:
        raise _no_workbook(path, error) from error
    return formulas


def _find(book: Any, layout: Layout, path: str) -> Any:
    names = [sheet.title for sheet in book.worksheets]
    if layout.sheet:
        if layout.sheet in names:
            return book[layout.sheet]
        hint = did_you_mean(layout.sheet, names, what="Sheets")
        raise _refused(path, "no-sheet", f"there is no sheet '{layout.sheet}'", hint)
    if len(names) == 1:
        return book.worksheets[0]
    if not names:
        raise _refused(path, "no-sheet", "the workbook has no sheet of cells")
    message = f"the workbook has {len(names)} sheets, and none is declared"
    raise _refused(path, "no-sheet", message, f"Add 'sheet: NAME': {listing(names)}.")


def _cell(sheet: Any, formulas: Any, first: tuple[int, int] | None, row: int, column: int) -> Cell:
    """A cell, with what it holds.

    Args:
        sheet: with values.
        formulas: the same sheet with formulas.
        first: row and column of the upper left of the cells that it is joined with; None for none.
        row: of the cell.
        column: of the cell.
    """
    at, joined = first or (row, column), first is not None
    cell = sheet.cell(*at)
    value = cell.value
    if value is None:
        behind = formulas.cell(*at)
        formula = behind.value if isinstance(behind.value, str) else "=..."
        return Cell(formula if behind.data_type == "f" else "", column, joined=joined)
    if isinstance(value, date):
        moment = datetime(value.year, value.month, value.day)
        moment = value if isinstance(value, datetime) else moment
        text = date_text((moment - datetime(1970, 1, 1)).total_seconds())
        return Cell(text, column, moment, joined)
    if isinstance(value, int | float) and not isinstance(value, bool):
        percent = "%" in str(cell.number_format)
        text = f"{100 * value:.12g} %" if percent else repr(value).removesuffix(".0")
        return Cell(text, column, None if percent else float(value), joined)
    text = str(value).lower() if isinstance(value, bool) else str(value)
    return Cell(" ".join(text.split()), column, joined=joined)


def _refused(path: str, code: str, message: str, hint: str = "") -> InputError:
    return InputError([Fault(code, message, hint, Location(path))])
