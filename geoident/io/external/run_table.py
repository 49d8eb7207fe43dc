"""A table of runs that were made elsewhere: a line for each, with its parameters and readings.

    run, E_rock [GPa], K0, roof @ heading [mm], roof @ bench [mm]
    1,   12.5,         0.8, 4.31,               9.90

Columns are named like what they hold, with the unit in brackets; of a case with several stages a
reading names its stage after ``@`` (or after ``at``, as in the table of a campaign). A run that
failed, whose readings are no finite numbers, is left out and named.
"""

from __future__ import annotations

import math
import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

import numpy as np

from geoident.errors import Fault, Location
from geoident.io.external.run_checks import (
    SHOWN,
    FoundRuns,
    HeldColumn,
    ReadRuns,
    checked_runs,
    left_out_note,
    runs_held,
    too_few,
)
from geoident.io.text.cells import Cell, cells_of, delimiter_of, written_lines
from geoident.io.text.text_file import decode, read_bytes
from geoident.io.text.wording import did_you_mean, listing, shorten
from geoident.model.gauges import Channel
from geoident.model.parameter import Parameter
from geoident.units import (
    DIMENSIONLESS,
    UnitError,
    normal_unit,
    size_in,
    unit_list,
    with_article,
)

MOST_RUNS = 2000
MAX_BYTES = 50_000_000
NAME_COLUMN = "run"
"""The column that names runs; it is passed over."""

_MOST_FAULTS = 100
_FAILED = {
    "", "nan", "inf", "infinity", "-", "--", "failed", "fail", "error", "none", "null", "na", "n/a",
    "nil", "#n/a", "#value!", "#div/0!",
}  # fmt: skip
_NUMBER = re.compile(r"[+-]?(\d+\.?\d*|\.\d+)([eEdD][+-]?\d+)?")
_UNIT = re.compile(r"(.*?)\s*(?:\[([^\[\]]*)\]|\(([^()]*)\))?")


@dataclass(frozen=True)
class _Column:
    """A column: its cell in the header, the size of its unit in SI, and what it holds."""

    cell: Cell
    size: float
    holds: HeldColumn


def read_run_table(
    path: str,
    parameters: Mapping[str, Parameter],
    channels: Sequence[Channel],
    stages: Sequence[str],
    ignore: Sequence[str],
) -> FoundRuns:
    """The runs of a table, and what is wrong with it.

    Args:
        path: of the file.
        parameters: by name, those that the model is given.
        channels: of the case.
        stages: names in their order.
        ignore: names of columns that are passed over.

    Raises:
        InputError: it cannot be read, or is no text.
    """
    text = decode(read_bytes(path, limit=MAX_BYTES, what="table of runs"), path)
    reader = _Reader(path, text, parameters, channels, stages)
    found = reader.read(ignore)
    known = not any(fault.code in ("unknown-column", "empty") for fault in reader.faults)
    return FoundRuns(found, frozenset(reader.named) if known else None, tuple(reader.faults))


