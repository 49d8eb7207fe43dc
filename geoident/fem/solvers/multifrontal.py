"""Our own multifrontal Cholesky factorization, on scipy's BLAS, as a `Solver`.

It needs nothing but numpy and scipy, takes all cores, keeps what it has found of unknowns whose
equations last from stage to stage (`fronts.lasting`), and factorizes what is large in single
precision, with solutions refined to double precision (`fronts.single`).
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial
from weakref import WeakValueDictionary

import numpy as np

from geoident.fem.solvers.direct import (
    DirectAnalysis,
    LowerPattern,
    NotPositiveDefinite,
    Solve,
    SolveInParts,
    SolverCounts,
    check_pivots,
)
from geoident.fem.solvers.fronts.blas import Dense, Kernels, kernels
from geoident.fem.solvers.fronts.elimination import Eliminated, Strips, eliminate
from geoident.fem.solvers.fronts.lasting import LastingPart, lasting_columns
from geoident.fem.solvers.fronts.layout import EliminationPlan, layout
from geoident.fem.solvers.fronts.memory import Memory
from geoident.fem.solvers.fronts.single import (
    CONTRACTION,
    NotContracting,
    SymmetricMatrix,
    contraction,
    in_range,
    refined,
    single_pays,
)
from geoident.fem.solvers.fronts.tasks import Runner, Work, run_alone, run_tasks
from geoident.fem.solvers.threads import one_thread
from geoident.model.arrays import Floats, Ints

SUSPICIOUS = 1e-6
"""A pivot in single precision below this part of its diagonal entry is looked at in double."""


COLUMNS = 16
"""Right-hand sides that one thread solves together."""


class MultifrontalSolver:
    """Our own factorization as a `Solver`.

    Args:
        counts: where to count; its own if not given.
        single: factorize in single precision; None: where that is faster or saves much memory.
    """

    name = "multifrontal"
    keeps_from = 0.0

    def __init__(self, counts: SolverCounts | None = None, *, single: bool | None = None) -> None:
        self.counts = counts if counts is not None else SolverCounts()
        self._single, self._memory = single, Memory()
        self._parts: WeakValueDictionary[bytes, LastingPart] = WeakValueDictionary()

    def analyse(self, pattern: LowerPattern) -> MultifrontalAnalysis:
        """Find the fronts of this pattern."""
        if not pattern.lasting or pattern.names is None:
            return MultifrontalAnalysis(pattern, self.counts, self._memory, self._single)
        columns = lasting_columns(pattern)
        part = self._parts.get(columns.key)
        if part is None:
            part = LastingPart(columns, self._memory)
            self._parts[columns.key] = part
        return MultifrontalAnalysis(
            pattern, self.counts, self._memory, self._single, part, columns.border
        )


class MultifrontalAnalysis(DirectAnalysis):
    """The fronts of a pattern.

    Args:
        pattern: the pattern.
        counts: where to count.
        memory: of the solver.
        single: factorize in single precision; None to choose.
        lasting: the unknowns that last, if there are some.
        border: (b,) unknowns at their border.
    """

    def __init__(
        self,
        pattern: LowerPattern,
        counts: SolverCounts,
        memory: Memory,
        single: bool | None = None,
        lasting: LastingPart | None = None,
        border: Ints | None = None,
    ) -> None:
        super().__init__(pattern, counts)
        self._lasting, self._memory = lasting, memory
        n = 0 if lasting is None else lasting.n
        self._n = n
        self._border = np.empty(0, dtype=np.int64) if border is None else border - n
        self._first = int(pattern.indptr[n])
        indptr, indices = pattern.indptr[n:] - self._first, pattern.indices[self._first :] - n
        cliques = [] if lasting is None else [self._border[c] for c in lasting.cliques()]
        rest = pattern.n - n
        known = (pattern.graph, pattern.fronts) if lasting is None else None
        keeps = lasting is not None
        self._plan = layout(indptr, indices, rest, cliques, keep_order=keeps, known=known)
        self._whole: EliminationPlan | None = self._plan if lasting is None else None
        entries = self._plan.panel_size + (0 if lasting is None else lasting.plan.panel_size)
        work = self._plan.flops if lasting is None else 0.0
        self.single = single_pays(work, entries) if single is None else single
        """Whether it factorizes in single precision, if the matrix allows."""

    def _release(self) -> None:
        """The factor dies with its last user: nothing of it is kept here."""

    def _factorize(self, values: Floats, diagonal: Floats) -> Solve:
        if not (self.single and in_range(diagonal)):
            return self._parts(values, diagonal, kernels("f8"))
        solve = self._in_single(values, diagonal)
        if solve is None:
            solve = self._in_double(values, diagonal)
            self.single = False  # it would not be enough the next time either
        return solve

    def preconditioner(self, values: Floats) -> Solve:
        """How to solve about (n, k): in single precision without refinement, if that is enough.

        Args:
            values: (nnz,) of the matrix.

        Raises:
            NotPositiveDefinite: the matrix is not.
        """
        diagonal = values[self.pattern.indptr[:-1]]
        self.factorized += 1
        if in_range(diagonal):
            try:
                factor = self._parts(values, diagonal, kernels("f4"))
            except NotPositiveDefinite:
                return self._in_double(values, diagonal)
            if (
                contraction(SymmetricMatrix(self.pattern, values), factor.precondition)
                < CONTRACTION
            ):
                return factor.precondition
        return self._in_double(values, diagonal)

    def _in_single(self, values: Floats, diagonal: Floats) -> Solve | None:
        """How to solve by a factorization in single precision; None if that is not enough."""
        try:
            factor = self._parts(values, diagonal, kernels("f4"))
        except NotPositiveDefinite:
            return None
        kept = values.copy()
        matrix = SymmetricMatrix(self.pattern, kept)
        if not contraction(matrix, factor.precondition) < CONTRACTION:
            return None
        instead: list[Solve] = []

        def solve(rhs: Floats) -> Floats:
            if not instead:
                try:
                    return refined(matrix, factor.precondition, rhs, self.counts)
                except NotContracting:
                    instead.append(self._in_double(kept, matrix.diagonal))
            return instead[0](rhs)

        return solve

    def _in_double(self, values: Floats, diagonal: Floats) -> Solve:
        """A factorization of the whole in double precision, where single is not enough."""
        if self._whole is None:
            pattern = self.pattern
            self._whole = layout(pattern.indptr, pattern.indices, pattern.n)
        plan = self._whole
        self.counts.flops += plan.flops
        found = eliminate(plan, kernels("f8"), values, self._memory)
        check_pivots(found.pivots(), diagonal, plan.order)
        return _Parts(None, 1.0, self._border, found, self.counts)

    def _parts(self, values: Floats, diagonal: Floats, kernel: Kernels) -> _Parts:
        """The factorization, of which what lasts may be kept from an earlier one."""
        single = kernel.dtype == np.float32
        least = SUSPICIOUS if single else None
        plan, n = self._plan, self._n
        part: Eliminated | None = None
        factor, outside = 1.0, list[Strips]()
        if self._lasting is not None:
            kept, factor = self._lasting.at(
                values[: self._first], diagonal[:n], kernel, self.counts, least
            )
            part = kept.eliminated
            outside = [_scaled(part.kept[k], factor) for k in part.layout.roots]
        self.counts.flops += plan.flops
        try:
            rest = eliminate(plan, kernel, values[self._first :], self._memory, outside)
            check_pivots(rest.pivots(), diagonal[n:], plan.order, least=least)
        except NotPositiveDefinite as error:
            unknown = None if error.unknown is None else n + error.unknown
            raise NotPositiveDefinite(unknown) from error
        return _Parts(part, factor, self._border, rest, self.counts)


@dataclass(frozen=True)
class _Parts(SolveInParts):
    """A factor whose first unknowns were eliminated for the matrix over a factor.

    Args:
        part: elimination of the first unknowns; None if there are none.
        scale: factor of their columns.
        border: (b,) unknowns of the rest at their border.
        rest_factor: factor of what is left.
        counts: where to count.
    """

    part: Eliminated | None
    scale: float
    border: Ints
    rest_factor: Eliminated
    counts: SolverCounts

    @property
    def n_first(self) -> int:
        """Number of the first unknowns."""
        return 0 if self.part is None else self.part.layout.n_eliminated

    def precondition(self, rhs: Floats) -> Floats:
        """Solutions (n, k) in single precision; columns are brought into its range."""
        size = np.abs(rhs).max(axis=0)
        size[~(size > 0)] = 1.0
        return np.asarray(self(np.asfortranarray(rhs / size)) * size)

    def __call__(self, rhs: Floats) -> Floats:
        """Solutions (n, k) in the place of right-hand sides, some columns at a time."""
        some = _some(rhs)
        with one_thread():
            _run_columns([partial(self._solve, rhs[:, k], _way(some)) for k in some])
        entries = self._entries(self.part) + self._entries(self.rest_factor)
        self.counts.passed += 2.0 * len(some) * entries
        return rhs

    def rest(self, rhs: Floats) -> Floats:
        """Solutions (n - n_first, k) in the place of right-hand sides."""
        some = _some(rhs)
        with one_thread():
            _run_columns([partial(self._solve_rest, rhs[:, k], _way(some)) for k in some])
        self.counts.passed += 2.0 * len(some) * self._entries(self.rest_factor)
        return rhs

    def first(self, rest: Floats) -> Floats:
        """The first unknowns (n_first, k) that follow the others (n - n_first, k)."""
        found = np.empty((self.n_first, rest.shape[1]), order="F")
        some = _some(rest)
        with one_thread():
            _run_columns([partial(self._follow, found[:, k], rest[:, k], _way(some)) for k in some])
        self.counts.passed += len(some) * self._entries(self.part)
        return found

    @staticmethod
    def _entries(part: Eliminated | None) -> float:
        return 0.0 if part is None else float(part.layout.panel_size)

    def _solve(self, rhs: Floats, run: Runner) -> None:
        part, dtype = self.part, self.rest_factor.kernels.dtype
        if part is None:
            self._solve_rest(rhs, run)
            return
        n, first = part.layout.n_eliminated, part.layout.order
        x: Dense = np.zeros((len(first), rhs.shape[1]), dtype=dtype)
        x[:n] = rhs[first[:n]]
        part.forward(x, run)
        y = rhs[n:]
        y[self.border] += x[n:]
        self._solve_rest(y, run)
        x[:n] /= self.scale
        x[n:] = y[self.border]
        part.backward(x, run)
        rhs[first[:n]] = x[:n]

    def _solve_rest(self, rhs: Floats, run: Runner) -> None:
        rest = self.rest_factor
        order = rest.layout.order
        z: Dense = np.ascontiguousarray(rhs[order], dtype=rest.kernels.dtype)
        rest.forward(z, run)
        rest.backward(z, run)
        rhs[order] = z

    def _follow(self, found: Floats, rest: Floats, run: Runner) -> None:
        part = self.part
        assert part is not None
        n, first = part.layout.n_eliminated, part.layout.order
        x: Dense = np.zeros((len(first), rest.shape[1]), dtype=part.kernels.dtype)
        x[n:] = rest[self.border]
        part.backward(x, run)
        found[first[:n]] = x[:n]


def _way(some: list[slice]) -> Runner:
    """How tasks of a solution are done: side by side, unless columns already are."""
    return run_tasks if len(some) == 1 else run_alone


def _run_columns(tasks: list[Work]) -> None:
    """Solve columns side by side; those of a single task divide the tree instead."""
    if len(tasks) == 1:
        tasks[0]()
    else:
        run_tasks(tasks)


def _some(columns: Floats) -> list[slice]:
    """The columns that one thread solves together."""
    return [slice(k, k + COLUMNS) for k in range(0, columns.shape[1], COLUMNS)]


def _scaled(strips: Strips, factor: float) -> Strips:
    if factor == 1.0:
        return strips
    return [strip * strip.dtype.type(factor) for strip in strips]
