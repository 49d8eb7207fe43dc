"""Seen and undetermined directions of the parameters, by singular values (theory 6).

Each parameter is measured by the admissible range R between its bounds, z = x / R, so that "no
better known than the bounds" means the same for all. A direction v_k of the singular value
decomposition U S V^T of the weighted Jacobian in z is known with the standard deviation 1/S_k.
Its admissible extent is L_k = 1 / max_i |v_ik|: the parameter that moves most spans its
bounds. The direction is *undetermined* if its 95 % interval is wider than that, or below rounding:

    2 * 1.96 / S_k > L_k    or    S_k <= 1e-10 S_1.

Its standard deviation is then taken as min(1/S_k, L_k), never more than the bounds allow.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from geoident.identify.problem.scaling import Scaling
from geoident.model.arrays import Bools, Floats
from geoident.model.results.bands import NORMAL_95

UNBOUNDED_RANGE = 10.0
"""Admissible range in x of a parameter without finite bounds: ten references, or a factor e^10."""

RANK = 1e-10
"""Singular values below this part of the largest are rounding."""


def admissible_ranges(scaling: Scaling) -> Floats:
    """Range (n,) in x between the bounds of each parameter; zero of what is given."""
    width = scaling.upper - scaling.lower
    return np.where(np.isfinite(width), width, UNBOUNDED_RANGE)


@dataclass(frozen=True)
class SingularDirections:
    """Directions and how well each is known.

    Args:
        V: (n, q) right singular vectors in z; zero rows of parameters that do not take part.
        S: (q,) singular values, largest first, zeros where there are fewer rows than parameters.
    """

    V: Floats
    S: Floats

    @classmethod
    def of(cls, A: Floats, taking_part: Bools) -> SingularDirections:
        """Decomposes A (rows, n), whitened and in z; parameters (n,) may stay out."""
        q = int(taking_part.sum())
        padded = np.zeros((max(q, A.shape[0]), q))
        padded[: A.shape[0]] = A[:, taking_part]
        _, S, Vt = np.linalg.svd(padded, full_matrices=False)
        V = np.zeros((A.shape[1], q))
        V[taking_part] = Vt.T
        return cls(V, S)

    @property
    def extent(self) -> Floats:
        """Admissible extent L (q,) of each direction in z."""
        largest: Floats = np.abs(self.V).max(axis=0, initial=0.0)
        return 1.0 / largest

    @property
    def undetermined(self) -> Bools:
        """Directions (q,) that are not better known than by the bounds."""
        rounding = np.less_equal(self.S, RANK * self.S.max(initial=0.0))
        wide = np.less(self.S * self.extent, 2.0 * NORMAL_95)
        return np.asarray(wide | rounding, dtype=np.bool_)

    @property
    def determined_covariance(self) -> Floats:
        """Sum over the determined directions of v v^T / S^2, (n, n) in z."""
        return self.determined_columns @ self.determined_columns.T

    @property
    def determined_columns(self) -> Floats:
        """Determined directions (n, d) in z, one standard deviation long each."""
        return self.V[:, ~self.undetermined] / self.S[~self.undetermined]

    @property
    def undetermined_vectors(self) -> Floats:
        """Unit vectors (n, u) in z."""
        return self.V[:, self.undetermined]

    @property
    def undetermined_columns(self) -> Floats:
        """Undetermined directions (n, u) in z, one standard deviation long each."""
        S, L = self.S[self.undetermined], self.extent[self.undetermined]
        return self.undetermined_vectors / np.maximum(S, 1.0 / L)


def without(vectors: Floats, taken: Floats) -> Floats:
    """Orthonormal basis (n, c) of what the columns of ``vectors`` span beside those of ``taken``.

    Both (n, .) have orthonormal columns.
    """
    rest = vectors - taken @ (taken.T @ vectors)
    U, S, _ = np.linalg.svd(rest, full_matrices=False)
    return np.asarray(U[:, S > 0.5], dtype=np.float64)


def sparse_basis(vectors: Floats) -> Floats:
    """Another basis (n, u) of the span of columns (n, u), each with few entries.

    Gauss-Jordan elimination with full pivoting: each column has one parameter of its own, which
    is zero in the others. So two independent gaps are not mixed into one another.
    """
    basis = vectors.copy()
    done = np.zeros(basis.shape[1], dtype=bool)
    for _ in range(basis.shape[1]):
        size = np.abs(basis)
        size[:, done] = 0.0
        row, column = np.unravel_index(int(np.argmax(size)), size.shape)
        basis[:, column] /= basis[row, column]
        others = np.arange(basis.shape[1]) != column
        basis[:, others] -= np.outer(basis[:, column], basis[row, others])
        done[column] = True
    return basis
