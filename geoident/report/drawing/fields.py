"""Fields on a plane or on a cut: displacement, principal stress, yielding, deformed mesh, vectors.

Colours are in bands, so that a value can be read in print. Fields and lines of the mesh are images
inside the figure, letters are not.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np
from matplotlib import colormaps
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection
from matplotlib.colors import BoundaryNorm, Normalize
from matplotlib.figure import Figure
from matplotlib.patches import Patch
from matplotlib.ticker import MaxNLocator
from matplotlib.tri import Triangulation

from geoident.model.arrays import Floats
from geoident.report.drawing.scene import Scene, Window, round_down
from geoident.report.drawing.sheets import Sheet, Trace
from geoident.report.drawing.style import (
    COMPUTED,
    DIVERGING,
    FAINT,
    LENGTHS,
    MEASURED,
    MM,
    SMALL,
    STRESSES,
    Picture,
    hide_unused,
)

_WIDTH = 10.0
_BANDS = 12
_MPA = 1e-6
_ENDS = (0.005, 0.995)
_TENSION = "Tension is positive. The out-of-plane stress is included."


@dataclass(frozen=True)
class ColouredField:
    """Something that is shown in colours.

    Args:
        label: what it is, with its unit.
        at: its values (n,) at the points of a sheet in a state.
        colours: map from light for 0 to dark for large sizes.
    """

    label: str
    at: Callable[[Sheet, int], Floats]
    colours: str


def field_pictures(scene: Scene) -> tuple[Picture, ...]:
    """All figures of a sheet, for each of the sheets."""
    found: list[Picture] = []
    for number, sheet in enumerate(scene.sheets, start=1):
        tag = f"section-{number}-" if scene.solid else ""
        where = f", section {sheet.plane}" if sheet.plane is not None else ""
        found += _contour_pictures(scene, sheet, tag, where)
        found.append(_deformed_picture(scene, sheet, tag, where))
        found.append(_vector_picture(scene, sheet, tag, where))
    return tuple(found)


def _contour_pictures(scene: Scene, sheet: Sheet, tag: str, where: str) -> list[Picture]:
    total = f"Size of the displacement {scene.since}."
    displacement = ColouredField("displacement (mm)", partial(displacement_size, scene), LENGTHS)
    found = [
        _contours(scene, sheet, f"{tag}displacement", f"Displacement{where}", total, displacement)
    ]
    if np.isfinite(scene.fields.stress[1:]).any():
        for which, name, words in (
            (0, "minimum", "the largest compression"),
            (2, "maximum", "the smallest compression, or tension"),
        ):
            quantity = ColouredField(
                f"{name} principal stress (MPa, tension positive)",
                partial(_stress, scene, which),
                STRESSES,
            )
            text = f"The {name} principal stress is {words}. {_TENSION}"
            title = f"{name.capitalize()} principal stress{where}"
            found.append(_contours(scene, sheet, f"{tag}stress-{name}", title, text, quantity))
    if scene.fields.yielded.any():
        found.append(
            Picture(
                f"{tag}yielded",
                f"Yielded zones{where}",
                "Elements that have yielded up to this stage.",
                lambda: yielded_figure(scene, sheet),
            )
        )
    return found


def _contours(
    scene: Scene, sheet: Sheet, name: str, title: str, caption: str, quantity: ColouredField
) -> Picture:
    more = (
        f" {len(scene.states)} of {scene.n_states - 1} stages."
        if len(scene.states) < scene.n_states - 1
        else ""
    )
    return Picture(
        name,
        f"{title}, stage by stage",
        caption + more,
        lambda: contour_figure(scene, sheet, quantity),
    )


def displacement_size(scene: Scene, sheet: Sheet, state: int) -> Floats:
    """Length (n,) of the displacement at the n points of a sheet, mm.

    Args:
        scene: what is drawn.
        sheet: a section or an outside of it.
        state: number of the state.
    """
    return np.asarray(MM * np.linalg.norm(sheet.of_nodes(scene.displacement(state)), axis=1))


def _stress(scene: Scene, which: int, sheet: Sheet, state: int) -> Floats:
    return _MPA * scene.stress_at(sheet, state, which)


def contour_figure(scene: Scene, sheet: Sheet, quantity: ColouredField) -> Figure:
    """A quantity after every stage, one scale of colours for all.

    Args:
        scene: what is drawn.
        sheet: a section or an outside of it.
        quantity: at its points.
    """
    window = scene.window(sheet)
    figure, panels = panel_figure(scene, window, len(scene.states))
    values = [quantity.at(sheet, state) for state in scene.states]
    shown = [
        weighted(scene, sheet, state, window, value)
        for value, state in zip(values, scene.states, strict=True)
    ]
    scale = bands(np.hstack(shown), quantity.colours)
    shading = None
    for axes, state, value in zip(panels, scene.states, values, strict=True):
        shading = shade(axes, scene, sheet, state, value, scale)
        draw_lines(axes, scene, sheet, state)
        finish(axes, scene, sheet, window, state)
    if shading is not None:
        bar = figure.colorbar(shading, ax=panels, location="bottom", shrink=0.6, aspect=45)
        bar.set_label(quantity.label)
    return figure


def panel_figure(
    scene: Scene, window: Window, n: int, *, extra: float = 0.75
) -> tuple[Figure, list[Axes]]:
    """A figure with panels of the aspect of a window.

    Args:
        scene: what is drawn.
        window: what each panel shows.
        n: number of panels.
        extra: height beside the panels, inches.
    """
    columns = min(n, 2 if window.aspect < 0.45 else 3 if window.aspect < 1.6 else 4)
    rows = -(-n // columns)
    width = min(_WIDTH / columns, 6.0)
    height = rows * ((width - 0.45) * window.aspect + 0.32) + extra
    figure = Figure(figsize=(max(width * columns, 4.5), height), layout="compressed")
    panels = list(figure.subplots(rows, columns, squeeze=False).ravel())
    hide_unused(panels, n)
    for k, axes in enumerate(panels[:n]):
        axes.tick_params(labelbottom=k + columns >= n, labelleft=k % columns == 0)
    return figure, panels[:n]


def weighted(scene: Scene, sheet: Sheet, state: int, window: Window, value: Floats) -> Floats:
    """(2, m) means of a quantity on the present triangles inside the window, and their areas.

    Args:
        scene: what is drawn.
        sheet: a section or an outside of it.
        state: number of the state.
        window: what is shown.
        value: (n,) at the points of the sheet.
    """
    triangles = sheet.triangles[scene.fields.present[state][sheet.element]]
    corners = sheet.xy[triangles]
    centre = corners.mean(axis=1)
    inside = ((centre >= window.low) & (centre <= window.high)).all(axis=1)
    (ax, ay), (bx, by) = (corners[inside, k].T - corners[inside, 0].T for k in (1, 2))
    mean = value[triangles[inside]].mean(axis=1)
    known = np.isfinite(mean)
    return np.stack([mean, 0.5 * np.abs(ax * by - ay * bx)])[:, known]


def bands(shown: Floats, colours: str) -> dict[str, Any]:
    """Limits of the bands of colour, which ends are open, and the colours, as `tricontourf` wants.

    A few extreme values at corners must not take the whole scale: it ends where less than half a
    percent of the area lies beyond. Dark is far from zero. Where a good part lies on each side of
    zero, each side has its hue.

    Args:
        shown: (2, m) values and their weights.
        colours: the map, light to dark.
    """
    low, high = _ends(shown)
    levels = MaxNLocator(_BANDS, steps=[1, 2, 2.5, 5, 10]).tick_values(low, high)
    low, high = float(levels[0]), float(levels[-1])
    known = shown[0] if shown.size else np.zeros(1)
    below, above = bool(known.min() < low), bool(known.max() > high)
    ends = {(True, False): "min", (False, True): "max", (True, True): "both"}
    scale: dict[str, Any] = {"levels": levels, "extend": ends.get((below, above), "neither")}
    if low < 0 < high and min(-low, high) > 0.15 * max(-low, high):
        reach = max(-low, high)
        return {**scale, "cmap": colormaps[DIVERGING], "norm": Normalize(-reach, reach)}
    shades = colormaps[colours if high > -low else f"{colours}_r"]
    return {**scale, "cmap": shades, "norm": BoundaryNorm(levels, shades.N, extend=scale["extend"])}


def _ends(shown: Floats) -> tuple[float, float]:
    """Where the scale begins and ends."""
    if not shown.size:
        return 0.0, 1.0
    order = np.argsort(shown[0], kind="stable")
    value, share = shown[0, order], np.cumsum(shown[1, order])
    places = np.searchsorted(share, np.array(_ENDS) * share[-1])
    low, high = value[np.minimum(places, len(value) - 1)]
    low = 0.0 if value[0] >= 0 else float(low)
    return low, max(float(high), low + 1e-6 * max(abs(low), 1.0))


def shade(
    axes: Axes, scene: Scene, sheet: Sheet, state: int, value: Floats, scale: dict[str, Any]
) -> Any:
    """Colour the present part of a sheet by values at its points.

    Args:
        axes: where to draw.
        scene: what is drawn.
        sheet: a section or an outside of it.
        state: number of the state.
        value: (n,) at the points of the sheet.
        scale: of `bands`.
    """
    triangles = sheet.triangles[scene.fields.present[state][sheet.element]]
    known = np.isfinite(value[triangles]).all(axis=1)
    ground = Triangulation(sheet.xy[:, 0], sheet.xy[:, 1], triangles[known])
    shading = axes.tricontourf(ground, np.nan_to_num(value), **scale)
    shading.set_rasterized(True)
    return shading


def draw_lines(axes: Axes, scene: Scene, sheet: Sheet, state: int) -> None:
    """Where the ground ends, and faintly where groups meet.

    Args:
        axes: where to draw.
        scene: what is drawn.
        sheet: a section or an outside of it.
        state: number of the state.
    """
    points = scene.fields.mesh.points
    borders = sheet.borders(scene.borders_label(state))
    _add_lines(axes, sheet, borders.at(points), color="white", lw=0.3, alpha=0.6)
    outline = sheet.outline(scene.fields.present[state])
    _add_lines(axes, sheet, outline.at(points), color="black", lw=0.7)


def _add_lines(axes: Axes, sheet: Sheet, ends: Floats, **style: Any) -> None:
    """Line segments (k, 2, dim), as an image: there may be thousands."""
    axes.add_collection(
        LineCollection(list(ends[:, :, list(sheet.axes)]), rasterized=True, **style),
        autolim=False,
    )


def finish(axes: Axes, scene: Scene, sheet: Sheet, window: Window, state: int) -> None:
    """Title, limits, equal scales and names of the axes.

    Args:
        axes: where to draw.
        scene: what is drawn.
        sheet: a section or an outside of it.
        window: what is shown.
        state: number of the state.
    """
    axes.set_title(scene.title(state))
    axes.set_aspect("equal")
    axes.set_xlim(window.low[0], window.high[0])
    axes.set_ylim(window.low[1], window.high[1])
    across, up = sheet.axes
    ticks = axes.xaxis.get_tick_params(), axes.yaxis.get_tick_params()
    axes.set_xlabel(f"{scene.axis_names[across]} (m)" if ticks[0].get("labelbottom", True) else "")
    axes.set_ylabel(f"{scene.axis_names[up]} (m)" if ticks[1].get("labelleft", True) else "")
    axes.xaxis.set_major_locator(MaxNLocator(4))
    axes.yaxis.set_major_locator(MaxNLocator(5))


def yielded_figure(scene: Scene, sheet: Sheet) -> Figure:
    """Which elements have yielded after every stage."""
    window = scene.window(sheet)
    figure, panels = panel_figure(scene, window, len(scene.states))
    for axes, state in zip(panels, scene.states, strict=True):
        keep = scene.fields.present[state][sheet.element]
        flags = scene.fields.yielded[state][sheet.element[keep]].astype(float)
        ground = Triangulation(sheet.xy[:, 0], sheet.xy[:, 1], sheet.triangles[keep])
        shades = axes.tripcolor(ground, facecolors=flags, cmap="Oranges", vmin=-0.1, vmax=1.3)
        shades.set_rasterized(True)
        draw_lines(axes, scene, sheet, state)
        finish(axes, scene, sheet, window, state)
    colours = colormaps["Oranges"]
    handles = [
        Patch(color=colours(1.1 / 1.4), label="yielded"),
        Patch(facecolor=colours(0.1 / 1.4), edgecolor=FAINT, label="elastic"),
    ]
    figure.legend(handles=handles, loc="outside upper center", ncols=2)
    return figure


def _deformed_picture(scene: Scene, sheet: Sheet, tag: str, where: str) -> Picture:
    factor = scene.magnification(scene.window(sheet).size)
    return Picture(
        f"{tag}deformed",
        f"Deformed mesh{where}, displacements {factor:g} times magnified",
        f"Blue and black: moved by the displacement {scene.since}, "
        f"{factor:g} times magnified. Orange: initial outline.",
        lambda: deformed_figure(scene, sheet, factor),
    )


def deformed_figure(scene: Scene, sheet: Sheet, factor: float) -> Figure:
    """Edges of the elements before and after, at the last fitted and the last stage.

    Args:
        scene: what is drawn.
        sheet: a section or an outside of it.
        factor: by which displacements are enlarged.
    """
    window = scene.window(sheet)
    figure, panels = panel_figure(scene, window, len(scene.key_states), extra=0.5)
    for axes, state in zip(panels, scene.key_states, strict=True):
        edges = sheet.edges(scene.fields.present[state])
        ground = sheet.outline(scene.fields.present[state])
        _add_lines(axes, sheet, _moved(scene, edges, state, factor), color=COMPUTED, lw=0.4)
        _add_lines(axes, sheet, _moved(scene, ground, state, factor), color="black", lw=0.9)
        _add_lines(axes, sheet, ground.at(scene.fields.mesh.points), color=MEASURED, lw=0.8)
        finish(axes, scene, sheet, window, state)
        axes.set_title(f"{axes.get_title(loc='left')}, x {factor:g}")
    return figure


def _moved(scene: Scene, trace: Trace, state: int, factor: float) -> Floats:
    return trace.at(scene.fields.mesh.points) + factor * trace.at(scene.displacement(state))


def _vector_picture(scene: Scene, sheet: Sheet, tag: str, where: str) -> Picture:
    only = " Points on the section only." if sheet.plane is not None else ""
    return Picture(
        f"{tag}vectors",
        f"Displacement vectors at the gauges{where}",
        "Computed displacement of the points between which the gauges measure, "
        f"{scene.since}. Lines: the gauges.{only}",
        lambda: vector_figure(scene, sheet),
    )


def vector_figure(scene: Scene, sheet: Sheet) -> Figure:
    """Arrows at the gauges, at the last fitted and the last stage, one scale for both."""
    window = scene.window(sheet)
    figure, panels = panel_figure(scene, window, len(scene.key_states), extra=0.5)
    points, motion = scene.gauge_motion
    keep = _on_sheet(scene, sheet, points)
    xy, arrows = points[keep][:, list(sheet.axes)], MM * motion[:, keep][:, :, list(sheet.axes)]
    sizes = np.linalg.norm(arrows[list(scene.key_states)], axis=2)
    largest = float(np.nanmax(sizes, initial=0.0)) or 1.0
    for axes, state in zip(panels, scene.key_states, strict=True):
        draw_lines(axes, scene, sheet, state)
        draw_gauge_lines(axes, scene, sheet)
        here = np.isfinite(arrows[state]).all(axis=1)
        shown = axes.quiver(
            *xy[here].T,
            *arrows[state, here].T,
            angles="xy",
            scale_units="width",
            scale=largest / 0.14,
            color=COMPUTED,
            width=0.005,
            zorder=3,
        )
        finish(axes, scene, sheet, window, state)
        key = round_down(largest)
        axes.quiverkey(
            shown,
            0.86,
            1 + 0.12 / _panel_height(figure, panels),
            key,
            f"{key:g} mm",
            labelpos="W",
            fontproperties={"size": SMALL},
        )
    return figure


def _panel_height(figure: Figure, panels: list[Axes]) -> float:
    """About how high a panel is, inches."""
    grid = panels[0].get_gridspec()
    return figure.get_figheight() / (grid.nrows if grid is not None else 1) - 0.6


def draw_gauge_lines(axes: Axes, scene: Scene, sheet: Sheet) -> None:
    """The gauges as lines between their points, as far as they lie on the sheet.

    Args:
        axes: where to draw.
        scene: what is drawn.
        sheet: a section or an outside of it.
    """
    table = scene.result.gauges
    for first, second in zip(table.first, table.second, strict=True):
        ends = np.array([end for end in (first, second) if np.isfinite(end).all()])
        if len(ends) and _on_sheet(scene, sheet, ends).all():
            axes.plot(*ends[:, list(sheet.axes)].T, "-o", color=MEASURED, lw=0.8, ms=2.2)


def _on_sheet(scene: Scene, sheet: Sheet, points: Floats) -> Any:
    """Which points (k, dim) lie on a sheet, within a hundredth of the model's size."""
    if sheet.plane is None:
        return np.ones(len(points), dtype=bool)
    near = 1e-2 * float((scene.box[1] - scene.box[0]).max())
    return np.abs(points[:, sheet.plane.axis] - sheet.plane.value) <= near
