"""The keys of a case that describe readings: inline, in files, their dates, and the bad ones."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Annotated

from pydantic import AfterValidator, BeforeValidator, Discriminator, Field, Tag, WithJsonSchema

from geoident.io.case.durations import require_no_negative
from geoident.io.case.gauges.accuracy import computable
from geoident.io.case.site_files.file import ReadingsFileSection
from geoident.io.schema.section import Section, optional
from geoident.io.schema.values import (
    TEXT_LIST_OR_MAPPING,
    AnyQuantity,
    CaseNumber,
    FixedTime,
    Name,
    QuantityType,
    Text,
    require_text,
)
from geoident.io.text.dates import DateError, read_date, utc_offset
from geoident.io.text.wording import Refusal, shorten


def read_case_date(value: object) -> str:
    """A date as a case gives it, checked.

    Raises:
        Refusal: it is none, or has an offset from UTC.
    """
    text = require_text(value, "a date")
    try:
        read_date(text)
    except DateError as error:
        raise Refusal(
            "bad-date", str(error), "Write it like 2024-03-01 or 2024-03-01 14:30."
        ) from None
    if utc_offset(text) is not None:
        message = f"'{shorten(text)}' has an offset from UTC; expected the local time of the site"
        raise Refusal("bad-date", message, "Write it without, like 2024-03-01 14:30.")
    return text


Date = Annotated[
    str,
    BeforeValidator(read_case_date),
    WithJsonSchema({"type": "string", "description": "a date such as 2024-03-01 [14:30]"}),
]
ReadAccuracy = Annotated[CaseNumber, QuantityType(None, above=0.0), AfterValidator(computable)]


class ReadingSection(Section):
    """One reading."""

    gauge: Name = Field(description="Gauge, or GAUGE.ANCHOR of an extensometer.")
    stage: Name | None = optional(
        "Stage at whose end it was read. Required where there are several. "
        "`STAGE + TIME` for a moment of a stage that lasts."
    )
    time: Annotated[FixedTime, AfterValidator(require_no_negative)] | None = optional(
        "When it was read, since the beginning of its stage, which lasts; at its end if missing.",
        examples=["12 d"],
    )
    value: AnyQuantity | None = Field(description="What was read; empty if it is missing.")
    accuracy: ReadAccuracy | None = optional("Its own standard deviation.")


class BadSection(Section):
    """Readings that are known to be wrong: kept, shown with the reason, and not used."""

    gauge: Name = Field(description="Gauge, or GAUGE.ANCHOR of an extensometer.")
    stage: Name | None = optional("Stage; all stages if missing.")
    reason: Text = Field(description="Why, such as 'head hit by blast'.")


def _entry_shape(value: object) -> str:
    if isinstance(value, ReadingsFileSection) or (isinstance(value, Mapping) and "file" in value):
        return "<file>"
    return "text" if isinstance(value, str) else "reading"


Entry = Annotated[
    Annotated[Text, Tag("text")]
    | Annotated[ReadingsFileSection, Tag("<file>")]
    | Annotated[ReadingSection, Tag("reading")],
    Discriminator(_entry_shape),
]


Readings = Annotated[
    Annotated[Text, Tag("text")]
    | Annotated[ReadingsFileSection, Tag("mapping")]
    | Annotated[list[Entry], Tag("list")],
    TEXT_LIST_OR_MAPPING,
]
