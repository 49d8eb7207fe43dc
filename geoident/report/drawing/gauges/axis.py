"""What is drawn of readings, over what and how far: values, bands, dates or stages, limits."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, cast

import numpy as np
from matplotlib.axes import Axes
from matplotlib.dates import AutoDateLocator, MonthLocator
from matplotlib.ticker import FuncFormatter, Locator

from geoident.io.text.dates import date_text
from geoident.model.arrays import Bools, Floats
from geoident.model.results.bands import NORMAL_95
from geoident.model.results.result import Result
from geoident.model.results.times import StageTimes
from geoident.report.drawing.style import FAINT, SMALL, short, stage_ticks
from geoident.report.text.case import stage_dates
from geoident.report.text.instruments import Instrument

_DAY = 86400.0  # s
_DECADES = 30.0
"""The times of a stage are shown on their logarithm if the last is so many times the first."""

_MANY = 60
"""Readings of a channel from which on dots are smaller."""

_YEAR = 366.0  # days
_CLOSE = 0.035
"""Part of an axis by which two stages are apart at least if both have their numbers."""


@dataclass(frozen=True)
class StageAxis:
    """Where the stages, and the moments of those that last, lie on an axis.

    Args:
        stages: names of the states.
        at: (n_stages,) days since 1970 where there are dates, days since the case or its stage
            began where stages last, else numbers from 0.
        dated: these are days since 1970.
        ends: the first and the last of stages and readings.
        marks: number of each stage to the place of its end.
        begin: where days count from, seconds since 1970; NaN where readings have no dates.
        label: what days count from; empty for dates and numbers.
        log: the axis is logarithmic.
    """

    stages: tuple[str, ...]
    at: Floats
    dated: bool
    ends: tuple[float, float] = (0.0, 1.0)
    marks: Mapping[int, float] = field(default_factory=dict)
    begin: float = np.nan
    label: str = ""
    log: bool = False

    @property
    def in_time(self) -> bool:
        """Whether places are times, at which each reading has its own."""
        return self.dated or bool(self.label)

    def of_reading(self, stage: int, time: float) -> float:
        """Where a reading of a stage lies that was taken at a time (s since 1970, or NaN)."""
        if self.dated and np.isfinite(time):
            return time / _DAY
        since = (time - self.begin) / _DAY
        return since if self.label and since > 0.0 else float(self.at[stage])

    def finish(self, axes: Axes) -> None:
        """Dates or days with a faint line at each stage, or the names of the stages."""
        if not self.in_time:
            stage_ticks(axes, self.stages)
            return
        low, high = self.ends
        if self.log:
            axes.set_xscale("log")
            axes.set_xlim(0.8 * low, 1.25 * high)
            axes.xaxis.set_major_formatter(FuncFormatter(lambda day, _: f"{day:g}"))
        else:
            margin = 0.03 * (high - low)
            axes.set_xlim(low - margin, high + margin)
        if self.label:
            axes.set_xlabel(self.label, fontsize=SMALL)
        else:
            axes.xaxis.set_major_locator(_date_locator(high - low))
            axes.xaxis.set_major_formatter(FuncFormatter(lambda day, _: date_text(_DAY * day)))
        last = -np.inf
        for number, x in self.marks.items():
            axes.axvline(x, color=FAINT, lw=0.4, ls=(0, (1, 2)), zorder=0)
            if x - last > _CLOSE * (high - low):
                axes.text(x, 0.99, str(number), transform=axes.get_xaxis_transform(),
                          ha="center", va="top", fontsize=SMALL - 0.5, color=FAINT)  # fmt: skip
                last = x


def _date_locator(days: float) -> Locator:
    """Places of two or three dates on an axis of so many days."""
    auto: Any = AutoDateLocator  # matplotlib.dates has no types
    monthly: Any = MonthLocator
    if _YEAR < days < 2.0 * _YEAR:  # where the other finds no interval, and warns
        return cast(Locator, monthly(bymonth=(1, 7)))
    return cast(Locator, auto(minticks=2, maxticks=3))


def stage_axis(result: Result) -> StageAxis:
    """Dates of the stages, from the case or else from their readings; numbers if any has none.

    Where stages last: the logarithm of the time since its beginning if there is but one, else
    dates, or days since the case began. One without duration, the end of all flow, has no date
    then and is not shown.
    """
    stages = result.gauges.stages
    times, dates = result.gauges.times, stage_dates(result)
    ends = np.flatnonzero(result.gauges.ends).tolist()
    if times is not None:
        alone = _of_one_stage(stages, times, dates)
        if alone is not None:
            return alone
    known = np.isfinite(dates)
    if times is None and not known.all():
        known[:] = False
    if known.sum() > 1 and (np.diff(dates[known]) >= 0.0).all() and np.ptp(dates[known]) > 0.0:
        every = np.r_[dates, result.gauges.readings.time] / _DAY
        span = float(np.nanmin(every)), float(np.nanmax(every))
        at = dates / _DAY
        named = not known.all() or list(stages) != [date_text(date) for date in dates.tolist()]
        marks = {number: float(at[n]) for number, n in enumerate(ends, 1) if named and known[n]}
        return StageAxis(stages, at, dated=True, ends=span, marks=marks)
    if times is not None and times.series is not None:
        at = times.elapsed / _DAY
        marks = {number: float(at[n]) for number, n in enumerate(ends, 1)}
        label = "days since the beginning"
        return StageAxis(stages, at, dated=False, ends=(0.0, at.max()), marks=marks, label=label)
    return StageAxis(stages, np.arange(len(stages), dtype=np.float64), dated=False)


def _of_one_stage(stages: tuple[str, ...], times: StageTimes, dates: Floats) -> StageAxis | None:
    """The axis of the one stage that lasts, on the logarithm of its time; None for another.

    What is before it lies at its left end, what is after it at its right end.
    """
    days = times.since / _DAY
    lasting = {whole for whole, day in zip(times.whole, days, strict=True) if day > 0.0}
    shown = days[days > 0.0]
    if len(lasting) != 1 or shown.max() < _DECADES * shown.min():
        return None
    (stage,) = lasting
    inside = np.flatnonzero([whole == stage for whole in times.whole])
    first, last = float(shown.min()), float(shown.max())
    at = np.where(np.arange(len(days)) < inside[0], first / 2.0, last)
    at[inside] = np.maximum(days[inside], first / 2.0)
    begin = dates[inside[-1]] - _DAY * last
    label = f"days since the beginning of '{short(stage, 24)}'"
    return StageAxis(
        stages, at, dated=False, ends=(first, last), begin=float(begin), label=label, log=True
    )


def value_limits(
    result: Result, shown: Sequence[Instrument], stages: Sequence[int] | None = None
) -> Mapping[str, tuple[float, float]]:
    """Limits for the values of instruments, one for all that read the same quantity.

    All that is measured with its error bar, all that is computed and all bands lie inside; so does
    zero where a change is read.

    Args:
        result: of a fit.
        shown: the instruments.
        stages: those that are drawn; None for all.
    """
    ends: dict[str, list[float]] = {}
    low, high = _extremes(result, stages)
    for one in shown:
        inside = np.concatenate([low[list(one.rows)], high[list(one.rows)]])
        ends.setdefault(one.quantity, [0.0] if _is_change(one) else []).extend(
            inside[np.isfinite(inside)].tolist()
        )
    return {quantity: _with_margin(values) for quantity, values in ends.items()}


def _is_change(one: Instrument) -> bool:
    """It reads a motion, or what has changed since its zero."""
    return "mm" in one.quantity or "change" in one.quantity or bool(one.line)


def _with_margin(values: list[float]) -> tuple[float, float]:
    low, high = min(values, default=0.0), max(values, default=1.0)
    margin = 0.07 * (high - low) or 0.1 * abs(high) or 1.0
    return low - margin, high + margin


def _extremes(result: Result, stages: Sequence[int] | None) -> tuple[Floats, Floats]:
    """(n_channels,) least and largest of what is drawn of each channel, in units; NaN for nothing.

    Args:
        result: of a fit.
        stages: those that are drawn; None for all.
    """
    gauges = result.gauges
    chosen = list(range(len(gauges.stages))) if stages is None else list(stages)
    drawn = gauges.in_units(computed_of(result)), *bands_of(result)
    every = np.concatenate([table[:, chosen] for table in drawn], axis=1)
    every = np.where(np.isfinite(every), every, np.nan)
    low, high = np.fmin.reduce(every, axis=1), np.fmax.reduce(every, axis=1)
    names, read = {gauges.stages[k] for k in chosen}, gauges.readings
    half = NORMAL_95 * np.nan_to_num(read.sd)
    size = gauges.in_units(np.ones((len(gauges.channels), 1)))[:, 0]
    rows = {name: row for row, name in enumerate(gauges.channels)}
    for k in np.flatnonzero(np.isfinite(read.value)).tolist():
        row = rows.get(read.channel[k])
        if row is not None and read.stage[k] in names:
            low[row] = np.fmin(low[row], size[row] * (read.value[k] - half[k]))
            high[row] = np.fmax(high[row], size[row] * (read.value[k] + half[k]))
    return low, high


def computed_of(result: Result) -> Floats:
    """(n_channels, n_stages) computed, SI: the mean of a prediction; NaN where not determined."""
    gauges, prediction = result.gauges, result.prediction
    if prediction is None:
        return gauges.computed
    computed = np.where(
        np.isfinite(prediction.mean) & ~gauges.used, prediction.mean, gauges.computed
    )
    return np.where(unknown(result), np.nan, computed)


def bands_of(result: Result) -> tuple[Floats, Floats]:
    """(n_channels, n_stages) ends of the 95 % bands, in units; NaN where there is none.

    Between the readings of a fit, at moments of stages that last, the fitted line says enough.
    """
    gauges, prediction = result.gauges, result.prediction
    if prediction is None:
        none = np.full(gauges.computed.shape, np.nan)
        return none, none
    low, high = (gauges.in_units(end) for end in (prediction.lower95, prediction.upper95))
    known = np.isfinite(low) & np.isfinite(high)
    between = ~gauges.ends & (np.arange(len(gauges.stages)) < last_fitted(result))
    fitted = np.asarray(gauges.used.any(axis=1), dtype=np.bool_)
    known &= ~(between & fitted[:, None])
    return np.where(known, low, np.nan), np.where(known, high, np.nan)


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


def draw_dots(
    axes: Axes,
    along: Floats,
    read: Floats,
    sd: Floats,
    used: Bools,
    *,
    upright: bool = False,
    **style: Any,
) -> None:
    """Readings with the half width of their 95 % interval; hollow where they are not used.

    Args:
        axes: where to draw.
        along: (k,) places.
        read: (k,) readings; NaN for none.
        sd: (k,) standard deviations.
        used: (k,) which are used.
        upright: places go upwards, readings to the right.
        style: of the dots, their ``color`` among it.
    """
    error = NORMAL_95 * np.nan_to_num(sd)
    for part, face in ((used, style["color"]), (~used, "white")):
        here = np.isfinite(read) & part
        if here.any():
            x, y, bar = (read, along, "xerr") if upright else (along, read, "yerr")
            size = 3.2 if len(along) <= _MANY else 2.2
            look = {"ms": size, "lw": 0.7, "mew": 0.7, "mfc": face, bar: error[here], **style}
            axes.errorbar(x[here], y[here], **look)
