"""Formulas of laws: in what is known of a section, and in constants that are found.

A formula is a tree of terms. It is evaluated with dual numbers, so its derivatives are exact.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass

import numpy as np

from geoident.model.dual import Dual

FUNCTIONS: Mapping[str, Callable[[Dual], Dual]] = {
    "exp": Dual.exp,
    "log": Dual.log,
    "log10": lambda x: x.log() * (1.0 / np.log(10.0)),
    "sqrt": Dual.root,
}
"""Functions that a law may use; ``log`` is the natural logarithm."""


@dataclass(frozen=True)
class LawTerm:
    """A node of a formula.

    Args:
        kind: ``number``, ``name``, one of ``+ - * / ^``, ``negative``, or a key of `FUNCTIONS`.
        arguments: one or two terms; none of a number or a name.
        value: of a number.
        name: of a name.
    """

    kind: str
    arguments: tuple[LawTerm, ...] = ()
    value: float = 0.0
    name: str = ""

    def names(self) -> Iterator[str]:
        """All names in the formula, from left to right."""
        if self.kind == "name":
            yield self.name
        for argument in self.arguments:
            yield from argument.names()

    def at(self, values: Mapping[str, Dual]) -> Dual:
        """The value of the formula and its derivatives.

        Args:
            values: of all its names.

        >>> x = Dual(np.array([3.0, 1.0]))
        >>> two = LawTerm("number", value=2.0)
        >>> LawTerm("*", (two, LawTerm("name", name="x"))).at({"x": x}).columns
        array([6., 2.])
        """
        match self.kind:
            case "number":
                return Dual.constant(self.value, next(iter(values.values())).n if values else 0)
            case "name":
                return values[self.name]
        with np.errstate(all="ignore"):  # who asks looks for what is not finite
            return _OPERATIONS[self.kind](*(argument.at(values) for argument in self.arguments))


def _power(base: Dual, exponent: Dual) -> Dual:
    """A power; of a base that is not positive only where the exponent is a given number."""
    if exponent.columns[..., 1:].any():
        return base.power(exponent)
    n = float(exponent.value)
    if n == 0.0:
        return base.times(0.0).plus(1.0)
    return base.through(lambda x: x**n, lambda x: n * x ** (n - 1.0))


_OPERATIONS: Mapping[str, Callable[..., Dual]] = {
    **FUNCTIONS,
    "negative": lambda x: -x,
    "+": lambda x, y: x + y,
    "-": lambda x, y: x - y,
    "*": lambda x, y: x * y,
    "/": lambda x, y: x / y,
    "^": _power,
}
