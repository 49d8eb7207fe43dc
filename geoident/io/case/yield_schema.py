"""What a case file may say of how a material yields: one section per kind of yield surface."""

from __future__ import annotations

from typing import Annotated, Any, Literal

from pydantic import Discriminator, Field, Tag, model_validator

from geoident.io.case.values import Angle, Count, Numbers, Pressure
from geoident.io.case.words import Name
from geoident.io.schema.section import Section, require_one_of
from geoident.model.yielding import Fit

_FIT = (
    "How the planes lie to the smooth surface: inside it, around it, or so that they are of the "
    "same size on average (`best`, if missing)."
)
_TENSION = "Largest tensile principal stress; limited by the other strengths alone if missing."
_COHESION = Field(description="Cohesion.", examples=["1.5 MPa", "$c"])
_FRICTION = Field(description="Angle of friction, from 0 to below 90 deg.", examples=["35 deg"])


class YieldPlaneSection(Section):
    """One plane of a yield surface: normal^T stress <= distance, tension positive."""

    name: Name | None = Field(None, description="In tables and reports; 'plane N' if missing.")
    normal: Numbers = Field(
        description="Unit normal: factors of the stresses xx, yy, xy in 2-D (or xx, yy, zz, xy), "
        "of xx, yy, zz, xy, yz, xz in a solid.",
        examples=[["0.6", "0", "0.8"]],
    )
    distance: Pressure = Field(
        description="Distance k of the plane from the stress-free state; planes that name the same "
        "parameter are tied.",
        examples=["2 MPa", "$k1"],
    )


class PlanesSection(Section):
    """A yield surface given plane by plane; all of them hold, the flow is along their normals."""

    type: Literal["planes"] = Field(description="Kind of yield surface.")
    planes: list[YieldPlaneSection] = Field(min_length=1, description="The planes.")
    hardening: Pressure | None = Field(
        None, description="Growth of a distance per plastic strain on its plane; 0 if missing."
    )


class _Coulomb(Section):
    tension: Pressure | None = Field(None, description=_TENSION)
    planes: Annotated[int, Count()] | None = Field(
        None,
        description="Planes in place of the smooth surface: in 2-D the sides of the polygon in "
        "place of Mohr's circle (even; three planes each), in a solid the number of planes (from "
        "48 on, taken six at a time).",
        examples=["16"],
    )
    fit: Fit | None = Field(None, description=_FIT)


class TrescaSection(_Coulomb):
    """Tresca: the shear stress is limited, whatever the pressure."""

    type: Literal["tresca"] = Field(description="Kind of yield surface.")
    strength: Pressure | None = Field(
        None, description="Shear strength: half the compressive one.", examples=["2 MPa"]
    )
    cohesion: Pressure | None = Field(None, description="Another name of the shear strength.")

    @model_validator(mode="after")
    def _one_strength(self) -> TrescaSection:
        ways = [("strength",), ("cohesion",)]
        require_one_of(self, ways, "strength is", "Give the shear strength once.")
        return self


class MohrCoulombSection(_Coulomb):
    """Mohr-Coulomb: smooth (exact in principal stresses), or by `planes`."""

    type: Literal["mohr-coulomb"] = Field(description="Kind of yield surface.")
    cohesion: Pressure = _COHESION
    friction: Angle = _FRICTION
    dilation: Angle | None = Field(
        None,
        description="Angle of dilation, from 0 to that of friction: the flow is associated if "
        "missing. Only without `planes`.",
    )


class DruckerPragerSection(Section):
    """Drucker-Prager's cone by planes, from the cohesion and friction of Mohr-Coulomb."""

    type: Literal["drucker-prager"] = Field(description="Kind of yield surface.")
    cohesion: Pressure = _COHESION
    friction: Angle = _FRICTION
    match: Literal["outer", "inner", "plane-strain"] = Field(
        "plane-strain",
        description="Where the cone meets Mohr-Coulomb: in triaxial compression (its outer edges), "
        "in extension (inner edges), or so that both carry the same in plane strain.",
    )
    tension: Pressure | None = Field(None, description=_TENSION)
    planes: Annotated[int, Count()] = Field(
        24, description="Least number of planes: from 6 on in 2-D, from 10 on in a solid."
    )
    fit: Fit | None = Field(None, description=_FIT)


class WeakPlaneSection(Section):
    """Coulomb's law on planes of one orientation, such as strata or joints.

    The planes lie by dip and dip_direction, or by their normal, as those of a
    transversely-isotropic material.
    """

    type: Literal["weak-plane"] = Field(description="Kind of yield surface.")
    dip: Angle | None = Field(
        None,
        description="Inclination of the planes, from the horizontal downwards. In 2-D without "
        "`dip_direction`: the apparent dip, falling towards +x.",
        examples=["35 deg", "$dip"],
    )
    dip_direction: Angle | None = Field(
        None, description="Azimuth of the line of dip, clockwise from north (y) in a solid."
    )
    normal: Numbers | None = Field(
        None, description="Normal of the planes in x, y, z; its length does not matter."
    )
    cohesion: Pressure = Field(description="Cohesion on the planes.", examples=["0.2 MPa"])
    friction: Angle = Field(description="Angle of friction on the planes.", examples=["25 deg"])
    tension: Pressure | None = Field(
        None, description="Largest tensile stress across the planes; cohesion / tan friction else."
    )
    planes: Annotated[int, Count()] = Field(
        16, description="Sides of the polygon in place of the circle of shear stress in a solid."
    )

    @model_validator(mode="after")
    def _one_attitude(self) -> WeakPlaneSection:
        ways = [("dip",), ("dip", "dip_direction"), ("normal",)]
        hint = "Planes that lie flat: 'dip: 0 deg'."
        require_one_of(self, ways, "dip (with dip_direction), or normal, is", hint)
        return self


YieldSection = Annotated[
    PlanesSection | TrescaSection | MohrCoulombSection | DruckerPragerSection | WeakPlaneSection,
    Field(discriminator="type"),
]


def _shape(value: Any) -> str:
    return "list" if isinstance(value, list | tuple) else "<mapping>"


YieldSections = Annotated[
    Annotated[YieldSection, Tag("<mapping>")]
    | Annotated[list[YieldSection], Field(min_length=1), Tag("list")],
    Discriminator(_shape),
]
