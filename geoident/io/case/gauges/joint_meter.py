"""The gauge that reads how the two sides of an interface part and slip."""

from __future__ import annotations

from typing import Literal

from pydantic import Field

from geoident.io.case.frames import refuse_no_direction
from geoident.io.case.gauges.gauge import GaugeBase, Motion
from geoident.io.case.gauges.value import unit_direction
from geoident.io.schema.section import Context, SectionFaults, optional
from geoident.io.schema.values import Coordinates, DirectionVector, Name
from geoident.model.gauges import Channel


class JointMeterSection(GaugeBase):
    """Motion of the two sides of an interface against each other at a point of it.

    `opening`, positive where they part; `slip`, in the plane positive where, seen from either side,
    the other one moves to the left. With `direction` and `towards`: motion, along the direction, of
    the side where the point `towards` lies, against the other one. Where a beam or shell stands on
    the interface, between the ground on the side of `towards` and that.
    """

    kind: Literal["joint-meter"]
    interface: Name = Field(description="The interface that it spans.")
    point: Coordinates = Field(description="Where on the interface.")
    component: Literal["opening", "slip"] | None = optional(
        "What is read; `opening` if missing, and no `direction` is given."
    )
    direction: DirectionVector | None = optional(
        "Direction of the motion, with `towards`, in place of a component."
    )
    towards: Coordinates | None = optional(
        "A point on the side whose motion is read; beside a beam or shell, on the side of it that "
        "is read."
    )

    def check(self, faults: SectionFaults) -> None:
        """A direction has a length, and a side that moves."""
        super().check(faults)
        refuse_no_direction("direction", self.direction, faults)
        if self.direction is not None and self.towards is None:
            message = "'direction' without 'towards'"
            hint = "Give both: the direction, and a point on the side whose motion is read."
            faults.add(("direction",), "missing-key", message, hint)
        elif self.direction is not None and self.component is not None:
            message = "found component and direction; expected one of them"
            faults.add(("component",), "wrong-pair", message, "Remove one.")

    def channels(self, name: str, context: Context) -> list[Channel]:
        """The one channel."""
        direction = unit_direction(self.direction, context.at("direction"))
        if self.component == "slip" and context.dim == 3:
            message = "slip in a solid has no sign by itself"
            hint = "Give 'direction', and 'towards' on the side whose motion along it is read."
            context.at("component").refuse("wrong-dimension", message, hint)
        point = context.at("point").vector(self.point)
        towards = None if self.towards is None else context.at("towards").vector(self.towards)
        quantity = "" if direction else self.component or "opening"
        motion = Motion(None, point, direction or (0.0,) * context.dim)
        return [
            self.make_channel(name, name, motion, context.path, towards=towards, quantity=quantity)
        ]
