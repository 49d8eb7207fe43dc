"""Gauges of a structure in service over time: read, explained, expected, changed."""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.dates import AutoDateLocator
from matplotlib.figure import Figure
from matplotlib.patches import Patch
from matplotlib.ticker import FuncFormatter

from geoident.io.text.dates import date_text
from geoident.model.arrays import Bools, Floats
from geoident.model.in_service import DAY
from geoident.model.results.bands import NORMAL_95
from geoident.model.results.in_service import ChangeRow, ParameterChangeRow
from geoident.model.results.result import Result
from geoident.report.drawing.style import (
    ACCENT,
    COMPUTED,
    FAINT,
    MEASURED,
    SMALL,
    WIDTH,
    Picture,
    key,
    paged,
)
from geoident.report.text.in_service import gauge_states
from geoident.units import in_unit

_PER_FIGURE = 5
_PANEL = 1.75  # height, inches
_MANY = 2000
"""Dots of a panel from which on they are drawn as pixels."""
_NAMED = 3
"""Single wrong readings of a panel whose dates are written."""
_APART = 0.1
"""Part of the axis by which dates that are written are apart."""
_ALARM: dict[str, Any] = {"color": ACCENT, "ls": (0, (5, 1.5)), "lw": 1.0}


def time_pictures(result: Result) -> tuple[Picture, ...]:
    """All gauges that were fitted or judged, a panel each; those that have changed first."""
    if not result.in_service:
        return ()
    shown = [name for name in result.gauges.channels if _known(result, name).any()]
    states = gauge_states(result)
    order = ["red", "amber", "green", ""]
    shown.sort(key=lambda name: order.index(states.get(name, ("", ""))[0]))
    judged = (
        " Dashed, in its 95 % band: what a reading was expected to be before it was taken; orange: "
        "readings outside of it."
        if result.judged is not None
        else ""
    )
    changed = (
        " Vertical lines: when changes began, in the 95 % interval of that; crosses: "
        "single readings that are wrong, at the rim where they are farther off."
        if result.changes or result.parameter_changes
        else ""
    )
    hollow = "read before, or not used" if result.kind == "control" else "not used"
    caption = f"Dots: read; hollow: {hollow}. Line: what the effects explain.{judged}{changed}"
    return paged(
        shown,
        partial(time_figure, result),
        most=_PER_FIGURE,
        picture=("in-service", "Gauges over time", caption),
        label=str,
    )


def _known(result: Result, name: str) -> Bools:
    """(k,) readings of a gauge of which something is computed or expected."""
    table = result.gauges.readings
    own = np.array(table.channel) == name
    known = np.isfinite(table.computed) & table.used
    if result.judged is not None:
        known = known | np.isfinite(result.judged.predicted)
    return np.asarray(own & known)


def time_figure(result: Result, names: Sequence[str]) -> Figure:
    """A panel for each gauge, one below the other, over the same time."""
    figure = Figure(figsize=(WIDTH, _PANEL * len(names) + 0.7))
    panels = figure.subplots(len(names), 1, squeeze=False, sharex=True)[:, 0]
    for axes, name in zip(panels, names, strict=True):
        _draw_gauge(axes, result, name)
    locator = AutoDateLocator(minticks=3, maxticks=8)  # type: ignore[no-untyped-call] # matplotlib.dates has no types
    panels[-1].xaxis.set_major_locator(locator)
    panels[-1].xaxis.set_major_formatter(FuncFormatter(lambda day, _: date_text(DAY * day)[:7]))
    figure.legend(handles=_legend(result, names), loc="outside upper center", ncols=5)
    return figure


def _legend(result: Result, names: Sequence[str]) -> list[object]:
    """What dots, lines and bands are, as far as the figure has them."""
    dot: dict[str, Any] = {"marker": "o", "ls": "", "ms": 3}
    handles: list[object] = [key("read", color=MEASURED, **dot)]
    handles.append(key("explained by the effects", color=COMPUTED, lw=1.0))
    if result.judged is not None:
        handles.append(key("outside its band", color=ACCENT, **dot))
        handles.append(key("expected", color=COMPUTED, ls="--", lw=1.0))
        handles.append(Patch(color=COMPUTED, alpha=0.22, lw=0, label="95 % band"))
    own = [row for row in result.changes if row.gauge in names]
    if any(row.kind != "reading" for row in own) or result.parameter_changes:
        handles.append(key("change", color=ACCENT, lw=1.2))
    if any(row.kind == "reading" for row in own):
        handles.append(key("wrong reading", color=ACCENT, marker="x", ls="", ms=4))
    if any(alarm.gauge in names for alarm in result.alarms):
        handles.append(key("alarm value", **_ALARM))
    return handles


