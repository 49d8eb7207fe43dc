"""The keys of a case that describe readings: inline, in files, their dates, and the bad ones."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from typing import Annotated, Any, Literal, get_args

from pydantic import BeforeValidator, Discriminator, Field, Tag, WithJsonSchema, model_validator

from geoident.io.case.accuracy import FORCES, dimension_read
from geoident.io.case.gauges import GaugeSection
from geoident.io.readings.ags import HEADINGS
from geoident.io.readings.file import format_of
from geoident.io.readings.table import COLUMNS, Layout, Origin
from geoident.io.schema.section import Section, SectionFaults
from geoident.io.schema.values import Flag, Given, Name, Of, Text, require_text
from geoident.io.text.dates import ISO, DateError, format_problem, read_date
from geoident.io.text.wording import Refusal, listing, shorten
from geoident.units import UnitError, normal_unit, size_in, units_of

DELIMITERS = {",": ",", ";": ";", "tab": "\t", "|": "|"}


def _date(value: object) -> str:
    text = require_text(value, "a date")
    try:
        read_date(text)
    except DateError as error:
        raise Refusal(
            "bad-date", str(error), "Write it like 2024-03-01 or 2024-03-01 14:30."
        ) from None
    return text


def _date_format(value: object) -> str:
    text = require_text(value, "a date format")
    problem = format_problem(text)
    if problem:
        message = f"'{shorten(text)}' is no date format: {problem}"
        raise Refusal("bad-date-format", message, "Write it like DD.MM.YYYY or DD/MM/YYYY hh:mm.")
    return text


def dimensions_of(kinds: Iterable[type[Section]]) -> tuple[str, ...]:
    """Dimensions of what gauges of some kinds read: those of their accuracies."""
    found: list[str] = []
    for kind in kinds:
        one = dimension_read(kind)
        found += FORCES if one is None else (one,)
    return tuple(dict.fromkeys(found))


def quantity_read(read: Sequence[str], *, above: float | None = None) -> Of:
    """What a reading must be that stands in the case: any quantity where gauges read several."""
    return Of(read[0] if len(read) == 1 else None, above=above)


READ = dimensions_of(get_args(get_args(GaugeSection)[0]))
"""Dimensions of what gauges read."""
_WHAT = " or ".join(READ)
_UNITS = tuple(dict.fromkeys(unit for name in READ for unit in units_of(name) if unit))


def _unit_read(value: object) -> str:
    text = require_text(value, f"a unit of {_WHAT}")
    try:
        unit = normal_unit(text)
    except UnitError as error:
        raise Refusal("unit", error.message, error.hint) from None
    if all(size_in(unit, dimension) is None for dimension in READ):
        message = f"'{text}' is no unit of {_WHAT}"
        raise Refusal("unit", message, f"Units of {_WHAT}: {listing(_UNITS)}.")
    return unit


def _sign(value: object) -> int:
    text = str(value)
    if text.lstrip("+") not in {"1", "-1"}:
        message = f"found '{shorten(text)}'; 1 or -1 is expected"
        raise Refusal("not-listed", message)
    return int(text)


def _column_key(key: object) -> str:
    text = require_text(key, "the name of a column")
    if text not in COLUMNS:
        message = f"there is no column '{shorten(text)}'"
        raise Refusal("unknown-key", message, f"Columns: {listing(COLUMNS)}.")
    return text


Date = Annotated[
    str,
    BeforeValidator(_date),
    WithJsonSchema({"type": "string", "description": "a date such as 2024-03-01 [14:30]"}),
]
DateFormat = Annotated[
    str,
    BeforeValidator(_date_format),
    WithJsonSchema({"type": "string", "description": "made of YYYY, MM, DD, hh, mm, ss"}),
]
ReadValue = Annotated[Given, quantity_read(READ)]
ReadAccuracy = Annotated[Given, quantity_read(READ, above=0.0)]
UnitRead = Annotated[str, BeforeValidator(_unit_read), WithJsonSchema({"enum": list(_UNITS)})]
Sign = Annotated[int, BeforeValidator(_sign), WithJsonSchema({"enum": [1, -1]})]


class ReadingSection(Section):
    """One reading."""

    gauge: Name = Field(description="Gauge, or GAUGE.ANCHOR of an extensometer.")
    stage: Name = Field(description="Stage at whose end it was read.")
    value: ReadValue | None = Field(description="What was read; empty if it is missing.")
    accuracy: ReadAccuracy | None = Field(None, description="Its own standard deviation.")


class OriginSection(Section):
    """Where the readings of one channel come from in a file."""

    name: Text = Field("", description="Name of the gauge in the file (long) or column (wide).")
    unit: UnitRead | None = Field(None, description="Unit, where the file does not say it.")
    sign: Sign = Field(1, description="-1 if the file counts the other way round.")
    LOCA_ID: Text | None = Field(None, description="AGS: location that the rows must have.")
    MONG_ID: Text | None = Field(None, description="AGS: instrument that the rows must have.")
    MONG_DIS: Text | None = Field(None, description="AGS: distance that the rows must have.")
    MOND_TYPE: Text | None = Field(None, description="AGS: type of reading of the rows.")
    MOND_REF: Text | None = Field(None, description="AGS: reference of the rows.")
    MOND_INST: Text | None = Field(None, description="AGS: instrument of the rows.")

    def origin(self) -> Origin:
        """For the readers of files."""
        fields = {name: getattr(self, name) for name in HEADINGS}
        known = {name: value for name, value in fields.items() if value is not None}
        return Origin(self.name, self.unit or "", self.sign, known)


def _origin_shape(value: object) -> str:
    return "mapping" if isinstance(value, Mapping | OriginSection) else "text"


OriginValue = Annotated[
    Annotated[Text, Tag("text")] | Annotated[OriginSection, Tag("mapping")],
    Discriminator(_origin_shape),
]
ColumnKey = Annotated[str, BeforeValidator(_column_key)]


class ReadingsFileSection(Section):
    """A file of readings and how it is laid out. Nothing is guessed: declare what differs."""

    file: Text = Field(description="Path of a CSV file, or of an AGS4 file (.ags).")
    layout: Literal["long", "wide"] = Field(
        "long", description="long: one reading a row; wide: one column a channel, dates in rows."
    )
    delimiter: Literal[",", ";", "tab", "|"] = Field(",", description="Between columns.")
    decimal: Literal[".", ","] = Field(".", description="Decimal point or comma.")
    columns: dict[ColumnKey, Text] = Field(
        {}, description="Names in the header: {gauge: Instrument, value: Reading, date: Datum}."
    )
    unit: UnitRead | None = Field(None, description="Unit of all values without one.")
    unit_row: Flag = Field(False, description="wide: units stand in the line below the header.")
    date_format: DateFormat = Field(
        ISO, description="How dates are written.", examples=["DD.MM.YYYY", "MM/DD/YYYY hh:mm"]
    )
    channels: dict[Name, OriginValue] = Field(
        {}, description="Channel of the case to its name in the file, or to more about it."
    )
    several: Literal["last", "mean", "all"] | None = Field(
        None,
        description="Several readings in a stage: the last, their mean (its standard deviation "
        "that of one by the root of their number), or all. Default last with dates; without, one.",
    )
    rezero: Flag = Field(
        False,
        description="Subtract from each channel what was read at its zero, which dates must tell.",
    )

    @model_validator(mode="after")
    def _fits_itself(self) -> ReadingsFileSection:
        faults = SectionFaults()
        many = format_of(self.file).many
        if self.decimal == "," and self.delimiter == "," and not many:
            message = "a comma cannot be decimal mark and delimiter at once"
            faults.add(("decimal",), "contradiction", message, "Give 'delimiter: \";\"'.")
        if self.unit_row and self.layout != "wide":
            message = "a row of units belongs to the wide layout"
            faults.add(("unit_row",), "contradiction", message, "Add 'layout: wide'.")
        if many and not self.channels:
            message = f"'channels' is missing: {many} has readings of many instruments"
            hint = "Write channels: {CHANNEL: {MONG_ID: ..., MONG_DIS: ...}}."
            faults.add((), "missing-key", message, hint)
        faults.raise_any()
        return self

    def described(self, dimensions: Mapping[str, str]) -> Layout:
        """For the readers of files.

        Args:
            dimensions: channel to the dimension of its readings.
        """
        return Layout(
            delimiter=DELIMITERS[self.delimiter],
            decimal=self.decimal,
            columns=dict(self.columns),
            unit=self.unit or "",
            date_format=self.date_format,
            wide=self.layout == "wide",
            unit_row=self.unit_row,
            channels={
                name: Origin(value) if isinstance(value, str) else value.origin()
                for name, value in self.channels.items()
            },
            dimensions=dimensions,
        )


class BadSection(Section):
    """Readings that are known to be wrong: kept, shown with the reason, and not used."""

    gauge: Name = Field(description="Gauge, or GAUGE.ANCHOR of an extensometer.")
    stage: Name | None = Field(None, description="Stage; all stages if missing.")
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


def _readings_shape(value: object) -> str:
    if isinstance(value, list | tuple):
        return "list"
    return "<file>" if isinstance(value, Mapping | ReadingsFileSection) else "text"


Readings = Annotated[
    Annotated[Text, Tag("text")]
    | Annotated[ReadingsFileSection, Tag("<file>")]
    | Annotated[list[Entry], Tag("list")],
    Discriminator(_readings_shape),
]


def entries(readings: Any) -> list[tuple[tuple[str | int, ...], Any]]:
    """What ``readings`` names, each with its path of keys: paths, files or single readings."""
    if readings is None:
        return []
    if isinstance(readings, list):
        return [(("readings", n), entry) for n, entry in enumerate(readings)]
    return [(("readings",), readings)]
