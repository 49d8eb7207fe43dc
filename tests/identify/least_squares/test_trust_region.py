"""The box of steps around a point, and least squares in a box, by hand."""

import numpy as np
import pytest

from geoident.identify.least_squares.several_starts import halton_starts
from geoident.identify.least_squares.trust_region import (
    TrustBox,
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


def test_further_starts_are_haltons_sequence():
    q = (Parameter("a", 5.0, 0.0, 10.0), Parameter("b", 5.0, -np.inf, np.inf))
    starts = list(halton_starts(Scaling(q), 3))
    share = np.array([(0.5, 1.0 / 3.0), (0.25, 2.0 / 3.0), (0.75, 1.0 / 9.0)])
    x = np.array(starts)
    np.testing.assert_allclose(x[:, 0] * Scaling(q).reference[0], 10.0 * share[:, 0])
    np.testing.assert_allclose(x[:, 1], 1.0 - 2.0 + 4.0 * share[:, 1])
