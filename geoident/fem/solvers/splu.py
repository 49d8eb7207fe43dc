"""SuperLU, which comes with scipy: always present, slower than the others.

It factorizes general matrices, so it is given both triangles and told to keep the pivots on the
diagonal, which positive definiteness allows.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import scipy.sparse as sp
from scipy.sparse.linalg import splu

from geoident.fem.solvers.counts import SolverCounts
from geoident.fem.solvers.direct import DirectAnalysis, Solve, check_pivots
from geoident.fem.solvers.protocol import LowerPattern, NotPositiveDefinite
from geoident.model.arrays import Floats, Ints

BLOCK = 4
"""Right-hand sides solved together; SuperLU loses its cache with more."""


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

    def _factorize(self, values: Floats, diagonal: Floats) -> Solve:
        full = self._full
        matrix = sp.csc_array((values[full.data], full.indices, full.indptr), shape=full.shape)
        try:
            lu = splu(
                matrix, permc_spec="NATURAL", diag_pivot_thresh=0.0, options={"SymmetricMode": True}
            )
        except RuntimeError as error:  # exactly singular
            raise NotPositiveDefinite from error
        unknowns = np.argsort(lu.perm_c)
        if not np.array_equal(lu.perm_r, lu.perm_c):  # left the diagonal: its entry was zero
            raise NotPositiveDefinite(int(np.flatnonzero(lu.perm_r != lu.perm_c)[0]))
        check_pivots(lu.U.diagonal(), diagonal, unknowns)
        return lambda rhs: _solve_in_blocks(lu, rhs)


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


def _solve_in_blocks(lu: Any, rhs: Floats) -> Floats:
    for start in range(0, rhs.shape[1], BLOCK):
        rhs[:, start : start + BLOCK] = lu.solve(rhs[:, start : start + BLOCK])
    return rhs
