"""Noise of a gauge in time: an error of each reading, and one that fades (theory 16.2).

The errors of the readings of one gauge at times t_1 < ... < t_m are

    e_k = white_k + x_k ,    x_k = phi_k x_{k-1} + sqrt(1 - phi_k^2) lasting eps_k ,
    phi_k = exp(-(t_k - t_{k-1}) / time)

with white_k of standard deviation ``white`` and x_k of ``lasting``: an AR(1) process that does not
mind gaps. The inverse of the covariance K of x is tridiagonal, so sums over the inverse of
Sigma = white^2 I + K cost m operations,

    Sigma^-1 = (I - M^-1 / white^2) / white^2 ,    M = I / white^2 + K^-1
    |Sigma| = white^(2m) |M| |K|

and a filter over the readings in their order gives L^-1 e, with Sigma = L L^T: what each reading
says that those before it did not.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy.linalg import cho_solve_banded, cholesky_banded

from geoident.model.arrays import Floats


@dataclass(frozen=True)
class Noise:
    """The errors of a gauge's readings.

    Args:
        white: standard deviation of what each reading has by itself, SI; positive.
        lasting: of what fades, SI; 0 for none.
        time: in which it fades to 1/e, s; positive.
    """

    white: float
    lasting: float = 0.0
    time: float = 1.0

    @property
    def sd(self) -> float:
        """Standard deviation of a reading, SI."""
        return float(np.hypot(self.white, self.lasting))

    def remaining(self, elapsed: Floats) -> Floats:
        """The part phi of the lasting error that is left after some time, s."""
        return np.exp(-np.asarray(elapsed, dtype=np.float64) / self.time)


class TimeCovariance:
    """Sigma of the readings of one gauge.

    Args:
        noise: of the gauge.
        times: (m,) s, increasing.
    """

    def __init__(self, noise: Noise, times: Floats) -> None:
        self.noise, self.times = noise, np.asarray(times, dtype=np.float64)
        self._phi = noise.remaining(np.diff(self.times))

    @cached_property
    def _factor(self) -> Floats:
        """(2, m) upper banded Cholesky factor of M."""
        phi, size = self._phi, self.noise.lasting**2
        rest = 1.0 - phi**2
        diagonal = np.ones(len(self.times))
        diagonal[1:] += phi**2 / rest
        diagonal[:-1] += phi**2 / rest
        bands = np.zeros((2, len(self.times)))
        bands[1] = diagonal / size + 1.0 / self.noise.white**2
        bands[0, 1:] = -phi / rest / size
        return np.asarray(cholesky_banded(bands))

    def solve(self, values: Floats) -> Floats:
        """Sigma^-1 of values (m,) or (m, k)."""
        white = self.noise.white**2
        if self.noise.lasting == 0.0:
            return values / white
        return np.asarray(values - cho_solve_banded((self._factor, False), values) / white) / white

    @cached_property
    def log_determinant(self) -> float:
        """Logarithm of |Sigma|."""
        m = len(self.times)
        white = 2.0 * m * np.log(self.noise.white)
        if self.noise.lasting == 0.0:
            return float(white)
        own = 2.0 * m * np.log(self.noise.lasting) + np.log1p(-(self._phi**2)).sum()
        return float(white + 2.0 * np.log(self._factor[1]).sum() + own)


def whitened(noise: Noise, times: Floats, e: Floats) -> Floats:
    """L^-1 e (m,) of errors e (m,): independent, of variance one, each with those before it.

    Args:
        noise: of the gauge.
        times: (m,) s, increasing.
        e: (m,) SI.
    """
    white = np.empty(len(e))
    mean, variance = 0.0, noise.lasting**2
    for k, phi in enumerate(noise.remaining(np.diff(times, prepend=times[0]))):
        mean *= phi
        variance = phi**2 * variance + (1.0 - phi**2) * noise.lasting**2
        total = variance + noise.white**2
        white[k] = (e[k] - mean) / np.sqrt(total)
        mean += variance / total * (e[k] - mean)
        variance *= noise.white**2 / total
    return white
