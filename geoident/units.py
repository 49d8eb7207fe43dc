"""Quantities as rock engineers write them: a number and a unit, to SI and back.

A table in place of a units package: what is not in it is refused by name, and what has two
readings (``1,5 mm``) is never guessed.
"""

from __future__ import annotations

import difflib
import math
import re
from collections.abc import Mapping
from dataclasses import dataclass

DIMENSIONLESS = "dimensionless"

DIMENSIONS: Mapping[str, str] = {
    "pressure": "Pa",
    "length": "m",
    "density": "kg/m3",
    "unit weight": "N/m3",
    "acceleration": "m/s2",
    "velocity": "m/s",
    "diffusivity": "m2/s",
    "force": "N",
    "line load": "N/m",
    "area": "m2",
    "moment": "Nm",
    "moment per length": "Nm/m",
    "bending stiffness": "Nm2/m",
    "flexural rigidity": "Nm2",
    "angle": "rad",
    "temperature": "K",
    "expansion": "1/K",
    "conductivity": "W/mK",
    "heat capacity": "J/m3K",
    "specific heat": "J/kgK",
    "film coefficient": "W/m2K",
    "frequency": "Hz",
    "compressibility": "1/Pa",
    "time": "s",
    "viscosity": "Pa s",
    DIMENSIONLESS: "",
    "strain": "m/m",
    "pressure rate": "Pa/s",
    "force rate": "N/s",
    "line load rate": "N/m/s",
    "moment rate": "Nm/s",
    "moment per length rate": "Nm/m/s",
    "angle rate": "rad/s",
    "strain rate": "m/m/s",
    "temperature rate": "K/s",
    "frequency rate": "Hz/s",
    "number rate": "1/s",
}
"""Dimension to its SI unit."""

_DAY = 86400.0  # s
_YEAR = 365.25 * _DAY  # Julian; a month is its twelfth part
_FT = 0.3048  # m, international foot; an inch is its twelfth part
_LBF = 4.4482216152605  # N: 0.45359237 kg times 9.80665 m/s2
_KIP = 1e3 * _LBF
_KGF = 9.80665  # N
_PSI = 6894.757293168361  # Pa, 1 lbf/in2
_ARCSEC = math.pi / 648e3
_GON = math.pi / 200

_OF_DURATION = {"sec": 1.0, "s": 1.0, "min": 60.0, "m": 60.0, "h": 3600.0, "d": _DAY}
_PART_OF_DURATION = re.compile(r"\s*([0-9]+(?:\.[0-9]*)?)\s*(sec|s|min|m|h|d)\s*")
_OF_FLOW = {"s": 1.0, "h": 3600.0, "d": _DAY, "days": _DAY, "year": _YEAR, "years": _YEAR}
_TIMES = {"month": _YEAR / 12, "year": _YEAR, "day": _DAY, "week": 7 * _DAY, "s": 1.0}


def _rates(**units: float) -> dict[str, float]:
    """Units by time: each of some units by each time."""
    return {
        f"{unit}/{time}": size / s for time, s in _TIMES.items() for unit, size in units.items()
    }


