"""Readings over the stages, and along extensometers: measured, computed, predicted."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from matplotlib import colormaps
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch

from geoident.model.arrays import Bools, Floats
from geoident.model.result import NORMAL_95, GaugeTable, Result
from geoident.report.drawing.style import (
    COLOURS,
    COMPUTED,
    FAINT,
    MARKERS,
    MEASURED,
    SMALL,
    Picture,
    hide_unused,
    short,
    stage_ticks,
)

MM = 1e3
_PER_FIGURE = 12
_COLUMNS = 3


@dataclass(frozen=True)
class Gauge:
    """The channels of one instrument.

    Args:
        name: of the gauge.
        rows: its channels in the table of gauges.
        labels: names of its anchors; empty for a gauge of one channel.
    """

    name: str
    rows: tuple[int, ...]
    labels: tuple[str, ...]


def gauges_of(table: GaugeTable) -> tuple[Gauge, ...]:
    """The channels by gauge: those of an extensometer are named ``gauge.anchor``."""
    rows: dict[str, list[int]] = {}
    for row, channel in enumerate(table.channels):
        rows.setdefault(channel.partition(".")[0], []).append(row)
    return tuple(
        Gauge(name, tuple(members), tuple(table.channels[r].partition(".")[2] for r in members))
        for name, members in rows.items()
    )


def reading_pictures(result: Result) -> tuple[Picture, ...]:
    """Every gauge over the stages, so many to a figure."""
    gauges = gauges_of(result.gauges)
    parts = [gauges[k : k + _PER_FIGURE] for k in range(0, len(gauges), _PER_FIGURE)]
    return tuple(
        Picture(
            f"readings-{number}",
            f"Gauges over the stages ({part[0].name} to {part[-1].name})",
            "Dots are measured, with 1.96 times their accuracy as error bars; hollow dots were not "
            "used. Solid lines are computed, dashed lines in their 95 % bands predicted. "
            "Positive: the points move apart, or as the gauge's direction says.",
            lambda part=part: readings_figure(result, part),  # type: ignore[misc]
        )
        for number, part in enumerate(parts, start=1)
    )


def readings_figure(result: Result, gauges: Sequence[Gauge]) -> Figure:
    """A panel for each gauge."""
    columns = min(_COLUMNS, len(gauges))
    rows = -(-len(gauges) // columns)
    figure = Figure(figsize=(3.4 * columns if columns > 1 else 5.0, 2.05 * rows + 0.7))
    panels = figure.subplots(rows, columns, squeeze=False, sharex=True)
    for axes, gauge in zip(panels.ravel(), gauges, strict=False):
        draw_gauge(axes, result, gauge)
    _show_bottom_labels(panels, len(gauges))
    figure.legend(handles=_legend(), loc="outside upper center", ncols=4)
    return figure


def _show_bottom_labels(panels: Any, used: int) -> None:
    """Stage names under the lowest panel of every column, also over an empty place."""
    rows, columns = panels.shape
    for k in range(used, rows * columns):
        panels[rows - 2, k % columns].tick_params(labelbottom=True)
    hide_unused(list(panels.ravel()), used)


def _legend() -> list[Any]:
    return [
        Line2D([], [], color=FAINT, marker="o", ls="", ms=4, label="measured"),
        Line2D([], [], color=FAINT, marker="o", ls="", ms=4, mfc="white", label="not used"),
        Line2D([], [], color=FAINT, label="computed"),
        (Patch(color=FAINT, alpha=0.3, lw=0, label="predicted, with 95 % band")),
    ]


def draw_gauge(axes: Axes, result: Result, gauge: Gauge) -> None:
    """The channels of one gauge over the stages.

    Args:
        axes: where to draw.
        result: of a fit.
        gauge: one of its gauges.
    """
    single = len(gauge.rows) == 1
    for k, row in enumerate(gauge.rows):
        colour = COMPUTED if single else COLOURS[k % len(COLOURS)]
        draw_computed(axes, result, row, colour)
        dots = MEASURED if single else colour
        draw_measured(axes, result.gauges, row, dots, MARKERS[k % len(MARKERS)])
    _mark_unknown(axes, result, gauge)
    axes.axhline(0, color=FAINT, lw=0.5, zorder=0)
    stage_ticks(axes, result.gauges.stages)
    axes.grid(axis="y")
    axes.set_ylabel("reading (mm)")
    axes.set_title(short(gauge.name, 16))
    if any(gauge.labels):
        _anchor_legend(axes, gauge)


def _anchor_legend(axes: Axes, gauge: Gauge) -> None:
    """The anchors on the line of the title, at its right end."""
    handles = [
        Line2D(
            [],
            [],
            color=COLOURS[k % len(COLOURS)],
            marker=MARKERS[k % len(MARKERS)],
            ms=3,
            lw=1,
            label=short(label, 6),
        )
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


def draw_computed(axes: Axes, result: Result, row: int, colour: str, *, band: bool = True) -> None:
    """The computed line of a channel; dashed and in its band where it is predicted.

    Args:
        axes: where to draw.
        result: of a fit.
        row: of the channel in its table.
        colour: of the line.
        band: whether the band is drawn.
    """
    x = np.arange(len(result.gauges.stages))
    computed = np.where(unknown(result)[row], np.nan, MM * result.gauges.computed[row])
    last = last_fitted(result.gauges)
    fitted, later = x <= last, x >= max(last, 0)
    axes.plot(x[fitted], computed[fitted], "-", color=colour, lw=1.2)
    axes.plot(x[later], computed[later], "--", color=colour, lw=1.2)
    if result.prediction is None or not band:
        return
    low, high = MM * result.prediction.lower95[row], MM * result.prediction.upper95[row]
    known = np.isfinite(low) & np.isfinite(high)
    axes.fill_between(
        x,
        np.where(known, low, np.nan),
        np.where(known, high, np.nan),
        color=colour,
        alpha=0.22,
        lw=0,
    )
    alone = known & ~np.roll(known, 1) & ~np.roll(known, -1)
    axes.vlines(x[alone], low[alone], high[alone], color=colour, alpha=0.22, lw=5)


def draw_measured(axes: Axes, table: GaugeTable, row: int, colour: str, marker: str) -> None:
    """The measured dots of a channel; hollow where they were not used.

    Args:
        axes: where to draw.
        table: of the readings.
        row: of the channel.
        colour: of the dots.
        marker: their shape.
    """
    x = np.arange(len(table.stages))
    error = np.nan_to_num(NORMAL_95 * MM * table.sd[row])
    for used, face in ((True, colour), (False, "white")):
        here = np.isfinite(table.measured[row]) & (table.used[row] == used)
        if here.any():
            axes.errorbar(
                x[here],
                MM * table.measured[row, here],
                yerr=error[here],
                fmt=marker,
                ms=3.2,
                lw=0.7,
                color=colour,
                mfc=face,
                mew=0.7,
            )


def _mark_unknown(axes: Axes, result: Result, gauge: Gauge) -> None:
    """Say in words where a prediction is not determined."""
    stages = np.flatnonzero(unknown(result)[list(gauge.rows)].any(axis=0))
    if stages.size:
        axes.text(
            0.98,
            0.04,
            "prediction not determined",
            transform=axes.transAxes,
            ha="right",
            fontsize=SMALL,
            color=FAINT,
        )


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


def profile_gauges(table: GaugeTable) -> tuple[Gauge, ...]:
    """Extensometers of two anchors or more: channels with one head."""
    return tuple(
        gauge
        for gauge in gauges_of(table)
        if len(gauge.rows) > 1
        and np.isfinite(depths(table, gauge)).all()
        and np.ptp(table.first[list(gauge.rows)], axis=0).max() < 1e-9
    )


def depths(table: GaugeTable, gauge: Gauge) -> Floats:
    """Distances (k,) of the k anchors from the head, m."""
    rows = list(gauge.rows)
    return np.asarray(np.linalg.norm(table.second[rows] - table.first[rows], axis=1))


def profile_pictures(result: Result) -> tuple[Picture, ...]:
    """Every extensometer along its length."""
    gauges = profile_gauges(result.gauges)
    parts = [gauges[k : k + _PER_FIGURE] for k in range(0, len(gauges), _PER_FIGURE)]
    return tuple(
        Picture(
            f"profiles-{number}",
            f"Extensometers along their length ({part[0].name} to {part[-1].name})",
            "Extension between head and anchor over the depth of the anchor, one line a stage; "
            "dots are measured, solid lines computed, dashed lines predicted.",
            lambda part=part: profiles_figure(result, part),  # type: ignore[misc]
        )
        for number, part in enumerate(parts, start=1)
    )


def profiles_figure(result: Result, gauges: Sequence[Gauge]) -> Figure:
    """A panel for each extensometer."""
    columns = min(_COLUMNS, len(gauges))
    rows = -(-len(gauges) // columns)
    stages = _read_stages(result.gauges, gauges)
    figure = Figure(figsize=(3.4 * columns if columns > 1 else 5.0, 2.3 * rows + 0.8))
    panels = list(figure.subplots(rows, columns, squeeze=False).ravel())
    for axes, gauge in zip(panels, gauges, strict=False):
        _draw_profile(axes, result, gauge, stages)
    hide_unused(panels, len(gauges))
    last = last_fitted(result.gauges)
    handles = [
        Line2D(
            [],
            [],
            color=_stage_colour(k, len(stages)),
            marker=MARKERS[k % len(MARKERS)],
            ms=4,
            ls="-" if stage <= last else "--",
            label=short(result.gauges.stages[stage], 14),
        )
        for k, stage in enumerate(stages)
    ]
    figure.legend(handles=handles, loc="outside upper center", ncols=7)
    return figure


def _read_stages(table: GaugeTable, gauges: Sequence[Gauge]) -> list[int]:
    """Stages in which any of the gauges has moved."""
    rows = [row for gauge in gauges for row in gauge.rows]
    moved = np.nan_to_num(table.computed[rows]) != 0
    moved |= np.isfinite(table.measured[rows])
    return [int(stage) for stage in np.flatnonzero(moved.any(axis=0))]


def _stage_colour(k: int, n: int) -> Any:
    return colormaps["viridis"](0.9 * (1 - k / max(n - 1, 1)))


def _draw_profile(axes: Axes, result: Result, gauge: Gauge, stages: Sequence[int]) -> None:
    table, rows = result.gauges, list(gauge.rows)
    order = np.argsort(depths(table, gauge), kind="stable")
    depth = np.concatenate([[0.0], depths(table, gauge)[order]])
    last, hidden = last_fitted(table), unknown(result)
    for k, stage in enumerate(stages):
        colour = _stage_colour(k, len(stages))
        computed = np.where(hidden[rows, stage], np.nan, MM * table.computed[rows, stage])[order]
        if np.nan_to_num(computed).any():
            style = "-" if stage <= last else "--"
            axes.plot(depth, np.concatenate([[0.0], computed]), style, color=colour, lw=1.1)
        axes.errorbar(
            depth[1:],
            MM * table.measured[rows, stage][order],
            yerr=np.nan_to_num(NORMAL_95 * MM * table.sd[rows, stage][order]),
            fmt=MARKERS[k % len(MARKERS)],
            ms=3.2,
            lw=0.7,
            color=colour,
        )
    axes.axhline(0, color=FAINT, lw=0.5, zorder=0)
    axes.set_title(short(gauge.name, 16))
    axes.set_xlabel("depth from head (m)")
    axes.set_ylabel("extension (mm)")
    axes.set_xlim(left=0)
    axes.grid()
