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
other, and beams of different structures meet in a hinge. At a hinge within a beam every member end
has a rotation of its own; the energy is least where its moment is zero.

About an axis a beam is a thin shell of revolution (Kirchhoff and Love; Timoshenko and
Woinowsky-Krieger, Theory of plates and shells, 1959, chapters 15 and 16), its members are frusta of
cones over the whole turn. With s along the meridian, r the radius, u_r linear between the nodes,
theta = dw/ds of the cubic w, and D = E t / (1 - nu^2), B = D t^2 / 12,

    e_s = t . (u_2 - u_1) / L     e_t = u_r / r                 N_s = D (e_s + nu e_t), N_t
    k_s = dtheta/ds               k_t = theta (dr/ds) / r       M_s = B (k_s + nu k_t), M_t

at the two Gauss points of a member. The energy of a pair (a, b) is that of its sum and difference,
a^2 + 2 nu a b + b^2 = (1 + nu) / 2 (a + b)^2 + (1 - nu) / 2 (a - b)^2, so the rows are a + b and
a - b with weights w (1 +- nu) / 2, and moduli D and B. Rotations occur in the bending energy alone
and follow as above, for any uniform B, but not for any nu: nu is a given number.
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
from geoident.model.cells import CELLS
from geoident.model.mesh import Mesh, rows_in


@dataclass(frozen=True)
class TurningRows:
    """The rows e, k and k' of a beam before its rotations are eliminated.

    Args:
        motion: (n_rows, n_dofs) by displacements, with rotations held.
        turns: (n_rows, n_turns) by rotations.
    """

    motion: sp.csr_array
    turns: sp.csr_array


@dataclass(frozen=True)
class Members:
    """The members of one structure.

    Args:
        operator: B, (n_rows, n_dofs); rows e of all members, then k, then k' (beams only).
        weight: w, (n_rows,).
        rigidity: (n_rows,) which rigidity of the structure each row goes with: EA, EI; of a shell
            see `fem.shells`.
        ends: (n_members, 2, dim) first and second end, m; of a shell none.
        nodes: (n_members, 2) nodes of the ends of beams; (m, 3) of a shell; None for bars.
        nu: Poisson's ratio of a shell of revolution; None for all others.
        turning: rows of a plane beam with its rotations; None for all others.
    """

    operator: sp.csr_array
    weight: Floats
    rigidity: Ints
    ends: Floats
    nodes: Ints | None = None
    nu: float | None = None
    turning: TurningRows | None = None

    def __len__(self) -> int:
        return len(self.ends)

    @property
    def n_rigidities(self) -> int:
        """Number of rigidities with which its rows go."""
        return int(self.rigidity.max()) + 1

    @property
    def length(self) -> Floats:
        """Length (n_members,) of every member, m."""
        return np.asarray(np.linalg.norm(self.ends[:, 1] - self.ends[:, 0], axis=1))


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
    return Members(operator, weight, np.zeros(len(ends), dtype=np.int64), ends)


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


def beams(mesh: Mesh, edges: Ints, clamped: Bools, hinged: Bools | None = None) -> Members:
    """Beams of one bending stiffness along edges (n, 2) of a plane mesh, rigid joints between them.

    Args:
        mesh: the mesh.
        edges: (n, 2) node indices of the two ends of every member.
        clamped: (n_nodes,) nodes at which the beams do not turn.
        hinged: (n_nodes,) nodes at which they turn against each other; None for none.
    """
    n, ends = len(edges), mesh.points[edges]
    direction, length = _directions(ends)
    normal = np.stack([-direction[:, 1], direction[:, 0]], axis=1)
    axial = _difference(mesh, edges, direction / length[:, None])
    chord = _difference(mesh, edges, normal / length[:, None])
    first, second = _turns(edges, clamped, hinged)
    psi_weight = np.concatenate([length, length**3 / 12])
    turning = [_by(1 / length) @ (second - first), _by(6 / length**2) @ (first + second)]
    moving = [sp.csr_array(chord.shape), _by(-12 / length**2) @ chord]
    by_turns, by_motion = (sp.csr_array(sp.vstack(rows)) for rows in (turning, moving))
    bending = by_motion + by_turns @ _follow(by_turns, by_motion, psi_weight)
    unturned = sp.csr_array((n, by_turns.shape[1]))
    return Members(
        sp.csr_array(sp.vstack([axial, bending])),
        np.concatenate([length, psi_weight]),
        np.repeat([0, 1], [n, 2 * n]),
        ends,
        edges,
        turning=TurningRows(
            sp.csr_array(sp.vstack([axial, by_motion])),
            sp.csr_array(sp.vstack([unturned, by_turns])),
        ),
    )


