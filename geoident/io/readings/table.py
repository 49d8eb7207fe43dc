"""A file of readings: how it is laid out, its cells, and the numbers, units and dates in them.

What differs from one file to the next is declared by the user (`Layout`); nothing is guessed.
"""

from __future__ import annotations

import math
import re
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from datetime import UTC, datetime
from functools import cached_property
from typing import Literal

from geoident.errors import Fault, InputError, Location
from geoident.io.readings.calibration import Calibration, raw_unit
from geoident.io.readings.survey import SurveyGrid
from geoident.io.text.dates import ISO, DateError, date_hint, read_date
from geoident.io.text.wording import did_you_mean, shorten
from geoident.model.gauges import Reading
from geoident.units import (
    DIMENSIONLESS,
    LEAST_SD,
    MOST_SD,
    NUMBER_PATTERN,
    UNITS,
    UnitError,
    normal_unit,
    read_quantity,
    size_in,
    unit_list,
    with_article,
)

_GOOD = frozenset(
    {"", "0", "0.0", "0,0", "n", "no", "nein", "non", "false", "f", "good", "ok", "none", "nil"}
    | {"n/a", "na", "nan", "null", "not bad", ".", "-", "--", "---", "\N{EN DASH}", "\N{EM DASH}"}
)
"""What people write in a cell that has nothing to say."""
_BAD = frozenset({"1", "x", "yes", "true", "bad"})
_POINT_NUMBER = re.compile(NUMBER_PATTERN)
_COMMA_NUMBER = re.compile(r"[-+]?(?:\d+(?:,\d*)?|,\d+)(?:[eE][-+]?\d+)?")


COLUMNS = ("gauge", "stage", "date", "value", "unit", "accuracy", "bad", "remarks")
POINT_COLUMNS = ("point", "east", "north", "height")
"""Columns of the layout of coordinates, beside stage or date, bad and remarks."""
_ERRORS = frozenset(
    {"#DIV/0!", "#N/A", "#NAME?", "#NULL!", "#NUM!", "#REF!", "#VALUE!", "#SPILL!", "#CALC!"}
)
"""What a cell of a sheet holds whose formula failed (ECMA-376, 18.17.3)."""
ENCODING_HINT = (
    "Declare its encoding: readings: {file: ..., encoding: windows-1252}, or save it as UTF-8."
)
_CALIBRATE = (
    "State the sensor's calibration: channels: {CHANNEL: {calibration: {reads: %s, factor: ..., "
    "zero: ..., difference: zero - reading}}}."
)


class FaultyReadings(InputError):
    """A file of readings with faults; other rows of it may be right.

    Args:
        faults: what is wrong.
        rows: readings of the other rows, and those of faulty rows without their values, so that
            these can be held against the case nonetheless.
    """

    def __init__(self, faults: Iterable[Fault], rows: Iterable[Reading]) -> None:
        self.rows = tuple(rows)
        super().__init__(faults)


@dataclass(frozen=True)
class Origin:
    """Where the readings of one channel come from in a file.

    Args:
        name: in the column of gauges, or of the column itself in the wide layout.
        unit: of its values; empty for what the file says.
        sign: -1 if the file counts the other way round.
        fields: AGS heading to the value that it must have, such as ``MONG_ID``.
        calibration: makes readings of what the sensor gives; None where the file has readings.
    """

    name: str = ""
    unit: str = ""
    sign: int = 1
    fields: Mapping[str, str] = field(default_factory=dict)
    calibration: Calibration | None = None


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
        encoding: codec of a text; empty for UTF-8.
        header_row: line or row of the (first) header; 0 for the first that holds something.
        header_rows: rows over which the names of the columns are spread.
        data_row: first line or row of readings; 0 for that after the header.
        blank: texts of cells that stand for a missing reading.
        ignore: names of columns that are not read, in small letters.
        sheet: name of the sheet of a workbook; empty for its only one.
        cells: range of the sheet, such as ``B4:H60``; empty for all.
        survey: how coordinates become readings; None where the file has readings.
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
    encoding: str = ""
    header_row: int = 0
    header_rows: int = 1
    data_row: int = 0
    blank: tuple[str, ...] = ()
    ignore: tuple[str, ...] = ()
    sheet: str = ""
    cells: str = ""
    survey: SurveyGrid | None = None

    def header(self, key: str) -> str:
        """Name of a column in the header, in small letters."""
        return self.columns.get(key, key).strip().lower()

    def dimension(self, channel: str) -> str:
        """Of the readings of a channel."""
        return self.dimensions.get(channel, "length")


