"""Sets of planes that are active together, each computed once and shared by all strain points.

A material has thousands of strain points and they reach a few dozens of faces, edges and vertices.
What a face needs of linear algebra depends on the face alone; a point only holds its number.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
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
        """The rows in use: a view, to be read and written."""
        return self._rows[: self.size]


class Faces:
    """Faces by number; 0 is the inside, without active planes.

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
        self._inverses: list[Floats] = []
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
            for face, plane in unique_pairs(faces[missing], planes[missing]):
                number = self.number(change(self.members[face], plane))
                table.all[face, plane] = number
            found = table.all[faces, planes]
        return found

    def inverse(self, face: int) -> Floats:
        """A_WW^-1 (w, w) of the active planes W of a face."""
        for members in self.members[len(self._inverses) :]:
            active = list(members)
            self._inverses.append(_inverse(self.coupling[np.ix_(active, active)]))
        return self._inverses[face]

    def compact(self, faces: Ints) -> tuple[Ints, Floats]:
        """Active planes (q, w) of faces (q,) and A_WW^-1 (q, w, w), filled up to the largest.

        Where a face has fewer planes, plane 0 stands with zeros in the inverse.
        """
        used, place = np.unique(faces, return_inverse=True)
        width = max((len(self.members[face]) for face in used), default=0)
        planes = np.zeros((len(used), width), dtype=np.int64)
        inverses = np.zeros((len(used), width, width))
        for row, face in enumerate(used):
            count = len(self.members[face])
            planes[row, :count] = self.members[face]
            inverses[row, :count, :count] = self.inverse(face)
        return planes[place], inverses[place]


def rows_of_numbers(width: int) -> Rows[np.int64]:
    """Rows (., width) of numbers that are not known yet: -1."""
    return Rows(np.full((_ROOM, width), _UNKNOWN))


def rows_of_floats(*shape: int) -> Rows[np.float64]:
    """Rows (., shape) of zeros."""
    return Rows(np.zeros((_ROOM, *shape)))


def unique_pairs(first: Ints, second: Ints) -> list[tuple[int, int]]:
    """The different pairs of two vectors (w,)."""
    pairs = np.unique(np.stack([first, second], axis=1), axis=0)
    return [(int(a), int(b)) for a, b in pairs]


def _inverse(matrix: Floats) -> Floats:
    """Inverse of (w, w), w may be zero."""
    return np.asarray(np.linalg.inv(matrix), dtype=np.float64) if len(matrix) else matrix
