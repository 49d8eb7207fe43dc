"""The numbers in a section of an MSH file, the same to read whether they are text or binary."""

from __future__ import annotations

import re
import warnings
from dataclasses import dataclass
from typing import Protocol

import numpy as np
import numpy.typing as npt

from geoident.io.mesh.raw import Refused
from geoident.model.arrays import Floats, Ints

_AGAIN = "the file is damaged: write it again with gmsh"


class Stream(Protocol):
    """The numbers of one section, in their order. Every method raises `Refused` at its end."""

    text: bool

    def count(self) -> int:
        """A number that stands on a line of its own, as text also in MSH 2.2 binary."""

    def ints(self, n: int) -> Ints:
        """The next ``n`` numbers (n,) of C's type int."""

    def sizes(self, n: int) -> Ints:
        """The next ``n`` numbers (n,) of C's type size_t."""

    def floats(self, n: int) -> Floats:
        """The next ``n`` numbers (n,) of C's type double."""

    def rest(self) -> int:
        """How many numbers (text) or bytes (binary) are left."""


@dataclass(frozen=True)
class Encoding:
    """How a file holds its numbers.

    Args:
        binary: binary numbers, not text.
        order: ``<`` or ``>``, order of the bytes.
        size: bytes of size_t, 4 or 8.
    """

    binary: bool = False
    order: str = "<"
    size: int = 8

    def open(self, section: bytes, *, name: str) -> Stream:
        """The numbers of a section."""
        if self.binary:
            return BinaryStream(section, name=name, encoding=self)
        return TextStream(section, name=name)


class TextStream:
    """Numbers written as text."""

    text = True

    def __init__(self, section: bytes, *, name: str) -> None:
        self._name = name
        self._next = 0
        kind = np.int64 if name == "Elements" else np.float64
        self._values = _parse(section, kind, name=name)

    def count(self) -> int:
        """See `Stream`."""
        return int(self.ints(1)[0])

    def ints(self, n: int) -> Ints:
        """(n,), see `Stream`."""
        with np.errstate(invalid="ignore"):
            return self._take(n).astype(np.int64)

    sizes = ints

    def floats(self, n: int) -> Floats:
        """(n,), see `Stream`."""
        return self._take(n).astype(np.float64)

    def rest(self) -> int:
        """See `Stream`."""
        return len(self._values) - self._next

    def _take(self, n: int) -> npt.NDArray[np.generic]:
        if not 0 <= n <= self.rest():
            raise _too_short(self._name)
        self._next += n
        return self._values[self._next - n : self._next]


def _parse(section: bytes, kind: type[np.generic], *, name: str) -> npt.NDArray[np.generic]:
    """All numbers of a text; refuses one that holds anything else."""
    text = section.strip()
    if not text:
        return np.zeros(0, dtype=kind)
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("error")
            return np.fromstring(text.decode("ascii"), dtype=kind, sep=" ")
    except (ValueError, DeprecationWarning, OverflowError) as error:
        message = f"the section ${name} holds something that is not a number"
        raise Refused("mesh-malformed", message, _AGAIN) from error


class BinaryStream:
    """Numbers in binary.

    Args:
        section: the bytes between its head and its end.
        name: of the section, for messages.
        encoding: byte order and sizes of the numbers.
    """

    text = False

    def __init__(self, section: bytes, *, name: str, encoding: Encoding) -> None:
        self._data = section
        self._name = name
        self._next = 0
        self._int = np.dtype(f"{encoding.order}i4")
        self._size = np.dtype(f"{encoding.order}u{encoding.size}")
        self._double = np.dtype(f"{encoding.order}f8")

    def count(self) -> int:
        """See `Stream`.

        Raises:
            Refused: the section ends, or there is no number.
        """
        match = re.compile(rb"\s*(\d{1,18})[ \t\r]*\n").match(self._data, self._next)
        if match is None:
            raise _too_short(self._name)
        self._next = match.end()
        return int(match[1])

    def ints(self, n: int) -> Ints:
        """(n,), see `Stream`."""
        return self._take(n, self._int).astype(np.int64)

    def sizes(self, n: int) -> Ints:
        """(n,), see `Stream`."""
        return self._take(n, self._size).astype(np.int64)

    def floats(self, n: int) -> Floats:
        """(n,), see `Stream`."""
        return self._take(n, self._double).astype(np.float64)

    def records(self, n: int, fields: np.dtype[np.void]) -> npt.NDArray[np.void]:
        """The next ``n`` records (n,) of packed ``fields``."""
        return self._take(n, fields).view(fields)

    def record(self, floats: int) -> np.dtype[np.void]:
        """The type of a record of one int and some doubles."""
        return np.dtype([("number", self._int), ("values", self._double, (floats,))])

    def rest(self) -> int:
        """See `Stream`."""
        return len(self._data[self._next :].strip(b"\r\n \t"))

    def _take(self, n: int, dtype: np.dtype) -> npt.NDArray[np.generic]:
        size = n * dtype.itemsize
        if not 0 <= size <= len(self._data) - self._next:
            raise _too_short(self._name)
        self._next += size
        return np.frombuffer(self._data, dtype=dtype, count=n, offset=self._next - size)


def _too_short(name: str) -> Refused:
    """The refusal of a section that announces more than it holds."""
    return Refused("mesh-truncated", f"the section ${name} holds less than it announces", _AGAIN)
