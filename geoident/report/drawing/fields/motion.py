"""How the ground moves: since the initial state, since the gauges were zeroed, in one stage."""

from __future__ import annotations

from functools import partial

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from geoident.model.arrays import Floats
from geoident.report.drawing.fields.panels import (
    ColouredField,
    add_lines,
    colour_bar,
    common_bands,
    contours,
    draw_gauge_lines,
    draw_lines,
    field_figure,
    finish,
    panel_figure,
    shade,
    table_figure,
)
from geoident.report.drawing.labels import place_labels
from geoident.report.drawing.scene import Scene, SheetView, Window, round_down
from geoident.report.drawing.sheets import Plane, Trace
from geoident.report.drawing.style import (
    ACCENT,
    COMPUTED,
    GAUGE,
    LENGTHS,
    MM,
    SMALL,
    Picture,
    arrow,
    short,
)

_ARROW = 0.16  # longest arrow, of the width of a panel
_MOST_NAMES = 30
_TOTAL = ColouredField("displacement (mm)", SheetView.displacement_size, LENGTHS, "mm")
_SAME_PLACE = 0.01  # of the length of the model


def displacement_pictures(view: SheetView) -> tuple[Picture, ...]:
    """Displacements stage by stage, and their components.

    Args:
        view: what is drawn.
    """
    scene = view.scene
    words = f"Size of the displacement {scene.since}; a cross marks the largest."
    every = contours(view, "displacement", "Displacement", words, _TOTAL)
    if scene.n_states <= 2:
        return (every,)
    since = f"since {scene.stage(scene.zero_state)}"
    parts = Picture(
        f"{view.tag}displacement-parts",
        f"Displacement {since} and of one stage{view.where}",
        f"Left: size and components {since}"
        + (", where most gauges were zeroed" if scene.zero_state else "")
        + ". Right: size of what the stage alone adds. Each column has its own colours. "
        "Where signs differ zero is dashed, and dots are on the negative side.",
        partial(parts_figure, view),
    )
    return every, parts


def largest_pictures(scene: Scene) -> tuple[Picture, ...]:
    """The section of a solid through its largest displacement, across the axis of the first one.

    None where that first section, which goes through gauges, goes through it already.
    """
    if not scene.solid or not scene.views or (first := scene.views[0].sheet.plane) is None:
        return ()
    moved = np.linalg.norm(scene.displacement(scene.key_states[-1]), axis=1)
    axis, (low, high) = first.axis, (corner[first.axis] for corner in scene.box)
    place = float(scene.fields.mesh.points[int(np.argmax(moved)), axis])
    inset = 1e-6 * (high - low)
    plane = Plane(axis, min(max(place, low + inset), high - inset))
    if abs(place - first.value) <= _SAME_PLACE * (high - low):
        return ()
    view = SheetView(scene, scene.section(plane), len(scene.views) + 1)
    return (
        Picture(
            "largest-displacement",
            f"Section through the largest displacement, {plane}",
            f"Size of the displacement {scene.since}; a cross marks the largest in the section.",
            lambda: field_figure(view, _TOTAL, scene.key_states),
        ),
    )


def parts_figure(view: SheetView) -> Figure:
    """Size and components since the zero, and the size of the stage, at the key states."""
    scene = view.scene

    def zero(state: int) -> int:
        return scene.zero_state if state > scene.zero_state else 0

    def component(axis: int, view: SheetView, state: int) -> Floats:
        return MM * view.sheet.of_nodes(scene.displacement(state, since=zero(state)))[:, axis]

    columns = [
        ColouredField("size (mm)", lambda v, k: v.displacement_size(k, since=zero(k)), LENGTHS),
        *(
            ColouredField(f"{scene.axis_names[axis]} (mm)", partial(component, axis), LENGTHS)
            for axis in view.across
        ),
        ColouredField(
            "of the stage (mm)", lambda v, k: v.displacement_size(k, since=scene.base(k)), LENGTHS
        ),
    ]
    return table_figure(view, columns)


def moved_pictures(view: SheetView) -> tuple[Picture, ...]:
    """The deformed shape, and vectors at the gauges.

    Args:
        view: what is drawn.
    """
    scene = view.scene
    factor = scene.magnification(view.window.size)
    only = " Points on the section only." if view.sheet.plane is not None else ""
    zero = scene.zero_state
    since = f"since {scene.stage(zero)}, where most gauges were zeroed" if zero else scene.since
    return (
        Picture(
            f"{view.tag}deformed",
            f"Deformed shape{view.where}, displacements {factor:g} times magnified",
            f"Colours and black lines: moved by the displacement {scene.since}, {factor:g} times "
            "magnified; the colour is its size. Orange: where the ground was.",
            partial(deformed_figure, view, factor),
        ),
        Picture(
            f"{view.tag}vectors",
            f"Displacement vectors at the gauges{view.where}",
            "Computed displacement of the points between which the gauges measure, "
            f"{since}. Lines: the gauges.{only}",
            partial(vector_figure, view),
        ),
    )


