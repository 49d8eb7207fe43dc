"""Hoek-Brown as Mohr-Coulomb: exact where it is a line, areas in balance, and what `check` says."""

from __future__ import annotations

from math import cos, pi, radians, sin, sqrt

import numpy as np
import pytest
from support.yielding import Cavity, hoek

from geoident.forward.yielding.equivalent import RockMassStrength, equivalent_notes
from geoident.model.case import Material
from geoident.model.ground import Isotropic
from geoident.model.parameter import Scalar

MPa = 1e6


def test_a_straight_curve_is_its_line():
    """For a = 1 it is sigma_1 = (1 + mb) sigma_3 + s sigci."""
    mass = RockMassStrength(20 * MPa, 2.0, 0.1, 1.0)
    cohesion, friction = mass.coulomb(5 * MPa)
    assert sin(friction) == pytest.approx(2.0 / 4.0)
    assert cohesion == pytest.approx(0.1 * 20 * MPa / (2 * sqrt(3.0)))
    assert mass.whole == pytest.approx(0.1 * 20 * MPa)


@pytest.mark.parametrize("most", [0.5, 2.0, 8.0])
def test_areas_balance(most):
    mass = RockMassStrength.of(hoek(50 * MPa, mi=10, GSI=45, D=0), {})
    assert (mass.mb, mass.s, mass.a) == pytest.approx((1.403, 0.00222, 0.5081), rel=1e-3)
    cohesion, friction = mass.coulomb(most * MPa)
    minor = np.linspace(0.0, most * MPa, 2001)
    curve = minor + mass.sigci * (mass.mb * minor / mass.sigci + mass.s) ** mass.a
    line = (2 * cohesion * cos(friction) + (1 + sin(friction)) * minor) / (1 - sin(friction))
    assert np.trapezoid(line - curve, minor) / np.trapezoid(curve, minor) == pytest.approx(
        0.0, abs=0.02
    )
    assert np.any(line > curve)
    assert np.any(line < curve)


def test_confining_stress_of_a_deep_tunnel():
    mass = RockMassStrength(50 * MPa, 1.4, 0.002, 0.51)
    found = mass.around_tunnel(mass.whole)
    assert found == pytest.approx(0.47 * mass.whole)
    assert mass.around_tunnel(2 * mass.whole) == pytest.approx(found * 2**0.94)


def test_what_is_said():
    surface = hoek(30 * MPa, mi=10, GSI=40, D=0.2, psi=radians(5))
    ground = Material("rock", Isotropic(E=Scalar(1e9), nu=Scalar(0.2)), yields=(surface,))
    stress = -np.array([[6.0], [8.0], [7.0], [0.5]]) * MPa
    (said,) = equivalent_notes(ground, stress, {})
    for part in ("mb 0.925", "around a deep tunnel", "of 8.12 MPa", "sigma3 = 5.88 MPa", "2002"):
        assert part in said, said
    # the largest of both principal stresses, each where it is largest
    elsewhere = -np.array([[1.0], [3.0], [0.4], [0.0]]) * MPa
    both = equivalent_notes(ground, np.column_stack([elsewhere, stress, elsewhere]), {})
    assert both == (said,)
    (none,) = equivalent_notes(ground, 0.0 * stress, {})
    assert "no in-situ stress" in none
    assert equivalent_notes(ground, stress[:, :0], {}) == ()


def test_numbers_are_said_in_their_unit():
    """c of a straight curve, as in the first test, below and above 100 kPa."""
    for sigci, said in ((2 * MPa, "c 57.7 kPa"), (5 * MPa, "c 0.144 MPa")):
        surface = hoek(sigci, mb=2.0, s=0.1, a=1.0, psi=0.0)
        ground = Material("rock", Isotropic(E=Scalar(1e9), nu=Scalar(0.2)), yields=(surface,))
        (note,) = equivalent_notes(ground, -np.full((4, 1), 0.05 * MPa), {})
        assert f"{said} and phi 30 deg" in note, note


def test_check_says_it_of_a_mesh():
    cavity = Cavity(pressure=6 * MPa)
    surface = hoek(30 * MPa, mb=0.9, s=8e-4, a=0.51, psi=pi / 30)
    staged = cavity.staged(cavity.mesh("tri3", n=2, layers=6, reach=6.0), surface)
    assert any("as Mohr-Coulomb" in note for note in staged.virgin_notes())
