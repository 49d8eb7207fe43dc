"""Yield surfaces of planes with associated flow: exact projection in the norm of E^-1.

The return step has stress, multipliers, tangent and derivatives of points whose active planes are
known.
"""

from __future__ import annotations

from functools import cached_property

import numpy as np

from geoident.fem.yielding.law import ScaledPlanes, YieldPlanes
from geoident.fem.yielding.projection import ActiveSets, Rays, active_sets_of
from geoident.model.arrays import Bools, Floats, Ints
from geoident.model.dual import Dual

_REACHED = 100.0
"""Times the tolerance of a yield function: within it a plane is reached."""


class ReturnStep:
    """The step from trial stresses to the faces on which they end: a `law.Projection`.

    Args:
        system: the planes.
        faces: of its coupling.
        trial: s* (s, m) of all points.
        yielded: (q,) those with an active plane, ascending.
        hardened: multipliers of earlier steps (y, q); None for zero.
        face: (q,) numbers of faces.
    """

    def __init__(
        self,
        system: ScaledPlanes,
        faces: ActiveSets,
        trial: Floats,
        yielded: Ints,
        hardened: Floats | None,
        face: Ints,
    ) -> None:
        self._system = system
        self._faces = faces
        self._all = trial
        self.yielded = yielded
        self.trial = trial[:, yielded]
        self._hardened = hardened
        self._used, self._place = np.unique(face, return_inverse=True)
        self._face_planes, self._face_inverse = faces.compact(self._used.tolist())
        self._planes = self._face_planes[self._place]
        self._inverse = self._face_inverse[self._place]
        self._scaled = self._solve()

    def _solve(self) -> Floats:
        """Scaled multipliers (q, y), refined once: what the inverse lacks in digits."""
        excess = self._system.excess(self.trial, self._hardened).T
        multipliers = np.zeros_like(excess)
        for _ in range(2):
            rest = excess - multipliers @ self._system.coupling.T
            active = np.take_along_axis(rest, self._planes, axis=1)
            multipliers += self._spread(np.einsum("qij,qj->qi", self._inverse, active))
        return multipliers

    def _spread(self, compact: Floats) -> Floats:
        """Values (q, w) of active planes at their places among all, (q, y)."""
        full = np.zeros((len(compact), len(self._system.scale)))
        np.put_along_axis(full, self._planes, compact, axis=1)
        return full

    @property
    def signed_multipliers(self) -> Floats:
        """(q, y), of the planes as given, with the sign that rounding left."""
        return self._scaled / self._system.scale

    @property
    def multipliers(self) -> Floats:
        """(q, y) >= 0, of the planes as given."""
        return np.maximum(self.signed_multipliers, 0.0)

    @cached_property
    def returned(self) -> Floats:
        """(s, q) admissible stress at the yielded points."""
        return np.asarray(self.trial - self._system.moved @ self._scaled.T)

    @cached_property
    def stress(self) -> Floats:
        """(s, m) admissible stress; the trial stress itself where nothing yields."""
        stress = self._all.copy()
        stress[:, self.yielded] = self.returned
        return stress

    @cached_property
    def active(self) -> Bools:
        """(q, y) planes on which the derivatives are taken."""
        table = np.zeros((len(self._used), len(self._system.scale)), dtype=np.bool_)
        for row, face in enumerate(self._used):
            table[row, list(self._faces.members[face])] = True
        return table[self._place]

    @cached_property
    def _near(self) -> Floats:
        """(q, y): what is zero but for rounding, in yield functions and scaled multipliers."""
        return _REACHED * self._system.tolerance(self.trial, self._hardened).T

    @cached_property
    def reached(self) -> Bools:
        """(q, y) planes on which the stress lies."""
        limits = self._system.limits(self._hardened) + self._system.hardening @ self._scaled.T
        excess = self._system.normals @ self.returned - limits
        return np.asarray(excess.T + self._near >= 0.0)

    @property
    def working(self) -> Bools:
        """(q, y) planes with a multiplier."""
        return np.asarray(np.abs(self._scaled) > self._near)

    @property
    def biactive(self) -> Bools:
        """(q, y)."""
        return self.reached & ~self.working

    @cached_property
    def reduction(self) -> Floats:
        """(q, s, s)."""
        planes = self._face_planes
        moved, normals = self._system.moved.T[planes], self._system.normals[planes]
        change = np.einsum("fis,fij,fjt->fst", moved, self._face_inverse, normals, optimize=True)
        return np.asarray((np.eye(len(self.trial)) - change)[self._place])

    @property
    def reserve(self) -> Floats:
        """(q,): 1/2 lam^T (M E M^T + H) lam."""
        work = self._system.flow @ self._system.moved + self._system.hardening
        return np.asarray(0.5 * np.einsum("qi,ij,qj->q", self._scaled, work, self._scaled))

    def derivatives(
        self, trial: Floats, hardened: Floats | None = None, *, of_law: bool
    ) -> tuple[Floats, Floats]:
        """Derivatives of stress (s, q, n) and multipliers (y, q, n), as in `Projection`.

        Args:
            trial: (s, q, n) of the trial stress.
            hardened: (y, q, n) of the multipliers of earlier steps; None for zero.
            of_law: the first columns are by the parameters of the law.
        """
        system = self._system
        stress = trial.copy()
        grown = np.zeros((len(system.scale), *trial.shape[1:]))
        for column in range(system.by_parameter[0].n if of_law else 0):
            self._add_direct(column, stress[:, :, column], grown[:, :, column])
        if hardened is not None and system.hardens:
            grown += np.tensordot(system.hardening * system.scale, hardened, axes=1)
        excess = np.tensordot(system.normals, stress, axes=1) - grown
        multipliers = self._multiplier_slopes(excess)
        stress -= np.tensordot(system.moved, multipliers, axes=1)
        return stress, multipliers / system.scale[:, None, None]

    def _multiplier_slopes(self, excess: Floats) -> Floats:
        """Scaled dlam (y, q, n) of the slopes of yield functions at fixed multipliers."""
        points = np.arange(excess.shape[1])[:, None]
        compact = np.einsum("qij,qjn->qin", self._inverse, excess[self._planes, points])
        full = np.zeros_like(excess)
        full[self._planes, points] = compact
        return full

    def _add_direct(self, column: int, stress: Floats, grown: Floats) -> None:
        """What a parameter changes at fixed multipliers: the stress (s, q), the limits (y, q)."""
        system, lam = self._system, self._scaled
        elasticity, planes = system.by_parameter
        stiffer = elasticity.slope(column)
        normals, distances = planes.normals.slope(column), planes.distances.slope(column)
        flow = normals if planes.flow is None else planes.flow.slope(column)
        hardening = None if planes.hardening is None else planes.hardening.slope(column)
        if stiffer is not None:
            stress -= stiffer @ (lam @ system.flow).T
        if flow is not None:
            stress -= system.elasticity @ (lam @ flow).T
        if distances is not None:
            grown += distances[:, None]
        if normals is not None:
            grown -= normals @ self.returned
        if hardening is not None:
            grown += hardening @ self._accumulated()

    def _accumulated(self) -> Floats:
        """Scaled multipliers of this step and those before, (y, q)."""
        if self._hardened is None:
            return self._scaled.T
        return np.asarray(self._scaled.T + self._system.scale[:, None] * self._hardened)


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
        """ActiveSets (q,) of points that end where they did; 0 for those that have to be searched.

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
