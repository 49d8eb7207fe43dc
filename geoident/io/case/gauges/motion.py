"""Tiltmeters, levelling lines and lines of sight.

All are made into channels that add up motions of points (`model.gauges.Channel.motions`).
"""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Literal

import numpy as np
from pydantic import Field

from geoident.io.case.gauges.gauge import (
    GaugeBase,
    Motion,
    Reference,
    axis_vector,
    point_or_ground,
    refuse_one_point,
    subtract,
    unit_vector,
)
from geoident.io.schema.section import Alternatives, Context, SectionFaults, optional
from geoident.io.schema.values import Coordinates, DirectionVector, FixedAngle, Line, Name
from geoident.model.arrays import Vector
from geoident.model.gauges import Channel

_ON_LINE = 1e-9
"""Lengths below this part of a distance count as zero."""


class TiltSection(GaugeBase):
    """Rotation of a point of the ground, a beam or a shell, or of two points, in a vertical plane.

    Positive where the top leans towards a direction. At a point it is the rotation of the ground
    there, without its distortion; of two points that of the line from one to the other.
    """

    one_of = (
        *GaugeBase.one_of,
        Alternatives(
            "point on?", "between", hint="Two points have a rotation without a structure."
        ),
    )

    measures = ("angle",)

    kind: Literal["tilt"]
    point: Coordinates | None = optional("The point whose rotation is read.")
    on: Name | None = optional(
        "Beam or shell (a wall, a lining) whose rotation is read at the point."
    )
    between: Line | None = optional("In place of it, two points.")
    towards: DirectionVector | None = optional(
        "Horizontal direction in which the top leans where the reading is positive; "
        "if missing: x in a plane model."
    )

    @property
    def structure(self) -> str | None:
        """The beam or shell on which it sits, if it does."""
        return self.on

    def channels(self, name: str, context: Context) -> list[Channel]:
        """The one channel."""
        towards = self._towards(context)
        if self.point is None:
            return self._pair(name, towards, context)
        motion = Motion(None, context.at("point").vector(self.point), towards)
        own = {"turns": _leaning(towards)} if self.on is None else {"structure": self.on}
        return [self.make_channel(name, name, motion, context.path, **own)]

    def _pair(self, name: str, towards: Vector, context: Context) -> list[Channel]:
        place = context.at("between")
        first, second = (place.at(n).vector(given) for n, given in enumerate(self.between or []))
        refuse_one_point(first, second, place)
        apart = np.array(subtract(second, first))
        # A rotation by the angle 1 moves the second point against the first by this vector.
        sweep = 2.0 * np.array(_leaning(towards)) @ apart
        size = float(sweep @ sweep)
        if 0.0 <= size <= _ON_LINE * float(apart @ apart):
            if first != second:
                message = "the line between the two points does not turn when it leans in the "
                hint = "Give points above each other, or beside each other in that direction."
                context.at("towards" if self.towards is not None else "between").refuse(
                    "zero-direction", f"{message}direction", hint
                )
            return []
        vector = tuple(float(x) for x in sweep / size)
        terms = ((first, tuple(-x for x in vector)), (second, vector))
        motion = Motion(first, second, unit_vector(vector))
        return [self.make_channel(name, name, motion, context.path, terms=terms)]

    def _towards(self, context: Context) -> Vector:
        """Horizontal unit vector (dim,); zeros, with a fault, where there is none."""
        if self.towards is None:
            if context.dim == 3:
                message = "'towards' is missing: the direction in which the top leans"
                context.refuse("missing-key", message, "Add 'towards: [1, 0, 0]'.", key=True)
            return axis_vector(0, context.dim, 1.0)
        place = context.at("towards")
        level = unit_vector((*place.vector(self.towards)[:-1], 0.0))
        if not any(level):
            message = "the direction is vertical or has length zero"
            place.refuse("zero-direction", message, "Give a horizontal direction.")
        return level


