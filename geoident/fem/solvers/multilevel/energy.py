"""Conjugate gradients (Hestenes & Stiefel 1952) that stop when the error in energy is known small.

Each column has its own iteration; products with the matrix and solves of the preconditioner are
made for all columns that still need them together.

With M the preconditioner and the eigenvalues of M^-1 K not below m,

    |e|_K^2 = r^T K^-1 r <= r^T M^-1 r / m ,

and r^T M^-1 r stands in the iteration anyway. A small problem with a random right-hand side, solved
beforehand, gives m: its coefficients are those of Lanczos' method, whose least Ritz value comes
down to the least eigenvalue (Golub & Van Loan, Matrix computations, 2013, 10.2). It is
brought to where a right-hand side of random numbers must have shown every eigenvalue that stands
apart: the part of an eigenvector with eigenvalue near zero, or below, stays in the residual until a
Ritz value has found it, and it is about one in the root of n. So a mechanism, or a matrix that is
not positive definite, is found whatever loads follow.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from geoident.fem.solvers.direct import NotPositiveDefinite
from geoident.model.arrays import Bools, Floats, Ints

Product = Callable[[Floats], Floats]
"""K x (n, k) of x (n, k), or the solutions M^-1 r of a preconditioner."""

TOLERANCE = 1e-10
"""Largest error in energy norm, relative to the solution."""

REVEALING = 1e-3
"""Residual, times the root of n, at which a random right-hand side has shown the eigenvalues."""

SAFE = 0.5
"""Part of the least Ritz value that is taken for the least eigenvalue."""

NEARLY_SINGULAR = 1e-9
"""A least eigenvalue of M^-1 K below this is rounding, not stiffness."""

MOST_STEPS = 400
"""Steps until a matrix is given up."""


class ConjugateDirections:
    """The iteration of K x = b, column by column; columns that are zero have none.

    One step is `curvature`, `advance`, and `turn`; `keep` between them drops columns that are done.

    Args:
        product: K x.
        precondition: M^-1 r.
        rhs: (n, k) right-hand sides b.

    Attributes:
        x: (n, k) what was found so far.
        active: columns that go on, of which are
        r: (n, g) residuals,
        d: (n, g) directions,
        rz: (g,) r^T M^-1 r.
    """

    def __init__(self, product: Product, precondition: Product, rhs: Floats) -> None:
        self._product, self._precondition = product, precondition
        self.x, self.active = np.zeros_like(rhs), np.flatnonzero(rhs.any(axis=0))
        self.r = rhs[:, self.active]
        self.d = precondition(self.r) if self.active.size else self.r
        self.rz = (self.r * self.d).sum(axis=0)
        self._q = self.d

    def curvature(self) -> Floats:
        """The product with the matrix; d^T K d (g,)."""
        self._q = self._product(self.d)
        return np.asarray((self.d * self._q).sum(axis=0))

    def advance(self, length: Floats) -> None:
        """Go along the directions, so far (g,)."""
        self.x[:, self.active] += length * self.d
        self.r = self.r - length * self._q

    def keep(self, unfinished: Bools | Ints) -> None:
        """Go on with some of the columns (g,) alone."""
        self.active, self.rz = self.active[unfinished], self.rz[unfinished]
        self.r, self.d = self.r[:, unfinished], self.d[:, unfinished]

    def turn(self) -> Floats:
        """The solve of the preconditioner: new directions; r^T M^-1 r by that of before (g,)."""
        z = self._precondition(self.r)
        following = (self.r * z).sum(axis=0)
        ratio = following / self.rz
        self.d, self.rz = z + ratio * self.d, following
        return np.asarray(ratio)


class Stagnation(ArithmeticError):
    """Conjugate gradients do not come to the end within reason.

    Args:
        columns: steps made in vain, column by column, added up.
    """

    def __init__(self, columns: int = 0) -> None:
        self.columns = columns
        super().__init__("conjugate gradients do not come to the end")


@dataclass(frozen=True)
class ExtremeEigenvalues:
    """What is known of M^-1 K.

    Args:
        least: its least eigenvalue, about.
        most: its largest, about.
        steps: that it took to find out.
    """

    least: float
    most: float
    steps: int


def spectrum(product: Product, precondition: Product, diagonal: Floats) -> ExtremeEigenvalues:
    """The extreme eigenvalues of M^-1 K.

    Args:
        product: multiplies with K.
        precondition: multiplies with M^-1.
        diagonal: (n,) of K.

    Raises:
        NotPositiveDefinite: K is indefinite, or singular to working precision.
        Stagnation: they are too far apart, or M is not positive definite in its rounding.
    """
    n = len(diagonal)
    rhs = np.random.default_rng(0).normal(size=(n, 1)) * np.sqrt(diagonal)[:, None]
    cg = ConjugateDirections(product, precondition, rhs)
    until, alphas, betas = (REVEALING**2 / n) * cg.rz[0], list[float](), list[float]()
    for step in range(MOST_STEPS):
        curvature, rz = float(cg.curvature()[0]), float(cg.rz[0])
        if curvature <= 0.0:
            raise NotPositiveDefinite(int(np.argmax(np.abs(cg.d[:, 0]))))
        if not (rz > 0.0 and curvature > 0.0):  # no number, or K is lost in the rounding of M
            raise Stagnation(step)
        alphas.append(rz / curvature)
        cg.advance(np.array(alphas[-1:]))
        before = cg.d
        betas.append(float(cg.turn()[0]))
        if abs(cg.rz[0]) <= until:
            return _extremes(alphas, betas, before)
    raise Stagnation(MOST_STEPS)


def _extremes(alphas: list[float], betas: list[float], d: Floats) -> ExtremeEigenvalues:
    """From the coefficients of conjugate gradients: eigenvalues of Lanczos' matrix."""
    a, b = np.array(alphas), np.array(betas)
    main = 1.0 / a
    main[1:] += b[:-1] / a[:-1]
    side = np.sqrt(np.maximum(b[:-1], 0.0)) / a[:-1]
    values = np.linalg.eigvalsh(np.diag(main) + np.diag(side, 1) + np.diag(side, -1))
    extremes = ExtremeEigenvalues(float(values[0]), float(values[-1]), len(alphas))
    if not extremes.least > NEARLY_SINGULAR * extremes.most:
        raise NotPositiveDefinite(int(np.argmax(np.abs(d[:, 0]))))
    return extremes


