"""Interfaces: faces along which the ground, or ground and a structure, part and slip."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from geoident.model.parameter import Scalar, Values, scalars_of


@dataclass(frozen=True)
class Interface:
    """Springs across faces of the mesh, with Coulomb's limit of the shear and one of the tension.

    Args:
        along: group of faces of the mesh (lines in the plane).
        k_n: traction per opening, Pa/m.
        k_s: traction per slip, Pa/m.
        cohesion: Pa; None for zero.
        friction: angle, rad; None: no limits, and it bears tension.
        R_inter: part of the cohesion and of tan(friction) that it has; None: all.
        dilation: angle, rad, by which slip opens it.
        tensile_strength: Pa.
        permeable: whether water that takes time to leave the ground flows across.
    """

    along: str
    k_n: Scalar
    k_s: Scalar
    cohesion: Scalar | None = None
    friction: Scalar | None = None
    R_inter: Scalar | None = None
    dilation: Scalar = Scalar(0.0)
    tensile_strength: Scalar = Scalar(0.0)
    permeable: bool = True

    ageing: ClassVar[None] = None

    @property
    def numbers(self) -> dict[str, Scalar]:
        """The numbers that the case gives of it, by name."""
        return scalars_of(self)

    @property
    def yields(self) -> bool:
        """Whether it has limits."""
        return self.friction is not None

    def strength(self, values: Values) -> tuple[float, float]:
        """Cohesion (Pa) and friction angle (rad) that it has at parameter values (SI)."""
        cohesion, friction, part = (
            missing if number is None else number.value(values)
            for number, missing in ((self.cohesion, 0.0), (self.friction, 0.0), (self.R_inter, 1.0))
        )
        return part * cohesion, float(np.arctan(part * np.tan(friction)))

    def breach(self, values: Values) -> str | None:
        """Which of its numbers is impossible at parameter values (SI), half a sentence, or None."""
        numbers = {name: scalar.value(values) for name, scalar in self.numbers.items()}
        for name, number in numbers.items():
            if name in ("k_n", "k_s", "R_inter"):
                if not number > 0.0:
                    return f"{name} is {number:.6g}, it must be positive"
            elif not number >= 0.0:
                return f"{name} is {number:.6g}, it must not be negative"
        friction, dilation = numbers.get("friction", 0.0), numbers["dilation"]
        if not friction < np.pi / 2:
            return f"friction is {np.degrees(friction):.6g} deg, it must be below 90 deg"
        cohesion, friction = self.strength(values)
        if self.yields and not dilation <= friction * (1.0 + 1e-12):
            return (
                f"dilation is {np.degrees(dilation):.6g} deg, beyond the friction of "
                f"{np.degrees(friction):.6g} deg"
            )
        apex = cohesion / np.tan(friction) if friction > 0.0 else np.inf
        tensile = numbers["tensile_strength"]
        if self.yields and not tensile <= apex * (1.0 + 1e-12):
            return (
                f"tensile_strength is {tensile / 1e3:.6g} kPa, beyond the tip of "
                f"Coulomb's cone, cohesion / tan(friction), {apex / 1e3:.6g} kPa"
            )
        return None
