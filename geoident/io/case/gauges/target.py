"""Targets of total stations and GNSS: motions along, across and up, at a point or a chainage."""

from __future__ import annotations

import math
from itertools import pairwise
from typing import Annotated, Literal

from pydantic import Field

from geoident.io.case.gauges.gauge import (
    GaugeBase,
    Motion,
    Reference,
    axis_vector,
    cross_product,
    point_or_ground,
    refuse_one_point,
    subtract,
    unit_vector,
)
from geoident.io.schema.section import Alternatives, Context, SectionFaults, optional
from geoident.io.schema.values import (
    CaseNumber,
    Coordinates,
    DirectionVector,
    Exactly,
    FixedLength,
    SharesUnit,
)
from geoident.model.arrays import Vector
from geoident.model.gauges import Channel

_ON_LINE = 1e-9
"""Lengths below this part of an alignment count as zero."""


TargetComponent = Literal["along", "across", "up", "x", "y", "z"]


class TargetSection(GaugeBase):
    """A point that is surveyed by total station or GNSS: its motion in up to three directions.

    One channel per component, named GAUGE.COMPONENT: along, across (to the right, looking along)
    and up; or x, y and z.
    """

    one_of = (
        *GaugeBase.one_of,
        Alternatives(
            "point along?",
            "chainage alignment beside",
            hint="Give 'point'; an alignment has a direction itself.",
        ),
    )

    kind: Literal["target"]
    point: Coordinates | None = optional("Coordinates of the target.")
    chainage: FixedLength | None = optional(
        "In place of the point: chainage on the alignment (solid)."
    )
    alignment: list[Coordinates] | None = optional(
        "Points of the axis from its beginning on.", min_length=2
    )
    start_chainage: FixedLength = Field(
        CaseNumber("0 m", 0.0, None, "length", "m"),
        description="Chainage where the alignment begins.",
    )
    beside: Annotated[list[FixedLength], SharesUnit(), Exactly(2)] | None = optional(
        "How far to the right of the alignment the target is, and how far above it."
    )
    components: list[TargetComponent] | None = optional(
        "What is read; if missing: across and up in a plane model, x, y and z in a "
        "solid, along, across and up where 'along' or an alignment is given.",
        min_length=1,
    )
    along: DirectionVector | None = optional("Horizontal direction of growing chainage (solid).")
    relative_to: Reference = Field("ground", description="A point, or fixed ground.")

    def check(self, faults: SectionFaults) -> None:
        """No component is listed twice."""
        super().check(faults)
        chosen = self.components or []
        for n, component in enumerate(chosen):
            if component in chosen[:n]:
                message = f"the component {component} is listed twice"
                faults.add(("components", n), "duplicate", message, "Remove one.")

    def chosen(self) -> list[str]:
        """Components that are read."""
        if self.components is not None:
            return list(self.components)
        if self.alignment is not None or self.along is not None:
            return ["along", "across", "up"]
        plane = self.point is not None and len(self.point) == 2
        return ["across", "up"] if plane else ["x", "y", "z"]

    def channels(self, name: str, context: Context) -> list[Channel]:
        """One channel for every component."""
        if self.point is not None:
            place = context.at("point")
            point, along = place.vector(self.point), self._level(context)
        else:
            place, piece = context.at("chainage"), self._piece(context)
            if piece is None:
                return []
            point, along = piece
        relative = context.at("relative_to")
        first = point_or_ground(self.relative_to, relative)
        refuse_one_point(first, point, relative)
        return [
            self.make_channel(f"{name}.{component}", name, Motion(first, point, vector), place.path)
            for component, vector in self._directions(along, context).items()
        ]

    def _directions(self, along: Vector | None, context: Context) -> dict[str, Vector]:
        """Unit vectors (dim,) of the components that are read; none, with a fault, if not all are.

        Args:
            along: (3,) horizontal unit vector of growing chainage, if it is known.
            context: of the gauge.
        """
        dim = context.dim
        known = {axis: axis_vector(n, dim, 1.0) for n, axis in enumerate("xyz"[:dim])}
        known["up"] = axis_vector(dim - 1, dim, 1.0)
        if dim == 2:
            known["across"] = known["x"]
        elif along is not None:
            known.update(along=along, across=cross_product(along, known["up"]))
        for n, component in enumerate(self.chosen()):
            if component in known:
                continue
            place = context if self.components is None else context.at("components", n)
            if dim == 2:
                message = f"a plane model has no motion along '{component}'"
                place.refuse("wrong-dimension", message, "Use across and up, or x and y.")
            else:
                message = f"the component '{component}' needs the direction of the axis"
                place.refuse("missing-key", message, "Add 'along: [0, 1, 0]' or an alignment.")
            return {}
        return {component: known[component] for component in self.chosen()}

    def _level(self, context: Context) -> Vector | None:
        """Horizontal unit vector (3,) of the key `along`; None where it is not given."""
        if self.along is None or context.dim == 2:
            return None
        place = context.at("along")
        level = unit_vector((*place.vector(self.along)[:2], 0.0))
        if not any(level):
            message = "the direction along the axis is vertical or has length zero"
            place.refuse("zero-direction", message, "Give a horizontal direction.")
        return level

    def _piece(self, context: Context) -> tuple[Vector, Vector] | None:
        """The target (3,) beside the alignment at the chainage, and the level direction there."""
        if context.dim == 2:
            message = "an alignment in a plane model"
            context.at("alignment").refuse("wrong-dimension", message, "Give 'point'.", key=True)
            return None
        assert self.chainage is not None
        assert self.beside is not None
        given = enumerate(self.alignment or [])
        points = [context.at("alignment", n).vector(point) for n, point in given]
        # chainage is measured in plan
        plan = [math.dist(a[:2], b[:2]) for a, b in pairwise(points)]
        if math.isnan(sum(plan)):
            return None  # a point is wrong
        ahead = self.chainage.factor - self.start_chainage.factor
        if not 0.0 <= ahead <= sum(plan) * (1 + _ON_LINE) or not all(plan):
            start = self.start_chainage.factor
            message = f"the chainage {self.chainage.text} is not on the alignment, which reaches "
            message += f"from {start:.6g} m to {start + sum(plan):.6g} m in plan"
            context.at("chainage").refuse("outside-alignment", message, "Correct one of them.")
            return None
        n = 0
        while ahead > plan[n] * (1 + _ON_LINE) and n < len(plan) - 1:
            ahead -= plan[n]
            n += 1
        tangent = subtract(points[n + 1], points[n])
        level = unit_vector((*tangent[:2], 0.0))
        right = cross_product(level, (0.0, 0.0, 1.0))
        beside, above = (length.factor for length in self.beside)
        x, y, z = (
            p + ahead / plan[n] * t + beside * r
            for p, t, r in zip(points[n], tangent, right, strict=True)
        )
        return (x, y, z + above), level
