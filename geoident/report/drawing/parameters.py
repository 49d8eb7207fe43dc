"""Parameters with what was known before and what is known now; scans; results side by side."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Patch
from matplotlib.ticker import FuncFormatter, LogLocator, NullFormatter, NullLocator

from geoident.model.results.result import Grid, Labelled, ParameterTable, Result
from geoident.report.drawing.fields.panels import bands
from geoident.report.drawing.style import FAINT, LENGTHS, SMALL, Picture, colour, key, marker, short
from geoident.report.text.layout import number
from geoident.report.text.parameters import AS_PRIOR, NOT_DETERMINED, Unit, prior_interval, unit_of
from geoident.units import in_unit, shown_unit

_PRIOR_COLOUR = "#e69f00"


def parameter_pictures(result: Result) -> tuple[Picture, ...]:
    """One figure of all parameters, if there are any."""
    if not result.parameters.names:
        return ()
    return (
        Picture(
            "parameters",
            "Parameters: bounds, prior and estimate",
            "Each axis spans the bounds. Bar: 95 % interval of the prior; tick: start value; dot "
            "and line: estimate and its 95 % interval.",
            lambda: parameter_figure([("estimate", result.parameters)]),
        ),
    )


def compared_parameter_pictures(results: Labelled) -> tuple[Picture, ...]:
    """The parameters of several results (with their labels), if there are any."""
    tables = [(label, result.parameters) for label, result in results]
    if not any(table.names for _, table in tables):
        return ()
    return (
        Picture(
            "compared-parameters",
            "Parameters side by side",
            "Bounds, prior and start are those of the first result that has the parameter.",
            lambda: parameter_figure(tables),
        ),
    )


def parameter_figure(tables: Sequence[tuple[str, ParameterTable]]) -> Figure:
    """A row for each parameter; of several results, one estimate below the other."""
    names = list(dict.fromkeys(name for _, table in tables for name in table.names))
    step = 0.62 + 0.16 * (len(tables) - 1)
    figure = Figure(figsize=(8.5, step * len(names) + 0.8))
    panels = figure.subplots(len(names), 1, squeeze=False)[:, 0]
    for axes, name in zip(panels, names, strict=True):
        _draw_parameter(axes, name, tables)
    figure.legend(handles=_legend(tables), loc="outside upper center", ncols=5)
    return figure


def _legend(tables: Sequence[tuple[str, ParameterTable]]) -> list[Any]:
    estimates = [
        key(f"{short(label, 24)}, 95 %", color=colour(k), marker=marker(k), ms=4, lw=1.4)
        for k, (label, _) in enumerate(tables)
    ]
    prior = Patch(color=_PRIOR_COLOUR, alpha=0.35, lw=0, label="prior, 95 %")
    return [*estimates, prior, key("start", color=FAINT, marker="|", ls="")]


def _draw_parameter(axes: Axes, name: str, tables: Sequence[tuple[str, ParameterTable]]) -> None:
    first = next(table for _, table in tables if name in table.names)
    i, unit = first.names.index(name), unit_of(first, name)
    _scale(axes, first, i, unit)
    prior = prior_interval(first.priors[i])
    if prior is not None:
        low, high = (in_unit(value, *unit) for value in prior)
        axes.axvspan(low, high, color=_PRIOR_COLOUR, alpha=0.35, lw=0)
    start = in_unit(float(first.start[i]), *unit)
    axes.plot([start], [0.5 * (len(tables) - 1)], "|", color=FAINT, ms=14)
    for k, (_, table) in enumerate(tables):
        if name in table.names:
            _draw_estimate(axes, table, table.names.index(name), unit, k)
    axes.set_ylim(len(tables) - 0.4, -0.6)
    axes.set_yticks([])
    axes.spines["left"].set_visible(False)
    axes.set_ylabel(_with_unit(short(name, 16), unit), rotation=0, ha="right", va="center")


def _with_unit(name: str, unit: Unit) -> str:
    shown = shown_unit(*unit)
    return f"{name} ({shown})" if shown else name


def _draw_estimate(axes: Axes, table: ParameterTable, i: int, unit: Unit, k: int) -> None:
    if not table.determined[i]:
        words = AS_PRIOR if table.priors[i] else NOT_DETERMINED
        axes.annotate(words, (0.01, k), xycoords=("axes fraction", "data"), va="center",
                      fontsize=SMALL, color=colour(k))  # fmt: skip
        return
    value, low, high = (
        in_unit(float(column[i]), *unit) for column in (table.values, table.lower95, table.upper95)
    )
    if np.isfinite(low) and np.isfinite(high):
        axes.plot([low, high], [k, k], "-", color=colour(k), lw=1.8)
    axes.plot([value], [k], marker(k), color=colour(k), ms=4.5, clip_on=False)


def _scale(axes: Axes, table: ParameterTable, i: int, unit: Unit) -> None:
    """The axis from bound to bound; logarithmic where they are far apart."""
    low, high, value = (
        in_unit(float(column[i]), *unit) for column in (table.lower, table.upper, table.values)
    )
    if not np.isfinite(low):
        low = min(0.0, 2 * value)
    if not np.isfinite(high):
        high = max(3 * value, low + 1.0)
    if not (low > 0 and high > 8 * low):
        margin = 0.02 * (high - low)
        axes.set_xlim(low - margin, high + margin)
        return
    axes.set_xscale("log")
    axes.xaxis.set_major_locator(LogLocator(subs=(1, 2, 5)))
    axes.xaxis.set_major_formatter(FuncFormatter(lambda x, _: number(x)))
    axes.xaxis.set_minor_locator(NullLocator())
    axes.xaxis.set_minor_formatter(NullFormatter())
    margin = (high / low) ** 0.02
    axes.set_xlim(low / margin, high * margin)


def scan_pictures(result: Result) -> tuple[Picture, ...]:
    """The misfit over its grid, if the result is that of a scan."""
    grid = result.grid
    if grid is None or not np.isfinite(grid.objective).any():
        return ()
    return (
        Picture(
            "scan",
            "Misfit over the parameters",
            "Weighted squares, priors included; blank where the model has no solution.",
            lambda: scan_figure(result.parameters, grid),
        ),
    )


def scan_figure(parameters: ParameterTable, grid: Grid) -> Figure:
    """A line over one parameter, bands of colour over two."""
    figure = Figure(figsize=(6, 4.4))
    axes = figure.subplots()
    units = [unit_of(parameters, name) for name in grid.names]
    values = [
        np.array([in_unit(float(v), *unit) for v in axis])
        for axis, unit in zip(grid.axes, units, strict=True)
    ]
    labels = [_with_unit(short(name), unit) for name, unit in zip(grid.names, units, strict=True)]
    axes.set_xlabel(labels[0])
    objective = np.where(np.isfinite(grid.objective), grid.objective, np.nan)
    if len(values) == 1:
        axes.plot(values[0], objective, "-o", ms=3, color=colour(0))
        axes.set_ylabel("misfit")
        axes.grid()
        return figure
    axes.set_ylabel(labels[1])
    logs = np.log10(np.maximum(objective, 1e-12))
    logs -= float(np.nanmin(logs))
    known = logs[np.isfinite(logs)]
    scale = bands(np.stack([known, np.ones_like(known)]), LENGTHS)
    shown = axes.contourf(*values, np.ma.masked_invalid(logs.T), **scale)
    best = np.unravel_index(np.nanargmin(objective), objective.shape)
    axes.plot(values[0][best[0]], values[1][best[1]], "*", ms=11, color="#d55e00", mec="white")
    least = float(np.nanmin(objective))
    figure.colorbar(shown, ax=axes, label=f"log10 (misfit / least misfit {number(least)})")
    return figure