_TABLE: Mapping[str, Mapping[str, float]] = {
    "pressure": {
        "Pa": 1.0,
        "kPa": 1e3,
        "MPa": 1e6,
        "GPa": 1e9,
        "bar": 1e5,
        "kbar": 1e8,
        "N/m2": 1.0,
        "kN/m2": 1e3,
        "MN/m2": 1e6,
        "N/mm2": 1e6,
        "kN/mm2": 1e9,
        "kgf/cm2": _KGF * 1e4,
        "psi": _PSI,
        "ksi": _PSI * 1e3,
        "psf": _LBF / _FT**2,
        "ksf": _KIP / _FT**2,
        "tsf": 2 * _KIP / _FT**2,  # short tons of 2000 lbf
        "kgf/m2": _KGF,
        "tf/m2": _KGF * 1e3,
        "hPa": 1e2,
        "mbar": 1e2,
        "atm": 101325.0,
        "N/cm2": 1e4,
        "kN/cm2": 1e7,
        "mH2O": _KGF * 1e3,  # conventional: 1000 kg/m3
        "ftH2O": _KGF * 1e3 * _FT,
        "Mpsi": _PSI * 1e6,
    },
    "length": {
        "m": 1.0,
        "km": 1e3,
        "dm": 0.1,
        "cm": 1e-2,
        "mm": 1e-3,
        "um": 1e-6,
        "in": _FT / 12,
        "ft": _FT,
        "mil": _FT / 12e3,
        "yd": 3 * _FT,
    },
    "density": {
        "kg/m3": 1.0,
        "t/m3": 1e3,
        "Mg/m3": 1e3,
        "g/cm3": 1e3,
        "lb/ft3": 16.018463373960142,
        "pcf": 16.018463373960142,
    },
    "unit weight": {
        "N/m3": 1.0,
        "kN/m3": 1e3,
        "MN/m3": 1e6,
        "kPa/m": 1e3,
        "MPa/m": 1e6,
        "GPa/m": 1e9,
        "kgf/m3": _KGF,
        "tf/m3": _KGF * 1e3,
        "lbf/ft3": _LBF / _FT**3,
        "kip/ft3": _KIP / _FT**3,
        "pcf": _LBF / _FT**3,
        "psf/ft": _LBF / _FT**3,
        "ksf/ft": _KIP / _FT**3,
        "psi/ft": _PSI / _FT,
    },
    "acceleration": {"m/s2": 1.0, "cm/s2": 1e-2, "ft/s2": _FT},
    "velocity": {
        "m/s": 1.0,
        "mm/h": 1e-3 / 3600,
        "mm/day": 1e-3 / _DAY,
        "mm/week": 1e-3 / (7 * _DAY),
        "mm/month": 12e-3 / _YEAR,
        "mm/year": 1e-3 / _YEAR,
        "cm/year": 1e-2 / _YEAR,
        "cm/s": 1e-2,
        "mm/s": 1e-3,
        "m/day": 1.0 / _DAY,
        "m/d": 1.0 / _DAY,
        "cm/day": 1e-2 / _DAY,
        "cm/d": 1e-2 / _DAY,
        "m/year": 1.0 / _YEAR,
        "ft/day": _FT / _DAY,
        "in/day": _FT / 12 / _DAY,
        "in/week": _FT / 12 / (7 * _DAY),
        "in/month": _FT / _YEAR,
        "in/year": _FT / 12 / _YEAR,
    },
    "diffusivity": {
        "m2/s": 1.0,
        "cm2/s": 1e-4,
        "mm2/s": 1e-6,
        "m2/day": 1.0 / _DAY,
        "m2/month": 12.0 / _YEAR,
        "m2/year": 1.0 / _YEAR,
        "ft2/day": _FT**2 / _DAY,
        "ft2/year": _FT**2 / _YEAR,
    },
    "force": {
        "N": 1.0,
        "kN": 1e3,
        "MN": 1e6,
        "GN": 1e9,
        "kgf": _KGF,
        "tf": _KGF * 1e3,
        "lbf": _LBF,
        "kip": _KIP,
    },
    "line load": {
        "N/m": 1.0,
        "kN/m": 1e3,
        "MN/m": 1e6,
        "GN/m": 1e9,
        "N/mm": 1e3,
        "kN/mm": 1e6,
        "kgf/m": _KGF,
        "tf/m": _KGF * 1e3,
        "lbf/ft": _LBF / _FT,
        "plf": _LBF / _FT,
        "kip/ft": _KIP / _FT,
        "klf": _KIP / _FT,
    },
    "moment": {
        "Nm": 1.0,
        "kNm": 1e3,
        "MNm": 1e6,
        "GNm": 1e9,
        "kgfm": _KGF,
        "tfm": _KGF * 1e3,
        "lbf-ft": _LBF * _FT,
        "lbf-in": _LBF * _FT / 12,
        "kip-ft": _KIP * _FT,
        "kip-in": _KIP * _FT / 12,
    },
    "moment per length": {
        "Nm/m": 1.0,
        "kNm/m": 1e3,
        "MNm/m": 1e6,
        "GNm/m": 1e9,
        "kgfm/m": _KGF,
        "tfm/m": _KGF * 1e3,
        "lbf-ft/ft": _LBF,
        "kip-ft/ft": _KIP,
        "kip-in/ft": _KIP / 12,
    },
    "bending stiffness": {
        "Nm2/m": 1.0,
        "kNm2/m": 1e3,
        "MNm2/m": 1e6,
        "GNm2/m": 1e9,
        "tfm2/m": _KGF * 1e3,
        "kip-ft2/ft": _KIP * _FT,
        "kip-in2/ft": _KIP * _FT / 144,
    },
    "flexural rigidity": {
        "Nm2": 1.0,
        "kNm2": 1e3,
        "MNm2": 1e6,
        "GNm2": 1e9,
        "tfm2": _KGF * 1e3,
        "kip-ft2": _KIP * _FT**2,
        "kip-in2": _KIP * _FT**2 / 144,
    },
    "angle": {
        "rad": 1.0,
        "mrad": 1e-3,
        "urad": 1e-6,
        "deg": math.pi / 180,
        "arcmin": 60 * _ARCSEC,
        "arcsec": _ARCSEC,
        "gon": _GON,
        "mgon": _GON * 1e-3,
        "mm/m": 1e-3,  # of a tilt or distortion: its tangent, which is the angle
    },
    "area": {"m2": 1.0, "cm2": 1e-4, "mm2": 1e-6, "in2": 0.0254**2},
    "temperature": {"K": 1.0, "degC": 1.0},
    "expansion": {"1/K": 1.0, "1/degC": 1.0, "1/degF": 1.8, "microstrain/degC": 1e-6},
    "conductivity": {"W/mK": 1.0, "W/mdegC": 1.0},
    "heat capacity": {"J/m3K": 1.0, "kJ/m3K": 1e3, "MJ/m3K": 1e6, "MJ/m3degC": 1e6},
    "specific heat": {"J/kgK": 1.0, "kJ/kgK": 1e3, "J/kgdegC": 1.0, "kJ/kgdegC": 1e3},
    "film coefficient": {"W/m2K": 1.0, "W/m2degC": 1.0},
    "frequency": {"Hz": 1.0, "kHz": 1e3},
    "compressibility": {
        "1/Pa": 1.0,
        "1/kPa": 1e-3,
        "1/MPa": 1e-6,
        "1/GPa": 1e-9,
        "m2/N": 1.0,
        "m2/kN": 1e-3,
        "m2/MN": 1e-6,
    },
    "time": {
        "s": 1.0,
        "min": 60.0,
        "h": 3600.0,
        "d": _DAY,
        "day": _DAY,
        "days": _DAY,
        "week": 7 * _DAY,
        "weeks": 7 * _DAY,
        "month": _YEAR / 12,
        "months": _YEAR / 12,
        "year": _YEAR,
        "years": _YEAR,
    },
    "viscosity": {
        f"{unit} {time}": size * s
        for time, s in _OF_FLOW.items()
        for unit, size in {"Pa": 1.0, "kPa": 1e3, "MPa": 1e6, "GPa": 1e9}.items()
    },
    DIMENSIONLESS: {"": 1.0, "%": 1e-2},
    "strain": {
        "m/m": 1.0,
        "mm/m": 1e-3,
        "um/m": 1e-6,
        "microstrain": 1e-6,
        "ustrain": 1e-6,
        "millistrain": 1e-3,
        "1e-6": 1e-6,
        "in/in": 1.0,
        "%": 1e-2,
    },
    "pressure rate": _rates(kPa=1e3, Pa=1.0, MPa=1e6, bar=1e5, mbar=1e2, psi=_PSI),
    "force rate": _rates(kN=1e3, N=1.0, MN=1e6, tf=_KGF * 1e3, lbf=_LBF, kip=_KIP),
    "line load rate": _rates(**{"kN/m": 1e3, "N/m": 1.0, "MN/m": 1e6, "kip/ft": _KIP / _FT}),
    "moment rate": _rates(**{"kNm": 1e3, "Nm": 1.0, "kip-ft": _KIP * _FT}),
    "moment per length rate": _rates(**{"kNm/m": 1e3, "Nm/m": 1.0, "kip-ft/ft": _KIP}),
    "angle rate": _rates(mrad=1e-3, rad=1.0, urad=1e-6, deg=math.pi / 180, arcsec=_ARCSEC)
    | _rates(**{"mm/m": 1e-3}),
    "strain rate": _rates(microstrain=1e-6, ustrain=1e-6, **{"mm/m": 1e-3, "m/m": 1.0}),
    "temperature rate": _rates(K=1.0, degC=1.0),
    "frequency rate": _rates(Hz=1.0),
    "number rate": {f"1/{time}": 1 / s for time, s in _TIMES.items()},
}
"""Dimension to the sizes of its units in SI. Sizes: BIPM, The International System of Units (9th
edition); NIST Special Publication 811 (2008), appendix B, for those of other countries."""

