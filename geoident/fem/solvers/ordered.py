"""Factorizations of symmetric matrices that are given in any order of their unknowns."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import scipy.sparse as sp

from geoident.fem.solvers.coarser import node_graph
from geoident.fem.solvers.direct import (
    LowerPattern,
    NotPositiveDefinite,
    Solve,
    SymbolicFactorization,
)
from geoident.fem.solvers.ordering import nested_dissection
from geoident.model.arrays import Floats, Ints


class OrderedFactorization:
    """Factorizes matrices of one pattern in an order of elimination with little fill.

    Args:
        matrix: (n, n) one of them.
        points: (n, dim) where its unknowns stand.
        analyse: prepares a direct solver for a pattern.
    """

    def __init__(
        self,
        matrix: sp.csr_array,
        points: Floats,
        analyse: Callable[[LowerPattern], SymbolicFactorization],
    ) -> None:
        self._indptr, self._indices = matrix.indptr, matrix.indices
        self._order = _elimination_order(matrix, points)
        lower = self._lower(matrix)
        pattern = LowerPattern(lower.indptr.astype(np.int64), lower.indices.astype(np.int64))
        self._analysis = analyse(pattern)

    def serves(self, matrix: sp.csr_array) -> bool:
        """Whether a matrix has this pattern."""
        same_starts = np.array_equal(matrix.indptr, self._indptr)
        return same_starts and np.array_equal(matrix.indices, self._indices)

    def factorize(self, matrix: sp.csr_array) -> Solve:
        """Factorize a matrix of this pattern; the answer solves until the next call.

        Raises:
            NotPositiveDefinite: it is not.
        """
        try:
            factor = self._analysis.factorize(self._lower(matrix).data)
        except NotPositiveDefinite as error:
            unknown = None if error.unknown is None else int(self._order[error.unknown])
            raise NotPositiveDefinite(unknown) from error

        def solve(rhs: Floats) -> Floats:
            x = np.empty_like(rhs)
            x[self._order] = factor.solve(rhs[self._order])
            return x

        return solve

    def _lower(self, matrix: sp.csr_array) -> sp.csc_array:
        """The lower triangle in the order of elimination, by columns."""
        lower = sp.csc_array(sp.tril(sp.csr_array(matrix[self._order][:, self._order])))
        lower.sort_indices()
        return lower


def _elimination_order(matrix: sp.csr_array, points: Floats) -> Ints:
    """Order (n,) of elimination of the unknowns of a matrix (n, n), which stand at points (n, dim).

    Unknowns at one point stay together: apart they would make the graph several times as large,
    and the separators of so many equal vertices take tens of minutes to find.
    """
    places, at = np.unique(points, axis=0, return_inverse=True)
    graph = node_graph(matrix, at.ravel(), len(places))
    dissected = nested_dissection(
        places, graph.indptr.astype(np.int64), graph.indices.astype(np.int64)
    )
    rank = np.empty_like(dissected)
    rank[dissected] = np.arange(len(dissected))
    return np.asarray(np.argsort(rank[at.ravel()], kind="stable"))
