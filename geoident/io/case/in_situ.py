"""The in-situ stress of a case: one section per model, and what it is built into."""

from __future__ import annotations

from typing import Annotated, Any, Literal

from pydantic import Field

from geoident.io.schema.section import Alternatives, Context, Section, SectionFaults, optional
from geoident.io.schema.values import (
    Angle,
    CaseNumber,
    Coefficient,
    Flag,
    LevelOrGroup,
    Name,
    Stress,
    TextOrMapping,
    UnitWeight,
    scalar_of,
)
from geoident.model.in_situ import (
    Components,
    ConstantStress,
    GeostaticStress,
    HeimStress,
    InSitu,
    ProfileStress,
)
from geoident.model.parameter import Scalar

_NAMES = ("xx", "yy", "zz", "xy", "yz", "xz")
_OUT_OF_PLANE = ("yz", "xz")
_HORIZONTAL = {2: ("xx", "zz"), 3: ("xx", "yy", "xy")}

_HELD = (
    "Whether the ground beyond the edges of the model holds the stress there in all stages; "
    "if missing: true for a stress that is the same everywhere, false if it grows with depth."
)
_SURFACE = (
    "Where depth is counted from: a level, or a group of lines (2-D) or surfaces (solid) of the "
    "mesh with topography. Beyond its footprint the level of its nearest node counts."
)


_EQUILIBRIUM = (
    "`accept` accepts that weight and in-situ stress do not agree: a stress that grows "
    "with depth without gravity, or by more than 2 % another unit weight than density times "
    "gravity, or a virgin state out of balance somewhere by more than 1 % of the local stress "
    "(slopes with K0 times the weight above always are). An elastic step then brings it to "
    "equilibrium, and a note says so; with `required` it is an error."
)


RatioByGroup = TextOrMapping[Coefficient, dict[Name, Coefficient]]
"""One number, or element group to number."""

Equilibrium = Literal["required", "accept"]


_ACROSS: Any = optional(
    "Ratio in the other horizontal direction (out of plane in 2-D); K0 if missing."
)
_AZIMUTH: Any = optional(
    "Solid: direction of K0, clockwise from north (y); along x if missing.",
    examples=["35 deg", "$azimuth"],
)
_TECTONIC: Any = optional(
    "Horizontal stress added everywhere, tension positive: xx, zz (2-D); xx, yy, xy (solid)."
)


def _components(section: Section, context: Context) -> Components:
    """The six components; those that a plane model does not have are faults."""
    if context.dim == 2:
        for name in _OUT_OF_PLANE:
            if getattr(section, name, None) is not None:
                message = f"a plane model has no stress {name}"
                context.at(name).refuse("wrong-dimension", message, "Remove it.", key=True)
    xx, yy, zz, xy, yz, xz = (
        scalar_of(getattr(section, name, None)) or Scalar(0.0) for name in _NAMES
    )
    return xx, yy, zz, xy, yz, xz


class TectonicSection(Section):
    """Horizontal components of a stress, tension positive; 0 if missing."""

    xx: Stress | None = optional("Normal stress along x.")
    yy: Stress | None = optional("Normal stress along y (solid only).")
    zz: Stress | None = optional("Normal stress out of plane (2-D only).")
    xy: Stress | None = optional("Shear stress (solid only).")

    def for_model(self, context: Context) -> Components:
        """Only horizontal components."""
        horizontal = _HORIZONTAL[context.dim]
        for name in type(self).model_fields:
            if name not in horizontal and getattr(self, name) is not None:
                message = f"{name} is not horizontal; {', '.join(horizontal)} are"
                hint = "Use 'model: profile' for stresses of any direction."
                context.at(name).refuse("wrong-dimension", message, hint, key=True)
        return _components(self, context)


class StressSection(Section):
    """Components of a stress, tension positive; 0 if missing."""

    xx: Stress | None = optional("Normal stress along x.")
    yy: Stress | None = optional("Normal stress along y.")
    zz: Stress | None = optional("Normal stress along z (out of plane in 2-D).")
    xy: Stress | None = optional("Shear stress.")
    yz: Stress | None = optional("Shear stress (solid only).")
    xz: Stress | None = optional("Shear stress (solid only).")

    def for_model(self, context: Context) -> Components:
        """The six components."""
        return _components(self, context)


class GradientSection(Section):
    """Change of each component per metre of depth, tension positive; 0 if missing."""

    xx: UnitWeight | None = optional("Of the normal stress along x.")
    yy: UnitWeight | None = optional("Of the normal stress along y.")
    zz: UnitWeight | None = optional("Of the normal stress along z.")
    xy: UnitWeight | None = optional("Of the shear stress.")
    yz: UnitWeight | None = optional("Of the shear stress (solid only).")
    xz: UnitWeight | None = optional("Of the shear stress (solid only).")

    def for_model(self, context: Context) -> Components:
        """The six components."""
        return _components(self, context)


class ConstantModel(Section):
    """In-situ stress that is the same everywhere; tension is positive."""

    model: Literal["constant"]
    xx: Stress = Field(description="Normal stress along x, tension positive.")
    yy: Stress = Field(description="Normal stress along y, tension positive.")
    zz: Stress = Field(description="Normal stress along z (out of plane in 2-D).")
    xy: Stress | None = optional("Shear stress; 0 if missing.")
    yz: Stress | None = optional("Shear stress (solid only); 0 if missing.")
    xz: Stress | None = optional("Shear stress (solid only); 0 if missing.")
    held: Flag | None = optional(_HELD)

    def for_model(self, context: Context) -> ConstantStress:
        """The same everywhere."""
        return self.to_model(ConstantStress, context, components=_components(self, context))


