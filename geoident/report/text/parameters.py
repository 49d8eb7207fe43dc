"""Parameters and scans over them, in the units in which the user wrote them.

What is not determined is said in words, never shown as a number.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from geoident.model.parameter import Parameter, Prior
from geoident.model.results.bands import NORMAL_95
from geoident.model.results.columns import columns
from geoident.model.results.result import Grid, Iteration, Labelled, ParameterTable, Result
from geoident.model.yielding import Certificate
from geoident.report.text.layout import TextTable, number, shown_interval
from geoident.report.text.rows import CsvTable, beside, headed, sheet
from geoident.report.text.yielding import least_text
from geoident.units import in_unit, shown_unit

NOT_DETERMINED = "not determined"
AS_PRIOR = "as its prior"

Unit = tuple[str, str]
"""A unit as the user wrote it, and the dimension of what it measures."""


def unit_of(parameters: ParameterTable, name: str) -> Unit:
    """Unit and dimension of a parameter."""
    i = parameters.names.index(name)
    return parameters.units[i], parameters.dimensions[i]


def headers(parameters: ParameterTable) -> list[str]:
    """The header of each parameter in a spreadsheet, with its unit."""
    table = parameters
    return [headed(*one) for one in zip(table.names, table.units, table.dimensions, strict=True)]


def parameters_sheet(result: Result, *, si: bool = False) -> CsvTable:
    """All columns of the parameters, and their priors.

    Args:
        result: with the parameters.
        si: SI units in place of those of the case.
    """
    table = result.parameters
    kinds = zip(table.priors, table.units, table.dimensions, strict=True)
    priors = tuple((prior_in_unit(prior, "" if si else unit, of),) for prior, unit, of in kinds)
    columns = sheet(table, "parameter", quantities=result.quantities, si=si)
    return beside(columns, CsvTable(("prior",), priors))


def parameters_text(parameters: ParameterTable, proof: Certificate | None = None) -> str:
    """One line for each parameter: value, 95 % interval, unit, and what else is to be known."""
    further = _further(parameters)
    rows = []
    for i, name in enumerate(parameters.names):
        value, interval = value_cells(parameters, i, between=" .. ")
        unit = shown_unit(*unit_of(parameters, name))
        more = [cells[i] for cells in further.values()]
        rows.append([name, value, interval, unit, *more, _remarks(parameters, i, proof)])
    header = ("name", "value", "95 % interval", "unit", *further, "remarks")
    return TextTable(header, rows, right="lrll" + "r" * len(further)).text


def _further(parameters: ParameterTable) -> dict[str, list[str]]:
    """The columns that are declared with a heading, in the units of the user."""
    quantities = {"parameter": list(zip(parameters.units, parameters.dimensions, strict=True))}
    labels = {one.field: one.label for one in columns(ParameterTable) if one.label}
    cells = {
        label: sheet(parameters, "parameter", quantities=quantities, only=(name,)).rows
        for name, label in labels.items()
    }
    return {
        label: [number(row[0]) if isinstance(row[0], float) else str(row[0]) for row in rows]
        for label, rows in cells.items()
        if rows and rows[0]
    }


def value_cells(parameters: ParameterTable, i: int, *, between: str = " to ") -> tuple[str, str]:
    """Value and 95 % interval in the user's unit; in words and empty if they are not determined.

    Args:
        parameters: the table.
        i: row of the parameter.
        between: what stands between the ends of the interval.
    """
    if not parameters.determined[i]:
        return unknown_words(parameters, i), ""
    numbers = parameters.values[i], parameters.lower95[i], parameters.upper95[i]
    unit = parameters.units[i], parameters.dimensions[i]
    return shown_interval(*numbers, *unit, between=between)


def unknown_words(parameters: ParameterTable, i: int) -> str:
    """What stands for the value of a parameter that the readings do not determine."""
    prior = parameters.priors[i]
    known = prior is not None and prior.narrows(parameters.lower[i], parameters.upper[i])
    return AS_PRIOR if known else NOT_DETERMINED


def _in_units(parameters: ParameterTable, i: int, *columns: np.ndarray) -> list[str]:
    """Entry ``i`` of columns of a table in its unit."""
    unit = parameters.units[i], parameters.dimensions[i]
    return [number(in_unit(float(column[i]), *unit)) for column in columns]


def _remarks(parameters: ParameterTable, i: int, proof: Certificate | None) -> str:
    texts = (parameters.described(i), least_text(proof, parameters, i))
    remarks = [text for text in texts if text]
    if parameters.at_bound[i]:
        remarks.append(f"at {nearer_bound(parameters, i)} bound")
    if parameters.priors[i]:
        text = prior_in_unit(parameters.priors[i], parameters.units[i], parameters.dimensions[i])
        remarks.append(f"prior {text}")
        if not parameters.determined[i]:  # the other parameters hold for this value of it
            remarks.append(f"computed with {_in_units(parameters, i, parameters.values)[0]}")
    return ", ".join(remarks)


def nearer_bound(parameters: ParameterTable, i: int) -> str:
    """``lower`` or ``upper``, the bound on which a parameter lies."""
    value = parameters.values[i]
    nearer_lower = abs(value - parameters.lower[i]) <= abs(value - parameters.upper[i])
    return "lower" if nearer_lower else "upper"


def parameter_table(parameters: ParameterTable) -> TextTable:
    """What was known of each parameter, and what is known now."""
    further = _further(parameters)
    rows = []
    for i in range(len(parameters.names)):
        *cells, remark = _row(parameters, i)
        rows.append([*cells, *(more[i] for more in further.values()), remark])
    header = ("parameter", "meaning", "unit", "value", "95 % interval", "prior", "start", "bounds")
    right = "lllrrrrr" + "r" * len(further) + "l"
    return TextTable((*header, *further, "remark"), rows, right=right)


def _row(parameters: ParameterTable, i: int) -> list[str]:
    unit = parameters.units[i], parameters.dimensions[i]
    value, interval = value_cells(parameters, i)
    start, lower, upper = _in_units(
        parameters, i, parameters.start, parameters.lower, parameters.upper
    )
    prior = parameters.priors[i]
    return [
        parameters.names[i],
        parameters.described(i),
        shown_unit(*unit) or "-",
        value,
        interval or "-",
        prior_in_unit(prior, *unit).replace("+-", "±") if prior else "-",
        start,
        f"{lower} to {upper}",
        f"at its {nearer_bound(parameters, i)} bound" if parameters.at_bound[i] else "",
    ]


def compared_parameters(results: Labelled) -> TextTable:
    """The parameters of several results (with their labels) side by side."""
    tables = [result.parameters for _, result in results]
    rows = []
    for name in dict.fromkeys(name for table in tables for name in table.names):
        owner = next(table for table in tables if name in table.names)
        unit = shown_unit(*unit_of(owner, name)) or "-"
        rows.append([name, unit, *(_compared_cell(table, name) for table in tables)])
    header = ("parameter", "unit", *(label for label, _ in results))
    return TextTable(header, rows, right="ll" + "r" * len(results))


def _compared_cell(parameters: ParameterTable, name: str) -> str:
    if name not in parameters.names:
        return "-"
    value, interval = value_cells(parameters, parameters.names.index(name))
    return f"{value} ({interval})" if interval else value


def value_sentence(parameters: ParameterTable, i: int) -> str:
    """A parameter with its unit and interval, such as ``E = 12 GPa (95 %: 11 to 13)``."""
    value, interval = value_cells(parameters, i)
    unit = shown_unit(parameters.units[i], parameters.dimensions[i])
    meaning = f" ({text})" if (text := parameters.described(i)) else ""
    words = f"{parameters.names[i]}{meaning} = {value} {unit}".rstrip()
    return f"{words} (95 %: {interval})" if interval else words


def prior_in_unit(prior: Prior | None, unit: str, dimension: str) -> str:
    """A prior in words, with its numbers in a unit; empty for none.

    Args:
        prior: SI, or None.
        unit: as the user wrote it.
        dimension: of the parameter.

    >>> prior_in_unit(Prior(8e6, 1e6), "MPa", "pressure")
    '8 +- 1'
    >>> prior_in_unit(Prior(8e6, 1e6, "lognormal"), "MPa", "pressure")
    '8 +- 1 (lognormal)'
    """
    if prior is None:
        return ""
    mean, sd = (number(in_unit(value, unit, dimension)) for value in (prior.mean, prior.sd))
    return f"{mean} +- {sd}" + ("" if prior.kind == "normal" else f" ({prior.kind})")


def prior_interval(prior: Prior | None) -> tuple[float, float] | None:
    """The 95 % interval of a prior, SI; None if there is no prior.

    The sd of a lognormal prior is that of the logarithm times its median.

    >>> [round(end / 1e6, 2) for end in prior_interval(Prior(8e6, 1e6))]
    [6.04, 9.96]
    """
    if prior is None:
        return None
    if prior.kind == "normal":
        return prior.mean - NORMAL_95 * prior.sd, prior.mean + NORMAL_95 * prior.sd
    factor = math.exp(NORMAL_95 * prior.sd / prior.mean)
    return prior.mean / factor, prior.mean * factor


def iteration_text(iteration: Iteration, parameters: Sequence[Parameter]) -> str:
    """One step of an identifier on one line."""
    values = ", ".join(
        f"{q.name} {number(in_unit(float(value), q.unit, q.dimension))}"
        f" {shown_unit(q.unit, q.dimension)}".rstrip()
        for q, value in zip(parameters, iteration.values, strict=False)
    )
    note = f" {iteration.note}," if iteration.note else ""
    return (
        f"{iteration.method} {iteration.number}:{note} misfit"
        f" {number(iteration.objective, 6)} ({values})"
    )


def grid_text(result: Result) -> str:
    """A scan: the table over one parameter, the extent over two."""
    grid = result.grid
    if grid is None:
        return ""
    units = [unit_of(result.parameters, name) for name in grid.names]
    return _line_text(grid, units[0]) if len(grid.names) == 1 else _plane_text(grid, units)


def _line_text(grid: Grid, unit: Unit) -> str:
    rows = [
        [number(in_unit(float(value), *unit)), _misfit(float(phi))]
        for value, phi in zip(grid.axes[0], grid.objective, strict=True)
    ]
    axis = f"{grid.names[0]} ({unit[0]})" if unit[0] else grid.names[0]
    return TextTable((axis, "misfit"), rows, right="rr").text


def _plane_text(grid: Grid, units: Sequence[Unit]) -> str:
    rows = [
        [
            name,
            number(in_unit(float(axis.min()), *unit)),
            number(in_unit(float(axis.max()), *unit)),
            unit[0],
            str(axis.size),
        ]
        for name, axis, unit in zip(grid.names, grid.axes, units, strict=True)
    ]
    finite = grid.objective[np.isfinite(grid.objective)]
    extent = (
        f"Misfit from {number(float(finite.min()))} to {number(float(finite.max()))}"
        f" over {grid.objective.size} points; the values are in the result file."
        if finite.size
        else "The model has no solution at any point."
    )
    return (
        TextTable(("axis", "from", "to", "unit", "points"), rows, right="lrrlr").text
        + "\n"
        + extent
    )


def _misfit(phi: float) -> str:
    return "no solution" if math.isinf(phi) else number(phi, 6)
