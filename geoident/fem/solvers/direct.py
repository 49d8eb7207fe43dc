"""What geoident asks of a sparse direct solver, and what all of them share.

A symmetric positive definite matrix is given by its lower triangle in compressed columns, rows
ascending and the diagonal first in every column, already in a fill-reducing order (see
`geoident.fem.solvers.ordering`): solvers must not reorder it. The three steps are separate because
their costs are: `Solver.analyse` once per pattern, `SymbolicFactorization.factorize` once per stage
and parameter vector, `Factor.solve` for many right-hand sides at once.

Shared are checks, counts, the lifetime of a factor and a test of its pivots.
"""

from __future__ import annotations

import math
import weakref
from abc import ABC, abstractmethod
from collections.abc import Callable
from dataclasses import dataclass
from typing import Protocol

import numpy as np

from geoident.model.arrays import Floats, Ints


@dataclass
class SolverCounts:
    """Work done by a solver. The only mutable thing that travels with it.

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


@dataclass(frozen=True)
class LowerPattern:
    """Pattern of the lower triangle of a symmetric matrix, by compressed columns.

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
        """Name as users write it, such as ``cholmod``."""

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


SINGULAR = 1e-13
"""A pivot below this part of the diagonal entry that it came from is rounding, not stiffness."""

RELEASED_ENTRIES = 250_000
"""Entries of a matrix from which on a factor's memory is given back as soon as nobody uses it.

A staged model has one analysis for every stage; if each kept its last factor, the memory of a
model would grow with the number of stages.
"""

Solve = Callable[[Floats], Floats]
"""Solutions (n, k) for right-hand sides (n, k) in Fortran order, k >= 1; may overwrite them."""


class DirectFactor:
    """A factorized matrix. Valid until its analysis factorizes again."""

    def __init__(self, analysis: DirectAnalysis, solve: Solve) -> None:
        self._analysis = analysis
        self._number = analysis.factorized
        self._solve = solve
        if len(analysis.pattern.indices) >= RELEASED_ENTRIES:
            weakref.finalize(self, analysis.release, self._number).atexit = False

    @property
    def valid(self) -> bool:
        """Whether the analysis has not factorized again since."""
        return self._number == self._analysis.factorized

    def solve(self, rhs: Floats) -> Floats:
        """Solve for several right-hand sides at once.

        Args:
            rhs: (n, k) right-hand sides, not modified.

        Returns:
            (n, k) solutions.

        Raises:
            RuntimeError: the analysis has factorized again since.
        """
        n = self._analysis.pattern.n
        if not self.valid:
            raise RuntimeError("this factor was replaced by a later factorization")
        if rhs.ndim != 2 or rhs.shape[0] != n:
            raise ValueError(f"right-hand sides have shape {rhs.shape}, not ({n}, k)")
        self._analysis.counts.solves += rhs.shape[1]
        if rhs.size == 0:
            return np.zeros(rhs.shape)
        return self._solve(np.array(rhs, dtype=np.float64, order="F"))


class DirectAnalysis(ABC):
    """A pattern that has been analysed. Subclasses say how to factorize in `_factorize`.

    Args:
        pattern: the pattern.
        counts: where to count.
    """

    def __init__(self, pattern: LowerPattern, counts: SolverCounts) -> None:
        self.pattern = pattern
        self.counts = counts
        self.factorized = 0
        counts.analyses += 1

    def factorize(self, values: Floats) -> DirectFactor:
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
        self.factorized += 1
        self.counts.factorizations += 1
        diagonal = values[self.pattern.indptr[:-1]]
        check_pivots(diagonal, diagonal)
        if not np.isfinite(values).all():
            raise NotPositiveDefinite
        if self.pattern.n == 0:
            return DirectFactor(self, np.copy)
        return DirectFactor(self, self._factorize(values, diagonal))

    def release(self, number: int) -> None:
        """Give back the memory of a factor, known by its number, unless a later one replaced it."""
        if number == self.factorized:
            self._release()

    @abstractmethod
    def _release(self) -> None:
        """Give back the memory of the last factor; what the analysis found may stay."""

    @abstractmethod
    def _factorize(self, values: Floats, diagonal: Floats) -> Solve:
        """Factorize and return how to solve; the diagonal (n,) of the matrix is for the checks."""


def check_pivots(
    pivots: Floats,
    diagonal: Floats,
    unknowns: Ints | None = None,
    *,
    least: float | None = None,
) -> None:
    """Refuse a matrix with a pivot that is not clearly positive.

    Args:
        pivots: (n,) diagonal of D in L D L^T.
        diagonal: (n,) diagonal of the matrix, by unknown.
        unknowns: (n,) unknown that each pivot belongs to; None if they stand in order.
        least: part of the diagonal entry that a pivot must exceed; None for `SINGULAR`.

    Raises:
        NotPositiveDefinite: with the worst unknown.
    """
    scale = diagonal if unknowns is None else diagonal[unknowns]
    part = SINGULAR if least is None else least
    bad = np.flatnonzero(~(pivots > part * np.abs(scale)))
    if bad.size:
        first = int(bad[0])
        raise NotPositiveDefinite(first if unknowns is None else int(unknowns[first]))
