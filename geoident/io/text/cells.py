"""Cells of a line of a table: what stands between commas, semicolons or tabs, and where."""

from __future__ import annotations

import re
from collections.abc import Iterator
from dataclasses import dataclass

_QUOTED = re.compile(r'"((?:[^"]|"")*)"\s*')


@dataclass(frozen=True)
class TextCell:
    """A cell of a line.

    Args:
        text: of it, without quotes.
        column: of its first character, from 1.
    """

    text: str
    column: int


def said_lines(text: str) -> Iterator[tuple[int, str]]:
    r"""Number, from 1, and text of the lines that hold something and are no remark.

    >>> list(said_lines("# a table\nE,K0\n\n1,2\n"))
    [(2, 'E,K0'), (4, '1,2')]
    """
    for number, line in enumerate(text.splitlines(), 1):
        if line.strip() and not line.startswith("#"):
            yield number, line


def delimiter_of(header: str) -> str:
    """What stands between the cells of a header: the comma, semicolon or tab it has most of.

    >>> delimiter_of("E [GPa];K0;roof, mm")
    ';'
    """
    plain = re.sub(r"\"[^\"]*\"", "", header)
    return max(",;\t", key=plain.count)


def cells_of(line: str, delimiter: str) -> list[TextCell]:
    """The cells of a line; in quotes, two quotes are one and the delimiter is a character.

    >>> [(c.text, c.column) for c in cells_of('a, "[b, c]",', ",")]
    [('a', 1), ('[b, c]', 4), ('', 13)]
    """
    cells: list[TextCell] = []
    at = 0
    while True:
        start = at
        while line.startswith(" ", start):
            start += 1
        quoted = _QUOTED.match(line, start)
        if quoted and (quoted.end() == len(line) or line[quoted.end()] == delimiter):
            end, text = quoted.end(), quoted[1].replace('""', '"')
        else:
            end = line.find(delimiter, at)
            end = len(line) if end < 0 else end
            text = line[at:end].strip()
        cells.append(TextCell(text, min(start, end) + 1))
        if end >= len(line):
            return cells
        at = end + 1
