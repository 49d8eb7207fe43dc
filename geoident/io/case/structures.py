"""Structural parts of a case, and what they are built into: linings as beams, bolts as bars."""

from __future__ import annotations

import math
from typing import Annotated, ClassVar, Literal

from pydantic import Field

from geoident.io.schema.section import Alternatives, Context, Section, SectionFaults
from geoident.io.schema.values import (
    Area,
    AxialStiffness,
    BendingStiffness,
    CaseNumber,
    Coordinates,
    Density,
    FixedSize,
    FixedStrength,
    FixedStress,
    Force,
    Line,
    Modulus,
    Multiple,
    Name,
    Ratio,
    Size,
    Stress,
    TextOrList,
    WallStiffness,
)
from geoident.model.case import Analysis
from geoident.model.structures import Anchors, Beam, Bolts, Struts

Hinge = TextOrList[Name, Coordinates]


class BeamSection(Section):
    """A lining or wall as a chain of beams on lines of the mesh, joined to its nodes.

    About an axis it is a thin shell of revolution, with hoop forces. Corners are rigid, its ends
    turn freely where they are not clamped, and two structures that meet are joined by a hinge.
    Forces are per metre out of plane or of circumference. Changes of temperature do not strain it.
    """

    one_of = (
        Alternatives("E thickness nu?", "EA EI", hint="Give the stiffness in one of these ways."),
    )

    kind: Literal["beam"]
    on: Name = Field(description="Group of lines of the mesh on which it is built.")
    E: Modulus | None = Field(None, description="Young's modulus.")
    thickness: Size | None = Field(None, description="Thickness.", examples=["0.2 m"])
    nu: Ratio | None = Field(
        None,
        description="Poisson's ratio: E / (1 - nu^2) is taken; E itself if missing. Of a shell of "
        "revolution a number, no parameter.",
    )
    EA: WallStiffness | None = Field(
        None, description="Axial stiffness per metre out of plane, in place of E and thickness."
    )
    EI: BendingStiffness | None = Field(
        None, description="Bending stiffness per metre out of plane, with EA."
    )
    clamped_on: list[Name] = Field(
        [],
        description="Groups on whose nodes the beam does not turn: planes of symmetry, abutments.",
    )
    hinges: list[Hinge] = Field(
        [],
        description="Where its pieces turn freely against each other: points at nodes of the beam, "
        "or groups of the mesh.",
        examples=[["[3 m, -2 m]"]],
    )
    density: Density | None = Field(
        None, description="Density, with the thickness; its weight acts with gravity."
    )
    weight: Stress | None = Field(
        None,
        description="Weight of a square metre of it, in place of the density.",
        examples=["8 kN/m2"],
    )
    compressive_strength: FixedStrength | None = Field(
        None,
        description="Compressive strength of its rectangular section, with the thickness: results "
        "then say which part of the strength N and M use together. Divide it by the safety factors "
        "that are to be kept.",
        examples=["20 MPa"],
    )
    tensile_strength: FixedStress | None = Field(
        None,
        description="Tensile strength beside `compressive_strength`: 0 if missing, as of plain "
        "sprayed concrete; what fibres bear in the crack; of steel that in compression.",
        examples=["0.8 MPa"],
    )

    def check(self, faults: SectionFaults) -> None:
        """Its weight is given in one way and not negative; its strength has a section."""
        if self.tensile_strength is not None and self.compressive_strength is None:
            message = "'tensile_strength' without 'compressive_strength'"
            hint = "Give both: N and M are held against them together."
            faults.add(("tensile_strength",), "missing-key", message, hint)
        elif self.compressive_strength is not None and self.thickness is None:
            message = "'compressive_strength' without a thickness, which makes the section"
            hint = "Give E and thickness in place of EA and EI, or leave the strength out."
            faults.add(("compressive_strength",), "missing-key", message, hint)
        if self.tensile_strength is not None and self.tensile_strength.factor < 0:
            message = f"'{self.tensile_strength.text}' is negative"
            faults.add(("tensile_strength",), "out-of-range", message, "Drop the -.")
        if self.density is not None and (self.weight is not None or self.thickness is None):
            other = "no thickness" if self.thickness is None else "weight"
            message = f"found density and {other}; expected density with a thickness, or weight"
            faults.add((), "wrong-pair", message, "Give its weight in one of these ways.")
        for key in ("density", "weight"):
            given: CaseNumber | None = getattr(self, key)
            if given is not None and given.parameter is None and given.factor < 0:
                message = f"'{given.text}' is negative"
                faults.add((key,), "out-of-range", message, "Weight acts with gravity: drop the -.")

    def for_model(self, context: Context) -> Beam:
        """A lining or wall, in the plane or about an axis."""
        if context.analysis is Analysis.SOLID:
            _refuse("beams", "plane-strain or axisymmetric", context)
        if context.analysis is Analysis.AXISYMMETRIC and self.nu and self.nu.parameter:
            message = "nu of a shell of revolution couples its meridian and hoops; it cannot be a "
            message += "parameter"
            hint = "Write the number itself; E and thickness may be parameters."
            context.at("nu").refuse("bad-tie", message, hint)
        return self.to_model(Beam, context, group=self.on)


