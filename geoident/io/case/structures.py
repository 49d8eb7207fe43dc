"""Structural parts of a case, and what they are built into: linings as beams, bolts as bars.

An opening in closed form has supports of its own, which press on its wall all round.
"""

from __future__ import annotations

import math
from types import MappingProxyType
from typing import Annotated, ClassVar, Literal

from pydantic import Field

from geoident.io.case.creep import AgeingSection
from geoident.io.case.frames import refuse_no_direction
from geoident.io.schema.section import Alternatives, Context, Section, SectionFaults, optional
from geoident.io.schema.values import (
    Area,
    AxialStiffness,
    BendingStiffness,
    CaseNumber,
    Coordinates,
    Count,
    Density,
    DirectionVector,
    FixedPressure,
    FixedSize,
    FixedStrength,
    Flag,
    FlexuralRigidity,
    Force,
    Line,
    Modulus,
    Multiple,
    Name,
    OrFile,
    Pressure,
    Ratio,
    Size,
    TextOrList,
    Time,
    WallMoment,
    WallStiffness,
    WallSubgrade,
)
from geoident.model.case import Analysis
from geoident.model.structures import (
    Anchors,
    Bars,
    Beam,
    BoltPattern,
    Bolts,
    GroutedBars,
    Piles,
    Ribs,
    Ring,
    SectionLimits,
    Shell,
    Struts,
    SupportLine,
)

Hinge = TextOrList[Name, Coordinates]


