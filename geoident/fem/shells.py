"""Shells on faces of solid elements, as generalized strains of displacements and rotations.

A face is cut into flat triangles through its nodes, those on its edges too; a quadrilateral is cut
along both diagonals, each pair of halves with half of the stiffness, so that no diagonal is
preferred. Unknowns at a node are the displacement u of the ground there and a rotation vector
theta (`Mesh.rotations_of`). In axes 1, 2 and n of a triangle, n its normal,

    membrane   the optimal triangle with drilling rotations theta_n of Felippa (Computer Methods in
               Applied Mechanics and Engineering 192, 2003, 2125-2168): mean strain with alpha = 3/2
               and deviations at the middles of the sides with beta_0 = 1/2. It bends in its plane
               without locking, and drilling needs no stabilisation.
    bending    the discrete Kirchhoff triangle (Batoz, Bathe and Ho, International Journal for
               Numerical Methods in Engineering 15, 1980, 1771-1812): curvatures at the middles of
               the sides, no strain of shear.

Both are flat, so that neither membrane nor shear locks. At each of the three middles, with a third
of the area A as weight and D = E t / (1 - nu^2),

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
from dataclasses import dataclass

import numpy as np
import scipy.sparse as sp

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

_MIDDLES = np.array([[0.5, 0.5, 0.0], [0.0, 0.5, 0.5], [0.5, 0.0, 0.5]])
"""Area coordinates of the middles of the sides 12, 23 and 31."""

_DEVIATION = 1.5 * np.sqrt(0.5)
"""3/2 sqrt(beta_0), with which deviations of the membrane strain count."""


@dataclass(frozen=True)
class FlatTriangles:
    """The flat triangles of some faces.

    Args:
        nodes: (m, 3) nodes.
        face: (m,) which of the faces each is a part of.
        share: (m,) part of the stiffness that it has.
    """

    nodes: Ints
    face: Ints
    share: Floats


@dataclass(frozen=True, kw_only=True)
class ShellMembers(Members):
    """A shell.

    Its rows are component by component, first of the membrane, then of bending: sum, difference,
    shear; each middle by middle for all triangles, (2, 3, 3, m).

    Args:
        triangles: of which it is made.
        frames: (m, 3, 3) unit vectors 1, 2 and n of every triangle.
        area: (n_faces,) of the faces, m2.
        centres: (n_faces, 3) m.
        side_known: (n_faces,) whether it is known to which side the normal should look.
    """

    triangles: FlatTriangles
    frames: Floats
    area: Floats
    centres: Floats
    side_known: Bools

    def face_forces(self, forces: Floats) -> Floats:
        """Means (6, n_faces, ...) of n_11, n_22, n_12, m_11, m_22, m_12 over every face.

        Args:
            forces: q (n_rows, ...) of the shell.
        """
        flat = forces.reshape(len(forces), -1)
        means = [np.asarray(self._means(number) @ flat) for number in range(6)]
        return np.stack(means).reshape(6, len(self.area), *forces.shape[1:])

    @property
    def face_axes(self) -> Floats:
        """(n_faces, 3, 3) unit vectors 1, 2 and n in the middle of every face."""
        total = np.zeros((len(self.area), 3, 3))
        np.add.at(total, self.triangles.face, self.frames)
        return np.asarray(total / np.linalg.norm(total, axis=2, keepdims=True))

    def force_row(self, number: int, faces: Floats) -> sp.csr_array:
        """(1, n_rows) which sum of q is a force at a place.

        Args:
            number: of the force, in the order of `face_forces`.
            faces: (n_faces,) weights of the forces of the faces in it.
        """
        return sp.csr_array(sp.csr_array(faces[None]) @ self._means(number))

    def _means(self, number: int) -> sp.csr_array:
        """(n_faces, n_rows) which sums of q are the means of a force."""
        bends, component = divmod(number, 3)
        m, face = len(self.frames), self.triangles.face
        share = np.tile(self.weight[:m] / self.area[face], 3)  # of the three middles
        terms = ((0, 1.0), (1, 1.0)), ((0, 1.0), (1, -1.0)), ((2, 1.0),)
        data = [sign * share for _, sign in terms[component]]
        at = [(3 * bends + row) * 3 * m + np.arange(3 * m) for row, _ in terms[component]]
        places = np.tile(face, 3 * len(at)), np.concatenate(at)
        shape = len(self.area), len(self.weight)
        return sp.csr_array((np.concatenate(data), places), shape=shape)


def flat_triangles(mesh: Mesh, faces: Ints) -> FlatTriangles:
    """The triangles of some facets (n_faces,) of a mesh; faces are counted block by block."""
    nodes, face, share, first = [], [], [], 0
    for block, rows in rows_in(mesh.facets, faces):
        cell = CELLS[block.kind]
        pieces = np.array(_DIAGONALS.get(block.kind, cell.flat_pieces))
        nodes.append(block.nodes[rows][:, pieces].reshape(-1, 3))
        face.append(np.repeat(first + np.arange(len(rows)), len(pieces)))
        share.append(np.tile(_SHARES.get(block.kind, (1.0,) * len(pieces)), len(rows)))
        first += len(rows)
    return FlatTriangles(np.concatenate(nodes), np.concatenate(face), np.concatenate(share))


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
    mesh: Mesh, triangles: FlatTriangles, sides: tuple[Bools, Bools], axis: Floats
) -> ShellMembers:
    """A shell on triangles of faces.

    Args:
        mesh: whose nodes have rotations there.
        triangles: of the faces.
        sides: (n_faces,) for which the normal is that against the order of the nodes, and for
            which its side is known.
        axis: (3,) direction of axis 1, projected on every triangle; it is normal to none.
    """
    nodes = triangles.nodes.copy()
    back = sides[0][triangles.face]
    nodes[back] = nodes[back][:, [0, 2, 1]]
    x = mesh.points[nodes]
    normal = np.cross(x[:, 1] - x[:, 0], x[:, 2] - x[:, 0])
    doubled = np.linalg.norm(normal, axis=1)
    normal /= doubled[:, None]
    first = axis - (normal @ axis)[:, None] * normal
    first /= np.linalg.norm(first, axis=1)[:, None]
    frames = np.stack([first, np.cross(normal, first), normal], axis=1)
    plane = np.einsum("mik,mak->mai", frames[:, :2], x - x[:, :1])
    m = len(nodes)
    rows = np.zeros((m, 3, 6, 18))  # middle; component; node: u_1, u_2, u_n, theta_1, .., theta_n
    _fill(rows, slice(0, 3), _membrane(plane), (0, 1, 5))
    _fill(rows, slice(3, 6), _bending(plane), (2, 3, 4))
    pairs = rows[:, :, [0, 3]].copy()
    rows[:, :, [0, 3]] += rows[:, :, [1, 4]]
    rows[:, :, [1, 4]] = pairs - rows[:, :, [1, 4]]
    turned_back = np.einsum("mqcvi,mij->mqcvj", rows.reshape(m, 3, 6, 6, 3), frames)
    values = turned_back.transpose(2, 1, 0, 3, 4).reshape(18 * m, 18)
    spins = rotation_nodes(mesh, nodes)
    both = np.stack([nodes, spins], axis=2).reshape(m, 6)
    dofs = (both[:, :, None] * 3 + np.arange(3)).reshape(m, 18)
    columns = np.tile(dofs, (18, 1))
    entries = np.repeat(np.arange(18 * m), 18), columns.ravel()
    operator = sp.csr_array((values.ravel(), entries), shape=(18 * m, mesh.points.size))
    part = doubled / 2 * triangles.share
    area = np.bincount(triangles.face, part).astype(np.float64)
    middles = x.mean(axis=1) * part[:, None]
    centres = np.stack([np.bincount(triangles.face, one) for one in middles.T], axis=1)
    return ShellMembers(
        operator,
        np.tile(part / 3, 18),
        np.repeat([0, 1, 1, 2, 3, 3], 3 * m),
        np.empty((0, 2, 3)),
        nodes,
        triangles=triangles,
        frames=frames,
        area=area,
        centres=centres / area[:, None],
        side_known=sides[1],
    )


def rotation_nodes(mesh: Mesh, nodes: Ints) -> Ints:
    """The nodes that stand for the rotations at some nodes (...)."""
    return np.asarray(mesh.n_places + np.searchsorted(mesh.rotations_of, nodes))


def shell_area_shares(mesh: Mesh, members: ShellMembers) -> Floats:
    """Area (n_nodes,) of a shell that belongs to each node, m2."""
    assert members.nodes is not None
    part = members.weight[: len(members.nodes)]
    shares = np.bincount(members.nodes.ravel(), np.repeat(part, 3), minlength=mesh.n_nodes)
    return shares.astype(np.float64)


def _fill(rows: Floats, components: slice, part: Floats, own: tuple[int, int, int]) -> None:
    """Write rows (m, 3, 3, 9) of three freedoms of each node into those of all six."""
    at = (6 * np.arange(3)[:, None] + np.array(own)).ravel()
    chosen = np.arange(6)[components]
    rows[:, :, chosen[:, None], at] = part


def _membrane(plane: Floats) -> Floats:
    """Strains e_11, e_22, g_12 (m, 3, 3, 9) at the middles, by u_1, u_2, theta_n of the corners.

    Args:
        plane: (m, 3, 2) corners in the plane, m.
    """
    m = len(plane)
    delta = plane[:, :, None] - plane[:, None]  # [:, i, j] = x_i - x_j
    X, Y = delta[..., 0], delta[..., 1]
    doubled = X[:, 1, 0] * Y[:, 2, 0] - X[:, 2, 0] * Y[:, 1, 0]
    mean = np.zeros((m, 3, 9))
    for i in range(3):
        j, k = (i + 1) % 3, (i + 2) % 3
        mean[:, 0, 3 * i] = mean[:, 2, 3 * i + 1] = Y[:, j, k]
        mean[:, 1, 3 * i + 1] = mean[:, 2, 3 * i] = X[:, k, j]
        a = 1.5 / 6.0
        mean[:, 0, 3 * i + 2] = a * Y[:, j, k] * (Y[:, i, k] - Y[:, j, i])
        mean[:, 1, 3 * i + 2] = a * X[:, k, j] * (X[:, k, i] - X[:, i, j])
        mean[:, 2, 3 * i + 2] = 2 * a * (X[:, k, i] * Y[:, i, k] - X[:, i, j] * Y[:, j, i])
    mean /= doubled[:, None, None]
    spin = np.zeros((m, 3, 9))  # rotations of the corners less that of the triangle
    for i in range(3):
        j, k = (i + 1) % 3, (i + 2) % 3
        spin[:, :, 3 * i] = X[:, k, j, None] / (2 * doubled[:, None])
        spin[:, :, 3 * i + 1] = Y[:, k, j, None] / (2 * doubled[:, None])
        spin[:, i, 3 * i + 2] = 1.0
    squared = np.stack([X[:, b, a] ** 2 + Y[:, b, a] ** 2 for a, b in ((0, 1), (1, 2), (2, 0))], 1)
    betas = np.array([[1, 2, 1], [0, 1, -1], [-1, -1, -2]], dtype=np.float64)
    natural = []  # at the corners; each the one before, with the corners one further
    for corner in range(3):
        shifted = np.roll(betas, corner, axis=(0, 1))
        natural.append(shifted[None] * (doubled[:, None] / (3 * squared))[:, :, None])
    by_natural = np.stack(
        [
            np.stack([Y[:, b, c] * Y[:, a, c], X[:, b, c] * X[:, a, c],
                      Y[:, b, c] * X[:, c, a] + X[:, c, b] * Y[:, a, c]], axis=1)
            * squared[:, n, None]
            for n, (a, b, c) in enumerate(((0, 1, 2), (1, 2, 0), (2, 0, 1)))
        ],
        axis=2,
    ) / doubled[:, None, None] ** 2  # fmt: skip
    strains = []
    for one, other in ((0, 1), (1, 2), (2, 0)):
        deviation = by_natural @ ((natural[one] + natural[other]) / 2) @ spin
        strains.append(mean + _DEVIATION * deviation)
    return np.stack(strains, axis=1)


def _bending(plane: Floats) -> Floats:
    """Curvatures k_11, k_22 and twice k_12 (m, 3, 3, 9) at the middles, by u_n, theta_1, theta_2.

    Args:
        plane: (m, 3, 2) corners in the plane, m.
    """
    m = len(plane)
    a, b, c, d, e = (np.empty((m, 3)) for _ in range(5))  # of the sides 23, 31 and 12
    for n, (i, j) in enumerate(((1, 2), (2, 0), (0, 1))):
        x, y = (plane[:, i] - plane[:, j]).T
        squared = x * x + y * y
        a[:, n], b[:, n], d[:, n] = -x / squared, 0.75 * x * y / squared, -y / squared
        c[:, n] = (0.25 * x * x - 0.5 * y * y) / squared
        e[:, n] = (0.25 * y * y - 0.5 * x * x) / squared
    (x1, y1), (x2, y2), (x3, y3) = plane.transpose(1, 2, 0)
    doubled = (x2 - x1) * (y3 - y1) - (x3 - x1) * (y2 - y1)
    by_x = np.stack([y2 - y3, y3 - y1, y1 - y2], axis=1) / doubled[:, None]  # of area coordinates
    by_y = np.stack([x3 - x2, x1 - x3, x2 - x1], axis=1) / doubled[:, None]
    rows = np.empty((m, 3, 3, 9))
    for q, L in enumerate(_MIDDLES):
        slopes = []
        for by in (by_x, by_y):
            corner = (4 * L - 1) * by
            side = [4 * (L[i] * by[:, j] + L[j] * by[:, i]) for i, j in ((1, 2), (2, 0), (0, 1))]
            of_x, of_y = np.empty((m, 9)), np.empty((m, 9))
            for i in range(3):
                p, r = (i + 2) % 3, (i + 1) % 3  # the sides that begin and end at the corner
                of_x[:, 3 * i] = 1.5 * (a[:, p] * side[p] - a[:, r] * side[r])
                of_x[:, 3 * i + 1] = b[:, r] * side[r] + b[:, p] * side[p]
                of_x[:, 3 * i + 2] = corner[:, i] - c[:, r] * side[r] - c[:, p] * side[p]
                of_y[:, 3 * i] = 1.5 * (d[:, p] * side[p] - d[:, r] * side[r])
                of_y[:, 3 * i + 1] = -corner[:, i] + e[:, r] * side[r] + e[:, p] * side[p]
                of_y[:, 3 * i + 2] = -of_x[:, 3 * i + 1]
            slopes.append((of_x, of_y))
        (x_by_x, y_by_x), (x_by_y, y_by_y) = slopes
        rows[:, q] = np.stack([x_by_x, y_by_y, x_by_y + y_by_x], axis=1)
    return rows
