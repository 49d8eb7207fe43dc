"""Numbers together with their derivatives by the parameters (dual numbers).

A formula written with dual numbers is its own exact derivative: products follow the product rule,
functions the chain rule. Columns are kept as the analysis keeps them: the value first, then one
derivative per parameter. They are the one way in which the program differentiates what a case says:
moduli, yield planes, in-situ stress, loads and structures alike.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from types import EllipsisType
from typing import TypeAlias

import numpy as np

from geoident.model.arrays import Bools, Floats, Ints
from geoident.model.parameter import Scalar, Values

Number: TypeAlias = "Dual | Floats | float"
"""What a dual number is computed with; plain numbers depend on no parameter."""

_Place: TypeAlias = Bools | Ints | slice | int | EllipsisType | None


class Dual:
    """A number, or an array of them, with derivatives.

    Args:
        columns: (..., 1 + n) the value, then its derivatives by n parameters.

    >>> x = Dual(np.array([3.0, 1.0]))
    >>> (x * x).columns
    array([9., 6.])
    """

    def __init__(self, columns: Floats) -> None:
        self.columns = columns

    @classmethod
    def constant(cls, number: Floats | float, n: int) -> Dual:
        """Numbers (...) that depend on none of n parameters."""
        value = np.asarray(number, dtype=np.float64)
        columns = np.zeros((*value.shape, 1 + n))
        columns[..., 0] = value
        return cls(columns)

    @property
    def value(self) -> Floats:
        """The value (...)."""
        return np.asarray(self.columns[..., 0])

    @property
    def n(self) -> int:
        """Number of parameters."""
        return int(self.columns.shape[-1]) - 1

    def slope(self, parameter: int) -> Floats | None:
        """The derivative (...) by one of the n parameters; None where it is zero throughout."""
        column = self.columns[..., 1 + parameter]
        return np.ascontiguousarray(column) if column.any() else None

    __array_ufunc__ = None  # so that array * dual is a dual number

    def __add__(self, other: Number) -> Dual:
        return Dual(self.columns + other.columns) if isinstance(other, Dual) else self.plus(other)

    __radd__ = __add__

    def __sub__(self, other: Number) -> Dual:
        return Dual(self.columns - other.columns) if isinstance(other, Dual) else self.plus(-other)

    def __rsub__(self, other: Floats | float) -> Dual:
        return -self + other

    def __neg__(self) -> Dual:
        return Dual(-self.columns)

    def __mul__(self, other: Number) -> Dual:
        if not isinstance(other, Dual):
            return self.times(other)
        product = self.columns * other.columns[..., :1]
        product[..., 1:] += self.columns[..., :1] * other.columns[..., 1:]
        return Dual(product)

    __rmul__ = __mul__

    def __matmul__(self, other: Dual) -> Dual:
        one, two = (np.moveaxis(factor.columns, -1, 0) for factor in (self, other))
        product = one[:1] @ two
        product[1:] += one[1:] @ two[0]
        return Dual(np.ascontiguousarray(np.moveaxis(product, 0, -1)))

    def __truediv__(self, other: Number) -> Dual:
        return self * (other.reciprocal() if isinstance(other, Dual) else 1.0 / np.asarray(other))

    def __rtruediv__(self, other: Floats | float) -> Dual:
        return self.reciprocal() * other

    def __getitem__(self, index: _Place | tuple[_Place, ...]) -> Dual:
        return Dual(self.columns[index])

    @property
    def T(self) -> Dual:  # noqa: N802  (as numpy writes it)
        """The transpose of a matrix, or of each of several (..., i, j)."""
        return Dual(self.columns.swapaxes(-3, -2))

    def reciprocal(self) -> Dual:
        """1 / value."""
        return self.through(lambda x: 1.0 / x, lambda x: -1.0 / x**2)

    def exp(self) -> Dual:
        """Exponential."""
        return self.through(np.exp, np.exp)

    def log(self) -> Dual:
        """Natural logarithm."""
        return self.through(np.log, lambda x: 1.0 / x)

    def sine(self) -> Dual:
        """Sine of an angle in rad."""
        return self.through(np.sin, np.cos)

    def cosine(self) -> Dual:
        """Cosine of an angle in rad."""
        return self.through(np.cos, lambda x: -np.sin(x))

    def root(self) -> Dual:
        """Square root."""
        return self.through(np.sqrt, lambda x: 0.5 / np.sqrt(x))

    def power(self, exponent: Dual) -> Dual:
        """Value ** exponent, of a positive value."""
        return (self.log() * exponent).exp()

    def times(self, factor: Floats | float) -> Dual:
        """Product with given numbers (...), which depend on no parameter."""
        return Dual(self.columns * np.asarray(factor)[..., None])

    def plus(self, term: Floats | float) -> Dual:
        """Sum with given numbers (...)."""
        value = self.value + term
        if value.shape == self.columns.shape[:-1]:
            columns = self.columns.copy(order="K")
            columns[..., 0] = value
            return Dual(columns)
        slopes = np.broadcast_to(self.columns[..., 1:], (*value.shape, self.columns.shape[-1] - 1))
        return Dual(np.concatenate([value[..., None], slopes], axis=-1))

    def through(self, value: Callable[[Floats], Floats], slope: Callable[[Floats], Floats]) -> Dual:
        """A function of the value.

        Args:
            value: the function, (...) to (...).
            slope: its derivative, (...) to (...).
        """
        result = self.columns * slope(self.value)[..., None]
        result[..., 0] = value(self.value)
        return Dual(result)

    def positive_part(self) -> Dual:
        """max(value, 0). At the kink the derivative is the one from below, zero."""
        return Dual(np.where(self.columns[..., :1] > 0.0, self.columns, 0.0))


def stacked(duals: Sequence[Dual]) -> Dual:
    """Numbers of equal shape (...) as one array (len(duals), ...)."""
    return Dual(np.stack([dual.columns for dual in duals]))


def joined(duals: Sequence[Dual]) -> Dual:
    """Arrays (k, ...) one after the other, (sum of k, ...)."""
    return Dual(np.concatenate([dual.columns for dual in duals]))


class ParameterPoint:
    """A point in parameter space, and the parameters by which to differentiate there.

    Args:
        values: parameter values by name, SI.
        names: the n parameters to differentiate by; the order of the derivatives.
    """

    def __init__(self, values: Values, names: Sequence[str]) -> None:
        self.values = values
        self.names = tuple(names)

    @property
    def n_columns(self) -> int:
        """1 + n."""
        return 1 + len(self.names)

    def number(self, scalar: Scalar) -> Dual:
        """A number of the case."""
        return Dual(scalar.columns(self.values, self.names))

    def numbers(self, scalars: Sequence[Scalar]) -> Dual:
        """Numbers (k,) of the case."""
        columns = [self.number(scalar).columns for scalar in scalars]
        return Dual(np.array(columns).reshape(-1, self.n_columns))  # also of none

    def constant(self, number: Floats | float) -> Dual:
        """Numbers (...) that depend on no parameter."""
        return Dual.constant(number, len(self.names))
