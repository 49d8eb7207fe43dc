"""Quantities as rock engineers write them."""

import math
import re

import pytest

from geoident.io.schema.values import QuantityType
from geoident.io.text.wording import Refusal
from geoident.units import (
    DIMENSIONS,
    UNITS,
    UnitError,
    in_unit,
    read_quantity,
    require_dimension,
    units_of,
)


@pytest.mark.parametrize(
    ("text", "dimension", "value"),
    [
        ("1e9 Pa", "pressure", 1e9),
        ("12GPa", "pressure", 12e9),
        ("12 GPa", "pressure", 12e9),
        ("12\u00a0GPa", "pressure", 12e9),
        ("-3.5e-3 m", "length", -3.5e-3),
        (" .5 mm ", "length", 5e-4),
        ("2. cm", "length", 0.02),
        ("+7 µm", "length", 7e-6),
        ("7 μm", "length", 7e-6),
        ("30 N/mm²", "pressure", 30e6),
        ("2 MN/m^2", "pressure", 2e6),
        ("1 bar", "pressure", 1e5),
        ("1000 psi", "pressure", 6894757.293168361),
        ("1 ksi", "pressure", 6894757.293168361),
        ("2.65 t/m3", "density", 2650.0),
        ("2.65 g / cm3", "density", 2650.0),
        ("27 kN/m³", "unit weight", 27e3),
        ("0.027 MPa/m", "unit weight", 27e3),
        ("180 deg", "angle", math.pi),
        ("180°", "angle", math.pi),
        ("9.81 m/s2", "acceleration", 9.81),
        ("9.81 m / s2", "acceleration", 9.81),
        ("1 m H2O", "pressure", 9806.65),
        ("1e-5 1/K", "expansion", 1e-5),
        ("-4 degC", "temperature", -4.0),
        ("3 MN", "force", 3e6),
        ("1 ft", "length", 0.3048),
        ("1 in", "length", 0.0254),
        ("0.3", "dimensionless", 0.3),
        ("30 %", "dimensionless", 0.3),
        ("30%", "dimensionless", 0.3),
    ],
)
def test_quantities_become_si(text, dimension, value):
    quantity = require_dimension(read_quantity(text), dimension, text)
    assert quantity.value == pytest.approx(value, rel=1e-14)


@pytest.mark.parametrize(
    ("text", "dimension", "message", "hint"),
    [
        ("12", "pressure", "'12' has no unit; expected a pressure", "'12 MPa' or"),
        ("0", "length", "has no unit; expected a length", "Write '0 mm' or '0 m'"),
        ("12 m", "pressure", "'12 m' is a length; expected a pressure", "MPa"),
        ("12 kN/m3", "density", "is a unit weight; expected a density", "kg/m3"),
        ("12 m", "dimensionless", "expected a number without unit", "Remove the unit"),
        ("12 mpa", "pressure", "there is no unit 'mpa'", "Did you mean 'MPa'?"),
        ("12 furlong", "length", "there is no unit 'furlong'", ""),
        ("1,5 mm", "length", "has a comma", "Write '1.5 mm'"),
        ("1,000 m", "length", "has a comma", "'1000 m' without separators"),
        ("1.000,5 m", "length", "has a comma", "Write '1000.5 m' with"),
        ("nan m", "length", "not a finite number", ""),
        (".inf", "length", "not a finite number", ""),
        ("-Infinity m", "length", "not a finite number", ""),
        ("1e999 m", "length", "too large", ""),
        ("", "length", "nothing is written", ""),
        ("m", "length", "not a number with a unit", "12.5 MPa"),
        ("9**9**9 m", "length", "there is no unit", ""),
        ("1_000 m", "length", "not a number", ""),
        ("0x10 m", "length", "there is no unit", ""),
        ("1 2 m", "length", "there is no unit", ""),
        ("--1 m", "length", "not a number", ""),
        ("20 Grad", "angle", "there is no unit 'Grad'", "'deg' for degrees"),
        ("20 grad", "", "there is no unit 'grad'", "'gon' for gons"),
        ("2 m m", "length", "there is no unit 'm m'", "Did you mean 'mm'?"),
        ("2 d m", "length", "there is no unit 'd m'", "Did you mean 'dm'?"),
    ],
)
def test_what_is_no_quantity_is_refused_with_a_remedy(text, dimension, message, hint):
    with pytest.raises(UnitError) as caught:
        require_dimension(read_quantity(text), dimension, text)
    assert message in caught.value.message
    assert hint in caught.value.hint


def test_every_unit_goes_to_si_and_back():
    for unit, (dimension, factor) in UNITS.items():
        quantity = read_quantity(f"2.5 {unit}")
        assert (quantity.dimension, quantity.unit) == (dimension, unit)
        assert quantity.value == 2.5 * factor
        assert in_unit(quantity.value, unit, dimension) == pytest.approx(2.5, rel=1e-15)


