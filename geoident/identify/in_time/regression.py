"""Linear regression of a gauge's readings in time, with its noise from the residuals (theory 16.2).

y = X b + e with e of a `Noise`. For a given noise b follows from generalized least squares,

    b = C X^T Sigma^-1 y ,   C = (X^T Sigma^-1 X)^-1

and the noise from the restricted likelihood, which accounts for what b has taken from the same
readings,

    -2 l = log|Sigma| + log|X^T Sigma^-1 X| + (y - X b)^T Sigma^-1 (y - X b)

Some of the columns may have coefficients of mean zero and given standard deviations s, such as
those of a model error: 1 / s^2 joins X^T Sigma^-1 X, and (b / s)^2 the sum of squares.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from scipy.linalg import cho_solve, cholesky

from geoident.identify.in_time.noise import PROCESSES, Noise, TimeCovariance
from geoident.model.arrays import Floats, Ints
from geoident.model.in_service import YEAR

WORTH = 6.0
"""Fall of -2 l from which on an error that lasts counts: its two numbers then earn their place."""

_LEAST_WHITE = 1e-3
"""Least error of a reading by itself, in standard deviations of the plain residuals."""

_ROUNDING = 1e-9
"""What is added to the diagonal of a correlation that may be singular."""

_NO_DRIFT = 1e-300
"""Stands for no drift where a search over logarithms begins: it is clipped to their range, SI."""


@dataclass(frozen=True)
class GaugeState:
    """What is known of a gauge after its last reading.

    Args:
        noise: of its readings.
        time: of the last one, s.
        mean: (q + 2,) the coefficients and, last, the error that lasts and the drift.
        P: (q + 2, q + 2) their covariance.
    """

    noise: Noise
    time: float
    mean: Floats
    P: Floats

    def drawn(self, normal: Floats, first: Ints | None = None) -> Floats:
        """(q + 2, s) errors of the mean, of standard normal numbers (q + 2, s).

        By the triangular factor of P, which may be singular: its columns mean the same for every
        gauge with these terms, so that draws of several gauges may be correlated column by column.

        Args:
            normal: independent random numbers.
            first: terms that come before the others: they depend on the first numbers alone; None
                for no such order.
        """
        size = np.sqrt(np.diag(self.P))  # a modulus and a motion are too far apart for one matrix
        scale = np.where(size > 0.0, size, 1.0)
        R = self.P / np.outer(scale, scale) + _ROUNDING * np.eye(len(size))
        order = np.arange(len(size))
        if first is not None:
            order = np.concatenate([first, np.setdiff1d(order, first)])
        errors = np.empty_like(normal)
        errors[order] = cholesky(R[np.ix_(order, order)], lower=True) @ normal
        return np.asarray(size[:, None] * errors)


@dataclass(frozen=True)
class Basis:
    """Columns that span X = Q R (m, q), of which no sum loses digits.

    Args:
        Q: (m, q).
        R: (q, q).
        prior: (k, q) what is known of the coefficients R b before, rows of size one.
    """

    Q: Floats
    R: Floats
    prior: Floats


def columns_basis(X: Floats, spread: Floats | None) -> Basis:
    """The basis of columns X (m, q) whose coefficients have a `TimeRegression.spread`."""
    q = X.shape[1]
    if spread is None:
        return Basis(*np.linalg.qr(X), np.zeros((0, q)))
    known = np.flatnonzero(np.isfinite(spread))
    rows = np.zeros((len(known), q))
    rows[np.arange(len(known)), known] = 1.0 / spread[known]
    # what the prior adds to the columns is as large as they are, so that R is well conditioned
    size = float(np.sqrt(np.mean((X[:, known] * spread[known]) ** 2))) if known.size else 1.0
    Q, R = np.linalg.qr(np.vstack([X, size * rows]))
    return Basis(Q[: len(X)], R, Q[len(X) :] / size)


@dataclass(frozen=True)
class TimeRegression:
    """Readings of one gauge, what explains them, and their noise.

    Args:
        times: (m,) s, increasing.
        y: (m,) readings, SI.
        X: (m, q) of full rank, q < m.
        noise: of the readings.
        basis: see `columns_basis`, where it is known.
        likely: other noises that the readings leave possible, as often as they are likely.
        spread: (q,) standard deviations of the coefficients about zero; inf for those of which
            nothing is known before, None where that is all.
    """

    times: Floats
    y: Floats
    X: Floats
    noise: Noise
    basis: Basis | None = None
    likely: tuple[Noise, ...] = ()
    spread: Floats | None = None

    @cached_property
    def _errors(self) -> TimeCovariance:
        return TimeCovariance(self.noise, self.times)

    @cached_property
    def _basis(self) -> Basis:
        return columns_basis(self.X, self.spread) if self.basis is None else self.basis

    @cached_property
    def _normal(self) -> tuple[Floats, Floats, Floats]:
        """Cholesky factor L of N = Q^T Sigma^-1 Q + prior, and Sigma^-1 of Q and of y."""
        Q, prior = self._basis.Q, self._basis.prior
        solved = self._errors.solve(np.column_stack([Q, self.y]))
        normal = Q.T @ solved[:, :-1] + prior.T @ prior
        return cholesky(normal, lower=True), solved[:, :-1], solved[:, -1]

    @cached_property
    def _c(self) -> Floats:
        """(q,) R b, the coefficients of Q."""
        L, _, y = self._normal
        return np.asarray(cho_solve((L, True), self._basis.Q.T @ y))

    @cached_property
    def b(self) -> Floats:
        """(q,) the coefficients."""
        return np.asarray(np.linalg.solve(self._basis.R, self._c), dtype=np.float64)

    @cached_property
    def covariance(self) -> Floats:
        """(q, q) C, of the coefficients."""
        root = np.linalg.solve(self._basis.R, np.linalg.inv(self._normal[0]).T)
        return np.asarray(root @ root.T)

    @property
    def residual(self) -> Floats:
        """(m,) readings less what explains them, SI."""
        return self.y - self.X @ self.b

    @cached_property
    def minus_two_l(self) -> float:
        """-2 l, up to a constant of the columns alone."""
        L, Q, y = self._normal
        left = float((self.y - self._basis.Q @ self._c) @ (y - Q @ self._c))
        left += float(np.sum((self._basis.prior @ self._c) ** 2))
        return self._errors.log_determinant + 2.0 * float(np.log(np.diag(L)).sum()) + left

    @property
    def end(self) -> GaugeState:
        """What is known after the last reading."""
        k = self._errors.with_last
        solved = self._errors.solve(k)
        pull = self.X.T @ solved
        q = len(self.b)
        P = np.zeros((q + PROCESSES, q + PROCESSES))
        P[:q, :q] = self.covariance
        P[:q, q:] = -self.covariance @ pull
        P[q:, :q] = P[:q, q:].T
        P[q:, q:] = np.diag(k[-1]) - k.T @ solved + pull.T @ self.covariance @ pull
        mean = np.concatenate([self.b, solved.T @ self.residual])
        return GaugeState(self.noise, float(self.times[-1]), mean, P)


def regression_in_time(times: Floats, y: Floats, X: Floats) -> TimeRegression:
    """The regression of a gauge with the noise that its residuals show.

    Args:
        times: (m,) s, increasing.
        y: (m,) readings, SI.
        X: (m, q) of full rank, q < m, a constant among the columns.
    """
    begun = TimeRegression(times, y, X, Noise(1.0))
    fitted = replace(begun, noise=fitted_noise(begun))
    return replace(fitted, likely=likely_noises(fitted))


def fitted_noise(regression: TimeRegression) -> Noise:
    """The noise that the residuals of a regression show, whatever noise it has."""
    search = _NoiseSearch(regression)
    if search.too_few:
        return Noise(search.size)
    lasting = [search.likeliest(start, _COARSE) for start in search.starts]
    best = min(lasting, key=lambda one: one.minus_two_l)
    best = search.likeliest(replace(best.noise, drift=search.drift(best)), _FINE)
    plain = search.likeliest(Noise(search.size, drift=best.noise.drift), _FINE)
    if best.minus_two_l > plain.minus_two_l - WORTH:
        best = plain
    return replace(best.noise, drift=search.drift(best))


def likely_noises(regression: TimeRegression) -> tuple[Noise, ...]:
    """Noises that the residuals of a regression leave possible, as often as they are likely."""
    search = _NoiseSearch(regression)
    return (regression.noise,) if search.too_few else search.likely(regression.noise)


class _NoiseSearch:
    """The noise of a regression: its parts by the restricted likelihood, beside a drift.

    Attributes:
        size: standard deviation of the residuals of plain least squares, SI.
        too_few: whether the readings do not tell how errors last.
    """

    def __init__(self, regression: TimeRegression) -> None:
        times, y, X, spread = regression.times, regression.y, regression.X, regression.spread
        self._given = replace(regression, basis=columns_basis(X, spread))
        free = X if spread is None else X[:, np.isinf(spread)]
        self.too_few = len(y) < free.shape[1] + 5
        columns = free if len(y) < X.shape[1] + 5 else X
        plain = y - columns @ np.linalg.lstsq(columns, y, rcond=None)[0]
        size = float(np.sqrt(plain @ plain / max(len(y) - columns.shape[1], 1)))
        self.size = max(size, 1e-12 * float(np.abs(y).max(initial=0.0)), np.finfo(float).tiny)
        self._spacing = float(np.median(np.diff(times)))
        self._span = float(times[-1] - times[0])

    def regression(self, noise: Noise) -> TimeRegression:
        """With a given noise."""
        return replace(self._given, noise=noise)

    @property
    def usual_drift(self) -> float:
        """A drift that adds as much as the residuals scatter over the record, SI in a year."""
        return self.size * float(np.sqrt(YEAR / self._span))

    @property
    def starts(self) -> list[Noise]:
        """From where to search; the time in which the error fades has several likely values."""
        longest = max(self._span / 10.0, 2.0 * self._spacing)
        return [
            Noise(0.5 * self.size, 0.75 * self.size, float(time), self.usual_drift)
            for time in np.geomspace(self._spacing, longest, 3)
        ]

    @property
    def _bounds(self) -> list[tuple[float, float]]:
        """Of white and lasting, in the size of the residuals, and of the time, s."""
        most = max(self._span / 3.0, self._spacing)
        return [(_LEAST_WHITE, 3.0), (5e-3, 20.0), (self._spacing / 3.0, most)]

    def likeliest(self, start: Noise, near: float) -> TimeRegression:
        """The likeliest parts beside the drift of the start; none that lasts if that has none.

        Args:
            start: of the search.
            near: tolerance of the logarithms of the parts.
        """
        from scipy.optimize import minimize  # noqa: PLC0415 - 0.3 s, and only these fits search so

        def regression(t: Floats) -> TimeRegression:
            white, *rest = np.exp(t).tolist()
            lasting, time = rest or (0.0, 1.0)
            noise = Noise(self.size * white, self.size * lasting, time, start.drift)
            return self.regression(noise)

        def minus_two_l(t: Floats) -> float:
            return regression(t).minus_two_l

        number = 3 if start.lasting else 1
        parts = [start.white / self.size, start.lasting / self.size, start.time][:number]
        bounds = np.log(self._bounds[:number])
        at: Floats = np.clip(np.log(np.maximum(parts, np.finfo(float).tiny)), *bounds.T)
        inwards = np.where(at < bounds.mean(axis=1), _STEP, -_STEP)
        simplex: Floats = np.vstack([at, at + np.diag(inwards)])
        best = minimize(
            minus_two_l,
            at,
            method="Nelder-Mead",
            bounds=[(float(low), float(high)) for low, high in bounds],
            options={"xatol": near, "fatol": near, "initial_simplex": simplex},
        )
        return regression(best.x)

    def likely(self, start: Noise) -> tuple[Noise, ...]:
        """Draws of the posterior of the noise by random steps (Metropolis et al. 1953).

        Priors: uniform for white, lasting and the logarithm of the time, half normal for the drift.
        """
        rng = np.random.default_rng(0)
        bounds = np.log([*self._bounds, (1e-3, 1e2)])
        bounds[:2] += np.log(self.size)
        bounds[3] += np.log(self.usual_drift)

        def minus_two_log(t: Floats) -> float:
            noise = Noise(*np.exp(t).tolist())
            return (
                self.regression(noise).minus_two_l
                + (noise.drift / self.usual_drift) ** 2
                - 2.0 * float(t[0] + t[1] + t[3])
            )

        if not start.lasting:  # it may have one that was not worth its numbers
            time = np.exp(bounds[2].mean())
            start = replace(start, lasting=_HIDDEN * start.white, time=float(time))
        sizes = [start.white, start.lasting, start.time, max(start.drift, _NO_DRIFT)]
        t = np.clip(np.log(sizes), *bounds.T)
        here = minus_two_log(t)
        draws = []
        for number in range(_LIKELY * _THINNED):
            other = t + _STEPS * rng.standard_normal(4)
            if ((other > bounds[:, 0]) & (other < bounds[:, 1])).all():
                there = minus_two_log(other)
                if np.log(rng.random()) < 0.5 * (here - there):
                    t, here = other, there
            if number % _THINNED == 0:
                draws.append(Noise(*np.exp(t).tolist()))
        return tuple(draws)

    def drift(self, regression: TimeRegression) -> float:
        """The drift that the readings leave possible: root of the mean square of its posterior.

        Its prior is half a normal distribution of the usual drift. The likeliest one is often none,
        since a record of some years cannot exclude a drift that doubles the variance of a later
        sum of innovations.
        """
        noise, usual = regression.noise, self.usual_drift
        trials = [self.regression(replace(noise, drift=usual * x)) for x in _DRIFTS]
        minus_two_l = np.array([trial.minus_two_l for trial in trials]) + _DRIFTS**2
        weight = np.exp(-0.5 * (minus_two_l - minus_two_l.min()))
        square = np.trapezoid(weight * _DRIFTS**2, _DRIFTS) / np.trapezoid(weight, _DRIFTS)
        return float(usual * np.sqrt(square))


_COARSE, _FINE = 0.3, 0.02
"""Tolerances of a search among starts, and of the last one."""

_STEP = 0.7
"""First steps of a search, in logarithms."""

_LIKELY, _THINNED = 30, 5
"""Likely noises that are kept, and steps from one to the next."""

_HIDDEN = 0.3
"""An error that lasts and hardly shows, in that of a reading by itself."""

_STEPS = np.array([0.2, 0.25, 0.5, 0.8])
"""Standard deviations of a step, of the logarithms of white, lasting, time and drift."""

_DRIFTS = np.concatenate([[0.0], np.geomspace(0.1, 12.0, 14)])
"""Drifts that are compared, in usual ones."""
