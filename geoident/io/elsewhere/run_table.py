"""A table of runs that were made elsewhere: a line for each, with its parameters and readings.

    run, E_rock [GPa], K0, roof @ heading [mm], roof @ bench [mm]
    1,   12.5,         0.8, 4.31,               9.90

Columns are named like what they hold, with the unit in brackets; of a case with several stages a
reading names its stage after ``@``. A run that failed, whose readings are no finite numbers, is
left out and named.
"""

from __future__ import annotations

import math
import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from geoident.errors import Fault, Location
from geoident.io.text.cells import TextCell, cells_of, delimiter_of, said_lines
from geoident.io.text.text_file import decode, read_bytes
from geoident.io.text.wording import did_you_mean, listing, shorten
from geoident.model.arrays import Floats
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
_SHOWN = 5
_FAILED = {
    "", "nan", "inf", "infinity", "-", "--", "failed", "fail", "error", "none", "null", "na", "n/a",
    "nil", "#n/a", "#value!", "#div/0!",
}  # fmt: skip
_NUMBER = re.compile(r"[+-]?(\d+\.?\d*|\.\d+)([eEdD][+-]?\d+)?")
_UNIT = re.compile(r"(.*?)\s*(?:\[([^\[\]]*)\]|\(([^()]*)\))?")
_SAME = 1e-12
_TOGETHER = 1e-6


@dataclass(frozen=True)
class ReadRuns:
    """What a table holds.

    Args:
        names: of the n parameters of its columns.
        values: (r, n) parameters of the runs, SI.
        readings: (r, n_stages, n_channels) what they gave, SI; NaN where there is no column.
        notes: which runs were left out.
    """

    names: tuple[str, ...]
    values: Floats
    readings: Floats
    notes: tuple[str, ...]


@dataclass(frozen=True)
class _Column:
    """A column: its cell in the header, the size of its unit in SI, and what it holds."""

    cell: TextCell
    size: float
    parameter: str = ""
    place: tuple[int, int] = (-1, -1)  # stage, channel
    zero: bool = False  # of readings that are zero by definition


def read_run_table(
    path: str,
    parameters: Mapping[str, Parameter],
    channels: Sequence[Channel],
    stages: Sequence[str],
    ignore: Sequence[str],
) -> tuple[ReadRuns | None, list[Fault]]:
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
    return found, reader.faults


