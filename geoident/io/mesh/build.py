"""From what a mesh file says to the `Mesh` of an analysis, with the checks all formats share."""

from __future__ import annotations

from collections.abc import Mapping
from itertools import product

import numpy as np

from geoident.io.mesh.raw import RawMesh, Refused, first_of_equal, join, row_keys
from geoident.model.arrays import Floats, Ints
from geoident.model.cells import CELLS
from geoident.model.mesh import ElementBlock, Mesh, spans

_FLAT = 1e-6
"""Extent in z, in parts of the largest extent, below which a mesh is plane."""

_FAR = 1e50
"""Coordinates (m) from here on are damage, and their squares would overflow."""

_FARTHEST = 0.45
"""How far from the middle of its edge a node may lie, in lengths of the edge.

A node at the quarter point (crack tips) lies at 0.25, one on an arc of 150 degrees at 0.38.
"""


_INCOMPLETE = "mesh with gmsh's option Mesh.SecondOrderIncomplete=1, or with elements of order 1"
_HINTS = {
    "quad9": _INCOMPLETE,
    "hex27": _INCOMPLETE,
    "wedge18": _INCOMPLETE,
    "pyramid14": _INCOMPLETE,
    "pixel": "write the cells as quadrilaterals",
    "voxel": "write the cells as hexahedra",
}


def build_mesh(raw: RawMesh, *, dim: int, file: str) -> Mesh:
    """The mesh of an analysis in ``dim`` dimensions.

    Cells of dimension ``dim`` become elements, those of the next lower one facets, of which one
    that stands several times is taken once; groups of still lower ones become node groups.

    Args:
        raw: what the file says.
        dim: dimensions of the analysis.
        file: path of the mesh, for messages.

    Raises:
        Refused: the cells do not fit the analysis, or some of them cannot be used.
    """
    _check_dimension(raw, dim)
    _check_kinds(raw, dim)
    _check_nodes(raw)
    points = raw.points[:, :dim] if dim == 3 else _plane(raw)
    blocks, place = _collect(raw, dim, points)
    facets, facet_place = _collect(raw, dim - 1, points, merge=True)
    return Mesh(
        points=np.ascontiguousarray(points, dtype=np.float64),
        blocks=blocks,
        facets=facets,
        groups=_placed(raw.groups, place),
        facet_groups=_placed(raw.groups, facet_place),
        node_groups=_node_groups(raw, dim),
        file=file,
    )


def _check_dimension(raw: RawMesh, dim: int) -> None:
    """Refuse a mesh without cells, or with cells of other dimension than the analysis."""
    top = max((cells.dim for cells in raw.cells if len(cells)), default=-1)
    if top < 1:
        hint = "mesh the geometry before saving: gmsh -2 or gmsh -3"
        raise Refused("mesh-empty", "the mesh has no elements", hint)
    if top == dim:
        return
    elements = {1: "lines only", 2: "surface elements only", 3: "solid elements"}[top]
    kind = "a solid analysis needs solid ones" if dim == 3 else "a plane analysis needs plane ones"
    hint = {
        1: "mesh the surfaces too; in gmsh, put them in a physical group or set Mesh.SaveAll=1",
        2: "`analysis: plane-strain` may be meant; else mesh the volumes, and in gmsh put them "
        "in a physical group or set Mesh.SaveAll=1",
        3: "`analysis: solid` may be meant",
    }[top]
    raise Refused("mesh-dimension", f"the mesh has {elements}, {kind}", hint)


def _check_kinds(raw: RawMesh, dim: int) -> None:
    """Refuse elements and facets of kinds that cannot be computed with, elements first."""
    for cells in sorted(raw.cells, key=lambda cells: -cells.dim):
        if cells.dim >= dim - 1 and cells.dim > 0 and len(cells) and not _usable(cells.kind):
            kind = cells.kind
            known = ", ".join(k for k, c in CELLS.items() if c.usable and c.dim == cells.dim)
            raise Refused(
                "mesh-kind",
                f"element {cells.numbers[0]} is of the kind {kind}, which cannot be used",
                _HINTS.get(kind, f"use elements of the kinds {known}"),
            )


