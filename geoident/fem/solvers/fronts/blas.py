"""BLAS and LAPACK on parts of arrays, in their place, without Python's lock.

scipy's wrappers copy what is not contiguous and hold Python's lock while they compute. The same
routines stand behind `scipy.linalg.cython_blas` as pointers, as compiled code takes them; called
through `ctypes` they work on any part of an array in Fortran order, and threads run side by side.

Every call is made with one thread of the BLAS (`threads.one_thread`): what is large is divided here
into tasks, always the same, so that the numbers do not depend on how many threads there are.
"""

from __future__ import annotations

import ctypes
from collections.abc import Callable
from functools import lru_cache
from importlib import import_module
from typing import Any

import numpy as np
import numpy.typing as npt

Dense = npt.NDArray[np.floating]
"""Numbers in double or single precision."""

_TINY = 1 << 15
"""Multiplications below which a product is left to numpy, whose calls are shorter."""

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

    def forward(self, lower: Dense, x: Dense) -> None:
        """X <- L^-1 X for rows x (s, k) in C order."""
        self._solve(lower, x, b"N", b"T")

    def backward(self, lower: Dense, x: Dense) -> None:
        """X <- L^-T X for rows x (s, k) in C order."""
        self._solve(lower, x, b"T", b"N")

    def product(self, a: Dense, x: Dense) -> Dense:
        """A X (r, k) for A (r, s) and rows x (s, k) in C order."""
        (r, s), k = a.shape, x.shape[1]
        found = np.empty((r, k), dtype=self.dtype)
        if k == 1:
            self._gemv(
                b"N", _int(r), _int(s), self._one, _at(a), _leading(a), _at(x), _int(1),
                self._zero, _at(found), _int(1),
            )  # fmt: skip
        elif r:
            self._gemm(
                b"N", b"T", _int(k), _int(r), _int(s), self._one, _at(x), _int(k),
                _at(a), _leading(a), self._zero, _at(found), _int(k),
            )  # fmt: skip
        return found

    def subtract_transposed(self, x: Dense, a: Dense, y: Dense) -> None:
        """X <- X - A^T Y.

        Args:
            x: (s, k) in C order, changed in place.
            a: (r, s).
            y: (r, k) in C order.
        """
        (r, s), k = a.shape, x.shape[1]
        if k == 1:
            self._gemv(
                b"T", _int(r), _int(s), self._minus, _at(a), _leading(a), _at(y), _int(1),
                self._one, _at(x), _int(1),
            )  # fmt: skip
        else:
            self._gemm(
                b"N", b"N", _int(k), _int(s), _int(r), self._minus, _at(y), _int(k),
                _at(a), _leading(a), self._one, _at(x), _int(k),
            )  # fmt: skip

    def _solve(self, lower: Dense, x: Dense, vector: bytes, matrix: bytes) -> None:
        s, k = x.shape
        if k == 1:
            self._trsv(b"L", vector, b"N", _int(s), _at(lower), _leading(lower), _at(x), _int(1))
            return
        self._trsm(
            b"R", b"L", matrix, b"N", _int(k), _int(s), self._one,
            _at(lower), _leading(lower), _at(x), _int(k),
        )  # fmt: skip


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


def _int(value: int) -> Any:
    return ctypes.byref(ctypes.c_int(value))


def _at(a: Dense) -> int:
    return int(a.__array_interface__["data"][0])


def _leading(a: Dense) -> Any:
    return ctypes.byref(ctypes.c_int(max(1, a.strides[1] // a.itemsize, a.shape[0])))
