"""What a channel makes of the stress at its place: against tensors written out."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from support.force_gauges import gauge

from geoident.fem.recovery import Recovery
from geoident.forward.gauges.observation import AnalysisState
from geoident.forward.gauges.stress import (
    PRINCIPAL,
    PorePressures,
    Reader,
    StressReadings,
    _tensor,
    component_weights,
    normal_coefficients,
    principal_values,
)

PLACES = {"xx": (0, 0), "yy": (1, 1), "zz": (2, 2), "xy": (0, 1), "yz": (1, 2), "xz": (0, 2)}
RANDOM = np.random.default_rng(12)


def _full(components):
    tensor = np.zeros((3, 3, *np.shape(components)[1:]))
    for value, (i, j) in zip(components, PLACES.values(), strict=False):
        tensor[i, j] = tensor[j, i] = value
    return tensor


@pytest.mark.parametrize("n_strain", [4, 6])
def test_a_stress_has_its_components_in_a_symmetric_tensor(n_strain):
    stress = RANDOM.standard_normal((n_strain, 3))
    np.testing.assert_array_equal(_tensor(stress, (0, 1, 2)), _full(stress))
    np.testing.assert_array_equal(_tensor(stress, (0, 1)), _full(stress)[:2, :2])
    np.testing.assert_array_equal(_tensor(stress, (2, 0)), _full(stress)[np.ix_([2, 0], [2, 0])])


@pytest.mark.parametrize("n_strain", [4, 6])
def test_what_is_normal_to_a_plane(n_strain):
    stress = RANDOM.standard_normal(n_strain)
    n = RANDOM.standard_normal(2 if n_strain == 4 else 3)
    padded = np.append(n, np.zeros(3 - len(n)))
    found = normal_coefficients(n, n_strain) @ stress
    assert found == pytest.approx(padded @ _full(stress) @ padded)


@pytest.mark.parametrize("n_strain", [4, 6])
def test_components_and_their_signs_across_the_axis(n_strain):
    """With x turned, components with one x change sign; normals turn with it."""
    signs = np.array([-1.0, 1.0] if n_strain == 4 else [-1.0, 1.0, 1.0])
    turn = np.diag(np.append(signs, np.ones(3 - len(signs))))
    stress = RANDOM.standard_normal(n_strain)
    seen = turn @ _full(stress) @ turn
    point = (1.0,) * len(signs)
    for name, (i, j) in list(PLACES.items())[:n_strain]:
        weights = component_weights(gauge("stress", "s", point, name), signs, n_strain)
        assert weights @ stress == pytest.approx(seen[i, j])
    n = RANDOM.standard_normal(len(signs))
    cell = replace(gauge("pressure-cell", "p", point), direction=tuple(n))
    padded = np.append(n, np.zeros(3 - len(n)))
    weights = component_weights(cell, signs, n_strain)
    assert weights @ stress == pytest.approx(padded @ seen @ padded)


def test_principal_values_by_name():
    """The most compressive first; of the section and of the whole."""
    turn, _ = np.linalg.qr(RANDOM.standard_normal((3, 3)))
    tensor = turn @ np.diag([-5.0, 2.0, -1.0]) @ turn.T
    stress = np.array([tensor[i, j] for i, j in PLACES.values()])[:, None]
    recovery = Recovery(np.array([0]), np.ones(1), None)
    flat = np.linalg.eigvalsh(tensor[:2, :2])
    exact = {"major": -5.0, "intermediate": -1.0, "minor": 2.0, "plane-major": flat[0],
             "plane-minor": flat[1]}  # fmt: skip
    assert set(exact) == set(PRINCIPAL)
    for name, value in exact.items():
        axes, rank = PRINCIPAL[name]
        for sign in (1.0, -1.0):
            reader = Reader(name, recovery, None, axes, rank, sign, False)
            assert reader.read(stress)[0] == pytest.approx(sign * value)
            assert not reader.coincides(stress)
    even = np.array([-2.0, -2.0, 3.0, 0.0])[:, None]
    for name, same in (("major", True), ("intermediate", True), ("minor", False),
                       ("plane-major", True), ("plane-minor", True)):  # fmt: skip
        axes, rank = PRINCIPAL[name]
        assert Reader(name, recovery, None, axes, rank, 1.0, False).coincides(even) is same
    assert not Reader("xx", recovery, np.ones(4), (), 0, 1.0, False).coincides(even)


def test_principal_values_are_differentiated_as_they_are():
    tensor = RANDOM.standard_normal((3, 3, 3))
    tensor = tensor + tensor.swapaxes(0, 1)
    found, equal = principal_values(tensor)
    assert found.shape == (3, 3)
    assert not equal.any()
    np.testing.assert_allclose(found[:, 0], np.linalg.eigvalsh(tensor[..., 0]))
    for h in (1, 2):
        ahead = np.linalg.eigvalsh(tensor[..., 0] + 1e-6 * tensor[..., h])
        behind = np.linalg.eigvalsh(tensor[..., 0] - 1e-6 * tensor[..., h])
        np.testing.assert_allclose(found[:, h], (ahead - behind) / 2e-6, rtol=1e-6)


def test_equal_principal_values_part_as_a_parameter_grows():
    turn, _ = np.linalg.qr(RANDOM.standard_normal((3, 3)))
    slope = RANDOM.standard_normal((3, 3))
    slope = slope + slope.T
    for values in ([-4.0, -4.0, 1.0], [-4.0, 1.0, 1.0], [2.0, 2.0, 2.0]):
        tensor = np.stack([turn @ np.diag(values) @ turn.T, slope], axis=-1)
        found, equal = principal_values(tensor)
        assert equal.tolist() == [values.count(v) > 1 for v in values]
        grown = np.linalg.eigvalsh(tensor[..., 0] + 1e-7 * slope)
        np.testing.assert_allclose(found[:, 1], (grown - values) / 1e-7, atol=1e-5)


@pytest.mark.parametrize(("apart", "same"), [(0.9e-9, True), (1.1e-9, False)])
def test_when_principal_values_count_as_one(apart, same):
    """By their difference against the largest of them."""
    for values in ([-5.0, 1.0, 1.0 + 5.0 * apart], [1.0, 1.0 + 5.0 * apart, 5.0]):
        _, equal = principal_values(np.diag(values)[:, :, None])
        assert equal.any() == same


def _readings():
    """Two components, and a principal value, at sums of the stresses of seven points."""
    places = [
        Recovery(np.array([4, 1]), np.array([0.75, 0.25]), None),
        Recovery(np.array([6]), np.array([1.0]), None),
        Recovery(np.array([0, 2, 5]), np.array([0.5, 0.2, 0.3]), None),
    ]
    readers = [
        Reader("cell", places[0], np.array([1.0, 2.0, 0.0, -3.0]), (), 0, -1.0, True),
        Reader("major", places[1], None, (0, 1, 2), 0, 1.0, False),
        Reader("yy", places[2], np.array([0.0, 1.0, 0.0, 0.0]), (), 0, 1.0, False),
    ]
    return readers, places


class _Water:
    """A pressure of 3, 5 and 7 with one derivative."""

    def at(self, state, point):
        return np.array([[3.0, 0.5], [5.0, 0.25], [7.0, 0.125]]) * (1 + state)


def test_stresses_are_read_with_the_water_or_without():
    """With one derivative of the water, and one more column of a unit force."""
    readers, places = _readings()
    stress = RANDOM.standard_normal((4, 7, 3))
    state = AnalysisState(SimpleNamespace(stress=stress, state=1), None, None)
    found = StressReadings(readers, _Water()).values(state)
    at = [np.tensordot(place.weights, stress[:, place.points], axes=([0], [1])) for place in places]
    whole = at[0].copy()
    whole[:3] -= np.array([6.0, 1.0, 0.0])
    np.testing.assert_allclose(found[0], -np.array([1.0, 2.0, 0.0, -3.0]) @ whole)
    np.testing.assert_allclose(found[2], at[2][1])
    values, _ = principal_values(_full(at[1]))
    np.testing.assert_allclose(found[1], values[0])
    assert StressReadings(readers, _Water()).coinciding(state) == ()
    even = np.zeros((4, 7, 3))
    even[:3, :, 0] = -1.0
    same = AnalysisState(SimpleNamespace(stress=even, state=1), None, None)
    assert StressReadings(readers, _Water()).coinciding(same) == ("major",)


def test_components_are_rows_of_the_stresses_at_points():
    readers, _ = _readings()
    readings = StressReadings(readers, _Water())
    stress = RANDOM.standard_normal((4, 7, 1))
    state = AnalysisState(SimpleNamespace(stress=stress, state=0), None, None)
    assert readings.linear(state, np.array([True, True, True])) is None
    rows = readings.linear(state, np.array([True, False, True]))
    assert rows.u is None
    assert rows.members is None
    assert rows.stress.shape == (3, 28)
    found = rows.stress @ stress.ravel()
    dry = [replace(reader, total=False) for reader in readers]
    exact = StressReadings(dry, _Water()).values(state)[:, 0]
    np.testing.assert_allclose(found[[0, 2]], exact[[0, 2]])
    assert found[1] == 0.0
    none = readings.linear(state, np.zeros(3, dtype=bool))
    assert none.stress.shape == (3, 28)
    assert none.stress.nnz == 0


def test_pressures_of_water_know_nothing_of_the_state():
    pressures = PorePressures(_Water())
    state = AnalysisState(SimpleNamespace(u=np.zeros((9, 4)), state=1), None, None)
    exact = [[6.0, 1.0, 0, 0], [10.0, 0.5, 0, 0], [14.0, 0.25, 0, 0]]
    np.testing.assert_array_equal(pressures.values(state), exact)
    rows = pressures.linear(state, np.ones(3, dtype=bool))
    assert (rows.u, rows.stress, rows.members) == (None, None, None)
    assert pressures.coinciding(state) == ()
