"""The layout of surveyed coordinates: a point, a date or stage, and its E, N, H in each row.

Each row gives one reading for every channel of the target: the component of its coordinates, from
which that of the zero epoch is subtracted later. Heights or positions that were not measured leave
the channels blank that need them.
"""

from __future__ import annotations

import math
import re

from geoident.io.readings.survey import SurveyGrid, SurveyTarget
from geoident.io.readings.table import POINT_COLUMNS, Cell, Table, flag
from geoident.io.text.dates import utc_offset
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

    def __init__(self, table: Table, survey: SurveyGrid) -> None:
        self.table = table
        self.survey = survey
        self.columns: dict[str, int] = {}
        self.sizes: dict[str, float] = {}
        self.dated = True
        self.unknown: set[str] = set()
        self.placed: set[str] = set()

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
            hint = "Write it, or take the row out."
            table.refuse((number, point.column), "missing-name", f"the {what} is missing", hint)
            return []
        own = () if self.survey.points else (point.text,)
        gauges = self.survey.points.get(point.text, own)
        targets = [self._target(number, point, gauge) for gauge in gauges]
        time = table.date(number, when) if self.dated and gauges else None
        before = len(table.faults)
        given = [table.measured(number, row[key]) for key in _AXES] if gauges else []
        if not gauges or len(table.faults) > before or (self.dated and time is None):
            return []  # a point that is not asked for, or a fault
        found = [
            None if x is None else x * self.sizes[key] for x, key in zip(given, _AXES, strict=True)
        ]
        self._check_places(number, point, gauges, found)
        note = row["remarks"].text if "remarks" in row else ""
        bad = flag(row["bad"].text) if "bad" in row else ""
        return [
            Reading(
                channel=channel,
                stage="" if self.dated else when.text,
                value=_component(self.survey, direction, found),
                location=table.place(number, point),
                time=time,
                zone=utc_offset(when.text) if self.dated else None,
                when=table.place(number, when),
                bad=bad,
                note=note,
            )
            for target in targets
            if target is not None
            for channel, direction in target.directions.items()
        ]

    def _target(self, number: int, point: Cell, gauge: str) -> SurveyTarget | None:
        """The target of a name; None, with a fault, if there is none."""
        target = self.survey.targets.get(gauge)
        if target is None and gauge not in self.unknown:
            self.unknown.add(gauge)
            hint = did_you_mean(gauge, self.survey.targets, what="Targets")
            hint += " Which points are whose is declared by channels: {TARGET: POINT}."
            message = f"there is no target '{shorten(gauge)}'"
            self.table.refuse((number, point.column), "unknown-gauge", message, hint)
        return target

    def _check_places(
        self, number: int, point: Cell, gauges: tuple[str, ...], found: list[float | None]
    ) -> None:
        """Note, once a point, a target that stands elsewhere than the case says."""
        known = tuple(x for x in found if x is not None)
        at = self.survey.position(known) if len(known) == len(_AXES) else None
        if at is None or point.text in self.placed:
            return
        self.placed.add(point.text)
        for gauge in gauges:
            target = self.survey.targets.get(gauge)
            if target is None or math.dist(at[: len(target.point)], target.point) <= FAR:
                continue
            case, survey = (_place(place[: len(target.point)]) for place in (target.point, at))
            message = f"the case has '{gauge}' at {case} m, the survey '{point.text}' at {survey} m"
            hint = "Correct the origin, the axes or the point; without 'origin' it is not checked."
            self.table.refuse((number, point.column), "wrong-place", message, hint)


def _place(point: tuple[float, ...]) -> str:
    return f"({', '.join(f'{x:.6g}' for x in point)})"


def _component(
    survey: SurveyGrid, direction: tuple[float, ...], found: list[float | None]
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