UNITS: Mapping[str, tuple[str, float]] = {
    unit: next((name, known[unit]) for name, known in _TABLE.items() if unit in known)
    for units in _TABLE.values()
    for unit in units
}
"""Unit to its dimension and its size in the SI unit of that dimension: the first of the table, if a
unit belongs to several (``mm/m`` is an angle or a strain; see `size_in`)."""

NUMBER_PATTERN = r"[-+]?(?:[0-9]+(?:\.[0-9]*)?|\.[0-9]+)(?:[eE][-+]?[0-9]+)?"
_QUANTITY = re.compile(rf"({NUMBER_PATTERN})\s*(.*)")
_COMMA = re.compile(r"[-+]?[0-9]+(?:[.,'_ ][0-9]+)*,[0-9]+")
_THOUSANDS = re.compile(r"[-+]?[1-9][0-9]{0,2}(?:,[0-9]{3})+(?![0-9])")
_COMMA_AFTER = re.compile(r"[-+]?[1-9][0-9]{0,2}(?:[.'_ ][0-9]{3})+,[0-9]+")
_NOT_FINITE = re.compile(r"[-+]?\.?(?:nan|inf|infinity)\b", re.IGNORECASE)
_SPELLINGS = str.maketrans(
    {"²": "2", "³": "3", "µ": "u", "μ": "u", "^": "", "·": "", "*": "", " ": "", "ε": "strain"}
)
_LONGEST = 80
_LISTED = 17
"""Units in a message."""
_WORDS = {
    **dict.fromkeys(("meter", "meters", "metre", "metres", "mtr"), "m"),
    **dict.fromkeys(("millimeter", "millimeters", "millimetre", "millimetres"), "mm"),
    **dict.fromkeys(("degree", "degrees", "°"), "deg"),
    **dict.fromkeys(("pascal", "pascals"), "Pa"),
    **dict.fromkeys(("percent", "per cent"), "%"),
    **dict.fromkeys(("kg/cm2", "ksc", "kp/cm2"), "kgf/cm2"),
    **dict.fromkeys(("inch", "inches", '"', "''"), "in"),
    **dict.fromkeys(("foot", "feet"), "ft"),
    **dict.fromkeys(("kips", "klbf"), "kip"),
    **dict.fromkeys(("lb", "lbs", "pounds"), "lbf"),
    **dict.fromkeys(("kp", "kg"), "kgf"),
    **dict.fromkeys(("mwc", "mws"), "mH2O"),
    **dict.fromkeys(("micron", "microns"), "um"),
    **dict.fromkeys(("ue", "ustr", "ppm", "me"), "microstrain"),
    **dict.fromkeys(("second", "seconds", "arcseconds"), "arcsec"),
    **dict.fromkeys(("minute", "minutes", "arcminutes"), "arcmin"),
}
"""Units written out or otherwise, to the units that are meant."""
_TWO_READINGS = {
    "grad": "Write 'deg' for degrees (90 make a right angle), 'gon' for gons or grads (100 do)."
}
"""Units that mean one thing here and another there, to what to write."""
_PREFIX_APART = re.compile(r"(?<![A-Za-z0-9])[dhm]\s+([A-Za-z]+)")
"""A unit after a blank and a letter that is a prefix and a unit: `m m` may be square metres."""
_SAME = {
    **dict.fromkeys(("lbf/ft2", "lb/ft2", "lbs/ft2"), "psf"),
    **dict.fromkeys(("lbf/in2", "lb/in2", "lbs/in2"), "psi"),
    **dict.fromkeys(("kip/ft2", "kips/ft2"), "ksf"),
    **dict.fromkeys(("kip/in2", "kips/in2", "kpsi"), "ksi"),
    **dict.fromkeys(("msi", "MPSI"), "Mpsi"),
    "°": "deg",
    "°C": "degC",
    "W/m/K": "W/mK",
    "W/m2/K": "W/m2K",
    "J/kg/K": "J/kgK",
    "-": "",
    "10-6": "1e-6",
    "x10-6": "1e-6",
    "kipft": "kip-ft",
    "kipin": "kip-in",
    "kipft/ft": "kip-ft/ft",
    "lbfft": "lbf-ft",
    "ft-lbf": "lbf-ft",
    "ft-kip": "kip-ft",
    "kcf": "kip/ft3",
    "Ns/m2": "Pa s",
    **{unit.replace(" ", ""): unit for unit in _TABLE["viscosity"]},
    **{unit.replace(" ", "."): unit for unit in _TABLE["viscosity"]},
}
"""Spellings to the units that they are, once signs and blanks are gone."""


