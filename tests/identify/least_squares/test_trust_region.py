"""The box of steps around a point, and least squares in a box, by hand."""

import numpy as np
import pytest
from scipy.optimize import lsq_linear

from geoident.identify.least_squares.trust_region import TrustBox, bounded_least_squares
from geoident.identify.problem.scaling import Scaling
from geoident.model.parameter import Parameter

LOG = Parameter("E", 2.0, 1.0, 100.0, "log")
POSITIVE = Parameter("K0", 2.0, 1.0, 100.0)
NEGATIVE = Parameter("s", -2.0, -100.0, -1.0)
WIDE = Parameter("t", 1.0, -40.0, 60.0)
NARROW = Parameter("u", 1.0, -1.0, 1.5)
FREE = Parameter("f", 3.0, -np.inf, np.inf)
ALL = (LOG, POSITIVE, NEGATIVE, WIDE, NARROW, FREE)


@pytest.fixture
def scaling():
    return Scaling(ALL)


def test_a_step_of_one_is_a_factor_e_or_a_quarter_of_the_width(scaling):
    low, high = TrustBox(scaling).sides(scaling.start, 0.5)
    reference = scaling.reference
    assert reference.tolist() == [1.0, 9.9, 9.9, 10.0, 1.0, 3.0]
    factor = np.exp(0.5)
    assert high[0] == pytest.approx(0.5)
    assert high[1] * reference[1] == pytest.approx(2.0 * (factor - 1.0))
    assert high[2] * reference[2] == pytest.approx(-2.0 * (1.0 / factor - 1.0))
    assert high[3] * reference[3] == pytest.approx(0.5 * 0.25 * 100.0)  # a quarter of the width
    assert high[4] * reference[4] == pytest.approx(0.5)  # more than a quarter of the width: one x
    assert high[5] * reference[5] == pytest.approx(0.5 * 3.0)
    assert low[0] == pytest.approx(-0.5)
    assert low[1] * reference[1] == pytest.approx(2.0 * (1.0 / factor - 1.0))
    assert low[2] * reference[2] == pytest.approx(-2.0 * (factor - 1.0))
    assert low[3] * reference[3] == pytest.approx(-0.5 * 0.25 * 100.0)


def test_the_box_ends_on_the_bounds(scaling):
    low, high = TrustBox(scaling).sides(scaling.start, np.inf)
    ends = np.array([(q.lower, q.upper) for q in ALL])
    np.testing.assert_allclose((scaling.start + low)[1:] * scaling.reference[1:], ends[1:, 0])
    np.testing.assert_allclose((scaling.start + high)[1:] * scaling.reference[1:], ends[1:, 1])
    assert np.exp(scaling.start + low)[0] == pytest.approx(1.0)
    assert np.exp(scaling.start + high)[0] == pytest.approx(100.0)


def test_the_length_is_the_radius_whose_box_a_step_just_fits(scaling):
    box, x = TrustBox(scaling), scaling.start
    low, high = box.sides(x, 0.3)
    for i in range(len(ALL)):
        for side in (low, high):
            d = np.zeros(len(ALL))
            d[i] = side[i]
            assert box.length(x, d) == pytest.approx(0.3)
    d = 0.1 * low
    d[3] = high[3]
    assert box.length(x, d) == pytest.approx(0.3)


@pytest.mark.parametrize("lower", [0.0, -0.01, -0.9, -1.1])
@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_a_parameter_that_may_be_zero_moves_by_lengths_and_not_by_factors(lower, sign):
    bounds = sorted((sign * lower, sign * 1.5))
    scaling = Scaling([Parameter("v", 0.3 * sign, *bounds)])
    box, width = TrustBox(scaling), float(scaling.upper[0] - scaling.lower[0])
    for place in (0.3, 1e-3, 0.7):
        x = np.array([place * sign]) / scaling.reference
        low, high = box.sides(x, 0.1)
        assert max(high[0], -low[0]) == pytest.approx(0.1 * max(0.25 * width, 1.0))


def test_a_step_to_a_bound_ends_on_it_exactly(scaling):
    box, x = TrustBox(scaling), scaling.start
    low, high = scaling.lower - x, scaling.upper - x
    assert np.array_equal(box.reach(x, low)[:5], scaling.lower[:5])
    assert np.array_equal(box.reach(x, high)[:5], scaling.upper[:5])
    half = np.where(np.isfinite(high), 0.5 * high, 1.0)
    assert np.array_equal(box.reach(x, half), x + half)


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
