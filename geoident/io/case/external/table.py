"""From a table of runs to the model of a case: held against its parameters, gauges and bounds."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from geoident.errors import InputError
from geoident.io.case.external.section import TableModelSection
from geoident.io.case.external.surroundings import ModelContext
from geoident.io.external.run_table import read_run_table
from geoident.io.external.runs import FoundRuns
from geoident.io.text.campaign_folder import over_all_of
from geoident.model.arrays import Floats
from geoident.model.external import RunTable
from geoident.model.parameter import Parameter
from geoident.units import in_unit, shown_unit

FEW = 10
"""Runs for each parameter below which it is said that they are few."""

_BEYOND = 2.0
"""By this part of the range of r runs, times 1 / r, a bound may be beyond them, to be moved there.

A Latin hypercube over the bounds ends that far from them.
"""


def build_table(section: TableModelSection, around: ModelContext) -> RunTable:
    """The table that a case names; what is wrong is noted.

    Args:
        section: the key ``model``.
        around: what it refers to.
    """
    over_all = over_all_of(around.folder / section.file)
    empty = np.zeros((0, 0)), np.zeros((0, 0, 0))
    path = str(over_all or around.folder / section.file)
    table = RunTable(path, section.surface, (), *empty, campaign=over_all is not None)
    asked = {name: p for name, p in around.parameters.items() if name not in around.tied}
    content = _found(section, table, asked, around)
    if content is None:
        return table
    around.faults.extend(content.faults)
    if content.named is not None:
        _check_complete(content.named, asked, around, table)
    runs = content.runs
    if runs is None:
        return table
    notes = runs.notes
    if len(runs.values) < FEW * len(runs.names):
        notes += (
            f"{len(runs.values)} runs are few for {len(runs.names)} parameters: "
            f"{FEW * len(runs.names)} and more make a good response surface",
        )
    table = replace(table, names=runs.names, values=runs.values, readings=runs.readings)
    return replace(table, notes=(*notes, *_check_bounds(table, around)))


def _found(
    section: TableModelSection, table: RunTable, asked: dict[str, Parameter], around: ModelContext
) -> FoundRuns | None:
    """What the file of a table has for a case; None where it cannot be read."""
    known = asked, around.channels, around.stages, section.ignore
    try:
        if table.campaign:
            # with it comes h5py, which no other case waits for
            from geoident.io.external.campaign_runs import read_campaign_runs  # noqa: PLC0415

            return read_campaign_runs(Path(table.path), *known)
        before = len(around.faults.found)
        path = around.find(section.file, ("model", "file"))
        return None if len(around.faults.found) > before else read_run_table(path, *known)
    except InputError as error:
        around.faults.extend(error.faults)
        return None


def _check_complete(
    named: frozenset[str], asked: dict[str, Parameter], around: ModelContext, table: RunTable
) -> None:
    """Every parameter and every gauge has a column."""
    where = f"is not in {table.called}" if table.campaign else f"has no column in {table.called}"
    for name in asked:
        if name not in named:
            message = f"the parameter '{name}' {where}"
            hint = "Add it, with what each run was made with, or remove the parameter."
            around.faults.add(("parameters", name), "no-column", message, hint, key=True)
    for channel in around.channels:
        if channel.name not in named:
            message = f"'{channel.name}' {where}"
            hint = "Add it, with what each run gave, or remove the gauge."
            around.faults.add(("gauges", channel.name), "no-column", message, hint, key=True)


def _check_bounds(table: RunTable, around: ModelContext) -> list[str]:
    """No bound is beyond the runs; those that are so by little are moved, which is said."""
    moved = []
    allowed = _BEYOND / len(table)
    for name, column in zip(table.names, table.values.T, strict=True):
        parameter = around.parameters[name]
        low, high = float(column.min()), float(column.max())
        beyond = _beyond(parameter, low, high)
        if not beyond.any():
            continue
        least, most = (_shown(x, parameter) for x in (low, high))
        if float(beyond.max()) > allowed + 1e-9:
            end = int(np.argmax(beyond))
            bound = _shown((parameter.lower, parameter.upper)[end], parameter)
            message = f"the bound {bound} is beyond the runs of {table.called}, "
            message += f"which go from {least} to {most}"
            hint = f"Write 'bounds: [{least}, {most}]', or add runs beyond them."
            path = ("parameters", name, "bounds", end)
            around.faults.add(path, "beyond-runs", message, hint)
        else:
            moved.append(f"{name} from {least} to {most}")
    return [f"bounds are taken where the runs end: {', '.join(moved)}"] if moved else []


def _beyond(parameter: Parameter, low: float, high: float) -> Floats:
    """By which part of the range of the runs the bounds (2,) are beyond it, on its scale."""
    ends = np.array([parameter.lower, low, high, parameter.upper])
    if parameter.scale == "log":
        ends = np.log(ends)
    return np.asarray(np.maximum([ends[1] - ends[0], ends[3] - ends[2]], 0.0) / (ends[2] - ends[1]))


def _shown(value: float, parameter: Parameter) -> str:
    unit = parameter.unit, parameter.dimension
    return f"{in_unit(value, *unit):.6g} {shown_unit(*unit)}".rstrip()


def within_runs(parameters: Sequence[Parameter], table: RunTable) -> tuple[Parameter, ...]:
    """Parameters with bounds and starts inside the runs of a table.

    Args:
        parameters: of the case.
        table: of its runs.
    """
    restricted = []
    for parameter in parameters:
        if parameter.name not in table.names:
            restricted.append(parameter)
            continue
        column = table.values[:, table.names.index(parameter.name)]
        lower = max(parameter.lower, float(column.min()))
        upper = min(parameter.upper, float(column.max()))
        start = min(max(parameter.start, lower), upper)
        restricted.append(replace(parameter, lower=lower, upper=upper, start=start))
    return tuple(restricted)
