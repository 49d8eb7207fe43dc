"""Faces of elements: which element stands behind a facet, and where the body ends.

Faces are recognised by their corner nodes. The table is built once per mesh; what is a free face
depends on which elements are present, and is asked for each time.

Distance of points from faces: segments in the plane, triangles in space.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from geoident.fem.elements import reference_element
from geoident.model.arrays import Bools, Floats, Ints
from geoident.model.mesh import ElementBlock, Mesh


@dataclass(frozen=True)
class FaceTable:
    """Every face of every element, once per element.

    Args:
        element: (n_f,) element index behind the face.
        face: (n_f,) identity: faces of neighbours that coincide have the same one.
        block: (n_f,) block of the element.
        local: (n_f,) number of the face in its element.
        n_faces: number of different faces.
        keys: (n_faces,) key of each different face, ascending.
    """

    element: Ints
    face: Ints
    block: Ints
    local: Ints
    n_faces: int
    keys: Ints

    def free(self, present: Bools) -> Ints:
        """Rows (r,) that are outer faces of the body of present elements (n_elements,)."""
        rows = np.flatnonzero(present[self.element])
        sharing = np.bincount(self.face[rows], minlength=self.n_faces)
        return np.asarray(rows[sharing[self.face[rows]] == 1])

    def find(self, facets: ElementBlock) -> Ints:
        """Identity (n,) of the face at each of n facets, -1 where no element has it."""
        n_corners = reference_element(facets.kind).n_corners
        wanted = _keys(facets.nodes[:, :n_corners])
        rows = np.minimum(np.searchsorted(self.keys, wanted), self.n_faces - 1)
        return np.asarray(np.where(self.keys[rows] == wanted, rows, -1))


def face_table(mesh: Mesh) -> FaceTable:
    """The faces of all elements of a mesh."""
    keys, elements, blocks, locals_ = [], [], [], []
    first = 0
    for number, block in enumerate(mesh.blocks):
        reference = reference_element(block.kind)
        for local, nodes in enumerate(reference.faces):
            corners = [node for node in nodes if node < reference.n_corners]
            keys.append(_keys(block.nodes[:, corners]))
            elements.append(np.arange(first, first + len(block)))
            blocks.append(np.full(len(block), number))
            locals_.append(np.full(len(block), local))
        first += len(block)
    unique, face = np.unique(np.concatenate(keys), return_inverse=True)
    return FaceTable(
        np.concatenate(elements), face.astype(np.int64), np.concatenate(blocks),
        np.concatenate(locals_), len(unique), unique,
    )  # fmt: skip


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
    offsets = np.cumsum([0, *(len(block) for block in mesh.blocks)])
    found: dict[str, list[tuple[Ints, Ints]]] = {}
    for number, block in enumerate(mesh.blocks):
        reference = reference_element(block.kind)
        for local, (face, kind) in enumerate(
            zip(reference.faces, reference.face_kinds, strict=True)
        ):
            mine = rows[(table.block[rows] == number) & (table.local[rows] == local)]
            if len(mine):
                element = table.element[mine]
                nodes = block.nodes[element - offsets[number]][:, list(face)]
                found.setdefault(kind, []).append((nodes, element))
    return tuple(
        FacetPatch(kind, np.vstack([n for n, _ in parts]), np.concatenate([e for _, e in parts]))
        for kind, parts in found.items()
    )


def face_centre(mesh: Mesh, nodes: Ints) -> Floats:
    """Mean of the nodes of a face, (dim,) m, for messages."""
    return np.asarray(mesh.points[nodes].mean(axis=0))


def _keys(corners: Ints) -> Ints:
    """(n,) one number for each face, from its three smallest corner nodes.

    Three corners tell the faces of a valid mesh apart; 21 bits each hold two million nodes, and
    larger meshes are beyond a direct solver on one machine.
    """
    smallest = np.sort(corners, axis=1)[:, :3]
    key = np.zeros(len(corners), dtype=np.int64)
    for column in smallest.T:
        key = (key << 21) | column
    return key


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
        n_corners = reference_element(patch.kind).n_corners
        for k in range(1, n_corners - 1) if mesh.dim == 3 else (1,):
            corners = mesh.points[patch.nodes[:, [0, k, k + 1] if mesh.dim == 3 else [0, 1]]]
            away = _to_triangles if mesh.dim == 3 else _to_segments
            nearest = min(nearest, float(away(corners, point).min(initial=np.inf)))
    return nearest


def _to_segments(ends: Floats, point: Floats) -> Floats:
    """(n,) distances of a point from segments (n, 2, dim)."""
    start, along = ends[:, 0], ends[:, 1] - ends[:, 0]
    length = np.einsum("ij,ij->i", along, along)
    t = np.einsum("ij,ij->i", point - start, along) / np.where(length > 0, length, 1.0)
    nearest = start + np.clip(t, 0.0, 1.0)[:, None] * along
    return np.asarray(np.linalg.norm(point - nearest, axis=1))


def _to_triangles(corners: Floats, point: Floats) -> Floats:
    """(n,) distances of a point from triangles (n, 3, 3)."""
    a, b, c = corners.swapaxes(0, 1)
    normal = np.cross(b - a, c - a)
    area = np.einsum("ij,ij->i", normal, normal)
    v = np.einsum("ij,ij->i", np.cross(point - a, c - a), normal) / area
    w = np.einsum("ij,ij->i", np.cross(b - a, point - a), normal) / area
    above = np.abs(np.einsum("ij,ij->i", point - a, normal)) / np.sqrt(area)
    inside = (v >= 0) & (w >= 0) & (v + w <= 1)
    edges = [_to_segments(corners[:, pair], point) for pair in ([0, 1], [1, 2], [2, 0])]
    return np.asarray(np.where(inside, above, np.min(edges, axis=0)))
