"""The choice between factorization and iterations, by the size of a matrix and of its factor.

It depends on the problem alone, so that a case takes the same way on every computer with the same
solvers.
"""

from __future__ import annotations

from geoident.fem.solvers.direct import LowerPattern, Solver, SymbolicFactorization
from geoident.fem.solvers.factor_cost import FactorCost, factor_cost
from geoident.fem.solvers.kept_solutions import KeepsSolutions, SolutionStore

COUNTED = 50_000
"""Unknowns below which a factor is always the better way: its cost is not counted."""

ITERATED = 16 * 7 * 8 * 4.0
"""Operations of conjugate gradients for each entry of the lower triangle.

16 steps with 7 products each for 8 right-hand sides, each entry used twice.
"""

DENSE = 50.0
"""Operations on dense matrices, on two cores, in a third of the time of one of those products.

Iterations are preferred only where they are three times as fast: a factor answers
further right-hand sides sooner, and to the last digit.
"""

MOST_ENTRIES = 400_000_000
"""Entries of a factor that is made without being asked for: with them it takes some 3.5 GB."""


def is_beyond(cost: FactorCost, nonzeros: float) -> bool:
    """Whether a matrix is better solved by conjugate gradients than factorized.

    Args:
        cost: of a factorization.
        nonzeros: entries of its lower triangle.
    """
    return cost.flops > DENSE * ITERATED * nonzeros or cost.entries > MOST_ENTRIES


class AutoSolver:
    """Matrices whose factor takes too much go to one solver, all others to another.

    Args:
        direct: factorizes.
        beyond: solves where a factor takes too much time or memory; with the same counts.
    """

    name = "auto"

    def __init__(self, direct: Solver, beyond: Solver) -> None:
        self.counts = direct.counts
        self._direct, self._beyond = direct, beyond

    def keep_solutions(self, store: SolutionStore | None) -> None:
        """Look solutions up in a store first, and put there what takes long; None for no longer."""
        if isinstance(self._beyond, KeepsSolutions):
            self._beyond.keep_solutions(store)

    def analyse(self, pattern: LowerPattern) -> SymbolicFactorization:
        """Prepare for matrices of this pattern, by the solver that is the better for them."""
        if pattern.places is not None and pattern.n >= COUNTED:
            node = pattern.places.dofs // pattern.places.points.shape[1]
            if is_beyond(factor_cost(pattern, node), len(pattern.indices)):
                return self._beyond.analyse(pattern)
        return self._direct.analyse(pattern)