def _refuse_azimuth(azimuth: CaseNumber | None, context: Context) -> None:
    """A plane model has none."""
    if context.dim == 2 and azimuth is not None:
        message = "a plane model has no azimuth"
        hint = "K0 acts along x, K0_across out of plane."
        context.at("azimuth").refuse("wrong-dimension", message, hint, key=True)


class HeimModel(Section):
    """Heim's stress: a vertical pressure, and K0 times it in every horizontal direction.

    The vertical is y in 2-D and z in a solid.
    """

    one_of = (
        Alternatives(
            "vertical",
            "unit_weight surface",
            hint="Give 'vertical' alone, or 'unit_weight' and 'surface'.",
        ),
    )

    model: Literal["heim"]
    K0: Coefficient = Field(
        description="Ratio of horizontal to vertical stress: along x, or along `azimuth`."
    )
    K0_across: Coefficient | None = _ACROSS
    azimuth: Angle | None = _AZIMUTH
    vertical: Stress | None = optional(
        "Vertical pressure, compression positive, the same everywhere."
    )
    unit_weight: UnitWeight | None = optional(
        "Weight of the ground: the pressure grows with depth below `surface`."
    )
    surface: LevelOrGroup | None = optional(_SURFACE, examples=["300 m", "topography"])
    tectonic: TectonicSection | None = _TECTONIC
    held: Flag | None = optional(_HELD)

    def for_model(self, context: Context) -> HeimStress:
        """Vertical, and horizontal in parts of it."""
        _refuse_azimuth(self.azimuth, context)
        return self.to_model(HeimStress, context)


class ProfileModel(Section):
    """A stress that changes linearly with depth: at_surface + gradient * depth."""

    builds = ProfileStress

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
    held: Flag | None = optional(_HELD)


class GeostaticModel(Section):
    """The weight of the layers above from their densities, and K0 times it horizontally.

    The vertical is y in 2-D and z in a solid. The weight of all ground above a point counts, along
    the vertical through the elements, with the loads that act on it from the beginning. Where there
    is water in the pores, the stress is effective: the weight above less the pressure of the water.
    """

    model: Literal["geostatic"]
    K0: RatioByGroup | None = optional(
        "Ratio of horizontal to vertical (effective) stress, along x or along "
        "`azimuth`: one number, or one for each element group. Hardening soil for which it is "
        "missing has that of its `K0nc`, `OCR` and `POP`.",
        examples=["0.5", {"clay": 0.6, "sand": 0.45}],
    )
    K0_across: RatioByGroup | None = _ACROSS
    azimuth: Angle | None = _AZIMUTH
    surface: LevelOrGroup | None = optional(
        "Surface of the ground: a level, or a group of lines (2-D) or surfaces (solid)"
        "; the top of the mesh if missing. Where it lies above the top of the mesh, `cover` gives "
        "its unit weight.",
        examples=["300 m", "topography"],
    )
    cover: UnitWeight | None = optional(
        "Unit weight of the ground between the top of the mesh and `surface`; it lies "
        "on the ground until that is excavated."
    )
    surcharge: Stress | None = optional(
        "Pressure on the surface, compression positive; it lies on the ground until "
        "that is excavated. Give here or as a load what acts from the beginning, not both."
    )
    tectonic: TectonicSection | None = _TECTONIC
    held: Flag | None = optional(_HELD)

    def check(self, faults: SectionFaults) -> None:
        """A cover reaches up to a surface."""
        if self.cover is not None and self.surface is None:
            message = "'cover' without 'surface': how thick it is is not known"
            faults.add(("cover",), "wrong-pair", message, "Add 'surface', a level or a group.")

    def for_model(self, context: Context) -> GeostaticStress:
        """The weight above, and parts of it."""
        _refuse_azimuth(self.azimuth, context)
        return self.to_model(GeostaticStress, context)


ZoneSection = Annotated[
    ConstantModel | HeimModel | ProfileModel | GeostaticModel, Field(discriminator="model")
]


class _WholeGround(Section):
    groups: dict[Name, ZoneSection] = Field(
        {},
        description="Element group to a model of its own, where its stress differs (a fault zone).",
    )
    equilibrium: Equilibrium = Field("required", description=_EQUILIBRIUM)


class ConstantSection(_WholeGround, ConstantModel):  # noqa: D101 - it is that of the model, below
    __doc__ = ConstantModel.__doc__


class HeimSection(_WholeGround, HeimModel):  # noqa: D101 - it is that of the model, below
    __doc__ = HeimModel.__doc__


class ProfileSection(_WholeGround, ProfileModel):  # noqa: D101 - it is that of the model, below
    __doc__ = ProfileModel.__doc__


class GeostaticSection(_WholeGround, GeostaticModel):  # noqa: D101 - it is that of the model, below
    __doc__ = GeostaticModel.__doc__


InSituSection = Annotated[
    ConstantSection | HeimSection | ProfileSection | GeostaticSection, Field(discriminator="model")
]


def build_in_situ(
    section: InSituSection | None, context: Context
) -> tuple[InSitu | None, dict[str, InSitu]]:
    """The in-situ stress, and that of groups of their own.

    Args:
        section: what stands under the key `in_situ`.
        context: of this key.
    """
    if section is None:
        return None, {}
    zones = {
        name: zone.for_model(context.at("groups", name)) for name, zone in section.groups.items()
    }
    return section.for_model(context), zones
