"""Flat pieces of a mesh that can be coloured and outlined: a plane mesh, or a cut through solids.

Every point of a *sheet* lies on a line between two nodes a and b at the weight w,

    x = (1 - w) x_a + w x_b,

with a = b and w = 0 in a plane mesh. So one drawing code serves both: what is known at nodes is
known on the sheet. Solids are cut as tetrahedra: a plane that leaves one corner alone meets a
triangle, one that parts two from two a quadrilateral. Lines (outlines, element edges) are cuts of
the faces of elements, so that the tetrahedra inside a hexahedron stay unseen.

Nodes are doubled where groups of elements meet (`DoubledCorners`): what is averaged at nodes may
jump between rock and lining.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from geoident.fem.faces import FaceTable, face_table, patches
from geoident.model.arrays import Bools, Floats, Ints
from geoident.model.cells import CELLS
from geoident.model.mesh import Mesh, spans

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


@dataclass(frozen=True)
class Sheet:
    """A flat piece of a mesh as triangles.

    Args:
        mesh: what it is a piece of.
        plane: the cut, or None for a plane mesh.
        corners: the doubled nodes.
        faces: the faces of the mesh.
        a: (n,) first doubled node of every point.
        b: (n,) second one.
        w: (n,) weight of the second.
        triangles: (m, 3) points.
        element: (m,) element of each triangle.
    """

    mesh: Mesh
    plane: Plane | None
    corners: DoubledCorners
    faces: FaceTable
    a: Ints
    b: Ints
    w: Floats
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

    def of_nodes(self, values: Floats) -> Floats:
        """What is known at nodes (n_nodes, ...) at the points of the sheet."""
        return self.of_corners(values[self.corners.node])

    def of_corners(self, values: Floats) -> Floats:
        """What is known at doubled nodes (n_doubled, ...) at the points of the sheet."""
        w = self.w.reshape(-1, *(1,) * (values.ndim - 1))
        first, second = values[self.a], values[self.b]
        return np.asarray(np.where(w == 0, first, (1 - w) * first + w * second))

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
        inside = label[self.faces.element] >= 0
        rows = np.flatnonzero(inside)[np.argsort(self.faces.face[inside], kind="stable")]
        first, second = rows[:-1], rows[1:]
        same = self.faces.face[first] == self.faces.face[second]
        differ = label[self.faces.element[first]] != label[self.faces.element[second]]
        return self._trace(first[same & differ])

    def _trace(self, rows: Ints) -> Trace:
        parts = [
            _edge_trace(self.mesh, self.plane, patch.nodes[:, : CELLS[patch.kind].n_corners])
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
        parts, elements = [], []
        for (block, span), corners in zip(spans(self.mesh.blocks), self.corners.of, strict=True):
            for triangle in CELLS[block.kind].shape.simplices:
                parts.append(corners[:, triangle])
                elements.append(np.arange(span.start, span.stop))
        points = np.arange(len(self.corners.node))
        ends = points, points, np.zeros(len(points))
        triangles, element = np.vstack(parts), np.concatenate(elements)
        return Sheet(self.mesh, None, self.corners, self.faces, *ends, triangles, element)

    def cut(self, plane: Plane) -> Sheet:
        """The sheet in which a plane cuts a mesh of solids."""
        distance = _distance(self.mesh, plane)[self.corners.node]
        ends, elements = [], []
        for (block, span), corners in zip(spans(self.mesh.blocks), self.corners.of, strict=True):
            number = np.arange(span.start, span.stop)
            for tet in CELLS[block.kind].shape.simplices:
                pairs, of = _cut_tets(corners[:, tet], distance, number)
                ends.append(pairs)
                elements.append(of)
        pairs = np.sort(np.concatenate(ends).reshape(-1, 2), axis=1)
        n = len(self.corners.node)
        unique, point = np.unique(pairs[:, 0] * n + pairs[:, 1], return_inverse=True)
        a, b = unique // n, unique % n
        w = distance[a] / (distance[a] - distance[b])
        triangles, element = point.reshape(-1, 3), np.concatenate(elements)
        return Sheet(self.mesh, plane, self.corners, self.faces, a, b, w, triangles, element)


def group_labels(mesh: Mesh) -> Ints:
    """(n_elements,) a number for the group of every element; 0 where it is in none."""
    label = np.zeros(mesh.n_elements, dtype=np.int64)
    for number, members in enumerate(mesh.groups.values(), start=1):
        label[members] = number
    return label


def element_centres(mesh: Mesh) -> Floats:
    """(n_elements, dim) means of the corners, m."""
    corners = [block.nodes[:, : CELLS[block.kind].n_corners] for block in mesh.blocks]
    return np.concatenate([mesh.points[nodes].mean(axis=1) for nodes in corners])


def _distance(mesh: Mesh, plane: Plane) -> Floats:
    """Signed distance of the nodes from the plane, never 0, so that no corner lies on the cut."""
    distance = mesh.points[:, plane.axis] - plane.value
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


def _edge_trace(mesh: Mesh, plane: Plane | None, nodes: Ints) -> Trace:
    """The segments of faces (n, n_corners): themselves in a plane mesh, else where they are cut."""
    if plane is None:
        return Trace(nodes, nodes, np.zeros(nodes.shape))
    distance = _distance(mesh, plane)
    following = np.roll(nodes, -1, axis=1)
    crossed = (distance[nodes] > 0) != (distance[following] > 0)
    cut = np.flatnonzero(crossed.sum(axis=1) == 2)
    where = np.argsort(~crossed[cut], axis=1, kind="stable")[:, :2]
    a = np.take_along_axis(nodes[cut], where, axis=1)
    b = np.take_along_axis(following[cut], where, axis=1)
    return Trace(a, b, distance[a] / (distance[a] - distance[b]))
