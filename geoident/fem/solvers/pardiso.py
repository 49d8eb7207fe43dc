"""PARDISO of Intel's MKL, installed with pypardiso: the fastest here, and it can take all cores.

pypardiso's own interface is for general matrices: it has no place for a given order and copies
every matrix. So MKL is called by its documented C functions (oneMKL developer reference, "oneMKL
PARDISO - Parallel Direct Sparse Solver Interface").

MKL is told once to give the same bits in every run (its conditional numerical reproducibility):
else they follow from where arrays happen to lie in memory. Bits of several threads also depend on
their number, so what one thread does soon enough is done by one (`ONE_THREAD`).
"""

from __future__ import annotations

import ctypes
import os
import weakref
from functools import cache
from importlib import import_module, metadata

import numpy as np
import numpy.typing as npt

from geoident.fem.solvers.direct import (
    LowerPattern,
    NotPositiveDefinite,
    Solve,
    SolverCounts,
    SymbolicFactorization,
    check_pivots,
)
from geoident.fem.solvers.threads import granted_threads
from geoident.model.arrays import Floats

ONE_THREAD = 1e10
"""Operations of a factorization below which one thread takes less than half a second for it.

For small matrices all cores together are hardly faster, and their time adds up to more.
"""

_SPD, _INDEFINITE = 2, -2  # mtype of real symmetric matrices, positive definite or indefinite
_ANALYSE, _FACTORIZE, _SOLVE, _RELEASE, _RELEASE_FACTOR = 11, 22, 33, -1, 0
_NOT_DEFINITE = (-4, -7)  # zero or negative pivot, singular diagonal matrix
_NO_MEMORY = (-2, -9)  # in main memory; in the file beside it
_SAME_BITS = 2  # MKL_CBWR_AUTO


class PardisoFactorization(SymbolicFactorization):
    """A symbolic factorization inside MKL, released with this object."""

    def __init__(self, pattern: LowerPattern, counts: SolverCounts) -> None:
        super().__init__(pattern, counts)
        self._handle = _Handle(pattern)
        self._handle.call(_ANALYSE)
        weakref.finalize(self, self._handle.call, _RELEASE)

    def release(self) -> None:
        self._handle.call(_RELEASE_FACTOR)

    def _factorize(self, values: Floats, diagonal: Floats) -> Solve:
        self._handle.values = np.array(values, dtype=np.float64)
        self._handle.call(_FACTORIZE)
        check_pivots(self._handle.pivots(), diagonal)
        return self._handle.solve


class PardisoIndefinite:
    """A pattern of quasi-definite matrices inside MKL; see `quasi_definite`.

    Args:
        pattern: of the lower triangle, in a fill-reducing order.
        signs: (n,) of the diagonal, 1 or -1; MKL counts those of the pivots.
    """

    def __init__(self, pattern: LowerPattern, signs: Floats) -> None:
        self._handle, self._negative = _Handle(pattern, _INDEFINITE), int((signs < 0.0).sum())
        self._handle.call(_ANALYSE)
        weakref.finalize(self, self._handle.call, _RELEASE)

    def factorize(self, values: Floats) -> Solve:
        """How to solve with the matrix of these values (nnz,), until the next call.

        Raises:
            NotPositiveDefinite: a pivot is zero, or there are too few or too many negative ones.
        """
        self._handle.values = np.array(values, dtype=np.float64)
        self._handle.call(_FACTORIZE)
        if self._handle.n_negative != self._negative:
            raise NotPositiveDefinite
        return self._handle.solve


