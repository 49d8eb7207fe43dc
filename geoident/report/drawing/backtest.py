"""A backtest: parameters as readings are added, and errors of predictions by stage."""

from __future__ import annotations

from collections.abc import Sequence, Set
from dataclasses import dataclass
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from geoident.model.arrays import Bools, Floats
from geoident.model.results.backtest import Backtest, bands_of
from geoident.model.results.bands import NORMAL_95, next_read
from geoident.model.results.result import Result
from geoident.report.drawing.parameters.scale import logarithmic, set_scale
from geoident.report.drawing.style import (
    COMPUTED,
    FAINT,
    MEASURED,
    WIDTH,
    Picture,
    key,
    labelled,
    panel_grid,
    short,
    stage_ticks,
)
from geoident.units import in_unit, shown_unit

_MOST_PARAMETERS = 12
_LINEAR = 8.0  # standard deviations up to which the axis of errors is linear


def backtest_pictures(result: Result) -> tuple[Picture, ...]:
    """Parameters against the stages fitted, and the errors of the predictions."""
    backtest = result.backtest
    if backtest is None or not backtest.steps:
        return ()
    pictures = []
    if len(backtest.steps) > 1:
        pictures.append(
            Picture(
                "backtest-parameters",
                "Parameters as readings are added",
                "Estimates with their 95 % intervals from the readings up to each stage; no mark: "
                "not determined. Where the model is right, an interval holds the later estimates.",
                lambda: settling_figure(result, backtest),
            )
        )
    if any(np.isfinite(bands_of(backtest, step).z).any() for step in backtest.steps):
        pictures.append(
            Picture(
                "backtest-errors",
                "Predictions against later readings",
                "Errors of predictions in their standard deviations, by predicted stage; grey: the "
                "95 % band. Filled: the next stage that was read after the fitted ones; hollow: "
                "stages further ahead.",
                lambda: error_figure(result, backtest),
            )
        )
    return tuple(pictures)


def settling_figure(result: Result, backtest: Backtest) -> Figure:
    """A panel for each parameter."""
    table, steps = result.parameters, backtest.steps
    courses = [
        Course(
            name,
            (table.units[i], table.dimensions[i]),
            *(np.array([getattr(step, column)[i] for step in steps]) for column in _OF_STEP),
        )
        for i, name in enumerate(table.names)
    ]
    stages = tuple(result.gauges.stages[step.last] for step in steps)
    return courses_figure(courses, stages, logarithmic(result))


_OF_STEP = ("values", "lower95", "upper95", "determined")


@dataclass(frozen=True)
class Course:
    """A parameter as readings are added.

    Args:
        name: of the parameter.
        unit: its unit and dimension.
        values: (k,) SI.
        lower95: (k,) lower end of its 95 % interval.
        upper95: (k,) its upper end.
        determined: (k,) the readings determine it.
    """

    name: str
    unit: tuple[str, str]
    values: Floats
    lower95: Floats
    upper95: Floats
    determined: Bools


def courses_figure(courses: Sequence[Course], ticks: tuple[str, ...], logs: Set[str]) -> Figure:
    """A panel for each of the first parameters.

    Args:
        courses: of the parameters.
        ticks: what stands below each of the k estimates.
        logs: names of the parameters that are drawn on the logarithm.
    """
    shown = courses[:_MOST_PARAMETERS]
    figure, panels = panel_grid(len(shown), height=2.3, extra=0.2)
    for axes, course in zip(panels, shown, strict=True):
        size = in_unit(1.0, *course.unit)
        values, low, high = (
            size * column for column in (course.values, course.lower95, course.upper95)
        )
        known = course.determined
        _draw_settling(axes, np.where(known, values, np.nan), low, high)
        drawn = np.r_[values, low, high]
        if course.name in logs and np.isfinite(drawn).any() and np.nanmin(drawn) > 0.0:
            drawn = np.r_[values[known], low[known], high[known]]
            first, last = float(np.nanmin(drawn)), float(np.nanmax(drawn))
            set_scale(axes.yaxis, low=first / 1.06, high=last * 1.06, log=True, most=4)
        axes.set_title(labelled(short(course.name), shown_unit(*course.unit)))
        stage_ticks(axes, ticks)
        axes.grid(axis="y")
    return figure


def _draw_settling(axes: Axes, values: Floats, low: Floats, high: Floats) -> None:
    x = np.arange(len(values))
    spread = np.isfinite(values) & np.isfinite(low) & np.isfinite(high)
    axes.vlines(x[spread], low[spread], high[spread], color=COMPUTED, lw=1.6)
    axes.plot(x, values, "o", color=COMPUTED, ms=4)
    if np.isfinite(values[-1]):
        axes.axhline(values[-1], color=FAINT, lw=0.7, zorder=0)


def error_figure(result: Result, backtest: Backtest) -> Figure:
    """Standardized errors over the predicted stages."""
    figure = Figure(figsize=(WIDTH, 3.6))
    axes = figure.subplots()
    axes.axhspan(-NORMAL_95, NORMAL_95, color=FAINT, alpha=0.15, lw=0)
    axes.axhline(0.0, color=FAINT, lw=0.7)
    dot: dict[str, Any] = {"marker": "o", "ls": "", "color": MEASURED, "ms": 4}
    keys = key("next stage", **dot), key("further ahead", mfc="white", **dot)
    largest, drawn = NORMAL_95, [False, False]
    predicted: set[int] = set()
    for step in backtest.steps:
        bands = bands_of(backtest, step)
        z, ahead = bands.z, next_read(bands)
        largest = max(largest, float(np.nanmax(np.abs(z), initial=0.0)))
        for k, part in enumerate((ahead, ~ahead)):
            rows, columns = np.nonzero(part & np.isfinite(z))
            aside = 0.3 * (rows / max(len(z) - 1, 1) - 0.5)  # channels side by side
            face = "white" if k else MEASURED
            axes.plot(columns + aside, z[rows, columns], mfc=face, mew=0.8, **dot)
            drawn[k] |= bool(len(rows))
            predicted |= {*columns.tolist()}
    if largest > _LINEAR:
        axes.set_yscale("symlog", linthresh=4.0)
    axes.set_ylabel("error / standard deviation")
    stage_ticks(axes, result.gauges.stages)
    axes.set_xlim(min(predicted) - 0.6, max(predicted) + 0.6)
    axes.grid(axis="y")
    handles = [handle for handle, shown in zip(keys, drawn, strict=True) if shown]
    axes.legend(handles=handles, loc="upper left", bbox_to_anchor=(1.0, 1.0))
    return figure
