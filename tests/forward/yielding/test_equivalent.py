"""Hoek-Brown as Mohr-Coulomb: exact where it is a line, areas in balance, and what `check` says."""

from __future__ import annotations

from dataclasses import replace
from math import cos, pi, radians, sin, sqrt

import numpy as np
import pytest
from support.yielding import Cavity, hoek

from geoident.fem.yielding.hoek_brown import HoekBrownConstants
from geoident.forward.yielding.hoek_brown import (
    RockMassStrength,
    equivalent_notes,
    hoek_brown_share,
)
from geoident.model.case import Material
from geoident.model.dual import Dual
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


MASSES = [(50 * MPa, 1.4, 0.002, 0.51), (7 * MPa, 0.6, 0.07, 0.63), (0.3 * MPa, 5.0, 0.9, 0.85)]


@pytest.mark.parametrize("numbers", MASSES)
def test_the_global_strength_is_that_of_the_line_up_to_a_quarter_of_the_strength(numbers):
    """Section 4 there: sigma_cm = 2 c cos phi / (1 - sin phi) for sigma3_max = sigci / 4."""
    mass = RockMassStrength(*numbers)
    c, phi = mass.coulomb(mass.sigci / 4)
    assert mass.whole == pytest.approx(2 * c * cos(phi) / (1 - sin(phi)), rel=1e-12)


def line_up_to(mass, most):
    """c, phi and sigma3_max as they are said, in MPa."""
    c, phi = mass.coulomb(most)
    size = f"c {c / MPa:.3g} MPa and phi {np.degrees(phi):.3g} deg"
    return f"{size} up to sigma3 = {most / MPa:.3g} MPa"


@pytest.mark.parametrize("shears", [1, 3])
def test_the_whole_sentence_in_a_stress_whose_axes_are_turned(shears):
    """In a section with xy, in a solid with all shears: principal stresses of a tensor."""
    surface = hoek(30 * MPa, mb=0.9, s=8e-3, a=0.55, psi=radians(5))
    ground = Material("gneiss", Isotropic(E=Scalar(1e9), nu=Scalar(0.2)), yields=(surface,))
    xy, yz, xz = 1.5 * MPa, -0.7 * MPa * (shears > 1), 0.4 * MPa * (shears > 1)
    tensor = np.array([[-6 * MPa, xy, xz], [xy, -8 * MPa, yz], [xz, yz, -7 * MPa]])
    stress = tensor[[0, 1, 2, 0, 1, 0], [0, 1, 2, 1, 2, 2]][: 3 + shears, None]
    low, _, high = np.linalg.eigvalsh(-tensor)
    mass = RockMassStrength(30 * MPa, 0.9, 8e-3, 0.55)
    deep = mass.around_tunnel(high)
    assert equivalent_notes(ground, np.hstack([0.3 * stress, stress]), {}) == (
        "'gneiss' has mb 0.9, s 0.008 and a 0.55 at the start values; as Mohr-Coulomb that is "
        f"{line_up_to(mass, deep)} around a deep tunnel in the largest in-situ stress of "
        f"{high / MPa:.3g} MPa, {line_up_to(mass, low)} that there is in situ (Hoek et al. 2002); "
        "what is computed is the curve itself",
    )


def test_stresses_below_a_thousandth_of_the_strength_are_none():
    """Of the largest stress and of the smallest, each on both sides."""
    surface = hoek(20 * MPa, mb=0.9, s=8e-3, a=0.55, psi=0.0)
    ground = Material("rock", Isotropic(E=Scalar(1e9), nu=Scalar(0.2)), yields=(surface,))
    for major, minor, parts in (
        (0.0, 0.0, ["there is no in-situ stress to fit c and phi to"]),
        (19e3, 19e3, ["there is no in-situ stress to fit c and phi to"]),
        (21e3, 19e3, ["around a deep tunnel in the largest in-situ stress of 21 kPa (Hoek"]),
        (9e4, 21e3, ["stress of 90 kPa, c ", "up to sigma3 = 21 kPa that there is in situ (Hoek"]),
        (101e3, 99.7e3, ["of 0.101 MPa, c ", "sigma3 = 99.7 kPa that there is in situ"]),
    ):
        stress = -np.array([[0.5 * (major + minor)], [minor], [major], [0.0]])
        (said,) = equivalent_notes(ground, stress, {})
        assert all(part in said for part in parts), said


