"""Numbers together with their derivatives by the parameters.

A formula written with jets is its own exact derivative: products follow the product rule,
functions the chain rule. Columns are kept as the march keeps them: the value first, then one
derivative per parameter.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import TypeAlias

import numpy as np

from geoident.model.arrays import Bools, Floats, Ints
from geoident.model.parameter import Scalar

Number: TypeAlias = "Jet | Floats | float"
"""What a jet is computed with; plain numbers depend on no parameter."""


class Jet:
    """A number, or an array of them, with derivatives.

    Args:
        columns: (..., 1 + n) the value, then its derivatives by n parameters.

    >>> x = Jet(np.array([3.0, 1.0]))
    >>> (x * x).columns
    array([9., 6.])
    """

    def __init__(self, columns: Floats) -> None:
        self.columns = columns

    @property
    def value(self) -> Floats:
        """The value (...)."""
        return np.asarray(self.columns[..., 0])

    __array_ufunc__ = None  # so that array * jet is a jet

    def __add__(self, other: Number) -> Jet:
        return Jet(self.columns + other.columns) if isinstance(other, Jet) else self.plus(other)

    __radd__ = __add__

    def __sub__(self, other: Number) -> Jet:
        return self + (-other)

    def __rsub__(self, other: Floats | float) -> Jet:
        return -self + other

    def __neg__(self) -> Jet:
        return Jet(-self.columns)

    def __mul__(self, other: Number) -> Jet:
        if not isinstance(other, Jet):
            return self.times(other)
        product = self.columns * other.columns[..., :1]
        product[..., 1:] += self.columns[..., :1] * other.columns[..., 1:]
        return Jet(product)

    __rmul__ = __mul__

    def __truediv__(self, other: Number) -> Jet:
        return self * (other.reciprocal() if isinstance(other, Jet) else 1.0 / np.asarray(other))

    def __rtruediv__(self, other: Floats | float) -> Jet:
        return self.reciprocal() * other

    def __getitem__(self, index: Bools | Ints | int) -> Jet:
        return Jet(self.columns[index])

    def reciprocal(self) -> Jet:
        """1 / value."""
        return self.through(lambda x: 1.0 / x, lambda x: -1.0 / x**2)

    def exp(self) -> Jet:
        """Exponential."""
        return self.through(np.exp, np.exp)

    def log(self) -> Jet:
        """Natural logarithm."""
        return self.through(np.log, lambda x: 1.0 / x)

    def power(self, exponent: Jet) -> Jet:
        """Value ** exponent, of a positive value."""
        return (self.log() * exponent).exp()

    def times(self, given: Floats | float) -> Jet:
        """Product with given numbers (...), which depend on no parameter."""
        return Jet(self.columns * np.asarray(given)[..., None])

    def plus(self, given: Floats | float) -> Jet:
        """Sum with given numbers (...)."""
        value = self.value + given
        slopes = np.broadcast_to(self.columns[..., 1:], (*value.shape, self.columns.shape[-1] - 1))
        return Jet(np.concatenate([value[..., None], slopes], axis=-1))

    def through(self, value: Callable[[Floats], Floats], slope: Callable[[Floats], Floats]) -> Jet:
        """A function of the value, by the function and its derivative.

        Args:
            value: the function, of values (...).
            slope: its derivative (...) there.
        """
        result = self.columns * slope(self.value)[..., None]
        result[..., 0] = value(self.value)
        return Jet(result)

    def positive_part(self) -> Jet:
        """max(value, 0). At the kink the derivative is the one from below, zero."""
        return Jet(np.where(self.columns[..., :1] > 0.0, self.columns, 0.0))


class Point:
    """The parameter values at which jets are made, and the parameters to differentiate by."""

    def __init__(self, values: Mapping[str, float], names: Sequence[str]) -> None:
        self._values = values
        self._names = tuple(names)

    @property
    def n_columns(self) -> int:
        """1 + n."""
        return 1 + len(self._names)

    def jet(self, scalar: Scalar) -> Jet:
        """A number of the case."""
        slopes = (scalar.slope(name) for name in self._names)
        return Jet(np.array([scalar.value(self._values), *slopes]))

    def given(self, number: Floats | float) -> Jet:
        """Numbers (...) that depend on no parameter."""
        value = np.asarray(number, dtype=np.float64)
        columns = np.zeros((*value.shape, self.n_columns))
        columns[..., 0] = value
        return Jet(columns)
