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

import numpy as np
from scipy.linalg import eigvalsh_tridiagonal

from geoident.fem.solvers.direct import NotPositiveDefinite, SolverCounts
from geoident.model.arrays import Floats

Product = Callable[[Floats], Floats]
"""K x (n, k) of x (n, k), or the solutions M^-1 r of a preconditioner."""

TOLERANCE = 1e-10
"""Largest error in energy norm, relative to the solution: readings then keep eight digits."""

REVEALING = 1e-3
"""Residual, times the root of n, at which a random right-hand side has shown the eigenvalues."""

SAFE = 0.5
"""Part of the least Ritz value that is taken for the least eigenvalue, which is below it."""

NEARLY_SINGULAR = 1e-9
"""A least eigenvalue of M^-1 K below this part of the largest is rounding, not stiffness."""

MOST_STEPS = 400
"""Steps until a matrix is given up: ten times what ground takes that is not incompressible."""


class Stagnation(ArithmeticError):
    """Conjugate gradients do not come to the end within reason."""


def least_eigenvalue(
    product: Product, precondition: Product, diagonal: Floats, counts: SolverCounts
) -> float:
    """The least eigenvalue of M^-1 K, about, by Lanczos' method.

    Args:
        product: K x.
        precondition: M^-1 r.
        diagonal: (n,) of K.
        counts: where to count the steps.

    Raises:
        NotPositiveDefinite: K is indefinite, or singular to working precision.
        Stagnation: eigenvalues are too far apart, or M is not positive definite in its rounding.
    """
    n = len(diagonal)
    r = np.random.default_rng(0).normal(size=(n, 1)) * np.sqrt(diagonal)[:, None]
    d = z = precondition(r)
    rz = float(np.vdot(r, z))
    enough = REVEALING**2 / n * rz
    lengths, ratios = list[float](), list[float]()
    while not (abs(rz) <= enough and lengths):
        q = product(d)
        curvature = float(np.vdot(d, q))
        if curvature <= 0.0:
            raise NotPositiveDefinite(int(np.argmax(np.abs(d))))
        # negative, or no number: what is soft in K is lost in the rounding of M
        if len(lengths) == MOST_STEPS or not (rz > 0.0 and curvature > 0.0):
            raise Stagnation
        counts.iterations += 1
        lengths.append(rz / curvature)
        r = r - lengths[-1] * q
        z = precondition(r)
        before, rz = rz, float(np.vdot(r, z))
        ratios.append(rz / before)
        last, d = d, z + ratios[-1] * d
    a, b = np.array(lengths), np.array(ratios)
    main = 1.0 / a
    main[1:] += b[:-1] / a[:-1]
    values = eigvalsh_tridiagonal(main, np.sqrt(np.maximum(b[:-1], 0.0)) / a[:-1])
    if not values[0] > NEARLY_SINGULAR * values[-1]:
        raise NotPositiveDefinite(int(np.argmax(np.abs(last))))
    return float(values[0])


def solve_in_energy(
    product: Product, precondition: Product, rhs: Floats, least: float, counts: SolverCounts
) -> Floats:
    """Solve K x = b, each column to an error in energy norm.

    Args:
        product: K x.
        precondition: M^-1 r.
        rhs: (n, k) b.
        least: the least eigenvalue of M^-1 K, about.
        counts: where to count the steps.

    Returns:
        (n, k) solutions.

    Raises:
        NotPositiveDefinite: a direction has no positive curvature.
        Stagnation: the error does not become small, or M is not positive definite in its rounding.
    """
    x, active = np.zeros_like(rhs), np.flatnonzero(rhs.any(axis=0))
    if not active.size:
        return x
    r = rhs[:, active]
    d = precondition(r)
    rz = (r * d).sum(axis=0)
    energy = np.zeros(active.size)  # x^T K x
    for _ in range(MOST_STEPS):
        # negative, or no number: what is soft in K is lost in the rounding of M
        if not (rz > 0.0).all():
            raise Stagnation
        counts.iterations += active.size
        q = product(d)
        curvature = (d * q).sum(axis=0)
        if (curvature <= 0.0).any():
            raise NotPositiveDefinite(int(np.argmax(np.abs(d[:, np.argmin(curvature)]))))
        length = rz / curvature
        x[:, active] += length * d
        r = r - length * q
        energy += length * rz
        z = precondition(r)
        before, rz = rz, (r * z).sum(axis=0)
        d = z + rz / before * d
        goes_on = ~(np.abs(rz) <= (SAFE * least) * TOLERANCE**2 * energy)
        if not goes_on.any():
            return x
        if not goes_on.all():
            active, rz, energy = active[goes_on], rz[goes_on], energy[goes_on]
            r, d = r[:, goes_on], d[:, goes_on]
    raise Stagnation
