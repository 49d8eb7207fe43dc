"""Bodies that can move without strain: found before any factorization, by group and place.

The present elements fall into pieces, joined through faces. Each piece has its rigid motions
(3 in the plane, 6 in space, 1 about an axis). Supports forbid some; pieces that touch only at
nodes (a hinge) must agree there. What motion is left is a mechanism: the null space of a small
Gram matrix.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy.sparse as sp
from scipy.sparse.csgraph import connected_components

from geoident.fem.faces import FaceTable
from geoident.fem.kinematics import Kinematics
from geoident.model.arrays import Bools, Floats, Ints
from geoident.model.mesh import Mesh, nodes_in, spans

_NULL = 1e-13  # relative to the largest eigenvalue of the Gram matrix; rounding is 1e-16 of it


@dataclass(frozen=True)
class LooseBody:
    """A piece that can move rigidly.

    Args:
        elements: (n,) element indices of the piece.
        centre: (dim,) mean of its nodes, m.
        motion: (dim,) how far its centre can move along each axis; zeros for a pure rotation.
    """

    elements: Ints
    centre: Floats
    motion: Floats


def loose_body(
    mesh: Mesh, table: FaceTable, kinematics: Kinematics, present: Bools, fixed: Bools
) -> LooseBody | None:
    """The first piece of the present elements that supports do not hold, or None.

    Args:
        mesh: the mesh.
        table: its faces.
        kinematics: says which rigid motions there are.
        present: (n_elements,).
        fixed: (n_dofs,) degrees of freedom held by supports.
    """
    piece = _pieces(table, present)
    pairs = _piece_nodes(mesh, present, piece)
    modes = _rigid_modes(mesh, pairs)[..., list(kinematics.rigid)]
    for rows in _clusters(pairs):
        loosest = _loosest(mesh, pairs[rows], modes[rows], fixed)
        if loosest is not None:
            number, amplitudes = loosest
            centre = mesh.points[pairs[pairs[:, 0] == number, 1]].mean(axis=0)
            motion = np.zeros(2 * mesh.dim)
            motion[list(kinematics.rigid)] = amplitudes
            motion = np.where(motion > 1e-6, motion, 0.0)[: mesh.dim]
            return LooseBody(np.flatnonzero(piece == number), centre, motion)
    return None


def _clusters(pairs: Ints) -> list[Ints]:
    """Rows of the pairs (piece, node) of pieces that hang together at nodes; mostly all rows."""
    shape = (int(pairs[:, 0].max()) + 1, int(pairs[:, 1].max()) + 1)
    graph = sp.csr_array((np.ones(len(pairs)), (pairs[:, 0], pairs[:, 1])), shape=shape)
    count, label = connected_components(graph @ graph.T, directed=False)
    order = np.argsort(label[pairs[:, 0]], kind="stable")
    ends = np.cumsum(np.bincount(label[pairs[:, 0]], minlength=count))
    return np.split(order, ends[:-1])


def _loosest(mesh: Mesh, pairs: Ints, modes: Floats, fixed: Bools) -> tuple[int, Floats] | None:
    """The piece of a cluster that moves most, and how far in each mode over all ways to move."""
    pieces, local = np.unique(pairs[:, 0], return_inverse=True)
    gram = _gram(mesh, np.stack([local, pairs[:, 1]], axis=1), modes, fixed)
    eigenvalues, vectors = np.linalg.eigh(gram)
    free = eigenvalues <= _NULL * max(eigenvalues[-1], 1.0)
    if not free.any():
        return None
    ways = vectors[:, free].reshape(-1, modes.shape[2], int(free.sum()))
    amplitudes = np.linalg.norm(ways, axis=2)
    worst = int(np.linalg.norm(amplitudes, axis=1).argmax())
    return int(pieces[worst]), amplitudes[worst]


def _pieces(table: FaceTable, present: Bools) -> Ints:
    """Piece of every element, -1 if absent."""
    rows = np.flatnonzero(present[table.element])
    n = len(present)
    graph = sp.csr_array(
        (np.ones(len(rows)), (table.element[rows], table.face[rows])), shape=(n, table.n_faces)
    )
    _, label = connected_components(graph @ graph.T, directed=False)
    piece = np.full(n, -1, dtype=np.int64)
    _, piece[present] = np.unique(label[present], return_inverse=True)
    return piece


def _piece_nodes(mesh: Mesh, present: Bools, piece: Ints) -> Ints:
    """(n, 2) pairs (piece, node), each once."""
    if piece.max() == 0:  # as nearly always: no need to sort
        nodes = nodes_in(mesh.blocks, present)
        return np.stack([np.zeros_like(nodes), nodes], axis=1)
    pairs = []
    for block, span in spans(mesh.blocks):
        kept = present[span]
        pieces = np.repeat(piece[span][kept], block.nodes.shape[1])
        pairs.append((pieces << 32) | block.nodes[kept].ravel())
    keys = np.sort(np.concatenate(pairs))
    keys = keys[np.concatenate([[True], keys[1:] != keys[:-1]])]
    return np.stack([keys >> 32, keys & 0xFFFFFFFF], axis=1)


def _rigid_modes(mesh: Mesh, pairs: Ints) -> Floats:
    """Displacements (n_pairs, dim, n_modes) of the rigid motions of the piece of each pair.

    Rotations are about the centre of the piece and scaled by its size, so all modes weigh alike.
    """
    x = mesh.points[pairs[:, 1]]
    count = np.bincount(pairs[:, 0])
    centre = np.stack([np.bincount(pairs[:, 0], weights=c) / count for c in x.T], axis=1)
    arm = x - centre[pairs[:, 0]]
    size = np.sqrt(np.bincount(pairs[:, 0], weights=(arm**2).sum(axis=1)) / count)
    arm = arm / np.maximum(size, 1e-300)[pairs[:, 0], None]
    translations = np.broadcast_to(np.eye(mesh.dim), (len(x), mesh.dim, mesh.dim))
    if mesh.dim == 2:
        rotations = np.stack([-arm[:, 1], arm[:, 0]], axis=1)[:, :, None]
    else:
        rotations = np.stack([np.cross(axis, arm) for axis in np.eye(3)], axis=2)
    return np.concatenate([translations, rotations], axis=2)


def _gram(mesh: Mesh, pairs: Ints, modes: Floats, fixed: Bools) -> Floats:
    """Sum of the squares of all forbidden motions, as a form in the amplitudes of the modes."""
    n_modes = modes.shape[2]
    n = (int(pairs[:, 0].max()) + 1) * n_modes
    gram = np.zeros((n // n_modes, n_modes, n // n_modes, n_modes))
    held = fixed.reshape(-1, mesh.dim)[pairs[:, 1]]
    for p in np.unique(pairs[held.any(axis=1), 0]):
        rows = modes[(pairs[:, 0] == p)][held[pairs[:, 0] == p]]
        gram[p, :, p, :] += rows.T @ rows
    _add_hinges(gram, pairs, modes)
    return gram.reshape(n, n)


def _add_hinges(gram: Floats, pairs: Ints, modes: Floats) -> None:
    """Pieces that share a node move together there."""
    order = np.argsort(pairs[:, 1], kind="stable")
    same = np.flatnonzero(pairs[order[1:], 1] == pairs[order[:-1], 1])
    for at in same:
        a, b = order[at], order[at + 1]
        pa, pb = pairs[a, 0], pairs[b, 0]
        gram[pa, :, pa, :] += modes[a].T @ modes[a]
        gram[pb, :, pb, :] += modes[b].T @ modes[b]
        gram[pa, :, pb, :] -= modes[a].T @ modes[b]
        gram[pb, :, pa, :] -= modes[b].T @ modes[a]
