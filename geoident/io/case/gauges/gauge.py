"""What all gauges of a case have in common: accuracy, zero, errors of the instrument, points.

The kinds of gauges are sections on this one: see `kinds`, `motion` and `force`.
"""

from __future__ import annotations

import math
from abc import abstractmethod
from typing import Annotated, Any, ClassVar, Literal, NamedTuple

import numpy as np
from pydantic import (
    Discriminator,
    Field,
    SerializerFunctionWrapHandler,
    Tag,
    model_serializer,
    model_validator,
)

from geoident.io.case.face import ZeroValue
from geoident.io.case.gauges.accuracy import (
    LengthAccuracy,
    check_parts,
    dimension_read,
    error_parts,
    unit_shown,
)
from geoident.io.schema.estimated import ESTIMATE
from geoident.io.schema.section import Alternatives, Context, Section
from geoident.io.schema.values import (
    CaseNumber,
    Coordinates,
    Drift,
    Length,
    Name,
    scalar_of,
    shape_of,
)
from geoident.model.arrays import Vector
from geoident.model.case import VIRGIN, KeyPath
from geoident.model.gauges import Channel, ErrorParts, MovingPoint, Reads


class Motion(NamedTuple):
    """What a channel reads: the motion of a point against another one along a direction.

    Args:
        first: (dim,) the reference point, m; None: fixed ground.
        second: (dim,) the point, m.
        direction: (dim,) unit vector.
    """

    first: Vector | None
    second: Vector
    direction: Vector


class GaugeBase(Section):
    """What every kind of gauge says beside its place."""

    one_of: ClassVar[tuple[Alternatives, ...]] = (
        Alternatives("drift", "drift_per_stage", "", hint="Give one of them, or none."),
    )

    accuracy: LengthAccuracy = Field(
        description="Standard deviation of one reading, whose errors are then independent; or what "
        "its errors are made of, where readings share some; or `estimate`.",
        examples=["0.1 mm", "estimate", {"reading": "0.1 mm", "epoch": "0.2 mm"}],
    )
    survey: Name | None = Field(
        None,
        description="Survey to which the gauge belongs, if several are read with one set-up: they "
        "share its error, `epoch`.",
    )
    zero: ZeroValue = Field(
        VIRGIN,
        description=f"Stage at whose end the gauge reads zero, or '{VIRGIN}'; or the `distance` to "
        "the face that a stage has: `{distance: 2.5 m}`. In ground that is placed at the very next "
        "stage readings count from its placing on.",
    )
    offset: Length | None = Field(
        None,
        description="Added to all readings after the zero: a misread zero, a head that slipped.",
        examples=["$off1"],
    )
    drift: Drift | None = Field(
        None,
        description="Drift of the gauge with time since its zero; needs dates.",
        examples=["$drift1"],
    )
    drift_per_stage: Length | None = Field(
        None, description="Drift of the gauge per stage since its zero."
    )

    @model_validator(mode="after")
    def _sizes_of_errors(self) -> GaugeBase:
        check_parts(self.accuracy, self.dimension, self.kind_name)
        return self

    @model_serializer(mode="wrap")
    def _as_written(self, dump: SerializerFunctionWrapHandler) -> Any:
        """As it is read again: a zero that is not given would change what is read."""
        found = dump(self)
        if "zero" not in self.model_fields_set:
            found.pop("zero", None)
        return found

    @property
    def zero_stage(self) -> str:
        """Name of the stage at whose end the gauge reads zero."""
        return self.zero if isinstance(self.zero, str) else VIRGIN

    @property
    def kind_name(self) -> str:
        """The kind of the gauge, as users write it."""
        return str(getattr(self, "kind", ""))

    @property
    def plain_accuracy(self) -> CaseNumber | None:
        """The accuracy of readings whose errors are independent; None where it has parts."""
        given = self.accuracy
        return given if isinstance(given, CaseNumber) and given.text != ESTIMATE else None

    @property
    def dimension(self) -> str:
        """Dimension of what the gauge reads."""
        if self.plain_accuracy is not None:
            return self.plain_accuracy.dimension
        return dimension_read(type(self)) or "length"

    @property
    def reads(self) -> Reads:
        """Which states a reading is made of."""
        return Reads.CHANGE

    @property
    def states_zero(self) -> bool:
        """Whether the case itself says how accurate the zero is."""
        return not isinstance(self.accuracy, CaseNumber) and self.accuracy.zero is not None

    @property
    def stated_errors(self) -> ErrorParts:
        """What the errors of its readings are made of, as the gauge states them."""
        if self.plain_accuracy is not None:
            return ErrorParts(self.plain_accuracy.factor)
        return error_parts(self.accuracy, self.kind_name, self.survey or "")

    def channel_names(self, name: str) -> list[str]:
        """Names of the channels of a gauge of this name."""
        return [name]

    def sections(self, name: str) -> dict[str, GaugeBase]:
        """Names of the channels with what the case says of each: its dimension, errors and zero."""
        return dict.fromkeys(self.channel_names(name), self)

    @abstractmethod
    def channels(self, name: str, context: Context) -> list[Channel]:
        """The channels of a gauge of this name; none, with a fault, where they cannot be."""

    def make_channel(
        self,
        channel: str,
        gauge: str,
        motion: Motion,
        key: KeyPath,
        terms: tuple[MovingPoint, ...] = (),
    ) -> Channel:
        """One channel.

        Args:
            channel: its name.
            gauge: name of the gauge.
            motion: what is read.
            key: where the channel is written.
            terms: points and vectors whose motions add up to the reading, where it is not the
                motion of one point against another along one direction.
        """
        parts = self.stated_errors
        return Channel(
            name=channel,
            gauge=gauge,
            kind=self.kind_name,
            first=motion.first,
            second=motion.second,
            direction=motion.direction,
            accuracy=parts.total(),
            zero=self.zero_stage,
            key=key,
            offset=scalar_of(self.offset),
            drift=scalar_of(self.drift),
            drift_per_stage=scalar_of(self.drift_per_stage),
            dimension=self.dimension,
            unit=unit_shown(self.accuracy, self.kind_name, self.dimension),
            errors=parts if self.plain_accuracy is None else None,
            terms=terms,
        )


