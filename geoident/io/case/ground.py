"""Materials of a case: one section per symmetry of the elasticity, and what it is built into."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Mapping
from typing import Annotated, Any, Literal

from pydantic import Discriminator, Field, Tag

from geoident.io.case.creep import (
    AgeingSection,
    CreepSections,
    TimeCurveSection,
    build_creep,
    sections_of_creep,
)
from geoident.io.case.frames import ATTITUDE_OR_AXES, attitude, axes_along, strata
from geoident.io.case.heat import HydrationSection
from geoident.io.case.hydraulic import HydraulicValue, build_hydraulic
from geoident.io.case.parameters import ParameterSection, numbers_at_start
from geoident.io.case.varied.number import ModulusOrVaried, YoungModulus, fields_in, growths_in
from geoident.io.case.varied.rock_mass import KEY, DerivedModulus
from geoident.io.case.yielding.sections import (
    YieldSections,
    build_yields,
    fields_of_yields,
    growths_of_yields,
)
from geoident.io.schema.section import Alternatives, Context, Section, SectionFaults, optional
from geoident.io.schema.values import (
    Angle,
    CaseNumber,
    Coefficient,
    Conductivity,
    Density,
    DirectionVector,
    Expansion,
    HeatCapacity,
    Ratio,
    SpecificHeat,
    Stress,
    scalar_of,
)
from geoident.model.case import Material
from geoident.model.ground import (
    ENTRIES,
    Anisotropic,
    Elastic,
    Isotropic,
    LoveModuli,
    Orthotropic,
    TransverselyIsotropic,
    bounded,
    breach,
)
from geoident.model.yielding import HardeningSoil

_VECTOR = "in x, y, z (z is out of plane in 2-D and may be left out); its length does not matter."


class _MaterialBase(Section):
    density: Density | None = optional(
        "Mass per volume, for gravity; 0 if missing.", examples=["2650 kg/m3"]
    )
    expansion: Expansion | None = optional(
        "Thermal expansion per degree; 0 if missing.", examples=["1e-5 1/K"]
    )
    conductivity: Conductivity | None = optional(
        "Of heat, for a structure in service and for stages that conduct it.",
        examples=["2.5 W/mK", "$k"],
    )
    heat_capacity: HeatCapacity | None = optional(
        "Heat per volume and degree.", examples=["2.2 MJ/m3K"]
    )
    specific_heat: SpecificHeat | None = optional(
        "Heat per mass and degree, in place of `heat_capacity`: times the density.",
        examples=["900 J/kgK"],
    )
    hydration: HydrationSection | None = optional(
        "Heat that the material sets free as it hardens, in stages that conduct heat.",
        examples=["{rise: 38 K, time: 1.2 d}"],
    )
    creep: CreepSections | None = optional(
        "Further strain under stress: an element, or a list of elements in a row with "
        "the elastic spring. Stages in which it comes have `lasts`. Of a structure in service one "
        "`share`: the loads are those of the stages and the water as it was day by day.",
        examples=["{share: $phi, time: 30 d}", "{share: 0.1, time: 1 d, law: logarithmic}"],
    )
    ageing: AgeingSection | None = optional(
        "The modulus grows with the age: what is loaded later strains less. In "
        "service it grows by a `share` with the time under load.",
        examples=["{code: eurocode-2, s: 0.2}", "{curve: {1 d: 12 GPa, 28 d: 30 GPa}}"],
    )
    softening: TimeCurveSection | None = optional(
        "Of a structure in service: its modulus falls, and what is loaded strains further.",
        examples=["{share: $loss, time: 10 years}"],
    )
    hydraulic: HydraulicValue | None = optional(
        "Water in its pores that takes time to leave, in stages that last; `impervious`"
        " for a material that holds none and lets none through. Without it water leaves at once.",
        examples=["{permeability: 1e-9 m/s}"],
    )
    yields: YieldSections | None = optional(
        "How it yields: one yield surface, or a list of surfaces that all hold; it "
        "stays elastic if missing. Exact surfaces need isotropic elasticity.",
        alias="yield",
    )

    def check(self, faults: SectionFaults) -> None:
        """What has a state in time goes together."""
        check_in_time(self, faults)

    @abstractmethod
    def build_elastic(self, context: Context) -> Elastic:
        """The elasticity for the model; what cannot be is noted as a fault."""


class IsotropicSection(_MaterialBase):
    """A material: isotropic elasticity by E and nu, or by K and G."""

    one_of = (Alternatives("E nu", "K G", hint="Give exactly one of the pairs."),)

    elastic: Literal["isotropic"] = Field("isotropic", description="Symmetry of the elasticity.")
    E: YoungModulus | None = optional(
        "Young's modulus; of a rock mass also by GSI (`hoek-diederichs`).",
        examples=["15 GPa", "$E_rock"],
    )
    nu: Ratio | None = optional("Poisson's ratio, between -1 and 0.5.")
    K: ModulusOrVaried | None = optional("Bulk modulus.")
    G: ModulusOrVaried | None = optional("Shear modulus.")

    def build_elastic(self, context: Context) -> Isotropic:
        """By the pair that is given."""
        return self.to_model(Isotropic)


class _InclinedBase(_MaterialBase):
    """Where the strata, or the material axes 1 and 2, lie.

    In a solid x is east, y north, z up. A plane section is seen looking north: x is east, y up.
    """

    dip: Angle | None = optional(
        "Inclination of the strata (of the plane of axes 1 and 2), from the horizontal "
        "downwards. In 2-D without `dip_direction`: the apparent dip, falling towards +x.",
        examples=["35 deg", "$dip"],
    )
    dip_direction: Angle | None = optional(
        "Azimuth of the line of dip, clockwise from north (y) in a solid: 90 deg is "
        "+x. In 2-D clockwise from the direction in which the section is seen; 90 deg (towards "
        "+x) if missing. Strata that strike obliquely to the section are refused.",
        examples=["120 deg"],
    )


class TransverselyIsotropicSection(_InclinedBase):
    """A material of strata: isotropic in their plane (p), different along their normal (n).

    By E_p, nu_p, E_n, nu_np and G_np, or by Love's moduli A, C, F, L, N, which condensation can
    identify. The strata lie by dip and dip_direction, or by their normal.
    """

    one_of = (
        Alternatives("E_p nu_p E_n nu_np G_np", "A C F L N", hint="Give all five of one set."),
        Alternatives("dip dip_direction?", "normal", hint="Horizontal strata: 'dip: 0 deg'."),
    )

    elastic: Literal["transversely-isotropic"] = Field(description="Symmetry of the elasticity.")
    normal: DirectionVector | None = optional(
        f"Normal of the strata in place of dip and dip_direction, {_VECTOR}"
    )
    E_p: ModulusOrVaried | None = optional("Young's modulus in the plane of the strata.")
    nu_p: Coefficient | None = optional("Poisson's ratio in the plane.")
    E_n: ModulusOrVaried | None = optional("Young's modulus along the normal.")
    nu_np: Coefficient | None = optional(
        "Poisson's ratio for a stress along the normal: -strain in the plane / strain "
        "along the normal; so nu_pn = nu_np E_p / E_n."
    )
    G_np: ModulusOrVaried | None = optional("Shear modulus between normal and plane.")
    A: ModulusOrVaried | None = optional("Love's A = c11 = c22, axis 3 being the normal.")
    C: ModulusOrVaried | None = optional("Love's C = c33.")
    F: Stress | None = optional("Love's F = c13 = c23.")
    L: ModulusOrVaried | None = optional("Love's L, shear modulus of normal and plane.")
    N: ModulusOrVaried | None = optional("Love's N, shear modulus in the plane.")

    def build_elastic(self, context: Context) -> TransverselyIsotropic | LoveModuli:
        """By engineering constants or Love's moduli."""
        frame = strata(context, self.dip, self.dip_direction, self.normal)
        if self.E_p is None:
            return self.to_model(LoveModuli, frame=frame)
        return self.to_model(TransverselyIsotropic, frame=frame)


