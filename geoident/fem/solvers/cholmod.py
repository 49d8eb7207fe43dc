"""CHOLMOD, from the wheel of cvxopt: a supernodal Cholesky factorization on one core."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from importlib import import_module
from typing import Any

import numpy as np

from geoident.fem.solvers.direct import (
    LowerPattern,
    NotPositiveDefinite,
    Solve,
    SolverCounts,
    SymbolicFactorization,
    check_pivots,
)
from geoident.model.arrays import Floats

# Supernodal, and the order that is given, as it is: without a postorder of its own, column k of
# the factor is unknown k. (A nested dissection is a postorder already.)
_OPTIONS = {"supernodal": 2, "nmethods": 1, "postorder": False, "print": 0}

BLOCK = 64
"""Right-hand sides that cvxopt gets as one sparse matrix; bounds the memory (16 bytes each)."""


class CholmodFactorization(SymbolicFactorization):
    """The supernodes of a pattern, whose numbers are overwritten by every factorization."""

    def __init__(self, pattern: LowerPattern, counts: SolverCounts) -> None:
        super().__init__(pattern, counts)
        n = pattern.n
        cvxopt = load()
        columns = np.repeat(np.arange(n), np.diff(pattern.indptr))
        entries = cvxopt.matrix(pattern.indices), cvxopt.matrix(columns)
        self._matrix = cvxopt.spmatrix(1.0, *entries, (n, n))
        self._factor = self._symbolic()

    def _symbolic(self) -> Any:
        cvxopt = load()
        with _options():
            order = cvxopt.matrix(np.arange(self.pattern.n))
            return cvxopt.cholmod.symbolic(self._matrix, order, uplo="L")

    def release(self) -> None:
        # CHOLMOD keeps symbols and numbers in one object; finding the symbols again costs a
        # few hundredths of a factorization.
        self._factor = None

    def _factorize(self, values: Floats, diagonal: Floats) -> Solve:
        cvxopt = load()
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


def load() -> Any:
    """The package cvxopt, of which nothing is needed until something is solved.

    Raises:
        ImportError: it is not installed.
    """
    import_module("cvxopt.cholmod")
    return import_module("cvxopt")


def _solve(factor: Any, rhs: Floats) -> Floats:
    """Solutions for dense right-hand sides (n, k) in Fortran order, which are overwritten.

    cvxopt hands dense ones to CHOLMOD one by one, sparse ones four at a time: in half the time.
    """
    cvxopt = load()
    if rhs.shape[1] == 1:
        dense = cvxopt.matrix(rhs)
        cvxopt.cholmod.solve(factor, dense)
        return np.asarray(dense)
    for start in range(0, rhs.shape[1], BLOCK):
        sparse = cvxopt.sparse(cvxopt.matrix(rhs[:, start : start + BLOCK]))
        solved = cvxopt.cholmod.spsolve(factor, sparse)
        rhs[:, start : start + BLOCK] = np.asarray(cvxopt.matrix(solved))
    return rhs


@contextmanager
def _options() -> Iterator[None]:
    """Our options, in a dictionary that all users of cvxopt share."""
    options = load().cholmod.options
    before = dict(options)
    options.update(_OPTIONS)
    try:
        yield
    finally:
        options.clear()
        options.update(before)
