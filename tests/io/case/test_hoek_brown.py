"""Hoek and Brown's criterion and Hoek and Diederichs' modulus, as case files say them."""

from __future__ import annotations

from math import radians

import pytest
from support.trench import CASE, write_case

from geoident.errors import InputError
from geoident.io.case.file import read_case
from geoident.model.empirical.rock_mass import RockMassModulus
from geoident.model.ground import Isotropic
from geoident.model.parameter import Scalar
from geoident.model.yielding import HoekBrown

ROCK = "E: $E, nu: 0.25}"
BY_GSI = "{type: hoek-brown, sigci: 50 MPa, mi: 10, GSI: $K0, D: 0.5, dilation: 0 deg}"
BY_CONSTANTS = "{type: hoek-brown, sigci: $E, mb: 1.2, s: 4e-3, a: 0.51, flow: associated}"


def read(folder, modulus="$E", yields=""):
    path = write_case(folder)
    said = f"E: {modulus}, nu: 0.25" + (f", yield: {yields}" if yields else "")
    path.write_text(CASE.replace(ROCK, said + "}"))
    return read_case(str(path)).case


def rock(folder, **given):
    return read(folder, **given).materials["rock"]


def faults(folder, **given):
    with pytest.raises(InputError) as caught:
        read(folder, **given)
    assert all(fault.location.line == 9 for fault in caught.value.faults), caught.value
    return "; ".join(
        f"{fault.path}: {fault.message}. {fault.hint}" for fault in caught.value.faults
    )


def test_strength_by_intact_rock_and_gsi(tmp_path):
    (found,) = rock(tmp_path, yields=BY_GSI).yields
    assert found == HoekBrown(
        Scalar(50e6), Scalar(10.0), Scalar(1.0, "K0"), Scalar(0.5), dilation=Scalar(0.0)
    )
    (found,) = rock(tmp_path, yields=BY_GSI.replace(" D: 0.5,", "")).yields
    assert found.D is None


def test_strength_by_constants_of_the_rock_mass(tmp_path):
    (found,) = rock(tmp_path, yields=BY_CONSTANTS).yields
    assert found == HoekBrown(
        Scalar(1.0, "E"), mb=Scalar(1.2), s=Scalar(4e-3), a=Scalar(0.51), dilation=None
    )
    given = BY_CONSTANTS.replace("flow: associated", "dilation: 5 deg, tension: 10 kPa")
    (found,) = rock(tmp_path, yields=given).yields
    assert (found.dilation, found.tension) == (Scalar(radians(5)), Scalar(1e4))


def test_no_flow_of_its_own_is_flow_without_change_of_volume(tmp_path):
    without = rock(tmp_path, yields=BY_GSI.replace("dilation: 0 deg", "flow: none"))
    assert without == rock(tmp_path, yields=BY_GSI)


def test_intact_strength_may_be_a_field(tmp_path):
    given = BY_GSI.replace("50 MPa", "{field: {mean: 50 MPa, sd: 20 %, length: 5 m}}")
    (field,) = rock(tmp_path, yields=given).fields
    assert (field.constant, field.surface, field.mean) == ("sigci", 0, Scalar(50e6))


@pytest.mark.parametrize(
    ("modulus", "expected"),
    [
        ("{Ei: $E, GSI: 45, D: 0.2}", {"Ei": Scalar(1.0, "E"), "D": Scalar(0.2)}),
        ("{MR: 400, sigci: 50 MPa, GSI: 45}", {"MR": Scalar(400.0), "sigci": Scalar(50e6)}),
        ("{GSI: 45}", {}),
    ],
)
def test_modulus_of_a_rock_mass(tmp_path, modulus, expected):
    # What only the modulus depends on is used: E and K0 are parameters of the case.
    yields = "" if "$E" in modulus else BY_CONSTANTS
    found = rock(tmp_path, modulus=f"{{hoek-diederichs: {modulus}}}", yields=yields)
    modulus = RockMassModulus(GSI=Scalar(45.0), **expected)
    assert found.elastic == Isotropic(E=modulus, nu=Scalar(0.25))


