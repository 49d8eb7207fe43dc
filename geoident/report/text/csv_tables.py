"""Results as tables for spreadsheets: every table of a result, as CSV.

Numbers stand in the units in which the user wrote them, lengths that were read in mm, with the unit
in a column or in the header, to 12 digits. An empty cell is a value that does not exist or is not
determined. A text that a spreadsheet would take for a formula (a gauge may be called ``=A1``) has
an apostrophe before it; numbers are numbers.
"""

from __future__ import annotations

import csv
import io
import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from geoident.model.results.posterior import LEVELS
from geoident.model.results.result import Grid, ParameterTable, Result
from geoident.report.text.accuracies import accuracies_list
from geoident.report.text.backtest import csv_fit_rows, csv_rows
from geoident.report.text.gauges import by_stage, each_reading
from geoident.report.text.parameters import prior_in_unit
from geoident.report.text.posterior import draw_rows
from geoident.report.text.residuals import (
    by_distance,
    compared_with,
    standardized,
    wide_diagnostics,
)
from geoident.units import in_unit, shown_unit

CsvCell = str | int | float | bool
CsvRow = tuple[CsvCell, ...]
_KILO = 1e3


@dataclass(frozen=True)
class CsvTable:
    """One table.

    Args:
        header: names of the columns.
        rows: the cells; NaN is an empty cell.
    """

    header: tuple[str, ...]
    rows: tuple[CsvRow, ...]


def csv_tables(result: Result) -> dict[str, CsvTable]:
    """Name to table, those without rows left out."""
    result = result.for_people
    made = {name: make(result) for name, make in _TABLES.items()}
    return {name: table for name, table in made.items() if table.rows}


def csv_text(table: CsvTable) -> str:
    """A table as CSV with commas, points and LF.

    >>> rows = (("EX1, a5", 0.1), ("CV", math.nan))
    >>> print(csv_text(CsvTable(("gauge", "value"), rows)), end="")
    gauge,value
    "EX1, a5",0.1
    CV,
    """
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow([_text(cell) for cell in table.header])
    writer.writerows([_text(cell) for cell in row] for row in table.rows)
    return text.getvalue()


def all_csv(result: Result) -> str:
    """All tables one below the other, each under a line ``# NAME``, with an empty line between.

    Without the draws of a posterior, which are thousands.
    """
    tables = csv_tables(result).items()
    return "\n".join(f"# {name}\n{csv_text(table)}" for name, table in tables if name != "draws")


def _text(cell: CsvCell) -> str:
    if isinstance(cell, bool):
        return "yes" if cell else "no"
    if isinstance(cell, float):
        return "" if math.isnan(cell) else f"{cell:.12g}"
    if isinstance(cell, str) and cell.startswith(_FORMULA) and not _is_number(cell):
        return f"'{cell}"
    return str(cell)


_FORMULA = ("=", "+", "-", "@", "\t", "\r")
"""Beginnings of texts that a spreadsheet takes for a formula, and would compute (CWE-1236)."""


def _is_number(text: str) -> bool:
    try:
        float(text)
    except ValueError:
        return False
    return True


def _parameters(result: Result) -> CsvTable:
    table = result.parameters
    header = ("parameter", "value", "sd", "lower95", "upper95", "unit", "start", "lower", "upper")
    rows = [_parameter(table, i) for i in range(len(table.names))]
    return CsvTable((*header, "at_bound", "determined", "prior"), tuple(rows))


def _parameter(table: ParameterTable, i: int) -> CsvRow:
    known = table.determined[i] or math.isfinite(table.sd[i])  # from readings, or its prior
    value = float(table.values[i]) if known else math.nan
    found = (value, *(float(column[i]) for column in (table.sd, table.lower95, table.upper95)))
    given = (float(column[i]) for column in (table.start, table.lower, table.upper))
    unit, dimension = table.units[i], table.dimensions[i]
    return (
        table.names[i],
        *(_shown(table, i, number) for number in found),
        _unit(table, i),
        *(_shown(table, i, number) for number in given),
        bool(table.at_bound[i]),
        bool(table.determined[i]),
        prior_in_unit(table.priors[i], unit, dimension),
    )


def _accuracies(result: Result) -> CsvTable:
    found = accuracies_list(result.accuracies) if result.accuracies is not None else []
    header = ("errors", "sd", "factor", "lower95", "upper95", "unit", "determined")
    rows = [tuple(_number(entry.get(name)) for name in header) for entry in found]
    return CsvTable(header, tuple(rows))


def _number(cell: CsvCell | None) -> CsvCell:
    if cell is None or (isinstance(cell, float) and math.isinf(cell)):
        return math.nan
    return cell if isinstance(cell, str | bool) else float(cell)


