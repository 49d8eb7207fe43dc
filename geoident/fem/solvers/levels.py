"""Levels of a preconditioner, and how a residual goes down through them and comes back.

One cycle smooths, takes what is left to the coarser space, is about solved there, by the next level
or at last by a factorization, and smooths again in the same way: so it is a symmetric
positive definite operator M^-1 (Hackbusch, Multi-grid methods and applications, 1985).

Smoothing takes the rough part out of an error by Chebyshev polynomials in D^-1 K, where D has the
blocks of K that couple the displacements of one node. Polynomials of the fourth kind need only an
upper bound b of the eigenvalues (Lottes 2023, Numer. Linear Algebra Appl. 30, e2518):

    d_1 = 4/3 (1/b) D^-1 r,    d_k = (2k-3)/(2k+1) d_(k-1) + (8k-4)/(2k+1) (1/b) D^-1 r,    x += d_k

Everything is in single precision: a preconditioner need not be better.
"""

from __future__ import annotations

from collections.abc import Callable
from itertools import pairwise

import numpy as np
import numpy.typing as npt
import scipy.sparse as sp

from geoident.fem.solvers.coarser import Coarser, aggregates, corners
from geoident.fem.solvers.direct import (
    LowerPattern,
    NotPositiveDefinite,
    SolverCounts,
    SymbolicFactorization,
    UnknownPlaces,
)
from geoident.fem.solvers.ordered import OrderedFactorization
from geoident.model.arrays import Ints

SMOOTHING_STEPS = 3
"""Steps of the smoother before and after: of 1 to 4 those with which cubes are solved soonest."""

POWER_STEPS = 12
"""Steps of the power method for the largest eigenvalue."""

MARGIN = 1.15
"""By how much the bound is above what so many steps find, which is too small."""

JACOBI_STEP = 4.0 / 3.0
"""Step of Jacobi that smooths motions of aggregates, in parts of 1 / largest eigenvalue."""

PROJECTED_PARTS = 8
"""Parts in which the coarser matrix is made: bounds the memory."""

MOST_CORNERS = 400_000
"""Unknowns of corners up to which they are the coarsest level: their factor takes some 3 GB."""

Singles = npt.NDArray[np.float32]

Approximation = Callable[[Singles], Singles]
"""About K^-1 of right-hand sides (n, k); symmetric and positive definite."""

Analyse = Callable[[LowerPattern, SolverCounts], SymbolicFactorization]
"""Prepares a direct solver for matrices of a pattern."""


class Hierarchy:
    """What is kept of the levels below a matrix from one factorization to the next.

    Args:
        places: of its unknowns in the mesh.
        direct: factorizes the coarsest level.
    """

    def __init__(self, places: UnknownPlaces, direct: Analyse) -> None:
        self._places, self._direct = places, direct
        self._corners = corners(places)
        self._coarsest: OrderedFactorization | None = None
        self._below: Hierarchy | None = None
        if self._corners is not None and len(self._corners.point) > MOST_CORNERS:
            assert self._corners.places is not None
            self._below = Hierarchy(self._corners.places, direct)

    def level(self, matrix: sp.csr_array) -> Approximation:
        """The finest level for a matrix (n, n).

        Raises:
            NotPositiveDefinite: the matrix is not, on a coarser level or in a node.
        """
        inverse = node_blocks_inverse(matrix, self._places.node)
        entries = matrix.data.astype(np.float32), matrix.indices, matrix.indptr
        single = sp.csr_array(entries, shape=matrix.shape)  # with the same pattern, not a copy
        rough = inverse.astype(np.float32)
        largest = largest_eigenvalue(single, rough)
        coarser = self._corners
        if coarser is None:
            coarser = aggregates(matrix, self._places, inverse * (JACOBI_STEP / largest))
        below = self._level_below(coarser, matrix)
        down = sp.csr_array(coarser.interpolation.T.astype(np.float32))
        up = coarser.interpolation.astype(np.float32)
        rough *= np.float32(1.0 / largest)

        def cycle(rhs: Singles) -> Singles:
            x = _smooth(single, rough, np.zeros_like(rhs), rhs)
            x += up @ below(down @ (rhs - single @ x))
            return _smooth(single, rough, x, rhs - single @ x)

        return cycle

    def _level_below(self, coarser: Coarser, matrix: sp.csr_array) -> Approximation:
        coarse = projected(matrix, coarser.interpolation)
        try:
            if self._below is not None:
                return self._below.level(coarse)
            if self._coarsest is None or not self._coarsest.serves(coarse):
                counts = SolverCounts()  # nobody asked for its factors
                self._coarsest = OrderedFactorization(
                    coarse, coarser.point, lambda pattern: self._direct(pattern, counts)
                )
            solve = self._coarsest.factorize(coarse)
            return lambda rhs: solve(rhs.astype(np.float64)).astype(np.float32)
        except NotPositiveDefinite as error:
            unknown = error.unknown
            if unknown is not None:  # the one that the coarser one stands for most
                unknown = int(np.argmax(abs(coarser.interpolation[:, [unknown]]).toarray()))
            raise NotPositiveDefinite(unknown) from error


def projected(matrix: sp.csr_array, interpolation: sp.csr_array) -> sp.csr_array:
    """P^T K P (m, m), some rows of K (n, n) at a time; P (n, m)."""
    n, m = interpolation.shape
    total = sp.csr_array((m, m))
    ends = np.linspace(0, n, PROJECTED_PARTS + 1).astype(np.int64)
    for a, b in pairwise(ends):
        product = matrix[a:b] @ interpolation
        total = total + interpolation[a:b].T @ product
    total.sort_indices()
    return sp.csr_array(total)


def _smooth(matrix: sp.csr_array, scaled: sp.csr_array, x: Singles, rest: Singles) -> Singles:
    """A better solution than x (n, k), which is changed.

    Args:
        matrix: (n, n) K.
        scaled: (n, n) D^-1 / b.
        x: (n, k) solution so far.
        rest: (n, k) its residual.
    """
    step = np.zeros_like(x)
    for k in range(1, SMOOTHING_STEPS + 1):
        if k > 1:
            rest = rest - matrix @ step
        step *= np.float32((2 * k - 3) / (2 * k + 1))
        step += np.float32((8 * k - 4) / (2 * k + 1)) * (scaled @ rest)
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
    bad = np.flatnonzero(~(np.linalg.eigvalsh(blocks)[:, 0] > 0.0))
    if bad.size:
        raise NotPositiveDefinite(int(first[bad[0]]))
    inverse = np.linalg.inv(blocks)
    columns = np.minimum(first[group][:, None] + np.arange(width), n - 1)
    in_node = np.arange(width) < size[group][:, None]
    indptr = np.concatenate([[0], np.cumsum(size[group])])
    entries = inverse[group, number][in_node], columns[in_node], indptr
    return sp.csr_array(entries, shape=(n, n))


def largest_eigenvalue(matrix: sp.csr_array, inverse: sp.csr_array) -> float:
    """A number above the largest eigenvalue of D^-1 K, both (n, n) in single precision."""
    x = np.random.default_rng(0).normal(size=(matrix.shape[0], 1)).astype(np.float32)
    value = 0.0
    for _ in range(POWER_STEPS):
        x /= np.float32(np.linalg.norm(x))
        x = np.asarray(inverse @ (matrix @ x))
        value = float(np.linalg.norm(x))
    return MARGIN * value