class BeamYieldSection(Section):
    """What the section of a beam bears before it yields: it keeps that force and moment then.

    Either limits of the axial force and the bending moment, or the strengths of a rectangular
    section, with the thickness of the beam. Plastic strain follows the normal of the surface in N
    and M (associated flow), and a beam that is unloaded is elastic again.
    """

    one_of = (
        Alternatives(
            "N M? interaction?", "M", "compressive_strength tensile_strength?",
            hint="Give N, M or both, or the strengths of the rectangular section.",
        ),
    )  # fmt: skip

    N: WallStiffness | None = optional(
        "Limit of the axial force per metre, pull and push alike; none if missing.",
        examples=["2 MN/m"],
    )
    M: WallMoment | None = optional(
        "Limit of the bending moment per metre, both ways alike; none if missing.",
        examples=["150 kNm/m"],
    )
    interaction: Literal["section", "linear", "none"] | None = optional(
        "How N and M use up the section together: `section`, |M|/M_p + (N/N_p)^2 <= 1, "
        "of a rectangle alike in tension and compression, which is taken if missing; `linear`, "
        "|M|/M_p + |N|/N_p <= 1; `none`, each by itself."
    )
    compressive_strength: Modulus | None = optional(
        "Compressive strength of the rectangular section.", examples=["20 MPa"]
    )
    tensile_strength: Pressure | None = optional(
        "Tensile strength beside it; 0 if missing: then N must press where M bends.",
        examples=["2 MPa"],
    )

    def check(self, faults: SectionFaults) -> None:
        """An interaction needs both limits."""
        if self.interaction is not None and self.M is None:
            message = "'interaction' without a limit of M"
            faults.add(("interaction",), "missing-key", message, "Add 'M: 150 kNm/m', or drop it.")

    def for_model(self, context: Context) -> SectionLimits:
        """The limits."""
        return self.to_model(SectionLimits, context)


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
    E: Modulus | None = optional("Young's modulus.")
    thickness: Size | None = optional("Thickness.", examples=["0.2 m"])
    nu: Ratio | None = optional(
        "Poisson's ratio: E / (1 - nu^2) is taken; E itself if missing. Of a shell of "
        "revolution a number, no parameter."
    )
    EA: WallStiffness | None = optional(
        "Axial stiffness per metre out of plane, in place of E and thickness."
    )
    EI: BendingStiffness | None = optional("Bending stiffness per metre out of plane, with EA.")
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
    density: Density | None = optional("Density, with the thickness; its weight acts with gravity.")
    weight: Pressure | None = optional(
        "Weight of a square metre of it, in place of the density.", examples=["8 kN/m2"]
    )
    compressive_strength: FixedStrength | None = optional(
        "Compressive strength of its rectangular section, with the thickness: results "
        "then say which part of the strength N and M use together. Divide it by the safety factors "
        "that are to be kept.",
        examples=["20 MPa"],
    )
    tensile_strength: FixedPressure | None = optional(
        "Tensile strength beside `compressive_strength`: 0 if missing, as of plain "
        "sprayed concrete; what fibres bear in the crack; of steel that in compression.",
        examples=["0.8 MPa"],
    )
    limits: BeamYieldSection | None = optional(
        "What its section bears before it yields, as hinges do; it is elastic if "
        "missing. Not of shells of revolution.",
        alias="yield",
        examples=["{N: 2 MN/m, M: 150 kNm/m}"],
    )
    ageing: AgeingSection | None = optional(
        "Its stiffness grows since it was built, as that of sprayed concrete. Stages "
        "in which it stands have `lasts`.",
        examples=["{code: eurocode-2, s: 0.2}"],
    )

    def check(self, faults: SectionFaults) -> None:
        """Its weight is given in one way; its strength has a section."""
        _check_strengths(self, faults)
        if self.compressive_strength is not None and self.thickness is None:
            message = "'compressive_strength' without a thickness, which makes the section"
            hint = "Give E and thickness in place of EA and EI, or leave the strength out."
            faults.add(("compressive_strength",), "missing-key", message, hint)
        if self.limits is not None and self.limits.compressive_strength and not self.thickness:
            message = "strengths of a section without a thickness, which makes the section"
            hint = "Give E and thickness in place of EA and EI, or limits of N and M."
            faults.add(("yield",), "missing-key", message, hint)
        if self.ageing is not None and self.ageing.curve is not None and self.E is None:
            message = "a table of Young's modulus needs 'E'"
            faults.add(("ageing", "curve"), "no-modulus", message, "Give E and thickness.")
        if self.density is not None and (self.weight is not None or self.thickness is None):
            other = "no thickness" if self.thickness is None else "weight"
            message = f"found density and {other}; expected density with a thickness, or weight"
            faults.add((), "wrong-pair", message, "Give its weight in one of these ways.")

    def for_model(self, context: Context) -> Beam:
        """A lining or wall, in the plane or about an axis."""
        if context.analysis is Analysis.SOLID:
            message = "beams in solid analysis; they are available in plane-strain or axisymmetric "
            message += "analysis only"
            hint = "On a group of faces a solid has 'kind: shell', with E, thickness, nu and axis."
            context.at("kind").refuse("wrong-analysis", message, hint)
        if context.analysis is Analysis.AXISYMMETRIC and self.limits is not None:
            message = "yield limits of a shell of revolution; they are available in plane-strain "
            message += "analysis only"
            hint = "Leave them out; 'compressive_strength' says how far its strength is used."
            context.at("yield").refuse("wrong-analysis", message, hint, key=True)
        if context.analysis is Analysis.AXISYMMETRIC and self.nu and self.nu.parameter:
            message = "nu of a shell of revolution couples its meridian and hoops; it cannot be a "
            message += "parameter"
            hint = "Write the number itself; E and thickness may be parameters."
            context.at("nu").refuse("bad-tie", message, hint)
        return self.to_model(Beam, context, group=self.on)


