"""A file of readings: how it is laid out, its cells, and the numbers, units and dates in them.

What differs from one file to the next is declared by the user (`Layout`); nothing is guessed.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from functools import cached_property
from typing import Literal

from geoident.errors import Fault, Location
from geoident.io.text.dates import ISO, DateError, read_date
from geoident.io.text.wording import shorten
from geoident.units import (
    DIMENSIONLESS,
    UNITS,
    UnitError,
    normal_unit,
    read_quantity,
    size_in,
    unit_list,
    with_article,
)

_GOOD = frozenset({"", "0", "no", "false", "good", "ok"})
_BAD = frozenset({"1", "x", "yes", "true", "bad"})
_COMMA_NUMBER = re.compile(r"[-+]?(?:\d+(?:,\d*)?|,\d+)(?:[eE][-+]?\d+)?")


COLUMNS = ("gauge", "stage", "date", "value", "unit", "accuracy", "bad")


@dataclass(frozen=True)
class Origin:
    """Where the readings of one channel come from in a file.

    Args:
        name: in the column of gauges, or of the column itself in the wide layout.
        unit: of its values; empty for what the file says.
        sign: -1 if the file counts the other way round.
        fields: AGS heading to the value that it must have, such as ``MONG_ID``.
    """

    name: str = ""
    unit: str = ""
    sign: int = 1
    fields: Mapping[str, str] = field(default_factory=dict)


@dataclass(frozen=True)
class Layout:
    """How a file is laid out.

    Args:
        delimiter: one character between columns.
        decimal: ``.`` or ``,``.
        columns: key of `COLUMNS` to its name in the header.
        unit: of all values that say none themselves; empty for none declared.
        date_format: see `geoident.io.text.dates`.
        wide: one column a channel, one row a date or stage.
        unit_row: the line after the header holds the units.
        channels: channel to its origin; empty where the file uses the names of the case.
        dimensions: channel to the dimension of its readings, a key of
            `geoident.units.DIMENSIONS`; lengths where it is not said.
    """

    delimiter: str = ","
    decimal: Literal[".", ","] = "."
    columns: Mapping[str, str] = field(default_factory=dict)
    unit: str = ""
    date_format: str = ISO
    wide: bool = False
    unit_row: bool = False
    channels: Mapping[str, Origin] = field(default_factory=dict)
    dimensions: Mapping[str, str] = field(default_factory=dict)

    def header(self, key: str) -> str:
        """Name of a column in the header, in small letters."""
        return self.columns.get(key, key).strip().lower()

    def dimension(self, channel: str) -> str:
        """Of the readings of a channel."""
        return self.dimensions.get(channel, "length")


@dataclass(frozen=True)
class Cell:
    """The text of a cell and its column, from 1."""

    text: str
    column: int


@dataclass
class Table:
    """A file being read: its layout, its columns and its faults.

    Args:
        file: its path.
        layout: as declared.
        columns: names in the header, in small letters.
        faults: found so far.
    """

    file: str
    layout: Layout = field(default_factory=Layout)
    columns: tuple[str, ...] = ()
    faults: list[Fault] = field(default_factory=list)

    def refuse(self, place: tuple[int, int], code: str, message: str, hint: str = "") -> None:
        """Note a fault at a line and column.

        Args:
            place: line and column, from 1.
            code: what kind of fault it is, for programs.
            message: what is wrong.
            hint: what would be right.
        """
        self.faults.append(Fault(code, message, hint, Location(self.file, *place)))

    def place(self, number: int, cell: Cell) -> Location:
        """Where a cell is."""
        return Location(self.file, number, cell.column)

    @cached_property
    def _cell(self) -> re.Pattern[str]:
        d = re.escape(self.layout.delimiter)
        blank = rf"[^\S{d}]*+"
        return re.compile(rf'{blank}(?:"((?:[^"]|"")*+)"{blank}|([^"{d}]*+))({d}|$)')

    def split(self, number: int, line: str) -> list[Cell]:
        """The cells of a line, with quotes removed; none, with a fault, if they cannot be told."""
        cells: list[Cell] = []
        at = 0
        while True:
            match = self._cell.match(line, at)
            if match is None:
                message = "a quote is not closed on its line, or stands inside a text"
                hint = 'Double quotes enclose a whole cell; inside one write "" for ".'
                self.refuse((number, at + 1), "bad-quote", message, hint)
                return []
            quoted = match[1] is not None
            text = match[1].replace('""', '"') if quoted else match[2].strip()
            cells.append(Cell(text, match.start(1 if quoted else 2) + 1))
            at = match.end()
            if match[3] == "":
                return cells

    def number(self, number: int, cell: Cell) -> float | None:
        """The number in a cell, None where it is blank or, with a fault, none."""
        text = cell.text
        if not text:
            return None
        if self.layout.decimal == ",":
            if not _COMMA_NUMBER.fullmatch(text):
                message = f"'{shorten(text)}' is not a number with a decimal comma"
                hint = "The file is declared with 'decimal: \",\"'; a point has no place in it."
                self.refuse((number, cell.column), "bad-number", message, hint)
                return None
            text = text.replace(",", ".")
        try:
            quantity = read_quantity(text)
        except UnitError as error:
            hint = error.hint
            if "," in text and self.layout.delimiter != ",":
                hint += ' Or declare it: readings: {file: ..., decimal: ","}.'
            self.refuse((number, cell.column), "bad-number", error.message, hint)
            return None
        if quantity.unit:
            message = f"'{shorten(cell.text)}' has a unit; a number is expected"
            hint = "Units stand in the column 'unit'."
            self.refuse((number, cell.column), "bad-number", message, hint)
            return None
        return quantity.value

    def accuracy(self, number: int, cell: Cell | None) -> float | None:
        """A positive number, None where there is none."""
        if cell is None:
            return None
        accuracy = self.number(number, cell)
        if accuracy is not None and accuracy <= 0:
            message = f"the accuracy '{cell.text}' is not positive"
            self.refuse((number, cell.column), "out-of-range", message)
        return accuracy

    def unit(self, number: int, cell: Cell, dimension: str) -> float | None:
        """Size of a unit in the SI unit of a dimension; None, with a fault, if it is none of it.

        Args:
            number: of the line.
            cell: the unit as written.
            dimension: of what is read, a key of `geoident.units.DIMENSIONS`.
        """
        try:
            unit = normal_unit(cell.text, dimension)
        except UnitError as error:
            comma = cell.text.replace(".", "").isdigit()
            hint = "If the value has a decimal comma, write a point." if comma else error.hint
            self.refuse((number, cell.column), "unit", error.message, hint)
            return None
        factor = size_in(unit, dimension) if unit or dimension == DIMENSIONLESS else None
        if factor is not None:
            return factor
        text, found, wanted = cell.text, UNITS[unit][0], with_article(dimension)
        message = f"'{text}' is the unit of {with_article(found)}" if text else "no unit"
        hint = f"Units of {dimension}: {unit_list(dimension)}."
        self.refuse((number, cell.column), "unit", f"{message}; {wanted} is expected", hint)
        return None

    def date(self, number: int, cell: Cell) -> float | None:
        """Seconds since 1970; None, with a fault, if it is no date of the declared format."""
        try:
            return read_date(cell.text, self.layout.date_format)
        except DateError as error:
            hint = "Declare the format: readings: {file: ..., date_format: DD.MM.YYYY hh:mm}."
            self.refuse((number, cell.column), "bad-date", str(error), hint)
            return None


def flag(text: str) -> str:
    """Why a reading is not to be used, from the column ``bad``; empty for a good one.

    >>> flag("no"), flag("x"), flag("head hit by blast")
    ('', 'flagged in the file', 'head hit by blast')
    """
    word = text.strip().lower()
    if word in _GOOD:
        return ""
    return "flagged in the file" if word in _BAD else text.strip()


def lines(text: str, delimiter: str) -> Iterator[tuple[int, str]]:
    """Number and text of the lines that hold something."""
    for number, line in enumerate(text.replace("\r\n", "\n").replace("\r", "\n").split("\n"), 1):
        if line.strip(f" \t{delimiter}") and not line.lstrip().startswith("#"):
            yield number, line
