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
    "force": "N",
    "line load": "N/m",
    "area": "m2",
    "bending stiffness": "Nm2/m",
    "angle": "rad",
    "temperature": "K",
    "expansion": "1/K",
    DIMENSIONLESS: "",
}
"""Dimension to its SI unit."""

_DAY = 86400.0  # s
_YEAR = 365.25 * _DAY  # Julian; a month is its twelfth part
_PSI = 6894.757293168361  # Pa, 1 lbf/in2

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
        "kgf/cm2": 98066.5,
        "psi": _PSI,
        "ksi": _PSI * 1e3,
    },
    "length": {
        "m": 1.0,
        "km": 1e3,
        "dm": 0.1,
        "cm": 1e-2,
        "mm": 1e-3,
        "um": 1e-6,
        "in": 0.0254,
        "ft": 0.3048,
    },
    "density": {"kg/m3": 1.0, "t/m3": 1e3, "g/cm3": 1e3, "lb/ft3": 16.018463373960142},
    "unit weight": {
        "N/m3": 1.0,
        "kN/m3": 1e3,
        "MN/m3": 1e6,
        "kPa/m": 1e3,
        "MPa/m": 1e6,
        "lbf/ft3": 157.08746384624,
    },
    "acceleration": {"m/s2": 1.0, "cm/s2": 1e-2},
    "velocity": {
        "m/s": 1.0,
        "mm/day": 1e-3 / _DAY,
        "mm/week": 1e-3 / (7 * _DAY),
        "mm/month": 12e-3 / _YEAR,
        "mm/year": 1e-3 / _YEAR,
        "cm/year": 1e-2 / _YEAR,
        "m/day": 1.0 / _DAY,
    },
    "force": {"N": 1.0, "kN": 1e3, "MN": 1e6, "lbf": 4.4482216152605},
    "line load": {"N/m": 1.0, "kN/m": 1e3, "MN/m": 1e6, "GN/m": 1e9},
    "area": {"m2": 1.0, "cm2": 1e-4, "mm2": 1e-6, "in2": 0.0254**2},
    "bending stiffness": {"Nm2/m": 1.0, "kNm2/m": 1e3, "MNm2/m": 1e6, "GNm2/m": 1e9},
    "angle": {"rad": 1.0, "deg": math.pi / 180},
    "temperature": {"K": 1.0, "degC": 1.0},
    "expansion": {"1/K": 1.0, "1/degC": 1.0},
    DIMENSIONLESS: {"": 1.0, "%": 1e-2},
}

UNITS: Mapping[str, tuple[str, float]] = {
    unit: (dimension, factor)
    for dimension, units in _TABLE.items()
    for unit, factor in units.items()
}
"""Unit to its dimension and its size in the SI unit of that dimension."""

NUMBER_PATTERN = r"[-+]?(?:[0-9]+(?:\.[0-9]*)?|\.[0-9]+)(?:[eE][-+]?[0-9]+)?"
_QUANTITY = re.compile(rf"({NUMBER_PATTERN})\s*(.*)")
_COMMA = re.compile(r"[-+]?[0-9]+(?:[.,'_ ][0-9]+)*,[0-9]+")
_THOUSANDS = re.compile(r"[-+]?[1-9][0-9]{0,2}(?:,[0-9]{3})+(?![0-9])")
_NOT_FINITE = re.compile(r"[-+]?\.?(?:nan|inf|infinity)\b", re.IGNORECASE)
_SPELLINGS = str.maketrans({"²": "2", "³": "3", "µ": "u", "μ": "u", "^": "", "·": "", " ": ""})
_LONGEST = 80
_WORDS = {
    **dict.fromkeys(("meter", "meters", "metre", "metres", "mtr"), "m"),
    **dict.fromkeys(("millimeter", "millimeters", "millimetre", "millimetres"), "mm"),
    **dict.fromkeys(("degree", "degrees", "°"), "deg"),
    **dict.fromkeys(("pascal", "pascals"), "Pa"),
    **dict.fromkeys(("percent", "per cent"), "%"),
}
"""Units written out, to the units that are meant."""


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


