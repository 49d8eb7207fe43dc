"""A Gaussian process through runs: universal kriging with a linear trend (theory 4.8).

    y(u) = f(u)^T b + z(u) ,   cov(z(u), z(v)) = s^2 ( k(u, v) + l [u = v] ) ,   f = (1, u)

with k the squared exponential of the distances over lengths, or Matern's function of order 5/2.
With K the matrix of k + l over the runs, F that of the trend and

    Q = K^-1 - K^-1 F (F^T K^-1 F)^-1 F^T K^-1

the lengths and l maximise the restricted likelihood, s^2 = y^T Q y / (r - q), and what is left out
is foretold in closed form (Dubrule 1983): of run i the error is (Q y)_i / Q_ii, its variance
s^2 / Q_ii.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy.linalg import cho_factor, cho_solve

from geoident.forward.external.surfaces.polynomial import LEAST_RESIDUAL
from geoident.model.arrays import Floats

MOST_FOR_LENGTHS = 300
"""Runs from which lengths are found; of more some are drawn, since the cost grows as their cube."""

_LENGTHS = (np.log(0.05), np.log(100.0))
"""Bounds of log lengths, of runs in [-1, 1]: closer than any grid of them, and nearly linear."""

_NUGGETS = (np.log(1e-8), np.log(1.0))
"""Bounds of log nuggets: the least keeps the matrix invertible, the largest is all noise."""

_ROOT5 = np.sqrt(5.0)  # of Matern's function of order 5/2

_UNLIKELY = 1e25
"""Stands for an infinite value: the search could not step back from a true infinity."""


@dataclass(frozen=True)
class Hyperparameters:
    """What is found by likelihood.

    Args:
        lengths: (n,) over which the process is alike, in coordinates.
        nugget: l, part of the variance that a run has by itself.
        smooth: squared exponential; else Matern's function.
    """

    lengths: Floats
    nugget: float
    smooth: bool

    def correlation(self, u: Floats, v: Floats) -> Floats:
        """Correlation k (r, s) between coordinates u (r, n) and v (s, n)."""
        return _correlation(_squared(u / self.lengths, v / self.lengths), smooth=self.smooth)[0]


def _squared(u: Floats, v: Floats) -> Floats:
    """Squared distances (r, s) of points (r, n) and (s, n), without cancellation."""
    total = np.zeros((len(u), len(v)))
    for a, b in zip(u.T, v.T, strict=True):
        total += (a[:, None] - b[None, :]) ** 2
    return total


def _correlation(squared: Floats, *, smooth: bool) -> tuple[Floats, Floats]:
    """Correlation k and -2 dk / d(squared) at squared distances."""
    if smooth:
        k = np.exp(-0.5 * squared)
        return k, k
    d = _ROOT5 * np.sqrt(squared)
    decay = np.exp(-d)
    return (1.0 + d + d**2 / 3.0) * decay, 5.0 / 3.0 * (1.0 + d) * decay


def trend(u: Floats) -> Floats:
    """F (r, 1 + n) at coordinates u (r, n)."""
    return np.column_stack([np.ones(len(u)), u])


class _System:
    """K of runs and what follows from it.

    Args:
        u: (r, n) coordinates of the runs.
        y: (r,) what they gave.
        matrix: K (r, r).
    """

    def __init__(self, u: Floats, y: Floats, matrix: Floats) -> None:
        self.factor = cho_factor(matrix, lower=True, check_finite=False)
        self.F = trend(u)
        self.solved = cho_solve(self.factor, self.F)
        self.of_trend = cho_factor(self.F.T @ self.solved, lower=True)
        self.b = cho_solve(self.of_trend, self.solved.T @ y)
        self.weights = cho_solve(self.factor, y - self.F @ self.b)  # Q y
        self.free = len(y) - self.F.shape[1]
        self.variance = max(float(y @ self.weights), 0.0) / self.free

    def projection(self) -> Floats:
        """Q (r, r)."""
        inverse = cho_solve(self.factor, np.eye(len(self.F)))
        return np.asarray(inverse - self.solved @ cho_solve(self.of_trend, self.solved.T))

    def log_determinants(self) -> float:
        """Logarithm of |K| |F^T K^-1 F|: log |K| + log |F^T K^-1 F|."""
        parts = (np.diag(factor[0]) for factor in (self.factor, self.of_trend))
        return 2.0 * float(sum(float(np.log(part).sum()) for part in parts))


@dataclass(frozen=True)
class GaussianProcess:
    """The process through the runs of one reading.

    Args:
        u: (r, n) coordinates of the runs.
        y: (r,) what they gave, SI.
        hyperparameters: found by likelihood.
        b: (1 + n,) coefficients of the trend.
        weights: (r,) Q y.
        variance: s^2, SI.
        errors: (r,) of the runs left out one by one, SI.
        expected: (r,) their standard deviations, SI.
    """

    u: Floats
    y: Floats
    hyperparameters: Hyperparameters
    b: Floats
    weights: Floats
    variance: float
    errors: Floats
    expected: Floats

    @property
    def words(self) -> str:
        """What kind of function it is."""
        return "Gaussian process" + ("" if self.hyperparameters.smooth else " (Matern 5/2)")

    @property
    def freedom(self) -> int:
        """Runs less coefficients of the trend, lengths and nugget."""
        return len(self.y) - len(self.b) - len(self.hyperparameters.lengths) - 1

    @cached_property
    def _scaled(self) -> Floats:
        return np.asarray(self.u / self.hyperparameters.lengths)

    def value(self, u: Floats) -> tuple[float, Floats]:
        """The reading at coordinates u (n,), SI, and its derivatives (n,) by these."""
        parameters = self.hyperparameters
        away = self._scaled - u / parameters.lengths
        k, slope = _correlation(np.sum(away**2, axis=1), smooth=parameters.smooth)
        value = float(self.b[0] + self.b[1:] @ u + k @ self.weights)
        return value, self.b[1:] + (slope * self.weights) @ away / parameters.lengths

    def deviation(self, u: Floats) -> float:
        """Standard deviation of the process given the runs, at coordinates u (n,), SI.

        What a run has by itself is in it: whether that is noise of the runs or a detail between
        them, the process cannot tell.
        """
        parameters = self.hyperparameters
        system = _System(self.u, self.y, _matrix(self.u, parameters))
        k = parameters.correlation(self.u, u[None])[:, 0]
        rest = trend(u[None])[0] - system.solved.T @ k
        part = 1.0 + parameters.nugget - k @ cho_solve(system.factor, k)
        part += rest @ cho_solve(system.of_trend, rest)
        return float(np.sqrt(self.variance * max(float(part), parameters.nugget)))


def _matrix(u: Floats, parameters: Hyperparameters) -> Floats:
    matrix = parameters.correlation(u, u)
    matrix[np.diag_indices_from(matrix)] += parameters.nugget
    return matrix


def process_with(u: Floats, y: Floats, parameters: Hyperparameters) -> GaussianProcess:
    """The process with given hyperparameters.

    Args:
        u: (r, n) coordinates of the runs.
        y: (r,) what they gave, SI.
        parameters: lengths and nugget.
    """
    size = _size(y)
    system = _System(u, y / size, _matrix(u, parameters))
    diagonal = np.diag(system.projection())
    return GaussianProcess(
        u,
        y,
        parameters,
        size * system.b,
        size * system.weights,
        size**2 * system.variance,
        size * system.weights / diagonal,
        size * np.sqrt(np.maximum(system.variance, LEAST_RESIDUAL**2) / diagonal),
    )


def _size(y: Floats) -> float:
    """By which readings are divided, so that nothing under- or overflows."""
    return float(y.max() - y.min()) or 1.0


def fitted_process(
    u: Floats, y: Floats, *, smooth: bool, near: Hyperparameters | None = None
) -> GaussianProcess:
    """The process whose lengths and nugget maximise the restricted likelihood.

    Args:
        u: (r, n) coordinates of the runs.
        y: (r,) what they gave, SI.
        smooth: squared exponential; else Matern's function of order 5/2.
        near: hyperparameters from which the search begins where they are the likelier start.
    """
    from scipy.optimize import minimize  # noqa: PLC0415 - 0.2 s, and most cases have no table

    rows = np.arange(len(u))
    if len(u) > MOST_FOR_LENGTHS:
        rows = np.sort(np.random.default_rng(0).permutation(len(u))[:MOST_FOR_LENGTHS])
    likelihood = ProcessLikelihood(u[rows], y[rows], smooth=smooth)
    n = u.shape[1]
    starts = [np.append(np.full(n, np.log(2.0)), np.log(1e-6))]
    if near is not None:
        starts.append(np.append(np.log(near.lengths), np.log(near.nugget)))
    start = starts[int(np.argmin([likelihood(theta)[0] for theta in starts]))]
    optimum = minimize(
        likelihood,
        start,
        jac=True,
        method="L-BFGS-B",
        bounds=[_LENGTHS] * n + [_NUGGETS],
        options={"maxiter": 100, "ftol": 1e-7, "gtol": 1e-4},
    )
    *lengths, nugget = np.exp(optimum.x)
    return process_with(u, y, Hyperparameters(np.array(lengths), float(nugget), smooth))


class ProcessLikelihood:
    """Negative logarithm of the restricted likelihood, but for a constant.

    Args:
        u: (r, n) coordinates of the runs.
        y: (r,) what they gave.
        smooth: squared exponential; else Matern's function.
    """

    def __init__(self, u: Floats, y: Floats, *, smooth: bool) -> None:
        self._u, self._y, self._smooth = u, y / _size(y), smooth
        self._squared = [(a[:, None] - a[None, :]) ** 2 for a in u.T]

    def __call__(self, theta: Floats) -> tuple[float, Floats]:
        """At logarithms (n + 1,) of lengths and nugget: the value, and its derivatives (n + 1,)."""
        inverse, nugget = np.exp(-2.0 * theta[:-1]), float(np.exp(theta[-1]))
        squared = np.zeros_like(self._squared[0])
        for part, size in zip(self._squared, inverse, strict=True):
            squared += size * part
        matrix, slope = _correlation(squared, smooth=self._smooth)
        matrix = matrix.copy()
        matrix[np.diag_indices_from(matrix)] += nugget
        try:
            system = _System(self._u, self._y, matrix)
        except np.linalg.LinAlgError:  # as near to singular as rounding can tell
            return _UNLIKELY, np.zeros_like(theta)
        variance = max(system.variance, LEAST_RESIDUAL**2)
        value = 0.5 * (system.free * np.log(variance) + system.log_determinants())
        left = system.projection() - np.outer(system.weights, system.weights) / variance
        bent = left * slope
        by_lengths = [
            0.5 * size * float(np.sum(bent * part))
            for part, size in zip(self._squared, inverse, strict=True)
        ]
        return float(value), np.array([*by_lengths, 0.5 * nugget * float(np.trace(left))])