_SHORT = 3

LEAST_SD, MOST_SD = 1e-15, 1e15
"""Standard deviations (SI) between which those of all instruments lie, by far.

Readings that are more accurate would be fitted to the rounding of what is computed.
"""


LARGEST = 1e20
"""Size (SI) that nothing in the ground has, by far; products of some such numbers are finite."""


class UnitError(ValueError):
    """A text that is not a quantity, or not one of the dimension wanted.

    Args:
        message: what was found and what is expected.
        hint: the likely remedy, or empty.
    """

    def __init__(self, message: str, hint: str = "") -> None:
        self.message = message
        self.hint = hint
        super().__init__(f"{message} ({hint})" if hint else message)


@dataclass(frozen=True)
class Quantity:
    """A quantity that was read.

    Args:
        value: in the SI unit of its dimension.
        dimension: key of `DIMENSIONS`.
        unit: key of `UNITS`.
    """

    value: float
    dimension: str
    unit: str


def read_quantity(text: str, dimension: str = "") -> Quantity:
    """The quantity that a text says.

    Args:
        text: a number with its unit.
        dimension: that it must have, a key of `DIMENSIONS`; empty for any.

    >>> read_quantity("12GPa")
    Quantity(value=12000000000.0, dimension='pressure', unit='GPa')

    Raises:
        UnitError: the text is no number with a unit, or one of another dimension.
    """
    quantity = _quantity(text, dimension)
    return require_dimension(quantity, dimension, text) if dimension else quantity


