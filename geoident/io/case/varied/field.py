"""Constants that vary from place to place: their section, tests that measured them, their field.

Written as `E: {field: {mean: $E_rock, sd: 30 %, length: [20 m, 5 m], along: {dip: 30 deg}}}`.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from typing import Annotated

from pydantic import Discriminator, Field, Tag

from geoident.io.case.frames import ATTITUDE_OR_AXES, attitude, axes_along
from geoident.io.schema.section import Alternatives, Context, Section, SectionFaults, optional
from geoident.io.schema.values import (
    Angle,
    AnyQuantity,
    CaseNumber,
    Coordinates,
    Count,
    DirectionVector,
    FixedAngle,
    FixedMultiple,
    FixedSize,
    Modulus,
    SharesUnit,
    Text,
    TextOrList,
)
from geoident.model.ground import Attitude, Axes, PointValue, RandomField
from geoident.units import DIMENSIONLESS, with_article

_MOST_SD = 2.0
_SMOOTHEST = 10.0
_ROUGHEST = 0.1


class AlongSection(Section):
    """The axes of a field's correlation lengths, as strata lie: by angles, or by two vectors.

    Axis 1 goes down the dip, 2 along the strike, 3 along the normal; `rotation` turns 1 and 2.
    """

    one_of = (Alternatives(*ATTITUDE_OR_AXES, hint="Along the model's axes: leave out 'along'."),)

    dip: FixedAngle | None = optional(
        "Inclination of axis 1; in 2-D it falls towards +x.", examples=["30 deg"]
    )
    dip_direction: FixedAngle | None = optional(
        "Azimuth of the line of dip, clockwise from north (y) in a solid."
    )
    rotation: FixedAngle | None = optional(
        "Turns axes 1 and 2 about the normal, right-handed; 0 if missing."
    )
    axis_1: DirectionVector | None = optional(
        "Axis 1 in place of the angles, in x, y, z; its length does not matter."
    )
    axis_2: DirectionVector | None = optional("Axis 2, at a right angle to 1, in x, y, z.")

    def frame(self, context: Context) -> Attitude | Axes:
        """The axes for the model."""
        if self.axis_1 is not None and self.axis_2 is not None:
            return axes_along(context, self.axis_1, self.axis_2)
        return attitude(context, self.dip, self.dip_direction, self.rotation)


class PointValueSection(Section):
    """The value of the constant at a point, from a test there."""

    at: Coordinates
    value: AnyQuantity = Field(description="What was measured.", examples=["12 GPa"])
    accuracy: AnyQuantity | None = optional(
        "Standard deviation of the value as one of the ground around (also of how far "
        "a small sample stands for an element), in its unit or in %; exact if missing."
    )
    line: Annotated[int, Count()] | None = optional("Line of the file from which it comes.")


class PointFileSection(Section):
    """A CSV file of measured values, with the columns x, y (z), value and perhaps accuracy."""

    file: Text = Field(description="Path of the file, relative to the case.")
    values: list[PointValueSection] = Field(
        [], description="What it holds; read from the file if missing."
    )


def _wrong_lengths(number: int, dim: int) -> tuple[str, str]:
    """What is wrong with a number of correlation lengths in a model, and the remedy."""
    count = "found no length" if number == 0 else f"found {number} lengths"
    if dim == 2:
        hint = "Write one length, or [along the dip, normal to it], such as [20 m, 5 m]."
        return f"{count}; expected one, or two for the axes of a plane model", hint
    hint = "Write one length, or one for each axis of `along`, such as [30 m, 20 m, 5 m]."
    return f"{count}; expected one, two or three", hint


def _entry(value: object) -> str:
    if isinstance(value, str):
        return "<file name>"
    named = "file" in value if isinstance(value, dict) else isinstance(value, PointFileSection)
    return "<file>" if named else "<point>"


Measured = Annotated[
    Annotated[Text, Tag("<file name>")]
    | Annotated[PointFileSection, Tag("<file>")]
    | Annotated[PointValueSection, Tag("<point>")],
    Discriminator(_entry),
]
Lengths = TextOrList[
    FixedSize,
    Annotated[
        list[FixedSize], SharesUnit(), Field(json_schema_extra={"minItems": 1, "maxItems": 3})
    ],
]


class FieldBase(Section):
    """A constant that varies from place to place: a lognormal random field."""

    mean: AnyQuantity = Field(description="Median of the values.")
    sd: AnyQuantity = Field(
        description="Standard deviation: that of the logarithm, in %, or in the unit of a mean "
        "that is a number.",
        examples=["30 %"],
    )
    length: Lengths = Field(
        description="Correlation length: one in all directions, or one along each axis of `along` "
        "(in 2-D along the dip and normal to it; in a solid along axes 1, 2 and 3, or in the plane "
        "of 1 and 2 and normal to it).",
        examples=[["20 m", "5 m"]],
    )
    along: AlongSection | None = optional(
        "How the axes of the lengths lie; along the model's axes if missing."
    )
    smoothness: FixedMultiple = Field(
        CaseNumber("1.5", 1.5, None, DIMENSIONLESS),
        description="Smoothness nu of the Matern correlation: 0.5 is exponential (rough), 1.5 once "
        "differentiable, 2.5 twice.",
    )
    modes: Annotated[int, Count()] | None = optional(
        "Most modes; if missing, those that hold 99 % of the variance (up to 300)."
    )
    measured: list[Measured] = Field(
        [],
        description="Values from tests at points, through which the field passes: CSV files (x, y, "
        "value, accuracy, with units in the header), or points.",
        examples=[["boreholes.csv"]],
    )

    def check(self, faults: SectionFaults) -> None:
        """Mean, scatter and smoothness are those of a lognormal field."""
        nu = self.smoothness.factor
        if not _ROUGHEST <= nu <= _SMOOTHEST:
            message = f"'{self.smoothness.text}': it must be between {_ROUGHEST:g} and "
            message += f"{_SMOOTHEST:g}"
            faults.add(("smoothness",), "out-of-range", message, "Write 0.5, 1.5 or 2.5.")
        mean, sd = self.mean, self.sd
        if mean.parameter is None and mean.factor <= 0:
            message = f"'{mean.text}': the mean of a field must be positive"
            faults.add(("mean",), "out-of-range", message, "A field is lognormal.")
        elif sd.dimension not in (DIMENSIONLESS, mean.dimension):
            message = (
                f"'{sd.text}' is {with_article(sd.dimension)}; expected a part of the mean in "
            )
            message += f"% or {with_article(mean.dimension)}"
            faults.add(("sd",), "unit", message, "Write it such as 30 %.")
        elif sd.dimension != DIMENSIONLESS and mean.parameter is not None:
            message = f"'{sd.text}': where the mean is a parameter, the scatter is a part of it"
            faults.add(("sd",), "unit", message, "Write it in %, such as 30 %.")
        elif not 0 < self.relative_sd <= _MOST_SD:
            message = (
                f"'{sd.text}' is {100 * self.relative_sd:.4g} % of the mean; it must be above 0 "
            )
            message += f"and up to {100 * _MOST_SD:g} %"
            hint = f"Did you mean '{sd.text} %'?" if sd.unit == "" and sd.factor > 1 else ""
            faults.add(("sd",), "out-of-range", message, hint or "Correct the number or its unit.")

    @property
    def relative_sd(self) -> float:
        """The standard deviation as a part of the mean, and so that of the logarithm."""
        if self.sd.dimension == DIMENSIONLESS:
            return self.sd.factor
        return self.sd.factor / self.mean.factor

    def built(
        self, context: Context, *, material: str, constant: str, surface: int | None
    ) -> RandomField:
        """The field for the model; what does not fit the analysis is noted as a fault.

        Args:
            context: of the key `field`.
            material: of which it is.
            constant: its name in the model.
            surface: index of the yield surface whose strength it is, or None.
        """
        mean = self.mean
        along = self.along.frame(context.at("along")) if self.along is not None else None
        given = self.length if isinstance(self.length, list) else [self.length]
        if not 1 <= len(given) <= context.dim:
            context.at("length").refuse("wrong-dimension", *_wrong_lengths(len(given), context.dim))
        points = [
            value
            for entry, place in self._entries(context.at("measured"))
            if (value := _point_value(entry, mean, *place)) is not None
        ]
        _check_repeated(points, context.at("measured"))
        return self.to_model(
            RandomField,
            material=material,
            constant=constant,
            sd=self.relative_sd,
            lengths=tuple(length.factor for length in given),
            frame=along or _upright(context),
            measured=tuple(points),
            surface=surface,
            dimension=mean.dimension,
            unit=mean.unit,
            path=context.path,
        )

    def _entries(self, context: Context) -> Iterator[tuple[PointValueSection, tuple[Context, str]]]:
        """Every measured value with its place and with where it comes from."""
        for n, entry in enumerate(self.measured):
            place = context.at(n)
            if isinstance(entry, PointValueSection):
                yield entry, (place, "")
            elif isinstance(entry, PointFileSection):
                for k, value in enumerate(entry.values):
                    line = "" if value.line is None else f", line {value.line}"
                    yield value, (place.at("values", k), f"{entry.file}{line}")


class ModulusFieldSection(FieldBase):
    """A modulus or a strength that varies from place to place: a lognormal random field."""

    mean: Modulus = Field(description="Median of the values.", examples=["$E_rock"])


class AngleFieldSection(FieldBase):
    """An angle of strength that varies from place to place: a lognormal random field."""

    mean: Angle = Field(description="Median of the values.", examples=["35 deg"])


class VariedSection(Section):
    """In place of one number: a field."""

    field: FieldBase

    def number(self) -> CaseNumber:
        """The mean of the field."""
        return replace(self.field.mean, varied_by=self)


class VariedModulusSection(VariedSection):
    """In place of one number: a field."""

    field: ModulusFieldSection = Field(description="How it varies from place to place.")


class VariedAngleSection(VariedSection):
    """In place of one number: a field."""

    field: AngleFieldSection = Field(description="How it varies from place to place.")


def _upright(context: Context) -> Attitude | Axes:
    """Axis 1 along x, 3 upwards: in a section strata that lie flat, in a solid x, y, z."""
    if context.dim == 2:
        return attitude(context, None, None)
    return Axes((1.0, 0.0, 0.0), (0.0, 1.0, 0.0))


def _point_value(
    section: PointValueSection, mean: CaseNumber, context: Context, origin: str
) -> PointValue | None:
    """One measured value; None, with a fault, where it is none."""
    position = context.at("at").vector(section.at)
    whence = f" ({origin})" if origin else ""
    value, accuracy = section.value, section.accuracy
    wrong = False
    if value.dimension != mean.dimension:
        message = f"'{value.text}' is {with_article(value.dimension)}; "
        message += f"expected {with_article(mean.dimension)}{whence}"
        context.at("value").refuse("unit", message, "Write it in the dimension of the mean.")
        wrong = True
    elif value.factor <= 0:
        message = f"'{value.text}': a field is positive everywhere{whence}"
        context.at("value").refuse("out-of-range", message, "Correct the number, or remove it.")
        wrong = True
    if accuracy is not None and accuracy.dimension not in (DIMENSIONLESS, mean.dimension):
        message = (
            f"'{accuracy.text}' is {with_article(accuracy.dimension)}; expected a part of the "
        )
        message += f"value in % or {with_article(mean.dimension)}{whence}"
        context.at("accuracy").refuse("unit", message, "Write it in the unit of the value.")
        wrong = True
    elif accuracy is not None and accuracy.factor < 0:
        message = f"'{accuracy.text}': a standard deviation is not negative{whence}"
        context.at("accuracy").refuse("out-of-range", message, "Write 0 for an exact value.")
        wrong = True
    if wrong:
        return None
    deviation = 0.0
    if accuracy is not None:
        part = accuracy.dimension == DIMENSIONLESS
        deviation = accuracy.factor * (value.factor if part else 1.0)
    where = context.path[context.path.index("measured") :]
    return PointValue(position, value.factor, deviation, origin, where)


def _check_repeated(points: list[PointValue], context: Context) -> None:
    """Note exact values that contradict each other at one point."""
    exact: dict[tuple[float, ...], PointValue] = {}
    for point in points:
        if point.accuracy > 0:
            continue
        first = exact.setdefault(point.position, point)
        if first.value != point.value:
            where = ", ".join(f"{x:g}" for x in point.position)
            named = f" ({first.origin}; {point.origin})" if point.origin else ""
            message = f"two exact values at ({where}) m differ{named}"
            context.refuse("contradiction", message, "Give their accuracy, or remove one.")
