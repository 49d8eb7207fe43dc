"""Errors that readings share, and the whitening that makes them count as what they are (theory 7).

The errors of g readings are e = own + B z with independent own errors of standard deviation s and
K shared ones z, each of variance one; B holds their sizes. So

    Sigma = diag(s^2) + B B^T = L L^T

and L^-1 e is white. Readings that share nothing, even through others, are blocks of their own: one
dense Cholesky factor a block, made once.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
import scipy.sparse as sp
from scipy.linalg.lapack import dtrtri
from scipy.sparse.csgraph import connected_components

from geoident.model.arrays import Bools, Floats, Ints


class SharedErrors:
    """What readings share of their errors: B, (g, K), SI.

    Args:
        columns: one column for each shared error, in the standard deviations that it gives.
        blocks: what hangs together, if that is known already.
    """

    def __init__(
        self, columns: sp.csr_array, blocks: tuple[tuple[Ints, Ints], ...] | None = None
    ) -> None:
        self.columns = sp.csr_array(columns)
        self._blocks = blocks

    def __len__(self) -> int:
        return int(self.columns.shape[1])

    def only(self, kept: Bools) -> SharedErrors:
        """Of some of the readings (g,)."""
        return SharedErrors(sp.csr_array(self.columns[np.flatnonzero(kept)]))

    @cached_property
    def blocks(self) -> tuple[tuple[Ints, Ints], ...]:
        """Readings (m,) and shared errors (k,) that hang together; readings without any: none."""
        if self._blocks is not None:
            return self._blocks
        g = self.columns.shape[0]
        entries = self.columns.tocoo()
        size = g + self.columns.shape[1]
        link = sp.csr_array(
            (np.ones(entries.nnz), (entries.row, g + entries.col)), shape=(size, size)
        )
        _, label = connected_components(link, directed=False)
        order = np.argsort(label, kind="stable")
        groups = np.split(order, np.flatnonzero(np.diff(label[order])) + 1)
        found = ((members[members < g], members[members >= g] - g) for members in groups)
        return tuple((rows, shared) for rows, shared in found if len(rows) and len(shared))

    def dense(self, rows: Ints, shared: Ints) -> Floats:
        """A block (m, k) of B."""
        if self._whole is not None:
            return np.asarray(self._whole[np.ix_(rows, shared)])
        return np.asarray(self.columns[rows][:, shared].toarray())

    @cached_property
    def _whole(self) -> Floats | None:
        """B as a dense matrix where that is small: much faster to take blocks from."""
        small = self.columns.shape[0] * self.columns.shape[1] <= _SMALL
        return np.asarray(self.columns.toarray()) if small else None


_SMALL = 4_000_000
"""Entries of a matrix that is kept dense (32 MB)."""


class Covariance:
    """Sigma = diag(s^2) + B B^T and its factor.

    Args:
        sd: (g,) standard deviations s of what each reading has by itself, SI, positive.
        shared: what readings share.
    """

    def __init__(self, sd: Floats, shared: SharedErrors) -> None:
        self.sd = sd
        self.shared = shared
        self.factors: list[tuple[Ints, Floats]] = []  # readings of a block, and its L^-1
        self._log_determinant = 2.0 * float(np.log(sd).sum())
        for rows, columns in shared.blocks:
            B = shared.dense(rows, columns)
            sigma = np.diag(sd[rows] ** 2) + B @ B.T
            L = np.linalg.cholesky(sigma)
            inverse, _ = dtrtri(L, lower=1)
            self.factors.append((rows, np.asarray(inverse)))
            self._log_determinant += 2.0 * float(np.log(np.diag(L) / sd[rows]).sum())

    def whiten(self, values: Floats) -> Floats:
        """L^-1 of values (g,) or (g, k)."""
        white = values / _column(self.sd, values)
        for rows, inverse in self.factors:
            white[rows] = inverse @ values[rows]
        return np.asarray(white)

    def solve(self, values: Floats) -> Floats:
        """Sigma^-1 of values (g,) or (g, k)."""
        found = values / _column(self.sd**2, values)
        for rows, inverse in self.factors:
            found[rows] = inverse.T @ (inverse @ values[rows])
        return np.asarray(found)

    def log_determinant(self) -> float:
        """Logarithm of the determinant of Sigma."""
        return self._log_determinant

    @cached_property
    def inverse(self) -> Floats:
        """Sigma^-1, (g, g)."""
        found = np.diag(self.sd**-2.0)
        for rows, inverse in self.factors:
            found[np.ix_(rows, rows)] = inverse.T @ inverse
        return np.asarray(found)


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
        columns = sp.csr_array(self.columns @ sp.diags_array(size))
        return sd, SharedErrors(columns, self._blocks)

    @cached_property
    def _blocks(self) -> tuple[tuple[Ints, Ints], ...]:
        return SharedErrors(self.columns).blocks

    def rows(self, kept: Ints) -> ErrorStructure:
        """Of some of the readings (m,)."""
        return ErrorStructure(
            self.sd[kept],
            self.component[kept],
            sp.csr_array(self.columns[kept]),
            self.column_component,
            self.names,
        )
