"""The key ``model`` of a settlement law: a fill on clay, its plates and rods."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Annotated, Literal

from pydantic import Discriminator, Field, Tag

from geoident.io.case.drains import check_smear
from geoident.io.case.external.by_gauge import ByGauge, LikeReading
from geoident.io.case.in_service.series import DatedTableSection
from geoident.io.case.readings import Date
from geoident.io.schema.section import Alternatives, Section, SectionFaults, optional
from geoident.io.schema.values import (
    CaseNumber,
    Coefficient,
    Diffusivity,
    FixedDuration,
    FixedLength,
    FixedSize,
    FixedStress,
    FixedUnitWeight,
    Modulus,
    Multiple,
    Name,
    QuantityType,
    Size,
    Text,
    TextOrList,
    Time,
)
from geoident.model.drains import misplaced
from geoident.units import DIMENSIONLESS


class LiftSection(Section):
    """A lift of the fill: what stands on the clay from a day on."""

    one_of = (
        Alternatives(
            "date height lasts?", "date load lasts?", hint="Give one of 'height' and 'load'."
        ),
    )

    date: Date = Field(description="Day on which it is placed, or on which that begins.")
    height: FixedLength | None = optional(
        "Thickness of the whole fill after it.", examples=["2.5 m"]
    )
    load: FixedStress | None = optional("Load of the whole fill after it.", examples=["45 kPa"])
    lasts: FixedDuration | None = optional(
        "Time over which it is placed evenly; at once if missing.", examples=["10 days"]
    )


class FillFileSection(DatedTableSection):
    """A file with a lift in each row: its date, and height or load of the whole fill after it."""

    one_of = (Alternatives("height", "load", hint="Name the column of one of them."),)

    height: Text | None = optional(
        "Name of the column with the thickness of the fill.", examples=["height"]
    )
    load: Text | None = optional("Name of the column with the load of the fill.", examples=["load"])


Lifts = Annotated[list[LiftSection], Field(min_length=1)]


def _fill_shape(value: object) -> str:
    if isinstance(value, FillFileSection) or (isinstance(value, Mapping) and "file" in value):
        return "<file>"
    return "list"


FillValue = Annotated[
    Annotated[Lifts, Tag("list")] | Annotated[FillFileSection, Tag("<file>")],
    Discriminator(_fill_shape),
]


def _fills_shape(value: object) -> str:
    of_one = not isinstance(value, Mapping) or "file" in value
    return "<fill>" if of_one or isinstance(value, FillFileSection) else "<by gauge>"


Fills = Annotated[
    Annotated[FillValue, Tag("<fill>")] | Annotated[dict[Name, FillValue], Tag("<by gauge>")],
    Discriminator(_fills_shape),
]


class DrainsSection(Section):
    """Vertical drains (Barron 1948, Hansbo 1981: equal strain, smear)."""

    c_h: ByGauge[Diffusivity] = Field(
        description="Coefficient of consolidation for water that flows to the drains.",
        examples=["$c_h"],
    )
    spacing: FixedSize = Field(description="Distance of neighbouring drains.", examples=["1.2 m"])
    pattern: Literal["triangle", "square"] = Field(
        "triangle", description="How they stand: a drain has 1.05 or 1.13 spacings around it."
    )
    diameter: FixedSize = Field(
        description="Of a drain; of a strip half the sum of width and thickness.",
        examples=["66 mm"],
    )
    smear: FixedSize | None = optional(
        "Diameter of the ground that was disturbed around it.", examples=["0.2 m"]
    )
    smear_ratio: ByGauge[Multiple] | None = optional(
        "Permeability of the ground by that of the disturbed ground.", examples=["3"]
    )
    installed: Date | None = optional("When they were installed; before the fill if missing.")

    def check(self, faults: SectionFaults) -> None:
        """Drains are apart from each other, and what is disturbed lies between."""
        check_smear(self.smear, self.smear_ratio, faults)
        smear = None if self.smear is None else self.smear.factor
        wrong = misplaced(self.spacing.factor, self.diameter.factor, smear)
        if wrong is not None:
            key, why = wrong
            faults.add((key,), "out-of-range", why, "Correct one of them.")


_Degree = Annotated[CaseNumber, QuantityType(DIMENSIONLESS, above=0.0, below=1.0)]
Dates = TextOrList[Date, Annotated[list[Date], Field(min_length=1)]]
Degrees = TextOrList[_Degree, Annotated[list[_Degree], Field(min_length=1)]]

_OF_CURVES = ("since", "T")
"""Keys of Asaoka's and the hyperbolic method, which both need."""
_OF_CONSOLIDATION = (
    "fill", "unit_weight", "stress", "c_v", "path", "drains", "creep", "creep_time",
)  # fmt: skip


