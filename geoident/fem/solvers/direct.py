"""Sparse symmetric matrices, and what all factorizations of them share.

A symmetric positive definite matrix is given by its lower triangle in compressed columns, rows
ascending and the diagonal first in every column, already in a fill-reducing order (see
`geoident.fem.solvers.ordering`): solvers must not reorder it. The three steps are separate because
their costs are: `Solver.analyse` once per pattern, `SymbolicFactorization.factorize` once per stage
and parameter vector, `Factor.solve` for many right-hand sides at once.
"""

from __future__ import annotations

import math
import weakref
from abc import ABC, abstractmethod
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import scipy.sparse as sp

from geoident.model.arrays import Floats, Ints

SINGULAR = 1e-13
"""A pivot below this part of the diagonal entry that it came from is rounding, not stiffness."""

RELEASED_ENTRIES = 250_000
"""Entries of a matrix from which on a factor's memory is given back as soon as nobody uses it.

A staged model has one analysis for every stage; if each kept its last factor, the memory of a
model would grow with the number of stages. Below, factors are small and made again sooner.
"""


@dataclass
class SolverCounts:
    """Work done by a solver.

    Args:
        analyses: patterns analysed.
        factorizations: numeric factorizations, failed ones included.
        solves: right-hand sides solved.
        iterations: steps of conjugate gradients, column by column.
    """

    analyses: int = 0
    factorizations: int = 0
    solves: int = 0
    iterations: int = 0


@dataclass(frozen=True, eq=False)
class UnknownPlaces:
    """Where the unknowns of a matrix stand in the mesh, for solvers of several levels.

    Args:
        dofs: (n,) degree of freedom of each unknown: node times dim, plus component.
        points: (n_nodes, dim) coordinates of the nodes.
        edges: (k, 3) nodes on edges of elements of second order, each with its two ends.
    """

    dofs: Ints
    points: Floats
    edges: Ints

    @property
    def dim(self) -> int:
        """Displacements of a node."""
        return int(self.points.shape[1])

    @property
    def node(self) -> Ints:
        """(n,) node of each unknown."""
        return self.dofs // self.dim


@dataclass(frozen=True)
class LowerPattern:
    """Pattern of the lower triangle of a symmetric matrix, by compressed columns.

    >>> pattern = LowerPattern(np.array([0, 2, 3]), np.array([0, 1, 1]))
    >>> pattern.whole(np.array([4.0, -1.0, 5.0])).toarray()
    array([[ 4., -1.],
           [-1.,  5.]])

    Args:
        indptr: (n + 1,) starts of the columns.
        indices: (nnz,) row of each entry, ascending within a column, the diagonal entry first.
        places: of the unknowns in the mesh; None if they have none.
    """

    indptr: Ints
    indices: Ints
    places: UnknownPlaces | None = None

    @property
    def n(self) -> int:
        """Number of unknowns."""
        return int(self.indptr.shape[0]) - 1

    @property
    def flops_at_most(self) -> float:
        """Operations that a factorization by nested dissection hardly exceeds.

        In cubes of quadratic elements they are 17 to 25 n^2, in squares up to 60 n^1.5. Columns of
        plane elements have fewer than 18 entries on average.
        """
        if len(self.indices) < 18 * self.n:
            return 60.0 * self.n * math.sqrt(self.n)
        return 25.0 * self.n * self.n

    def whole(self, below: Floats, above: Floats | None = None) -> sp.csr_array:
        """The matrix (n, n) with both triangles, rows ascending, stored zeros with it.

        Args:
            below: (nnz,) values K[i, j] of the entries of the pattern.
            above: (nnz,) values K[j, i]; None where K is symmetric.
        """
        n, indices, indptr = self.n, self.indices.astype(np.int32), self.indptr
        is_strict = np.ones(len(below), dtype=bool)
        is_strict[indptr[:-1]] = False
        starts = (indptr - np.arange(n + 1)).astype(np.int32)
        strict = sp.csr_array(
            sp.csc_array((below[is_strict], indices[is_strict], starts), shape=(n, n))
        )
        # A row of the matrix is one of the strict lower triangle, then a column of the pattern.
        left_starts = strict.indptr
        rows = left_starts + indptr
        data, columns = np.empty(rows[-1]), np.empty(rows[-1], dtype=np.int32)
        place = np.arange(strict.nnz) + np.repeat(indptr[:-1], np.diff(left_starts))
        data[place], columns[place] = strict.data, strict.indices
        del strict  # a third of the memory of all this
        place = np.arange(len(below)) + np.repeat(left_starts[1:], np.diff(indptr))
        data[place], columns[place] = below if above is None else above, indices
        return sp.csr_array((data, columns, rows.astype(np.int32)), shape=(n, n))


