"""The order of nodes within second-order elements, settled by geometry.

Formats number the nodes between the corners differently, and readers have mixed them up. A node
between two corners lies near the middle of its edge, also on a curved or distorted element. So
among the orders in use the one with the nodes nearest to the middles of their edges is the right
one, and an element for which none fits is refused by its number.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from geoident.io.mesh.raw import Refused
from geoident.model.arrays import Floats, Ints

_HEX_EDGES = (
    *((0, 1), (1, 2), (2, 3), (3, 0)),
    *((4, 5), (5, 6), (6, 7), (7, 4)),
    *((0, 4), (1, 5), (2, 6), (3, 7)),
)

EDGES: Mapping[str, tuple[tuple[int, int], ...]] = {
    "line3": ((0, 1),),
    "tri6": ((0, 1), (1, 2), (2, 0)),
    "quad8": ((0, 1), (1, 2), (2, 3), (3, 0)),
    "tet10": ((0, 1), (1, 2), (2, 0), (0, 3), (1, 3), (2, 3)),
    "hex20": _HEX_EDGES,
}
"""VTK's order: after the corners one node for each of these edges."""

GMSH_TET10 = (0, 1, 2, 3, 4, 5, 6, 7, 9, 8)
GMSH_HEX20 = (*range(9), 11, 13, 9, 16, 18, 19, 17, 10, 12, 14, 15)
_UPRIGHTS_FIRST = (*range(12), 16, 17, 18, 19, 12, 13, 14, 15)

ORDERS: Mapping[str, tuple[tuple[int, ...], ...]] = {
    "line3": ((0, 1, 2), (0, 2, 1)),
    "tri6": ((0, 1, 2, 3, 4, 5), (0, 2, 4, 1, 3, 5)),
    "quad8": (tuple(range(8)), (0, 2, 4, 6, 1, 3, 5, 7)),
    "tet10": (tuple(range(10)), GMSH_TET10),
    "hex20": (tuple(range(20)), GMSH_HEX20, _UPRIGHTS_FIRST),
}
"""Orders in use, VTK's first: entry i of a row is the place in the file's row of VTK's node i."""

_FARTHEST = 0.45
"""How far from the middle of its edge a node may lie, in lengths of the edge.

A node at the quarter point (crack tips) lies at 0.25, one on an arc of 150 degrees at 0.38.
"""


def in_vtk_order(kind: str, nodes: Ints, *, points: Floats, numbers: Ints) -> Ints:
    """The ``nodes`` (n_cells, k) of second-order cells in VTK's order; others unchanged.

    Args:
        kind: kind of the cells.
        nodes: (n_cells, k) node indices as read, in any order of `ORDERS`.
        points: (n_nodes, dim) coordinates, m.
        numbers: (n_cells,) numbers for the message.

    Raises:
        Refused: a node lies nowhere near the middle of its edge in any order.
    """
    if kind not in ORDERS or len(nodes) == 0:
        return nodes
    candidates = [nodes[:, list(order)] for order in ORDERS[kind]]
    offsets = _offsets(kind, candidates[0], points)
    if float(offsets.max()) < 0.1:
        return nodes
    others = [_offsets(kind, candidate, points) for candidate in candidates[1:]]
    best = int(np.argmin([np.minimum(o, 10.0).sum() for o in (offsets, *others)]))
    _check_offsets((offsets, *others)[best], kind=kind, numbers=numbers)
    return candidates[best]


def _offsets(kind: str, nodes: Ints, points: Floats) -> Floats:
    """(n_cells, n_edges) distance of each node from the middle of its edge, in edge lengths."""
    edges = np.array(EDGES[kind])
    corners = int(edges.max()) + 1
    start, end = points[nodes[:, edges[:, 0]]], points[nodes[:, edges[:, 1]]]
    away = np.linalg.norm(points[nodes[:, corners:]] - 0.5 * (start + end), axis=2)
    length = np.linalg.norm(end - start, axis=2)
    ratio: Floats = away / np.maximum(length, np.finfo(float).tiny)
    return ratio


def _check_offsets(offsets: Floats, *, kind: str, numbers: Ints) -> None:
    """Refuse the first cell with a node too far from the middle of its edge."""
    far = np.argwhere(offsets > _FARTHEST)
    if len(far) == 0:
        return
    row, edge = (int(k) for k in far[0])
    first, last = (corner + 1 for corner in EDGES[kind][edge])
    raise Refused(
        "mesh-mid-node",
        f"element {numbers[row]} ({kind}): none of its nodes between the corners lies near the "
        f"middle of the edge from its corner {first} to its corner {last}",
        "the order of the nodes is not one that is known for this format, or the element is "
        "badly distorted: write the mesh as .msh with gmsh, or make elements of first order",
    )
