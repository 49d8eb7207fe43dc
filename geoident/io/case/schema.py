"""What a case file may hold: the keys, their types, defaults and descriptions.

This is the code that validates, and the JSON schema is generated from it. What takes more than one
section to judge (names that refer to each other, the sequence of stages) is in `case_references`
and `case_sequence`.
"""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import AfterValidator, Discriminator, Field, Tag, model_validator

from geoident.io.case.action_schema import LoadSection, TemperatureSection, WaterSection
from geoident.io.case.fit import FitSection
from geoident.io.case.in_situ_schema import InSituSection
from geoident.io.case.material_schema import MaterialSection
from geoident.io.case.parameters import ParameterSection
from geoident.io.case.structure_schema import StructureSection
from geoident.io.case.values import (
    Acceleration,
    Accelerations,
    Accuracy,
    Drift,
    Factor,
    Line,
    Numbers,
    Offset,
    Point,
    shape_of,
)
from geoident.io.case.words import Flag, Name, ParameterName, Text
from geoident.io.readings.schema import BadSection, Date, Readings
from geoident.io.schema.section import Section, Wrongs
from geoident.io.text.wording import Refusal
from geoident.model.case import VIRGIN


def _not_reserved(value: str) -> str:
    if value == VIRGIN:
        message = f"'{VIRGIN}' is the name of the state before the first stage"
        raise Refusal("reserved-name", message, "Give the stage another name.")
    return value


class MeshSection(Section):
    """The finite element mesh."""

    file: Text = Field(
        description="Path of the mesh, relative to the case. Groups go by their physical names."
    )


class StageSection(Section):
    """One step of construction: all that it says happens together, before the readings."""

    name: Annotated[Name, AfterValidator(_not_reserved)] = Field(
        description="Unique name, to which readings refer."
    )
    excavate: list[Name] = Field([], description="Element groups that leave.")
    install: dict[Name, Name] = Field(
        {},
        description="Element group to material: enters free of stress (lift, lining, backfill); "
        "a group that is present is replaced.",
    )
    change: dict[Name, Name] = Field(
        {}, description="Element group to material: the material changes, the stress stays."
    )
    release: dict[Name, Factor] = Field(
        {},
        description="Element group to the part of its stress, 0 to 1, that is released so far: of "
        "a group that this stage excavates, or that an earlier one excavated with part of it. The "
        "rest goes on supporting the ground until a later stage releases more "
        "(convergence-confinement).",
        examples=[{"heading": 0.4}],
    )
    loads: dict[Name, LoadSection] = Field(
        {}, description="Loads by name, from this stage on; a name used again replaces."
    )
    remove: list[Name] = Field([], description="Names of loads that end with this stage.")
    build: list[Name] = Field(
        [],
        description="Names of `structures` (linings, bolts) that stand from this stage on. They "
        "enter free of stress and bear part of what moves the ground from this stage on.",
        examples=[["lining"]],
    )
    dismantle: list[Name] = Field(
        [], description="Names of structures that leave; the ground takes over what they bore."
    )
    water: WaterSection | None = Field(
        None, description="Water in the pores from this stage on; as before if missing."
    )
    temperature: dict[Name, TemperatureSection] = Field(
        {},
        description="Element group to change of temperature since the virgin state (or since it "
        "was installed), from this stage on; needs the `expansion` of its material.",
        examples=[{"dam": "-8 K"}],
    )
    independent: Flag = Field(
        False,
        description="A load case on its own: it builds on the last stage before it that is not "
        "independent (or on `base`), and nothing builds on it that does not name it. Gauges read "
        "the motion since their zero all the same.",
    )
    base: Name | None = Field(
        None, description="Earlier stage, or 'virgin', on which this one builds."
    )


