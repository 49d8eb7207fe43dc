"""Parameters with what was known before and what is known now; scans; results side by side."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch
from matplotlib.ticker import FuncFormatter, LogLocator, NullFormatter, NullLocator

from geoident.model.result import Grid, ParameterTable, Result
from geoident.report.drawing.fields import bands
from geoident.report.drawing.style import (
    COLOURS,
    FAINT,
    LENGTHS,
    MARKERS,
    SMALL,
    Picture,
    short,
)
from geoident.report.text.layout import number
from geoident.report.text.quantities import in_unit, prior_interval, shown_unit

_PRIOR_COLOUR = "#e69f00"


def parameter_pictures(result: Result) -> tuple[Picture, ...]:
    """One figure of all parameters, if there are any."""
    if not result.parameters.names:
        return ()
    return (
        Picture(
            "parameters",
            "Parameters: bounds, prior and estimate",
            "Each axis spans the bounds. A bar from end to end of the prior's 95 % interval, the "
            "start value, and the estimate with its 95 % interval.",
            lambda: parameter_figure([("estimate", result.parameters)]),
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
        Line2D(
            [],
            [],
            color=COLOURS[k % len(COLOURS)],
            marker=MARKERS[k % len(MARKERS)],
            ms=4,
            lw=1.4,
            label=f"{short(label, 24)}, 95 %",
        )
        for k, (label, _) in enumerate(tables)
    ]
    prior = Patch(color=_PRIOR_COLOUR, alpha=0.35, lw=0, label="prior, 95 %")
    return [*estimates, prior, Line2D([], [], color=FAINT, marker="|", ls="", label="start")]


def _draw_parameter(axes: Axes, name: str, tables: Sequence[tuple[str, ParameterTable]]) -> None:
    first = next(table for _, table in tables if name in table.names)
    i = first.names.index(name)
    unit = first.units[i], first.dimensions[i]
    _scale(axes, first, i)
    prior = prior_interval(first.priors[i])
    if prior is not None:
        low, high = (in_unit(value, *unit) for value in prior)
        axes.axvspan(low, high, color=_PRIOR_COLOUR, alpha=0.35, lw=0)
    axes.plot(
        [in_unit(float(first.start[i]), *unit)], [0.5 * (len(tables) - 1)], "|", color=FAINT, ms=14
    )
    for k, (_, table) in enumerate(tables):
        if name in table.names:
            _draw_estimate(axes, table, table.names.index(name), unit, k)
    axes.set_ylim(len(tables) - 0.4, -0.6)
    axes.set_yticks([])
    axes.spines["left"].set_visible(False)
    shown = shown_unit(*unit)
    label = f"{short(name, 16)} ({shown})" if shown else short(name, 16)
    axes.set_ylabel(label, rotation=0, ha="right", va="center")


def _draw_estimate(
    axes: Axes, table: ParameterTable, i: int, unit: tuple[str, str], k: int
) -> None:
    if not table.determined[i]:
        words = "as its prior" if table.priors[i] else "not determined"
        axes.annotate(
            words,
            (0.01, k),
            xycoords=("axes fraction", "data"),
            va="center",
            fontsize=SMALL,
            color=COLOURS[k % len(COLOURS)],
        )
        return
    value, low, high = (
        in_unit(float(column[i]), *unit) for column in (table.values, table.lower95, table.upper95)
    )
    colour = COLOURS[k % len(COLOURS)]
    if np.isfinite(low) and np.isfinite(high):
        axes.plot([low, high], [k, k], "-", color=colour, lw=1.8)
    axes.plot([value], [k], MARKERS[k % len(MARKERS)], color=colour, ms=4.5, clip_on=False)


def _scale(axes: Axes, table: ParameterTable, i: int) -> None:
    """The axis from bound to bound; logarithmic where they are far apart."""
    unit = table.units[i], table.dimensions[i]
    low, high = in_unit(float(table.lower[i]), *unit), in_unit(float(table.upper[i]), *unit)
    value = in_unit(float(table.values[i]), *unit)
    if not np.isfinite(low):
        low = min(0.0, 2 * value)
    if not np.isfinite(high):
        high = max(3 * value, low + 1.0)
    if low > 0 and high > 8 * low:
        axes.set_xscale("log")
        axes.xaxis.set_major_locator(LogLocator(subs=(1, 2, 5)))
        axes.xaxis.set_major_formatter(FuncFormatter(lambda x, _: number(x)))
        axes.xaxis.set_minor_locator(NullLocator())
        axes.xaxis.set_minor_formatter(NullFormatter())
    margin = (high / low) ** 0.02 if axes.get_xscale() == "log" else 0.02 * (high - low)
    log = axes.get_xscale() == "log"
    axes.set_xlim(low / margin if log else low - margin, high * margin if log else high + margin)


def scan_pictures(result: Result) -> tuple[Picture, ...]:
    """The discrepancy over its grid, if the result is that of a scan."""
    grid = result.grid
    if grid is None or not np.isfinite(grid.objective).any():
        return ()
    return (
        Picture(
            "scan",
            "Discrepancy over the parameters",
            "Weighted squares, with the part of the priors; blank where the model has no solution.",
            lambda: scan_figure(result.parameters, grid),
        ),
    )


def scan_figure(parameters: ParameterTable, grid: Grid) -> Figure:
    """A line over one parameter, bands of colour over two."""
    figure = Figure(figsize=(6, 4.4))
    axes = figure.subplots()
    units = [_unit(parameters, name) for name in grid.names]
    values = [
        np.array([in_unit(float(v), *unit) for v in axis])
        for axis, unit in zip(grid.axes, units, strict=True)
    ]
    labels = [
        f"{short(name)} ({shown_unit(*unit)})" if shown_unit(*unit) else short(name)
        for name, unit in zip(grid.names, units, strict=True)
    ]
    axes.set_xlabel(labels[0])
    objective = np.where(np.isfinite(grid.objective), grid.objective, np.nan)
    if len(values) == 1:
        axes.plot(values[0], objective, "-o", ms=3, color=COLOURS[0])
        axes.set_ylabel("discrepancy")
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
    figure.colorbar(shown, ax=axes, label=f"log10 of discrepancy / least ({number(least)})")
    return figure


def _unit(parameters: ParameterTable, name: str) -> tuple[str, str]:
    i = parameters.names.index(name)
    return parameters.units[i], parameters.dimensions[i]
