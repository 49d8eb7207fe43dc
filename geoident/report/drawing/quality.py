"""How well the model meets the readings, how it got there, and what it says of the parameters."""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import FuncFormatter, MaxNLocator

from geoident.model.arrays import Bools, Floats
from geoident.model.results.result import GaugeTable, Iteration, ParameterTable, Result
from geoident.report.drawing.gauges.axis import unknown
from geoident.report.drawing.labels import place_labels
from geoident.report.drawing.style import (
    ACCENT,
    COMPUTED,
    DIVERGING,
    FAINT,
    MEASURED,
    SMALL,
    WIDTH,
    Picture,
    colour,
    labelled,
    marker,
    short,
)
from geoident.report.text.layout import number
from geoident.report.text.residuals import OUTLIER, has_unexplained, in_sd_note, unexplained

_MOST_ROWS = 60
_MOST_NAMES = 30


def quality_pictures(result: Result) -> tuple[Picture, ...]:
    """1:1 plot, residuals, history and correlation, as far as there is something to show."""
    pictures = []
    if np.isfinite(unexplained(result)).any():
        words = "All readings; on the line, computed and measured are equal."
        draw = partial(one_to_one_figure, result)
        pictures.append(Picture("one-to-one", "Computed against measured", words, draw))
        words, draw = _residual_words(result), partial(residual_figure, result)
        pictures.append(Picture("residuals", "Standardized residuals", words, draw))
    if len(result.history) > 1:
        words = (
            "Left: misfit (weighted squares, priors included) at each trial. Right: parameters "
            "that are determined, divided by their final values."
        )
        pictures.append(
            Picture("history", "Course of the search", words, partial(history_figure, result))
        )
    table = result.parameters
    if np.count_nonzero(table.determined & np.isfinite(table.sd)) > 1:
        words = (
            "Near 1 or -1 the readings determine a combination of two parameters better than "
            "either. A dash: not determined."
        )
        draw = partial(correlation_figure, table)
        pictures.append(Picture("correlation", "Correlation of the parameters", words, draw))
    return tuple(pictures)


def one_to_one_figure(result: Result) -> Figure:
    """Computed over measured readings, equal scales, a panel for each unit."""
    shown, rows = result.gauges.shown_units, np.flatnonzero(_both(result).any(axis=1))
    units = list(dict.fromkeys(shown[row] for row in rows))
    width = min(4.3, WIDTH / len(units))
    figure = Figure(figsize=(width * len(units), width + 0.1))
    for axes, unit in zip(figure.subplots(1, len(units), squeeze=False)[0], units, strict=True):
        _draw_one_to_one(axes, result, unit)
        axes.legend(loc="upper left")
    return figure


def _both(result: Result) -> Bools:
    """(n_channels, n_stages) measured, and computed or predicted."""
    known = np.isfinite(result.gauges.computed) & ~unknown(result)
    return np.asarray(known & np.isfinite(result.gauges.measured))


def _draw_one_to_one(axes: Axes, result: Result, unit: str) -> None:
    table = result.gauges
    computed, measured = table.in_units(table.computed), table.in_units(table.measured)
    alike = np.array([name == unit for name in table.shown_units], dtype=np.bool_)
    both = _both(result) & alike[:, None]
    for used, words in ((True, "used"), (False, "not used or predicted")):
        here = both & (table.used == used)
        if here.any():
            label = f"{words} ({np.count_nonzero(here)})"
            _draw_dots(axes, measured[here], computed[here], used=used, ms=4, label=label)
    values = np.concatenate([measured[both], computed[both]])
    low, high = float(values.min()), float(values.max())
    margin = 0.05 * (high - low) or 1.0
    ends = low - margin, high + margin
    axes.plot(ends, ends, "-", color=COMPUTED, lw=1, zorder=0, label="computed = measured")
    across, up = labelled("measured", unit), labelled("computed", unit)
    axes.set(xlim=ends, ylim=ends, xlabel=across, ylabel=up)
    axes.set_aspect("equal")
    axes.grid()


def _draw_dots(axes: Axes, x: Floats, y: Floats, *, used: bool, **style: Any) -> None:
    """Readings (n,) at x and y, hollow where they are not used."""
    face = MEASURED if used else "white"
    axes.plot(x, y, "o", color=MEASURED, mfc=face, mew=0.8, **style)


def _residual_words(result: Result) -> str:
    """What has to be known of the residuals, and what is left out where there are many."""
    rows = _residual_rows(result)
    beyond = int(np.count_nonzero(np.abs(np.nan_to_num(unexplained(result))) > OUTLIER))
    named = (
        f" Of {beyond} such values only the {_MOST_NAMES} largest are named."
        if beyond > _MOST_NAMES
        else ""
    )
    few = len(rows) < len(result.gauges.channels)
    more = f" Only the {len(rows)} channels that deviate most are shown." if few else ""
    note = in_sd_note(result, predictions=True)
    return (
        f"Measured minus computed. {note} Values beyond {OUTLIER:g} have the name of their stage."
        f"{named}{more}"
    )


def _residual_rows(result: Result) -> list[int]:
    """Channels with residuals; of many, those that deviate most, in their order."""
    size = np.nan_to_num(np.abs(unexplained(result)), nan=-1.0).max(axis=1, initial=-1.0)
    rows = [int(row) for row in np.argsort(-size, kind="stable") if size[row] >= 0]
    return sorted(rows[:_MOST_ROWS])


