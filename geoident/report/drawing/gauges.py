"""Readings over the stages, and along extensometers: measured, computed, predicted.

Of one result, or of several in one figure.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import Any

import numpy as np
from matplotlib import colormaps
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Patch

from geoident.model.arrays import Bools, Floats
from geoident.model.results.result import NORMAL_95, GaugeTable, Labelled, Result
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
from geoident.report.text.case import ACROSS, ALONG, gauge_entry, gauge_quantity

_MOST_CHANNELS = 8
"""Channels of one gauge that a panel over the stages shows."""

_PER_FIGURE = 12
_COMPARED_PER_FIGURE = 15
_STYLES = ("-", "--", "-.", ":")


@dataclass(frozen=True)
class Instrument:
    """Channels of one gauge that are shown together.

    Args:
        name: of the gauge; for an inclinometer with its axis.
        gauge: name of the gauge.
        rows: its channels in the table of gauges.
        labels: names of its anchors, points or depths; empty for a gauge of one channel.
        places: (k,) where the channels are along the instrument, m; empty where it has no length.
        along: what the places are, for an axis; empty for none.
    """

    name: str
    gauge: str
    rows: tuple[int, ...]
    labels: tuple[str, ...]
    places: tuple[float, ...] = ()
    along: str = ""


def instruments(result: Result) -> tuple[Instrument, ...]:
    """The channels by gauge, dimension and, of an inclinometer, axis."""
    table = result.gauges
    rows: dict[tuple[str, str, str], list[int]] = {}
    for row, (gauge, dimension) in enumerate(zip(table.gauges, table.dimensions, strict=True)):
        deep = gauge_entry(result, gauge).get("kind") == "inclinometer"
        axis = table.channels[row][len(gauge) + 1 :][:1] if deep else ""
        rows.setdefault((gauge, dimension, axis), []).append(row)
    return tuple(_instrument(result, *key, own) for key, own in rows.items())


def _instrument(
    result: Result, gauge: str, dimension: str, axis: str, rows: list[int]
) -> Instrument:
    table, kind = result.gauges, gauge_entry(result, gauge).get("kind")
    labels = tuple(table.channels[r][len(gauge) + 1 + len(axis) :] for r in rows)
    name = f"{gauge}.{axis}" if axis else gauge
    places, along = np.empty(0), ""
    if axis:
        places, along = np.array([float(label) for label in labels]), "depth along the casing (m)"
    elif len(rows) > 1 and dimension == "length" and kind in {None, "extensometer"}:
        apart = np.linalg.norm(table.second[rows] - table.first[rows], axis=1)
        places, along = apart, "depth from head (m)"
    elif len(rows) > 1 and (kind, dimension) in {("levelling", "length"), ("strain", "strain")}:
        steps = np.linalg.norm(np.diff(table.second[rows], axis=0), axis=1)
        places, along = np.r_[0.0, np.cumsum(steps)], "distance along the line (m)"
    if not np.isfinite(places).all() or (len(places) and np.ptp(places) == 0.0):
        places, along = np.empty(0), ""
    return Instrument(name, gauge, tuple(rows), labels, tuple(map(float, places)), along)


def reading_pictures(result: Result) -> tuple[Picture, ...]:
    """Every gauge over the stages, so many to a figure."""
    caption = (
        "Dots: measured, with error bars of 1.96 times their accuracy; hollow: not used. Solid "
        "lines: computed; dashed lines with 95 % bands: predicted. Positive: the points move "
        "apart, or the motion follows the direction of the gauge; of stresses and forces what "
        "the axis says. Of instruments with many channels, some."
    )
    return paged(
        _few_channels(result),
        partial(readings_figure, result),
        most=_PER_FIGURE,
        picture=("readings", "Gauges over the stages", caption),
        label=_name,
    )


def _few_channels(result: Result) -> tuple[Instrument, ...]:
    """The instruments; of one of many channels, evenly spaced ones."""
    found = []
    for gauge in instruments(result):
        some = np.unique(np.linspace(0, len(gauge.rows) - 1, _MOST_CHANNELS).round().astype(int))
        found.append(
            gauge
            if len(gauge.rows) <= _MOST_CHANNELS
            else replace(
                gauge,
                rows=tuple(gauge.rows[k] for k in some),
                labels=tuple(gauge.labels[k] for k in some),
            )
        )
    return tuple(found)


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
    axes.set_ylabel(_quantity(result, gauge), fontsize=SMALL)
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


def _draw_dots(
    axes: Axes, x: Any, table: GaugeTable, place: Any, *, down: bool = False, **style: Any
) -> None:
    """Readings at an index of the table over x, with the half width of their 95 % interval.

    Args:
        axes: where to draw.
        x: (k,) where the readings are.
        table: of the readings.
        place: index of k of them.
        down: x goes down the panel.
        style: of dots and bars.
    """
    error = np.nan_to_num(NORMAL_95 * table.in_units(table.sd)[place])
    read = table.in_units(table.measured)[place]
    if down:
        axes.errorbar(read, x, xerr=error, ms=3.2, lw=0.7, **style)
    else:
        axes.errorbar(x, read, yerr=error, ms=3.2, lw=0.7, **style)


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
    """Every instrument with several channels along its length."""
    caption = (
        "Readings along extensometers, casings, levelling lines and fibres, one line per stage. "
        "Dots: measured; solid lines: computed; dashed lines: predicted."
    )
    return paged(
        tuple(gauge for gauge in instruments(result) if gauge.places),
        partial(profiles_figure, result),
        most=_PER_FIGURE,
        picture=("profiles", "Instruments along their length", caption),
        label=_name,
    )


def profiles_figure(result: Result, gauges: Sequence[Instrument]) -> Figure:
    """A panel for each instrument."""
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
    """Readings along an instrument; down a casing, as inclinometers are shown."""
    order = np.argsort(gauge.places, kind="stable")
    places, rows = np.array(gauge.places)[order], np.array(gauge.rows)[order]
    last, every = last_fitted(result.gauges), _computed(result)
    kind = gauge_entry(result, gauge.gauge).get("kind")
    down = kind == "inclinometer"
    head = [0.0] if gauge.along.endswith("head (m)") else []
    for k, stage in enumerate(stages):
        paint, computed = _stage_colour(k, len(stages)), every[rows, stage]
        if np.nan_to_num(computed).any():
            line = np.r_[head, places], np.r_[head, computed]
            style = "-" if stage <= last else "--"
            axes.plot(*(line[::-1] if down else line), style, color=paint, lw=1.1)
        dots = {"fmt": marker(k), "color": paint}
        _draw_dots(axes, places, result.gauges, (rows, stage), down=down, **dots)
    axes.set_title(short(gauge.name, 16))
    labels = gauge.along, _quantity(result, gauge)
    (axes.axvline if down else axes.axhline)(0, color=FAINT, lw=0.5, zorder=0)
    if down:
        axes.invert_yaxis()
        labels = labels[::-1]
    axes.set_xlabel(labels[0])
    axes.set_ylabel(labels[1], fontsize=SMALL)
    axes.grid()


def _quantity(result: Result, gauge: Instrument) -> str:
    """What the channels of an instrument measure."""
    found = gauge_quantity(result, gauge.gauge, result.gauges.dimensions[gauge.rows[0]])
    return found.replace(ACROSS, ALONG) if gauge.name.endswith(".S") else found


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
