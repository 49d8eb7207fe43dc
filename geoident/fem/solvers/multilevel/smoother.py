"""What takes the rough part out of an error: Chebyshev polynomials in D^-1 K, D node by node.

Polynomials of the fourth kind need only an upper bound of the eigenvalues (Lottes 2023, Numer.
Linear Algebra Appl. 30, e2518):

    d_1 = 4/3 (1/b) D^-1 r,    d_k = (2k-3)/(2k+1) d_(k-1) + (8k-4)/(2k+1) (1/b) D^-1 r,    x += d_k

D has the blocks of K that couple the displacements of one node. Everything is in single precision:
a preconditioner need not be better.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
import scipy.sparse as sp

from geoident.fem.solvers.direct import NotPositiveDefinite
from geoident.model.arrays import Floats, Ints

Singles = npt.NDArray[np.float32]

POWER_STEPS = 12
"""Steps of the power method for the largest eigenvalue."""

MARGIN = 1.15
"""By how much the bound is above what the power method finds, which is too small."""


class Smoother:
    """Some steps that reduce the rough part of an error.

    Args:
        matrix: (n, n) K in single precision.
        inverse: (n, n) D^-1 in single precision.
        largest: bound of the eigenvalues of D^-1 K.
        steps: of a run.
    """

    def __init__(
        self, matrix: sp.csr_array, inverse: sp.csr_array, largest: float, steps: int
    ) -> None:
        self._matrix, self._steps = matrix, steps
        self._inverse = inverse * np.float32(1.0 / largest)

    def begin(self, rhs: Singles) -> Singles:
        """The error (n, k) of zero, about."""
        return self._run(np.zeros_like(rhs), rhs)

    def go_on(self, x: Singles, rhs: Singles) -> Singles:
        """A better solution than x (n, k), which is changed."""
        return self._run(x, rhs - self._matrix @ x)

    def _run(self, x: Singles, rest: Singles) -> Singles:
        step = np.zeros_like(x)
        for k in range(1, self._steps + 1):
            if k > 1:
                rest = rest - self._matrix @ step
            step *= np.float32((2 * k - 3) / (2 * k + 1))
            step += np.float32((8 * k - 4) / (2 * k + 1)) * (self._inverse @ rest)
            x += step
        return x


def node_blocks_inverse(matrix: sp.csr_array, node: Ints) -> sp.csr_array:
    """D^-1 (n, n) of the blocks of K by nodes.

    Args:
        matrix: (n, n) K.
        node: (n,) node of each unknown; those of one node follow each other.

    Raises:
        NotPositiveDefinite: a block is not.
    """
    n = len(node)
    first = np.flatnonzero(np.concatenate([[True], node[1:] != node[:-1]]))
    size = np.diff(np.append(first, n))
    width = int(size.max())
    group = np.repeat(np.arange(len(first)), size)
    number = np.arange(n) - first[group]
    blocks = np.tile(np.eye(width), (len(first), 1, 1))
    for shift in range(-width + 1, width):
        band = matrix.diagonal(shift)
        row = np.arange(max(0, -shift), max(0, -shift) + len(band))
        same = group[row] == group[row + shift]
        row = row[same]
        blocks[group[row], number[row], number[row + shift]] = band[same]
    _check_blocks(blocks, first)
    inverse = np.linalg.inv(blocks)
    columns = np.minimum(first[group][:, None] + np.arange(width), n - 1)
    in_node = np.arange(width) < size[group][:, None]
    indptr = np.concatenate([[0], np.cumsum(size[group])])
    entries = inverse[group, number][in_node], columns[in_node], indptr
    return sp.csr_array(entries, shape=(n, n))


def _check_blocks(blocks: Floats, first: Ints) -> None:
    least = np.linalg.eigvalsh(blocks)[:, 0]
    bad = np.flatnonzero(~(least > 0.0))
    if bad.size:
        raise NotPositiveDefinite(int(first[bad[0]]))


def largest_eigenvalue(matrix: sp.csr_array, inverse: sp.csr_array) -> float:
    """A number above the largest eigenvalue of D^-1 K, both (n, n) in single precision."""
    x = np.random.default_rng(0).normal(size=(matrix.shape[0], 1)).astype(np.float32)
    value = 0.0
    for _ in range(POWER_STEPS):
        x /= np.float32(np.linalg.norm(x))
        x = np.asarray(inverse @ (matrix @ x))
        value = float(np.linalg.norm(x))
    return MARGIN * value
