"""Shells on faces of solid elements, as generalized strains of displacements and rotations.

A face is cut into flat triangles through its nodes, those on its edges too; a quadrilateral is cut
along both diagonals, each pair of halves with half of the stiffness, so that no diagonal is
preferred. Unknowns at a node are the displacement u of the ground there and a rotation vector
theta (`Mesh.rotations_of`). In axes 1, 2 and n, n the normal,

    bending    the discrete Kirchhoff triangle (Batoz, Bathe and Ho, International Journal for
               Numerical Methods in Engineering 15, 1980, 1771-1812): curvatures at the middles of
               the sides, no strain of shear. A side bends about the normal of the face there.
    membrane   of faces of second order the strain of the curved face itself, with the shape
               functions of the ground: in a triangle by the ties of MITC6, in a quadrilateral at
               two by two points, so that it does not lock. It loads the nodes as the ground does;
               flat triangles load them unevenly, by their kinks, and between them a thin lining
               bends. At each node a weak spring holds the rotation about the normal to that of the
               face.
               Of faces of first order the optimal triangle with drilling rotations theta_n of
               Felippa (Computer Methods in Applied Mechanics and Engineering 192, 2003, 2125-2168):
               mean strain with alpha = 3/2 and deviations at the middles of the sides with beta_0 =
               1/2. It bends in its plane without locking, and drilling needs no stabilisation.

With the weight w of each point, D = E t / (1 - nu^2),

    n_11 = D (e_11 + nu e_22)     m_11 = D t^2/12 (k_11 + nu k_22)     k_11 = -w,11
    n_12 = D (1 - nu)/2 g_12      m_12 = D t^2/12 (1 - nu)/2 g(k)_12

tension positive, a moment with tension on the side of n. As in `fem.structures` the rows of the
operator are sums and differences, so that each goes with one rigidity and any of E, t and nu may be
sought:

    e_11 + e_22   with  E t / (2 (1 - nu))          e_11 - e_22, g_12   with  E t / (2 (1 + nu))
    k_11 + k_22   with t^2/12 of that               k_11 - k_22, g(k)_12   likewise
"""

from __future__ import annotations

from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import scipy.sparse as sp

from geoident.fem.elements import reference_element
from geoident.fem.shell_strains import (
    axes_of,
    curvatures,
    curved_membrane,
    flat_membrane,
    on_faces,
    spins,
)
from geoident.fem.structures import Members
from geoident.model.arrays import Bools, Floats, Ints
from geoident.model.cells import CELLS
from geoident.model.mesh import Mesh, rows_in

_DIAGONALS = {
    "quad4": ((0, 1, 2), (0, 2, 3), (0, 1, 3), (1, 2, 3)),
    "quad8": (
        (0, 4, 7), (4, 1, 5), (5, 2, 6), (6, 3, 7), (4, 5, 7), (5, 6, 7), (4, 5, 6), (4, 6, 7),
    ),
}  # fmt: skip
"""Triangles of quadrilaterals."""

_SHARES = {"quad4": (0.5,) * 4, "quad8": (*(1.0,) * 4, *(0.5,) * 4)}
"""Part of the stiffness that each of them has."""

_RULES = {"tri6": "tri6", "quad8": "quad4"}
"""Kinds whose quadrature points are those of the membrane of curved faces."""

_SMOOTH = np.cos(np.radians(20.0))
"""Of the angle to their mean beyond which the normals of faces that meet make a fold."""

_DRILLING = 1e-2
"""Part of the shear stiffness of the membrane with which drilling is held."""


@dataclass(frozen=True)
class FlatTriangles:
    """The flat triangles of some faces.

    Args:
        nodes: (m, 3) nodes.
        face: (m,) which of the faces each is a part of.
        share: (m,) part of the stiffness that it has.
        normals: (m, 3, 3) unit normals of the surface in the middles of the sides 12, 23 and 31.
    """

    nodes: Ints
    face: Ints
    share: Floats
    normals: Floats


