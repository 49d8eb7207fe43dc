"""All kinds of gauges of a case, and the channels that they are made into.

Sections of those that read one relative displacement stand here, of the others in `motion`,
`force` and `strain`.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Annotated, Literal

from pydantic import Field

from geoident.io.case.frames import refuse_no_direction
from geoident.io.case.gauges.bar_displacement import BarDisplacementSection
from geoident.io.case.gauges.force import ForceSection
from geoident.io.case.gauges.gauge import (
    GaugeBase,
    Motion,
    Reference,
    axis_vector,
    distance,
    point_or_ground,
    refuse_one_point,
)
from geoident.io.case.gauges.inclinometer import InclinometerSection
from geoident.io.case.gauges.joint_meter import JointMeterSection
from geoident.io.case.gauges.motion import MotionSection
from geoident.io.case.gauges.on_structure import on_structures
from geoident.io.case.gauges.strain import StrainSection
from geoident.io.case.gauges.target import TargetSection
from geoident.io.case.gauges.value import PlainReadingSection, unit_direction
from geoident.io.schema.section import Alternatives, Context, SectionFaults, optional
from geoident.io.schema.values import Coordinates, DirectionVector, Line, Name
from geoident.model.arrays import Vector
from geoident.model.gauges import Channel
from geoident.model.structures import Structure

_AXES = "xyz"


class ExtensometerSection(GaugeBase):
    """Change of distance between a head and anchors, positive when they move apart.

    One channel per anchor, named GAUGE.ANCHOR.
    """

    kind: Literal["extensometer"]
    head: Coordinates = Field(description="Coordinates of the head.")
    anchors: dict[Name, Coordinates] = Field(min_length=1, description="Name to coordinates.")

    def channels(self, name: str, context: Context) -> list[Channel]:
        """One channel for every anchor."""
        head = context.at("head").vector(self.head)
        channels = []
        for anchor, given in self.anchors.items():
            place = context.at("anchors", anchor)
            motion = distance(head, place.vector(given), place)
            channels.append(self.make_channel(f"{name}.{anchor}", name, motion, place.path))
        return channels


class ConvergenceSection(GaugeBase):
    """Change of distance between two points, positive when they move apart."""

    kind: Literal["convergence"]
    between: Line = Field(description="The two points.")

    def channels(self, name: str, context: Context) -> list[Channel]:
        """The one channel."""
        place = context.at("between")
        first, second = (place.at(n).vector(point) for n, point in enumerate(self.between))
        return [self.make_channel(name, name, distance(first, second, place), context.path)]


class DisplacementSection(GaugeBase):
    """Displacement of a point in a direction, relative to the ground or to another point."""

    one_of = (
        *GaugeBase.one_of,
        Alternatives("component", "direction", hint="Give exactly one of them."),
    )

    kind: Literal["displacement"]
    point: Coordinates = Field(description="The point whose motion is read.")
    relative_to: Reference = Field("ground", description="A point, or fixed ground.")
    component: Literal["x", "y", "z"] | None = optional("Coordinate direction.")
    direction: DirectionVector | None = optional(
        "Direction vector in place of a component; its length does not matter."
    )

    def check(self, faults: SectionFaults) -> None:
        """The direction has a length."""
        super().check(faults)
        refuse_no_direction("direction", self.direction, faults)

    def channels(self, name: str, context: Context) -> list[Channel]:
        """The one channel."""
        direction = unit_direction(self.direction, context.at("direction"))
        if direction is None:
            axis = _AXES.index(self.component or "x")
            direction = axis_vector(axis, context.dim, 1.0)
            if axis >= context.dim:
                message = "a plane model has no displacement along z"
                context.at("component").refuse("wrong-dimension", message, "Use x or y.")
        motion = _displacement(self, direction, context)
        return [self.make_channel(name, name, motion, context.path)]


class SettlementSection(GaugeBase):
    """Settlement of a point, positive downwards, relative to the ground or to another point."""

    kind: Literal["settlement"]
    point: Coordinates = Field(description="The point whose settlement is read.")
    relative_to: Reference = Field("ground", description="A point, or fixed ground.")

    def channels(self, name: str, context: Context) -> list[Channel]:
        """The one channel."""
        down = axis_vector(context.dim - 1, context.dim, -1.0)
        motion = _displacement(self, down, context)
        return [self.make_channel(name, name, motion, context.path)]


GaugeSection = Annotated[
    ExtensometerSection
    | ConvergenceSection
    | DisplacementSection
    | SettlementSection
    | ForceSection
    | StrainSection
    | InclinometerSection
    | TargetSection
    | MotionSection
    | JointMeterSection
    | BarDisplacementSection
    | PlainReadingSection,
    Field(discriminator="kind"),
]
Gauges = Mapping[str, GaugeSection]


def build_channels(
    gauges: Gauges, structures: Mapping[str, Structure], context: Context
) -> tuple[Channel, ...]:
    """The channels of all gauges, in the order of the file.

    Args:
        gauges: name to section.
        structures: of the case, on which some of them sit.
        context: of the key `gauges`.
    """
    channels: dict[str, Channel] = {}
    for name, gauge in gauges.items():
        for channel in gauge.channels(name, context.at(name)):
            if channel.name in channels:
                message = f"two channels are named '{channel.name}'"
                context.faults.add(
                    channel.key, "duplicate-channel", message, "Rename one.", key=True
                )
            channels[channel.name] = channel
    return tuple(on_structures(tuple(channels.values()), gauges, structures, context))


def _displacement(
    section: DisplacementSection | SettlementSection, direction: Vector, context: Context
) -> Motion:
    """Motion of a point against another one, or against fixed ground."""
    point = context.at("point").vector(section.point)
    place = context.at("relative_to")
    first = point_or_ground(section.relative_to, place)
    refuse_one_point(first, point, place)
    return Motion(first, point, direction)
