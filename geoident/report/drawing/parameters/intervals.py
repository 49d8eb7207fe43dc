"""Parameters with what was known before and what is known now; results side by side."""

from __future__ import annotations

from collections.abc import Sequence, Set
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Patch

from geoident.model.results.result import Labelled, ParameterTable, Result
from geoident.report.drawing.parameters.scale import (
    logarithmic,
    logarithmic_in_any,
    scaled,
    set_scale,
    shown_bounds,
    unscaled,
    with_unit,
)
from geoident.report.drawing.style import FAINT, SMALL, WIDTH, Picture, colour, key, marker, short
from geoident.report.text.parameters import (
    Unit,
    prior_interval,
    unit_of,
    unknown_words,
    value_cells,
)
from geoident.units import in_unit

_PRIOR_COLOUR = "#e69f00"


def parameter_pictures(result: Result) -> tuple[Picture, ...]:
    """One figure of all parameters, if there are any."""
    if not result.parameters.names:
        return ()
    return (
        Picture(
            "parameters",
            "Parameters: bounds, prior and estimate",
            "Each axis spans the bounds, on the scale on which the parameter is identified. Bar: "
            "95 % interval of the prior; tick: start value; dot and line, and in numbers: estimate "
            "and its 95 % interval.",
            lambda: parameter_figure([("estimate", result.parameters)], logarithmic(result)),
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
            lambda: parameter_figure(tables, logarithmic_in_any(results)),
        ),
    )


def parameter_figure(
    tables: Sequence[tuple[str, ParameterTable]], logs: Set[str] = frozenset()
) -> Figure:
    """A row for each parameter; of several results, one estimate below the other.

    Args:
        tables: labels and parameters of the results.
        logs: names of the parameters that are identified on the logarithm.
    """
    names = list(dict.fromkeys(name for _, table in tables for name in table.names))
    step = 0.62 + 0.16 * (len(tables) - 1)
    figure = Figure(figsize=(WIDTH, step * len(names) + 0.8))
    panels = figure.subplots(len(names), 1, squeeze=False)[:, 0]
    for axes, name in zip(panels, names, strict=True):
        _draw_parameter(axes, name, tables, log=name in logs)
    figure.legend(handles=_legend(tables), loc="outside upper center", ncols=5)
    return figure


def _legend(tables: Sequence[tuple[str, ParameterTable]]) -> list[Any]:
    estimates = [
        key(f"{short(label, 24)}, 95 %", color=colour(k), marker=marker(k), ms=4, lw=1.4)
        for k, (label, _) in enumerate(tables)
    ]
    prior = Patch(color=_PRIOR_COLOUR, alpha=0.35, lw=0, label="prior, 95 %")
    known = [prior] if any(any(table.priors) for _, table in tables) else []
    marks = [key("start", color=FAINT, marker="|", ms=8, ls=""), key("bound", color=FAINT, lw=1.2)]
    return [*estimates, *known, *marks]


def _draw_parameter(
    axes: Axes, name: str, tables: Sequence[tuple[str, ParameterTable]], *, log: bool
) -> None:
    first = next(table for _, table in tables if name in table.names)
    i, unit = first.names.index(name), unit_of(first, name)
    ends = _draw_axis(axes, first, i, unit, log=log)
    prior = prior_interval(first.priors[i])
    if prior is not None:
        low, high = np.clip([in_unit(value, *unit) for value in prior], *ends)
        axes.axvspan(low, high, color=_PRIOR_COLOUR, alpha=0.35, lw=0)
    start = in_unit(float(first.start[i]), *unit)
    axes.plot([start], [0.5 * (len(tables) - 1)], "|", color=FAINT, ms=14)
    for k, (_, table) in enumerate(tables):
        if name in table.names:
            _draw_estimate(axes, table, table.names.index(name), unit, k)
    axes.set_ylim(len(tables) - 0.4, -0.6)
    axes.set_yticks([])
    axes.spines["left"].set_visible(False)
    axes.set_ylabel(with_unit(name, unit), rotation=0, ha="right", va="center")


def _draw_estimate(axes: Axes, table: ParameterTable, i: int, unit: Unit, k: int) -> None:
    if not table.determined[i]:
        words = unknown_words(table, i)
        axes.annotate(words, (0.01, k), xycoords=("axes fraction", "data"), va="center",
                      fontsize=SMALL, color=colour(k))  # fmt: skip
        return
    value, low, high = (
        in_unit(float(column[i]), *unit) for column in (table.values, table.lower95, table.upper95)
    )
    if np.isfinite(low) and np.isfinite(high):
        axes.plot([low, high], [k, k], "-", color=colour(k), lw=1.8)
    axes.plot([value], [k], marker(k), color=colour(k), ms=4.5, clip_on=False)
    estimate, interval = value_cells(table, i)
    words = f"{estimate} ({interval})" if interval else estimate
    axes.annotate(words, (1.015, k), xycoords=("axes fraction", "data"), va="center",
                  fontsize=SMALL, color=colour(k))  # fmt: skip


def _draw_axis(
    axes: Axes, table: ParameterTable, i: int, unit: Unit, *, log: bool
) -> tuple[float, float]:
    """The axis from bound to bound with marks at the bounds; its ends."""
    low, high = shown_bounds(table, i, unit, log=log)
    ends = scaled(np.array([low, high]), log=log)
    margin = 0.02 * float(np.ptp(ends))
    first, last = unscaled(ends + np.array([-margin, margin]), log=log)
    set_scale(axes.xaxis, low=float(first), high=float(last), log=log, most=8)
    for bound, side in ((table.lower[i], low), (table.upper[i], high)):
        if np.isfinite(bound):
            axes.axvline(side, color=FAINT, lw=1.2, ymax=0.75)
    return float(first), float(last)
