"""The picture of a case by matplotlib: mesh, groups, stages in their order, supports and gauges.

In the plane: the whole model with its supports, and the part with the gauges. In space: the outer
surface with the supports, and what is dug or placed with the gauges.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from matplotlib import colormaps
from matplotlib.axes import Axes
from matplotlib.collections import PolyCollection
from matplotlib.figure import Figure
from matplotlib.patches import Patch
from matplotlib.patheffects import withStroke
from mpl_toolkits.mplot3d.art3d import Poly3DCollection

from geoident.fem.faces import face_table, patches
from geoident.forward.actions.supports import group_nodes
from geoident.model.arrays import Floats, Ints
from geoident.model.case import Case
from geoident.model.cells import CELLS
from geoident.model.mesh import Mesh, spans
from geoident.report.drawing.sheets import element_centres
from geoident.report.drawing.structures import draw_structures, structure_lines
from geoident.report.drawing.style import MEASURED, SMALL, Picture, box_axes, image, key, short

Colour = tuple[float, float, float]
_GROUND = ((0.91, 0.91, 0.89), (0.79, 0.83, 0.86), (0.86, 0.81, 0.76), (0.74, 0.74, 0.74))
_ORDER = "YlOrBr"
_PLACED = "YlGnBu"
_MARKERS = {"x": ">", "y": "^", "z": "v"}
_SUPPORT: dict[str, Any] = {"ls": "", "ms": 4, "mfc": "none", "mec": "black", "mew": 0.7}
_MOST_MARKS = 25
_MOST_LABELS = 40
_RIM = 0.03  # around the part that is drawn, of its larger side
_EDGE = (0.35, 0.35, 0.35)
_MOVES: dict[str, Any] = {"marker": "o", "ms": 2.5}
_GAUGE_MARKS: dict[str, dict[str, Any]] = {
    "stress": {"marker": "P", "ms": 5.0},
    "pressure-cell": {"marker": "D", "ms": 4.0},
    "piezometer": {"marker": "v", "ms": 5.0},
    "load-cell": {"marker": "s", "ms": 4.0},
    "strain": {"marker": ".", "ms": 4.0},
}
"""Marks of gauges that read something else than motions."""
_FIBRE = 20
"""Channels of a gauge above which their marks are small."""
_SHOWN = ("stages in their order, and gauges", "stages in their order, structures and gauges")
_HALO = [withStroke(linewidth=2.0, foreground="white")]


def case_picture(case: Case, mesh: Mesh, suffix: str) -> bytes:
    """The picture as a file, ``svg``, ``png`` or ``pdf``; the same case gives the same bytes.

    Args:
        case: the case.
        mesh: its mesh.
        suffix: of the file.
    """
    return image(model_picture(case, mesh), suffix)


def model_picture(case: Case, mesh: Mesh) -> Picture:
    """The picture of a case, not drawn yet."""
    draw = _solid_figure if mesh.dim == 3 else _plane_figure
    return Picture("case", case.title, "", lambda: draw(case, mesh))


def _plane_figure(case: Case, mesh: Mesh) -> Figure:
    parts = parts_of(case, mesh)
    low, high = window(case, mesh, parts)
    figure = Figure(figsize=(11.5, _height(np.ptp(mesh.points, axis=0), high - low)))
    whole, near = figure.subplots(1, 2)
    for axes, width in ((whole, 0.1), (near, 0.25)):
        _draw_elements(axes, mesh, parts, width)
        axes.set_aspect("equal")
        axes.set_xlabel("x (m)")
        axes.set_ylabel("y (m)")
    whole.autoscale_view()
    supports = _draw_supports(whole, case, mesh)
    frame = np.array([low, [high[0], low[1]], high, [low[0], high[1]], low])
    whole.plot(*frame.T, color="black", lw=0.8, ls=":")
    rim = _RIM * float((high - low).max())  # what stands on the edge of the mesh is shown whole
    near.set_xlim(low[0] - rim, high[0] + rim)
    near.set_ylim(low[1] - rim, high[1] + rim)
    built = draw_structures(near, case, mesh)
    _draw_gauges(near, case)
    _draw_marks(near, mesh, parts)
    whole.set_title("model and supports")
    near.set_title(f"{_SHOWN[bool(built)]} (the dotted part)")
    _finish(figure, case, parts, [*supports, *built])
    return figure


def _height(*extents: Floats) -> float:
    """Height of the figure, inches, at which two panels of some extents fill it."""
    steepest = max(float(extent[1] / extent[0]) for extent in extents)
    return float(np.clip(4.4 * steepest + 1.5, 3.2, 7.5))


def _solid_figure(case: Case, mesh: Mesh) -> Figure:
    parts = parts_of(case, mesh)
    figure = Figure(figsize=(11.5, 6.4))
    whole, near = (
        figure.add_subplot(1, 2, k, projection="3d", computed_zorder=k == 1) for k in (1, 2)
    )
    moved = tuple(part for part in parts if part.mark)
    _draw_surface(whole, mesh, parts, alpha=1.0)
    _draw_surface(near, mesh, moved, alpha=0.75)
    _name_supports(whole, case, mesh)
    built = draw_structures(near, case, mesh)
    _draw_gauges(near, case)
    _draw_marks(near, mesh, parts)
    _frame(whole, mesh.points.min(axis=0), mesh.points.max(axis=0))
    _frame(near, *window(case, mesh, parts))
    whole.set_title("outer surface; GROUP: directions in which it is held")
    near.set_title(_SHOWN[bool(built)])
    _finish(figure, case, parts, built)
    return figure


def _draw_elements(axes: Axes, mesh: Mesh, parts: tuple[Part, ...], width: float) -> None:
    colours = np.ones((mesh.n_elements, 3))
    for part in parts:
        colours[part.elements] = part.colour
    for block, span in spans(mesh.blocks):
        corners = block.nodes[:, : CELLS[block.kind].n_corners]
        axes.add_collection(
            PolyCollection(
                list(mesh.points[corners]),
                facecolors=colours[span],
                edgecolors=_EDGE,
                linewidths=width,
                rasterized=len(block) > 3000,
            )
        )


def _draw_surface(axes: Any, mesh: Mesh, parts: tuple[Part, ...], *, alpha: float) -> None:
    """The outer surface of some parts."""
    owner = np.full(mesh.n_elements, -1)
    for k, part in enumerate(parts):
        owner[part.elements] = k
    table = face_table(mesh)
    colours = np.array([part.colour for part in parts]).reshape(-1, 3)
    polygons: list[Floats] = []
    shades = [np.empty((0, 3))]
    for patch in patches(mesh, table, table.free(owner >= 0)):
        corners = mesh.points[patch.nodes[:, : CELLS[patch.kind].n_corners]]
        polygons += list(corners)
        shades.append(colours[owner[patch.element]] * _light(corners)[:, None])
    if not polygons:
        return
    shade = np.concatenate(shades)
    # One collection, since matplotlib sorts by depth only within each.
    axes.add_collection3d(
        Poly3DCollection(
            polygons,
            facecolors=np.c_[shade, np.full(len(shade), alpha)],
            edgecolors=(*_EDGE, 0.4),
            linewidths=0.15,
            rasterized=True,
        )
    )


def _light(corners: Floats) -> Floats:
    """(n,) brightness of faces (n, n_corners, 3) by their inclination, 0.75 to 1."""
    normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    length = np.linalg.norm(normal, axis=1)
    weights = np.array([0.82, 0.9, 1.0])
    share = np.abs(normal) / np.where(length > 0, length, 1.0)[:, None]
    return np.asarray(np.clip((share**2) @ weights, 0.75, 1.0))


def _draw_supports(axes: Any, case: Case, mesh: Mesh) -> list[Any]:
    """Marks along the supported groups; what they mean."""
    meanings: dict[str, Any] = {}
    for support in case.supports:
        names = [("x", "y", "z")[c] for c in support.components]
        marker = _MARKERS[names[0]] if len(names) == 1 else "s"
        nodes = _some(group_nodes(mesh, support.group), mesh)
        axes.plot(*mesh.points[nodes].T, zorder=5, marker=marker, **_SUPPORT)
        label = f"held along {', '.join(names)}"
        meanings[label] = key(label, marker=marker, **_SUPPORT)
    return list(meanings.values())


def _name_supports(axes: Any, case: Case, mesh: Mesh) -> None:
    """The name of each supported group at its middle, with the directions that are held."""
    for support in case.supports:
        points = mesh.points[group_nodes(mesh, support.group)]
        middle = (points.min(axis=0) + points.max(axis=0)) / 2
        held = ", ".join("xyz"[component] for component in support.components)
        axes.text(*middle, f"{short(support.group)}: {held}", fontsize=SMALL + 1, ha="center",
                  zorder=9, path_effects=_HALO)  # fmt: skip


def _some(nodes: Ints, mesh: Mesh) -> Ints:
    """Nodes evenly out of many, from one end to the other."""
    points = mesh.points[nodes]
    along = points[:, np.ptp(points, axis=0).argmax()]
    order = nodes[np.argsort(along, kind="stable")]
    return np.asarray(order[np.unique(np.linspace(0, len(order) - 1, _MOST_MARKS).astype(int))])


def _draw_gauges(axes: Any, case: Case) -> None:
    for k, (name, ends) in enumerate(gauge_lines(case).items()):
        kind = next(channel.kind for channel in case.channels if channel.gauge == name)
        style = _GAUGE_MARKS.get(kind, _MOVES) | ({"ms": 1.0} if len(ends) > _FIBRE else {})
        for line in ends:
            axes.plot(*line.T, color=MEASURED, lw=1.0, zorder=6, **style)
        if k < _MOST_LABELS:
            far = np.vstack([line[-1:] for line in ends])
            axes.text(*far[-1], f" {short(name)}", fontsize=SMALL, color="#7a3300", zorder=7,
                      clip_on=True, path_effects=_HALO)  # fmt: skip


def _gauge_keys(case: Case) -> list[Any]:
    """What the marks of gauges mean, one for every kind of mark in the case."""
    kinds = {channel.kind for channel in case.channels}
    special = [kind for kind in _GAUGE_MARKS if kind in kinds]
    styles = {kind: _GAUGE_MARKS[kind] for kind in special}
    if kinds - set(special):
        styles = {"gauge": _MOVES, **styles}
    return [key(name, color=MEASURED, lw=1.0, **style) for name, style in styles.items()]


def _draw_marks(axes: Any, mesh: Mesh, parts: tuple[Part, ...]) -> None:
    """The number of the stage on what it digs or places."""
    for part in parts:
        if part.mark:
            axes.text(*centre(mesh, part.elements), part.mark, fontsize=SMALL + 2, weight="bold",
                      ha="center", va="center", zorder=8, clip_on=True,
                      path_effects=_HALO)  # fmt: skip


def _frame(axes: Any, low: Floats, high: Floats) -> None:
    box_axes(axes, low, high)
    axes.set_box_aspect(high - low)
    axes.view_init(elev=22, azim=-55)
    axes.grid(visible=False)


def _finish(figure: Figure, case: Case, parts: tuple[Part, ...], supports: list[Any]) -> None:
    """Title and legend."""
    colours: list[Any] = [
        Patch(facecolor=part.colour, edgecolor=_EDGE, lw=0.4, label=short(part.label, 34))
        for part in parts
    ]
    handles = [*colours, *supports, *_gauge_keys(case)]
    figure.legend(handles=handles, loc="outside right upper", fontsize=SMALL, frameon=False,
                  ncols=1 + len(handles) // 36)  # fmt: skip
    figure.suptitle(short(case.title, 90), x=0.01, ha="left", fontsize=11)


@dataclass(frozen=True)
class Part:
    """Elements that are drawn alike.

    Args:
        label: for the legend.
        mark: for the place itself; empty for none.
        colour: red, green and blue.
        elements: (k,) indices of the elements.
    """

    label: str
    mark: str
    colour: Colour
    elements: Ints


def parts_of(case: Case, mesh: Mesh) -> tuple[Part, ...]:
    """Ground that stays, group by group; then what is dug and what is placed, stage by stage."""
    moved: dict[str, tuple[int, bool]] = {}
    for n, stage in enumerate(case.stages):
        for name in stage.excavate:
            moved.setdefault(name, (n, True))
        for name in stage.install:
            moved.setdefault(name, (n, False))
    still = [name for name in case.groups if name not in moved]
    parts = [
        Part(name, "", _GROUND[k % len(_GROUND)], mesh.groups[name]) for k, name in enumerate(still)
    ]
    for n, stage in enumerate(case.stages):
        for dug, verb in ((True, "excavated"), (False, "placed")):
            names = [name for name, when in moved.items() if when == (n, dug)]
            if names:
                elements = np.unique(np.concatenate([mesh.groups[name] for name in names]))
                colour = _in_order(n, len(case.stages), dug=dug)
                parts.append(Part(f"{n + 1}  {stage.name}: {verb}", str(n + 1), colour, elements))
    return tuple(part for part in parts if len(part.elements))


def _in_order(n: int, count: int, *, dug: bool) -> Colour:
    """Light for the first stage, dark for the last."""
    shade = colormaps[_ORDER if dug else _PLACED](0.2 + 0.55 * n / max(1, count - 1))
    return shade[0], shade[1], shade[2]


def gauge_lines(case: Case) -> dict[str, list[Floats]]:
    """Of each gauge, its lines: (2, dim) from point to point, (1, dim) for a point by itself, m."""
    lines: dict[str, list[Floats]] = {}
    for channel in case.channels:
        ends = [point for point in (channel.first, channel.second) if point is not None]
        lines.setdefault(channel.gauge, []).append(np.array(ends, dtype=np.float64))
    return lines


def centre(mesh: Mesh, elements: Ints) -> Floats:
    """Middle of that element which lies next to the middle of all, (dim,) m."""
    middles = element_centres(mesh)[elements]
    nearest = np.linalg.norm(middles - middles.mean(axis=0), axis=1).argmin()
    return np.asarray(middles[nearest])


def window(case: Case, mesh: Mesh, parts: tuple[Part, ...]) -> tuple[Floats, Floats]:
    """The box around gauges, structures and all that is dug or placed, with a margin.

    It ends where the mesh ends.

    Args:
        case: with gauges.
        mesh: its mesh.
        parts: what is dug, placed or neither.

    Returns:
        Its lower and its upper corner, (dim,) each, m.
    """
    points = [line for lines in gauge_lines(case).values() for line in lines]
    points += [
        line for structure in case.structures.values() for line in structure_lines(structure, mesh)
    ]
    moved = [part.elements for part in parts if part.mark]
    if moved:
        points.append(element_centres(mesh)[np.concatenate(moved)])
    low, high = mesh.points.min(axis=0), mesh.points.max(axis=0)
    if not points:
        return low, high
    inner = np.vstack(points)
    margin = 0.12 * float(np.ptp(inner, axis=0).max()) + 1e-9
    return np.maximum(low, inner.min(axis=0) - margin), np.minimum(high, inner.max(axis=0) + margin)
