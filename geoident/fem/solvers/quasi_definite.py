"""Symmetric quasi-definite matrices [K, -Q; -Q^T, -C] with K and C positive definite.

Such a matrix has factors L D L^T in every order of its unknowns (Vanderbei, SIAM Journal on
Optimization 5, 1995), so it is factorized in an order with little fill. Pivots that are small
beside what they stand on cost digits: C is next to nothing where water hardly gives way and hardly
flows. So what is left of right-hand sides is solved for again, if it is more than rounding. That
is a matter of the pivots: a factor that leaves no more of what it is first asked for is trusted.

Matrices that differ in C alone, C = C_0 + h C_1, have one pattern: it is made once, and a factor
for each h. K may change as well (`places`).
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Protocol

import numpy as np
import scipy.sparse as sp

from geoident.fem.solvers.direct import (
    Factor,
    LowerPattern,
    NotPositiveDefinite,
    Solve,
    SolverCounts,
)
from geoident.model.arrays import Floats, Ints

_ROUNDING = 1e-10
"""Part of the largest entry of a right-hand side that may be left of it."""

_MOST_CORRECTIONS = 4


class IndefiniteFactorization(Protocol):
    """A library's factorization of quasi-definite matrices of one pattern."""

    def factorize(self, values: Floats) -> Solve:
        """How to solve with the matrix of these values (nnz,), until the next call.

        Raises:
            NotPositiveDefinite: a pivot is zero, or none of its block.
        """


Prepare = Callable[[LowerPattern, Floats], IndefiniteFactorization]
"""Prepares a library for a pattern, with the signs (n,) of the diagonal."""


class QuasiDefinite:
    """The matrices A(h) = A_0 + h A_1 of one pattern.

    Args:
        constant: A_0 (n, n), symmetric.
        growing: A_1 (n, n), symmetric.
        signs: (n,) of the diagonal of A(h), 1 or -1.
        order: (n,) order of elimination with little fill.
        prepare: a library.
        counts: where to count.
        changing: (n, n) where entries may change beside those that A(h) has; None for nowhere.

    Attributes:
        order: (n,) of elimination.
        pattern: of the lower triangle in that order.
    """

    def __init__(
        self,
        constant: sp.csr_array,
        growing: sp.csr_array,
        *,
        signs: Floats,
        order: Ints,
        prepare: Prepare,
        counts: SolverCounts,
        changing: sp.csr_array | None = None,
    ) -> None:
        self.order, self._counts = order, counts
        self._place = np.empty_like(order)
        self._place[order] = np.arange(len(order))
        first, second = _lower(constant, order), _lower(growing, order)
        both = sp.csc_array(abs(first) + abs(second) + sp.eye_array(len(order)))
        if changing is not None:
            both = sp.csc_array(both + _lower(abs(changing), order))
        both.sort_indices()
        self._constant, self._growing = _on(both, first), _on(both, second)
        indptr, indices = both.indptr.astype(np.int64), both.indices.astype(np.int64)
        self.pattern = LowerPattern(indptr, indices)
        self._library = prepare(self.pattern, signs[order])
        self._last = 0  # number of the last factorization
        counts.analyses += 1

    def places(self, rows: Ints, columns: Ints) -> Ints:
        """Where entries (k,) stand among the values (nnz,) of the pattern, which has them all.

        Args:
            rows: (k,) unknowns, none before that of the column in the order of elimination.
            columns: (k,) unknowns.
        """
        n = len(self.order)
        keys = np.repeat(np.arange(n), np.diff(self.pattern.indptr)) * n + self.pattern.indices
        return np.searchsorted(keys, self._place[columns] * n + self._place[rows])

    def values(self, h: float) -> Floats:
        """(nnz,) of A(h) in the pattern."""
        return np.asarray(self._constant + h * self._growing)

    def factor(self, h: float, change: Floats | float = 0.0) -> Factor:
        """The factor of A(h) with a symmetric change (nnz,), valid until the next one.

        Raises:
            NotPositiveDefinite: a block is not definite.
        """
        n, order, pattern = len(self.order), self.order, self.pattern
        values = self.values(h) + change
        number = self._last = self._last + 1
        self._counts.factorizations += 1
        if not np.isfinite(values).all():
            raise NotPositiveDefinite
        try:
            ordered = self._library.factorize(values)
        except NotPositiveDefinite as error:
            unknown = None if error.unknown is None else int(order[error.unknown])
            raise NotPositiveDefinite(unknown) from error
        lower = sp.csc_array((values, pattern.indices, pattern.indptr), shape=(n, n))
        diagonal = values[pattern.indptr[:-1], None]
        trusted: bool | None = None  # until it is asked for a solution that is not zero

        def solve(rhs: Floats) -> Floats:
            nonlocal trusted
            right = np.asfortranarray(rhs[order])
            found = ordered(right.copy(order="F"))
            for _ in range(0 if trusted else _MOST_CORRECTIONS):
                rest = right + diagonal * found - lower @ found - lower.T @ found
                allowed = _ROUNDING * np.abs(right).max(axis=0)
                exact = bool((np.abs(rest).max(axis=0) <= allowed).all())
                if trusted is None and right.any():
                    trusted = exact
                if exact:
                    break
                found += ordered(np.asfortranarray(rest))
            x = np.empty_like(rhs)
            x[order] = found
            return x

        return Factor(n, self._counts, solve, lambda: number == self._last)


def _lower(matrix: sp.csr_array, order: Ints) -> sp.csc_array:
    """The lower triangle in an order of the unknowns, by columns, without zeros that are stored."""
    lower = sp.csc_array(sp.tril(sp.csr_array(matrix)[order][:, order]))
    lower.eliminate_zeros()
    return lower


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
