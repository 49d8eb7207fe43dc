"""Constants that vary from place to place: their values, how well known, and where readings see."""

from __future__ import annotations

from functools import partial
from typing import Any

import numpy as np
from matplotlib import colormaps
from matplotlib.colors import BoundaryNorm
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator
from matplotlib.tri import Triangulation

from geoident.model.arrays import Floats
from geoident.model.results.varied import FieldEstimate
from geoident.report.drawing.fields.panels import draw_gauge_lines, draw_lines, finish, panel_figure
from geoident.report.drawing.scene import Scene
from geoident.report.drawing.sheets import Sheet
from geoident.report.drawing.style import Picture
from geoident.units import in_unit, shown_unit

_VALUES, _DEVIATIONS, _SEEN = "viridis", "Oranges", "Blues"
_BANDS = 10

_OF_FIELD = (
    "Median of the values; standard deviation of their logarithm, about that of the values in "
    "parts; and how much of the variance that the field had before, with the measured values, the "
    "readings take away: where it is 0 they do not see the ground. Lines: the gauges."
)
_OF_GROWTH = (
    "The values, which grow with depth or with the stress in situ; and their standard deviation in "
    "parts, as the parameters of the growth are known. Lines: the gauges."
)


def varied_pictures(scene: Scene) -> tuple[Picture, ...]:
    """One figure for each field and sheet of a scene."""
    return tuple(
        Picture(
            f"field-{found.name.replace('.', '-')}{f'-section-{n}' if scene.solid else ''}",
            f"Field {found.name}{f', section {sheet.plane}' if sheet.plane is not None else ''}",
            _OF_FIELD if found.modes else _OF_GROWTH,
            partial(varied_figure, scene, sheet, found),
        )
        for found in scene.result.varied
        for n, sheet in enumerate(scene.sheets, start=1)
        if np.isin(sheet.element, found.elements).any()
    )


def varied_figure(scene: Scene, sheet: Sheet, found: FieldEstimate) -> Figure:
    """Value, deviation and variance reduction of a field side by side, in the initial state.

    Args:
        scene: what is drawn.
        sheet: the section, or a cut.
        found: the field.
    """
    window = scene.window(sheet)
    factor = in_unit(1.0, found.unit, found.dimension)
    unit = shown_unit(found.unit, found.dimension)
    every = (
        (f"{found.constant} ({unit})" if unit else found.constant, factor * found.values, _VALUES),
        ("standard deviation (%)", 100 * found.sd, _DEVIATIONS),
        ("variance reduction (%)", 100 * found.reduction, _SEEN),
    )
    shown = every if found.modes else every[:2]  # what grows by a law has no variance to reduce
    figure, panels = panel_figure(scene, window, len(shown))
    for axes, (label, values, colours) in zip(panels, shown, strict=True):
        shading = _shade(axes, scene, sheet, found, values, colours)
        draw_lines(axes, scene, sheet, 0)
        draw_gauge_lines(axes, scene, sheet)
        finish(axes, scene, sheet, window, 0)
        axes.set_title(label)
        if shading is not None:
            figure.colorbar(shading, ax=axes, location="bottom", shrink=0.9, aspect=25)
    return figure


def _shade(
    axes: Any, scene: Scene, sheet: Sheet, found: FieldEstimate, values: Floats, colours: str
) -> Any:
    """The elements of the field in the colours of their values; None where nothing is known."""
    every = np.full(scene.fields.mesh.n_elements, np.nan)
    every[found.elements] = values
    here = scene.fields.present[0] if scene.fields.present[0].any() else np.ones_like(every, bool)
    kept = here[sheet.element] & np.isfinite(every[sheet.element])
    if not kept.any():
        return None
    low, high = float(np.nanmin(values)), float(np.nanmax(values))
    levels = MaxNLocator(_BANDS).tick_values(low, high if high > low else low + 1e-6 + abs(low))
    ground = Triangulation(sheet.xy[:, 0], sheet.xy[:, 1], sheet.triangles[kept])
    shading = axes.tripcolor(
        ground,
        facecolors=every[sheet.element[kept]],
        cmap=colormaps[colours],
        norm=BoundaryNorm(levels, colormaps[colours].N),
    )
    shading.set_rasterized(True)
    return shading
