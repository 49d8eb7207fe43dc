"""Preconditioned conjugate gradients for several right-hand sides at once.

Hestenes & Stiefel (1952). Each column has its own iteration (`ConjugateDirections`); products with
the matrix and solves of the preconditioner are made for all columns that still need them together.
Who iterates says when a column is done, and what a direction without curvature means: cut off where
it pays (`conjugate_gradients`), for steps of Newton's method; or to a bounded error in energy, for
solutions (`fem.solvers.multilevel.energy`).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from geoident.model.arrays import Bools, Floats, Ints

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


class ConjugateDirections:
    """The iteration of K x = b, column by column; columns that are zero have none.

    One step is `curvature`, `advance`, and `turn`; `keep` between them drops columns that are done.

    Args:
        product: K x.
        precondition: M^-1 r.
        rhs: (n, k) right-hand sides b.

    Attributes:
        x: (n, k) what was found so far.
        going: columns that go on, of which are
        r: (n, g) residuals,
        d: (n, g) directions,
        rz: (g,) r^T M^-1 r.
    """

    def __init__(self, product: Product, precondition: Product, rhs: Floats) -> None:
        self._product, self._precondition = product, precondition
        self.x, self.going = np.zeros_like(rhs), np.flatnonzero(rhs.any(axis=0))
        self.r = rhs[:, self.going]
        self.d = precondition(self.r) if self.going.size else self.r
        self.rz = (self.r * self.d).sum(axis=0)
        self._q = self.d

    def curvature(self) -> Floats:
        """The product with the matrix; d^T K d (g,)."""
        self._q = self._product(self.d)
        return np.asarray((self.d * self._q).sum(axis=0))

    def advance(self, length: Floats) -> None:
        """Go along the directions, so far (g,)."""
        self.x[:, self.going] += length * self.d
        self.r = self.r - length * self._q

    def keep(self, on: Bools | Ints) -> None:
        """Go on with some of the columns (g,) alone."""
        self.going, self.rz = self.going[on], self.rz[on]
        self.r, self.d = self.r[:, on], self.d[:, on]

    def turn(self) -> Floats:
        """The solve of the preconditioner: new directions; r^T M^-1 r by that of before (g,)."""
        z = self._precondition(self.r)
        following = (self.r * z).sum(axis=0)
        ratio = following / self.rz
        self.d, self.rz = z + ratio * self.d, following
        return np.asarray(ratio)


def conjugate_gradients(
    product: Product, rhs: Floats, precondition: Product, *, tolerance: float, most: int
) -> Iterated:
    """Solve K x = b, cut off where it pays.

    The matrix may be singular, as tangents of ground that flows are: the iteration of a column ends
    where its direction has no curvature, with what was found so far, or with that direction if it
    is the first (Steihaug 1983, SIAM J. Numer. Anal. 20, 626-637). So what comes back is always a
    direction of descent of 1/2 x^T K x - b^T x.

    Args:
        product: K x; K symmetric and positive semidefinite.
        rhs: (n, k) right-hand sides b.
        precondition: M^-1 r; M symmetric and positive definite.
        tolerance: of the residual, relative to b, column by column.
        most: products at most.
    """
    size, reached = np.linalg.norm(rhs, axis=0), True
    found = ConjugateDirections(product, precondition, rhs)
    if not found.going.size:
        return Iterated(found.x, 0, reached)
    measure = found.rz.copy()  # d^T M d
    for step in range(1, most + 1):
        curvature = found.curvature()
        flat = ~(curvature > FLAT * measure)
        length = found.rz / np.where(flat, 1.0, curvature)
        length[flat] = 1.0 if step == 1 else 0.0
        found.advance(length)
        short = np.linalg.norm(found.r, axis=0) <= tolerance * size[found.going]
        reached = reached and not bool((flat & ~short).any())
        on = np.flatnonzero(~short & ~flat)
        if not on.size:
            return Iterated(found.x, step, reached)
        found.keep(on)
        measure = measure[on]
        ratio = found.turn()
        measure = found.rz + ratio**2 * measure
    return Iterated(found.x, most, False)
