"""What stands above a place: ground and loads along the vertical line through it.

A vertical line meets the boundary of a body where it enters and where it leaves it. With levels l_f
of these meetings and signs s_f = 1 where the body ends upwards, -1 where it begins, the length of
the line in the body above a level z is

    L = sum_f s_f max(l_f - z, 0) ,

so only the boundary of the ground of each material is looked at, not its elements: tilted layers,
lenses and voids need nothing of their own. Faces are taken as flat pieces between their nodes
(`CellKind.flat_pieces`): lengths are exact for straight-sided elements and of second order in
their size where mid-nodes make them curved. Of neighbours both faces are cut in the same way, and a
line that passes along the edge between two pieces meets just one of them: by half-open intervals in
a section, by the side on which it passes the edge, counted from the edge's smaller node, in space.

The lines are sought once per mesh and set of places; what depends on parameters comes after.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from functools import cached_property

import numpy as np
import scipy.sparse as sp

from geoident.fem.faces import FacetPatch, load_patches
from geoident.forward.in_situ.water import FacePressure
from geoident.forward.stages import CaseOnMesh
from geoident.model.actions import FaceLoad, Pressure, Seismic, Traction
from geoident.model.arrays import Bools, Floats, Ints
from geoident.model.case import Case
from geoident.model.cells import CELLS
from geoident.model.dual import Dual, ParameterPoint
from geoident.model.mesh import Mesh

_INWARDS = 1e-7
"""How far a place on the border is moved into its element, in parts of the way to its centre."""

_ASIDE = 1e-10 * np.array([1.0, 0.6180339887498949])
"""How far other lines are moved, in parts of the mesh, so as not to pass through nodes."""

_SAME_LEVEL = 1e-9
"""Difference of levels, in parts of the mesh, that is none."""

_APART = 2.0
"""Distance of strips in the order of places: the end of one is not within the start of the next."""

_CHUNK = 4_000_000
"""Pairs of a place and a piece that are looked at together."""


@dataclass(frozen=True)
class _Pieces:
    """Flat pieces of a boundary: lines or triangles.

    Args:
        corners: (k, dim, dim) corners, in an order that neighbours agree on.
        nodes: (k, dim) their numbers.
        sign: (k,) 1 where the body is below, -1 where it is above, 0 where it is beside.
        plan: (k,) area in plan over the area.
    """

    corners: Floats
    nodes: Ints
    sign: Floats
    plan: Floats


@dataclass(frozen=True)
class _Meetings:
    """Where vertical lines through places meet pieces.

    Args:
        place: (k,) number of the place.
        sign: (k,) of the piece.
        plan: (k,) of the piece.
        level: (k,) m.
    """

    place: Ints
    sign: Floats
    plan: Floats
    level: Floats


def _load_above(
    load: FaceLoad, met: _Meetings, positions: Floats
) -> Callable[[ParameterPoint], Dual]:
    """A load on faces as a vertical pressure (m,) on places below: per area in plan, downwards, Pa.

    Args:
        load: the load.
        met: where the lines above the places meet its faces.
        positions: (m, dim) the places, m.
    """

    def sums(each: Floats) -> Floats:
        """Sums (m,) of numbers (k,) given where lines meet faces."""
        total = np.bincount(met.place, weights=each, minlength=len(positions))
        return total.astype(np.float64)

    if isinstance(load, Pressure):
        pressed, pressure = sums(met.sign), load.value
        return lambda point: Dual(np.outer(pressed, point.number(pressure).columns))
    if isinstance(load, Traction):
        pulled, along = sums(-1.0 / met.plan), load.value[-1]
        return lambda point: Dual(np.outer(pulled, point.number(along).columns))
    on_faces = positions[met.place].copy()
    on_faces[:, -1] = met.level
    water = FacePressure(load, on_faces)
    return lambda point: Dual(
        np.stack([sums(met.sign * column) for column in water.at(point).columns.T], axis=-1)
    )


@dataclass(frozen=True)
class GroundAbove:
    """Ground and loads above some places.

    Args:
        lengths: (m, n_materials) sparse, of the vertical line above each place in each material, m.
        materials: names of the materials.
        top: (m,) level at which the ground ends, m; that of the place if none is above.
        loads: pressure (m,) of each load on faces above.
        tolerance: difference of levels that is none, m.
    """

    lengths: sp.csr_array
    materials: tuple[str, ...]
    top: Floats
    loads: tuple[Callable[[ParameterPoint], Dual], ...]
    tolerance: float

    def weight(self, case: Case, point: ParameterPoint) -> Dual:
        """Weight above each place per area in plan, (m,), Pa, of ground and loads."""
        pull = 0.0 if case.gravity is None else -case.gravity[-1]
        size = 0.0 if case.gravity is None else float(np.linalg.norm(case.gravity))
        acceleration = point.constant(pull)
        for load in case.loads.values():
            if isinstance(load, Seismic):
                acceleration = acceleration - point.number(load.factors[-1]).times(size)
        unit_weights = [
            (point.number(case.materials[name].density) * acceleration).columns
            for name in self.materials
        ]
        each = np.array(unit_weights).reshape(-1, point.n_columns)
        total = Dual(np.asarray(self.lengths @ each))
        for pressure in self.loads:
            total = total + pressure(point)
        return total

    @property
    def uncovered(self) -> Bools:
        """(m,) places with no ground above them."""
        return np.asarray(self.lengths.sum(axis=1) <= self.tolerance)


class Overburden:
    """Finds what stands above places in the initial state of a case.

    Args:
        on_mesh: the case on its mesh; one without mesh has none that weighs.
    """

    def __init__(self, on_mesh: CaseOnMesh) -> None:
        self._on_mesh, self._mesh = on_mesh, on_mesh.mesh

    def above(self, positions: Floats, elements: Ints | None = None) -> GroundAbove:
        """What stands above some places.

        Args:
            positions: (m, dim) m.
            elements: (m,) the elements on whose border the places lie; None: they lie inside.
        """
        plan = positions[:, :-1] + self._aside(positions, elements)
        index = _PlanIndex(plan)
        tolerance = _SAME_LEVEL * float(np.ptp(self._mesh.points, axis=0).max(initial=1.0))
        top = positions[:, -1].copy()
        lengths = []
        for met in (_met(index, p, positions, plan) for p in self._boundaries.values()):
            rise = np.maximum(met.level - positions[met.place, -1], 0.0)
            rise[rise <= tolerance] = 0.0
            length = np.bincount(met.place, weights=met.sign * rise, minlength=len(positions))
            lengths.append(sp.csr_array(np.where(length > tolerance, length, 0.0)[:, None]))
            np.maximum.at(top, met.place, met.level)
        loads = []
        for load, pieces in self._loaded:
            met = _met(index, pieces, positions, plan)
            higher = met.level > positions[met.place, -1] + tolerance
            met = _Meetings(
                met.place[higher], met.sign[higher], met.plan[higher], met.level[higher]
            )
            loads.append(_load_above(load, met, positions))
        every = sp.hstack(lengths, format="csr") if lengths else sp.csr_array((len(positions), 0))
        return GroundAbove(every, tuple(self._boundaries), top, tuple(loads), tolerance)

    def _aside(self, positions: Floats, elements: Ints | None) -> Floats:
        """(m, dim - 1) by which lines are moved, so that they pass through the inside."""
        if elements is not None:
            return (_INWARDS * (self._centres[elements] - positions))[:, :-1]
        size = np.ptp(self._mesh.points, axis=0).max()
        return np.broadcast_to(size * _ASIDE[: positions.shape[1] - 1], positions[:, :-1].shape)

    @cached_property
    def _centres(self) -> Floats:
        """(n_elements, dim) m."""
        points = self._mesh.points
        return np.concatenate([points[block.nodes].mean(axis=1) for block in self._mesh.blocks])

    @cached_property
    def _boundaries(self) -> Mapping[str, _Pieces]:
        """Material to the boundary of all ground that is made of it at the beginning."""
        return {m: _pieces(self._mesh, faces) for m, faces in self._on_mesh.boundaries.items()}

    @cached_property
    def _loaded(self) -> tuple[tuple[FaceLoad, _Pieces], ...]:
        """Loads on faces that act from the beginning, with the faces."""
        mesh, table = self._mesh, self._on_mesh.table
        present = self._on_mesh.sequence.present(0)
        loaded = []
        for load in self._on_mesh.case.loads.values():
            if isinstance(load, FaceLoad):
                faces = load_patches(mesh, table, load.group, present) or ()
                loaded.append((load, _pieces(mesh, faces)))
        return tuple(loaded)


def _pieces(mesh: Mesh, faces: tuple[FacetPatch, ...]) -> _Pieces:
    """Flat pieces of faces, cut in the same way from both sides."""
    dim = mesh.dim
    corners, nodes, signs = [np.empty((0, dim, dim))], [np.empty((0, dim), np.int64)], []
    for patch in faces:
        rows, turned = _canonical(patch)
        for piece in CELLS[patch.kind].flat_pieces:
            nodes.append(rows[:, piece])
            corners.append(mesh.points[rows[:, piece]])
            signs.append(turned)
    where, which = np.concatenate(corners), np.concatenate(nodes)
    edges = where[:, 1:] - where[:, :1]
    if dim == 2:
        plan, size = -edges[:, 0, 0], np.linalg.norm(edges[:, 0], axis=1)
    else:
        normal = np.cross(edges[:, 0], edges[:, 1])
        plan, size = normal[:, 2], np.linalg.norm(normal, axis=1)
    turn = np.concatenate([np.empty(0), *signs])
    share = np.abs(plan) / np.where(size > 0, size, 1.0)
    return _Pieces(where, which, np.sign(plan) * turn, share)


def _canonical(patch: FacetPatch) -> tuple[Ints, Floats]:
    """Nodes of faces from their smallest corner on towards its smaller neighbour.

    Returns:
        The nodes, and (n,) -1 where the order was turned round by that, else 1.
    """
    n_corners = CELLS[patch.kind].n_corners
    nodes, turned = patch.nodes.copy(), np.ones(len(patch.nodes))
    if n_corners < 3:
        return nodes, turned
    first = np.argmin(nodes[:, :n_corners], axis=1)
    around = (np.arange(n_corners) + first[:, None]) % n_corners
    rows = np.arange(len(nodes))[:, None]
    order = around
    back = nodes[rows[:, 0], around[:, 1]] > nodes[rows[:, 0], around[:, -1]]
    order = np.where(back[:, None], around[:, [0, *range(n_corners - 1, 0, -1)]], around)
    parts = [nodes[rows, order]]
    if nodes.shape[1] > n_corners:
        middle = np.where(back[:, None], around[:, ::-1], around)
        parts.append(nodes[rows, n_corners + middle])
    return np.concatenate(parts, axis=1), np.where(back, -1.0, 1.0)


class _PlanIndex:
    """Places in plan, sorted so that those near a piece are a few runs of the order."""

    def __init__(self, plan: Floats) -> None:
        self.plan = plan
        self._low = plan.min(axis=0, initial=np.inf) if len(plan) else np.zeros(plan.shape[1])
        size = np.ptp(plan, axis=0) if len(plan) else np.ones(plan.shape[1])
        self._size = np.where(size > 0, size, 1.0) * (1 + 1e-9)
        self._strips = max(1, int(np.sqrt(len(plan)) / 4)) if plan.shape[1] == 2 else 1
        strip, along = self._coordinates(plan)
        self.order = np.argsort(_APART * strip + along, kind="stable")
        self._sorted = (_APART * strip + along)[self.order]

    def _coordinates(self, plan: Floats) -> tuple[Ints, Floats]:
        """The strip, and how far along it, from 0 to 1, of places (m, dim - 1)."""
        parts = np.clip((plan - self._low) / self._size, 0.0, 1 - 1e-9)
        if plan.shape[1] == 1:
            return np.zeros(len(plan), np.int64), parts[:, 0]
        return (parts[:, 0] * self._strips).astype(np.int64), parts[:, 1]

    def near(self, corners: Floats) -> Iterator[tuple[Ints, Ints]]:
        """Pairs (number of a piece, number of a place) whose boxes in plan meet, in chunks.

        Args:
            corners: (k, dim, dim) of the pieces.
        """
        low, high = corners[..., :-1].min(axis=1), corners[..., :-1].max(axis=1)
        touching = np.all((high >= self._low) & (low <= self._low + self._size), axis=1)
        pieces = np.flatnonzero(touching)
        first_strip, start = self._coordinates(low[pieces])
        last_strip, end = self._coordinates(high[pieces])
        which, strip = _runs(first_strip, last_strip + 1)
        start, end = start[which] - 1e-9, end[which] + 1e-9
        first = np.searchsorted(self._sorted, _APART * strip + start)
        last = np.searchsorted(self._sorted, _APART * strip + end, side="right")
        bounds = np.cumsum(last - first) // _CHUNK
        for chunk in np.split(np.arange(len(which)), np.flatnonzero(np.diff(bounds)) + 1):
            run, place = _runs(first[chunk], last[chunk])
            yield pieces[which[chunk[run]]], self.order[place]


def _runs(first: Ints, last: Ints) -> tuple[Ints, Ints]:
    """All numbers from first to before last of k runs: which run, and the number."""
    count = last - first
    run = np.repeat(np.arange(len(count)), count)
    before = np.cumsum(count) - count
    return run, np.arange(len(run)) - np.repeat(before - first, count)


def _met(index: _PlanIndex, pieces: _Pieces, positions: Floats, plan: Floats) -> _Meetings:
    """Where the vertical lines through places meet pieces; levels above the places themselves.

    Args:
        index: of the plan.
        pieces: which are met.
        positions: (m, dim) the places, m.
        plan: (m, dim - 1) where their lines pass.
    """
    meetings: list[tuple[Ints, Ints, Floats]] = []
    meets = _lines_met if plan.shape[1] == 1 else _triangles_met
    for near_piece, near_place in index.near(pieces.corners):
        met = meets(pieces.corners[near_piece], pieces.nodes[near_piece], plan[near_place])
        met &= pieces.sign[near_piece] != 0
        piece, place = near_piece[met], near_place[met]
        levels = _levels(pieces.corners[piece], positions[place, :-1])
        meetings.append((place, piece, levels))
    place = np.concatenate([np.empty(0, np.int64), *(p for p, _, _ in meetings)])
    piece = np.concatenate([np.empty(0, np.int64), *(p for _, p, _ in meetings)])
    level = np.concatenate([np.empty(0), *(z for _, _, z in meetings)])
    return _Meetings(place, pieces.sign[piece], pieces.plan[piece], level)


def _lines_met(corners: Floats, nodes: Ints, plan: Floats) -> Bools:
    """(k,) whether vertical lines at plan (k, 1) meet lines (k, 2, 2); the right end is not met."""
    one, other, x = corners[:, 0, 0], corners[:, 1, 0], plan[:, 0]
    return np.asarray((x >= np.minimum(one, other)) & (x < np.maximum(one, other)))


def _triangles_met(corners: Floats, nodes: Ints, plan: Floats) -> Bools:
    """(k,) whether vertical lines at plan (k, 2) meet triangles (k, 3, 3)."""
    sides = []
    for i, j in ((0, 1), (1, 2), (2, 0)):
        swapped = nodes[:, i] > nodes[:, j]
        a, b = corners[:, i, :2], corners[:, j, :2]
        start, end = np.where(swapped[:, None], b, a), np.where(swapped[:, None], a, b)
        along, to = end - start, plan - start
        left = along[:, 0] * to[:, 1] - along[:, 1] * to[:, 0] >= 0
        sides.append(left ^ swapped)
    return np.asarray((sides[0] == sides[1]) & (sides[1] == sides[2]))


def _levels(corners: Floats, plan: Floats) -> Floats:
    """Levels (k,) of pieces (k, dim, dim) at plan (k, dim - 1), m, between those of its corners."""
    base, edges = corners[:, 0], corners[:, 1:] - corners[:, :1]
    to = plan - base[:, :-1]
    if plan.shape[1] == 1:
        rise = edges[:, 0, 1] * (to[:, 0] / edges[:, 0, 0])
    else:
        normal = np.cross(edges[:, 0], edges[:, 1])
        rise = -(normal[:, 0] * to[:, 0] + normal[:, 1] * to[:, 1]) / normal[:, 2]
    heights = corners[..., -1]
    return np.asarray(np.clip(base[:, -1] + rise, heights.min(axis=1), heights.max(axis=1)))
