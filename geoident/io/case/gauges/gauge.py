"""What all gauges of a case have in common: accuracy, zero, errors of the instrument, points.

The kinds of gauges are sections on this one: see `kinds`, `motion` and `force`.
"""

from __future__ import annotations

import math
from abc import abstractmethod
from collections.abc import Iterator
from functools import cache
from typing import Annotated, Any, ClassVar, Literal, NamedTuple

import numpy as np
from pydantic import (
    Field,
    GetJsonSchemaHandler,
    SerializerFunctionWrapHandler,
    ValidationInfo,
    field_validator,
    model_serializer,
)
from pydantic_core import CoreSchema

from geoident.io.case.face import ZeroValue
from geoident.io.case.gauges.accuracy import (
    Accuracy,
    StandardDeviationOf,
    check_parts,
    error_parts,
    unit_shown,
    usual_examples,
)
from geoident.io.schema.estimated import ESTIMATE
from geoident.io.schema.section import Alternatives, Context, Section, SectionFaults, optional
from geoident.io.schema.values import (
    CaseNumber,
    Coordinates,
    Flag,
    Multiple,
    Name,
    QuantityType,
    TextOrList,
    shape_of,
)
from geoident.model.arrays import Vector
from geoident.model.case import VIRGIN, KeyPath
from geoident.model.gauges import Channel, ErrorParts, Reads
from geoident.units import rate_of, unit_list, with_article

