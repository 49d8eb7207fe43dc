"""Least squares in a box."""

import numpy as np
import pytest
from scipy.optimize import lsq_linear

from geoident.identify.least_squares.trust_region import bounded_least_squares


@pytest.mark.parametrize("seed", range(20))
def test_bounded_least_squares_agrees_with_an_independent_solver(seed):
    rng = np.random.default_rng(seed)
    n = int(rng.integers(1, 9))
    A, b = rng.normal(size=(n + 3, n)), 3.0 * rng.normal(size=n + 3)
    lower, upper = -rng.random(n), rng.random(n)
    d = bounded_least_squares(A, b, lower, upper)
    reference = lsq_linear(A, -b, (lower, upper), method="bvls", tol=1e-14).x
    np.testing.assert_allclose(d, reference, atol=1e-9)


def test_bounded_least_squares_takes_the_smallest_step_where_columns_are_equal():
    A = np.array([[1.0, 1.0, 0.0], [1.0, 1.0, 0.0]])
    d = bounded_least_squares(A, np.array([-1.0, -1.0]), np.full(3, -9.0), np.full(3, 9.0))
    np.testing.assert_allclose(d, [0.5, 0.5, 0.0], atol=1e-14)
    d = bounded_least_squares(
        A, np.array([-1.0, -1.0]), np.full(3, -9.0), np.array([0.1, 9.0, 9.0])
    )
    np.testing.assert_allclose(d, [0.1, 0.9, 0.0], atol=1e-14)


def _random_box(seed):
    """A, b, lower, upper of a problem with what makes it degenerate: see the names."""
    rng = np.random.default_rng(seed)
    g, n = (int(rng.integers(1, size)) for size in (12, 9))
    A, b = rng.normal(size=(g, n)), 3.0 * rng.normal(size=g)
    lower, upper = -rng.random(n), rng.random(n)
    unseen, twin, fixed, left, right, free = (int(i) for i in rng.integers(n, size=6))
    if seed % 3 == 0:
        A[:, unseen] = 0.0
    if seed % 4 == 0:
        A[:, twin] = 2.0 * A[:, -1]
    if seed % 5 == 0:
        lower[fixed] = upper[fixed] = 0.0
    if seed % 2 == 0:
        lower[left] = upper[right] = 0.0
    if seed % 7 == 0:
        lower[free], upper[free] = -np.inf, np.inf
    scale = 10.0 ** rng.integers(-6, 7)
    return A * scale, b * scale, lower, upper


@pytest.mark.parametrize("first", range(0, 420, 42))
def test_bounded_least_squares_fulfils_the_kuhn_tucker_conditions(first):
    """With them the minimum is proven, whatever way led there; what A does not see stays."""
    for seed in range(first, first + 42):
        A, b, lower, upper = _random_box(seed)
        d = bounded_least_squares(A, b, lower, upper)
        g, small = A.T @ (A @ d + b), 1e-9 * np.linalg.norm(A) * np.linalg.norm(b)
        assert np.all((d >= lower) & (d <= upper))
        assert np.all(np.abs(g[(d > lower) & (d < upper)]) <= small)
        assert np.all(g[(d == lower) & (lower < upper)] >= -small)
        assert np.all(g[(d == upper) & (lower < upper)] <= small)
        assert np.all(np.abs(d[~A.any(axis=0)]) <= 1e-12)


def test_bounded_least_squares_counts_as_unseen_what_is_1e_10_of_the_largest():
    b, wide = np.array([-1.0, -1e-9]), np.full(2, np.inf)
    for smallest, expected in ((1.1e-10, 1e-9 / 1.1e-10), (0.9e-10, 0.0)):
        d = bounded_least_squares(np.diag([1.0, smallest]), b, -wide, wide)
        np.testing.assert_allclose(d, [1.0, expected], rtol=1e-6, atol=1e-15)
