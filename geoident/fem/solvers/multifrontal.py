"""Our own multifrontal Cholesky factorization, on scipy's BLAS, as a `Solver`.

It needs nothing but numpy and scipy, uses all cores, and keeps what it has found of unknowns whose
equations last from stage to stage (`fronts.lasting`).
"""

from __future__ import annotations

from weakref import WeakValueDictionary

import numpy as np

from geoident.fem.solvers.direct import (
    DirectAnalysis,
    LowerPattern,
    NotPositiveDefinite,
    Solve,
    SolverCounts,
    check_pivots,
)
from geoident.fem.solvers.fronts.blas import Dense, kernels
from geoident.fem.solvers.fronts.elimination import Eliminated, Strips, eliminate
from geoident.fem.solvers.fronts.lasting import KeptPart, LastingPart, lasting_columns
from geoident.fem.solvers.fronts.layout import layout
from geoident.model.arrays import Floats, Ints


class MultifrontalSolver:
    """Our own factorization as a `Solver`.

    Args:
        counts: where to count; its own if not given.
    """

    name = "multifrontal"
    keeps_from = 0.0

    def __init__(self, counts: SolverCounts | None = None) -> None:
        self.counts = counts if counts is not None else SolverCounts()
        self._parts: WeakValueDictionary[bytes, LastingPart] = WeakValueDictionary()

    def analyse(self, pattern: LowerPattern) -> MultifrontalAnalysis:
        """Find the fronts of this pattern."""
        if not pattern.lasting or pattern.names is None:
            return MultifrontalAnalysis(pattern, self.counts)
        columns = lasting_columns(pattern)
        part = self._parts.get(columns.key)
        if part is None:
            part = LastingPart(columns, kernels("f8"))
            self._parts[columns.key] = part
        return MultifrontalAnalysis(pattern, self.counts, part, columns.border)


class MultifrontalAnalysis(DirectAnalysis):
    """The fronts of a pattern.

    Args:
        pattern: the pattern.
        counts: where to count.
        lasting: the unknowns that last, if there are some.
        border: (b,) unknowns at their border.
    """

    def __init__(
        self,
        pattern: LowerPattern,
        counts: SolverCounts,
        lasting: LastingPart | None = None,
        border: Ints | None = None,
    ) -> None:
        super().__init__(pattern, counts)
        self._lasting = lasting
        n = 0 if lasting is None else lasting.n
        self._n = n
        self._border = np.empty(0, dtype=np.int64) if border is None else border - n
        self._first = int(pattern.indptr[n])
        indptr, indices = pattern.indptr[n:] - self._first, pattern.indices[self._first :] - n
        cliques = [] if lasting is None else [self._border[c] for c in lasting.cliques()]
        rest = pattern.n - n
        self._layout = layout(indptr, indices, rest, cliques, keep_order=lasting is not None)

    def _release(self) -> None:
        """The factor dies with its last user: nothing of it is kept here."""

    def _factorize(self, values: Floats, diagonal: Floats) -> Solve:
        plan, n = self._layout, self._n
        kept: KeptPart | None = None
        factor, outside = 1.0, list[Strips]()
        if self._lasting is not None:
            kept, factor = self._lasting.at(values[: self._first], diagonal[:n], self.counts)
            found = kept.eliminated
            outside = [_scaled(found.kept[k], factor) for k in found.layout.roots]
        self.counts.flops += plan.flops
        try:
            rest = eliminate(plan, kernels("f8"), values[self._first :], outside)
        except NotPositiveDefinite as error:
            raise NotPositiveDefinite(n + (error.unknown or 0)) from error
        order = plan.order
        try:
            check_pivots(rest.pivots(), diagonal[n:], order)
        except NotPositiveDefinite as error:
            raise NotPositiveDefinite(n + (error.unknown or 0)) from error
        if kept is None:
            return lambda rhs: _solve(rest, rhs)
        part = kept.eliminated
        return lambda rhs: _solve_both(part, factor, self._border, rest, rhs)


def _scaled(strips: Strips, factor: float) -> Strips:
    return strips if factor == 1.0 else [factor * strip for strip in strips]


def _solve(factor: Eliminated, rhs: Floats) -> Floats:
    """Solutions (n, k) by a factor of the whole matrix."""
    order = factor.layout.order
    x: Dense = np.ascontiguousarray(rhs[order])
    factor.forward(x)
    factor.backward(x)
    rhs[order] = x
    return rhs


def _solve_both(
    part: Eliminated, scale: float, border: Ints, rest: Eliminated, rhs: Floats
) -> Floats:
    """Solutions (n, k) where the first unknowns were eliminated for the matrix over a factor.

    Args:
        part: elimination of the first unknowns.
        scale: factor of their columns.
        border: (b,) unknowns of the rest at their border.
        rest: factor of what is left.
        rhs: right-hand sides.
    """
    n = part.layout.n_eliminated
    first, second = part.layout.order, rest.layout.order
    x = np.zeros((len(first), rhs.shape[1]))
    x[:n] = rhs[first[:n]]
    part.forward(x)
    y = rhs[n:]
    y[border] += x[n:]
    z = np.ascontiguousarray(y[second])
    rest.forward(z)
    rest.backward(z)
    y[second] = z
    x[:n] /= scale
    x[n:] = y[border]
    part.backward(x)
    rhs[first[:n]] = x[:n]
    return rhs