class _Gauge(Section):
    accuracy: Accuracy = Field(
        description="Standard deviation of one reading.", examples=["0.1 mm"]
    )
    zero: Name = Field(
        VIRGIN, description=f"Stage at whose end the gauge reads zero, or '{VIRGIN}'."
    )
    offset: Offset | None = Field(
        None,
        description="Added to all readings after the zero: a misread zero, a head that slipped.",
        examples=["$off1"],
    )
    drift: Drift | None = Field(
        None,
        description="What the gauge gains by itself in time since its zero; needs dates.",
        examples=["$drift1"],
    )
    drift_per_stage: Offset | None = Field(
        None, description="What the gauge gains by itself in every stage since its zero."
    )

    @model_validator(mode="after")
    def _one_drift(self) -> _Gauge:
        if self.drift is not None and self.drift_per_stage is not None:
            wrongs = Wrongs()
            message = "found drift and drift_per_stage; one of them is expected"
            wrongs.add((), "wrong-pair", message, "Give exactly one of them.")
            wrongs.raise_any()
        return self


class ExtensometerSection(_Gauge):
    """Change of distance between a head and anchors, positive when they move apart.

    One channel per anchor, named GAUGE.ANCHOR.
    """

    kind: Literal["extensometer"]
    head: Point = Field(description="Coordinates of the head.")
    anchors: dict[Name, Point] = Field(min_length=1, description="Name to coordinates.")


class ConvergenceSection(_Gauge):
    """Change of distance between two points, positive when they move apart."""

    kind: Literal["convergence"]
    between: Line = Field(description="The two points.")


Reference = Annotated[
    Annotated[Literal["ground"], Tag("text")] | Annotated[Point, Tag("list")],
    Discriminator(shape_of),
]


class DisplacementSection(_Gauge):
    """Displacement of a point in a direction, relative to the ground or to another point."""

    kind: Literal["displacement"]
    point: Point = Field(description="The point whose motion is read.")
    relative_to: Reference = Field("ground", description="A point, or fixed ground.")
    component: Literal["x", "y", "z"] | None = Field(None, description="Coordinate direction.")
    direction: Numbers | None = Field(
        None, description="Direction vector in place of a component; its length does not matter."
    )

    @model_validator(mode="after")
    def _one_direction(self) -> DisplacementSection:
        wrongs = Wrongs()
        if (self.component is None) == (self.direction is None):
            found = "neither" if self.component is None else "both"
            message = f"found {found}; either component or direction is expected"
            wrongs.add((), "wrong-pair", message, "Give exactly one of them.")
        if self.direction is not None and not any(x.factor for x in self.direction):
            wrongs.add(("direction",), "zero-direction", "the direction has length zero")
        wrongs.raise_any()
        return self


class SettlementSection(_Gauge):
    """Settlement of a point, positive downwards, relative to the ground or to another point."""

    kind: Literal["settlement"]
    point: Point = Field(description="The point whose settlement is read.")
    relative_to: Reference = Field("ground", description="A point, or fixed ground.")


GaugeSection = Annotated[
    ExtensometerSection | ConvergenceSection | DisplacementSection | SettlementSection,
    Field(discriminator="kind"),
]
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
        {}, description="What is identified; elsewhere $NAME stands for it."
    )
    materials: dict[Name, MaterialSection] = Field(min_length=1, description="Materials by name.")
    groups: dict[Name, Name] = Field(
        min_length=1,
        description="Element group to material in the virgin state, or 'absent'.",
    )
    supports: dict[Name, SupportValue] = Field(
        {}, description="Group to fixed directions: x, [x, y], or fixed for all."
    )
    in_situ: InSituSection | None = Field(None, description="Stress of the virgin ground.")
    water: WaterSection | None = Field(None, description="Water in the pores of the virgin ground.")
    gravity: Gravity | None = Field(
        None,
        description="Acceleration, downwards (-y in 2-D, -z in a solid), or a vector.",
        examples=["9.81 m/s2"],
    )
    loads: dict[Name, LoadSection] = Field({}, description="Loads that act from the beginning.")
    structures: dict[Name, StructureSection] = Field(
        {}, description="Linings and rock bolts by name; a stage says when it builds them."
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
