"""Preconditioned conjugate gradients for several right-hand sides at once, cut off where it pays.

Hestenes & Stiefel (1952). Each column has its own iteration; products with the matrix and solves of
the preconditioner are made for all columns that still need them together. The matrix may be
singular, as tangents of ground that flows are: the iteration of a column ends where its direction
has no curvature, with what was found so far, or with that direction if it is the first (Steihaug
1983, SIAM J. Numer. Anal. 20, 626-637). So what comes back is always a direction of descent of
1/2 x^T K x - b^T x.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from geoident.model.arrays import Floats

Product = Callable[[Floats], Floats]
"""K x (n, k) of x (n, k), or the solutions M^-1 r of a preconditioner."""

FLAT = 1e-12
"""d^T K d below this part of d^T M d is no curvature."""


@dataclass(frozen=True)
class Iterated:
    """What conjugate gradients found.

    Args:
        x: (n, k) solutions, or how far they were brought.
        steps: products with the matrix.
        reached: whether all columns have the residual that was asked for.
    """

    x: Floats
    steps: int
    reached: bool


def conjugate_gradients(
    product: Product, rhs: Floats, precondition: Product, *, tolerance: float, most: int
) -> Iterated:
    """Solve K x = b.

    Args:
        product: K x; K symmetric and positive semidefinite.
        rhs: (n, k) right-hand sides b.
        precondition: M^-1 r; M symmetric and positive definite.
        tolerance: of the residual, relative to b, column by column.
        most: products at most.
    """
    x, size = np.zeros_like(rhs), np.linalg.norm(rhs, axis=0)
    going = np.flatnonzero(size > 0.0)
    reached = True
    if not going.size:
        return Iterated(x, 0, reached)
    r = rhs[:, going].copy()
    d = precondition(r)
    rz = (r * d).sum(axis=0)
    measure = rz.copy()  # d^T M d
    for step in range(1, most + 1):
        q = product(d)
        curvature = (d * q).sum(axis=0)
        flat = ~(curvature > FLAT * measure)
        length = rz / np.where(flat, 1.0, curvature)
        length[flat] = 1.0 if step == 1 else 0.0
        x[:, going] += length * d
        r -= length * q
        short = np.linalg.norm(r, axis=0) <= tolerance * size[going]
        reached = reached and not bool((flat & ~short).any())
        on = np.flatnonzero(~short & ~flat)
        if not on.size:
            return Iterated(x, step, reached)
        going, r, d = going[on], r[:, on], d[:, on]
        z = precondition(r)
        following = (r * z).sum(axis=0)
        ratio = following / rz[on]
        d = z + ratio * d
        measure = following + ratio**2 * measure[on]
        rz = following
    return Iterated(x, most, False)
