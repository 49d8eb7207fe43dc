"""A model in the plane: supports, loads, structures and gauges, each with its name."""

from __future__ import annotations

from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import PathCollection
from matplotlib.figure import Figure
from matplotlib.path import Path
from matplotlib.patheffects import withStroke
from matplotlib.ticker import MaxNLocator

from geoident.model.arrays import Bools, Floats
from geoident.model.case import Case
from geoident.report.drawing.labels import place_labels
from geoident.report.drawing.lines import add_segments
from geoident.report.drawing.model.actions import LOAD, WATER, draw_supports, water_levels
from geoident.report.drawing.model.construction import marked_places
from geoident.report.drawing.model.drawn import DrawnModel
from geoident.report.drawing.sheets import Sheet
from geoident.report.drawing.space import Box
from geoident.report.drawing.structures import draw_structures
from geoident.report.drawing.style import ACCENT, GAUGE, key, short

WIDTH = 7.2
LETTERS = 8.0
"""Of names in the picture, points: they must be read on a telephone too."""

_RIM = 0.04  # around what is drawn, of its larger side
_ARROW = 0.09  # longest arrow of a load, of the larger side of a panel
_EDGE = (0.25, 0.25, 0.25)
_MESH = (0.2, 0.2, 0.2, 0.3)
_LEAST_ELEMENT = 4.0  # size from which on elements are drawn, points
_TALLEST = 6.2
_TALLEST_CLOSER, _TALLEST_WHOLE = 5.4, 2.8  # of a closer view, and of the whole over it, inches
_MOVES: dict[str, Any] = {"marker": "o", "ms": 3.0}
_GAUGE_MARKS: dict[str, dict[str, Any]] = {
    "stress": {"marker": "P", "ms": 5.0},
    "pressure-cell": {"marker": "D", "ms": 4.0},
    "piezometer": {"marker": "v", "ms": 5.0},
    "thermometer": {"marker": "^", "ms": 5.0},
    "load-cell": {"marker": "s", "ms": 4.0},
    "strain": {"marker": ".", "ms": 4.0},
}
"""Marks of gauges that read something else than motions."""
_FIBRE = 20
"""Channels of a gauge above which their marks are small."""


def plane_figure(model: DrawnModel) -> Figure:
    """The whole model, and the part with the gauges closer where it is small.

    Args:
        model: what is drawn.
    """
    sheet = model.maker.flat()
    whole = _with_loads(model, model.box)
    figure = Figure()
    if not model.has_closer:
        size = _panel_size(whole, 0.9 * WIDTH, _TALLEST)
        handles = len(model.legend()) + 9
        heights = [size[1], 0.17 * max(handles / 2, len(model.stage_keys()) + 1)]
        figure.set_size_inches(WIDTH, sum(heights) + 1.1)
        main, below = figure.subplots(2, 1, height_ratios=heights)
        meanings = _draw_panel(main, model, sheet, whole, names=True, width=size[0])
        draw_legend(below, model, meanings, columns=2)
    else:
        closer = _with_loads(model, model.near)
        first, main, legend, widths = _two_views(figure, whole, closer)
        meanings = _draw_panel(first, model, sheet, whole, names=False, width=widths[0])
        low, high = model.near
        frame = np.array([low, [high[0], low[1]], high, [low[0], high[1]], low])
        first.plot(*frame.T, color="black", lw=0.9, ls=":", zorder=7)
        first.set_title("the whole model")
        more = _draw_panel(main, model, sheet, closer, names=True, width=widths[1])
        main.set_title("the dotted part")
        draw_legend(legend, model, {**meanings, **more})
    figure.suptitle(short(model.case.title, 90), x=0.01, ha="left", fontsize=10)
    return figure


def _two_views(
    figure: Figure, whole: Box, closer: Box
) -> tuple[Axes, Axes, Axes, tuple[float, float]]:
    """Axes of the whole model, of its closer part and of the legend; widths of the first two.

    The closer part stands below the others, not so high that its letters become small where the
    figure must fit a printed page.

    Args:
        figure: gets its size.
        whole: what is shown of the model.
        closer: the part with the gauges.
    """
    main = _panel_size(closer, WIDTH - 0.6, _TALLEST_CLOSER)
    first = _panel_size(whole, 0.48 * WIDTH, _TALLEST_WHOLE)
    figure.set_size_inches(WIDTH, first[1] + main[1] + 1.1)
    grid = figure.add_gridspec(2, 2, height_ratios=[first[1], main[1]])
    places = grid[0, 0], grid[1, :], grid[0, 1]
    axes = [figure.add_subplot(place) for place in places]
    return axes[0], axes[1], axes[2], (first[0], main[0])


def _panel_size(box: Box, widest: float, tallest: float) -> tuple[float, float]:
    """Width and height of a panel that shows a box, inches."""
    aspect = float((box[1][1] - box[0][1]) / (box[1][0] - box[0][0]))
    width = min(widest, tallest / aspect)
    return width, width * aspect


