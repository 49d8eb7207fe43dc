"""Conjugate gradients, preconditioned on several levels: for matrices beyond the memory.

A factor of a million unknowns in space takes 10 GB and grows with n^(4/3), the operations with n^2;
the matrix and its levels take two, and everything grows with n. All right-hand sides go
together: one product with the matrix for all (`conjugate_gradients`). The coarsest level is
factorized by a direct solver (`levels`).

Where conjugate gradients do not come to the end (ground that is all but incompressible, slivers),
the matrix is factorized if its factor fits the memory, and refused if not.
"""

from __future__ import annotations

from functools import cached_property

import numpy as np
import scipy.sparse as sp

from geoident.errors import ModelError
from geoident.fem.solvers.conjugate_gradients import (
    Product,
    Stagnation,
    least_eigenvalue,
    solve_in_energy,
)
from geoident.fem.solvers.direct import LowerPattern, Solve, SolverCounts, SymbolicFactorization
from geoident.fem.solvers.factor_cost import factor_cost
from geoident.fem.solvers.kept_solutions import KeptSolutions
from geoident.fem.solvers.levels import Analyse, Hierarchy
from geoident.model.arrays import Floats
from geoident.processors import memory_limit

BLOCK = 32
"""Right-hand sides that go together; bounds the memory (50 bytes an unknown each)."""

BYTES = 9.5
"""Memory for an entry of a factor, with what goes with it."""


class IterativeFactorization(SymbolicFactorization):
    """The levels of a pattern, as far as they do not depend on values.

    Args:
        pattern: the pattern, whose unknowns have places.
        counts: where to count.
        direct: factorizes the coarsest level, and where conjugate gradients do not come to the end.
        kept: solutions of before.
    """

    def __init__(
        self, pattern: LowerPattern, counts: SolverCounts, direct: Analyse, kept: KeptSolutions
    ) -> None:
        super().__init__(pattern, counts)
        assert pattern.places is not None
        self.hierarchy, self.kept, self._direct = Hierarchy(pattern.places, direct), kept, direct
        self._instead: SymbolicFactorization | None = None

    def _factorize(self, values: Floats, diagonal: Floats) -> Solve:
        if self._instead is None:  # else iterations would not come to the end this time either
            try:
                return _Iterations(self, values, diagonal)
            except Stagnation:
                pass
        return self.factorize_instead(values)

    def factorize_instead(self, values: Floats) -> Solve:
        """A factorization of values (nnz,) with which conjugate gradients do not come to the end.

        Raises:
            ModelError: it would not fit the memory.
        """
        if self._instead is None:
            assert self.pattern.places is not None
            needed = factor_cost(self.pattern, self.pattern.places.node).entries * BYTES
            if needed > memory_limit():
                msg = "conjugate gradients do not come to the solution: ground is all but "
                msg += "incompressible, or elements are nearly flat; a factorization would take "
                msg += f"{needed / 1e9:.1f} GB of memory"
                hint = "look for moduli near a Poisson's ratio of 0.5 and for slivers in the mesh, "
                raise ModelError(msg, hint + "or take a coarser mesh or more memory")
            self._instead = self._direct(self.pattern, SolverCounts())
        return self._instead.factorize(values).solve


class _Iterations:
    """Conjugate gradients with one matrix, as a `Solve`; what took long is kept and found again.

    Args:
        analysis: of its pattern.
        values: (nnz,) of the lower triangle.
        diagonal: (n,) of the matrix.

    Raises:
        NotPositiveDefinite: the matrix is not.
        Stagnation: conjugate gradients do not come to the end.
    """

    def __init__(self, analysis: IterativeFactorization, values: Floats, diagonal: Floats) -> None:
        self._analysis, self._kept, self._counts = analysis, analysis.kept, analysis.counts
        self._matrix = analysis.pattern.whole(values)
        self._name = self._kept.name(analysis.pattern.indptr, analysis.pattern.indices, values)
        self._instead: Solve | None = None
        product = self._matrix.__matmul__
        self._least = self._kept.find_or_compute(
            self._name,
            lambda: np.array(least_eigenvalue(product, self._precondition, diagonal, self._counts)),
        )

    @cached_property
    def _precondition(self) -> Product:
        """M^-1 r (n, k), found in single precision; made when something must be solved."""
        cycle = self._analysis.hierarchy.level(self._matrix)

        def precondition(rhs: Floats) -> Floats:
            size = np.abs(rhs).max(axis=0)  # brings columns into the range of single precision
            size[~(size > 0.0)] = 1.0
            return np.asarray(cycle((rhs / size).astype(np.float32)) * size)

        return precondition

    def __call__(self, rhs: Floats) -> Floats:
        """Solutions in the place of right-hand sides (n, k)."""
        for start in range(0, rhs.shape[1], BLOCK):
            block = slice(start, start + BLOCK)
            rhs[:, block] = self._solve(rhs[:, block])
        return rhs

    def _solve(self, rhs: Floats) -> Floats:
        if self._instead is None:
            try:
                return self._kept.find_or_compute(
                    self._kept.name(rhs.T, of=self._name), lambda: self._iterate(rhs)
                )
            except Stagnation:
                self._instead = self._analysis.factorize_instead(lower_values(self._matrix))
        return self._instead(rhs)

    def _iterate(self, rhs: Floats) -> Floats:
        product, least = self._matrix.__matmul__, float(self._least)
        return solve_in_energy(product, self._precondition, rhs, least, self._counts)


def lower_values(matrix: sp.csr_array) -> Floats:
    """Values (nnz,) of the lower triangle of K (n, n) by columns: of the upper one by rows."""
    rows = np.repeat(np.arange(matrix.shape[0]), np.diff(matrix.indptr))
    return np.asarray(matrix.data[matrix.indices >= rows])
