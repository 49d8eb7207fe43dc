"""How a file of readings is laid out. It is declared by the user; nothing is guessed."""

from __future__ import annotations

from collections.abc import Collection, Mapping
from dataclasses import dataclass, field
from typing import Literal

from geoident.io.readings.calibration import Calibration
from geoident.io.readings.survey import SurveyGrid
from geoident.io.text.dates import ISO

COLUMNS = ("gauge", "stage", "date", "time", "value", "unit", "accuracy", "bad", "remarks")
POINT_COLUMNS = ("point", "east", "north", "height")
"""Columns of the layout of coordinates, beside stage or date, bad and remarks."""


@dataclass(frozen=True)
class Origin:
    """Where the readings of one channel come from in a file.

    Args:
        name: in the column of gauges, or of the column itself in the wide layout.
        unit: of its values; empty for what the file says.
        sign: -1 if the file counts the other way round.
        fields: AGS heading to the value that it must have, such as ``MONG_ID``.
        calibration: makes readings of what the sensor gives; None where the file has readings.
    """

    name: str = ""
    unit: str = ""
    sign: int = 1
    fields: Mapping[str, str] = field(default_factory=dict)
    calibration: Calibration | None = None


@dataclass(frozen=True)
class Layout:
    """How a file is laid out.

    Args:
        delimiter: one character between columns.
        decimal: ``.`` or ``,``.
        columns: key of `COLUMNS` to its name in the header.
        unit: of all values that say none themselves; empty for none declared.
        date_format: see `geoident.io.text.dates`.
        wide: one column a channel, one row a date or stage.
        unit_row: the line after the header holds the units.
        channels: channel to its origin; empty where the file uses the names of the case.
        dimensions: channel to the dimension of its readings, a key of
            `geoident.units.DIMENSIONS`; lengths where it is not said.
        encoding: codec of a text; empty for UTF-8.
        header_row: line or row of the (first) header; 0 for the first that holds something.
        header_rows: rows over which the names of the columns are spread.
        data_row: first line or row of readings; 0 for that after the header.
        blank: texts of cells that stand for a missing reading.
        ignore: names of columns that are not read, in small letters.
        sheet: name of the sheet of a workbook; empty for its only one.
        cells: range of the sheet, such as ``B4:H60``; empty for all.
        survey: how coordinates become readings; None where the file has readings.
        load: key of the load in the case that the file describes, such as ``loads.air``; empty for
            a file of readings.
    """

    delimiter: str = ","
    decimal: Literal[".", ","] = "."
    columns: Mapping[str, str] = field(default_factory=dict)
    unit: str = ""
    date_format: str = ISO
    wide: bool = False
    unit_row: bool = False
    channels: Mapping[str, Origin] = field(default_factory=dict)
    dimensions: Mapping[str, str] = field(default_factory=dict)
    encoding: str = ""
    header_row: int = 0
    header_rows: int = 1
    data_row: int = 0
    blank: tuple[str, ...] = ()
    ignore: tuple[str, ...] = ()
    sheet: str = ""
    cells: str = ""
    survey: SurveyGrid | None = None
    load: str = ""

    def declaring(self, key: str) -> str:
        """What a user writes in the case to declare one more key of the file.

        >>> Layout().declaring("decimal: ','"), Layout(load="loads.air").declaring("decimal: ','")
        ("readings: {file: ..., decimal: ','}", "loads: {air: {file: ..., decimal: ','}}")
        """
        declared = f"{{file: ..., {key}}}"
        section, _, name = self.load.partition(".")
        return f"{section}: {{{name}: {declared}}}" if self.load else f"readings: {declared}"

    @property
    def what(self) -> str:
        """What the file is, in messages."""
        return "file of a load" if self.load else "readings file"

    @property
    def encoding_hint(self) -> str:
        """The remedy for a text in another encoding."""
        declared = self.declaring("encoding: windows-1252")
        return f"Declare its encoding: {declared}, or save it as UTF-8."

    def header(self, key: str) -> str:
        """Name of a column in the header, in small letters."""
        return self.columns.get(key, key).strip().lower()

    def keys(self, keys: Collection[str]) -> dict[str, str]:
        """Name in the header, in small letters, to its key; a date may be called ``time``."""
        names = {self.header(key): key for key in keys if key != "time"}
        return names if "time" not in keys else {self.header("time"): "time"} | names

    def dimension(self, channel: str) -> str:
        """Of the readings of a channel."""
        return self.dimensions.get(channel, "length")

    def unit_of(self, origin: Origin) -> str:
        """The declared unit of a channel's values; empty for none, as of what a sensor gives."""
        return origin.unit or ("" if origin.calibration else self.unit)
