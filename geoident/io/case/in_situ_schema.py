"""What a case file may say of the in-situ stress: one section per model."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field, model_validator

from geoident.io.case.values import Angle, Factor, LevelOrGroup, Pressure, UnitWeight
from geoident.io.case.words import Flag, Name
from geoident.io.schema.section import Section, Wrongs

_HELD = (
    "Whether the ground beyond the edges of the model holds the stress there in all stages; "
    "if missing: true for a stress that is the same everywhere, false if it grows with depth."
)
_SURFACE = (
    "Where depth is counted from: a level, or a group of lines (2-D) or surfaces (solid) of the "
    "mesh with topography. Beyond its footprint the level of its nearest node counts."
)


class StressSection(Section):
    """Components of a stress, tension positive; 0 if missing."""

    xx: Pressure | None = Field(None, description="Normal stress along x.")
    yy: Pressure | None = Field(None, description="Normal stress along y.")
    zz: Pressure | None = Field(None, description="Normal stress along z (out of plane in 2-D).")
    xy: Pressure | None = Field(None, description="Shear stress.")
    yz: Pressure | None = Field(None, description="Shear stress (solid only).")
    xz: Pressure | None = Field(None, description="Shear stress (solid only).")


class GradientSection(Section):
    """Change of each component per metre of depth, tension positive; 0 if missing."""

    xx: UnitWeight | None = Field(None, description="Of the normal stress along x.")
    yy: UnitWeight | None = Field(None, description="Of the normal stress along y.")
    zz: UnitWeight | None = Field(None, description="Of the normal stress along z.")
    xy: UnitWeight | None = Field(None, description="Of the shear stress.")
    yz: UnitWeight | None = Field(None, description="Of the shear stress (solid only).")
    xz: UnitWeight | None = Field(None, description="Of the shear stress (solid only).")


class ConstantModel(Section):
    """In-situ stress that is the same everywhere; tension is positive."""

    model: Literal["constant"]
    xx: Pressure = Field(description="Normal stress along x, tension positive.")
    yy: Pressure = Field(description="Normal stress along y, tension positive.")
    zz: Pressure = Field(description="Normal stress along z (out of plane in 2-D).")
    xy: Pressure | None = Field(None, description="Shear stress; 0 if missing.")
    yz: Pressure | None = Field(None, description="Shear stress (solid only); 0 if missing.")
    xz: Pressure | None = Field(None, description="Shear stress (solid only); 0 if missing.")
    held: Flag | None = Field(None, description=_HELD)


class HeimModel(Section):
    """Heim's stress: a vertical pressure, and K0 times it in every horizontal direction.

    The vertical is y in 2-D and z in a solid.
    """

    model: Literal["heim"]
    K0: Factor = Field(
        description="Ratio of horizontal to vertical stress: along x, or along `azimuth`."
    )
    K0_across: Factor | None = Field(
        None,
        description="Ratio in the other horizontal direction (out of plane in 2-D); K0 if missing.",
    )
    azimuth: Angle | None = Field(
        None,
        description="Solid: direction of K0, clockwise from north (y); along x if missing.",
        examples=["35 deg", "$azimuth"],
    )
    vertical: Pressure | None = Field(
        None, description="Vertical pressure, compression positive, the same everywhere."
    )
    unit_weight: UnitWeight | None = Field(
        None, description="Weight of the ground: the pressure grows with depth below `surface`."
    )
    surface: LevelOrGroup | None = Field(
        None, description=_SURFACE, examples=["300 m", "topography"]
    )
    tectonic: StressSection | None = Field(
        None,
        description="Horizontal stress added everywhere, tension positive: xx, zz (2-D); "
        "xx, yy, xy (solid).",
    )
    held: Flag | None = Field(None, description=_HELD)

    @model_validator(mode="after")
    def _one_way(self) -> HeimModel:
        given = [k for k in ("vertical", "unit_weight", "surface") if getattr(self, k) is not None]
        if given not in (["vertical"], ["unit_weight", "surface"]):
            wrongs = Wrongs()
            message = f"found {' and '.join(given) or 'neither'}; vertical, or unit_weight with"
            hint = "Give 'vertical' alone, or 'unit_weight' and 'surface'."
            wrongs.add((), "wrong-pair", f"{message} surface, is expected", hint)
            wrongs.raise_any()
        return self


class ProfileModel(Section):
    """A stress that changes linearly with depth: at_surface + gradient * depth."""

    model: Literal["profile"]
    surface: LevelOrGroup = Field(description=_SURFACE, examples=["300 m", "topography"])
    at_surface: StressSection = Field(
        default_factory=StressSection,
        description="Stress at the surface: with its horizontal components, the tectonic part.",
    )
    gradient: GradientSection = Field(
        default_factory=GradientSection,
        description="Change per metre of depth; yy: -26 kN/m3 is the weight of the ground in 2-D.",
    )
    held: Flag | None = Field(None, description=_HELD)


ZoneSection = Annotated[ConstantModel | HeimModel | ProfileModel, Field(discriminator="model")]

_ZONES = "Element group to a model of its own, where its stress differs (a fault zone)."


class ConstantSection(ConstantModel):
    """In-situ stress that is the same everywhere; tension is positive."""

    groups: dict[Name, ZoneSection] = Field({}, description=_ZONES)


class HeimSection(HeimModel):
    """Heim's stress: a vertical pressure, and K0 times it in every horizontal direction.

    The vertical is y in 2-D and z in a solid.
    """

    groups: dict[Name, ZoneSection] = Field({}, description=_ZONES)


class ProfileSection(ProfileModel):
    """A stress that changes linearly with depth: at_surface + gradient * depth."""

    groups: dict[Name, ZoneSection] = Field({}, description=_ZONES)


InSituSection = Annotated[
    ConstantSection | HeimSection | ProfileSection, Field(discriminator="model")
]
