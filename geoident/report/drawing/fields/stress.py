"""Stresses: principal values in colours, principal directions as crosses."""

from __future__ import annotations

from functools import partial

import numpy as np
from matplotlib.collections import LineCollection
from matplotlib.figure import Figure

from geoident.model.arrays import Floats
from geoident.report.drawing.fields.panels import (
    ColouredField,
    contours,
    draw_lines,
    finish,
    panel_figure,
    weighted,
)
from geoident.report.drawing.scene import Scene, Window
from geoident.report.drawing.sheets import Sheet
from geoident.report.drawing.style import ACCENT, COMPUTED, STRESSES, Picture, key
from geoident.report.text.layout import number

_TENSION = "Tension is positive. The out-of-plane stress is included."
_CROSSES = 17  # along the longer side of a window
_SOIL = 1e6  # stresses below, Pa, are shown in kPa
_FULL = 0.995  # share of crosses that keep to their cell


def stress_pictures(scene: Scene, sheet: Sheet, tag: str, where: str) -> tuple[Picture, ...]:
    """Largest and smallest compression stage by stage, and crosses; none without stresses.

    Args:
        scene: what is drawn.
        sheet: a section or an outside of it.
        tag: before the names of the pictures.
        where: behind their titles.
    """
    if not np.isfinite(scene.fields.stress[1:]).any():
        return ()
    size, unit = stress_unit(scene, sheet)
    found = []
    for which, name, words in (
        (0, "minimum", "the largest compression"),
        (2, "maximum", "the smallest compression, or tension"),
    ):
        quantity = ColouredField(
            f"{name} principal stress ({unit}, tension positive)",
            partial(_stress, scene, which, size),
            STRESSES,
        )
        text = f"The {name} principal stress is {words}. {_TENSION}"
        title = f"{name.capitalize()} principal stress{where}"
        found.append(contours(scene, sheet, f"{tag}stress-{name}", title, text, quantity))
    found.append(
        Picture(
            f"{tag}stress-crosses",
            f"Principal stresses{where}",
            "Crosses along the principal directions in the picture, as long as the stresses are "
            "large.",
            partial(cross_figure, scene, sheet),
        )
    )
    return tuple(found)


def stress_unit(scene: Scene, sheet: Sheet) -> tuple[float, str]:
    """The unit in which the stresses of a sheet are shown, Pa, and its name: kPa in soils."""
    window = scene.window(sheet)
    shown = weighted(scene, sheet, 0, window, scene.stress_at(sheet, 0, 0))
    last = int(scene.reached[-1])
    shown = np.hstack(
        [shown, weighted(scene, sheet, last, window, scene.stress_at(sheet, last, 0))]
    )
    typical = float(np.quantile(np.abs(shown[0]), 0.9)) if shown.size else 0.0
    return (1e3, "kPa") if typical < _SOIL else (1e6, "MPa")


def _stress(scene: Scene, which: int, unit: float, sheet: Sheet, state: int) -> Floats:
    return np.asarray(scene.stress_at(sheet, state, which) / unit)


def cross_figure(scene: Scene, sheet: Sheet) -> Figure:
    """Principal stresses in the plane of a sheet as crosses at evenly spread places.

    Args:
        scene: what is drawn.
        sheet: a section or an outside of it.
    """
    window = scene.window(sheet)
    states = scene.key_states
    figure, panels = panel_figure(scene, window, len(states), extra=0.95)
    places, step = _spread(window)
    size, unit = stress_unit(scene, sheet)
    crosses = [_crosses(scene, sheet, state, places) for state in states]
    sizes = np.concatenate([np.abs(values).ravel() for _, values, _ in crosses])
    full = float(np.quantile(sizes, _FULL)) if sizes.size else 1.0
    for axes, state, (at, values, directions) in zip(panels, states, crosses, strict=True):
        draw_lines(axes, scene, sheet, state, on_white=True)
        half = 0.46 * step * np.minimum(np.abs(values) / (full or 1.0), 1.3)
        arms = half[..., None] * directions
        ends = np.stack([at[:, None] - arms, at[:, None] + arms], axis=2).reshape(-1, 2, 2)
        pulled = (values > 0).ravel()
        for chosen, colour, width in ((~pulled, COMPUTED, 0.8), (pulled, ACCENT, 1.4)):
            axes.add_collection(LineCollection(list(ends[chosen]), colors=colour,
                                               linewidths=width), autolim=False)  # fmt: skip
        finish(axes, scene, sheet, window, state)
    handles = [
        key(f"compression, {number(full / size, 2)} {unit} as long as the crosses are apart",
            color=COMPUTED, lw=1.0),
        key("tension", color=ACCENT, lw=1.4),
    ]  # fmt: skip
    figure.legend(handles=handles, loc="outside lower center", ncols=2)
    return figure


def _spread(window: Window) -> tuple[Floats, float]:
    """Places (k, 2) all over a window, and how far they are apart, m."""
    step = window.size / _CROSSES
    x, y = (
        np.arange(low + step / 2, high, step)
        for low, high in zip(window.low, window.high, strict=True)
    )
    return np.stack(np.meshgrid(x, y), axis=-1).reshape(-1, 2), step


def _crosses(
    scene: Scene, sheet: Sheet, state: int, places: Floats
) -> tuple[Floats, Floats, Floats]:
    """Places (m, 2) in the ground, principal stresses (m, 2), Pa, and directions (m, 2, 2)."""
    sites = scene.sites(sheet, state, places)
    here = np.array([site is not None for site in sites])
    stress = scene.fields.stress[state, [site.element for site in sites if site is not None]]
    across, up = sheet.axes
    shear = {(0, 1): 3, (1, 2): 4, (0, 2): 5}[across, up]
    rows = [stress[:, [across, shear]], stress[:, [shear, up]]]
    values, vectors = np.linalg.eigh(np.stack(rows, axis=1))
    return places[here], values, np.swapaxes(vectors, 1, 2)