class OrthotropicSection(_InclinedBase):
    """A material with three planes of symmetry, normal to its axes 1, 2, 3.

    nu_ij is -strain along j / strain along i for a stress along i; nu_ij / E_i = nu_ji / E_j.
    Axis 1 goes down the dip, 2 along the strike, 3 along the normal, upwards; `rotation` turns 1
    and 2 about 3. Or the axes are given by two vectors.
    """

    one_of = (Alternatives(*ATTITUDE_OR_AXES, hint="Axes along the model's: 'dip: 0 deg'."),)

    elastic: Literal["orthotropic"] = Field(description="Symmetry of the elasticity.")
    E_1: ModulusOrVaried = Field(description="Young's modulus along axis 1.")
    E_2: ModulusOrVaried = Field(description="Young's modulus along axis 2.")
    E_3: ModulusOrVaried = Field(description="Young's modulus along axis 3.")
    nu_12: Coefficient = Field(description="Poisson's ratio: contraction along 2, stress along 1.")
    nu_13: Coefficient = Field(description="Poisson's ratio: contraction along 3, stress along 1.")
    nu_23: Coefficient = Field(description="Poisson's ratio: contraction along 3, stress along 2.")
    G_12: ModulusOrVaried = Field(description="Shear modulus between axes 1 and 2.")
    G_13: ModulusOrVaried = Field(description="Shear modulus between axes 1 and 3.")
    G_23: ModulusOrVaried = Field(description="Shear modulus between axes 2 and 3.")
    rotation: Angle | None = optional(
        "Turns axes 1 and 2 about the normal, right-handed; 0 if missing."
    )
    axis_1: DirectionVector | None = optional(f"Axis 1 in place of the angles, {_VECTOR}")
    axis_2: DirectionVector | None = optional(f"Axis 2, at a right angle to 1, {_VECTOR}")

    def build_elastic(self, context: Context) -> Orthotropic:
        """By nine constants, and angles or axes."""
        frame = (
            attitude(context, self.dip, self.dip_direction, self.rotation)
            if self.axis_1 is None or self.axis_2 is None
            else axes_along(context, self.axis_1, self.axis_2)
        )
        return self.to_model(Orthotropic, frame=frame)