class SettlementLawSection(Section):
    """Settlement of a fill on clay in time, read on plates and rods.

    `asaoka`: s = S [1 - exp(-t / T)], on which Asaoka's (1978) line is drawn; `hyperbola`: s =
    S t / (T + t) (Tan 1991). Both apply from the end of loading on, `since`; what a gauge shows
    until then is its `offset`. `consolidation`: S times the degree of consolidation of each lift of
    `fill` (Terzaghi 1943, Barron 1948, Hansbo 1981; Olson 1977), and creep. Each constant is a
    number or `$NAME`, for all gauges or by gauge (`{P1: $S_1, P2: $S_2}`). The stages are the days
    of reading, and those of `forecast`.
    """

    kind: Literal["settlement-law"]
    law: Literal["asaoka", "hyperbola", "consolidation"] = Field(
        description="What the settlement follows in time."
    )
    since: Date | None = optional(
        "From when on the law applies: the end of loading. Earlier readings are not "
        "used. Consolidation applies from the first lift on.",
        examples=["2024-06-01"],
    )
    S: ByGauge[LikeReading] = Field(
        description="Settlement in the end: since `since`; of `consolidation` under the whole "
        "fill, without creep. Positive where readings are.",
        examples=[{"P1": "$S_1", "P2": "$S_2"}],
    )
    T: ByGauge[Time] | None = optional(
        "Time after which 63 % of `S` (asaoka) or half of it (hyperbola) has come.", examples=["$T"]
    )
    m: ByGauge[Coefficient] | None = optional(
        "Of `hyperbola`: shape between that (1, if missing) and `asaoka` (0), S [1 - "
        "(1 + m t / T)^(-1 / m)]. As a parameter with bounds 0 and 1 it says what is not known of "
        "the shape.",
        examples=["$m"],
    )
    fill: Fills | None = optional(
        "The lifts, for all gauges or by gauge: a list, or a file with a row for each.",
        examples=[[{"date": "2024-03-01", "height": "1 m"}]],
    )
    unit_weight: FixedUnitWeight | None = optional(
        "Of the fill, where it is given by height.", examples=["19 kN/m3"]
    )
    stress: ByGauge[Modulus] | None = optional(
        "Effective stress in the middle of the clay before the fill: the parts that "
        "lifts have in `S` then go by the logarithm of the stress. Without it they go by load.",
        examples=["30 kPa"],
    )
    c_v: ByGauge[Diffusivity] | None = optional(
        "Coefficient of consolidation for water that flows up and down.", examples=["$c_v"]
    )
    path: ByGauge[Size] | None = optional(
        "Longest way of this water: half the clay where it drains on both sides.", examples=["4 m"]
    )
    drains: DrainsSection | None = optional("Vertical drains.")
    creep: ByGauge[Coefficient] | None = optional(
        "Creep of a lift in a tenfold of time, as a part of its `S`: C_alpha.",
        examples=["$C_alpha"],
    )
    creep_time: ByGauge[Time] | None = optional(
        "Time after a lift from which on creep counts: log10(1 + t / creep_time).",
        examples=["30 days"],
    )
    forecast: Dates | None = optional(
        "Days to be predicted, beside those of reading.", examples=["2030-01-01"]
    )
    until: Date | None = optional(
        "When settlement counts as final; the end of all consolidation if missing. "
        "Creep has no end, so that it needs a date.",
        examples=["2055-01-01"],
    )
    degree: Degrees | None = optional(
        "Parts of the final settlement; a fit says when each gauge reaches them.",
        examples=[["90 %", "95 %"]],
    )
    remaining_after: Dates | None = optional(
        "Dates; a fit says how much settlement comes after each: of the opening, say.",
        examples=["2026-05-01"],
    )

    def check(self, faults: SectionFaults) -> None:
        """The keys are those of the law."""
        by_load = self.law == "consolidation"
        strange = _OF_CURVES if by_load else _OF_CONSOLIDATION
        for key in strange:
            if getattr(self, key) is not None:
                message = f"the law '{self.law}' does not depend on it"
                faults.add((key,), "unused-key", message, f"Remove it. {_NEEDS[self.law]}")
        if self.law != "hyperbola" and self.m is not None:
            faults.add(("m",), "unused-key", f"the law '{self.law}' has no shape", "Remove it.")
        needed = ("fill",) if by_load else _OF_CURVES
        missing = [key for key in needed if getattr(self, key) is None]
        if by_load and self.c_v is None and self.drains is None:
            missing.append("c_v")
        if missing:
            message = f"the law '{self.law}' needs {' and '.join(map(repr, missing))}"
            faults.add((), "missing-key", message, _NEEDS[self.law])
        for one, other in (("c_v", "path"), ("creep", "creep_time")):
            pair = getattr(self, one), getattr(self, other)
            if by_load and (pair[0] is None) != (pair[1] is None):
                given, lacks = (one, other) if pair[1] is None else (other, one)
                message = f"'{given}' without '{lacks}' says nothing"
                faults.add((given,), "missing-key", message, f"Add '{lacks}', or remove it.")
        if self.creep is not None and self.until is None:
            message = "creep has no end, and the case does not say when settlement is final"
            hint = "Add 'until: DATE', such as the end of the design life."
            faults.add(("creep",), "missing-key", message, hint)


_NEEDS = {
    "asaoka": "It has since, S and T.",
    "hyperbola": "It has since, S and T.",
    "consolidation": "It has fill and S, c_v with path or drains or both, and maybe creep.",
}
