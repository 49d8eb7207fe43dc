"""Instruments that read several motions, or a motion in several directions.

Inclinometers, total-station and GNSS targets, tiltmeters, levelling lines and lines of sight. All
are made into channels that add up motions of points (`model.gauges.Channel.motions`).
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import Annotated, Any, Literal

import numpy as np
from pydantic import Field, model_validator

from geoident.io.case.gauges.accuracy import AngleAccuracy, LengthAccuracy, check_parts
from geoident.io.case.gauges.gauge import (
    GaugeBase,
    GivenLength,
    Motion,
    Reference,
    axis_vector,
    point_of,
    refuse_one_point,
    unit_vector,
)
from geoident.io.schema.section import Context, SectionFaults, refuse
from geoident.io.schema.values import (
    Coordinates,
    DirectionVector,
    Given,
    GivenAngle,
    Length,
    Line,
    Name,
    Of,
    SharesUnit,
)
from geoident.model.arrays import Vector
from geoident.model.gauges import Channel, MovingPoint

DepthList = Annotated[list[Length], SharesUnit()]
AngleOffset = Annotated[Given, Of("angle", tied=True)]

_ON_LINE = 1e-9
"""Lengths below this part of a casing count as zero."""

_MOST_DEPTHS = 10_000


class InclinometerSection(GaugeBase):
    """Motion across a casing, depth by depth, relative to its bottom or its top.

    One channel per depth and axis, named GAUGE.A12.5 and GAUGE.B12.5, with the depth in metres;
    magnetic rings add GAUGE.S12.5, the settlement along the casing. Axis B is a quarter turn
    clockwise from A, seen from above.
    """

    kind: Literal["inclinometer"]
    casing: list[Coordinates] = Field(
        min_length=2,
        description="Points of the casing from its top to its bottom; straight between them.",
        examples=[["[12, 0 m]", "[12, -20 m]"]],
    )
    depths: DepthList | None = Field(
        None, description="Where it is read, measured along the casing from its top."
    )
    interval: GivenLength | None = Field(
        None, description="In place of depths: read every so far.", examples=["0.5 m"]
    )
    axes: list[Literal["A", "B"]] = Field(
        ["A"], min_length=1, max_length=2, description="Axes that are read; B in a solid only."
    )
    A: DirectionVector | None = Field(
        None,
        description="Horizontal direction of axis A; if missing: x in a plane model.",
    )
    reads_as: Literal["cumulated", "incremental"] = Field(
        "cumulated",
        alias="reading",
        description="cumulated: motion against the reference end; incremental: of each depth "
        "against the next one towards the reference end.",
    )
    relative_to: Literal["bottom", "top"] = Field(
        "bottom", description="Reference end of the casing."
    )
    rings: DepthList = Field(
        [], description="Depths of magnetic rings, whose settlement along the casing is read."
    )
    ring_accuracy: LengthAccuracy | None = Field(
        None,
        description="Accuracy of the settlement of a ring, which another probe reads than that "
        "across the casing; needed with rings.",
        examples=["1 mm"],
    )

    @model_validator(mode="after")
    def _consistent(self) -> InclinometerSection:
        faults = SectionFaults()
        if (self.depths is None) == (self.interval is None):
            found = "neither" if self.depths is None else "both"
            message = f"found {found}; either depths or interval is expected"
            faults.add((), "wrong-pair", message, "Give exactly one of them.")
        if (self.ring_accuracy is None) == bool(self.rings):
            message = "found one of rings and ring_accuracy; both or none are expected"
            hint = "Rings are read by another probe: add 'ring_accuracy: 1 mm' to 'rings'."
            faults.add((), "wrong-pair", message, hint)
        if len(set(self.axes)) < len(self.axes):
            message = f"axis {self.axes[0]} is listed twice"
            faults.add(("axes", 1), "duplicate", message, "Remove one.")
        for key, given in (("depths", self.depths or []), ("rings", self.rings)):
            seen: set[str] = set()
            for n, depth in enumerate(given):
                if _metres(depth.factor) in seen:
                    message = f"the depth {depth.text} is listed twice"
                    faults.add((key, n), "duplicate", message, "Remove one.")
                seen.add(_metres(depth.factor))
        faults.raise_any()
        return self

    @model_validator(mode="after")
    def _sizes_of_ring_errors(self) -> InclinometerSection:
        if self.ring_accuracy is not None:
            check_parts(self.ring_accuracy, self.dimension, self.kind, "ring_accuracy")
        return self

    def sections(self, name: str) -> dict[str, GaugeBase]:
        """Rings have an accuracy of their own."""
        rings = dict.fromkeys(self._ring_names(name), self._of_rings())
        return super().sections(name) | rings

    def _of_rings(self) -> InclinometerSection:
        """What is said of the rings, as of a gauge of their own."""
        if self.ring_accuracy is None:
            return self
        return self.model_copy(update={"accuracy": self.ring_accuracy})

    def _ring_names(self, name: str) -> list[str]:
        return [f"{name}.S{_metres(ring.factor)}" for ring in self.rings]

    def channel_names(self, name: str) -> list[str]:
        """One name for every axis and depth, then one for every ring."""
        depths = self._read_depths()
        names = [f"{name}.{axis}{_metres(depth)}" for axis in self.axes for depth in depths]
        return names + self._ring_names(name)

    def channels(self, name: str, context: Context) -> list[Channel]:
        """One channel for every axis and depth, then one for every ring."""
        casing = self._casing(context)
        if casing is None:
            return []
        if len(self._read_depths()) > _MOST_DEPTHS:
            message = f"more than {_MOST_DEPTHS} depths in a casing of {casing.length:.6g} m"
            place = context.at("interval" if self.depths is None else "depths")
            place.refuse("too-many-depths", message, "Let them be farther apart.")
            return []
        found: list[Channel] = []
        for axis in self.axes:
            across = self._axis(axis, casing, context)
            if across is not None:
                found += self._along(name, axis, (casing, across), context)
        found += self._along(name, "S", (casing, casing.tangents), context)
        return found

    def _along(
        self, name: str, axis: str, what: tuple[_Casing, list[Vector]], context: Context
    ) -> list[Channel]:
        """Channels of one axis; ``what`` is the casing and what is read of each of its pieces."""
        casing, vectors = what
        key = "rings" if axis == "S" else "interval" if self.depths is None else "depths"
        depths = [ring.factor for ring in self.rings] if axis == "S" else self._read_depths()
        end = casing.length if self.relative_to == "bottom" else 0.0
        read_by = self._of_rings() if axis == "S" else self
        found = []
        for n, depth in enumerate(depths):
            place = context.at(key) if key == "interval" else context.at(key, n)
            if not self._within(depth, end, casing, place):
                continue
            reference = end if axis == "S" else self._reference(depth, depths, end)
            motion, terms = casing.motion(self.kind, reference, depth, vectors)
            channel_name = f"{name}.{axis}{_metres(depth)}"
            channel = read_by.reads(channel_name, name, motion, place.path, terms)
            # cumulated readings share what adds up from the end on; an increment has its own length
            # only, and rings are read one by one
            cumulated = self.reads_as == "cumulated" and axis != "S"
            length = 0.0 if axis == "S" else abs(depth - reference)
            found.append(replace(channel, run=f"{name}.{axis}" * cumulated, along=length))
        return found

    def _reference(self, depth: float, depths: Sequence[float], end: float) -> float:
        """Depth against which a depth is read, m."""
        if self.reads_as == "cumulated":
            return end
        between = [d for d in (*depths, end) if (d - depth) * (end - depth) > 0]
        return min(between, key=lambda d: abs(d - depth))

    def _within(self, depth: float, end: float, casing: _Casing, place: Context) -> bool:
        """Whether something can be read at a depth; a fault if not."""
        small = _ON_LINE * casing.length
        if not -small <= depth <= casing.length + small:
            message = f"the depth {_metres(depth)} m lies beyond the casing, which is "
            message += f"{casing.length:.6g} m long"
            place.refuse("outside-casing", message, "Correct the depth or the casing.")
            return False
        if abs(depth - end) <= small:
            message = f"the depth {_metres(depth)} m is the {self.relative_to} of the casing, to "
            message += "which all readings are relative: it always reads zero"
            place.refuse("zero-length", message, "Remove it, or correct 'relative_to'.")
            return False
        return True

    def _read_depths(self) -> list[float]:
        """Depths that are read, m; none of them the reference end where an interval is given."""
        if self.depths is not None:
            return [depth.factor for depth in self.depths]
        if self.interval is None:
            return []
        points = [[x.factor for x in point] for point in self.casing]
        if len({len(point) for point in points}) > 1:
            return []  # a fault of the casing
        length = sum(math.dist(a, b) for a, b in pairwise(points))
        step, small = self.interval.factor, _ON_LINE * length
        if self.relative_to == "bottom":
            count = min(math.ceil((length - small) / step), _MOST_DEPTHS + 1)
            return [round(n * step, 9) for n in range(count)]
        count = min(math.floor((length + small) / step), _MOST_DEPTHS + 1)
        return [round(n * step, 9) for n in range(1, count + 1)]

    def _casing(self, context: Context) -> _Casing | None:
        """The casing; None, with a fault, where it cannot be."""
        points: list[Vector] = []
        for n, given in enumerate(self.casing):
            point = point_of(given, context.at("casing", n))
            if point is None:
                return None
            if points and point == points[-1]:
                message = "two points of the casing that follow each other are the same"
                context.at("casing", n).refuse("zero-length", message, "Remove one.")
                return None
            points.append(point)
        if points[0][-1] < points[-1][-1]:
            message = "the first point of the casing lies below the last one; its top comes first"
            context.at("casing").refuse("upside-down", message, "Reverse the list of points.")
            return None
        return _Casing(points)

    def _axis(self, axis: str, casing: _Casing, context: Context) -> list[Vector] | None:
        """Direction (dim,) of an axis in each piece of the casing; None, with a fault, if none."""
        if axis == "B" and context.dim == 2:
            message = "a plane model has no axis B: nothing moves out of the plane"
            context.at("axes", self.axes.index("B")).refuse(
                "wrong-dimension", message, "Remove B, and let A lie in the plane."
            )
            return None
        if self.A is None and context.dim == 3:
            if axis == self.axes[0]:
                message = "'A' is missing: the horizontal direction of axis A"
                context.refuse("missing-key", message, "Add 'A: [1, 0, 0]'.", key=True)
            return None
        given = axis_vector(0, context.dim, 1.0)
        if self.A is not None:
            written = context.at("A").vector(self.A, "the direction")
            if written is None:
                return None
            given = written
        found = []
        for tangent in casing.tangents:
            across = _across(given, tangent)
            if across is None:
                message = "axis A has no direction across the casing"
                hint = "Give a direction that is not along the casing."
                context.at("A").refuse("zero-direction", message, hint, key=self.A is None)
                return None
            found.append(across if axis == "A" else _cross(tangent, across))
        return found


@dataclass(frozen=True)
class _Casing:
    """A chain of straight pieces.

    Args:
        points: its m + 1 points from the top on, m.
    """

    points: list[Vector]

    @property
    def tangents(self) -> list[Vector]:
        """Directions of its m pieces, downwards."""
        return [
            unit_vector(tuple(y - x for x, y in zip(a, b, strict=True))) or a
            for a, b in pairwise(self.points)
        ]

    @property
    def starts(self) -> list[float]:
        """Depths along the casing of its m + 1 points, m."""
        found = [0.0]
        for a, b in pairwise(self.points):
            found.append(found[-1] + math.dist(a, b))
        return found

    @property
    def length(self) -> float:
        """Of the whole, m."""
        return self.starts[-1]

    def at(self, depth: float) -> Vector:
        """The point at a depth along the casing, m."""
        starts = self.starts
        for k, (a, b) in enumerate(zip(self.points, self.points[1:], strict=False)):
            if depth <= starts[k + 1] or k == len(self.points) - 2:
                share = (depth - starts[k]) / (starts[k + 1] - starts[k])
                return tuple(x + share * (y - x) for x, y in zip(a, b, strict=True))
        raise AssertionError

    def motion(
        self, kind: str, reference: float, depth: float, vectors: Sequence[Vector]
    ) -> tuple[Motion, tuple[MovingPoint, ...]]:
        """Motion at a depth against that at another, added up piece by piece.

        Where the casing bends, what is across it turns: an inclinometer adds up what it reads on
        each piece in its own direction.

        Args:
            kind: of the gauge.
            reference: depth that counts as fixed, m.
            depth: the depth, m.
            vectors: what is read in each piece, unit vectors.
        """
        starts = self.starts
        low, high = sorted((reference, depth))
        pieces = [
            (max(low, starts[k]), min(high, starts[k + 1]), vector)
            for k, vector in enumerate(vectors)
            if min(high, starts[k + 1]) - max(low, starts[k]) > _ON_LINE * starts[-1]
        ]
        up = depth < reference
        terms: list[MovingPoint] = []
        for start, end, vector in pieces:
            near, far = (start, end) if up else (end, start)
            terms += [(self.at(far), tuple(-x for x in vector)), (self.at(near), vector)]
        nearest = pieces[0] if up else pieces[-1]
        motion = (kind, self.at(reference), self.at(depth), nearest[2])
        return motion, tuple(terms) if len(pieces) > 1 else ()


TargetComponent = Literal["along", "across", "up", "x", "y", "z"]


class TargetSection(GaugeBase):
    """A point that is surveyed by total station or GNSS: its motion in up to three directions.

    One channel per component, named GAUGE.COMPONENT: along, across (to the right, looking along)
    and up; or x, y and z.
    """

    kind: Literal["target"]
    point: Coordinates | None = Field(None, description="Coordinates of the target.")
    chainage: Length | None = Field(
        None, description="In place of the point: chainage on the alignment (solid)."
    )
    alignment: list[Coordinates] | None = Field(
        None, min_length=2, description="Points of the axis from its beginning on."
    )
    start_chainage: Length = Field(
        Given("0 m", 0.0, None, "length", "m"), description="Chainage where the alignment begins."
    )
    beside: Annotated[list[Length], SharesUnit()] | None = Field(
        None,
        min_length=2,
        max_length=2,
        description="How far to the right of the alignment the target is, and how far above it.",
    )
    components: list[TargetComponent] | None = Field(
        None,
        min_length=1,
        description="What is read; if missing: across and up in a plane model, x, y and z in a "
        "solid, along, across and up where 'along' or an alignment is given.",
    )
    along: DirectionVector | None = Field(
        None, description="Horizontal direction of growing chainage (solid)."
    )
    relative_to: Reference = Field("ground", description="A point, or fixed ground.")

    @model_validator(mode="after")
    def _consistent(self) -> TargetSection:
        faults = SectionFaults()
        placed = (self.chainage, self.alignment, self.beside)
        if self.point is None and None in placed:
            message = "the place is missing; either point, or chainage, alignment and beside are "
            faults.add((), "wrong-pair", message + "expected", "Give 'point'.")
        if self.point is not None and any(key is not None for key in placed):
            message = "found point and a place on an alignment; one of them is expected"
            faults.add((), "wrong-pair", message, "Give exactly one of them.")
        if self.alignment is not None and self.along is not None:
            message = "found along and alignment, which has a direction itself"
            faults.add(("along",), "wrong-pair", message, "Remove 'along'.")
        chosen = self.components or []
        for n, component in enumerate(chosen):
            if component in chosen[:n]:
                message = f"the component {component} is listed twice"
                faults.add(("components", n), "duplicate", message, "Remove one.")
        faults.raise_any()
        return self

    def chosen(self) -> list[str]:
        """Components that are read."""
        if self.components is not None:
            return list(self.components)
        if self.alignment is not None or self.along is not None:
            return ["along", "across", "up"]
        plane = self.point is not None and len(self.point) == 2
        return ["across", "up"] if plane else ["x", "y", "z"]

    def channel_names(self, name: str) -> list[str]:
        """One name for every component."""
        return [f"{name}.{component}" for component in self.chosen()]

    def directions(self, context: Context) -> dict[str, Vector] | None:
        """Unit vectors (dim,) of the components that are read; None, with a fault, if not all are.

        Args:
            context: of the gauge.
        """
        known: dict[str, Vector]
        if context.dim == 2:
            known = {"across": (1.0, 0.0), "up": (0.0, 1.0), "x": (1.0, 0.0), "y": (0.0, 1.0)}
        else:
            known = dict(zip("xyz", (axis_vector(n, 3, 1.0) for n in range(3)), strict=True))
            known["up"] = axis_vector(2, 3, 1.0)
            along = self._along(context)
            if along is not None:
                known.update(along=along, across=_cross(along, known["up"]))
        found = {}
        for n, component in enumerate(self.chosen()):
            if component in known:
                found[component] = known[component]
                continue
            place = context if self.components is None else context.at("components", n)
            if context.dim == 2:
                message = f"a plane model has no motion along '{component}'"
                place.refuse("wrong-dimension", message, "Use across and up, or x and y.")
            else:
                message = f"the component '{component}' needs the direction of the axis"
                place.refuse("missing-key", message, "Add 'along: [0, 1, 0]' or an alignment.")
            return None
        return found

    def channels(self, name: str, context: Context) -> list[Channel]:
        """One channel for every component."""
        if self.alignment is not None and self._piece(context) is None:
            return []
        directions = self.directions(context)
        point, place = self._place(context)
        first = None
        if not isinstance(self.relative_to, str):
            first = point_of(self.relative_to, context.at("relative_to"))
            if first is None:
                return []
        if directions is None or point is None:
            return []
        if first == point:
            refuse_one_point(context.at("relative_to"))
            return []
        return [
            self.reads(f"{name}.{component}", name, (self.kind, first, point, vector), place.path)
            for component, vector in directions.items()
        ]

    def _along(self, context: Context) -> Vector | None:
        """Horizontal unit vector of growing chainage; None where none is given."""
        if self.alignment is not None:
            piece = self._piece(context)
            return None if piece is None else unit_vector((*piece[1][:2], 0.0))
        if self.along is None:
            return None
        given = context.at("along").vector(self.along, "the direction")
        if given is None:
            return None
        level = unit_vector((*given[:2], 0.0))
        if level is None:
            message = "the direction along the axis is vertical or has length zero"
            context.at("along").refuse("zero-direction", message, "Give a horizontal direction.")
        return level

    def _place(self, context: Context) -> tuple[Vector | None, Context]:
        """The point, and where it is written."""
        if self.point is not None:
            return point_of(self.point, context.at("point")), context.at("point")
        place = context.at("chainage")
        piece = self._piece(context)
        if piece is None or self.beside is None:
            return None, place
        on, tangent = piece
        level = unit_vector((*tangent[:2], 0.0))
        if level is None:
            return None, place
        right, up = _cross(level, (0.0, 0.0, 1.0)), self.beside[1].factor
        moved = [x + self.beside[0].factor * r for x, r in zip(on, right, strict=True)]
        return (moved[0], moved[1], moved[2] + up), place

    def _piece(self, context: Context) -> tuple[Vector, Vector] | None:
        """The point of the alignment at the chainage, and its direction there."""
        if context.dim == 2:
            message = "an alignment in a plane model"
            context.at("alignment").refuse("wrong-dimension", message, "Give 'point'.", key=True)
            return None
        points = []
        for n, given in enumerate(self.alignment or []):
            point = point_of(given, context.at("alignment", n))
            if point is None:
                return None
            points.append(point)
        assert self.chainage is not None
        # chainage is measured in plan
        plan = [math.dist(a[:2], b[:2]) for a, b in pairwise(points)]
        ahead = self.chainage.factor - self.start_chainage.factor
        if not 0.0 <= ahead <= sum(plan) * (1 + _ON_LINE) or not all(plan):
            start = self.start_chainage.factor
            message = f"the chainage {self.chainage.text} is not on the alignment, which reaches "
            message += f"from {start:.6g} m to {start + sum(plan):.6g} m in plan"
            context.at("chainage").refuse("outside-alignment", message, "Correct one of them.")
            return None
        for a, b, length in zip(points, points[1:], plan, strict=False):
            if ahead <= length * (1 + _ON_LINE) or b is points[-1]:
                tangent = tuple(y - x for x, y in zip(a, b, strict=True))
                return tuple(
                    x + ahead / length * t for x, t in zip(a, tangent, strict=True)
                ), tangent
            ahead -= length
        return None


class _AngleGauge(GaugeBase):
    """A gauge whose readings are angles."""

    accuracy: AngleAccuracy = Field(
        description="Standard deviation of one reading.", examples=["0.05 mm/m"]
    )
    offset: AngleOffset | None = Field(None, description="Added to all readings after the zero.")
    drift_per_stage: AngleOffset | None = Field(
        None, description="Drift of the gauge per stage since its zero."
    )

    @model_validator(mode="after")
    def _no_drift(self) -> _AngleGauge:
        if self.drift is not None:
            message = "a drift in time is a length by a time; this gauge reads angles"
            refuse(("drift",), "wrong-dimension", message, "Use 'drift_per_stage'.")
        return self


class TiltSection(_AngleGauge):
    """Rotation of a point of the ground, of a beam or of a pair of points, in a vertical plane.

    Positive where the top leans towards a direction. At a point it is the rotation of the ground
    there, without its distortion; of two points that of the line from one to the other.
    """

    kind: Literal["tilt"]
    point: Coordinates | None = Field(None, description="The point whose rotation is read.")
    on: Name | None = Field(
        None, description="Beam (a wall, a lining) whose rotation is read at the point."
    )
    between: Line | None = Field(None, description="In place of it, two points.")
    towards: DirectionVector | None = Field(
        None,
        description="Horizontal direction in which the top leans where the reading is positive; "
        "if missing: x in a plane model.",
    )

    @property
    def structure(self) -> str | None:
        """The beam on which it sits, if it does."""
        return self.on

    @model_validator(mode="after")
    def _one_place(self) -> TiltSection:
        if (self.point is None) == (self.between is None):
            found = "neither" if self.point is None else "both"
            message = f"found {found}; either point or between is expected"
            refuse((), "wrong-pair", message, "Give exactly one of them.")
        if self.on is not None and self.point is None:
            message = "'on' goes with a point: two points have a rotation without it"
            refuse(("on",), "wrong-pair", message, "Give 'point', or remove 'on'.")
        return self

    def channels(self, name: str, context: Context) -> list[Channel]:
        """The one channel."""
        towards = self._towards(context)
        if towards is None:
            return []
        if self.point is not None:
            point = point_of(self.point, context.at("point"))
            if point is None:
                return []
            motion = (self.kind, None, point, towards)
            if self.on is not None:
                return [replace(self.reads(name, name, motion, context.path), structure=self.on)]
            return [replace(self.reads(name, name, motion, context.path), turns=_leaning(towards))]
        return self._pair(name, towards, context)

    def _pair(self, name: str, towards: Vector, context: Context) -> list[Channel]:
        place = context.at("between")
        ends = [point_of(given, place.at(n)) for n, given in enumerate(self.between or [])]
        first, second = ends
        if first is None or second is None:
            return []
        apart = [b - a for a, b in zip(first, second, strict=True)]
        length = math.hypot(*apart)
        if length == 0.0:
            refuse_one_point(place)
            return []
        # A rotation by the angle 1 moves the second point against the first by this vector.
        sweep = 2.0 * np.array(_leaning(towards)) @ np.array(apart)
        size = float(sweep @ sweep)
        if size <= _ON_LINE * length**2:
            message = "the line between the two points does not turn when it leans in the direction"
            hint = "Give points above each other, or beside each other in that direction."
            context.at("towards" if self.towards is not None else "between").refuse(
                "zero-direction", message, hint
            )
            return []
        vector = tuple(float(x) for x in sweep / size)
        terms = ((first, tuple(-x for x in vector)), (second, vector))
        motion = (self.kind, first, second, unit_vector(vector) or vector)
        return [self.reads(name, name, motion, context.path, terms)]

    def _towards(self, context: Context) -> Vector | None:
        """Horizontal unit vector (dim,); None, with a fault, where there is none."""
        if self.towards is None:
            if context.dim == 2:
                return axis_vector(0, 2, 1.0)
            message = "'towards' is missing: the direction in which the top leans"
            context.refuse("missing-key", message, "Add 'towards: [1, 0, 0]'.", key=True)
            return None
        given = context.at("towards").vector(self.towards, "the direction")
        if given is None:
            return None
        level = unit_vector((*given[:-1], 0.0))
        if level is None:
            message = "the direction is vertical or has length zero"
            context.at("towards").refuse("zero-direction", message, "Give a horizontal direction.")
        return level


class DistortionSection(_AngleGauge):
    """Angular distortion of pairs of points: difference of their settlements by their distance."""

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
    distortions: DistortionSection | None = Field(
        None, description="Pairs whose angular distortion is read, the second point going down."
    )

    @model_validator(mode="after")
    def _known_points(self) -> LevellingSection:
        faults = SectionFaults()
        known = ", ".join(self.points)
        if self.relative_to not in {"ground", *self.points}:
            message = f"there is no point '{self.relative_to}' in the line"
            faults.add(("relative_to",), "unknown-point", message, f"Its points: {known}.")
        for n, pair in enumerate(self.distortions.pairs if self.distortions else []):
            path = ("distortions", "pairs", n)
            if len(pair) != 2 or pair[0] == pair[1]:
                message = "two different points are expected"
                faults.add(path, "wrong-pair", message, f"Points of the line: {known}.")
            for name in pair:
                if name not in self.points:
                    message = f"there is no point '{name}' in the line"
                    faults.add(path, "unknown-point", message, f"Its points: {known}.")
        faults.raise_any()
        return self

    def channel_names(self, name: str) -> list[str]:
        """One name for every point that is read, then one for every pair."""
        read = [f"{name}.{point}" for point in self.points if point != self.relative_to]
        pairs = self.distortions.pairs if self.distortions else []
        return read + [f"{name}.{a}-{b}" for a, b in pairs]

    def sections(self, name: str) -> dict[str, GaugeBase]:
        """Distortions are angles with errors of their own; they share the zero unless they say."""
        found, pairs = super().sections(name), self.distortions
        if pairs is not None:
            own_zero = "zero" in pairs.model_fields_set
            own = pairs if own_zero else pairs.model_copy(update={"zero": self.zero})
            found |= dict.fromkeys((f"{name}.{a}-{b}" for a, b in pairs.pairs), own)
        return found

    def channels(self, name: str, context: Context) -> list[Channel]:
        """One channel for every point that is read, then one for every pair."""
        places = {key: context.at("points", key) for key in self.points}
        at = {key: point_of(given, places[key]) for key, given in self.points.items()}
        points = {key: point for key, point in at.items() if point is not None}
        if len(points) < len(at):
            return []
        down = axis_vector(context.dim - 1, context.dim, -1.0)
        base = points.get(self.relative_to)
        found = []
        for key, point in points.items():
            if key == self.relative_to:
                continue
            if point == base:
                refuse_one_point(places[key])
                continue
            motion = (self.kind, base, point, down)
            found.append(self.reads(f"{name}.{key}", name, motion, places[key].path))
        return found + self._distorted(name, points, down, context)

    def _distorted(
        self, name: str, points: dict[str, Vector], down: Vector, context: Context
    ) -> list[Channel]:
        """Channels of the angular distortions."""
        found: list[Channel] = []
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
            motion = (self.kind, points[a], points[b], down)
            channel = section.reads(f"{name}.{a}-{b}", name, motion, place.path, terms)
            own_zero = "zero" in section.model_fields_set
            found.append(channel if own_zero else replace(channel, zero=self.zero))
        return found


class LineOfSightSection(GaugeBase):
    """Motion along the line to a sensor: InSAR, radar, distance meter. Towards it is positive.

    One channel named as the gauge for one point, or GAUGE.POINT for several.
    """

    kind: Literal["line-of-sight"]
    point: Coordinates | None = Field(None, description="The point whose motion is read.")
    points: dict[Name, Coordinates] | None = Field(
        None, min_length=1, description="In place of it, several: name to coordinates."
    )
    direction: DirectionVector | None = Field(
        None, description="From the ground towards the sensor, of any length."
    )
    sensor: Coordinates | None = Field(
        None, description="In place of a direction: where the instrument stands."
    )
    incidence: GivenAngle | None = Field(
        None, description="In place of a direction: angle between it and the vertical."
    )
    azimuth: GivenAngle | None = Field(
        None,
        description="With incidence, in a solid: towards the sensor, clockwise from y; in a plane "
        "model the line leans towards x, or against it where incidence is negative.",
    )
    positive: Literal["towards", "away"] = Field(
        "towards", description="Which motion counts as positive: towards the sensor or away."
    )
    relative_to: Reference = Field("ground", description="A reference point, or fixed ground.")

    @model_validator(mode="after")
    def _consistent(self) -> LineOfSightSection:
        faults = SectionFaults()
        if (self.point is None) == (self.points is None):
            found = "neither" if self.point is None else "both"
            message = f"found {found}; either point or points is expected"
            faults.add((), "wrong-pair", message, "Give exactly one of them.")
        ways = ("direction", "sensor", "incidence")
        given = [key for key in ways if getattr(self, key) is not None]
        if len(given) != 1:
            message = f"found {' and '.join(given) or 'no direction'}; one of direction, sensor "
            faults.add((), "wrong-pair", message + "and incidence is expected", "Give one of them.")
        if self.azimuth is not None and self.incidence is None:
            message = "an azimuth goes with an incidence"
            faults.add(("azimuth",), "wrong-pair", message, "Add 'incidence', or remove it.")
        faults.raise_any()
        return self

    def channel_names(self, name: str) -> list[str]:
        """One name for every point."""
        return [name] if self.points is None else [f"{name}.{point}" for point in self.points]

    def channels(self, name: str, context: Context) -> list[Channel]:
        """One channel for every point."""
        given: dict[str, Any] = {name: (self.point, context.at("point"))}
        if self.points is not None:
            given = {
                f"{name}.{key}": (point, context.at("points", key))
                for key, point in self.points.items()
            }
        base = None
        if not isinstance(self.relative_to, str):
            base = point_of(self.relative_to, context.at("relative_to"))
            if base is None:
                return []
        found = []
        for channel, (written, place) in given.items():
            point = point_of(written, place)
            vector = None if point is None else self._sight(point, context)
            if point is None or vector is None:
                continue
            if point == base:
                refuse_one_point(place)
                continue
            found.append(self.reads(channel, name, (self.kind, base, point, vector), place.path))
        return found

    def _sight(self, point: Vector, context: Context) -> Vector | None:
        """Unit vector (dim,) in which a motion is positive; None, with a fault, if none."""
        towards = self._towards_sensor(point, context)
        if towards is None:
            return None
        return towards if self.positive == "towards" else tuple(-x for x in towards)

    def _towards_sensor(self, point: Vector, context: Context) -> Vector | None:
        if self.direction is not None:
            place, given = context.at("direction"), self.direction
            vector = place.vector(given, "the direction")
        elif self.sensor is not None:
            place = context.at("sensor")
            stands = point_of(self.sensor, place)
            vector = None
            if stands is not None:
                vector = tuple(b - a for a, b in zip(point, stands, strict=True))
        else:
            return self._from_angles(context)
        if vector is None:
            return None
        found = unit_vector(vector)
        if found is None:
            message = "the direction towards the sensor has length zero"
            place.refuse("zero-direction", message, "Correct it.")
        return found

    def _from_angles(self, context: Context) -> Vector | None:
        assert self.incidence is not None
        sine, cosine = math.sin(self.incidence.factor), math.cos(self.incidence.factor)
        if context.dim == 2:
            if self.azimuth is not None:
                message = "a plane model has no azimuth"
                hint = "Remove it; a negative incidence leans against x."
                context.at("azimuth").refuse("wrong-dimension", message, hint, key=True)
                return None
            return (sine, cosine)
        if self.azimuth is None:
            message = "'azimuth' is missing: the direction towards the sensor, clockwise from y"
            context.refuse("missing-key", message, "Add 'azimuth: 100 deg'.", key=True)
            return None
        angle = self.azimuth.factor
        return (sine * math.sin(angle), sine * math.cos(angle), cosine)


def _metres(depth: float) -> str:
    """A depth as it stands in the name of a channel.

    >>> _metres(12.5), _metres(3.0)
    ('12.5', '3')
    """
    return f"{depth:.6g}"


def _across(given: Vector, tangent: Vector) -> Vector | None:
    """The unit vector across a tangent that is nearest to a vector; None along the tangent."""
    share = sum(x * t for x, t in zip(given, tangent, strict=True))
    rest = tuple(x - share * t for x, t in zip(given, tangent, strict=True))
    if math.hypot(*rest) <= _ON_LINE * math.hypot(*given):
        return None
    return unit_vector(rest)


def _cross(a: Vector, b: Vector) -> Vector:
    """Vector product in space."""
    return tuple(float(x) for x in np.cross(a, b))


def _leaning(towards: Vector) -> tuple[Vector, ...]:
    """M (dim, dim) with M : grad u the rotation in which the top leans towards a direction s.

    With e upwards it is half of s . du/de - e . du/ds.
    """
    dim = len(towards)
    up = np.array(axis_vector(dim - 1, dim, 1.0))
    lean = np.outer(towards, up)
    half = 0.5 * (lean - lean.T)
    return tuple(tuple(float(x) for x in row) for row in half)