class ShellSection(Section):
    """A lining, slab or wall of a solid: a shell on faces of the mesh, joined to their nodes.

    It bears in its plane and bends, without strain of shear (Kirchhoff and Love). Folds are rigid,
    shells that meet are joined rigidly, and edges turn freely where they are not clamped. Forces
    are per metre: n_11, n_22, n_12 and moments m_11, m_22, m_12, with axis 1 along `axis`, axis 2
    across it, and moments positive with tension on the inside, the side without ground. Changes of
    temperature do not strain it.
    """

    not_here = MappingProxyType(
        {
            "yield": "Shells are elastic. With 'compressive_strength' results say which part of "
            "the strength n and m use; a lining that yields is made of elements.",
            "hinges": "Shells have no hinges: folds and joints are rigid, edges turn freely.",
            "EA": "Give E, nu and thickness: EA per metre is E times the thickness.",
            "EI": "Give E, nu and thickness: a plate bends with E t^3 / (12 (1 - nu^2)).",
        }
    )

    kind: Literal["shell"]
    on: Name = Field(description="Group of faces of the mesh on which it is built.")
    E: Modulus = Field(description="Young's modulus.")
    thickness: Size = Field(description="Thickness.", examples=["0.3 m"])
    nu: Ratio = Field(description="Poisson's ratio.")
    axis: DirectionVector = Field(
        description="Direction of axis 1 of its forces, projected on the faces: along a tunnel or "
        "a wall. It is at right angles to none of them.",
        examples=[["0", "1", "0"]],
    )
    clamped_on: list[Name] = Field(
        [], description="Groups on whose nodes the shell does not turn: abutments."
    )
    mirrored_on: list[Name] = Field(
        [],
        description="Groups on planes of symmetry that cross the shell: at their nodes it turns "
        "about the normal of the plane only. The planes are at right angles to x, y or z.",
    )
    density: Density | None = optional("Density; its weight acts with gravity.")
    weight: Pressure | None = optional(
        "Weight of a square metre of it, in place of the density.", examples=["8 kN/m2"]
    )
    compressive_strength: FixedStrength | None = optional(
        "Compressive strength of its rectangular section: results then say which part "
        "of the strength n and m use together, along axis 1, along axis 2 and in the direction in "
        "which it is most. Divide it by the safety factors that are to be kept.",
        examples=["20 MPa"],
    )
    tensile_strength: FixedPressure | None = optional(
        "Tensile strength beside `compressive_strength`: 0 if missing, as of plain "
        "concrete; what fibres bear in the crack, or bars by the thickness.",
        examples=["0.8 MPa"],
    )
    ageing: AgeingSection | None = optional(
        "Its stiffness grows since it was built, as that of sprayed concrete. Stages "
        "in which it stands have `lasts`.",
        examples=["{code: eurocode-2, s: 0.2}"],
    )

    def check(self, faults: SectionFaults) -> None:
        """Its axis has a direction; its strengths go together; it weighs once."""
        refuse_no_direction("axis", self.axis, faults)
        _check_strengths(self, faults)
        if self.density is not None and self.weight is not None:
            message = "found density and weight; expected one of them"
            faults.add((), "wrong-pair", message, "Give its weight in one of these ways.")

    def for_model(self, context: Context) -> Shell:
        """The shell; a section has beams."""
        if context.analysis is not Analysis.SOLID:
            message = f"shells in {context.analysis.value} analysis; they are available in solids"
            hint = "A section has 'kind: beam', with the thickness and nu of the shell."
            context.at("kind").refuse("wrong-analysis", message, hint)
        axis = context.at("axis").vector(self.axis)
        return self.to_model(Shell, context, group=self.on, axis=axis)


def _check_strengths(section: BeamSection | ShellSection, faults: SectionFaults) -> None:
    if section.tensile_strength is not None and section.compressive_strength is None:
        message = "'tensile_strength' without 'compressive_strength'"
        hint = "Give both: N and M are held against them together."
        faults.add(("tensile_strength",), "missing-key", message, hint)