def _shown(table: ParameterTable, i: int, value: float) -> float:
    return in_unit(value, table.units[i], table.dimensions[i])


def _unit(table: ParameterTable, i: int) -> str:
    return shown_unit(table.units[i], table.dimensions[i])


def _correlation(result: Result) -> CsvTable:
    table = result.parameters
    known = np.isfinite(table.correlation).any()
    lines = zip(table.names, table.correlation.tolist(), strict=True)
    rows: list[CsvRow] = [(name, *line) for name, line in lines]
    return CsvTable(("parameter", *table.names), tuple(rows) if known else ())


def _gauges(result: Result) -> CsvTable:
    table, (computed, sd) = result.gauges, compared_with(result)
    residual, in_sd = table.measured - computed, standardized(result)
    columns = [table.in_units(c) for c in (table.measured, computed, residual, sd)]
    known = np.isfinite(table.measured) | np.isfinite(computed)
    rows: list[CsvRow] = [
        (
            table.channels[i],
            table.stages[j],
            *(float(column[i, j]) for column in columns),
            table.shown_units[i],
            float(in_sd[i, j]),
            bool(table.used[i, j]),
        )
        for i, j in by_stage(known)
    ]
    header = ("measured", "computed", "residual", "sd", "unit", "residual_in_sd", "used")
    return CsvTable(("gauge", "stage", *header), tuple(rows))


def _readings(result: Result) -> CsvTable:
    """Every reading, in the order of the files."""
    header = ("gauge", "stage", "time", "value", "computed", "sd", "unit", "used", "reason", "note")
    rows: list[CsvRow] = [
        (
            reading["gauge"],
            reading["stage"],
            reading["time"] or "",
            *(
                in_unit(float(reading[name]), *reading["shown"])
                for name in ("value", "computed", "sd")
            ),
            shown_unit(*reading["shown"]),
            reading["used"],
            reading["reason"],
            reading["note"],
        )
        for reading in each_reading(result.gauges)
    ]
    return CsvTable(header, tuple(rows))


def _diagnostics(result: Result) -> CsvTable:
    """How each used reading acts on the answer, the most influential first."""
    header = ("gauge", "stage", "standardized", "studentized", "weight", "leverage", "distance")
    found = wide_diagnostics(result)
    if found is None:
        return CsvTable(header, ())
    names = result.parameters.names
    rows: list[CsvRow] = [
        (
            result.gauges.channels[i],
            result.gauges.stages[j],
            *(float(getattr(found, name)[i, j]) for name in header[2:]),
            *(float(change) for change in found.influence[i, j]),
        )
        for i, j in by_distance(found)
    ]
    return CsvTable((*header, *(f"influence_{name}" for name in names)), tuple(rows))


def _prediction(result: Result) -> CsvTable:
    header = ("gauge", "stage", "predicted", "sd", "lower95", "upper95", "measured", "unit")
    table, gauges = result.prediction, result.gauges
    if table is None:
        return CsvTable(header, ())
    mean = np.where(np.isfinite(table.sd), table.mean, math.nan)  # else it is not determined
    read = (mean, table.sd, table.lower95, table.upper95, gauges.measured)
    columns = [gauges.in_units(column) for column in read]
    rows: list[CsvRow] = [
        (
            gauges.channels[i],
            gauges.stages[j],
            *(float(column[i, j]) for column in columns),
            gauges.shown_units[i],
        )
        for i, j in by_stage(np.isfinite(table.mean))
    ]
    return CsvTable(header, tuple(rows))


def _history(result: Result) -> CsvTable:
    table = result.parameters
    names = [_with_unit(table, i) for i in range(len(table.names))]
    rows: list[CsvRow] = [
        (
            step.method,
            step.number,
            step.objective,
            step.step,
            step.counts.evaluations,
            step.counts.factorizations,
            step.counts.solves,
            *(_shown(table, i, float(value)) for i, value in enumerate(step.values)),
            step.note,
        )
        for step in result.history
    ]
    costs = ("evaluations", "factorizations", "solves")
    header = ("method", "iteration", "objective", "step", *costs, *names, "note")
    return CsvTable(header, tuple(rows))


def _with_unit(table: ParameterTable, i: int) -> str:
    unit = _unit(table, i)
    return f"{table.names[i]} [{unit}]" if unit else table.names[i]


def _sensitivity(result: Result) -> CsvTable:
    header = ("gauge", "stage", "parameter", "value", "unit")
    values, table = result.sensitivity, result.parameters
    if values is None:
        return CsvTable(header, ())
    shown = result.gauges.in_units(values)
    rows: list[CsvRow] = [
        (
            result.gauges.channels[i],
            result.gauges.stages[j],
            table.names[q],
            float(shown[i, j, q]) / _shown(table, q, 1.0),
            _per_unit(result.gauges.shown_units[i], _unit(table, q)),
        )
        for j, i, q in np.argwhere(np.isfinite(values).transpose(1, 0, 2)).tolist()
    ]
    return CsvTable(header, tuple(rows))


