"""Vertical drains: how fast ground around them gives its water to them.

Barron (Trans. ASCE 113, 1948) with equal strain, Hansbo (Proc. 10th ICSMFE, 1981) with smear. Of
ground of permeability k_h, of diameter D around each drain of diameter d, a volume gives in a time

    q = 8 k_h / (gamma_w mu D^2) (mean pressure - pressure in the drain)
    mu = int_1^n k_h / k(x) (n^2 - x^2)^2 / x dx / (n^2 (n^2 - 1)) ,   n = D / d

with k(x) the permeability at x radii of the drain: k_s up to s = d_s / d, in the ground that was
disturbed around it, and k_h beyond.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Literal

from geoident.model.dual import Dual, ParameterPoint
from geoident.model.parameter import Scalar, Values

DrainPattern = Literal["triangle", "square"]
"""How drains stand."""

AROUND: Mapping[DrainPattern, float] = {"triangle": 1.05, "square": 1.13}
"""Diameter of the ground around a drain, in spacings (Barron 1948)."""


@dataclass(frozen=True)
class VerticalDrains:
    """Drains in a grid, which ground gives its water to wherever it is.

    Args:
        spacing: of neighbours, m.
        sides: of a drain, m: its diameter, or width and thickness of a strip.
        pattern: how they stand.
        smear: diameter of the disturbed ground around one, m; None for none.
        smear_ratio: permeability of the ground by that of the disturbed ground.
        permeability: of the ground for water that flows to them, m/s; None: the horizontal one.
    """

    spacing: Scalar
    sides: tuple[Scalar, ...]
    pattern: DrainPattern = "triangle"
    smear: Scalar | None = None
    smear_ratio: Scalar = Scalar(1.0)
    permeability: Scalar | None = None

    @property
    def scalars(self) -> tuple[Scalar, ...]:
        """All its numbers."""
        maybe = (self.smear, self.permeability)
        given = tuple(number for number in maybe if number is not None)
        return (self.spacing, *self.sides, self.smear_ratio, *given)

    def intake(self, horizontal: Dual, point: ParameterPoint) -> Dual:
        """8 k_h / (mu D^2), what they take by head, volume and time, 1/(m s).

        Args:
            horizontal: permeability of the ground, m/s.
            point: the parameters.
        """
        k_h = horizontal if self.permeability is None else point.number(self.permeability)
        influence = AROUND[self.pattern] * point.number(self.spacing)
        diameter = point.number(self.sides[0])
        for side in self.sides[1:]:
            diameter = 0.5 * (diameter + point.number(side))
        smear = diameter if self.smear is None else point.number(self.smear)
        ratio = point.number(self.smear_ratio)
        mu = resistance(influence / diameter, smear / diameter, ratio)
        return 8.0 * k_h / (mu * influence * influence)

    def breach(self, values: Values) -> tuple[str, str] | None:
        """The first number that cannot be at parameter values: its key, and why; None for none."""
        names = ("diameter",) if len(self.sides) == 1 else ("width", "thickness")
        numbers = {
            **dict(zip(names, self.sides, strict=True)),
            "spacing": self.spacing,
            "smear": self.smear,
            "smear_ratio": self.smear_ratio,
            "permeability": self.permeability,
        }
        found = {key: one.value(values) for key, one in numbers.items() if one is not None}
        for key, value in found.items():
            if not value > 0.0:
                return key, f"'{key}' of the drains is {value:.4g}, it must be positive"
        diameter = sum(found[key] for key in names) / len(names)
        wrong = misplaced(found["spacing"], diameter, found.get("smear"))
        if wrong is None:
            return None
        key, why = wrong
        return (names[0] if key == "diameter" else key), why


def misplaced(spacing: float, diameter: float, smear: float | None) -> tuple[str, str] | None:
    """What is wrong with drains of some sizes (m): the key, and why; None for nothing.

    Drains are apart from each other, and what is disturbed lies between.
    """
    if diameter >= spacing:
        why = f"the drains are as thick, {diameter:.4g} m, as they are apart, {spacing:.4g} m"
        return "diameter", why
    if smear is not None and not diameter <= smear < spacing:
        why = f"the smear of {smear:.4g} m is not between the diameter of the drains, "
        return "smear", why + f"{diameter:.4g} m, and their spacing, {spacing:.4g} m"
    return None


def resistance(n: Dual, s: Dual, ratio: Dual) -> Dual:
    """Mu of a drain.

    Args:
        n: diameter of the ground around it by its own.
        s: diameter of the disturbed ground by its own.
        ratio: permeability of the ground by that of the disturbed ground.
    """
    square = n * n

    def up_to(x: Dual) -> Dual:
        """The integral from 1 on, without disturbance."""
        return square * square * x.log() - square * (x * x - 1.0) + 0.25 * (x * x * x * x - 1.0)

    return (up_to(n) + (ratio - 1.0) * up_to(s)) / (square * (square - 1.0))
