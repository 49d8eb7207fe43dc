"""What the sections of all kinds of gauges share: their keys, and channels made of points."""

from __future__ import annotations

import math
from abc import abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Annotated, Literal

from pydantic import Discriminator, Field, Tag, model_validator

from geoident.io.schema.section import Context, Section, refuse
from geoident.io.schema.values import (
    Accuracy,
    Coordinates,
    Drift,
    Given,
    Name,
    Offset,
    scalar_of,
    shape_of,
)
from geoident.model.case import VIRGIN
from geoident.model.gauges import Channel, Motion
from geoident.model.parameter import Scalar

Vector = tuple[float, ...]

_SHOWN_IN = {"length": "mm", "angle": "mrad", "pressure": "kPa", "force": "kN"}
"""Dimensions whose numbers people expect in one unit, whatever unit the accuracy has."""


@dataclass(frozen=True)
class Reads:
    """What a channel reads, before it is known how well.

    Args:
        first: reference point, m; None for fixed ground.
        second: the point whose motion is read, m.
        direction: (dim,) unit vector.
        terms: the motions that add up to the reading where it is not the difference of the two
            points along the direction.
    """

    first: Vector | None
    second: Vector
    direction: Vector
    terms: tuple[Motion, ...] = ()


class GaugeBase(Section):
    """Keys of every gauge; a kind adds its own, and may narrow the accuracy to its dimension."""

    accuracy: Accuracy = Field(
        description="Standard deviation of one reading.", examples=["0.1 mm"]
    )
    zero: Name = Field(
        VIRGIN, description=f"Stage at whose end the gauge reads zero, or '{VIRGIN}'."
    )

    def channel_names(self, name: str) -> list[str]:
        """Names of the channels of a gauge of this name."""
        return [name]

    @abstractmethod
    def channels(self, name: str, context: Context) -> list[Channel]:
        """The channels of a gauge of this name; none, with a fault, where they cannot be."""

    def instrument_errors(self) -> dict[str, Scalar | None]:
        """What the instrument adds by itself, by the name that `Channel` has for it."""
        return {}

    def reads(self, channel: str, gauge: str, what: Reads, place: Context) -> Channel:
        """One channel.

        Args:
            channel: its name.
            gauge: name of the gauge.
            what: what is read.
            place: where the channel is written.
        """
        accuracy = self.accuracy
        return Channel(
            name=channel,
            gauge=gauge,
            kind=getattr(self, "kind", ""),
            first=what.first,
            second=what.second,
            direction=what.direction,
            terms=what.terms,
            accuracy=accuracy.factor,
            zero=self.zero,
            key=place.path,
            dimension=accuracy.dimension,
            unit=_SHOWN_IN.get(accuracy.dimension, accuracy.unit),
            **self.instrument_errors(),
        )


class MotionGauge(GaugeBase):
    """Keys of gauges that read lengths: they can be misread, slip and drift."""

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
    def _one_drift(self) -> MotionGauge:
        if self.drift is not None and self.drift_per_stage is not None:
            message = "found drift and drift_per_stage; one of them is expected"
            refuse((), "wrong-pair", message, "Give exactly one of them.")
        return self

    def instrument_errors(self) -> dict[str, Scalar | None]:
        """Offset and drifts."""
        names = ("offset", "drift", "drift_per_stage")
        return {name: scalar_of(getattr(self, name)) for name in names}


Reference = Annotated[
    Annotated[Literal["ground"], Tag("text")] | Annotated[Coordinates, Tag("list")],
    Discriminator(shape_of),
]
"""What a motion is relative to: fixed ground, or a point."""


def point_of(given: Sequence[Given], place: Context) -> Vector | None:
    """Coordinates (dim,) of a point, m; None, with a fault, where there are more or fewer."""
    return place.vector(given, "the point")


def distance_between(first: Vector | None, second: Vector | None, place: Context) -> Reads | None:
    """Change of distance between two points; None, with a fault, where they are one."""
    if first is None or second is None:
        return None
    direction = unit_vector(tuple(b - a for a, b in zip(first, second, strict=True)))
    if direction is None:
        refuse_one_point(place)
        return None
    return Reads(first, second, direction)


def motion_against(
    point: Sequence[Given],
    reference: str | Sequence[Given],
    direction: Vector | None,
    context: Context,
    key: str = "point",
) -> Reads | None:
    """Motion of a point along a direction, against another point or fixed ground.

    Args:
        point: as written under the key.
        reference: as written under `relative_to`.
        direction: (dim,) unit vector; None where it was at fault.
        context: of the gauge.
        key: of the point.

    Returns:
        None, with a fault, where the points are one or have too many coordinates.
    """
    second = point_of(point, context.at(key))
    first = None
    if not isinstance(reference, str):
        first = point_of(reference, context.at("relative_to"))
        if first is None:
            return None
    if second is None or direction is None:
        return None
    if first == second:
        refuse_one_point(context.at("relative_to"))
        return None
    return Reads(first, second, direction)


def refuse_one_point(place: Context) -> None:
    """Note that both points of a gauge are one."""
    message = "both points are the same, so nothing can be read between them"
    place.refuse("zero-length", message, "Correct the coordinates of one.")


def unit_vector(components: Sequence[float]) -> Vector | None:
    """The vector with length one; None for the zero vector."""
    length = math.hypot(*components)
    return tuple(x / length for x in components) if length > 0 else None


def along_axis(axis: int, dim: int, sign: float = 1.0) -> Vector:
    """Unit vector (dim,) along a coordinate axis."""
    return tuple(sign if n == axis else 0.0 for n in range(dim))
