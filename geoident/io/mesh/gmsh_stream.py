"""The numbers in a section of an MSH file, the same to read whether they are text or binary."""

from __future__ import annotations

import re
import warnings
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from geoident.io.mesh.raw import Refused
from geoident.model.arrays import Floats, Ints

_AGAIN = "the file is damaged: write it again with gmsh"
_COUNT = re.compile(rb"\s*(\d{1,18})[ \t\r]*\n")


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


class Stream:
    """The numbers of one section, in their order. Every method raises `Refused` at its end.

    Args:
        section: the bytes between its head and its end.
        name: of the section, for messages.
        encoding: how it holds its numbers.
    """

    def __init__(self, section: bytes, *, name: str, encoding: Encoding) -> None:
        self.text = not encoding.binary
        self._name, self._next, self._data = name, 0, section
        self._values = self._parsed(section) if self.text else np.zeros(0)
        self._int = np.dtype(f"{encoding.order}i4")
        self._size = np.dtype(f"{encoding.order}u{encoding.size}")
        self._double = np.dtype(f"{encoding.order}f8")

    def _parsed(self, section: bytes) -> npt.NDArray[np.generic]:
        """All numbers of a text; refuses one that holds anything else."""
        kind = np.int64 if self._name == "Elements" else np.float64
        if not (text := section.strip()):
            return np.zeros(0, dtype=kind)
        try:
            with warnings.catch_warnings():
                warnings.simplefilter("error")
                return np.fromstring(text.decode("ascii"), dtype=kind, sep=" ")
        except (ValueError, DeprecationWarning, OverflowError) as error:
            message = f"the section ${self._name} holds something that is not a number"
            raise Refused("mesh-malformed", message, _AGAIN) from error

    def count(self) -> int:
        """A number that stands on a line of its own, as text also in MSH 2.2 binary.

        Raises:
            Refused: the section ends, or there is no number.
        """
        if self.text:
            return int(self.ints(1)[0])
        match = _COUNT.match(self._data, self._next)
        if match is None:
            raise self._too_short()
        self._next = match.end()
        return int(match[1])

    def ints(self, n: int) -> Ints:
        """The next ``n`` numbers (n,) of C's type int."""
        with np.errstate(invalid="ignore"):
            return self._take(n, self._int).astype(np.int64)

    def sizes(self, n: int) -> Ints:
        """The next ``n`` numbers (n,) of C's type size_t."""
        with np.errstate(invalid="ignore"):
            return self._take(n, self._size).astype(np.int64)

    def floats(self, n: int) -> Floats:
        """The next ``n`` numbers (n,) of C's type double."""
        return self._take(n, self._double).astype(np.float64)

    def numbered(self, n: int, width: int) -> tuple[Ints, Floats]:
        """The next ``n`` rows of a number, of C's type int (n,), and doubles (n, width)."""
        if self.text:
            rows = self.floats(n * (1 + width)).reshape(n, 1 + width)
            with np.errstate(invalid="ignore"):
                return rows[:, 0].astype(np.int64), np.ascontiguousarray(rows[:, 1:])
        fields = np.dtype([("number", self._int), ("values", self._double, (width,))])
        records = self._take(n, fields).view(fields)
        return records["number"].astype(np.int64), records["values"].astype(np.float64)

    def rest(self) -> int:
        """How many numbers (text) or bytes (binary) are left."""
        if self.text:
            return len(self._values) - self._next
        return len(self._data[self._next :].strip(b"\r\n \t"))

    def _take(self, n: int, dtype: np.dtype) -> npt.NDArray[np.generic]:
        size, end = (n, len(self._values)) if self.text else (n * dtype.itemsize, len(self._data))
        if not 0 <= size <= end - self._next:
            raise self._too_short()
        start, self._next = self._next, self._next + size
        if self.text:
            return self._values[start : self._next]
        return np.frombuffer(self._data, dtype=dtype, count=n, offset=start)

    def _too_short(self) -> Refused:
        """The refusal of a section that announces more than it holds."""
        message = f"the section ${self._name} holds less than it announces"
        return Refused("mesh-truncated", message, _AGAIN)
