"""The discrepancy on a grid, the "parametric analysis" of the paper (theory 4.5).

phi is evaluated at every point of the grid, the parameters that have no axis at their start. Points
where the model has no solution have phi = inf. The lowest point is the result, a start for other
methods. Axes of parameters that are scaled by their logarithm have even spacing in the logarithm.

Per point: one call of the model, without derivatives. All points are told beforehand (`ahead`).
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from geoident.errors import Fault, InputError
from geoident.identify.problem.ahead import prefetched_readings
from geoident.identify.problem.outcome import History, OnIteration, Outcome
from geoident.identify.problem.problem import Discrepancy, Problem
from geoident.model.arrays import Floats
from geoident.model.methods import ScanAxis, ScanOptions
from geoident.model.parameter import Parameter
from geoident.model.results.result import Grid

MOST_POINTS = 1_000_000
"""More are a typing error: they would take days, and their history all memory."""


def scan(problem: Problem, options: ScanOptions, on_iteration: OnIteration) -> Outcome:
    """Evaluates the misfit on a grid, theory 4.5.

    Args:
        problem: readings, model and parameters.
        options: the axes.
        on_iteration: is called with every point; its reason to stop ends the scan.

    Returns:
        The best point, and the grid: infinite where there is no solution, NaN where the scan was
        stopped before.

    Raises:
        InputError: an axis of an unknown parameter, or one without finite ends.
    """
    axes = grid_axes(problem.parameters, options)
    names = [q.name for q in problem.parameters]
    columns = [names.index(name) for name in axes]
    phi = np.full([len(axis) for axis in axes.values()], np.nan)
    discrepancy = Discrepancy(problem)
    history = History("scan", problem.response, on_iteration)
    points = np.repeat(problem.start[None], phi.size, axis=0)
    for column, values in zip(columns, np.meshgrid(*axes.values(), indexing="ij"), strict=True):
        points[:, column] = values.ravel()
    with prefetched_readings(problem, points, row=phi.shape[-1]) as turn:
        for k, (p, place) in enumerate(zip(points, np.ndindex(phi.shape), strict=True)):
            turn(k)
            phi[place] = discrepancy.objective(p)
            history.record(p, float(phi[place]), step=0.0, note="grid")
            if history.stop is not None:
                break
    best = min(history.iterations, key=lambda entry: entry.objective)
    status, values = "converged", best.values
    reason = f"All {phi.size} points of the grid are computed."
    if not np.isfinite(best.objective):
        status, values = "not-converged", problem.start
        reason = "The model has no solution at any point of the grid: move or refine the grid."
    grid = Grid(tuple(axes), tuple(axes.values()), phi)
    return replace(history.outcome(values, best.objective, status, reason), grid=grid)


def grid_axes(parameters: tuple[Parameter, ...], options: ScanOptions) -> Mapping[str, Floats]:
    """The values (k,) of every axis by the name of its parameter, SI.

    Raises:
        InputError: an axis of an unknown parameter, or one without finite ends.
    """
    chosen = options.grid or {
        q.name: ScanAxis(q.lower, q.upper, options.points)
        for q in [q for q in parameters if not q.field][:2]
    }
    known = {q.name: q for q in parameters}
    faults = [fault for name, axis in chosen.items() for fault in _axis_faults(known, name, axis)]
    points = math.prod(axis.points for axis in chosen.values())
    if points > MOST_POINTS:
        message = f"the scan has {points:,} points; {MOST_POINTS:,} are the most"
        faults.append(Fault("scan-size", message, "Lower 'points' in fit.scan.", path="fit.scan"))
    if not chosen:
        message = "there is nothing to scan: the case has fields, and no parameter beside"
        hint = "Make the mean of a field a parameter, or name what to scan in fit.scan.grid."
        faults.append(Fault("no-parameters", message, hint, path="fit.scan"))
    if faults:
        raise InputError(faults)
    values = {}
    for name, axis in chosen.items():
        space = np.geomspace if known[name].scale == "log" else np.linspace
        values[name] = np.asarray(space(axis.start, axis.stop, axis.points), dtype=np.float64)
    return values


def _axis_faults(known: Mapping[str, Parameter], name: str, axis: ScanAxis) -> list[Fault]:
    """What is wrong with an axis."""
    if name not in known:
        names = ", ".join(q.name for q in known.values() if not q.field)
        return [Fault("unknown-parameter", f"scan over {name}: the parameters are {names}.")]
    ends = np.array([axis.start, axis.stop])
    log = known[name].scale == "log"
    if not np.all(np.isfinite(ends)) or (log and np.any(ends <= 0.0)) or axis.points < 1:
        what = f"scan over {name}: no grid from {axis.start:g} to {axis.stop:g}"
        return [Fault("scan-axis", f"{what} with {axis.points} points.", "Give finite ends.")]
    return []