class _BarSection(Section):
    """A kind of bars: bolts, struts or anchors, with the keys that all have in common."""

    what: ClassVar[str]
    """What one of them is."""
    builds: ClassVar[type[Bolts | Struts | Anchors]]
    one_of = (
        Alternatives("E diameter", "E area", "EA", hint="Give the stiffness in one of these ways."),
    )

    ends: list[Line] = Field(
        min_length=1,
        description="The two end points of every bar.",
        examples=[[["[3, 0 m]", "[7, 0 m]"]]],
    )
    spacing: Size | None = Field(
        None,
        description="Distance between bars: out of plane in plane strain; about an axis along the "
        "circumference through their first ends.",
    )
    number: Multiple | None = Field(
        None, description="Axisymmetric: number of bars around the axis, in place of the spacing."
    )
    E: Modulus | None = Field(None, description="Young's modulus.")
    diameter: Size | None = Field(None, description="Diameter of the bar.", examples=["25 mm"])
    area: Area | None = Field(
        None, description="Area of its section, in place of the diameter.", examples=["600 mm2"]
    )
    EA: AxialStiffness | None = Field(
        None, description="Axial stiffness of one bar, in place of E and diameter."
    )
    prestress: Force | None = Field(
        None,
        description="Force to which one bar is stressed at the stage that builds it: a pull, of a "
        "strut the push of its jack. It is held during that stage and locked off at its end.",
        examples=["300 kN"],
    )

    def check(self, faults: SectionFaults) -> None:
        """The bars have a length, and are pulled or pushed by a positive force."""
        for n, (first, second) in enumerate(self.ends):
            if _place(first) == _place(second):
                message = f"the {self.what} begins and ends at one point"
                faults.add(("ends", n, 1), "zero-length", message, "Let its ends differ.")
        if self.prestress is not None and (fault := negative_force(self.prestress)):
            faults.add(("prestress",), "out-of-range", *fault)

    def for_model(self, context: Context) -> Bolts | Struts | Anchors:
        """The bars; about an axis they are smeared over their ring."""
        if context.analysis is Analysis.AXISYMMETRIC:
            self._check_ring(context)
        elif self.number is not None:
            message = f"'number' in {context.analysis.value} analysis, which has no axis"
            hint = "Give the 'spacing' out of plane." if context.dim == 2 else "Remove it."
            context.at("number").refuse("wrong-analysis", message, hint, key=True)
        if context.analysis is Analysis.PLANE_STRAIN and self.spacing is None:
            message = f"'spacing' is missing: the distance between {self.what}s out of plane"
            context.refuse("missing-key", message, "Add 'spacing: 1.5 m'.", key=True)
        elif context.analysis is Analysis.SOLID and self.spacing is not None:
            message = f"'spacing' in a solid, where every {self.what} is modelled by itself"
            hint = f"Remove it, and list all {self.what}s under 'ends'."
            context.at("spacing").refuse("wrong-dimension", message, hint, key=True)
        return self.to_model(self.builds, context)

    def _check_ring(self, context: Context) -> None:
        """Bars about an axis: how many there are, and where."""
        if (self.spacing is None) == (self.number is None):
            which = "neither" if self.spacing is None else "both"
            message = f"found {which}; expected either number or spacing of the {self.what}s "
            message += "around the axis"
            hint = f"Add 'number: 12', the {self.what}s of one ring, or their 'spacing: 1.5 m' "
            hint += "along the circumference."
            context.refuse("wrong-pair", message, hint, key=True)
        for n, pair in enumerate(self.ends):
            for k, point in enumerate(pair):
                place = context.at("ends", n, k)
                if point[0].factor < 0:
                    message = f"the end lies at the negative radius {point[0].text}"
                    hint = "Give the bar in the half x >= 0; the others of its ring follow."
                    place.refuse("negative-radius", message, hint)
                elif k == 0 and point[0].factor == 0 and self.spacing is not None:
                    message = "the first end lies on the axis, where bars have no spacing"
                    place.refuse("zero-length", message, "Give their 'number'.")


