"""A file of readings that is being read: its faults; numbers, units and dates in its cells."""

from __future__ import annotations

import math
import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from datetime import UTC, datetime

from geoident.errors import Fault, InputError, Location
from geoident.io.readings.calibration import Calibration, raw_unit
from geoident.io.readings.layout import Layout, Origin
from geoident.io.text.cells import Cell, name_and_unit
from geoident.io.text.dates import DateError, date_hint, read_date, utc_offset
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
_ERRORS = frozenset(
    {"#DIV/0!", "#N/A", "#NAME?", "#NULL!", "#NUM!", "#REF!", "#VALUE!", "#SPILL!", "#CALC!"}
)
"""What a cell of a sheet holds whose formula failed (ECMA-376, 18.17.3)."""
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
class UnitScale:
    """From the number in a cell to a reading in SI units.

    Args:
        factor: size of the unit, with the sign.
        calibration: of the sensor that gives the number; None where it is the reading.
        sign: of the calibrated reading.
        unit: of the number, where it is the reading.
    """

    factor: float = 1.0
    calibration: Calibration | None = None
    sign: int = 1
    unit: str = ""

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
    """A file of readings.

    Args:
        file: its path.
        layout: as declared.
        sheet: of a workbook; empty for a text.
        faults: noted so far.
        temperatures: name in small letters to index of the columns in which calibrations find
            temperatures.
        time_unit: unit of the column of times, if its header has it.
    """

    file: str
    layout: Layout = field(default_factory=Layout)
    sheet: str = ""
    faults: list[Fault] = field(default_factory=list)
    temperatures: dict[str, int] = field(default_factory=dict)
    time_unit: str = ""
    _commas: list[str] = field(default_factory=list)
    _first_comma: int = 0

    def refuse(self, line: int, at: Cell | int, code: str, message: str, hint: str = "") -> None:
        """Note a fault in a line (0 for none), at a cell or column.

        Args:
            line: from 1.
            at: the cell, or its column from 1.
            code: what kind of fault it is, for programs.
            message: what is wrong.
            hint: what would be right.
        """
        column = at if isinstance(at, int) else at.column
        self.faults.append(
            Fault(code, message, hint, Location(self.file, line, column, self.sheet))
        )

    def place(self, line: int, cell: Cell) -> Location:
        """Where a cell is."""
        return Location(self.file, line, cell.column, self.sheet)

    # What a header says

    def header_missing(
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
        message = f"this {row} is not a header: it has numbers, and none of the names of columns"
        hint = f"If it is a reading already, put a header above it: {header}. If the header is "
        hint += f"further down, declare its row: {self.layout.declaring('header_row: ...')}."
        self.refuse(line, 1, "bad-header", message, hint)
        return True

    def declared_columns(self, line: int, cells: Sequence[Cell]) -> None:
        """Note columns to be ignored and of temperatures that the header does not have."""
        names = [cell.text for cell in cells if cell.text]
        lower = [cell.text.lower() for cell in cells]
        for name in (name for name in self.layout.ignore if name not in lower):
            message = f"there is no column '{name}' to be ignored"
            self.refuse(line, 1, "bad-header", message, did_you_mean(name, names, what="Columns"))
        for channel, origin in self.layout.channels.items():
            wanted = origin.calibration.temperature if origin.calibration else ""
            if wanted and wanted.lower() in lower:
                self.temperatures[wanted.lower()] = lower.index(wanted.lower())
            elif wanted:
                message = f"there is no column '{wanted}', the temperature of '{channel}'"
                hint = did_you_mean(wanted, names, what="Columns")
                self.refuse(line, 1, "bad-header", message, hint)

    def nameless(self, line: int, cells: Sequence[Cell], columns: dict[int, bool]) -> bool:
        """Note cells of a row in columns that have no name in the header; whether there are any.

        Args:
            line: its number.
            cells: of the row.
            columns: index of such a column to whether a cell in it is noted; once is enough.
        """
        filled = [n for n in columns if n < len(cells) and cells[n].text]
        for n in (n for n in filled if not columns[n]):
            columns[n] = True
            message = f"column {n + 1} has no name in the header, "
            message += f"and here is '{shorten(cells[n].text)}' in it"
            hint = "Name the column, or empty it; if a number has a decimal comma, write a point."
            self.refuse(line, cells[n], "bad-header", message, hint)
        return bool(filled)

    def too_wide(self, line: int, cells: Sequence[Cell], width: int, hint: str) -> bool:
        """Note cells behind the last column of the header; whether there are any."""
        if not any(cell.text for cell in cells[width:]):
            return False
        message = f"the row has {len(cells)} columns, the header {width}"
        self.refuse(line, cells[width], "too-many-columns", message, hint)
        return True

    # What cells say

    def number(self, line: int, cell: Cell) -> float | None:
        """The number in a cell, None where it is blank or, with a fault, none."""
        if isinstance(cell.value, float) and math.isfinite(cell.value):
            return cell.value
        if not cell.text or self._refused_of_a_sheet(line, cell):
            return None
        text, comma = cell.text, self.layout.decimal == ","
        if comma and not _COMMA_NUMBER.fullmatch(text):
            message = f"'{shorten(text)}' is not a number with a decimal comma"
            hint = "The file is declared with 'decimal: \",\"'; a point has no place in it."
            self.refuse(line, cell, "bad-number", message, _if_blank(text) or hint)
            return None
        try:
            quantity = read_quantity(text.replace(",", ".") if comma else text)
        except UnitError as error:
            hint = (_if_blank(text) if "finite" not in error.message else "") or error.hint
            if "," in text and not comma and self.layout.delimiter != ",":
                self._decimal_comma(line, cell, error.message, hint)
            else:
                self.refuse(line, cell, "bad-number", error.message, hint)
            return None
        if quantity.unit:
            message = f"'{shorten(cell.text)}' has a unit; expected a number"
            self.refuse(line, cell, "bad-number", message, "Units stand in the column 'unit'.")
            return None
        return quantity.value

    def _decimal_comma(self, line: int, cell: Cell, message: str, hint: str) -> None:
        """Note a number with a comma; of several in a file there is one fault, at the first.

        Args:
            line: its number.
            cell: the cell.
            message: what is wrong with this one.
            hint: how it would be right.
        """
        declared = self.layout.declaring('decimal: ","')
        if not self._commas:
            self._first_comma = len(self.faults)
            self.refuse(line, cell, "bad-number", message, f"{hint} Or declare it: {declared}.")
        self._commas.append(cell.text)
        if len(self._commas) > 1:
            first, more = self._commas[0], len(self._commas) - 1
            message = f"'{shorten(first)}' and {more} more number{'s' * (more > 1)} of the file "
            message += "have a comma, which can be read in two ways"
            hint = f"If it is the decimal mark, declare it: {declared}; else leave commas out."
            fault = self.faults[self._first_comma]
            self.faults[self._first_comma] = replace(fault, message=message, hint=hint)

    def _refused_of_a_sheet(self, line: int, cell: Cell) -> bool:
        """Note a cell of a sheet that holds no number, but a date, an error or a formula."""
        text = cell.text
        if isinstance(cell.value, datetime):
            message = f"the cell holds the date {text}; expected a number"
            hint = "If Excel made a date of a number, type it again in a cell formatted as number."
            self.refuse(line, cell, "bad-number", message, hint)
        elif self.sheet and text.startswith("="):
            message = f"the result of the formula '{shorten(text)}' is not stored in the file"
            hint = "Open the workbook in Excel, compute and save it, or paste values."
            self.refuse(line, cell, "no-stored-value", message, hint)
        elif self.sheet and text.upper() in _ERRORS:
            message = f"the cell holds the error {text}; expected a number"
            hint = f"Correct the sheet, or declare it as missing: blank: ['{text}']."
            self.refuse(line, cell, "cell-error", message, hint)
        else:
            return False
        return True

    def measured(self, line: int, cell: Cell) -> float | None:
        """What was read once, so in a cell of its own; else as `number`."""
        if not (cell.joined and cell.text):
            return self.number(line, cell)
        message = f"the reading '{shorten(cell.text)}' stands in a cell that joins several"
        hint = "Unmerge them, and leave it where it was read."
        self.refuse(line, cell, "joined-cell", message, hint)
        return None

    def accuracy(self, line: int, cell: Cell) -> float | None:
        """A positive number, None where there is none."""
        accuracy = self.number(line, cell)
        if accuracy is not None and accuracy <= 0:
            message = f"the accuracy '{cell.text}' is not positive"
            self.refuse(line, cell, "out-of-range", message)
        elif accuracy is not None and not LEAST_SD <= accuracy <= MOST_SD:
            message = f"the accuracy '{cell.text}' is implausible for a gauge"
            hint = f"From {LEAST_SD:g} to {MOST_SD:g} is expected."
            self.refuse(line, cell, "out-of-range", message, hint)
        return accuracy

    def date(self, line: int, cell: Cell) -> float | None:
        """Seconds since 1970; None, with a fault, if it is no date of the declared format."""
        if isinstance(cell.value, datetime):
            return cell.value.replace(tzinfo=UTC).timestamp()
        if isinstance(cell.value, float):
            message = f"the cell holds the number {cell.text}, not a date"
            hint = "Format the column in Excel as a date (not as number or text), and save it."
            self.refuse(line, cell, "bad-date", message, hint)
            return None
        if self._refused_of_a_sheet(line, cell):
            return None
        try:
            return read_date(cell.text, self.layout.date_format)
        except DateError as error:
            hint = date_hint(cell.text, self.layout.date_format, self.layout.declaring)
            self.refuse(line, cell, "bad-date", str(error), hint)
            return None

    def column_names(self, line: int, cells: Sequence[Cell], keys: Mapping[str, str]) -> list[str]:
        """The names of columns in small letters, that of a time without its unit.

        A time beside a date is refused: it counts from the beginning of a stage.

        Args:
            line: of the header.
            cells: of the header.
            keys: names of columns in small letters to what they are.
        """
        names = [cell.text.lower() for cell in cells]
        kinds = [keys.get(name) for name in names if name not in self.layout.ignore]
        dated = "date" in kinds and "stage" not in kinds
        for n, cell in enumerate(cells):
            name, unit = name_and_unit(cell.text)
            name = name.strip().lower()
            if keys.get(name) != "time" or names[n] in self.layout.ignore:
                continue
            names[n], self.time_unit = name, unit or ""
            if dated:
                message = f"'{shorten(cell.text)}' is the time since the beginning of a stage, but "
                message += "the rows have dates"
                hint = "Write date and time of day into one column, such as 2024-03-01 14:30; or "
                hint += f"declare it: ignore: [{shorten(cell.text)}]."
                self.refuse(line, cell, "bad-header", message, hint)
        return names

    def since(self, line: int, cell: Cell) -> float | None:
        """Seconds since the beginning of a stage; None where the cell is blank, or with a fault."""
        number = isinstance(cell.value, float)
        if not cell.text or (not number and self._refused_of_a_sheet(line, cell)):
            return None
        text = cell.text.replace(",", ".") if self.layout.decimal == "," else cell.text
        try:
            bare = not read_quantity(text).unit
            quantity = read_quantity(f"{text} {self.time_unit}" if bare else text, "time")
        except UnitError as error:
            hint = "Write it like 12 d, or the unit in the header: time (d)."
            self.refuse(line, cell, "bad-time", error.message, hint)
            return None
        if quantity.value < 0.0:
            message = f"'{shorten(cell.text)}' is a negative time"
            hint = "It counts from the beginning of the stage."
            self.refuse(line, cell, "out-of-range", message, hint)
            return None
        return quantity.value

    def unit(self, line: int, cell: Cell, dimension: str) -> float | None:
        """Size of a unit in the SI unit of a dimension; None, with a fault, if it is none of it.

        Args:
            line: its number.
            cell: the unit as written.
            dimension: of what is read, a key of `geoident.units.DIMENSIONS`.
        """
        text, raw = cell.text, raw_unit(cell.text)
        wanted = f"expected {with_article(dimension)}"
        if raw is not None and dimension != "frequency":
            message = f"'{text}' is what the sensor gives; {wanted}"
            self.refuse(line, cell, "unit", message, _CALIBRATE % raw)
            return None
        try:
            unit = normal_unit(text, dimension)
        except UnitError as error:
            comma = text.replace(".", "").isdigit()
            hint = "If the value has a decimal comma, write a point." if comma else error.hint
            self.refuse(line, cell, "unit", error.message, hint)
            return None
        factor = size_in(unit, dimension) if unit or dimension == DIMENSIONLESS else None
        if factor is None:
            other = f"'{text}' is the unit of {with_article(UNITS[unit][0])}" if text else "no unit"
            hint = f"Units of {dimension}: {unit_list(dimension)}."
            self.refuse(line, cell, "unit", f"{other}; {wanted}", hint)
        return factor

    def scale(self, line: int, cell: Cell, channel: str, origin: Origin) -> UnitScale | None:
        """How the numbers of a channel become readings; None, with a fault, if they cannot.

        Args:
            line: of the unit.
            cell: the unit as written.
            channel: its name.
            origin: what is declared of the channel.
        """
        known = origin.calibration
        if known is None:
            factor = self.unit(line, cell, self.layout.dimension(channel))
            return None if factor is None else UnitScale(origin.sign * factor, unit=cell.text)
        if cell.text and raw_unit(cell.text) != known.reads:
            message = f"'{cell.text}' is not what the calibration is for, '{known.reads}'"
            hint = "Correct 'reads' of the calibration, or leave it out where readings are given."
            self.refuse(line, cell, "unit", message, hint)
            return None
        return UnitScale(1.0, known, origin.sign)

    def value(
        self, line: int, cells: Sequence[Cell], number: float | None, scale: UnitScale | None
    ) -> float | None:
        """The reading, SI, of a number in a row; None without number or scale.

        Args:
            line: of the row.
            cells: of the row, in which the temperature of the sensor may stand.
            number: that was measured.
            scale: how it becomes a reading; None where that is not known.
        """
        if number is None or scale is None:
            return None
        if scale.calibration is None or not scale.calibration.temperature:
            return scale.reading(number)
        name = scale.calibration.temperature
        at = self.temperatures[name.lower()]
        cell = cells[at] if at < len(cells) else Cell("", 1)
        temperature = self.number(line, cell)
        if temperature is None and not cell.text:
            message = f"the temperature of the sensor is missing ('{name}')"
            hint = "Its calibration needs it; leave the reading blank, or 'thermal' out."
            self.refuse(line, cell, "missing-temperature", message, hint)
        return scale.reading(number, temperature)

    def reading(
        self,
        line: int,
        row: Mapping[str, Cell],
        channel: str,
        value: float | None,
        time: float | None,
        at: Cell,
        accuracy: float | None = None,
        unit: str = "",
    ) -> Reading:
        """A reading of a row.

        Args:
            line: its number.
            row: key of `COLUMNS` to its cell; a date or a stage is among them.
            channel: its name.
            value: SI.
            time: of its date; None where it has a stage.
            at: where the reading is written.
            accuracy: its own, SI; None for none.
            unit: in which it is written.
        """
        when = row["date"] if "date" in row else row["stage"]
        return Reading(
            channel=channel,
            stage="" if "date" in row else when.text,
            value=value,
            accuracy=accuracy,
            location=self.place(line, at),
            time=time,
            zone=utc_offset(when.text) if time is not None else None,
            when=self.place(line, when),
            bad=flag(row["bad"].text) if "bad" in row else "",
            note=row["remarks"].text if "remarks" in row else "",
            unit=unit,
        )


def _if_blank(text: str) -> str:
    """The remedy where a text looks like a mark for a missing reading; empty where it does not."""
    if any(letter.isdigit() for letter in text) or "," in text:
        return ""
    return f"If it stands for a missing reading, declare it: blank: ['{shorten(text)}']."


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