def _entry(row: str, column: str, missing: str = "") -> Any:
    """The key of one entry; it may be missing if it is said what that means."""
    text = f"Stress {row} per strain {column}"
    if column[0] != column[1]:
        text += " (gamma = 2 eps)"
    text += f"; {missing}." if missing else "."
    return Field(None, description=text) if missing else Field(description=text)


class AnisotropicSection(_MaterialBase):
    """A material without symmetry: the upper triangle of its elasticity matrix.

    Rows and columns 1 to 6 are xx, yy, zz, xy, yz, xz in the model's axes (z is out of plane in
    2-D): c44 is the shear modulus xy. Many books order the shears yz, xz, xy instead.
    """

    elastic: Literal["anisotropic"] = Field(description="Symmetry of the elasticity.")
    c11: ModulusOrVaried = _entry("xx", "xx")
    c12: Stress | None = _entry("xx", "yy", "0 if missing")
    c13: Stress | None = _entry("xx", "zz", "0 if missing")
    c14: Stress | None = _entry("xx", "xy", "0 if missing")
    c15: Stress | None = _entry("xx", "yz", "0 if missing")
    c16: Stress | None = _entry("xx", "xz", "0 if missing")
    c22: ModulusOrVaried = _entry("yy", "yy")
    c23: Stress | None = _entry("yy", "zz", "0 if missing")
    c24: Stress | None = _entry("yy", "xy", "0 if missing")
    c25: Stress | None = _entry("yy", "yz", "0 if missing")
    c26: Stress | None = _entry("yy", "xz", "0 if missing")
    c33: ModulusOrVaried = _entry("zz", "zz")
    c34: Stress | None = _entry("zz", "xy", "0 if missing")
    c35: Stress | None = _entry("zz", "yz", "0 if missing")
    c36: Stress | None = _entry("zz", "xz", "0 if missing")
    c44: ModulusOrVaried = _entry("xy", "xy")
    c45: Stress | None = _entry("xy", "yz", "0 if missing")
    c46: Stress | None = _entry("xy", "xz", "0 if missing")
    c55: ModulusOrVaried | None = _entry("yz", "yz", "needed in a solid")
    c56: Stress | None = _entry("yz", "xz", "0 if missing")
    c66: ModulusOrVaried | None = _entry("xz", "xz", "needed in a solid")

    def build_elastic(self, context: Context) -> Anisotropic:
        """By the entries that are given; a solid needs two more."""
        entries = {name: scalar_of(getattr(self, name)) for name in ENTRIES}
        for name in ("c55", "c66"):
            if context.dim == 3 and entries[name] is None:
                message = f"'{name}' is missing; a solid needs it"
                context.refuse("missing-key", message, f"Add '{name}: ...'.", key=True)
        return Anisotropic({name: scalar for name, scalar in entries.items() if scalar})


