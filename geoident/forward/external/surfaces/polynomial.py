"""A polynomial through runs, by least squares in products of Legendre's (theory 4.8)."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from itertools import product

import numpy as np
from numpy.polynomial import legendre
from scipy.linalg import qr, solve_triangular

from geoident.model.arrays import Floats

HIGHEST = 6
"""Order of a polynomial at most: beyond, few runs are left to judge it by."""
RUNS_A_TERM = 2
"""Runs for each coefficient, at least."""
LEAST_RESIDUAL = 1e-14
"""Residual at which a surface meets its runs but for rounding, in parts of their readings."""


def terms(n: int, order: int) -> list[tuple[int, ...]]:
    """Powers of n coordinates up to a total order."""
    return sorted(
        (powers for powers in product(range(order + 1), repeat=n) if sum(powers) <= order),
        key=lambda powers: (sum(powers), powers),
    )


def count(n: int, order: int) -> int:
    """Number of `terms`."""
    total = 1
    for k in range(1, order + 1):
        total = total * (n + k) // k
    return total


def orders(runs: int, n: int) -> list[int]:
    """Orders of polynomials of n parameters for which there are enough runs, 1 at least.

    Args:
        runs: their number.
        n: number of parameters.
    """
    return [k for k in range(1, HIGHEST + 1) if k == 1 or RUNS_A_TERM * count(n, k) <= runs]


@dataclass(frozen=True)
class Polynomial:
    """The polynomial through the runs of one reading.

    Args:
        powers: of each of its q terms.
        order: largest sum of them.
        coefficients: (q,) SI.
        triangle: (q, q) R of the QR decomposition of its terms at the runs.
        variance: of what it leaves, r - q degrees of freedom, SI.
        errors: (r,) of the runs left out one by one, SI.
        expected: (r,) their standard deviations, SI.
    """

    powers: tuple[tuple[int, ...], ...]
    order: int
    coefficients: Floats
    triangle: Floats
    variance: float
    errors: Floats
    expected: Floats

    @property
    def words(self) -> str:
        """What kind of function it is."""
        return f"polynomial of order {self.order}"

    @property
    def freedom(self) -> int:
        """Runs less coefficients."""
        return len(self.errors) - len(self.coefficients)

    @cached_property
    def _powers(self) -> Floats:
        return np.array(self.powers)

    def value(self, u: Floats) -> tuple[float, Floats]:
        """The reading at coordinates u (n,), SI, and its derivatives (n,) by these."""
        values, slopes = _legendre(u[None], self.order)
        columns = np.arange(len(u))
        factors = values[0, columns, self._powers]
        value = float(factors.prod(axis=1) @ self.coefficients)
        gradient = np.empty(len(u))
        for j in columns.tolist():
            moved = factors.copy()
            moved[:, j] = slopes[0, j, self._powers[:, j]]
            gradient[j] = moved.prod(axis=1) @ self.coefficients
        return value, gradient

    def deviation(self, u: Floats) -> float:
        """Standard deviation of what the model and the polynomial differ by at u (n,), SI."""
        row = design(u[None], self.powers, self.order)[0]
        left = solve_triangular(self.triangle, row, trans="T")
        return float(np.sqrt(self.variance * (1.0 + left @ left)))


def _legendre(u: Floats, order: int) -> tuple[Floats, Floats]:
    """Legendre's polynomials (r, n, order + 1) at coordinates u (r, n), and their derivatives.

    These by P'_(k+1) = P'_(k-1) + (2 k + 1) P_k.
    """
    values = np.asarray(legendre.legvander(u, order), dtype=np.float64)
    slopes = np.zeros_like(values)
    for k in range(order):
        slopes[..., k + 1] = slopes[..., max(k - 1, 0)] + (2 * k + 1) * values[..., k]
    return values, slopes


def design(u: Floats, powers: tuple[tuple[int, ...], ...], order: int) -> Floats:
    """The terms (r, q) at coordinates of points.

    Args:
        u: (r, n) coordinates.
        powers: of each of the q terms.
        order: the largest of them.
    """
    values = legendre.legvander(u, order)
    terms = np.ones((len(u), len(powers)))
    for j, column in enumerate(np.array(powers).T):
        terms *= values[:, j, column]
    return np.asarray(terms)


def fitted_polynomial(u: Floats, y: Floats, order: int) -> Polynomial:
    """The polynomial of an order through runs, by least squares.

    What one run says more than the polynomial through all others is e / (1 - h), with e what it
    leaves and h the run's leverage.

    Args:
        u: (r, n) coordinates of the runs.
        y: (r,) what they gave, SI.
        order: of the polynomial.
    """
    powers = tuple(terms(u.shape[1], order))
    Q, R = qr(design(u, powers, order), mode="economic")
    left = y - Q @ (Q.T @ y)
    free = len(y) - len(powers)
    # a reading that is zero in all runs, as of a gauge at its zero, leaves no size to round by
    tiny = LEAST_RESIDUAL * (float(np.abs(y).max()) or 1.0)
    variance = max(float(left @ left) / free, tiny**2)
    rest = np.maximum(1.0 - np.sum(Q**2, axis=1), LEAST_RESIDUAL)
    return Polynomial(
        powers,
        order,
        np.asarray(solve_triangular(R, Q.T @ y)),
        np.asarray(R),
        variance,
        left / rest,
        np.sqrt(variance / rest),
    )
