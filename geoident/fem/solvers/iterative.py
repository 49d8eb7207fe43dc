"""Conjugate gradients, preconditioned on several levels, as a `Solver`: beyond the memory.

A factor of a million unknowns in space takes 10 GB and grows with n^(4/3); the matrix and
its levels take one or two, and grow with n. All right-hand sides go together: one product with
the matrix for all (`multilevel.energy`). The coarsest level is factorized by our own solver in
single precision (`multilevel.cycle`).
"""

from __future__ import annotations

import numpy as np
import scipy.sparse as sp

from geoident.fem.solvers.direct import (
    DirectAnalysis,
    LowerPattern,
    Solve,
    SolverCounts,
)
from geoident.fem.solvers.multilevel.cycle import Hierarchy, Level
from geoident.fem.solvers.multilevel.energy import solve_in_energy, spectrum
from geoident.model.arrays import Floats

COLUMNS = 32
"""Right-hand sides that go together; bounds the memory."""


class IterativeSolver:
    """Conjugate gradients on several levels as a `Solver`.

    Args:
        counts: where to count; its own if not given.
    """

    name = "iterative"
    keeps_from = float("inf")

    def __init__(self, counts: SolverCounts | None = None) -> None:
        self.counts = counts if counts is not None else SolverCounts()

    def analyse(self, pattern: LowerPattern) -> IterativeAnalysis:
        """Prepare for matrices of this pattern."""
        return IterativeAnalysis(pattern, self.counts)


class IterativeAnalysis(DirectAnalysis):
    """The levels of a pattern, as far as they do not depend on values."""

    def __init__(self, pattern: LowerPattern, counts: SolverCounts) -> None:
        super().__init__(pattern, counts)
        self._hierarchy = Hierarchy(pattern.places, counts)

    def _release(self) -> None:
        """The levels die with their last user."""

    def _factorize(self, values: Floats, diagonal: Floats) -> Solve:
        matrix = whole(self.pattern, values)
        level = self._hierarchy.level(matrix)
        precondition = _Preconditioner(level)
        found = spectrum(matrix.__matmul__, precondition, diagonal)
        print(found)
        self.counts.iterations += found.steps
        counts = self.counts

        def solve(rhs: Floats) -> Floats:
            for start in range(0, rhs.shape[1], COLUMNS):
                part = slice(start, start + COLUMNS)
                done = solve_in_energy(matrix.__matmul__, precondition, rhs[:, part], found.least)
                counts.iterations += done.columns
                print(done.steps, done.columns, rhs.shape)
                rhs[:, part] = done.x
            return rhs

        return solve


class _Preconditioner:
    """M^-1 r in single precision, with columns brought into its range."""

    def __init__(self, level: Level) -> None:
        self._level = level

    def __call__(self, rhs: Floats) -> Floats:
        size = np.abs(rhs).max(axis=0)
        size[~(size > 0.0)] = 1.0
        return self._level.solve((rhs / size).astype(np.float32)) * size


def whole(pattern: LowerPattern, values: Floats) -> sp.csr_array:
    """The matrix (n, n) of a lower triangle."""
    n = pattern.n
    indices, indptr = pattern.indices.astype(np.int32), pattern.indptr
    strict = values.copy()
    strict[indptr[:-1]] = 0.0
    upper = sp.csr_array((values, indices, indptr), shape=(n, n))
    lower = sp.csc_array((strict, indices, indptr), shape=(n, n)).tocsr()
    matrix = sp.csr_array(upper + lower)
    matrix.sort_indices()
    return matrix
