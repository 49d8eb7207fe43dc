"""Plain text that fits a terminal of 80 columns: tables, wrapped sentences, headings."""

from __future__ import annotations

import math
import textwrap
from collections.abc import Sequence
from dataclasses import dataclass

WIDTH = 80
GAP = "  "


@dataclass(frozen=True)
class TextTable:
    """Rows of text under a header, for a terminal (`text`) or for a page.

    Args:
        header: names of the columns.
        rows: the cells.
        right: one letter a column, ``r`` for those that are aligned to the right; left without.
    """

    header: Sequence[str]
    rows: Sequence[Sequence[str]]
    right: str = ""

    @property
    def sides(self) -> str:
        """``l`` or ``r`` for every column."""
        return self.right.ljust(len(self.header), "l")

    @property
    def text(self) -> str:
        """The table with columns as wide as they need; empty without rows.

        >>> print(TextTable(["gauge", "mm"], [["EX1", "1.5"], ["CV", "12"]], right="lr").text)
        gauge   mm
        EX1    1.5
        CV      12
        """
        if not self.rows:
            return ""
        lines = [self.header, *self.rows]
        widths = [max(map(len, column)) for column in zip(*lines, strict=True)]
        return "\n".join(_line(cells, widths, self.sides) for cells in lines)


def _line(cells: Sequence[str], widths: Sequence[int], sides: str) -> str:
    padded = (
        cell.rjust(width) if side == "r" else cell.ljust(width)
        for cell, width, side in zip(cells, widths, sides, strict=True)
    )
    return GAP.join(padded).rstrip()


def section(title: str, *paragraphs: str) -> str:
    """A heading and what stands under it; empty if there is nothing under it."""
    body = [paragraph for paragraph in paragraphs if paragraph]
    return "\n".join([title, *body]) if body else ""


def sections(*parts: str) -> str:
    """Sections with an empty line between them."""
    return "\n\n".join(part for part in parts if part)


def sentence(text: str, *, indent: str = "") -> str:
    """A sentence wrapped to the width of the terminal."""
    return textwrap.fill(
        text,
        WIDTH,
        initial_indent=indent,
        subsequent_indent=" " * len(indent),
        break_long_words=False,
        break_on_hyphens=False,
    )


def bullets(sentences: Sequence[str]) -> str:
    """Sentences as a list."""
    return "\n".join(sentence(text, indent="- ") for text in sentences)


def number(value: float, digits: int = 4) -> str:
    """A number with so many significant digits; a dash for none.

    >>> number(15234.5), number(0.25), number(float("nan"))
    ('15230', '0.25', '-')
    """
    if math.isnan(value):
        return "-"
    if math.isinf(value):
        return "inf" if value > 0 else "-inf"
    if value != 0 and 1e-4 <= abs(value) < 1e6:
        places = max(0, digits - 1 - math.floor(math.log10(abs(value))))
        text = f"{float(f'{value:.{digits}g}'):.{places}f}"
        return text.rstrip("0").rstrip(".") if "." in text else text
    return f"{value:.{digits}g}"


def decimals(value: float, places: int) -> str:
    """A number with so many decimals, never ``-0.00``; a dash for none.

    >>> decimals(-0.001, 2)
    '0.00'
    """
    return "-" if math.isnan(value) else f"{value:z.{places}f}"
