"""The wide layout of readings: one column a channel, one row a date or stage.

The unit of a column stands in its header, ``EX1.a5 (mm)`` or ``EX1.a5 [mm]``, or in a row of units
below the header, or is declared in the case.
"""

from __future__ import annotations

import re
from dataclasses import dataclass, replace

from geoident.io.readings.table import Cell, Origin, Table
from geoident.io.text.wording import did_you_mean
from geoident.model.gauges import Reading

_WITH_UNIT = re.compile(r"(.*?)\s*[(\[]([^()\[\]]*)[)\]]")


@dataclass(frozen=True)
class _Column:
    """Position of a column, its channel, sign, and size of its unit (None: not yet known)."""

    at: int
    channel: str
    cell: Cell
    sign: int
    factor: float | None


class WideReader:
    """One row a date or stage.

    Args:
        table: the file.
    """

    def __init__(self, table: Table) -> None:
        self.table = table
        self.columns: list[_Column] = []
        self.when = 0
        self.dated = True
        self.units_follow = table.layout.unit_row

    def header(self, number: int, line: str) -> None:
        """Note the columns, and what is wrong with them."""
        cells = self.table.split(number, line)
        names = [cell.text.lower() for cell in cells]
        keys = [key for key in ("date", "stage") if self.table.layout.header(key) in names]
        if not keys:
            message = f"there is no column '{self.table.layout.header('date')}' or 'stage'"
            hint = "Name it in the case: columns: {date: NAME}."
            self.table.refuse((number, 1), "bad-header", message, hint)
            return
        self.dated = keys[0] == "date"
        self.when = names.index(self.table.layout.header(keys[0]))
        channels = self.table.layout.channels
        given = {n: cell for n, cell in enumerate(cells) if n != self.when and cell.text}
        if channels:
            for channel, origin in channels.items():
                self._add_declared(number, channel, origin, given)
        else:
            for n, cell in given.items():
                self._add(number, n, cell, Origin(), "")

    def _add_declared(
        self, number: int, channel: str, origin: Origin, given: dict[int, Cell]
    ) -> None:
        wanted = origin.name or channel
        for n, cell in given.items():
            match = _WITH_UNIT.fullmatch(cell.text)
            if wanted in {cell.text, match[1] if match else cell.text}:
                self._add(number, n, cell, origin, channel)
                return
        hint = did_you_mean(wanted, [cell.text for cell in given.values()], what="Columns")
        message = f"there is no column '{wanted}' for '{channel}'"
        self.table.refuse((number, 1), "bad-header", message, hint)

    def _add(self, number: int, n: int, cell: Cell, origin: Origin, channel: str) -> None:
        match = _WITH_UNIT.fullmatch(cell.text)
        name, unit = (match[1], match[2]) if match else (cell.text, "")
        unit = origin.unit or unit or ("" if self.units_follow else self.table.layout.unit)
        factor = None
        if unit or not self.units_follow:
            factor = self._factor(number, cell, (channel or name, name), unit)
        self.columns.append(_Column(n, channel or name, cell, origin.sign, factor))

    def _factor(self, number: int, cell: Cell, names: tuple[str, str], unit: str) -> float | None:
        """Size of the unit of a column; names are those of its channel and its own."""
        channel, name = names
        if unit:
            dimension = self.table.layout.dimension(channel)
            return self.table.unit(number, Cell(unit, cell.column), dimension)
        message = f"the column '{name}' has no unit"
        hint = f"Write '{name} (mm)' in the header, or 'unit: mm' in the case."
        self.table.refuse((number, cell.column), "unit", message, hint)
        return None

    def row(self, number: int, line: str) -> list[Reading]:
        """The readings of a row."""
        cells = self.table.split(number, line)
        if self.units_follow:
            self._read_units(number, cells)
            return []
        if len(cells) <= self.when or not cells[self.when].text:
            if cells:
                what = "date" if self.dated else "stage"
                self.table.refuse((number, 1), "missing-name", f"the {what} of the row is missing")
            return []
        last = max((column.at for column in self.columns), default=self.when)
        if len(cells) > max(last, self.when) + 1 and self.table.layout.delimiter == ",":
            self._refuse_width(number, cells, max(last, self.when) + 1)
        when = cells[self.when]
        time = self.table.date(number, when) if self.dated else None
        if self.dated and time is None:
            return []
        place, stage = self.table.place(number, when), "" if self.dated else when.text
        readings = []
        for column in (column for column in self.columns if column.at < len(cells)):
            cell = cells[column.at]
            value = self.table.number(number, cell)
            if column.factor is None or (value is None and cell.text):
                continue
            known = None if value is None else column.sign * value * column.factor
            at = self.table.place(number, cell)
            readings.append(
                Reading(column.channel, stage, known, location=at, time=time, when=place)
            )
        return readings

    def _refuse_width(self, number: int, cells: list[Cell], width: int) -> None:
        """Note further cells where the whole file is read: a decimal comma may be behind it."""
        if self.table.layout.channels or not any(cell.text for cell in cells[width:]):
            return
        message = f"the row has {len(cells)} columns, the header {width}"
        hint = "If a number has a decimal comma, declare another delimiter, or write a point."
        self.table.refuse((number, cells[width].column), "too-many-columns", message, hint)

    def _read_units(self, number: int, cells: list[Cell]) -> None:
        self.units_follow = False
        for n, column in enumerate(self.columns):
            if column.factor is None:
                cell = cells[column.at] if column.at < len(cells) else Cell("", 1)
                names, unit = (column.channel, column.channel), cell.text.strip("()[] ")
                factor = self._factor(number, cell, names, unit)
                self.columns[n] = replace(column, factor=factor)