def _with_loads(model: DrawnModel, box: Box) -> Box:
    """A box with a rim, and with room for the arrows of the loads on it."""
    size = float((box[1] - box[0]).max())
    low, high = box[0] - _RIM * size, box[1] + _RIM * size
    for load in model.loads:
        tails = load.tips - 1.25 * _ARROW * size * load.arrows
        here = _inside_box(load.tips, box)
        if here.any():
            room = 0.03 * size
            low = np.minimum(low, tails[here].min(axis=0) - room)
            high = np.maximum(high, tails[here].max(axis=0) + room)
    return low, high


def _draw_panel(
    axes: Axes, model: DrawnModel, sheet: Sheet, box: Box, *, names: bool, width: float
) -> dict[str, Any]:
    """All of the model inside a box; what its marks mean."""
    draw_materials(axes, model, sheet, box, width=width)
    size = float((box[1] - box[0]).max())
    keys = draw_supports(axes, model.case, model.mesh, box)
    draw_gauges(axes, model, model.gauges, names=names)
    keys += draw_structures(axes, model.case, model.mesh, names=names)
    keys += _draw_loads(axes, model, size, box, names=names)
    _draw_water(axes, model)
    if names:
        places = list(marked_places(model.mesh, model.made))
        kept = [(x[((x >= box[0]) & (x <= box[1])).all(axis=1)], n) for n, x in places]
        inside = [(x, n) for x, n in kept if len(x)]
        if inside:
            place_labels(axes, *zip(*inside, strict=True), centred=True, size=LETTERS + 1,
                         weight="bold")  # fmt: skip
        keys += gauge_keys(model.case)
    axes.set_xlim(box[0][0], box[1][0])
    axes.set_ylim(box[0][1], box[1][1])
    axes.set_aspect("equal")
    axes.xaxis.set_major_locator(MaxNLocator(5))
    axes.yaxis.set_major_locator(MaxNLocator(5))
    axes.set_xlabel(f"{model.axis_names[0]} (m)")
    axes.set_ylabel(f"{model.axis_names[1]} (m)")
    return {handle.get_label(): handle for handle in keys}


def draw_materials(axes: Axes, model: DrawnModel, sheet: Sheet, box: Box, *, width: float) -> None:
    """The elements of a sheet in the colours of their materials, and where these meet.

    Args:
        axes: where to draw.
        model: what is drawn.
        sheet: the plane, or a cut.
        box: what is shown.
        width: of the panel, inches.
    """
    known = model.made.material[sheet.element] >= 0
    corners = sheet.xy[sheet.triangles[known]]
    colours = model.element_colours[sheet.element[known]]
    (ax, ay), (bx, by) = (corners[:, 1:] - corners[:, :1]).transpose(1, 2, 0)
    corners = np.where((ax * by < ay * bx)[:, None, None], corners[:, ::-1], corners)
    shades, number = np.unique(colours, axis=0, return_inverse=True)
    areas = [  # one for each colour, in which no joint shows
        Path.make_compound_path_from_polys(corners[number.ravel() == k]) for k in range(len(shades))
    ]
    ground = PathCollection(areas, facecolors=shades, linewidths=0, rasterized=True, zorder=0)
    axes.add_collection(ground, autolim=False)
    points = model.mesh.points
    across = list(sheet.axes)
    present = model.made.material >= 0
    if _element_size(sheet, box) * width * 72 / (box[1][0] - box[0][0]) > _LEAST_ELEMENT:
        edges = sheet.edges(present).at(points)[:, :, across]
        add_segments(axes, edges, box, color=_MESH, lw=0.25)
    zones = np.where(present, model.zones, -1)
    borders = sheet.borders(zones).at(points)[:, :, across]
    add_segments(axes, borders, box, color=_EDGE, lw=0.5)
    dug = model.made.dug > 0
    if dug.any():
        around = sheet.borders(np.where(present, model.made.dug, -1)).at(points)[:, :, across]
        add_segments(axes, around, box, color="black", lw=1.0)
    outline = sheet.outline(present).at(points)[:, :, across]
    add_segments(axes, outline, box, color="black", lw=0.8)


def _element_size(sheet: Sheet, box: Box) -> float:
    """Side of a typical triangle in a box, m."""
    corners = sheet.xy[sheet.triangles]
    middle = corners.mean(axis=1)
    here = ((middle >= box[0]) & (middle <= box[1])).all(axis=1)
    if not here.any():
        return 0.0
    a, b, c = corners[here].swapaxes(0, 1)
    u, v = b - a, c - a
    return float(np.sqrt(np.median(np.abs(u[:, 0] * v[:, 1] - u[:, 1] * v[:, 0]))))