def shells(mesh: Mesh, edges: Ints, clamped: Bools, hinged: Bools | None, nu: float) -> Members:
    """Shells of revolution about x = 0 along edges (n, 2) of their meridian, as `beams`.

    Args:
        mesh: the mesh, of the half section x >= 0.
        edges: (n, 2) node indices of the two ends of every member; none lies on the axis.
        clamped: (n_nodes,) nodes at which the meridian does not turn, those on the axis among them.
        hinged: (n_nodes,) nodes at which its pieces turn against each other; None for none.
        nu: Poisson's ratio, which couples meridian and hoops.
    """
    ends = mesh.points[edges]
    direction, length = _directions(ends)
    normal = np.stack([-direction[:, 1], direction[:, 0]], axis=1)
    along = _difference(mesh, edges, direction / length[:, None])
    chord = _difference(mesh, edges, normal / length[:, None])
    first, second = _turns(edges, clamped, hinged)
    pairs: list[tuple[sp.csr_array, sp.csr_array]] = []  # e_s and e_t
    bent: list[tuple[sp.csr_array, sp.csr_array]] = []  # k_s and k_t by motion
    turned: list[tuple[sp.csr_array, sp.csr_array]] = []  # k_s and k_t by rotations
    weights = []
    for xi in GAUSS:
        radius = ends[:, 0, 0] * (1 - xi) + ends[:, 1, 0] * xi
        weights.append(np.pi * radius * length)  # 2 pi r times half of the length
        slope = _by(direction[:, 0] / radius)
        pairs.append((along, _radial(mesh, edges, (1 - xi) / radius, xi / radius)))
        bent.append((_by((6 - 12 * xi) / length) @ chord, (6 * xi * (1 - xi) * slope) @ chord))
        meridian = _by((6 * xi - 4) / length) @ first + _by((6 * xi - 2) / length) @ second
        angle = (1 - 4 * xi + 3 * xi**2) * first + (3 * xi**2 - 2 * xi) * second
        turned.append((meridian, slope @ angle))
    shares = np.concatenate([(1 + nu) / 2 * np.concatenate(weights),
                             (1 - nu) / 2 * np.concatenate(weights)])  # fmt: skip
    by_turns, by_motion = _sums_and_differences(turned), _sums_and_differences(bent)
    bending = by_motion + by_turns @ _follow(by_turns, by_motion, shares)
    return Members(
        sp.csr_array(sp.vstack([_sums_and_differences(pairs), bending])),
        np.concatenate([shares, shares]),
        np.repeat([0, 1], len(shares)),
        ends,
        edges,
        nu,
    )


GAUSS = (0.5 - 0.5 / np.sqrt(3.0), 0.5 + 0.5 / np.sqrt(3.0))
"""Gauss points of a member of a shell, in parts of its length."""


def _sums_and_differences(pairs: Sequence[tuple[sp.csr_array, sp.csr_array]]) -> sp.csr_array:
    """Rows a + b of all pairs (a, b), then a - b."""
    rows = [a + b for a, b in pairs] + [a - b for a, b in pairs]
    return sp.csr_array(sp.vstack(rows))


def _radial(mesh: Mesh, edges: Ints, first: Floats, second: Floats) -> sp.csr_array:
    """(n, n_dofs) u_x of the first ends times some factors (n,) and of the second ends."""
    n = len(edges)
    data = np.stack([first, second], axis=1)
    entries = (data.ravel(), (np.repeat(np.arange(n), 2), (edges * mesh.dim).ravel()))
    return sp.csr_array(entries, shape=(n, mesh.points.size))


@dataclass(frozen=True)
class SectionForces:
    """Forces in beams per metre out of plane or of circumference; columns as of what they are of.

    Args:
        axial: N at mid-length, (n_members, ...), tension positive; of bars all that there is.
        first: M at the first end, (n_members, ...), positive with tension on the right.
        second: M at the second end.
        shear: Q = dM/ds at mid-length; of a shell also what hoop moments add on a cone.
        hoop: N_t of a shell, (n_members, ...), zero otherwise.
        stretch: the axial strain times EA (D of a shell): N but for what its hoops do.
        bent_first: the curvature at the first end times EI (B): M but for what its hoops do.
        bent_second: the same at the second end.
    """

    axial: Floats
    first: Floats
    second: Floats
    shear: Floats
    hoop: Floats
    stretch: Floats
    bent_first: Floats
    bent_second: Floats


