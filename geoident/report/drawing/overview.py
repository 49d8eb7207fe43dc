"""One figure for the eye: displacements around the gauges, and gauges whose readings say most."""

from __future__ import annotations

from textwrap import wrap

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure, SubFigure
from matplotlib.patches import Patch
from matplotlib.ticker import MaxNLocator

from geoident.model.results.result import Result
from geoident.report.drawing.fields.panels import (
    common_bands,
    draw_gauge_lines,
    draw_lines,
    finish,
    mark_largest,
    shade,
)
from geoident.report.drawing.gauges.axis import stage_axis
from geoident.report.drawing.gauges.course import draw_computed, draw_measured
from geoident.report.drawing.scene import Scene, SheetView
from geoident.report.drawing.style import (
    COMPUTED,
    LENGTHS,
    MEASURED,
    WIDTH,
    Picture,
    key,
    short,
    stage_ticks,
)

_PANELS = 6
_TALLEST = 4.2  # of the field, inches
_BESIDE = 0.75  # height of the field by its width from which on the gauges stand beside it
_FIELD = (2.6, 3.5)  # least and largest width of the field with its axis, inches
_OVER, _UNDER = 2.6, 1.3  # heights of a field over gauges, and of a row of these, inches
_FEW, _HIGH, _LOW = 2, 1.9, 1.45  # so few rows of gauges are higher than more of them, inches
_LETTERS, _TICKS = 13, 1.6  # that find room below a field, an inch
_THREE_ACROSS = 5.6  # width from which on three gauges find room side by side, inches


def overview_pictures(result: Result, scene: Scene | None) -> tuple[Picture, ...]:
    """The overview, if anything was computed."""
    if not _busiest(result):
        return ()
    return (
        Picture(
            "overview",
            "Displacements and gauges at a glance",
            f"{_since(scene)}{_chosen(result)}"
            "Dots: measured; solid lines: computed; dashed lines with 95 % bands: predicted.",
            lambda: overview_figure(result, scene),
        ),
    )


def overview_figure(result: Result, scene: Scene | None) -> Figure:
    """Displacements after the last fitted stage, and beside or below the gauges that say most."""
    rows = _busiest(result)
    gauge_part: Figure | SubFigure
    if scene is not None and scene.views:
        view, aspect = scene.views[0], scene.views[0].window.aspect
        beside = aspect > _BESIDE
        left = float(np.clip(_TALLEST / aspect + 0.7, *_FIELD)) if beside else WIDTH
        columns, lines, height = _grid(len(rows), WIDTH - left if beside else WIDTH)
        height = height if beside else 0.7 + _UNDER * lines
        tall = min((left - 0.7) * aspect, _TALLEST if beside else _OVER) + 1.25
        size = max(height, tall) if beside else height + tall
        figure = Figure(figsize=(WIDTH, size))
        if beside:
            parts = figure.subfigures(1, 2, width_ratios=[left, WIDTH - left], squeeze=False)
        else:
            parts = figure.subfigures(2, 1, height_ratios=[tall, height], squeeze=False)
        field, gauge_part = parts.ravel()
        _draw_field(field.subplots(), view, left)
    else:
        columns, lines, height = _grid(len(rows), WIDTH)
        gauge_part = figure = Figure(figsize=(WIDTH, height))
    axis = None if result.gauges.times is None else stage_axis(result)
    panels = gauge_part.subplots(lines, columns, sharex=True, squeeze=False).ravel()
    for axes, row in zip(panels, rows, strict=False):
        draw_computed(axes, result, row, COMPUTED, axis)
        draw_measured(axes, result, row, MEASURED, "o", axis)
        axes.set_title(short(result.gauges.channels[row], 24))
        axes.set_ylabel(result.gauges.shown_units[row])
        if axis is None:
            stage_ticks(axes, result.gauges.stages)
        else:
            axis.finish(axes)
        axes.grid(axis="y")
    for k in range(len(rows), len(panels)):
        panels[k - columns].tick_params(labelbottom=True)
        panels[k].remove()
    handles = [
        key("measured", color=MEASURED, marker="o", ls="", ms=4),
        key("computed", color=COMPUTED),
        Patch(color=COMPUTED, alpha=0.22, lw=0, label="predicted, 95 %"),
    ]
    gauge_part.legend(handles=handles, loc="outside upper center", ncols=3)
    return figure


def _grid(n: int, width: float) -> tuple[int, int, float]:
    """Columns and rows of n gauges in a part of so many inches, and its height."""
    columns = min(n, 3 if width >= _THREE_ACROSS and n != 4 else 2)
    lines = -(-n // columns)
    return columns, lines, 0.7 + (_HIGH if lines <= _FEW else _LOW) * lines


def _since(scene: Scene | None) -> str:
    """What has to be known of the field, if there is one."""
    if scene is None or not scene.views or not 0 < scene.zero_state < scene.last_fitted:
        return ""
    return f"Field: since {scene.stage(scene.zero_state)}, where most gauges were zeroed. "


def _chosen(result: Result) -> str:
    """Which gauges are drawn, where these are not all."""
    shown, count = len(_busiest(result)), len(set(result.gauges.gauges))
    if shown == count:
        return ""
    return (
        f"Of {count} gauges the {shown} with the largest computed readings in standard deviations "
        "of their accuracy, each with its channel of the largest. "
    )


def _draw_field(axes: Axes, view: SheetView, width: float) -> None:
    """Displacements after the last fitted stage in a part of so many inches."""
    scene, state = view.scene, view.scene.last_fitted
    zero = scene.zero_state if scene.zero_state < state else 0
    size = view.displacement_size(state, since=zero)
    shading = shade(axes, view, state, size, common_bands(view, [state], [size], LENGTHS))
    draw_lines(axes, view, state)
    draw_gauge_lines(axes, view)
    finish(axes, view, state)
    mark_largest(axes, view, state, size, "mm")
    axes.set_title("")
    figure = axes.get_figure()
    assert figure is not None
    bar = figure.colorbar(shading, ax=axes, location="bottom", shrink=0.8, aspect=35)
    bar.ax.xaxis.set_major_locator(MaxNLocator(max(3, int(_TICKS * width))))
    since = f"since {short(scene.stage(zero), 20)}" if zero else scene.since
    words = f"displacement after {short(scene.stage(state), 20)}, {since} (mm){view.where}"
    bar.set_label("\n".join(wrap(words, int(_LETTERS * width))))


def _busiest(result: Result) -> list[int]:
    """Rows of the channels with the largest readings for their accuracy, one of each gauge."""
    table = result.gauges
    moved = np.abs(np.nan_to_num(table.computed)) / np.nan_to_num(table.sd, nan=1.0)
    gauges: dict[str, int] = {}
    for row in np.argsort(-moved.max(axis=1, initial=0.0), kind="stable"):
        if moved[row].max(initial=0.0) > 0:
            gauges.setdefault(table.gauges[row], int(row))
    return list(gauges.values())[:_PANELS]
