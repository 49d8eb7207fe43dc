"""What many matrices have in common is eliminated once.

In a staged model most of the ground is never touched. Its unknowns come first in the order
(`LowerPattern.lasting`); their elimination leaves a dense matrix on the unknowns at its border,
which is added to the rest. Both stay as long as the values of these columns are those for which
they were found, or these times one factor c, as when the modulus of the ground changes: then

    A = c L L^T,    update matrix c U.

Patterns share what they have in common when names and places of the entries are the same.
"""

from __future__ import annotations

import hashlib
from dataclasses import dataclass

import numpy as np

from geoident.fem.solvers.direct import (
    LowerPattern,
    SolverCounts,
    check_pivots,
)
from geoident.fem.solvers.fronts.blas import Kernels
from geoident.fem.solvers.fronts.elimination import Eliminated, eliminate
from geoident.fem.solvers.fronts.layout import layout
from geoident.fem.solvers.fronts.memory import Memory
from geoident.model.arrays import Floats, Ints

SAME = 16.0 * float(np.finfo(np.float64).eps)
"""Values that differ by so little, against the diagonal, are the same but for rounding."""


@dataclass(frozen=True)
class LastingColumns:
    """The lasting columns of a pattern by themselves.

    Args:
        indptr: (n + b + 1,) starts; those of unknowns at the border are empty.
        indices: (nnz,) rows, those at the border numbered from n.
        border: (b,) unknowns of the pattern at the border, ascending.
        key: what tells these columns from others.
    """

    indptr: Ints
    indices: Ints
    border: Ints
    key: bytes


def lasting_columns(pattern: LowerPattern) -> LastingColumns:
    """The lasting columns of a pattern that has names."""
    assert pattern.names is not None
    n = pattern.lasting
    ends = pattern.indptr[: n + 1]
    rows = pattern.indices[: ends[-1]]
    outside = rows >= n
    border, place = np.unique(rows[outside], return_inverse=True)
    indices = rows.copy()
    indices[outside] = n + place
    indptr = np.concatenate([ends, np.full(len(border), ends[-1])])
    digest = hashlib.sha256()
    for part in (ends, indices, pattern.names[:n], pattern.names[border]):
        digest.update(np.ascontiguousarray(part, dtype=np.int64).tobytes())
        digest.update(b"/")
    return LastingColumns(indptr, indices, border, digest.digest())


@dataclass(frozen=True)
class KeptPart:
    """The elimination of the lasting unknowns, for some values of their columns.

    Args:
        eliminated: their fronts.
        values: (nnz,) for which it was made.
        tolerance: (nnz,) difference from these, times a factor, that other values may have.
    """

    eliminated: Eliminated
    values: Floats
    tolerance: Floats

    def factor_to(self, values: Floats) -> float | None:
        """The factor c with values (nnz,) = c times its own, or None."""
        if np.array_equal(values, self.values):
            return 1.0
        largest = int(np.argmax(np.abs(self.values)))
        c = float(values[largest] / self.values[largest])
        if not (np.isfinite(c) and c > 0):
            return None
        off = np.abs(values - c * self.values)
        return c if bool((off <= c * self.tolerance).all()) else None


class LastingPart:
    """The lasting unknowns, for all patterns that have them.

    Args:
        columns: of one of the patterns.
        memory: of the solver.
    """

    def __init__(self, columns: LastingColumns, memory: Memory) -> None:
        self._columns, self._memory = columns, memory
        self.n = len(columns.indptr) - 1 - len(columns.border)
        self.plan = layout(columns.indptr, columns.indices, self.n)
        self._kept: KeptPart | None = None

    def cliques(self) -> list[Ints]:
        """(h,) for each root that passes something on, its rows, counted along the border."""
        plan = self.plan
        return [plan.order[plan.fronts[k].rows] - self.n for k in plan.roots]

    def at(
        self,
        values: Floats,
        diagonal: Floats,
        kernel: Kernels,
        counts: SolverCounts,
        least: float | None = None,
    ) -> tuple[KeptPart, float]:
        """The elimination for some values, kept or made, and the factor by which it is multiplied.

        Args:
            values: (nnz,) of the columns.
            diagonal: (n,) of the matrix.
            kernel: of the precision.
            counts: where to count.
            least: smallest pivot, as `check_pivots` takes it.

        Raises:
            NotPositiveDefinite: with the unknown.
        """
        kept = self._kept
        if kept is not None and kept.eliminated.kernels is kernel:
            factor = kept.factor_to(values)
            if factor is not None:
                counts.kept_flops += self.plan.flops
                return kept, factor
        kept = self._kept = None  # its memory is given back before the next is made
        counts.flops += self.plan.flops
        eliminated = eliminate(self.plan, kernel, values, self._memory)
        check_pivots(eliminated.pivots(), diagonal, self.plan.order[: self.n], least=least)
        own = values.copy()
        self._kept = KeptPart(eliminated, own, self._tolerance(own))
        return self._kept, 1.0

    def _tolerance(self, values: Floats) -> Floats:
        """(nnz,) differences that are rounding: a part of the geometric mean of two diagonals.

        Of an unknown at the border the largest entry stands for the diagonal.
        """
        indptr, indices = self._columns.indptr, self._columns.indices
        scale = np.zeros(len(indptr) - 1)
        np.maximum.at(scale, indices, np.abs(values))
        column = np.repeat(np.arange(self.n), np.diff(indptr[: self.n + 1]))
        return np.asarray(SAME * np.sqrt(scale[column] * scale[indices]))
