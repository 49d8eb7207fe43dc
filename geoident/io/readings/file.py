"""Readings from CSV: ``gauge,stage,value,unit[,accuracy][,bad]``, one reading a row.

``date`` may stand in place of ``stage``, and columns may have other names if the case declares
them. Lines that begin with ``#`` and blank lines are passed over. A blank value is a reading that
was not taken: it is kept, and counted later. The wide layout, one column a gauge, is in
`geoident.io.readings.wide`.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path

from geoident.errors import InputError, Location
from geoident.io.readings.ags import read_ags
from geoident.io.readings.table import COLUMNS, Cell, Layout, Origin, Table, flag, lines
from geoident.io.readings.wide import WideReader
from geoident.io.text.faults import shortened
from geoident.io.text.text_file import decode, read_bytes
from geoident.io.text.wording import did_you_mean, listing, shorten
from geoident.model.gauges import Reading

REQUIRED = ("gauge", "stage", "value", "unit")
MAX_ROWS = 1_000_000
MAX_BYTES = 200_000_000
_MOST_FAULTS = 1000
_DELIMITERS = {",": "commas", ";": "semicolons", "\t": "tabs", "|": "bars"}


@dataclass(frozen=True)
class Format:
    """A format of files of readings.

    Args:
        read: the readings of a file that is laid out as declared.
        many: what a file of it is called in a message, if it has readings of many instruments, so
            that it must be declared which are whose.
    """

    read: Callable[[str, Layout], tuple[Reading, ...]]
    many: str = ""


def format_of(path: str) -> Format:
    """The format of a file, by its suffix; CSV if it is none of `FORMATS`."""
    return FORMATS.get(Path(path).suffix.lower(), CSV)


def read_readings(path: str, layout: Layout | None = None) -> tuple[Reading, ...]:
    """Read a CSV file of readings.

    Raises:
        InputError: with all that is wrong in the file.
    """
    return parse_readings(read_bytes(path, limit=MAX_BYTES, what="readings file"), path, layout)


def parse_readings(content: bytes, file: str, layout: Layout | None = None) -> tuple[Reading, ...]:
    """Readings from the bytes of a CSV file; see `read_readings`.

    Args:
        content: of the file.
        file: its path, for messages.
        layout: how it is written; None for the default.

    Raises:
        InputError: with all faults; it stops at a thousand of them.
    """
    table = Table(file, layout or Layout())
    if content.count(b"\n") > MAX_ROWS:
        table.refuse((0, 0), "too-large", f"the file has more than {MAX_ROWS:,} rows")
        raise InputError(table.faults)
    rest = lines(decode(content, file), table.layout.delimiter)
    header = next(rest, None)
    if header is None:
        hint = f"The first line names the columns: {','.join(REQUIRED)}."
        table.refuse((0, 0), "empty", "the file is empty", hint)
        raise InputError(table.faults)
    reader = WideReader(table) if table.layout.wide else _LongReader(table)
    if not _separated_otherwise(table, *header):
        reader.header(*header)
    rows: list[Reading] = []
    for line in rest if not table.faults else ():
        rows += reader.row(*line)
        if len(table.faults) > _MOST_FAULTS:
            break
    if table.faults:
        raise InputError(shortened(table.faults))
    return tuple(rows)


def _separated_otherwise(table: Table, number: int, line: str) -> bool:
    """Note a header that is separated by something else than declared."""
    wanted = table.layout.delimiter
    others = [d for d in _DELIMITERS if d != wanted and d in line]
    if wanted in line or not others:
        return False
    if wanted == ",":
        message = "the columns are separated by semicolons or tabs; commas are expected"
        hint = "Export as comma-separated values, with decimal points, or declare them in the case:"
        hint += " readings: {file: ..., delimiter: ';', decimal: ','}."
    else:
        message = f"there are no {_DELIMITERS[wanted]} in the header; they are declared"
        hint = f"It has {listing(_DELIMITERS[d] for d in others)}: correct 'delimiter' in the case."
    table.refuse((number, 1), "bad-header", message, hint)
    return True


CSV = Format(read_readings)
FORMATS = {".ags": Format(read_ags, many="an AGS file")}
"""Suffix to format. What reads a new one stands in its own module, and here in a line."""


class _LongReader:
    """One reading a row."""

    def __init__(self, table: Table) -> None:
        self.table = table
        layout = table.layout
        self.names = {layout.header(key): key for key in COLUMNS}
        self.channels = {
            origin.name or channel: (channel, origin) for channel, origin in layout.channels.items()
        }
        self.required: tuple[str, ...] = REQUIRED
        self.keys: tuple[str, ...] = ()

    def header(self, number: int, line: str) -> None:
        """Note the columns, and what is wrong with them."""
        cells = self.table.split(number, line)
        found = tuple(cell.text.lower() for cell in cells)
        for n, cell in enumerate(cells):
            self._check_column(number, cell, found[:n])
        self.keys = tuple(self.names.get(name, "") for name in found)
        dated = "date" in self.keys and "stage" not in self.keys
        self.required = tuple("date" if dated and k == "stage" else k for k in REQUIRED)
        if self.table.layout.unit:
            self.required = tuple(key for key in self.required if key != "unit")
        self._require_columns(number)

    def _check_column(self, number: int, cell: Cell, before: tuple[str, ...]) -> None:
        name = cell.text.lower()
        if name not in self.names:
            if self.table.layout.columns:
                return  # whoever names the columns may leave others aside
            hint = did_you_mean(name, COLUMNS, what="Columns")
            message = f"there is no column '{shorten(cell.text)}'"
            self.table.refuse((number, cell.column), "bad-header", message, hint)
        elif name in before:
            message = f"the column '{name}' is there twice"
            self.table.refuse((number, cell.column), "bad-header", message)

    def _require_columns(self, number: int) -> None:
        missing = [self.table.layout.header(k) for k in self.required if k not in self.keys]
        if missing:
            hint = f"The first line names the columns: {','.join(REQUIRED)}[,accuracy]."
            message = f"columns missing in the header: {listing(missing)}"
            self.table.refuse((number, 1), "bad-header", message, hint)

    def row(self, number: int, line: str) -> list[Reading]:
        """The reading of a row, if it is right."""
        table, cells = self.table, self.table.split(number, line)
        if not cells or not self._has_width(number, cells):
            return []
        cells += [Cell("", len(line) + 1)] * (len(self.keys) - len(cells))
        row = {key: cell for key, cell in zip(self.keys, cells, strict=False) if key}
        before = len(table.faults)
        self._check_names(number, row)
        channel, sign, unit = self._channel(row["gauge"].text)
        time = table.date(number, row["date"]) if "date" in self.required else None
        factor = self._factor(number, row, unit, table.layout.dimension(channel))
        value = table.number(number, row["value"])
        accuracy = table.accuracy(number, row.get("accuracy"))
        if len(table.faults) > before or factor is None or not channel:
            return []
        when = row["date" if "date" in self.required else "stage"]
        return [
            Reading(
                channel=channel,
                stage="" if "date" in self.required else row["stage"].text,
                value=None if value is None else sign * value * factor,
                accuracy=None if accuracy is None else accuracy * factor,
                bad=flag(row["bad"].text) if "bad" in row else "",
                location=table.place(number, row["gauge"]),
                time=time,
                when=Location(table.file, number, when.column),
            )
        ]

    def _channel(self, name: str) -> tuple[str, int, str]:
        """Channel, sign and unit of a name in the file; no channel where none is asked for."""
        if not self.channels:
            return name, 1, ""
        channel, origin = self.channels.get(name, ("", Origin()))
        return channel, origin.sign, origin.unit

    def _check_names(self, number: int, row: Mapping[str, Cell]) -> None:
        for name in ("gauge", *(key for key in ("stage", "date") if key in self.required)):
            if not row[name].text:
                message = f"the name of the {name} is missing"
                message = "the date is missing" if name == "date" else message
                self.table.refuse((number, row[name].column), "missing-name", message)

    def _has_width(self, number: int, cells: list[Cell]) -> bool:
        table, width = self.table, len(self.keys)
        needed = max(n for n, name in enumerate(self.keys) if name in self.required) + 1
        if len(cells) > width and any(cell.text for cell in cells[width:]):
            message = f"the row has {len(cells)} columns, the header {width}"
            hint = "If a number has a decimal comma, write a point; quote texts that hold commas."
            table.refuse((number, cells[width].column), "too-many-columns", message, hint)
            return False
        if len(cells) < needed:
            expected = ",".join(self.keys)
            message = f"the row has {len(cells)} columns; {expected} expected"
            end = cells[-1].column + len(cells[-1].text)
            hint = "Leave a missing value blank: ,,"
            table.refuse((number, end), "too-few-columns", message, hint)
            return False
        return True

    def _factor(
        self, number: int, row: Mapping[str, Cell], unit: str, dimension: str
    ) -> float | None:
        """Size of the unit in that of SI; 1 where there is none and none is needed."""
        cell = row.get("unit", Cell("", 1))
        if not cell.text and (unit or self.table.layout.unit):
            cell = Cell(unit or self.table.layout.unit, cell.column)
        accuracy = row.get("accuracy")
        blank = not row["value"].text and (accuracy is None or not accuracy.text)
        if not cell.text and blank:
            return 1.0
        return self.table.unit(number, cell, dimension)
