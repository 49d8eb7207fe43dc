"""CHOLMOD, from the wheel of cvxopt: a supernodal Cholesky factorization.

cvxopt hands right-hand sides to CHOLMOD one by one or four at a time; all together they are solved
three to four times as fast, since the supernodes then meet matrices. The library is already loaded
by cvxopt; it is asked for its function `cholmod_l_solve`. Where it is not found (another build of
cvxopt), or does not solve a small system as cvxopt does, there is none, and cvxopt is used.
"""

from __future__ import annotations

import ctypes
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import lru_cache
from importlib import import_module
from pathlib import Path
from typing import Any

import numpy as np

from geoident.fem.solvers.direct import (
    DirectAnalysis,
    LowerPattern,
    NotPositiveDefinite,
    Solve,
    SolverCounts,
    check_pivots,
)
from geoident.model.arrays import Floats

# Supernodal, and the order that is given, as it is: without a postorder of its own, column k of
# the factor is unknown k. (A nested dissection is a postorder already.)
_OPTIONS = {"supernodal": 2, "nmethods": 1, "postorder": False, "print": 0}

BLOCK = 64
"""Right-hand sides solved together; bounds the memory."""

_SYSTEM = 0  # A x = b
_REAL = 1
_COMMON = 1 << 16  # bytes for cholmod_common, of which it takes some 3000


class CholmodSolver:
    """CHOLMOD as a `Solver`.

    Args:
        counts: where to count; its own if not given.

    Raises:
        ImportError: cvxopt is not installed.
    """

    name = "cholmod"
    keeps_from = float("inf")

    def __init__(self, counts: SolverCounts | None = None) -> None:
        _load()
        self.counts = counts if counts is not None else SolverCounts()

    def analyse(self, pattern: LowerPattern) -> CholmodAnalysis:
        """Find the supernodes of this pattern."""
        return CholmodAnalysis(pattern, self.counts)


class CholmodAnalysis(DirectAnalysis):
    """A symbolic factorization, whose numbers are overwritten by every factorization."""

    def __init__(self, pattern: LowerPattern, counts: SolverCounts) -> None:
        super().__init__(pattern, counts)
        n = pattern.n
        if n == 0:
            return
        cvxopt = _load()
        columns = np.repeat(np.arange(n), np.diff(pattern.indptr))
        entries = cvxopt.matrix(pattern.indices), cvxopt.matrix(columns)
        self._matrix = cvxopt.spmatrix(1.0, *entries, (n, n))
        self._factor = self._symbolic()

    def _symbolic(self) -> Any:
        cvxopt = _load()
        with _options():
            order = cvxopt.matrix(np.arange(self.pattern.n))
            return cvxopt.cholmod.symbolic(self._matrix, order, uplo="L")

    def _release(self) -> None:
        # CHOLMOD keeps symbols and numbers in one object; finding the symbols again costs a
        # few hundredths of a factorization.
        self._factor = None

    def _factorize(self, values: Floats, diagonal: Floats) -> Solve:
        cvxopt = _load()
        if self._factor is None:
            self._factor = self._symbolic()
        self._matrix.V = cvxopt.matrix(values)
        try:
            with _options():
                cvxopt.cholmod.numeric(self._matrix, self._factor)
        except ArithmeticError as error:
            raise NotPositiveDefinite(int(error.args[0])) from error
        pivots = np.asarray(cvxopt.cholmod.diag(self._factor)).ravel() ** 2
        check_pivots(pivots, diagonal)
        return lambda rhs: _solve(self._factor, rhs)


def _load() -> Any:
    """The package cvxopt, of which nothing is needed until a solver is made."""
    import_module("cvxopt.cholmod")
    return import_module("cvxopt")


def _solve(factor: Any, rhs: Floats) -> Floats:
    """Solutions for dense right-hand sides.

    All together where CHOLMOD's library is found. cvxopt takes dense ones one by one, sparse ones
    four at a time, which halves the time.
    """
    cvxopt = _load()
    if rhs.shape[1] == 1:
        dense = cvxopt.matrix(rhs)
        cvxopt.cholmod.solve(factor, dense)
        return np.asarray(dense)
    together = solve_many()
    if together is not None:
        for start in range(0, rhs.shape[1], BLOCK):
            together(factor, rhs[:, start : start + BLOCK])
        return rhs
    for start in range(0, rhs.shape[1], BLOCK):
        sparse = cvxopt.sparse(cvxopt.matrix(rhs[:, start : start + BLOCK]))
        solved = cvxopt.cholmod.spsolve(factor, sparse)
        rhs[:, start : start + BLOCK] = np.asarray(cvxopt.matrix(solved))
    return rhs


@contextmanager
def _options() -> Iterator[None]:
    """Our options, in a dictionary that all users of cvxopt share."""
    options = _load().cholmod.options
    before = dict(options)
    options.update(_OPTIONS)
    try:
        yield
    finally:
        options.clear()
        options.update(before)


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
