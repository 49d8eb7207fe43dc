"""Gaussian random fields at points: Matern covariance, values given at points, principal modes.

A field is wanted at n points as mean + sum_k phi_k xi_k with few independent xi_k ~ N(0, 1). Its
covariance (n, n) is never made whole: a Cholesky factorization that takes the point of largest
remaining variance next (Harbrecht, Peters & Schneider 2012, On the low-rank approximation by the
pivoted Cholesky decomposition, Applied Numerical Mathematics 62) needs one column a step and ends
when nothing worth mentioning is left. Its columns, turned so that they are orthogonal, are the
principal modes of the field at these points (Karhunen and Loeve), the largest first. Values at
points condition the field (kriging: Chiles & Delfiner 2012, Geostatistics, chapter 3): they give
its mean, and take a part off every column.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import gamma, sqrt

import numpy as np
from scipy.linalg import cho_solve, solve_triangular
from scipy.special import kv

from geoident.model.arrays import Floats

MARGIN = 0.25
"""Part of the variance to be left out that the factorization itself may leave out."""

JITTER = 1e-10
"""Variance, in parts of the field's, that is added where values are given without an accuracy."""

_LEAST_COLUMNS = 400
"""Columns of the factorization, at least: modes made of too few are not the best."""


@dataclass(frozen=True)
class Matern:
    """A stationary covariance: sd^2 times Matern's correlation over the scaled distance r.

    rho(r) = 2^(1 - nu) / Gamma(nu) (sqrt(2 nu) r)^nu K_nu(sqrt(2 nu) r): exp(-r) for nu = 0.5.

    Args:
        sd: standard deviation.
        scaling: (dim, dim) A, so that r = |A^T (x - y)|; lengths along axes are in it.
        smoothness: nu.
    """

    sd: float
    scaling: Floats
    smoothness: float = 1.5

    def between(self, first: Floats, second: Floats) -> Floats:
        """Covariance (n, m) of the field at points (n, dim) and (m, dim)."""
        a, b = first @ self.scaling, second @ self.scaling
        square = sum((a[:, None, k] - b[None, :, k]) ** 2 for k in range(a.shape[1]))
        return self.sd**2 * matern(np.sqrt(square), self.smoothness)


def scaling_of(axes: Floats, lengths: Floats) -> Floats:
    """A (dim, dim) of `Matern` for lengths along three axes.

    Args:
        axes: (dim, 3) the orthonormal axes as columns, in the coordinates of the model; what a
            section has no coordinate for is left out.
        lengths: (3,) m.
    """
    return np.asarray(np.linalg.cholesky((axes / lengths**2) @ axes.T), dtype=np.float64)


def matern(distance: Floats, smoothness: float) -> Floats:
    """Matern's correlation at scaled distances (...).

    >>> float(matern(np.array(1.0), 0.5).round(6))
    0.367879
    """
    r = sqrt(2 * smoothness) * distance
    if smoothness == 0.5:
        return np.asarray(np.exp(-r))
    if smoothness == 1.5:
        return np.asarray((1 + r) * np.exp(-r))
    if smoothness == 2.5:
        return np.asarray((1 + r + r**2 / 3) * np.exp(-r))
    apart = np.maximum(r, 1e-12)
    k = 2 ** (1 - smoothness) / gamma(smoothness) * apart**smoothness * kv(smoothness, apart)
    return np.asarray(np.where(r > 1e-8, k, 1.0))


@dataclass(frozen=True)
class Conditioning:
    """What values at m points say of a field at n points.

    Args:
        weights: (n, m) of the values, counted from the field's mean: simple kriging.
        factor: (m, n) G: the covariance that is left is that of the field less G^T G.
    """

    weights: Floats
    factor: Floats


def conditioning(covariance: Matern, points: Floats, at: Floats, noise: Floats) -> Conditioning:
    """Values at points condition the field.

    Args:
        covariance: of the field.
        points: (n, dim) where the field is wanted.
        at: (m, dim) where values are given; none for no conditioning.
        noise: (m,) their variances.
    """
    if not len(at):
        return Conditioning(np.zeros((len(points), 0)), np.zeros((0, len(points))))
    among = covariance.between(at, at)
    among[np.diag_indices(len(at))] += np.maximum(noise, JITTER * covariance.sd**2)
    lower = np.linalg.cholesky(among)
    across = covariance.between(at, points)
    weights = cho_solve((lower, True), across).T
    return Conditioning(weights, solve_triangular(lower, across, lower=True))


@dataclass(frozen=True)
class Modes:
    """The principal modes of a field at n points.

    Args:
        shapes: (n, r) modes times their standard deviation, the largest first.
        explained: part of the variance (its sum over the points) that they hold.
    """

    shapes: Floats
    explained: float


def principal_modes(
    covariance: Matern, points: Floats, conditioning: Conditioning, *, explained: float, most: int
) -> Modes:
    """The fewest principal modes that hold a part of the variance.

    Args:
        covariance: of the field.
        points: (n, dim).
        conditioning: by what it is conditioned.
        explained: part of the variance, summed over the points, that the modes are to hold.
        most: modes at most.

    Returns:
        No modes where nothing varies.
    """
    variance = np.maximum(covariance.sd**2 - np.sum(conditioning.factor**2, axis=0), 0.0)
    whole = float(variance.sum())
    if whole <= JITTER * len(points) * covariance.sd**2:
        return Modes(np.zeros((len(points), 0)), 1.0)
    left_out = MARGIN * (1 - explained) * whole
    most_columns = max(2 * most, _LEAST_COLUMNS)
    columns = _pivoted_cholesky(covariance, points, conditioning, variance, left_out, most_columns)
    sizes, turn = np.linalg.eigh(columns.T @ columns)
    order = np.argsort(sizes)[::-1]
    held = np.cumsum(np.maximum(sizes[order], 0.0)) / whole
    number = min(int(np.searchsorted(held, explained)) + 1, most, len(held))
    shapes = columns @ turn[:, order[:number]]
    largest = shapes[np.argmax(np.abs(shapes), axis=0), np.arange(number)]
    return Modes(shapes * np.sign(largest), float(held[number - 1]))


def _pivoted_cholesky(
    covariance: Matern,
    points: Floats,
    conditioning: Conditioning,
    variance: Floats,
    left_out: float,
    most: int,
) -> Floats:
    """L (n, r) with L L^T the covariance but for a trace of ``left_out``, or after most columns.

    Args:
        covariance: of the field.
        points: (n, dim).
        conditioning: what is taken off the covariance.
        variance: (n,) the diagonal of what is to be factorized.
        left_out: sum of the variance that may be left.
        most: columns at most.
    """
    left = variance.copy()
    rows = np.empty((min(most, len(points)), len(points)))
    for k in range(len(rows)):
        pivot = int(np.argmax(left))
        if left.sum() <= left_out or left[pivot] <= JITTER * covariance.sd**2:
            return np.ascontiguousarray(rows[:k].T)
        column = covariance.between(points[pivot : pivot + 1], points)[0]
        column -= conditioning.factor[:, pivot] @ conditioning.factor
        column -= rows[:k, pivot] @ rows[:k]
        rows[k] = column / sqrt(left[pivot])
        left = np.maximum(left - rows[k] ** 2, 0.0)
        left[pivot] = 0.0
    return np.ascontiguousarray(rows.T)
