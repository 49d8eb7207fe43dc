"""A model in space: its outside, what is built in it with the gauges, sections through these."""

from __future__ import annotations

from typing import Any

import numpy as np
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator

from geoident.fem.faces import patches
from geoident.forward.actions.supports import all_supports, support_nodes
from geoident.model.arrays import Bools, Floats, Ints
from geoident.model.cells import CELLS
from geoident.model.mesh import element_centres, spans
from geoident.report.drawing.labels import place_labels
from geoident.report.drawing.model.actions import LOAD, WATER
from geoident.report.drawing.model.construction import marked_places
from geoident.report.drawing.model.drawn import DrawnModel
from geoident.report.drawing.model.plane import (
    LETTERS,
    WIDTH,
    draw_gauges,
    draw_legend,
    draw_materials,
    gauge_keys,
)
from geoident.report.drawing.polygons import Polygons
from geoident.report.drawing.scene import planes_through
from geoident.report.drawing.sheets import Sheet
from geoident.report.drawing.space import Box, add_faces, add_lines, frame, hidden, towards
from geoident.report.drawing.structures import draw_structures
from geoident.report.drawing.style import short

_VIEW = (24.0, -58.0)  # elevation and azimuth, degrees
_SHARP = 0.9  # cosine of the angle between faces from which on their edge is drawn
_EYE = towards(_VIEW)
_EDGE = (0.15, 0.15, 0.15)
_SHADOW = 0.16  # darkness of what faces along x
_TALLEST = 2.9
_MOST_PLACES = 12  # at which the name of a material may stand
_ON = 1e-2  # of the model's size: how near to a section a gauge counts as on it


def solid_figure(model: DrawnModel) -> Figure:
    """Outside, inside and sections of a model in space.

    Args:
        model: what is drawn.
    """
    planes = planes_through(model.gauge_points, model.box)
    sheets = [sheet for sheet in map(model.maker.cut, planes) if len(sheet.triangles)]
    windows = [_window(model, sheet) for sheet in sheets]
    below = max((min(_TALLEST, _aspect(w) * (WIDTH / 2 - 0.7)) for w in windows), default=0.5)
    figure = Figure(figsize=(WIDTH, 3.0 + 4.2 + below + 0.9))
    grid = figure.add_gridspec(3, 2, height_ratios=[3.0, 4.2, below], width_ratios=[1.0, 1.0])
    whole = figure.add_subplot(grid[0, 0], projection="3d", computed_zorder=False)
    legend = figure.add_subplot(grid[0, 1])
    inside = figure.add_subplot(grid[1, :], projection="3d", computed_zorder=False)
    _draw_outside(whole, model)
    meanings = _draw_inside(inside, model)
    for k, (sheet, window) in enumerate(zip(sheets, windows, strict=True)):
        _draw_section(figure.add_subplot(grid[2, k]), model, sheet, window)
    keys = {handle.get_label(): handle for handle in meanings}
    draw_legend(legend, model, keys)
    figure.suptitle(short(model.case.title, 90), x=0.01, ha="left", fontsize=10)
    return figure


def _window(model: DrawnModel, sheet: Sheet) -> Box:
    across = list(sheet.axes)
    return model.near[0][across], model.near[1][across]


def _aspect(window: Box) -> float:
    return float((window[1][1] - window[0][1]) / (window[1][0] - window[0][0]))


def _draw_outside(axes: Any, model: DrawnModel) -> None:
    """The outer surface with the supports and loads that can be seen."""
    present = model.made.material >= 0
    faces, owner = outer_faces(model, present)
    colours = model.element_colours[owner]
    ground = _polygons(model, faces)
    _add_faces(axes, ground, colours, alpha=1.0)
    surface = ground.triangles
    edges = model.mesh.points[_zone_edges(model, np.where(present, model.zones, -1))]
    visible = ~hidden(edges.mean(axis=1), surface, _EYE)
    add_lines(axes, edges[visible], _EDGE, 0.5)
    _frame(axes, model.box)
    named, nearest = [], [np.empty((0, 3))]
    for support in all_supports(model.case):
        points = model.mesh.points[support_nodes(model.mesh, support)]
        middle = (points.min(axis=0) + points.max(axis=0)) / 2
        nearest.append(points[[np.linalg.norm(points - middle, axis=1).argmin()]])
        held = ", ".join("xyz"[c] for c in support.components)
        moved = " (moved)" if support.moves else ""
        named.append(f"{short(support.group)}: {held}{moved}")
    places = np.vstack(nearest)
    seen = np.flatnonzero(~hidden(places, surface, _EYE))
    _draw_loads(axes, model, surface)
    place_labels(axes, places[seen], [named[k] for k in seen], size=LETTERS, centred=True)
    axes.set_title("the whole model; what is held along which axis")


