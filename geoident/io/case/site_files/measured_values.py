"""Tables of tests that measured a constant that varies: written into the case before it is checked.

    x [m], y [m], E [GPa], accuracy [GPa]
    12.5,  40,    14.2,    1.0

The resolved case holds their numbers, so a result needs no file beside it.
"""

from __future__ import annotations

from copy import deepcopy
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, TypeAlias

from geoident.errors import Fault, InputError, Location
from geoident.io.text.faults import Faults, Places
from geoident.io.text.text_file import decode, read_bytes
from geoident.io.text.wording import did_you_mean, shorten
from geoident.io.text.yaml_reader import Node
from geoident.model.case import KeyPath, format_path
from geoident.units import (
    DIMENSIONLESS,
    UnitError,
    normal_unit,
    read_quantity,
    require_dimension,
    size_in,
    with_article,
)

_AXES = ("x", "y", "z")
_LIMIT = 10 * 10**6  # bytes
_HEADER = "Begin with a line such as 'x [m], y [m], value [GPa]' ('accuracy [GPa]' may follow)."

_Row: TypeAlias = "list[tuple[str, int]]"


def with_measured(places: Places, folder: Path, faults: Faults) -> Places:
    """The case with the values of the files that its fields name.

    Args:
        places: the case.
        folder: of the case.
        faults: is told where a file cannot be read, or is no table of measured values.
    """
    wanted = list(_named(places.data))
    if not wanted:
        return places
    data = deepcopy(places.data)
    solid = isinstance(places.data, dict) and places.data.get("analysis") == "solid"
    for path, name in wanted:
        dimension = "angle" if path[-4] == "friction" else "pressure"
        before = len(faults.found)
        values = _Table(folder / name, path, solid=solid, dimension=dimension).read(faults)
        if len(faults.found) > before:
            faults.spoils(path)
        node: Any = data
        for step in path[:-1]:
            node = node[step]
        node[path[-1]] = {"file": name, "values": values}
    return replace(places, data=data)


def _named(data: Node) -> list[tuple[KeyPath, str]]:
    """Every file of measured values that is given by its name alone, with the path of its entry."""
    materials = data.get("materials") if isinstance(data, dict) else None
    found: list[tuple[KeyPath, str]] = []

    def visit(node: Node, path: KeyPath) -> None:
        if isinstance(node, list):
            for n, part in enumerate(node):
                visit(part, (*path, n))
        if not isinstance(node, dict):
            return
        for key, part in node.items():
            measured = part.get("measured") if key == "field" and isinstance(part, dict) else None
            for n, entry in enumerate(measured if isinstance(measured, list) else ()):
                name = entry.get("file") if isinstance(entry, dict) else entry
                bare = isinstance(entry, str) or (isinstance(entry, dict) and "values" not in entry)
                if isinstance(name, str) and bare:
                    found.append(((*path, key, "measured", n), name))
            visit(part, (*path, key))

    visit(materials, ("materials",))
    return found


