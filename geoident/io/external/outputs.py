"""Numbers in the files that a run of a program leaves: tables, JSON, HDF5, lines of text.

What is not found is a `NotFound` with the file and what was looked for: the run has failed.
"""

from __future__ import annotations

import csv
import json
import math
import re
from collections.abc import Callable
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import Any

import h5py
import numpy as np

from geoident.io.external.pest_instructions import CannotFollow, observed
from geoident.io.text.wording import shorten
from geoident.model.external import (
    Finding,
    FunctionValue,
    Hdf5Value,
    InstructedValue,
    JsonValue,
    LineValue,
    Output,
    PatternValue,
    TableCell,
)

_INDEX = re.compile("[0-9]{1,18}")

LARGEST = 500 * 10**6
"""Bytes of a file of text that are read at most."""

Call = Callable[[str, str, str, str, str], Any]
"""Calls a function of a file: its path and name, the folder, the gauge and the stage."""


class NotFound(ValueError):
    """A run has left no such number."""


@dataclass
class RunFiles:
    """The files of one run, each read once.

    Args:
        folder: of the run.
        call: calls functions that find numbers.
    """

    folder: Path
    call: Call
    _read: dict[str, Any] = field(default_factory=dict)

    def number(self, output: Output, gauge: str, stage: str) -> float:
        """The reading, SI, that an output finds.

        Args:
            output: how it is found.
            gauge: its name.
            stage: its name.

        Raises:
            NotFound: it is not there, or no finite number.
        """
        how = output.how
        if isinstance(how, FunctionValue):
            value_read = self.call(how.path, how.name, str(self.folder), gauge, stage)
            where = f"{how.name}({gauge!r}, {stage!r})"
        else:
            value_read, where = self._found(output.file, how), output.file
        try:
            value = float(str(value_read).replace("D", "e").replace("d", "e"))
        except ValueError:
            raise NotFound(f"{where}: '{shorten(str(value_read))}' is not a number") from None
        if not math.isfinite(value):
            raise NotFound(f"{where}: the reading of '{gauge}' at '{stage}' is {value}")
        return value * output.size

    def _found(self, file: str, how: Finding) -> Any:
        path = self.folder / file
        if not path.is_file():
            raise NotFound(f"there is no file '{file}'")
        if not path.resolve().is_relative_to(self.folder.resolve()):
            raise NotFound(f"'{file}' leads out of the folder of the run")
        try:
            return self._in_file(path, file, how)
        except (OSError, UnicodeError, json.JSONDecodeError, csv.Error, CannotFollow) as error:
            raise NotFound(f"{file}: {error}") from error

    def _in_file(self, path: Path, file: str, how: Finding) -> Any:
        if isinstance(how, Hdf5Value):
            with h5py.File(path, "r") as opened:
                return _dataset(opened, file, how)
        if path.stat().st_size > LARGEST:
            raise NotFound(f"{file} is larger than {LARGEST // 10**6} MB")
        text = partial(path.read_text, encoding="utf-8", errors="replace")
        match how:
            case TableCell():
                return _cell(self._once(f"csv {file}", lambda: _table(text())), file, how)
            case JsonValue():
                return _pointed(self._once(f"json {file}", lambda: json.loads(text())), file, how)
            case LineValue():
                return _word(self._once(f"lines {file}", lambda: text().splitlines()), file, how)
            case PatternValue():
                return _match(self._once(f"text {file}", text), file, how)
            case InstructedValue():
                observations = self._once(
                    f"pest {how.path}\n{file}", lambda: observed(how.lines, text())
                )
                return observations[how.observation]
        raise AssertionError(how)

    def _once(self, key: str, read: Callable[[], Any]) -> Any:
        if key not in self._read:
            self._read[key] = read()
        return self._read[key]


def _table(text: str) -> list[list[str]]:
    first = text.lstrip("\ufeff").partition("\n")[0]
    mark = next((m for m in (",", ";", "\t") if m in first), ",")
    rows = csv.reader(text.lstrip("\ufeff").splitlines(), delimiter=mark)
    return [[cell.strip() for cell in row] for row in rows if any(cell.strip() for cell in row)]


