"""SuperLU, which comes with scipy: always present, slower than the others.

It factorizes general matrices, so it is given both triangles and told to keep the pivots on the
diagonal, which positive definiteness allows. It cannot keep its symbolic factorization.

The tangent of a material whose plastic flow is not associated is not symmetric (theory 5). Such a
matrix is given by the values of its lower triangle and, entry by entry, those of its upper one, on
a symmetric pattern (`general_factor`).
"""

from __future__ import annotations

from typing import Any

import numpy as np
import scipy.sparse as sp
from scipy.sparse.linalg import splu

from geoident.fem.solvers.direct import (
    SINGULAR,
    Factor,
    LowerPattern,
    NotPositiveDefinite,
    Solve,
    SolverCounts,
    SymbolicFactorization,
)
from geoident.model.arrays import Floats

BLOCK = 4
"""Right-hand sides solved together; SuperLU loses its cache with more."""

READABLE = 20_000_000
"""Entries of the factor up to which it is copied to see its pivots (12 bytes each)."""

DIAGONAL = {"diag_pivot_thresh": 0.0, "options": {"SymmetricMode": True}}
"""Pivots stay on the diagonal: what a positive definite matrix allows."""

LARGE_ENOUGH = {"diag_pivot_thresh": 0.01}
"""Pivots stay on the diagonal unless an entry of their column is a hundred times as large."""


def load() -> None:
    """Nothing: scipy is always there."""


class SpluFactorization(SymbolicFactorization):
    """A pattern for SuperLU."""

    def _factorize(self, values: Floats, diagonal: Floats) -> Solve:
        whole = self.pattern.whole(values)
        lu = _lu((whole.data, whole.indices, whole.indptr), DIAGONAL)
        moved = np.flatnonzero(lu.perm_r != lu.perm_c)
        if moved.size:  # it left the diagonal, where a pivot was zero
            raise NotPositiveDefinite(int(moved[0]))
        _refuse_singular(lu, diagonal, definite=True)
        return lambda rhs: _solve_in_blocks(lu, rhs)


def general_factor(
    pattern: LowerPattern, below: Floats, above: Floats, counts: SolverCounts
) -> Factor:
    """Factorize a general matrix.

    Args:
        pattern: of the lower triangle, in a fill-reducing order.
        below: (nnz,) values K[i, j] of the entries of the pattern.
        above: (nnz,) values K[j, i].
        counts: where to count.

    Raises:
        NotPositiveDefinite: the matrix is singular.
    """
    counts.factorizations += 1
    rows = pattern.whole(above, below)  # of the transposed matrix: columns of the matrix
    scale = np.maximum.reduceat(np.abs(rows.data), rows.indptr[:-1])
    if not np.isfinite(scale).all():
        raise NotPositiveDefinite(int(np.flatnonzero(~np.isfinite(scale))[0]))
    lu = _lu((rows.data, rows.indices, rows.indptr), LARGE_ENOUGH)
    _refuse_singular(lu, scale, definite=False)
    return Factor(pattern.n, counts, lambda rhs: _solve_in_blocks(lu, rhs), lambda: True)


class SpluIndefinite:
    """A pattern of quasi-definite matrices for SuperLU; see `quasi_definite`.

    It takes no advantage of the symmetry: its pivots stay on the diagonal all the same.

    Args:
        pattern: of the lower triangle, in a fill-reducing order.
        signs: (n,) of the diagonal, 1 or -1.
    """

    def __init__(self, pattern: LowerPattern, signs: Floats) -> None:
        self._pattern, self._signs = pattern, signs

    def factorize(self, values: Floats) -> Solve:
        """How to solve with the matrix of these values (nnz,).

        Raises:
            NotPositiveDefinite: a pivot is zero, or has the other sign.
        """
        whole = self._pattern.whole(values)
        lu = _lu((whole.data, whole.indices, whole.indptr), DIAGONAL)
        moved = np.flatnonzero(lu.perm_r != lu.perm_c)
        if moved.size:
            raise NotPositiveDefinite(int(moved[0]))
        if lu.nnz <= READABLE:
            wrong = np.flatnonzero(~(lu.U.diagonal()[lu.perm_c] * self._signs > 0.0))
            if wrong.size:
                raise NotPositiveDefinite(int(wrong[0]))
        return lambda rhs: _solve_in_blocks(lu, rhs)


def _lu(columns: Any, pivoting: dict[str, Any]) -> Any:
    """SuperLU of a matrix by compressed columns, in the order that it has."""
    n = len(columns[2]) - 1
    try:
        return splu(sp.csc_array(columns, shape=(n, n)), permc_spec="NATURAL", **pivoting)
    except RuntimeError as error:  # exactly singular
        raise NotPositiveDefinite from error


def _refuse_singular(lu: Any, scale: Floats, *, definite: bool) -> None:
    """Raise `NotPositiveDefinite` where a factorized matrix is singular to rounding.

    To see the pivots SuperLU must copy the factor. Where that is too large, the solution for a
    random right-hand side stands in. It is as large as the inverse, so a singular matrix is found
    for sure; an indefinite one only if its negative eigenvalues dominate.

    Args:
        lu: the factorization.
        scale: (n,) size of the entries of each column of the matrix.
        definite: whether pivots must be positive, too.
    """
    if lu.nnz <= READABLE:
        pivots = lu.U.diagonal()[lu.perm_c]
        good = (pivots if definite else np.abs(pivots)) > SINGULAR * scale
    else:
        rhs = np.random.default_rng(0).normal(size=scale.size) * scale
        solution = lu.solve(rhs)
        good = np.abs(solution) < 1.0 / SINGULAR
        if definite and not rhs @ solution > 0.0:
            raise NotPositiveDefinite(int(np.argmax(np.abs(solution))))
    if not good.all():
        raise NotPositiveDefinite(int(np.flatnonzero(~good)[0]))


def _solve_in_blocks(lu: Any, rhs: Floats) -> Floats:
    """Solutions in the place of right-hand sides (n, k) in Fortran order."""
    for start in range(0, rhs.shape[1], BLOCK):
        rhs[:, start : start + BLOCK] = lu.solve(rhs[:, start : start + BLOCK])
    return rhs
