"""SuperLU, which comes with scipy: always present, slower than the others.

It factorizes general matrices, so it is given both triangles and told to keep the pivots on the
diagonal, which positive definiteness allows.

The tangent of a material whose plastic flow is not associated is not symmetric (theory 5). Such a
matrix is given by the values of its lower triangle and, entry by entry, those of its upper one, on
a symmetric pattern (`GeneralFactor`).
"""

from __future__ import annotations

from typing import Any

import numpy as np
import scipy.sparse as sp
from scipy.sparse.linalg import splu

from geoident.fem.solvers.direct import (
    SINGULAR,
    DirectAnalysis,
    LowerPattern,
    NotPositiveDefinite,
    Solve,
    SolverCounts,
    check_pivots,
)
from geoident.model.arrays import Floats, Ints

BLOCK = 4
"""Right-hand sides solved together; SuperLU loses its cache with more."""

READABLE = 20_000_000
"""Entries of the factor up to which it is copied to see its pivots (12 bytes each)."""


class SpluSolver:
    """SuperLU as a `Solver`.

    Args:
        counts: where to count; its own if not given.
    """

    name = "splu"

    def __init__(self, counts: SolverCounts | None = None) -> None:
        self.counts = counts if counts is not None else SolverCounts()

    def analyse(self, pattern: LowerPattern) -> SpluAnalysis:
        """Prepare for matrices of this pattern."""
        return SpluAnalysis(pattern, self.counts)


class SpluAnalysis(DirectAnalysis):
    """The full pattern of a symmetric matrix and where its values come from.

    SuperLU cannot keep its symbolic factorization, so that is all that is done once.
    """

    def __init__(self, pattern: LowerPattern, counts: SolverCounts) -> None:
        super().__init__(pattern, counts)
        self._full = _mirror(pattern)

    def _release(self) -> None:
        """The factor dies with its last user: nothing of it is kept here."""

    def _factorize(self, values: Floats, diagonal: Floats) -> Solve:
        full = self._full
        matrix = sp.csc_array((values[full.data], full.indices, full.indptr), shape=full.shape)
        try:
            lu = splu(
                matrix, permc_spec="NATURAL", diag_pivot_thresh=0.0, options={"SymmetricMode": True}
            )
        except RuntimeError as error:  # exactly singular
            raise NotPositiveDefinite from error
        _check(lu, diagonal)
        return lambda rhs: solve_in_blocks(lu, rhs)


def _mirror(pattern: LowerPattern) -> sp.csc_array[np.int64]:
    """Both triangles, each entry holding the place of its value among those of the lower one."""
    n = pattern.n
    nnz = len(pattern.indices)
    columns = np.repeat(np.arange(n), np.diff(pattern.indptr))
    below = pattern.indices != columns
    rows = np.concatenate([pattern.indices, columns[below]])
    mirrored = np.concatenate([columns, pattern.indices[below]])
    places: Ints = np.concatenate([np.arange(nnz), np.flatnonzero(below)])
    order = np.lexsort((rows, mirrored))
    indptr = np.concatenate([[0], np.cumsum(np.bincount(mirrored, minlength=n))])
    return sp.csc_array(
        (places[order], rows[order].astype(np.int32), indptr.astype(np.int32)), shape=(n, n)
    )


def _check(lu: Any, diagonal: Floats) -> None:
    """Raise `NotPositiveDefinite` unless the factor is that of a positive definite matrix.

    To see the pivots SuperLU must copy the factor; where that is too large, one solve stands in: it
    finds a singular matrix for sure, an indefinite one if its negative eigenvalues dominate.
    """
    off = np.flatnonzero(lu.perm_r != lu.perm_c)
    if off.size:  # it left the diagonal, where a pivot was zero
        raise NotPositiveDefinite(int(off[0]))
    if lu.nnz <= READABLE:
        check_pivots(lu.U.diagonal(), diagonal, np.argsort(lu.perm_c))
        return
    probe = np.random.default_rng(0).normal(size=diagonal.size)
    shape = lu.solve(probe)
    worst = int(np.argmax(np.abs(shape)))
    if not probe @ shape > SINGULAR * diagonal[worst] * (shape @ shape):
        raise NotPositiveDefinite(worst)


def _refuse_singular(lu: Any, scale: Floats) -> None:
    """Raise `NotPositiveDefinite` where a factorized general matrix is singular to rounding.

    Where the factor is too large to be copied, the solution for a random right-hand side stands in:
    it is as large as the inverse, as far as that right-hand side has a part in its direction.

    Args:
        lu: the factorization.
        scale: (n,) largest entry of each column of the matrix.
    """
    if lu.nnz <= READABLE:
        pivots = np.abs(lu.U.diagonal())[lu.perm_c]
        small = np.flatnonzero(~(pivots > SINGULAR * scale))
    else:
        probe = np.random.default_rng(0).normal(size=scale.size)
        size = np.abs(lu.solve(probe * scale))
        small = np.flatnonzero(~(size < 1.0 / SINGULAR))
    if small.size:
        raise NotPositiveDefinite(int(small[0]))


def solve_in_blocks(lu: Any, rhs: Floats) -> Floats:
    """Solutions in the place of right-hand sides (n, k) in Fortran order."""
    for start in range(0, rhs.shape[1], BLOCK):
        rhs[:, start : start + BLOCK] = lu.solve(rhs[:, start : start + BLOCK])
    return rhs


class GeneralFactor:
    """A factorized general matrix.

    Args:
        pattern: of the lower triangle, in a fill-reducing order.
        below: (nnz,) values K[i, j] of the entries of the pattern.
        above: (nnz,) values K[j, i].
        counts: where to count.

    Raises:
        NotPositiveDefinite: the matrix is singular.
    """

    def __init__(
        self, pattern: LowerPattern, below: Floats, above: Floats, counts: SolverCounts
    ) -> None:
        self._counts = counts
        counts.factorizations += 1
        columns = np.repeat(np.arange(pattern.n), np.diff(pattern.indptr))
        off = pattern.indices != columns
        rows = np.concatenate([pattern.indices, columns[off]])
        matrix = sp.csc_array(
            (
                np.concatenate([below, above[off]]),
                (rows, np.concatenate([columns, pattern.indices[off]])),
            ),
            shape=(pattern.n, pattern.n),
        )
        try:
            self._lu = splu(matrix, permc_spec="NATURAL", diag_pivot_thresh=0.01)
        except RuntimeError as error:
            raise NotPositiveDefinite from error
        scale = np.maximum.reduceat(np.abs(matrix.data), matrix.indptr[:-1])
        _refuse_singular(self._lu, scale)

    @property
    def valid(self) -> bool:
        """Always: it has its numbers to itself."""
        return True

    def solve(self, rhs: Floats) -> Floats:
        """Solutions (n, k) for right-hand sides (n, k); counts k solves."""
        self._counts.solves += rhs.shape[1]
        return solve_in_blocks(self._lu, np.array(rhs, order="F"))