@dataclass(frozen=True)
class _Table:
    """A file of measured values.

    Args:
        file: its path.
        path: of the entry of the case that names it.
        solid: points have three coordinates.
        dimension: of the values.
    """

    file: Path
    path: KeyPath
    solid: bool
    dimension: str

    def read(self, faults: Faults) -> list[Node]:
        """Its values as they would be written in the case."""
        try:
            text = decode(
                read_bytes(str(self.file), limit=_LIMIT, what="table of measured values"),
                str(self.file),
            )
        except InputError as error:
            first = error.faults[0]
            beside = self._beside() if first.code == "unreadable-file" else ""
            message = f"'{shorten(self.file.name)}': {first.message}"
            faults.add(self.path, first.code, message, beside or first.hint)
            return []
        lines = text.splitlines()
        delimiter = ";" if lines and ";" in lines[0] else ","
        rows = [_cells(line, delimiter) for line in lines]
        columns = self._columns(rows[0] if rows else [], faults)
        if columns is None:
            return []
        found: list[Node] = []
        for number, row in enumerate(rows[1:], start=2):
            if any(text for text, _ in row):
                value = self._value(row, number, columns, faults)
                found += [] if value is None else [value]
        if len(rows) < 2:
            self._fault(faults, 1, 1, "bad-table", "the table has no row", _HEADER)
        return found

    def _beside(self) -> str:
        try:
            names = [p.name for p in self.file.parent.iterdir() if p.suffix == self.file.suffix]
        except OSError:
            return ""
        return did_you_mean(self.file.name, names, what="Files there")

    def _fault(
        self, faults: Faults, line: int, column: int, code: str, message: str, hint: str = ""
    ) -> None:
        place = Location(str(self.file), line, column)
        faults.extend([Fault(code, message, hint, place, format_path(self.path))])

    def _columns(self, header: _Row, faults: Faults) -> dict[str, tuple[int, str]] | None:
        """Coordinate, ``value`` or ``accuracy`` to its place and its unit; None with a fault."""
        axes = _AXES if self.solid else _AXES[:2]
        constant = str(self.path[-4])
        known = {name: name for name in (*axes, "value", "accuracy")} | {constant: "value"}
        found: dict[str, tuple[int, str]] = {}
        before = len(faults.found)
        for n, (title, at) in enumerate(header):
            name, unit = _title(title)
            meant = known.get(name)
            if meant is None:
                message = f"the column '{shorten(title)}' is not known here"
                hint = did_you_mean(name, known, what="Columns")
                self._fault(faults, 1, at, "unknown-column", message, hint)
                continue
            if meant in found:
                message = f"the column '{meant}' is there twice"
                self._fault(faults, 1, at, "duplicate-column", message, "Remove one.")
                continue
            dimension = "length" if meant in _AXES else self.dimension
            found[meant] = (n, self._unit(unit, dimension, meant, title, at, faults))
        for name in (*axes, "value"):
            if name not in found and len(faults.found) == before:
                message = f"there is no column '{name}'"
                self._fault(faults, 1, 1, "missing-column", message, _HEADER)
        return found if len(faults.found) == before else None

    def _unit(
        self, unit: str, dimension: str, name: str, title: str, at: int, faults: Faults
    ) -> str:
        """The unit of a column, in its usual spelling; noted as a fault where it is none."""
        if name == "accuracy" and unit.strip() == "%":
            return "%"
        try:
            normal = normal_unit(unit, dimension)
        except UnitError as error:
            self._fault(faults, 1, at, "unit", error.message, error.hint)
            return unit
        if not unit or size_in(normal, dimension) is None:
            message = f"'{shorten(title)}' has no unit of {with_article(dimension)}"
            hint = f"Write it in brackets, such as '{name} [{'m' if name in _AXES else 'GPa'}]'."
            self._fault(faults, 1, at, "unit", message, hint)
        return normal

    def _value(
        self, row: _Row, line: int, columns: dict[str, tuple[int, str]], faults: Faults
    ) -> dict[str, Node] | None:
        """A row as an entry of the case; None, with a fault, where it is none."""
        written: dict[str, str] = {}
        before = len(faults.found)
        if len(row) > len(columns):
            message = f"found {len(row)} cells; {len(columns)} expected"
            hint = "Remove what is too much; a decimal comma is written as a point."
            self._fault(faults, line, row[len(columns)][1], "bad-row", message, hint)
        for name, (n, unit) in columns.items():
            text, at = row[n] if n < len(row) else ("", 1)
            if name == "accuracy" and not text:
                continue
            try:
                dimension = "length" if name in _AXES else self.dimension
                quantity = read_quantity(f"{text} {unit}", DIMENSIONLESS if unit == "%" else "")
                if unit != "%":
                    require_dimension(quantity, dimension, text)
                written[name] = f"{text} {unit}"
            except UnitError:
                what = f"'{shorten(text)}' is no number" if text else "the cell is empty"
                hint = f"Write the {name} in {unit} as a number, or remove the row."
                self._fault(faults, line, at, "bad-number", f"{what} ({name})", hint)
        if len(faults.found) > before:
            return None
        entry: dict[str, Node] = {
            "at": [written[axis] for axis in _AXES if axis in written],
            "value": written["value"],
            "line": str(line),
        }
        return entry | ({"accuracy": written["accuracy"]} if "accuracy" in written else {})


def _cells(line: str, delimiter: str) -> _Row:
    """The cells of a line without blanks around, each with its column in the line, from 1."""
    cells, at = [], 0
    for raw in line.split(delimiter):
        start = at + len(raw) - len(raw.lstrip()) + 1
        cells.append((raw.strip().strip('"').strip(), start))
        at += len(raw) + 1
    return cells


def _title(text: str) -> tuple[str, str]:
    """Name and unit of a column: ``E [GPa]`` or ``E (GPa)``."""
    for opening, closing in ("[]", "()"):
        if text.endswith(closing) and opening in text:
            name, _, unit = text[:-1].partition(opening)
            return name.strip(), unit.strip()
    return text.strip(), ""
