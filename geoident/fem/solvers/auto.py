"""The choice among the solvers that are installed, by the work that a matrix takes."""

from __future__ import annotations

from collections.abc import Callable

from geoident.fem.solvers.direct import (
    LowerPattern,
    Solver,
    SolverCounts,
    SymbolicFactorization,
)
from geoident.fem.solvers.fronts.graph import node_graph
from geoident.fem.solvers.fronts.tree import assembly_tree, flops_at_most

LARGE_WORK = 4.0e10
"""Operations from which on our own solver, which takes all cores, is the faster one."""

KEEP_WORK = 3.0e9
"""Operations from which on it pays to keep what lasts from stage to stage."""

PLANE = 18.0
"""Entries of a column of the lower triangle, on average, of which plane elements have fewer."""


class AutoSolver:
    """Large matrices, and those of which parts last, go to one solver, the others to another.

    Args:
        small: makes the solver of the small ones; it is given the counts.
        large: makes the solver of the large ones.
    """

    name = "auto"
    keeps_from = KEEP_WORK

    def __init__(
        self, small: Callable[[SolverCounts], Solver], large: Callable[[SolverCounts], Solver]
    ) -> None:
        self.counts = SolverCounts()
        self._small, self._large = small(self.counts), large(self.counts)

    def analyse(self, pattern: LowerPattern) -> SymbolicFactorization:
        """Prepare for matrices of this pattern, by the solver that is the faster for them."""
        if pattern.lasting or _work(pattern) >= LARGE_WORK:
            return self._large.analyse(pattern)
        return self._small.analyse(pattern)


def _work(pattern: LowerPattern) -> float:
    """Operations of a factorization; 0 where they are surely few, since counting takes longer."""
    if flops_at_most(pattern.n, plane=len(pattern.indices) < PLANE * pattern.n) < LARGE_WORK:
        return 0.0
    graph = node_graph(pattern.indptr, pattern.indices, pattern.n)
    return sum(front.flops for front in assembly_tree(graph))
