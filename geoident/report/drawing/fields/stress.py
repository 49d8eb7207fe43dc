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
)
from geoident.report.drawing.scene import SheetView, Window
from geoident.report.drawing.style import ACCENT, COMPUTED, STRESSES, Picture, key, stress_unit
from geoident.report.text.layout import number

_TENSION = "Tension is positive. The out-of-plane stress is included."
_CROSSES = 17  # along the longer side of a window
_FULL = 0.995  # share of crosses that keep to their cell


def stress_pictures(view: SheetView) -> tuple[Picture, ...]:
    """Largest and smallest compression stage by stage, and crosses; none without stresses."""
    if not np.isfinite(view.scene.fields.stress[1:]).any():
        return ()
    unit, size = _unit(view)
    pictures = []
    for which, name, words in (
        (0, "minimum", "the largest compression"),
        (2, "maximum", "the smallest compression, or tension"),
    ):
        label = f"{name} principal stress ({unit}, tension positive)"
        quantity = ColouredField(label, partial(_stress, which, size), STRESSES)
        text = f"The {name} principal stress is {words}. {_TENSION}"
        title = f"{name.capitalize()} principal stress"
        pictures.append(contours(view, f"stress-{name}", title, text, quantity))
    crosses = Picture(
        f"{view.tag}stress-crosses",
        f"Principal stresses{view.where}",
        "Crosses along the principal directions in the picture, as long as the stresses are large.",
        partial(cross_figure, view),
    )
    return (*pictures, crosses)


def _stress(which: int, size: float, view: SheetView, state: int) -> Floats:
    return view.stress(state, which) / size


def _unit(view: SheetView) -> tuple[str, float]:
    """The unit in which the stresses of a sheet are shown, and how many Pa it has."""
    ends = 0, int(view.scene.reached[-1])
    shown = np.hstack([view.weighted(state, view.stress(state, 0)) for state in ends])
    return stress_unit(float(np.quantile(np.abs(shown[0]), 0.9)) if shown.size else 0.0)


def cross_figure(view: SheetView) -> Figure:
    """Principal stresses in the plane of a sheet as crosses at evenly spread places."""
    states = view.scene.key_states
    figure, panels = panel_figure(view, len(states), extra=0.95)
    places, step = _spread(view.window)
    unit, size = _unit(view)
    crosses = [_crosses(view, state, places) for state in states]
    sizes = np.concatenate([np.abs(values).ravel() for _, values, _ in crosses])
    full = float(np.quantile(sizes, _FULL)) if sizes.size else 1.0
    for axes, state, (at, values, directions) in zip(panels, states, crosses, strict=True):
        draw_lines(axes, view, state, on_white=True)
        half = 0.46 * step * np.minimum(np.abs(values) / (full or 1.0), 1.3)
        arms = half[..., None] * directions
        ends = np.stack([at[:, None] - arms, at[:, None] + arms], axis=2).reshape(-1, 2, 2)
        pulled = (values > 0).ravel()
        for chosen, colour, width in ((~pulled, COMPUTED, 0.8), (pulled, ACCENT, 1.4)):
            axes.add_collection(LineCollection(list(ends[chosen]), colors=colour,
                                               linewidths=width), autolim=False)  # fmt: skip
        finish(axes, view, state)
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
        np.arange(low + min(step, high - low) / 2, high, step)  # a thin slice has one row
        for low, high in zip(window.low, window.high, strict=True)
    )
    return np.stack(np.meshgrid(x, y), axis=-1).reshape(-1, 2), step


def _crosses(view: SheetView, state: int, places: Floats) -> tuple[Floats, Floats, Floats]:
    """Places (m, 2) in the ground, principal stresses (m, 2), Pa, and directions (m, 2, 2)."""
    sites = view.sites(state, places)
    here = np.array([site is not None for site in sites], dtype=np.bool_)
    elements = np.array([site.element for site in sites if site is not None], dtype=np.int64)
    stress = view.scene.fields.stress[state, elements]
    across, up = view.across
    shear = {(0, 1): 3, (1, 2): 4, (0, 2): 5}[across, up]
    rows = [stress[:, [across, shear]], stress[:, [shear, up]]]
    values, vectors = np.linalg.eigh(np.stack(rows, axis=1))
    return places[here], values, np.swapaxes(vectors, 1, 2)
