"""Levels of a surface with topography: where a vertical line meets a group of faces of the mesh."""

from __future__ import annotations

import numpy as np
from scipy.spatial import KDTree

from geoident.model.arrays import Bools, Floats, Ints
from geoident.model.cells import CELLS
from geoident.model.dual import Dual, ParameterPoint
from geoident.model.in_situ import Surface
from geoident.model.mesh import Mesh, rows_in

_INSIDE = 1e-9
"""How far outside a face, in parts of its size, a vertical line may pass and still meet it."""


class Topography:
    """A surface above (or below) which every vertical line passes through a level.

    Where several faces lie above each other the highest counts. Beyond the footprint of the faces
    the level is that of their horizontally nearest node, of several above each other the highest.
    """

    def __init__(self, mesh: Mesh, group: str) -> None:
        self._nodes = mesh.points[_pieces(mesh, group)]
        self._rim, self._tops = _highest(self._nodes.reshape(-1, mesh.dim))

    def levels(self, positions: Floats) -> tuple[Floats, Bools]:
        """Levels at positions (m, dim), and which of them lie outside the footprint; m."""
        plan = positions[:, :-1]
        highest = np.full(len(positions), -np.inf)
        order = np.argsort(plan[:, 0])
        along = plan[order, 0]
        for piece in self._nodes:
            low, high = piece[:, 0].min(), piece[:, 0].max()
            margin = _INSIDE * (high - low)
            first, last = np.searchsorted(along, [low - margin, high + margin])
            near = order[first:last]
            met, level = _meet(piece, plan[near])
            highest[near[met]] = np.maximum(highest[near[met]], level)
        outside = ~np.isfinite(highest)
        if outside.any():
            nearest = KDTree(self._rim).query(plan[outside])[1]
            highest[outside] = self._tops[nearest]
        return highest, outside


class Depths:
    """Levels of a surface over fixed positions: prepared once, asked for many parameters.

    Args:
        mesh: for a surface with topography.
        surface: from which depth is counted.
        positions: (m, dim) m.
    """

    def __init__(self, mesh: Mesh, surface: Surface, positions: Floats) -> None:
        self._surface = surface
        self._height = positions[:, -1]
        self.n_outside = 0
        if isinstance(surface, str):
            self._levels, outside = Topography(mesh, surface).levels(positions)
            self.n_outside = int(outside.sum())

    def at(self, point: ParameterPoint) -> Dual:
        """Depth (m,) below the surface, negative above it, m."""
        if isinstance(self._surface, str):
            return point.constant(self._levels - self._height)
        return Dual(point.number(self._surface).columns[None]).plus(-self._height)


def _pieces(mesh: Mesh, group: str) -> Ints:
    """(n, dim) nodes of the flat pieces of a group of facets."""
    pieces = []
    for block, rows in rows_in(mesh.facets, mesh.facet_groups[group]):
        pieces += [block.nodes[rows][:, piece] for piece in CELLS[block.kind].flat_pieces]
    return np.vstack(pieces)


def _highest(nodes: Floats) -> tuple[Floats, Floats]:
    """Places in plan (k, dim - 1), each once, and the level (k,) of the highest of the nodes there.

    On a cliff many stand above each other.
    """
    same = _INSIDE * np.ptp(nodes, axis=0).max()
    _, first, place = np.unique(
        np.round(nodes[:, :-1] / same), axis=0, return_index=True, return_inverse=True
    )
    tops = np.full(len(first), -np.inf)
    np.maximum.at(tops, place.ravel(), nodes[:, -1])
    return nodes[first, :-1], tops


def _meet(piece: Floats, plan: Floats) -> tuple[Bools, Floats]:
    """Which vertical lines (k, dim - 1) meet a piece (dim, dim), and at which levels."""
    base, edges = piece[0], piece[1:] - piece[0]
    matrix = edges[:, :-1].T
    size = np.abs(matrix).max(initial=0.0) ** len(matrix)
    if abs(np.linalg.det(matrix)) <= _INSIDE * size:
        return np.zeros(len(plan), dtype=bool), np.empty(0)  # a vertical piece has no level
    local = np.linalg.solve(matrix, (plan - base[:-1]).T).T
    met = (local.min(axis=1) >= -_INSIDE) & (local.sum(axis=1) <= 1 + _INSIDE)
    return met, base[-1] + local[met] @ edges[:, -1]