def test_every_dimension_has_its_si_unit():
    for dimension, unit in DIMENSIONS.items():
        assert unit in units_of(dimension)
        assert UNITS[unit] == (dimension, 1.0)


def test_no_unit_is_another_with_other_letters_in_one_dimension():
    spellings = [re.sub(r"[^a-z0-9/%]", "", unit.lower()) for unit in units_of("pressure")]
    assert len(spellings) == len(set(spellings)), "a hint could name the wrong unit"


@pytest.mark.parametrize("text", ["1" * 10**6, "1" + " " * 10**6 + "m", "1e" * 10**5])
def test_long_texts_are_refused(text):
    """Steps that grow with the square of their length would take hours."""
    with pytest.raises(UnitError):
        read_quantity(text)


@pytest.mark.parametrize(
    ("text", "dimension", "value"),
    [
        ("1 ksf", "pressure", 47880.25898033584),
        ("1 tsf", "pressure", 95760.51796067168),
        ("1 lb/ft2", "pressure", 47.88025898033584),
        ("1 kpsi", "pressure", 6894757.293168361),
        ("2.5 Mpsi", "pressure", 17236893232.9209),
        ("1 psf", "pressure", 47.88025898033584),
        ("1 kgf/cm2", "pressure", 98066.5),
        ("10 mH2O", "pressure", 98066.5),
        ("1 bar", "pressure", 1e5),
        ("1 GN", "force", 1e9),
        ("1 kip", "force", 4448.2216152605),
        ("1 tf", "force", 9806.65),
        ("1 kip/ft", "line load", 14593.902937206365),
        ("1 kip-ft", "moment", 1355.8179483314004),
        ("1 kip·ft", "moment", 1355.8179483314004),
        ("250 kN·m", "moment", 250e3),
        ("250 kN m/m", "moment per length", 250e3),
        ("1 kip-in/ft", "moment per length", 4448.2216152605 / 12),
        ("1 mrad", "angle", 1e-3),
        ("3600 arcsec", "angle", math.pi / 180),
        ("400 gon", "angle", 2 * math.pi),
        ("2 mm/m", "angle", 2e-3),
        ("2 mm/m", "strain", 2e-3),
        ("120 microstrain", "strain", 120e-6),
        ("120 µε", "strain", 120e-6),
        ("120 1e-6", "strain", 120e-6),
        ("120 ·10^-6", "strain", 120e-6),
        ("120e-6 m/m", "strain", 120e-6),
        ("0.1 %", "strain", 1e-3),
        ("120 pcf", "density", 1922.2156),
        ("120 pcf", "unit weight", 18850.496),
        ("62.4 lbf/ft3", "unit weight", 9802.2577),
        ("2800 Hz", "frequency", 2800.0),
        ("0.5 in/month", "velocity", 12 * 0.0127 / (365.25 * 86400)),
    ],
)
def test_units_of_other_countries_and_instruments(text, dimension, value):
    """Sizes: NIST Special Publication 811, appendix B.8; weights of a cubic foot by hand."""
    quantity = require_dimension(read_quantity(text), dimension, text)
    assert quantity.value == pytest.approx(value, rel=3e-8)
    assert quantity.dimension == dimension
    assert in_unit(quantity.value, quantity.unit, dimension) == pytest.approx(
        read_quantity(text).value / UNITS[quantity.unit][1], rel=1e-14
    )


@pytest.mark.parametrize(
    ("text", "dimension", "message", "hint"),
    [
        ("250", "strain", "'250' has no unit; expected a strain", "Write '250 microstrain', or"),
        ("30", "angle", "'30' has no unit; expected an angle", "Write '30 deg', or"),
        ("3 kg/cm2", "pressure", "there is no unit 'kg/cm2'", "Did you mean 'kgf/cm2'?"),
        ("3 kips", "force", "there is no unit 'kips'", "Did you mean 'kip'?"),
        ("3 KSF", "pressure", "there is no unit 'KSF'", "Did you mean 'ksf'?"),
        ("3 inches", "length", "there is no unit 'inches'", "Did you mean 'in'?"),
        ("3 kNm/m", "moment", "is a moment per length; expected a moment", "kip-ft"),
        ("2800 Hz", "strain", "'2800 Hz' is a frequency; expected a strain", "microstrain"),
        ("2 mm/m", "length", "'2 mm/m' is an angle; expected a length", "mm"),
    ],
)
def test_what_other_units_are_not(text, dimension, message, hint):
    with pytest.raises(UnitError) as caught:
        require_dimension(read_quantity(text), dimension, text)
    assert message in caught.value.message
    assert hint in caught.value.hint


def test_a_number_beyond_an_upper_limit_alone_is_refused():
    with pytest.raises(Refusal) as caught:
        QuantityType("length", below=2.0).parse("3 m")
    assert caught.value.message == "'3 m': it must be less than 2"