def _draw_gauge(axes: Axes, result: Result, name: str) -> None:
    """The readings of a gauge, what is known of them, and its changes."""
    gauges = result.gauges
    table, i = gauges.readings, gauges.channels.index(name)
    unit = gauges.units[i], gauges.dimensions[i]
    size = in_unit(1.0, *unit)
    own = np.flatnonzero(np.array(table.channel) == name)
    own = own[np.argsort(table.time[own], kind="stable")]
    own = own[np.isfinite(table.time[own]) & np.isfinite(table.value[own])]
    days, read, used = table.time[own] / DAY, size * table.value[own], table.used[own]
    judged = np.full((3, len(own)), np.nan)  # expected, standard deviation, in these
    if result.judged is not None:
        columns = result.judged.predicted, result.judged.predicted_sd, result.judged.innovation
        judged = np.array([column[own] for column in columns])
    expected, half = size * judged[0], NORMAL_95 * size * judged[1]
    is_judged = np.isfinite(judged[2])
    wrong = _at(result, name, table.time[own])
    limits = _limits(read[~wrong & ~table.bad[own]], expected - half, expected + half)
    axes.plot(days, size * table.computed[own], color=COMPUTED, lw=0.9)
    axes.plot(days[is_judged], expected[is_judged], "--", color=COMPUTED, lw=0.9)
    axes.fill_between(days[is_judged], (expected - half)[is_judged],
                      (expected + half)[is_judged], color=COMPUTED, alpha=0.22, lw=0)  # fmt: skip
    outside = is_judged & (np.abs(judged[2]) > NORMAL_95) & ~wrong
    groups = (
        (used & ~outside & ~wrong, MEASURED, MEASURED),
        (is_judged & ~used & ~outside & ~wrong, MEASURED, MEASURED),
        (~used & ~is_judged & ~wrong, FAINT, "white"),
        (outside, ACCENT, ACCENT),
    )
    for here, edge, face in groups:
        if here.any():
            axes.plot(days[here], read[here], "o", ms=2.2, mew=0.5, color=edge, mfc=face,
                      rasterized=int(here.sum()) > _MANY)  # fmt: skip
    _draw_wrong(axes, days[wrong], read[wrong], limits, judged[2][wrong])
    _draw_changes(axes, result, name)
    for alarm in result.alarms:
        if alarm.gauge == name:
            axes.axhline(size * alarm.value, **_ALARM)
    axes.set_ylim(*limits)
    axes.grid(axis="y")
    state = gauge_states(result).get(name, ("", ""))[0]
    axes.set_title(f"{name}: {state}" if state else name)
    axes.set_ylabel(gauges.shown_units[i] or "reading", fontsize=SMALL)


def _at(result: Result, name: str, times: Floats) -> Bools:
    """(k,) which readings of a gauge at some times are wrong by themselves."""
    wrong = [r.since for r in result.changes if r.gauge == name and r.kind == "reading"]
    return np.isin(times, wrong)


def _limits(read: Floats, low: Floats, high: Floats) -> tuple[float, float]:
    """Of a panel: all readings but wrong ones, and the bands as far as these do not hide them."""
    ends = float(np.min(read, initial=np.inf)), float(np.max(read, initial=-np.inf))
    if not np.isfinite(ends).all():
        ends = float(np.nanmin(low, initial=0.0)), float(np.nanmax(high, initial=1.0))
    span = ends[1] - ends[0] or 1.0
    bottom = max(min(float(np.nanmin(low, initial=np.inf)), ends[0]), ends[0] - span)
    top = min(max(float(np.nanmax(high, initial=-np.inf)), ends[1]), ends[1] + span)
    margin = 0.08 * (top - bottom)
    return bottom - margin, top + margin


def _draw_wrong(
    axes: Axes, days: Floats, read: Floats, limits: tuple[float, float], off: Floats
) -> None:
    """Crosses at wrong readings, at the rim where they lie beyond; the farthest have their date."""
    low, high = limits
    rim = 0.04 * (high - low)
    y = np.clip(read, low + rim, high - rim)
    axes.plot(days, y, "x", color=ACCENT, ms=4.5, mew=1.1, zorder=4)
    room = _APART * float(np.ptp(axes.get_xlim()))
    named: list[int] = []
    for k in np.argsort(-np.abs(off)).tolist():
        if all(abs(days[k] - days[other]) > room for other in named):
            named.append(k)
    for k in named[:_NAMED]:
        up = y[k] < 0.5 * (low + high)
        words = date_text(DAY * float(days[k]))[:10]
        axes.annotate(words, (days[k], y[k]), xytext=(3, 4 if up else -4),
                      textcoords="offset points", fontsize=SMALL - 1, color=ACCENT,
                      va="bottom" if up else "top")  # fmt: skip


def _draw_changes(axes: Axes, result: Result, name: str) -> None:
    """A line where each change of a gauge began, in the interval of that, with size and date."""
    rows: list[tuple[str, ChangeRow | ParameterChangeRow]] = [
        (row.parameter, row) for row in result.parameter_changes if name in row.gauges.split(", ")
    ]
    rows += [(r.kind, r) for r in result.changes if r.gauge == name and r.kind != "reading"]
    for k, (what, row) in enumerate(rows):
        if row.latest > row.earliest:
            axes.axvspan(row.earliest / DAY, row.latest / DAY, color=ACCENT, alpha=0.13, lw=0)
        axes.axvline(row.since / DAY, color=ACCENT, lw=1.2)
        words = f"{what} {row.text}, {date_text(row.since)[:10]}"
        axes.annotate(words, (row.since / DAY, 0.97 - 0.13 * k), xytext=(3, 0),
                      xycoords=("data", "axes fraction"), textcoords="offset points",
                      fontsize=SMALL - 0.5, color=ACCENT, va="top")  # fmt: skip
