"""How far ground yields, state by state, as numbers: volume, reach, plastic radius."""

from __future__ import annotations

import numpy as np

from geoident.fem.faces import FacetPatch, distance_to_faces, patches
from geoident.forward.stages import CaseOnMesh
from geoident.model.arrays import Bools, Floats
from geoident.model.case import Analysis
from geoident.model.results.yielded import YieldedGround

_ROUND = 0.01
"""Deviation of an outline from a circle, in parts of its radius, that counts as none."""

_FEWEST = 8
"""Nodes of an outline that is taken for round."""

_FLAT = 2.0
"""Radius in parts of the size of the outline beyond which it is flat, not round."""


class YieldRecorder:
    """Notes, state by state, which ground has yielded so far, and how far it reaches.

    Args:
        on_mesh: the case on its mesh.
    """

    def __init__(self, on_mesh: CaseOnMesh) -> None:
        self._on_mesh, self._sequence = on_mesh, on_mesh.sequence
        self._points = on_mesh.discretization.points
        self._group = self._sequence.group_of[self._points.element]
        self._yielded: list[Bools] = []
        self._dug: list[frozenset[int]] = []
        self._rows: list[tuple[float, ...]] = []
        self._walls: dict[frozenset[int], tuple[FacetPatch, ...]] = {}

    def add(self, number: int, yielded: Bools, *, known: bool) -> None:
        """Record a state.

        Args:
            number: of the state; states come in their order.
            yielded: (n_points,) strain points that yield in it.
            known: whether it was reached.
        """
        state = self._sequence.states[number]
        can = {g for g, m in state.materials.items() if self._on_mesh.case.materials[m].yields}
        able = np.isin(self._group, sorted(can))
        so_far, dug = yielded.copy(), frozenset[int]()
        if number:
            so_far |= self._yielded[state.base] & ~np.isin(self._group, sorted(state.placed))
            dug = self._dug[state.base] | state.leaving
        so_far &= able
        self._yielded.append(so_far)
        self._dug.append(dug)
        self._rows.append(self._row(so_far, able, dug, known=known))

    def table(self) -> YieldedGround:
        """All that was recorded."""
        dim = self._on_mesh.mesh.dim
        columns = np.array(self._rows).reshape(-1, 4 + 2 * dim).T
        names = tuple(state.name for state in self._sequence.states[: len(self._rows)])
        unit = "m2" if self._on_mesh.case.analysis is Analysis.PLANE_STRAIN else "m3"
        lower, upper = columns[4 : 4 + dim].T, columns[4 + dim :].T
        volume, share, reach, radius = columns[:4]
        return YieldedGround(names, volume, share, reach, radius, lower, upper, unit)

    def _row(
        self, so_far: Bools, able: Bools, dug: frozenset[int], *, known: bool
    ) -> tuple[float, ...]:
        """Volume, share, reach, radius, least and largest coordinates of a state."""
        dim = self._on_mesh.mesh.dim
        nothing = (np.nan,) * (2 + 2 * dim)
        if not known:
            return (np.nan, np.nan, *nothing)
        volume = float(self._points.volume[so_far].sum())
        if not volume:
            return (0.0, 0.0, *nothing)
        share = volume / float(self._points.volume[able].sum())
        where = self._points.position[so_far]
        wall = self._wall(dug)
        reach = _farthest(self._on_mesh, wall, where) if wall else np.nan
        centre = self._centre(wall)
        radius = np.nan if centre is None else np.linalg.norm(where - centre, axis=1).max()
        return (volume, share, reach, float(radius), *where.min(axis=0), *where.max(axis=0))

    def _wall(self, dug: frozenset[int]) -> tuple[FacetPatch, ...]:
        """Faces between what was excavated so far, by groups, and the ground around it."""
        if dug not in self._walls:
            mesh, table = self._on_mesh.mesh, self._on_mesh.table
            gone = np.isin(self._sequence.group_of, sorted(dug))
            outer, edge = table.free(gone), table.free(np.ones_like(gone))
            inside = ~np.isin(table.face[outer], table.face[edge])
            self._walls[dug] = patches(mesh, table, outer[inside])
        return self._walls[dug]

    def _centre(self, wall: tuple[FacetPatch, ...]) -> Floats | None:
        """The centre (2,) of an outline in the plane; None where it is no circle."""
        mesh = self._on_mesh.mesh
        if mesh.dim != 2 or not wall:
            return None
        nodes = np.unique(np.concatenate([patch.nodes.ravel() for patch in wall]))
        return circle_centre(mesh.points[nodes])


def circle_centre(points: Floats) -> Floats | None:
    """The centre (2,) of the circle on which points (n, 2) lie; None where they lie on none."""
    if len(points) < _FEWEST:
        return None
    middle = points.mean(axis=0)
    x = points - middle
    # |x|^2 = 2 x . c + (R^2 - |c|^2), by least squares
    rows = np.column_stack([2.0 * x, np.ones(len(x))])
    solution, _, rank, _ = np.linalg.lstsq(rows, (x**2).sum(axis=1), rcond=None)
    if rank < rows.shape[1]:
        return None
    centre = solution[:2]
    away = np.linalg.norm(x - centre, axis=1)
    radius = float(away.mean())
    size = float(np.linalg.norm(np.ptp(x, axis=0)))
    is_round = radius < _FLAT * size and np.abs(away - radius).max() < _ROUND * radius
    return np.asarray(middle + centre) if is_round else None


def _farthest(on_mesh: CaseOnMesh, wall: tuple[FacetPatch, ...], where: Floats) -> float:
    """The largest distance of places (n, dim) from some faces, m.

    No place is farther from the faces than from their nodes, so only those are measured whose
    nodes are farther away than the farthest so far.
    """
    from scipy.spatial import cKDTree  # noqa: PLC0415 - 0.3 s

    mesh = on_mesh.mesh
    nodes = np.unique(np.concatenate([patch.nodes.ravel() for patch in wall]))
    bound = np.asarray(cKDTree(mesh.points[nodes]).query(where)[0], dtype=np.float64)
    farthest = 0.0
    for k in np.argsort(-bound):
        if bound[k] <= farthest:
            break
        farthest = max(farthest, distance_to_faces(mesh, wall, where[k]))
    return farthest
