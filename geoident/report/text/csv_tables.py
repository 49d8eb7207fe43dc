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
from collections.abc import Callable, Mapping

import numpy as np

from geoident.model.results.columns import LABELS, ROW
from geoident.model.results.interfaces import InterfaceStates
from geoident.model.results.result import Result, SupportReactions
from geoident.model.results.shells import ShellForces
from geoident.report.text.accuracies import accuracies_list
from geoident.report.text.backtest import predictions, step_parameters
from geoident.report.text.gauges import each_reading, predicted_readings
from geoident.report.text.in_service import judged_readings, seasonal_sheet
from geoident.report.text.parameters import headers, parameters_sheet
from geoident.report.text.posterior import draws_sheet, posterior_sheet
from geoident.report.text.residuals import compared_readings, diagnostics_sheet
from geoident.report.text.rows import CsvCell, CsvRow, CsvTable, beside, sheet
from geoident.report.text.trough import troughs
from geoident.units import in_unit, shown_unit


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


def _times(result: Result) -> CsvTable:
    """When stages and their moments are: a date, and times in days."""
    times = result.gauges.times
    if times is None:
        return CsvTable()
    stages = CsvTable(("stage",), tuple((name,) for name in result.gauges.stages))
    return beside(stages, sheet(times, "stage"))


def _accuracies(result: Result) -> CsvTable:
    if result.accuracies is None:
        return CsvTable()
    header = ("errors", "sd", "factor", "lower95", "upper95", "unit", "determined")
    entries = accuracies_list(result.accuracies)
    rows = [tuple(_number(entry.get(name)) for name in header) for entry in entries]
    return CsvTable(header, tuple(rows))


def _number(cell: CsvCell | None) -> CsvCell:
    if cell is None or (isinstance(cell, float) and math.isinf(cell)):
        return math.nan
    return cell if isinstance(cell, str | bool) else float(cell)


def _correlation(result: Result) -> CsvTable:
    table = result.parameters
    if not np.isfinite(table.correlation).any():
        return CsvTable()
    return sheet(table, "parameter", labels={"other": table.names}, only=("names", "correlation"))


def _history(result: Result) -> CsvTable:
    counts = ("counts.evaluations", "counts.factorizations", "counts.solves")
    return sheet(
        result.history,
        ROW,
        quantities=result.quantities,
        labels={"parameter": headers(result.parameters)},
        only=("method", "number", "objective", "step", *counts, "values", "note"),
    )


def _sensitivity(result: Result) -> CsvTable:
    gauges, values, table = result.gauges, result.sensitivity, result.parameters
    if values is None:
        return CsvTable()
    readings, units = gauges.in_units(values), list(zip(table.units, table.dimensions, strict=True))
    rows: list[CsvRow] = []
    for j, i, q in np.argwhere(np.isfinite(values).transpose(1, 0, 2)).tolist():
        value = float(readings[i, j, q]) / in_unit(1.0, *units[q])
        unit = _per_unit(gauges.shown_units[i], shown_unit(*units[q]))
        rows.append((gauges.channels[i], gauges.stages[j], table.names[q], value, unit))
    return CsvTable(("gauge", "stage", "parameter", "value", "unit"), tuple(rows))


def _per_unit(reading: str, unit: str) -> str:
    """The unit of a reading by that of a parameter."""
    return f"{reading}/({unit})" if "/" in unit else f"{reading or 1}/{unit}" if unit else reading


def _structures(result: Result) -> CsvTable:
    """Forces in kN and kNm, of walls and linings per metre, of bars each; where the pieces end."""
    forces = result.members
    if forces is None:
        return CsvTable()
    return sheet(forces, "stage", "member", rows=np.argwhere(np.isfinite(forces.axial.T)).tolist())


def _standing(
    table: ShellForces | InterfaceStates | SupportReactions | None, *axes: str
) -> CsvTable:
    """What shells, interfaces and supports bear while they stand."""
    return CsvTable() if table is None else sheet(table, *axes, rows=table.standing)


def _opening(result: Result) -> CsvTable:
    """The stages of a closed form; compression and motions inwards are positive."""
    reaction = result.reaction
    if reaction is None:
        return CsvTable()
    table = sheet(reaction, "stage")
    rows = tuple((row[0], reaction.radius, *row[1:]) for row in table.rows)
    return CsvTable((table.header[0], "radius (m)", *table.header[1:]), rows)


def _opening_stresses(result: Result) -> CsvTable:
    """Stresses around the opening, positive in compression."""
    fields = ("stages", "radii", "radial", "hoop")
    return sheet(result.reaction, "stage", "radii", only=fields)


