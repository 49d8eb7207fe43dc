"""What a case file may say of actions from outside: loads, water, temperature."""

from __future__ import annotations

from typing import Annotated

from pydantic import Discriminator, Field, Tag, model_validator

from geoident.io.case.values import (
    Factor,
    Factors,
    Forces,
    Level,
    LevelOrGroup,
    LineForces,
    Point,
    Pressure,
    Pressures,
    TemperatureChange,
    TemperatureValues,
    UnitWeight,
)
from geoident.io.case.words import Name, Text
from geoident.io.schema.section import Section, Wrongs

KINDS = ("pressure", "traction", "water", "force", "line_force", "seismic")
"""Keys of a load of which it has exactly one."""

_WATER_WEIGHT = "Of the water; 9.81 kN/m3 if missing."


class FallSection(Section):
    """Uplift: the level of the water falls linearly along a line, and is constant beyond it."""

    start: Point = Field(alias="from", description="Where the level is still that of the load.")
    end: Point = Field(alias="to", description="Where it has fallen to `level`.")
    level: Level = Field(description="Level of the water there.")

    @model_validator(mode="after")
    def _some_length(self) -> FallSection:
        if [x.factor for x in self.start] == [x.factor for x in self.end]:
            wrongs = Wrongs()
            wrongs.add(("to",), "zero-length", "the line begins and ends at one point")
            wrongs.raise_any()
        return self


class WaterLoadSection(Section):
    """Pressure of water on a face, growing with depth below a level; above it the face is dry."""

    level: Level = Field(description="Level of the water.", examples=["120 m", "$level"])
    unit_weight: UnitWeight | None = Field(None, description=_WATER_WEIGHT)
    falls: FallSection | None = Field(
        None, description="Uplift: how the level falls along the face."
    )


class LoadSection(Section):
    """A load: a pressure, a traction or water on faces, a force, or a pseudo-static earthquake."""

    on: Name | None = Field(
        None,
        description="Group of lines (2-D) or surfaces (solid) in the mesh; for a force a group of "
        "nodes, which share it equally.",
    )
    at: Point | None = Field(None, description="Point on which a force acts.")
    pressure: Pressure | None = Field(None, description="Positive pushes onto the ground.")
    traction: Pressures | None = Field(
        None, description="Force per area in the coordinate directions."
    )
    water: WaterLoadSection | None = Field(None, description="Pressure of water on the faces.")
    force: Forces | None = Field(
        None, description="Force in the coordinate directions (solid; axisymmetric: of all around)."
    )
    line_force: LineForces | None = Field(
        None, description="Force per metre out of plane in the directions x, y (plane strain)."
    )
    seismic: Factors | None = Field(
        None,
        description="Parts of its own weight that act on all ground in the coordinate directions.",
        examples=["[0.1, 0]"],
    )

    @model_validator(mode="after")
    def _one_kind(self) -> LoadSection:
        wrongs = Wrongs()
        kinds = [kind for kind in KINDS if getattr(self, kind) is not None]
        if len(kinds) != 1:
            message = f"found {' and '.join(kinds) or 'no kind of load'}; exactly one of "
            wrongs.add((), "wrong-pair", f"{message}{', '.join(KINDS)} is expected")
        else:
            self._check_place(kinds[0], wrongs)
        wrongs.raise_any()
        return self

    def _check_place(self, kind: str, wrongs: Wrongs) -> None:
        places = [key for key in ("on", "at") if getattr(self, key) is not None]
        if kind == "seismic":
            expected, good = "neither 'on' nor 'at' is expected", not places
        elif kind in ("force", "line_force"):
            expected, good = "'at' with a point, or 'on' with a group is expected", len(places) == 1
        else:
            expected, good = "'on' with a group of faces is expected", places == ["on"]
        if not good:
            found = " and ".join(f"'{place}'" for place in places) or "no place"
            wrongs.add((), "wrong-place", f"found {found} for the load '{kind}'; {expected}")


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


class TemperatureFieldSection(Section):
    """Changes of temperature at points: linear between them, the nearest beyond them."""

    points: list[Point] | None = Field(None, description="Coordinates of the points.")
    values: TemperatureValues | None = Field(None, description="Change at each point.")
    file: Text | None = Field(
        None,
        description="In place of points and values: a CSV file whose first line names the columns "
        "with their units, such as 'x [m], y [m], change [K]' (and z [m] in a solid).",
    )
    factor: Factor | None = Field(None, description="Multiplies all changes; 1 if missing.")

    @model_validator(mode="after")
    def _as_many(self) -> TemperatureFieldSection:
        wrongs = Wrongs()
        if self.file is not None or not self.points or not self.values:
            given = [key for key in ("points", "values", "file") if getattr(self, key) is not None]
            message = f"found {' and '.join(given) or 'neither'}; points with values, or a file, is"
            wrongs.add((), "wrong-pair", f"{message} expected")
        elif len(self.points) != len(self.values):
            message = f"{len(self.values)} values for {len(self.points)} points"
            wrongs.add(("values",), "wrong-number", message, "Write one value for each point.")
        wrongs.raise_any()
        return self


def _shape(value: object) -> str:
    return "mapping" if isinstance(value, dict | TemperatureFieldSection) else "text"


TemperatureSection = Annotated[
    Annotated[TemperatureChange, Tag("text")] | Annotated[TemperatureFieldSection, Tag("mapping")],
    Discriminator(_shape),
]
