"""Symmetric quasi-definite matrices [K, -Q; -Q^T, -C] with K and C positive definite, by SuperLU.

Such a matrix has a factorization L D L^T in every order of its unknowns (Vanderbei, SIAM Journal on
Optimization 5, 1995), so its pivots may stay on the diagonal, whose signs are known. SuperLU takes
no advantage of the symmetry, and is nevertheless about as fast as indefinite solvers.

Matrices that differ in C alone, C = C_0 + h C_1, have one pattern: it is made once, in an order
that is given, and a factor for each h.
"""

from __future__ import annotations

import numpy as np
import scipy.sparse as sp

from geoident.fem.solvers.direct import Factor, NotPositiveDefinite, SolverCounts
from geoident.fem.solvers.splu import quasi_definite_solve
from geoident.model.arrays import Floats, Ints


class QuasiDefinite:
    """The matrices A(h) = A_0 + h A_1 of one pattern.

    Args:
        constant: A_0 (n, n), symmetric.
        growing: A_1 (n, n), symmetric.
        signs: (n,) of the diagonal of A(h), 1 or -1.
        order: (n,) order of elimination with little fill.
        counts: where to count.
    """

    def __init__(
        self,
        constant: sp.csr_array,
        growing: sp.csr_array,
        *,
        signs: Floats,
        order: Ints,
        counts: SolverCounts,
    ) -> None:
        self._order, self._counts, self._signs = order, counts, signs[order]
        constant, growing = (_in_order(A, order) for A in (constant, growing))
        pattern = abs(constant) + abs(growing)
        pattern.sort_indices()
        self._indices, self._indptr = pattern.indices, pattern.indptr
        self._constant, self._growing = (_on(pattern, A) for A in (constant, growing))
        counts.analyses += 1

    def factor(self, h: float) -> Factor:
        """The factor of A(h).

        Raises:
            NotPositiveDefinite: a block is not definite.
        """
        self._counts.factorizations += 1
        columns = self._constant + h * self._growing, self._indices, self._indptr
        order = self._order
        try:
            ordered = quasi_definite_solve(columns, self._signs)
        except NotPositiveDefinite as error:
            unknown = None if error.unknown is None else int(order[error.unknown])
            raise NotPositiveDefinite(unknown) from error

        def solve(rhs: Floats) -> Floats:
            x = np.empty_like(rhs)
            x[order] = ordered(np.asfortranarray(rhs[order]))
            return x

        return Factor(len(order), self._counts, solve, lambda: True)


def _in_order(matrix: sp.csr_array, order: Ints) -> sp.csc_array:
    """A matrix by columns in an order of its unknowns, without the zeros that it stores."""
    ordered = sp.csc_array(sp.csr_array(matrix)[order][:, order])
    ordered.eliminate_zeros()
    return ordered


def _on(pattern: sp.csc_array, matrix: sp.csc_array) -> Floats:
    """Values of a matrix at all entries of a pattern that has all of its own."""
    n = pattern.shape[0]
    keys = [
        np.repeat(np.arange(n, dtype=np.int64), np.diff(one.indptr)) * n + one.indices
        for one in (pattern, matrix)
    ]
    values = np.zeros(pattern.nnz)
    values[np.searchsorted(keys[0], keys[1])] = matrix.data
    return values