def read_quantity(text: str) -> Quantity:
    """The quantity that a text says, whatever its dimension.

    >>> read_quantity("12GPa")
    Quantity(value=12000000000.0, dimension='pressure', unit='GPa')

    Raises:
        UnitError: the text is no number with a unit.
    """
    text = text.strip()
    match = _QUANTITY.fullmatch(text) if len(text) <= _LONGEST else None
    if match is None or match[2].startswith((",", "'", "_", ".")):
        raise _not_a_quantity(text)
    unit = normal_unit(match[2])
    dimension, factor = UNITS[unit]
    value = float(match[1]) * factor
    if not math.isfinite(value):
        raise UnitError(f"'{text}' is too large for a number", "Check its exponent.")
    return Quantity(value, dimension, unit)


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
    units = unit_list(dimension)
    if dimension == DIMENSIONLESS:
        message = (
            f"'{text}' is {with_article(quantity.dimension)}; a number without unit is expected"
        )
        raise UnitError(message, "Remove the unit.")
    if quantity.unit == "":
        message = f"'{text}' has no unit; {with_article(dimension)} is expected"
        if dimension == "angle":  # whoever writes 30 means degrees
            raise UnitError(message, f"Write '{text.strip()} deg', or one of {units}.")
        si = DIMENSIONS[dimension]
        raise UnitError(
            message, f"The SI unit is {si}: write '{text.strip()} {si}', or one of {units}."
        )
    message = (
        f"'{text}' is {with_article(quantity.dimension)}; {with_article(dimension)} is expected"
    )
    raise UnitError(message, f"Its units: {units}.")


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
    known = UNITS.get(unit)
    return value / known[1] if known and known[0] == dimension else value


def shown_unit(unit: str, dimension: str) -> str:
    """The unit that `in_unit` gives."""
    known = UNITS.get(unit)
    return unit if known and known[0] == dimension else si_unit(dimension)


def normal_unit(text: str) -> str:
    """The key of `UNITS` that a spelling means: ``kN/m³`` is ``kN/m3``.

    Raises:
        UnitError: there is no such unit.
    """
    unit = text.strip().translate(_SPELLINGS)
    unit = {"°": "deg", "°C": "degC", "-": ""}.get(unit, unit)
    if unit in UNITS:
        return unit
    raise UnitError(f"there is no unit '{text}'", _unit_hint(unit))


def unit_list(dimension: str) -> str:
    """The units of a dimension for a message."""
    return ", ".join(unit for unit in _TABLE[dimension] if unit)


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


def _unit_hint(unit: str) -> str:
    folded = {name.lower(): name for name in UNITS if name}
    near = difflib.get_close_matches(unit.lower(), folded, n=1, cutoff=0.5)
    meant = _WORDS.get(unit.lower()) or (folded[near[0]] if near else None)
    if meant:
        return f"Did you mean '{meant}'?"
    return f"Known units: {', '.join(filter(None, UNITS))}."


def _not_a_quantity(text: str) -> UnitError:
    shown = text if len(text) <= _LONGEST else f"{text[:_LONGEST]}..."
    if len(text) <= _LONGEST and _COMMA.match(text):
        hint = f"Write '{text.replace(',', '.', 1)}' with a decimal point"
        if _THOUSANDS.match(text):
            hint += f", or '{text.replace(',', '')}' without separators"
        return UnitError(f"'{shown}' has a comma, which can be read in two ways", f"{hint}.")
    if _NOT_FINITE.match(text):
        return UnitError(f"'{shown}' is not a finite number", "Write a finite number.")
    if not text:
        return UnitError("nothing is written here; a number is expected")
    return UnitError(
        f"'{shown}' is not a number with a unit",
        "Write it like '12.5 MPa' or '1e-3 m', and like '0.25' where there is no unit.",
    )