def _draw_loads(axes: Any, model: DrawnModel, surface: Floats) -> None:
    """Arrows of the loads whose tips can be seen, with their names."""
    size = 0.12 * float((model.box[1] - model.box[0]).max())
    for load in model.loads:
        seen = ~hidden(load.tips, surface, _EYE)
        tips, arrows = load.tips[seen], size * load.arrows[seen]
        if not len(tips):
            continue
        colour = WATER if load.water else LOAD
        tails = tips - arrows
        axes.quiver(*tails.T, *arrows.T, color=colour, lw=1.0, arrow_length_ratio=0.35, zorder=6)
        place_labels(axes, [tails], [short(load.label, 40)], colour=colour, size=LETTERS)


def _draw_inside(axes: Any, model: DrawnModel) -> list[Any]:
    """What is dug and placed, other materials than that of most ground, structures and gauges."""
    made = model.made
    present = made.material >= 0
    weak = present & ~made.moved & (made.material != _host(model))
    near = model.near
    for chosen, alpha in ((weak, 0.45), (made.moved & present, 0.55)):
        faces, owner = outer_faces(model, chosen)
        faces, owner = _near_faces(model, faces, owner)
        _add_faces(axes, _polygons(model, faces), model.element_colours[owner], alpha=alpha)
    shown = (made.moved | weak) & present
    edges = model.mesh.points[_zone_edges(model, np.where(shown, model.zones, -1))]
    kept = ((edges >= near[0] - 1e-9) & (edges <= near[1] + 1e-9)).all(axis=(1, 2))
    add_lines(axes, edges[kept], _EDGE, 0.6)
    _frame(axes, near, zoom=1.15)
    keys = draw_structures(axes, model.case, model.mesh)
    draw_gauges(axes, model, model.gauges, names=True)
    places = list(marked_places(model.mesh, made))
    if (made.dug > 0).any():  # linings are too thin and too many to be numbered in space
        places = [(n, x) for n, x in places if not n.startswith("+")]
    place_labels(axes, [x for _, x in places], [n for n, _ in places], centred=True,
                 size=LETTERS, weight="bold")  # fmt: skip
    middles = element_centres(model.mesh)
    inside = weak & ((middles >= near[0]) & (middles <= near[1])).all(axis=1)
    for n in np.unique(made.material[inside]):  # at their tops, where others hide them least
        own = inside & (made.material == n)
        top = own & (middles[:, 2] >= np.quantile(middles[own, 2], 0.8))
        _name_materials(axes, model, middles, np.where(top, n, -1))
    axes.set_title("inside: construction and gauges")
    return [*keys, *gauge_keys(model.case)]


def _host(model: DrawnModel) -> int:
    """Number of the material of which most of what stays is made."""
    made = model.made
    kept = made.material[(made.material >= 0) & ~made.moved]
    return int(np.bincount(kept, minlength=1).argmax())


def _name_materials(axes: Any, model: DrawnModel, middles: Floats, material: Ints) -> None:
    """Names of materials where they are seen.

    Args:
        axes: of space, or of a section.
        model: what is drawn.
        middles: (n, dim) of its pieces.
        material: (n,) number of the material of each; -1 for what has no name here.
    """
    numbers = np.unique(material[material >= 0])
    places = [_spread(middles[material == n]) for n in numbers]
    names = [short(model.made.materials[n]) for n in numbers]
    place_labels(axes, places, names, centred=True, size=LETTERS - 0.5)


