"""Single precision, made good in double: iterative refinement, and whether it may be trusted.

A factorization in single precision takes half the time and half the memory. It is that of a matrix
M = A + E near A, and refinement,

    x <- x + M^-1 (b - A x),

with the residual in double precision, ends at the same error as a factorization in double
precision (Wilkinson 1963; Higham, Accuracy and stability of numerical algorithms, 2002, ch. 12),
provided that rho = rho(I - M^-1 A) is small. That is measured by three steps of the power method on
a random vector: the eigenvalues of M^-1 A then lie in [1 - rho, 1 + rho], so a small rho also shows
that A is positive definite. A matrix that is indefinite, singular to working precision or too ill
conditioned for single precision all have an eigenvalue of M^-1 A near 0 or below, which
stands out from the rest near 1; such a matrix is factorized in double precision, which decides.

Scaling the matrix beforehand would change nothing but the range of the numbers: the rounding errors
of a Cholesky factorization are relative, and are those of the scaled matrix (van der Sluis 1969).
"""

from __future__ import annotations

from collections.abc import Callable
from functools import partial

import numpy as np
import scipy.sparse as sp

from geoident.fem.solvers.direct import LowerPattern, SolverCounts
from geoident.fem.solvers.fronts.tasks import run_tasks
from geoident.model.arrays import Floats

SINGLE_WORK = 4.0e10
"""Operations from which on a factorization is made in single precision.

With fewer, the further passes through the factor that refinement takes cost more than is saved.
"""

SINGLE_ENTRIES = 400_000_000
"""Entries of a factor from which on it is kept in single precision: 3 GB in double."""

CONTRACTION = 0.03
"""Largest part of an error that a step of refinement may leave."""

ROUNDING = 4.0 * float(np.finfo(np.float64).eps)
"""Backward error at which a solution is as good as that of a factorization in double precision."""

ENOUGH = 1e-14
"""Backward error that is accepted where steps do not make it smaller."""

MOST_STEPS = 12

COLUMNS = 64
"""Right-hand sides refined together; bounds the memory."""

RANGE = 1e-24
"""Ratio of diagonal entries below which numbers might leave the range of single precision."""

Precondition = Callable[[Floats], Floats]
"""M^-1 R (n, k) for R (n, k)."""


class NotContracting(ArithmeticError):
    """Refinement does not lead to the solution: single precision is not enough."""


class SymmetricMatrix:
    """A symmetric matrix by its lower triangle, to multiply with.

    Args:
        pattern: of the lower triangle.
        values: (nnz,) its values; kept, not copied.
    """

    def __init__(self, pattern: LowerPattern, values: Floats) -> None:
        shape = (pattern.n, pattern.n)
        self._lower = sp.csc_array((values, pattern.indices, pattern.indptr), shape=shape)
        self.diagonal = values[pattern.indptr[:-1]]
        size = abs(self._lower)
        ones = np.ones(pattern.n)
        sums = size @ ones + size.T @ ones - np.abs(self.diagonal)
        self.norm = float(sums.max())

    def times(self, x: Floats) -> Floats:
        """A x for x (n, k), the triangle and its transpose side by side."""
        parts: list[Floats] = [np.empty(0), np.empty(0)]

        def multiply(number: int, triangle: sp.csc_array | sp.csr_array) -> None:
            parts[number] = triangle @ x

        run_tasks([partial(multiply, 0, self._lower), partial(multiply, 1, self._lower.T)])
        result = parts[0]
        result += parts[1]
        result -= self.diagonal[:, None] * x
        return np.asarray(result)


def single_pays(work: float, entries: int) -> bool:
    """Whether a factorization is made in single precision.

    Args:
        work: its operations, without those for what may be kept.
        entries: of the factor.
    """
    return work >= SINGLE_WORK or entries >= SINGLE_ENTRIES


def in_range(diagonal: Floats) -> bool:
    """Whether a matrix with this diagonal (n,) can be factorized in single precision."""
    least, most = float(diagonal.min()), float(diagonal.max())
    return bool(least > max(RANGE * most, 1e-24) and most < 1e30)


def contraction(matrix: SymmetricMatrix, precondition: Precondition) -> float:
    """The spectral radius rho of I - M^-1 A, by the power method on a random vector.

    Vectors are measured by the root of v^T D v, D the diagonal of A, which has no units.
    """
    root = np.sqrt(matrix.diagonal)[:, None]
    error = np.random.default_rng(0).normal(size=root.shape) / root
    ratio, size = 0.0, float(np.linalg.norm(root * error))
    for _ in range(3):
        error = error - precondition(matrix.times(error))
        left = float(np.linalg.norm(root * error))
        ratio = left / size
        if not ratio > 1e-9:  # so near to A that nothing can stand out; or not a number
            break
        size = left
    return ratio if np.isfinite(ratio) else float("inf")


def refined(
    matrix: SymmetricMatrix, precondition: Precondition, rhs: Floats, counts: SolverCounts
) -> Floats:
    """Solutions (n, k) of A x = b to double precision, some columns at a time.

    Args:
        matrix: A.
        precondition: M^-1.
        rhs: b (n, k).
        counts: where steps are counted.

    Raises:
        NotContracting: steps do not make the residual small.
    """
    found = rhs.copy(order="F")
    for start in range(0, rhs.shape[1], COLUMNS):
        part = slice(start, start + COLUMNS)
        found[:, part] = _refine(matrix, precondition, rhs[:, part], counts)
    return found


def _refine(
    matrix: SymmetricMatrix, precondition: Precondition, rhs: Floats, counts: SolverCounts
) -> Floats:
    x = np.zeros_like(rhs)
    rest = rhs
    size = np.abs(rhs).max(axis=0)
    before = np.full(rhs.shape[1], np.inf)
    for _ in range(MOST_STEPS):
        x += precondition(rest)
        counts.refinements += rhs.shape[1]
        rest = rhs - matrix.times(x)
        scale = matrix.norm * np.abs(x).max(axis=0) + size
        error = np.abs(rest).max(axis=0) / np.where(scale > 0, scale, 1.0)
        if (error <= ROUNDING).all():
            return x
        if (error <= ENOUGH).all() and (error > 0.5 * before).any():
            return x
        if not np.isfinite(error).all():
            break
        before = error
    raise NotContracting
