"""Runs that were made elsewhere, wherever they are read from, and what a response surface needs."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from geoident.errors import Fault, Location
from geoident.io.text.wording import listing, shorten
from geoident.model.arrays import Floats
from geoident.model.parameter import Parameter

MOST_RUNS = 2000
_CONSTANT = 1e-12
"""Part of its size by which a column must change."""
_TIED = 1e-6
"""Singular value of the runs, as a part of the largest, below which parameters change together."""
_SHOWN = 5
"""Runs that a note names."""


@dataclass(frozen=True)
class ReadRuns:
    """What a table holds.

    Args:
        names: of the n parameters of its columns.
        values: (r, n) parameters of the runs, SI.
        readings: (r, n_stages, n_channels) what they gave, SI; NaN where there is no column.
        notes: which runs were left out.
    """

    names: tuple[str, ...]
    values: Floats
    readings: Floats
    notes: tuple[str, ...]


@dataclass(frozen=True)
class FoundRuns:
    """What was found in a table.

    Args:
        runs: they; None where something is wrong.
        named: names of parameters and gauges that have a column; None where columns have names that
            nobody knows, which may be those of others.
        faults: what is wrong.
    """

    runs: ReadRuns | None
    named: frozenset[str] | None
    faults: tuple[Fault, ...]


@dataclass(frozen=True)
class RunColumn:
    """What all runs have of one parameter, or of one gauge at a stage.

    Args:
        label: as it is called in the table.
        place: in the table.
        values: (r,) SI; NaN where a run has failed.
        parameter: that it holds; empty for a reading.
        at: number of the stage and of the channel of a reading.
        zero: readings that are zero by definition.
    """

    label: str
    place: Location
    values: Floats
    parameter: str = ""
    at: tuple[int, int] = (-1, -1)
    zero: bool = False


@dataclass(frozen=True)
class RunRow:
    """One run of a table.

    Args:
        name: in notes, such as ``line 5``.
        called: in messages, such as ``the run in line 5``.
        place: in the table.
        failure: why it has no readings; empty for a run that has them.
    """

    name: str
    called: str
    place: Location
    failure: str = ""


def least_runs(n: int) -> int:
    """The fewest runs through which a surface of n parameters is laid."""
    return 3 * (n + 1)


def runs_of(
    columns: Sequence[RunColumn],
    runs: Sequence[RunRow],
    parameters: Mapping[str, Parameter],
    shape: tuple[int, int],
    table: str,
    faults: list[Fault],
) -> ReadRuns | None:
    """The runs that have not failed; None, with faults, where no surface can be laid through them.

    Args:
        columns: of the table, c of them.
        runs: r of them.
        parameters: of the case, by name.
        shape: number of stages and of channels.
        table: its name.
        faults: is told what is wrong; nothing is checked where there are some already.
    """
    names = tuple(column.parameter for column in columns if column.parameter)
    if faults or not names or len(names) == len(columns):
        return None  # what has no column is a fault of the case
    values = np.column_stack([column.values for column in columns])
    lost = [
        run.failure or (f"{columns[int(np.argmin(known))].label} is missing" * (not known.all()))
        for run, known in zip(runs, np.isfinite(values), strict=True)
    ]
    sound = [n for n, failure in enumerate(lost) if not failure]
    failed = [f"{run.name} ({failure})" for run, failure in zip(runs, lost, strict=True) if failure]
    if len(sound) < least_runs(len(names)):
        also = f" ({len(failed)} more have failed)" if failed else ""
        message = f"found {len(sound)} runs{also}; {len(names)} parameters need "
        message += f"{least_runs(len(names))} at least"
        hint = f"About {10 * len(names)} make a good surface: a Latin hypercube over the bounds."
        place = runs[-1].place if runs else columns[0].place
        faults.append(Fault("too-few", message, hint, place))
        return None
    of_parameters = [bool(column.parameter) for column in columns]
    kept, p = values[sound], values[sound][:, of_parameters]
    for column, numbers in zip(columns, kept.T, strict=True):
        faults += _column_faults(column, numbers, parameters)
    faults += [] if faults else _run_faults(names, p, [runs[n] for n in sound], columns[0].place)
    if faults:
        return None
    readings = np.full((len(sound), *shape), np.nan)
    for column, numbers in zip(columns, kept.T, strict=True):
        if not column.parameter:
            readings[:, *column.at] = numbers
    notes: tuple[str, ...] = ()
    if failed:
        more = f" and {len(failed) - _SHOWN} more" if len(failed) > _SHOWN else ""
        have = "has failed and is" if len(failed) == 1 else "have failed and are"
        shown = ", ".join(failed[:_SHOWN])
        notes = (f"{len(failed)} of {len(runs)} runs in {table} {have} left out: {shown}{more}",)
    return ReadRuns(names, p, readings, notes)


def _column_faults(
    column: RunColumn, values: Floats, parameters: Mapping[str, Parameter]
) -> Iterator[Fault]:
    """A column that never changes has no information; a logarithm is of what is positive."""
    name, size = column.parameter, float(np.max(np.abs(values)))
    if float(np.ptp(values)) <= _CONSTANT * size and not (column.zero and size == 0.0):
        what = f"the parameter '{name}'" if name else f"the column '{shorten(column.label)}'"
        hint = "Vary it, or give it its number where the runs are made and remove it here."
        if not name:
            hint = "Nothing can be identified from it: name it under 'ignore' of the case."
        message = f"{what} is the same in all runs"
        yield Fault("constant-column", message, hint, column.place)
    if name and parameters[name].scale == "log" and values.min() <= 0.0:
        message = f"'{name}' has the scale log, and is not positive in all runs"
        yield Fault("out-of-range", message, "Use 'scale: linear' in the case.", column.place)


def _run_faults(
    names: Sequence[str], values: Floats, runs: Sequence[RunRow], place: Location
) -> Iterator[Fault]:
    """No run is there twice, and no parameters only change together."""
    unit = (values - values.min(axis=0)) / np.ptp(values, axis=0)
    first_of: dict[tuple[float, ...], RunRow] = {}
    for run, row in zip(runs, np.round(unit, 10).tolist(), strict=True):
        first = first_of.setdefault(tuple(row), run)
        if first is not run:
            which = "" if run.place.line else f"{run.called}: "
            message = f"{which}the parameters are those of {first.called}"
            hint = "Remove one of the two: a surface can go through one reading only."
            yield Fault("duplicate-run", message, hint, run.place)
    size, vectors = np.linalg.svd(unit - unit.mean(axis=0), full_matrices=False)[1:]
    if size[-1] < _TIED * size[0]:
        tied = [names[k] for k in np.flatnonzero(np.abs(vectors[-1]) > 0.1).tolist()]
        message = f"{listing(tied)} change only together and cannot be separated"
        hint = "Add runs in which each changes alone, or make one parameter of them."
        yield Fault("tied-columns", message, hint, place)