@dataclass(frozen=True, kw_only=True)
class ShellMembers(Members):
    """A shell.

    Its rows are component by component, first of the membrane, then of bending: sum, difference,
    shear, each at all points of its own; then those of drilling.

    Args:
        triangles: of which it is made.
        face_of: of the points of the membrane and of those of bending, the face of each.
        node_area: (n_nodes,) area of it that belongs to each node, m2.
        frames: (m, 3, 3) unit vectors 1, 2 and n of every triangle.
        area: (n_faces,) of the faces, m2.
        centres: (n_faces, 3) m.
        corners: (n_faces, 4, 3) m; the fourth of a triangle is NaN.
        side_known: (n_faces,) whether it is known to which side the normal should look.
    """

    triangles: FlatTriangles
    face_of: tuple[Ints, Ints]
    node_area: Floats
    frames: Floats
    area: Floats
    centres: Floats
    corners: Floats
    side_known: Bools

    def face_forces(self, forces: Floats) -> Floats:
        """Means (6, n_faces, ...) of n_11, n_22, n_12, m_11, m_22, m_12 over every face.

        Args:
            forces: q (n_rows, ...) of the shell.
        """
        flat = forces.reshape(len(forces), -1)
        total, apart, shear, bent, warp, twist = (self._means(row) @ flat for row in range(6))
        means = total + apart, total - apart, shear, bent + warp, bent - warp, twist
        return np.stack(means).reshape(6, len(self.area), *forces.shape[1:])

    @property
    def face_axes(self) -> Floats:
        """(n_faces, 3, 3) unit vectors 1, 2 and n in the middle of every face."""
        total = np.zeros((len(self.area), 3, 3))
        np.add.at(total, self.triangles.face, self.frames)
        return np.asarray(total / np.linalg.norm(total, axis=2, keepdims=True))

    def row(self, parts: Sequence[float], faces: Floats) -> sp.csr_array:
        """(1, n_rows) which sum of q is some sum of its means at a place.

        Args:
            parts: (6,) of the membrane's sum, difference and shear, and of those of bending.
            faces: (n_faces,) weights of the means of the faces in it.
        """
        chosen = [part * self._means(row) for row, part in enumerate(parts) if part]
        return sp.csr_array(sp.csr_array(faces[None]) @ sum(chosen[1:], chosen[0]))

    def _means(self, row: int) -> sp.csr_array:
        """(n_faces, n_rows) which sums of q are its means over the faces: see `row`."""
        bends, component = divmod(row, 3)
        face, n = self.face_of[bends], len(self.area)
        first = 3 * len(self.face_of[0]) * bends
        weight = self.weight[first : first + len(face)]
        share = weight / np.bincount(face, weight, minlength=n)[face]
        at = first + component * len(face) + np.arange(len(face))
        return sp.csr_array((share, (face, at)), shape=(n, len(self.weight)))


def flat_triangles(mesh: Mesh, faces: Ints, turned: Bools) -> FlatTriangles:
    """The triangles of some facets (n_faces,) of a mesh; faces are counted block by block.

    Args:
        mesh: the mesh.
        faces: numbers of the facets.
        turned: (n_faces,) for which the normal is that against the order of the nodes.
    """
    nodes, face, share, normals, first = [], [], [], [], 0
    for block, rows in rows_in(mesh.facets, faces):
        element, cell = reference_element(block.kind), CELLS[block.kind]
        pieces = np.array(_DIAGONALS.get(block.kind, cell.flat_pieces))
        back = turned[first : first + len(rows)]
        order = np.where(back[:, None, None], pieces[:, [0, 2, 1]], pieces)
        own = block.nodes[rows]
        nodes.append(np.take_along_axis(own[:, None], order, axis=2).reshape(-1, 3))
        places = element.nodes[order]
        gradients = element.gradients((places + np.roll(places, -1, axis=2)) / 2)
        along = np.einsum("nax,npsad->npsdx", mesh.points[own], gradients)
        normal = np.cross(along[..., 0, :], along[..., 1, :]).reshape(-1, 3, 3)
        normal *= np.repeat(np.where(back, -1.0, 1.0), len(pieces))[:, None, None]
        normals.append(normal / np.linalg.norm(normal, axis=2, keepdims=True))
        face.append(np.repeat(first + np.arange(len(rows)), len(pieces)))
        share.append(np.tile(_SHARES.get(block.kind, (1.0,) * len(pieces)), len(rows)))
        first += len(rows)
    of_all = np.concatenate(nodes)
    normal = _smoothed(of_all, np.concatenate(normals))
    return FlatTriangles(of_all, np.concatenate(face), np.concatenate(share), normal)


