"""Which yield planes are active where a return ends: two searches over sets of planes.

A material has thousands of strain points and they reach a few dozens of faces, edges and vertices,
all called faces here. What a set of active planes needs of linear algebra depends on the set alone
and is kept (`ActiveSets`); a point only holds its number.

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

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from itertools import combinations
from typing import Generic, TypeVar

import numpy as np
import numpy.typing as npt

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

_Number = TypeVar("_Number", bound=np.generic)
_UNKNOWN = -1  # number of a set of planes that has no row yet


class _Rows(Generic[_Number]):
    """Rows of equal shape that are appended in batches, in one array with room to grow.

    Args:
        row: what a row (...) is before it is written.
    """

    def __init__(self, row: npt.NDArray[_Number]) -> None:
        self._empty = row[None]
        self._rows = np.repeat(self._empty, 16, axis=0)
        self.size = 0

    def grow(self, count: int) -> None:
        """Append `count` rows."""
        self.size += count
        while self.size > len(self._rows):
            more = np.repeat(self._empty, len(self._rows), axis=0)
            self._rows = np.concatenate([self._rows, more])

    @property
    def all(self) -> npt.NDArray[_Number]:
        """The rows in use (size, ...): a view, to be read and written."""
        return self._rows[: self.size]


class ActiveSets:
    """Faces, the sets of active planes, by number; 0 is the inside, without active planes.

    Args:
        coupling: A (y, y) of the planes.

    >>> sets = ActiveSets(np.eye(3))
    >>> sets.number([2, 0])
    1
    >>> sets.members[sets.joined(np.array([1]), np.array([1]))[0]]
    (0, 1, 2)
    """

    def __init__(self, coupling: Floats) -> None:
        self.coupling = coupling
        self.members: list[tuple[int, ...]] = []
        self._numbers: dict[tuple[int, ...], int] = {}
        self._joined = _Rows(np.full(len(coupling), _UNKNOWN))
        self._left = _Rows(np.full(len(coupling), _UNKNOWN))
        self.number(())

    def number(self, planes: Sequence[int]) -> int:
        """Number of the face on which these planes are active."""
        key = tuple(sorted(planes))
        known = self._numbers.get(key)
        if known is None:
            known = self._numbers[key] = len(self.members)
            self.members.append(key)
            self._joined.grow(1)
            self._left.grow(1)
        return known

    def joined(self, faces: Ints, planes: Ints) -> Ints:
        """Numbers (w,) of the faces (w,) with one more plane each."""
        return self._neighbours(self._joined, faces, planes, lambda old, p: (*old, p))

    def left(self, faces: Ints, planes: Ints) -> Ints:
        """Numbers (w,) of the faces (w,) with one plane less each."""
        return self._neighbours(
            self._left, faces, planes, lambda old, p: tuple(j for j in old if j != p)
        )

    def _neighbours(
        self,
        table: _Rows[np.int64],
        faces: Ints,
        planes: Ints,
        change: Callable[[tuple[int, ...], int], tuple[int, ...]],
    ) -> Ints:
        numbers = table.all[faces, planes]
        missing = numbers == _UNKNOWN
        if missing.any():
            pairs = _different_pairs(faces[missing], planes[missing], len(self.coupling))
            for face, plane in zip(*(some.tolist() for some in pairs), strict=True):
                number = self.number(change(self.members[face], plane))
                table.all[face, plane] = number
            numbers = table.all[faces, planes]
        return numbers

    def by_size(self, faces: Sequence[int]) -> Iterator[tuple[Ints, Ints, Floats]]:
        """Faces (f,) with equally many planes together: batches for linear algebra.

        Yields:
            (g,) places among the faces, (g, w) their active planes W, (g, w, w) A_WW^-1.
        """
        sizes = np.array([len(self.members[face]) for face in faces], dtype=np.int64)
        for size in np.unique(sizes):
            places = np.flatnonzero(sizes == size)
            active = np.array(
                [self.members[faces[place]] for place in places.tolist()], dtype=np.int64
            )
            active = active.reshape(places.size, size)
            own = self.coupling[active[:, :, None], active[:, None, :]]
            yield places, active, np.asarray(np.linalg.inv(own), dtype=np.float64)

    def compact(self, faces: Sequence[int]) -> tuple[Ints, Floats]:
        """Active planes (f, w) of faces (f,) and A_WW^-1 (f, w, w), filled up to the largest.

        Where a face has fewer planes, others stand with zeros in the inverse: each plane once, so
        that values can be written back to their places.
        """
        width = max((len(self.members[face]) for face in faces), default=0)
        filled = []
        for face in faces:
            members = self.members[face]
            others = [plane for plane in range(width) if plane not in members]
            filled.append((*members, *others[: width - len(members)]))
        inverses = np.zeros((len(faces), width, width))
        for places, active, inverse in self.by_size(faces):
            size = active.shape[1]
            inverses[places, :size, :size] = inverse
        return np.array(filled, dtype=np.int64).reshape(len(faces), width), inverses

    def holds(self, faces: Ints, excess: Floats, tolerance: Floats) -> Bools:
        """Whether points end on given faces, for associated flow.

        That is where multipliers are not negative and no plane is violated: the Kuhn-Tucker
        conditions, which are sufficient.

        Args:
            faces: (q,).
            excess: (q, y) scaled yield functions of the trial stresses.
            tolerance: (q, y) what counts as zero in them.
        """
        used, place = np.unique(faces, return_inverse=True)
        planes, inverses = self.compact(used.tolist())
        active = np.take_along_axis(excess, planes[place], axis=1)
        multipliers = np.einsum("qij,qj->qi", inverses[place], active)
        full = np.zeros_like(excess)
        np.put_along_axis(full, planes[place], multipliers, axis=1)
        after = excess - full @ self.coupling
        return np.asarray((multipliers >= 0.0).all(axis=1) & (after <= tolerance).all(axis=1))


def _different_pairs(faces: Ints, planes: Ints, count: int) -> tuple[Ints, Ints]:
    """The different pairs (k,) of faces (w,) and planes (w,), of which there are `count`."""
    pairs = np.unique(faces * count + planes)
    return pairs // count, pairs % count


@dataclass(eq=False)
class _Unfinished:
    """The points of a dual search that have not ended, one row each.

    Args:
        point: (w,) which they are.
        excess: (w, y) scaled yield functions where they are now.
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


