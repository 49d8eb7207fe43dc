"""Vertical drains in ground that consolidates: the key `drains` of `hydraulic`."""

from __future__ import annotations

from typing import Literal

from pydantic import Field

from geoident.io.schema.section import Alternatives, Section, SectionFaults, optional
from geoident.io.schema.values import CaseNumber, Multiple, Permeability, Size
from geoident.model.drains import VerticalDrains


class VerticalDrainsSection(Section):
    """Vertical drains in a grid (Barron 1948, Hansbo 1981: equal strain, smear).

    The ground gives its water to them wherever it is: they are not drawn in the mesh. In them the
    water has no excess pressure.
    """

    one_of = (
        Alternatives(
            "diameter", "width thickness", hint="Give the 'diameter', or both sides of a strip."
        ),
    )

    spacing: Size = Field(description="Distance of neighbouring drains.", examples=["1.2 m"])
    pattern: Literal["triangle", "square"] = Field(
        "triangle", description="How they stand: a drain has 1.05 or 1.13 spacings around it."
    )
    diameter: Size | None = optional("Of a drain.", examples=["66 mm"])
    width: Size | None = optional(
        "Of a strip, whose diameter is half the sum of width and thickness.", examples=["100 mm"]
    )
    thickness: Size | None = optional("Of a strip.", examples=["4 mm"])
    smear: Size | None = optional(
        "Diameter of the ground that was disturbed around it.", examples=["0.2 m"]
    )
    smear_ratio: Multiple | None = optional(
        "Permeability of the ground by that of the disturbed ground.", examples=["3", "$smear"]
    )
    permeability: Permeability | None = optional(
        "Of the ground, for water that flows to the drains; that of the ground along x "
        "if missing, in a solid the geometric mean of those along x and y.",
        examples=["$k_h"],
    )

    def check(self, faults: SectionFaults) -> None:
        """Smear has an extent and a ratio."""
        check_smear(self.smear, self.smear_ratio, faults)

    def build(self) -> VerticalDrains:
        """For the model."""
        sides = (self.width, self.thickness) if self.diameter is None else (self.diameter,)
        return self.to_model(
            VerticalDrains, sides=tuple(side.scalar for side in sides if side is not None)
        )


def check_smear(smear: CaseNumber | None, ratio: object, faults: SectionFaults) -> None:
    """Note smear that has an extent and no ratio, or the reverse."""
    if (smear is None) == (ratio is None):
        return
    given, other = ("smear", "smear_ratio") if smear else ("smear_ratio", "smear")
    message = f"'{given}' without '{other}' says nothing"
    faults.add((given,), "missing-key", message, f"Add '{other}', or remove it.")
