"""Moduli that grow with depth or stress: what a case says of them, and what is wrong with it."""

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
