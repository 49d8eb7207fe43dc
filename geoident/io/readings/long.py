"""The long layout: one reading a row, ``gauge,stage,value,unit[,accuracy][,bad][,remarks]``.

``date`` may stand in place of ``stage``, and ``time``, since its beginning, beside it. Columns may
have other names if the case declares them. A blank value is a reading that was not taken: it is
kept, and counted later.
"""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

from geoident.io.readings.layout import COLUMNS, Origin
from geoident.io.readings.table import Table, UnitScale
from geoident.io.text.cells import Cell, name_and_unit
from geoident.io.text.wording import did_you_mean, listing, shorten
from geoident.model.gauges import Reading

REQUIRED = ("gauge", "stage", "value", "unit")
_NONE = Cell("", 1)


class LongRows:
    """One reading a row.

    Args:
        table: the file; is told what is wrong in the header.
        line: of the header.
        cells: of the header.
    """

    expected = REQUIRED

    def __init__(self, table: Table, line: int, cells: list[Cell]) -> None:
        self.table = table
        layout = table.layout
        self.origins = {o.name or channel: (channel, o) for channel, o in layout.channels.items()}
        self.nameless: dict[int, bool] = {}
        keys = layout.keys(COLUMNS)
        header = ",".join(layout.header(key) for key in REQUIRED)
        if table.header_missing(line, cells, keys, header):
            return
        table.declared_columns(line, cells)
        names = table.column_names(line, cells, keys)
        wide = [cell for cell in cells if name_and_unit(cell.text)[0] in layout.dimensions]
        if wide and layout.header("value") not in names:
            message = f"'{shorten(wide[0].text)}' is a gauge, and a row has one reading here"
            hint = "If each gauge has its own column, declare it: "
            hint += f"readings: {{file: {Path(table.file).name}, layout: wide}}."
            table.refuse(line, wide[0], "bad-header", message, hint)
            return
        passed = {"", *layout.ignore, *table.temperatures}
        for n, (name, cell) in enumerate(zip(names, cells, strict=True)):
            if name in passed:
                continue
            if name in keys and name in names[:n]:
                message = f"the column '{name}' is given twice"
                table.refuse(line, cell, "bad-header", message)
            elif name not in keys and not layout.columns:  # whoever names columns names all
                message = f"there is no column '{shorten(cell.text)}'"
                hint = did_you_mean(name, COLUMNS, what="Columns")
                if not hint.startswith("Did"):
                    hint += f" If it is not to be read, declare it: ignore: [{shorten(cell.text)}]."
                table.refuse(line, cell, "bad-header", message, hint)
        if not (layout.columns or table.sheet):
            self.nameless = {n: False for n, name in enumerate(names) if not name}
        self.width, self.header = len(cells), ",".join(keys.get(name, "") for name in names)
        read = {name for name in keys if name not in layout.ignore}
        self.columns = {keys[name]: n for n, name in enumerate(names) if name in read}
        dated = "date" in self.columns and "stage" not in self.columns
        self.when, other = ("date", "stage") if dated else ("stage", "date")
        self.columns.pop(other, None)
        calibrated = [origin.calibration for _, origin in self.origins.values()]
        united = bool(layout.unit or (calibrated and None not in calibrated))
        self.required = ["gauge", self.when, "value", *([] if united else ["unit"])]
        missing = [layout.header(key) for key in self.required if key not in self.columns]
        if missing:
            hint = f"The first line names the columns: {','.join(REQUIRED)}[,accuracy]."
            if missing == [layout.header("stage")]:
                hint += " A column 'date' may stand in place of 'stage'."
            if missing == [layout.header("unit")]:
                hint += " One unit for all may stand in the case: readings: {file: ..., unit: mm}."
            message = f"columns missing in the header: {listing(missing)}"
            table.refuse(line, 1, "bad-header", message, hint)

    def readings(self, line: int, cells: list[Cell]) -> list[Reading]:
        """The reading of a row; without its value where something is wrong with it."""
        table = self.table
        if table.nameless(line, cells, self.nameless) or not self._fits_header(line, cells):
            return []
        end = Cell("", cells[-1].column + len(cells[-1].text))
        row = {key: cells[n] if n < len(cells) else end for key, n in self.columns.items()}
        before = len(table.faults)
        for key in ("gauge", self.when):
            if not row[key].text:
                what = "the date" if key == "date" else f"the name of the {key}"
                table.refuse(line, row[key], "missing-name", f"{what} is missing")
        name = row["gauge"].text
        layout = table.layout
        if name in self.origins:
            channel, origin = self.origins[name]
        elif layout.channels and (name in layout.channels or name not in layout.dimensions):
            return []  # of an instrument that is not asked for
        else:
            channel, origin = name, Origin()
        time = table.date(line, row["date"]) if self.when == "date" else None
        since = table.since(line, row["time"]) if "time" in row else None
        accuracy = row.get("accuracy", _NONE)
        unit = row.get("unit", _NONE)
        unit = unit if unit.text else Cell(layout.unit_of(origin), unit.column)
        scale: UnitScale | None = UnitScale()
        if unit.text or row["value"].text or accuracy.text:
            scale = table.scale(line, unit, channel, origin)
        number = table.measured(line, row["value"])
        value = table.value(line, cells, number, scale)
        sd = table.accuracy(line, accuracy)
        if not channel or (time is None and (self.when == "date" or not row["stage"].text)):
            return []
        if len(table.faults) > before:
            value, sd = None, None
        own = None if sd is None or scale is None else scale.accuracy(sd, number)
        written = "" if scale is None else scale.unit
        reading = table.reading(line, row, channel, value, time, row["gauge"], own, written)
        return [reading if since is None else replace(reading, since=since)]

    def _fits_header(self, line: int, cells: list[Cell]) -> bool:
        """Whether a row has the columns of the header; notes it if not."""
        hint = "If a number has a decimal comma, write a point; quote texts that hold commas."
        if self.table.too_wide(line, cells, self.width, hint):
            return False
        if len(cells) > max(self.columns[key] for key in self.required):
            return True
        message = f"the row has {len(cells)} columns; expected {self.header}"
        end = cells[-1].column + len(cells[-1].text)
        self.table.refuse(line, end, "too-few-columns", message, "Leave a missing value blank: ,,")
        return False
