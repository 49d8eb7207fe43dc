"""How the ground moves: since the initial state, since the gauges were zeroed, in one stage."""

from __future__ import annotations

from functools import partial

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from geoident.model.arrays import Floats
from geoident.report.drawing.fields.panels import (
    TOP,
    ColouredField,
    add_lines,
    bands,
    contours,
    draw_gauge_lines,
    draw_lines,
    finish,
    on_sheet,
    panel_figure,
    shade,
    table_figure,
    weighted,
)
from geoident.report.drawing.labels import place_labels
from geoident.report.drawing.scene import Scene, Window, round_down
from geoident.report.drawing.sheets import Sheet, Trace
from geoident.report.drawing.style import (
    ACCENT,
    COMPUTED,
    GAUGE,
    LENGTHS,
    MM,
    SMALL,
    Picture,
    short,
)

_ARROW = 0.16  # longest arrow, of the width of a panel
_MOST_NAMES = 30


def motion_pictures(scene: Scene, sheet: Sheet, tag: str, where: str) -> tuple[Picture, ...]:
    """Displacements, the deformed shape, and vectors at the gauges, on one sheet.

    Args:
        scene: what is drawn.
        sheet: a section or an outside of it.
        tag: before the names of the pictures.
        where: behind their titles.
    """
    total = ColouredField("displacement (mm)", partial(displacement_size, scene), LENGTHS)
    words = f"Size of the displacement {scene.since}."
    found = [contours(scene, sheet, f"{tag}displacement", f"Displacement{where}", words, total)]
    if scene.n_states > 2:
        since = f"since {scene.stage(scene.zero_state)}"
        found.append(
            Picture(
                f"{tag}displacement-parts",
                f"Displacement {since} and of one stage{where}",
                f"Left: size and components {since}"
                + (", where most gauges were zeroed" if scene.zero_state else "")
                + ". Right: size of what the stage alone adds. Each column has its own colours. "
                "Where signs differ zero is dashed, and dots are on the negative side.",
                partial(parts_figure, scene, sheet),
            )
        )
    return (*found, _deformed_picture(scene, sheet, tag, where),
            _vector_picture(scene, sheet, tag, where))  # fmt: skip


def displacement_size(scene: Scene, sheet: Sheet, state: int, *, since: int = 0) -> Floats:
    """Length (n,) of the displacement at the n points of a sheet, mm.

    Args:
        scene: what is drawn.
        sheet: a section or an outside of it.
        state: number of the state.
        since: number of the state from which on it counts.
    """
    moved = sheet.of_nodes(scene.displacement(state, since=since))
    return np.asarray(MM * np.linalg.norm(moved, axis=1))


def parts_figure(scene: Scene, sheet: Sheet) -> Figure:
    """Size and components since the zero, and the size of the stage, at the key states.

    Args:
        scene: what is drawn.
        sheet: a section or an outside of it.
    """

    def since_zero(sheet: Sheet, state: int) -> Floats:
        zero = scene.zero_state if state > scene.zero_state else 0
        return MM * sheet.of_nodes(scene.displacement(state, since=zero))

    def of_stage(sheet: Sheet, state: int) -> Floats:
        moved = sheet.of_nodes(scene.displacement(state, since=scene.base(state)))
        return np.asarray(MM * np.linalg.norm(moved, axis=1))

    across, up = sheet.axes
    name = scene.axis_names
    columns = [
        ColouredField("size (mm)", lambda s, k: np.linalg.norm(since_zero(s, k), axis=1), LENGTHS),
        ColouredField(f"{name[across]} (mm)", lambda s, k: since_zero(s, k)[:, across], LENGTHS),
        ColouredField(f"{name[up]} (mm)", lambda s, k: since_zero(s, k)[:, up], LENGTHS),
        ColouredField("of the stage (mm)", of_stage, LENGTHS),
    ]
    return table_figure(scene, sheet, columns)


def _deformed_picture(scene: Scene, sheet: Sheet, tag: str, where: str) -> Picture:
    factor = scene.magnification(scene.window(sheet).size)
    return Picture(
        f"{tag}deformed",
        f"Deformed shape{where}, displacements {factor:g} times magnified",
        f"Colours and black lines: moved by the displacement {scene.since}, {factor:g} times "
        "magnified; the colour is its size. Orange: where the ground was.",
        lambda: deformed_figure(scene, sheet, factor),
    )


