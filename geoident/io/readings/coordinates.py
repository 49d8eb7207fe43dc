"""The layout of surveyed coordinates: a point, a date or stage, and its E, N, H in each row.

Each row gives one reading for every channel of the target: the component of its coordinates, from
which that of the zero epoch is subtracted later. Heights or positions that were not measured leave
the channels blank that need them.
"""

from __future__ import annotations

import math
import re

from geoident.io.readings.survey import Survey
from geoident.io.readings.table import POINT_COLUMNS, Cell, Table, flag
from geoident.io.text.wording import did_you_mean, listing, shorten
from geoident.model.gauges import Reading

_AXES = POINT_COLUMNS[1:]
_OPTIONAL = ("stage", "date", "bad", "remarks")
_WITH_UNIT = re.compile(r"(.*?)\s*[(\[]([^()\[\]]*)[)\]]")
FAR = 1.0  # m
"""A target this far from the coordinates of its point is said."""


class CoordinateReader:
    """One row a point and date.

    Args:
        table: the file.
        survey: how coordinates become readings.
    """

    units_follow = False

    def __init__(self, table: Table, survey: Survey) -> None:
        self.table = table
        self.survey = survey
        self.columns: dict[str, int] = {}
        self.sizes: dict[str, float] = {}
        self.dated = True

    def header(self, number: int, cells: list[Cell]) -> None:
        """Note the columns, their units, and what is wrong with them."""
        layout = self.table.layout
        self.table.require_ignored(number, cells)
        wanted = {layout.header(key): key for key in (*POINT_COLUMNS, *_OPTIONAL)}
        units: dict[str, Cell] = {}
        for n, cell in enumerate(cells):
            match = _WITH_UNIT.fullmatch(cell.text)
            names = (cell.text, match[1] if match else cell.text)
            key = next((wanted[name.lower()] for name in names if name.lower() in wanted), None)
            if key is not None and key not in self.columns:
                self.columns[key] = n
                unit = match[2] if match and cell.text.lower() not in wanted else layout.unit
                units[key] = Cell(unit, cell.column)
        self.dated = "date" in self.columns
        missing = [layout.header(key) for key in POINT_COLUMNS if key not in self.columns]
        if not self.dated and "stage" not in self.columns:
            missing.append(f"{layout.header('date')} or {layout.header('stage')}")
        if missing:
            hint = did_you_mean(missing[0], [c.text for c in cells if c.text], what="Columns")
            hint += " Name them in the case: columns: {point: NAME, east: NAME, ...}."
            message = f"columns missing in the header: {listing(missing)}"
            self.table.refuse((number, 1), "bad-header", message, hint)
            return
        for key in _AXES:
            if not units[key].text:
                message = f"the column '{layout.header(key)}' has no unit"
                hint = "Write 'E (m)' in the header, or 'unit: m' in the case."
                self.table.refuse((number, units[key].column), "unit", message, hint)
                continue
            size = self.table.unit(number, units[key], "length")
            self.sizes[key] = size or 1.0

    def row(self, number: int, cells: list[Cell]) -> list[Reading]:
        """The readings of a row."""
        table = self.table
        row = {key: cells[n] if n < len(cells) else Cell("", 1) for key, n in self.columns.items()}
        point, when = row["point"], row["date" if self.dated else "stage"]
        if not point.text or not when.text:
            what = "name of the point" if not point.text else "date" if self.dated else "stage"
            table.refuse((number, point.column), "missing-name", f"the {what} is missing")
            return []
        gauge = self.survey.points.get(point.text, "" if self.survey.points else point.text)
        if not gauge:
            return []  # a point that is not asked for
        time = table.date(number, when) if self.dated else None
        target = self.survey.targets.get(gauge)
        if target is None:
            hint = did_you_mean(gauge, self.survey.targets, what="Targets")
            hint += " Which points are whose is declared by channels: {TARGET: POINT}."
            message = f"there is no target '{shorten(gauge)}'"
            table.refuse((number, point.column), "unknown-gauge", message, hint)
            return []
        before = len(table.faults)
        given = [table.number(number, row[key]) for key in _AXES]
        if len(table.faults) > before or (self.dated and time is None):
            return []
        found = [
            None if x is None else x * self.sizes[key] for x, key in zip(given, _AXES, strict=True)
        ]
        note = row["remarks"].text if "remarks" in row else ""
        bad = flag(row["bad"].text) if "bad" in row else ""
        return [
            Reading(
                channel=channel,
                stage="" if self.dated else when.text,
                value=_component(self.survey, direction, found),
                location=table.place(number, point),
                time=time,
                when=table.place(number, when),
                bad=bad,
                note=note,
            )
            for channel, direction in target.directions.items()
        ]


def _component(
    survey: Survey, direction: tuple[float, ...], found: list[float | None]
) -> float | None:
    """Component of the coordinates along a direction of the model, m; None where they lack."""
    weights = [
        survey.scale * sum(d * axis[k] for d, axis in zip(direction, survey.axes, strict=True))
        for k in range(3)
    ]
    origin = survey.origin or (0.0, 0.0, 0.0)
    parts = [
        None if x is None else w * (x - o)
        for w, x, o in zip(weights, found, origin, strict=True)
        if abs(w) > 1e-9 * survey.scale
    ]
    known = [part for part in parts if part is not None]
    return math.fsum(known) if len(known) == len(parts) else None