def check_in_time(material: _MaterialBase, faults: SectionFaults) -> None:
    """Creep by its own constants, in shear or volume alone, and a table of E need an E or G.

    Args:
        material: its section.
        faults: takes what is wrong.
    """
    isotropic = isinstance(material, IsotropicSection)
    moduli = (material.E, material.K, material.G) if isinstance(material, IsotropicSection) else ()
    varies = any(given is not None and given.varied_by is not None for given in moduli)
    for path, element in sections_of_creep(material.creep):
        own = next((key for key in ("kelvin", "maxwell") if getattr(element, key)), None)
        key = own or ("in" if element.part in {"shear", "volume"} else None)
        if key is not None and not isotropic:
            message = "it needs isotropic elasticity, whose shear and volume are apart"
            hint = "Give 'share' and 'time', without 'in': all strain creeps alike."
            faults.add(("creep", *path, key), "not-isotropic", message, hint)
        elif own is not None and varies:
            message = "its constants are numbers, and the modulus of the material varies"
            hint = "Give 'share' and 'time': the creep then varies with the modulus."
            faults.add(("creep", *path, own), "varied-modulus", message, hint)
    ageing = material.ageing
    if (
        ageing is not None
        and ageing.curve is not None
        and (getattr(material, "E", None) is None or varies)
    ):
        message = "a table of Young's modulus needs 'E' as one number"
        hint = "Give E and nu, or 'code: eurocode-2'."
        faults.add(("ageing", "curve"), "no-modulus", message, hint)


def elastic(value: object) -> str:
    """Discriminator of the union: the value of the key `elastic`, `isotropic` if missing.

    Messages name this function, so it is called as the key.
    """
    symmetry = value.get("elastic") if isinstance(value, dict) else getattr(value, "elastic", None)
    return symmetry if isinstance(symmetry, str) else "isotropic"


MaterialSection = Annotated[
    Annotated[IsotropicSection, Tag("isotropic")]
    | Annotated[TransverselyIsotropicSection, Tag("transversely-isotropic")]
    | Annotated[OrthotropicSection, Tag("orthotropic")]
    | Annotated[AnisotropicSection, Tag("anisotropic")],
    Discriminator(elastic),
]


def build_materials(
    sections: Mapping[str, MaterialSection],
    parameters: Mapping[str, ParameterSection],
    context: Context,
) -> dict[str, Material]:
    """The materials; what they cannot be, at the start of the parameters, is noted as a fault.

    Args:
        sections: name to section.
        parameters: the parameters of the case.
        context: of the key `materials`.
    """
    materials = {}
    for name, section in sections.items():
        place = context.at(name)
        elastic, growths = section.build_elastic(place), growths_in(section, place, material=name)
        stronger = growths_of_yields(section.yields, place.at("yield"), material=name)
        _check_start(bounded(elastic, growths), section, parameters, place)
        surfaces = build_yields(section.yields, elastic, stronger, parameters, place.at("yield"))
        materials[name] = section.to_model(
            Material,
            place,
            name=name,
            elastic=elastic,
            creep=build_creep(section.creep),
            yields=tuple(one for one in surfaces if not isinstance(one, HardeningSoil)),
            soil=next((one for one in surfaces if isinstance(one, HardeningSoil)), None),
            fields=(
                *fields_in(section, place, material=name),
                *fields_of_yields(section.yields, place.at("yield"), material=name),
            ),
            growths=(*growths, *stronger),
            hydraulic=build_hydraulic(section.hydraulic, parameters, place.at("hydraulic")),
        )
    return materials


def _check_start(
    elastic: Elastic,
    section: MaterialSection,
    parameters: Mapping[str, ParameterSection],
    context: Context,
) -> None:
    """Note a constant that is inadmissible at the start of the parameters."""
    starts = numbers_at_start(section.numbers, parameters)
    violation = None if starts is None else breach(elastic, starts)
    if violation is None:
        return
    keys, given = _written(section, violation.constant)
    ties = {n.parameter for n in section.numbers if n.parameter and n.dimension != "angle"}
    if given.parameter is not None:
        message = f"'{given.text}' is {violation.value:g} at the start; {violation.limit}"
        hint = f"Change the start of {given.parameter}."
    else:
        message = f"'{given.text}' makes the stiffness indefinite; {violation.limit}"
        hint = f"Change it, or the start of {', '.join(sorted(ties))}." if ties else ""
        if len(keys) > 1:
            message, hint = f"'{given.text}': {violation.limit}", "Correct the number."
    context.at(*keys).refuse("out-of-range", message, hint)


def _written(section: MaterialSection, constant: str) -> tuple[tuple[str, ...], CaseNumber]:
    """Where a constant is written, and its number: also one from which E follows."""
    modulus = getattr(section, "E", None)
    if isinstance(modulus, DerivedModulus) and hasattr(modulus.inner, constant):
        return ("E", KEY, constant), getattr(modulus.inner, constant)
    return (constant,), getattr(section, constant)
