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

from geoident.model.arrays import Floats, Ints
from geoident.model.results.bands import NORMAL_95
from geoident.model.results.result import Result
from geoident.report.drawing.gauges.axis import computed_of, value_limits
from geoident.report.drawing.gauges.course import has_band, last_fitted
from geoident.report.drawing.gauges.instruments import (
    CASING,
    EXTENSOMETER,
    FIBRE,
    PLUMB,
    TROUGH,
    Instrument,
    lines,
)
from geoident.report.drawing.style import (
    FAINT,
    SMALL,
    Picture,
    key,
    marker,
    paged,
    panel_grid,
    short,
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
    found: list[Picture] = []
    for line, (name, title, caption, most) in _KINDS.items():
        own = tuple(one for one in every if one.line == line and _stages(result, [one]))
        found += paged(
            own,
            partial(profiles_figure, result, kind=own),
            most=most,
            picture=(name, title, f"{caption} {_HOW}"),
            label=_name,
        )
    return tuple(found)


def _name(one: Instrument) -> str:
    return one.name


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
    if len(every) > _MOST_STAGES:
        every = every[np.linspace(0, len(every) - 1, _MOST_STAGES).round().astype(int)]
    return [int(stage) for stage in every]


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
    if has_band(result)[np.ix_(rows, stages)].any():
        handles.append(Patch(color=FAINT, alpha=0.3, lw=0, label="95 % band"))
    return handles


def _stage_colour(k: int, n: int) -> Any:
    return colormaps["viridis"](0.85 * (1 - k / max(n - 1, 1)))


def _draw_profile(axes: Axes, result: Result, one: Instrument, stages: Sequence[int]) -> None:
    """Readings along an instrument: upright down a casing or a plumb line."""
    upright, last = one.line in _UPRIGHT, last_fitted(result)
    places, rows = _ordered(one)
    computed = result.gauges.in_units(computed_of(result))[rows]
    foot = [] if one.fixed is None else [one.fixed]
    for k, stage in enumerate(stages):
        paint = _stage_colour(k, len(stages))
        values = computed[:, stage]
        if np.abs(np.nan_to_num(values)).any():  # it stands
            along, read = _with_foot(places, values, foot)
            style = "-" if stage <= last else "--"
            axes.plot(*((read, along) if upright else (along, read)), style, color=paint, lw=1.1)
        _draw_band(axes, result, one, stage, paint)
        _draw_dots(axes, result, one, stage, paint, marker(k))
    axes.set_title(short(one.name, 26))
    (axes.axvline if upright else axes.axhline)(0, color=FAINT, lw=0.5, zorder=0)
    labels = (one.quantity, one.along) if upright else (one.along, one.quantity)
    if one.line == CASING:
        axes.invert_yaxis()
    axes.set_xlabel(labels[0], fontsize=SMALL)
    axes.set_ylabel(labels[1], fontsize=SMALL)
    axes.grid()


def _ordered(one: Instrument) -> tuple[Floats, Ints]:
    """Places (k,) along the line in their order, and the rows of their channels."""
    order = np.argsort(one.places, kind="stable")
    return np.array(one.places)[order], np.array(one.rows)[order]


def _with_foot(places: Floats, values: Floats, foot: Sequence[float]) -> tuple[Floats, Floats]:
    """The line through a place that does not move, too."""
    known = np.isfinite(values)
    along, read = np.r_[foot, places[known]], np.r_[np.zeros(len(foot)), values[known]]
    order = np.argsort(along, kind="stable")
    return along[order], read[order]


def _draw_band(axes: Axes, result: Result, one: Instrument, stage: int, paint: Any) -> None:
    """The band of a predicted stage."""
    if result.prediction is None:
        return
    places, rows = _ordered(one)
    ends95 = (result.prediction.lower95, result.prediction.upper95)
    low, high = (result.gauges.in_units(end)[rows, stage] for end in ends95)
    known = np.isfinite(low) & np.isfinite(high)
    if known.any():
        fill = axes.fill_betweenx if one.line in _UPRIGHT else axes.fill_between
        fill(places[known], low[known], high[known], color=paint, alpha=_BAND, lw=0)


def _draw_dots(
    axes: Axes, result: Result, one: Instrument, stage: int, paint: Any, dots: str
) -> None:
    """Readings of a stage with the half width of their 95 % interval; hollow where not used."""
    places, rows = _ordered(one)
    table = result.gauges
    read, sd = (table.in_units(column)[rows, stage] for column in (table.measured, table.sd))
    error, used = NORMAL_95 * np.nan_to_num(sd), table.used[rows, stage]
    for part, face in ((used, paint), (~used, "white")):
        here = np.isfinite(read) & part
        if not here.any():
            continue
        style = {"fmt": dots, "color": paint, "mfc": face, "ms": 3.2, "lw": 0.7, "mew": 0.7}
        if one.line in _UPRIGHT:
            axes.errorbar(read[here], places[here], xerr=error[here], **style)
        else:
            axes.errorbar(places[here], read[here], yerr=error[here], **style)
