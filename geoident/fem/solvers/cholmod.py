"""CHOLMOD, from the wheel of cvxopt: a supernodal Cholesky factorization."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

import numpy as np
from cvxopt import cholmod, matrix, spmatrix

from geoident.fem.solvers.counts import SolverCounts
from geoident.fem.solvers.direct import DirectAnalysis, Solve, check_pivots
from geoident.fem.solvers.protocol import LowerPattern, NotPositiveDefinite
from geoident.model.arrays import Floats

# Supernodal, and the order that is given, as it is: without a postorder of its own, column k of
# the factor is unknown k. (A nested dissection is a postorder already.)
_OPTIONS = {"supernodal": 2, "nmethods": 1, "postorder": False, "print": 0}


class CholmodSolver:
    """CHOLMOD as a `Solver`.

    Args:
        counts: where to count; its own if not given.
    """

    name = "cholmod"

    def __init__(self, counts: SolverCounts | None = None) -> None:
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
        columns = np.repeat(np.arange(n), np.diff(pattern.indptr))
        self._matrix = spmatrix(1.0, matrix(pattern.indices), matrix(columns), (n, n))
        with _options():
            self._factor = cholmod.symbolic(self._matrix, matrix(np.arange(n)), uplo="L")

    def _factorize(self, values: Floats, diagonal: Floats) -> Solve:
        self._matrix.V = matrix(values)
        try:
            with _options():
                cholmod.numeric(self._matrix, self._factor)
        except ArithmeticError as error:
            raise NotPositiveDefinite(int(error.args[0])) from error
        check_pivots(np.asarray(cholmod.diag(self._factor)).ravel() ** 2, diagonal)
        return lambda rhs: _solve(self._factor, rhs)


def _solve(factor: Any, rhs: Floats) -> Floats:
    solution = matrix(rhs)
    cholmod.solve(factor, solution)
    return np.asarray(solution)


@contextmanager
def _options() -> Iterator[None]:
    """Our options, in a dictionary that all users of cvxopt share."""
    before = dict(cholmod.options)
    cholmod.options.update(_OPTIONS)
    try:
        yield
    finally:
        cholmod.options.clear()
        cholmod.options.update(before)