LikeReading = Annotated[CaseNumber, QuantityType(None, tied=True)]
"""A quantity whose dimension follows from what the gauge reads."""
LIKE_READINGS = ("offset", "drift_per_stage")
RATES_OF_READINGS = ("drift",)
"""Keys of all gauges with the dimension of a reading, or of its change in time."""
AlarmValue = Annotated[CaseNumber, QuantityType(None)]
_ALARM_EXAMPLES = {
    "length": ("15 mm", "25 mm"),
    "pressure": ("150 kPa", "200 kPa"),
    "strain": ("500 microstrain", "800 microstrain"),
    "angle": ("1 mrad", "2 mrad"),
}
"""Dimension to examples of two alarm values."""
ALARMS = {"alarm": "alarm", "limits": "limit"}
"""Keys of alarm values, and the name of the value of a gauge that has one only."""


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
    """What every kind of gauge says beside its place.

    The dimension of what a kind reads is its attribute `measures`, which quantities that are like a
    reading have, too (`LIKE_READINGS`). Keys become attributes of the channel of the same names.
    """

    measures: ClassVar[tuple[str, ...]] = ("length",)
    """Dimensions that readings may have; empty for any. Of several the accuracy says which."""
    one_of: ClassVar[tuple[Alternatives, ...]] = (
        Alternatives("drift", "drift_per_stage", "", hint="Give one of them, or none."),
    )

    accuracy: Accuracy = Field(
        description="Standard deviation of one reading, whose errors are then independent; or what "
        "its errors are made of, where readings share some."
    )
    survey: Name | None = optional(
        "Survey to which the gauge belongs, if several are read with one set-up: they "
        "share its error, `epoch`."
    )
    zero: ZeroValue = Field(
        VIRGIN,
        description=f"Stage at whose end the gauge reads zero, or '{VIRGIN}'; or the `distance` to "
        "the face that a stage has: `{distance: 2.5 m}`. In ground that is placed at the very next "
        "stage readings count from its placing on.",
    )
    ratio: Multiple | None = optional(
        "What the gauge reads, by what the model says: a bias that is alike in all its "
        "readings. `$NAME` finds it; give it a prior. Gauges, or sections of a project that share "
        "the parameter, have one bias.",
        examples=["$bias", "1.05"],
    )
    offset: LikeReading | None = optional(
        "Added to all readings after the zero (without a zero, to all): a misread "
        "zero, a head that slipped.",
        examples=["$off1"],
    )
    drift: LikeReading | None = optional(
        "Drift of the gauge with time since its zero, without `zero` since the date of "
        f"'{VIRGIN}'; needs dates.",
        examples=["$drift1"],
    )
    drift_per_stage: LikeReading | None = optional("Drift of the gauge per stage since its zero.")
    alarm: dict[Name, AlarmValue] | None = optional(
        "Reading from which on an alarm is given, or several with their names. A fit "
        "says when it was reached, and when and how probably predicted readings reach it; in "
        "service `geoident control` says how probably one of the next year does. A negative value "
        "is reached by readings below it."
    )
    limits: dict[Name, AlarmValue] | None = optional(
        "Size of a reading, with either sign, that is not to be reached: the alarm "
        "values of the design, whichever way the gauge moves. One value, or several with their "
        "names."
    )

    branch: Flag = Field(
        False,
        description="The gauge is read only in stages that build on its zero: on a branch of "
        "`independent` ones.",
    )

    @classmethod
    @cache
    def like_readings(cls, dimension: str | None) -> dict[str, QuantityType]:
        """Keys with a quantity like a reading, and what it must be.

        Args:
            dimension: of what is read; None for any.
        """
        like = QuantityType(dimension, tied=True)
        rate = QuantityType(dimension and rate_of(dimension), tied=True)
        accuracy = StandardDeviationOf(dimension, above=0.0, usual=bool(cls.measures))
        likes = dict.fromkeys(LIKE_READINGS, like) | dict.fromkeys(RATES_OF_READINGS, rate)
        return {"accuracy": accuracy, **likes}

    @classmethod
    def _likes(cls) -> dict[str, QuantityType]:
        return cls.like_readings(cls.measures[0] if len(cls.measures) == 1 else None)

    @field_validator("accuracy", *LIKE_READINGS, *RATES_OF_READINGS, mode="before")
    @classmethod
    def _like_a_reading(cls, value: Any, info: ValidationInfo) -> Any:
        """Read a quantity in the dimension of what the kind of gauge reads."""
        name = str(info.field_name)
        left = shape_of(value) == "mapping" if name == "accuracy" else value is None
        return value if left else cls._likes()[name].parse(value)

    @field_validator(*ALARMS, mode="before")
    @classmethod
    def _alarm_like_a_reading(cls, value: Any, info: ValidationInfo) -> Any:
        """Read alarm values in the dimension of what the kind of gauge reads; one has a name."""
        like = QuantityType(cls._likes()["offset"].dimension)
        if shape_of(value) != "mapping":
            name = ALARMS[str(info.field_name)]
            return None if value is None else {name: like.parse(value)}
        return {name: like.parse(one) for name, one in value.items()}

    @classmethod
    def __get_pydantic_json_schema__(
        cls, schema: CoreSchema, handler: GetJsonSchemaHandler
    ) -> dict[str, Any]:
        """The schema with quantities and examples of what the kind of gauge reads."""
        described = handler(schema)
        keys = handler.resolve_ref_schema(described)["properties"]
        for name, like in cls._likes().items():
            ways = keys[name].get("anyOf") or keys[name]["oneOf"]
            ways[0] = like.described()
        value = QuantityType(cls._likes()["offset"].dimension).described()
        named = {"type": "object", "additionalProperties": value}
        low, high = _ALARM_EXAMPLES.get(value["x-quantity"], _ALARM_EXAMPLES["length"])
        for name, one in (("alarm", f"-{high}"), ("limits", high)):
            keys[name]["anyOf"][0] = {"oneOf": [value, named]}
            keys[name]["examples"] = [f"{{amber: {low}, red: {high}}}", one]
        accuracy, kind = keys["accuracy"], keys["kind"]["const"] if "kind" in keys else ""
        accuracy["examples"] = usual_examples(kind) or accuracy["oneOf"][0]["examples"]
        if cls.measures:
            accuracy["description"] += " `estimate` finds it from the residuals."
        return described

    def check(self, faults: SectionFaults) -> None:
        """All quantities like a reading have the dimension of what is read."""
        read = self.dimension
        if self.measures and read not in self.measures:
            return  # the accuracy is refused
        check_parts(self.accuracy, read, self.kind_name, faults)
        for key, like in self.like_readings(read).items():
            given = None if key == "accuracy" else getattr(self, key)
            if given is None or given.parameter is not None or given.dimension == like.dimension:
                continue
            message = (
                f"'{given.text}' is {with_article(given.dimension)}; by its accuracy the gauge "
            )
            message += f"reads {with_article(read)}"
            hint = "Use 'drift_per_stage'."
            if like.dimension:
                hint = f"Its units: {unit_list(like.dimension)}."
            faults.add((key,), "unit", message, hint)
        for key, name, given in self._alarm_values():
            if given.dimension != read:
                message = f"'{given.text}' is {with_article(given.dimension)}; by its accuracy the "
                message += f"gauge reads {with_article(read)}"
                faults.add((key, name), "unit", message, f"Its units: {unit_list(read)}.")
            elif given.factor == 0.0:
                message = f"'{given.text}' is reached by every reading"
                hint = "Give it a sign: a negative value is reached by readings below it."
                faults.add((key, name), "out-of-range", message, hint)
            elif key == "limits" and given.factor < 0.0:
                message = f"'{given.text}' is negative; a limit is the size of a reading"
                hint = "Give it without its sign, or as 'alarm', which readings below it reach."
                faults.add((key, name), "out-of-range", message, hint)
            elif key == "limits" and name in (self.alarm or {}):
                hint = "Give one of them, or another name."
                message = f"'{name}' is the name of an alarm value, too"
                faults.add((key, name), "duplicate", message, hint)
            elif name == "amber" and self._before(given, (getattr(self, key) or {}).get("red")):
                message = f"'{given.text}' warns after the red value has been reached"
                faults.add((key, name), "out-of-range", message, "Exchange amber and red.")

    @staticmethod
    def _before(amber: CaseNumber, red: CaseNumber | None) -> bool:
        """Red is reached before amber, in the same direction."""
        if red is None or red.dimension != amber.dimension:
            return False
        return abs(amber.factor) > abs(red.factor) and amber.factor * red.factor > 0.0

    def _alarm_values(self) -> Iterator[tuple[str, str, CaseNumber]]:
        """Key, name and value of all alarm values."""
        for key in ALARMS:
            for name, given in (getattr(self, key) or {}).items():
                yield key, name, given

    @model_serializer(mode="wrap")
    def _as_written(self, dump: SerializerFunctionWrapHandler) -> Any:
        """As it is read again: a zero that is not given would change what is read."""
        data = dump(self)
        if "zero" not in self.model_fields_set:
            data.pop("zero", None)
        return data

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
        return self.measures[0]

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

    def read_by(self, probe: str) -> GaugeBase:
        """What says how accurate the channels of a probe are: mostly the gauge itself."""
        return self

    @abstractmethod
    def channels(self, name: str, context: Context) -> list[Channel]:
        """The channels of a gauge of this name; none, with a fault, where they cannot be."""

    def make_channel(
        self, channel: str, gauge: str, motion: Motion, key: KeyPath, **given: Any
    ) -> Channel:
        """One channel. Its attributes are the keys of the gauge that have their names.

        Args:
            channel: its name.
            gauge: name of the gauge.
            motion: what is read.
            key: where the channel is written.
            given: attributes that are no keys of the gauge, or that keys do not give as they are.
        """
        parts = self.stated_errors
        given = {"along": 0.0, "fibre": None, "towards": None, **given}
        return self.to_model(
            Channel,
            name=channel,
            gauge=gauge,
            kind=self.kind_name,
            first=motion.first,
            second=motion.second,
            direction=motion.direction,
            accuracy=parts.total(),
            zero=self.zero_stage,
            key=key,
            dimension=self.dimension,
            unit=unit_shown(self.accuracy, self.kind_name, self.dimension),
            errors=parts if self.plain_accuracy is None else None,
            reads=self.reads,
            **given,
        )


Reference = TextOrList[Literal["ground"], Coordinates]
"""What a motion is relative to: fixed ground, or a point."""


def distance(first: Vector, second: Vector, place: Context) -> Motion:
    """Change of distance between two points (dim,), m; a fault where they are one.

    Args:
        first: the reference point.
        second: the other one.
        place: where they stand.
    """
    refuse_one_point(first, second, place)
    return Motion(first, second, unit_vector(subtract(second, first)))


def refuse_one_point(first: Vector | None, second: Vector, place: Context) -> None:
    """Note that the two points of a gauge are one."""
    if first == second:
        message = "the two points coincide"
        place.refuse("zero-length", message, "Correct the coordinates of one.")


def point_or_ground(given: list[CaseNumber] | str, place: Context) -> Vector | None:
    """The point to which a motion is relative; None for fixed ground."""
    return None if isinstance(given, str) else place.vector(given)


def subtract(one: Vector, other: Vector) -> Vector:
    """The vector (dim,) from another point to one."""
    return tuple(a - b for a, b in zip(one, other, strict=True))


def unit_vector(components: Vector) -> Vector:
    """The vector (dim,) of length one along another; zeros along one of length zero."""
    length = math.hypot(*components) or 1.0
    return tuple(x / length for x in components)


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
