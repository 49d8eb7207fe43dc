"""Supports: groups and nodes that are held, or moved by what is given."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Annotated, Literal

from pydantic import Discriminator, Field, Tag

from geoident.io.schema.section import Context, Section, SectionFaults, optional
from geoident.io.schema.values import (
    TEXT_LIST_OR_MAPPING,
    CaseNumber,
    Coefficient,
    Coordinates,
    FixedLength,
    Length,
    SharesUnit,
    Text,
)
from geoident.model.actions import Contraction, MotionField
from geoident.model.case import Analysis, Support

FIXED, FREE = "fixed", "free"
_AXES = ("x", "y", "z")


def _word(value: object) -> str:
    return "word" if value == FIXED else "length"


Component = Literal["x", "y", "z"]
GivenMotion = Annotated[
    Annotated[Literal["fixed"], Tag("word")] | Annotated[Length, Tag("length")],
    Discriminator(_word),
]
MotionLengths = Annotated[list[FixedLength], SharesUnit()]


class MeasuredMotionSection(Section):
    """Motions that were measured at points: linear between them, over all nodes of the support."""

    points: list[Coordinates] | None = optional("Coordinates of the points.")
    x: MotionLengths | None = optional("Motion along x at each point.")
    y: MotionLengths | None = optional("Motion along y at each point.")
    z: MotionLengths | None = optional("Motion along z at each point (solid).")
    file: Text | None = optional(
        "In place of all these: a CSV file whose first line names the columns with "
        "their units, such as 'x [m], y [m], ux [mm], uy [mm]' (and z [m], uz [mm] in a solid)."
    )
    factor: Coefficient | None = optional("Multiplies all motions; 1 if missing.")

    def check(self, faults: SectionFaults) -> None:
        """Points and motions, as many of both, or a file."""
        columns = {axis: getattr(self, axis) for axis in _AXES if getattr(self, axis) is not None}
        if self.file is not None or not self.points or not columns:
            given = [key for key in ("points", *_AXES, "file") if getattr(self, key) is not None]
            message = f"found {' and '.join(given) or 'neither'}; expected points with their "
            faults.add((), "wrong-pair", f"{message}motions along x, y or z, or a file")
            columns = {}
        for axis, values in columns.items():
            if len(values) != len(self.points or ()):
                message = f"{len(values)} motions for {len(self.points or ())} points"
                faults.add((axis,), "wrong-number", message, "Write one motion for each point.")

    @property
    def axes(self) -> tuple[int, ...]:
        """Directions that were measured."""
        return tuple(c for c, axis in enumerate(_AXES) if getattr(self, axis) is not None)

    def for_model(self, context: Context) -> MotionField:
        """The motions for the model."""
        columns = [[value.factor for value in getattr(self, _AXES[c])] for c in self.axes]
        values = tuple(zip(*columns, strict=True))
        return self.to_model(MotionField, context, components=self.axes, values=values)


class SupportSection(Section):
    """How a group, or the node at a point, moves: what is not named here is free to move."""

    at: Coordinates | None = optional(
        "The point of a node that is held, in place of the group of this name; the "
        "support may have any name then."
    )
    x: GivenMotion | None = optional(
        "Motion along x, or 'fixed'.", examples=["1 mm", "$u", "fixed"]
    )
    y: GivenMotion | None = optional("Motion along y, or 'fixed'.")
    z: GivenMotion | None = optional("Motion along z, or 'fixed' (solid).")
    measured: MeasuredMotionSection | None = optional(
        "Motions that were measured at points, in the directions that they have."
    )
    contraction: Coefficient | None = optional(
        "Volume loss of a tunnel: the part of the area within this closed line by "
        "which the wall moves in, radially towards the centroid (about an axis of revolution, or "
        "`axis`: towards that). A negative part widens.",
        examples=["1.5 %", "$volume_loss"],
    )
    centre: Coordinates | None = optional(
        "Centre of the contraction, if it is not the centroid, or if planes of "
        "symmetry cut the wall; in a solid any point of `axis`."
    )
    axis: Component | None = optional("Direction of the axis of the contraction, in a solid.")

    def check(self, faults: SectionFaults) -> None:
        """Something is held or moved, and each direction in one way."""
        along = [axis for axis in _AXES if getattr(self, axis) is not None]
        if not along and self.measured is None and self.contraction is None:
            hint = "Give x, y or z (a motion, or 'fixed'), 'measured', or 'contraction'."
            faults.add((), "no-motion", "found no direction that is held", hint)
        others = [*along, *(key for key in ("measured", "at") if getattr(self, key) is not None)]
        if self.contraction is not None and others:
            message = f"found 'contraction' and {', '.join(others)}: it gives all of the motion"
            faults.add(("contraction",), "wrong-pair", message, "Write one or the other.")
        for key in ("centre", "axis"):
            if self.contraction is None and getattr(self, key) is not None:
                faults.add((key,), "wrong-pair", f"'{key}' belongs to 'contraction'", "Remove it.")
        read = () if self.measured is None else self.measured.axes
        for axis in (_AXES[c] for c in read if _AXES[c] in along):
            message = f"the motion along {axis} is given here and by 'measured'"
            faults.add((axis,), "wrong-pair", message, "Write one or the other.")

    def support(self, name: str, context: Context) -> Support:
        """The support for the model; what cannot be is noted as a fault."""
        measured = (
            None if self.measured is None else self.measured.for_model(context.at("measured"))
        )
        at = None if self.at is None else context.at("at").vector(self.at)
        wall = None if self.contraction is None else self._wall(self.contraction, context)
        held = [c for c, axis in enumerate(_AXES) if getattr(self, axis) is not None]
        held += () if measured is None else measured.components
        held += () if wall is None else self._across(context.analysis)
        for axis in _AXES[context.dim :]:
            if getattr(self, axis) is not None:
                _refuse_z(context.at(axis))
        if measured is not None and max(measured.components) >= context.dim:
            _refuse_z(context.at("measured", "z"))
        motions = tuple(
            (c, given.scalar)
            for c, axis in enumerate(_AXES)
            if isinstance(given := getattr(self, axis), CaseNumber)
        )
        return Support(name, tuple(sorted(held)), at, motions, measured, wall)

    def _across(self, analysis: Analysis) -> list[int]:
        """Directions in which a wall moves in."""
        if analysis is Analysis.AXISYMMETRIC:
            return [0]
        axis = None if self.axis is None else _AXES.index(self.axis)
        return [c for c in range(analysis.dim) if c != axis]

    def _wall(self, part: CaseNumber, context: Context) -> Contraction:
        """The contraction of the wall."""
        solid = context.analysis is Analysis.SOLID
        if part.parameter is None and not -1 < part.factor < 1:
            message = f"'{part.text}' is not a part of an area"
            context.at("contraction").refuse("out-of-range", message, "Write it such as 1.5 %.")
        if solid != (self.axis is not None):
            place = context if solid else context.at("axis")
            message = "a contraction in a solid goes towards an axis, which is not given"
            hint = "Give 'axis: x' (or y, z) and 'centre' with one of its points."
            if not solid:
                message, hint = "only a solid has an axis of contraction", "Remove it."
            place.refuse("wrong-dimension", message, hint)
        elif solid and self.centre is None:
            message = "the axis of the contraction has no place"
            context.refuse("wrong-pair", message, "Give 'centre' with one of its points.")
        centre = None
        if self.centre is not None:
            centre = context.at("centre").vector(self.centre)
        return Contraction(part.scalar, centre)


def _refuse_z(context: Context) -> None:
    context.refuse("wrong-dimension", "a plane model has no direction z", "Use x and y.")


_Directions = Annotated[list[Component], Field(min_length=1), Tag("list")]
_Mapping = Annotated[SupportSection, Tag("mapping")]
SupportValue = Annotated[
    Annotated[Literal["x", "y", "z", "fixed"], Tag("text")] | _Directions | _Mapping,
    TEXT_LIST_OR_MAPPING,
]
StageSupportValue = Annotated[
    Annotated[Literal["x", "y", "z", "fixed", "free"], Tag("text")] | _Directions | _Mapping,
    TEXT_LIST_OR_MAPPING,
]


def build_supports(
    values: Mapping[str, StageSupportValue], context: Context
) -> dict[str, Support | None]:
    """The supports of a case or a stage by name, None for those that let go.

    Args:
        values: name to what is given for it.
        context: of the key `supports`.
    """
    return {
        name: None if value == FREE else _support(name, value, context.at(name))
        for name, value in values.items()
    }


def _support(name: str, value: StageSupportValue, context: Context) -> Support:
    if isinstance(value, SupportSection):
        return value.support(name, context)
    names = _AXES[: context.dim] if value == FIXED else value
    components = tuple(sorted({_AXES.index(axis) for axis in names}))
    if components[-1] >= context.dim:
        _refuse_z(context)
    return Support(name, components)