class _BarSection(Section):
    """A kind of bars: bolts, piles, struts or anchors, with the keys that all have in common."""

    what: ClassVar[str]
    """What one of them is."""
    builds: ClassVar[type[Bars]]
    one_of = (
        Alternatives("E diameter", "E area", "EA", hint="Give the stiffness in one of these ways."),
    )

    ends: Annotated[list[Line], OrFile()] = Field(
        min_length=1,
        description="The two end points of every bar, or the name of a CSV file that has a row for "
        "each: `x1 [m], y1 [m], x2 [m], y2 [m]`. With a column `structure` one file serves several "
        "structures.",
        examples=[[["[3, 0 m]", "[7, 0 m]"]]],
    )
    spacing: Size | None = optional(
        "Distance between bars: out of plane in plane strain; about an axis along the "
        "circumference through their first ends."
    )
    number: Multiple | None = optional(
        "Axisymmetric: number of bars around the axis, in place of the spacing."
    )
    E: Modulus | None = optional("Young's modulus.")
    diameter: Size | None = optional("Diameter of the bar.", examples=["25 mm"])
    area: Area | None = optional(
        "Area of its section, in place of the diameter.", examples=["600 mm2"]
    )
    EA: AxialStiffness | None = optional("Axial stiffness of one bar, in place of E and diameter.")
    capacity: AxialStiffness | None = optional(
        "Force of one bar at which it yields, pull and push alike: it keeps it then. "
        "It is elastic if missing.",
        examples=["250 kN"],
    )

    def check(self, faults: SectionFaults) -> None:
        """The bars have a length."""
        for n, length in enumerate(self._lengths()):
            if length == 0.0:
                message = f"the {self.what} begins and ends at one point"
                faults.add(("ends", n, 1), "zero-length", message, "Let its ends differ.")

    def _lengths(self) -> list[float]:
        """Of each bar, m; infinite where its ends have not the same number of coordinates."""
        ends = [[[x.factor for x in point] for point in pair] for pair in self.ends]
        return [math.dist(*pair) if len(pair[0]) == len(pair[1]) else math.inf for pair in ends]

    def _require_rest(self, part: CaseNumber, is_so: str, rest: str, faults: SectionFaults) -> None:
        """A bar of which a part is free, or grouted, is longer than that."""
        for n, length in enumerate(self._lengths()):
            if 0.0 < length <= part.factor:
                message = f"the {self.what} is {length:.6g} m long, of which '{part.text}' are "
                message += f"{is_so}: no {rest} length is left"
                hint = "Give head and toe, in this order, or a shorter part."
                faults.add(("ends", n), "zero-length", message, hint)

    def for_model(self, context: Context) -> Bars:
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
        return self._built(context)

    def _built(self, context: Context) -> Bars:
        return self.to_model(self.builds, context)

    def _check_ring(self, context: Context) -> None:
        """Bars about an axis: how many there are, and where."""
        if (self.spacing is None) == (self.number is None):
            which = "neither" if self.spacing is None else "both"
            message = f"found {which}; expected either number or spacing of the {self.what}s "
            message += "around the axis"
            hint = (
                f"Add 'number: 12', the {self.what}s of one ring (1 of one on the axis), or their "
            )
            hint += "'spacing: 1.5 m' along the circumference."
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


class _StressedBarSection(_BarSection):
    """A kind of bars that jacks stress: bolts, struts or anchors, with the keys of all of them."""

    prestress: Force | None = optional(
        "Force to which one bar is stressed at the stage that builds it: a pull, of a "
        "strut the push of its jack. It is held during that stage and locked off at its end.",
        examples=["300 kN"],
    )

    def check(self, faults: SectionFaults) -> None:
        """The bars are pulled or pushed by a positive force that they can bear."""
        if self.prestress is not None and (fault := beyond_capacity(self.prestress, self.capacity)):
            faults.add(("prestress",), "out-of-range", *fault)
        super().check(faults)
        if self.prestress is not None and (fault := negative_force(self.prestress)):
            faults.add(("prestress",), "out-of-range", *fault)


def beyond_capacity(force: CaseNumber, capacity: CaseNumber | None) -> tuple[str, str] | None:
    """What is wrong with a prestress beyond a capacity, where neither is a parameter."""
    if capacity is None or force.parameter is not None or capacity.parameter is not None:
        return None
    if force.factor <= capacity.factor:
        return None
    return (
        f"'{force.text}' is beyond the capacity '{capacity.text}' of the bar, which yields there",
        "Stress it less, or correct its capacity.",
    )


