"""A load that is given day by day in a file: a water level, an air temperature."""

from __future__ import annotations

import itertools
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Annotated, Literal

import numpy as np
from pydantic import Field

from geoident.errors import Fault, InputError
from geoident.io.case.site_files.file import DELIMITERS
from geoident.io.case.site_files.values import Cells, DateFormat, TextEncoding
from geoident.io.readings.file import read_readings
from geoident.io.readings.layout import Layout, Origin
from geoident.io.schema.section import Section, optional
from geoident.io.schema.values import CaseNumber, QuantityType, Text
from geoident.io.text.dates import ISO, date_text
from geoident.io.text.faults import Faults
from geoident.model.case import KeyPath
from geoident.model.gauges import Reading
from geoident.model.in_service import DAY, Series
from geoident.units import size_in, units_of

DIMENSION_OF = {"level": "length", "air": "temperature", "water_temperature": "temperature"}
"""Name of a load that changes in time to the dimension of its values."""

_FEWEST = 2
"""Values of a series."""

_REGULAR = 1.5
"""Times the usual distance of two values up to which there is no gap between them."""


class DatedTableSection(Section):
    """A file with a date and a value in each row, and how it is written."""

    file: Text = Field(
        description="Path of a CSV file or an Excel workbook (.xlsx).", examples=["level.csv"]
    )
    unit: Text | None = optional(
        "Of the values, where the header does not say it.", examples=["m", "degC"]
    )
    date: Text = Field("date", description="Name of the column of dates.")
    date_format: DateFormat = Field(
        ISO, description="How its dates are written.", examples=["DD.MM.YYYY", "MM/DD/YYYY hh:mm"]
    )
    blank: list[Text] = Field(
        [], description="Texts of cells that stand for no value.", examples=[["n/a", "---"]]
    )
    delimiter: Literal[",", ";", "tab", "|"] = Field(",", description="Between columns.")
    decimal: Literal[".", ","] = Field(".", description="Decimal point or comma.")
    encoding: TextEncoding | None = optional("Of a text; UTF-8 if missing.")
    sheet: Text = Field("", description="Excel: name of the sheet, where there are several.")
    range: Cells | None = optional("Excel: cells of the table with its header.")

    def layout_of(self, column: str, dimension: str, load: str) -> Layout:
        """For the readers of files.

        Args:
            column: name of the column of values.
            dimension: of its values.
            load: key of the load in the case.
        """
        name = load.rpartition(".")[2]
        return self.to_model(
            Layout,
            delimiter=DELIMITERS[self.delimiter],
            wide=True,
            columns={"date": self.date},
            channels={name: Origin(column, self.unit or "")},
            dimensions={name: dimension},
            cells=self.range or "",
            unit="",
            load=load,
        )


class SeriesSection(DatedTableSection):
    """A load that changes in time: a file with a date and a value in each row."""

    column: Text | None = optional("Name of the column of values; that of the load if missing.")
    bridge: Annotated[CaseNumber, QuantityType("time", above=0.0)] | None = optional(
        "Longest gap over which values are taken as linear in between. Without it "
        "nothing is known inside of gaps, and readings there are not used.",
        examples=["10 d"],
    )

    def layout(self, name: str, dimension: str) -> Layout:
        """For the readers of files.

        Args:
            name: of the load.
            dimension: of its values.
        """
        return self.layout_of(self.column or name, dimension, f"loads.{name}")


def rows_of_shared_files(
    loads: Mapping[str, tuple[str, SeriesSection]],
) -> dict[str, Sequence[Reading]]:
    """What a file holds of each of its loads, where it has several: it is gone through once.

    A file with faults is left out: read for each load it says what is wrong with that.

    Args:
        loads: name to path and how the file is written.
    """
    files: list[tuple[str, Layout, dict[str, Layout]]] = []
    for name, (path, section) in loads.items():
        layout = section.layout(name, DIMENSION_OF[name])
        bare = replace(layout, channels={}, dimensions={}, load="")
        known = (of for file, other, of in files if (file, other) == (path, bare))
        if (of := next(known, None)) is None:
            files.append((path, bare, of := {}))
        of[name] = layout
    rows: dict[str, Sequence[Reading]] = {}
    for path, _, of in files:
        if len(of) > 1:
            channels = {name: layout.channels[name] for name, layout in of.items()}
            dimensions = {name: DIMENSION_OF[name] for name in of}
            any_of_them = next(iter(of.values()))
            try:
                read = read_readings(
                    path, replace(any_of_them, channels=channels, dimensions=dimensions)
                )
            except InputError:
                continue
            rows |= {name: [row for row in read if row.channel == name] for name in of}
    return rows


def read_series(
    name: str,
    section: SeriesSection,
    path: str,
    at: KeyPath,
    faults: Faults,
    read: Sequence[Reading] | None = None,
) -> Series | None:
    """The values of a load over time; None, with faults, where the file is of no use.

    Args:
        name: of the load.
        section: how its file is written.
        path: of the file.
        at: where the case says it.
        faults: takes what is wrong.
        read: its rows, where they are known.
    """
    dimension = DIMENSION_OF[name]
    if section.unit is not None and size_in(section.unit, dimension) is None:
        hint = f"Its units: {', '.join(units_of(dimension))}."
        faults.add((*at, "unit"), "unit", f"'{section.unit}' is not a unit of the {name}", hint)
        return None
    try:
        read = read_readings(path, section.layout(name, dimension)) if read is None else read
    except InputError as error:
        faults.extend(error.faults)
        return None
    rows = sorted((row for row in read if row.value is not None and not row.bad), key=_time)
    if len(rows) < _FEWEST:
        few = "one value" if rows else "no value"
        message = f"the file has {few} of the {name}; expected one for each day or so"
        faults.add((*at, "file"), "too-few", message, "Give all of the time of the readings.")
        return None
    for one, other in itertools.pairwise(rows):
        if _time(one) == _time(other):
            message = f"a second {name} of {date_text(_time(one))}, first at {one.location}"
            fault = Fault("repeated-date", message, "Keep one of them.", other.location)
            faults.extend([fault])
            return None
    times = np.array([_time(row) for row in rows])
    values = np.array([row.value for row in rows], dtype=np.float64)
    given = section.bridge
    bridge = given.factor if given else _REGULAR * float(np.median(np.diff(times)))
    return Series(name, path, times, values, bridge)


def gap_notes(series: Mapping[str, Series]) -> list[str]:
    """What is not known of the loads that change in time."""
    notes = []
    for name, one in series.items():
        if not one.gaps:
            continue
        start, end = max(one.gaps, key=lambda gap: gap[1] - gap[0])
        days = (end - start) / DAY
        many = "a gap" if len(one.gaps) == 1 else f"{len(one.gaps)} gaps, the longest"
        notes.append(
            f"the {name} of '{Path(one.path).name}' has {many} of {days:.0f} days after "
            f"{date_text(start)}: readings inside are not used ('bridge: {days:.0f} d' takes it as "
            "linear there)"
        )
    return notes


def _time(row: Reading) -> float:
    return row.time or 0.0
