"""SuperLU for matrices that are not symmetric, on a symmetric pattern.

The tangent of a material whose plastic flow is not associated is not symmetric (theory 5). Such a
matrix is given by the values of its lower triangle and, entry by entry, those of its upper one.
"""

from __future__ import annotations

import numpy as np
import scipy.sparse as sp
from scipy.sparse.linalg import splu

from geoident.fem.solvers.protocol import LowerPattern, NotPositiveDefinite, SolverCounts
from geoident.fem.solvers.splu import solve_in_blocks
from geoident.model.arrays import Floats


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

    @property
    def valid(self) -> bool:
        """Always: it has its numbers to itself."""
        return True

    def solve(self, rhs: Floats) -> Floats:
        """Solutions (n, k) for right-hand sides (n, k); counts k solves."""
        self._counts.solves += rhs.shape[1]
        return solve_in_blocks(self._lu, np.array(rhs, order="F"))
