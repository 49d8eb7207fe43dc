"""The key ``service``: what acts on a finite element model day by day, from its last stage on."""

from __future__ import annotations

from collections.abc import Collection, Mapping
from typing import Annotated, Literal

from pydantic import AfterValidator, Field

from geoident.io.case.actions import FallSection
from geoident.io.case.readings import Date
from geoident.io.schema.section import Alternatives, Context, Section, SectionFaults, optional
from geoident.io.schema.values import (
    CaseNumber,
    FilmCoefficient,
    FixedSize,
    FixedTemperature,
    Flag,
    Name,
    QuantityType,
    Text,
)
from geoident.io.text.dates import DateError, read_date
from geoident.io.text.faults import Faults
from geoident.io.text.wording import Refusal, shorten
from geoident.model.in_service import ReservoirFormula, Series, StructureInService, Uplift

WATER_TEMPERATURE = "water_temperature"

_FixedTime = Annotated[CaseNumber, QuantityType("time", above=0.0)]

_A_YEAR = "1971-"
"""Beginning of a date in a year without a day in February that others lack."""


def _day_of_year(text: str) -> str:
    try:
        read_date(_A_YEAR + text)
    except DateError:
        message = f"'{shorten(text)}' is no day of a year"
        raise Refusal("bad-date", message, "Write month and day, such as 07-15.") from None
    return text


class ReservoirSection(Section):
    """Temperature of a reservoir by depth and season, by the formula of Zhu Bofang.

    The formula is of deep reservoirs that lie still. A measured temperature is better.
    """

    model: Literal["zhu"]
    depth: FixedSize = Field(description="Of the reservoir.", examples=["45 m"])
    surface: FixedTemperature = Field(
        description="Mean of the year at the surface.", examples=["14 degC"]
    )
    bottom: FixedTemperature = Field(
        description="Mean of the year at the bottom.", examples=["8 degC"]
    )
    amplitude: Annotated[CaseNumber, QuantityType("temperature", above=0.0)] = Field(
        description="Half of the range over the year at the surface.", examples=["9 K"]
    )
    warmest: Annotated[Text, AfterValidator(_day_of_year)] = Field(
        description="When the air is warmest: month and day.", examples=["07-15"]
    )

    def formula(self) -> ReservoirFormula:
        """The formula for the model."""
        warmest = read_date(_A_YEAR + self.warmest) - read_date(_A_YEAR + "01-01")
        return self.to_model(ReservoirFormula, warmest=warmest)


class FacesSection(Section):
    """Groups of lines (2-D) or surfaces (solid) on which water and air act.

    All other faces let no heat pass.
    """

    wetted: list[Name] = Field(
        [],
        description="Where the water stands: its pressure below the level. The temperature is that "
        "of the water below the level, above it that of the air.",
        examples=[["upstream"]],
    )
    air: list[Name] = Field([], description="In the air.", examples=[["downstream", "crest"]])
    foundation: list[Name] = Field(
        [], description="So deep that the temperature does not change.", examples=[["bottom"]]
    )


class UpliftSection(Section):
    """Water under the structure: its level falls from that of the reservoir along a line.

    On faces of the mesh it is a pressure. Where dam and rock hang together in the mesh there is
    no face between them: give the groups of the rock, in whose pores the water is.
    """

    one_of = (Alternatives("on", "pores", hint="Give faces or pores; a list may have both."),)
    builds = Uplift

    on: list[Name] | None = optional("Groups of lines (2-D) or surfaces (solid) on which it acts.")
    pores: list[Name] | None = optional(
        "Element groups in whose pores it is. Pressure and seepage act on them, and "
        "their surface pushes what stands on it.",
        examples=[["rock"]],
    )
    falls: FallSection = Field(
        description="How the level falls: `from` is where it is that of the reservoir.",
        examples=[
            "{from: [0 m, 0 m], to: [46 m, 0 m], level: 2 m, drain: {at: [6 m, 0 m], left: 0.35}}"
        ],
    )


