"""Straight members: bars, beams, shells of revolution, as generalized strains of displacements.

A member works like a strain point: strains e = B u, forces q = D e, nodal forces f = B^T w q with
weights w, and K = B^T w D B. Its three rows, with t its direction, L its length, n to the left of
t, psi = n . (u_2 - u_1) / L its rotation as a chord and phi_i = theta_i - psi:

    axial strain            e = t . (u_2 - u_1) / L          w = L         N = EA e
    mean curvature          k = (phi_2 - phi_1) / L          w = L         M = EI k  (at mid-length)
    change of curvature     k' = 6 (phi_1 + phi_2) / L^2     w = L^3 / 12  Q = EI k' = dM/ds

The energy is that of the cubic (Euler-Bernoulli) beam: EI/L (2 phi_1^2 + 2 phi_1 phi_2 +
2 phi_2^2) = EI/2 (L k^2 + L^3/12 k'^2). A bar has the first row only.

The rotations theta are no unknowns of the model. No moment acts on them from outside, so they
follow the displacements: with EI the same along the whole beam, minimal energy gives theta = R u,
R = -K_rr^-1 K_ru, whatever EI is. Put into k and k' this is exact static condensation; K keeps two
fixed matrices, one times EA and one times EI. The price: all nodes of one beam couple with each
other, and beams of different structures meet in a hinge.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import scipy.sparse as sp
import scipy.sparse.linalg as spla

from geoident.fem.location import Site
from geoident.fem.stiffness import GroupBlocks
from geoident.model.arrays import Bools, Floats, Ints
from geoident.model.mesh import Mesh


@dataclass(frozen=True)
class Members:
    """The members of one structure.

    Args:
        operator: B, (n_rows, n_dofs); rows e of all members, then k, then k' (beams only).
        weight: w, (n_rows,).
        bending: (n_rows,) the row goes with EI, else with EA.
        ends: (n_members, 2, dim) first and second end, m.
    """

    operator: sp.csr_array
    weight: Floats
    bending: Bools
    ends: Floats

    def __len__(self) -> int:
        return len(self.ends)


def bars(
    mesh: Mesh,
    ends: Floats,
    sites: Sequence[tuple[Sequence[Site], Sequence[Site]]],
    extent: Floats | None = None,
) -> Members:
    """Bars between points that elements hold, embedded by the shape functions of these elements.

    Args:
        mesh: the mesh.
        ends: (n, 2, dim) end points, m.
        sites: for every bar what holds its ends: a point in an element, several that share the
            force evenly (the end moves as they do on average), or none for an end that is fixed.
        extent: (n,) to what the stiffness of each is multiplied, as the circumference on which bars
            are counted by their spacing, m; 1 if missing.
    """
    direction, length = _directions(ends)
    rows, columns, data = [], [], []
    for n, pair in enumerate(sites):
        for sign, held in zip((-1.0, 1.0), pair, strict=True):
            for site in held:
                part = np.outer(site.shapes, sign * direction[n] / length[n]) / len(held)
                columns.append((site.nodes[:, None] * mesh.dim + np.arange(mesh.dim)).ravel())
                data.append(part.ravel())
                rows.append(np.full(part.size, n))
    entries = (np.concatenate(rows), np.concatenate(columns))
    shape = (len(ends), mesh.points.size)
    operator = sp.csr_array((np.concatenate(data), entries), shape=shape)
    weight = length if extent is None else length * extent
    return Members(operator, weight, np.zeros(len(ends), dtype=bool), ends)


def grouted_parts(ends: Floats, grouted: float, count: int) -> tuple[Floats, Floats]:
    """Free lengths of anchors, and points spread evenly along their grouted lengths.

    Args:
        ends: (n, 2, dim) head and toe, m.
        grouted: length at the toe, m, shorter than every anchor.
        count: of points of one anchor, each in the middle of its part of the grouted length.

    Returns:
        Ends (n, 2, dim) of the free lengths, and points (n, count, dim), from head to toe.
    """
    direction, length = _directions(ends)
    free = length - grouted
    along = free[:, None] + grouted * (np.arange(count) + 0.5) / count
    points = ends[:, :1] + along[..., None] * direction[:, None]
    return np.stack([ends[:, 0], ends[:, 0] + free[:, None] * direction], axis=1), points


def beams(mesh: Mesh, edges: Ints, clamped: Bools) -> Members:
    """Beams of one bending stiffness along edges (n, 2) of a plane mesh, rigid joints between them.

    Args:
        mesh: the mesh.
        edges: (n, 2) node indices of the two ends of every member.
        clamped: (n_nodes,) nodes at which the beams do not turn.
    """
    n, ends = len(edges), mesh.points[edges]
    direction, length = _directions(ends)
    normal = np.stack([-direction[:, 1], direction[:, 0]], axis=1)
    axial = _difference(mesh, edges, direction / length[:, None])
    chord = _difference(mesh, edges, normal / length[:, None])
    first, second = _turns(edges, clamped)
    psi_weight = np.concatenate([length, length**3 / 12])
    turning = [_by(1 / length) @ (second - first), _by(6 / length**2) @ (first + second)]
    moving = [sp.csr_array(chord.shape), _by(-12 / length**2) @ chord]
    by_turns, by_motion = (sp.csr_array(sp.vstack(rows)) for rows in (turning, moving))
    bending = by_motion + by_turns @ _follow(by_turns, by_motion, psi_weight)
    return Members(
        sp.csr_array(sp.vstack([axial, bending])),
        np.concatenate([length, psi_weight]),
        np.repeat([False, True], [n, 2 * n]),
        ends,
    )


def member_blocks(members: Members, rank: Ints, dim: int) -> GroupBlocks:
    """Node-pair blocks of B^T w B, side by side for the rows of EA and of EI.

    Times `stiffness_map` they are the blocks of K, so that a structure goes into the pattern like a
    group of elements.

    Args:
        members: the members.
        rank: (n_nodes,) place of each node in the elimination order.
        dim: space dimensions.
    """
    keys, parts = [], []
    for mine in (~members.bending, members.bending):
        operator = members.operator[np.flatnonzero(mine)]
        matrix = (operator.T @ _by(members.weight[mine]) @ operator).tobsr(blocksize=(dim, dim))
        nodes = np.repeat(np.arange(len(rank)), np.diff(matrix.indptr))
        row, column = rank[nodes], rank[matrix.indices]
        kept = row >= column
        keys.append((column[kept] << 32) | row[kept])
        parts.append(matrix.data[kept].reshape(-1, dim * dim))
    unique = np.unique(np.concatenate(keys))
    products = np.zeros((len(unique), 2, dim * dim))
    for which, (key, part) in enumerate(zip(keys, parts, strict=True)):
        products[np.searchsorted(unique, key), which] = part
    return GroupBlocks(unique & 0xFFFFFFFF, unique >> 32, products.reshape(len(unique), -1))


def stiffness_map(axial: float, bending: float, *, dim: int) -> Floats:
    """What the products of `member_blocks` are multiplied with, (2 dim^2, dim^2).

    Args:
        axial: EA, N or N/m.
        bending: EI, N m2 or N m.
        dim: space dimensions.
    """
    one = np.eye(dim * dim)
    return np.vstack([axial * one, bending * one])


def _directions(ends: Floats) -> tuple[Floats, Floats]:
    """Unit vectors (n, dim) from first to second end, and lengths (n,), m."""
    along = ends[:, 1] - ends[:, 0]
    length = np.linalg.norm(along, axis=1)
    return along / length[:, None], length


def _difference(mesh: Mesh, edges: Ints, vectors: Floats) -> sp.csr_array:
    """(n, n_dofs) vector . (u_2 - u_1) for every edge."""
    n, dim = vectors.shape
    columns = edges[:, :, None] * dim + np.arange(dim)
    data = np.stack([-vectors, vectors], axis=1)
    rows = np.repeat(np.arange(n), 2 * dim)
    return sp.csr_array((data.ravel(), (rows, columns.ravel())), shape=(n, mesh.points.size))


def _turns(edges: Ints, clamped: Bools) -> tuple[sp.csr_array, sp.csr_array]:
    """(n, n_turns) pick the rotations of first and second ends; clamped ones are zero."""
    free = np.setdiff1d(edges, np.flatnonzero(clamped))
    picks = []
    for end in edges.T:
        rows = np.flatnonzero(~clamped[end])
        columns = np.searchsorted(free, end[rows])
        shape = (len(edges), len(free))
        picks.append(sp.csr_array((np.ones(len(rows)), (rows, columns)), shape=shape))
    return picks[0], picks[1]


def _follow(by_turns: sp.csr_array, by_motion: sp.csr_array, weight: Floats) -> sp.csr_array:
    """R = -K_rr^-1 K_ru, (n_turns, n_dofs): the rotations of least energy."""
    stiffness = (by_turns.T @ _by(weight) @ by_turns).tocsc()
    coupling = (by_turns.T @ _by(weight) @ by_motion).tocsc()
    moving = np.flatnonzero(np.diff(coupling.indptr))
    if stiffness.shape[0] == 0:
        return sp.csr_array(coupling.shape)
    turns = spla.splu(stiffness).solve(-coupling[:, moving].toarray())
    place = sp.csr_array(
        (np.ones(len(moving)), (np.arange(len(moving)), moving)),
        shape=(len(moving), coupling.shape[1]),
    )
    return sp.csr_array(sp.csr_array(turns) @ place)


def _by(factors: Floats) -> sp.dia_array:
    return sp.diags_array(factors)