Reference = Annotated[
    Annotated[Literal["ground"], Tag("text")] | Annotated[Coordinates, Tag("list")],
    Discriminator(shape_of),
]
"""What a motion is relative to: fixed ground, or a point."""


def point_of(given: list[CaseNumber], place: Context) -> Vector | None:
    """A point (dim,), m; None, with a fault, where it has another number of coordinates.

    Args:
        given: the coordinates as written.
        place: where they stand.
    """
    return place.vector(given, "the point")


def distance(first: Vector | None, second: Vector | None, place: Context) -> Motion | None:
    """Change of distance between two points (dim,), m; None, with a fault, where they are one.

    Args:
        first: the reference point.
        second: the other one.
        place: where they stand.
    """
    if first is None or second is None:
        return None
    direction = unit_vector(tuple(b - a for a, b in zip(first, second, strict=True)))
    if direction is None:
        refuse_one_point(place)
        return None
    return Motion(first, second, direction)


def refuse_one_point(place: Context) -> None:
    """Note that the two points of a gauge are one."""
    message = "the two points coincide"
    place.refuse("zero-length", message, "Correct the coordinates of one.")


def unit_vector(components: Vector) -> Vector | None:
    """The vector (dim,) of length one along another; None along one of length zero."""
    length = math.hypot(*components)
    return tuple(x / length for x in components) if length > 0 else None


def axis_vector(axis: int, dim: int, sign: float) -> Vector:
    """The vector (dim,) along an axis, or against it.

    Args:
        axis: number of the axis.
        dim: space dimensions.
        sign: 1, or -1 for against it.
    """
    return tuple(sign if n == axis else 0.0 for n in range(dim))


def cross_product(a: Vector, b: Vector) -> Vector:
    """Vector product (3,) of two vectors (3,)."""
    return tuple(float(x) for x in np.cross(a, b))