def _quantity(text: str, dimension: str) -> Quantity:
    text = text.strip()
    match = _QUANTITY.fullmatch(text) if len(text) <= _LONGEST else None
    if match is None or match[2].startswith((",", "'", "_", ".")):
        raise _not_a_quantity(text)
    unit = normal_unit(match[2], dimension)
    behind = text[match.end(1) :]
    if behind and not unit and not re.fullmatch(r"\s+-", behind):
        message = f"'{text}' has '{match[2]}' behind its number"
        raise UnitError(message, "A sign stands before a number; remove marks of footnotes.")
    dimension, factor = UNITS[unit]
    value = float(match[1]) * factor
    if not abs(value) <= LARGEST:
        raise UnitError(f"'{text}' is too large to be computed with", "Check its exponent.")
    return Quantity(value, dimension, unit)


def read_duration(text: str) -> float:
    """Seconds of a duration such as ``90 s``, ``10min`` or ``1h 30min``.

    >>> read_duration("1h30min")
    5400.0

    Raises:
        UnitError: it is none.
    """
    hint = "Write it like 90 s, 10 min or 1h30min."
    parts = _PART_OF_DURATION.findall(text.lower())
    if not parts or _PART_OF_DURATION.sub("", text.lower()):
        raise UnitError(f"'{text}' is not a time", hint)
    return sum(float(number) * _OF_DURATION[unit] for number, unit in parts)


