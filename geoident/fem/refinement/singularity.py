"""Corners of the ground, and how fast a mesh converges there (theory 9.4).

Around a corner of free ground with the opening omega the displacements grow as r^lambda, with
lambda the smallest root of

    sin(lambda omega) + lambda sin(omega) = 0 ,     1/2 < lambda < 1 for omega > 180 degrees

(Williams 1952). On meshes that are uniformly refined there, readings of displacements converge with
h^(2 lambda) and not with the order of the elements: 1.09 at the corners of a rectangular opening.
"""

from __future__ import annotations

import math

import numpy as np

from geoident.fem.faces import FaceTable
from geoident.model.arrays import Bools, Floats, Ints
from geoident.model.cells import CELLS
from geoident.model.mesh import ElementBlock, Mesh, rows_in

_STRAIGHT = np.radians(1.0)
"""Turn of a boundary below which it counts as straight."""

_ROUND = np.radians(20.0)
"""Turn at an edge of cells with curved faces below which it counts as round."""


def exponent(opening: float) -> float:
    """Exponent lambda of the displacements at a corner of an opening (rad) of free ground.

    Infinite where there is none: nothing grows without bounds there.

    >>> round(exponent(1.5 * np.pi), 4)
    0.5445
    """
    if opening <= np.pi + _STRAIGHT:
        return np.inf
    # It is 1/2 for a slit, with room for rounding there, and nears 1 for a straight side.
    from scipy.optimize import brentq  # noqa: PLC0415 - 0.3 s, and few runs refine meshes

    root = brentq(lambda x: math.sin(x * opening) + x * math.sin(opening), 0.5 - 1e-9, 1.0)
    return float(root)


def openings(mesh: Mesh, table: FaceTable, present: Bools) -> Floats:
    """Openings (k,), rad, of the ground at its free corners (in space: edges).

    Args:
        mesh: the mesh.
        table: its faces.
        present: (n_elements,) which elements are there.
    """
    ends, angles, round_ones = _angles(mesh, present)
    free = table.free(present)
    keys, place = np.unique(ends, axis=0, return_inverse=True)
    whole = np.bincount(place.ravel(), angles, minlength=len(keys))
    curved = np.bincount(place.ravel(), round_ones, minlength=len(keys)) > 0
    at_free = np.isin(_joined(keys, mesh), _free_ends(mesh, table, free))
    angle, soft = whole[at_free], curved[at_free]
    return np.asarray(np.where(soft & (angle < np.pi + _ROUND), np.minimum(angle, np.pi), angle))


def _joined(ends: Ints, mesh: Mesh) -> Ints:
    """One number (k,) for the nodes (k, 1 or 2) of a corner or edge."""
    return np.asarray(ends[:, 0] * mesh.n_nodes + ends[:, -1])


def _free_ends(mesh: Mesh, table: FaceTable, rows: Ints) -> Ints:
    """Corners (edges) of the free faces in some rows of the table, as `_joined` numbers."""
    ends = [np.empty(0, np.int64)]
    for block, local, _, nodes in table.by_place(mesh, rows):
        n = len(CELLS[block.kind].shape.faces[local])
        if mesh.dim == 2:
            ends += [_joined(nodes[:, [k]], mesh) for k in range(n)]
        else:
            edges = [np.sort(nodes[:, [k, (k + 1) % n]], axis=1) for k in range(n)]
            ends += [_joined(edge, mesh) for edge in edges]
    return np.unique(np.concatenate(ends))


def _angles(mesh: Mesh, present: Bools) -> tuple[Ints, Floats, Floats]:
    """Angles of elements: nodes (k, 1 or 2), angle (k,) rad, and 1 where faces may be round."""
    parts: list[tuple[Ints, Floats, Floats]] = []
    for block, rows in rows_in(mesh.blocks, present):
        taken = ElementBlock(block.kind, block.nodes[rows], block.numbers[rows])
        at_ends = _at_corners(mesh, taken) if mesh.dim == 2 else _at_edges(mesh, taken)
        soft = float(CELLS[block.kind].order == 2 and mesh.dim == 3)
        parts += [(ends, angle, np.full(len(angle), soft)) for ends, angle in at_ends]
    ends, angles, soft_ones = (np.concatenate(part) for part in zip(*parts, strict=True))
    return ends, angles, soft_ones


def _at_corners(mesh: Mesh, block: ElementBlock) -> list[tuple[Ints, Floats]]:
    cell = CELLS[block.kind]
    n, angles = cell.n_corners, []
    for k in range(n):
        sides = [_tangent(mesh, block, k, (k + step) % n) for step in (1, -1)]
        angles.append((block.nodes[:, [k]], _between(*sides)))
    return angles


def _tangent(mesh: Mesh, block: ElementBlock, a: int, b: int) -> Floats:
    """Direction (n, dim) in which the edge from corner a to b begins."""
    cell, x = CELLS[block.kind], mesh.points[block.nodes]
    chord = x[:, b] - x[:, a]
    pairs = [frozenset(edge) for edge in cell.edges]
    if frozenset((a, b)) not in pairs:
        return np.asarray(chord)
    middle = x[:, cell.n_corners + pairs.index(frozenset((a, b)))]
    return np.asarray(4.0 * (middle - x[:, a]) - chord)


def _at_edges(mesh: Mesh, block: ElementBlock) -> list[tuple[Ints, Floats]]:
    shape, x = CELLS[block.kind].shape, mesh.points[block.nodes]
    angles = []
    for a, b in shape.edges:
        along = x[:, b] - x[:, a]
        along = along / np.linalg.norm(along, axis=1)[:, None]
        sides = []
        for face in shape.faces:
            if a in face and b in face:
                others = [c for c in face if c not in (a, b)]
                away = x[:, others].mean(axis=1) - x[:, a]
                sides.append(away - np.einsum("ni,ni->n", away, along)[:, None] * along)
        angles.append((np.sort(block.nodes[:, [a, b]], axis=1), _between(sides[0], sides[1])))
    return angles


def _between(one: Floats, other: Floats) -> Floats:
    """Angles (n,) between directions (n, dim), rad."""
    size = np.linalg.norm(one, axis=1) * np.linalg.norm(other, axis=1)
    cosine = np.einsum("ni,ni->n", one, other) / np.where(size > 0.0, size, 1.0)
    return np.asarray(np.arccos(np.clip(cosine, -1.0, 1.0)))