def _cell(rows: list[list[str]], file: str, how: TableCell) -> str:
    names = rows[0] if rows else []
    wanted = [how.column] if isinstance(how.row, int) else [how.column, *(k for k, _ in how.row)]
    for name in wanted:
        if name not in names:
            columns = ", ".join(names[:12]) or "none"
            raise NotFound(f"{file} has no column '{name}' (its columns: {columns})")
    body = rows[1:]
    if isinstance(how.row, int):
        index = how.row - 1 if how.row > 0 else how.row
        if not -len(body) <= index < len(body):
            raise NotFound(f"{file} has {len(body)} rows, and row {how.row} is requested")
        row = body[index]
    else:
        places = [(names.index(key), value) for key, value in how.row]
        fitting = [
            row for row in body if all(n < len(row) and row[n] == value for n, value in places)
        ]
        conditions = ", ".join(f"{key} = {value}" for key, value in how.row)
        if len(fitting) != 1:
            raise NotFound(
                f"{file} has {len(fitting) or 'no'} rows with {conditions}; expected one"
            )
        row = fitting[0]
    place = names.index(how.column)
    if place >= len(row) or not row[place]:
        raise NotFound(f"{file} has nothing in the column '{how.column}' there")
    return row[place]


def _pointed(data: Any, file: str, how: JsonValue) -> Any:
    node = data
    for part in how.pointer.split("/")[1:]:
        key = part.replace("~1", "/").replace("~0", "~")
        if isinstance(node, dict) and key in node:
            node = node[key]
        elif isinstance(node, list) and _INDEX.fullmatch(key) and int(key) < len(node):
            node = node[int(key)]
        else:
            raise NotFound(f"{file} has nothing at '{how.pointer}': '{key}' is not there")
    if isinstance(node, bool) or not isinstance(node, int | float | str):
        raise NotFound(f"{file}: the value at '{how.pointer}' is not a number")
    return node


def _dataset(opened: h5py.File, file: str, how: Hdf5Value) -> float:
    dataset = opened.get(how.dataset)
    if not isinstance(dataset, h5py.Dataset):
        raise NotFound(f"{file} has no dataset '{how.dataset}'")
    fits = len(how.index) == len(dataset.shape) and all(
        -size <= n < size for n, size in zip(how.index, dataset.shape, strict=True)
    )
    if not fits:
        if dataset.size == 1 and not how.index:
            return float(np.ravel(dataset[()])[0])
        shape = " x ".join(map(str, dataset.shape)) or "one number"
        raise NotFound(
            f"'{how.dataset}' of {file} is {shape}; index {list(how.index)} is requested"
        )
    return float(dataset[how.index])


def _word(lines: list[str], file: str, how: LineValue) -> str:
    if isinstance(how.line, int):
        index = how.line - 1 if how.line > 0 else len(lines) + how.line
        wanted = f"line {how.line}"
    else:
        pattern = re.compile(how.line)
        index = next((n for n, text in enumerate(lines) if pattern.search(text)), -1)
        wanted = f"line with '{shorten(how.line)}'"
        if index < 0:
            raise NotFound(f"{file} has no {wanted}")
    index += how.after
    if not 0 <= index < len(lines):
        raise NotFound(
            f"{file} has {len(lines)} lines, and {how.after} after {wanted} is requested"
        )
    line = lines[index]
    if how.word == 0:
        first, last = how.columns
        return line[first - 1 : last].strip()
    words = line.replace(",", " ").split()
    if how.word > len(words):
        raise NotFound(f"{file}:{index + 1} has {len(words)} words; word {how.word} is requested")
    return words[how.word - 1]


def _match(text: str, file: str, how: PatternValue) -> str:
    matches = [match[1] for match in re.finditer(how.pattern, text, re.MULTILINE)]
    index = how.occurrence - 1 if how.occurrence > 0 else how.occurrence
    if not -len(matches) <= index < len(matches):
        message = f"{file}: '{shorten(how.pattern)}' is found {len(matches)} times"
        raise NotFound(f"{message}, and number {how.occurrence} is requested")
    return str(matches[index])