def require_dimension(quantity: Quantity, dimension: str, text: str) -> Quantity:
    """The quantity itself if it has the dimension.

    Args:
        quantity: what was read.
        dimension: a key of `DIMENSIONS`.
        text: what was written, for the message.

    Raises:
        UnitError: it has another dimension, or no unit where one is needed.
    """
    if quantity.dimension == dimension:
        return quantity
    size = _TABLE[dimension].get(quantity.unit)
    if size is not None and quantity.unit:
        value = quantity.value / UNITS[quantity.unit][1] * size
        return Quantity(value, dimension, quantity.unit)
    units = unit_list(dimension)
    if dimension == DIMENSIONLESS:
        message = f"'{text}' is {with_article(quantity.dimension)}; expected a number without unit"
        raise UnitError(message, "Remove the unit.")
    if quantity.unit == "":
        message = f"'{text}' has no unit; expected {with_article(dimension)}"
        likely = _LIKELY.get(dimension, (DIMENSIONS[dimension],))
        written = " or ".join(f"'{text.strip()} {unit}'" for unit in likely)
        raise UnitError(message, f"Write {written}, or another of {units}.")
    message = f"'{text}' is {with_article(quantity.dimension)}; expected {with_article(dimension)}"
    raise UnitError(message, f"Its units: {units}.")


_LIKELY = {
    "angle": ("deg",),
    "strain": ("microstrain",),
    "length": ("mm", "m"),
    "pressure": ("kPa", "MPa", "GPa"),
}
"""What people mean who write a number without its unit."""


def rate_of(dimension: str) -> str:
    """The dimension of a change by time; empty where the table has none.

    Args:
        dimension: of what changes.

    >>> rate_of("length"), rate_of("pressure"), rate_of("density")
    ('velocity', 'pressure rate', '')
    """
    name = {"length": "velocity", DIMENSIONLESS: "number rate"}.get(dimension, f"{dimension} rate")
    return name if name in DIMENSIONS else ""


def si_unit(dimension: str) -> str:
    """The SI unit of a dimension; empty for a pure number."""
    return DIMENSIONS.get(dimension, "")


def in_unit(value: float, unit: str, dimension: str) -> float:
    """An SI value in a unit; in SI where the unit is none of the dimension.

    Args:
        value: SI.
        unit: as the user wrote it.
        dimension: of the value.

    >>> in_unit(2.5e9, "GPa", "pressure")
    2.5
    """
    return value / (size_in(unit, dimension) or 1.0)


def shown_unit(unit: str, dimension: str) -> str:
    """The unit that `in_unit` gives."""
    return unit if size_in(unit, dimension) is not None else si_unit(dimension)


def size_in(unit: str, dimension: str) -> float | None:
    """Size of a unit in the SI unit of a dimension; None where it is not a unit of it.

    >>> size_in("mm/m", "strain"), size_in("mm/m", "length")
    (0.001, None)
    """
    return _TABLE.get(dimension, {}).get(unit)