class ServiceSection(Section):
    """A structure in service, on its mesh as the last stage leaves it.

    `loads` has the level, the air temperature and the temperature of the water day by day. Readings
    have dates; each gauge has a constant of its own, and an error that lasts in time. Materials
    have `conductivity` and `heat_capacity` where `loads` has `air`.
    """

    since: Date = Field(
        description="When the service begins: readings before are not used, and the time of "
        "irreversible motions counts from here."
    )
    loaded: Date | None = optional(
        "When the sustained loads began to act: creep, ageing and softening of "
        "materials count from here; `since` if missing. Before the first value of `loads.level` "
        "its mean acts.",
        examples=["1965-10-01"],
    )
    faces: FacesSection = Field(description="Where water and air act.")
    uplift: list[UpliftSection] = Field(
        [], description="Water under or in the structure that follows the level of the reservoir."
    )
    film: FilmCoefficient | None = optional(
        "Film coefficient of the faces in the air. Without it they have the "
        "temperature of the air.",
        examples=["25 W/m2K"],
    )
    linear: Flag = Field(False, description="Each gauge may have a motion that goes on.")
    settling: Annotated[list[_FixedTime], Field(min_length=1)] | None = optional(
        "Each gauge may have motions that fade, 1 - exp(-t / T): their times T.",
        examples=[["1 year"]],
    )

    def check(self, faults: SectionFaults) -> None:
        """There are faces, and none is in two places."""
        if not (self.faces.wetted or self.faces.air):
            hint = "Write faces: {wetted: [upstream], air: [downstream]}."
            faults.add(("faces",), "missing-key", "nothing acts on any face", hint)
        places = {key: getattr(self.faces, key) for key in ("wetted", "air", "foundation")}
        first: dict[str, str] = {}
        for key, groups in places.items():
            for group in groups:
                if first.setdefault(group, key) != key:
                    message = f"'{group}' is '{first[group]}' as well"
                    faults.add(("faces", key), "two-places", message, "Keep one of them.")
        for n, uplift in enumerate(self.uplift):
            for group in uplift.on or ():
                if first.get(group) == "wetted":
                    message = f"on '{group}' the reservoir acts already: it is 'wetted'"
                    faults.add(("uplift", n, "on"), "two-places", message, "Keep one of them.")
        in_pores = [n for n, uplift in enumerate(self.uplift) if uplift.pores]
        for n in in_pores[1:]:
            message = "water in pores is given twice, and falls along one line only"
            faults.add(("uplift", n, "pores"), "two-waters", message, "Name all groups in one.")


def check_service(section: ServiceSection, given: Collection[str], faults: SectionFaults) -> None:
    """What acts is given, and acts on something.

    Args:
        section: the key ``service``.
        given: names of the loads of the case that change in time.
        faults: takes what is wrong, with paths from the case on.
    """
    faces, at = section.faces, ("service", "faces")
    example = {
        "level": "{file: level.csv}",
        "air": "{file: air.csv}",
        WATER_TEMPERATURE: "{model: zhu, depth: 45 m, surface: 14 degC, bottom: 8 degC, "
        "amplitude: 9 K, warmest: 07-15}",
    }

    def missing(name: str, path: tuple[str, ...], why: str) -> None:
        hint = f"Add loads: {{{name}: {example[name]}}}."
        faults.add(path, "missing-load", f"{why}, and 'loads' has no '{name}'", hint)

    heat = {"air", WATER_TEMPERATURE} & set(given)
    if faces.wetted and "level" not in given:
        missing("level", (*at, "wetted"), "water stands in front of these faces")
    if faces.air and "air" not in given:
        missing("air", (*at, "air"), "these faces are in the air")
    if faces.wetted and heat:
        for name in sorted({"air", WATER_TEMPERATURE} - heat):
            why = "temperatures act on the wetted faces, below and above the level"
            missing(name, (*at, "wetted"), why)
    if not faces.wetted:
        for name in sorted({"level", WATER_TEMPERATURE} & set(given)):
            message, hint = "no face is wetted", "Name these faces: service.faces.wetted."
            faults.add(("loads", name), "unused-load", message, hint)
    if section.uplift and not faces.wetted:
        message = "uplift follows the level of the reservoir, and no face is wetted"
        hint = "Name the faces in front of which the water stands: service.faces.wetted."
        faults.add(("service", "uplift"), "no-level", message, hint)
    if section.film and "air" not in given:
        message = "no temperature of the air acts"
        faults.add(("service", "film"), "unused-key", message, "Remove it, or add loads.air.")


def build_service(
    section: ServiceSection,
    series: Mapping[str, Series],
    water: ReservoirSection | None,
    context: Context,
) -> StructureInService:
    """What acts on the structure, for the model.

    Args:
        section: the key ``service``.
        series: the loads that change in time, by name.
        water: formula of the temperature of the water; None where it is a series, or not given.
        context: of the section.
    """
    faces = section.faces
    for name in ("air", WATER_TEMPERATURE):
        if name in series:
            _refuse_other_units(name, series[name], context.faults)
    return StructureInService(
        since=read_date(section.since),
        wetted=tuple(faces.wetted),
        in_air=tuple(faces.air),
        constant=tuple(faces.foundation),
        film=section.film.scalar if section.film else None,
        level=series.get("level"),
        air=series.get("air"),
        water=water.formula() if water else series.get(WATER_TEMPERATURE),
        linear=section.linear,
        settling=tuple(time.factor for time in section.settling or ()),
        loaded=read_date(section.loaded) if section.loaded else None,
        uplift=tuple(
            uplift.for_model(context.at("uplift", n)) for n, uplift in enumerate(section.uplift)
        ),
    )


_COLDEST, _WARMEST = -60.0, 60.0
"""Temperatures of air and water, degC."""


def _refuse_other_units(name: str, series: Series, faults: Faults) -> None:
    """Temperatures are in degrees Celsius: those of air and water stand beside each other."""
    low, high = float(series.values.min()), float(series.values.max())
    if low < _COLDEST or high > _WARMEST:
        word = "air" if name == "air" else "water"
        message = f"the file has temperatures of the {word} from {low:.4g} to {high:.4g}"
        hint = (
            "Give them in degC. Kelvin less 273.15 are degC; of degrees Fahrenheit (F - 32) / 1.8."
        )
        faults.add(("loads", name), "temperature-unit", message, hint)