def _smoothed(nodes: Ints, normals: Floats) -> Floats:
    """Unit normals (m, 3, 3) on the sides of triangles (m, 3): the mean of those that meet there.

    Where they make a fold each keeps its own.

    Args:
        nodes: of the triangles.
        normals: (m, 3, 3) unit normals of their faces on the sides.
    """
    pairs = np.sort(np.stack([nodes, np.roll(nodes, -1, axis=1)], axis=2).reshape(-1, 2), axis=1)
    _, side = np.unique(pairs, axis=0, return_inverse=True)
    side, own = side.ravel(), normals.reshape(-1, 3)
    mean = np.stack([np.bincount(side, part) for part in own.T], axis=1)[side]
    mean = mean / np.maximum(np.linalg.norm(mean, axis=1, keepdims=True), 1e-12)
    folded = np.bincount(side, (mean * own).sum(axis=1) < _SMOOTH)[side] > 0
    return np.where(folded[:, None], own, mean).reshape(normals.shape)


def corners_of(mesh: Mesh, faces: Ints) -> list[tuple[int, ...]]:
    """The corners of some facets, block by block as `flat_triangles` counts them."""
    return [
        tuple(corners)
        for block, rows in rows_in(mesh.facets, faces)
        for corners in block.nodes[rows][:, : CELLS[block.kind].n_corners].tolist()
    ]


def consistent_sides(corners: Sequence[tuple[int, ...]], side: Ints) -> tuple[Bools, Bools]:
    """Which faces are turned, so that all of a connected piece look to one side.

    That is the side which most of its faces look to.

    Args:
        corners: of every face, in its order around its normal.
        side: (n_faces,) 1 where the normal looks to the wanted side, -1 where it looks away, 0
            where neither is known.

    Returns:
        (n_faces,) which are turned, and for which the wanted side is known at all.
    """
    at_edge: dict[frozenset[int], list[tuple[int, bool]]] = {}
    for n, own in enumerate(corners):
        for a, b in zip(own, own[1:] + own[:1], strict=True):
            at_edge.setdefault(frozenset((a, b)), []).append((n, a < b))
    turned, known = (np.zeros(len(corners), dtype=np.bool_) for _ in range(2))
    seen = np.zeros(len(corners), dtype=np.bool_)
    for start in range(len(corners)):
        if seen[start]:
            continue
        seen[start], piece, waiting = True, [start], deque([start])
        while waiting:
            own = corners[at := waiting.popleft()]
            for pair in zip(own, own[1:] + own[:1], strict=True):
                meeting = at_edge[frozenset(pair)]
                if len(meeting) != 2:
                    continue
                (one, along), (other, beside) = meeting
                following = other if one == at else one
                if not seen[following]:
                    seen[following] = True
                    turned[following] = turned[at] ^ (along == beside)
                    piece.append(following)
                    waiting.append(following)
        looks = np.where(turned[piece], -1, 1) @ side[piece]
        known[piece] = looks != 0
        if looks < 0:
            turned[piece] = ~turned[piece]
    return turned, known