def normal_unit(text: str, dimension: str = "") -> str:
    """The key of `UNITS` that a spelling means: ``kN/m³`` is ``kN/m3``.

    Args:
        text: the unit as written.
        dimension: that is expected, for the hint; empty for any.

    Raises:
        UnitError: there is no such unit.
    """
    unit = text.strip().translate(_SPELLINGS)
    if "/(" in unit:  # W/(m K)
        unit = unit.replace("/(", "/").removesuffix(")")
    unit = _SAME.get(unit, unit)
    apart = _PREFIX_APART.match(text.strip())
    if unit in UNITS and not (apart and apart[1] in UNITS):
        return unit
    raise UnitError(f"there is no unit '{text}'", _unit_hint(unit, dimension))


def unit_size(text: str, dimension: str, owner: str) -> float:
    """Size of a unit in the SI unit of a dimension.

    Args:
        text: the unit as written.
        dimension: that it must have.
        owner: what has the dimension, for the message.

    >>> unit_size("GPa", "pressure", "E")
    1000000000.0

    Raises:
        UnitError: it is no unit, or one of another dimension.
    """
    size = size_in(normal_unit(text, dimension), dimension)
    if size is not None:
        return size
    message = f"'{text}' is not a unit of {with_article(dimension)}, as '{owner}' is"
    raise UnitError(message, f"Its units: {unit_list(dimension)}.")


def unit_list(dimension: str) -> str:
    """The units of a dimension for a message; where there are many, the more usual ones.

    >>> unit_list("frequency")
    'Hz, kHz'
    """
    units = [unit for unit in _TABLE[dimension] if unit]
    more = f" and {len(units) - _LISTED} more" if len(units) > _LISTED + 1 else ""
    return ", ".join(units[:_LISTED] if more else units) + more


def units_of(dimension: str) -> tuple[str, ...]:
    """The units of a dimension."""
    return tuple(_TABLE[dimension])


def with_article(dimension: str) -> str:
    """The name of a dimension in a sentence.

    >>> with_article("angle")
    'an angle'
    """
    if dimension == DIMENSIONLESS:
        return "a number without unit"
    return f"{'an' if dimension[0] in 'aeio' else 'a'} {dimension}"


def _unit_hint(unit: str, dimension: str = "") -> str:
    if unit.lower() in _TWO_READINGS:
        return _TWO_READINGS[unit.lower()]
    meant = _WORDS.get(unit.lower()) or _nearest(unit, dimension) or _nearest(unit, "")
    if meant:
        return f"Did you mean '{meant}'?"
    if dimension:
        return f"Units of {dimension}: {unit_list(dimension)}."
    return f"Known units: {', '.join(filter(None, UNITS))}."


def _nearest(unit: str, dimension: str) -> str:
    folded = {name.lower(): name for name in (_TABLE[dimension] if dimension else UNITS) if name}
    # of three letters, two are no likeness: psg is neither psi nor psf
    cutoff = 0.5 if len(unit) > _SHORT else 0.7
    near = difflib.get_close_matches(unit.lower(), folded, n=1, cutoff=cutoff)
    return folded[near[0]] if near else ""


def _not_a_quantity(text: str) -> UnitError:
    shown = text if len(text) <= _LONGEST else f"{text[:_LONGEST]}..."
    if len(text) <= _LONGEST and _COMMA.match(text):
        if grouped := _COMMA_AFTER.match(text):
            plain = re.sub("[.'_ ]", "", grouped[0]) + text[grouped.end() :]
        else:
            plain = text
        hint = f"Write '{plain.replace(',', '.', 1)}' with a decimal point"
        if _THOUSANDS.match(text):
            hint += f", or '{text.replace(',', '')}' without separators"
        return UnitError(f"'{shown}' has a comma, which can be read in two ways", f"{hint}.")
    if _NOT_FINITE.match(text):
        return UnitError(f"'{shown}' is not a finite number", "Write a finite number.")
    if not text:
        return UnitError("nothing is written here; expected a number")
    return UnitError(
        f"'{shown}' is not a number with a unit",
        "Write it like '12.5 MPa' or '1e-3 m', and like '0.25' where there is no unit.",
    )
