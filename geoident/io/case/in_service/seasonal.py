"""The key ``model`` of a seasonal model: readings as a sum of effects (HST, HSTT, HTT)."""

from __future__ import annotations

from collections.abc import Collection, Mapping
from typing import Annotated, Literal

from pydantic import Field

from geoident.io.case.readings import Date
from geoident.io.schema.section import Section, SectionFaults, optional
from geoident.io.schema.values import CaseNumber, Count, Flag, QuantityType
from geoident.io.text.dates import read_date
from geoident.io.text.faults import Faults
from geoident.model.case import KeyPath
from geoident.model.in_service import SeasonalModel, Series

IN_SERVICE = "service"
"""Name of the one stage of a structure in service."""

_LOADS = {"level": "level", "air": "temperature of the air"}

_MOST_POWERS, _MOST_HARMONICS = 6, 12
"""Beyond them columns are so much alike that no reading tells them apart."""

_FixedTime = Annotated[CaseNumber, QuantityType("time", above=0.0)]


class SeasonalModelSection(Section):
    """Readings of a structure in service as a sum of effects: season, level, air, time.

    With `level`, `season` and `linear` or `settling` it is the model HST of dam owners, with `air`
    as well HSTT, with `air` in place of `season` HTT. Each gauge has coefficients of its own and an
    error that lasts in time; both follow from its readings. `loads` has the level and the air
    temperature day by day.
    """

    kind: Literal["seasonal"]
    since: Date = Field(
        description="When the structure was put into service: the time of irreversible effects "
        "counts from here, and readings before are not used."
    )
    level: Annotated[int, Count()] | None = optional(
        "Effect of the water level, `loads: {level: {file: ...}}`: a polynomial up to "
        "this power, mostly 3 or 4.",
        examples=[3],
    )
    season: Annotated[int, Count()] | None = optional(
        "Effect of the season, the same every year: a year and its parts down to this "
        "one, mostly 2.",
        examples=[2],
    )
    air: Annotated[list[_FixedTime], Field(min_length=1)] | None = optional(
        "Effect of the air temperature, `loads: {air: {file: ...}}`: response times of "
        "the structure, one effect for each.",
        examples=[["3 d", "20 d", "60 d"]],
    )
    linear: Flag = Field(False, description="An irreversible motion that goes on at one rate.")
    settling: Annotated[list[_FixedTime], Field(min_length=1)] | None = optional(
        "Irreversible motions that fade, 1 - exp(-t / T): their times T.", examples=[["1 year"]]
    )

    def check(self, faults: SectionFaults) -> None:
        """There is an effect."""
        if not (self.level or self.season or self.air or self.linear or self.settling):
            hint = "Write season: 2, and level: 3 where a water level acts."
            faults.add((), "missing-key", "the model has no effect at all", hint)
        for key, most in (("level", _MOST_POWERS), ("season", _MOST_HARMONICS)):
            if (getattr(self, key) or 0) > most:
                message = f"'{getattr(self, key)}' is more than readings can tell"
                faults.add((key,), "too-many", message, f"Write {most} at most, mostly 2 to 4.")

    def used_loads(self) -> list[str]:
        """Names of the loads in time on which it depends."""
        return [name for name in ("level", "air") if getattr(self, name) is not None]


def build_seasonal(
    section: SeasonalModelSection,
    series: Mapping[str, Series],
    given: Collection[str],
    faults: Faults,
) -> SeasonalModel:
    """The model of a case.

    Args:
        section: the key ``model``.
        series: the loads that change in time, by name.
        given: names of all of them in the case, also of those that could not be read.
        faults: takes what is wrong.
    """
    at: KeyPath = ("model",)
    for name in section.used_loads():
        if name not in given:
            message = f"'{name}' of the model needs the {_LOADS[name]} over time"
            hint = f"Add loads: {{{name}: {{file: {name}.csv}}}}."
            faults.add((*at, name), "missing-load", message, hint, key=True)
    return SeasonalModel(
        since=read_date(section.since),
        level=series.get("level") if section.level else None,
        powers=section.level or 0,
        harmonics=section.season or 0,
        air=series.get("air") if section.air else None,
        lags=tuple(lag.factor for lag in section.air or ()),
        linear=section.linear,
        settling=tuple(time.factor for time in section.settling or ()),
    )