def shell_members(
    mesh: Mesh,
    faces: Ints,
    corners: Sequence[tuple[int, ...]],
    sides: tuple[Bools, Bools],
    axis: Floats,
) -> ShellMembers:
    """A shell on faces.

    Args:
        mesh: whose nodes have rotations there.
        faces: (n_faces,) facets of the mesh.
        corners: nodes of every face, in its order around its normal.
        sides: (n_faces,) for which the normal is that against the order of the nodes, and for
            which its side is known.
        axis: (3,) direction of axis 1, projected on every triangle; it is normal to none.
    """
    triangles = flat_triangles(mesh, faces, sides[0])
    x = mesh.points[triangles.nodes]
    normal = np.cross(x[:, 1] - x[:, 0], x[:, 2] - x[:, 0])
    frames = axes_of(normal, axis)
    part = np.linalg.norm(normal, axis=1) / 2 * triangles.share
    weight = np.repeat(part[:, None] / 3, 3, axis=1)
    bent = curvatures(x, frames, triangles.normals)
    bending = _Rows.of(bent, triangles.nodes, weight, triangles.face)
    membrane, drilling, node_area, first = [], [], np.zeros(mesh.n_nodes), 0
    for block, rows in rows_in(mesh.facets, faces):
        numbers = first + np.arange(len(rows))
        first += len(rows)
        if CELLS[block.kind].order == 1:
            here = np.isin(triangles.face, numbers)
            strains, nodes = flat_membrane(x[here], frames[here]), triangles.nodes[here]
            membrane.append(_Rows.of(strains, nodes, weight[here], triangles.face[here]))
            np.add.at(node_area, nodes, weight[here])
            continue
        element, nodes = reference_element(block.kind), block.nodes[rows]
        rule = reference_element(_RULES[block.kind])
        points, at = mesh.points[nodes], rule.points
        own = on_faces(points, at, element, axis)[1] * rule.weights
        strains = curved_membrane(points, at, element, axis)
        strains[sides[0][numbers], :, 2] *= -1.0  # with n axis 2 turns round, too
        membrane.append(_Rows.of(strains, nodes, own, numbers))
        np.add.at(node_area, nodes, own @ element.shapes(at))
        slopes, _, there, _ = on_faces(points, element.nodes, element, axis)
        held = _DRILLING / element.n_nodes * own.sum(axis=1, keepdims=True)
        held = np.repeat(held, element.n_nodes, axis=1)
        drilling.append(_Rows.of(spins(slopes, there)[:, :, None], nodes, held, numbers))
    parts = [_Rows.joined(membrane).by_sums(), bending.by_sums(), *drilling]
    goes_with = [[0, 1, 1], [2, 3, 3], *[[1]] * len(drilling)]
    rigidity = [np.repeat(g, len(p.weight)) for g, p in zip(goes_with, parts, strict=True)]
    area, flat = (np.bincount(p.face, p.weight).astype(np.float64) for p in parts[:2])
    middles = (x.mean(axis=1) * part[:, None]).T
    centres = np.stack([np.bincount(triangles.face, one) for one in middles], axis=1)
    return ShellMembers(
        sp.csr_array(sp.vstack([p.operator(mesh) for p in parts])),
        np.concatenate([np.tile(p.weight, len(p.values)) for p in parts]),
        np.concatenate(rigidity),
        np.empty((0, 2, 3)),
        triangles.nodes,
        triangles=triangles,
        face_of=(parts[0].face, parts[1].face),
        node_area=node_area,
        frames=frames,
        area=area,
        centres=centres / flat[:, None],
        corners=np.array(
            [[*mesh.points[list(own)], *[[np.nan] * 3] * (4 - len(own))] for own in corners]
        ),
        side_known=sides[1],
    )