def _per_unit(reading: str, unit: str) -> str:
    """The unit of a reading by that of a parameter."""
    return f"{reading}/({unit})" if "/" in unit else f"{reading or 1}/{unit}" if unit else reading


def _structures(result: Result) -> CsvTable:
    """Forces in kN and kNm, of walls and linings per metre, of bars each; where the pieces end."""
    forces = ("N", "M_first", "M_second", "Q", "N_hoop", "stressed_to")
    units = ("kN", "kNm", "kNm", "kN", "kN", "kN")
    places = tuple(f"{axis}_{end} (m)" for end in ("first", "second") for axis in "xyz")
    names = (
        "structure", "number", "stage", *places,
        *(f"{force} ({unit})" for force, unit in zip(forces, units, strict=True)),
    )  # fmt: skip
    found = result.members
    if found is None:
        return CsvTable(names, ())
    missing = 3 - found.ends.shape[2]
    ends = np.pad(found.ends, [(0, 0), (0, 0), (0, missing)], constant_values=math.nan)
    rows: list[CsvRow] = [
        (
            found.structures[i],
            int(found.numbers[i]),
            found.stages[j],
            *map(float, ends[i].ravel()),
            *(
                float(force) / _KILO
                for force in (
                    found.axial[i, j],
                    *found.moment[i, :, j],
                    found.shear[i, j],
                    found.hoop[i, j],
                    found.prestress[i, j],
                )
            ),
        )
        for j, i in np.argwhere(np.isfinite(found.axial.T)).tolist()
    ]
    return CsvTable(names, tuple(rows))


def _grid(result: Result) -> CsvTable:
    grid, table = result.grid, result.parameters
    if grid is None:
        return CsvTable(("objective",), ())
    positions = [table.names.index(name) for name in grid.names]
    header = (*(_with_unit(table, i) for i in positions), "objective")
    return CsvTable(header, tuple(_grid_rows(grid, table, positions)))


def _grid_rows(grid: Grid, table: ParameterTable, positions: Sequence[int]) -> Iterator[CsvRow]:
    """One row a point; without an objective where the model has no solution."""
    for place in np.ndindex(grid.objective.shape):
        coordinates = (
            _shown(table, i, float(axis[k]))
            for i, axis, k in zip(positions, grid.axes, place, strict=True)
        )
        phi = float(grid.objective[place])
        yield (*coordinates, phi if math.isfinite(phi) else math.nan)


def _posterior(result: Result) -> CsvTable:
    found, table = result.posterior, result.parameters
    levels = tuple(f"q{100 * level:g}" for level in LEVELS)
    header = ("parameter", "mean", "sd", *levels, "unit", "effective_size", "r_hat")
    if found is None:
        return CsvTable(header, ())
    rows: list[CsvRow] = [
        (
            name,
            *(
                _shown(table, i, float(value))
                for value in (found.mean[i], found.sd[i], *found.quantiles[i])
            ),
            _unit(table, i),
            float(found.effective[i]),
            float(found.r_hat[i]),
        )
        for i, name in enumerate(found.names)
    ]
    return CsvTable(header, tuple(rows))


def _draws(result: Result) -> CsvTable:
    header, rows = draw_rows(result)
    return CsvTable(header, tuple((int(row[0]), int(row[1]), *row[2:]) for row in rows))


def _of_rows(header: tuple[str, ...], rows: Sequence[CsvRow]) -> CsvTable:
    return CsvTable(header, tuple(rows))


def _fields(result: Result) -> CsvTable:
    """Constants that vary from place to place, by elements; deviations are of the logarithm."""
    header = ("field", "x", "y", "z", "value", "unit", "sd_log", "prior_sd_log", "reduction")
    rows = []
    for found in result.varied:
        unit = shown_unit(found.unit, found.dimension)
        columns = (found.values, found.sd, found.prior_sd, found.reduction)
        for centre, *numbers in zip(found.centres.tolist(), *columns, strict=True):
            value, sd, before, reduction = map(float, numbers)
            place = (*centre, *(math.nan,) * (3 - len(centre)))
            shown = in_unit(value, found.unit, found.dimension)
            rows.append((found.name, *place, shown, unit, sd, before, reduction))
    return CsvTable(header, tuple(rows))


_WALL = ("pressure (MPa)", "wall_inwards (mm)", "plastic_radius (m)")


def _wall(pressure: float, displacement: float, plastic_radius: float) -> CsvRow:
    return float(pressure) / 1e6, 1e3 * float(displacement) + 0.0, float(plastic_radius)  # no -0


