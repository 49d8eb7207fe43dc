"""The choice among the solvers that are installed, by the work and the memory of a matrix."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from geoident.fem.solvers.direct import (
    LowerPattern,
    Solver,
    SolverCounts,
    SymbolicFactorization,
)
from geoident.fem.solvers.fronts.single import single_pays
from geoident.fem.solvers.fronts.tree import entries_at_most, flops_at_most
from geoident.fem.solvers.kept_solutions import KeepsSolutions, SolutionStore
from geoident.fem.solvers.memory_limit import memory_limit

LARGE_WORK = 4.0e10
"""Operations from which on our own solver, which takes all cores, is the faster one."""

KEEP_WORK = 3.0e9
"""Operations from which on it pays to keep what lasts from stage to stage."""

PLANE = 18.0
"""Entries of a column of the lower triangle, on average, of which plane elements have fewer."""

ITERATED = 16 * 7 * 8 * 4.0
"""Operations of conjugate gradients for each entry of the lower triangle.

16 steps with 7 products each for 8 right-hand sides, each entry used twice.
"""

DENSE = 50.0
"""Operations on dense matrices, on two cores, in a third of the time of one of those products.

Iterations are preferred only where they are three times as fast: a factor answers
further right-hand sides sooner, and to the last digit.
"""

FACTOR_SHARE = 0.4
"""Part of the memory that a factor may take."""

BYTES = 9.5
"""Memory for an entry of a factor in double precision, with what goes with it."""


@dataclass(frozen=True)
class FactorSize:
    """What a matrix takes, told from its pattern.

    Args:
        work: operations of a factorization.
        entries: of the factor.
        nonzeros: of the lower triangle.
        lasting: parts of it last from stage to stage.
        places: whether its unknowns have places in a mesh.
    """

    work: float
    entries: int
    nonzeros: int
    lasting: bool = False
    places: bool = False


NOTHING = FactorSize(0.0, 0, 0)


def factor_bytes(size: FactorSize) -> float:
    """Memory of a factor."""
    work = 0.0 if size.lasting else size.work
    return size.entries * BYTES * (0.5 if single_pays(work, size.entries) else 1.0)


def fits(size: FactorSize) -> bool:
    """Whether a factor leaves room for the rest."""
    return factor_bytes(size) <= FACTOR_SHARE * memory_limit()


def is_beyond(size: FactorSize) -> bool:
    """Whether a matrix is better solved by conjugate gradients than factorized."""
    if not size.places or size.work < LARGE_WORK:
        return False
    faster = not size.lasting and size.work > DENSE * ITERATED * size.nonzeros
    return faster or not fits(size)


class AutoSolver:
    """Large matrices, and those of which parts last, go to one solver, the others to another.

    Args:
        small: makes the solver of the small ones; it is given the counts.
        large: makes the solver of the large ones.
        beyond: makes the solver of those whose factor takes too much time or memory.
    """

    name = "auto"
    keeps_from = KEEP_WORK

    def __init__(
        self,
        small: Callable[[SolverCounts], Solver],
        large: Callable[[SolverCounts], Solver],
        beyond: Callable[[SolverCounts], Solver],
    ) -> None:
        self.counts = SolverCounts()
        self._small, self._large = small(self.counts), large(self.counts)
        self._beyond = beyond(self.counts)

    def keep_solutions(self, store: SolutionStore | None) -> None:
        """Look solutions up in a store first, and put there what takes long; None for no longer."""
        if isinstance(self._beyond, KeepsSolutions):
            self._beyond.keep_solutions(store)

    def analyse(self, pattern: LowerPattern) -> SymbolicFactorization:
        """Prepare for matrices of this pattern, by the solver that is the best for them."""
        if pattern.lasting and fits(_at_most(pattern)):
            return self._large.analyse(pattern)  # whatever the exact count would be
        size = size_of(pattern)
        if is_beyond(size):
            return self._beyond.analyse(pattern)
        if size.lasting or size.work >= LARGE_WORK:
            return self._large.analyse(pattern)
        return self._small.analyse(pattern)


def size_of(pattern: LowerPattern) -> FactorSize:
    """What a matrix takes; no work where that is surely little, since counting takes longer."""
    nonzeros, lasting = len(pattern.indices), pattern.lasting > 0
    places = pattern.places is not None
    if flops_at_most(pattern.n, plane=nonzeros < PLANE * pattern.n) < LARGE_WORK:
        return FactorSize(0.0, 0, nonzeros, lasting, places)
    fronts = pattern.fronts
    work = sum(front.flops for front in fronts)
    entries = sum(f.width * (f.width + 1) // 2 + f.width * f.height for f in fronts)
    return FactorSize(work, entries, nonzeros, lasting, places)


def _at_most(pattern: LowerPattern) -> FactorSize:
    """A size that a matrix of which parts last does not exceed; nothing is counted."""
    return FactorSize(0.0, entries_at_most(pattern.n), len(pattern.indices), lasting=True)
