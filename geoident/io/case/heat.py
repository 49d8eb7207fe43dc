"""Heat in stages: `heat` of faces, of the case and of a stage, and `hydration` of a material."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Annotated, Literal

from pydantic import AfterValidator, Field, Tag

from geoident.io.schema.section import Alternatives, Context, Section, SectionFaults, optional
from geoident.io.schema.values import (
    TEXT_LIST_OR_MAPPING,
    CaseNumber,
    CelsiusTemperature,
    FilmCoefficient,
    TemperatureChange,
    Text,
    TextOrMapping,
    Time,
)
from geoident.io.text.wording import Refusal
from geoident.model.heat import Course, HeatFace, Hydration
from geoident.model.parameter import Scalar
from geoident.units import UnitError, read_quantity

ADIABATIC = "adiabatic"


def _moment(text: str) -> str:
    try:
        time = read_quantity(text, "time").value
    except UnitError as error:
        raise Refusal("bad-time", error.message, error.hint) from None
    if time < 0.0:
        raise Refusal("out-of-range", f"the time '{text}' is negative", "Count times from 0 d on.")
    return text


Moment = Annotated[Text, AfterValidator(_moment)]
Temperatures = Annotated[dict[Moment, CelsiusTemperature], Field(min_length=1)]
Rises = Annotated[dict[Moment, TemperatureChange], Field(min_length=1)]


def _check_order(key: str, table: Mapping[str, CaseNumber], faults: SectionFaults) -> None:
    """The times of a table ascend."""
    times = [read_quantity(text, "time").value for text in table]
    for before, after, text in zip(times, times[1:], [*table][1:], strict=False):
        if after <= before:
            message = f"the time '{text}' is not later than the one before it"
            faults.add((key, text), "wrong-order", message, "Write the times in their order.")


def _course(given: CaseNumber | Mapping[str, CaseNumber]) -> Course:
    """A number that stays, or a table over time."""
    if isinstance(given, CaseNumber):
        return Course((0.0,), (given.scalar,))
    times = tuple(read_quantity(text, "time").value for text in given)
    return Course(times, tuple(number.scalar for number in given.values()))


class HydrationSection(Section):
    """Heat that concrete sets free as it hardens, by its adiabatic rise of temperature.

    Its age counts from the stage that installs the ground, or changes it to the material; ground of
    the virgin state is old and sets none free.
    """

    one_of = (Alternatives("rise time", "curve", hint="Give the rise and its time, or a table."),)

    rise: TemperatureChange | None = optional(
        "In the end: `rise` (1 - exp(-age / `time`)).", examples=["38 K", "$rise"]
    )
    time: Time | None = optional("In which it comes.", examples=["1.2 d"])
    curve: Rises | None = optional(
        "Age to the rise until then: linear in between, from nothing at placing on, "
        "constant after the last.",
        examples=["{12 h: 8 K, 1 d: 20 K, 3 d: 32 K, 28 d: 40 K}"],
    )

    def check(self, faults: SectionFaults) -> None:
        """Heat is set free, and ages ascend."""
        if self.rise is not None and self.rise.parameter is None and self.rise.factor < 0.0:
            message = f"'{self.rise.text}' is negative: concrete warms as it hardens"
            faults.add(("rise",), "out-of-range", message, "Write it without its sign.")
        if self.curve is not None:
            _check_order("curve", self.curve, faults)

    def for_model(self, context: Context) -> Hydration:
        """The law for the model."""
        if self.curve is None:
            return self.to_model(Hydration)
        curve = _course(self.curve)
        if curve.times[0] > 0.0:
            curve = Course((0.0, *curve.times), (Scalar(0.0), *curve.values))
        return Hydration(curve=curve)


class HeatSection(Section):
    """What faces or nodes have as temperature, or exchange heat with."""

    temperature: TextOrMapping[CelsiusTemperature, Temperatures] = Field(
        description="Of the ground there; with `film`, of the air or water beyond. One number, or "
        "the time since the beginning of the stage that says it to the temperature: linear in "
        "between, constant before the first and after the last.",
        examples=["-30 degC", "$brine", "{0 d: 20 degC, 3 d: -25 degC}"],
    )
    film: FilmCoefficient | None = optional(
        "Coefficient of the exchange with air or water. Without it the ground has the "
        "temperature itself.",
        examples=["12 W/m2K", "$film"],
    )

    def check(self, faults: SectionFaults) -> None:
        """Times ascend."""
        if isinstance(self.temperature, Mapping):
            _check_order("temperature", self.temperature, faults)

    def for_model(self, context: Context) -> HeatFace:
        """The face for the model."""
        return self.to_model(HeatFace, temperature=_course(self.temperature))


StageHeatValue = Annotated[
    Annotated[Literal["adiabatic"], Tag("text")] | Annotated[HeatSection, Tag("mapping")],
    TEXT_LIST_OR_MAPPING,
]


def build_heat(
    values: Mapping[str, HeatSection | Literal["adiabatic"]], context: Context
) -> dict[str, HeatFace | None]:
    """Faces of a stage by group, None for those that become adiabatic."""
    return {
        name: value.for_model(context.at(name)) if isinstance(value, HeatSection) else None
        for name, value in values.items()
    }
