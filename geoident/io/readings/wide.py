"""The wide layout of readings: one column a channel, one row a date or stage.

The unit of a column stands in its header, ``EX1.a5 (mm)`` or ``EX1.a5 [mm]``, or in a row of units
below the header, or is declared in the case.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

from geoident.io.readings.layout import Origin
from geoident.io.readings.table import Table, UnitScale
from geoident.io.text.cells import Cell, name_and_unit
from geoident.io.text.wording import did_you_mean
from geoident.model.gauges import Reading

_USUAL = {
    "pressure": "kPa",
    "force": "kN",
    "line load": "kN/m",
    "moment": "kNm",
    "moment per length": "kNm/m",
    "angle": "mm/m",
    "strain": "microstrain",
    "temperature": "degC",
}


@dataclass
class _Column:
    """A column of readings.

    Args:
        at: its index.
        name: in the header, without unit.
        channel: whose readings it has.
        origin: what is declared of the channel.
        scale: how its numbers become readings; None while that is not known.
    """

    at: int
    name: str
    channel: str
    origin: Origin
    scale: UnitScale | None = None


class WideRows:
    """One row a date or stage.

    Args:
        table: the file; is told what is wrong in the header.
        line: of the header.
        cells: of the header.
    """

    expected = ("date", "CHANNEL", "CHANNEL", "...")

    def __init__(self, table: Table, line: int, cells: list[Cell]) -> None:
        self.table = table
        self.columns: list[_Column] = []
        self.nameless: dict[int, bool] = {}
        layout = table.layout
        columns = (
            ("date", "stage", "remarks") if layout.load else ("date", "stage", "time", "remarks")
        )
        known = layout.keys(columns)
        if table.header_missing(line, cells, known, "date,CHANNEL (mm),CHANNEL (mm)"):
            return
        table.declared_columns(line, cells)
        names = table.column_names(line, cells, known)
        self.keys = {key: names.index(name) for name, key in known.items() if name in names}
        self.when = "date" if "date" in self.keys else "stage"
        if self.when not in self.keys:
            message = f"there is no column '{layout.header('date')}' or 'stage'"
            hint = "Name it in the case: columns: {date: NAME}."
            if layout.load:
                message = f"there is no column '{layout.header('date')}'"
                hint = f"Name it in the case: {layout.declaring('date: NAME')}."
            table.refuse(line, 1, "bad-header", message, hint)
            return
        if self.when == "date":
            self.keys.pop("stage", None)
        self.width = max((n for n, cell in enumerate(cells, 1) if cell.text), default=0)
        apart = {*self.keys.values(), *table.temperatures.values()}
        apart |= {n for n, name in enumerate(names) if name in layout.ignore}
        given = {n: cell for n, cell in enumerate(cells) if n not in apart and cell.text}
        if layout.channels:
            for channel, origin in layout.channels.items():
                self._find(line, channel, origin, given)
            taken = {column.at for column in self.columns}
            for n, cell in given.items():
                name, _ = name_and_unit(cell.text)
                if n not in taken and name in layout.dimensions and name not in layout.channels:
                    self._add(line, cell, _Column(n, name, name, Origin()))
            return
        for n, cell in given.items():
            name, _ = name_and_unit(cell.text)
            self._add(line, cell, _Column(n, name, name, Origin()))
        inside = cells[: self.width] if not table.sheet else []
        self.nameless = {n: False for n, cell in enumerate(inside) if not cell.text}

    def _find(self, line: int, channel: str, origin: Origin, given: dict[int, Cell]) -> None:
        """The column of a declared channel; notes that there is none."""
        wanted = origin.name or channel
        for n, cell in given.items():
            name, _ = name_and_unit(cell.text)
            if wanted in (cell.text, name):
                self._add(line, cell, _Column(n, name, channel, origin))
                return
        hint = did_you_mean(wanted, [cell.text for cell in given.values()], what="Columns")
        message = f"there is no column '{wanted}' for '{channel}'"
        self.table.refuse(line, 1, "bad-header", message, hint)

    def _add(self, line: int, cell: Cell, column: _Column) -> None:
        """Take a column; its unit is declared or stands in the header, if not in the next row."""
        layout = self.table.layout
        unit = column.origin.unit or name_and_unit(cell.text)[1] or ""
        if unit or not layout.unit_row:
            unit = unit or layout.unit_of(column.origin)
            column.scale = self._scale(line, Cell(unit, cell.column), column)
        self.columns.append(column)

    def units(self, line: int, cells: list[Cell]) -> None:
        """Take the units of the row below the header."""
        for column in (column for column in self.columns if column.scale is None):
            cell = cells[column.at] if column.at < len(cells) else Cell("", 1)
            unit = Cell(cell.text.strip("()[] "), cell.column)
            column.scale = self._scale(line, unit, column)

    def _scale(self, line: int, unit: Cell, column: _Column) -> UnitScale | None:
        """How the numbers of a column become readings; None, with a fault, if they cannot."""
        if unit.text or column.origin.calibration:
            return self.table.scale(line, unit, column.channel, column.origin)
        layout = self.table.layout
        usual = _USUAL.get(layout.dimension(column.channel), "m" if layout.load else "mm")
        hint = f"Write '{column.name} ({usual})' in the header, or 'unit: {usual}' in the case, or "
        hint += "'unit_row: true' where the next row has the units."
        if column.channel not in self.table.layout.channels:
            hint += f" If it is not a gauge: ignore: [{column.name}], "
            hint += f"or columns: {{remarks: {column.name}}}."
        self.table.refuse(line, unit, "unit", f"the column '{column.name}' has no unit", hint)
        return None

    def readings(self, line: int, cells: list[Cell]) -> list[Reading]:
        """The readings of a row."""
        table = self.table
        row = {key: cells[n] for key, n in self.keys.items() if n < len(cells)}
        if self.when not in row or not row[self.when].text:
            message = f"the {self.when} of the row is missing"
            table.refuse(line, 1, "missing-name", message)
            return []
        # A decimal comma may be behind a further cell, where all columns are read.
        if table.layout.delimiter == "," and not table.layout.channels:
            hint = "If a number has a decimal comma, declare another delimiter, or write a point."
            table.too_wide(line, cells, self.width, hint)
        table.nameless(line, cells, self.nameless)
        time = table.date(line, row["date"]) if "date" in row else None
        before = len(table.faults)
        since = table.since(line, row["time"]) if "time" in row else None
        if len(table.faults) > before:
            return []
        readings = []
        for column in self.columns:
            if column.at >= len(cells):
                continue
            cell = cells[column.at]
            value = table.value(line, cells, table.measured(line, cell), column.scale)
            if column.scale is not None and (value is not None or not cell.text):
                unit = column.scale.unit
                reading = table.reading(line, row, column.channel, value, time, cell, unit=unit)
                readings.append(reading if since is None else replace(reading, since=since))
        return readings if "stage" in row or time is not None else []
