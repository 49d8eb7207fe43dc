"""Actions on the ground of a case: loads, water and temperature, and what they are built into."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from pydantic import Field

from geoident.io.case.frames import refuse_no_direction
from geoident.io.schema.section import Alternatives, Context, Section, SectionFaults, optional
from geoident.io.schema.values import (
    CaseNumber,
    Coefficient,
    Coefficients,
    Coordinates,
    DirectionVector,
    Force,
    Forces,
    Length,
    LevelOrGroup,
    LineForces,
    Name,
    Stress,
    Stresses,
    TemperatureChange,
    TemperatureValues,
    Text,
    TextOrMapping,
    UnitWeight,
)
from geoident.model.actions import (
    Drain,
    HeadForce,
    HeadLine,
    Load,
    PointForce,
    Pressure,
    Seismic,
    TemperatureField,
    Traction,
    Water,
    WaterPressure,
)
from geoident.model.case import Analysis
from geoident.model.parameter import Scalar

_WATER_WEIGHT = "Of the water; 9.81 kN/m3 if missing."


class DrainSection(Section):
    """A row of drains: up to it the level falls linearly, and from it to the end."""

    builds = Drain

    at: Coordinates = Field(description="Where the line meets it.", examples=["[8 m, 0 m]"])
    left: Coefficient = Field(
        description="Part of the whole fall of the level that is left there, 0 to 1: 0 for a drain "
        "that takes all, 1 for one that takes nothing of the level of the load.",
        examples=["0.35", "$drain"],
    )

    def check(self, faults: SectionFaults) -> None:
        """It is a part."""
        if self.left.parameter is None and not 0.0 <= self.left.factor <= 1.0:
            message = f"'{self.left.text}' is no part from 0 to 1"
            hint = "0.35: at the drains, about a third of the fall is still to come."
            faults.add(("left",), "out-of-range", message, hint)


class FallSection(Section):
    """Uplift: the level of the water falls linearly along a line, and is constant beyond it."""

    builds = HeadLine

    start: Coordinates = Field(
        alias="from", description="Where the level is still that of the load."
    )
    end: Coordinates = Field(alias="to", description="Where it has fallen to `level`.")
    level: Length = Field(description="Level of the water there.")
    drain: DrainSection | None = optional("Drains between the two.")

    def check(self, faults: SectionFaults) -> None:
        """The line has a length, and its drain is between its ends."""
        start, end = ([x.factor for x in place] for place in (self.start, self.end))
        if start == end:
            faults.add(("to",), "zero-length", "the line begins and ends at one point")
        elif self.drain is not None and len(start) == len(end) == len(self.drain.at):
            at = np.array([x.factor for x in self.drain.at]) - start
            along = np.array(end) - start
            if not 0.0 < at @ along / (along @ along) < 1.0:
                message = "the drain is not between the ends of the line"
                hint = "Give a point between 'from' and 'to'."
                faults.add(("drain", "at"), "out-of-range", message, hint)


class WaterLoadSection(Section):
    """Pressure of water on a face, growing with depth below a level; above it the face is dry."""

    level: Length = Field(description="Level of the water.", examples=["120 m", "$level"])
    unit_weight: UnitWeight | None = optional(_WATER_WEIGHT)
    falls: FallSection | None = optional("Uplift: how the level falls along the face.")


class LoadSection(Section):
    """A load: a pressure, a traction or water on faces, a force, or a pseudo-static earthquake.

    A pull or a push acts from outside on the free head of each bar of grouted bolts or piles.
    """

    one_of = (
        Alternatives(
            "pressure",
            "traction",
            "water",
            "force",
            "line_force",
            "seismic",
            "pull",
            "push direction?",
            hint="Give each load a name and a mapping of its own.",
        ),
    )

    on: Name | None = optional(
        "Group of lines (2-D) or surfaces (solid) in the mesh; for a force a group of "
        "nodes, which share it equally; for a pull or push a structure."
    )
    at: Coordinates | None = optional("Point on which a force acts.")
    pressure: Stress | None = optional("Positive pushes onto the ground.")
    traction: Stresses | None = optional("Force per area in the coordinate directions.")
    water: WaterLoadSection | None = optional("Pressure of water on the faces.")
    force: Forces | None = optional(
        "Force in the coordinate directions (solid; axisymmetric: of all around)."
    )
    line_force: LineForces | None = optional(
        "Force per metre out of plane in the directions x, y (plane strain)."
    )
    seismic: Coefficients | None = optional(
        "Parts of its own weight that act on all ground in the coordinate directions.",
        examples=["[0.1, 0]"],
    )
    pull: Force | None = optional(
        "Force on each head of grouted bolts or piles, out of the ground.", examples=["80 kN"]
    )
    push: Force | None = optional(
        "The same into the ground, or along a `direction`.", examples=["600 kN"]
    )
    direction: DirectionVector | None = optional(
        "Along which heads of piles that bend are pushed, in place of along the pile.",
        examples=[["1", "0"]],
    )

    def check(self, faults: SectionFaults) -> None:
        """The load stands in a place of its kind, and its direction has a length."""
        refuse_no_direction("direction", self.direction, faults)
        kind = next(kind for kind in self.one_of[0].keys if getattr(self, kind) is not None)
        places = [key for key in ("on", "at") if getattr(self, key) is not None]
        hint = ""
        if kind == "seismic":
            expected, good = "neither 'on' nor 'at'", not places
        elif kind in ("force", "line_force"):
            expected, good = "'at' with a point, or 'on' with a group", len(places) == 1
        elif kind in ("pull", "push"):
            expected, good = "'on' with a structure", places == ["on"]
            hint = "Name bolts or piles with a free head."
        else:
            expected, good = "'on' with a group of faces", places == ["on"]
        if not good:
            places_text = " and ".join(f"'{place}'" for place in places) or "no place"
            message = f"found {places_text} for the load '{kind}'; expected {expected}"
            faults.add((), "wrong-place", message, hint)

    def for_model(self, context: Context) -> Load:
        """The load for the model."""
        group, analysis = self.on or "", context.analysis

        def scalars(key: str, given: list[CaseNumber]) -> tuple[Scalar, ...]:
            context.at(key).has_axes(given)
            return tuple(number.scalar for number in given)

        if self.pressure is not None:
            return Pressure(group, self.pressure.scalar)
        if self.traction is not None:
            return Traction(group, scalars("traction", self.traction))
        if self.water is not None:
            return self.water.to_model(WaterPressure, context.at("water"), group=group)
        if self.seismic is not None:
            return Seismic(scalars("seismic", self.seismic))
        if self.pull is not None:
            return HeadForce(group, self.pull.scalar)
        if self.push is not None:
            if self.direction is not None:
                way = np.array(context.at("direction").vector(self.direction))
                unit = way / (np.linalg.norm(way) or 1.0)
                return HeadForce(group, self.push.scalar, tuple(unit.tolist()))
            return HeadForce(group, replace(self.push.scalar, factor=-self.push.scalar.factor))
        key, given, wanted, unit = "force", self.force, "line_force", "kN/m"
        if given is None:
            key, given, wanted, unit = "line_force", self.line_force, "force", "kN"
        assert given is not None
        if (key == "line_force") != (analysis is Analysis.PLANE_STRAIN):
            message = f"found '{key}' in {analysis.value} analysis; expected '{wanted}'"
            place = context.at(key)
            place.refuse("wrong-dimension", message, f"Give it in {unit}.", key=True)
        at = group if self.at is None else context.at("at").vector(self.at)
        return PointForce(at, scalars(key, given))


class WaterSection(Section):
    """Water in the pores: stresses are effective, the pressure of the water loads the skeleton."""

    builds = Water

    table: LevelOrGroup = Field(
        description="Level, or group of lines (2-D) or surfaces (solid), below which the pores are "
        "full of still water.",
        examples=["250 m", "water-table"],
    )
    unit_weight: UnitWeight | None = optional(_WATER_WEIGHT)
    groups: list[Name] | None = optional(
        "Element groups with water in their pores, and interfaces with water in them; "
        "all if missing. An interface has water where the ground of a side has."
    )
    falls: FallSection | None = optional(
        "How the level of the table falls along a line: seepage, and uplift in interfaces."
    )

    def check(self, faults: SectionFaults) -> None:
        """Only a level falls."""
        if self.falls is not None and isinstance(self.table, str):
            message = f"the table '{self.table}' is a group; a level falls along a line"
            faults.add(("falls",), "no-level", message, "Give 'table' the level at 'from'.")


class TemperatureFieldSection(Section):
    """Changes of temperature at points: linear between them, the nearest beyond them."""

    builds = TemperatureField

    points: list[Coordinates] | None = optional("Coordinates of the points.")
    values: TemperatureValues | None = optional("Change at each point.")
    file: Text | None = optional(
        "In place of points and values: a CSV file whose first line names the columns "
        "with their units, such as 'x [m], y [m], change [K]' (and z [m] in a solid)."
    )
    factor: Coefficient | None = optional("Multiplies all changes; 1 if missing.")

    def check(self, faults: SectionFaults) -> None:
        """Points and values, as many of both, or a file."""
        if self.file is not None or not self.points or not self.values:
            given = [key for key in ("points", "values", "file") if getattr(self, key) is not None]
            message = f"found {' and '.join(given) or 'neither'}; expected points with values, "
            faults.add((), "wrong-pair", f"{message}or a file")
        elif len(self.points) != len(self.values):
            message = f"{len(self.values)} values for {len(self.points)} points"
            faults.add(("values",), "wrong-number", message, "Write one value for each point.")


TemperatureSection = TextOrMapping[TemperatureChange, TemperatureFieldSection]