def residual_figure(result: Result) -> Figure:
    """Standardized residuals, a line for each channel, a mark for each stage."""
    rows, table = _residual_rows(result), result.gauges
    figure = Figure(figsize=(WIDTH, 0.19 * len(rows) + 1.4))
    axes = figure.subplots()
    axes.axvspan(-2, 2, color=FAINT, alpha=0.15, lw=0)
    axes.axvline(0, color=FAINT, lw=0.7)
    residual = unexplained(result)
    for y, row in enumerate(rows):
        for used in (True, False):
            here = np.isfinite(residual[row]) & (table.used[row] == used)
            _draw_dots(axes, residual[row, here], np.full(here.sum(), y), used=used, ms=3.8)
    reach = 1.1 * max(3.5, float(np.nanmax(np.abs(residual))))
    axes.set_xlim(-reach, reach)
    axes.set_ylim(len(rows) - 0.4, -0.6)
    axes.set_yticks(range(len(rows)), [short(table.channels[row], 22) for row in rows])
    apart = has_unexplained(result, predictions=True)
    what = "unexplained residual" if apart else "(measured - computed)"
    axes.set_xlabel(
        f"{what} / standard deviation; grey: within 2; hollow: not used", fontsize=SMALL
    )
    axes.grid(axis="y")
    _name_outliers(axes, residual[rows], table)
    return figure


def _name_outliers(axes: Axes, residual: Floats, table: GaugeTable) -> None:
    """The stage of each dot beyond the limit, beside it; of many, of those farthest off.

    Args:
        axes: where the dots are, those of the k-th channel at y = k.
        residual: (k, n_stages) standardized residuals.
        table: of the readings.
    """
    size = np.abs(np.nan_to_num(residual))
    out = np.argwhere(size > OUTLIER)
    farthest = np.argsort(-size[tuple(out.T)], kind="stable")[:_MOST_NAMES]
    far = out[np.sort(farthest)]
    dots = np.argwhere(np.isfinite(residual))
    place_labels(
        axes,
        [(residual[y, stage], y) for y, stage in far],
        [short(table.stages[stage], 12) for _, stage in far],
        avoid=[np.array([[residual[y, stage], y]]) for y, stage in dots],
    )


def history_figure(result: Result) -> Figure:
    """Objective and parameters over the trials."""
    history = [i for i in result.history if np.isfinite(i.objective)]
    names = np.flatnonzero(result.parameters.determined).tolist()
    figure = Figure(figsize=(WIDTH if names else 5.5, 3.3))
    panels = figure.subplots(1, 2 if names else 1, squeeze=False)[0]
    _draw_objective(panels[0], history)
    if names:
        _draw_traces(panels[1], result, history, names)
    for axes in panels:
        axes.set_xlabel("trial")
        axes.xaxis.set_major_locator(MaxNLocator(integer=True))
        axes.grid()
    return figure


def _draw_objective(axes: Axes, history: Sequence[Iteration]) -> None:
    x = np.arange(len(history))
    objective = np.array([i.objective for i in history])
    rejected = np.array([i.note == "rejected" for i in history], dtype=bool)
    axes.plot(x[~rejected], objective[~rejected], "-o", ms=3.5, lw=1, color=COMPUTED)
    if rejected.any():
        axes.plot(x[rejected], objective[rejected], "x", ms=5, color=ACCENT, label="rejected")
        axes.legend()
    if objective.size and objective.min() > 0 and objective.max() > 10 * objective.min():
        axes.set_yscale("log")
        axes.yaxis.set_major_formatter(FuncFormatter(lambda y, _: number(y)))
    axes.set_ylabel("misfit")


def _draw_traces(
    axes: Axes, result: Result, history: Sequence[Iteration], names: Sequence[int]
) -> None:
    x = [n for n, step in enumerate(history) if step.note != "rejected"]
    for k, i in enumerate(names):
        final = result.parameters.values[i] or 1.0
        axes.plot(x, [history[n].values[i] / final for n in x], "-", marker=marker(k), ms=3.5,
                  lw=1, color=colour(k), label=short(result.parameters.names[i]))  # fmt: skip
    axes.axhline(1, color=FAINT, lw=0.6, zorder=0)
    axes.set_ylabel("value / final value")
    axes.legend(loc="upper left", bbox_to_anchor=(1.0, 1.0))


def correlation_figure(parameters: ParameterTable) -> Figure:
    """The correlation matrix with its numbers."""
    n = len(parameters.names)
    known = np.outer(parameters.determined, parameters.determined)
    matrix = np.where(known, parameters.correlation, np.nan)
    size = min(9.0, 2.0 + 0.55 * n)
    figure = Figure(figsize=(size + 1.2, size))
    axes = figure.subplots()
    shown = axes.imshow(matrix, vmin=-1, vmax=1, cmap=DIVERGING)
    names = [short(name, 14) for name in parameters.names]
    axes.set_xticks(range(n), names, rotation=55, ha="right", rotation_mode="anchor")
    axes.set_yticks(range(n), names)
    for i, j in np.ndindex(n, n):
        value = matrix[i, j]
        text = f"{value:.2f}" if np.isfinite(value) else "-"
        dark = np.isfinite(value) and abs(value) > 0.7
        axes.text(
            j, i, text, ha="center", va="center", fontsize=SMALL, color="white" if dark else "black"
        )
    axes.spines[:].set_visible(False)
    figure.colorbar(shown, ax=axes, shrink=0.8, label="correlation")
    return figure
