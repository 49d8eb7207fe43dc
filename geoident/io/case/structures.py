"""Structural parts of a case, and what they are built into: linings as beams, bolts as bars."""

from __future__ import annotations

from abc import abstractmethod
from typing import Annotated, Literal

from pydantic import Field, model_validator

from geoident.io.schema.section import Context, Section, SectionFaults, refuse
from geoident.io.schema.values import (
    AxialStiffness,
    BendingStiffness,
    Given,
    Line,
    Modulus,
    Name,
    Ratio,
    Size,
    WallStiffness,
    scalar_of,
)
from geoident.model.case import Analysis
from geoident.model.structures import Beam, Bolts, Structure


class _StructureBase(Section):
    @abstractmethod
    def structure(self, context: Context) -> Structure:
        """The structure for the model; a fault where the kind of analysis has none."""

    def _require_one_of(self, *ways: tuple[str, ...]) -> None:
        """Exactly the keys of one of the ways to say the stiffness."""
        keys = sorted({key for way in ways for key in way})
        given = [key for key in keys if getattr(self, key) is not None]
        if any(sorted(way) == given for way in ways):
            return
        expected = ", or ".join(" and ".join(way) for way in ways)
        message = f"found {' and '.join(given) or 'no stiffness'}; {expected} is expected"
        refuse((), "wrong-pair", message, "Give the stiffness in one of these ways.")


class BeamSection(_StructureBase):
    """A lining as a chain of beams on lines of the mesh (plane strain), joined to its nodes.

    Corners are rigid, its ends turn freely where they are not clamped, and two structures that
    meet are joined by a hinge. Forces are per metre out of plane. It has no weight, and changes of
    temperature do not strain it.
    """

    kind: Literal["beam"]
    on: Name = Field(description="Group of lines of the mesh on which it is built.")
    E: Modulus | None = Field(None, description="Young's modulus.")
    thickness: Size | None = Field(None, description="Thickness.", examples=["0.2 m"])
    nu: Ratio | None = Field(
        None, description="Poisson's ratio: E / (1 - nu^2) is taken; E itself if missing."
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

    @model_validator(mode="after")
    def _one_way(self) -> BeamSection:
        self._require_one_of(("E", "thickness"), ("E", "thickness", "nu"), ("EA", "EI"))
        return self

    def structure(self, context: Context) -> Beam:
        """A lining, in plane strain."""
        if context.analysis is not Analysis.PLANE_STRAIN:
            _refuse("beams", "plane-strain", context)
        return Beam(
            self.on,
            E=scalar_of(self.E),
            thickness=scalar_of(self.thickness),
            nu=scalar_of(self.nu),
            EA=scalar_of(self.EA),
            EI=scalar_of(self.EI),
            clamped_on=tuple(self.clamped_on),
        )


class BoltSection(_StructureBase):
    """Rock bolts: bars that hold the ground at their two ends, wherever these lie in the mesh."""

    kind: Literal["bolt"]
    ends: list[Line] = Field(
        min_length=1,
        description="The two end points of every bolt.",
        examples=[[["[3, 0 m]", "[7, 0 m]"]]],
    )
    spacing: Size | None = Field(
        None, description="Distance between bolts out of plane; needed in plane strain only."
    )
    E: Modulus | None = Field(None, description="Young's modulus.")
    diameter: Size | None = Field(None, description="Diameter of the bar.", examples=["25 mm"])
    EA: AxialStiffness | None = Field(
        None, description="Axial stiffness of one bolt, in place of E and diameter."
    )

    @model_validator(mode="after")
    def _one_way(self) -> BoltSection:
        self._require_one_of(("E", "diameter"), ("EA",))
        faults = SectionFaults()
        for n, (first, second) in enumerate(self.ends):
            if _place(first) == _place(second):
                message = "the bolt begins and ends at one point"
                faults.add(("ends", n, 1), "zero-length", message, "Let its ends differ.")
        faults.raise_any()
        return self

    def structure(self, context: Context) -> Bolts:
        """Bolts, in plane strain or a solid."""
        self._check_spacing(context)
        ends = []
        for n, pair in enumerate(self.ends):
            first, second = (
                context.at("ends", n, k).vector(point, "the end") or ()
                for k, point in enumerate(pair)
            )
            ends.append((first, second))
        spacing, E, diameter = map(scalar_of, (self.spacing, self.E, self.diameter))
        return Bolts(tuple(ends), spacing, E, diameter, scalar_of(self.EA))

    def _check_spacing(self, context: Context) -> None:
        if context.analysis is Analysis.AXISYMMETRIC:
            _refuse("bolts", "plane-strain or solid", context)
        elif context.analysis is Analysis.PLANE_STRAIN and self.spacing is None:
            message = "'spacing' is missing: the distance between bolts out of plane"
            context.refuse("missing-key", message, "Add 'spacing: 1.5 m'.", key=True)
        elif context.analysis is Analysis.SOLID and self.spacing is not None:
            message = "'spacing' in a solid, where every bolt is modelled by itself"
            hint = "Remove it, and list all bolts under 'ends'."
            context.at("spacing").refuse("wrong-dimension", message, hint, key=True)


def _place(point: list[Given]) -> list[float]:
    return [coordinate.factor for coordinate in point]


def _refuse(what: str, where: str, context: Context) -> None:
    message = (
        f"{what} in {context.analysis.value} analysis; they are available in {where} analysis only"
    )
    hint = "Model it by elements: a group with a material, placed by 'install'."
    context.at("kind").refuse("wrong-analysis", message, hint)


StructureSection = Annotated[BeamSection | BoltSection, Field(discriminator="kind")]
