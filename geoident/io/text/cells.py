"""Tables written as text: lines, and cells between commas, semicolons, tabs or bars."""

from __future__ import annotations

import re
from collections.abc import Iterator
from dataclasses import dataclass
from datetime import datetime
from functools import cache

from geoident.errors import Fault, InputError, Location
from geoident.io.text.text_file import decode, read_bytes

_MOST_FAULTS = 100


@dataclass(frozen=True)
class Cell:
    """A cell of a table.

    Args:
        text: that it shows, without quotes and the blanks around it.
        column: from 1: of the first character of its text, or of the cell in a sheet.
        value: number or date that the cell of a sheet holds; None for a text.
        joined: it is one with other cells of the sheet.
    """

    text: str
    column: int
    value: float | datetime | None = None
    joined: bool = False


Row = tuple[int, list[Cell]]
"""Number of a line or row, from 1, and its cells."""


@dataclass(frozen=True)
class TextTable:
    """A table whose first line names its columns.

    Args:
        header: its first line.
        rows: that have as many cells as the header.
        delimiter: between cells.
        faults: of the other rows.
    """

    header: Row
    rows: list[Row]
    delimiter: str
    faults: list[Fault]


def read_text_table(
    path: str, *, limit: int, what: str, hint: str, delimiter: str = ""
) -> TextTable:
    """Read a table; lines that hold nothing, and those that begin with ``#``, are passed over.

    Args:
        path: of the file.
        limit: of its size, bytes.
        what: name of the kind of file in messages.
        hint: what its first line is, where it has none.
        delimiter: between cells; that of its header (`delimiter_of`) if empty.

    Raises:
        InputError: it cannot be read, is no text, or is empty.
    """
    lines = list(written_lines(decode(read_bytes(path, limit=limit, what=what), path)))
    if not lines:
        raise InputError([Fault("empty", "the table is empty", hint, Location(path))])
    delimiter = delimiter or delimiter_of(lines[0][1])
    header, *rows = [(number, cells_of(line, delimiter)) for number, line in lines]
    width, remedy = len(header[1]), ""
    if delimiter == ",":
        remedy = "A decimal comma needs ';' between columns, a text that holds commas quotes."
    wrong = [row for row in rows if len(row[1]) != width][:_MOST_FAULTS]
    faults = [
        Fault(
            "bad-row",
            f"found {len(cells)} cells; expected {width}, as in the header",
            remedy,
            Location(path, number, 1),
        )
        for number, cells in wrong
    ]
    return TextTable(header, [row for row in rows if len(row[1]) == width], delimiter, faults)


def written_lines(text: str) -> Iterator[tuple[int, str]]:
    r"""Number, from 1, and text of the lines that hold something and are no remark.

    >>> list(written_lines("# a table\nE,K0\n\n1,2\n"))
    [(2, 'E,K0'), (4, '1,2')]
    """
    for number, line in enumerate(text.replace("\r\n", "\n").replace("\r", "\n").split("\n"), 1):
        begin = line.lstrip()
        if begin and not begin.startswith("#"):
            yield number, line


def delimiter_of(header: str) -> str:
    """What stands between the cells of a header: the comma, semicolon or tab it has most of.

    >>> delimiter_of("E [GPa];K0;roof, mm")
    ';'
    """
    plain = re.sub(r"\"[^\"]*\"", "", header)
    return max(",;\t", key=plain.count)


def cells_of(line: str, delimiter: str) -> list[Cell]:
    """The cells of a line; in quotes, two quotes are one and the delimiter is a character.

    A quote that does not enclose a whole cell is a character (`stray_quote`).

    >>> [(c.text, c.column) for c in cells_of('a, "[b, c]",', ",")]
    [('a', 1), ('[b, c]', 5), ('', 13)]
    """
    cells: list[Cell] = []
    at = 0
    if '"' not in line:  # as most, which may be thousands
        for part in line.split(delimiter):
            cells.append(Cell(part.strip(), at + 1 + len(part) - len(part.lstrip())))
            at += len(part) + 1
        return cells
    while at <= len(line):
        quoted = _quoted(delimiter).match(line, at)
        if quoted:
            cells.append(Cell(quoted[1].replace('""', '"'), quoted.start(1) + 1))
            at = quoted.end() + 1
            continue
        end = line.find(delimiter, at)
        part = line[at : end if end >= 0 else len(line)]
        cells.append(Cell(part.strip(), at + 1 + len(part) - len(part.lstrip())))
        at += len(part) + 1
    return cells


@cache
def _quoted(delimiter: str) -> re.Pattern[str]:
    end = re.escape(delimiter)
    blank = rf"[^\S{end}]*+"
    return re.compile(rf'{blank}"((?:[^"]|"")*+)"{blank}(?={end}|\Z)')


_UNIT = re.compile(r"(.*?)\s*(?:\[([^\[\]]*)\]|\(([^()]*)\))?")


def name_and_unit(title: str) -> tuple[str, str | None]:
    """Name and unit of a column; None where it has none.

    >>> name_and_unit("E [GPa]"), name_and_unit("u (mm)"), name_and_unit("K0")
    (('E', 'GPa'), ('u', 'mm'), ('K0', None))
    """
    match = _UNIT.fullmatch(title)
    assert match is not None  # any text does
    unit = match[2] or match[3]
    return match[1], unit and unit.strip()


def stray_quote(line: str, cells: list[Cell]) -> Cell | None:
    """The first cell of a line with a quote that does not enclose all of it.

    >>> stray_quote('"a""b",c"d', cells_of('"a""b",c"d', ","))
    Cell(text='c"d', column=8, value=None, joined=False)
    """
    if '"' not in line:
        return None
    written = (cell for cell in cells if '"' in cell.text)
    return next((c for c in written if line[max(c.column - 2, 0) : c.column - 1] != '"'), None)
