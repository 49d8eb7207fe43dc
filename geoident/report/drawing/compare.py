"""Several results in one figure: the same gauges, the same parameters."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from geoident.model.result import Result
from geoident.report.drawing.parameters import parameter_figure
from geoident.report.drawing.readings import MM, draw_measured, unknown
from geoident.report.drawing.style import (
    COLOURS,
    FAINT,
    Picture,
    hide_unused,
    short,
    stage_ticks,
)

_PER_FIGURE = 15
_COLUMNS = 3
_STYLES = ("-", "--", "-.", ":")

Named = Sequence[tuple[str, Result]]


def comparison_pictures(results: Named) -> tuple[Picture, ...]:
    """Parameters and gauges of several results, one over the other."""
    return (*_parameter_pictures(results), *_gauge_pictures(results))


def _parameter_pictures(results: Named) -> tuple[Picture, ...]:
    if not any(result.parameters.names for _, result in results):
        return ()
    tables = [(label, result.parameters) for label, result in results]
    return (
        Picture(
            "compared-parameters",
            "Parameters side by side",
            "Bounds, prior and start are those of the first result that has the parameter.",
            lambda: parameter_figure(tables),
        ),
    )


def _gauge_pictures(results: Named) -> tuple[Picture, ...]:
    channels = list(dict.fromkeys(c for _, result in results for c in result.gauges.channels))
    parts = [channels[k : k + _PER_FIGURE] for k in range(0, len(channels), _PER_FIGURE)]
    return tuple(
        Picture(
            f"compared-gauges-{n}",
            f"Gauges side by side ({part[0]} to {part[-1]})",
            "Computed and predicted lines of every result; dots are the readings of the first one.",
            lambda part=part: gauges_figure(results, part),  # type: ignore[misc]
        )
        for n, part in enumerate(parts, start=1)
    )


def gauges_figure(results: Named, channels: Sequence[str]) -> Figure:
    """A panel for each channel."""
    columns = min(_COLUMNS, len(channels))
    rows = -(-len(channels) // columns)
    figure = Figure(figsize=(3.4 * columns if columns > 1 else 5.0, 2.2 * rows + 0.8))
    panels = list(figure.subplots(rows, columns, squeeze=False).ravel())
    for axes, channel in zip(panels, channels, strict=False):
        _draw_channel(axes, results, channel)
    hide_unused(panels, len(channels))
    handles = [
        Line2D(
            [],
            [],
            color=COLOURS[k % len(COLOURS)],
            ls=_STYLES[k % len(_STYLES)],
            label=short(label, 30),
        )
        for k, (label, _) in enumerate(results)
    ]
    handles.append(Line2D([], [], color=FAINT, marker="o", ls="", ms=4, label="measured"))
    figure.legend(handles=handles, loc="outside upper center", ncols=4)
    return figure


def _draw_channel(axes: Axes, results: Named, channel: str) -> None:
    stages = tuple(dict.fromkeys(s for _, result in results for s in result.gauges.stages))
    read = False
    for k, (_, result) in enumerate(results):
        table = result.gauges
        if channel not in table.channels:
            continue
        row = table.channels.index(channel)
        x = [stages.index(stage) for stage in table.stages]
        computed = np.where(unknown(result)[row], np.nan, MM * table.computed[row])
        axes.plot(x, computed, _STYLES[k % len(_STYLES)], color=COLOURS[k % len(COLOURS)], lw=1.2)
        if not read and table.stages == stages:
            draw_measured(axes, table, row, FAINT, "o")
            read = True
    stage_ticks(axes, stages)
    axes.set_title(short(channel, 24))
    axes.set_ylabel("reading (mm)")
    axes.grid(axis="y")
