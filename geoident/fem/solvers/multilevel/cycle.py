"""Levels of a preconditioner, and how a residual goes down through them and comes back.

One cycle smooths, takes what is left to the coarser space, is about solved there, by the next level
or at last by a factorization, and smooths again in the same way: so it is a symmetric
positive definite operator M^-1 (Hackbusch, Multi-grid methods and applications, 1985).
"""

from __future__ import annotations

from itertools import pairwise
from typing import Protocol

import numpy as np
import scipy.sparse as sp

from geoident.fem.solvers.direct import (
    Factor,
    LowerPattern,
    NotPositiveDefinite,
    Solver,
    UnknownPlaces,
)
from geoident.fem.solvers.multilevel.coarser import Coarser, aggregates, corners
from geoident.fem.solvers.multilevel.smoother import (
    Singles,
    Smoother,
    largest_eigenvalue,
    node_blocks_inverse,
)
from geoident.fem.solvers.ordering import nested_dissection
from geoident.model.arrays import Floats, Ints

SMOOTHING_STEPS = 3
"""Steps of the smoother before and after."""

JACOBI_STEP = 4.0 / 3.0
"""Step of Jacobi that smooths motions of aggregates, in parts of 1 / largest eigenvalue."""

PROJECTED_PARTS = 8
"""Parts in which the coarser matrix is made: bounds the memory."""

MOST_CORNERS = 400_000
"""Unknowns of corners up to which they are the coarsest level."""


class CycleLevel(Protocol):
    """About solves a system."""

    def solve(self, rhs: Singles) -> Singles:
        """About K^-1 of right-hand sides (n, k); symmetric and positive definite."""


class Hierarchy:
    """What is kept of the levels below a matrix from one factorization to the next.

    Args:
        places: of its unknowns in the mesh.
        direct: factorizes the coarsest level.
    """

    def __init__(self, places: UnknownPlaces, direct: Solver) -> None:
        self._places, self._direct = places, direct
        self._corners = corners(places)
        self._coarsest: _Coarsest | None = None
        self._below: Hierarchy | None = None
        if self._corners is not None and len(self._corners.point) > MOST_CORNERS:
            assert self._corners.places is not None
            self._below = Hierarchy(self._corners.places, direct)

    def level(self, matrix: sp.csr_array) -> CycleLevel:
        """The finest level for a matrix (n, n).

        Raises:
            NotPositiveDefinite: the matrix is not, on a coarser level or in a node.
        """
        dim = self._places.points.shape[1]
        inverse = sp.csr_array(node_blocks_inverse(matrix, self._places.dofs // dim))
        single, rough = matrix.astype(np.float32), inverse.astype(np.float32)
        largest = largest_eigenvalue(single, rough)
        coarser = self._corners
        if coarser is None:
            coarser = aggregates(matrix, self._places, inverse * (JACOBI_STEP / largest))
        below = self._factorized(coarser, matrix)
        return _Smoothed(single, Smoother(single, rough, largest, SMOOTHING_STEPS), coarser, below)

    def _factorized(self, coarser: Coarser, matrix: sp.csr_array) -> CycleLevel:
        coarse = projected(matrix, coarser.interpolation)
        try:
            if self._below is not None:
                return self._below.level(coarse)
            if self._coarsest is None or not self._coarsest.serves(coarse):
                self._coarsest = _Coarsest(coarse, coarser.point, self._direct)
            return self._coarsest.level(coarse)
        except NotPositiveDefinite as error:
            raise NotPositiveDefinite(_unknown(error.unknown, coarser)) from error


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


def _unknown(coarse: int | None, coarser: Coarser) -> int | None:
    """The unknown that a coarser one stands for most."""
    if coarse is None:
        return None
    column = abs(coarser.interpolation[:, [coarse]]).toarray()
    return int(np.argmax(column))


class _Smoothed:
    """A level that smooths and goes on to a coarser one."""

    def __init__(
        self, matrix: sp.csr_array, smoother: Smoother, coarser: Coarser, below: CycleLevel
    ) -> None:
        self._matrix, self._smoother, self._below = matrix, smoother, below
        self._down = sp.csr_array(coarser.interpolation.T.astype(np.float32))
        self._up = coarser.interpolation.astype(np.float32)

    def solve(self, rhs: Singles) -> Singles:
        x = self._smoother.begin(rhs)
        x += self._up @ self._below.solve(self._down @ (rhs - self._matrix @ x))
        return self._smoother.go_on(x, rhs)


def _elimination_order(matrix: sp.csr_array, point: Floats) -> Ints:
    """Order (n,) of elimination of the unknowns of a matrix (n, n), which stand at points (n, dim).

    Unknowns at one point stay together: apart they would make the graph several times as large,
    and the separators of so many equal vertices take tens of minutes to find.
    """
    order = np.lexsort(point.T)
    begins = np.r_[True, (np.diff(point[order], axis=0) != 0.0).any(axis=1)]
    place = np.empty(len(point), dtype=np.int64)
    place[order] = np.cumsum(begins) - 1
    rows = place[np.repeat(np.arange(len(point)), np.diff(matrix.indptr))]
    edges = (np.ones(len(rows), dtype=np.int8), (rows, place[matrix.indices]))
    graph = sp.csr_array(sp.coo_array(edges, shape=(place.max() + 1,) * 2))
    dissected = nested_dissection(
        point[order[begins]], graph.indptr.astype(np.int64), graph.indices.astype(np.int64)
    )
    rank = np.empty_like(dissected)
    rank[dissected] = np.arange(len(dissected))
    return np.asarray(np.argsort(rank[place], kind="stable"))


class _Coarsest:
    """The pattern of the coarsest level in the order of its elimination."""

    def __init__(self, matrix: sp.csr_array, point: Floats, direct: Solver) -> None:
        self._indptr, self._indices = matrix.indptr, matrix.indices
        self._order = _elimination_order(matrix, point)
        lower = self._lower(matrix)
        pattern = LowerPattern(lower.indptr.astype(np.int64), lower.indices.astype(np.int64))
        self._analysis = direct.analyse(pattern)

    def serves(self, matrix: sp.csr_array) -> bool:
        """Whether a matrix has this pattern."""
        return np.array_equal(matrix.indptr, self._indptr) and np.array_equal(
            matrix.indices, self._indices
        )

    def level(self, matrix: sp.csr_array) -> CycleLevel:
        """Factorize a matrix of this pattern."""
        try:
            factor = self._analysis.factorize(self._lower(matrix).data)
        except NotPositiveDefinite as error:
            raise NotPositiveDefinite(
                None if error.unknown is None else int(self._order[error.unknown])
            ) from error
        return _Factorized(self._order, factor)

    def _lower(self, matrix: sp.csr_array) -> sp.csc_array:
        """The lower triangle in the order of elimination, by columns."""
        lower = sp.csc_array(sp.tril(sp.csr_array(matrix[self._order][:, self._order])))
        lower.sort_indices()
        return lower


class _Factorized:
    """The coarsest level."""

    def __init__(self, order: Ints, factor: Factor) -> None:
        self._order, self._factor = order, factor

    def solve(self, rhs: Singles) -> Singles:
        x = np.empty_like(rhs)
        x[self._order] = self._factor.solve(rhs[self._order].astype(np.float64))
        return x
