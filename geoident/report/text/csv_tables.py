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

import numpy as np

from geoident.model.results.posterior import LEVELS
from geoident.model.results.result import Grid, ParameterTable, Result
from geoident.report.text.accuracies import accuracies_list
from geoident.report.text.backtest import csv_fit_rows, csv_rows
from geoident.report.text.gauges import each_reading
from geoident.report.text.parameters import prior_in_unit
from geoident.report.text.posterior import draw_rows
from geoident.report.text.residuals import (
    by_distance,
    compared_with,
    standardized,
    wide_diagnostics,
)
from geoident.report.text.rows import CsvCell, CsvRow, CsvTable, by_stage, sheet
from geoident.units import in_unit, shown_unit

NOTHING = CsvTable((), ())


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
    return parameters_sheet(result)


def parameters_sheet(result: Result, *, si: bool = False) -> CsvTable:
    """All columns of the parameters, and their priors.

    Args:
        result: with the parameters.
        si: SI units in place of those of the case.
    """
    table = result.parameters
    columns = sheet(table, "parameter", quantities=result.quantities, si=si)
    kinds = zip(table.units, table.dimensions, strict=True)
    priors = [
        prior_in_unit(prior, "" if si else unit, dimension)
        for prior, (unit, dimension) in zip(table.priors, kinds, strict=True)
    ]
    rows = tuple((*row, prior) for row, prior in zip(columns.rows, priors, strict=True))
    return CsvTable((*columns.header, "prior"), rows)


def _accuracies(result: Result) -> CsvTable:
    entries = accuracies_list(result.accuracies) if result.accuracies is not None else []
    header = ("errors", "sd", "factor", "lower95", "upper95", "unit", "determined")
    rows = [tuple(_number(entry.get(name)) for name in header) for entry in entries]
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
    diagnostics = wide_diagnostics(result)
    if diagnostics is None:
        return CsvTable(header, ())
    names = result.parameters.names
    rows: list[CsvRow] = [
        (
            result.gauges.channels[i],
            result.gauges.stages[j],
            *(float(getattr(diagnostics, name)[i, j]) for name in header[2:]),
            *(float(change) for change in diagnostics.influence[i, j]),
        )
        for i, j in by_distance(diagnostics)
    ]
    return CsvTable((*header, *(f"influence_{name}" for name in names)), tuple(rows))


def _prediction(result: Result) -> CsvTable:
    prediction, gauges = result.prediction, result.gauges
    if prediction is None:
        return NOTHING
    places = by_stage(np.isfinite(prediction.mean))
    table = sheet(prediction, "gauge", "stage", rows=places, quantities=result.quantities)
    measured = gauges.in_units(gauges.measured)
    rows: list[CsvRow] = [
        (gauges.channels[i], gauges.stages[j], *row, float(measured[i, j]), gauges.shown_units[i])
        for (i, j), row in zip(places, table.rows, strict=True)
    ]
    return CsvTable(("gauge", "stage", *table.header, "measured", "unit"), tuple(rows))


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
    forces = result.members
    if forces is None:
        return NOTHING
    return sheet(forces, "stage", "member", rows=np.argwhere(np.isfinite(forces.axial.T)).tolist())


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
    posterior, table = result.posterior, result.parameters
    levels = tuple(f"q{100 * level:g}" for level in LEVELS)
    header = ("parameter", "mean", "sd", *levels, "unit", "effective_size", "r_hat")
    if posterior is None:
        return CsvTable(header, ())
    rows: list[CsvRow] = [
        (
            name,
            *(
                _shown(table, i, float(value))
                for value in (posterior.mean[i], posterior.sd[i], *posterior.quantiles[i])
            ),
            _unit(table, i),
            float(posterior.effective[i]),
            float(posterior.r_hat[i]),
        )
        for i, name in enumerate(posterior.names)
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
    for field in result.varied:
        unit = shown_unit(field.unit, field.dimension)
        columns = (field.values, field.sd, field.prior_sd, field.reduction)
        for centre, *numbers in zip(field.centres.tolist(), *columns, strict=True):
            value, sd, before, reduction = map(float, numbers)
            place = (*centre, *(math.nan,) * (3 - len(centre)))
            shown = in_unit(value, field.unit, field.dimension)
            rows.append((field.name, *place, shown, unit, sd, before, reduction))
    return CsvTable(header, tuple(rows))


def _reactions(result: Result) -> CsvTable:
    """Resultants of supports on the ground, kN."""
    reactions = result.reactions
    return (
        NOTHING
        if reactions is None
        else sheet(reactions, "support", "state", rows=reactions.holding)
    )


def _yielded(result: Result) -> CsvTable:
    """How far ground yields; areas in plane strain."""
    return NOTHING if result.yielded is None else sheet(result.yielded, "state")


def _opening(result: Result) -> CsvTable:
    """The stages of a closed form; compression and motions inwards are positive."""
    reaction = result.reaction
    if reaction is None:
        return NOTHING
    table = sheet(reaction, "stage")
    rows = tuple((row[0], reaction.radius, *row[1:]) for row in table.rows)
    return CsvTable((table.header[0], "radius (m)", *table.header[1:]), rows)


def _ground_reaction(result: Result) -> CsvTable:
    """The wall under ever less pressure inside."""
    return NOTHING if result.reaction is None else sheet(result.reaction, "pressure")


def _opening_stresses(result: Result) -> CsvTable:
    """Stresses around the opening, positive in compression."""
    fields = ("stages", "radii", "radial", "hoop")
    reaction = result.reaction
    return NOTHING if reaction is None else sheet(reaction, "stage", "radii", only=fields)


def _face(result: Result) -> CsvTable:
    """What distances to the face say of the stages; parts of one."""
    return NOTHING if result.advance is None else sheet(result.advance, "stage")


def _face_profile(result: Result) -> CsvTable:
    """The part of its final motion that the wall has made, by the distance behind the face."""
    return NOTHING if result.advance is None else sheet(result.advance, "distance")


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
