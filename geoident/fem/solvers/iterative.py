"""Conjugate gradients, preconditioned on several levels, as a `Solver`: beyond the memory.

A factor of a million unknowns in space takes 10 GB and grows with n^(4/3), the operations with n^2;
the matrix and its levels take two, and everything grows with n. All right-hand sides go
together: one product with the matrix for all (`multilevel.energy`). The coarsest level is
factorized by a direct solver (`multilevel.cycle`).

Where conjugate gradients do not come to the end (ground that is all but incompressible, slivers),
the matrix is factorized if its factor fits the memory, and refused if not.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import cached_property
from time import monotonic

import numpy as np
import scipy.sparse as sp

from geoident.errors import ModelError
from geoident.fem.solvers.direct import (
    DirectAnalysis,
    LowerPattern,
    Solve,
    Solver,
    SolverCounts,
    SymbolicFactorization,
)
from geoident.fem.solvers.factor_cost import factor_cost
from geoident.fem.solvers.kept_solutions import KeptSolutions, SolutionStore
from geoident.fem.solvers.memory_limit import memory_limit
from geoident.fem.solvers.multilevel.cycle import CycleLevel, Hierarchy
from geoident.fem.solvers.multilevel.energy import Stagnation, solve_in_energy, spectrum
from geoident.model.arrays import Floats

BLOCK = 32
"""Right-hand sides that go together; bounds the memory."""

SMALL = 3_000
"""Unknowns up to which a matrix is factorized: levels would save nothing."""

BYTES = 9.5
"""Memory for an entry of a factor, with what goes with it."""


class IterativeSolver:
    """Conjugate gradients on several levels as a `Solver`.

    Matrices without places in a mesh, and small ones, are factorized.

    Args:
        direct: makes solvers that factorize, with the counts that it is given.
        counts: where to count; its own if not given.
        few: unknowns up to which a matrix is factorized.
    """

    name = "iterative"

    def __init__(
        self,
        direct: Callable[[SolverCounts], Solver],
        counts: SolverCounts | None = None,
        *,
        few: int = SMALL,
    ) -> None:
        self.counts = counts if counts is not None else SolverCounts()
        self._few, self._direct = few, direct(self.counts)
        self._inner = direct(SolverCounts())  # of factors that nobody asked for
        self._kept = KeptSolutions()

    def keep_solutions(self, store: SolutionStore | None) -> None:
        """Look solutions up in a store first, and put there what takes long; None for no longer."""
        self._kept.store = store

    def analyse(self, pattern: LowerPattern) -> SymbolicFactorization:
        """Prepare for matrices of this pattern."""
        if pattern.places is None or pattern.n <= self._few:
            return self._direct.analyse(pattern)
        hierarchy = Hierarchy(pattern.places, self._inner)
        return IterativeAnalysis(pattern, self.counts, hierarchy, self._kept, self._inner)


class IterativeAnalysis(DirectAnalysis):
    """The levels of a pattern, as far as they do not depend on values.

    Args:
        pattern: the pattern.
        counts: where to count.
        hierarchy: its levels.
        kept: solutions of before.
        direct: factorizes where conjugate gradients do not come to the end.
    """

    def __init__(
        self,
        pattern: LowerPattern,
        counts: SolverCounts,
        hierarchy: Hierarchy,
        kept: KeptSolutions,
        direct: Solver,
    ) -> None:
        super().__init__(pattern, counts)
        self.hierarchy, self.kept, self._direct = hierarchy, kept, direct
        self._instead: SymbolicFactorization | None = None

    def _release(self) -> None:
        """The levels die with their last user."""

    def _factorize(self, values: Floats, diagonal: Floats) -> Solve:
        if self._instead is None:  # else iterations would not come to the end this time either
            try:
                return _Iterations(self, values, diagonal)
            except Stagnation as failure:
                self.counts.iterations += failure.columns
        return self.factorize_instead(values)

    def factorize_instead(self, values: Floats) -> Solve:
        """A factorization, where conjugate gradients do not come to the end.

        Raises:
            ModelError: it would not fit the memory.
        """
        if self._instead is None:
            places = self.pattern.places
            assert places is not None
            cost = factor_cost(self.pattern, places.dofs // places.points.shape[1])
            needed = cost.entries * BYTES
            if needed > memory_limit():
                msg = "conjugate gradients do not come to the solution: ground is all but "
                msg += "incompressible, or elements are nearly flat; a factorization would take "
                msg += f"{needed / 1e9:.1f} GB of memory"
                hint = "look for moduli near a Poisson's ratio of 0.5 and for slivers in the mesh, "
                raise ModelError(msg, hint + "or take a coarser mesh or more memory")
            self._instead = self._direct.analyse(self.pattern)
        return self._instead.factorize(values).solve


class _Iterations:
    """Conjugate gradients with one matrix, as a `Solve`; what took long is kept and found again.

    Iterations that are found again are counted, too, so that a run that goes on has the counts of
    one that was never cut short.

    Args:
        analysis: of its pattern.
        values: (nnz,) of the lower triangle.
        diagonal: (n,) of the matrix.

    Raises:
        NotPositiveDefinite: the matrix is not.
        Stagnation: conjugate gradients do not come to the end.
    """

    def __init__(self, analysis: IterativeAnalysis, values: Floats, diagonal: Floats) -> None:
        self._analysis, self._kept = analysis, analysis.kept
        self._matrix = whole_matrix(analysis.pattern, values)
        self._name = self._kept.name(analysis.pattern, values)
        self._instead: Solve | None = None
        known = self._kept.find(self._name)
        if known is None:
            start_time = monotonic()
            extremes = spectrum(self._matrix.__matmul__, self._precondition, diagonal)
            known = {"least": np.array(extremes.least), "steps": np.array(float(extremes.steps))}
            self._kept.add(self._name, monotonic() - start_time, known)
        self._least = float(known["least"])
        analysis.counts.iterations += int(known["steps"])

    @cached_property
    def _precondition(self) -> _Preconditioner:
        """Made when something must be solved."""
        return _Preconditioner(self._analysis.hierarchy.level(self._matrix))

    def __call__(self, rhs: Floats) -> Floats:
        """Solutions in the place of right-hand sides (n, k)."""
        for start in range(0, rhs.shape[1], BLOCK):
            block = slice(start, start + BLOCK)
            rhs[:, block] = self._solve(rhs[:, block])
        return rhs

    def _solve(self, rhs: Floats) -> Floats:
        if self._instead is None:
            try:
                return self._iterate(rhs)
            except Stagnation as failure:
                self._analysis.counts.iterations += failure.columns
                self._instead = self._analysis.factorize_instead(lower_values(self._matrix))
        return self._instead(rhs)

    def _iterate(self, rhs: Floats) -> Floats:
        name = self._kept.of(self._name, rhs)
        known = self._kept.find(name)
        if known is None:
            start_time = monotonic()
            product = self._matrix.__matmul__
            solution = solve_in_energy(product, self._precondition, rhs, self._least)
            known = {"x": solution.x, "steps": np.array(float(solution.columns))}
            self._kept.add(name, monotonic() - start_time, known)
        self._analysis.counts.iterations += int(known["steps"])
        return known["x"]


class _Preconditioner:
    """M^-1 r (n, k), found in single precision; columns are brought into its range."""

    def __init__(self, level: CycleLevel) -> None:
        self._level = level

    def __call__(self, rhs: Floats) -> Floats:
        size = np.abs(rhs).max(axis=0)
        size[~(size > 0.0)] = 1.0
        return np.asarray(self._level.solve((rhs / size).astype(np.float32)) * size)


def whole_matrix(pattern: LowerPattern, values: Floats) -> sp.csr_array:
    """The matrix (n, n) of a lower triangle (nnz,), rows ascending, stored zeros with it."""
    n, indices, indptr = pattern.n, pattern.indices.astype(np.int32), pattern.indptr
    below = np.ones(len(values), dtype=bool)
    below[indptr[:-1]] = False
    strict = values[below], indices[below], (indptr - np.arange(n + 1)).astype(np.int32)
    lower = sp.csr_array(sp.csc_array(strict, shape=(n, n)))
    # a row is one of the strict lower triangle, and then a column of the lower one
    rows = lower.indptr + indptr
    before = np.arange(len(lower.data)) + np.repeat(indptr[:-1], np.diff(lower.indptr))
    after = np.arange(len(values)) + np.repeat(lower.indptr[1:], np.diff(indptr))
    data, columns = np.empty(rows[-1]), np.empty(rows[-1], dtype=np.int32)
    data[before], columns[before] = lower.data, lower.indices
    data[after], columns[after] = values, indices
    return sp.csr_array((data, columns, rows.astype(np.int32)), shape=(n, n))


def lower_values(matrix: sp.csr_array) -> Floats:
    """Values (nnz,) of the lower triangle of K (n, n) by columns: of the upper one by rows."""
    rows = np.repeat(np.arange(matrix.shape[0]), np.diff(matrix.indptr))
    return np.asarray(matrix.data[matrix.indices >= rows])
