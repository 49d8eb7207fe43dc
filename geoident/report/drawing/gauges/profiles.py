"""Readings along instruments, a line for each stage, as each kind is shown in monitoring reports.

Settlement troughs have settlement down, casings and plumb lines their depth or height upright,
extensometers the depth from their head.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import partial
from typing import Any

import numpy as np
from matplotlib import colormaps
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Patch

from geoident.model.arrays import Floats
from geoident.model.results.result import Result
from geoident.report.drawing.gauges.axis import (
    bands_of,
    computed_of,
    draw_dots,
    last_fitted,
    value_limits,
)
from geoident.report.drawing.style import (
    FAINT,
    SMALL,
    Picture,
    evenly,
    key,
    marker,
    paged,
    panel_grid,
    short,
)
from geoident.report.text.instruments import (
    CASING,
    EXTENSOMETER,
    FIBRE,
    PLUMB,
    TROUGH,
    Instrument,
    lines,
)

_MOST_STAGES = 7
_HOW = (
    "Dots: measured, with bars of 1.96 times their standard deviation; solid lines: computed; "
    "dashed, in their 95 % bands: predicted. One colour and marker a stage."
)
_KINDS: Mapping[str, tuple[str, str, str, int]] = {
    TROUGH: ("troughs", "Settlement troughs", "Settlement is drawn downwards.", 9),
    CASING: ("inclinometers", "Inclinometers", "Motion against the depth.", 9),
    PLUMB: (
        "pendulums",
        "Plumb lines",
        "Against the height; the point to which the readings refer does not move.",
        9,
    ),
    EXTENSOMETER: (
        "extensometers",
        "Extensometers",
        "Motion of the anchors away from the head, over their depth.",
        12,
    ),
    FIBRE: ("fibres", "Strain along fibres", "Elongation is positive.", 12),
}
"""Kind of a line to the name and title of its pictures, what is to be known, panels in one."""

_LEGEND_WIDTH = 1.45
"""Of an entry of the legend, inches."""

_BAND = 0.15
"""Opacity of bands, of which several lie on each other."""

_UPRIGHT = {CASING, PLUMB}


def profile_pictures(result: Result) -> tuple[Picture, ...]:
    """Every instrument with a length along it, the kinds apart."""
    every = lines(result)
    pictures: list[Picture] = []
    for line, (name, title, caption, most) in _KINDS.items():
        own = tuple(one for one in every if one.line == line and _stages(result, [one]))
        pictures += paged(
            own,
            partial(profiles_figure, result, kind=own),
            most=most,
            picture=(name, title, f"{caption} {_HOW}"),
            label=lambda one: one.name,
        )
    return tuple(pictures)


def profiles_figure(
    result: Result, shown: Sequence[Instrument], *, kind: Sequence[Instrument] = ()
) -> Figure:
    """A panel for each instrument.

    Args:
        result: of a fit.
        shown: the instruments.
        kind: all of the kind, which share a scale; without, those that are shown.
    """
    stages = _stages(result, kind or shown)
    limits = value_limits(result, kind or shown, stages)
    upright = shown[0].line in _UPRIGHT
    figure, panels = panel_grid(len(shown), height=3.4 if upright else 2.3, extra=0.8)
    for axes, one in zip(panels, shown, strict=True):
        _draw_profile(axes, result, one, stages)
        (axes.set_xlim if upright else axes.set_ylim)(limits[one.quantity])
        if one.line == TROUGH:
            axes.invert_yaxis()
    columns = int(figure.get_figwidth() / _LEGEND_WIDTH)
    figure.legend(handles=_legend(result, shown, stages), loc="outside upper center", ncols=columns)
    return figure


def _stages(result: Result, shown: Sequence[Instrument]) -> list[int]:
    """Stages in which any of the instruments has moved; of many some, always the last."""
    table, rows = result.gauges, [row for one in shown for row in one.rows]
    moved = np.abs(np.nan_to_num(computed_of(result)[rows])) > 0.0
    moved |= np.abs(np.nan_to_num(table.measured[rows])) > 0.0
    every = np.flatnonzero(moved.any(axis=0))
    return [int(stage) for stage in every[evenly(len(every), _MOST_STAGES)]]


def _legend(result: Result, shown: Sequence[Instrument], stages: Sequence[int]) -> list[Any]:
    rows, last = [row for one in shown for row in one.rows], last_fitted(result)
    handles: list[Any] = [
        key(
            short(result.gauges.stages[stage], 14),
            color=_stage_colour(k, len(stages)),
            marker=marker(k) if np.isfinite(result.gauges.measured[rows, stage]).any() else "",
            ms=4,
            ls="-" if stage <= last else "--",
        )
        for k, stage in enumerate(stages)
    ]
    if np.isfinite(bands_of(result)[0][np.ix_(rows, stages)]).any():
        handles.append(Patch(color=FAINT, alpha=0.3, lw=0, label="95 % band"))
    return handles


def _stage_colour(k: int, n: int) -> Any:
    return colormaps["viridis"](0.85 * (1 - k / max(n - 1, 1)))


def _draw_profile(axes: Axes, result: Result, one: Instrument, stages: Sequence[int]) -> None:
    """Readings along an instrument: upright down a casing or a plumb line."""
    gauges, upright, last = result.gauges, one.line in _UPRIGHT, last_fitted(result)
    order = np.argsort(one.places, kind="stable")
    places, rows = np.array(one.places)[order], np.array(one.rows)[order]
    drawn = computed_of(result), gauges.measured, gauges.sd
    computed, read, sd = (gauges.in_units(table)[rows] for table in drawn)
    low, high = (end[rows] for end in bands_of(result))
    foot = [] if one.fixed is None else [one.fixed]
    for k, stage in enumerate(stages):
        paint = _stage_colour(k, len(stages))
        if np.abs(np.nan_to_num(computed[:, stage])).any():  # it stands
            along, values = _with_foot(places, computed[:, stage], foot)
            style = "-" if stage <= last else "--"
            axes.plot(
                *((values, along) if upright else (along, values)), style, color=paint, lw=1.1
            )
        known = np.isfinite(low[:, stage])
        if known.any():
            fill = axes.fill_betweenx if upright else axes.fill_between
            fill(places[known], low[known, stage], high[known, stage], color=paint, alpha=_BAND,
                 lw=0)  # fmt: skip
        draw_dots(axes, places, read[:, stage], sd[:, stage], gauges.used[rows, stage],
                  upright=upright, color=paint, fmt=marker(k))  # fmt: skip
    axes.set_title(short(one.name, 26))
    (axes.axvline if upright else axes.axhline)(0, color=FAINT, lw=0.5, zorder=0)
    labels = (one.quantity, one.along) if upright else (one.along, one.quantity)
    if one.line == CASING:
        axes.invert_yaxis()
    axes.set_xlabel(labels[0], fontsize=SMALL)
    axes.set_ylabel(labels[1], fontsize=SMALL)
    axes.grid()


def _with_foot(places: Floats, values: Floats, foot: Sequence[float]) -> tuple[Floats, Floats]:
    """The line through a place that does not move, too."""
    known = np.isfinite(values)
    along, read = np.r_[foot, places[known]], np.r_[np.zeros(len(foot)), values[known]]
    order = np.argsort(along, kind="stable")
    return along[order], read[order]
