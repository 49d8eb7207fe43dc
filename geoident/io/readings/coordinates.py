"""The layout of surveyed coordinates: a point, a date or stage, and its E, N, H in each row.

Each row gives one reading for every channel of the target: the component of its coordinates, from
which that of the zero epoch is subtracted later. Heights or positions that were not measured leave
the channels blank that need them.
"""

from __future__ import annotations

import math

from geoident.io.readings.layout import POINT_COLUMNS
from geoident.io.readings.survey import SurveyGrid, SurveyTarget
from geoident.io.readings.table import Table
from geoident.io.text.cells import Cell, name_and_unit
from geoident.io.text.wording import did_you_mean, listing, shorten
from geoident.model.gauges import Reading

_AXES = POINT_COLUMNS[1:]
_OPTIONAL = ("stage", "date", "bad", "remarks")
FAR = 1.0  # m
"""A target this far from the coordinates of its point is said."""


class CoordinateRows:
    """One row a point and date.

    Args:
        table: the file; is told what is wrong in the header.
        line: of the header.
        cells: of the header.
    """

    expected = ("point", "date", "east", "north", "height")

    def __init__(self, table: Table, line: int, cells: list[Cell]) -> None:
        layout = table.layout
        assert layout.survey is not None
        self.table = table
        self.survey: SurveyGrid = layout.survey
        self.unknown: set[str] = set()
        self.placed: set[str] = set()
        self.columns: dict[str, int] = {}
        table.declared_columns(line, cells)
        keys = {layout.header(key): key for key in (*POINT_COLUMNS, *_OPTIONAL)}
        units: dict[str, Cell] = {}
        for n, cell in enumerate(cells):
            name, unit = name_and_unit(cell.text)
            whole = keys.get(cell.text.lower())
            key = whole or keys.get(name.lower())
            if key and key not in self.columns:
                self.columns[key] = n
                units[key] = Cell(layout.unit if whole else unit or "", cell.column)
        self.when = "date" if "date" in self.columns else "stage"
        missing = [layout.header(key) for key in POINT_COLUMNS if key not in self.columns]
        if self.when not in self.columns:
            missing.append(f"{layout.header('date')} or {layout.header('stage')}")
        if missing:
            hint = did_you_mean(missing[0], [c.text for c in cells if c.text], what="Columns")
            hint += " Name them in the case: columns: {point: NAME, east: NAME, ...}."
            message = f"columns missing in the header: {listing(missing)}"
            table.refuse(line, 1, "bad-header", message, hint)
            return
        if self.when == "date":
            self.columns.pop("stage", None)
        self.sizes: list[float] = []
        for key in _AXES:
            if units[key].text:
                self.sizes.append(table.unit(line, units[key], "length") or 1.0)
            else:
                message = f"the column '{layout.header(key)}' has no unit"
                hint = "Write 'E (m)' in the header, or 'unit: m' in the case."
                table.refuse(line, units[key], "unit", message, hint)

    def readings(self, line: int, cells: list[Cell]) -> list[Reading]:
        """The readings of a row."""
        table, survey = self.table, self.survey
        row = {key: cells[n] if n < len(cells) else Cell("", 1) for key, n in self.columns.items()}
        point = row["point"]
        if not point.text or not row[self.when].text:
            what = self.when if point.text else "name of the point"
            hint = "Write it, or take the row out."
            table.refuse(line, point, "missing-name", f"the {what} is missing", hint)
            return []
        gauges = survey.points.get(point.text, () if survey.points else (point.text,))
        if not gauges:
            return []  # a point that is not asked for
        targets = [(gauge, self._target(line, point, gauge)) for gauge in gauges]
        time = table.date(line, row["date"]) if "date" in row else None
        before = len(table.faults)
        numbers = [table.measured(line, row[key]) for key in _AXES]
        if len(table.faults) > before or ("date" in row and time is None):
            return []
        xyz = [None if x is None else x * s for x, s in zip(numbers, self.sizes, strict=True)]
        known = [(gauge, target) for gauge, target in targets if target is not None]
        if point.text not in self.placed:
            self._check_places(line, point, known, xyz)
        return [
            table.reading(line, row, channel, _component(survey, direction, xyz), time, point)
            for _, target in known
            for channel, direction in target.directions.items()
        ]

    def _target(self, line: int, point: Cell, gauge: str) -> SurveyTarget | None:
        """The target of a name; None, with a fault, if there is none."""
        target = self.survey.targets.get(gauge)
        if target is None and gauge not in self.unknown:
            self.unknown.add(gauge)
            hint = did_you_mean(gauge, self.survey.targets, what="Targets")
            hint += " Which points are whose is declared by channels: {TARGET: POINT}."
            message = f"there is no target '{shorten(gauge)}'"
            self.table.refuse(line, point, "unknown-gauge", message, hint)
        return target

    def _check_places(
        self,
        line: int,
        point: Cell,
        targets: list[tuple[str, SurveyTarget]],
        xyz: list[float | None],
    ) -> None:
        """Note, once a point, a target that stands elsewhere than the case says."""
        known = tuple(x for x in xyz if x is not None)
        at = self.survey.position(known) if len(known) == len(_AXES) else None
        if at is None:
            return
        self.placed.add(point.text)
        for gauge, target in targets:
            surveyed = at[: len(target.point)]
            if math.dist(surveyed, target.point) <= FAR:
                continue
            case, survey = (
                f"({', '.join(f'{x:.6g}' for x in place)})" for place in (target.point, surveyed)
            )
            message = f"the case has '{gauge}' at {case} m, the survey '{point.text}' at {survey} m"
            hint = "Correct the origin, the axes or the point; without 'origin' it is not checked."
            self.table.refuse(line, point, "wrong-place", message, hint)


def _component(
    survey: SurveyGrid, direction: tuple[float, ...], xyz: list[float | None]
) -> float | None:
    """Component of the coordinates along a direction of the model, m; None where they lack."""
    parts = []
    for k, (x, origin) in enumerate(zip(xyz, survey.origin or (0.0, 0.0, 0.0), strict=True)):
        weight = survey.scale * sum(
            d * axis[k] for d, axis in zip(direction, survey.axes, strict=True)
        )
        if abs(weight) <= 1e-9 * survey.scale:
            continue
        if x is None:
            return None
        parts.append(weight * (x - origin))
    return math.fsum(parts)