class _Reader:
    def __init__(
        self,
        path: str,
        text: str,
        parameters: Mapping[str, Parameter],
        channels: Sequence[Channel],
        stages: Sequence[str],
    ) -> None:
        self.file, self.faults = path, list[Fault]()
        self.rows = list(written_lines(text))
        self.delimiter = delimiter_of(self.rows[0][1]) if self.rows else ","
        self.parameters, self.channels, self.stages = parameters, channels, stages
        self.name = Path(path).name
        self.named = set[str]()

    def read(self, ignore: Sequence[str]) -> ReadRuns | None:
        """What the table holds; None where something is wrong with it."""
        if not self.rows:
            hint = "The first line names the columns: parameters and readings with their units."
            self.faults.append(Fault("empty", "the table is empty", hint, Location(self.file)))
            return None
        number, header = self.rows[0]
        cells = cells_of(header, self.delimiter)
        columns = self._columns(number, cells, ignore)
        if len(self.rows) - 1 > MOST_RUNS:
            message = f"found {len(self.rows) - 1} runs; {MOST_RUNS} at most"
            hint = "More runs hardly help a response surface: take every second."
            self._refuse((self.rows[MOST_RUNS + 1][0], 1), "too-large", message, hint)
        runs = list(self._runs(len(cells), columns))
        return None if self.faults else self._checked(number, list(columns.values()), runs)

    def _refuse(self, place: tuple[int, int], code: str, message: str, hint: str = "") -> None:
        """Note a fault at a line and column."""
        self.faults.append(Fault(code, message, hint, Location(self.file, *place)))

    def _columns(
        self, number: int, cells: Sequence[Cell], ignore: Sequence[str]
    ) -> dict[int, _Column]:
        """Positions of the columns that hold something, and what."""
        known: dict[str, Cell] = {}
        found: dict[int, _Column] = {}
        for at, cell in enumerate(cells):
            match = _UNIT.fullmatch(cell.text)
            assert match is not None  # any text does
            name, unit = match[1], match[2] or match[3]
            if not cell.text or name == NAME_COLUMN or {name, cell.text} & set(ignore):
                continue
            column = self._column(number, cell, name, unit)
            if len(self.faults) > _MOST_FAULTS:
                return found
            if column is None:
                continue
            key = column.holds.parameter or repr(column.holds.place)
            if key in known:
                message = f"two columns hold '{name}', the first is column {known[key].column}"
                hint = "Remove one, or name it under 'ignore' of the case."
                self._refuse((number, cell.column), "duplicate-column", message, hint)
            known.setdefault(key, cell)
            found[at] = column
        absent = sorted(set(ignore) - {cell.text for cell in cells} - {
            match[1] for cell in cells if (match := _UNIT.fullmatch(cell.text))
        })  # fmt: skip
        for name in absent:
            hint = did_you_mean(name, [cell.text for cell in cells], what="Columns")
            message = f"there is no column '{name}' that 'ignore' of the case names"
            self._refuse((number, 1), "unknown-column", message, hint)
        return found

    def _column(self, number: int, cell: Cell, name: str, unit: str | None) -> _Column | None:
        place = (number, cell.column)
        if name in self.parameters:
            self.named.add(name)
            parameter = self.parameters[name]
            size = self._size(place, name, unit, parameter.dimension)
            return _Column(cell, size, HeldColumn(cell.text, name))
        gauge, stage = self._gauge_and_stage(name)
        if gauge not in self._rows:
            message = f"the column '{shorten(name)}' is neither a parameter nor a gauge"
            self._refuse(place, "unknown-column", message, self._meant(name, gauge))
            return None
        self.named.add(gauge)
        if not stage and len(self.stages) > 1:
            message = f"the column '{shorten(name)}' does not say of which stage it is"
            hint = f"Write '{gauge} @ {self.stages[-1]}'. Stages: {listing(self.stages)}."
            self._refuse(place, "no-stage", message, hint)
            return None
        stage = stage or self.stages[0]
        if stage not in self.stages:
            hint = did_you_mean(stage, self.stages, what="Stages")
            self._refuse(place, "unknown-stage", f"there is no stage '{stage}'", hint)
            return None
        channel = self.channels[self._rows[gauge]]
        size = self._size(place, gauge, unit, channel.dimension)
        zero = channel.is_zeroed and channel.zero == stage
        at = self.stages.index(stage), self._rows[gauge]
        return _Column(cell, size, HeldColumn(cell.text, place=at, zero=zero))

    def _gauge_and_stage(self, name: str) -> tuple[str, str]:
        """What a column is named after: ``roof @ bench``, or ``roof at bench`` as campaigns say."""
        if name in self._rows:
            return name, ""
        for mark in ("@", " at "):
            gauge, at, stage = (part.strip() for part in name.rpartition(mark))
            if at.strip() and (mark == "@" or gauge in self._rows):
                return gauge, stage
        return name, ""

    def _meant(self, name: str, gauge: str) -> str:
        """What a column may stand for: a misspelt name has no column of its own."""
        known = [*self.parameters, *self._rows]
        absent = [one for one in known if one not in self._heads]
        what = "Without a column" if absent else "Known"
        hint = did_you_mean(gauge, absent or known, what=what)
        return f"{hint} A column that is not wanted is named under 'ignore' of the case."

    @cached_property
    def _heads(self) -> frozenset[str]:
        """The parameters and gauges that the columns are named after, known or not."""
        cells = cells_of(self.rows[0][1], self.delimiter)
        names = [match[1] for cell in cells if (match := _UNIT.fullmatch(cell.text))]
        return frozenset(name.rpartition("@")[0].strip() or name for name in names)

    @cached_property
    def _rows(self) -> dict[str, int]:
        return {channel.name: n for n, channel in enumerate(self.channels)}

    def _size(self, place: tuple[int, int], name: str, unit: str | None, dimension: str) -> float:
        """Size of the unit of a column; 1, with a fault, where it is none."""
        if unit is None:
            if dimension != DIMENSIONLESS:
                message = f"the column '{name}' says no unit, and is {with_article(dimension)}"
                hint = f"Write '{name} [UNIT]'. Its units: {unit_list(dimension)}."
                self._refuse(place, "unit", message, hint)
            return 1.0
        try:
            size = size_in(normal_unit(unit, dimension), dimension)
        except UnitError as error:
            self._refuse(place, "unit", error.message, error.hint)
            return 1.0
        if size is None:
            message = f"'{unit}' is no unit of {with_article(dimension)}, as '{name}' is"
            self._refuse(place, "unit", message, f"Its units: {unit_list(dimension)}.")
        return size or 1.0

    def _runs(
        self, width: int, columns: Mapping[int, _Column]
    ) -> Iterator[tuple[int, list[Cell], list[float]]]:
        """Line, cells and numbers of each run, in the order of the columns."""
        for number, line in self.rows[1:]:
            cells = cells_of(line, self.delimiter)
            if len(cells) != width:
                message = f"found {len(cells)} cells; {width} are expected, as in the header"
                hint = "A decimal comma needs ';' between columns." if self.delimiter == "," else ""
                self._refuse((number, 1), "bad-row", message, hint)
            else:
                mine = [cells[at] for at in columns]
                numbers = [
                    self._number(number, cell, column)
                    for cell, column in zip(mine, columns.values(), strict=True)
                ]
                yield number, mine, numbers
            if len(self.faults) > _MOST_FAULTS:
                return

    def _number(self, number: int, cell: Cell, column: _Column) -> float:
        """What a cell says, SI; NaN for a run that failed, and with a fault for what is none."""
        text = cell.text.strip()
        if self.delimiter != "," and text.count(",") == 1 and "." not in text:
            text = text.replace(",", ".")
        if _NUMBER.fullmatch(text):
            value = float(re.sub("[dD]", "e", text)) * column.size
            if math.isfinite(value):
                return value
        place = (number, cell.column)
        if column.holds.parameter:
            message = f"'{shorten(cell.text)}' of '{column.holds.parameter}' is not a number"
            self._refuse(place, "bad-number", message, "Write what the run was made with.")
        elif text.lower().lstrip("+-") not in _FAILED:
            message = f"'{shorten(cell.text)}' is not a number"
            hint = "Write nan, or leave it empty, where a run has failed."
            self._refuse(place, "bad-number", message, hint)
        return math.nan

    def _checked(
        self,
        header: int,
        columns: list[_Column],
        runs: list[tuple[int, list[Cell], list[float]]],
    ) -> ReadRuns | None:
        """The runs that are there, unless no surface could be laid through them."""
        failed = [run for run in runs if np.isnan(run[2]).any()]
        sound = [run for run in runs if not np.isnan(run[2]).any()]
        holds = [column.holds for column in columns]
        names = tuple(one.parameter for one in holds if one.parameter)
        wrong = too_few(len(names), len(sound), len(failed))
        if wrong is not None:
            self._refuse((self.rows[-1][0], 1), "too-few", *wrong)
            return None
        table = np.array([numbers for _, _, numbers in sound])

        def refuse(at: int, code: str, message: str, hint: str) -> None:
            place = (sound[at][0], 1) if at >= 0 else (header, columns[-1 - at].cell.column)
            self._refuse(place, code, message, hint)

        lines = [f"the run in line {number}" for number, _, _ in sound]
        checked_runs(holds, table, lines, self.parameters, refuse)
        if self.faults or not names:
            return None
        shape = len(self.stages), len(self.channels)
        return runs_held(holds, table, shape, self._left_out(columns, failed, len(runs)))

    def _left_out(
        self,
        columns: Sequence[_Column],
        failed: Sequence[tuple[int, list[Cell], list[float]]],
        total: int,
    ) -> tuple[str, ...]:
        """Which runs have failed, in a sentence."""
        said = []
        for number, cells, numbers in failed[:SHOWN]:
            k = int(np.flatnonzero(np.isnan(numbers))[0])
            what = f"'{cells[k].text}'" if cells[k].text else "empty"
            said.append(f"line {number} ({columns[k].cell.text} is {what})")
        return left_out_note(said, len(failed), total, self.name)
