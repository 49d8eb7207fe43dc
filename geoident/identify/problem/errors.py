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

from copy import copy
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Protocol

import numpy as np
import scipy.sparse as sp
from scipy.linalg import cho_solve, solve_triangular
from scipy.linalg.lapack import dtrtri
from scipy.sparse.csgraph import connected_components

from geoident.model.arrays import Bools, Floats, Ints


class SharedErrors:
    """What readings share of their errors: B, (g, K), SI.

    Args:
        columns: one column for each shared error, in the standard deviations that it gives.
    """

    def __init__(self, columns: sp.csr_array) -> None:
        self._unsized = sp.csr_array(columns)
        self._size: Floats | None = None

    def __len__(self) -> int:
        return int(self._unsized.shape[1])

    def sized(self, factor: Floats) -> SharedErrors:
        """The same with each of them times a factor (K,); what hangs together is found once."""
        _ = self.blocks, self._whole  # the copy takes them along
        found = copy(self)
        found.__dict__.pop("columns", None)
        found._size = factor if self._size is None else self._size * factor
        return found

    @cached_property
    def columns(self) -> sp.csr_array:
        """B (g, K), SI."""
        if self._size is None:
            return self._unsized
        B = self._unsized
        return sp.csr_array((B.data * self._size[B.indices], B.indices, B.indptr), shape=B.shape)

    def only(self, kept: Bools) -> SharedErrors:
        """Of some of the readings (g,)."""
        return SharedErrors(sp.csr_array(self.columns[np.flatnonzero(kept)]))

    @cached_property
    def blocks(self) -> tuple[tuple[Ints, Ints], ...]:
        """Readings (m,) and shared errors (k,) that hang together; readings without any: none."""
        g = self._unsized.shape[0]
        entries = self._unsized.tocoo()
        size = g + self._unsized.shape[1]
        link = sp.csr_array(
            (np.ones(entries.nnz), (entries.row, g + entries.col)), shape=(size, size)
        )
        _, label = connected_components(link, directed=False)
        order = np.argsort(label, kind="stable")
        groups = np.split(order, np.flatnonzero(np.diff(label[order])) + 1)
        found = ((members[members < g], members[members >= g] - g) for members in groups)
        return tuple((rows, shared) for rows, shared in found if len(rows) and len(shared))

    def block(self, rows: Ints, shared: Ints) -> Columns:
        """A block (m, k) of B, dense where that is small or most of it is not zero."""
        if self._whole is not None:
            whole = np.asarray(self._whole[np.ix_(rows, shared)])
            return whole if self._size is None else whole * self._size[shared]
        block = sp.csr_array(self.columns[rows][:, shared])
        size = len(rows) * len(shared)
        return np.asarray(block.toarray()) if size <= max(_SMALL, 3 * block.nnz) else block

    @cached_property
    def _whole(self) -> Floats | None:
        """B, not sized, as a dense matrix where it is small: much faster to take blocks from."""
        small = self._unsized.shape[0] * self._unsized.shape[1] <= _SMALL
        return np.asarray(self._unsized.toarray()) if small else None


Columns = Floats | sp.csr_array
"""A matrix of shared errors (m, k), dense or sparse."""

_SMALL = 4_000_000
"""Entries of a matrix that is kept dense (32 MB)."""


def scaled_rows(scale: Floats, columns: Columns) -> Columns:
    """diag(scale) times a matrix (m, k) for a scale (m,)."""
    if isinstance(columns, np.ndarray):
        return np.asarray(scale[:, None] * columns)
    return sp.csr_array(sp.diags_array(scale) @ columns)


def products(columns: Columns, weight: Floats) -> Floats:
    """C^T diag(weight) C, (k, k), of C (m, k) for a weight (m,)."""
    found = columns.T @ scaled_rows(weight, columns)
    return np.asarray(found if isinstance(found, np.ndarray) else found.toarray())


class _Block(Protocol):
    """Readings that hang together, in own standard deviations: 1 + C C^T of rows (m,)."""

    rows: Ints
    shared: Ints

    @property
    def conditional(self) -> Floats:
        """Covariance (k, k) of z, given the readings."""

    def white(self, own: Floats) -> Floats:
        """L^-1 of values (m, ...)."""

    def solved(self, own: Floats) -> Floats:
        """The inverse times values (m, ...)."""

    def given(self, own: Floats) -> Floats:
        """The z (k, ...) to be expected, of values (m, ...)."""

    def diagonal(self) -> Floats:
        """Diagonal (m,) of the inverse."""

    def log_root(self) -> float:
        """Half of the logarithm of the determinant."""


FEW = 300
"""Readings of a block up to which its covariance is factorized as it is."""