def section_forces(members: Members, forces: Floats) -> SectionForces:
    """Forces in the sections of beams or shells; linear, so that derivatives travel in columns.

    Args:
        members: beams or shells.
        forces: q (n_rows, ...).
    """
    n, length = len(members), members.length.reshape(-1, *(1,) * (forces.ndim - 1))
    if members.nu is None:
        axial, middle, shear = forces.reshape(3, n, *forces.shape[1:])
        half = shear * length / 2
        first, second = middle - half, middle + half
        around = np.zeros_like(axial)
        return SectionForces(axial, first, second, shear, around, axial, first, second)
    total, rest = (1 + members.nu) / 2, (1 - members.nu) / 2
    table = forces.reshape(2, 2, 2, n, *forces.shape[1:])  # axial or bending; sum or less; point
    meridian = total * table[:, 0] + rest * table[:, 1]
    hoop = total * table[:, 0] - rest * table[:, 1]
    (axial, moment), (around, twist) = meridian.mean(axis=1), hoop.mean(axis=1)
    rise = (meridian[1, 1] - meridian[1, 0]) * np.sqrt(3.0)  # of M over the length
    radius, run = (x.reshape(length.shape) for x in _radius_and_run(members))
    shear = rise / length + run / (radius * length) * (moment - twist)
    strained = 0.5 * table.sum(axis=1)
    (stretch, bent), more = strained.mean(axis=1), strained[1, 1] - strained[1, 0]
    more = more * (np.sqrt(3.0) / 2)
    return SectionForces(
        axial,
        moment - rise / 2,
        moment + rise / 2,
        shear,
        around,
        stretch,
        bent - more,
        bent + more,
    )


def _radius_and_run(members: Members) -> tuple[Floats, Floats]:
    """Radius (n,) at mid-length, and r_2 - r_1 (n,), m."""
    radii = members.ends[:, :, 0]
    return radii.mean(axis=1), radii[:, 1] - radii[:, 0]


def area_shares(mesh: Mesh, members: Members) -> Floats:
    """Area (n_nodes,) of beams that belongs to each node, of a metre or of the whole turn, m2."""
    assert members.nodes is not None
    radius = 2 * np.pi * members.ends[:, :, 0] if members.nu is not None else np.ones((1, 2))
    parts = members.length[:, None] * (2 * radius + radius[:, ::-1]) / 6
    nodes = members.nodes.ravel()
    shares = np.broadcast_to(parts, members.nodes.shape).ravel()
    total = np.zeros(mesh.n_nodes)
    np.add.at(total, nodes, shares)
    return total


def member_blocks(members: Members, rank: Ints, dim: int) -> GroupBlocks:
    """Node-pair blocks of B^T w B, side by side for the rows of each rigidity.

    Times `stiffness_map` they are the blocks of K, so that a structure goes into the pattern like a
    group of elements.

    Args:
        members: the members.
        rank: (n_nodes,) place of each node in the elimination order.
        dim: space dimensions.
    """
    keys, parts = [], []
    for number in range(members.n_rigidities):
        chosen = members.rigidity == number
        operator = members.operator[np.flatnonzero(chosen)]
        matrix = (operator.T @ _by(members.weight[chosen]) @ operator).tobsr(blocksize=(dim, dim))
        nodes = np.repeat(np.arange(len(rank)), np.diff(matrix.indptr))
        row, column = rank[nodes], rank[matrix.indices]
        kept = row >= column
        keys.append((column[kept] << 32) | row[kept])
        parts.append(matrix.data[kept].reshape(-1, dim * dim))
    unique = np.unique(np.concatenate(keys))
    products = np.zeros((len(unique), members.n_rigidities, dim * dim))
    for which, (key, part) in enumerate(zip(keys, parts, strict=True)):
        products[np.searchsorted(unique, key), which] = part
    blocks = products.reshape(len(unique), -1)
    return GroupBlocks(unique & 0xFFFFFFFF, unique >> 32, lambda: blocks)


def stiffness_map(rigidities: Sequence[float], *, dim: int) -> Floats:
    """What the products of `member_blocks` are multiplied with, (n_rigidities dim^2, dim^2).

    Args:
        rigidities: EA, N or N/m, and EI, N m2 or N m, of beams and bars.
        dim: space dimensions.
    """
    one = np.eye(dim * dim)
    return np.vstack([rigidity * one for rigidity in rigidities])


def straight_pieces(mesh: Mesh, group: str) -> Ints:
    """(n, 2) nodes of the straight pieces of a group of lines, each once; line3 are two pieces."""
    edges = []
    for block, rows in rows_in(mesh.facets, mesh.facet_groups[group]):
        edges += [block.nodes[rows][:, piece] for piece in CELLS[block.kind].flat_pieces]
    joined = np.concatenate(edges)
    _, once = np.unique(np.sort(joined, axis=1), axis=0, return_index=True)
    return joined[np.sort(once)]


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


def _turns(edges: Ints, clamped: Bools, hinged: Bools | None) -> tuple[sp.csr_array, sp.csr_array]:
    """(n, n_turns) pick the rotations of first and second ends; clamped ones are zero.

    At a hinge every end has its own, even where the node is clamped otherwise.
    """
    number, held = edges.copy(), clamped[edges]
    if hinged is not None:
        own = hinged[edges]
        number[own] = len(hinged) + np.arange(np.count_nonzero(own))
        held &= ~own
    free = np.unique(number[~held])
    picks = []
    for turn, fixed in zip(number.T, held.T, strict=True):
        rows = np.flatnonzero(~fixed)
        columns = np.searchsorted(free, turn[rows])
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
