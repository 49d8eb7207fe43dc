"""Innovations are those of the joint normal distribution of old and new readings."""

import numpy as np
from support.in_time import DAY, DRIFTING, covariance, drawn, effects

from geoident.identify.in_time.innovations import Filter, single_wrong
from geoident.identify.in_time.regression import TimeRegression


def old_and_new(seed=6, m=100, k=70):
    t, y = drawn(m, np.random.default_rng(seed))
    X = effects(t)
    return t, y, X, k, TimeRegression(t[:k], y[:k], X[:k], DRIFTING)


def conditional(t, y, X, k, regression):
    """Mean and covariance of the new readings, given the old ones, by dense matrices."""
    S = covariance(DRIFTING, t)
    G = np.linalg.solve(S[:k, :k], S[:k, k:]).T
    D = X[k:] - G @ X[:k]
    mean = X[k:] @ regression.b + G @ (y[:k] - X[:k] @ regression.b)
    return mean, S[k:, k:] - G @ S[:k, k:] + D @ regression.covariance @ D.T


def test_innovations_are_whitened_by_the_conditional_covariance(verification):
    t, y, X, k, regression = old_and_new()
    mean, V = conditional(t, y, X, k, regression)
    root = np.linalg.cholesky(V)
    filtered = Filter(regression.end, t[k:], X[k:])
    e = (y[k:] - filtered.predicted(y[k:])) / filtered.sd
    np.testing.assert_allclose(e, np.linalg.solve(root, y[k:] - mean), rtol=1e-8, atol=1e-10)
    np.testing.assert_allclose(filtered.sd, np.diag(root), rtol=1e-8)
    exact = np.linalg.solve(root, y[k:] - mean)
    verification("innovations", "", (t[k:] - t[k - 1]) / DAY, exact=exact, found=e)
    steps = np.tril(np.ones((len(t) - k, len(t) - k)))
    np.testing.assert_allclose(filtered.effects(steps), np.linalg.solve(root, steps), atol=1e-10)


def test_a_skipped_reading_is_as_if_it_had_not_been():
    t, y, X, k, regression = old_and_new()
    skipped = np.zeros(len(t) - k, dtype=bool)
    skipped[[3, 8]] = True
    filtered = Filter(regression.end, t[k:], X[k:], skipped)
    without = Filter(regression.end, t[k:][~skipped], X[k:][~skipped])
    np.testing.assert_allclose(
        filtered.predicted(y[k:])[~skipped], without.predicted(y[k:][~skipped]), rtol=1e-12
    )
    wrong = y[k:].copy()
    wrong[skipped] += 1e3
    np.testing.assert_allclose(
        filtered.predicted(wrong)[~skipped], filtered.predicted(y[k:])[~skipped], rtol=1e-12
    )


def test_a_single_wrong_reading_is_told_from_a_step():
    t, y, X, k, regression = old_and_new()
    new = y[k:].copy()
    new[10] += 6.0
    wrong = single_wrong(regression.end, t[k:], X[k:], new, 4.0)
    assert wrong.tolist() == [n == 10 for n in range(len(new))]
    new = y[k:].copy()
    new[10:] += 6.0
    assert not single_wrong(regression.end, t[k:], X[k:], new, 4.0).any()
