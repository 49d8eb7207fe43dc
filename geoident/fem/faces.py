"""Faces of elements: which element stands behind a facet, and where the body ends.

Faces are recognised by their corner nodes. The table is built once per mesh; what is a free face
depends on which elements are present, and is asked for each time.

Distance of points from faces: segments in the plane, triangles in space.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Self

import numpy as np

from geoident.fem.near import points_in_boxes
from geoident.model.arrays import Bools, Floats, Ints
from geoident.model.cells import CELLS
from geoident.model.mesh import ElementBlock, Mesh, spans


@dataclass(frozen=True)
class FaceTable:
    """Every face of every element, once per element.

    Args:
        element: (n_f,) element index behind the face.
        face: (n_f,) identity: faces of neighbours that coincide have the same one.
        block: (n_f,) block of the element.
        local: (n_f,) number of the face in its element.
        keys: what tells the faces apart.
    """

    element: Ints
    face: Ints
    block: Ints
    local: Ints
    keys: FaceKeys

    @property
    def n_faces(self) -> int:
        """Number of different faces."""
        return len(self.keys.sorted)

    @cached_property
    def side_by_side(self) -> Ints:
        """All rows (n_f,), those of one face behind each other in the order of the table."""
        return np.argsort(self.face, kind="stable")

    def free(self, present: Bools) -> Ints:
        """Rows (r,) that are outer faces of the body of present elements (n_elements,)."""
        rows = np.flatnonzero(present[self.element])
        sharing = np.bincount(self.face[rows], minlength=self.n_faces)
        return np.asarray(rows[sharing[self.face[rows]] == 1])

    def by_place(self, mesh: Mesh, rows: Ints) -> Iterator[tuple[ElementBlock, int, Ints, Ints]]:
        """Some rows of the table, those of one face of one kind of element together.

        Args:
            mesh: whose faces they are.
            rows: (r,) of the table.

        Yields:
            The block, the number of the face in its elements, the rows (k,), and the nodes
            (k, n_a) of the faces, their corners first.
        """
        for number, (block, span) in enumerate(spans(mesh.blocks)):
            for local, face in enumerate(CELLS[block.kind].faces):
                at = rows[(self.block[rows] == number) & (self.local[rows] == local)]
                yield block, local, at, block.nodes[self.element[at] - span.start][:, face]

    def find(self, facets: ElementBlock) -> Ints:
        """Identity (n,) of the face at each of n facets, -1 where no element has it."""
        return self.keys.find(facets.nodes[:, : CELLS[facets.kind].n_corners])


def face_table(mesh: Mesh) -> FaceTable:
    """The faces of all elements of a mesh."""
    corners, elements, blocks, locals_ = [], [], [], []
    for number, (block, span) in enumerate(spans(mesh.blocks)):
        for local, face in enumerate(CELLS[block.kind].shape.faces):
            corners.append(block.nodes[:, face])
            elements.append(np.arange(span.start, span.stop))
            blocks.append(np.full(len(block), number))
            locals_.append(np.full(len(block), local))
    keys, face_of = FaceKeys.of(corners, mesh.n_nodes)
    return FaceTable(
        np.concatenate(elements), face_of, np.concatenate(blocks), np.concatenate(locals_), keys
    )


@dataclass(frozen=True)
class FaceKeys:
    """Numbers by which faces are known, exact for meshes of any size.

    Three corners tell the faces of a valid mesh apart, and triangles are told from quadrilaterals.
    So a face with the smallest corners a < b < c is the pair of a and the tail 2 (b n + c) +
    (whether it has four corners), n nodes in all. Where 2 n^3 is no 64-bit integer, the tails are
    numbered.

    Args:
        n_nodes: n.
        tails: (k,) the different tails, ascending; empty where they need not be numbered.
        sorted: (n_faces,) key of each different face, ascending.
        original: (n,) of a mesh that is split along faces, which node of before each node is;
            None where they are the same.
    """

    n_nodes: int
    tails: Ints
    sorted: Ints
    original: Ints | None = None

    @classmethod
    def of(cls, corners: Sequence[Ints], n_nodes: int) -> tuple[Self, Ints]:
        """The keys of some faces, and the identity of each face.

        Args:
            corners: the corner nodes of faces, (n_f, n_corners) each, n_corners from 1 to 4.
            n_nodes: number of nodes of the mesh.
        """
        pairs = [_head_and_tail(rows, n_nodes) for rows in corners]
        head, tail = (np.concatenate(part) for part in zip(*pairs, strict=True))
        tails = np.unique(tail) if 2 * n_nodes**3 >= 2**63 else np.empty(0, np.int64)
        bare = cls(n_nodes, tails, np.empty(0, np.int64))
        keys, identity = np.unique(bare._joined(head, tail), return_inverse=True)
        return replace(bare, sorted=keys), identity.astype(np.int64)

    def find(self, corners: Ints) -> Ints:
        """Identity (n,) of faces with corner nodes (n, n_corners), -1 for those not known."""
        corners = corners if self.original is None else self.original[corners]
        head, tail = _head_and_tail(corners, self.n_nodes)
        wanted = self._joined(head, tail)
        rows = np.minimum(np.searchsorted(self.sorted, wanted), len(self.sorted) - 1)
        known = self.sorted[rows] == wanted
        if len(self.tails):
            known &= self.tails[self._place(tail)] == tail
        return np.asarray(np.where(known, rows, -1))

    def _joined(self, head: Ints, tail: Ints) -> Ints:
        """(n,) head and tail as one number."""
        if len(self.tails):
            return head * len(self.tails) + self._place(tail)
        return np.asarray(head * (2 * self.n_nodes**2) + tail)

    def _place(self, tail: Ints) -> Ints:
        return np.minimum(np.searchsorted(self.tails, tail), len(self.tails) - 1)


def _head_and_tail(corners: Ints, n_nodes: int) -> tuple[Ints, Ints]:
    """The smallest corner of faces (n, n_corners), and the others as one number."""
    smallest = np.sort(corners, axis=1)[:, :3]
    tail = np.zeros(len(corners), dtype=np.int64)
    for column in smallest[:, 1:].T:
        tail = tail * n_nodes + column
    return smallest[:, 0], 2 * tail + (corners.shape[1] == 4)


@dataclass(frozen=True)
class FacetPatch:
    """Faces of one kind with the side on which their body lies.

    Args:
        kind: kind of the faces.
        nodes: (n, n_a) their nodes, oriented so that the normal points out of the body.
        element: (n,) element index behind each face.
    """

    kind: str
    nodes: Ints
    element: Ints


def patches(mesh: Mesh, table: FaceTable, rows: Ints) -> tuple[FacetPatch, ...]:
    """The faces in some rows of the table, sorted into patches of one kind each.

    Args:
        mesh: the mesh.
        table: its faces.
        rows: (r,) of the table.
    """
    by_kind: dict[str, list[tuple[Ints, Ints]]] = {}
    for block, local, at, nodes in table.by_place(mesh, rows):
        if len(at):
            kind = CELLS[block.kind].face_kinds[local]
            by_kind.setdefault(kind, []).append((nodes, table.element[at]))
    return tuple(
        FacetPatch(kind, np.vstack([n for n, _ in parts]), np.concatenate([e for _, e in parts]))
        for kind, parts in by_kind.items()
    )


def load_faces(mesh: Mesh, table: FaceTable, group: str) -> Ints:
    """Identity (k,) in the face table of every facet of a group, -1 where it borders no element.

    Args:
        mesh: the mesh.
        table: its faces.
        group: name of the group.
    """
    faces = np.concatenate([table.find(block) for block in mesh.facets])
    return np.asarray(faces[mesh.facet_groups[group]])


def load_patches(
    mesh: Mesh, table: FaceTable, group: str, present: Bools
) -> tuple[FacetPatch, ...] | None:
    """The loaded free faces of the present body; None if a face is not free (inside, or absent).

    Args:
        mesh: the mesh.
        table: its faces.
        group: name of the group.
        present: (n_elements,) which elements are there.
    """
    wanted = np.unique(load_faces(mesh, table, group))
    rows = table.free(present)
    rows = rows[np.isin(table.face[rows], wanted)]
    if len(rows) != len(wanted):
        return None
    return patches(mesh, table, rows)


def free_patches(
    mesh: Mesh, table: FaceTable, group: str, present: Bools
) -> tuple[FacetPatch, ...]:
    """Those faces of a group that are free faces of the present body; none where no face is.

    Args:
        mesh: the mesh.
        table: its faces.
        group: name of the group.
        present: (n_elements,) which elements are there.
    """
    wanted, rows = np.unique(load_faces(mesh, table, group)), table.free(present)
    return patches(mesh, table, rows[np.isin(table.face[rows], wanted)])


def nonconforming(mesh: Mesh, table: FaceTable) -> Floats:
    """Centres (k, dim), m, of quadrilaterals against which other elements have triangles.

    Such neighbours share corners but not a face, so a gap can open between them.
    """
    rows = table.free(np.ones(mesh.n_elements, dtype=bool))
    centres = [np.empty((0, mesh.dim))]
    for patch in patches(mesh, table, rows):
        corners = patch.nodes[:, : CELLS[patch.kind].n_corners]
        if corners.shape[1] == 4:
            triangles = (np.delete(corners, corner, axis=1) for corner in range(4))
            against = np.any([table.keys.find(three) >= 0 for three in triangles], axis=0)
            centres.append(mesh.points[corners[against]].mean(axis=1))
    return np.concatenate(centres)


def hanging_nodes(mesh: Mesh, table: FaceTable) -> Ints:
    """Nodes (k,) that stand inside an outer face or edge of an element that does not have them.

    The element moves there as its own nodes say, so a gap can open or parts can overlap. Faces
    count as plane and edges as straight; nodes at the place of another node are not among them.
    """
    faces = patches(mesh, table, table.free(np.ones(mesh.n_elements, dtype=bool)))
    outer = np.unique(np.concatenate([patch.nodes.ravel() for patch in faces]))
    hanging = [np.empty(0, dtype=np.int64)]
    for patch in faces:
        corners = mesh.points[patch.nodes[:, : CELLS[patch.kind].n_corners]]
        centre = corners.mean(axis=1)
        reach = np.linalg.norm(corners - centre[:, None], axis=2).max(axis=1)
        spare = 2.0 * _AT_ONE_PLACE * reach[:, None]
        low, high = corners.min(axis=1) - spare, corners.max(axis=1) + spare
        near, row = points_in_boxes(mesh.points[outer], low, high)
        node = outer[near]
        own = np.linalg.norm(mesh.points[patch.nodes[row]] - mesh.points[node][:, None], axis=2)
        other = own.min(axis=1) > _AT_ONE_PLACE * reach[row]
        row, node = row[other], node[other]
        for piece in CELLS[patch.kind].shape.simplices:
            simplex = mesh.points[patch.nodes[row][:, piece]]
            away = _to_triangles if mesh.dim == 3 else _to_segments
            hanging.append(node[away(simplex, mesh.points[node]) <= _AT_ONE_PLACE * reach[row]])
    return np.unique(np.concatenate(hanging))


_AT_ONE_PLACE = 1e-6
"""Distance in parts of the size of a face below which a node is on it."""


def distance_to_faces(mesh: Mesh, patches: tuple[FacetPatch, ...], point: Floats) -> float:
    """Distance of a point from the nearest of some faces, m; their edges count as straight.

    Infinite if there are none.

    Args:
        mesh: the mesh.
        patches: the faces.
        point: (dim,) m.
    """
    nearest = np.inf
    for patch in patches:
        for piece in CELLS[patch.kind].shape.simplices:
            corners = mesh.points[patch.nodes[:, piece]]
            away = _to_triangles if mesh.dim == 3 else _to_segments
            nearest = min(nearest, float(away(corners, point).min(initial=np.inf)))
    return nearest


def _to_segments(ends: Floats, point: Floats) -> Floats:
    """(n,) distances of a point, or of one for each, (n, dim), from segments (n, 2, dim)."""
    start, along = ends[:, 0], ends[:, 1] - ends[:, 0]
    length = np.einsum("ij,ij->i", along, along)
    t = np.einsum("ij,ij->i", point - start, along) / np.where(length > 0, length, 1.0)
    nearest = start + np.clip(t, 0.0, 1.0)[:, None] * along
    return np.asarray(np.linalg.norm(point - nearest, axis=1))


def _to_triangles(corners: Floats, point: Floats) -> Floats:
    """(n,) distances of a point, or of one for each, (n, 3), from triangles (n, 3, 3)."""
    a, b, c = corners.swapaxes(0, 1)
    normal = np.cross(b - a, c - a)
    area = np.einsum("ij,ij->i", normal, normal)
    v = np.einsum("ij,ij->i", np.cross(point - a, c - a), normal) / area
    w = np.einsum("ij,ij->i", np.cross(b - a, point - a), normal) / area
    above = np.abs(np.einsum("ij,ij->i", point - a, normal)) / np.sqrt(area)
    inside = (v >= 0) & (w >= 0) & (v + w <= 1)
    edges = [_to_segments(corners[:, pair], point) for pair in ([0, 1], [1, 2], [2, 0])]
    return np.asarray(np.where(inside, above, np.min(edges, axis=0)))
