"""What a computation cost, counted."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Counts:
    """What the computation cost.

    Args:
        evaluations: parameter vectors at which the model was evaluated.
        analyses: symbolic analyses of a sparsity pattern.
        factorizations: numeric factorizations.
        solves: right-hand sides solved.
        iterations: steps of conjugate gradients for them, where they take the place of a factor.
    """

    evaluations: int = 0
    analyses: int = 0
    factorizations: int = 0
    solves: int = 0
    iterations: int = 0

    def __add__(self, other: Counts) -> Counts:
        """Both together."""
        return Counts(*(getattr(self, name) + getattr(other, name) for name in COUNTS))

    def __sub__(self, other: Counts) -> Counts:
        """What came since the other."""
        return Counts(*(getattr(self, name) - getattr(other, name) for name in COUNTS))


COUNTS = ("evaluations", "analyses", "factorizations", "solves", "iterations")

NO_COST = Counts()
