"""Targets of total stations and GNSS: motions along, across and up, at a point or a chainage."""

from __future__ import annotations

import math
from itertools import pairwise
from typing import Annotated, Literal

from pydantic import Field, model_validator

from geoident.io.case.gauges.gauge import (
    GaugeBase,
    Motion,
    Reference,
    axis_vector,
    cross_product,
    point_of,
    refuse_one_point,
    unit_vector,
)
from geoident.io.schema.section import Alternatives, Context, SectionFaults
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
    point: Coordinates | None = Field(None, description="Coordinates of the target.")
    chainage: FixedLength | None = Field(
        None, description="In place of the point: chainage on the alignment (solid)."
    )
    alignment: list[Coordinates] | None = Field(
        None, min_length=2, description="Points of the axis from its beginning on."
    )
    start_chainage: FixedLength = Field(
        CaseNumber("0 m", 0.0, None, "length", "m"),
        description="Chainage where the alignment begins.",
    )
    beside: Annotated[list[FixedLength], SharesUnit(), Exactly(2)] | None = Field(
        None,
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
                known.update(along=along, across=cross_product(along, known["up"]))
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
            self.make_channel(f"{name}.{component}", name, Motion(first, point, vector), place.path)
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
        right, up = cross_product(level, (0.0, 0.0, 1.0)), self.beside[1].factor
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
