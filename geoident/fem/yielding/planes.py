"""Yield planes: as given, scaled in one elasticity, and the stress on those that are active.

Planes psi_i = n_i^T sigma - k_i - (H lam)_i <= 0, with lam >= 0 and psi^T lam = 0 (theory 5). For a
trial stress s* = sigma_old + E C du, the holonomic step ends at

    sigma = s* - E sum_i m_i dlam_i        (m_i = n_i: associated)

which for associated flow is the projection of s* on the polyhedron in the norm of E^-1. It is a
complementarity problem in the multipliers of the planes,

    w = -psi* + A lam >= 0,  lam >= 0,  w^T lam = 0,   A = N E M^T + H

The matrix is that of the material, the same at all its strain points; only the yield functions psi*
of the trial stress differ. Planes are scaled (`ScaledPlanes`) so that A has a unit diagonal, which
frees tolerances from units and from the length of normals.

A material has thousands of strain points and they reach a few dozens of faces, edges and vertices.
What a set of active planes needs of linear algebra depends on the set alone (`ActiveSets`); a point
only holds its number. Where the sets are known, the return step has stress, multipliers, tangent
and derivatives; they are found by `polyhedral` and, without symmetry, `nonassociated_return`.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Generic, TypeVar

import numpy as np
import numpy.typing as npt

from geoident.model.arrays import Bools, Floats, Ints
from geoident.model.dual import Dual, joined


@dataclass(frozen=True, eq=False)
class YieldPlanes:
    """Yield planes n^T sigma <= k of one material with their derivatives by n parameters.

    Args:
        normals: n, (y, s); their products with a stress are in Pa. In a `PrincipalLaw` s is 3 and
            the components are those along the principal directions.
        distances: k, (y,), Pa.
        flow: m, (y, s) directions of plastic strain; None: the normals (associated).
        hardening: H, (y, y) symmetric, positive semidefinite, Pa; None: perfect plasticity.
        names: of the y planes, for outputs; empty where nobody asks.
    """

    normals: Dual
    distances: Dual
    flow: Dual | None = None
    hardening: Dual | None = None
    names: tuple[str, ...] = ()

    def __len__(self) -> int:
        return int(self.distances.columns.shape[0])

    def scaled(self, factor: Dual) -> YieldPlanes:
        """The same planes with normals, distances and flow multiplied by factors (y,)."""
        rows = factor[:, None]
        hardening = self.hardening
        return YieldPlanes(
            self.normals * rows,
            self.distances * factor,
            None if self.flow is None else self.flow * rows,
            None if hardening is None else hardening * rows * factor[None],
            self.names,
        )

    def of_unit_length(self) -> YieldPlanes:
        """The same planes with normals of unit length; the flow keeps its angle to them."""
        squares = Dual((self.normals * self.normals).columns.sum(axis=1))
        return self.scaled(squares.root().reciprocal())


def common_inside(parts: Sequence[YieldPlanes]) -> YieldPlanes:
    """One polyhedron that lies inside several; none of them may have a flow of its own."""
    hardening = None
    if any(part.hardening is not None for part in parts):
        n = parts[0].distances.n
        blocks = [part.hardening or Dual.constant(np.zeros((len(part),) * 2), n) for part in parts]
        hardening = _block_diagonal(blocks)
    return YieldPlanes(
        joined([part.normals for part in parts]),
        joined([part.distances for part in parts]),
        hardening=hardening,
        names=tuple(name for part in parts for name in part.names),
    )


def _block_diagonal(blocks: Sequence[Dual]) -> Dual:
    ends = np.cumsum([0, *(block.columns.shape[0] for block in blocks)])
    columns = np.zeros((ends[-1], ends[-1], blocks[0].columns.shape[-1]))
    for block, first, last in zip(blocks, ends[:-1], ends[1:], strict=True):
        columns[first:last, first:last] = block.columns
    return Dual(columns)


_ROUNDING = 1e-13
"""Of the terms a yield function is the difference of: what is smaller counts as on the plane."""


class ScaledPlanes:
    """Scaled planes in one elasticity, with their derivatives at the scale of the values.

    Args:
        elasticity: E (s, s), Pa, symmetric, positive definite.
        planes: normals (y, s).

    Attributes:
        scale: (y,) what normals and distances were divided by, and multipliers multiplied with.
        elasticity: E (s, s).
        normals: N (y, s), scaled.
        flow: M (y, s), scaled.
        distances: k (y,), scaled.
        hardening: H (y, y), scaled; zero for none.
        by_parameter: E and the scaled planes with their derivatives.

    Raises:
        ValueError: E is not positive definite, or a plane has no normal or a flow against it.
    """

    def __init__(self, elasticity: Dual, planes: YieldPlanes) -> None:
        self.elasticity: Floats = np.asarray(0.5 * (elasticity.value + elasticity.value.T))
        _check_definite(self.elasticity)
        if not np.isfinite(planes.distances.value).all():
            raise ValueError("a plane without a finite distance is none")
        flow = planes.normals if planes.flow is None else planes.flow
        count = len(planes)
        hardening = np.zeros((count, count))
        if planes.hardening is not None:
            hardening = np.ascontiguousarray(planes.hardening.value)
        own = np.einsum("ys,st,yt->y", planes.normals.value, self.elasticity, flow.value)
        if np.any(own <= 0.0):
            raise ValueError(f"plane {int(np.argmin(own)) + 1} has no normal, or flows inwards")
        self.scale: Floats = np.sqrt(own + np.diag(hardening))
        length = self.scale[:, None]
        self.normals: Floats = np.ascontiguousarray(planes.normals.value) / length
        self.flow: Floats = np.ascontiguousarray(flow.value) / length
        self.distances: Floats = planes.distances.value / self.scale
        self.hardening: Floats = hardening / (length * length.T)
        self.by_parameter = (
            elasticity,
            planes.scaled(Dual.constant(1.0 / self.scale, planes.distances.n)),
        )

    @cached_property
    def moved(self) -> Floats:
        """E M^T (s, y): the stress that a unit multiplier takes away."""
        return np.asarray(self.elasticity @ self.flow.T)

    @cached_property
    def coupling(self) -> Floats:
        """A (y, y): the drop of yield functions by multipliers."""
        return np.asarray(self.normals @ self.moved + self.hardening)

    @cached_property
    def root(self) -> Floats:
        """B (s + y, y) with B^T B = A, for associated flow: columns whose angles count."""
        plain = np.linalg.cholesky(self.elasticity).T @ self.normals.T
        values, vectors = np.linalg.eigh(self.hardening)
        return np.concatenate([plain, np.sqrt(np.maximum(values, 0.0))[:, None] * vectors.T])

    @cached_property
    def hardens(self) -> bool:
        """Whether H is not zero."""
        return bool(self.hardening.any())

    def limits(self, hardened: Floats | None) -> Floats:
        """Scaled distances k + H Lam (y, 1) or (y, m), of multipliers (y, m) as they are given."""
        if hardened is None or not self.hardens:
            return self.distances[:, None]
        return self.distances[:, None] + self.hardening @ (self.scale[:, None] * hardened)

    def excess(self, stress: Floats, hardened: Floats | None = None) -> Floats:
        """Scaled yield functions (y, m) of stresses (s, m)."""
        return np.asarray(self.normals @ stress - self.limits(hardened))

    def tolerance(self, stress: Floats, hardened: Floats | None = None) -> Floats:
        """What rounding leaves of the scaled yield functions on the way from stresses, (y, m).

        Their terms are distances, the stress, and how far the way goes: couplings are at most 1.
        """
        largest = np.abs(stress).max(axis=0, initial=0.0)
        way = np.maximum(self.excess(stress, hardened).max(axis=0, initial=0.0), 0.0)
        lengths = np.abs(self.normals).sum(axis=1)[:, None]
        return np.asarray(_ROUNDING * (np.abs(self.limits(hardened)) + lengths * largest + way))


def _check_definite(elasticity: Floats) -> None:
    """Refuse an elasticity with which stresses have no norm."""
    try:
        np.linalg.cholesky(elasticity)
    except np.linalg.LinAlgError as error:
        raise ValueError("the elasticity matrix is not positive definite") from error


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
    """Faces, the sets of active planes, by number; 0 is the inside, without active planes.

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
