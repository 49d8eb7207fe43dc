"""Pressure of water at places: still, falling along a line, and in which groups."""

from __future__ import annotations

import numpy as np
import pytest
from support.meshes import box

from geoident.forward.in_situ.water import FacePressure, PorePressure, is_wet
from geoident.model.actions import HeadLine, Water, WaterPressure
from geoident.model.dual import ParameterPoint
from geoident.model.parameter import Scalar

POINT = ParameterPoint({"h": 2.5, "w": 1.1, "e": 0.8}, ("w", "e", "h"))
PLACES = np.array(
    [[1.0, 4.0, 2.0], [5.0, 1.0, 3.0], [-4.0, 0.0, 1.0], [30.0, 9.0, 1.5], [3.0, 2.0, 9.0]]
)


def test_pores_below_a_table():
    water = Water(Scalar(2.0, "h"), Scalar(1e4, "w"))
    found = PorePressure(water, box("tet4", (1, 1, 1)), PLACES)
    depth = np.maximum(5.0 - PLACES[:, 2], 0.0)
    columns = found.at(POINT).columns
    np.testing.assert_allclose(columns[:, 0], 1.1e4 * depth, rtol=1e-12)
    np.testing.assert_allclose(columns[:, 1], 1e4 * depth, rtol=1e-12)
    np.testing.assert_array_equal(columns[:, 2], 0.0)
    np.testing.assert_allclose(columns[:, 3], 2.0 * 1.1e4 * (depth > 0.0), rtol=1e-12)
    assert found.n_outside == 0


def test_pores_below_a_group_of_faces():
    """Three of the places lie beside the box, where its nearest node counts."""
    found = PorePressure(
        Water("z1", Scalar(1e4)), box("tet4", (1, 1, 1), size=(6.0, 5.0, 4.0)), PLACES
    )
    np.testing.assert_allclose(found.at(POINT).value, [2e4, 1e4, 3e4, 2.5e4, 0.0])
    assert found.n_outside == 2


@pytest.mark.parametrize("end", [None, Scalar(4.0, "e")])
def test_water_on_a_face_falls_along_a_line(end):
    """Of 3.2 times the way at the first places; before its start and beyond its end it is still."""
    start, stop = np.array([1.0, 1.0, 0.0]), np.array([9.0, 7.0, 0.0])
    falls = None if end is None else HeadLine(tuple(start), tuple(stop), end)
    load = WaterPressure("z0", Scalar(3.0, "h"), Scalar(1e4, "w"), falls)
    columns = FacePressure(load, PLACES).at(POINT).columns
    part = np.zeros(5) if end is None else np.clip((PLACES - start) @ (stop - start) / 100.0, 0, 1)
    if end is not None:
        np.testing.assert_allclose(part, [0.18, 0.32, 0.0, 1.0, 0.22])
    depth = (1 - part) * 7.5 + part * 3.2 - PLACES[:, 2]
    wet = depth > 0.0
    assert wet.tolist() == [True, True, True, True, False]
    np.testing.assert_allclose(columns[:, 0], 1.1e4 * depth * wet, rtol=1e-12)
    np.testing.assert_allclose(columns[:, 1], 1e4 * depth * wet, rtol=1e-12)
    np.testing.assert_allclose(columns[:, 2], 1.1e4 * 4.0 * part * wet, rtol=1e-12, atol=1e-9)
    np.testing.assert_allclose(columns[:, 3], 1.1e4 * 3.0 * (1 - part) * wet, rtol=1e-12, atol=1e-9)


def test_groups_with_water_in_their_pores():
    groups, names = np.array([2, 0, 1, 2, 0]), ("sand", "clay", "rock")
    assert is_wet(None, groups, names).tolist() == [False] * 5
    assert is_wet(Water(Scalar(0.0), Scalar(1.0)), groups, names).tolist() == [True] * 5
    some = Water(Scalar(0.0), Scalar(1.0), groups=("rock", "elsewhere", "clay"))
    assert is_wet(some, groups, names).tolist() == [True, False, True, True, False]
    none = Water(Scalar(0.0), Scalar(1.0), groups=())
    assert is_wet(none, groups, names).tolist() == [False] * 5