def draw_gauges(
    axes: Any, model: DrawnModel, gauges: dict[str, list[Floats]], *, names: bool
) -> None:
    """Gauges as lines and marks, dark on light, with their names.

    Args:
        axes: where to draw.
        model: what is drawn.
        gauges: lines and points (k, dim) of each, in the coordinates of the axes.
        names: whether names are written.
    """
    kinds = {channel.gauge: channel.kind for channel in model.case.channels}
    for name, lines in gauges.items():
        style = _GAUGE_MARKS.get(kinds[name], _MOVES) | ({"ms": 1.2} if len(lines) > _FIBRE else {})
        rim = [withStroke(linewidth=2.0, foreground="white")] if names else None
        colour = ACCENT if name in model.marked else GAUGE
        for line in lines:
            axes.plot(*line.T, color=colour, lw=1.0, zorder=6, path_effects=rim)
        for line in lines:  # over the rims of all lines
            axes.plot(*line.T, color=colour, ls="", zorder=6.5, **style)
    if names:
        anchors = [
            lines[0][::-1] if kinds[name] == "convergence" else np.vstack([x[-1:] for x in lines])
            for name, lines in gauges.items()
        ]  # either end of what is measured across, else where it moves
        every = [line for lines in gauges.values() for line in lines]
        place_labels(axes, anchors, [short(name, 24) for name in gauges], avoid=every,
                     colour=GAUGE, size=LETTERS)  # fmt: skip


def gauge_keys(case: Case) -> list[Any]:
    """What the marks of gauges mean, one for every kind of mark in the case."""
    kinds = {channel.kind for channel in case.channels}
    special = [kind for kind in _GAUGE_MARKS if kind in kinds]
    styles = {kind: _GAUGE_MARKS[kind] for kind in special}
    if kinds - set(special):
        styles = {"gauge": _MOVES, **styles}
    return [key(name, color=GAUGE, lw=1.0, **style) for name, style in styles.items()]


def _draw_loads(axes: Axes, model: DrawnModel, size: float, box: Box, *, names: bool) -> list[Any]:
    """Arrows of the loads that act inside a box, with their names; loads without place as keys."""
    keys = []
    for load in model.loads:
        colour = WATER if load.water else LOAD
        here = _inside_box(load.tips, box)
        tips, arrows = load.tips[here], _ARROW * size * load.arrows[here]
        if not len(load.tips):
            keys.append(key(short(load.label, 44), color=colour, marker=r"$\downarrow$", ls=""))
            continue
        if not len(tips):
            continue
        named = names or not _inside_box(tips, model.near).any()
        if not named and float(np.ptp(tips, axis=0).max()) < 3 * _ARROW * size:
            continue
        tails = tips - arrows
        axes.quiver(*tips.T, *arrows.T, angles="xy", scale_units="xy", scale=1, pivot="tip",
                    color=colour, units="inches", width=0.014, headwidth=4.5, headlength=5,
                    headaxislength=4.5, zorder=5)  # fmt: skip
        if load.water and load.level is not None:
            x = tails[:, 0].mean()
            axes.plot([x], [load.level], marker="v", ms=6, mfc="white", color=WATER, zorder=6)
        if named:
            ends = list(np.stack([tips, tails], axis=1))
            place_labels(axes, [tails], [short(load.label, 56)], avoid=ends, colour=colour,
                         size=LETTERS)  # fmt: skip
    return keys


def _inside_box(points: Floats, box: Box) -> Bools:
    return np.asarray(((points >= box[0] - 1e-9) & (points <= box[1] + 1e-9)).all(axis=1))


def _draw_water(axes: Axes, model: DrawnModel) -> None:
    """The level of the water in the pores."""
    for label, line in water_levels(model.case, model.mesh, model.values).items():
        axes.plot(*line.T, color=WATER, lw=1.0, ls=(0, (5, 2)), zorder=4)
        inner = np.linspace(line[0], line[-1], 21)[1:-1]
        place_labels(axes, [inner], [label], avoid=[line], colour=WATER, size=LETTERS)


def draw_legend(
    axes: Axes, model: DrawnModel, meanings: dict[str, Any], *, columns: int = 1
) -> None:
    """Materials and marks on the left, stages on the right, in axes of their own.

    Args:
        axes: of nothing else.
        model: whose materials and stages are named.
        meanings: marks as the legend shows them, by what they mean.
        columns: in which materials and marks stand.
    """
    axes.set_axis_off()
    style: dict[str, Any] = {"fontsize": LETTERS - 0.5, "frameon": False, "borderaxespad": 0.0,
                             "handlelength": 1.5, "labelspacing": 0.35}  # fmt: skip
    first = axes.legend(
        handles=[*model.legend(), *meanings.values()], loc="upper left", ncols=columns, **style
    )
    axes.add_artist(first)
    stages = model.stage_keys()
    if stages:
        style |= {"handlelength": 0.0, "handletextpad": 0.0}
        axes.legend(handles=stages, loc="upper right", title="stages", alignment="left",
                    title_fontsize=LETTERS - 0.5, **style)  # fmt: skip
