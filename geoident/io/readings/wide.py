"""The wide layout of readings: one column a channel, one row a date or stage.

The unit of a column stands in its header, ``EX1.a5 (mm)`` or ``EX1.a5 [mm]``, or in a row of units
below the header, or is declared in the case.
"""

from __future__ import annotations

import re
from dataclasses import dataclass, replace

from geoident.io.readings.table import Cell, Origin, Table, UnitScale
from geoident.io.text.dates import utc_offset
from geoident.io.text.wording import did_you_mean
from geoident.model.gauges import Reading

_WITH_UNIT = re.compile(r"(.*?)\s*[(\[]([^()\[\]]*)[)\]]")

_USUAL = {
    "pressure": "kPa",
    "force": "kN",
    "line load": "kN/m",
    "moment per length": "kNm/m",
    "angle": "mm/m",
    "strain": "microstrain",
}


@dataclass(frozen=True)
class _Column:
    """Position of a column, its channel, origin, and how it is scaled (None: not yet known)."""

    at: int
    channel: str
    cell: Cell
    origin: Origin
    scale: UnitScale | None


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
        self.remarks: int | None = None
        self.width = 0
        self.nameless: dict[int, bool] = {}
        self.temperatures: dict[str, int] = {}

    def header(self, line: int, cells: list[Cell]) -> None:
        """Note the columns, and what is wrong with them."""
        known = [self.table.layout.header(key) for key in ("date", "stage", "remarks")]
        if self.table.refuse_missing(line, cells, known, "date,CHANNEL (mm),CHANNEL (mm)"):
            return
        self.table.require_ignored(line, cells)
        self.temperatures = self.table.temperature_columns(line, cells)
        self.width = max((n for n, cell in enumerate(cells, 1) if cell.text), default=0)
        names = [cell.text.lower() for cell in cells]
        keys = [key for key in ("date", "stage") if self.table.layout.header(key) in names]
        if not keys:
            message = f"there is no column '{self.table.layout.header('date')}' or 'stage'"
            hint = "Name it in the case: columns: {date: NAME}."
            self.table.refuse((line, 1), "bad-header", message, hint)
            return
        self.dated = keys[0] == "date"
        self.when = names.index(self.table.layout.header(keys[0]))
        channels = self.table.layout.channels
        remarks = self.table.layout.header("remarks")
        self.remarks = names.index(remarks) if remarks in names else None
        apart = {self.when, self.remarks, *self.temperatures.values()}
        apart |= {n for n, name in enumerate(names) if name in self.table.layout.ignore}
        given = {n: cell for n, cell in enumerate(cells) if n not in apart and cell.text}
        if channels:
            for channel, origin in channels.items():
                self._add_declared(line, channel, origin, given)
        else:
            inside = cells[: self.width] if not self.table.sheet else []
            self.nameless = {n: False for n, cell in enumerate(inside) if not cell.text}
            for n, cell in given.items():
                self._add(line, n, cell, Origin(), "")

    def _add_declared(
        self, line: int, channel: str, origin: Origin, given: dict[int, Cell]
    ) -> None:
        wanted = origin.name or channel
        for n, cell in given.items():
            match = _WITH_UNIT.fullmatch(cell.text)
            if wanted in {cell.text, match[1] if match else cell.text}:
                self._add(line, n, cell, origin, channel)
                return
        hint = did_you_mean(wanted, [cell.text for cell in given.values()], what="Columns")
        message = f"there is no column '{wanted}' for '{channel}'"
        self.table.refuse((line, 1), "bad-header", message, hint)

    def _add(self, line: int, n: int, cell: Cell, origin: Origin, channel: str) -> None:
        match = _WITH_UNIT.fullmatch(cell.text)
        name, unit = (match[1], match[2]) if match else (cell.text, "")
        declared = "" if self.units_follow or origin.calibration else self.table.layout.unit
        unit = origin.unit or unit or declared
        scale = None
        if unit or not self.units_follow:
            scale = self._scale(line, cell, channel or name, unit, origin, name=name)
        self.columns.append(_Column(n, channel or name, cell, origin, scale))

    def _scale(
        self, line: int, cell: Cell, channel: str, unit: str, origin: Origin, *, name: str = ""
    ) -> UnitScale | None:
        """How the numbers of a column become readings.

        Args:
            line: of the unit.
            cell: at which a fault is noted.
            channel: which it holds.
            unit: of its numbers; empty where none is given.
            origin: what is declared of the channel.
            name: of the column, where it is not that of the channel.
        """
        name = name or channel
        if unit or origin.calibration:
            dimension = self.table.layout.dimension(channel)
            return self.table.scale(line, Cell(unit, cell.column), dimension, origin)
        message = f"the column '{name}' has no unit"
        unit = _USUAL.get(self.table.layout.dimension(channel), "mm")
        hint = f"Write '{name} ({unit})' in the header, or 'unit: {unit}' in the case, or "
        hint += "'unit_row: true' where the next row has the units."
        if not self.table.layout.channels:
            hint += f" If it is no gauge: ignore: [{name}], or columns: {{remarks: {name}}}."
        self.table.refuse((line, cell.column), "unit", message, hint)
        return None

    def row(self, line: int, cells: list[Cell]) -> list[Reading]:
        """The readings of a row."""
        if self.units_follow:
            self._read_units(line, cells)
            return []
        if len(cells) <= self.when or not cells[self.when].text:
            if cells:
                what = "date" if self.dated else "stage"
                self.table.refuse((line, 1), "missing-name", f"the {what} of the row is missing")
            return []
        if len(cells) > self.width and self.table.layout.delimiter == ",":
            self._refuse_width(line, cells, self.width)
        self.table.refuse_nameless(line, cells, self.nameless)
        when = cells[self.when]
        time = self.table.date(line, when) if self.dated else None
        place, stage = self.table.place(line, when), "" if self.dated else when.text
        zone = utc_offset(when.text) if self.dated else None
        at = self.remarks
        note = cells[at].text if at is not None and at < len(cells) else ""
        readings = []
        for column in (column for column in self.columns if column.at < len(cells)):
            value = self._value(line, cells, column)
            here = self.table.place(line, cells[column.at])
            if column.scale is not None and (value is not None or not cells[column.at].text):
                reading = Reading(
                    column.channel,
                    stage,
                    value,
                    location=here,
                    time=time,
                    when=place,
                    note=note,
                    zone=zone,
                )
                readings.append(reading)
        return [] if self.dated and time is None else readings

    def _value(self, line: int, cells: list[Cell], column: _Column) -> float | None:
        """The reading of a column, SI; None where it is missing or, with a fault, wrong."""
        value = self.table.measured(line, cells[column.at])
        if value is None or column.scale is None:
            return None
        temperature, calibration = None, column.origin.calibration
        if calibration is not None:
            temperature = self.table.temperature(line, cells, self.temperatures, calibration)
        return column.scale.reading(value, temperature)

    def _refuse_width(self, line: int, cells: list[Cell], width: int) -> None:
        """Note further cells where the whole file is read: a decimal comma may be behind it."""
        if self.table.layout.channels or not any(cell.text for cell in cells[width:]):
            return
        message = f"the row has {len(cells)} columns, the header {width}"
        hint = "If a number has a decimal comma, declare another delimiter, or write a point."
        self.table.refuse((line, cells[width].column), "too-many-columns", message, hint)

    def _read_units(self, line: int, cells: list[Cell]) -> None:
        self.units_follow = False
        for n, column in enumerate(self.columns):
            if column.scale is None:
                cell = cells[column.at] if column.at < len(cells) else Cell("", 1)
                unit = cell.text.strip("()[] ")
                scale = self._scale(line, cell, column.channel, unit, column.origin)
                self.columns[n] = replace(column, scale=scale)
