"""The box of steps around a point, and least squares in a box, by hand."""

import numpy as np
import pytest
from scipy.optimize import lsq_linear

from geoident.identify.least_squares import trust_region
from geoident.identify.least_squares.several_starts import halton_starts
from geoident.identify.least_squares.trust_region import (
    TrustBox,
    bounded_least_squares,
    smallest_solution,
)
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


def test_every_parameter_of_one_sign_has_its_own_factor():
    """Whatever their sizes and signs are, and how many there are."""
    sizes = np.array([3.0, -0.5, 7.0, 1.1])
    scaling = Scaling([Parameter(f"p{n}", x, *sorted((x / 9, 9 * x))) for n, x in enumerate(sizes)])
    low, high = TrustBox(scaling).sides(scaling.start, 0.3)
    ends = scaling.start[:, None] * np.expm1([-0.3, 0.3])
    np.testing.assert_allclose(low, ends.min(axis=1), rtol=1e-12)
    np.testing.assert_allclose(high, ends.max(axis=1), rtol=1e-12)


def test_a_unit_is_the_step_of_length_one_to_first_order(scaling):
    box, x = TrustBox(scaling), scaling.start
    for i, unit in enumerate(box.unit(x)):
        d = np.zeros(len(ALL))
        d[i] = 1e-6 * unit
        assert box.length(x, d) == pytest.approx(1e-6, rel=1e-5)


def test_a_step_to_a_bound_ends_on_it_exactly(scaling):
    box, x = TrustBox(scaling), scaling.start
    low, high = scaling.lower - x, scaling.upper - x
    assert np.array_equal(box.reach(x, low)[:5], scaling.lower[:5])
    assert np.array_equal(box.reach(x, high)[:5], scaling.upper[:5])
    half = np.where(np.isfinite(high), 0.5 * high, 1.0)
    assert np.array_equal(box.reach(x, half), x + half)


def test_what_is_seen_to_a_part_of_ten_billion_does_not_count():
    """Singular values of 1 and 2e-10 count, of 1 and 0.5e-10 only the first."""
    b = np.array([-1.0, -1e-10])
    assert smallest_solution(np.diag([1.0, 2e-10]), b) == pytest.approx([1.0, 0.5])
    assert smallest_solution(np.diag([1.0, 0.5e-10]), b) == pytest.approx([1.0, 0.0])


@pytest.mark.parametrize("seed", range(40))
def test_the_minimum_in_a_box_fulfils_the_conditions_of_kuhn_and_tucker(seed):
    """Also with columns of very different size, and sides at zero."""
    rng = np.random.default_rng(seed)
    n = int(rng.integers(2, 8))
    A = rng.normal(size=(n + 2, n)) * 10.0 ** rng.uniform(-4, 4, n)
    b = rng.normal(size=n + 2)
    size = 1.0 / np.linalg.norm(A, axis=0)
    lower, upper = -rng.random(n) * size, rng.random(n) * size
    lower[rng.random(n) < 0.2] = 0.0
    upper[rng.random(n) < 0.2] = 0.0
    d = bounded_least_squares(A, b, lower, upper)
    g = (A.T @ (A @ d + b)) * size
    assert np.all((d >= lower) & (d <= upper))
    inside = (d > lower) & (d < upper)
    assert np.all(np.abs(g[inside]) < 1e-11)
    assert np.all(g[(d == lower) & (d < upper)] > -1e-11)
    assert np.all(g[(d == upper) & (d > lower)] < 1e-11)


@pytest.mark.parametrize("sides", [([-1.0, -9.0], [9.0, 9.0]), ([-9.0, -9.0], [9.0, 0.5])])
def test_a_minimum_on_the_box_is_found_at_once(monkeypatch, sides):
    solved = []

    def counted(A, b):
        solved.append(smallest_solution(A, b))
        return solved[-1]

    monkeypatch.setattr(trust_region, "smallest_solution", counted)
    d = bounded_least_squares(np.eye(2), np.array([1.0, -0.5]), *np.array(sides))
    assert d.tolist() == [-1.0, 0.5]
    assert len(solved) == 1


def test_a_move_ends_where_the_first_variable_meets_the_box():
    """From (0.5, 0, 0) towards (3, 4, -8): the third is at its side of -2 after a quarter."""
    d, free = np.array([0.5, 0.0, 0.0]), np.array([True, True, True])
    low, high = np.array([-9.0, -9.0, -2.0]), np.array([9.0, 3.9, 9.0])
    b = np.array([-3.0, -4.0, 8.0])
    d, free, ended = trust_region._move(np.eye(3), b, d, free, low, high)
    assert d.tolist() == [1.125, 1.0, -2.0]
    assert (free.tolist(), ended) == ([True, True, False], False)
    d, free, ended = trust_region._move(np.eye(3), b, d, free, low, high)
    assert d == pytest.approx([1.125 + 1.875 * 2.9 / 3.0, 3.9, -2.0], rel=1e-15)
    assert (free.tolist(), ended) == ([True, False, False], False)
    d, free, ended = trust_region._move(np.eye(3), b, d, free, low, high)
    assert d == pytest.approx([3.0, 3.9, -2.0], rel=1e-15)
    assert (free.tolist(), ended) == ([True, False, False], True)


def test_columns_of_very_different_size_are_released_by_their_own_size():
    """Both run into a side first; which gives way is judged per unit of its column."""
    A = np.array([[1e3, 0.0], [0.0, 1e-3], [1.0, 1e-3]])
    unit = np.array([1e-3, 1e3])
    lower, upper = np.array([-0.5, -1.0]), np.array([0.2, 4.0])
    for b in ([300.0, 2e-3, -0.5], [-300.0, -2e-3, 0.7], [2e3, -3e-3, 0.1], [9.0, 5e-3, 0.0]):
        d = bounded_least_squares(A, np.array(b), lower, upper)
        best = lsq_linear(
            A * unit, -np.array(b), (lower / unit, upper / unit), method="bvls", tol=1e-15
        ).x
        np.testing.assert_allclose(d, best * unit, rtol=1e-6, atol=1e-9)


def test_a_variable_that_cannot_move_stays():
    A, b = np.eye(2), np.array([-5.0, -5.0])
    d = bounded_least_squares(A, b, np.array([0.0, -9.0]), np.array([0.0, 1.0]))
    assert d.tolist() == [0.0, 1.0]


def test_further_starts_are_haltons_sequence():
    q = (Parameter("a", 5.0, 0.0, 10.0), Parameter("b", 5.0, -np.inf, np.inf))
    starts = list(halton_starts(Scaling(q), 3))
    share = np.array([(0.5, 1.0 / 3.0), (0.25, 2.0 / 3.0), (0.75, 1.0 / 9.0)])
    x = np.array(starts)
    np.testing.assert_allclose(x[:, 0] * Scaling(q).reference[0], 10.0 * share[:, 0])
    np.testing.assert_allclose(x[:, 1], 1.0 - 2.0 + 4.0 * share[:, 1])
