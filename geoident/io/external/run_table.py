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
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from geoident.errors import Fault, Location
from geoident.io.external.runs import MOST_RUNS, FoundRuns, RunColumn, RunRow, runs_of
from geoident.io.text.cells import Cell, Row, name_and_unit, read_text_table
from geoident.io.text.wording import did_you_mean, listing, shorten
from geoident.model.arrays import Floats
from geoident.model.gauges import Channel
from geoident.model.parameter import Parameter
from geoident.units import DIMENSIONLESS, UnitError, unit_list, unit_size, with_article

MAX_BYTES = 50_000_000
NAME_COLUMN = "run"
"""The column that names runs; it is passed over."""

_MOST_FAULTS = 100
_FAILED = {
    "", "nan", "inf", "infinity", "-", "--", "failed", "fail", "error", "none", "null", "na", "n/a",
    "nil", "#n/a", "#value!", "#div/0!",
}  # fmt: skip
_NUMBER = re.compile(r"[+-]?(\d+\.?\d*|\.\d+)([eEdD][+-]?\d+)?")
_NO_VALUES: Floats = np.zeros(0)


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
        InputError: it cannot be read, is no text, or is empty.
    """
    hint = "The first line names the columns: parameters and readings with their units."
    table = read_text_table(path, limit=MAX_BYTES, what="table of runs", hint=hint)
    rows, comma = table.rows, table.delimiter != ","
    reader = _TableReader(path, parameters, channels, stages, table.faults, comma=comma)
    if len(rows) > MOST_RUNS:
        message = f"found {len(rows)} runs; {MOST_RUNS} at most"
        hint = "More runs hardly help a response surface: take every second."
        reader.refuse(rows[MOST_RUNS][0], 1, "too-large", message, hint)
    columns = reader.columns(table.header, rows, ignore)
    runs = []
    for n, (line, cells) in enumerate(rows):
        failed = next((at for at, one in columns.items() if math.isnan(one.values[n])), None)
        failure = ""
        if failed is not None:
            text = f"'{cells[failed].text}'" if cells[failed].text else "empty"
            failure = f"{columns[failed].label} is {text}"
        place = Location(path, line, 1)
        runs.append(RunRow(f"line {line}", f"the run in line {line}", place, failure))
    held, shape = list(columns.values()), (len(stages), len(channels))
    table_runs = runs_of(held, runs, parameters, shape, Path(path).name, reader.faults)
    known = not any(fault.code == "unknown-column" for fault in reader.faults)
    named = {c.parameter or channels[c.at[1]].name for c in held} | reader.misplaced
    return FoundRuns(table_runs, frozenset(named) if known else None, tuple(reader.faults))


class _TableReader:
    """What the columns and cells of a table mean in a case; what is wrong is noted.

    Args:
        file: path of the table.
        parameters: by name.
        channels: of the case.
        stages: names in their order.
        faults: is told what is wrong.
        comma: numbers may have a decimal comma.

    Attributes:
        misplaced: gauges that have a column of no stage.
    """

    def __init__(
        self,
        file: str,
        parameters: Mapping[str, Parameter],
        channels: Sequence[Channel],
        stages: Sequence[str],
        faults: list[Fault],
        *,
        comma: bool,
    ) -> None:
        self.file, self.faults, self.comma = file, faults, comma
        self.parameters, self.channels, self.stages = parameters, channels, stages
        self.numbers = {channel.name: n for n, channel in enumerate(channels)}
        self.misplaced = set[str]()

    def refuse(self, line: int, at: Cell | int, code: str, message: str, hint: str = "") -> None:
        """Note a fault in a line, at a cell or column."""
        place = Location(self.file, line, at if isinstance(at, int) else at.column)
        self.faults.append(Fault(code, message, hint, place))

    def columns(
        self, header: Row, rows: Sequence[Row], ignore: Sequence[str]
    ) -> dict[int, RunColumn]:
        """Positions of the columns that hold something, and what."""
        line, cells = header
        heads = {name_and_unit(cell.text)[0] for cell in cells}
        for name in sorted(set(ignore) - heads - {cell.text for cell in cells}):
            message = f"there is no column '{name}' that 'ignore' of the case names"
            hint = did_you_mean(name, [cell.text for cell in cells], what="Columns")
            self.refuse(line, 1, "unknown-column", message, hint)
        named = {name.rpartition("@")[0].strip() or name for name in heads}
        absent = [one for one in (*self.parameters, *self.numbers) if one not in named]
        first: dict[object, Cell] = {}
        columns: dict[int, RunColumn] = {}
        for at, cell in enumerate(cells):
            name, _ = name_and_unit(cell.text)
            if not cell.text or name == NAME_COLUMN or {name, cell.text} & set(ignore):
                continue
            if len(self.faults) > _MOST_FAULTS:
                break
            column = self._column(line, cell, absent)
            if column is None:
                continue
            what = column.parameter or column.at
            if what in first:
                message = f"two columns hold '{name}', the first is column {first[what].column}"
                hint = "Remove one, or name it under 'ignore' of the case."
                self.refuse(line, cell, "duplicate-column", message, hint)
            first.setdefault(what, cell)
            size = self._size(line, cell, column)
            values = [self._number(n, row[at], column) * size for n, row in rows]
            columns[at] = replace(column, values=np.array(values))
        return columns

    def _column(self, line: int, cell: Cell, absent: Sequence[str]) -> RunColumn | None:
        """What a column holds; None, with a fault, where it is neither parameter nor reading.

        Args:
            line: of the header.
            cell: of the header.
            absent: what has no column of its own, and may be misspelt here.
        """
        name, place = name_and_unit(cell.text)[0], Location(self.file, line, cell.column)
        if name in self.parameters:
            return RunColumn(cell.text, place, _NO_VALUES, name)
        gauge, stage = self._gauge_and_stage(name)
        if gauge not in self.numbers:
            message = f"the column '{shorten(name)}' is neither a parameter nor a gauge"
            known = absent or [*self.parameters, *self.numbers]
            hint = did_you_mean(gauge, known, what="Without a column" if absent else "Known")
            hint += " A column that is not wanted is named under 'ignore' of the case."
            self.refuse(line, cell, "unknown-column", message, hint)
            return None
        if not stage and len(self.stages) == 1:
            stage = self.stages[0]
        if stage in self.stages:
            channel, j = self.channels[self.numbers[gauge]], self.stages.index(stage)
            zero = channel.is_zeroed and channel.zero == stage
            return RunColumn(cell.text, place, _NO_VALUES, "", (j, self.numbers[gauge]), zero)
        self.misplaced.add(gauge)
        if stage:
            hint = did_you_mean(stage, self.stages, what="Stages")
            self.refuse(line, cell, "unknown-stage", f"there is no stage '{stage}'", hint)
        else:
            message = f"the column '{shorten(name)}' does not say of which stage it is"
            hint = f"Write '{gauge} @ {self.stages[-1]}'. Stages: {listing(self.stages)}."
            self.refuse(line, cell, "no-stage", message, hint)
        return None

    def _gauge_and_stage(self, name: str) -> tuple[str, str]:
        """What a column is named after: ``roof @ bench``, or ``roof at bench`` as campaigns say."""
        if name in self.numbers:
            return name, ""
        for mark in ("@", " at "):
            gauge, at, stage = (part.strip() for part in name.rpartition(mark))
            if at.strip() and (mark == "@" or gauge in self.numbers):
                return gauge, stage
        return name, ""

    def _size(self, line: int, cell: Cell, column: RunColumn) -> float:
        """Size of the unit of a column; 1, with a fault, where it is none."""
        unit = name_and_unit(cell.text)[1]
        of = self.parameters.get(column.parameter) or self.channels[column.at[1]]
        try:
            if unit is not None:
                return unit_size(unit, of.dimension, of.name)
        except UnitError as error:
            self.refuse(line, cell, "unit", error.message, error.hint)
            return 1.0
        if of.dimension != DIMENSIONLESS:
            message = f"the column '{of.name}' has no unit, and is {with_article(of.dimension)}"
            hint = f"Write '{of.name} [UNIT]'. Its units: {unit_list(of.dimension)}."
            self.refuse(line, cell, "unit", message, hint)
        return 1.0

    def _number(self, line: int, cell: Cell, column: RunColumn) -> float:
        """What a cell says; NaN for a run that failed and, with a fault, for what is no number."""
        text = cell.text
        if self.comma and text.count(",") == 1 and "." not in text:
            text = text.replace(",", ".")
        if _NUMBER.fullmatch(text):
            value = float(re.sub("[dD]", "e", text))
            if math.isfinite(value):
                return value
        if len(self.faults) > _MOST_FAULTS:
            return math.nan
        if column.parameter:
            message = f"'{shorten(cell.text)}' of '{column.parameter}' is not a number"
            self.refuse(line, cell, "bad-number", message, "Write what the run was made with.")
        elif text.lower().lstrip("+-") not in _FAILED:
            message = f"'{shorten(cell.text)}' is not a number"
            hint = "Write nan, or leave it empty, where a run has failed."
            self.refuse(line, cell, "bad-number", message, hint)
        return math.nan