def _usable(kind: str) -> bool:
    return kind in CELLS and CELLS[kind].usable


def _check_nodes(raw: RawMesh) -> None:
    """Refuse coordinates that are no numbers and node indices out of range."""
    bad = np.flatnonzero(~(np.abs(raw.points) < _FAR).all(axis=1))
    if len(bad):
        what = "that is no number or beyond all measure"
        message = f"node {bad[0] + 1} of the file has a coordinate {what}"
        raise Refused("mesh-coordinate", message, "write the mesh again")
    for cells in raw.cells:
        if _usable(cells.kind) and cells.nodes.shape[1] != CELLS[cells.kind].n_nodes:
            message = f"element {cells.numbers[0]} ({cells.kind}) has {cells.nodes.shape[1]} nodes"
            raise Refused("mesh-node", message, "the file is damaged: write it as .msh with gmsh")
        wrong = (cells.nodes < 0) | (cells.nodes >= len(raw.points))
        if bool(wrong.any()):
            number = cells.numbers[np.flatnonzero(wrong.any(axis=1))[0]]
            message = f"element {number} uses a node that the file does not hold"
            raise Refused("mesh-node", message, "the file is damaged: write the mesh again")


def _plane(raw: RawMesh) -> Floats:
    """(n, 2) coordinates of a mesh in a plane z = const."""
    if raw.points.shape[1] == 2:
        return raw.points
    used = np.unique(np.concatenate([c.nodes.ravel() for c in raw.cells if c.dim]))
    extent = np.ptp(raw.points[used], axis=0)
    if extent[2] <= _FLAT * extent.max():
        return raw.points[:, :2]
    planes = {0: "y-z", 1: "x-z"}
    flat = [name for axis, name in planes.items() if extent[axis] <= _FLAT * extent.max()]
    message = f"the mesh lies in the {flat[0]} plane" if flat else "the mesh is not plane"
    raise Refused(
        "mesh-plane",
        f"{message} (z runs over {extent[2]:.6g} m): a plane analysis needs x and y, z the same",
        "turn the mesh so that y points upwards and z is constant"
        if flat
        else "`analysis: solid` needs volume elements; a plane analysis needs a flat mesh",
    )


def _collect(
    raw: RawMesh, dim: int, points: Floats, *, merge: bool = False
) -> tuple[tuple[ElementBlock, ...], Ints]:
    """Cells of one dimension by kind, and where each cell of the file went (-1: nowhere).

    ``merge`` takes equal cells once and else refuses them.
    """
    place = np.full(sum(map(len, raw.cells)), -1, dtype=np.int64)
    blocks: list[ElementBlock] = []
    parts = [(cells, span) for cells, span in spans(raw.cells) if cells.dim == dim and len(cells)]
    for kind in dict.fromkeys(cells.kind for cells, _ in parts):
        own = [(cells, span) for cells, span in parts if cells.kind == kind]
        where = np.concatenate([np.arange(span.start, span.stop) for _, span in own])
        numbers = np.concatenate([cells.numbers for cells, _ in own]).astype(np.int64)
        nodes = np.concatenate([cells.nodes for cells, _ in own]).astype(np.int64)
        nodes = _in_vtk_order(kind, nodes, points=points, numbers=numbers)
        _check_collapsed(kind, nodes, numbers)
        first, leads = first_of_equal(row_keys(np.sort(nodes[:, : CELLS[kind].n_corners], axis=1)))
        if not (merge or leads.all()):
            row = int(np.flatnonzero(~leads)[0])
            message = (
                f"elements {numbers[first[row]]} and {numbers[row]} have the same corner nodes"
            )
            hint = "remove one of them; in gmsh, let volumes or surfaces not overlap (Coherence)"
            raise Refused("mesh-duplicate", message, hint)
        rows = np.cumsum(leads) - 1 + sum(map(len, blocks))
        place[where] = rows[first]
        blocks.append(ElementBlock(kind, np.ascontiguousarray(nodes[leads]), numbers[leads]))
    return tuple(blocks), place