def _opening_supports(result: Result) -> CsvTable:
    """What each support of an opening presses with while it stands, and could press with."""
    reaction = result.reaction
    if reaction is None or not reaction.supports:
        return CsvTable()
    fields = ("supports", "stages", "support_pressure", "support_capacity")
    return sheet(reaction, "support", "stage", only=fields, rows=reaction.standing)


def _grid(result: Result) -> CsvTable:
    """One row a point; without an objective where the model has no solution."""
    grid, table = result.grid, result.parameters
    if grid is None:
        return CsvTable()
    positions = [table.names.index(name) for name in grid.names]
    rows: list[CsvRow] = []
    for place in np.ndindex(grid.objective.shape):
        coordinates = (
            in_unit(float(axis[k]), table.units[i], table.dimensions[i])
            for i, axis, k in zip(positions, grid.axes, place, strict=True)
        )
        phi = float(grid.objective[place])
        rows.append((*coordinates, phi if math.isfinite(phi) else math.nan))
    return CsvTable((*(headers(table)[i] for i in positions), "objective"), tuple(rows))


def _fields(result: Result) -> CsvTable:
    """Constants that vary from place to place, by elements; deviations are of the logarithm."""
    header = ("field", "x", "y", "z", "value", "unit", "sd_log", "prior_sd_log", "reduction")
    rows: list[CsvRow] = []
    for field in result.varied:
        of = field.unit, field.dimension
        columns = (field.values, field.sd, field.prior_sd, field.reduction)
        for centre, *numbers in zip(field.centres.tolist(), *columns, strict=True):
            value, *others = map(float, numbers)
            place = (*centre, *(math.nan,) * (3 - len(centre)))
            rows.append((field.name, *place, in_unit(value, *of), shown_unit(*of), *others))
    return CsvTable(header, tuple(rows))


def _updates(result: Result, name: str) -> CsvTable:
    """One table of the history of a fit."""
    return CsvTable() if result.updates is None else sheet(getattr(result.updates, name), ROW)


_TABLES: Mapping[str, Callable[[Result], CsvTable]] = {
    "parameters": parameters_sheet,
    "gauges": lambda result: sheet(compared_readings(result), ROW),
    "diagnostics": diagnostics_sheet,
    "prediction": lambda result: sheet(predicted_readings(result), ROW),
    "history": _history,
    "correlation": _correlation,
    "sensitivity": _sensitivity,
    "structures": _structures,
    "shells": lambda result: _standing(result.shells, "stage", "face"),
    "interfaces": lambda result: _standing(result.interfaces, "stage", "joint"),
    "reactions": lambda result: _standing(result.reactions, "support", "state"),
    "alarms": lambda result: sheet(
        result.alarms, ROW, labels={**LABELS, "stage": result.gauges.stages}
    ),
    "decisions": lambda result: sheet(result.decisions, ROW),
    "telling-readings": lambda result: sheet(result.telling, ROW),
    "safety": lambda result: sheet(
        result.safety, ROW, labels={**LABELS, "parameter": result.parameters.names}
    ),
    "plan": lambda result: sheet(result.plan and result.plan.gauges, ROW),
    "plan-targets": lambda result: sheet(result.plan and result.plan.targets, ROW),
    "convergence": lambda result: sheet(result.convergence, ROW),
    "settlement": lambda result: sheet(result.settlement, ROW),
    "troughs": lambda result: sheet(troughs(result), ROW),
    "yielded": lambda result: sheet(result.yielded, "state"),
    "opening": _opening,
    "ground-reaction": lambda result: sheet(result.reaction, "pressure"),
    "opening-stresses": _opening_stresses,
    "opening-supports": _opening_supports,
    "face": lambda result: sheet(result.advance, "stage"),
    "face-profile": lambda result: sheet(result.advance, "distance"),
    "grid": _grid,
    "readings": lambda result: sheet(each_reading(result.gauges), ROW),
    "times": _times,
    "accuracies": _accuracies,
    "left-out": lambda result: sheet(result.left_out, "left_out"),
    "posterior": posterior_sheet,
    "draws": draws_sheet,
    "fields": _fields,
    "seasonal": seasonal_sheet,
    "judged": lambda result: sheet(judged_readings(result), ROW),
    "changes": lambda result: sheet(result.changes, ROW),
    "parameter-changes": lambda result: sheet(result.parameter_changes, ROW),
    "power": lambda result: sheet(result.power, ROW),
    "backtest": lambda result: sheet(predictions(result), ROW),
    "backtest-parameters": lambda result: sheet(step_parameters(result), ROW),
    "updates": lambda result: _updates(result, "steps"),
    "update-gauges": lambda result: _updates(result, "gauges"),
    "update-readings": lambda result: _updates(result, "readings"),
    "update-parameters": lambda result: _updates(result, "parameters"),
    "update-predictions": lambda result: _updates(result, "predictions"),
}

CSV_TABLES = tuple(_TABLES)
"""Names of all tables that a result may have."""
