"""Readings over time, or over the stages where there are no dates, and over the way of the face.

Measured: dots with bars; computed: lines; predicted: bands. Instruments that read the same quantity
share a scale. Of several results the same gauges stand one over the other.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Patch

from geoident.model.arrays import Bools, Floats
from geoident.model.results.result import Labelled, Result
from geoident.report.drawing.gauges.axis import (
    StageAxis,
    bands_of,
    computed_of,
    draw_dots,
    last_fitted,
    stage_axis,
    unknown,
    value_limits,
)
from geoident.report.drawing.style import (
    ACCENT,
    COMPUTED,
    FAINT,
    MEASURED,
    SMALL,
    Picture,
    colour,
    evenly,
    key,
    marker,
    paged,
    panel_grid,
    short,
    stage_ticks,
)
from geoident.report.text.case import gauge_quantity
from geoident.report.text.curves import curves_of
from geoident.report.text.instruments import CASING, FIBRE, Instrument, instruments, lines
from geoident.units import in_unit

_MOST_CHANNELS = 8
"""Channels of one instrument that a panel over time shows."""

_PER_FIGURE = 15
_COMPARED_PER_FIGURE = 15
_HEIGHT, _LOW, _LOW_FROM = 2.05, 1.7, 12  # of panels, inches; lower ones where a page has more
_LEAST_ROUNDS = 3
_STYLES = ("-", "--", "-.", ":")
_BAND = 0.22
"""Opacity of bands."""

_ALARM: Mapping[str, Any] = {"color": ACCENT, "ls": (0, (5, 1.5)), "lw": 1.0}
"""Lines of alarm values, as far as these lie on the axis of the readings."""


def reading_pictures(result: Result) -> tuple[Picture, ...]:
    """Every gauge over time, so many to a figure; casings and fibres only along their length."""
    axis = stage_axis(result)
    shown = _over_time(result)
    over = "time" if axis.in_time else "the stages"
    words = (
        "Dotted lines: when stages were complete, by their numbers. " if axis.marks else ""
    ) + "Panels of the same quantity have the same scale."
    if any(len(one.rows) > _MOST_CHANNELS for one in shown):
        words += f" Of instruments with more than {_MOST_CHANNELS} channels, some."
    caption = (
        "Dots: measured, with bars of 1.96 times their standard deviation; hollow: not used. "
        "Lines: computed; dashed, in their 95 % bands: predicted. See the axis for the sign; "
        f"a change of length is positive where it gets longer. {words}"
    )
    return paged(
        shown,
        partial(readings_figure, result),
        most=_PER_FIGURE,
        picture=("readings", f"Gauges over {over}", caption),
        label=lambda one: one.name,
    )


def _over_time(result: Result) -> tuple[Instrument, ...]:
    """What is shown over time, the same quantities together; of many channels, some."""
    together = [one for one in lines(result) if one.line not in {CASING, FIBRE}]
    taken = {row for one in together for row in one.rows}
    taken |= {row for one in curves_of(result) for row in one.rows}
    alone = [
        one
        for one in instruments(result)
        if one.line not in {CASING, FIBRE} and not taken & set(one.rows)
    ]
    every = sorted([*together, *alone], key=lambda one: one.rows)
    order = list(dict.fromkeys(one.quantity for one in every))
    every.sort(key=lambda one: order.index(one.quantity))
    return tuple(_some_channels(one) for one in every)


def _some_channels(one: Instrument) -> Instrument:
    """An instrument; of one of many channels, evenly spaced ones."""
    some = evenly(len(one.rows), _MOST_CHANNELS)
    rows, labels = ([column[k] for k in some if column] for column in (one.rows, one.labels))
    return replace(one, rows=tuple(rows), labels=tuple(labels))


def readings_figure(
    result: Result, shown: Sequence[Instrument], *, ways: Mapping[int, Floats] | None = None
) -> Figure:
    """A panel for each instrument.

    Args:
        result: of a fit.
        shown: the instruments.
        ways: channel to how far (n_stages,) the face has passed its section, m, for the axis; None
            for dates or stages.
    """
    axis = stage_axis(result)
    limits = value_limits(result, shown if ways else [*_over_time(result), *shown])
    extra = 0.8 if ways else 0.7
    height = _HEIGHT if len(shown) <= _LOW_FROM else _LOW
    figure, panels = panel_grid(len(shown), height=height, extra=extra, sharex=not ways)
    for axes, one in zip(panels, shown, strict=True):
        own = StageAxis(axis.stages, ways[one.rows[0]], dated=False) if ways else axis
        _draw_instrument(axes, result, one, own)
        if ways:
            _finish_way(axes, np.concatenate([ways[each.rows[0]] for each in shown]))
        else:
            axis.finish(axes)
        low, high = limits[one.quantity]
        axes.set_ylim((high, low) if one.downwards else (low, high))
    handles = legend_handles(result, [row for one in shown for row in one.rows])
    if any(_alarm_values(result, one) for one in shown):
        handles.append(key("alarm value", **_ALARM))
    figure.legend(handles=handles, loc="outside upper center", ncols=4)
    return figure


def _finish_way(axes: Axes, every: Floats) -> None:
    """The axis of the way of the face, m, for the places (k,) of all panels."""
    margin = 0.04 * np.ptp(every)
    axes.set_xlim(every.min() - margin, every.max() + margin)
    axes.axvline(0.0, color=FAINT, lw=0.7, ls=":")
    axes.set_xlabel("face past the section (m)")


def legend_handles(result: Result, rows: Sequence[int]) -> list[object]:
    """What dots, lines and bands of some channels are, as far as there are any."""
    gauges, rows = result.gauges, list(rows)
    read, used = np.isfinite(gauges.measured[rows]), gauges.used[rows]
    dot = {"color": MEASURED, "marker": "o", "ls": "", "ms": 4}
    handles: list[object] = []
    if (read & used).any():
        handles.append(key("measured", **dot))
    if (read & ~used).any():
        handles.append(key("measured, not used", mfc="white", **dot))
    later = np.arange(len(gauges.stages)) > max(last_fitted(result), 0)
    predicted = np.isfinite(computed_of(result)[rows]) & later
    if (np.isfinite(gauges.computed[rows]) & ~predicted).any():
        handles.append(key("computed", color=COMPUTED))
    if predicted.any():
        handles.append(key("predicted", color=COMPUTED, ls="--"))
    if np.isfinite(bands_of(result)[0])[rows].any():
        handles.append(Patch(color=COMPUTED, alpha=_BAND, lw=0, label="95 % band"))
    return handles


def _draw_instrument(axes: Axes, result: Result, one: Instrument, axis: StageAxis) -> None:
    """The channels of one instrument over time."""
    for k, row in enumerate(one.rows):
        line, dots = (COMPUTED, MEASURED) if len(one.rows) == 1 else (colour(k), colour(k))
        draw_computed(axes, result, row, line, axis)
        draw_measured(axes, result, row, dots, marker(k), axis)
    for value in _alarm_values(result, one):
        axes.axhline(value, **_ALARM)
    if unknown(result)[list(one.rows)].any():
        axes.text(0.98, 0.04, "prediction not determined", transform=axes.transAxes, ha="right",
                  fontsize=SMALL, color=FAINT)  # fmt: skip
    axes.axhline(0, color=FAINT, lw=0.5, zorder=0)
    axes.grid(axis="y")
    axes.set_ylabel(one.quantity, fontsize=SMALL)
    axes.set_title(short(one.name, 16))
    if any(one.labels):  # the anchors on the line of the title, at its right end
        handles = [
            key(short(label, 6), color=colour(k), marker=marker(k), ms=3, lw=1)
            for k, label in enumerate(one.labels)
        ]
        axes.legend(handles=handles, loc="lower right", bbox_to_anchor=(1.02, 0.97),
                    ncols=min(4, len(handles)), columnspacing=0.8, handlelength=1.0,
                    handletextpad=0.3, borderpad=0.1)  # fmt: skip


def _alarm_values(result: Result, one: Instrument) -> set[float]:
    """The alarm values of an instrument in its unit."""
    names = {result.gauges.channels[row] for row in one.rows}
    own = [alarm for alarm in result.alarms if alarm.gauge in names]
    return {
        in_unit(value, alarm.unit, alarm.dimension)
        for alarm in own
        for value in ((alarm.value, -alarm.value) if alarm.either_sign else (alarm.value,))
    }


def draw_computed(
    axes: Axes, result: Result, row: int, paint: str, axis: StageAxis | None = None
) -> None:
    """The computed line of a channel; dashed and in its band where it is predicted.

    Args:
        axes: where to draw.
        result: of a fit.
        row: of the channel in its table.
        paint: colour of line and band.
        axis: where the stages lie; None for their numbers.
    """
    numbers = np.arange(len(result.gauges.stages))
    x = numbers if axis is None else axis.at
    computed = result.gauges.in_units(computed_of(result))[row]
    last = last_fitted(result)
    fitted, later = numbers <= last, numbers >= max(last, 0)
    axes.plot(x[fitted], computed[fitted], "-", color=paint, lw=1.2)
    axes.plot(x[later], computed[later], "--", color=paint, lw=1.2)
    low, high = (end[row] for end in bands_of(result))
    known = np.isfinite(low)
    if known.any():
        axes.fill_between(x, low, high, color=paint, alpha=_BAND, lw=0)
    before, after = np.r_[False, known[:-1]], np.r_[known[1:], False]
    alone = known & ~before & ~after
    axes.vlines(x[alone], low[alone], high[alone], color=paint, alpha=_BAND, lw=5)


def draw_measured(
    axes: Axes, result: Result, row: int, paint: str, dots: str, axis: StageAxis | None = None
) -> None:
    """The measured dots of a channel; hollow where they were not used.

    Args:
        axes: where to draw.
        result: with the readings.
        row: of the channel.
        paint: colour of the dots.
        dots: their shape.
        axis: where the stages lie, on which dated readings stand at their dates; None for numbers.
    """
    if axis is not None and axis.in_time:
        x, read, sd, used = _each_reading(result, row, axis)
    else:
        table = result.gauges
        x = np.arange(len(table.stages), dtype=np.float64) if axis is None else axis.at
        read, sd = (table.in_units(column)[row] for column in (table.measured, table.sd))
        used = table.used[row]
    draw_dots(axes, x, read, sd, used, color=paint, fmt=dots)


def _each_reading(
    result: Result, row: int, axis: StageAxis
) -> tuple[Floats, Floats, Floats, Bools]:
    """Place, value, deviation and use of every reading that counts of a channel, in units."""
    table, gauges = result.gauges.readings, result.gauges
    places = [(j, k) for (i, j), rows in gauges.rows.items() if i == row for k in rows.tolist()]
    places.sort(key=lambda pair: pair[1])
    rows = np.array([k for _, k in places], dtype=np.int64)
    x = np.array([axis.of_reading(j, float(table.time[k])) for j, k in places])
    unit = gauges.in_units(np.ones((len(gauges.channels), 1)))[row, 0]
    return x, unit * table.value[rows], unit * table.sd[rows], table.used[rows]


def face_pictures(result: Result) -> tuple[Picture, ...]:
    """Motions of sections over the distance of the face from them, where a tunnel is driven."""
    ways = _ways(result)
    shown = [one for one in _over_time(result) if one.rows[0] in ways and not one.line]
    caption = (
        "Each gauge over the way by which the face has passed its section; negative: the face has "
        "not come there yet. Dots: measured; lines: computed; dashed, in their 95 % bands: "
        "predicted."
    )
    return paged(
        shown,
        partial(readings_figure, result, ways=ways),
        most=_PER_FIGURE,
        picture=("face", "Motions over the distance to the face", caption),
        label=lambda one: one.name,
    )


def _ways(result: Result) -> dict[int, Floats]:
    """Channel to how far (n_stages,) the face has passed its section, m; empty for no tunnel."""
    faces = _faces(result)
    if faces is None:
        return {}
    axis, sense, at = faces
    points = sense * result.gauges.second[:, axis]
    return {row: at - point for row, point in enumerate(points) if np.isfinite(point)}


def _faces(result: Result) -> tuple[int, float, Floats] | None:
    """The axis along which a tunnel is driven, 1 or -1 for its sense, and the way of the face.

    The way (n_stages,) is the coordinate in that sense after each stage, m.

    A tunnel is driven where in space at least three stages take ground away that lies further along
    one and the same axis than what was taken before, and ends where it begins.
    """
    fields = result.fields
    if fields is None or fields.mesh.dim != 3 or len(fields.present) < 4:
        return None
    nodes = fields.mesh.points
    elements = [each for block in fields.mesh.blocks for each in block.nodes]
    gone = [
        np.unique(np.concatenate([elements[e] for e in np.flatnonzero(left)]))
        if left.any()
        else None
        for left in fields.present[:-1] & ~fields.present[1:]
    ]
    digs = [k for k, taken in enumerate(gone) if taken is not None]
    if len(digs) < _LEAST_ROUNDS:
        return None
    for axis in (1, 0, 2):
        for sense in (1.0, -1.0):
            low, high = (
                np.array([end(sense * nodes[gone[k], axis]) for k in digs])
                for end in (np.min, np.max)
            )
            if (np.diff(high) > 0.0).all() and (low[1:] >= high[:-1] - 1e-6).all():
                at = np.full(len(gone), low[0])
                for k, end in zip(digs, high, strict=True):
                    at[k:] = end
                return axis, sense, at
    return None


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
    handles.append(key("measured", color=MEASURED, marker="o", ls="", ms=4))
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
        values, style = table.in_units(computed_of(result))[row], _STYLES[k % len(_STYLES)]
        axes.plot(x, values, style, color=colour(k), lw=1.2)
        if not read and table.stages == stages:
            draw_measured(axes, result, row, MEASURED, "o")
            read = True
    stage_ticks(axes, stages)
    axes.set_title(short(channel, 24))
    owner = next(result for result in results if channel in result.gauges.channels)
    gauge = owner.gauges.gauges[owner.gauges.channels.index(channel)]
    axes.set_ylabel(gauge_quantity(owner, gauge), fontsize=SMALL)
    axes.grid(axis="y")