def test_of_other_surfaces_nothing_is_said():
    plain = Material("rock", Isotropic(E=Scalar(1e9), nu=Scalar(0.2)))
    assert equivalent_notes(plain, -np.ones((4, 1)), {}) == ()
    surface = hoek(30 * MPa, mb=0.9, s=8e-3, a=0.55, psi=0.0)
    assert equivalent_notes(replace(plain, yields=(surface,)), np.empty((4, 0)), {}) == ()


def constants(sigci, mb, s, a, tension=None):
    numbers = [Dual(np.array([x])) for x in (sigci, mb, s, a)]
    cut = None if tension is None else Dual(np.array([tension]))
    return HoekBrownConstants(*numbers, None, cut)


MEAN = np.array([-9.0, -2.0, -0.5, 0.05, -30.0]) * MPa
DEVIATOR = np.array([[1.0, 0.2, -1.2], [2.0, 0.0, -2.0], [0.4, 0.4, -0.8], [0.7, -0.3, -0.4],
                     [50.0, -10.0, -40.0]]) * MPa  # fmt: skip


def test_a_share_by_hand_on_a_straight_surface():
    """a = 1: t (s1 - s3) = s sigci - mb (mean + t s1), with deviators s."""
    found = hoek_brown_share(constants(20 * MPa, 2.0, 0.1, 1.0), MEAN, DEVIATOR)
    first, apart = DEVIATOR[:, 0], DEVIATOR[:, 0] - DEVIATOR[:, 2]
    np.testing.assert_allclose(found, (apart + 2.0 * first) / (2 * MPa - 2.0 * MEAN), rtol=1e-12)


def test_a_share_meets_the_cut_off_where_that_is_nearer():
    """Mean and t s1 come to 0.3 MPa before the curve is reached; steeper deviators reach that."""
    flat = np.array([[0.2, 0.1, -0.3], [0.2, 0.0, -0.2], [30.0, 0.0, -30.0]]) * MPa
    mean = np.array([0.1, -0.4, -30.0]) * MPa
    found = hoek_brown_share(constants(20 * MPa, 2.0, 0.1, 1.0, tension=0.3 * MPa), mean, flat)
    assert found[:2] == pytest.approx([0.2 / 0.2, 0.2 / 0.7])
    assert found[2] == pytest.approx(120.0 / 62.0)


def test_a_share_of_nothing_and_beyond_the_tip():
    """Without a deviator nothing is reached; with the mean beyond the cut-off all is."""
    surface = constants(20 * MPa, 2.0, 0.1, 0.6)  # the tip is at 1 MPa
    mean = np.array([-1.0, 0.999, 1.0, 5.0, -1.0, -1.0]) * MPa
    deviator = np.zeros((6, 3))
    deviator[4] = np.array([0.45e-6, 0.0, -0.45e-6])  # below and above 1e-12 of the mean
    deviator[5] = np.array([0.55e-6, 0.0, -0.55e-6])
    deviator[2] = np.array([1.0, 0.0, -1.0]) * MPa
    found = hoek_brown_share(surface, mean, deviator)
    assert found[[0, 1, 4]].tolist() == [0.0, 0.0, 0.0]
    assert np.isinf(found[[2, 3]]).all()
    exact = 20 * MPa * (0.1 + 2.0 / 20) ** 0.6
    assert found[5] == pytest.approx(1.1e-6 / exact, rel=1e-9)


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
