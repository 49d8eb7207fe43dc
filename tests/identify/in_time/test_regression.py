"""Coefficients and noise of a gauge against dense least squares, likelihood and simulation."""

import numpy as np
import pytest
from scipy.stats import chi2
from support.in_time import DAY, DRIFTING, TRUTH, B, covariance, drawn, effects, times

from geoident.identify.in_time.innovations import Filter
from geoident.identify.in_time.noise import Noise
from geoident.identify.in_time.regression import TimeRegression, fitted_noise, regression_in_time

YEAR = 365.25 * DAY


def test_coefficients_are_those_of_generalized_least_squares():
    t, y = drawn(80, np.random.default_rng(2))
    X, S = effects(t), covariance(TRUTH, t)
    regression = TimeRegression(t, y, X, TRUTH)
    C = np.linalg.inv(X.T @ np.linalg.solve(S, X))
    b = C @ X.T @ np.linalg.solve(S, y)
    np.testing.assert_allclose(regression.covariance, C, rtol=1e-9)
    np.testing.assert_allclose(regression.b, b, rtol=1e-9)
    r = y - X @ b
    dense = np.linalg.slogdet(S)[1] + np.linalg.slogdet(X.T @ np.linalg.solve(S, X))[1]
    other = TimeRegression(t, y, X, Noise(0.4, 0.3, 10.0 * DAY))
    S2 = covariance(other.noise, t)
    r2 = y - X @ other.b
    dense2 = np.linalg.slogdet(S2)[1] + np.linalg.slogdet(X.T @ np.linalg.solve(S2, X))[1]
    assert regression.minus_two_l - other.minus_two_l == pytest.approx(
        dense + r @ np.linalg.solve(S, r) - dense2 - r2 @ np.linalg.solve(S2, r2), abs=1e-8
    )


@pytest.mark.slow  # counts many draws
def test_noise_and_intervals_are_right_on_the_average():
    """Of 60 records the ellipsoids of 95 % hold the coefficients; the noise is not too small."""
    rng = np.random.default_rng(3)
    held, sizes = [], []
    for _ in range(60):
        t, y = drawn(150, rng)
        found = regression_in_time(t, y, effects(t))
        off = found.b - B
        held.append(off @ np.linalg.solve(found.covariance, off) < chi2.ppf(0.95, len(B)))
        sizes.append((found.noise.white, found.noise.lasting))
    assert 0.85 <= np.mean(held) <= 1.0
    white, lasting = np.median(sizes, axis=0)
    assert white == pytest.approx(TRUTH.white, rel=0.15)
    assert lasting == pytest.approx(TRUTH.lasting, rel=0.15)


@pytest.mark.slow  # counts many draws
def test_white_noise_is_not_taken_for_one_that_lasts():
    rng = np.random.default_rng(4)
    lasts = []
    for _ in range(40):
        t = times(120, rng)
        y = effects(t) @ B + 0.3 * rng.standard_normal(120)
        lasts.append(regression_in_time(t, y, effects(t)).noise.lasting > 0.0)
    assert np.mean(lasts) < 0.1


def test_what_is_known_after_the_last_reading_is_the_conditional_mean():
    t, y = drawn(60, np.random.default_rng(5), DRIFTING)
    X, S = effects(t), covariance(DRIFTING, t)
    end = TimeRegression(t, y, X, DRIFTING).end
    # coefficients of a very wide prior, the lasting error of the last day, and the drift
    wide = 1e4
    lasting = DRIFTING.lasting**2 * np.exp(-(t[-1] - t) / DRIFTING.time)
    drift = DRIFTING.drift**2 * (1.0 + (t - t[0]) / YEAR)
    cross = np.column_stack([wide**2 * X, lasting, drift])
    full = S + wide**2 * X @ X.T
    prior = np.diag([*[wide**2] * len(B), DRIFTING.lasting**2, drift[-1]])
    np.testing.assert_allclose(end.mean, cross.T @ np.linalg.solve(full, y), rtol=1e-4, atol=1e-6)
    P = prior - cross.T @ np.linalg.solve(full, cross)
    np.testing.assert_allclose(end.P, P, rtol=1e-3, atol=1e-4)


def test_later_sums_of_innovations_vary_as_they_should_although_creep_follows_another_curve():
    """Creep by the logarithm of time, fitted by a line and one that fades, and looked at later."""
    rng, noise = np.random.default_rng(11), Noise(0.15, 0.2, 25.0 * DAY)
    t = np.arange(0.0, 3650.0, 10.0) * DAY
    root, old = np.linalg.cholesky(covariance(noise, t)), t < 6.0 * YEAR
    X = np.column_stack([effects(t), 1.0 - np.exp(-t / (300.0 * DAY))])
    squares = []
    for _ in range(12):
        y = 1.2 * np.log1p(t / (120.0 * DAY)) + root @ rng.standard_normal(len(t))
        fit = regression_in_time(t[old], y[old], X[old])
        later = Filter(fit.end, t[~old], X[~old])
        e = (y[~old] - later.predicted(y[~old])) / later.sd
        squares += [e[:72].sum() ** 2 / 72.0, e[72:144].sum() ** 2 / 72.0]
    assert 0.5 <= np.mean(squares) <= 2.0  # of 15 records 1.4; without a drift 3.7


def test_coefficients_of_known_size_are_those_of_their_posterior():
    """Against Gaussian conditioning and the likelihood with their variances in the covariance."""
    t, y = drawn(60, np.random.default_rng(5))
    X = effects(t)
    spread = np.where(np.arange(X.shape[1]) >= X.shape[1] - 2, 0.4, np.inf)
    free, known = X[:, np.isinf(spread)], X[:, np.isfinite(spread)]
    values = []
    for noise in (TRUTH, Noise(0.5, 0.2, 12.0 * DAY)):
        S = covariance(noise, t)
        N = X.T @ np.linalg.solve(S, X) + np.diag(np.isfinite(spread) / 0.4**2)
        regression = TimeRegression(t, y, X, noise, spread=spread)
        np.testing.assert_allclose(regression.covariance, np.linalg.inv(N), rtol=1e-8)
        b = np.linalg.solve(N, X.T @ np.linalg.solve(S, y))
        np.testing.assert_allclose(regression.b, b, rtol=1e-8)
        whole = S + 0.4**2 * known @ known.T
        M = free.T @ np.linalg.solve(whole, free)
        r = y - free @ np.linalg.solve(M, free.T @ np.linalg.solve(whole, y))
        dense = np.linalg.slogdet(whole)[1] + np.linalg.slogdet(M)[1]
        values.append((regression.minus_two_l, dense + r @ np.linalg.solve(whole, r)))
    (a, c), (d, e) = values
    assert a - d == pytest.approx(c - e, abs=1e-7)


def test_more_shapes_than_readings_leave_a_noise():
    """Shapes of known size need no readings of their own."""
    rng = np.random.default_rng(6)
    t = np.sort(rng.uniform(0.0, 200.0 * DAY, 12))
    X = np.column_stack([np.ones(12), rng.standard_normal((12, 16))])
    spread = np.append(np.inf, np.full(16, 0.05))
    regression = TimeRegression(t, 0.3 * rng.standard_normal(12), X, Noise(1.0), spread=spread)
    assert 0.1 < fitted_noise(regression).sd < 0.7
