"""Moduli and strengths that grow: what a case says of them, and what is wrong with it."""

from __future__ import annotations

import pytest
from support.trench import CASE, write_case

from geoident.errors import InputError
from geoident.io.case.file import read_case
from geoident.model.ground import Isotropic, WithDepth, WithStress
from geoident.model.parameter import Scalar

ROCK = "E: $E, nu: 0.25}"
DEPTH = "{at: $E, gradient: 0.5 MPa/m, surface: 4 m}"
STRESS = "{reference: $E, exponent: 0.5, pressure: 100 kPa}"


def read(folder, modulus, nu="nu: 0.25"):
    path = write_case(folder)
    path.write_text(CASE.replace(ROCK, f"E: {modulus}, {nu}}}"))
    return read_case(str(path)).case


def faults(folder, modulus, nu="nu: 0.25"):
    with pytest.raises(InputError) as caught:
        read(folder, modulus, nu)
    assert all(fault.location.line == 9 for fault in caught.value.faults), caught.value
    return "; ".join(
        f"{fault.path}: {fault.message}. {fault.hint}" for fault in caught.value.faults
    )


def test_growth_with_depth(tmp_path):
    rock = read(tmp_path, DEPTH).materials["rock"]
    assert rock.elastic == Isotropic(E=Scalar(1.0, "E"), nu=Scalar(0.25))
    (found,) = rock.growths
    assert (found.name, found.base, found.unit) == ("rock.E", Scalar(1.0, "E"), "")
    assert found.law == WithDepth(Scalar(0.5e6), Scalar(4.0))
    (found,) = read(tmp_path, DEPTH.replace("4 m", "hills")).growths
    assert found.law == WithDepth(Scalar(0.5e6), "hills")


def test_growth_with_stress(tmp_path):
    (found,) = read(tmp_path, STRESS).growths
    assert found.law == WithStress(Scalar(0.5), Scalar(1e5), Scalar(1e3))
    (found,) = read(tmp_path, STRESS.replace("kPa}", "kPa, least: 5 kPa}")).growths
    assert found.law == WithStress(Scalar(0.5), Scalar(1e5), Scalar(5e3))


def test_every_number_may_be_a_parameter(tmp_path):
    """What only the growth depends on is used, and its dimension is asked."""
    (found,) = read(tmp_path, STRESS.replace("0.5", "$K0")).growths
    assert found.law == WithStress(Scalar(1.0, "K0"), Scalar(1e5), Scalar(1e3))
    said = faults(tmp_path, DEPTH.replace("0.5 MPa/m", "$E"))
    assert "materials.rock.E.gradient: '$E' is a pressure (start: 2 GPa)" in said
    assert "materials.rock.E.exponent: " in faults(tmp_path, STRESS.replace("0.5", "$m"))


@pytest.mark.parametrize(
    ("modulus", "said"),
    [
        ("{at: $E, gradient: 0.5 MPa/m}", "'surface' is missing"),
        ("{at: $E, surface: 4 m}", "'gradient' is missing"),
        ("{gradient: 1 MPa/m, surface: 4 m}", "'at' is missing"),
        (DEPTH.replace("0.5 MPa/m", "0.5 MPa"), "E.gradient: '0.5 MPa' is a pressure"),
        (DEPTH.replace("4 m", "4 kPa"), "E.surface: '4 kPa' is a pressure"),
        (DEPTH.replace("gradient", "gradiant"), "gradient"),
        ("{reference: $E, exponent: 0.5}", "'pressure' is missing"),
        ("{reference: $E, pressure: 1 kPa}", "'exponent' is missing"),
        ("{exponent: 0.5, pressure: 1 kPa}", "'reference' is missing"),
        (STRESS.replace("100 kPa", "0 kPa"), "E.pressure: '0 kPa': it must be positive"),
        (STRESS.replace("100 kPa", "-1 kPa"), "E.pressure: '-1 kPa': it must be positive"),
        (STRESS.replace("0.5", "0.5 m"), "E.exponent: '0.5 m' is a length"),
        ("{at: $E, gradient: 1 MPa/m, surface: 4 m, exponent: 1}", "exponent"),
    ],
)
def test_what_is_wrong_is_said_at_its_place(tmp_path, modulus, said):
    assert said in faults(tmp_path, modulus)


def test_a_ratio_does_not_grow(tmp_path):
    said = faults(tmp_path, "$E", "nu: {at: 0.2, gradient: 0.1 1/m, surface: 0 m}")
    assert "materials.rock.nu" in said


def read_yield(folder, surface):
    path = write_case(folder)
    path.write_text(CASE.replace(ROCK, f"E: $E, nu: 0.25, yield: {surface}}}"))
    return read_case(str(path)).case.materials["rock"]


@pytest.mark.parametrize("key", ["strength", "cohesion"])
def test_undrained_strength_grows(tmp_path, key):
    """From zero at the surface, in a list of surfaces as well as alone."""
    surface = f"{{type: tresca, {key}: {{at: 0 kPa, gradient: 11 kPa/m, surface: 4 m}}}}"
    for given in (surface, f"[{surface}]"):
        (found,) = read_yield(tmp_path, given).growths
        assert (found.name, found.surface) == ("rock.cohesion", 0)
        assert found.law == WithDepth(Scalar(11e3), Scalar(4.0))
        assert found.words == f"{key} of rock grows with depth"


def test_cohesion_and_tension_grow_apart(tmp_path):
    surface = "{type: mohr-coulomb, cohesion: C, friction: 20 deg, tension: T}"
    surface = surface.replace("C", "{reference: 20 kPa, exponent: 0.5, pressure: 100 kPa}")
    surface = surface.replace(" T}", " {at: 1 kPa, gradient: 2 kPa/m, surface: hills}}")
    growths = read_yield(tmp_path, surface).growths
    assert [growth.constant for growth in growths] == ["tension", "cohesion"]


@pytest.mark.parametrize(
    ("surface", "said"),
    [
        (
            "{type: tresca, strength: {at: 1 kPa, gradient: 11 kPa, surface: 4 m}}",
            "materials.rock.yield.strength.gradient: '11 kPa' is a pressure",
        ),
        (
            "{type: mohr-coulomb, cohesion: 1 kPa, friction: "
            "{at: 30 deg, gradient: 1 deg/m, surface: 4 m}}",
            "an angle does not grow",
        ),
    ],
)
def test_what_is_wrong_of_strengths_is_said(tmp_path, surface, said):
    with pytest.raises(InputError) as caught:
        read_yield(tmp_path, surface)
    assert said in str(caught.value)
