"""Between the ends of an axis readings follow a cubic, beyond them a straight line."""

import numpy as np
import pytest

from geoident.identify.hierarchical import bands
from geoident.identify.hierarchical.knowledge import FurtherSection, Interval95
from geoident.identify.problem.scaling import Scaling
from geoident.model.parameter import Parameter

A, B, C = np.array([2.0, -1.0]), np.array([0.5, 0.3]), np.array([-0.2, 0.4])
V0 = np.array([7.0, -3.0])


def change(t):
    return A * t + B * t**2 + C * t**3


def slope(t):
    return A + 2.0 * B * t + 3.0 * C * t**2


def test_a_cubic_is_met_between_the_ends_and_its_tangent_beyond():
    ends = [bands._Side(t, V0 + change(t), slope(t)) for t in (-1.5, 2.0)]
    found = bands._along(np.array([-3.0, -1.0, -0.2, 0.7, 2.0, 3.5]), A, V0, ends)
    inside = [change(t) for t in (-1.0, -0.2, 0.7, 2.0)]
    assert found[1:5] == pytest.approx(np.array(inside), rel=1e-12)
    assert found[0] == pytest.approx(change(-1.5) - 1.5 * slope(-1.5), rel=1e-12)
    assert found[5] == pytest.approx(change(2.0) + 1.5 * slope(2.0), rel=1e-12)


def test_where_an_end_is_unknown_the_slope_at_the_middle_holds():
    found = bands._along(np.array([-2.0, 1.0]), A, V0, [None, None])
    assert found == pytest.approx(np.outer([-2.0, 1.0], A))


def curve(z):
    """A reading that follows a cubic of the parameter, and one that it does not move."""
    return np.array([z + 0.3 * z**3, 4.0])


@pytest.mark.parametrize(
    ("known_from", "lowest"),
    [
        (-np.inf, -1.96 - 0.3 * 1.96**3),
        (-1.5, -1.3 - 0.96 * 1.9),  # by the tangent at -1, the next place that is tried
        (-0.01, -1.96),  # by the slope at the middle
    ],
)
def test_bands_follow_readings_that_are_not_linear(known_from, lowest):
    """The ends of the band are the readings at the ends of the parameter's interval."""
    scaling = Scaling([Parameter("a", 10.0, -np.inf, np.inf)])
    unit = scaling.reference[0]

    def evaluate(points):
        z = [(p[0] - 10.0) / unit for p in points]
        slopes = [np.array([[1.0 + 0.9 * x**2], [0.0]]) / unit for x in z]
        made = [(curve(x), slope) for x, slope in zip(z, slopes, strict=True)]
        return [one if x > known_from else None for x, one in zip(z, made, strict=True)]

    one = np.ones(1)
    none = Interval95(one, one, one, one)
    section = FurtherSection(
        10.0 * one, none, np.zeros((1, 1)), np.ones((1, 1, 1)), np.ones(1), scaling
    )
    found = bands.reading_bands(section, evaluate, np.array([0.0, 0.5]))
    np.testing.assert_array_equal(found.computed, curve(0.0))
    slope = 1.0 + 0.9 * 1.96**2
    assert found.upper95[0] == pytest.approx(curve(1.96)[0], abs=0.05 * slope)
    assert found.lower95[0] == pytest.approx(lowest, abs=0.05 * slope)
    assert found.median[0] == pytest.approx(0.0, abs=0.03)
    ends = found.lower95[1], found.upper95[1]
    assert ends == pytest.approx((4.0 - 0.98, 4.0 + 0.98), abs=0.03)
    assert found.sd[1] == pytest.approx(0.5, rel=0.02)
