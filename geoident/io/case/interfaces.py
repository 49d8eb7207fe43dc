"""Interfaces of a case: faces along which the mesh is split, with their stiffness and limits."""

from __future__ import annotations

from collections.abc import Mapping

from pydantic import Field

from geoident.io.case.parameters import ParameterSection, numbers_at_start
from geoident.io.schema.section import Alternatives, Context, Section, optional
from geoident.io.schema.values import (
    Flag,
    FrictionAngle,
    Multiple,
    Name,
    Pressure,
    WallSubgrade,
)
from geoident.model.case import Material
from geoident.model.interfaces import Interface
from geoident.model.yielding import MohrCoulomb


class InterfaceSection(Section):
    """Faces along which the two sides part and slip: a joint, a fault, a lift surface, a wall.

    The mesh is split there; what stands on either side follows from its elements, and ends inside
    the ground stay joined. An interface works while the ground of both its sides is there; a beam
    or shell on it divides it, and slips on both of its own sides. Beside
    `k_n` and `k_s`, traction per opening and per slip, it has Coulomb's limit if `friction` or
    `R_inter` is given; else it is elastic, and bears tension.
    """

    one_of = (
        Alternatives(
            "cohesion? friction dilation? tensile_strength?",
            "R_inter of dilation? tensile_strength?",
            "",
            hint="Give the limit by its own numbers, as a part of that of the ground, or none.",
        ),
    )

    along: Name = Field(
        description="Group of faces inside the mesh: lines in the plane, surfaces in a solid."
    )
    k_n: WallSubgrade = Field(
        description="Normal stiffness, traction per opening.", examples=["10 GPa/m"]
    )
    k_s: WallSubgrade = Field(
        description="Shear stiffness, traction per slip.", examples=["1 GPa/m"]
    )
    cohesion: Pressure | None = optional("Cohesion; 0 if missing.", examples=["50 kPa"])
    friction: FrictionAngle | None = optional(
        "Friction angle, from 0 to below 90 deg.", examples=["30 deg"]
    )
    R_inter: Multiple | None = optional(
        "Part of the cohesion and of tan(friction) of the material `of`, in place of "
        "`cohesion` and `friction`.",
        examples=["0.67"],
    )
    of: Name | None = optional(
        "Material whose strength `R_inter` reduces: with a Mohr-Coulomb surface, or a "
        "hardening soil.",
    )
    dilation: FrictionAngle | None = optional(
        "Dilation angle, by which slip opens it; 0 if missing."
    )
    tensile_strength: Pressure | None = optional(
        "Largest tension; 0 if missing. Not beyond cohesion / tan(friction).",
        examples=["20 kPa"],
    )
    permeable: Flag = Field(
        True,
        description="Whether water of ground that consolidates flows across it, and through a wall "
        "of beams or shells on it; false for a sheet or a wall face that holds it back.",
    )

    def interface(self, materials: Mapping[str, Material], context: Context) -> Interface | None:
        """The interface; None, with a fault, where the strength of the ground is not known."""
        if self.R_inter is None or self.of is None:
            return self.to_model(Interface, context)
        if self.of not in materials:
            context.faults.add_unknown(context.at("of").path, "material", self.of, materials)
            return None
        ground = materials[self.of]
        surface = next((s for s in ground.yields if isinstance(s, MohrCoulomb)), ground.soil)
        varied = any(one.surface is not None for one in ground.fields)
        varied = varied or any(one.surface is not None for one in ground.growths)
        if surface is None or varied:
            what = "varies from place to place" if varied else "has no Mohr-Coulomb surface"
            message = f"the strength of '{self.of}' {what}, so 'R_inter' has nothing to reduce"
            hint = "Give 'cohesion' and 'friction' of the interface."
            context.at("of").refuse("wrong-material", message, hint)
            return None
        return self.to_model(
            Interface, context, cohesion=surface.cohesion, friction=surface.friction
        )


def build_interfaces(
    sections: Mapping[str, InterfaceSection],
    materials: Mapping[str, Material],
    parameters: Mapping[str, ParameterSection],
    context: Context,
) -> dict[str, Interface]:
    """The interfaces of a case by name; those with a fault are left out.

    Args:
        sections: name to section.
        materials: of the ground, whose strength some reduce.
        parameters: of the case, whose starts the numbers must bear.
        context: of the key `interfaces`.
    """
    made: dict[str, Interface] = {}
    groups: dict[str, str] = {}
    for name, section in sections.items():
        place = context.at(name)
        other = groups.setdefault(section.along, name)
        if other != name:
            message = f"the interface '{other}' is along '{section.along}' already"
            place.at("along").refuse("duplicate", message, "Name another group, or remove one.")
        given = section.interface(materials, place)
        starts = numbers_at_start(section.numbers, parameters)
        breach = None if given is None or starts is None else given.breach(starts)
        if breach is not None:
            hint = "Correct the number or its unit, or the start of its parameter."
            place.refuse("out-of-range", breach, hint)
        elif given is not None:
            made[name] = given
    return made
