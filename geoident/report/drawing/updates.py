"""The history of a fit over its updates: its parameters, and how far new readings were off."""

from __future__ import annotations

import numpy as np
from matplotlib.figure import Figure

from geoident.model.results.result import Result
from geoident.model.results.updates import LEAST_CHANCE, UpdateHistory
from geoident.report.drawing.backtest import Course, courses_figure
from geoident.report.drawing.parameters.scale import logarithmic
from geoident.report.drawing.style import ACCENT, FAINT, MEASURED, WIDTH, Picture, key, stage_ticks

_LEAST = 1e-6
"""P-value at which the axis ends."""


def update_pictures(result: Result) -> tuple[Picture, ...]:
    """Parameters and p-values over the updates; none where there was no update."""
    history = result.updates
    if history is None or not history.last:
        return ()
    pictures = []
    if history.parameters:
        pictures.append(
            Picture(
                "update-parameters",
                "Parameters over the updates",
                "Estimates with their 95 % intervals after each update; no mark: not determined. "
                "Where the model is right, an interval holds the later estimates.",
                lambda: _parameters_figure(result, history),
            )
        )
    if any(step.judged for step in history.steps):
        pictures.append(
            Picture(
                "update-p-values",
                "New readings against their predictions",
                "How often chance makes readings that belong to the model at least as far from its "
                "predictions. Filled: all new readings of an update together; hollow: each gauge. "
                "Orange: updates whose readings do not belong.",
                lambda: _chance_figure(history),
            )
        )
    return tuple(pictures)


def _ticks(history: UpdateHistory) -> tuple[str, ...]:
    return tuple(f"{k}: {step.made[:10]}" for k, step in enumerate(history.steps))


def _parameters_figure(result: Result, history: UpdateHistory) -> Figure:
    units = {row.parameter: (row.unit, row.dimension) for row in history.parameters}
    courses = []
    for name, unit in units.items():
        values, low, high, determined = history.values_of(name)
        courses.append(Course(name, unit, values, low, high, determined == 1.0))
    return courses_figure(courses, _ticks(history), logarithmic(result))


def _chance_figure(history: UpdateHistory) -> Figure:
    figure = Figure(figsize=(WIDTH, 2.8))
    axes = figure.subplots()
    for gauge in history.gauges:
        axes.plot(gauge.update, max(gauge.p_value, _LEAST), "o", ms=3, mew=0.6, mfc="white",
                  color=FAINT)  # fmt: skip
    for k, step in enumerate(history.steps):
        if np.isfinite(step.p_value):
            color = MEASURED if step.belong else ACCENT
            axes.plot(k, max(step.p_value, _LEAST), "o", ms=5, color=color)
    axes.axhline(LEAST_CHANCE, color=FAINT, lw=0.8, ls="--")
    axes.set_yscale("log")
    axes.set_ylim(0.5 * _LEAST, 2.0)
    axes.set_ylabel("probability by chance")
    stage_ticks(axes, _ticks(history))
    axes.grid(axis="y")
    dot = {"marker": "o", "ls": ""}
    axes.legend(
        handles=[
            key("all new readings", color=MEASURED, ms=5, **dot),
            key("each gauge", color=FAINT, ms=3, mfc="white", **dot),
        ],
        loc="upper left",
        bbox_to_anchor=(1.0, 1.0),
    )
    return figure
