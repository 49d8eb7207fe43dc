"""One figure for the eye: displacements around the gauges, and the gauges that moved most."""

from __future__ import annotations

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure, SubFigure
from matplotlib.patches import Patch

from geoident.model.results.result import Result
from geoident.report.drawing.fields.motion import displacement_size
from geoident.report.drawing.fields.panels import (
    bands,
    draw_gauge_lines,
    draw_lines,
    finish,
    shade,
    weighted,
)
from geoident.report.drawing.gauges.course import draw_computed, draw_measured
from geoident.report.drawing.scene import Scene
from geoident.report.drawing.style import (
    COMPUTED,
    LENGTHS,
    MEASURED,
    Picture,
    key,
    short,
    stage_ticks,
)

_PANELS = 6
_COLUMNS = 3
_WIDTH, _TALLEST = 7.4, 4.2  # of the figure, and of the field in it, inches


def overview_pictures(result: Result, scene: Scene | None) -> tuple[Picture, ...]:
    """The overview, if anything was computed."""
    if not _busiest(result):
        return ()
    return (
        Picture(
            "overview",
            "Displacements and gauges at a glance",
            f"{_since(scene)}The gauges that moved most in relation to their accuracy. "
            "Dots: measured; solid lines: computed; dashed lines with 95 % bands: predicted.",
            lambda: overview_figure(result, scene),
        ),
    )


def overview_figure(result: Result, scene: Scene | None) -> Figure:
    """Displacements after the last fitted stage, and below the gauges that moved most."""
    rows = _busiest(result)
    columns = min(len(rows), _COLUMNS)
    lines = -(-len(rows) // columns)
    below = 0.5 + 1.9 * lines
    gauge_part: Figure | SubFigure
    if scene is not None and scene.sheets:
        above = min(_TALLEST, _WIDTH * scene.window(scene.sheets[0]).aspect) + 0.9
        figure = Figure(figsize=(_WIDTH, above + below))
        parts = figure.subfigures(2, 1, height_ratios=[above, below], squeeze=False)
        _draw_field(parts[0, 0].subplots(), scene)
        gauge_part = parts[1, 0]
    else:
        gauge_part = figure = Figure(figsize=(_WIDTH, below))
    panels = gauge_part.subplots(lines, columns, sharex=True, squeeze=False).ravel()
    for axes, row in zip(panels, rows, strict=False):
        _draw_channel(axes, result, row)
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


def _since(scene: Scene | None) -> str:
    """What has to be known of the field, if there is one."""
    if scene is None or not scene.sheets or not 0 < scene.zero_state < scene.last_fitted:
        return ""
    return f"Above: since {scene.stage(scene.zero_state)}, where most gauges were zeroed. "


def _draw_channel(axes: Axes, result: Result, row: int) -> None:
    draw_computed(axes, result, row, COMPUTED)
    draw_measured(axes, result, row, MEASURED, "o")
    axes.set_title(short(result.gauges.channels[row], 24))
    axes.set_ylabel(result.gauges.shown_units[row])
    stage_ticks(axes, result.gauges.stages)
    axes.grid(axis="y")


def _draw_field(axes: Axes, scene: Scene) -> None:
    sheet, state = scene.sheets[0], scene.last_fitted
    window = scene.window(sheet)
    zero = scene.zero_state if scene.zero_state < state else 0
    size = displacement_size(scene, sheet, state, since=zero)
    scale = bands(weighted(scene, sheet, state, window, size), LENGTHS)
    shading = shade(axes, scene, sheet, state, size, scale)
    draw_lines(axes, scene, sheet, state)
    draw_gauge_lines(axes, scene, sheet)
    finish(axes, scene, sheet, window, state)
    where = f", section {sheet.plane}" if sheet.plane is not None else ""
    axes.set_title("")
    figure = axes.get_figure()
    assert figure is not None
    bar = figure.colorbar(shading, ax=axes, location="bottom", shrink=0.6, aspect=45)
    since = f"since {short(scene.stage(zero), 20)}" if zero else scene.since
    bar.set_label(f"displacement after {short(scene.stage(state), 20)}, {since} (mm){where}")


def _busiest(result: Result) -> list[int]:
    """Rows of the channels that moved most for their accuracy, one of each gauge."""
    table = result.gauges
    moved = np.abs(np.nan_to_num(table.computed)) / np.nan_to_num(table.sd, nan=1.0)
    gauges: dict[str, int] = {}
    for row in np.argsort(-moved.max(axis=1, initial=0.0), kind="stable"):
        if moved[row].max(initial=0.0) > 0:
            gauges.setdefault(table.gauges[row], int(row))
    return list(gauges.values())[:_PANELS]
