"""Simulated innovations of sound gauges go together as those of the joint normal distribution."""

import numpy as np
import pytest
from support.in_time import DAY, DRIFTING, covariance, drawn, effects

from geoident.identify.in_time.detection import Detector
from geoident.identify.in_time.innovations import Filter
from geoident.identify.in_time.noise import Noise
from geoident.identify.in_time.regression import TimeRegression
from geoident.identify.in_time.simulation import Correlations, FittedErrors, sound_innovations

WHITE, SLOW = 0.2, 0.7


def two(rho):
    return np.array([[1.0, rho], [rho, 1.0]])


def gauges(seed=12, m=160, k=100):
    """Filters of two gauges that are read on the same days, and these days."""
    t, y = drawn(m, np.random.default_rng(seed), DRIFTING)
    X = effects(t)
    end = TimeRegression(t[:k], y[:k], X[:k], DRIFTING).end
    return [Filter(end, t[k:], X[k:])] * 2, t, X, k


def test_sums_over_longer_times_are_more_alike_between_gauges():
    filters, t, X, k = gauges()
    sound = sound_innovations(filters, Correlations(two(WHITE), two(SLOW)), 4000,
                              np.random.default_rng(13))  # fmt: skip
    # errors of the new readings given the old ones, dense: white of one correlation, others of
    # the other
    S = covariance(DRIFTING, t)
    fit = TimeRegression(t[:k], np.zeros(k), X[:k], DRIFTING)
    G = np.linalg.solve(S[:k, :k], S[:k, k:]).T
    D = X[k:] - G @ X[:k]
    V = S[k:, k:] - G @ S[:k, k:] + D @ fit.covariance @ D.T
    white = DRIFTING.white**2 * np.eye(len(V))
    L = np.linalg.cholesky(V)
    between = np.linalg.solve(L, np.linalg.solve(L, WHITE * white + SLOW * (V - white)).T)
    a, b = sound
    np.testing.assert_allclose((a @ a.T) / 4000, np.eye(len(V)), atol=0.09)
    np.testing.assert_allclose((a @ b.T) / 4000, between, atol=0.09)
    g = filters[0].effects(np.ones((len(V), 1)))[:, 0]
    g /= np.linalg.norm(g)
    expected = g @ between @ g
    assert expected > 1.3 * np.mean(np.diag(between))
    assert np.mean((g @ a) * (g @ b)) == pytest.approx(expected, abs=0.06)


def test_what_all_gauges_share_is_no_change_of_the_structure():
    """Slow errors of all gauges raise as few alarms as independent ones at the stated rate."""
    filters, *_ = gauges()
    together = Correlations(two(WHITE), two(0.95))
    sound = sound_innovations(filters, together, 200, np.random.default_rng(14))
    usual = Detector(filters).correlated(sound)
    limit = usual.threshold(2.0 * usual.length, sound)
    others = sound_innovations(filters, together, 300, np.random.default_rng(15))
    assert np.mean(usual.largest(others) > limit) == pytest.approx(0.39, abs=0.12)


def test_correlations_are_estimated_from_the_errors_of_the_fit():
    rng = np.random.default_rng(16)
    t = np.arange(0.0, 4000.0, 5.0) * DAY
    noise = Noise(0.3, 0.5, 40.0 * DAY)
    lasting = np.linalg.cholesky(covariance(Noise(1e-6, 0.5, 40.0 * DAY), t))
    common = rng.standard_normal((2, len(t)))
    errors = []
    for _ in range(2):
        own = rng.standard_normal((2, len(t)))
        white = 0.3 * (np.sqrt(WHITE) * common[0] + np.sqrt(1.0 - WHITE) * own[0])
        slow = lasting @ (np.sqrt(SLOW) * common[1] + np.sqrt(1.0 - SLOW) * own[1])
        errors.append(FittedErrors.of(noise, t, white + slow))
    estimated = Correlations.of(errors)
    assert estimated.white[0, 1] == pytest.approx(WHITE, abs=0.12)
    assert estimated.slow[0, 1] == pytest.approx(SLOW, abs=0.2)
    # a gauge that is read on other days shares no white error, but what lasts
    elsewhere = FittedErrors(t + 2.0 * DAY, errors[1].white, errors[1].slow)
    estimated = Correlations.of([errors[0], elsewhere])
    assert estimated.white[0, 1] == 0.0
    assert estimated.slow[0, 1] == pytest.approx(SLOW, abs=0.2)