def least_runs(n: int) -> int:
    """The fewest runs through which a surface of n parameters is laid."""
    return 3 * (n + 1)


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
        self.rows = list(said_lines(text))
        self.delimiter = delimiter_of(self.rows[0][1]) if self.rows else ","
        self.parameters, self.channels, self.stages = parameters, channels, stages
        self.name = Path(path).name

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
        if self.faults:
            return None
        runs = [run for run in self._runs(len(cells), columns) if not self.faults]
        if self.faults:
            return None
        return self._checked(number, list(columns.values()), runs)

    def _refuse(self, place: tuple[int, int], code: str, message: str, hint: str = "") -> None:
        """Note a fault at a line and column."""
        self.faults.append(Fault(code, message, hint, Location(self.file, *place)))

    def _columns(
        self, number: int, cells: Sequence[TextCell], ignore: Sequence[str]
    ) -> dict[int, _Column]:
        """Positions of the columns that hold something, and what."""
        known: dict[str, TextCell] = {}
        found: dict[int, _Column] = {}
        for at, cell in enumerate(cells):
            match = _UNIT.fullmatch(cell.text)
            assert match is not None  # any text does
            name, unit = match[1], match[2] or match[3]
            if not cell.text or name == NAME_COLUMN or {name, cell.text} & set(ignore):
                continue
            column = self._column(number, cell, name, unit)
            if column is None:
                continue
            key = column.parameter or repr(column.place)
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

    def _column(self, number: int, cell: TextCell, name: str, unit: str | None) -> _Column | None:
        place = (number, cell.column)
        if name in self.parameters:
            parameter = self.parameters[name]
            size = self._size(place, name, unit, parameter.dimension)
            return None if size is None else _Column(cell, size, parameter=name)
        gauge, at, stage = (part.strip() for part in name.rpartition("@"))
        if not at or name in self._rows:
            gauge, stage = name, ""
        if gauge not in self._rows:
            message = f"the column '{shorten(name)}' is neither a parameter nor a gauge"
            self._refuse(place, "unknown-column", message, self._meant(name, gauge))
            return None
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
        if size is None:
            return None
        zero = channel.is_zeroed and channel.zero == stage
        return _Column(cell, size, place=(self.stages.index(stage), self._rows[gauge]), zero=zero)

    def _meant(self, name: str, gauge: str) -> str:
        """What a column may stand for: a misspelt name has no column of its own."""
        before, at, stage = name.partition(" at ")  # as in the table of a campaign
        if at and before in self._rows:
            return f"Write '{before} @ {stage}'."
        heads = {name.rpartition("@")[0].strip() or name for name in self._heads}
        known = [*self.parameters, *self._rows]
        absent = [one for one in known if one not in heads]
        what = "Without a column" if absent else "Known"
        hint = did_you_mean(gauge, absent or known, what=what)
        return f"{hint} A column that is not wanted is named under 'ignore' of the case."

    @property
    def _heads(self) -> list[str]:
        """The names of the columns, without their units."""
        cells = cells_of(self.rows[0][1], self.delimiter)
        return [match[1] for cell in cells if (match := _UNIT.fullmatch(cell.text))]

    @property
    def _rows(self) -> dict[str, int]:
        return {channel.name: n for n, channel in enumerate(self.channels)}

    def _size(
        self, place: tuple[int, int], name: str, unit: str | None, dimension: str
    ) -> float | None:
        """Size of the unit of a column; None, with a fault, where it is none."""
        if unit is None:
            if dimension == DIMENSIONLESS:
                return 1.0
            message = f"the column '{name}' says no unit, and is {with_article(dimension)}"
            hint = f"Write '{name} [UNIT]'. Its units: {unit_list(dimension)}."
            self._refuse(place, "unit", message, hint)
            return None
        try:
            size = size_in(normal_unit(unit, dimension), dimension)
        except UnitError as error:
            self._refuse(place, "unit", error.message, error.hint)
            return None
        if size is None:
            message = f"'{unit}' is no unit of {with_article(dimension)}, as '{name}' is"
            self._refuse(place, "unit", message, f"Its units: {unit_list(dimension)}.")
        return size

    def _runs(
        self, width: int, columns: Mapping[int, _Column]
    ) -> Iterator[tuple[int, list[TextCell], list[float]]]:
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

    def _number(self, number: int, cell: TextCell, column: _Column) -> float:
        """What a cell says, SI; NaN for a run that failed, and with a fault for what is none."""
        text = cell.text.strip()
        if self.delimiter != "," and text.count(",") == 1 and "." not in text:
            text = text.replace(",", ".")
        if _NUMBER.fullmatch(text):
            value = float(re.sub("[dD]", "e", text)) * column.size
            if math.isfinite(value):
                return value
        place = (number, cell.column)
        if column.parameter:
            message = f"'{shorten(cell.text)}' of '{column.parameter}' is not a number"
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
        runs: list[tuple[int, list[TextCell], list[float]]],
    ) -> ReadRuns | None:
        """The runs that are there, unless no surface could be laid through them."""
        failed = [run for run in runs if np.isnan(run[2]).any()]
        sound = [run for run in runs if not np.isnan(run[2]).any()]
        names = tuple(column.parameter for column in columns if column.parameter)
        if not self._enough(len(names), len(sound), len(failed)):
            return None
        table = np.array([numbers for _, _, numbers in sound])
        of_parameters = np.array([bool(column.parameter) for column in columns])
        values = table[:, of_parameters]
        for k, column in enumerate(columns):
            self._check_column(header, column, table[:, k])
        if self.faults or not names:
            return None
        self._check_runs(names, values, [number for number, _, _ in sound])
        readings = np.full((len(sound), len(self.stages), len(self.channels)), np.nan)
        for k, column in enumerate(columns):
            if not column.parameter:
                readings[:, *column.place] = table[:, k]
        return ReadRuns(names, values, readings, self._left_out(columns, failed, len(runs)))

    def _enough(self, n: int, sound: int, failed: int) -> bool:
        least = least_runs(n)
        if sound >= least:
            return True
        also = f" ({failed} more have failed)" if failed else ""
        message = f"found {sound} runs{also}; {n} parameters need {least} at least"
        hint = f"About {10 * n} make a good surface: a Latin hypercube over the bounds."
        place = Location(self.file, self.rows[-1][0], 1)
        self.faults.append(Fault("too-few", message, hint, place))
        return False

    def _check_column(self, header: int, column: _Column, values: Floats) -> None:
        """A column that never changes tells nothing; a logarithm is of what is positive."""
        place, name = (header, column.cell.column), column.cell.text
        size = float(np.max(np.abs(values)))
        if float(np.ptp(values)) <= _SAME * size and not (column.zero and size == 0.0):
            message = f"the column '{shorten(name)}' is the same in all runs"
            hint = "Give the parameter its number in the program instead, and remove it here."
            if not column.parameter:
                hint = "Nothing can be identified from it: name it under 'ignore' of the case."
            self._refuse(place, "constant-column", message, hint)
        log = column.parameter and self.parameters[column.parameter].scale == "log"
        if log and values.min() <= 0.0:
            message = f"'{column.parameter}' has the scale log, and is not positive in all runs"
            self._refuse(place, "out-of-range", message, "Use 'scale: linear' in the case.")

    def _check_runs(self, names: Sequence[str], values: Floats, numbers: Sequence[int]) -> None:
        """No run is there twice, and no parameters only change together."""
        width = np.ptp(values, axis=0)
        unit = (values - values.min(axis=0)) / width
        seen: dict[tuple[float, ...], int] = {}
        for row, number in zip(np.round(unit, 10).tolist(), numbers, strict=True):
            first = seen.setdefault(tuple(row), number)
            if first != number:
                message = f"the parameters are those of the run in line {first}"
                hint = "Remove one of the two: a surface can go through one reading only."
                self._refuse((number, 1), "duplicate-run", message, hint)
        centred = unit - unit.mean(axis=0)
        size, vectors = np.linalg.svd(centred, full_matrices=False)[1:]
        if size[-1] < _TOGETHER * size[0]:
            tied = [names[k] for k in np.flatnonzero(np.abs(vectors[-1]) > 0.1).tolist()]
            message = f"{listing(tied)} change only together, so nothing tells them apart"
            hint = "Add runs in which each changes by itself, or make one parameter of them."
            self._refuse((self.rows[0][0], 1), "tied-columns", message, hint)

    def _left_out(
        self,
        columns: Sequence[_Column],
        failed: Sequence[tuple[int, list[TextCell], list[float]]],
        total: int,
    ) -> tuple[str, ...]:
        """Which runs have failed, in a sentence."""
        said = []
        for number, cells, numbers in failed[:_SHOWN]:
            k = int(np.flatnonzero(np.isnan(numbers))[0])
            what = f"'{cells[k].text}'" if cells[k].text else "empty"
            said.append(f"line {number} ({columns[k].cell.text} is {what})")
        if not said:
            return ()
        more = f" and {len(failed) - _SHOWN} more" if len(failed) > _SHOWN else ""
        have = "has failed and is" if len(failed) == 1 else "have failed and are"
        return (
            f"{len(failed)} of {total} runs in {self.name} {have} left out: "
            f"{', '.join(said)}{more}",
        )