def deformed_figure(view: SheetView, factor: float) -> Figure:
    """The moved ground in the colours of its displacement over its first outline.

    Args:
        view: what is drawn.
        factor: by which displacements are enlarged.
    """
    scene, sheet, states = view.scene, view.sheet, view.scene.key_states
    points = scene.fields.mesh.points
    figure, panels = panel_figure(view, len(states), extra=0.9)
    sizes = [view.displacement_size(state) for state in states]
    scale = common_bands(view, states, sizes, LENGTHS)
    for axes, state, size in zip(panels, states, sizes, strict=True):
        motion = scene.displacement(state)
        xy = sheet.xy + factor * sheet.of_nodes(motion)[:, view.across]
        shading = shade(axes, view, state, size, scale, xy=xy)

        def moved(trace: Trace, motion: Floats = motion) -> Floats:
            return trace.at(points) + factor * trace.at(motion)

        borders, ground = view.lines(state)
        add_lines(axes, view, ground.at(points), color=ACCENT, lw=0.8)
        add_lines(axes, view, moved(borders), color="black", lw=0.4)
        add_lines(axes, view, moved(ground), color="black", lw=1.0)
        finish(axes, view, state)
        axes.set_title(f"{axes.get_title(loc='left')}, x {factor:g}")
    if states:
        colour_bar(figure, shading, panels, "displacement (mm)")
    return figure


def vector_figure(view: SheetView) -> Figure:
    """Arrows at the gauges, at the last fitted and the last stage, one scale for both."""
    scene, states = view.scene, view.scene.key_states
    points, motion = scene.gauge_motion
    keep = view.holds(points)
    zero = motion[scene.zero_state] if min(states) > scene.zero_state else 0.0 * motion[0]
    arrows = MM * (motion - np.nan_to_num(zero))[:, keep][:, :, view.across]
    xy = points[keep][:, view.across]
    sizes = np.linalg.norm(arrows[list(states)], axis=2)
    largest = float(np.nanmax(sizes, initial=0.0)) or 1.0
    window = view.window
    length = _ARROW * float(window.high[0] - window.low[0]) / largest
    window = _around(window, np.vstack([xy, *(xy + length * arrows[list(states)])]))
    figure, panels = panel_figure(view, len(states), extra=0.5, aspect=window.aspect)
    for axes, state in zip(panels, states, strict=True):
        draw_lines(axes, view, state, on_white=True)
        draw_gauge_lines(axes, view)
        here = np.isfinite(arrows[state]).all(axis=1)
        tips = length * arrows[state, here]
        axes.quiver(*xy[here].T, *tips.T, angles="xy", scale_units="xy", scale=1.0,
                    color=COMPUTED, units="inches", width=0.016, zorder=4)  # fmt: skip
        _name_gauges(axes, view, list(np.stack([xy[here], xy[here] + tips], axis=1)))
        finish(axes, view, state, window)
        _draw_key(axes, round_down(largest), length)
    return figure


def _name_gauges(axes: Axes, view: SheetView, arrows: list[Floats]) -> None:
    """Names of the gauges on a sheet, if they are not too many."""
    places: dict[str, list[Floats]] = {}
    for name, ends in view.gauges():
        places.setdefault(name, []).append(ends[-1:])
    if len(places) <= _MOST_NAMES:
        place_labels(axes, [np.vstack(ends) for ends in places.values()],
                     [short(name, 24) for name in places], avoid=arrows, colour=GAUGE)  # fmt: skip


def _around(window: Window, points: Floats) -> Window:
    """A window that holds points (k, 2) too, with room around those beyond it."""
    room = 0.02 * window.size
    known = points[np.isfinite(points).all(axis=1)]
    if not len(known):
        return window
    low, high = known.min(axis=0), known.max(axis=0)
    return Window(
        np.where(low < window.low + room, np.minimum(window.low, low - room), window.low),
        np.where(high > window.high - room, np.maximum(window.high, high + room), window.high),
    )


def _draw_key(axes: Axes, size: float, length: float) -> None:
    """An arrow of a round size above the right corner of the panel."""
    low, high = axes.get_xlim()
    part = size * length / (high - low)
    axes.annotate("", xy=(1.0, 1.04), xytext=(1.0 - part, 1.04), xycoords="axes fraction",
                  textcoords="axes fraction", arrowprops=arrow(COMPUTED, 1.2),
                  annotation_clip=False)  # fmt: skip
    axes.annotate(f"{size:g} mm ", xy=(1.0 - part, 1.04), xycoords="axes fraction", ha="right",
                  va="center", fontsize=SMALL, annotation_clip=False)  # fmt: skip