class NotPositiveDefinite(ArithmeticError):
    """A matrix that should be positive definite is not, or a general one is singular.

    Args:
        unknown: where it was noticed, if that can be told.
    """

    def __init__(self, unknown: int | None = None) -> None:
        self.unknown = unknown
        super().__init__("the matrix is not positive definite")


Solve = Callable[[Floats], Floats]
"""Solutions (n, k) for right-hand sides (n, k) in Fortran order, k >= 1; may overwrite them."""


class Factor:
    """A factorized matrix.

    Args:
        n: number of unknowns.
        counts: where to count.
        solve: solves.
        is_valid: whether it still can: an analysis may have memory for its last factor only.
    """

    def __init__(
        self, n: int, counts: SolverCounts, solve: Solve, is_valid: Callable[[], bool]
    ) -> None:
        self.n, self._counts, self._solve, self._is_valid = n, counts, solve, is_valid

    @property
    def valid(self) -> bool:
        """Whether it can still solve."""
        return self._is_valid()

    def solve(self, rhs: Floats) -> Floats:
        """Solutions (n, k) for right-hand sides (n, k), which are not modified.

        Raises:
            RuntimeError: the analysis has factorized again since.
        """
        if not self.valid:
            raise RuntimeError("this factor was replaced by a later factorization")
        if rhs.ndim != 2 or rhs.shape[0] != self.n:
            raise ValueError(f"right-hand sides have shape {rhs.shape}, not ({self.n}, k)")
        self._counts.solves += rhs.shape[1]
        if rhs.size == 0:
            return np.zeros(rhs.shape)
        return self._solve(np.array(rhs, dtype=np.float64, order="F"))


class SymbolicFactorization(ABC):
    """A pattern that has been analysed. Subclasses say how to factorize in `_factorize`.

    Args:
        pattern: the pattern, with at least one unknown.
        counts: where to count.
    """

    def __init__(self, pattern: LowerPattern, counts: SolverCounts) -> None:
        self.pattern, self.counts = pattern, counts
        self._last = 0  # number of the last factorization
        counts.analyses += 1

    def factorize(self, values: Floats) -> Factor:
        """Factorize the matrix with these values.

        Args:
            values: (nnz,) values of the lower triangle, not modified.

        Returns:
            The factor, valid until the next call.

        Raises:
            NotPositiveDefinite: the matrix is indefinite, or singular to working precision.
        """
        if values.shape != self.pattern.indices.shape:
            raise ValueError(f"{values.shape} values for {self.pattern.indices.shape} entries")
        number = self._last = self._last + 1
        self.counts.factorizations += 1
        diagonal = values[self.pattern.indptr[:-1]]
        check_pivots(diagonal, diagonal)
        if not np.isfinite(values).all():
            raise NotPositiveDefinite
        solve = self._factorize(values, diagonal)
        factor = Factor(self.pattern.n, self.counts, solve, lambda: number == self._last)
        if len(values) >= RELEASED_ENTRIES:
            weakref.finalize(factor, self._forget, number).atexit = False
        return factor

    def _forget(self, number: int) -> None:
        """Give back the memory of a factor, unless a later one replaced it."""
        if number == self._last:
            self.release()

    def release(self) -> None:  # noqa: B027  most keep nothing
        """Give back the memory of the last factor; what the analysis found may stay."""

    @abstractmethod
    def _factorize(self, values: Floats, diagonal: Floats) -> Solve:
        """Factorize and return how to solve; the diagonal (n,) of the matrix is for the checks."""


def check_pivots(pivots: Floats, diagonal: Floats) -> None:
    """Refuse a matrix with a pivot that is not clearly positive.

    Args:
        pivots: (n,) diagonal of D in L D L^T, by unknown.
        diagonal: (n,) diagonal of the matrix.

    Raises:
        NotPositiveDefinite: with the first unknown of such a pivot.
    """
    bad = np.flatnonzero(~(pivots > SINGULAR * np.abs(diagonal)))
    if bad.size:
        raise NotPositiveDefinite(int(bad[0]))
