"""Flat pieces of a mesh that can be coloured and outlined: a plane mesh, or a cut through solids.

Every point of a *sheet* is a weighted mean of nodes: of those of an element by its shape functions,
and, in a cut, of two such points on both sides of the plane. So one drawing code serves plane
meshes and cuts through solids: what is known at nodes is known there. Elements are taken apart into
triangles or tetrahedra, those of order 2 into smaller ones, so that what bends inside an element
bends in the picture. A plane that leaves one corner of a tetrahedron alone meets a triangle, one
that parts two from two a quadrilateral. Lines (outlines, element edges) are cuts of the faces of
elements, so that the tetrahedra inside a hexahedron stay unseen.

Nodes are doubled where groups of elements meet (`DoubledCorners`): what is averaged at nodes may
jump between rock and lining.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property, lru_cache
from itertools import combinations
from typing import Any

import numpy as np
from scipy.sparse import csr_array, diags_array, vstack

from geoident.fem.elements import reference_element
from geoident.fem.faces import FaceTable, face_table, patches
from geoident.model.arrays import Bools, Floats, Ints
from geoident.model.cells import CELLS
from geoident.model.mesh import Mesh, spans

_ROUNDING = 1e-12  # weights below are rounding errors of shape functions
_OTHERS = np.array([[1, 2, 3], [0, 2, 3], [0, 1, 3], [0, 1, 2]])


@dataclass(frozen=True)
class Plane:
    """The plane on which one coordinate has a value.

    Args:
        axis: the coordinate, 0 for x.
        value: m.
    """

    axis: int
    value: float

    @property
    def axes(self) -> tuple[int, int]:
        """The coordinates in the plane, across and up."""
        return {0: (1, 2), 1: (0, 2), 2: (0, 1)}[self.axis]

    def __str__(self) -> str:
        return f"{'xyz'[self.axis]} = {round(self.value, 2):z.6g} m"


@dataclass(frozen=True)
class DoubledCorners:
    """Corner nodes of the elements, doubled where groups meet.

    Args:
        element: (k,) element of every corner of every element.
        corner: (k,) its doubled node.
        node: (n_doubled,) the node behind each doubled one.
        of: for every block (n_elements, n_corners) doubled nodes.
    """

    element: Ints
    corner: Ints
    node: Ints
    of: tuple[Ints, ...]

    def average(self, values: Floats, present: Bools) -> Floats:
        """Means (n_doubled,) of values of elements (n_elements,); NaN where none is present."""
        keep = present[self.element]
        corner, value = self.corner[keep], values[self.element[keep]]
        count = np.bincount(corner, minlength=len(self.node))
        total = np.bincount(corner, value, minlength=len(self.node))
        return np.asarray(np.where(count > 0, total / np.maximum(count, 1), np.nan))


@dataclass(frozen=True)
class Trace:
    """Line segments: the ends (k, 2) between nodes a and b at the weight w."""

    a: Ints
    b: Ints
    w: Floats

    def at(self, values: Floats) -> Floats:
        """What is known at nodes (n_nodes, dim) at the ends, (k, 2, dim)."""
        w = self.w[..., None]
        return np.asarray((1 - w) * values[self.a] + w * values[self.b])


@dataclass(frozen=True, eq=False)
class Sheet:
    """A flat piece of a mesh as triangles.

    Args:
        mesh: what it is a piece of.
        plane: the cut, or None for a plane mesh.
        corners: the doubled nodes.
        faces: the faces of the mesh.
        at_nodes: (n, n_nodes) weights of the nodes in every point.
        at_corners: (n, n_doubled) weights of the doubled corners.
        triangles: (m, 3) points.
        element: (m,) element of each triangle.
    """

    mesh: Mesh
    plane: Plane | None
    corners: DoubledCorners
    faces: FaceTable
    at_nodes: csr_array
    at_corners: csr_array
    triangles: Ints
    element: Ints

    @property
    def axes(self) -> tuple[int, int]:
        """The coordinates across and up."""
        return (0, 1) if self.plane is None else self.plane.axes

    @cached_property
    def xy(self) -> Floats:
        """Points (n, 2), m."""
        return self.of_nodes(self.mesh.points)[:, list(self.axes)]

    @cached_property
    def elements_behind(self) -> Ints:
        """Elements (k,) that have a corner from which a point of the sheet has a value."""
        asked = np.zeros(len(self.corners.node), dtype=bool)
        asked[self.at_corners.indices] = True
        return np.unique(self.corners.element[asked[self.corners.corner]])

    def of_nodes(self, values: Floats) -> Floats:
        """What is known at nodes (n_nodes, ...) at the points of the sheet."""
        return np.asarray(self.at_nodes @ values)

    def of_corners(self, values: Floats) -> Floats:
        """What is known at doubled corners (n_doubled, ...) at the points of the sheet."""
        return np.asarray(self.at_corners @ values)

    def outline(self, present: Bools) -> Trace:
        """Where the body of the present elements (n_elements,) ends."""
        return self._trace(self.faces.free(present))

    def edges(self, present: Bools) -> Trace:
        """Edges of the present elements (n_elements,)."""
        rows = np.flatnonzero(present[self.faces.element])
        _, first = np.unique(self.faces.face[rows], return_index=True)
        return self._trace(rows[first])

    def borders(self, label: Ints) -> Trace:
        """Where elements (n_elements,) of different labels meet; none at those labelled below 0."""
        rows = self.faces.side_by_side
        rows = rows[label[self.faces.element[rows]] >= 0]
        first, second = rows[:-1], rows[1:]
        same = self.faces.face[first] == self.faces.face[second]
        differ = label[self.faces.element[first]] != label[self.faces.element[second]]
        return self._trace(first[same & differ])

    def _trace(self, rows: Ints) -> Trace:
        parts = [
            _edge_trace(self.mesh, self.plane, _around(patch.nodes, patch.kind))
            for patch in patches(self.mesh, self.faces, rows)
        ]
        none = np.empty((0, 2), dtype=np.int64)
        if not parts:
            return Trace(none, none, none.astype(np.float64))
        return Trace(*(np.concatenate([getattr(p, key) for p in parts]) for key in ("a", "b", "w")))


class SheetMaker:
    """Makes sheets of one mesh; faces and doubled nodes are found once."""

    def __init__(self, mesh: Mesh) -> None:
        self.mesh = mesh
        self.label = group_labels(mesh)

    @cached_property
    def faces(self) -> FaceTable:
        """The faces of all elements."""
        return face_table(self.mesh)

    @cached_property
    def corners(self) -> DoubledCorners:
        """Corner nodes, doubled where groups meet."""
        keys, elements = [], []
        for block, span in spans(self.mesh.blocks):
            nodes = block.nodes[:, : CELLS[block.kind].n_corners]
            keys.append(self.label[span][:, None] * self.mesh.n_nodes + nodes)
            elements.append(np.repeat(np.arange(span.start, span.stop), nodes.shape[1]))
        unique, corner = np.unique(np.concatenate([k.ravel() for k in keys]), return_inverse=True)
        ends = np.cumsum([k.size for k in keys])[:-1]
        of = [part.reshape(k.shape) for part, k in zip(np.split(corner, ends), keys, strict=True)]
        node = unique % self.mesh.n_nodes
        return DoubledCorners(np.concatenate(elements), corner, node, tuple(of))

    def flat(self) -> Sheet:
        """The sheet of a plane mesh."""
        return self._sheet(None, *self._pieces(np.ones(self.mesh.n_elements, dtype=bool)))

    def cut(self, plane: Plane) -> Sheet:
        """The sheet in which a plane cuts a mesh of solids."""
        away = _distance(self.mesh, plane)
        met = [
            (away[block.nodes] < 0).any(axis=1) & (away[block.nodes] > 0).any(axis=1)
            for block in self.mesh.blocks
        ]
        at_nodes, at_corners, tets, element = self._pieces(np.concatenate(met))
        distance = np.asarray(at_nodes @ self.mesh.points[:, plane.axis]) - plane.value
        distance = _never_zero(distance, self.mesh, plane)
        pairs, element = _cut_tets(tets, distance, element)
        pairs, n = np.sort(pairs.reshape(-1, 2), axis=1), len(distance)
        unique, point = np.unique(pairs[:, 0] * n + pairs[:, 1], return_inverse=True)
        a, b = unique // n, unique % n
        w = distance[a] / (distance[a] - distance[b])
        means = (_between(matrix, a, b, w) for matrix in (at_nodes, at_corners))
        return self._sheet(plane, *means, point.reshape(-1, 3), element)

    def _sheet(self, plane: Plane | None, *parts: Any) -> Sheet:
        return Sheet(self.mesh, plane, self.corners, self.faces, *parts)

    def _pieces(self, chosen: Bools) -> tuple[csr_array, csr_array, Ints, Ints]:
        """The triangles or tetrahedra of some elements (n_elements,), as a `Sheet` has them.

        Their points are the doubled corners, and after these the inner points of elements.
        """
        n_corners, n_nodes = len(self.corners.node), self.mesh.n_nodes
        every, one = np.arange(n_corners), np.ones((n_corners, 1))
        nodes = [_means(self.corners.node[:, None], one, n_nodes)]
        corners = [_means(every[:, None], one, n_corners)]
        simplices, elements, first = [], [], n_corners
        for (block, span), doubled in zip(spans(self.mesh.blocks), self.corners.of, strict=True):
            rows = np.flatnonzero(chosen[span])
            parts = _parts_of(block.kind)
            own = doubled[rows]
            if inner := len(parts.of_nodes):
                label = self.label[span][rows]
                number, which = _inner_points(block.nodes[rows], parts, label, n_nodes)
                own = np.hstack([own, first + number])
                row, local = rows[which // inner], which % inner
                nodes.append(_means(block.nodes[row], parts.of_nodes[local], n_nodes))
                corners.append(_means(doubled[row], parts.of_corners[local], n_corners))
                first += len(which)
            simplices.append(own[:, parts.simplices].reshape(-1, parts.simplices.shape[1]))
            elements.append(np.repeat(span.start + rows, len(parts.simplices)))
        at_nodes, at_corners = (vstack(means, format="csr") for means in (nodes, corners))
        return at_nodes, at_corners, np.concatenate(simplices), np.concatenate(elements)


def _means(columns: Ints, weights: Floats, n: int) -> csr_array:
    """The means (m, n) with the terms (m, k), without those that are rounding errors."""
    rows = np.repeat(np.arange(len(columns)), columns.shape[1])
    kept = np.abs(weights.ravel()) > _ROUNDING
    terms = weights.ravel()[kept], (rows[kept], columns.ravel()[kept])
    return csr_array(terms, shape=(len(columns), n))


def _between(means: csr_array, a: Ints, b: Ints, w: Floats) -> csr_array:
    """The means at the weights w (k,) from those in the rows a (k,) to those in the rows b."""
    return csr_array(diags_array(1 - w) @ means[a] + diags_array(w) @ means[b])


@dataclass(frozen=True)
class _SubElements:
    """How an element is taken apart.

    Args:
        simplices: (s, 3 or 4) its triangles or tetrahedra between its corners and inner points.
        of_nodes: (k, n_nodes) its shape functions at the inner points.
        of_corners: (k, n_corners) those of its corners alone.
        node: (k,) the node of the element that an inner point is; -1 for none.
    """

    simplices: Ints
    of_nodes: Floats
    of_corners: Floats
    node: Ints


@lru_cache
def _parts_of(kind: str) -> _SubElements:
    """Elements of order 1 by their corners; of order 2 also by the middles of all edges."""
    cell = CELLS[kind]
    simplices = np.array(cell.shape.simplices)
    if cell.order == 1:
        none = np.empty((0, cell.n_nodes))
        return _SubElements(simplices, none, none, np.empty(0, np.int64))
    number: dict[tuple[int, int], int] = {}

    def between(a: int, b: int) -> int:
        return number.setdefault((min(a, b), max(a, b)), cell.n_corners + len(number))

    pieces = []
    for simplex in simplices.tolist():
        middle = {
            (i, j): between(simplex[i], simplex[j]) for i, j in combinations(range(len(simplex)), 2)
        }
        for piece in _SMALLER[len(simplex)]:
            pieces.append([simplex[i] if i == j else middle[i, j] for i, j in piece])
    corners = np.array(cell.shape.corners, dtype=np.float64)
    xi = np.array([(corners[a] + corners[b]) / 2 for a, b in number])
    edges = [tuple(sorted(edge)) for edge in cell.edges]
    node = [cell.n_corners + edges.index(pair) if pair in edges else -1 for pair in number]
    straight = reference_element(f"{cell.shape.name}{cell.n_corners}")
    return _SubElements(
        np.array(pieces), reference_element(kind).shapes(xi), straight.shapes(xi), np.array(node)
    )


_SMALLER = {
    3: (
        ((0, 0), (0, 1), (0, 2)), ((0, 1), (1, 1), (1, 2)), ((0, 2), (1, 2), (2, 2)),
        ((0, 1), (1, 2), (0, 2)),
    ),
    4: (
        ((0, 0), (0, 1), (0, 2), (0, 3)), ((1, 1), (0, 1), (1, 2), (1, 3)),
        ((2, 2), (0, 2), (1, 2), (2, 3)), ((3, 3), (0, 3), (1, 3), (2, 3)),
        ((0, 1), (0, 2), (0, 3), (1, 3)), ((0, 1), (0, 2), (1, 2), (1, 3)),
        ((0, 2), (0, 3), (1, 3), (2, 3)), ((0, 2), (1, 2), (1, 3), (2, 3)),
    ),
}  # fmt: skip
"""Corners to smaller triangles (tetrahedra); a pair is the middle between two of the corners."""


def _inner_points(nodes: Ints, parts: _SubElements, label: Ints, n_nodes: int) -> tuple[Ints, Ints]:
    """Numbers (m, k) of the inner points of elements; where each of them is first.

    Neighbours of one label share those that are nodes.

    Args:
        nodes: (m, n_a) of the elements.
        parts: how they are taken apart.
        label: (m,) of the elements.
        n_nodes: of the mesh.
    """
    m, k = len(nodes), len(parts.node)
    own = np.arange(m * k).reshape(m, k) + (int(label.max(initial=0)) + 1) * n_nodes
    shared = label[:, None] * n_nodes + nodes[:, np.maximum(parts.node, 0)]
    keys = np.where(parts.node >= 0, shared, own)
    _, first, number = np.unique(keys, return_index=True, return_inverse=True)
    return number.reshape(m, k), first


def group_labels(mesh: Mesh) -> Ints:
    """(n_elements,) a number for the group of every element; 0 where it is in none."""
    label = np.zeros(mesh.n_elements, dtype=np.int64)
    for number, members in enumerate(mesh.groups.values(), start=1):
        label[members] = number
    return label


def _distance(mesh: Mesh, plane: Plane) -> Floats:
    """Signed distance of the nodes from the plane, never 0, so that no corner lies on the cut."""
    return _never_zero(mesh.points[:, plane.axis] - plane.value, mesh, plane)


def _never_zero(distance: Floats, mesh: Mesh, plane: Plane) -> Floats:
    least = 1e-9 * float(np.ptp(mesh.points[:, plane.axis]))
    return np.asarray(np.where(np.abs(distance) < least, least, distance))


def _cut_tets(tets: Ints, distance: Floats, number: Ints) -> tuple[Ints, Ints]:
    """Cut edges (m, 3, 2) of triangles in which tetrahedra (n, 4) are cut; their elements."""
    above = distance[tets] > 0
    count = above.sum(axis=1)
    single = np.flatnonzero((count == 1) | (count == 3))
    double = np.flatnonzero(count == 2)
    alone = np.argmax(above[single] == (count[single] == 1)[:, None], axis=1)
    lone = tets[single, alone]
    others = np.take_along_axis(tets[single], _OTHERS[alone], axis=1)
    triangles = np.stack([np.broadcast_to(lone[:, None], others.shape), others], axis=2)
    order = np.argsort(~above[double], axis=1, kind="stable")
    p, q, r, s = np.take_along_axis(tets[double], order, axis=1).T
    ring = np.stack([np.stack(e, axis=1) for e in ((p, r), (p, s), (q, s), (q, r))], axis=1)
    pairs = np.concatenate([triangles, ring[:, [0, 1, 2]], ring[:, [0, 2, 3]]])
    return pairs, np.concatenate([number[single], number[double], number[double]])


def _around(nodes: Ints, kind: str) -> Ints:
    """Nodes (n, k) of faces in their order around each; those of a line from end to end."""
    cell = CELLS[kind]
    n = cell.n_corners
    if nodes.shape[1] == n:
        return nodes
    if cell.dim == 1:
        return nodes[:, [0, 2, 1]]
    order = [k for pair in zip(range(n), range(n, 2 * n), strict=True) for k in pair]
    return np.asarray(nodes[:, order])


def _edge_trace(mesh: Mesh, plane: Plane | None, nodes: Ints) -> Trace:
    """The segments of faces (n, k): themselves in a plane mesh, else where they are cut."""
    if plane is None:
        pairs = np.concatenate([nodes[:, k : k + 2] for k in range(nodes.shape[1] - 1)])
        return Trace(pairs, pairs, np.zeros(pairs.shape))
    distance = _distance(mesh, plane)
    following = np.roll(nodes, -1, axis=1)
    crossed = (distance[nodes] > 0) != (distance[following] > 0)
    cut = np.flatnonzero(crossed.sum(axis=1) == 2)
    where = np.argsort(~crossed[cut], axis=1, kind="stable")[:, :2]
    a = np.take_along_axis(nodes[cut], where, axis=1)
    b = np.take_along_axis(following[cut], where, axis=1)
    return Trace(a, b, distance[a] / (distance[a] - distance[b]))
