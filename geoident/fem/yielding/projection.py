"""Projection of many points on one polyhedron: a dual active-set method, all points at once.

Goldfarb & Idnani (1983), Mathematical Programming 27, 1-33. Each point starts at its trial stress
with no plane active and takes in the plane it violates most: along the ray on which the multiplier
of that plane grows and the active planes stay active. Where an active multiplier would turn
negative first, its plane is dropped on the way. The dual objective grows with every plane taken in,
so no set of active planes comes twice, also where normals depend linearly on each other. Only where
planes miss each other by little more than rounding may it grow by too little to be told from it;
points that take long are therefore asked for less and less accuracy.

The ray depends on the active planes and the new one alone, so each is computed once (`Rays`) and a
step of all points is a few operations on arrays (w, y).

A material has thousands of strain points and they reach a few dozens of faces, edges and vertices.
What a set of active planes needs of linear algebra depends on the set alone (`ActiveSets`); a point
only holds its number.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from typing import Generic, TypeVar

import numpy as np
import numpy.typing as npt

from geoident.fem.yielding.domain import EmptyDomain, NoProjection
from geoident.model.arrays import Bools, Floats, Ints

_Number = TypeVar("_Number", bound=np.generic)
_UNKNOWN = -1
_ROOM = 16


class Rows(Generic[_Number]):
    """Rows of equal shape that are appended in batches, in one array with room to grow.

    Args:
        empty: (r, ...) the room to start with, full of what rows are before they are written.
    """

    def __init__(self, empty: npt.NDArray[_Number]) -> None:
        self._rows = empty
        self._empty = empty[:1].copy()
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
    """ActiveSets by number; 0 is the inside, without active planes.

    Args:
        coupling: A (y, y) of the planes.
    """

    def __init__(self, coupling: Floats) -> None:
        self.coupling = coupling
        self.members: list[tuple[int, ...]] = []
        self._numbers: dict[tuple[int, ...], int] = {}
        count = len(coupling)
        self._joined = rows_of_numbers(count)
        self._left = rows_of_numbers(count)
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

    def join(self, faces: Ints, planes: Ints) -> Ints:
        """Numbers (w,) of the faces (w,) with one more plane each."""
        return self._neighbours(self._joined, faces, planes, lambda old, p: (*old, p))

    def leave(self, faces: Ints, planes: Ints) -> Ints:
        """Numbers (w,) of the faces (w,) with one plane less each."""
        return self._neighbours(
            self._left, faces, planes, lambda old, p: tuple(j for j in old if j != p)
        )

    def _neighbours(
        self,
        table: Rows[np.int64],
        faces: Ints,
        planes: Ints,
        change: Callable[[tuple[int, ...], int], tuple[int, ...]],
    ) -> Ints:
        found = table.all[faces, planes]
        missing = found == _UNKNOWN
        if missing.any():
            first, second = unique_pairs(faces[missing], planes[missing], len(self.coupling))
            for face, plane in zip(first.tolist(), second.tolist(), strict=True):
                number = self.number(change(self.members[face], plane))
                table.all[face, plane] = number
            found = table.all[faces, planes]
        return found

    def by_size(self, faces: Sequence[int]) -> Iterator[tuple[Ints, Ints, Floats]]:
        """ActiveSets (f,) with equally many planes together: batches for linear algebra.

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
        filled = [(*self.members[f], *self._others(f, width)) for f in faces]
        inverses = np.zeros((len(faces), width, width))
        for places, active, inverse in self.by_size(faces):
            size = active.shape[1]
            inverses[places, :size, :size] = inverse
        return np.array(filled, dtype=np.int64).reshape(len(faces), width), inverses

    def _others(self, face: int, width: int) -> list[int]:
        """Planes that are not active on a face: as many as it lacks of a number."""
        members = self.members[face]
        return [plane for plane in range(width) if plane not in members][: width - len(members)]


def rows_of_numbers(width: int) -> Rows[np.int64]:
    """Rows (., width) of numbers that are not known yet: -1."""
    return Rows(np.full((_ROOM, width), _UNKNOWN))


def rows_of_floats(*shape: int) -> Rows[np.float64]:
    """Rows (., shape) of zeros."""
    return Rows(np.zeros((_ROOM, *shape)))


def unique_pairs(first: Ints, second: Ints, count: int) -> tuple[Ints, Ints]:
    """The different pairs of two vectors of numbers, (k,) each.

    Args:
        first: (w,).
        second: (w,), below ``count``.
        count: of numbers that the second may be.
    """
    pairs = np.unique(first * count + second)
    return pairs // count, pairs % count


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
