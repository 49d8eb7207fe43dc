"""Readings over time, or over the stages where there are no dates, and over the way of the face.

Measured: dots with bars; computed: lines; predicted: bands. Instruments that read the same quantity
share a scale.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from functools import partial

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Patch

from geoident.model.arrays import Bools, Floats
from geoident.model.results.bands import NORMAL_95
from geoident.model.results.result import Result
from geoident.report.drawing.gauges.axis import (
    StageAxis,
    computed_of,
    stage_axis,
    value_limits,
)
from geoident.report.drawing.gauges.instruments import (
    CASING,
    FIBRE,
    Instrument,
    instruments,
    lines,
)
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
)

_MOST_CHANNELS = 8
"""Channels of one instrument that a panel over time shows."""

_PER_FIGURE = 12
BAND = 0.22
"""Opacity of bands."""


def reading_pictures(result: Result) -> tuple[Picture, ...]:
    """Every gauge over time, so many to a figure; casings and fibres only along their length."""
    axis = stage_axis(result)
    shown = _over_time(result)
    over = "time" if axis.dated else "the stages"
    words = (
        "Dotted lines: when stages were complete, by their numbers. " if axis.dated else ""
    ) + "Panels of the same quantity have the same scale."
    if any(len(one.rows) > _MOST_CHANNELS for one in shown):
        words += f" Of instruments with more than {_MOST_CHANNELS} channels, some."
    caption = (
        "Dots: measured, with bars of 1.96 times their standard deviation; hollow: not used. "
        "Lines: computed; dashed, in their 95 % bands: predicted. Positive is what the axis says, "
        f"and of changes of length: longer. {words}"
    )
    return paged(
        shown,
        partial(readings_figure, result),
        most=_PER_FIGURE,
        picture=("readings", f"Gauges over {over}", caption),
        label=_name,
    )


def _over_time(result: Result) -> tuple[Instrument, ...]:
    """What is shown over time, the same quantities together; of many channels, some."""
    together = [one for one in lines(result) if one.line not in {CASING, FIBRE}]
    taken = {row for one in together for row in one.rows}
    alone = [
        one
        for one in instruments(result)
        if one.line not in {CASING, FIBRE} and not taken & set(one.rows)
    ]
    every = sorted([*together, *alone], key=lambda one: one.rows)
    order = list(dict.fromkeys(one.quantity for one in every))
    every.sort(key=lambda one: order.index(one.quantity))
    return tuple(some_channels(one) for one in every)


def some_channels(one: Instrument) -> Instrument:
    """An instrument; of one of many channels, evenly spaced ones."""
    if len(one.rows) <= _MOST_CHANNELS:
        return one
    some = np.unique(np.linspace(0, len(one.rows) - 1, _MOST_CHANNELS).round().astype(int))
    return replace(
        one,
        rows=tuple(one.rows[k] for k in some),
        labels=tuple(one.labels[k] for k in some),
    )


def _name(one: Instrument) -> str:
    return one.name


def readings_figure(result: Result, shown: Sequence[Instrument]) -> Figure:
    """A panel for each instrument."""
    axis = stage_axis(result)
    limits = value_limits(result, [*_over_time(result), *shown])
    figure, panels = panel_grid(len(shown), height=2.05, extra=0.7, sharex=True)
    for axes, one in zip(panels, shown, strict=True):
        _draw_instrument(axes, result, one, axis)
        _set_values(axes, one, limits[one.quantity])
    figure.legend(handles=legend(result, shown), loc="outside upper center", ncols=4)
    return figure


def _set_values(axes: Axes, one: Instrument, limits: tuple[float, float]) -> None:
    """The axis of the values; settlements go down."""
    axes.set_ylim(limits[::-1] if one.downwards else limits)


def legend(result: Result, shown: Sequence[Instrument]) -> list[object]:
    """What dots, lines and bands are, as far as there are any."""
    gauges, rows = result.gauges, [row for one in shown for row in one.rows]
    read, used = np.isfinite(gauges.measured[rows]), gauges.used[rows]
    dot = {"color": MEASURED, "marker": "o", "ls": "", "ms": 4}
    found: list[object] = []
    if (read & used).any():
        found.append(key("measured", **dot))
    if (read & ~used).any():
        found.append(key("measured, not used", mfc="white", **dot))
    predicted = _predicted(result)[rows]
    if (np.isfinite(gauges.computed[rows]) & ~predicted).any():
        found.append(key("computed", color=COMPUTED))
    if predicted.any():
        found.append(key("predicted", color=COMPUTED, ls="--"))
    if has_band(result)[rows].any():
        found.append(Patch(color=COMPUTED, alpha=BAND, lw=0, label="95 % band"))
    return found


def _predicted(result: Result) -> Bools:
    """(n_channels, n_stages) where the line is dashed: computed, behind the last fitted stage."""
    stages = np.arange(len(result.gauges.stages))
    later = stages > max(last_fitted(result), 0)
    return np.asarray(np.isfinite(computed_of(result)) & later)


def has_band(result: Result) -> Bools:
    """(n_channels, n_stages) where there is a band."""
    prediction = result.prediction
    if prediction is None:
        return np.zeros(result.gauges.computed.shape, dtype=np.bool_)
    return np.asarray(np.isfinite(prediction.lower95) & np.isfinite(prediction.upper95))


def _draw_instrument(axes: Axes, result: Result, one: Instrument, axis: StageAxis) -> None:
    """The channels of one instrument over time."""
    single = len(one.rows) == 1
    for k, row in enumerate(one.rows):
        draw_computed(axes, result, row, COMPUTED if single else colour(k), axis)
        dots = MEASURED if single else colour(k)
        draw_measured(axes, result, row, dots, marker(k), axis)
    if unknown(result)[list(one.rows)].any():
        axes.text(0.98, 0.04, "prediction not determined", transform=axes.transAxes, ha="right",
                  fontsize=SMALL, color=FAINT)  # fmt: skip
    axes.axhline(0, color=FAINT, lw=0.5, zorder=0)
    axis.finish(axes)
    axes.grid(axis="y")
    axes.set_ylabel(one.quantity, fontsize=SMALL)
    axes.set_title(short(one.name, 16))
    if any(one.labels):
        _anchor_legend(axes, one)


def _anchor_legend(axes: Axes, one: Instrument) -> None:
    """The anchors on the line of the title, at its right end."""
    handles = [
        key(short(label, 6), color=colour(k), marker=marker(k), ms=3, lw=1)
        for k, label in enumerate(one.labels)
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
    if result.prediction is None:
        return
    ends95 = (result.prediction.lower95, result.prediction.upper95)
    low, high = (result.gauges.in_units(end)[row] for end in ends95)
    known = np.isfinite(low) & np.isfinite(high)
    ends = np.where(known, low, np.nan), np.where(known, high, np.nan)
    axes.fill_between(x, *ends, color=paint, alpha=BAND, lw=0)
    before, after = np.r_[False, known[:-1]], np.r_[known[1:], False]
    alone = known & ~before & ~after
    axes.vlines(x[alone], low[alone], high[alone], color=paint, alpha=BAND, lw=5)


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
    if axis is not None and axis.dated:
        x, read, error, used = _each_reading(result, row, axis)
    else:
        table = result.gauges
        x = np.arange(len(table.stages), dtype=np.float64) if axis is None else axis.at
        read, sd = (table.in_units(column)[row] for column in (table.measured, table.sd))
        error, used = NORMAL_95 * np.nan_to_num(sd), table.used[row]
    for part, face in ((used, paint), (~used, "white")):
        here = np.isfinite(read) & part
        if here.any():
            axes.errorbar(x[here], read[here], yerr=error[here], ms=3.2, lw=0.7, fmt=dots,
                          color=paint, mfc=face, mew=0.7)  # fmt: skip


def _each_reading(
    result: Result, row: int, axis: StageAxis
) -> tuple[Floats, Floats, Floats, Bools]:
    """Place, value, half width and use of every reading that counts of a channel, in units."""
    table, gauges = result.gauges.readings, result.gauges
    found = [(j, k) for (i, j), rows in gauges.rows.items() if i == row for k in rows.tolist()]
    found.sort(key=lambda pair: pair[1])
    rows = np.array([k for _, k in found], dtype=np.int64)
    x = np.array([axis.of_reading(j, float(table.time[k])) for j, k in found])
    unit = gauges.in_units(np.ones((len(gauges.channels), 1)))[row, 0]
    sd = NORMAL_95 * np.nan_to_num(table.sd[rows])
    return x, table.value[rows] * unit, sd * unit, table.used[rows]


def unknown(result: Result) -> Bools:
    """(n_channels, n_stages) predicted without being determined."""
    prediction = result.prediction
    if prediction is None:
        return np.zeros(result.gauges.computed.shape, dtype=bool)
    return np.asarray(np.isfinite(prediction.mean) & ~np.isfinite(prediction.sd))


def last_fitted(result: Result) -> int:
    """The last stage whose readings were used, -1 if none."""
    used = np.flatnonzero(result.gauges.used.any(axis=0))
    return int(used.max()) if used.size else -1


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
        partial(face_figure, result, ways=ways),
        most=_PER_FIGURE,
        picture=("face", "Motions over the distance to the face", caption),
        label=_name,
    )


def face_figure(
    result: Result, shown: Sequence[Instrument], *, ways: Mapping[int, Floats]
) -> Figure:
    """A panel for each instrument, over the distance of the face.

    Args:
        result: of a fit.
        shown: the instruments.
        ways: channel to how far (n_stages,) the face has passed its section, m.
    """
    limits = value_limits(result, shown)
    figure, panels = panel_grid(len(shown), height=2.05, extra=0.8)
    every = np.concatenate([ways[one.rows[0]] for one in shown])
    margin = 0.04 * np.ptp(every)
    for axes, one in zip(panels, shown, strict=True):
        axis = StageAxis(result.gauges.stages, ways[one.rows[0]], dated=False)
        for k, row in enumerate(one.rows):
            paint = COMPUTED if len(one.rows) == 1 else colour(k)
            draw_computed(axes, result, row, paint, axis)
            dots = MEASURED if len(one.rows) == 1 else colour(k)
            draw_measured(axes, result, row, dots, marker(k), axis)
        axes.set_xlim(every.min() - margin, every.max() + margin)
        _set_values(axes, one, limits[one.quantity])
        axes.axvline(0.0, color=FAINT, lw=0.7, ls=":")
        axes.axhline(0.0, color=FAINT, lw=0.5, zorder=0)
        axes.set_title(short(one.name, 16))
        axes.set_ylabel(one.quantity, fontsize=SMALL)
        axes.set_xlabel("face past the section (m)")
        axes.grid(axis="y")
        if any(one.labels):
            _anchor_legend(axes, one)
    figure.legend(handles=legend(result, shown), loc="outside upper center", ncols=4)
    return figure


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


_LEAST_ROUNDS = 3
