"""CHOLMOD's own solution for many right-hand sides, in the library that comes with cvxopt's wheel.

cvxopt hands right-hand sides to CHOLMOD one by one or four at a time; all together they are solved
three to four times as fast, since the supernodes then meet matrices. The library is already loaded
by cvxopt; it is asked for its function `cholmod_l_solve`. Where it is not found (another build of
cvxopt), or does not solve a small system as cvxopt does, there is none, and cvxopt is used.
"""

from __future__ import annotations

import ctypes
from collections.abc import Callable
from functools import lru_cache
from importlib import import_module
from pathlib import Path
from typing import Any

import numpy as np

from geoident.model.arrays import Floats

_SYSTEM = 0  # A x = b
_REAL = 1
_COMMON = 1 << 16  # bytes for cholmod_common, of which it takes some 3000


class _Dense(ctypes.Structure):
    """`cholmod_dense`: a matrix by columns."""

    _fields_ = (
        ("nrow", ctypes.c_size_t),
        ("ncol", ctypes.c_size_t),
        ("nzmax", ctypes.c_size_t),
        ("d", ctypes.c_size_t),
        ("x", ctypes.c_void_p),
        ("z", ctypes.c_void_p),
        ("xtype", ctypes.c_int),
        ("dtype", ctypes.c_int),
    )


SolveMany = Callable[[Any, Floats], Floats]
"""Solutions (n, k) of a factor of cvxopt for right-hand sides (n, k) in Fortran order."""


@lru_cache(maxsize=1)
def solve_many() -> SolveMany | None:
    """The solution for many right-hand sides at once, tried on a small system; None for none."""
    cvxopt = import_module("cvxopt")
    import_module("cvxopt.cholmod")
    folder = Path(str(cvxopt.__file__)).parent.parent / "cvxopt.libs"
    for path in sorted(folder.glob("libcholmod*")):
        try:
            found = _bound(ctypes.CDLL(str(path)))
            if _agrees(cvxopt, found):
                return found
        except (OSError, AttributeError, ValueError):
            continue
    return None


def _bound(library: ctypes.CDLL) -> SolveMany:
    pointer, name = ctypes.pythonapi.PyCapsule_GetPointer, ctypes.pythonapi.PyCapsule_GetName
    name.restype, name.argtypes = ctypes.c_char_p, [ctypes.py_object]
    pointer.restype, pointer.argtypes = ctypes.c_void_p, [ctypes.py_object, ctypes.c_char_p]
    solve, free = library.cholmod_l_solve, library.cholmod_l_free_dense
    dense = ctypes.POINTER(_Dense)
    solve.restype = dense
    solve.argtypes = [ctypes.c_int, ctypes.c_void_p, dense, ctypes.c_void_p]
    free.argtypes = [ctypes.POINTER(dense), ctypes.c_void_p]
    common = ctypes.create_string_buffer(_COMMON)
    if library.cholmod_l_start(common) != 1:
        raise ValueError("CHOLMOD does not start")

    def solve_all(factor: Any, rhs: Floats) -> Floats:
        n, k = rhs.shape
        given = _Dense(n, k, n * k, n, rhs.ctypes.data, None, _REAL, 0)
        found = solve(_SYSTEM, pointer(factor, name(factor)), ctypes.byref(given), common)
        if not found or not found.contents.x:
            raise ValueError("CHOLMOD does not solve")
        values = ctypes.cast(found.contents.x, ctypes.POINTER(ctypes.c_double))
        rhs[:] = np.ctypeslib.as_array(values, (k, n)).T
        free(ctypes.byref(found), common)
        return rhs

    return solve_all


def _agrees(cvxopt: Any, found: SolveMany) -> bool:
    """Whether a small system is solved as cvxopt solves it."""
    n, k = 12, 5
    matrix = np.diag(np.full(n, 4.0)) + np.diag(np.full(n - 1, -1.0), -1)
    rhs = np.asfortranarray(np.arange(n * k, dtype=np.float64).reshape(n, k))
    sparse = cvxopt.sparse(cvxopt.matrix(matrix))
    factor = cvxopt.cholmod.symbolic(sparse, uplo="L")
    cvxopt.cholmod.numeric(sparse, factor)
    wanted = cvxopt.matrix(rhs)
    cvxopt.cholmod.solve(factor, wanted)
    return bool(np.allclose(found(factor, rhs), np.asarray(wanted), rtol=1e-12, atol=1e-12))
