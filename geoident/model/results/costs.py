"""What a computation cost, counted."""

from __future__ import annotations

from dataclasses import dataclass, replace


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

    def since(self, before: Counts) -> Counts:
        """What a model has cost since then; it analyses a pattern once, whenever that was."""
        return replace(self - before, analyses=self.analyses)

    def joined(self, other: Counts) -> Counts:
        """Both together, of one model: a pattern that both used was analysed once."""
        return replace(self + other, analyses=max(self.analyses, other.analyses))


COUNTS = ("evaluations", "analyses", "factorizations", "solves", "iterations")

NO_COST = Counts()