def deformed_figure(scene: Scene, sheet: Sheet, factor: float) -> Figure:
    """The moved ground in the colours of its displacement over its first outline.

    Args:
        scene: what is drawn.
        sheet: a section or an outside of it.
        factor: by which displacements are enlarged.
    """
    window = scene.window(sheet)
    states = scene.key_states
    figure, panels = panel_figure(scene, window, len(states), extra=0.9)
    sizes = [displacement_size(scene, sheet, state) for state in states]
    seen = [weighted(scene, sheet, s, window, v) for s, v in zip(states, sizes, strict=True)]
    scale = bands(np.hstack(seen), LENGTHS)
    shading = None
    for axes, state, size in zip(panels, states, sizes, strict=True):
        across = list(sheet.axes)
        moved = sheet.xy + factor * sheet.of_nodes(scene.displacement(state))[:, across]
        shading = shade(axes, scene, sheet, state, size, scale, xy=moved)
        borders, ground = scene.lines(sheet, state)
        add_lines(axes, scene, sheet, ground.at(scene.fields.mesh.points), color=ACCENT, lw=0.8)
        add_lines(axes, scene, sheet, _moved(scene, borders, state, factor), color="black", lw=0.4)
        add_lines(axes, scene, sheet, _moved(scene, ground, state, factor), color="black", lw=1.0)
        finish(axes, scene, sheet, window, state)
        axes.set_title(f"{axes.get_title(loc='left')}, x {factor:g}")
    if shading is not None:
        bar = figure.colorbar(
            shading, ax=panels, location="bottom", panchor=TOP, shrink=0.6, aspect=45
        )
        bar.set_label("displacement (mm)")
    return figure


def _moved(scene: Scene, trace: Trace, state: int, factor: float) -> Floats:
    return trace.at(scene.fields.mesh.points) + factor * trace.at(scene.displacement(state))


def _vector_picture(scene: Scene, sheet: Sheet, tag: str, where: str) -> Picture:
    only = " Points on the section only." if sheet.plane is not None else ""
    zero = scene.zero_state
    since = f"since {scene.stage(zero)}, where most gauges were zeroed" if zero else scene.since
    return Picture(
        f"{tag}vectors",
        f"Displacement vectors at the gauges{where}",
        f"Computed displacement of the points between which the gauges measure, {since}. "
        f"Lines: the gauges.{only}",
        lambda: vector_figure(scene, sheet),
    )


def vector_figure(scene: Scene, sheet: Sheet) -> Figure:
    """Arrows at the gauges, at the last fitted and the last stage, one scale for both.

    Args:
        scene: what is drawn.
        sheet: a section or an outside of it.
    """
    across = list(sheet.axes)
    states = scene.key_states
    points, motion = scene.gauge_motion
    keep = on_sheet(scene, sheet, points)
    zero = motion[scene.zero_state] if min(states) > scene.zero_state else 0.0 * motion[0]
    arrows = MM * (motion - np.nan_to_num(zero))[:, keep][:, :, across]
    xy = points[keep][:, across]
    sizes = np.linalg.norm(arrows[list(states)], axis=2)
    largest = float(np.nanmax(sizes, initial=0.0)) or 1.0
    window = scene.window(sheet)
    length = _ARROW * float(window.high[0] - window.low[0]) / largest
    window = _around(window, np.vstack([xy, *(xy + length * arrows[list(states)])]))
    figure, panels = panel_figure(scene, window, len(states), extra=0.5)
    for axes, state in zip(panels, states, strict=True):
        draw_lines(axes, scene, sheet, state, on_white=True)
        draw_gauge_lines(axes, scene, sheet)
        here = np.isfinite(arrows[state]).all(axis=1)
        tips = length * arrows[state, here]
        axes.quiver(*xy[here].T, *tips.T, angles="xy", scale_units="xy", scale=1.0,
                    color=COMPUTED, units="inches", width=0.016, zorder=4)  # fmt: skip
        _name_gauges(axes, scene, sheet, list(np.stack([xy[here], xy[here] + tips], axis=1)))
        finish(axes, scene, sheet, window, state)
        _draw_key(axes, round_down(largest), length)
    return figure


def _name_gauges(axes: Axes, scene: Scene, sheet: Sheet, arrows: list[Floats]) -> None:
    """Names of the gauges on a sheet, if they are not too many."""
    table = scene.result.gauges
    places: dict[str, list[Floats]] = {}
    for name, first, second in zip(table.gauges, table.first, table.second, strict=True):
        ends = np.array([end for end in (first, second) if np.isfinite(end).all()])
        if len(ends) and on_sheet(scene, sheet, ends).all():
            places.setdefault(name, []).append(ends[-1:, list(sheet.axes)])
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
    arrow = {"arrowstyle": "-|>", "color": COMPUTED, "lw": 1.2, "shrinkA": 0, "shrinkB": 0}
    axes.annotate("", xy=(1.0, 1.04), xytext=(1.0 - part, 1.04), xycoords="axes fraction",
                  textcoords="axes fraction", arrowprops=arrow, annotation_clip=False)  # fmt: skip
    axes.annotate(f"{size:g} mm ", xy=(1.0 - part, 1.04), xycoords="axes fraction", ha="right",
                  va="center", fontsize=SMALL, annotation_clip=False)  # fmt: skip