def _in_vtk_order(kind: str, nodes: Ints, *, points: Floats, numbers: Ints) -> Ints:
    """The ``nodes`` (n_cells, k) of second-order cells in VTK's order; others unchanged.

    Args:
        kind: kind of the cells.
        nodes: (n_cells, k) node indices as read, in any order of `geoident.model.cells`.
        points: (n_nodes, dim) coordinates, m.
        numbers: (n_cells,) numbers for the message.

    Raises:
        Refused: a node lies nowhere near the middle of its edge in any order.
    """
    cell = CELLS[kind]
    if not cell.edges or len(nodes) == 0:
        return nodes
    offsets = _offsets(kind, nodes, points)
    if float(offsets.max()) < 0.1:
        return nodes
    orders = [order for order in (cell.gmsh_order, *cell.other_orders) if order]
    candidates = [nodes, *(nodes[:, order] for order in orders)]
    all_offsets = [offsets, *(_offsets(kind, other, points) for other in candidates[1:])]
    best = int(np.argmin([np.minimum(away, 10.0).sum() for away in all_offsets]))
    _check_offsets(all_offsets[best], kind=kind, numbers=numbers)
    return candidates[best]


def _offsets(kind: str, nodes: Ints, points: Floats) -> Floats:
    """(n_cells, n_edges) distance of each node from the middle of its edge, in edge lengths."""
    edges, corners = np.array(CELLS[kind].edges), CELLS[kind].n_corners
    start, end = points[nodes[:, edges[:, 0]]], points[nodes[:, edges[:, 1]]]
    away = np.linalg.norm(points[nodes[:, corners:]] - 0.5 * (start + end), axis=2)
    length = np.linalg.norm(end - start, axis=2)
    least = max(np.finfo(float).tiny, 1e-300 * float(np.max(away, initial=0.0)))
    ratio: Floats = away / np.maximum(length, least)
    return ratio


def _check_offsets(offsets: Floats, *, kind: str, numbers: Ints) -> None:
    """Refuse the first cell with a node too far from the middle of its edge."""
    far = np.argwhere(offsets > _FARTHEST)
    if len(far) == 0:
        return
    row, edge = (int(k) for k in far[0])
    first, last = (corner + 1 for corner in CELLS[kind].edges[edge])
    raise Refused(
        "mesh-mid-node",
        f"element {numbers[row]} ({kind}): none of its nodes between the corners lies near the "
        f"middle of the edge from its corner {first} to its corner {last}",
        "the order of the nodes is not one that is known for this format, or the element is "
        "badly distorted: write the mesh as .msh with gmsh, or make elements of first order",
    )


def _check_collapsed(kind: str, nodes: Ints, numbers: Ints) -> None:
    """Refuse an element that has a node twice."""
    ordered = np.sort(nodes, axis=1)
    twice = np.flatnonzero((ordered[:, 1:] == ordered[:, :-1]).any(axis=1))
    if len(twice):
        raise Refused(
            "mesh-collapsed",
            f"element {numbers[twice[0]]} ({kind}) has the same node twice",
            "use triangles, tetrahedra, wedges or pyramids in place of collapsed elements",
        )


def _placed(groups: Mapping[str, Ints], place: Ints) -> dict[str, Ints]:
    """Groups of cells of the file as groups of elements or facets."""
    return join({name: [place[where][place[where] >= 0]] for name, where in groups.items()})


def _node_groups(raw: RawMesh, dim: int) -> dict[str, Ints]:
    """Sets of nodes, and the nodes of groups of cells that are neither elements nor facets."""
    parts = {name: [np.asarray(where)] for name, where in raw.node_groups.items()}
    low = [(cells, span) for cells, span in spans(raw.cells) if cells.dim < dim - 1]
    for (cells, span), (name, where) in product(low, raw.groups.items()):
        inside = where[(where >= span.start) & (where < span.stop)] - span.start
        parts.setdefault(name, []).append(cells.nodes[inside].ravel())
    return join(parts)
