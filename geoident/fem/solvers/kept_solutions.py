"""Solutions that took long, kept outside of the process: who is killed begins again where it was.

A march through a million unknowns takes minutes, and what a fit keeps of its work are whole
evaluations: one that is cut short at its end would be lost. Its solutions are not. They are found
by the bits of what they solve, so that whoever asks the same again gets the same bits back, and
nothing else is ever taken for them.
"""

from __future__ import annotations

from collections.abc import Mapping
from hashlib import blake2b
from typing import Protocol, runtime_checkable

import numpy as np

from geoident.fem.solvers.direct import LowerPattern
from geoident.model.arrays import Floats, Ints

_Arrays = Mapping[str, Floats]

WORTH = 5.0
"""Seconds from which on it pays to keep what was computed."""


class SolutionStore(Protocol):
    """Where solutions are kept: a file, or a dictionary in tests."""

    def find_solution(self, name: str) -> _Arrays | None:
        """What was put there under a name, bit by bit, or None."""

    def add_solution(self, name: str, arrays: _Arrays) -> None:
        """Put something there, if there is room.

        Args:
            name: under which it is found.
            arrays: (...) what it is.
        """


@runtime_checkable
class KeepsSolutions(Protocol):
    """A solver, or what solves by one, that can keep solutions."""

    def keep_solutions(self, store: SolutionStore | None) -> None:
        """Look solutions up in a store first, and put there what takes long; None for no longer."""


class KeptSolutions:
    """The store of a solver, if it was given one; shared by all that it has analysed.

    Attributes:
        store: the store, or None for none.
    """

    def __init__(self) -> None:
        self.store: SolutionStore | None = None

    def name(self, pattern: LowerPattern, values: Floats) -> str:
        """The name of a matrix: of its pattern and its values (nnz,); empty without a store."""
        if self.store is None:
            return ""
        return _digest(pattern.indptr, pattern.indices, values)

    def of(self, matrix: str, rhs: Floats) -> str:
        """The name of solutions with a matrix of a name, for right-hand sides (n, k)."""
        return f"{matrix} {_digest(rhs.T)}" if matrix else ""

    def find(self, name: str) -> _Arrays | None:
        """What is kept under a name, or None."""
        return self.store.find_solution(name) if self.store is not None and name else None

    def add(self, name: str, seconds: float, arrays: _Arrays) -> None:
        """Keep something, if it is worth it.

        Args:
            name: under which it is found.
            seconds: that it took.
            arrays: (...) what it is.
        """
        if self.store is not None and name and seconds >= WORTH:
            self.store.add_solution(name, arrays)


def _digest(*arrays: Floats | Ints) -> str:
    """Of the bits of arrays."""
    digest = blake2b(digest_size=16)
    for array in arrays:
        digest.update(repr(array.shape).encode())
        digest.update(np.ascontiguousarray(array).data)
    return digest.hexdigest()
