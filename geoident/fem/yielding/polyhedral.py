"""Yield planes with associated flow: projection of many points on one polyhedron, all at once.

A dual active-set method, Goldfarb & Idnani (1983), Mathematical Programming 27, 1-33, exact in the
norm of E^-1. Each point starts at its trial stress with no plane active and takes in the plane it
violates most: along the ray on which the multiplier of that plane grows and the active planes stay
active. Where an active multiplier would turn negative first, its plane is dropped on the way. The
dual objective grows with every plane taken in, so no set of active planes comes twice, also where
normals depend linearly on each other. Only where planes miss each other by little more than
rounding may it grow by too little to be told from it; points that take long are therefore asked for
less and less accuracy.

The ray depends on the active planes and the new one alone, so each is computed once (`Rays`) and a
step of all points is a few operations on arrays (w, y). Most points end where they did in the last
projection, which needs no search (`LastActiveSets`).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from geoident.fem.yielding.domain import EmptyDomain, NoProjection
from geoident.fem.yielding.planes import (
    ActiveSets,
    ReturnStep,
    ScaledPlanes,
    YieldPlanes,
    rows_of_floats,
    rows_of_numbers,
    unique_pairs,
)
from geoident.model.arrays import Bools, Floats, Ints
from geoident.model.dual import Dual

_DEPENDENT = 1e-11
"""Squared sine of the angle to the active normals under which a normal depends on them."""
_LOOSEST = 1e5
"""Times the tolerance: less accuracy than that (1e-8 of the stress) is never asked for."""
_NEGLIGIBLE = 1e4
"""Times the tolerance: a contradiction of planes that is rounding of a slab without thickness."""


class Rays:
    """Directions in which a plane is taken in while those of a face stay active.

    Args:
        faces: the faces of the polyhedron, of symmetric coupling.
        root: B (r, y), B^T B = A.
    """

    def __init__(self, faces: ActiveSets, root: Floats) -> None:
        self.faces = faces
        self._root = root
        count = len(faces.coupling)
        self._row = rows_of_numbers(count)
        self._loss = rows_of_floats(count)
        self._drop = rows_of_floats(count)
        self._curvature = rows_of_floats()

    def find(self, faces: Ints, planes: Ints) -> tuple[Floats, Floats, Floats]:
        """Rays of faces (w,) and new planes (w,), per unit of the multiplier of the new plane.

        Returns:
            (w, y) by how much multipliers fall (-1 for the new plane), (w, y) by how much yield
            functions fall, and (w,) that of the new plane, zero where it depends on the face.
        """
        self._row.grow(len(self.faces.members) - self._row.size)
        rows = self._row.all[faces, planes]
        if (missing := rows < 0).any():
            count = len(self.faces.coupling)
            self._add(*unique_pairs(faces[missing], planes[missing], count))
            rows = self._row.all[faces, planes]
        return self._loss.all[rows], self._drop.all[rows], self._curvature.all[rows]

    def _add(self, faces: Ints, planes: Ints) -> None:
        """Compute rays that are asked for the first time."""
        start, count = self._loss.size, faces.size
        for table in (self._loss, self._drop, self._curvature):
            table.grow(count)
        self._row.all[faces, planes] = np.arange(start, start + count)
        for places, active, inverse in self.faces.by_size(faces.tolist()):
            new = planes[places]
            loss = np.zeros((places.size, len(self.faces.coupling)))
            across = self.faces.coupling[active, new[:, None]]
            np.put_along_axis(loss, active, np.einsum("gij,gj->gi", inverse, across), axis=1)
            loss[np.arange(places.size), new] = -1.0
            lasting = -loss @ self._root.T  # the part of the new normal across the active ones
            drop = lasting @ self._root
            np.put_along_axis(drop, active, 0.0, axis=1)
            curvature = np.einsum("gr,gr->g", lasting, lasting)
            self._loss.all[start + places] = loss
            self._drop.all[start + places] = drop
            self._curvature.all[start + places] = np.where(curvature > _DEPENDENT, curvature, 0.0)


@dataclass(eq=False)
class _Work:
    """The points that are not done, as arrays with one row each."""

    point: Ints
    excess: Floats
    tolerance: Floats
    multipliers: Floats
    face: Ints
    plane: Ints

    def keep(self, rows: Bools) -> None:
        """Forget the other points."""
        for name, value in vars(self).items():
            setattr(self, name, value[rows])


def active_sets_of(excess: Floats, tolerance: Floats, rays: Rays) -> Ints:
    """Numbers (q,) of the faces on which the projections of points lie.

    Args:
        excess: (q, y) scaled yield functions of the trial stresses.
        tolerance: (q, y) what counts as zero in them.
        rays: of the polyhedron.

    Raises:
        EmptyDomain: the planes contradict each other.
        NoProjection: points take planes in and out without end.
    """
    count, planes = excess.shape
    found = np.zeros(count, dtype=np.int64)
    work = _Work(
        point=np.arange(count),
        excess=excess.copy(),
        tolerance=tolerance.copy(),
        multipliers=np.zeros((count, planes)),
        face=found.copy(),
        plane=np.full(count, -1),
    )
    loosened = 1.0
    for step in range(step_limit(planes)):
        _choose(work)
        if step and step % (20 + planes) == 0 and loosened < _LOOSEST:
            work.tolerance *= 10.0
            loosened *= 10.0
        if (done := work.plane < 0).any():
            found[work.point[done]] = work.face[done]
            work.keep(~done)
        if not work.point.size:
            return found
        _advance(work, rays)
    raise NoProjection(work.point.size)


def step_limit(planes: int) -> int:
    """Steps that no projection needs: a handful a plane."""
    return 100 + 20 * planes


def _choose(work: _Work) -> None:
    """Give points without a plane in hand the one they violate most, if there is one."""
    free = np.flatnonzero(work.plane < 0)
    if free.size == work.point.size:
        outside = work.excess - work.tolerance
    else:
        outside = work.excess[free] - work.tolerance[free]
    worst = outside.argmax(axis=1)
    violated = outside[np.arange(free.size), worst] > 0.0
    work.plane[free[violated]] = worst[violated]


def _advance(work: _Work, rays: Rays) -> None:
    """Take one step along the rays: to the new plane, or until a multiplier vanishes."""
    rows = np.arange(work.point.size)
    loss, drop, curvature = rays.find(work.face, work.plane)
    first, bound = _first_to_vanish(work, loss)
    to_plane = np.full(rows.size, np.inf)
    np.divide(work.excess[rows, work.plane], curvature, out=to_plane, where=curvature > 0.0)
    full = (to_plane <= bound) & np.isfinite(to_plane)
    length = np.minimum(bound, to_plane)
    if (stuck := np.isinf(length)).any():
        _leave_or_refuse(work, loss, stuck)
        length[stuck] = 0.0
    loss *= length[:, None]
    drop *= length[:, None]
    work.multipliers -= loss
    work.excess -= drop
    _arrive(work, rays, full)
    _drop(work, rays, ~full & ~stuck, first)


def _first_to_vanish(work: _Work, loss: Floats) -> tuple[Ints, Floats]:
    """The active plane (w,) whose multiplier vanishes first on the way, and the step (w,) to it."""
    first, bound = np.zeros(work.point.size, dtype=np.int64), np.full(work.point.size, np.inf)
    some = np.flatnonzero(work.face)
    losing = loss[some]
    steps = np.full(losing.shape, np.inf)
    with np.errstate(over="ignore"):
        np.divide(work.multipliers[some], losing, out=steps, where=losing > _DEPENDENT)
    first[some] = steps.argmin(axis=1)
    bound[some] = steps[np.arange(some.size), first[some]]
    return first, bound


def _arrive(work: _Work, rays: Rays, rows: Bools) -> None:
    """Count the new plane among the active ones of rows that reached it."""
    planes = work.plane[rows]
    work.face[rows] = rays.faces.join(work.face[rows], planes)
    # Members are on their planes: what rounding leaves there must not call them again.
    work.excess[rows, planes] = -np.inf
    work.plane[rows] = -1


def _drop(work: _Work, rays: Rays, rows: Bools, first: Ints) -> None:
    """Take the plane whose multiplier vanished out of the active ones."""
    planes = first[rows]
    work.face[rows] = rays.faces.leave(work.face[rows], planes)
    work.multipliers[rows, planes] = 0.0
    work.excess[rows, planes] = 0.0


def _leave_or_refuse(work: _Work, loss: Floats, stuck: Bools) -> None:
    """Drop a contradiction that is rounding; refuse one that is not.

    The new normal is minus a nonnegative combination of active ones, and yet its plane is violated:
    Farkas' certificate that nothing satisfies them all.
    """
    rows = np.flatnonzero(stuck)
    planes = work.plane[rows]
    real = work.excess[rows, planes] > _NEGLIGIBLE * work.tolerance[rows, planes]
    if real.any():
        row = rows[real][0]
        raise EmptyDomain(tuple(int(i) for i in np.flatnonzero(loss[row] < -_DEPENDENT)))
    work.excess[rows, planes] = -np.inf
    work.plane[rows] = -1


class LastActiveSets:
    """The faces on which the points of a law ended in its last projection: most end there again.

    Newton's method and its line search project almost the same stresses many times over. A point is
    tried on the face of its last projection first; where multipliers and yield functions confirm it
    (the Kuhn-Tucker conditions, which are sufficient), no search is needed.

    Args:
        faces: their numbers.
    """

    def __init__(self, faces: ActiveSets) -> None:
        self._faces = faces
        self._last = np.empty(0, dtype=np.int64)

    def keep(self, count: int, points: Ints, face: Ints) -> None:
        """Remember where points ended.

        Args:
            count: of all points.
            points: (q,) those that were projected.
            face: (q,) their faces.
        """
        self._last = np.zeros(count, dtype=np.int64)
        self._last[points] = face

    def confirmed(self, count: int, points: Ints, excess: Floats, tolerance: Floats) -> Ints:
        """Faces (q,) of points that end where they did; 0 for those that have to be searched.

        Args:
            count: number of points of the law.
            points: (q,) those outside the polyhedron.
            excess: (q, y) scaled yield functions of their trial stresses.
            tolerance: (q, y) what counts as zero in them.
        """
        found = np.zeros(len(points), dtype=np.int64)
        if len(self._last) != count:
            return found
        guess = self._last[points]
        tried = np.flatnonzero(guess > 0)
        if len(tried):
            holds = self._holds(guess[tried], excess[tried], tolerance[tried])
            found[tried[holds]] = guess[tried[holds]]
        return found

    def _holds(self, face: Ints, excess: Floats, tolerance: Floats) -> Bools:
        """Whether multipliers are not negative and no plane is violated on faces (q,)."""
        used, place = np.unique(face, return_inverse=True)
        planes, inverses = self._faces.compact(used.tolist())
        mine = planes[place]
        active = np.take_along_axis(excess, mine, axis=1)
        multipliers = np.einsum("qij,qj->qi", inverses[place], active)
        full = np.zeros_like(excess)
        np.put_along_axis(full, mine, multipliers, axis=1)
        after = excess - full @ self._faces.coupling
        return np.asarray((multipliers >= 0.0).all(axis=1) & (after <= tolerance).all(axis=1))


_MOST_FACES = 20_000
"""Of many planes that harden there are as many faces as points, and none comes again."""


class PolyhedralLaw:
    """Yield planes in the space of stresses, associated, perfect or hardening.

    Args:
        elasticity: E (s, s), symmetric, positive definite, Pa.
        planes: normals (y, s); any number, also parallel or repeated ones.

    Raises:
        ValueError: E is not positive definite, a plane has no normal, or a flow is given.
    """

    def __init__(self, elasticity: Dual, planes: YieldPlanes) -> None:
        if planes.flow is not None:
            raise ValueError("planes in the space of stresses flow along their normals")
        self.planes = planes
        self._system = ScaledPlanes(elasticity, planes)
        self._forget()

    def _forget(self) -> None:
        """Begin with no face known."""
        self._rays = Rays(ActiveSets(self._system.coupling), self._system.root)
        self._memory = LastActiveSets(self._rays.faces)

    @property
    def associated(self) -> bool:
        """Always."""
        return True

    @property
    def hardens(self) -> bool:
        """Whether the multipliers of earlier steps count."""
        return self._system.hardens

    def at(self, points: Ints) -> PolyhedralLaw:
        """The same at points (k,): its numbers are those of all."""
        return self

    def project(self, trial: Floats, hardened: Floats | None = None) -> ReturnStep:
        """Bring trial stresses (s, m) to the polyhedron; `hardened` (y, m) as in `YieldLaw`.

        Raises:
            EmptyDomain: no stress satisfies all planes.
        """
        # Projections keep the faces they know; only a law between two of them may forget.
        if len(self._rays.faces.members) > _MOST_FACES:
            self._forget()
        yielded, face = self._faces_of(trial, hardened)
        some = None if hardened is None else hardened[:, yielded]
        return ReturnStep(self._system, self._rays.faces, trial, yielded, some, face)

    def _faces_of(self, trial: Floats, hardened: Floats | None) -> tuple[Ints, Ints]:
        """The points (q,) outside the polyhedron and the faces (q,) on which they end."""
        excess = self._system.excess(trial, hardened)
        outside = np.flatnonzero((excess > 0.0).any(axis=0))
        some = None if hardened is None else hardened[:, outside]
        beyond = np.ascontiguousarray(excess[:, outside].T)
        tolerance = np.ascontiguousarray(self._system.tolerance(trial[:, outside], some).T)
        count = trial.shape[1]
        face = self._memory.confirmed(count, outside, beyond, tolerance)
        rest = np.flatnonzero(face == 0)
        face[rest] = active_sets_of(beyond[rest], tolerance[rest], self._rays)
        self._memory.keep(count, outside, face)
        return outside[face > 0], face[face > 0]

    def excess(self, stress: Floats, hardened: Floats | None = None) -> Floats:
        """The yield functions psi (y, m) of stresses (s, m): positive outside, Pa."""
        return self._system.excess(stress, hardened) * self._system.scale[:, None]