@dataclass(frozen=True)
class _Rows:
    """Strains at points of faces.

    Args:
        values: (n_components, n_points, 6 k) by the unknowns of k nodes.
        nodes: (n_points, k).
        weight: (n_points,) m2.
        face: (n_points,) on which each is.
    """

    values: Floats
    nodes: Ints
    weight: Floats
    face: Ints

    @classmethod
    def of(cls, strains: Floats, nodes: Ints, weight: Floats, face: Ints) -> _Rows:
        """Strains (m, q, n_components, k, 6) at q points of m pieces with nodes (m, k)."""
        m, q, count, k, _ = strains.shape
        values = strains.transpose(2, 0, 1, 3, 4).reshape(count, m * q, 6 * k)
        return cls(values, np.repeat(nodes, q, axis=0), weight.ravel(), np.repeat(face, q))

    @classmethod
    def joined(cls, parts: Sequence[_Rows]) -> _Rows:
        """Those of blocks of faces in one; nodes and unknowns are filled up with zeros."""
        most = max(part.nodes.shape[1] for part in parts)

        def filled(array: Any, each: int) -> Any:
            room = [(0, 0)] * (array.ndim - 1) + [(0, each * most - array.shape[-1])]
            return np.pad(array, room, mode="edge" if each == 1 else "constant")

        return cls(
            np.concatenate([filled(part.values, 6) for part in parts], axis=1),
            np.concatenate([filled(part.nodes, 1) for part in parts]),
            np.concatenate([part.weight for part in parts]),
            np.concatenate([part.face for part in parts]),
        )

    def by_sums(self) -> _Rows:
        """Components 11, 22, 12 as sum, difference and 12."""
        first, second, shear = self.values
        return replace(self, values=np.stack([first + second, first - second, shear]))

    def operator(self, mesh: Mesh) -> sp.csr_array:
        """(n_components n_points, n_dofs) component by component."""
        n, width = self.values.shape[0], self.values.shape[2]
        both = np.stack([self.nodes, rotation_nodes(mesh, self.nodes)], axis=2)
        dofs = (both[..., None] * 3 + np.arange(3)).reshape(len(self.nodes), width)
        starts = width * np.arange(n * len(dofs) + 1)
        shape = (n * len(dofs), mesh.points.size)
        entries = self.values.ravel(), np.tile(dofs, (n, 1)).ravel(), starts
        operator = sp.csr_array(entries, shape=shape)
        operator.sum_duplicates()
        return operator


def rotation_nodes(mesh: Mesh, nodes: Ints) -> Ints:
    """The nodes that stand for the rotations at some nodes (...)."""
    return np.asarray(mesh.n_places + np.searchsorted(mesh.rotations_of, nodes))


def nearest_triangle(corners: Floats, point: Floats) -> tuple[int, Floats]:
    """Which triangle comes nearest to a point, and the parts (3,) of its corners in that place.

    Args:
        corners: (m, 3, 3) m.
        point: (3,) m.
    """
    edges = np.roll(corners, -1, axis=1) - corners
    to_point = point - corners
    along = (edges * to_point).sum(axis=2) / (edges**2).sum(axis=2)
    on_edges = corners + np.clip(along, 0.0, 1.0)[..., None] * edges
    away = np.linalg.norm(on_edges - point, axis=2)
    feet = np.take_along_axis(on_edges, away.argmin(axis=1)[:, None, None], axis=1)[:, 0]
    normal = np.cross(edges[:, 0], edges[:, 1])
    outside = (np.cross(edges, to_point) @ normal[:, :, None])[..., 0] < 0.0
    inner = ~outside.any(axis=1)
    height = (to_point[:, 0] * normal).sum(axis=1) / (normal**2).sum(axis=1)
    feet[inner] = point - height[inner, None] * normal[inner]
    best = int(np.linalg.norm(feet - point, axis=1).argmin())
    sides = (corners[best, 1:] - corners[best, 0]).T
    parts = np.linalg.lstsq(sides, feet[best] - corners[best, 0])[0]
    return best, np.array([1.0 - parts.sum(), *parts])
