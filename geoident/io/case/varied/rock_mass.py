"""The modulus of a rock mass by Hoek and Diederichs, in place of a number.

Written as `E: {hoek-diederichs: {Ei: 20 GPa, GSI: $GSI, D: 0}}`.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import nan

from pydantic import Field

from geoident.io.schema.section import Alternatives, Section, optional
from geoident.io.schema.values import CaseNumber, Coefficient, Modulus, Multiple
from geoident.model.empirical.rock_mass import RockMassModulus
from geoident.model.parameter import Scalar

KEY = "hoek-diederichs"


class HoekDiederichsSection(Section):
    """E of a rock mass by its Geological Strength Index (Hoek & Diederichs 2006).

    From the modulus of intact rock, Ei or MR times sigci; with neither, the simplified form, which
    knows GSI and D only.
    """

    one_of = (
        Alternatives(
            "Ei",
            "MR sigci",
            "",
            hint="Write one modulus of intact rock; without any E follows from GSI and D alone.",
        ),
    )

    Ei: Modulus | None = optional(
        "Young's modulus of intact rock.", examples=["20 GPa", "$E_intact"]
    )
    MR: Multiple | None = optional(
        "Modulus ratio Ei / sigci of the kind of rock, where Ei is not measured."
    )
    sigci: Modulus | None = optional("Uniaxial compressive strength of intact rock, with MR.")
    GSI: Coefficient = Field(
        description="Geological Strength Index, 0 to 100.", examples=["45", "$GSI"]
    )
    D: Coefficient | None = optional(
        "Disturbance by blasting and relaxation, 0 to 1; 0 if missing."
    )


class RockMassModulusSection(Section):
    """A modulus that follows from what is known of the rock mass."""

    hoek_diederichs: HoekDiederichsSection = Field(
        alias=KEY, description="By Hoek and Diederichs (2006)."
    )

    def number(self) -> DerivedModulus:
        """The modulus that follows from it."""
        return DerivedModulus(KEY, nan, None, "pressure", varied_by=self, may_be_tied=True)


@dataclass(frozen=True)
class DerivedModulus(CaseNumber):
    """A modulus that follows from the numbers of its section."""

    @property
    def inner(self) -> HoekDiederichsSection:
        """What it follows from."""
        section: RockMassModulusSection = self.varied_by
        return section.hoek_diederichs

    @property
    def scalar(self) -> Scalar:
        """For the model."""
        return self.inner.to_model(RockMassModulus)

    @property
    def parts(self) -> list[CaseNumber]:
        """The numbers that are given, from which it follows."""
        return self.inner.numbers
