"""Structural parts of a case: linings as beams on lines of the mesh, rock bolts as bars."""

from __future__ import annotations

from dataclasses import dataclass

from geoident.model.parameter import Scalar, Values, scalars_of


@dataclass(frozen=True)
class _Structure:
    """What every structure knows of itself."""

    @property
    def numbers(self) -> dict[str, Scalar]:
        """The numbers on which its stiffness depends, by name."""
        return scalars_of(self)

    def breach(self, values: Values) -> str | None:
        """Which of its numbers is impossible at parameter values (SI), half a sentence, or None."""
        for name, scalar in self.numbers.items():
            number = scalar.value(values)
            if name == "nu":
                if not -1.0 < number < 0.5:
                    return f"nu is {number:.6g}, it must be between -1 and 0.5"
            elif not number > 0.0:
                return f"{name} is {number:.6g}, it must be positive"
        return None


@dataclass(frozen=True)
class Beam(_Structure):
    """A lining in plane strain, per metre out of plane. Either E and thickness, or EA and EI.

    Args:
        group: group of lines of the mesh on which it is built.
        E: Young's modulus, Pa.
        thickness: m.
        nu: Poisson's ratio: then E / (1 - nu^2) is taken, as for a wall long out of plane.
        EA: axial stiffness, N/m.
        EI: bending stiffness, N m (N m2 per metre).
        clamped_on: groups on whose nodes the beam does not turn (planes of symmetry, abutments).
    """

    group: str
    E: Scalar | None = None
    thickness: Scalar | None = None
    nu: Scalar | None = None
    EA: Scalar | None = None
    EI: Scalar | None = None
    clamped_on: tuple[str, ...] = ()


@dataclass(frozen=True)
class Bolts(_Structure):
    """Bars that hold the ground at their two ends only. Either E and diameter, or EA.

    Args:
        ends: the two end points of every bolt, m.
        spacing: out of plane, m, in plane strain; None in a solid.
        E: Young's modulus, Pa.
        diameter: m.
        EA: axial stiffness of one bolt, N.
    """

    ends: tuple[tuple[tuple[float, ...], tuple[float, ...]], ...]
    spacing: Scalar | None = None
    E: Scalar | None = None
    diameter: Scalar | None = None
    EA: Scalar | None = None


Structure = Beam | Bolts
