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
from geoident.report.drawing.scene import Scene, SheetView
from geoident.report.drawing.style import Picture, labelled
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
            f"field-{field.name.replace('.', '-')}{f'-section-{n}' if scene.solid else ''}",
            f"Field {field.name}{view.where}",
            _OF_FIELD if field.modes else _OF_GROWTH,
            partial(varied_figure, view, field),
        )
        for field in scene.result.varied
        for n, view in enumerate(scene.views, start=1)
        if np.isin(view.sheet.element, field.elements).any()
    )


def varied_figure(view: SheetView, field: FieldEstimate) -> Figure:
    """Value, deviation and variance reduction of a field side by side, in the initial state."""
    factor = in_unit(1.0, field.unit, field.dimension)
    name = labelled(field.constant, shown_unit(field.unit, field.dimension))
    every = (
        (name, factor * field.values, _VALUES),
        ("standard deviation (%)", 100 * field.sd, _DEVIATIONS),
        ("variance reduction (%)", 100 * field.reduction, _SEEN),
    )
    shown = every if field.modes else every[:2]  # what grows by a law has no variance to reduce
    figure, panels = panel_figure(view, len(shown))
    for axes, (label, values, colours) in zip(panels, shown, strict=True):
        shading = _shade(axes, view, field, values, colours)
        draw_lines(axes, view, 0)
        draw_gauge_lines(axes, view)
        finish(axes, view, 0)
        axes.set_title(label)
        if shading is not None:
            figure.colorbar(shading, ax=axes, location="bottom", shrink=0.9, aspect=25)
    return figure


def _shade(axes: Any, view: SheetView, field: FieldEstimate, values: Floats, colours: str) -> Any:
    """The elements of the field in the colours of their values; None where nothing is known."""
    fields, sheet = view.scene.fields, view.sheet
    every = np.full(fields.mesh.n_elements, np.nan)
    every[field.elements] = values
    here = fields.present[0] if fields.present[0].any() else np.ones_like(every, bool)
    kept = here[sheet.element] & np.isfinite(every[sheet.element])
    if not kept.any():
        return None
    low, high = float(np.nanmin(values)), float(np.nanmax(values))
    levels = MaxNLocator(_BANDS).tick_values(low, high if high > low else low + 1e-6 + abs(low))
    return axes.tripcolor(
        Triangulation(sheet.xy[:, 0], sheet.xy[:, 1], sheet.triangles[kept]),
        facecolors=every[sheet.element[kept]],
        cmap=colours,
        norm=BoundaryNorm(levels, colormaps[colours].N),
        rasterized=True,
    )
