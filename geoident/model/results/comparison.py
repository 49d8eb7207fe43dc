"""What differs between two results, number by number."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field


@dataclass(frozen=True)
class Tolerance:
    """How far two numbers may lie apart and still be the same.

    Args:
        relative: to the larger of the two.
        absolute: dimension (key of `geoident.units.DIMENSIONS`) to a value in its SI unit.
    """

    relative: float = 1e-6
    absolute: Mapping[str, float] = field(default_factory=dict)


@dataclass(frozen=True)
class Amount:
    """A number of a result.

    Args:
        value: SI, finite or infinite.
        dimension: key of `geoident.units.DIMENSIONS`.
        unit: in which people want to see it.
    """

    value: float
    dimension: str
    unit: str


@dataclass(frozen=True, order=True)
class Place:
    """Where a number of a result stands.

    Args:
        table: such as ``parameters``.
        item: such as ``E_rock`` or ``EX1.a5, bench 1``; empty where there is only one.
        quantity: such as ``value`` or ``computed``.
    """

    table: str
    item: str
    quantity: str


@dataclass(frozen=True)
class Difference:
    """A number that is not the same in both results; None where a result does not have it."""

    place: Place
    first: Amount | None
    second: Amount | None


@dataclass(frozen=True)
class Comparison:
    """Two results side by side.

    Args:
        first, second: their paths.
        statuses: how each ended, such as ``converged``.
        compared: how many numbers at least one of the results has.
        differences: those that are not the same.
        kinds: of the results, such as ``fit``.
    """

    first: str
    second: str
    statuses: tuple[str, str]
    compared: int
    differences: tuple[Difference, ...]
    kinds: tuple[str, str] = ("", "")

    @property
    def same(self) -> bool:
        """All numbers are the same, and the commands ended in the same way."""
        return not self.differences and self.statuses[0] == self.statuses[1]
