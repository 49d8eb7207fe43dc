"""Plain text that fits a terminal of 80 columns: tables, wrapped sentences, headings."""

from __future__ import annotations

import math
import textwrap
from collections.abc import Sequence
from dataclasses import dataclass
from datetime import UTC, datetime, timedelta

from geoident.units import in_unit, shown_unit

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
    def filled(self) -> TextTable:
        """The same without columns in which no row has anything.

        >>> TextTable(["gauge", "mm", "band"], [["EX1", "1.5", "-"], ["CV", "2", ""]]).filled.header
        ['gauge', 'mm']
        """
        cells = zip(*self.rows, strict=True)
        return self._only([k for k, column in enumerate(cells) if {*column} - {"", "-"}])

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
        lines, widths = [self.header, *self.rows], self._widths
        return "\n".join(_line(cells, widths, self.sides) for cells in lines)

    def folded(self, keys: int = 1) -> str:
        """The table as text no wider than the terminal: columns that do not fit follow below.

        A single column that is too wide by itself stays as it is.

        Args:
            keys: the first columns, which are repeated with each part.
        """
        if not self.rows:
            return ""
        parts: list[list[int]] = [[]]
        room = WIDTH - sum(width + len(GAP) for width in self._widths[:keys]) + len(GAP)
        left = room
        for column, width in enumerate(self._widths[keys:], start=keys):
            needed = width + len(GAP)
            if needed > left and parts[-1]:
                parts.append([])
                left = room
            parts[-1].append(column)
            left -= needed
        return "\n\n".join(self._only([*range(keys), *part]).text for part in parts)

    @property
    def _widths(self) -> list[int]:
        """Characters of each column."""
        return [max(map(len, column)) for column in zip(self.header, *self.rows, strict=True)]

    def _only(self, columns: Sequence[int]) -> TextTable:
        rows = [[row[k] for k in columns] for row in self.rows]
        sides = "".join(self.sides[k] for k in columns)
        return TextTable([self.header[k] for k in columns], rows, sides)


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


def with_interval(value: float, low: float, high: float, *, most: int = 99) -> tuple[str, str, str]:
    """A value and the ends of its interval with as many digits as the interval warrants.

    All three are rounded to the second significant digit of the width of the interval. Where the
    interval does not hold zero, the value keeps three significant digits at least and the ends two.
    Where there is no interval, each is a `number`.

    Args:
        value: in the unit in which it is shown.
        low: lower end, in the same.
        high: upper end.
        most: decimals at most, such as those that a gauge can read.

    >>> with_interval(9.98765, 8.4912, 11.7049)
    ('9.99', '8.5', '11.7')
    >>> with_interval(15234.5, 14873.0, 15570.0), with_interval(0.25, 0.25, 0.25)
    (('15230', '14870', '15570'), ('0.25', '0.25', '0.25'))
    """
    width = high - low
    if not (math.isfinite(value) and math.isfinite(width) and width > 0.0):
        return number(value), number(low), number(high)
    places = min(_places(width), most)
    apart = 2 if low * high > 0.0 else 0
    return (
        _rounded(value, places, apart + 1, most),
        _rounded(low, places, apart, most),
        _rounded(high, places, apart, most),
    )


def shown_interval(
    value: float, low: float, high: float, unit: str, dimension: str, *, between: str = " to "
) -> tuple[str, str]:
    """A value, and its interval where there is one, in a unit with the digits that it warrants.

    Args:
        value: SI.
        low: lower end, SI; NaN for none.
        high: upper end.
        unit: as the user wrote it.
        dimension: of the value.
        between: what stands between the ends.

    >>> shown_interval(9.98765e9, 8.4912e9, 11.7049e9, "GPa", "pressure")
    ('9.99', '8.5 to 11.7')
    """
    ends = (in_unit(float(x), unit, dimension) for x in (value, low, high))
    text, lower, upper = with_interval(*ends)
    return text, "" if lower == "-" else f"{lower}{between}{upper}"


def with_unit(name: str, unit: str, dimension: str, *, form: str = "{} ({})") -> str:
    """A name with the unit of its numbers, where they have one.

    >>> with_unit("E", "GPa", "pressure"), with_unit("K0", "", "")
    ('E (GPa)', 'K0')
    """
    shown = shown_unit(unit, dimension)
    return form.format(name, shown) if shown else name


_FARTHEST = 2.5e11
"""Seconds from 1970 to the year 9892: what is farther is damage, and NaN is no time."""


def moment_text(seconds: float) -> str | None:
    """Date and time (ISO 8601) of seconds since 1970; None for NaN and what is no date.

    >>> moment_text(86400.0)
    '1970-01-02T00:00:00'
    """
    if not abs(seconds) < _FARTHEST:
        return None
    moment = datetime(1970, 1, 1, tzinfo=UTC) + timedelta(seconds=seconds)
    return moment.replace(tzinfo=None).isoformat(timespec="seconds")


_MOST_DIGITS = 6


def _places(width: float) -> int:
    """Decimals of the second significant digit of a width; negative for tens and hundreds."""
    return 1 - math.floor(math.log10(width))


def _rounded(value: float, places: int, least: int, most: int) -> str:
    """A number with so many decimals, but so many significant digits at least."""
    if value == 0.0:
        return decimals(0.0, max(0, places))
    power = math.floor(math.log10(abs(value)))
    places = min(max(places, least - 1 - power), most, _MOST_DIGITS - 1 - power)
    if not 1e-4 <= abs(value) < 1e6:
        return number(value, places + power + 1) if places + power >= 0 else "0"
    return decimals(round(value, places), max(0, places))