@dataclass(frozen=True)
class Cell:
    """A cell.

    Args:
        text: that it shows.
        column: from 1: of its first character in a text, of the cell in a sheet.
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
class UnitScale:
    """From the number in a cell to a reading in SI units.

    Args:
        factor: size of the unit, with the sign.
        calibration: of the sensor that gives the number; None where it is the reading.
        sign: of the calibrated reading.
    """

    factor: float = 1.0
    calibration: Calibration | None = None
    sign: int = 1

    def reading(self, number: float, temperature: float | None = None) -> float:
        """The reading, SI.

        Args:
            number: in the cell.
            temperature: of the sensor, degrees Celsius, where its calibration needs it.
        """
        if self.calibration is None:
            return self.factor * number
        return self.sign * self.calibration.reading(number, temperature)

    def accuracy(self, sd: float, number: float | None) -> float:
        """Standard deviation of the reading, SI, from that of the number."""
        if self.calibration is None:
            return abs(self.factor) * sd
        return sd * abs(self.calibration.slope(number or 0.0))


@dataclass
class Table:
    """A file being read: its layout, its columns and its faults.

    Args:
        file: its path.
        layout: as declared.
        columns: names in the header, in small letters.
        faults: found so far.
        sheet: of a workbook; empty for a text.
    """

    file: str
    layout: Layout = field(default_factory=Layout)
    columns: tuple[str, ...] = ()
    faults: list[Fault] = field(default_factory=list)
    sheet: str = ""

    def refuse(self, place: tuple[int, int], code: str, message: str, hint: str = "") -> None:
        """Note a fault at a line and column.

        Args:
            place: line and column, from 1.
            code: what kind of fault it is, for programs.
            message: what is wrong.
            hint: what would be right.
        """
        location = Location(self.file, *place, self.sheet)
        self.faults.append(Fault(code, message, hint, location))

    def place(self, line: int, cell: Cell) -> Location:
        """Where a cell is."""
        return Location(self.file, line, cell.column, self.sheet)

    @cached_property
    def _cell(self) -> re.Pattern[str]:
        d = re.escape(self.layout.delimiter)
        blank = rf"[^\S{d}]*+"
        return re.compile(rf'{blank}(?:"((?:[^"]|"")*+)"{blank}|([^"{d}]*+))({d}|$)')

    def split(self, line: int, text: str) -> list[Cell]:
        """The cells of a line, with quotes removed; none, with a fault, if they cannot be told."""
        cells: list[Cell] = []
        at = 0
        while True:
            match = self._cell.match(text, at)
            if match is None:
                message = "a quote is not closed on its line, or stands inside a text"
                hint = 'Double quotes enclose a whole cell; inside one write "" for ".'
                self.refuse((line, at + 1), "bad-quote", message, hint)
                return []
            quoted = match[1] is not None
            inside = match[1].replace('""', '"') if quoted else match[2].strip()
            cells.append(Cell(inside, match.start(1 if quoted else 2) + 1))
            at = match.end()
            if match[3] == "":
                return cells

    def measured(self, line: int, cell: Cell) -> float | None:
        """What was read once, so in a cell of its own; else as `read_number`."""
        if cell.joined and cell.text:
            message = f"the reading '{shorten(cell.text)}' stands in a cell that joins several"
            hint = "Unmerge them, and leave it where it was read."
            self.refuse((line, cell.column), "joined-cell", message, hint)
            return None
        return self.read_number(line, cell)

    def read_number(self, line: int, cell: Cell) -> float | None:
        """The number in a cell, None where it is blank or, with a fault, none."""
        if isinstance(cell.value, float) and math.isfinite(cell.value):
            return cell.value
        if not cell.text or self._refused_of_a_sheet(line, cell):
            return None
        text = cell.text
        if self.layout.decimal == ",":
            if not _COMMA_NUMBER.fullmatch(text):
                message = f"'{shorten(text)}' is not a number with a decimal comma"
                hint = "The file is declared with 'decimal: \",\"'; a point has no place in it."
                hint = self._if_blank(text) or hint
                self.refuse((line, cell.column), "bad-number", message, hint)
                return None
            text = text.replace(",", ".")
        return self._plain_number(line, cell, text)

    def _plain_number(self, line: int, cell: Cell, text: str) -> float | None:
        """The number that a text says with a decimal point; None, with a fault, if it is none."""
        try:
            quantity = read_quantity(text)
        except UnitError as error:
            finite = "finite" not in error.message
            hint = (self._if_blank(text) if finite else "") or error.hint
            if "," in text and self.layout.delimiter != ",":
                hint += ' Or declare it: readings: {file: ..., decimal: ","}.'
            self.refuse((line, cell.column), "bad-number", error.message, hint)
            return None
        if quantity.unit:
            message = f"'{shorten(cell.text)}' has a unit; a number is expected"
            hint = "Units stand in the column 'unit'."
            self.refuse((line, cell.column), "bad-number", message, hint)
            return None
        return quantity.value

    @staticmethod
    def _if_blank(text: str) -> str:
        """The remedy where a text looks like a mark for a missing reading."""
        if any(letter.isdigit() for letter in text) or "," in text:
            return ""
        return f"If it stands for a missing reading, declare it: blank: ['{shorten(text)}']."

    def _refused_of_a_sheet(self, line: int, cell: Cell) -> bool:
        """Note a cell of a sheet that holds no number, but a date, an error or a formula."""
        text, place = cell.text, (line, cell.column)
        if isinstance(cell.value, datetime):
            message = f"the cell holds the date {text}; a number is expected"
            hint = "If Excel made a date of a number, type it again in a cell formatted as number."
            self.refuse(place, "bad-number", message, hint)
        elif self.sheet and text.startswith("="):
            message = f"the result of the formula '{shorten(text)}' is not stored in the file"
            hint = "Open the workbook in Excel, compute and save it, or paste values."
            self.refuse(place, "no-stored-value", message, hint)
        elif self.sheet and text.upper() in _ERRORS:
            message = f"the cell holds the error {text}; a number is expected"
            hint = f"Correct the sheet, or declare it as missing: blank: ['{text}']."
            self.refuse(place, "cell-error", message, hint)
        else:
            return False
        return True

    def accuracy(self, line: int, cell: Cell | None) -> float | None:
        """A positive number, None where there is none."""
        if cell is None:
            return None
        accuracy = self.read_number(line, cell)
        if accuracy is not None and accuracy <= 0:
            message = f"the accuracy '{cell.text}' is not positive"
            self.refuse((line, cell.column), "out-of-range", message)
        elif accuracy is not None and not LEAST_SD <= accuracy <= MOST_SD:
            message = f"the accuracy '{cell.text}' is implausible for a gauge"
            hint = f"From {LEAST_SD:g} to {MOST_SD:g} is expected."
            self.refuse((line, cell.column), "out-of-range", message, hint)
        return accuracy

    def require_ignored(self, line: int, cells: Sequence[Cell]) -> None:
        """Note names of columns to be ignored that the header does not have."""
        names = [cell.text for cell in cells if cell.text]
        for name in self.layout.ignore:
            if name not in {text.lower() for text in names}:
                hint = did_you_mean(name, names, what="Columns")
                message = f"there is no column '{name}' to be ignored"
                self.refuse((line, 1), "bad-header", message, hint)

    def refuse_missing(
        self, line: int, cells: Sequence[Cell], known: Iterable[str], header: str
    ) -> bool:
        """Note that a row of numbers stands in place of the header; whether it is so.

        Args:
            line: its number.
            cells: of the row.
            known: names in small letters of which a header has one.
            header: that could stand above it.
        """
        numbers = _COMMA_NUMBER if self.layout.decimal == "," else _POINT_NUMBER
        if {cell.text.lower() for cell in cells if cell.text} & {*known, *self.layout.ignore}:
            return False
        if not any(isinstance(c.value, float) or numbers.fullmatch(c.text) for c in cells):
            return False
        row = "row" if self.sheet else "line"
        message = f"this {row} is no header: it has numbers, and none of the names of columns"
        hint = f"If it is a reading already, put a header above it: {header}. If the header is "
        hint += "further down, declare its row: readings: {file: ..., header_row: ...}."
        self.refuse((line, 1), "bad-header", message, hint)
        return True

    def refuse_nameless(self, line: int, cells: Sequence[Cell], nameless: dict[int, bool]) -> bool:
        """Note cells of a row in columns that have no name in the header; whether there are any.

        Args:
            line: its number.
            cells: of the row.
            nameless: index of such a column to whether a cell in it is noted; once is enough.
        """
        found = [n for n in nameless if n < len(cells) and cells[n].text]
        for n in found:
            if nameless[n]:
                continue
            nameless[n] = True
            text = shorten(cells[n].text)
            message = f"column {n + 1} has no name in the header, and here is '{text}' in it"
            hint = "Name the column, or empty it; if a number has a decimal comma, write a point."
            self.refuse((line, cells[n].column), "bad-header", message, hint)
        return bool(found)

    def temperature_columns(self, line: int, cells: Sequence[Cell]) -> dict[str, int]:
        """Name, in small letters, to index of the columns in which calibrations find temperatures.

        A name that the header does not have is noted.
        """
        names = [cell.text.lower() for cell in cells]
        found: dict[str, int] = {}
        for channel, origin in self.layout.channels.items():
            wanted = origin.calibration.temperature if origin.calibration else ""
            if not wanted:
                continue
            if wanted.lower() in names:
                found[wanted.lower()] = names.index(wanted.lower())
            else:
                hint = did_you_mean(wanted, [c.text for c in cells if c.text], what="Columns")
                message = f"there is no column '{wanted}', the temperature of '{channel}'"
                self.refuse((line, 1), "bad-header", message, hint)
        return found

    def temperature(
        self,
        line: int,
        cells: Sequence[Cell],
        columns: Mapping[str, int],
        calibration: Calibration,
    ) -> float | None:
        """Temperature of a sensor in a row, degrees Celsius; None where none is needed.

        Args:
            line: its number.
            cells: of the row.
            columns: as `temperature_columns` found them.
            calibration: of the sensor; a missing temperature that it needs is noted.
        """
        if not calibration.temperature:
            return None
        at = columns[calibration.temperature.lower()]
        cell = cells[at] if at < len(cells) else Cell("", 1)
        found = self.read_number(line, cell)
        if found is None and not cell.text:
            message = f"the temperature of the sensor is missing ('{calibration.temperature}')"
            hint = "Its calibration needs it; leave the reading blank, or 'thermal' out."
            self.refuse((line, cell.column), "missing-temperature", message, hint)
        return found

    def scale(self, line: int, cell: Cell, dimension: str, origin: Origin) -> UnitScale | None:
        """How the numbers of a channel become readings; None, with a fault, if they cannot.

        Args:
            line: of the unit.
            cell: the unit as written.
            dimension: of what is read.
            origin: what is declared of the channel.
        """
        known = origin.calibration
        if known is None:
            factor = self.unit(line, cell, dimension)
            return None if factor is None else UnitScale(origin.sign * factor)
        found = raw_unit(cell.text)
        if cell.text and found != known.reads:
            message = f"'{cell.text}' is not what the calibration is for, '{known.reads}'"
            hint = "Correct 'reads' of the calibration, or leave it out where readings are given."
            self.refuse((line, cell.column), "unit", message, hint)
            return None
        return UnitScale(1.0, known, origin.sign)

    def unit(self, line: int, cell: Cell, dimension: str) -> float | None:
        """Size of a unit in the SI unit of a dimension; None, with a fault, if it is none of it.

        Args:
            line: its number.
            cell: the unit as written.
            dimension: of what is read, a key of `geoident.units.DIMENSIONS`.
        """
        raw = raw_unit(cell.text)
        if raw is not None and dimension != "frequency":
            message = (
                f"'{cell.text}' is what the sensor gives; {with_article(dimension)} is expected"
            )
            self.refuse((line, cell.column), "unit", message, _CALIBRATE % raw)
            return None
        try:
            unit = normal_unit(cell.text, dimension)
        except UnitError as error:
            comma = cell.text.replace(".", "").isdigit()
            hint = "If the value has a decimal comma, write a point." if comma else error.hint
            self.refuse((line, cell.column), "unit", error.message, hint)
            return None
        factor = size_in(unit, dimension) if unit or dimension == DIMENSIONLESS else None
        if factor is not None:
            return factor
        text, found, wanted = cell.text, UNITS[unit][0], with_article(dimension)
        message = f"'{text}' is the unit of {with_article(found)}" if text else "no unit"
        hint = f"Units of {dimension}: {unit_list(dimension)}."
        self.refuse((line, cell.column), "unit", f"{message}; {wanted} is expected", hint)
        return None

    def date(self, line: int, cell: Cell) -> float | None:
        """Seconds since 1970; None, with a fault, if it is no date of the declared format."""
        if isinstance(cell.value, datetime):
            return cell.value.replace(tzinfo=UTC).timestamp()
        if isinstance(cell.value, float):
            message = f"the cell holds the number {cell.text}, not a date"
            hint = "Format the column in Excel as a date (not as number or text), and save it."
            self.refuse((line, cell.column), "bad-date", message, hint)
            return None
        if self._refused_of_a_sheet(line, cell):
            return None
        try:
            return read_date(cell.text, self.layout.date_format)
        except DateError as error:
            hint = date_hint(cell.text, self.layout.date_format)
            self.refuse((line, cell.column), "bad-date", str(error), hint)
            return None


def flag(text: str) -> str:
    """Why a reading is not to be used, from the column ``bad``; empty for a good one.

    A dash, or what else stands for an empty cell, is no reason.

    >>> flag("no"), flag("-"), flag("x"), flag("head hit by blast")
    ('', '', 'flagged in the file', 'head hit by blast')
    """
    word = text.strip().lower()
    if word in _GOOD:
        return ""
    return "flagged in the file" if word in _BAD else text.strip()


def lines(text: str, delimiter: str) -> Iterator[tuple[int, str]]:
    """Number and text of the lines that hold something."""
    for line, found in enumerate(text.replace("\r\n", "\n").replace("\r", "\n").split("\n"), 1):
        if found.strip(f" \t{delimiter}") and not found.lstrip().startswith("#"):
            yield line, found


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