class DualSearch:
    """Finds active sets of associated flow.

    Args:
        system: the planes, with symmetric coupling A.
    """

    def __init__(self, system: ScaledPlanes) -> None:
        self.sets = ActiveSets(system.coupling)
        self._root = system.root
        count = len(system.coupling)
        self._ray = _Rows(np.full(count, _UNKNOWN))
        self._loss = _Rows(np.zeros(count))
        self._drop = _Rows(np.zeros(count))
        self._curvature = _Rows(np.zeros(()))

    def find(self, excess: Floats, tolerance: Floats, limits: Floats | None = None) -> Ints:
        """Numbers (q,) of the faces on which the projections of points lie; 0 for the inside.

        Args:
            excess: (q, y) scaled yield functions of the trial stresses.
            tolerance: (q, y) what counts as zero in them.
            limits: not needed.

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
            _choose(work)
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
        first, bound = np.zeros(rows.size, dtype=np.int64), np.full(rows.size, np.inf)
        some = np.flatnonzero(work.face)
        losing = loss[some]
        steps = np.full(losing.shape, np.inf)
        with np.errstate(over="ignore"):
            np.divide(work.multipliers[some], losing, out=steps, where=losing > _DEPENDENT)
        first[some] = steps.argmin(axis=1)
        bound[some] = steps[np.arange(some.size), first[some]]

        to_plane = np.full(rows.size, np.inf)
        np.divide(work.excess[rows, work.plane], curvature, out=to_plane, where=curvature > 0.0)
        arrives = (to_plane <= bound) & np.isfinite(to_plane)
        length = np.minimum(bound, to_plane)
        if (stuck := np.isinf(length)).any():
            _leave_or_refuse(work, loss, stuck)
            length[stuck] = 0.0
        loss *= length[:, None]
        drop *= length[:, None]
        work.multipliers -= loss
        work.excess -= drop

        planes = work.plane[arrives]
        work.face[arrives] = self.sets.joined(work.face[arrives], planes)
        # Members are on their planes: what rounding leaves there must not call them again.
        work.excess[arrives, planes] = -np.inf
        work.plane[arrives] = -1

        loses = ~arrives & ~stuck
        planes = first[loses]
        work.face[loses] = self.sets.left(work.face[loses], planes)
        work.multipliers[loses, planes] = 0.0
        work.excess[loses, planes] = 0.0

    def _rays(self, faces: Ints, planes: Ints) -> tuple[Floats, Floats, Floats]:
        """Rays of faces (w,) and new planes (w,), per unit of the multiplier of the new plane.

        Returns:
            (w, y) by how much multipliers fall (-1 for the new plane), (w, y) by how much yield
            functions fall, and (w,) that of the new plane, zero where it depends on the face.
        """
        self._ray.grow(len(self.sets.members) - self._ray.size)
        rows = self._ray.all[faces, planes]
        if (missing := rows == _UNKNOWN).any():
            count = len(self.sets.coupling)
            self._add_rays(*_different_pairs(faces[missing], planes[missing], count))
            rows = self._ray.all[faces, planes]
        return self._loss.all[rows], self._drop.all[rows], self._curvature.all[rows]

    def _add_rays(self, faces: Ints, planes: Ints) -> None:
        """Compute rays that are asked for the first time."""
        start, count = self._loss.size, faces.size
        for table in (self._loss, self._drop, self._curvature):
            table.grow(count)
        self._ray.all[faces, planes] = np.arange(start, start + count)
        for places, active, inverse in self.sets.by_size(faces.tolist()):
            new = planes[places]
            loss = np.zeros((places.size, len(self.sets.coupling)))
            across = self.sets.coupling[active, new[:, None]]
            np.put_along_axis(loss, active, np.einsum("gij,gj->gi", inverse, across), axis=1)
            loss[np.arange(places.size), new] = -1.0
            remaining = -loss @ self._root.T  # the part of the new normal across the active ones
            drop = remaining @ self._root
            np.put_along_axis(drop, active, 0.0, axis=1)
            curvature = np.einsum("gr,gr->g", remaining, remaining)
            self._loss.all[start + places] = loss
            self._drop.all[start + places] = drop
            self._curvature.all[start + places] = np.where(curvature > _DEPENDENT, curvature, 0.0)


def _choose(work: _Unfinished) -> None:
    """Give points that take in no plane the one they violate most, if there is one."""
    free = np.flatnonzero(work.plane < 0)
    if free.size == work.point.size:
        outside = work.excess - work.tolerance
    else:
        outside = work.excess[free] - work.tolerance[free]
    worst = outside.argmax(axis=1)
    violated = outside[np.arange(free.size), worst] > 0.0
    work.plane[free[violated]] = worst[violated]


def _leave_or_refuse(work: _Unfinished, loss: Floats, stuck: Bools) -> None:
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


class CombinationSearch:
    """Finds active sets with any flow.

    Args:
        system: the planes for sorted principal stresses, with their images.
    """

    def __init__(self, system: ScaledPlanes) -> None:
        self.sets = ActiveSets(system.coupling)
        self._system = system
        self._plain = np.flatnonzero(~system.upright)
        # Hardening adds a dimension for each stated plane: so many more may be active at a point.
        self._most = min(3 + system.count * system.hardens, self._plain.size)
        self._known: list[int] = []
        self._rest = self._independent_sets()

    def _independent_sets(self) -> Iterator[int]:
        """Faces whose planes can be active together, small ones first."""
        for size in range(1, self._most + 1):
            for some in combinations(self._plain.tolist(), size):
                matrix = self._system.coupling[np.ix_(some, some)]
                if np.linalg.svd(matrix, compute_uv=False)[-1] > _SINGULAR:
                    yield self.sets.number(some)

    def _candidates(self) -> Iterator[int]:
        """The same, computed once and kept: most calls need only the first few."""
        yield from self._known
        for face in self._rest:
            self._known.append(face)
            yield face

    def find(self, excess: Floats, tolerance: Floats, limits: Floats) -> Ints:
        """Faces (q,) of points with the scaled yield functions (q, i) of their trial stress.

        Args:
            excess: (q, i).
            tolerance: (q, i) what counts as zero in them.
            limits: (q, i) scaled distances with hardening.

        Raises:
            NoReturn: no set brings a stress back that does not lie beyond the apex.
        """
        faces = np.zeros(len(excess), dtype=np.int64)
        rest = np.flatnonzero(((excess > tolerance)[:, self._plain]).any(axis=1))
        best = np.full(len(excess), np.inf)
        for face in self._candidates():
            if not rest.size:
                return faces
            lacking = self._lacking(face, excess[rest], tolerance[rest])
            better = lacking < best[rest]
            best[rest[better]], faces[rest[better]] = lacking[better], face
            rest = rest[lacking > 1.0]
        far = rest[best[rest] > _BETWEEN]
        if far.size:
            faces[far] = self._apex(excess[far], limits[far])
        return faces

    def _lacking(self, face: int, excess: Floats, tolerance: Floats) -> Floats:
        """By how many tolerances the worst condition (q,) fails on a face; a solution has < 1."""
        active = list(self.sets.members[face])
        inverse = np.linalg.inv(self._system.coupling[np.ix_(active, active)])
        multipliers = excess[:, active] @ inverse.T
        after = excess - multipliers @ self._system.coupling[:, active].T
        after[:, active] = 0.0
        with np.errstate(divide="ignore", invalid="ignore"):
            outside = (after / tolerance)[:, self._plain].max(axis=1)
            against = (-multipliers / tolerance[:, active]).max(axis=1)
        return np.asarray(np.nan_to_num(np.maximum(outside, against), nan=0.0))

    def _apex(self, excess: Floats, limits: Floats) -> Ints:
        """The apex (q,): where the hydrostatic axis first leaves the surface; see `find`."""
        system = self._system
        upright = np.flatnonzero(system.upright)
        faces = np.zeros(len(excess), dtype=np.int64)
        if upright.size:
            pressure = limits[:, upright] / system.normals[upright].sum(axis=1)
            owner = system.owner[upright][np.argmin(pressure, axis=1)]
            meeting = system.upright & (system.owner == owner[:, None])
            faces = np.array([self.sets.number(np.flatnonzero(row).tolist()) for row in meeting])
        for face in np.unique(faces).tolist():
            planes = list(self.sets.members[face])
            coupling = system.coupling[np.ix_(planes, planes)]
            volume = np.linalg.solve(coupling, excess[faces == face][:, planes].T).sum(axis=0)
            if not planes or volume.min() < 0.0:
                raise NoReturn("no set of yield planes with their flow brings a stress back")
        return faces
