"""Errors that readings share, and the whitening that makes them count as what they are (theory 7).

The errors of g readings are e = own + B z with independent own errors of standard deviation s and
K shared ones z, each of variance one; B holds their sizes. So

    Sigma = D + B B^T = L L^T ,   D = diag(s^2)

and L^-1 e is white. Sigma is diagonal but for the few things that are shared, so nothing of its
size (g, g) is made. With C = D^(-1/2) B and the Cholesky factor R of the small matrix A,

    A = I + C^T C = R R^T                                             (K, K)
    L^-1      = (I - C X C^T) D^(-1/2) ,   X = (R + A)^-1 = (I + R^T)^-1 R^-1
    Sigma^-1  = D^(-1/2) (I - C A^-1 C^T) D^(-1/2)                    (Woodbury)
    |Sigma|   = |D| |A|

L^-1 is any matrix with L^-T L^-1 = Sigma^-1: (R^T + A) A^-1 (R + A) = A + R + R^T + I shows that
this is one. A^-1 is also the covariance of z, given the readings. For few readings the dense factor
of Sigma serves, which is exact even where own errors are next to nothing beside the shared ones.
Readings that share nothing, even through others, are blocks of their own: one factor a block, made
once.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
import scipy.sparse as sp
from scipy.linalg import cho_solve, solve_triangular
from scipy.linalg.lapack import dtrtri
from scipy.sparse.csgraph import connected_components

from geoident.model.arrays import Bools, Floats, Ints

Columns = Floats | sp.csr_array
"""A matrix of shared errors (m, k), dense or sparse."""

FEW = 300
"""Readings of a block up to which its covariance is factorized as it is."""

_STACKED = 40
"""Readings of a block up to which those of equal size are factorized together."""

_SMALL = 4_000_000
"""Entries of a matrix that is kept dense (32 MB)."""

_QUICK = 200_000
"""Entries of B up to which it is kept dense, too (1.6 MB)."""


class SharedErrors:
    """What readings share of their errors: B, (g, K), SI.

    Args:
        columns: one column for each shared error, in the standard deviations that it gives.
        pattern: the same errors in other sizes, whose blocks are these; None for none.
    """

    def __init__(self, columns: sp.csr_array, pattern: SharedErrors | None = None) -> None:
        self.columns = sp.csr_array(columns)
        self._pattern = pattern

    def __len__(self) -> int:
        return int(self.columns.shape[1])

    def sized(self, factor: Floats) -> SharedErrors:
        """The same with each of them times a factor (K,)."""
        B = self.columns
        sized = sp.csr_array((B.data * factor[B.indices], B.indices, B.indptr), shape=B.shape)
        return SharedErrors(sized, self._pattern or self)

    def only(self, kept: Bools) -> SharedErrors:
        """Of some of the readings (g,)."""
        return SharedErrors(sp.csr_array(self.columns[np.flatnonzero(kept)]))

    @cached_property
    def blocks(self) -> tuple[tuple[Ints, Ints, Columns], ...]:
        """Readings (m,) and errors (k,) that hang together, and B (m, k) of each such block.

        Readings that share nothing are in none.
        """
        B = self.quick
        return tuple((rows, shared, _block(B, rows, shared)) for rows, shared in self._connected)

    @cached_property
    def quick(self) -> Columns:
        """B, dense where it is small: a part of a sparse one takes a hundred times as long."""
        small = self.columns.shape[0] * self.columns.shape[1] <= _QUICK
        return self.columns.toarray() if small else self.columns

    @cached_property
    def _connected(self) -> tuple[tuple[Ints, Ints], ...]:
        if self._pattern is not None:
            return self._pattern._connected
        return _connected(self.columns, np.arange(len(self)))

    @cached_property
    def parts(self) -> tuple[tuple[tuple[Ints, Ints], ...], Ints]:
        """Blocks that are small once the errors that many readings share are taken out of them.

        Errors of zeros alone make a block of each channel; that of a set-up beside makes one block
        of all. Which errors count as those of many is a matter of cost alone, and blocks of up to
        `FEW` readings are never cut.

        Returns:
            Blocks of equal size together, readings (b, m) and shared errors (b, k), and the
            numbers (w,) of the errors that are taken out.
        """
        if self._pattern is not None:
            return self._pattern.parts
        g, K = self.columns.shape
        if g <= FEW or K == 0:
            return _of_equal_size(self._connected), np.zeros(0, dtype=np.int64)
        support = _support(self.columns)
        best, least = (self._connected, np.zeros(0, dtype=np.int64)), np.inf
        limit = max(g // 2, 1)
        while limit >= 1:
            wide = np.flatnonzero(support > limit)
            blocks = _connected(self.columns, np.flatnonzero(support <= limit))
            cost = float(g) * len(wide) ** 2 + sum(_cost(len(m), len(k)) for m, k in blocks)
            if cost < least:
                best, least = (blocks, wide), cost
            if all(len(m) <= FEW for m, _ in blocks):
                break  # smaller ones save nothing
            limit //= 2
        return _of_equal_size(best[0]), best[1]


def _block(B: Columns, rows: Ints, shared: Ints) -> Columns:
    """A block (m, k) of B, dense where that is small or most of it is not zero."""
    if isinstance(B, np.ndarray):
        return np.asarray(B[np.ix_(rows, shared)])
    block = sp.csr_array(B[rows][:, shared])
    dense = len(rows) * len(shared) <= max(_SMALL, 3 * block.nnz)
    return np.asarray(block.toarray()) if dense else block


def _support(columns: sp.csr_array) -> Ints:
    """(K,) how many readings each shared error is one of."""
    return np.bincount(columns.indices, minlength=columns.shape[1])


def _connected(columns: sp.csr_array, chosen: Ints) -> tuple[tuple[Ints, Ints], ...]:
    """Readings (m,) and shared errors (k,), of those chosen, that hang together."""
    g, support = columns.shape[0], _support(columns)[chosen]
    if support.max(initial=0) == g > 0:  # one that all share: the others need not be looked at
        return ((np.arange(g), chosen[support > 0]),)
    entries = columns[:, chosen].tocoo()
    size = g + len(chosen)
    link = sp.csr_array((np.ones(entries.nnz), (entries.row, g + entries.col)), shape=(size, size))
    _, label = connected_components(link, directed=False)
    order = np.argsort(label, kind="stable")
    groups = np.split(order, np.flatnonzero(np.diff(label[order])) + 1)
    parts = ((members[members < g], chosen[members[members >= g] - g]) for members in groups)
    return tuple((rows, shared) for rows, shared in parts if len(rows) and len(shared))


def _of_equal_size(blocks: Sequence[tuple[Ints, Ints]]) -> tuple[tuple[Ints, Ints], ...]:
    """Blocks of few readings and equal size together: readings (b, m), shared errors (b, k)."""
    sizes: dict[tuple[int, int, int], list[tuple[Ints, Ints]]] = {}
    for n, (rows, shared) in enumerate(blocks):
        alone = n if len(rows) > _STACKED else -1
        sizes.setdefault((len(rows), len(shared), alone), []).append((rows, shared))
    return tuple(
        (np.array([rows for rows, _ in each]), np.array([shared for _, shared in each]))
        for each in sizes.values()
    )


def _cost(m: int, k: int) -> float:
    """Operations, about, for a block of m readings with k shared errors."""
    return float(m) ** 3 if m <= max(FEW, k) else float(m) * k**2 + float(k) ** 3


def scaled_rows(scale: Floats, columns: Columns) -> Columns:
    """diag(scale) times a matrix (m, k) for a scale (m,)."""
    if isinstance(columns, np.ndarray):
        return np.asarray(scale[:, None] * columns)
    return sp.csr_array(sp.diags_array(scale) @ columns)


def products(columns: Columns, weight: Floats) -> Floats:
    """C^T diag(weight) C, (k, k), of C (m, k) for a weight (m,), not negative."""
    if isinstance(columns, np.ndarray):
        scaled = columns if np.all(weight == 1.0) else np.sqrt(weight)[:, None] * columns
        return np.asarray(scaled.T @ scaled)
    return np.asarray(sp.csr_array(columns.T @ scaled_rows(weight, columns)).toarray())


class _Factor(ABC):
    """The factor L L^T = 1 + C C^T of b blocks of readings, in own standard deviations.

    Args:
        rows: (b, m) the readings.
        shared: (b, k) what they share.

    Attributes:
        log_root: half of the logarithm of the determinant, of all b.
    """

    log_root: float

    def __init__(self, rows: Ints, shared: Ints) -> None:
        self.rows, self.shared = rows, shared

    @abstractmethod
    def white(self, own: Floats) -> Floats:
        """L^-1 of values (b, m, n)."""

    @abstractmethod
    def back(self, white: Floats) -> Floats:
        """L^-T of values (b, m, n): the inverse times what was whitened."""

    @property
    @abstractmethod
    def diagonal(self) -> Floats:
        """Diagonal (b, m) of the inverse."""

    @property
    @abstractmethod
    def conditional(self) -> Floats:
        """Covariance (b, k, k) of z, given the readings."""


class _FewReadings(_Factor):
    """Dense Cholesky factors of the size of the blocks, exact however large shared errors are."""

    def __init__(self, rows: Ints, shared: Ints, C: Floats) -> None:
        super().__init__(rows, shared)
        L = np.linalg.cholesky(np.eye(rows.shape[1]) + C @ C.swapaxes(1, 2))
        self.log_root = float(np.log(np.diagonal(L, axis1=1, axis2=2)).sum())
        self._inverse = np.stack([dtrtri(one, lower=1)[0] for one in L])
        self._C = C

    def white(self, own: Floats) -> Floats:
        return np.asarray(self._inverse @ own)

    def back(self, white: Floats) -> Floats:
        return np.asarray(self._inverse.swapaxes(1, 2) @ white)

    @property
    def diagonal(self) -> Floats:
        return np.asarray(np.sum(self._inverse**2, axis=1))

    @property
    def conditional(self) -> Floats:
        white = self._inverse @ self._C
        return np.asarray(np.eye(self._C.shape[2]) - white.swapaxes(1, 2) @ white)


class _ManyReadings(_Factor):
    """A block of many readings: the factor R of A = 1 + C^T C, of the size of what is shared."""

    def __init__(self, rows: Ints, shared: Ints, C: Columns) -> None:
        super().__init__(rows[None], shared[None])
        one = np.eye(len(shared))
        self.R = np.asarray(np.linalg.cholesky(one + products(C, np.ones(len(rows)))))
        self.log_root = float(np.log(np.diag(self.R)).sum())
        self._plus, self._C = self.R + one, C

    def white(self, own: Floats) -> Floats:
        if not len(self.R):
            return own
        inner = solve_triangular(self.R, self._C.T @ own[0], lower=True)
        pulled = solve_triangular(self._plus, inner, lower=True, trans="T")
        return np.asarray(own[0] - self._C @ pulled)[None]

    def back(self, white: Floats) -> Floats:
        if not len(self.R):
            return white
        inner = solve_triangular(self._plus, self._C.T @ white[0], lower=True)
        pulled = solve_triangular(self.R, inner, lower=True, trans="T")
        return np.asarray(white[0] - self._C @ pulled)[None]

    @property
    def diagonal(self) -> Floats:
        C, A_inverse = self._C, self.conditional[0]
        squares = np.zeros(C.shape[0])
        few = max(1, _SMALL // max(1, C.shape[1]))
        for first in range(0, len(squares), few):  # some rows at a time
            part = C[first : first + few]
            moved = part @ A_inverse
            both = part * moved if isinstance(part, np.ndarray) else part.multiply(moved)
            squares[first : first + few] = np.asarray(both.sum(axis=1)).ravel()
        least = np.finfo(np.float64).eps  # what rounding leaves where shared errors are all
        return np.maximum(1.0 - squares, least)[None]

    @property
    def conditional(self) -> Floats:
        return np.asarray(cho_solve((self.R, True), np.eye(len(self.R))))[None]

    @property
    def root(self) -> Floats:
        """C R^-T, (m, k): the inverse is 1 less it times its transposed."""
        return np.asarray(solve_triangular(self.R, np.asarray(self._C.T), lower=True).T)


def _factor(rows: Ints, shared: Ints, errors: SharedErrors, sd: Floats) -> _Factor:
    """The factor of blocks of equal size: readings (b, m), shared errors (b, k)."""
    b, m, k = *rows.shape, shared.shape[1]
    B = errors.quick
    if b == 1 and m > max(FEW, k):
        block = _block(B, rows[0], shared[0])
        return _ManyReadings(rows[0], shared[0], scaled_rows(1.0 / sd[rows[0]], block))
    if isinstance(B, np.ndarray):
        stacked = B[rows[:, :, None], shared[:, None, :]]
    else:
        entries = B[rows.ravel()][:, shared.ravel()].tocoo()
        stacked = np.zeros((b, m, k))
        stacked[entries.row // m, entries.row % m, entries.col % k] = entries.data
    return _FewReadings(rows, shared, stacked / sd[rows][:, :, None])


def _columns(values: Floats) -> Floats:
    """Values (g,) or (g, k) as columns, also of no readings."""
    return values[:, None] if values.ndim == 1 else values


def _some_at_a_time(change: Callable[[Floats], Floats], values: Floats) -> Floats:
    """Changes values (g, n) in their place, some columns at a time: only of these are copies."""
    some = max(1, _SMALL // max(1, len(values)))
    for first in range(0, values.shape[1], some):
        chosen = slice(first, first + some)
        values[:, chosen] = change(np.ascontiguousarray(values[:, chosen]))
    return values


class Covariance:
    """Sigma = diag(s^2) + B B^T and its factor.

    Of few readings, or of readings that share little, Sigma falls into blocks, each with a factor
    L_1 of its own. Errors W that many readings share go on top of these,

        Sigma = L_1 (1 + V V^T) L_1^T ,   V = L_1^-1 W ,

    of which 1 + V V^T is as 1 + C C^T above.

    Args:
        sd: (g,) standard deviations s of what each reading has by itself, SI, positive.
        shared: what readings share.
    """

    def __init__(self, sd: Floats, shared: SharedErrors) -> None:
        self.sd = sd
        self.shared = shared
        blocks, self._wide = shared.parts
        self._blocks = tuple(_factor(rows, errors, shared, sd) for rows, errors in blocks)
        W = shared.quick[:, self._wide]
        W = (W if isinstance(W, np.ndarray) else W.toarray()) / sd[:, None]
        self._V = _some_at_a_time(self._whitened_in_blocks, W)
        self._top = _ManyReadings(np.arange(len(sd)), self._wide, self._V)

    def _whitened_in_blocks(self, own: Floats) -> Floats:
        """L_1^-1 of values (g, n) in own standard deviations, in their place."""
        for block in self._blocks:
            own[block.rows] = block.white(own[block.rows])
        return own

    def _back_in_blocks(self, white: Floats) -> Floats:
        """L_1^-T of values (g, n), in their place."""
        for block in self._blocks:
            white[block.rows] = block.back(white[block.rows])
        return white

    def whiten(self, values: Floats) -> Floats:
        """L^-1 of values (g,) or (g, k)."""

        def white(own: Floats) -> Floats:
            return np.asarray(self._top.white(self._whitened_in_blocks(own)[None])[0])

        own = _columns(values) / self.sd[:, None]
        return _some_at_a_time(white, own).reshape(values.shape)

    def solve(self, values: Floats) -> Floats:
        """Sigma^-1 of values (g,) or (g, k)."""

        def back(white: Floats) -> Floats:
            return self._back_in_blocks(self._top.back(white[None])[0])

        solution = _some_at_a_time(back, _columns(self.whiten(values)))
        solution /= self.sd[:, None]
        return solution.reshape(values.shape)

    def log_determinant(self) -> float:
        """Logarithm of the determinant of Sigma."""
        factors = (*self._blocks, self._top)
        return 2.0 * (float(np.log(self.sd).sum()) + sum(factor.log_root for factor in factors))

    @cached_property
    def inverse(self) -> Floats:
        """Sigma^-1, (g, g): for few readings."""
        return self.solve(np.eye(len(self.sd)))

    @cached_property
    def _taken(self) -> Floats:
        """What W takes of the inverse of the blocks in own standard deviations, T T^T: T (g, w)."""
        return self._back_in_blocks(self._top.root)

    @cached_property
    def inverse_diagonal(self) -> Floats:
        """Diagonal (g,) of Sigma^-1."""
        diagonal = np.ones(len(self.sd))
        for block in self._blocks:
            diagonal[block.rows] = block.diagonal
        least = np.finfo(np.float64).eps * diagonal
        diagonal = np.maximum(diagonal - np.sum(self._taken**2, axis=1), least)
        return np.asarray(diagonal / self.sd**2)

    def expected_shared(self, values: Floats) -> Floats:
        """The z (K, ...) to be expected, B^T Sigma^-1 of errors (g, ...), SI."""
        return np.asarray(self.shared.columns.T @ self.solve(values))

    @cached_property
    def _given_wide(self) -> Floats:
        """What each of the wide errors makes others expect, with its sign turned: (K, w).

        Rows of the wide ones themselves are those of a unit matrix, so that rows of B times it are
        what is left to the wide errors.
        """
        left = np.asarray(-self._narrow.T @ self._back_in_blocks(self._V.copy()))
        left[self._wide] = np.eye(len(self._wide))
        return left

    @cached_property
    def _narrow(self) -> sp.csr_array:
        """B (g, K) in own standard deviations, zero for the wide errors."""
        kept = np.ones(len(self.shared))
        kept[self._wide] = 0.0
        scale = sp.diags_array(1.0 / self.sd)
        narrow = sp.csr_array(scale @ self.shared.columns @ sp.diags_array(kept))
        narrow.eliminate_zeros()
        return narrow

    @cached_property
    def _conditional_in_blocks(self) -> sp.csr_array:
        """Covariance (K, K) of the errors that are not wide, given the readings and the wide."""
        K = len(self.shared)
        alone = np.ones(K, dtype=np.bool_)  # no reading has to do with them
        alone[self._wide] = False
        row, column, size = list[Ints](), list[Ints](), list[Floats]()
        for block in self._blocks:
            alone[block.shared] = False
            conditional = block.conditional
            numbers = np.broadcast_to(block.shared[:, :, None], conditional.shape)
            row.append(numbers.ravel())
            column.append(numbers.swapaxes(1, 2).ravel())
            size.append(conditional.ravel())
        rest = np.flatnonzero(alone)
        at = np.concatenate([*row, rest]), np.concatenate([*column, rest])
        return sp.csr_array((np.concatenate([*size, np.ones(len(rest))]), at), shape=(K, K))

    def conditional_variance(self, columns: sp.csr_array) -> Floats:
        """Variance (l,) that rows (l, K) of shared errors keep, given the g readings."""
        own = columns.multiply(columns @ self._conditional_in_blocks).sum(axis=1)
        if not len(self._wide):
            return np.asarray(np.ravel(own), dtype=np.float64)
        left = solve_triangular(self._top.R, (columns @ self._given_wide).T, lower=True)
        return np.asarray(np.ravel(own) + np.sum(left**2, axis=0), dtype=np.float64)

    def conditional_covariance(self, columns: sp.csr_array) -> Floats:
        """Covariance (l, l) of what rows (l, K) of shared errors keep, given the g readings."""
        left = solve_triangular(self._top.R, (columns @ self._given_wide).T, lower=True)
        own = (columns @ self._conditional_in_blocks) @ columns.T
        return np.asarray(own.toarray() + left.T @ left)

    def inverse_along(self, columns: sp.csc_array) -> tuple[sp.csr_array, Floats]:
        """U^T Sigma^-1 U of sparse U (g, k), SI, as M - Q Q^T with M (k, k) sparse and Q (k, w)."""
        own = sp.csc_array(sp.diags_array(1.0 / self.sd) @ columns)
        shared = self._narrow.T @ own
        between = own.T @ own - shared.T @ self._conditional_in_blocks @ shared
        return sp.csr_array(between), np.asarray(own.T @ self._taken)

    def without_others(self, rows: Ints, values: Floats) -> Floats:
        """The inverse of the block (m, m) of Sigma^-1 that belongs to rows (m,), times values.

        It is the covariance of their errors given all others. Of many rows it is found as
        D + B (T^-1 - C^T C)^-1 B^T with T the covariance of the errors that they share, given all
        readings: of the size of what is shared, not of m.

        Args:
            rows: (m,) numbers of readings.
            values: (m, ...), SI.

        Returns:
            (m, ...) SI.
        """
        sd = self.sd[rows]
        if len(rows) <= FEW:
            narrow, taken = self._narrow[rows], self._taken[rows]
            inverse = np.eye(len(rows)) - taken @ taken.T
            inverse -= sp.csr_array(narrow @ self._conditional_in_blocks @ narrow.T).toarray()
            return np.asarray((np.linalg.solve(inverse, (values.T * sd).T).T * sd).T)
        some = sp.csr_array(self.shared.columns[rows])
        touched = np.unique(some.indices)
        unit = sp.csr_array(sp.eye_array(len(self.shared), format="csr")[touched])
        B = np.asarray(some[:, touched].toarray())
        C = B / sd[:, None]
        others = np.linalg.inv(self.conditional_covariance(unit)) - C.T @ C
        return np.asarray((values.T * sd**2).T + B @ np.linalg.solve(others, B.T @ values))


@dataclass(frozen=True)
class ErrorStructure:
    """Errors whose sizes may be to be estimated: g readings, K shared errors, c components.

    The variance of what belongs to a component is multiplied with one unknown factor.

    Args:
        sd: (g,) own standard deviations at factors of one, SI.
        component: (g,) number of the component of each; -1 where the size is given.
        columns: (g, K) B at factors of one, SI.
        column_component: (K,) likewise.
        names: of the c components.
    """

    sd: Floats
    component: Ints
    columns: sp.csr_array
    column_component: Ints
    names: tuple[str, ...]

    def at(self, log_factor: Floats) -> tuple[Floats, SharedErrors | None]:
        """Own standard deviations (g,) and shared errors, for the logarithms (c,) of the factors.

        None where nothing is shared.
        """
        root = np.exp(0.5 * np.append(log_factor, 0.0))  # the last one for -1: given
        sd = np.where(self.component < 0, self.sd, self.sd * root[self.component])
        if self.columns.shape[1] == 0:
            return sd, None
        size = np.where(self.column_component < 0, 1.0, root[self.column_component])
        return sd, self._shared.sized(size)

    @property
    def stated(self) -> tuple[Floats, SharedErrors | None]:
        """Own standard deviations (g,) and shared errors at factors of one."""
        return self.at(np.zeros(len(self.names)))

    def sized(self, log_factor: Floats) -> ErrorStructure:
        """The same where what had these logarithms (c,) of factors has factors of one."""
        sd, shared = self.at(log_factor)
        return replace(self, sd=sd, columns=self.columns if shared is None else shared.columns)

    @cached_property
    def _shared(self) -> SharedErrors:
        """At factors of one."""
        return SharedErrors(self.columns)

    def with_component(self, columns: sp.csr_array, name: str) -> ErrorStructure:
        """The same with one component more, of shared errors alone.

        Args:
            columns: (g, k) their sizes at a factor of one, SI.
            name: of the component.
        """
        number = np.full(columns.shape[1], len(self.names), dtype=np.int64)
        return replace(
            self,
            columns=sp.csr_array(sp.hstack([self.columns, columns])),
            column_component=np.concatenate([self.column_component, number]),
            names=(*self.names, name),
        )

    def with_one_factor(self, name: str) -> ErrorStructure:
        """The same with all errors in one component: all sizes are wrong by one factor."""
        return replace(
            self,
            component=np.zeros_like(self.component),
            column_component=np.zeros_like(self.column_component),
            names=(name,),
        )

    def rows(self, kept: Ints) -> ErrorStructure:
        """Of some of the readings (m,)."""
        columns = sp.csr_array(self.columns[kept])
        return replace(self, sd=self.sd[kept], component=self.component[kept], columns=columns)