def _spread(middles: Floats) -> Floats:
    """Some of many places (k, dim), that next to the middle of all first."""
    order = np.linalg.norm(middles - middles.mean(axis=0), axis=1).argsort(kind="stable")
    return np.asarray(middles[order[:: -(-len(order) // _MOST_PLACES)]])


def _draw_section(axes: Any, model: DrawnModel, sheet: Sheet, window: Box) -> None:
    """A section with the gauges on it."""
    plane = sheet.plane
    assert plane is not None
    draw_materials(axes, model, sheet, window, width=WIDTH / 2 - 0.5)
    near = _ON * float((model.box[1] - model.box[0]).max())
    on = {
        name: [line[:, list(sheet.axes)] for line in lines]
        for name, lines in model.gauges.items()
        if all((np.abs(line[:, plane.axis] - plane.value) <= near).all() for line in lines)
    }
    draw_gauges(axes, model, on, names=True)
    stages = model.made.dug[sheet.element]
    middles = sheet.xy[sheet.triangles].mean(axis=1)
    seen = ((middles >= window[0]) & (middles <= window[1])).all(axis=1)
    numbers = np.unique(stages[(stages > 0) & seen])
    places = [_most_inside(middles[(stages == n) & seen]) for n in numbers]
    place_labels(axes, places, [str(n) for n in numbers], centred=True, size=LETTERS,
                 weight="bold")  # fmt: skip
    weak = model.made.material[sheet.element] != _host(model)
    labelled = weak & seen & ~model.made.moved[sheet.element]
    _name_materials(
        axes, model, middles, np.where(labelled, model.made.material[sheet.element], -1)
    )
    axes.set_xlim(window[0][0], window[1][0])
    axes.set_ylim(window[0][1], window[1][1])
    axes.set_aspect("equal")
    for axis, name in ((axes.xaxis, sheet.axes[0]), (axes.yaxis, sheet.axes[1])):
        axis.set_major_locator(MaxNLocator(5))
        axis.set_label_text(f"{model.axis_names[name]} (m)")
    axes.set_title(f"section {plane}")


def _most_inside(middles: Floats) -> Floats:
    """That of some places (k, 2) which lies next to the middle of all."""
    return np.asarray(middles[np.linalg.norm(middles - middles.mean(axis=0), axis=1).argmin()])


def outer_faces(model: DrawnModel, chosen: Bools) -> tuple[list[Ints], Ints]:
    """Corners (n, 3 or 4) of the outer faces of some elements, kind by kind; the elements behind.

    Args:
        model: with the mesh.
        chosen: the elements (n_elements,) that are there.

    Returns:
        The corners of each kind of face, and the elements (sum of n,) in the order of the faces.
    """
    mesh, table = model.mesh, model.maker.faces
    faces = patches(mesh, table, table.free(chosen))
    corners = [patch.nodes[:, : CELLS[patch.kind].n_corners] for patch in faces]
    owners = [patch.element for patch in faces]
    return corners, np.concatenate([np.empty(0, np.int64), *owners])


def _near_faces(model: DrawnModel, faces: list[Ints], owner: Ints) -> tuple[list[Ints], Ints]:
    """The faces whose middle lies in the box around gauges and construction."""
    low, high = model.near
    kept, owners = [], [np.empty(0, np.int64)]
    for nodes, span in spans(faces):
        middle = model.mesh.points[nodes].mean(axis=1)
        here = ((middle >= low - 1e-9) & (middle <= high + 1e-9)).all(axis=1)
        kept.append(nodes[here])
        owners.append(owner[span][here])
    return kept, np.concatenate(owners)


def _polygons(model: DrawnModel, faces: list[Ints]) -> Polygons:
    return Polygons.of([np.empty((0, 3, 3)), *(model.mesh.points[nodes] for nodes in faces)])


def _add_faces(axes: Any, faces: Polygons, colours: Floats, *, alpha: float) -> None:
    """Faces in their colours (n, 3), darker where they lean."""
    shade = colours * faces.brightness(_SHADOW)[:, None]
    add_faces(axes, faces.corners(), np.c_[shade, np.full(len(shade), alpha)], linewidths=0.0)


def _zone_edges(model: DrawnModel, zones: Ints) -> Ints:
    """Edges (k, 2) at which the outer faces of zones turn sharply."""
    edges = [np.empty((0, 2), np.int64)]
    for zone in np.unique(zones[zones >= 0]):
        faces, _ = outer_faces(model, zones == zone)
        edges.append(_sharp_edges(model.mesh.points, faces))
    return np.unique(np.concatenate(edges), axis=0)


def _sharp_edges(points: Floats, faces: list[Ints]) -> Ints:
    """Edges (k, 2) between faces that meet at an angle, and where a surface ends."""
    edges, normals = [np.empty((0, 2), np.int64)], [np.empty((0, 3))]
    for nodes in faces:
        corners = points[nodes]
        normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
        normal /= np.maximum(np.linalg.norm(normal, axis=1, keepdims=True), 1e-300)
        n = nodes.shape[1]
        edges += [nodes[:, [k, (k + 1) % n]] for k in range(n)]
        normals += [normal] * n
    pairs = np.sort(np.concatenate(edges), axis=1)
    normal = np.concatenate(normals)
    unique, first, place, count = np.unique(
        pairs, axis=0, return_index=True, return_inverse=True, return_counts=True
    )
    cosine = np.abs(np.einsum("ij,ij->i", normal, normal[first[place.ravel()]]))
    least = np.ones(len(unique))
    np.minimum.at(least, place.ravel(), cosine)
    return np.asarray(unique[(count != 2) | (least < _SHARP)])


def _frame(axes: Any, box: Box, *, zoom: float = 1.0) -> None:
    frame(axes, box, _VIEW, zoom=zoom)
    axes.grid(visible=False)
