"""The gauge that reads strains: of the ground, along a fibre optic cable, of a structure."""

from __future__ import annotations

import math
from bisect import bisect_right
from collections.abc import Sequence
from itertools import accumulate, pairwise
from typing import Annotated, Literal

from pydantic import Field

from geoident.io.case.frames import refuse_no_direction
from geoident.io.case.gauges.gauge import Motion, distance, subtract, unit_vector
from geoident.io.case.gauges.on_structure import TOWARDS, on_structure
from geoident.io.case.gauges.value import (
    StressComponent,
    ValueGauge,
    check_component,
    unit_direction,
)
from geoident.io.schema.section import Alternatives, Context, SectionFaults, optional
from geoident.io.schema.values import (
    Coordinates,
    Count,
    DirectionVector,
    FixedLength,
    FixedSize,
    Line,
    Name,
    SharesUnit,
)
from geoident.model.arrays import Vector
from geoident.model.gauges import Channel, MovingPoint, Reads

Stations = Annotated[list[FixedLength], SharesUnit()]

_MOST_STATIONS = 10_000


class StrainSection(ValueGauge):
    """Strain, elongation positive: of the ground, along a fibre optic cable, of a structure.

    * `point` with `direction` or `component`: the strain of the ground there;
    * `between` two points: the mean strain from one to the other;
    * `along` a line with `every` or `at`: mean strains over the length `base` around each station,
      as a fibre optic cable reads them: channels GAUGE.2.5, with the station in metres along it;
    * `structure` with `bar`, or with `point` and `fibre`: of a bar, or of a fibre of a beam or of a
      pile that bends (`inside`: on the side of `towards`); of a shell also with the `direction`; of
      a grouted bar at a `point` of it, or where its grout begins.

    Of the ground it is the change since `zero`; of a structure the value since it was built.
    """

    one_of = (
        *ValueGauge.one_of,
        Alternatives(
            "point direction",
            "point component",
            "between",
            "along every base?",
            "along at base",
            "structure bar? point?",
            "structure point fibre depth? towards? direction?",
            hint="Give the keys of one of these ways.",
        ),
    )

    measures = ("strain",)

    kind: Literal["strain"]
    point: Coordinates | None = optional("Where it is read.")
    direction: DirectionVector | None = optional(
        "Along which it is read; on a shell its part along the shell."
    )
    component: StressComponent | Literal["volume"] | None = optional(
        "In place of a direction; of shear strains gamma = 2 eps. `volume`: the sum of "
        "the three normal strains."
    )
    between: Line | None = optional("The two points of a mean strain.")
    along: list[Coordinates] | None = optional(
        "Points of the cable, straight between them.", min_length=2
    )
    every: FixedSize | None = optional(
        "Distance of the stations along the cable.", examples=["0.25 m"]
    )
    at: Stations | None = optional("Stations along the cable, in place of `every`.", min_length=1)
    base: FixedSize | None = optional(
        "Length over which each station is a mean; `every` if missing."
    )
    structure: Name | None = optional("The structure whose strain is read.")
    bar: Annotated[int, Count()] | None = optional(
        "Which of its bars, counted from 1; may be missing if it has one, or where a "
        "`point` on grouted bars tells."
    )
    fibre: Literal["inside", "outside", "axis"] | None = optional("Which fibre of a beam or shell.")
    depth: FixedSize | None = optional(
        "Distance of the fibre from the axis of the beam or the middle of the shell; "
        "half of its thickness if missing."
    )
    towards: Coordinates | None = optional(TOWARDS)
    positive: Literal["tension", "compression"] = Field(
        "tension",
        description="Which strain of the ground at a point has positive readings.",
    )

    def check(self, faults: SectionFaults) -> None:
        """The direction has a length."""
        super().check(faults)
        refuse_no_direction("direction", self.direction, faults)
        at_point = self.point is not None and self.structure is None
        if self.positive == "compression" and not at_point:
            message = "only the strain of the ground at a point counts so"
            faults.add(("positive",), "wrong-pair", message, "Remove it.")

    @property
    def reads(self) -> Reads:
        """A change of the ground since the zero; of a structure its value, if no zero is given."""
        return Reads.CHANGE if self.structure is None else super().reads

    def channels(self, name: str, context: Context) -> list[Channel]:
        """One channel; along a line one for every station."""
        if self.structure is not None:
            return self._of_structure(name, context)
        if self.along is not None:
            return self._along(name, context)
        if self.between is not None:
            place = context.at("between")
            first, second = (place.at(n).vector(point) for n, point in enumerate(self.between))
            motion, terms = distance(first, second, place), _mean_strain([first, second])
            return [self.make_channel(name, name, motion, context.path, terms=terms)]
        point = context.at("point").vector(self.point or [])
        direction = unit_direction(self.direction, context.at("direction"))
        if self.component:
            check_component(self.component, context.at("component"))
        pushed = self.positive == "compression"
        quantity = self.component or ""
        return [
            self.at_point(name, point, direction, context, quantity=quantity, compression=pushed)
        ]

    def _along(self, name: str, context: Context) -> list[Channel]:
        place = context.at("along")
        line = [place.at(n).vector(point) for n, point in enumerate(self.along or ())]
        for n, (a, b) in enumerate(pairwise(line), start=1):
            if a == b:
                message = "the point is the same as the one before"
                place.at(n).refuse("zero-length", message, "Remove one of them.")
                return []
        length = sum(math.dist(a, b) for a, b in pairwise(line))
        if math.isnan(length):
            return []  # a point is wrong
        half, stations = self._base / 2, self._stations(length)
        if not self._fits(stations, half, length, context):
            return []
        channels = []
        for station in stations:
            part = _part_of(line, station - half, station + half)
            motion = Motion(part[0], part[-1], unit_vector(subtract(part[-1], part[0])))
            channel, terms = f"{name}.{station:.6g}", _mean_strain(part)
            channels.append(self.make_channel(channel, name, motion, context.path, terms=terms))
        return channels

    def _fits(
        self, stations: Sequence[float], half: float, length: float, context: Context
    ) -> bool:
        """Whether the stations with their bases lie on the line; a fault where they do not."""
        key = context.at("at" if self.at else "every")
        if not stations:
            message = f"the line is {length:.6g} m long, less than one base of {2 * half:.6g} m"
            key.refuse("beyond-line", message, "Correct the line or the length.")
        elif len(stations) > _MOST_STATIONS:
            message = f"{len(stations)} stations; at most {_MOST_STATIONS} are allowed"
            key.refuse("too-many-stations", message, "Let them be farther apart.")
        else:
            beyond = [s for s in stations if not -1e-9 <= s - half <= s + half <= length + 1e-9]
            if not beyond:
                return True
            message = f"the station {beyond[0]:.6g} m with its base of {2 * half:.6g} m reaches "
            message += f"beyond the line, which is {length:.6g} m long"
            key.refuse("beyond-line", message, "Correct the station, the base or the line.")
        return False

    @property
    def _base(self) -> float:
        given = self.base or self.every
        return 0.0 if given is None else given.factor

    def _stations(self, length: float) -> list[float]:
        if self.at is not None:
            return [station.factor for station in self.at]
        step, base = (self.every.factor if self.every else 0.0), self._base
        count = math.floor((length - base) / step * (1 + 1e-12) + 1e-9) + 1 if step else 0
        return [base / 2 + n * step for n in range(max(0, min(count, _MOST_STATIONS + 1)))]

    def _of_structure(self, name: str, context: Context) -> list[Channel]:
        depth = None if self.depth is None else self.depth.factor
        places = self.point, self.bar, self.towards
        fibre = self.fibre or ""
        along = unit_direction(self.direction, context.at("direction"))
        return [on_structure(self, name, *places, context, along, quantity=fibre, fibre=depth)]


def _mean_strain(line: Sequence[Vector]) -> tuple[MovingPoint, ...]:
    """Points and vectors, 1/m, whose motions add up to the mean strain along a line."""
    length = sum(math.dist(a, b) for a, b in pairwise(line)) or 1.0
    terms: list[MovingPoint] = []
    for a, b in pairwise(line):
        along = tuple(x / length for x in unit_vector(subtract(b, a)))
        terms += [(a, tuple(-x for x in along)), (b, along)]
    return tuple(terms)


def _part_of(line: Sequence[Vector], start: float, end: float) -> list[Vector]:
    """The part of a line from one distance along it to another, m."""
    lengths = [math.dist(a, b) for a, b in pairwise(line)]
    at = [0.0, *accumulate(lengths)]
    bends = [point for s, point in zip(at, line, strict=True) if start < s < end]
    ends = []
    for s in (start, end):
        k = min(bisect_right(at, s, lo=1), len(lengths)) - 1
        t = (s - at[k]) / lengths[k]
        ends.append(tuple(x + t * (y - x) for x, y in zip(line[k], line[k + 1], strict=True)))
    return [ends[0], *bends, ends[1]]