class _Handle:
    """One matrix in MKL.

    The lower triangle by columns is the upper triangle by rows, which PARDISO wants.
    """

    def __init__(self, pattern: LowerPattern, kind: int = _SPD) -> None:
        self._kind = kind
        self._indptr = np.array(pattern.indptr, dtype=np.int32)
        self._indices = np.array(pattern.indices, dtype=np.int32)
        self._order = np.arange(pattern.n, dtype=np.int32)
        self._memory = np.zeros(64, dtype=np.int64)
        self._settings = _settings(kind)
        self._threads = 1
        if pattern.flops_at_most > ONE_THREAD:
            self._threads = granted_threads("MKL_NUM_THREADS")
        self.values = np.ones(len(pattern.indices))

    def solve(self, rhs: Floats) -> Floats:
        """Solutions (n, k) for right-hand sides (n, k) in Fortran order."""
        solution = np.empty_like(rhs)
        self.call(_SOLVE, rhs, solution)
        return solution

    @property
    def n_negative(self) -> int:
        """Number of negative pivots of an indefinite matrix."""
        return int(self._settings[22])

    def pivots(self) -> Floats:
        """(n,) squared diagonal of the factor, by unknown."""
        factor, matrix = np.empty((2, self._order.size))
        error = ctypes.c_int32(0)
        load()["pardiso_getdiag"](
            _address(self._memory),
            _address(factor),
            _address(matrix),
            *_numbers(1),
            ctypes.byref(error),
        )
        return factor

    def call(self, phase: int, rhs: Floats | None = None, solution: Floats | None = None) -> None:
        """One call of PARDISO; raises `NotPositiveDefinite` if it says so."""
        n = self._order.size
        k = 1 if rhs is None else rhs.shape[1]
        error = ctypes.c_int32(0)
        threads_before = load()["MKL_Set_Num_Threads_Local"](self._threads)
        load()["pardiso"](
            _address(self._memory),
            *_numbers(1, 1, self._kind, phase, n),
            _address(self.values),
            _address(self._indptr),
            _address(self._indices),
            _address(self._order),
            *_numbers(k),
            _address(self._settings),
            *_numbers(0),
            None if rhs is None else _address(rhs),
            None if solution is None else _address(solution),
            ctypes.byref(error),
        )
        load()["MKL_Set_Num_Threads_Local"](threads_before)
        if error.value in _NOT_DEFINITE:
            equation = int(self._settings[29])  # at which it stopped, if that is told
            raise NotPositiveDefinite(equation - 1 if 1 <= equation <= n else None)
        if error.value in _NO_MEMORY:
            raise MemoryError("PARDISO: not enough memory for the factor")
        if error.value:
            raise RuntimeError(f"PARDISO reports error {error.value} in phase {phase}")


@cache
def load() -> ctypes.CDLL:
    """The shared library `mkl_rt`, where pip has put it or else where pypardiso finds it.

    pypardiso searches whole folders, which takes up to a second.

    Raises:
        ImportError: it is not installed.
        OSError: it is there and does not load.
    """
    # Threads of OpenMP sleep at once when they have nothing to do: turning round and round beside
    # our own work they took a fifth of a fit's time of processors, and won nothing.
    os.environ.setdefault("KMP_BLOCKTIME", "0")
    try:
        files = metadata.files("mkl") or []
    except metadata.PackageNotFoundError:
        files = []
    paths = [str(file.locate()) for file in files if file.name.startswith(("libmkl_rt", "mkl_rt"))]
    library = ctypes.CDLL(paths[0]) if paths else import_module("pypardiso").ps.libmkl
    assert isinstance(library, ctypes.CDLL)
    library["MKL_CBWR_Set"](_SAME_BITS)  # refused, without harm, if others have used MKL before
    return library


def _settings(kind: int) -> npt.NDArray[np.int32]:
    """PARDISO's iparm, counted from 0."""
    settings = np.zeros(64, dtype=np.int32)
    settings[0] = 1  # not all defaults
    settings[4] = 1  # the order is given
    settings[34] = 1  # indices count from 0
    if kind == _SPD:
        settings[55] = 1  # keep the pivots
    else:
        settings[9] = 13  # a pivot below this power of a tenth of the matrix is moved up to it
        settings[20] = 1  # blocks of two beside each other may be a pivot (Bunch and Kaufman)
    return settings


def _address(array: npt.NDArray[np.generic]) -> ctypes.c_void_p:
    return ctypes.c_void_p(array.ctypes.data)


def _numbers(*values: int) -> list[ctypes._CArgObject]:
    """Integers by reference, as Fortran wants them."""
    return [ctypes.byref(ctypes.c_int32(value)) for value in values]
