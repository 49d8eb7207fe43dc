"""BLAS and LAPACK on parts of arrays, in their place, without Python's lock.

scipy's wrappers copy what is not contiguous and hold Python's lock while they compute. The same
routines stand behind `scipy.linalg.cython_blas` as pointers, as compiled code takes them; called
through `ctypes` they work on any part of an array in Fortran order, and threads run side by side.

Every call is made with one thread of the BLAS (`threads.one_thread`): what is large is divided here
into tasks, always the same, so that the numbers do not depend on how many threads there are.
"""

from __future__ import annotations

import ctypes
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property, lru_cache
from importlib import import_module
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

Dense = npt.NDArray[np.floating]
"""Numbers in double or single precision."""

FEW = 4
"""Right-hand sides that are solved one by one.

Products of matrices copy both first, which takes longer than the products where one has so few
columns.
"""

CACHED = 1 << 18
"""Bytes of a factor that are read for one right-hand side and are still at hand for the next."""

NARROW = 8
"""Columns of a factor, at least, that are taken at once: what stands below is passed each time."""

_Routine = Callable[..., None]


class Kernels:
    """The dense operations of a factorization in one precision.

    Matrices are two-dimensional, in Fortran order (rows next to each other), of which any
    rectangle may be given.

    Args:
        dtype: float64 or float32.
    """

    def __init__(self, dtype: npt.DTypeLike) -> None:
        self.dtype = np.dtype(dtype)
        letter, number = (
            ("d", ctypes.c_double) if self.dtype == np.float64 else ("s", ctypes.c_float)
        )
        self._potrf = _routine("cython_lapack", f"{letter}potrf", 5)
        self._trsm = _routine("cython_blas", f"{letter}trsm", 11)
        self._syrk = _routine("cython_blas", f"{letter}syrk", 10)
        self._gemm = _routine("cython_blas", f"{letter}gemm", 13)
        self._trsv = _routine("cython_blas", f"{letter}trsv", 8)
        self._gemv = _routine("cython_blas", f"{letter}gemv", 11)
        self._one, self._minus = ctypes.byref(number(1.0)), ctypes.byref(number(-1.0))
        self._zero = ctypes.byref(number(0.0))

    def factorize(self, a: Dense) -> int:
        """The Cholesky factor in the place of the lower triangle of a (s, s).

        Returns:
            Number of pivots that are positive: s if all are.
        """
        info = ctypes.c_int(0)
        self._potrf(b"L", _int(a.shape[0]), _at(a), _leading(a), ctypes.byref(info))
        return a.shape[0] if info.value == 0 else info.value - 1

    def divide(self, b: Dense, lower: Dense) -> None:
        """B <- B L^-T for rows (r, s)."""
        r, s = b.shape
        if r:
            self._trsm(
                b"R", b"L", b"T", b"N", _int(r), _int(s), self._one,
                _at(lower), _leading(lower), _at(b), _leading(b),
            )  # fmt: skip

    def subtract_square(self, c: Dense, a: Dense) -> None:
        """Lower triangle of C <- C - A A^T for A (r, s)."""
        r, s = a.shape
        self._syrk(
            b"L", b"N", _int(r), _int(s), self._minus,
            _at(a), _leading(a), self._one, _at(c), _leading(c),
        )  # fmt: skip

    def subtract_product(self, c: Dense, a: Dense, b: Dense) -> None:
        """C <- C - A B^T.

        Args:
            c: (r, q), changed in place.
            a: (r, s).
            b: (q, s).
        """
        (r, s), q = a.shape, b.shape[0]
        if r and q:
            self._gemm(
                b"N", b"T", _int(r), _int(q), _int(s), self._minus, _at(a), _leading(a),
                _at(b), _leading(b), self._one, _at(c), _leading(c),
            )  # fmt: skip

    def forward(self, panel: Panel, x: Dense) -> Dense:
        """X <- L^-1 X, L the square on top of a panel.

        Args:
            panel: (w + r, w), the rows A below L with it.
            x: (w, k) in C order, changed in place.

        Returns:
            (r, k) what is to be added to the rows below: - A X.
        """
        (m, w), k = panel.strip.shape, x.shape[1]
        if k <= FEW:
            columns = np.zeros((k, m), dtype=self.dtype)
            columns[:, :w] = x.T
            self._forward_one_by_one(panel, columns)
            x[:] = columns[:, :w].T
            return columns[:, w:].T
        whole = panel.whole
        self._solve(whole, x, b"T")
        below = np.empty((m - w, k), dtype=self.dtype)
        if m > w:
            self._gemm(
                b"N", b"T", _int(k), whole.height, whole.width, self._minus, _at(x), _int(k),
                whole.rest, whole.leading, self._zero, _at(below), _int(k),
            )  # fmt: skip
        return below

    def backward(self, panel: Panel, x: Dense, below: Dense) -> None:
        """X <- L^-T (X - A^T Y), L the square on top of a panel.

        Args:
            panel: (w + r, w), the rows A below L with it.
            x: (w, k) in C order, changed in place.
            below: (r, k) Y in C order.
        """
        (m, w), k = panel.strip.shape, x.shape[1]
        if k <= FEW:
            columns = np.empty((k, m), dtype=self.dtype)
            columns[:, :w], columns[:, w:] = x.T, below.T
            self._backward_one_by_one(panel, columns)
            x[:] = columns[:, :w].T
            return
        whole = panel.whole
        if m > w:
            self._gemm(
                b"N", b"N", _int(k), whole.width, whole.height, self._minus, _at(below), _int(k),
                whole.rest, whole.leading, self._one, _at(x), _int(k),
            )  # fmt: skip
        self._solve(whole, x, b"N")

    def _solve(self, tile: Tile, x: Dense, way: bytes) -> None:
        k = _int(x.shape[1])
        self._trsm(
            b"R", b"L", way, b"N", k, tile.width, self._one,
            tile.lower, tile.leading, _at(x), k,
        )  # fmt: skip

    def _forward_one_by_one(self, panel: Panel, columns: Dense) -> None:
        """Forward for columns (k, w + r), what is below with them."""
        starts = range(_at(columns), _at(columns) + columns.nbytes, columns.strides[0])
        next_to = _int(1)
        for lower, rest, leading, s, r, a, b in panel.tiles(len(columns)):
            for at in starts:
                self._trsv(b"L", b"N", b"N", s, lower, leading, at + a, next_to)
                self._gemv(
                    b"N", r, s, self._minus, rest, leading, at + a, next_to,
                    self._one, at + b, next_to,
                )  # fmt: skip

    def _backward_one_by_one(self, panel: Panel, columns: Dense) -> None:
        """Backward for columns (k, w + r), what is below with them."""
        starts = range(_at(columns), _at(columns) + columns.nbytes, columns.strides[0])
        next_to = _int(1)
        for lower, rest, leading, s, r, a, b in reversed(panel.tiles(len(columns))):
            for at in starts:
                self._gemv(
                    b"T", r, s, self._minus, rest, leading, at + b, next_to,
                    self._one, at + a, next_to,
                )  # fmt: skip
                self._trsv(b"L", b"T", b"N", s, lower, leading, at + a, next_to)


