"""Actions on the ground of a case: loads, water and temperature, and what they are built into."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Annotated, Any

from pydantic import Field, Tag

from geoident.io.schema.section import Alternatives, Context, Section, SectionFaults
from geoident.io.schema.values import (
    TEXT_OR_MAPPING,
    CaseNumber,
    Coefficient,
    Coefficients,
    Coordinates,
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
    UnitWeight,
    scalar_of,
)
from geoident.model.actions import (
    HeadLine,
    Load,
    PointForce,
    Pressure,
    Seismic,
    Temperature,
    TemperatureField,
    Traction,
    Water,
    WaterPressure,
)
from geoident.model.case import Analysis
from geoident.model.parameter import Scalar

WATER = Scalar(9.81e3)
"""Unit weight of water, N/m3."""

_WATER_WEIGHT = "Of the water; 9.81 kN/m3 if missing."


class FallSection(Section):
    """Uplift: the level of the water falls linearly along a line, and is constant beyond it."""

    start: Coordinates = Field(
        alias="from", description="Where the level is still that of the load."
    )
    end: Coordinates = Field(alias="to", description="Where it has fallen to `level`.")
    level: Length = Field(description="Level of the water there.")

    def check(self, faults: SectionFaults) -> None:
        """The line has a length."""
        if [x.factor for x in self.start] == [x.factor for x in self.end]:
            faults.add(("to",), "zero-length", "the line begins and ends at one point")

    def line(self, context: Context) -> HeadLine:
        """The line for the model."""
        start, end = context.at("from").vector(self.start), context.at("to").vector(self.end)
        return HeadLine(start, end, self.level.scalar)


class WaterLoadSection(Section):
    """Pressure of water on a face, growing with depth below a level; above it the face is dry."""

    level: Length = Field(description="Level of the water.", examples=["120 m", "$level"])
    unit_weight: UnitWeight | None = Field(None, description=_WATER_WEIGHT)
    falls: FallSection | None = Field(
        None, description="Uplift: how the level falls along the face."
    )

    def load(self, group: str, context: Context) -> WaterPressure:
        """The pressure on a group of faces."""
        falls = None if self.falls is None else self.falls.line(context.at("falls"))
        weight = _weight(self.unit_weight)
        return self.to_model(WaterPressure, group=group, unit_weight=weight, falls=falls)


class LoadSection(Section):
    """A load: a pressure, a traction or water on faces, a force, or a pseudo-static earthquake."""

    one_of = (
        Alternatives(
            "pressure",
            "traction",
            "water",
            "force",
            "line_force",
            "seismic",
            hint="Give each load a name and a mapping of its own.",
        ),
    )

    on: Name | None = Field(
        None,
        description="Group of lines (2-D) or surfaces (solid) in the mesh; for a force a group of "
        "nodes, which share it equally.",
    )
    at: Coordinates | None = Field(None, description="Point on which a force acts.")
    pressure: Stress | None = Field(None, description="Positive pushes onto the ground.")
    traction: Stresses | None = Field(
        None, description="Force per area in the coordinate directions."
    )
    water: WaterLoadSection | None = Field(None, description="Pressure of water on the faces.")
    force: Forces | None = Field(
        None, description="Force in the coordinate directions (solid; axisymmetric: of all around)."
    )
    line_force: LineForces | None = Field(
        None, description="Force per metre out of plane in the directions x, y (plane strain)."
    )
    seismic: Coefficients | None = Field(
        None,
        description="Parts of its own weight that act on all ground in the coordinate directions.",
        examples=["[0.1, 0]"],
    )

    def check(self, faults: SectionFaults) -> None:
        """The load stands in a place of its kind."""
        kind = next(kind for kind in _LOADS if getattr(self, kind) is not None)
        places = [key for key in ("on", "at") if getattr(self, key) is not None]
        if kind == "seismic":
            expected, good = "neither 'on' nor 'at' is expected", not places
        elif kind in ("force", "line_force"):
            expected, good = "'at' with a point, or 'on' with a group is expected", len(places) == 1
        else:
            expected, good = "'on' with a group of faces is expected", places == ["on"]
        if not good:
            places_text = " and ".join(f"'{place}'" for place in places) or "no place"
            faults.add((), "wrong-place", f"found {places_text} for the load '{kind}'; {expected}")

    def load(self, context: Context) -> Load:
        """The load for the model; what cannot be is noted as a fault."""
        kind = next(kind for kind in _LOADS if getattr(self, kind) is not None)
        return _LOADS[kind](self, getattr(self, kind), context)

    def _pressure(self, given: CaseNumber, context: Context) -> Pressure:
        return Pressure(self.on or "", given.scalar)

    def _traction(self, given: Sequence[CaseNumber], context: Context) -> Traction:
        return Traction(self.on or "", _scalars(given, context.at("traction")))

    def _water(self, given: WaterLoadSection, context: Context) -> WaterPressure:
        return given.load(self.on or "", context.at("water"))

    def _force(self, given: Sequence[CaseNumber], context: Context) -> PointForce:
        plane = context.analysis is Analysis.PLANE_STRAIN
        wanted, wrong, unit = (
            ("line_force", "force", "kN/m") if plane else ("force", "line_force", "kN")
        )
        if getattr(self, wrong) is not None:
            message = f"'{wrong}' in {context.analysis.value} analysis; '{wanted}' is expected"
            hint = f"Give it in {unit}."
            context.at(wrong).refuse("wrong-dimension", message, hint, key=True)
        value = _scalars(given, context.at(wanted))
        at = None if self.at is None else context.at("at").vector(self.at)
        return PointForce(self.on or "" if at is None else at, value)

    def _seismic(self, given: Sequence[CaseNumber], context: Context) -> Seismic:
        return Seismic(_scalars(given, context.at("seismic")))


_LOADS: Mapping[str, Callable[[LoadSection, Any, Context], Load]] = {
    "pressure": LoadSection._pressure,
    "traction": LoadSection._traction,
    "water": LoadSection._water,
    "force": LoadSection._force,
    "line_force": LoadSection._force,
    "seismic": LoadSection._seismic,
}
"""Keys of a load, of which it has exactly one, and what each is built by."""


class WaterSection(Section):
    """Water in the pores: stresses are effective, the pressure of the water loads the skeleton."""

    table: LevelOrGroup = Field(
        description="Level, or group of lines (2-D) or surfaces (solid), below which the pores are "
        "full of still water.",
        examples=["250 m", "water-table"],
    )
    unit_weight: UnitWeight | None = Field(None, description=_WATER_WEIGHT)
    groups: list[Name] | None = Field(
        None, description="Element groups with water in their pores; all if missing."
    )

    def water(self) -> Water:
        """The water for the model."""
        return self.to_model(Water, unit_weight=_weight(self.unit_weight))


class TemperatureFieldSection(Section):
    """Changes of temperature at points: linear between them, the nearest beyond them."""

    points: list[Coordinates] | None = Field(None, description="Coordinates of the points.")
    values: TemperatureValues | None = Field(None, description="Change at each point.")
    file: Text | None = Field(
        None,
        description="In place of points and values: a CSV file whose first line names the columns "
        "with their units, such as 'x [m], y [m], change [K]' (and z [m] in a solid).",
    )
    factor: Coefficient | None = Field(None, description="Multiplies all changes; 1 if missing.")

    def check(self, faults: SectionFaults) -> None:
        """Points and values, as many of both, or a file."""
        if self.file is not None or not self.points or not self.values:
            given = [key for key in ("points", "values", "file") if getattr(self, key) is not None]
            message = f"found {' and '.join(given) or 'neither'}; points with values, or a file, is"
            faults.add((), "wrong-pair", f"{message} expected")
        elif len(self.points) != len(self.values):
            message = f"{len(self.values)} values for {len(self.points)} points"
            faults.add(("values",), "wrong-number", message, "Write one value for each point.")

    def field(self, context: Context) -> TemperatureField:
        """The changes for the model."""
        points = tuple(
            context.at("points", n).vector(point) for n, point in enumerate(self.points or ())
        )
        return self.to_model(TemperatureField, points=points)


TemperatureSection = Annotated[
    Annotated[TemperatureChange, Tag("text")] | Annotated[TemperatureFieldSection, Tag("mapping")],
    TEXT_OR_MAPPING,
]


def build_loads(
    sections: Mapping[str, LoadSection], context: Context, *, gravity: bool
) -> dict[str, Load]:
    """The loads at a place of the case, by name; what cannot be is noted as a fault.

    Args:
        sections: name to section.
        context: of the key `loads`.
        gravity: whether the case has any, of which shaking is a part.
    """
    for name, section in sections.items():
        if section.seismic is not None and not gravity:
            message = "a seismic load is a part of the weight, and there is no gravity"
            hint = "Add 'gravity: 9.81 m/s2'."
            context.at(name, "seismic").refuse("no-gravity", message, hint, key=True)
    return {name: section.load(context.at(name)) for name, section in sections.items()}


def build_temperature(
    sections: Mapping[str, TemperatureSection], context: Context
) -> dict[str, Temperature]:
    """Changes of temperature by group.

    Args:
        sections: group to what is given for it.
        context: of the key `temperature`.
    """
    return {
        group: given.field(context.at(group))
        if isinstance(given, TemperatureFieldSection)
        else given.scalar
        for group, given in sections.items()
    }


def _weight(given: CaseNumber | None) -> Scalar:
    return scalar_of(given) or WATER


def _scalars(given: Sequence[CaseNumber], context: Context) -> tuple[Scalar, ...]:
    context.vector(given, f"the {str(context.path[-1]).replace('_', ' ')}")
    return tuple(number.scalar for number in given)