class _FewReadings:
    """A block of few readings: a dense Cholesky factor, exact however large the shared errors."""

    def __init__(self, rows: Ints, shared: Ints, C: Columns) -> None:
        self.rows, self.shared = rows, shared
        self._C = np.asarray(C if isinstance(C, np.ndarray) else C.toarray())
        L = np.linalg.cholesky(np.eye(len(rows)) + self._C @ self._C.T)
        self._log_root = float(np.log(np.diag(L)).sum())
        self._inverse = np.asarray(dtrtri(L, lower=1)[0])

    @cached_property
    def conditional(self) -> Floats:
        """Covariance (k, k) of z, given the readings."""
        seen = self._inverse @ self._C
        return np.asarray(np.eye(len(self.shared)) - seen.T @ seen)

    def white(self, own: Floats) -> Floats:
        """L^-1 of values (m, ...)."""
        return np.asarray(self._inverse @ own)

    def solved(self, own: Floats) -> Floats:
        """The inverse times values (m, ...)."""
        return np.asarray(self._inverse.T @ (self._inverse @ own))

    def given(self, own: Floats) -> Floats:
        """The z (k, ...) to be expected, of values (m, ...)."""
        return np.asarray(self._C.T @ self.solved(own))

    def diagonal(self) -> Floats:
        """Diagonal (m,) of the inverse."""
        return np.asarray(np.sum(self._inverse**2, axis=0))

    def log_root(self) -> float:
        """Half of the logarithm of the determinant."""
        return self._log_root


class _ManyReadings:
    """A block of many readings: the factor R of A = 1 + C^T C, of the size of what is shared."""

    def __init__(self, rows: Ints, shared: Ints, C: Columns) -> None:
        self.rows, self.shared, self._C = rows, shared, C
        A = products(C, np.ones(len(rows)))
        A[np.diag_indices_from(A)] += 1.0
        self._R = np.asarray(np.linalg.cholesky(A))

    @cached_property
    def conditional(self) -> Floats:
        """Covariance (k, k) of z, given the readings."""
        return np.asarray(cho_solve((self._R, True), np.eye(len(self._R))))

    def white(self, own: Floats) -> Floats:
        """L^-1 of values (m, ...)."""
        inner = solve_triangular(self._R, self._C.T @ own, lower=True)
        plus = self._R + np.eye(len(self._R))
        pulled = solve_triangular(plus, inner, lower=True, trans="T")
        return np.asarray(own - self._C @ pulled)

    def solved(self, own: Floats) -> Floats:
        """The inverse times values (m, ...)."""
        return np.asarray(own - self._C @ self.given(own))

    def given(self, own: Floats) -> Floats:
        """The z (k, ...) to be expected, of values (m, ...)."""
        return np.asarray(cho_solve((self._R, True), self._C.T @ own))

    def diagonal(self) -> Floats:
        """Diagonal (m,) of the inverse."""
        least = np.finfo(np.float64).eps  # what rounding leaves where shared errors are all
        return np.maximum(1.0 - row_squares(self._C, self.conditional), least)

    def log_root(self) -> float:
        """Half of the logarithm of the determinant."""
        return float(np.log(np.diag(self._R)).sum())


def _block(rows: Ints, shared: Ints, C: Columns) -> _Block:
    few = len(rows) <= max(FEW, len(shared))
    return _FewReadings(rows, shared, C) if few else _ManyReadings(rows, shared, C)


