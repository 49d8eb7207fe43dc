"""Moduli and strengths that grow with depth, or with the stress in situ.

Written as `E: {at: 20 MPa, gradient: 0.5 MPa/m, surface: 0 m}` or as
`E: {reference: 30 MPa, exponent: 0.5, pressure: 100 kPa}`.
"""

from __future__ import annotations

from abc import abstractmethod
from dataclasses import replace

from pydantic import Field

from geoident.io.schema.section import Context, Section, optional
from geoident.io.schema.values import (
    CaseNumber,
    Coefficient,
    LevelOrGroup,
    Modulus,
    Stress,
    UnitWeight,
    scalar_of,
)
from geoident.model.ground import Growth, WithDepth, WithStress
from geoident.model.parameter import Scalar

LEAST_PRESSURE = 0.01
"""Least mean stress that counts where the case gives none, in parts of the reference pressure."""


class GrowthBase(Section):
    """A modulus or a strength that grows."""

    @property
    @abstractmethod
    def base(self) -> CaseNumber:
        """The number from which it grows."""

    @abstractmethod
    def law(self) -> WithDepth | WithStress:
        """How it grows, for the model."""

    def number(self) -> CaseNumber:
        """The number from which it grows."""
        return replace(self.base, varied_by=self)

    def built(
        self, context: Context, *, material: str, constant: str, surface: int | None
    ) -> Growth:
        """The growth for the model.

        Args:
            context: of the key of the constant.
            material: of which it is.
            constant: its name in the model.
            surface: index of the yield surface whose strength it is, or None.
        """
        base = self.base
        return Growth(
            material=material,
            constant=constant,
            base=base.scalar,
            law=self.law(),
            surface=surface,
            dimension=base.dimension,
            unit=base.unit,
            path=context.path,
        )


class DepthGrowthSection(GrowthBase):
    """A modulus or a strength that grows with depth: at + gradient * depth."""

    at: Stress = Field(
        description="Its value at the surface; it may be 0, as in Gibson's soil.",
        examples=["20 MPa", "$E_top"],
    )
    gradient: UnitWeight = Field(
        description="By how much it grows per metre of depth; it may be negative, where the "
        "value stays positive in all ground of the material.",
        examples=["0.5 MPa/m", "$growth"],
    )
    surface: LevelOrGroup = Field(
        description="Where depth is counted from, downwards: a level, or a group of lines (2-D) or "
        "surfaces (solid) of the mesh with topography. Depth is negative above it.",
        examples=["0 m", "topography"],
    )

    @property
    def base(self) -> CaseNumber:
        """The value at the surface."""
        return self.at

    def law(self) -> WithDepth:
        """With depth."""
        return self.to_model(WithDepth)


class StressGrowthSection(GrowthBase):
    """A modulus or a strength that grows with the mean effective stress p' in situ.

    It is reference * (p' / pressure)^exponent, with p' as `in_situ` gives it before the first
    stage, compression positive: no stage changes it.
    """

    reference: Modulus = Field(
        description="Its value at p' = pressure.", examples=["30 MPa", "$E_ref"]
    )
    exponent: Coefficient = Field(
        description="Exponent: of moduli about 0.5 for sand, up to 1 for soft clay; 1 for an "
        "undrained strength in proportion to p'; 0 for no growth.",
        examples=["0.5", "$m"],
    )
    pressure: Modulus = Field(
        description="Mean effective stress at which the value is the reference.",
        examples=["100 kPa"],
    )
    least: Modulus | None = optional(
        "Least p' that counts: ground in tension or without stress has the value of "
        "this one. 1 % of `pressure` if missing.",
        examples=["1 kPa"],
    )

    @property
    def base(self) -> CaseNumber:
        """The value at the reference pressure."""
        return self.reference

    def law(self) -> WithStress:
        """With stress."""
        pressure = self.pressure
        small = Scalar(LEAST_PRESSURE * pressure.factor, pressure.parameter)
        return self.to_model(WithStress, least=scalar_of(self.least) or small)
