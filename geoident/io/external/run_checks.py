"""Runs that were read, wherever from, held against what a response surface needs."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from geoident.errors import Fault
from geoident.io.text.wording import listing, shorten
from geoident.model.arrays import Floats
from geoident.model.parameter import Parameter

_SAME = 1e-12
_TOGETHER = 1e-6
SHOWN = 5
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
class HeldColumn:
    """What a column of a table of runs holds.

    Args:
        label: as it is called there.
        parameter: that it holds; empty for a reading.
        place: number of the stage and of the channel of a reading.
        zero: readings that are zero by definition.
    """

    label: str
    parameter: str = ""
    place: tuple[int, int] = (-1, -1)
    zero: bool = False


Refuse = Callable[[int, str, str, str], None]
"""Notes a fault: of a run (its number, from 0; -1 - k for column k), code, message, hint."""


def least_runs(n: int) -> int:
    """The fewest runs through which a surface of n parameters is laid."""
    return 3 * (n + 1)


def checked_runs(
    columns: Sequence[HeldColumn],
    table: Floats,
    runs: Sequence[str],
    parameters: Mapping[str, Parameter],
    refuse: Refuse,
) -> None:
    """Note why no surface could be laid through runs.

    Args:
        columns: what the c columns hold.
        table: (r, c) numbers, SI, all finite.
        runs: how each run is called in a sentence, such as ``the run in line 5``.
        parameters: of the case, by name.
        refuse: is told what is wrong.
    """
    before = [
        _check_column(-1 - k, column, table[:, k], parameters, refuse)
        for k, column in enumerate(columns)
    ]
    names = [column.parameter for column in columns if column.parameter]
    if all(before) and names:
        of_parameters = np.array([bool(column.parameter) for column in columns])
        _check_runs(names, table[:, of_parameters], runs, refuse)


def _check_column(
    at: int, column: HeldColumn, values: Floats, parameters: Mapping[str, Parameter], refuse: Refuse
) -> bool:
    """A column that never changes tells nothing; a logarithm is of what is positive."""
    size, sound = float(np.max(np.abs(values))), True
    if float(np.ptp(values)) <= _SAME * size and not (column.zero and size == 0.0):
        message = f"the column '{shorten(column.label)}' is the same in all runs"
        hint = "Give the parameter its number in the program instead, and remove it here."
        if not column.parameter:
            hint = "Nothing can be identified from it: name it under 'ignore' of the case."
        refuse(at, "constant-column", message, hint)
        sound = False
    log = column.parameter and parameters[column.parameter].scale == "log"
    if log and values.min() <= 0.0:
        message = f"'{column.parameter}' has the scale log, and is not positive in all runs"
        refuse(at, "out-of-range", message, "Use 'scale: linear' in the case.")
        sound = False
    return sound


def _check_runs(names: Sequence[str], values: Floats, runs: Sequence[str], refuse: Refuse) -> None:
    """No run is there twice, and no parameters only change together."""
    unit = (values - values.min(axis=0)) / np.ptp(values, axis=0)
    seen: dict[tuple[float, ...], int] = {}
    for number, row in enumerate(np.round(unit, 10).tolist()):
        first = seen.setdefault(tuple(row), number)
        if first != number:
            message = f"the parameters are those of {runs[first]}"
            hint = "Remove one of the two: a surface can go through one reading only."
            refuse(number, "duplicate-run", message, hint)
    size, vectors = np.linalg.svd(unit - unit.mean(axis=0), full_matrices=False)[1:]
    if size[-1] < _TOGETHER * size[0]:
        tied = [names[k] for k in np.flatnonzero(np.abs(vectors[-1]) > 0.1).tolist()]
        message = f"{listing(tied)} change only together, so nothing tells them apart"
        hint = "Add runs in which each changes by itself, or make one parameter of them."
        refuse(-1, "tied-columns", message, hint)


def too_few(n: int, sound: int, failed: int) -> tuple[str, str] | None:
    """What is wrong where runs are too few, and what to do; None where they are enough.

    Args:
        n: number of parameters.
        sound: number of runs.
        failed: number of runs besides that have failed.
    """
    least = least_runs(n)
    if sound >= least:
        return None
    also = f" ({failed} more have failed)" if failed else ""
    message = f"found {sound} runs{also}; {n} parameters need {least} at least"
    return message, f"About {10 * n} make a good surface: a Latin hypercube over the bounds."


def left_out_note(said: Sequence[str], failed: int, total: int, name: str) -> tuple[str, ...]:
    """Which runs have failed, in a sentence; nothing where none has.

    Args:
        said: the first of them in words.
        failed: number of all of them.
        total: number of all runs.
        name: of the table.
    """
    if not failed:
        return ()
    more = f" and {failed - len(said)} more" if failed > len(said) else ""
    have = "has failed and is" if failed == 1 else "have failed and are"
    return (f"{failed} of {total} runs in {name} {have} left out: {', '.join(said)}{more}",)


def runs_held(
    columns: Sequence[HeldColumn], table: Floats, shape: tuple[int, int], notes: tuple[str, ...]
) -> ReadRuns:
    """The runs of a table, its parameters and its readings apart.

    Args:
        columns: what the c columns hold.
        table: (r, c) numbers, SI.
        shape: number of stages and of channels.
        notes: which runs were left out.
    """
    readings = np.full((len(table), *shape), np.nan)
    for k, column in enumerate(columns):
        if not column.parameter:
            readings[:, *column.place] = table[:, k]
    names = tuple(column.parameter for column in columns if column.parameter)
    values = table[:, [bool(column.parameter) for column in columns]]
    return ReadRuns(names, values, readings, notes)
