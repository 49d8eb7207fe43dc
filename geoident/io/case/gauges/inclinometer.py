"""Inclinometers: channels that add up what is read across each piece of a casing."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Annotated, Literal

from pydantic import Field

from geoident.io.case.gauges.accuracy import LengthAccuracy, check_parts
from geoident.io.case.gauges.gauge import (
    GaugeBase,
    Motion,
    axis_vector,
    cross_product,
    subtract,
    unit_vector,
)
from geoident.io.schema.section import Alternatives, Context, SectionFaults, optional
from geoident.io.schema.values import (
    Coordinates,
    DirectionVector,
    FixedLength,
    FixedSize,
    SharesUnit,
)
from geoident.model.arrays import Vector
from geoident.model.gauges import Channel, MovingPoint

DepthList = Annotated[list[FixedLength], SharesUnit()]

_ON_LINE = 1e-9
"""Lengths below this part of a casing count as zero."""

_MOST_DEPTHS = 10_000


class InclinometerSection(GaugeBase):
    """Motion across a casing, depth by depth, relative to its bottom or its top.

    One channel per depth and axis, named GAUGE.A12.5 and GAUGE.B12.5, with the depth in metres;
    magnetic rings add GAUGE.S12.5, the settlement along the casing. Axis B is a quarter turn
    clockwise from A, seen from above.
    """

    one_of = (
        *GaugeBase.one_of,
        Alternatives("depths", "interval", hint="Give exactly one of them."),
    )

    kind: Literal["inclinometer"]
    casing: list[Coordinates] = Field(
        min_length=2,
        description="Points of the casing from its top to its bottom; straight between them.",
        examples=[["[12, 0 m]", "[12, -20 m]"]],
    )
    depths: DepthList | None = optional("Where it is read, measured along the casing from its top.")
    interval: FixedSize | None = optional(
        "In place of depths: read every so far.", examples=["0.5 m"]
    )
    axes: list[Literal["A", "B"]] = Field(
        ["A"], min_length=1, max_length=2, description="Axes that are read; B in a solid only."
    )
    A: DirectionVector | None = optional(
        "Horizontal direction of axis A; if missing: x in a plane model."
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
    ring_accuracy: LengthAccuracy | None = optional(
        "Accuracy of the settlement of a ring, which another probe reads than that "
        "across the casing; needed with rings.",
        examples=["1 mm"],
    )

    def check(self, faults: SectionFaults) -> None:
        """Rings have an accuracy, and no axis and no depth is listed twice."""
        super().check(faults)
        if (self.ring_accuracy is None) == bool(self.rings):
            message = "found one of rings and ring_accuracy; expected both or none"
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
        if self.ring_accuracy is not None:
            check_parts(self.ring_accuracy, self.dimension, self.kind, faults, "ring_accuracy")

    def read_by(self, probe: str) -> GaugeBase:
        """Rings have an accuracy of their own."""
        return self._of_rings() if probe == "rings" else self

    def _of_rings(self) -> InclinometerSection:
        """What is said of the rings, as of a gauge of their own."""
        if self.ring_accuracy is None:
            return self
        return self.model_copy(update={"accuracy": self.ring_accuracy})

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
        channels: list[Channel] = []
        for axis in self.axes:
            across = self._axis(axis, casing, context)
            if across is not None:
                channels += self._along(name, axis, (casing, across), context)
        channels += self._along(name, "S", (casing, casing.tangents), context)
        return channels

    def _along(
        self, name: str, axis: str, what: tuple[_Casing, list[Vector]], context: Context
    ) -> list[Channel]:
        """Channels of one axis; ``what`` is the casing and what is read of each of its pieces."""
        casing, vectors = what
        key = "rings" if axis == "S" else "interval" if self.depths is None else "depths"
        depths = [ring.factor for ring in self.rings] if axis == "S" else self._read_depths()
        end = casing.length if self.relative_to == "bottom" else 0.0
        read_by = self._of_rings() if axis == "S" else self
        channels = []
        for n, depth in enumerate(depths):
            place = context.at(key) if key == "interval" else context.at(key, n)
            if not self._within(depth, end, casing, place):
                continue
            reference = end if axis == "S" else self._reference(depth, depths, end)
            motion, terms = casing.motion(reference, depth, vectors)
            channel = f"{name}.{axis}{_metres(depth)}"
            # cumulated readings share what adds up from the end on; an increment has its own length
            # only, and rings are read one by one
            cumulated = self.reads_as == "cumulated" and axis != "S"
            length = 0.0 if axis == "S" else abs(depth - reference)
            run, probe = f"{name}.{axis}" * cumulated, "rings" * (axis == "S")
            own = {"terms": terms, "run": run, "along": length, "probe": probe}
            channels.append(read_by.make_channel(channel, name, motion, place.path, **own))
        return channels

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
            point = context.at("casing", n).vector(given)
            if points and point == points[-1]:
                message = "two points of the casing that follow each other are the same"
                context.at("casing", n).refuse("zero-length", message, "Remove one.")
                return None
            points.append(point)
        if math.isnan(sum(map(sum, points))):
            return None  # a point is wrong
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
            given = context.at("A").vector(self.A)
        directions = []
        for tangent in casing.tangents:
            across = _across(given, tangent)
            if across is None:
                message = "axis A has no direction across the casing"
                hint = "Give a direction that is not along the casing."
                context.at("A").refuse("zero-direction", message, hint, key=self.A is None)
                return None
            directions.append(across if axis == "A" else cross_product(tangent, across))
        return directions


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
        return [unit_vector(subtract(b, a)) for a, b in pairwise(self.points)]

    @property
    def starts(self) -> list[float]:
        """Depths along the casing of its m + 1 points, m."""
        depths = [0.0]
        for a, b in pairwise(self.points):
            depths.append(depths[-1] + math.dist(a, b))
        return depths

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
        self, reference: float, depth: float, vectors: Sequence[Vector]
    ) -> tuple[Motion, tuple[MovingPoint, ...]]:
        """Motion at a depth against that at another, added up piece by piece.

        Where the casing bends, what is across it turns: an inclinometer adds up what it reads on
        each piece in its own direction.

        Args:
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
        motion = Motion(self.at(reference), self.at(depth), nearest[2])
        return motion, tuple(terms) if len(pieces) > 1 else ()


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
