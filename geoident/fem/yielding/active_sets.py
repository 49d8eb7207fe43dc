"""Which yield planes are active where a return ends: two searches over sets of planes.

A material has thousands of strain points and they reach a few dozens of faces, edges and vertices,
all called faces here. A point only holds the number of its face (`ActiveSets`).

*Associated flow* (`DualSearch`): the projection on a polyhedron by a dual active-set method,
Goldfarb & Idnani (1983), Mathematical Programming 27, 1-33, exact in the norm of E^-1. Each point
starts at its trial stress with no plane active and takes in the plane it violates most: along the
ray on which the multiplier of that plane grows and the active planes stay active. Where an active
multiplier would turn negative first, its plane is dropped on the way. The dual objective grows with
every plane taken in, so no set of active planes comes twice, also where normals depend linearly on
each other. Only where planes miss each other by little more than rounding may it grow by too little
to be told from it; points that take long are therefore asked for less and less accuracy. A ray
depends on the active planes and the new one alone, so each is computed once and a step of all
points is a few operations on arrays (w, y).

*Any flow* (`CombinationSearch`): without symmetry there is no projection and no descent of a dual
objective, but in principal stresses there are few planes, so the sets that can be active together
are tried in turn, all points at once: first single planes, then edges, then vertices. The first
whose multipliers are nonnegative and whose stress violates no plane is it. Where the flow has too
little dilation, no set brings a tension back; such points go to the apex on the hydrostatic axis,
with the plastic volume that takes: there the flow is free (de Souza Neto, Peric & Owen 2008, 8.2).
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from itertools import combinations

import numpy as np

from geoident.fem.yielding.domain import EmptyDomain, NoProjection, NoReturn
from geoident.fem.yielding.planes import ScaledPlanes
from geoident.model.arrays import Bools, Floats, Ints

_DEPENDENT = 1e-11
"""Squared sine of the angle to the active normals under which a normal depends on them."""

_LOOSEST = 1e5
"""Times the tolerance: less accuracy than that (1e-8 of the stress) is never asked for."""

_NEGLIGIBLE = 1e4
"""Times the tolerance: a contradiction of planes that is rounding of a slab without thickness."""

_SINGULAR = 1e-9
"""Smallest singular value of the scaled coupling of planes that can be active together."""

_BETWEEN = 1e5
"""Times the tolerance: what a point may lack that falls between two sets by rounding."""

_UNKNOWN = -1  # in tables (faces, planes) of numbers: not asked for yet


class ActiveSets:
    """Faces, the sets of active planes, by number; 0 is the inside, without active planes.

    Args:
        coupling: A (y, y) of the planes.

    >>> sets = ActiveSets(np.eye(3))
    >>> sets.number([2, 0])
    1
    >>> sets.members[sets.toggled(np.array([1]), np.array([1]))[0]]
    (0, 1, 2)
    """

    def __init__(self, coupling: Floats) -> None:
        self.coupling = coupling
        self.members: list[tuple[int, ...]] = [()]
        self._numbers: dict[tuple[int, ...], int] = {(): 0}
        self._toggled = np.full((1, len(coupling)), _UNKNOWN)

    def number(self, planes: Iterable[int]) -> int:
        """Number of the face on which these planes are active."""
        key = tuple(sorted(planes))
        if key not in self._numbers:
            self._numbers[key] = len(self.members)
            self.members.append(key)
        return self._numbers[key]

    def toggled(self, faces: Ints, planes: Ints) -> Ints:
        """Numbers (w,) of the faces (w,) with one more plane, or without it where it is active."""
        self._toggled = _enlarged(self._toggled, len(self.members))
        numbers = self._toggled[faces, planes]
        if (missing := numbers == _UNKNOWN).any():
            for face, plane in _different_pairs(faces[missing], planes[missing]).T.tolist():
                self._toggled[face, plane] = self.number({*self.members[face]} ^ {plane})
            numbers = self._toggled[faces, planes]
        return numbers

    def inverses(self, faces: Sequence[int]) -> tuple[Ints, Floats]:
        """Active planes (f, w) of faces (f,) and A_WW^-1 (f, w, w), filled up to the largest.

        Where a face has fewer planes, others stand with zeros in the inverse: each plane once, so
        that values can be written back to their places.
        """
        members = [self.members[face] for face in faces]
        width = max((len(some) for some in members), default=0)
        filled = [(*some, *(p for p in range(width) if p not in some))[:width] for some in members]
        planes = np.array(filled, dtype=np.int64).reshape(len(members), width)
        active = np.arange(width) < np.array([[len(some)] for some in members]).reshape(-1, 1)
        both = active[:, :, None] & active[:, None, :]
        coupling = self.coupling[planes[:, :, None], planes[:, None, :]]
        inverse = np.linalg.inv(np.where(both, coupling, np.eye(width)))
        return planes, np.where(both, inverse, 0.0)


def _enlarged(table: Ints, count: int) -> Ints:
    """A table (f, y) with a row for each of `count` faces."""
    new = np.full((count - len(table), table.shape[1]), _UNKNOWN)
    return np.concatenate([table, new]) if len(new) else table


def _different_pairs(faces: Ints, planes: Ints) -> Ints:
    """The different pairs (2, k) of faces (w,) and planes (w,)."""
    return np.asarray(np.unique(np.stack([faces, planes]), axis=1))


@dataclass(eq=False)
class _Unfinished:
    """The points of a dual search that have not ended, one row each.

    Args:
        point: (w,) which they are.
        excess: (w, y) scaled yield functions where they are now; -inf for active planes.
        tolerance: (w, y) what counts as zero in these.
        multipliers: (w, y).
        face: (w,) numbers of their active sets.
        plane: (w,) the plane that is being taken in; -1 for none.
    """

    point: Ints
    excess: Floats
    tolerance: Floats
    multipliers: Floats
    face: Ints
    plane: Ints

    def keep(self, rows: Bools) -> None:
        """Drop the other points."""
        for name, value in vars(self).items():
            setattr(self, name, value[rows])

    def choose_planes(self) -> None:
        """Give points that take in no plane the one they violate most, if there is one."""
        free = np.flatnonzero(self.plane < 0)
        outside = self.excess[free] - self.tolerance[free]
        worst = outside.argmax(axis=1)
        violated = outside[np.arange(free.size), worst] > 0.0
        self.plane[free[violated]] = worst[violated]


class DualSearch:
    """Finds active sets of associated flow.

    Args:
        system: the planes, with symmetric coupling A.
    """

    def __init__(self, system: ScaledPlanes) -> None:
        self.system, self.sets = system, ActiveSets(system.coupling)
        count = len(system.coupling)
        self._ray = np.full((1, count), _UNKNOWN)
        self._loss, self._drop = np.zeros((0, count)), np.zeros((0, count))
        self._curvature = np.zeros(0)

    def find(self, excess: Floats, tolerance: Floats) -> Ints:
        """Numbers (q,) of the faces on which the projections of points lie; 0 for the inside.

        Args:
            excess: (q, y) scaled yield functions of the trial stresses.
            tolerance: (q, y) what counts as zero in them.

        Raises:
            EmptyDomain: the planes contradict each other.
            NoProjection: points take planes in and out without end.
        """
        count, planes = excess.shape
        faces = np.zeros(count, dtype=np.int64)
        work = _Unfinished(
            point=np.arange(count),
            excess=excess.copy(),
            tolerance=tolerance.copy(),
            multipliers=np.zeros((count, planes)),
            face=faces.copy(),
            plane=np.full(count, -1),
        )
        loosened = 1.0
        for step in range(100 + 20 * planes):  # a projection takes a handful a plane at most
            work.choose_planes()
            if step and step % (20 + planes) == 0 and loosened < _LOOSEST:
                work.tolerance *= 10.0
                loosened *= 10.0
            if (done := work.plane < 0).any():
                faces[work.point[done]] = work.face[done]
                work.keep(~done)
            if not work.point.size:
                return faces
            self._advance(work)
        raise NoProjection(work.point.size)

    def _advance(self, work: _Unfinished) -> None:
        """Take one step along the rays: to the new plane, or until a multiplier vanishes."""
        rows = np.arange(work.point.size)
        loss, drop, curvature = self._rays(work.face, work.plane)
        # the active plane whose multiplier vanishes first on the way, and the step to it
        steps = np.full(loss.shape, np.inf)
        with np.errstate(over="ignore"):
            np.divide(work.multipliers, loss, out=steps, where=loss > _DEPENDENT)
        first = steps.argmin(axis=1)
        bound = steps[rows, first]

        to_plane = np.full(rows.size, np.inf)
        np.divide(work.excess[rows, work.plane], curvature, out=to_plane, where=curvature > 0.0)
        arrives = (to_plane <= bound) & np.isfinite(to_plane)
        length = np.minimum(bound, to_plane)
        if (stuck := np.isinf(length)).any():
            self._leave_or_refuse(work, loss, stuck)
            length[stuck] = 0.0
        work.multipliers -= loss * length[:, None]
        work.excess -= drop * length[:, None]

        changes = ~stuck
        planes = np.where(arrives, work.plane, first)
        work.face[changes] = self.sets.toggled(work.face[changes], planes[changes])
        # Members are on their planes: what rounding leaves there must not call them again.
        work.excess[arrives, planes[arrives]] = -np.inf
        work.plane[arrives] = -1
        leaves = changes & ~arrives
        work.multipliers[leaves, planes[leaves]] = 0.0
        work.excess[leaves, planes[leaves]] = 0.0

    def _rays(self, faces: Ints, planes: Ints) -> tuple[Floats, Floats, Floats]:
        """Rays of faces (w,) and new planes (w,), per unit of the multiplier of the new plane.

        Returns:
            (w, y) by how much multipliers fall (-1 for the new plane), (w, y) by how much yield
            functions fall, and (w,) that of the new plane, zero where it depends on the face.
        """
        self._ray = _enlarged(self._ray, len(self.sets.members))
        rows = self._ray[faces, planes]
        if (missing := rows == _UNKNOWN).any():
            some, new = _different_pairs(faces[missing], planes[missing])
            self._ray[some, new] = len(self._loss) + np.arange(new.size)
            active, inverse = self.sets.inverses(some.tolist())
            loss = np.zeros((new.size, len(self.sets.coupling)))
            across = self.sets.coupling[active, new[:, None]]
            np.put_along_axis(loss, active, np.einsum("fij,fj->fi", inverse, across), axis=1)
            loss[np.arange(new.size), new] = -1.0
            remaining = -loss @ self.system.root.T  # what of the normal is across the active ones
            curvature = np.einsum("fr,fr->f", remaining, remaining)
            curvature[curvature <= _DEPENDENT] = 0.0
            self._loss = np.concatenate([self._loss, loss])
            self._drop = np.concatenate([self._drop, remaining @ self.system.root])
            self._curvature = np.concatenate([self._curvature, curvature])
            rows = self._ray[faces, planes]
        return self._loss[rows], self._drop[rows], self._curvature[rows]

    def _leave_or_refuse(self, work: _Unfinished, loss: Floats, stuck: Bools) -> None:
        """Drop a contradiction that is rounding; refuse one that is not.

        The new normal is minus a nonnegative combination of active ones, and yet its plane is
        violated: Farkas' certificate that nothing satisfies them all.
        """
        rows = np.flatnonzero(stuck)
        planes = work.plane[rows]
        real = work.excess[rows, planes] > _NEGLIGIBLE * work.tolerance[rows, planes]
        if real.any():
            images = np.flatnonzero(loss[rows[real][0]] < -_DEPENDENT)
            raise EmptyDomain(tuple(np.unique(self.system.owner[images]).tolist()))
        work.excess[rows, planes] = -np.inf
        work.plane[rows] = -1


class CombinationSearch:
    """Finds active sets with any flow.

    Args:
        system: the planes for sorted principal stresses, with their images.
    """

    def __init__(self, system: ScaledPlanes) -> None:
        self.system, self.sets = system, ActiveSets(system.coupling)
        self._plain = np.flatnonzero(~system.for_apex)
        self._candidates: list[int] = []
        for size in (1, 2, 3):
            some = np.array(list(combinations(self._plain, size)), dtype=np.int64).reshape(-1, size)
            coupling = system.coupling[some[:, :, None], some[:, None, :]]
            regular = np.linalg.svd(coupling, compute_uv=False)[:, -1] > _SINGULAR
            self._candidates += [self.sets.number(planes) for planes in some[regular].tolist()]
        # The apex, where the hydrostatic axis first leaves the cones. A cut-off of tension in front
        # of it is associated: its own sets bring every tension back, none is left for the apex.
        for_apex = np.flatnonzero(system.for_apex)
        pressure = system.distances[for_apex] / system.normals[for_apex].sum(axis=1)
        owner = system.owner[for_apex]
        self._apex = for_apex[owner == owner[pressure.argmin()]] if for_apex.size else for_apex

    def find(self, excess: Floats, tolerance: Floats) -> Ints:
        """Faces (q,) of points with the scaled yield functions (q, i) of their trial stress.

        Args:
            excess: (q, i).
            tolerance: (q, i) what counts as zero in them.

        Raises:
            NoReturn: no set brings a stress back that does not lie beyond the apex.
        """
        faces = np.zeros(len(excess), dtype=np.int64)
        rest = np.flatnonzero((excess > tolerance)[:, self._plain].any(axis=1))
        best = np.full(len(excess), np.inf)
        for face in self._candidates:
            if not rest.size:
                return faces
            lacking = self._lacking(face, excess[rest], tolerance[rest])
            better = lacking < best[rest]
            best[rest[better]], faces[rest[better]] = lacking[better], face
            rest = rest[lacking > 1.0]
        far = rest[best[rest] > _BETWEEN]
        if far.size:
            coupling = self.system.coupling[np.ix_(self._apex, self._apex)]
            volume = np.linalg.solve(coupling, excess[far][:, self._apex].T).sum(axis=0)
            if not self._apex.size or volume.min() < 0.0:
                raise NoReturn("no set of yield planes with their flow brings a stress back")
            faces[far] = self.sets.number(self._apex.tolist())
        return faces

    def _lacking(self, face: int, excess: Floats, tolerance: Floats) -> Floats:
        """By how many tolerances the worst condition (q,) fails on a face; a solution has < 1."""
        active = list(self.sets.members[face])
        inverse = np.linalg.inv(self.system.coupling[np.ix_(active, active)])
        multipliers = excess[:, active] @ inverse.T
        after = excess - multipliers @ self.system.coupling[:, active].T
        after[:, active] = 0.0
        with np.errstate(divide="ignore", invalid="ignore"):
            outside = (after / tolerance)[:, self._plain].max(axis=1)
            against = (-multipliers / tolerance[:, active]).max(axis=1)
        return np.asarray(np.nan_to_num(np.maximum(outside, against), nan=0.0))