def _reactions(result: Result) -> CsvTable:
    """Resultants of supports on the ground, kN."""
    names = ("support", "stage", "R_x (kN)", "R_y (kN)", "R_z (kN)")
    found = result.reactions
    if found is None:
        return CsvTable(names, ())
    missing = 3 - found.force.shape[2]
    force = np.pad(found.force, [(0, 0), (0, 0), (0, missing)], constant_values=math.nan)
    rows: list[CsvRow] = [
        (found.supports[i], found.states[j], *map(float, force[i, j] / _KILO))
        for i, j in np.argwhere(np.isfinite(force).any(axis=2)).tolist()
    ]
    return CsvTable(names, tuple(rows))


def _yielded(result: Result) -> CsvTable:
    """How far ground yields; areas in plane strain."""
    names = ("stage", "volume (m3)", "share", "from_excavation (m)", "from_centre (m)")
    places = tuple(f"{axis}_{end} (m)" for end in ("min", "max") for axis in "xyz")
    found = result.yielded
    if found is None:
        return CsvTable((*names, *places), ())
    missing = [(0, 0), (0, 3 - found.lower.shape[1])]
    ends = [np.pad(x, missing, constant_values=math.nan) for x in (found.lower, found.upper)]
    columns = [found.volume, found.share, found.reach, found.radius]
    numbers = np.column_stack([*columns, *ends]).tolist()
    rows = tuple((name, *row) for name, row in zip(found.states, numbers, strict=True))
    return CsvTable((*names, *places), rows)


def _opening(result: Result) -> CsvTable:
    """The stages of a closed form; compression and motions inwards are positive."""
    found = result.reaction
    stages = () if found is None else zip(
        found.stages, found.stage_pressure, found.stage_displacement, found.stage_plastic_radius,
        strict=True,
    )  # fmt: skip
    radius = math.nan if found is None else found.radius
    rows = tuple((stage, radius, *_wall(*numbers)) for stage, *numbers in stages)
    return CsvTable(("stage", "radius (m)", *_WALL), rows)


def _ground_reaction(result: Result) -> CsvTable:
    """The wall under ever less pressure inside."""
    found = result.reaction
    curve = () if found is None else zip(
        found.pressure, found.displacement, found.plastic_radius, strict=True
    )  # fmt: skip
    return CsvTable(_WALL, tuple(_wall(*numbers) for numbers in curve))


def _opening_stresses(result: Result) -> CsvTable:
    """Stresses around the opening, positive in compression."""
    found = result.reaction
    header = ("stage", "distance (m)", "radial_compression (MPa)", "hoop_compression (MPa)")
    rows: list[CsvRow] = []
    for j, stage in enumerate(() if found is None else found.stages):
        assert found is not None
        rows += [
            (stage, float(r), float(radial) / 1e6, float(hoop) / 1e6)
            for r, radial, hoop in zip(found.radii, found.radial[j], found.hoop[j], strict=True)
        ]
    return CsvTable(header, tuple(rows))


def _face(result: Result) -> CsvTable:
    """What distances to the face say of the stages; parts of one."""
    found = result.advance
    header = ("stage", "distance (m)", "share_of_motion", "released_stress", "zero_of_gauges")
    rows = () if found is None else zip(
        found.stages, map(float, found.stage_distance), map(float, found.stage_share),
        map(float, found.stage_released), map(bool, found.stage_zero), strict=True,
    )  # fmt: skip
    return CsvTable(header, tuple(rows))


def _face_profile(result: Result) -> CsvTable:
    """The part of its final motion that the wall has made, by the distance behind the face."""
    found = result.advance
    curve = () if found is None else zip(
        map(float, found.distance), map(float, found.share), strict=True
    )  # fmt: skip
    return CsvTable(("distance (m)", "share_of_motion"), tuple(curve))


_TABLES: Mapping[str, Callable[[Result], CsvTable]] = {
    "parameters": _parameters,
    "gauges": _gauges,
    "diagnostics": _diagnostics,
    "prediction": _prediction,
    "history": _history,
    "correlation": _correlation,
    "sensitivity": _sensitivity,
    "structures": _structures,
    "reactions": _reactions,
    "yielded": _yielded,
    "opening": _opening,
    "ground-reaction": _ground_reaction,
    "opening-stresses": _opening_stresses,
    "face": _face,
    "face-profile": _face_profile,
    "grid": _grid,
    "readings": _readings,
    "accuracies": _accuracies,
    "posterior": _posterior,
    "draws": _draws,
    "fields": _fields,
    "backtest": lambda result: _of_rows(*csv_rows(result)),
    "backtest-parameters": lambda result: _of_rows(*csv_fit_rows(result)),
}

CSV_TABLES = tuple(_TABLES)
"""Names of all tables that a result may have."""