def negative_force(given: CaseNumber) -> tuple[str, str] | None:
    """What is wrong with a prestress that is no parameter, and the remedy; None if nothing is."""
    if given.parameter is not None or given.factor >= 0:
        return None
    return (
        f"'{given.text}' is negative",
        "Give the force of the jack: bolts and anchors are pulled by it, struts are pushed apart.",
    )


_HEAD = (
    "`joined`, the head moves with the ground where it lies, as by a plate or where a lining is "
    "built; `free`, nothing but a load holds it. `joined` if missing."
)
_PIECES = (
    "Into how many pieces the grouted length of each bar is divided; 40 if missing. A piece is "
    "much shorter than sqrt(EA / k), on which the force of a long bar decays."
)
Pieces = Annotated[int, Count(2, 1000)]


class BoltSection(_StressedBarSection):
    """Rock bolts: bars that hold the ground at their two ends, wherever these lie in the mesh.

    With `k_grout` grout ties them to the ground along their length, with a stiffness and a
    strength: they slip where the bond is used up.
    """

    what, builds = "bolt", Bolts

    kind: Literal["bolt"]
    k_grout: Modulus | None = optional(
        "Stiffness of the grout: force per length of one bar and per slip of it "
        "against the ground. Without it the bar is held at its ends only.",
        examples=["500 MPa"],
    )
    bond: WallStiffness | None = optional(
        "Strength of the grout: force per length of one bar at which it slips. It "
        "never does if missing.",
        examples=["150 kN/m"],
    )
    free: FixedSize | None = optional(
        "Length from the head that touches nothing; none if missing. A grouted bolt "
        "that is stressed has one.",
        examples=["0.5 m"],
    )
    head: Literal["joined", "free"] | None = optional(_HEAD)
    pieces: Pieces | None = optional(_PIECES)

    def check(self, faults: SectionFaults) -> None:
        """What grout has needs grout; a free length leaves a part of the bar, and has a plate."""
        super().check(faults)
        if self.k_grout is None:
            for key in ("bond", "free", "head", "pieces"):
                if getattr(self, key) is not None:
                    message = f"'{key}' without 'k_grout', the stiffness of the grout"
                    hint = "Add 'k_grout: 500 MPa', or leave it out: held at its ends only."
                    faults.add((key,), "missing-key", message, hint)
            return
        if self.prestress is not None and (fault := unstressed(self)):
            faults.add(("prestress",), "wrong-structure", *fault)
        if self.free is None:
            return
        if self.head == "free":
            message = "'free' of a bolt whose head is free: a length that bears nothing"
            faults.add(("free",), "wrong-pair", message, "Leave it out, or let 'head: joined'.")
        self._require_rest(self.free, "free", "grouted", faults)

    def _built(self, context: Context) -> Bars:
        return self.to_model(Bolts if self.k_grout is None else GroutedBars, context)


def unstressed(section: BoltSection) -> tuple[str, str] | None:
    """Why no jack can stress bolts, and the remedy; None where one can."""
    if section.k_grout is None or section.free is not None:
        return None
    message = "the bolt is grouted from its head on: a jack has no free length to stretch"
    return message, "Add 'free: 0.5 m', from the plate to the grout."


