"""What geoident asks of a sparse direct solver.

A symmetric positive definite matrix is given by its lower triangle in compressed columns, rows
ascending and the diagonal first in every column, already in a fill-reducing order (see
`geoident.fem.ordering`): solvers must not reorder it. The three steps are separate because their
costs are: `Solver.analyse` once per pattern, `SymbolicFactorization.factorize` once per stage and
parameter vector, `Factor.solve` for many right-hand sides at once.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

from geoident.model.arrays import Floats, Ints


@dataclass
class SolverCounts:
    """Work done by a solver. The only mutable thing that travels with it.

    Args:
        analyses: patterns analysed.
        factorizations: numeric factorizations, failed ones included.
        solves: right-hand sides solved.
    """

    analyses: int = 0
    factorizations: int = 0
    solves: int = 0


@dataclass(frozen=True)
class LowerPattern:
    """Pattern of the lower triangle of a symmetric matrix, by compressed columns.

    Args:
        indptr: (n + 1,) starts of the columns.
        indices: (nnz,) row of each entry, ascending within a column, the diagonal entry first.
    """

    indptr: Ints
    indices: Ints

    @property
    def n(self) -> int:
        """Number of unknowns."""
        return int(self.indptr.shape[0]) - 1


class Factor(Protocol):
    """A factorized matrix. Valid until its analysis factorizes again."""

    @property
    def valid(self) -> bool:
        """Whether it can still solve."""

    def solve(self, rhs: Floats) -> Floats:
        """Solutions (n, k) for right-hand sides (n, k); counts k solves."""


class SymbolicFactorization(Protocol):
    """A pattern that has been analysed."""

    def factorize(self, values: Floats) -> Factor:
        """Factorize the matrix with these values (nnz,).

        Raises `NotPositiveDefinite` with the index of an unknown where it can be told.
        """


class Solver(Protocol):
    """A sparse direct solver."""

    @property
    def name(self) -> str:
        """Name for `geoident doctor`: ``pardiso``, ``cholmod`` or ``splu``."""

    @property
    def counts(self) -> SolverCounts:
        """What has been done so far with this solver."""

    def analyse(self, pattern: LowerPattern) -> SymbolicFactorization:
        """Prepare for matrices of this pattern; counts one analysis."""


class NotPositiveDefinite(ArithmeticError):
    """A matrix that should be positive definite is not."""

    def __init__(self, unknown: int | None = None) -> None:
        self.unknown = unknown
        super().__init__("the matrix is not positive definite")