def negative_force(given: CaseNumber) -> tuple[str, str] | None:
    """What is wrong with a prestress that is no parameter, and the remedy; None if nothing is."""
    if given.parameter is not None or given.factor >= 0:
        return None
    return (
        f"'{given.text}' is negative",
        "Give the force of the jack: bolts and anchors are pulled by it, struts are pushed apart.",
    )


class BoltSection(_BarSection):
    """Rock bolts: bars that hold the ground at their two ends, wherever these lie in the mesh."""

    what, builds = "bolt", Bolts

    kind: Literal["bolt"]


class StrutSection(_BarSection):
    """Struts and props: bars from a point of the mesh to what they are propped against.

    That is another point of the mesh, a fixed place, or the plane of symmetry of the model: there
    half of the strut ends.
    """

    what, builds = "strut", Struts

    kind: Literal["strut"]
    second_end: Literal["joined", "fixed", "symmetry"] = Field(
        "joined",
        description="What holds the second end: `joined`, the mesh at that point; `fixed`, a place "
        "that does not move; `symmetry`, the plane of symmetry of the model on which the middle of "
        "the whole strut lies (give EA of the strut: half its length follows from the ends).",
    )


class AnchorSection(_BarSection):
    """Ground anchors from a head to a toe: free up to the grout, held by the ground along it."""

    what, builds = "anchor", Anchors

    kind: Literal["anchor"]
    grouted: FixedSize = Field(
        description="Length at the second end, the toe, along which grout ties the bar to the "
        "ground; before it the bar is free.",
        examples=["6 m"],
    )

    def check(self, faults: SectionFaults) -> None:
        """Before the grout is a free length."""
        super().check(faults)
        for n, (head, toe) in enumerate(self.ends):
            length = math.dist(_place(head), _place(toe)) if len(head) == len(toe) else math.inf
            if 0.0 < length <= self.grouted.factor:
                message = f"the anchor is {length:.6g} m long, of which '{self.grouted.text}' are "
                message += "grouted: no free length is left"
                hint = "Give head and toe, and the grouted length at the toe."
                faults.add(("ends", n), "zero-length", message, hint)


def _place(point: list[CaseNumber]) -> list[float]:
    return [coordinate.factor for coordinate in point]


def _refuse(what: str, where: str, context: Context) -> None:
    message = (
        f"{what} in {context.analysis.value} analysis; they are available in {where} analysis only"
    )
    hint = "Model it by elements: a group with a material, placed by 'install'."
    context.at("kind").refuse("wrong-analysis", message, hint)


StructureSection = Annotated[
    BeamSection | BoltSection | StrutSection | AnchorSection, Field(discriminator="kind")
]
