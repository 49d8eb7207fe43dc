"""Gauges of a case: their sections, and the channels that they are made into.

Every gauge, whatever its kind, is one or more relative displacements.
"""

from __future__ import annotations

import math
from abc import abstractmethod
from collections.abc import Mapping
from typing import Annotated, Literal

from pydantic import Discriminator, Field, Tag, model_validator

from geoident.io.schema.section import Context, Section, SectionFaults, refuse
from geoident.io.schema.values import (
    Accuracy,
    Coordinates,
    DirectionVector,
    Drift,
    Given,
    Line,
    Name,
    Offset,
    scalar_of,
    shape_of,
)
from geoident.model.case import VIRGIN, KeyPath
from geoident.model.gauges import Channel

Vector = tuple[float, ...]
_Motion = tuple[str, Vector | None, Vector, Vector]
"""Kind of gauge, reference point (None: fixed ground), point, unit vector along which it moves."""

_AXES = "xyz"


class _GaugeBase(Section):
    accuracy: Accuracy = Field(
        description="Standard deviation of one reading.", examples=["0.1 mm"]
    )
    zero: Name = Field(
        VIRGIN, description=f"Stage at whose end the gauge reads zero, or '{VIRGIN}'."
    )
    offset: Offset | None = Field(
        None,
        description="Added to all readings after the zero: a misread zero, a head that slipped.",
        examples=["$off1"],
    )
    drift: Drift | None = Field(
        None,
        description="Drift of the gauge with time since its zero; needs dates.",
        examples=["$drift1"],
    )
    drift_per_stage: Offset | None = Field(
        None, description="Drift of the gauge per stage since its zero."
    )

    @model_validator(mode="after")
    def _one_drift(self) -> _GaugeBase:
        if self.drift is not None and self.drift_per_stage is not None:
            message = "found drift and drift_per_stage; one of them is expected"
            refuse((), "wrong-pair", message, "Give exactly one of them.")
        return self

    def channel_names(self, name: str) -> list[str]:
        """Names of the channels of a gauge of this name."""
        return [name]

    @abstractmethod
    def channels(self, name: str, context: Context) -> list[Channel]:
        """The channels of a gauge of this name; none, with a fault, where they cannot be."""

    def _reads(self, channel: str, gauge: str, motion: _Motion, key: KeyPath) -> Channel:
        """One channel.

        Args:
            channel: its name.
            gauge: name of the gauge.
            motion: what is read.
            key: where the channel is written.
        """
        kind, first, second, direction = motion
        return Channel(
            name=channel,
            gauge=gauge,
            kind=kind,
            first=first,
            second=second,
            direction=direction,
            accuracy=self.accuracy.factor,
            zero=self.zero,
            key=key,
            offset=scalar_of(self.offset),
            drift=scalar_of(self.drift),
            drift_per_stage=scalar_of(self.drift_per_stage),
            dimension=self.accuracy.dimension,
            unit="mm" if self.accuracy.dimension == "length" else self.accuracy.unit,
        )


class ExtensometerSection(_GaugeBase):
    """Change of distance between a head and anchors, positive when they move apart.

    One channel per anchor, named GAUGE.ANCHOR.
    """

    kind: Literal["extensometer"]
    head: Coordinates = Field(description="Coordinates of the head.")
    anchors: dict[Name, Coordinates] = Field(min_length=1, description="Name to coordinates.")

    def channel_names(self, name: str) -> list[str]:
        """One name for every anchor."""
        return [f"{name}.{anchor}" for anchor in self.anchors]

    def channels(self, name: str, context: Context) -> list[Channel]:
        """One channel for every anchor."""
        head = _point(self.head, context.at("head"))
        found = []
        for anchor, given in self.anchors.items():
            place = context.at("anchors", anchor)
            motion = _distance(self.kind, head, _point(given, place), place)
            if motion is not None:
                found.append(self._reads(f"{name}.{anchor}", name, motion, place.path))
        return found


class ConvergenceSection(_GaugeBase):
    """Change of distance between two points, positive when they move apart."""

    kind: Literal["convergence"]
    between: Line = Field(description="The two points.")

    def channels(self, name: str, context: Context) -> list[Channel]:
        """The one channel."""
        place = context.at("between")
        first, second = (_point(point, place.at(n)) for n, point in enumerate(self.between))
        motion = _distance(self.kind, first, second, place)
        return [] if motion is None else [self._reads(name, name, motion, context.path)]


