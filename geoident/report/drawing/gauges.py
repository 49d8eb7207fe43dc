"""Readings over the stages, and along extensometers: measured, computed, predicted.

Of one result, or of several in one figure.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np
from matplotlib import colormaps
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Patch

from geoident.model.arrays import Bools, Floats
from geoident.model.result import NORMAL_95, GaugeTable, Labelled, Result
from geoident.report.drawing.style import (
    COMPUTED,
    FAINT,
    MEASURED,
    SMALL,
    Picture,
    colour,
    key,
    marker,
    paged,
    panel_grid,
    short,
    stage_ticks,
)
from geoident.report.text.case import gauge_quantity

_PER_FIGURE = 12
_COMPARED_PER_FIGURE = 15
_STYLES = ("-", "--", "-.", ":")


@dataclass(frozen=True)
class Instrument:
    """The channels of one gauge.

    Args:
        name: of the gauge.
        rows: its channels in the table of gauges.
        labels: names of its anchors; empty for a gauge of one channel.
    """

    name: str
    rows: tuple[int, ...]
    labels: tuple[str, ...]


def instruments(table: GaugeTable) -> tuple[Instrument, ...]:
    """The channels by gauge: those of an extensometer are named ``gauge.anchor``."""
    rows: dict[str, list[int]] = {}
    for row, gauge in enumerate(table.gauges):
        rows.setdefault(gauge, []).append(row)
    return tuple(
        Instrument(name, tuple(own), tuple(table.channels[r][len(name) + 1 :] for r in own))
        for name, own in rows.items()
    )


def reading_pictures(result: Result) -> tuple[Picture, ...]:
    """Every gauge over the stages, so many to a figure."""
    caption = (
        "Dots: measured, with error bars of 1.96 times their accuracy; hollow: not used. Solid "
        "lines: computed; dashed lines with 95 % bands: predicted. Positive: the points move "
        "apart, or the motion follows the direction of the gauge; of stresses and forces what "
        "the axis says."
    )
    return paged(
        instruments(result.gauges),
        partial(readings_figure, result),
        most=_PER_FIGURE,
        picture=("readings", "Gauges over the stages", caption),
        label=_name,
    )


def _name(gauge: Instrument) -> str:
    return gauge.name


def readings_figure(result: Result, gauges: Sequence[Instrument]) -> Figure:
    """A panel for each gauge."""
    figure, panels = panel_grid(len(gauges), height=2.05, extra=0.7, sharex=True)
    for axes, gauge in zip(panels, gauges, strict=True):
        _draw_gauge(axes, result, gauge)
    handles = [
        key("measured", color=FAINT, marker="o", ls="", ms=4),
        key("not used", color=FAINT, marker="o", ls="", ms=4, mfc="white"),
        key("computed", color=FAINT),
        Patch(color=FAINT, alpha=0.3, lw=0, label="predicted, with 95 % band"),
    ]
    figure.legend(handles=handles, loc="outside upper center", ncols=4)
    return figure


def _draw_gauge(axes: Axes, result: Result, gauge: Instrument) -> None:
    """The channels of one gauge over the stages."""
    single = len(gauge.rows) == 1
    for k, row in enumerate(gauge.rows):
        draw_computed(axes, result, row, COMPUTED if single else colour(k))
        draw_measured(axes, result.gauges, row, MEASURED if single else colour(k), marker(k))
    if unknown(result)[list(gauge.rows)].any():
        axes.text(0.98, 0.04, "prediction not determined", transform=axes.transAxes, ha="right",
                  fontsize=SMALL, color=FAINT)  # fmt: skip
    axes.axhline(0, color=FAINT, lw=0.5, zorder=0)
    stage_ticks(axes, result.gauges.stages)
    axes.grid(axis="y")
    axes.set_ylabel(gauge_quantity(result, gauge.name), fontsize=SMALL)
    axes.set_title(short(gauge.name, 16))
    if any(gauge.labels):
        _anchor_legend(axes, gauge)


def _anchor_legend(axes: Axes, gauge: Instrument) -> None:
    """The anchors on the line of the title, at its right end."""
    handles = [
        key(short(label, 6), color=colour(k), marker=marker(k), ms=3, lw=1)
        for k, label in enumerate(gauge.labels)
    ]
    axes.legend(
        handles=handles,
        loc="lower right",
        bbox_to_anchor=(1.02, 0.97),
        ncols=min(4, len(handles)),
        columnspacing=0.8,
        handlelength=1.0,
        handletextpad=0.3,
        borderpad=0.1,
    )


def draw_computed(axes: Axes, result: Result, row: int, paint: str) -> None:
    """The computed line of a channel; dashed and in its band where it is predicted.

    Args:
        axes: where to draw.
        result: of a fit.
        row: of the channel in its table.
        paint: colour of line and band.
    """
    x = np.arange(len(result.gauges.stages))
    computed = _computed(result)[row]
    last = last_fitted(result.gauges)
    fitted, later = x <= last, x >= max(last, 0)
    axes.plot(x[fitted], computed[fitted], "-", color=paint, lw=1.2)
    axes.plot(x[later], computed[later], "--", color=paint, lw=1.2)
    if result.prediction is None:
        return
    ends95 = (result.prediction.lower95, result.prediction.upper95)
    low, high = (result.gauges.in_units(end)[row] for end in ends95)
    known = np.isfinite(low) & np.isfinite(high)
    ends = np.where(known, low, np.nan), np.where(known, high, np.nan)
    axes.fill_between(x, *ends, color=paint, alpha=0.22, lw=0)
    alone = known & ~np.roll(known, 1) & ~np.roll(known, -1)
    axes.vlines(x[alone], low[alone], high[alone], color=paint, alpha=0.22, lw=5)


def _computed(result: Result) -> Floats:
    """(n_channels, n_stages) computed, in units; NaN where a prediction is not determined."""
    gauges = result.gauges
    return np.where(unknown(result), np.nan, gauges.in_units(gauges.computed))


def draw_measured(axes: Axes, table: GaugeTable, row: int, paint: str, dots: str) -> None:
    """The measured dots of a channel; hollow where they were not used.

    Args:
        axes: where to draw.
        table: of the readings.
        row: of the channel.
        paint: colour of the dots.
        dots: their shape.
    """
    x = np.arange(len(table.stages))
    for used, face in ((True, paint), (False, "white")):
        here = np.isfinite(table.measured[row]) & (table.used[row] == used)
        if here.any():
            _draw_dots(axes, x[here], table, (row, here), fmt=dots, color=paint, mfc=face, mew=0.7)


def _draw_dots(axes: Axes, x: Any, table: GaugeTable, place: Any, **style: Any) -> None:
    """Readings at an index of the table over x, with the half width of their 95 % interval."""
    error = np.nan_to_num(NORMAL_95 * table.in_units(table.sd)[place])
    axes.errorbar(x, table.in_units(table.measured)[place], yerr=error, ms=3.2, lw=0.7, **style)


def unknown(result: Result) -> Bools:
    """(n_channels, n_stages) predicted without being determined."""
    prediction = result.prediction
    if prediction is None:
        return np.zeros(result.gauges.computed.shape, dtype=bool)
    return np.asarray(np.isfinite(prediction.mean) & ~np.isfinite(prediction.sd))


def last_fitted(table: GaugeTable) -> int:
    """The last stage whose readings were used, -1 if none."""
    used = np.flatnonzero(table.used.any(axis=0))
    return int(used.max()) if used.size else -1


def profile_pictures(result: Result) -> tuple[Picture, ...]:
    """Every extensometer along its length."""
    caption = (
        "Extension between head and anchor over the depth of the anchor, one line per stage. "
        "Dots: measured; solid lines: computed; dashed lines: predicted."
    )
    return paged(
        _extensometers(result.gauges),
        partial(profiles_figure, result),
        most=_PER_FIGURE,
        picture=("profiles", "Extensometers along their length", caption),
        label=_name,
    )


def _extensometers(table: GaugeTable) -> tuple[Instrument, ...]:
    """Extensometers of two anchors or more: channels with one head."""
    return tuple(
        gauge
        for gauge in instruments(table)
        if len(gauge.rows) > 1
        and np.isfinite(_depths(table, gauge)).all()
        and np.ptp(table.first[list(gauge.rows)], axis=0).max() < 1e-9
    )


def _depths(table: GaugeTable, gauge: Instrument) -> Floats:
    """Distances (k,) of the k anchors from the head, m."""
    rows = list(gauge.rows)
    return np.asarray(np.linalg.norm(table.second[rows] - table.first[rows], axis=1))


def profiles_figure(result: Result, gauges: Sequence[Instrument]) -> Figure:
    """A panel for each extensometer."""
    stages = _read_stages(result.gauges, gauges)
    figure, panels = panel_grid(len(gauges), height=2.3, extra=0.8)
    for axes, gauge in zip(panels, gauges, strict=True):
        _draw_profile(axes, result, gauge, stages)
    last = last_fitted(result.gauges)
    handles = [
        key(
            short(result.gauges.stages[stage], 14),
            color=_stage_colour(k, len(stages)),
            marker=marker(k),
            ms=4,
            ls="-" if stage <= last else "--",
        )
        for k, stage in enumerate(stages)
    ]
    figure.legend(handles=handles, loc="outside upper center", ncols=7)
    return figure


def _read_stages(table: GaugeTable, gauges: Sequence[Instrument]) -> list[int]:
    """Stages in which any of the gauges has moved."""
    rows = [row for gauge in gauges for row in gauge.rows]
    moved = np.nan_to_num(table.computed[rows]) != 0
    moved |= np.isfinite(table.measured[rows])
    return [int(stage) for stage in np.flatnonzero(moved.any(axis=0))]


def _stage_colour(k: int, n: int) -> Any:
    return colormaps["viridis"](0.9 * (1 - k / max(n - 1, 1)))


def _draw_profile(axes: Axes, result: Result, gauge: Instrument, stages: Sequence[int]) -> None:
    depth = _depths(result.gauges, gauge)
    order = np.argsort(depth, kind="stable")
    depth, rows = depth[order], np.array(gauge.rows)[order]
    last, every = last_fitted(result.gauges), _computed(result)
    for k, stage in enumerate(stages):
        paint, computed = _stage_colour(k, len(stages)), every[rows, stage]
        if np.nan_to_num(computed).any():
            style = "-" if stage <= last else "--"
            axes.plot(np.r_[0.0, depth], np.r_[0.0, computed], style, color=paint, lw=1.1)
        _draw_dots(axes, depth, result.gauges, (rows, stage), fmt=marker(k), color=paint)
    axes.axhline(0, color=FAINT, lw=0.5, zorder=0)
    axes.set_title(short(gauge.name, 16))
    axes.set_xlabel("depth from head (m)")
    axes.set_ylabel(f"extension ({result.gauges.shown_units[gauge.rows[0]]})")
    axes.set_xlim(left=0)
    axes.grid()


def compared_gauge_pictures(results: Labelled) -> tuple[Picture, ...]:
    """The gauges of several results (with their labels), one over the other."""
    caption = "Lines: computed and predicted by every result. Dots: readings of the first result."
    return paged(
        list(dict.fromkeys(c for _, result in results for c in result.gauges.channels)),
        partial(compared_figure, results),
        most=_COMPARED_PER_FIGURE,
        picture=("compared-gauges", "Gauges side by side", caption),
        label=str,
    )


def compared_figure(results: Labelled, channels: Sequence[str]) -> Figure:
    """A panel for each channel."""
    figure, panels = panel_grid(len(channels), height=2.2, extra=0.8)
    for axes, channel in zip(panels, channels, strict=True):
        _draw_compared(axes, [result for _, result in results], channel)
    handles = [
        key(short(label, 30), color=colour(k), ls=_STYLES[k % len(_STYLES)])
        for k, (label, _) in enumerate(results)
    ]
    handles.append(key("measured", color=FAINT, marker="o", ls="", ms=4))
    figure.legend(handles=handles, loc="outside upper center", ncols=4)
    return figure


def _draw_compared(axes: Axes, results: Sequence[Result], channel: str) -> None:
    stages = tuple(dict.fromkeys(stage for result in results for stage in result.gauges.stages))
    read = False
    for k, result in enumerate(results):
        table = result.gauges
        if channel not in table.channels:
            continue
        row = table.channels.index(channel)
        x = [stages.index(stage) for stage in table.stages]
        axes.plot(x, _computed(result)[row], _STYLES[k % len(_STYLES)], color=colour(k), lw=1.2)
        if not read and table.stages == stages:
            draw_measured(axes, table, row, FAINT, "o")
            read = True
    stage_ticks(axes, stages)
    axes.set_title(short(channel, 24))
    owner = next(result for result in results if channel in result.gauges.channels)
    gauge = owner.gauges.gauges[owner.gauges.channels.index(channel)]
    axes.set_ylabel(gauge_quantity(owner, gauge), fontsize=SMALL)
    axes.grid(axis="y")
