"""What the solving cost: counted by the solvers, asserted by tests, reported with results."""

from __future__ import annotations

from dataclasses import dataclass


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
