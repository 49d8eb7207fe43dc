"""Sets of planes that are active together, each computed once and shared by all strain points.

A material has thousands of strain points and they reach a few dozens of faces, edges and vertices.
What a face needs of linear algebra depends on the face alone; a point only holds its number.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from typing import Generic, TypeVar

import numpy as np
import numpy.typing as npt

from geoident.model.arrays import Floats, Ints

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