class PileSection(_BarSection):
    """Piles: bars that the ground holds along their shafts and presses on at their toes.

    The first of the ends is the head. The toe is never pulled. With `k_lateral` the ground holds
    them across themselves, too, and they bend (plane strain and solids); without it nothing does.
    """

    what, builds = "pile", Piles

    kind: Literal["pile"]
    k_shaft: Modulus = Field(
        description="Stiffness of the shaft: force per length of one pile and per slip of it "
        "against the ground.",
        examples=["60 MPa"],
    )
    skin_friction: WallStiffness | None = optional(
        "Strength of the shaft: force per length of one pile at which it slips. It "
        "never does if missing.",
        examples=["120 kN/m"],
    )
    k_base: WallStiffness | None = optional(
        "Stiffness of the toe: force per motion of it into the ground there; nothing "
        "presses on it if missing.",
        examples=["50 MN/m"],
    )
    base_capacity: AxialStiffness | None = optional(
        "Force at which the toe sinks in; it never does if missing.", examples=["800 kN"]
    )
    k_lateral: Modulus | None = optional(
        "Stiffness of the ground beside it: force per length of one pile and per "
        "motion across it against the ground.",
        examples=["40 MPa"],
    )
    lateral_resistance: WallStiffness | None = optional(
        "Force per length of one pile at which the ground beside it yields; it never "
        "does if missing.",
        examples=["180 kN/m"],
    )
    EI: FlexuralRigidity | None = optional(
        "Bending stiffness of one pile, with `k_lateral`; that of a full round section "
        "by E and diameter if missing."
    )
    head: Literal["joined", "free", "clamped"] | None = optional(
        f"{_HEAD} `clamped`, joined and turned by nothing, as in a stiff slab; only of "
        "piles that bend."
    )
    pieces: Pieces | None = optional(_PIECES)

    def check(self, faults: SectionFaults) -> None:
        """What a toe bears needs a toe, what bends a stiffness."""
        super().check(faults)
        if self.k_lateral is None:
            bent = [key for key in ("lateral_resistance", "EI") if getattr(self, key) is not None]
            for key in bent + ["head"] * (self.head == "clamped"):
                what = "head: clamped" if key == "head" else key
                message = f"'{what}' without 'k_lateral', the stiffness of the ground beside a pile"
                faults.add((key,), "missing-key", message, "Add 'k_lateral: 40 MPa'.")
        elif self.EI is None and (self.E is None or self.diameter is None):
            message = "'EI' is missing: the stiffness of a pile that 'k_lateral' bends"
            faults.add((), "missing-key", message, "Add 'EI: 250 MNm2', or give E and diameter.")
        if self.base_capacity is not None and self.k_base is None:
            message = "'base_capacity' without 'k_base', the stiffness of the toe"
            faults.add(("base_capacity",), "missing-key", message, "Add 'k_base: 50 MN/m'.")

    def _built(self, context: Context) -> Bars:
        if self.k_lateral is not None and context.analysis is Analysis.AXISYMMETRIC:
            message = "bending of piles in axisymmetric analysis; it is available in plane strain "
            message += "and solids"
            hint = "Remove it: the axis of a pile at x = 0 stays straight."
            context.at("k_lateral").refuse("wrong-analysis", message, hint, key=True)
        bond = None if self.skin_friction is None else self.skin_friction.scalar
        return self.to_model(Piles, context, k_grout=self.k_shaft.scalar, bond=bond)


UNSTRESSED_PILE = (
    "piles are not stressed by jacks",
    "Load the heads by a load '{on: PILES, push: 500 kN}', or use 'kind: anchor'.",
)


class StrutSection(_StressedBarSection):
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
    compression_only: Flag = Field(
        False,
        description="The strut is wedged in and does not pull: where its ends part, a gap opens, "
        "which closes before it presses again. A jack (`prestress`) closes it. It pulls as it "
        "presses, as one that is welded or bolted, if missing.",
    )


class AnchorSection(_StressedBarSection):
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
        self._require_rest(self.grouted, "grouted", "free", faults)


class OpeningSupportSection(Section):
    """A support of an opening in closed form: it presses on the wall as this moves inwards."""

    instead: ClassVar[str]
    """What to write in a case with a mesh."""


