"""Between the ends of an axis readings follow a cubic, beyond them a straight line."""

import numpy as np
import pytest

from geoident.identify.hierarchical import bands

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