class Tile(NamedTuple):
    """Some columns of a panel, as BLAS is told of them.

    Args:
        lower: where their triangle is.
        rest: where the rows below it are.
        leading: from one column to the next.
        width: number of columns.
        height: number of rows below the triangle.
        begin: bytes from the first row of the panel to that of the triangle.
        end: bytes to the first row below it.
    """

    lower: int
    rest: int
    leading: Any
    width: Any
    height: Any
    begin: int
    end: int


@dataclass(frozen=True)
class Panel:
    """Columns of a factor, to solve with: a triangle and the rows below it.

    Args:
        strip: (w + r, w) in Fortran order.
    """

    strip: Dense

    @cached_property
    def whole(self) -> Tile:
        """All columns."""
        return self._tile(0, self.strip.shape[1])

    @cached_property
    def _tiles(self) -> Sequence[Tile]:
        (m, w), size = self.strip.shape, self.strip.itemsize
        step = max(NARROW, CACHED // (m * size))
        return [self._tile(a, min(a + step, w)) for a in range(0, w, step)]

    def tiles(self, k: int) -> Sequence[Tile]:
        """The columns as they are read for k right-hand sides: of one, all at once."""
        return [self.whole] if k == 1 else self._tiles

    def _tile(self, a: int, b: int) -> Tile:
        strip, size = self.strip, self.strip.itemsize
        corner = _at(strip) + a * strip.strides[1]
        begin, end, leading = a * size, b * size, _leading(strip)
        height = _int(strip.shape[0] - b)
        return Tile(corner + begin, corner + end, leading, _int(b - a), height, begin, end)


@lru_cache(maxsize=2)
def kernels(dtype: npt.DTypeLike) -> Kernels:
    """The operations in a precision, made once."""
    return Kernels(dtype)


def _routine(module: str, name: str, n_arguments: int) -> _Routine:
    capsule: Any = import_module(f"scipy.linalg.{module}").__pyx_capi__[name]
    signature = ctypes.pythonapi.PyCapsule_GetName
    signature.restype, signature.argtypes = ctypes.c_char_p, [ctypes.py_object]
    pointer = ctypes.pythonapi.PyCapsule_GetPointer
    pointer.restype, pointer.argtypes = ctypes.c_void_p, [ctypes.py_object, ctypes.c_char_p]
    prototype = ctypes.CFUNCTYPE(None, *[ctypes.c_void_p] * n_arguments)
    found: _Routine = prototype(pointer(capsule, signature(capsule)))
    return found


@lru_cache(maxsize=4096)
def _int(value: int) -> Any:
    """A number where BLAS reads it; made once, since it changes none."""
    return ctypes.byref(ctypes.c_int(value))


def _at(a: Dense) -> int:
    return int(a.__array_interface__["data"][0])


def _leading(a: Dense) -> Any:
    return _int(max(1, a.strides[1] // a.itemsize, a.shape[0]))