class RingSection(OpeningSupportSection):
    """A closed ring of shotcrete or concrete around the opening of a case without mesh.

    It is a thick ring (Lame; Hoek & Brown 1980): with R its outer and b its inner radius it presses
    by E (R^2 - b^2) / ((1 + nu) R ((1 - 2 nu) R^2 + b^2)) per motion of the wall, and by
    strength (1 - b^2 / R^2) / 2 at most.
    """

    one_of = (
        Alternatives(
            "", "hardening_time", "hardening_distance", hint="Let it harden in one of these ways."
        ),
    )
    builds = Ring
    instead = "kind: beam, on: LINES, E: 15 GPa, nu: 0.2, thickness: 0.2 m"

    kind: Literal["ring"]
    E: Modulus = Field(
        description="Young's modulus; where it hardens that of old concrete.", examples=["25 GPa"]
    )
    thickness: Size = Field(description="Thickness.", examples=["0.2 m"])
    nu: Ratio | None = optional("Poisson's ratio; 0.2 if missing.")
    strength: Modulus | None = optional(
        "Uniaxial compressive strength; without it the ring carries all.", examples=["25 MPa"]
    )
    hardening_time: Time | None = optional(
        "T: stiffness and strength have grown to 1 - exp(-t / T) at the age t. Needs "
        "`dates` of the stages.",
        examples=["3 day"],
    )
    hardening_distance: Size | None = optional(
        "The same by the way of the face since the ring was built, in place of the "
        "time; needs a `distance` of the stages.",
        examples=["6 m"],
    )


class RibsSection(OpeningSupportSection):
    """Closed steel sets around the opening of a case without mesh, in contact all round.

    They press by E area / (spacing R^2) per motion of the wall, and by strength area / (spacing R)
    at most.
    """

    builds = Ribs
    instead = "kind: beam, on: LINES, EA: 1 GN/m, EI: 1 MNm2/m"

    kind: Literal["ribs"]
    E: Modulus = Field(description="Young's modulus.", examples=["210 GPa"])
    area: Area = Field(description="Area of the section of one rib.", examples=["54 cm2"])
    spacing: Size = Field(description="Distance of the ribs along the opening.", examples=["1 m"])
    strength: Modulus | None = optional(
        "Yield strength; without it they carry all.", examples=["355 MPa"]
    )


class BoltPatternSection(OpeningSupportSection):
    """Bolts all around the opening of a case without mesh, held at head and end (not grouted).

    They press by 1 / (spacing rows (4 length / (pi diameter^2 E) + 1 / head_stiffness)) per motion
    of the wall, and by capacity / (spacing rows) at most (Hoek & Brown 1980). Grouted bolts
    strengthen the ground: give it that strength.
    """

    builds = BoltPattern
    instead = "kind: bolt, ends: [[HEAD, END], ..], spacing: 1.5 m, E: 210 GPa, diameter: 25 mm"

    kind: Literal["bolting"]
    E: Modulus = Field(description="Young's modulus.", examples=["210 GPa"])
    diameter: Size = Field(description="Diameter of a bolt.", examples=["25 mm"])
    length: Size = Field(description="Free length of a bolt.", examples=["4 m"])
    spacing: Size = Field(description="Distance of the bolts around the wall.", examples=["1.5 m"])
    rows: Size | None = optional("Distance of the rows along the opening; the spacing if missing.")
    capacity: AxialStiffness | None = optional(
        "Force that one bolt with head and end carries; all if missing.", examples=["200 kN"]
    )
    head_stiffness: WallStiffness | None = optional(
        "Force per displacement of head and end in a pull-out test, beside the bar; "
        "rigid if missing.",
        examples=["7 MN/m"],
    )


class SupportLineSection(OpeningSupportSection):
    """A support of which only the line is known, of the opening of a case without mesh."""

    builds = SupportLine
    instead = "kind: beam, on: LINES, E: 15 GPa, nu: 0.2, thickness: 0.2 m"

    kind: Literal["support-line"]
    stiffness: WallSubgrade = Field(
        description="Pressure on the wall per motion of the wall inwards.", examples=["80 MPa/m"]
    )
    capacity: Modulus | None = optional(
        "Largest pressure; no limit if missing.", examples=["0.6 MPa"]
    )


StructureSection = Annotated[
    BeamSection
    | ShellSection
    | BoltSection
    | PileSection
    | StrutSection
    | AnchorSection
    | RingSection
    | RibsSection
    | BoltPatternSection
    | SupportLineSection,
    Field(discriminator="kind"),
]
