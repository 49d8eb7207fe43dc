"""Noise of a gauge in time: an error of each reading, one that fades, and a drift (theory 16.2).

The errors of the readings of one gauge at times t_1 < ... < t_m are

    e_k = white_k + x_k + s_k
    x_k = phi_k x_{k-1} + sqrt(1 - phi_k^2) lasting eps_k ,    phi_k = exp(-(t_k - t_{k-1}) / time)
    s_k = s_{k-1} + drift sqrt((t_k - t_{k-1}) / year) eta_k

with white_k of standard deviation ``white``, x_k of ``lasting``: an AR(1) process that does not
mind gaps; and s_k a random walk, what effects that the model lacks leave slowly. Sigma is
white^2 I + A K A^T, with the inverse of the covariance K of (x, s) banded and A x = x_k + s_k, so
sums over the inverse of Sigma cost m operations,

    Sigma^-1 = (I - A M^-1 A^T / white^2) / white^2 ,    M = A^T A / white^2 + K^-1
    |Sigma| = white^(2m) |M| |K|
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy.linalg import cho_solve_banded, cholesky_banded

from geoident.model.arrays import Floats
from geoident.model.in_service import YEAR

PROCESSES = 2
"""Errors that go from reading to reading: the one that fades, and the drift."""


@dataclass(frozen=True)
class Noise:
    """The errors of a gauge's readings.

    Args:
        white: standard deviation of what each reading has by itself, SI; positive.
        lasting: of what fades, SI; 0 for none.
        time: in which it fades to 1/e, s; positive.
        drift: of what the drift adds in a year, SI; 0 for none.
    """

    white: float
    lasting: float = 0.0
    time: float = 1.0
    drift: float = 0.0

    @property
    def sd(self) -> float:
        """Standard deviation of a reading without the drift, SI."""
        return float(np.hypot(self.white, self.lasting))

    def remaining(self, elapsed: Floats) -> Floats:
        """(k, 2) the parts phi of the lasting error and of the drift left after times (k,), s."""
        elapsed = np.asarray(elapsed, dtype=np.float64)
        return np.column_stack([np.exp(-elapsed / self.time), np.ones(len(elapsed))])

    def added(self, elapsed: Floats) -> Floats:
        """(k, 2) the variances that they gain in times (k,), s."""
        elapsed = np.asarray(elapsed, dtype=np.float64)
        fades = -np.expm1(-2.0 * elapsed / self.time)
        return np.column_stack([self.lasting**2 * fades, self.drift**2 * elapsed / YEAR])

    @property
    def at_first(self) -> Floats:
        """(2,) their variances at the first reading; a constant takes up that of the drift."""
        return np.array([self.lasting**2, self.drift**2])


class TimeCovariance:
    """Sigma of the readings of one gauge.

    Args:
        noise: of the gauge.
        times: (m,) s, increasing.
    """

    def __init__(self, noise: Noise, times: Floats) -> None:
        self.noise, self.times = noise, np.asarray(times, dtype=np.float64)
        elapsed = np.diff(self.times)
        self._there = np.flatnonzero(noise.at_first > 0.0)
        self._phi = noise.remaining(elapsed)[:, self._there]
        first = noise.at_first[None, self._there]
        self._added = np.vstack([first, noise.added(elapsed)[:, self._there]])

    @cached_property
    def _factor(self) -> Floats:
        """(d + 1, m d) upper banded Cholesky factor of M, for the d processes that are there."""
        m, d = self._added.shape
        inverse = 1.0 / self._added
        diagonal = inverse.copy()
        diagonal[:-1] += self._phi**2 * inverse[1:]
        bands = np.zeros((d + 1, m, d))
        bands[d] = diagonal
        bands[0, 1:] = -self._phi * inverse[1:]
        for i in range(d):
            for j in range(i, d):
                bands[d + i - j, :, j] += 1.0 / self.noise.white**2
        return np.asarray(cholesky_banded(bands.reshape(d + 1, m * d)))

    def solve(self, values: Floats) -> Floats:
        """Sigma^-1 of values (m,) or (m, k)."""
        white, d = self.noise.white**2, len(self._there)
        if not d:
            return values / white
        each = cho_solve_banded((self._factor, False), np.repeat(values, d, axis=0))
        summed = sum((each[j::d] for j in range(1, d)), each[0::d])
        return np.asarray(values - summed / white) / white

    @cached_property
    def log_determinant(self) -> float:
        """Logarithm of |Sigma|."""
        white = 2.0 * len(self.times) * np.log(self.noise.white)
        if not len(self._there):
            return float(white)
        processes = np.log(self._added).sum() + 2.0 * np.log(self._factor[-1]).sum()
        return float(white + processes)

    @property
    def with_last(self) -> Floats:
        """(m, 2) covariance of the errors of the readings with the processes at the last one."""
        noise, since = self.noise, self.times[-1] - self.times
        lasting = noise.lasting**2 * np.exp(-since / noise.time)
        drift = noise.drift**2 * (1.0 + (self.times - self.times[0]) / YEAR)
        return np.column_stack([lasting, drift])
