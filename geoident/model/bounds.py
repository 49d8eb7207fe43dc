"""Bounds on the constants of a material, and the one that a constant breaks."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from math import degrees

Numbers = Mapping[str, float]
"""Name of a constant to its value, SI."""

_ANGLES = ("friction", "dilation")
_RATIOS = (
    "nu", "nu_p", "nu_np", "nu_12", "nu_13", "nu_23", "mi", "GSI", "D", "mb", "s", "a", "MR", "m",
    "Rf", "K0nc", "OCR", "gamma_07",
)  # fmt: skip


@dataclass(frozen=True)
class Breach:
    """A constant outside its bounds.

    Args:
        constant: its name.
        value: SI.
        limit: what it must be, half a sentence.
    """

    constant: str
    value: float
    limit: str

    @property
    def shown(self) -> str:
        """The value with its unit."""
        if self.constant in _ANGLES:
            return f"{degrees(self.value):.6g} deg"
        return f"{self.value:.6g}" + ("" if self.constant in _RATIOS else " Pa")


def not_positive(constants: Numbers, *names: str) -> Breach | None:
    """The first of some constants that is not above zero; one that is not given may be anything."""
    for name in names:
        if not constants.get(name, 1.0) > 0.0:
            return Breach(name, constants[name], "it must be positive")
    return None


def negative(constants: Numbers, name: str) -> Breach | None:
    """A constant below zero."""
    if constants.get(name, 0.0) >= 0.0:
        return None
    return Breach(name, constants[name], "it must not be negative")


def beyond(constants: Numbers, name: str, least: float, most: float) -> Breach | None:
    """A constant that is not from ``least`` to ``most``, both included."""
    if least <= constants.get(name, least) <= most:
        return None
    return Breach(name, constants[name], f"it must be from {least:g} to {most:g}")


def outside(
    constants: Numbers, name: str, low: float, high: float, known: str = ""
) -> Breach | None:
    """A constant that is not between ``low`` and ``high``, both excluded.

    Args:
        constants: the constants.
        name: of the constant.
        low: SI.
        high: SI.
        known: on what the bounds depend, a clause before the limit.
    """
    if name not in constants or low < constants[name] < high:
        return None
    unit = "" if name.startswith("nu") else " Pa"
    return Breach(
        name, constants[name], f"{known}it must be between {low:.4g} and {high:.4g}{unit}"
    )
