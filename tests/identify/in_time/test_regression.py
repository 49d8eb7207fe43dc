"""Coefficients and noise of a gauge against dense least squares, likelihood and simulation."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.stats import chi2
from support.in_time import DAY, DRIFTING, TRUTH, B, covariance, drawn, effects, times

from geoident.identify.in_time.innovations import Filter
from geoident.identify.in_time.noise import Noise
from geoident.identify.in_time.regression import TimeRegression, regression_in_time

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


@pytest.mark.parametrize("drift", [0.0, 0.2, 0.8])
def test_later_sums_of_innovations_vary_as_they_should(drift):
    """Whatever the true drift: none, about as the scatter over ten years, and four times that."""
    rng = np.random.default_rng(11)
    noise = replace(TRUTH, drift=drift)
    squares, drifts = [], []
    for _ in range(25):
        t, y = drawn(300, rng, noise)
        X, k = effects(t), 200
        fit = regression_in_time(t[:k], y[:k], X[:k])
        filtered = Filter(fit.end, t[k:], X[k:])
        e = (y[k:] - filtered.predicted(y[k:])) / filtered.sd
        squares.append((e[:50].sum() ** 2 + e[50:].sum() ** 2) / 100.0)
        drifts.append(fit.noise.drift)
    assert 0.4 <= np.mean(squares) <= 2.0  # without a drift 1.0, 1.9 and 8 times
    if drift == 0.8:
        assert np.median(drifts) == pytest.approx(drift, rel=0.3)
