"""Readings over a number of each stage: the rows of tests over what was imposed, load tests."""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial

import numpy as np
from matplotlib.figure import Figure

from geoident.model.results.result import Result
from geoident.report.drawing.gauges.axis import StageAxis
from geoident.report.drawing.gauges.course import draw_computed, draw_measured, legend_handles
from geoident.report.drawing.style import (
    FAINT,
    SMALL,
    Picture,
    colour,
    key,
    marker,
    paged,
    panel_grid,
    short,
)
from geoident.report.text.curves import Curves, curves_of

_PER_FIGURE = 6
_HEIGHT = 2.7  # of a panel, inches


def curve_pictures(result: Result) -> tuple[Picture, ...]:
    """All figures that the case asks for, and those of tests."""
    caption = (
        "Dots: measured, with bars of 1.96 times their standard deviation; hollow: not used. "
        "Lines: computed at these numbers; dashed, in their 95 % bands: predicted."
    )
    return paged(
        curves_of(result),
        partial(_figure, result),
        most=_PER_FIGURE,
        picture=("curves", "Readings over what was imposed", caption),
        label=lambda one: one.read,
    )


def _figure(result: Result, shown: Sequence[Curves]) -> Figure:
    """A panel for each quantity, a colour for each gauge."""
    figure, panels = panel_grid(len(shown), height=_HEIGHT, extra=0.5)
    for axes, one in zip(panels, shown, strict=True):
        ends = float(np.nanmin(one.at)), float(np.nanmax(one.at))
        label = f"{one.over} ({one.unit})" if one.unit else one.over
        axis = StageAxis(
            result.gauges.stages, one.at, dated=False, ends=ends, label=label, log=one.log
        )
        for k, row in enumerate(one.rows):
            draw_computed(axes, result, row, colour(k), axis)
            draw_measured(axes, result, row, colour(k), marker(k), axis)
        axes.axhline(0, color=FAINT, lw=0.5, zorder=0)
        axes.grid(axis="y")
        axis.finish(axes)
        unit = result.gauges.shown_units[one.rows[0]]
        axes.set_ylabel(f"{one.read} ({unit})" if unit else one.read, fontsize=SMALL)
        if one.downwards:
            axes.invert_yaxis()
        handles = [
            key(short(name, 16), color=colour(k), marker=marker(k), ms=3, lw=1)
            for k, name in enumerate(one.names)
        ]
        axes.legend(handles=handles, loc="best", fontsize=SMALL, frameon=False)
    rows = [row for one in shown for row in one.rows]
    figure.legend(handles=legend_handles(result, rows), loc="outside upper center", ncols=4)
    return figure