class Covariance:
    """Sigma = diag(s^2) + B B^T and its factor.

    Args:
        sd: (g,) standard deviations s of what each reading has by itself, SI, positive.
        shared: what readings share.
    """

    def __init__(self, sd: Floats, shared: SharedErrors) -> None:
        self.sd = sd
        self.shared = shared
        self._blocks = tuple(
            _block(rows, columns, scaled_rows(1.0 / sd[rows], shared.block(rows, columns)))
            for rows, columns in shared.blocks
        )

    def whiten(self, values: Floats) -> Floats:
        """L^-1 of values (g,) or (g, k)."""
        white = values / _column(self.sd, values)
        for block in self._blocks:
            white[block.rows] = block.white(white[block.rows])
        return np.asarray(white)

    def solve(self, values: Floats) -> Floats:
        """Sigma^-1 of values (g,) or (g, k)."""
        own = values / _column(self.sd, values)
        for block in self._blocks:
            own[block.rows] = block.solved(own[block.rows])
        return np.asarray(own / _column(self.sd, values))

    def log_determinant(self) -> float:
        """Logarithm of the determinant of Sigma."""
        more = sum(block.log_root() for block in self._blocks)
        return 2.0 * (float(np.log(self.sd).sum()) + more)

    @cached_property
    def inverse(self) -> Floats:
        """Sigma^-1, (g, g): for few readings."""
        return self.solve(np.eye(len(self.sd)))

    @cached_property
    def inverse_diagonal(self) -> Floats:
        """Diagonal (g,) of Sigma^-1."""
        found = np.ones(len(self.sd))
        for block in self._blocks:
            found[block.rows] = block.diagonal()
        return np.asarray(found / self.sd**2)

    def expected_shared(self, values: Floats) -> Floats:
        """The z (K, ...) to be expected, B^T Sigma^-1 of errors (g, ...), SI."""
        own = values / _column(self.sd, values)
        z = np.zeros((len(self.shared), *values.shape[1:]))
        for block in self._blocks:
            z[block.shared] = block.given(own[block.rows])
        return z

    def conditional_variance(self, columns: sp.csr_array) -> Floats:
        """Variance (l,) that rows (l, K) of shared errors keep, given the g readings."""
        found = np.asarray(columns.power(2).sum(axis=1), dtype=np.float64).ravel()
        for block in self._blocks:
            part = sp.csr_array(columns[:, block.shared])
            rows = np.flatnonzero(np.diff(part.indptr))
            if len(rows):
                less = block.conditional - np.eye(len(block.shared))
                found[rows] += row_squares(sp.csr_array(part[rows]), less)
        return found

    def conditional_covariance(self, columns: sp.csr_array) -> Floats:
        """Covariance (l, l) of what rows (l, K) of shared errors keep, given the g readings."""
        found = np.asarray((columns @ columns.T).toarray(), dtype=np.float64)
        for block in self._blocks:
            part = sp.csr_array(columns[:, block.shared])
            less = block.conditional - np.eye(len(block.shared))
            found += part @ np.asarray((part @ less).T)
        return found

    def without_others(self, rows: Ints, values: Floats) -> Floats:
        """The inverse of the block (m, m) of Sigma^-1 that belongs to rows (m,), times values.

        It is the covariance of their errors given all others, D + B (T^-1 - C^T C)^-1 B^T with T
        the part of A^-1 of the errors that they share: of the size of what is shared, not of m.

        Args:
            rows: (m,) numbers of readings.
            values: (m, ...), SI.

        Returns:
            (m, ...) SI.
        """
        if len(rows) <= FEW:
            unit = np.zeros((len(self.sd), len(rows)))
            unit[rows, np.arange(len(rows))] = 1.0
            return np.asarray(np.linalg.solve(self.solve(unit)[rows], values))
        found = _column(self.sd[rows] ** 2, values) * values
        for block in self._blocks:
            inside = np.isin(rows, block.rows)
            if not inside.any():
                continue
            columns = sp.csr_array(self.shared.columns[rows[inside]][:, block.shared])
            touched = np.flatnonzero(np.diff(columns.tocsc().indptr))
            B = np.asarray(columns[:, touched].toarray())
            C = B / self.sd[rows[inside], None]
            others = np.linalg.inv(block.conditional[np.ix_(touched, touched)]) - C.T @ C
            found[inside] += B @ np.linalg.solve(others, B.T @ values[inside])
        return np.asarray(found)


def row_squares(columns: Columns, matrix: Floats) -> Floats:
    """The diagonal (m,) of C M C^T for C (m, k) and M (k, k), some rows at a time."""
    found = np.zeros(columns.shape[0])
    few = max(1, _SMALL // max(1, columns.shape[1]))
    for first in range(0, len(found), few):
        part = columns[first : first + few]
        moved = part @ matrix
        both = part * moved if isinstance(part, np.ndarray) else part.multiply(moved)
        found[first : first + few] = np.asarray(both.sum(axis=1)).ravel()
    return found


def _column(scale: Floats, values: Floats) -> Floats:
    """A scale (g,) as it divides values (g,) or (g, k)."""
    return scale if values.ndim == 1 else scale[:, None]


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
        return ErrorStructure(
            self.sd,
            self.component,
            sp.csr_array(sp.hstack([self.columns, columns])),
            np.concatenate([self.column_component, number]),
            (*self.names, name),
        )

    def with_one_factor(self, name: str) -> ErrorStructure:
        """The same with all errors in one component: all sizes are wrong by one factor."""
        component, columns = np.zeros_like(self.component), np.zeros_like(self.column_component)
        return ErrorStructure(self.sd, component, self.columns, columns, (name,))

    def rows(self, kept: Ints) -> ErrorStructure:
        """Of some of the readings (m,)."""
        return ErrorStructure(
            self.sd[kept],
            self.component[kept],
            sp.csr_array(self.columns[kept]),
            self.column_component,
            self.names,
        )