class DistortionSection(GaugeBase):
    """Angular distortion of pairs of points: difference of their settlements by their distance."""

    measures = ("angle",)

    pairs: list[list[Name]] = Field(
        min_length=1, description="Names of two points each.", examples=[[["P1", "P2"]]]
    )

    @property
    def kind_name(self) -> str:
        """What is usual for them is not what is usual for settlements."""
        return "distortion"

    def channels(self, name: str, context: Context) -> list[Channel]:
        """None: they are made with the points of the line."""
        return []


class LevellingSection(GaugeBase):
    """Settlements of the points of a line, positive downwards.

    One channel per point, named GAUGE.POINT; distortions are named GAUGE.POINT-POINT.
    """

    kind: Literal["levelling"]
    points: dict[Name, Coordinates] = Field(min_length=1, description="Name to coordinates.")
    relative_to: Name = Field(
        "ground", description="Point of the line to which the others refer, or fixed ground."
    )
    distortions: DistortionSection | None = optional(
        "Pairs whose angular distortion is read, the second point going down."
    )

    def check(self, faults: SectionFaults) -> None:
        """The points that are named are points of the line."""
        super().check(faults)
        known = ", ".join(self.points)
        if self.relative_to not in {"ground", *self.points}:
            message = f"there is no point '{self.relative_to}' in the line"
            faults.add(("relative_to",), "unknown-point", message, f"Its points: {known}.")
        for n, pair in enumerate(self.distortions.pairs if self.distortions else []):
            path = ("distortions", "pairs", n)
            if len(pair) != 2 or pair[0] == pair[1]:
                message = "expected two different points"
                faults.add(path, "wrong-pair", message, f"Points of the line: {known}.")
            for name in pair:
                if name not in self.points:
                    message = f"there is no point '{name}' in the line"
                    faults.add(path, "unknown-point", message, f"Its points: {known}.")

    def read_by(self, probe: str) -> GaugeBase:
        """Distortions are angles with errors of their own."""
        return self.distortions if probe == "distortions" and self.distortions else self

    def channels(self, name: str, context: Context) -> list[Channel]:
        """One channel for every point that is read, then one for every pair."""
        places = {key: context.at("points", key) for key in self.points}
        points = {key: places[key].vector(given) for key, given in self.points.items()}
        down = axis_vector(context.dim - 1, context.dim, -1.0)
        base = points.get(self.relative_to)
        channels = []
        for key, point in points.items():
            if key != self.relative_to:
                refuse_one_point(base, point, places[key])
                motion = Motion(base, point, down)
                channels.append(self.make_channel(f"{name}.{key}", name, motion, places[key].path))
        return channels + self._distorted(name, points, down, context)

    def _distorted(
        self, name: str, points: dict[str, Vector], down: Vector, context: Context
    ) -> list[Channel]:
        """Channels of the angular distortions."""
        channels: list[Channel] = []
        section = self.distortions
        for n, (a, b) in enumerate(section.pairs if section else []):
            assert section is not None
            place = context.at("distortions", "pairs", n)
            length = math.dist(points[a][:-1], points[b][:-1])
            if length == 0.0:
                message = f"'{a}' and '{b}' stand above each other, with no distance to divide by"
                place.refuse("zero-length", message, "Choose two points beside each other.")
                continue
            vector = tuple(x / length for x in down)
            terms = ((points[a], tuple(-x for x in vector)), (points[b], vector))
            motion = Motion(points[a], points[b], down)
            zeroed = section if "zero" in section.model_fields_set else self
            channel = section.make_channel(f"{name}.{a}-{b}", name, motion, place.path, terms=terms)
            channels.append(
                replace(channel, kind=self.kind, zero=zeroed.zero_stage, probe="distortions")
            )
        return channels


