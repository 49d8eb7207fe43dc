"""A case file as a whole: what it may hold, and the case that it is built into.

This is the code that validates, and the JSON schema is generated from it. Every key has its module
here, with its section and what this is built into. What takes more than one section to judge (names
that refer to each other, the sequence of stages) is in `references` and `stages`.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Annotated, Literal

from pydantic import Discriminator, Field, Tag

from geoident.io.case.actions import LoadSection, WaterSection, build_loads
from geoident.io.case.fit import FitSection
from geoident.io.case.gauges import GaugeSection, build_channels
from geoident.io.case.ground import MaterialSection, build_materials
from geoident.io.case.in_situ import InSituSection, build_in_situ
from geoident.io.case.parameters import ParameterSection
from geoident.io.case.readings import BadSection, Date, Readings
from geoident.io.case.stages import ABSENT, StageSection
from geoident.io.case.structures import StructureSection
from geoident.io.schema.section import Context, Section
from geoident.io.schema.values import (
    Acceleration,
    Accelerations,
    Name,
    ParameterName,
    Text,
    shape_of,
)
from geoident.io.text.faults import Faults
from geoident.model.case import Analysis, Case, Material, Support

_AXES = "xyz"


class MeshSection(Section):
    """The finite element mesh."""

    file: Text = Field(
        description="Path of the mesh, relative to the case. Groups go by their physical names."
    )


Component = Literal["x", "y", "z"]
SupportValue = Annotated[
    Annotated[Literal["x", "y", "z", "fixed"], Tag("text")]
    | Annotated[list[Component], Field(min_length=1), Tag("list")],
    Discriminator(shape_of),
]
Gravity = Annotated[
    Annotated[Acceleration, Tag("text")] | Annotated[Accelerations, Tag("list")],
    Discriminator(shape_of),
]


class CaseSection(Section):
    """A project for geoident: ground, construction, gauges and what is to be identified."""

    format: Literal["geoident-case/1"] = Field(description="Type and version of this file.")
    title: Text = Field("", description="Free text.")
    analysis: Literal["plane-strain", "axisymmetric", "solid"] = Field(
        description="Kind of analysis. Axisymmetric: the mesh is half a section, x is the radius "
        "(>= 0), y the axis; the stresses xx, yy, zz, xy are radial, axial, hoop and shear rz."
    )
    mesh: MeshSection | None = Field(
        None,
        description="The finite element mesh. Without it the case is a circular opening that "
        "`fit.closed-form` gives, computed by formulas: all that the stages excavate.",
    )
    parameters: dict[ParameterName, ParameterSection] = Field(
        {}, description="What is identified; $NAME refers to it elsewhere in the case."
    )
    materials: dict[Name, MaterialSection] = Field(min_length=1, description="Materials by name.")
    groups: dict[Name, Name] = Field(
        min_length=1,
        description="Element group to its material in the initial state (before the first stage), "
        "or 'absent'.",
    )
    supports: dict[Name, SupportValue] = Field(
        {}, description="Group to fixed directions: x, [x, y], or fixed for all."
    )
    in_situ: InSituSection | None = Field(
        None, description="In-situ stress of the ground, before the first stage."
    )
    water: WaterSection | None = Field(None, description="Water in the pores in the initial state.")
    gravity: Gravity | None = Field(
        None,
        description="Acceleration, downwards (-y in 2-D, -z in a solid), or a vector.",
        examples=["9.81 m/s2"],
    )
    loads: dict[Name, LoadSection] = Field({}, description="Loads that act from the beginning.")
    structures: dict[Name, StructureSection] = Field(
        {},
        description="Walls, linings, struts, anchors and bolts by name; a stage says when it "
        "builds them.",
    )
    stages: list[StageSection] = Field([], description="Construction, step by step.")
    gauges: dict[Name, GaugeSection] = Field({}, description="Gauges by name.")
    dates: dict[Name, Date] = Field(
        {},
        description="Stage (or 'virgin') to the date of its end, for dated readings and drift.",
        examples=[{"heading": "2024-03-01", "bench 1": "2024-04-15"}],
    )
    readings: Readings | None = Field(
        None,
        description="Path of a CSV file (gauge,stage,value,unit), a description of a file, or a "
        "list of files and readings.",
    )
    bad: list[BadSection] = Field(
        [], description="Readings known to be wrong: shown with the reason, and not used."
    )
    fit: FitSection = Field(default_factory=FitSection)


def build_case(section: CaseSection, faults: Faults) -> Case:
    """The case in SI units, without mesh and readings; what does not fit its axes is a fault."""
    context = Context((), Analysis(section.analysis), faults)
    gravity = section.gravity is not None
    in_situ, zones = build_in_situ(section.in_situ, context.at("in_situ"))
    materials = build_materials(section.materials, section.parameters, context.at("materials"))
    structures = {
        name: part.structure(context.at("structures", name))
        for name, part in section.structures.items()
    }
    return Case(
        title=section.title,
        analysis=context.analysis,
        mesh_file=None,
        parameters=tuple(p.parameter(name) for name, p in section.parameters.items()),
        materials=materials,
        groups={group: None if m == ABSENT else m for group, m in section.groups.items()},
        supports=_supports(section.supports, context.at("supports")),
        in_situ=in_situ,
        gravity=_gravity(section.gravity, context.at("gravity")),
        loads=build_loads(section.loads, context.at("loads"), gravity=gravity),
        stages=tuple(
            stage.stage(context.at("stages", n), gravity=gravity)
            for n, stage in enumerate(section.stages)
        ),
        channels=build_channels(section.gauges, structures, context.at("gauges")),
        readings=(),
        fit=section.fit.settings(strengths=_seek_strengths(materials)),
        source=faults.places.source(),
        in_situ_of=zones,
        imbalance_accepted=section.in_situ is not None and section.in_situ.equilibrium == "accept",
        water=None if section.water is None else section.water.water(),
        structures=structures,
    )


def _supports(values: Mapping[str, SupportValue], context: Context) -> tuple[Support, ...]:
    supports = []
    for group, value in values.items():
        names = _AXES[: context.dim] if value == "fixed" else value
        components = tuple(sorted({_AXES.index(name) for name in names}))
        if components[-1] >= context.dim:
            message = "a plane model has no direction z"
            context.at(group).refuse("wrong-dimension", message, "Use x and y.")
        supports.append(Support(group, components))
    return tuple(supports)


def _gravity(given: Gravity | None, context: Context) -> tuple[float, ...] | None:
    if given is None:
        return None
    if isinstance(given, list):
        return context.vector(given, "gravity")
    if given.factor < 0:
        hint = "A single value points downwards by itself; write it positive, or as a vector."
        context.refuse("out-of-range", f"'{given.text}' is negative", hint)
    return (*(0.0,) * (context.dim - 1), -given.factor)


def _seek_strengths(materials: Mapping[str, Material]) -> bool:
    """Whether strengths of yield limits are parameters."""
    return any(
        number.parameter is not None
        for material in materials.values()
        for surface in material.yields
        for number in surface.numbers
    )
