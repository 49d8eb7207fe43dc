"""The keys that turn what an instrument gives into readings: calibrations, systems of surveys."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field

from geoident.io.readings.calibration import Calibration
from geoident.io.readings.survey import SurveyGrid, axes_of_azimuth
from geoident.io.schema.section import Alternatives, Section, SectionFaults, optional
from geoident.io.schema.values import (
    AnyQuantity,
    CaseNumber,
    DirectionVector,
    Exactly,
    FixedAngle,
    FixedCoefficient,
    FixedLength,
    FixedMultiple,
    Name,
    QuantityType,
    SharesUnit,
)
from geoident.units import DIMENSIONLESS, with_article

GivenTemperature = Annotated[CaseNumber, QuantityType("temperature")]
Raw = Literal["Hz", "digits", "mV/V", "mV", "V", "mA", "Ohm"]


class CalibrationSection(Section):
    """From what a sensor gives to its reading, as its data sheet has it.

    R is the frequency squared by 1000 (digits) where it gives Hz, else what it gives:
    factor (zero - R) or factor (R - zero), or a polynomial in R, plus thermal times
    T - zero_temperature.
    """

    one_of = (
        Alternatives(
            "factor zero difference", "polynomial zero?", hint="Give what the data sheet has."
        ),
        Alternatives(
            "thermal temperature zero_temperature", "", hint="Give all three of them, or none."
        ),
    )

    reads: Raw = Field(description="What the file has; digits are Hz squared by 1000.")
    factor: AnyQuantity | None = optional(
        "Reading per digit (or mV/V, ...).", examples=["0.0123 kPa"]
    )
    difference: Literal["zero - reading", "reading - zero"] | None = optional(
        "With a factor: which way its data sheet takes the difference."
    )
    polynomial: Annotated[list[AnyQuantity], SharesUnit()] | None = optional(
        "In place of a factor: the constant, and what stands with R, R^2, ...",
        min_length=2,
        max_length=6,
        examples=[["812.3 kPa", "-0.0912 kPa", "-1.1e-7 kPa"]],
    )
    zero: FixedCoefficient | None = optional(
        "What it gave at its zero; of a polynomial, only if it counts from there."
    )
    thermal: AnyQuantity | None = optional(
        "What the reading gains per degree Celsius.", examples=["0.05 kPa"]
    )
    temperature: Name | None = optional(
        "thermal: name of the column with the temperature, degrees Celsius."
    )
    zero_temperature: GivenTemperature | None = optional("thermal: the temperature at its zero.")

    def check(self, faults: SectionFaults) -> None:
        """The constants have one dimension."""
        if self.zero_temperature is not None and self.zero_temperature.unit == "K":
            message = (
                f"'{self.zero_temperature.text}' is in kelvin; the column is in degrees Celsius"
            )
            faults.add(("zero_temperature",), "unit", message, "Write it like 20 degC.")
        given = [("factor", self.factor), ("thermal", self.thermal)]
        given += [("polynomial", entry) for entry in self.polynomial or ()]
        known = [(key, value) for key, value in given if value is not None]
        for key, value in known[1:]:
            if value.dimension != known[0][1].dimension:
                message = f"'{value.text}' is {with_article(value.dimension)}, "
                message += f"'{known[0][1].text}' {with_article(known[0][1].dimension)}"
                faults.add((key,), "unit", message, "Correct the units.")

    @property
    def dimension(self) -> str:
        """Of the readings."""
        if self.factor is not None:
            return self.factor.dimension
        return self.polynomial[0].dimension if self.polynomial else ""

    def calibration(self) -> Calibration:
        """For the readers of files."""
        if self.factor is not None:
            sign = -1.0 if self.difference == "zero - reading" else 1.0
            coefficients: tuple[float, ...] = (0.0, sign * self.factor.factor)
        else:
            coefficients = tuple(entry.factor for entry in self.polynomial or ())
        return self.to_model(Calibration, coefficients=coefficients)


class TransformationSection(Section):
    """From the system of a survey (easting, northing, height) to that of the model.

    In a plane model x is horizontal and y points up; in a solid z points up.
    """

    one_of = (Alternatives("azimuth", "axes", hint="Give exactly one of them."),)

    azimuth: FixedAngle | None = optional(
        "Of the model's x axis, clockwise from north.", examples=["37.5 deg"]
    )
    axes: dict[Literal["x", "y", "z"], DirectionVector] | None = optional(
        "In place of an azimuth: two or three axes of the model as vectors of easting, "
        "northing and height; their lengths do not matter."
    )
    scale: FixedMultiple = Field(
        CaseNumber("1", 1.0, None, DIMENSIONLESS),
        description="Of the survey's projection: its lengths by true ones, such as 0.9996.",
    )
    origin: Annotated[list[FixedLength], SharesUnit(), Exactly(3)] | None = optional(
        "Easting, northing and height of the model's origin: it checks where targets stand."
    )

    def check(self, faults: SectionFaults) -> None:
        """The axes are at right angles."""
        given = self.axes or {}
        if self.axes is not None and len(given) < 2:
            message = f"found {len(given)} axes; expected two or three"
            faults.add(("axes",), "wrong-kind", message, "Write x and y, for example.")
        units = {}
        for name, vector in given.items():
            components = tuple(number.factor for number in vector)
            unit = _unit(components) if len(components) == 3 else None
            if unit is None:
                message = f"the axis {name} is not a vector of easting, northing and height"
                faults.add(
                    ("axes", name), "zero-direction", message, "Write it like [0.6, 0.8, 0]."
                )
            else:
                units[name] = unit
        for one, other in (("x", "y"), ("x", "z"), ("y", "z")):
            if one in units and other in units and abs(_dot(units[one], units[other])) > _SKEW:
                message = f"the axes {one} and {other} are not at right angles"
                faults.add(("axes", other), "contradiction", message, "Correct one of them.")

    def survey(self, *, plane: bool) -> SurveyGrid:
        """The axes of the model in the system of the survey, without targets.

        Args:
            plane: the model is a plane or turned about an axis.
        """
        origin = None if self.origin is None else tuple(x.factor for x in self.origin)
        if self.azimuth is not None:
            axes = axes_of_azimuth(self.azimuth.factor, plane=plane)
        else:
            known: dict[str, tuple[float, ...]] = {
                str(name): _unit(tuple(number.factor for number in vector)) or (0.0, 0.0, 0.0)
                for name, vector in (self.axes or {}).items()
            }
            for n, name in enumerate("xyz"):  # the third of a right-handed triple
                if name not in known:
                    one, other = (known["xyz"[(n + k) % 3]] for k in (1, 2))
                    known[name] = _cross(one, other)
            axes = known["x"], known["y"], known["z"]
        return SurveyGrid(axes, 1.0 / self.scale.factor, origin)


_SKEW = 1e-3
"""Cosine between axes from which on they are not at right angles."""


def _dot(a: tuple[float, ...], b: tuple[float, ...]) -> float:
    return sum(x * y for x, y in zip(a, b, strict=True))


def _unit(vector: tuple[float, ...]) -> tuple[float, ...] | None:
    size = _dot(vector, vector) ** 0.5
    return tuple(x / size for x in vector) if size > 0 else None


def _cross(a: tuple[float, ...], b: tuple[float, ...]) -> tuple[float, ...]:
    return (a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0])
