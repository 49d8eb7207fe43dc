"""Memory that is used again: getting fresh pages takes a quarter of a factorization."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from geoident.fem.solvers.fronts.blas import Dense

SPARE = 3
"""Blocks that are kept: those of two factors and of stacks."""


class Memory:
    """Blocks of memory for the factorizations of a solver."""

    def __init__(self) -> None:
        self._spare: list[Dense] = []

    def take(self, size: int, dtype: npt.DTypeLike) -> Dense:
        """At least so many numbers, not set: a block that was given back, or a new one.

        A block that is more than twice as large is left for what needs it.
        """
        for k, block in enumerate(self._spare):
            if block.dtype == dtype and size <= block.size <= 2 * size:
                return self._spare.pop(k)
        # Those that are too small have served their time; they go before more is asked for.
        self._spare = [block for block in self._spare if block.size > 2 * size]
        return np.empty(size, dtype=dtype)

    def give(self, *blocks: Dense) -> None:
        """Give back blocks that nobody uses any more; the largest are kept."""
        found = sorted([*self._spare, *blocks], key=lambda block: -block.nbytes)
        self._spare = found[:SPARE]
