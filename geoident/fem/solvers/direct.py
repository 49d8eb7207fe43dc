"""What geoident asks of a sparse direct solver, and what all of them share.

A symmetric positive definite matrix is given by its lower triangle in compressed columns, rows
ascending and the diagonal first in every column, already in a fill-reducing order (see
`geoident.fem.solvers.ordering`): solvers must not reorder it. The three steps are separate because
their costs are: `Solver.analyse` once per pattern, `SymbolicFactorization.factorize` once per stage
and parameter vector, `Factor.solve` for many right-hand sides at once.

Shared are checks, counts, the lifetime of a factor and a test of its pivots.
"""

from __future__ import annotations

import weakref
from abc import ABC, abstractmethod
from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from typing import Protocol

import numpy as np

from geoident.fem.solvers.fronts.graph import NodeGraph, node_graph
from geoident.fem.solvers.fronts.tree import Front, assembly_tree
from geoident.model.arrays import Floats, Ints


@dataclass
class SolverCounts:
    """Work done by a solver. The only mutable thing that travels with it.

    Args:
        analyses: patterns analysed.
        factorizations: numeric factorizations, failed ones included.
        solves: right-hand sides solved.
        flops: multiplications and additions in factorizations, where the solver counts them.
        kept_flops: those that were not needed again, since parts of a factor were kept.
        refinements: steps of refinement of solutions in single precision, column by column.
        iterations: steps of conjugate gradients, column by column.
        passed: entries of factors that solutions went through, once for all columns of a call;
            where the solver counts them.
    """

    analyses: int = 0
    factorizations: int = 0
    solves: int = 0
    flops: float = 0.0
    kept_flops: float = 0.0
    refinements: int = 0
    iterations: int = 0
    passed: float = 0.0


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
        lasting: number of unknowns, the first, whose equations are mostly the same in the matrices
            of other patterns too: a solver may keep what it finds of them.
        names: (n,) names of the unknowns that are the same in all patterns; None for none.
        places: of the unknowns in the mesh; None if they have none.
    """

    indptr: Ints
    indices: Ints
    lasting: int = 0
    names: Ints | None = None
    places: UnknownPlaces | None = None

    @property
    def n(self) -> int:
        """Number of unknowns."""
        return int(self.indptr.shape[0]) - 1

    @cached_property
    def graph(self) -> NodeGraph:
        """The graph by nodes."""
        return node_graph(self.indptr, self.indices, self.n)

    @cached_property
    def fronts(self) -> list[Front]:
        """The fronts that eliminate it, children before their parents."""
        return assembly_tree(self.graph)


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

    @property
    def keeps_from(self) -> float:
        """Operations of a factorization from which on it keeps what it finds of unknowns that last.

        Infinite if it never does; see `LowerPattern.lasting`.
        """

    def analyse(self, pattern: LowerPattern) -> SymbolicFactorization:
        """Prepare for matrices of this pattern; counts one analysis."""


class NotPositiveDefinite(ArithmeticError):
    """A matrix that should be positive definite is not."""

    def __init__(self, unknown: int | None = None) -> None:
        self.unknown = unknown
        super().__init__("the matrix is not positive definite")


SINGULAR = 1e-13
"""A pivot below this part of the diagonal entry that it came from is rounding, not stiffness."""

LARGE = 250_000
"""Entries of a matrix from which on a factor's memory is given back as soon as nobody uses it.

A staged model has one analysis for every stage; if each kept its last factor, the memory of a
model would grow with the number of stages.
"""

Solve = Callable[[Floats], Floats]
"""Solutions (n, k) for right-hand sides (n, k) in Fortran order, k >= 1; may overwrite them."""


class SolveInParts(ABC):
    """How to solve where the first unknowns were eliminated by themselves (a `Solve`)."""

    @property
    @abstractmethod
    def n_first(self) -> int:
        """Number of these unknowns."""

    @abstractmethod
    def __call__(self, rhs: Floats) -> Floats:
        """Solutions (n, k) for right-hand sides (n, k), which may be overwritten."""

    @abstractmethod
    def rest(self, rhs: Floats) -> Floats:
        """Solutions (n - n_first, k) of the others, for forces (n - n_first, k) on these alone."""

    @abstractmethod
    def first(self, rest: Floats) -> Floats:
        """The first unknowns (n_first, k) that follow the others (n - n_first, k): no forces."""


class DirectFactor:
    """A factorized matrix. Valid until its analysis factorizes again."""

    def __init__(self, analysis: DirectAnalysis, solve: Solve) -> None:
        self._analysis = analysis
        self._number = analysis.factorized
        self._solve = solve
        if len(analysis.pattern.indices) >= LARGE:
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
        self._check(rhs, self._analysis.pattern.n)
        self._analysis.counts.solves += rhs.shape[1]
        if rhs.size == 0:
            return np.zeros(rhs.shape)
        return self._solve(np.array(rhs, dtype=np.float64, order="F"))

    @property
    def n_first(self) -> int:
        """Unknowns, the first, that can be left out where no forces are on them; 0 for none."""
        return self._solve.n_first if isinstance(self._solve, SolveInParts) else 0

    def solve_rest(self, rhs: Floats) -> Floats:
        """Solve for the unknowns that are not the first, where forces act on these alone.

        Args:
            rhs: (n - n_first, k) forces, not modified.

        Returns:
            (n - n_first, k) of the solutions.

        Raises:
            RuntimeError: the analysis has factorized again since.
        """
        self._check(rhs, self._analysis.pattern.n - self.n_first)
        assert isinstance(self._solve, SolveInParts)
        self._analysis.counts.solves += rhs.shape[1]
        return self._solve.rest(np.array(rhs, dtype=np.float64, order="F"))

    def first_of(self, rest: Floats) -> Floats:
        """The first unknowns (n_first, k) of solutions, from the others (n - n_first, k).

        Raises:
            RuntimeError: the analysis has factorized again since.
        """
        self._check(rest, self._analysis.pattern.n - self.n_first)
        assert isinstance(self._solve, SolveInParts)
        return self._solve.first(rest)

    def _check(self, rhs: Floats, n: int) -> None:
        if not self.valid:
            raise RuntimeError("this factor was replaced by a later factorization")
        if rhs.ndim != 2 or rhs.shape[0] != n:
            raise ValueError(f"right-hand sides have shape {rhs.shape}, not ({n}, k)")


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