@dataclass(frozen=True)
class EnergySolution:
    """What conjugate gradients found.

    Args:
        x: (n, k) solutions.
        steps: of all columns together: products with the matrix.
        columns: steps, column by column, added up.
    """

    x: Floats
    steps: int
    columns: int


def solve_in_energy(
    product: Product,
    precondition: Product,
    rhs: Floats,
    least: float,
    *,
    tolerance: float = TOLERANCE,
) -> EnergySolution:
    """Solve K x = b, each column to an error in energy norm.

    Args:
        product: K x.
        precondition: M^-1 r.
        rhs: (n, k) b.
        least: the least eigenvalue of M^-1 K, about.
        tolerance: of the error, relative to the energy norm of the solution.

    Raises:
        NotPositiveDefinite: a direction has no positive curvature.
        Stagnation: the error does not become small, or M is not positive definite in its rounding.
    """
    cg = ConjugateDirections(product, precondition, rhs)
    steps = columns = 0
    energy = np.zeros(len(cg.active))  # x^T K x
    while cg.active.size:
        # negative, or no number: what is soft in K is lost in the rounding of M
        if steps == MOST_STEPS or not (cg.rz > 0.0).all():
            raise Stagnation(columns)
        steps, columns = steps + 1, columns + len(cg.active)
        curvature = cg.curvature()
        bad = np.flatnonzero(curvature <= 0.0)
        if bad.size:
            raise NotPositiveDefinite(int(np.argmax(np.abs(cg.d[:, bad[0]]))))
        length = cg.rz / curvature
        cg.advance(length)
        energy += length * cg.rz
        cg.turn()
        unfinished = ~(np.abs(cg.rz) <= (SAFE * least) * tolerance**2 * energy)
        if not unfinished.all():
            cg.keep(unfinished)
            energy = energy[unfinished]
    return EnergySolution(cg.x, steps, columns)
