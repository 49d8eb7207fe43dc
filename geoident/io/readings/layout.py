"""How a file of readings is laid out: what users declare about it, nothing of it guessed."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Literal

from geoident.errors import Location
from geoident.io.text.dates import ISO
from geoident.model.case import KeyPath

COLUMNS = ("gauge", "stage", "date", "value", "unit", "accuracy", "bad")


@dataclass(frozen=True)
class Origin:
    """Where the readings of one channel come from in a file.

    Args:
        name: in the column of gauges, or of the column itself in the wide layout.
        unit: of its values; empty for what the file says.
        sign: -1 if the file counts the other way round.
        fields: AGS heading to the value that it must have, such as ``MONG_ID``.
    """

    name: str = ""
    unit: str = ""
    sign: int = 1
    fields: Mapping[str, str] = field(default_factory=dict)


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
    """

    delimiter: str = ","
    decimal: Literal[".", ","] = "."
    columns: Mapping[str, str] = field(default_factory=dict)
    unit: str = ""
    date_format: str = ISO
    wide: bool = False
    unit_row: bool = False
    channels: Mapping[str, Origin] = field(default_factory=dict)

    def header(self, key: str) -> str:
        """Name of a column in the header, in small letters."""
        return self.columns.get(key, key).strip().lower()


@dataclass(frozen=True)
class FieldReading:
    """A reading as a file or the case gives it, before it is given to a stage.

    Args:
        channel: name of the channel.
        stage: name of the stage, or None where a date is given.
        time: seconds since 1970, or None where a stage is given.
        value: m, None where the sheet is blank.
        accuracy: m, or None.
        bad: why it is not to be used; empty for a good one.
        location: of the channel's name, or of the value in the wide layout.
        when: where the stage or date is written.
        path: path of keys in the case, empty for a row of a file.
        count: how many readings it is the mean of.
    """

    channel: str
    stage: str | None
    time: float | None
    value: float | None
    accuracy: float | None
    bad: str
    location: Location
    when: Location
    path: KeyPath = ()
    count: int = 1