Reference = Annotated[
    Annotated[Literal["ground"], Tag("text")] | Annotated[Coordinates, Tag("list")],
    Discriminator(shape_of),
]


class DisplacementSection(_GaugeBase):
    """Displacement of a point in a direction, relative to the ground or to another point."""

    kind: Literal["displacement"]
    point: Coordinates = Field(description="The point whose motion is read.")
    relative_to: Reference = Field("ground", description="A point, or fixed ground.")
    component: Literal["x", "y", "z"] | None = Field(None, description="Coordinate direction.")
    direction: DirectionVector | None = Field(
        None, description="Direction vector in place of a component; its length does not matter."
    )

    @model_validator(mode="after")
    def _one_direction(self) -> DisplacementSection:
        faults = SectionFaults()
        if (self.component is None) == (self.direction is None):
            found = "neither" if self.component is None else "both"
            message = f"found {found}; either component or direction is expected"
            faults.add((), "wrong-pair", message, "Give exactly one of them.")
        if self.direction is not None and not any(x.factor for x in self.direction):
            faults.add(("direction",), "zero-direction", "the direction has length zero")
        faults.raise_any()
        return self

    def channels(self, name: str, context: Context) -> list[Channel]:
        """The one channel."""
        motion = _displacement(self, self._unit(context), context)
        return [] if motion is None else [self._reads(name, name, motion, context.path)]

    def _unit(self, context: Context) -> Vector | None:
        if self.direction is not None:
            given = context.at("direction").vector(self.direction, "the direction")
            return None if given is None else _unit(given)
        axis = _AXES.index(self.component or "x")
        if axis < context.dim:
            return _axis(axis, context.dim, 1.0)
        message = "a plane model has no displacement along z"
        context.at("component").refuse("wrong-dimension", message, "Use x or y.")
        return None


class SettlementSection(_GaugeBase):
    """Settlement of a point, positive downwards, relative to the ground or to another point."""

    kind: Literal["settlement"]
    point: Coordinates = Field(description="The point whose settlement is read.")
    relative_to: Reference = Field("ground", description="A point, or fixed ground.")

    def channels(self, name: str, context: Context) -> list[Channel]:
        """The one channel."""
        down = _axis(context.dim - 1, context.dim, -1.0)
        motion = _displacement(self, down, context)
        return [] if motion is None else [self._reads(name, name, motion, context.path)]


GaugeSection = Annotated[
    ExtensometerSection | ConvergenceSection | DisplacementSection | SettlementSection,
    Field(discriminator="kind"),
]
Gauges = Mapping[str, GaugeSection]


def sections_of_channels(gauges: Gauges) -> dict[str, GaugeSection]:
    """Names of all channels with what the case says of the gauge of each."""
    return {
        channel: gauge for name, gauge in gauges.items() for channel in gauge.channel_names(name)
    }


def build_channels(gauges: Gauges, context: Context) -> tuple[Channel, ...]:
    """The channels of all gauges, in the order of the file.

    Args:
        gauges: name to section.
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
    return tuple(channels.values())


def _point(given: list[Given], place: Context) -> Vector | None:
    return place.vector(given, "the point")


def _distance(
    kind: str, first: Vector | None, second: Vector | None, place: Context
) -> _Motion | None:
    """Change of distance between two points; None, with a fault, where they are one."""
    if first is None or second is None:
        return None
    direction = _unit(tuple(b - a for a, b in zip(first, second, strict=True)))
    if direction is None:
        _refuse_one_point(place)
        return None
    return kind, first, second, direction


def _displacement(
    section: DisplacementSection | SettlementSection, direction: Vector | None, context: Context
) -> _Motion | None:
    """Motion of a point against another one, or against fixed ground."""
    point = _point(section.point, context.at("point"))
    given = section.relative_to
    first = None if isinstance(given, str) else _point(given, context.at("relative_to"))
    if point is None or direction is None or (first is None and not isinstance(given, str)):
        return None
    if first == point:
        _refuse_one_point(context.at("relative_to"))
        return None
    return section.kind, first, point, direction


def _refuse_one_point(place: Context) -> None:
    message = "both points are the same, so nothing can be read between them"
    place.refuse("zero-length", message, "Correct the coordinates of one.")


def _unit(components: Vector) -> Vector | None:
    length = math.hypot(*components)
    return tuple(x / length for x in components) if length > 0 else None


def _axis(axis: int, dim: int, sign: float) -> Vector:
    return tuple(sign if n == axis else 0.0 for n in range(dim))
