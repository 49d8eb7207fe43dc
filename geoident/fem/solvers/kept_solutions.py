"""Solutions that took long, kept outside of the process: who is killed begins again where it was.

An analysis through a million unknowns takes minutes, and what a fit keeps of its work are whole
evaluations: one that is cut short at its end would be lost. Its solutions are not. They are found
by the bits of what they solve, so that whoever asks the same again gets the same bits back, and
nothing else is ever taken for them.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from hashlib import blake2b
from time import monotonic
from typing import Protocol, runtime_checkable

import numpy as np

from geoident.model.arrays import Floats, Ints

WORTH = 5.0
"""Seconds from which on it pays to keep what was computed: more than it takes to write it."""


class SolutionStore(Protocol):
    """Where solutions are kept: a file, or a dictionary in tests."""

    def find_solution(self, name: str) -> Mapping[str, Floats] | None:
        """What was put there under a name, bit by bit, or None."""

    def add_solution(self, name: str, arrays: Mapping[str, Floats]) -> None:
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

    def name(self, *arrays: Floats | Ints, of: str = "") -> str:
        """A name of the bits of arrays, such as a right-hand side; empty without a store.

        Args:
            arrays: (...) what is named.
            of: name of the matrix to which they belong.
        """
        if self.store is None:
            return ""
        digest = blake2b(digest_size=16)
        for array in arrays:
            digest.update(repr(array.shape).encode())
            digest.update(np.ascontiguousarray(array).data)
        return f"{of} {digest.hexdigest()}".strip()

    def find_or_compute(self, name: str, compute: Callable[[], Floats]) -> Floats:
        """The solution (...) kept under a name; or else computed, and kept if that took long."""
        if self.store is None or not name:
            return compute()
        known = self.store.find_solution(name)
        if known is not None:
            return known["x"]
        start_time = monotonic()
        x = compute()
        if monotonic() - start_time >= WORTH:
            self.store.add_solution(name, {"x": x})
        return x
