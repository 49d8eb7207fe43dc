"""Matrices that are sums of matrices of unit properties, each times a number of the case."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
import scipy.sparse as sp

from geoident.model.arrays import Floats
from geoident.model.dual import Dual


@dataclass(frozen=True)
class Summed:
    """A matrix that depends on parameters.

    Args:
        value: at the parameters.
        slopes: its derivatives that are not zero, by their number among the parameters.
    """

    value: sp.csr_array
    slopes: Mapping[int, sp.csr_array]

    def at(self, columns: Floats) -> Floats:
        """The product with a vector and its derivatives, (n, 1 + k), with derivatives.

        With a vector alone, (n, 1), that of the value.
        """
        product = np.asarray(self.value @ columns)
        if columns.shape[1] == 1:
            return product
        for n, slope in self.slopes.items():
            product[:, 1 + n] += slope @ columns[:, 0]
        return product


def summed(parts: Sequence[tuple[Dual, sp.csr_array]], shape: tuple[int, int]) -> Summed:
    """The sum of some matrices of a shape, each times a number."""
    value = sp.csr_array(shape)
    slopes: dict[int, sp.csr_array] = {}
    for number, matrix in parts:
        value = value + float(number.value) * matrix
        for n, by in enumerate(number.columns[1:]):
            if by:
                slopes[n] = slopes.get(n, sp.csr_array(matrix.shape)) + float(by) * matrix
    return Summed(sp.csr_array(value), slopes)
