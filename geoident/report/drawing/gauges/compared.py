"""The same gauges of several results, one over the other."""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial

from matplotlib.axes import Axes
from matplotlib.figure import Figure

from geoident.model.results.result import Labelled, Result
from geoident.report.drawing.gauges.axis import computed_of
from geoident.report.drawing.gauges.course import draw_measured
from geoident.report.drawing.style import (
    MEASURED,
    SMALL,
    Picture,
    colour,
    key,
    paged,
    panel_grid,
    short,
    stage_ticks,
)
from geoident.report.text.case import gauge_quantity

_COMPARED_PER_FIGURE = 15
_STYLES = ("-", "--", "-.", ":")


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
        axes.plot(
            x,
            table.in_units(computed_of(result))[row],
            _STYLES[k % len(_STYLES)],
            color=colour(k),
            lw=1.2,
        )
        if not read and table.stages == stages:
            draw_measured(axes, result, row, MEASURED, "o")
            read = True
    stage_ticks(axes, stages)
    axes.set_title(short(channel, 24))
    owner = next(result for result in results if channel in result.gauges.channels)
    gauge = owner.gauges.gauges[owner.gauges.channels.index(channel)]
    axes.set_ylabel(gauge_quantity(owner, gauge), fontsize=SMALL)
    axes.grid(axis="y")
