"""The criterion of Hoek and Brown, by intact rock and GSI or by the constants of the rock mass."""

from __future__ import annotations

from typing import Literal

from pydantic import Field, model_validator

from geoident.io.case.varied.number import FieldStrength
from geoident.io.case.yielding.sections import SurfaceBase
from geoident.io.schema.section import Context, require_one_of
from geoident.io.schema.values import Angle, Coefficient, Multiple, scalar_of
from geoident.model.yielding import HoekBrown


class HoekBrownSection(SurfaceBase):
    """The generalised criterion of Hoek and Brown (2002 edition), smooth.

    By mi, GSI and D of intact rock and rock mass, or by mb, s and a directly.
    """

    type: Literal["hoek-brown"] = Field(description="Kind of yield surface.")
    sigci: FieldStrength = Field(
        description="Uniaxial compressive strength of intact rock.",
        examples=["50 MPa", "$sigci"],
    )
    mi: Multiple | None = Field(
        None,
        description="Constant of intact rock, with GSI: about 4 for claystone, 32 for granite.",
    )
    GSI: Coefficient | None = Field(
        None, description="Geological Strength Index, 0 to 100.", examples=["45", "$GSI"]
    )
    D: Coefficient | None = Field(
        None,
        description="Disturbance by blasting and relaxation, 0 to 1, with GSI; 0 if missing.",
    )
    mb: Multiple | None = Field(None, description="Constant of the rock mass, with s and a.")
    s: Coefficient | None = Field(
        None, description="Constant of the rock mass, with mb and a: 0 to 1, 1 for intact rock."
    )
    a: Coefficient | None = Field(
        None, description="Exponent, with mb and s: 0.5 for intact rock, 0.2 to 0.9 at most."
    )
    dilation: Angle | None = Field(
        None,
        description="Constant dilation angle; 0 deg for flow without change of volume.",
        examples=["0 deg", "5 deg"],
    )
    flow: Literal["associated"] | None = Field(
        None,
        description="In place of `dilation`: flow along the normals, which near an unsupported "
        "wall dilates as no rock does.",
    )
    tension: FieldStrength | None = Field(
        None,
        description="Tensile strength: largest principal stress, lower than s sigci / mb, which "
        "limits it if missing.",
    )

    @model_validator(mode="after")
    def _one_set(self) -> HoekBrownSection:
        ways = [("mi", "GSI"), ("mi", "GSI", "D"), ("mb", "s", "a")]
        expected = "mi with GSI (and D), or mb, s and a, are"
        require_one_of(self, ways, expected, "Give all constants of one set.")
        expected = "dilation, or flow, is"
        hint = "Flow without change of volume: 'dilation: 0 deg'; or write 'flow: associated'."
        require_one_of(self, [("dilation",), ("flow",)], expected, hint)
        return self

    def surface(self, context: Context) -> HoekBrown:
        """The surface; a tie has its own number for each constant."""
        names = ("mi", "GSI", "D", "mb", "s", "a", "dilation", "tension")
        given = {name: scalar_of(getattr(self, name)) for name in names}
        return HoekBrown(self.sigci.scalar, **given)