class LineOfSightSection(GaugeBase):
    """Motion along the line to a sensor: InSAR, radar, distance meter. Towards it is positive.

    One channel named as the gauge for one point, or GAUGE.POINT for several.
    """

    one_of = (
        *GaugeBase.one_of,
        Alternatives("point", "points", hint="Give exactly one of them."),
        Alternatives("direction", "sensor", "incidence azimuth?", hint="Give one of them."),
    )

    kind: Literal["line-of-sight"]
    point: Coordinates | None = optional("The point whose motion is read.")
    points: dict[Name, Coordinates] | None = optional(
        "In place of it, several: name to coordinates.", min_length=1
    )
    direction: DirectionVector | None = optional(
        "From the ground towards the sensor, of any length."
    )
    sensor: Coordinates | None = optional("In place of a direction: where the instrument stands.")
    incidence: FixedAngle | None = optional(
        "In place of a direction: angle between it and the vertical."
    )
    azimuth: FixedAngle | None = optional(
        "With incidence, in a solid: towards the sensor, clockwise from y; in a plane "
        "model the line leans towards x, or against it where incidence is negative."
    )
    positive: Literal["towards", "away"] = Field(
        "towards", description="Which motion counts as positive: towards the sensor or away."
    )
    relative_to: Reference = Field("ground", description="A reference point, or fixed ground.")

    def channels(self, name: str, context: Context) -> list[Channel]:
        """One channel for every point."""
        given = {name: (self.point or [], context.at("point"))}
        if self.points is not None:
            given = {
                f"{name}.{key}": (point, context.at("points", key))
                for key, point in self.points.items()
            }
        base = point_or_ground(self.relative_to, context.at("relative_to"))
        sign = 1.0 if self.positive == "towards" else -1.0
        channels = []
        for channel, (written, place) in given.items():
            point = place.vector(written)
            refuse_one_point(base, point, place)
            towards = tuple(sign * x for x in self._towards_sensor(point, context))
            channels.append(
                self.make_channel(channel, name, Motion(base, point, towards), place.path)
            )
        return channels

    def _towards_sensor(self, point: Vector, context: Context) -> Vector:
        """Unit vector (dim,) from a point to the sensor; zeros, with a fault, if there is none."""
        if self.direction is not None:
            place = context.at("direction")
            vector = unit_vector(place.vector(self.direction))
        elif self.sensor is not None:
            place = context.at("sensor")
            vector = unit_vector(subtract(place.vector(self.sensor), point))
        else:
            return self._from_angles(context)
        if not any(vector):
            message = "the direction towards the sensor has length zero"
            place.refuse("zero-direction", message, "Correct it.")
        return vector

    def _from_angles(self, context: Context) -> Vector:
        assert self.incidence is not None
        sine, cosine = math.sin(self.incidence.factor), math.cos(self.incidence.factor)
        if context.dim == 2:
            if self.azimuth is not None:
                message = "a plane model has no azimuth"
                hint = "Remove it; a negative incidence leans against x."
                context.at("azimuth").refuse("wrong-dimension", message, hint, key=True)
            return (sine, cosine)
        if self.azimuth is None:
            message = "'azimuth' is missing: the direction towards the sensor, clockwise from y"
            context.refuse("missing-key", message, "Add 'azimuth: 100 deg'.", key=True)
            return (0.0, 0.0, 0.0)
        angle = self.azimuth.factor
        return (sine * math.sin(angle), sine * math.cos(angle), cosine)


def _leaning(towards: Vector) -> tuple[Vector, ...]:
    """M (dim, dim) with M : grad u the rotation in which the top leans towards a direction s.

    With e upwards it is half of s . du/de - e . du/ds.
    """
    dim = len(towards)
    up = np.array(axis_vector(dim - 1, dim, 1.0))
    lean = np.outer(towards, up)
    half = 0.5 * (lean - lean.T)
    return tuple(tuple(float(x) for x in row) for row in half)


MotionSection = TiltSection | LevellingSection | LineOfSightSection
"""What a gauge may be that adds up motions of points."""