@pytest.mark.parametrize(
    ("yields", "said"),
    [
        (BY_GSI.replace("GSI: $K0", "GSI: 120"), "yield.GSI: '120': it must be from 0 to 100"),
        (BY_GSI.replace("GSI: $K0", "GSI: 30 MPa"), "yield.GSI: '30 MPa' is a pressure"),
        (BY_GSI.replace("D: 0.5", "D: 50"), "yield.D: '50': it must be from 0 to 1"),
        (BY_GSI.replace("mi: 10", "mi: -1"), "yield.mi: '-1': it must be positive"),
        (BY_GSI.replace("50 MPa", "-50 MPa"), "yield.sigci: '-50 MPa': it must be positive"),
        (BY_GSI.replace("mi: 10, ", ""), "found GSI and D; expected mi and GSI (with D), or"),
        (BY_GSI.replace("mi: 10", "mb: 2"), "Give all constants of one set."),
        (BY_GSI.replace(", dilation: 0 deg", ""), "expected dilation, or flow"),
        (BY_GSI.replace("0 deg", "0 deg, flow: associated"), "found dilation and flow"),
        (BY_GSI.replace("0 deg", "90 deg"), "yield.dilation: '90 deg': it must be from 0 to below"),
        (BY_CONSTANTS.replace("s: 4e-3", "s: 4"), "yield.s: '4': it must be from 0 to 1"),
        (BY_CONSTANTS.replace("a: 0.51", "a: 1"), "yield.a: '1': it must be from 0.2 to 0.9"),
        (BY_CONSTANTS.replace("mb: 1.2", "mb: 0"), "yield.mb: '0': it must be positive"),
        (BY_CONSTANTS[:-1] + ", tension: -1 kPa}", "yield.tension: '-1 kPa': it must not be"),
        (f"[{BY_CONSTANTS}, {BY_GSI}]", "an exact surface cannot be combined with another one"),
        (BY_CONSTANTS.replace("flow: associated", "flow: constant"), "yield.flow"),
        (BY_GSI.replace("sigci", "UCS"), "the key 'UCS' is not known here. Did you mean 'sigci'?"),
        (BY_GSI.replace("dilation", "psi"), "'psi' is not known here. Did you mean 'dilation'?"),
    ],
)
def test_what_is_wrong_with_a_strength_is_said_at_its_place(tmp_path, yields, said):
    found = faults(tmp_path, yields=yields)
    assert said in found


def test_symbols_of_strengths_are_told_the_keys_that_are_meant(tmp_path):
    symbols = "c: 1 MPa, phi: 30 deg, psi: 0 deg"
    found = faults(tmp_path, yields=f"{{type: mohr-coulomb, {symbols}}}")
    for symbol, meant in (("c", "cohesion"), ("phi", "friction"), ("psi", "dilation")):
        said = f"materials.rock.yield.{symbol}: the key '{symbol}' is not known here."
        assert f"{said} Did you mean '{meant}'?" in found
    found = faults(tmp_path, yields=f"{{{symbols}}}")
    assert "'type' is missing. Say which yield surface: 'type: mohr-coulomb' with cohes" in found


@pytest.mark.parametrize(
    ("modulus", "said"),
    [
        ("{Ei: $E, GSI: 101}", "E.hoek-diederichs.GSI: '101': it must be from 0 to 100"),
        ("{Ei: $E, GSI: 45, D: 2}", "E.hoek-diederichs.D: '2': it must be from 0 to 1"),
        ("{Ei: $E}", "'GSI' is missing"),
        ("{Ei: $E, MR: 400, sigci: 1 MPa, GSI: 45}", "Ei, or MR and sigci, or none of them"),
        ("{MR: 400, GSI: 45}", "found MR; expected Ei, or MR and sigci, or none of them"),
        ("{Ei: 20, GSI: $K0}", "E.hoek-diederichs.Ei: "),
        ("{Ei: $E, GSI: $nothing}", "E.hoek-diederichs.GSI: "),
        ("{Ei: $E, GSI: $E}", "E.hoek-diederichs.GSI: '$E' is a pressure"),
    ],
)
def test_what_is_wrong_with_a_modulus_is_said_at_its_place(tmp_path, modulus, said):
    assert said in faults(tmp_path, modulus=f"{{hoek-diederichs: {modulus}}}")


def test_gsi_out_of_range_at_its_start(tmp_path):
    found = faults(tmp_path, yields=BY_GSI.replace("$K0", "300 $K0"))
    assert "yield.GSI: '300 $K0' is " in found
    assert "Change the start of K0." in found
    found = faults(tmp_path, modulus="{hoek-diederichs: {Ei: $E, GSI: 300 $K0}}")
    assert "E.hoek-diederichs.GSI: '300 $K0' is " in found
