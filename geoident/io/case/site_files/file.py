"""The keys that describe a file of readings: how it is laid out, and what its columns are."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Annotated, Literal

from pydantic import Field

from geoident.io.case.site_files.sensors import CalibrationSection, TransformationSection
from geoident.io.case.site_files.values import (
    Cells,
    ColumnKey,
    DateFormat,
    Sign,
    TextEncoding,
    UnitRead,
)
from geoident.io.readings.ags import HEADINGS
from geoident.io.readings.file import Format, format_of
from geoident.io.readings.layout import Layout, Origin
from geoident.io.readings.survey import SurveyGrid
from geoident.io.schema.section import Section, SectionFaults, optional
from geoident.io.schema.values import Count, Flag, Name, Text, TextOrList, TextOrMapping
from geoident.io.text.dates import ISO
from geoident.units import size_in

DELIMITERS = {",": ",", ";": ";", "tab": "\t", "|": "|"}


class OriginSection(Section):
    """Where the readings of one channel come from in a file."""

    name: Text = Field("", description="Name of the gauge in the file (long) or column (wide).")
    unit: UnitRead | None = optional("Unit, where the file does not say it.")
    sign: Sign = Field(1, description="-1 if the file counts the other way round.")
    LOCA_ID: Text | None = optional("AGS: location that the rows must have.")
    MONG_ID: Text | None = optional("AGS: instrument that the rows must have.")
    MONG_DIS: Text | None = optional("AGS: distance that the rows must have.")
    MOND_TYPE: Text | None = optional("AGS: type of reading of the rows.")
    MOND_REF: Text | None = optional("AGS: reference of the rows.")
    MOND_INST: Text | None = optional("AGS: instrument of the rows.")
    calibration: CalibrationSection | None = optional(
        "Of the sensor, where the file has what it gives, such as Hz."
    )

    def check(self, faults: SectionFaults) -> None:
        """A calibration defines its unit."""
        if self.calibration is not None and self.unit is not None:
            message = "found unit and calibration, which defines the unit"
            faults.add(("unit",), "contradiction", message, "Remove 'unit'.")

    def origin(self) -> Origin:
        """For the readers of files."""
        fields = {name: getattr(self, name) for name in HEADINGS}
        known = {name: value for name, value in fields.items() if value is not None}
        calibration = self.calibration.calibration() if self.calibration else None
        return Origin(self.name, self.unit or "", self.sign, known, calibration)


HeaderRow = Annotated[int, Count(0)]
HeaderRows = Annotated[int, Count()]
OriginValue = TextOrMapping[Text, OriginSection]
Texts = Annotated[list[Text], Field(min_length=1)]


Paths = TextOrList[Text, Texts]


class ReadingsFileSection(Section):
    """A file of readings and how it is laid out. Nothing is guessed: declare what differs."""

    file: Paths = Field(
        description="Path of a CSV file, an Excel workbook (.xlsx) or an AGS4 file (.ags); a list "
        "of files of one layout counts as one."
    )
    layout: Literal["long", "wide", "coordinates"] = Field(
        "long",
        description="long: one reading a row; wide: one column a channel, dates in rows; "
        "coordinates: point, date, easting, northing and height in each row.",
    )
    encoding: TextEncoding | None = optional(
        "Of a text; UTF-8 if missing. Excel's CSV is mostly windows-1252."
    )
    sheet: Text = Field(
        "",
        description="Excel: name of the sheet, where there are several. Hidden rows and columns "
        "are read as well; cells that join rows give their name or date to each of them, and are "
        "refused for a reading.",
    )
    range: Cells | None = optional("Excel: cells of the table with its header.")
    header_row: HeaderRow = Field(
        0,
        description="Line or row of the header, counted from 1; 0 for the first that is not empty.",
    )
    header_rows: HeaderRows = Field(
        1, description="Number of rows with names of columns: EX1 above a5 is EX1 a5."
    )
    data_row: HeaderRow = Field(
        0, description="First line or row of readings, counted from 1; 0: the one below the header."
    )
    blank: list[Text] = Field(
        [], description="Texts of cells that stand for no reading.", examples=[["n/a", "---"]]
    )
    ignore: list[Text] = Field([], description="Names of columns that are not read.")
    delimiter: Literal[",", ";", "tab", "|"] = Field(",", description="Between columns.")
    decimal: Literal[".", ","] = Field(".", description="Decimal point or comma.")
    columns: dict[ColumnKey, Text] = Field(
        {},
        description="Names in the header: {gauge: Instrument, value: Reading, date: Datum}. A "
        "column 'remarks' is kept with the readings of its row.",
    )
    unit: UnitRead | None = optional("Unit of all values without one.")
    unit_row: Flag = Field(False, description="wide: units are in the line below the header.")
    date_format: DateFormat = Field(
        ISO, description="How dates are written.", examples=["DD.MM.YYYY", "MM/DD/YYYY hh:mm"]
    )
    channels: dict[Name, OriginValue] = Field(
        {},
        description="Channel of the case (of coordinates: gauge) to its name in the file, or to "
        "more about it. Others are read where the file has exactly their name.",
    )
    transformation: TransformationSection | None = optional(
        "coordinates: from the system of the survey to that of the model."
    )
    repeated_readings: Literal["last", "mean", "all"] | None = optional(
        "Several readings in a stage: the last, their mean (its standard deviation "
        "that of one by the root of their number), or all. Default last with dates; without, one."
    )
    several: Literal["last", "mean", "all"] | None = optional(
        "Earlier name of `repeated_readings`."
    )
    rezero: Flag = Field(
        False,
        description="Subtract from each channel what was read at its zero, which dates must tell.",
    )

    def check(self, faults: SectionFaults) -> None:
        """The keys fit the format and the layout of the file."""
        formats = [format_of(path) for path in self.paths]
        many = next((known.many for known in formats if known.many), "")
        if self.several and self.repeated_readings:
            message = "'several' is the earlier name of 'repeated_readings'; both are given"
            faults.add(("several",), "contradiction", message, "Remove it.")
        text = not many and not any(known.sheets for known in formats)
        if self.decimal == "," and self.delimiter == "," and text:
            message = "a comma cannot be decimal mark and delimiter at once"
            faults.add(("decimal",), "contradiction", message, "Give 'delimiter: \";\"'.")
        if self.unit_row and self.layout != "wide":
            message = "a row of units belongs to the wide layout"
            faults.add(("unit_row",), "contradiction", message, "Add 'layout: wide'.")
        if many and not self.channels:
            message = f"'channels' is missing: {many} has readings of many instruments"
            hint = "Write channels: {CHANNEL: {MONG_ID: ..., MONG_DIS: ...}}."
            faults.add((), "missing-key", message, hint)
        if many:
            self._check_sensors(many, faults)
        self._check_format(formats, faults)
        self._check_rows(faults)
        self._check_coordinates(faults)

    def _check_sensors(self, many: str, faults: SectionFaults) -> None:
        """Rows of one instrument each have no column with the temperature of their sensor."""
        for name, value in self.channels.items():
            calibration = None if isinstance(value, str) else value.calibration
            if calibration is not None and calibration.thermal is not None:
                message = f"{many} has no column with the temperature of the sensor of '{name}'"
                hint = "Correct the readings in the file, or leave out 'thermal'."
                path = ("channels", name, "calibration", "thermal")
                faults.add(path, "contradiction", message, hint)

    def _check_format(self, formats: list[Format], faults: SectionFaults) -> None:
        """Keys of workbooks belong to workbooks, keys of texts to texts."""
        sheets = [known.sheets for known in formats]
        for key in ("sheet", "range"):
            if getattr(self, key) and not all(sheets):
                message = f"'{key}' belongs to an Excel workbook"
                faults.add((key,), "contradiction", message, "Remove it, or name an .xlsx file.")
        if self.encoding and any(sheets):
            message = "'encoding' belongs to a text; a workbook has its own"
            faults.add(("encoding",), "contradiction", message, "Remove it.")

    def _check_rows(self, faults: SectionFaults) -> None:
        last = self.header_row + self.header_rows - 1
        if self.data_row and self.data_row <= last:
            message = f"row {self.data_row} is not below the header, which ends in row {last}"
            faults.add(("data_row",), "contradiction", message, "Count rows from 1.")

    def _check_coordinates(self, faults: SectionFaults) -> None:
        if self.layout != "coordinates":
            if self.transformation is not None:
                message = "a transformation belongs to the layout of coordinates"
                hint = "Add 'layout: coordinates', or remove it."
                faults.add(("transformation",), "contradiction", message, hint)
            return
        if self.transformation is None:
            message = "'transformation' is missing: coordinates are of the system of the survey"
            hint = "Write transformation: {azimuth: 37.5 deg, origin: [E, N, H]}, the azimuth of x."
            faults.add((), "missing-key", message, hint)
        if self.unit and size_in(self.unit, "length") is None:
            message = f"'{self.unit}' is not a unit of coordinates"
            faults.add(("unit",), "unit", message, "Write 'unit: m'.")
        for name, value in self.channels.items():
            if isinstance(value, OriginSection) and value.origin() != Origin(value.name):
                message = "a point of coordinates has a name only"
                hint = f"Write {name}: {value.name or 'POINT'}; signs follow from the axes."
                faults.add(("channels", name), "contradiction", message, hint)

    @property
    def paths(self) -> tuple[str, ...]:
        """The files, as the case names them."""
        return (self.file,) if isinstance(self.file, str) else tuple(self.file)

    def described(self, dimensions: Mapping[str, str], survey: SurveyGrid | None = None) -> Layout:
        """For the readers of files.

        Args:
            dimensions: channel to the dimension of its readings.
            survey: how coordinates become readings; None for other layouts.
        """
        return self.to_model(
            Layout,
            delimiter=DELIMITERS[self.delimiter],
            wide=self.layout == "wide",
            channels={
                name: Origin(value) if isinstance(value, str) else value.origin()
                for name, value in self.channels.items()
            },
            dimensions=dimensions,
            ignore=tuple(name.strip().lower() for name in self.ignore),
            cells=self.range or "",
            survey=survey,
        )
