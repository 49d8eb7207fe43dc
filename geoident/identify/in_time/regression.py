"""Linear regression of a gauge's readings in time, with its noise from the residuals (theory 16.2).

y = X b + e with e of a `Noise`. For a given noise b follows from generalized least squares,

    b = C X^T Sigma^-1 y ,   C = (X^T Sigma^-1 X)^-1

and the noise from the restricted likelihood, which accounts for what b has taken from the same
readings,

    -2 l = log|Sigma| + log|X^T Sigma^-1 X| + (y - X b)^T Sigma^-1 (y - X b)
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy.linalg import cho_solve, cholesky

from geoident.identify.in_time.noise import Noise, TimeCovariance
from geoident.model.arrays import Floats

WORTH = 6.0
"""Fall of -2 l from which on an error that lasts counts: its two numbers then earn their place."""

_LEAST_WHITE = 1e-3
"""Least error of a reading by itself, in standard deviations of the plain residuals."""


@dataclass(frozen=True)
class GaugeState:
    """What is known of a gauge after its last reading.

    Args:
        noise: of its readings.
        time: of the last one, s.
        mean: (q + 1,) the coefficients and, last, the error that lasts.
        P: (q + 1, q + 1) their covariance.
    """

    noise: Noise
    time: float
    mean: Floats
    P: Floats


@dataclass(frozen=True)
class TimeRegression:
    """Readings of one gauge, what explains them, and their noise.

    Args:
        times: (m,) s, increasing.
        y: (m,) readings, SI.
        X: (m, q) of full rank, q < m.
        noise: of the readings.
    """

    times: Floats
    y: Floats
    X: Floats
    noise: Noise

    @cached_property
    def _errors(self) -> TimeCovariance:
        return TimeCovariance(self.noise, self.times)

    @cached_property
    def _basis(self) -> tuple[Floats, Floats]:
        """Orthonormal columns that span X, and R with X = Q R: no sum then loses digits."""
        Q, R = np.linalg.qr(self.X)
        return Q, R

    @cached_property
    def _normal(self) -> tuple[Floats, Floats, Floats]:
        """Cholesky factor L of N = Q^T Sigma^-1 Q, and Sigma^-1 of Q and of y."""
        Q, _ = self._basis
        solved = self._errors.solve(np.column_stack([Q, self.y]))
        return cholesky(Q.T @ solved[:, :-1], lower=True), solved[:, :-1], solved[:, -1]

    @cached_property
    def b(self) -> Floats:
        """(q,) the coefficients."""
        Q, R = self._basis
        L, _, y = self._normal
        return np.asarray(np.linalg.solve(R, cho_solve((L, True), Q.T @ y)))

    @cached_property
    def covariance(self) -> Floats:
        """(q, q) C, of the coefficients."""
        _, R = self._basis
        root = np.linalg.solve(R, np.linalg.inv(self._normal[0]).T)
        return np.asarray(root @ root.T)

    @property
    def residual(self) -> Floats:
        """(m,) readings less what explains them, SI."""
        return self.y - self.X @ self.b

    @cached_property
    def minus_two_l(self) -> float:
        """-2 l, up to a constant of the columns alone."""
        L, _, y = self._normal
        left = float(self.residual @ (y - self._errors.solve(self.X @ self.b)))
        return self._errors.log_determinant + 2.0 * float(np.log(np.diag(L)).sum()) + left

    @property
    def end(self) -> GaugeState:
        """What is known after the last reading."""
        k = self.noise.lasting**2 * self.noise.remaining(self.times[-1] - self.times)
        solved = self._errors.solve(k)
        pull = solved @ self.X
        mean = np.append(self.b, solved @ self.residual)
        P = np.zeros((len(mean), len(mean)))
        P[:-1, :-1] = self.covariance
        P[-1, :-1] = P[:-1, -1] = -self.covariance @ pull
        P[-1, -1] = self.noise.lasting**2 - k @ solved + pull @ self.covariance @ pull
        return GaugeState(self.noise, float(self.times[-1]), mean, P)


def regression_in_time(
    times: Floats, y: Floats, X: Floats, white: float | None = None
) -> TimeRegression:
    """The regression of a gauge with the noise that its residuals show.

    Args:
        times: (m,) s, increasing.
        y: (m,) readings, SI.
        X: (m, q) of full rank, q < m.
        white: what each reading has by itself, SI; None to estimate it.
    """
    plain = y - X @ np.linalg.lstsq(X, y, rcond=None)[0]
    size = float(np.sqrt(plain @ plain / max(len(y) - X.shape[1], 1)))
    size = max(size, 1e-12 * float(np.abs(y).max(initial=0.0)), np.finfo(float).tiny)
    spacing = float(np.median(np.diff(times)))
    span = float(times[-1] - times[0])

    def of(noise: Noise) -> TimeRegression:
        return TimeRegression(times, y, X, noise)

    best = of(Noise(size if white is None else white))
    if len(y) < X.shape[1] + 5:
        return best

    def noise(t: Floats) -> Noise:
        """Of the logarithms of sizes, in `size`, and of the time in which it fades, s."""
        own = size * np.exp(t[2]) if white is None else white
        return Noise(float(own), float(size * np.exp(t[0])), float(np.exp(t[1])))

    def minus_two_l(t: Floats) -> float:
        return of(noise(t)).minus_two_l

    from scipy.optimize import minimize  # noqa: PLC0415 - 0.3 s, and only these fits search so

    bounds = [(-5.0, 3.0), (np.log(spacing / 3.0), np.log(max(span / 3.0, spacing)))]
    bounds += [(np.log(_LEAST_WHITE), 1.0)] if white is None else []
    for time in np.geomspace(spacing, max(span / 10.0, 2.0 * spacing), 3):
        start = np.array([-0.3, np.log(time), -0.7][: len(bounds)])
        found = minimize(
            minus_two_l,
            np.clip(start, *np.transpose(bounds)),
            method="Nelder-Mead",
            bounds=bounds,
            options={"xatol": 0.02, "fatol": 0.02},
        )
        trial = of(noise(found.x))
        if trial.minus_two_l < best.minus_two_l - (WORTH if best.noise.lasting == 0.0 else 0.0):
            best = trial
    return best
