"""Tables of points from CSV files, written into the case before it is validated.

Values from tests of a constant that varies, motions of supports, changes of temperature, ends of
bars, and the rows of tests, which have no places:

    x [m], y [m], E [GPa], accuracy [GPa]       x [m], y [m], ux [mm], uy [mm]
    12.5,  40,    14.2,    1.0                  12.5,  3,     -1.2,    0.3

    structure, x1 [m], y1 [m], x2 [m], y2 [m]
    round 1,   0,      3,      0,      7

The resolved case holds the numbers themselves, so a result needs no file beside it, and its hash
tells when a file has changed.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from copy import deepcopy
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from geoident.errors import Fault, InputError, Location
from geoident.io.case.laboratory import COLUMNS
from geoident.io.text.cells import Cell, cells_of, delimiter_of, name_and_unit, written_lines
from geoident.io.text.faults import Faults, Places
from geoident.io.text.text_file import decode, read_bytes
from geoident.io.text.wording import did_you_mean, shorten
from geoident.io.text.yaml_reader import Node
from geoident.model.case import KeyPath, format_path
from geoident.units import UnitError, normal_unit, read_quantity, size_in, with_article

_LIMIT = 10 * 10**6  # bytes
_MOTIONS = {"ux": "x", "uy": "y", "uz": "z"}
"""Column of a motion to its key."""
_OWNER = "structure"
"""Column that says of which structure a row is."""


def with_tables(places: Places, folder: Path, faults: Faults) -> Places:
    """The case with what the tables hold that it names.

    Args:
        places: the case.
        folder: of the case.
        faults: is told where a file cannot be read, or is no such table.
    """
    data: Any = places.data
    solid = isinstance(data, dict) and data.get("analysis") == "solid"
    axes = ("x", "y", "z") if solid else ("x", "y")
    tables = [*_measured(data, axes), *_motions(data, axes), *_temperatures(data, axes)]
    tables += [*_ends_of_bars(data, axes), *_rows_of_tests(data)]
    if not tables:
        return places
    data = deepcopy(data)
    for table in tables:
        rows = table.rows(folder, faults)
        if rows is None:
            faults.spoils(table.entry)
        else:
            holder = data
            for key in table.entry[:-1]:
                holder = holder[key]
            holder[table.entry[-1]] = table.written(rows)
    return replace(places, data=data)


_Refuse = Callable[[int, int, str, str, str], None]
"""Notes a fault: line, column, code, what is wrong, what would be right."""
_Row = dict[str, str]
"""Column to what stands in it, with its unit."""


@dataclass(frozen=True)
class _Table:
    """A file that a case names.

    Args:
        entry: the key whose value its content becomes.
        key: the key at which it is named.
        name: of the file, as the case has it.
        axes: columns of the coordinates.
        columns: others to their dimensions, one at least of which is there.
        what: is in it, for messages.
        header: the remedy where a column is missing.
        given: what stands under the entry beside the file.
        owners: names of which a column `structure` has one in each row; rows of the first count.
    """

    entry: KeyPath
    key: KeyPath
    name: str
    axes: tuple[str, ...]
    columns: Mapping[str, str]
    what: str
    header: str
    given: Mapping[str, Node]
    owners: tuple[str, ...] = ()

    @property
    def measured(self) -> bool:
        """It holds values from tests, with their accuracies."""
        return "accuracy" in self.columns

    def written(self, rows: list[tuple[int, _Row]]) -> Node:
        """The rows as they would be written in the case."""
        if not self.axes:
            names = dict.fromkeys(name for _, row in rows for name in row)
            return {name: [row.get(name) for _, row in rows] for name in names}
        points: list[list[Node]] = [[row[axis] for axis in self.axes] for _, row in rows]
        if self.owners:
            half = len(self.axes) // 2
            return [[point[:half], point[half:]] for point in points]
        if not self.measured:
            written: dict[str, Node] = {**self.given, "points": [*points]}
            for name in self.columns:
                if name in rows[0][1]:
                    written[_MOTIONS.get(name, "values")] = [row[name] for _, row in rows]
            return written
        values: list[Node] = []
        for (line, row), point in zip(rows, points, strict=True):
            entry = {name: text for name, text in row.items() if name not in self.axes}
            constant = next(name for name in entry if name != "accuracy")
            value = entry.pop(constant)
            values.append({"at": point, "value": value, "line": str(line), **entry})
        return {"file": self.name, "values": values}

    def rows(self, folder: Path, faults: Faults) -> list[tuple[int, _Row]] | None:
        """The rows with their lines; None, with faults, where one is wrong."""
        file = folder / self.name
        try:
            content = read_bytes(str(file), limit=_LIMIT, what=f"table of {self.what}")
            lines = list(written_lines(decode(content, str(file))))
        except InputError as error:
            first = error.faults[0]
            hint = first.hint
            if first.code == "unreadable-file":
                hint = _beside(file) or hint
            message = f"'{shorten(file.name)}': {first.message}"
            faults.add(self.key, first.code, message, hint)
            return None
        wrong: list[Fault] = []

        def refuse(line: int, column: int, code: str, message: str, hint: str) -> None:
            place = Location(str(file), line, column)
            wrong.append(Fault(code, message, hint, place, format_path(self.key)))

        header = lines[0][1] if lines else ""
        delimiter = delimiter_of(header)
        units = self._units(cells_of(header, delimiter) if lines else [], refuse)
        rows = []
        for number, line in lines[1:] if not wrong else ():
            cells = cells_of(line, delimiter)
            if any(cell.text for cell in cells) and self._is_own(number, cells, units, refuse):
                rows.append((number, self._row(number, cells, units, refuse)))
        if not wrong and not rows:
            whose = f" of '{shorten(self.owners[0])}'" if _OWNER in units else ""
            refuse(1, 1, "bad-table", f"the table has no row{whose}", self.header)
        faults.extend(wrong)
        return None if wrong else rows

    def _units(self, header: list[Cell], refuse: _Refuse) -> dict[str, str]:
        """The columns in their order, each with its unit; what is wrong with them is refused."""
        dimensions = {**dict.fromkeys(self.axes, "length"), **self.columns}
        units: dict[str, str] = {}
        good = True
        for cell in header:
            title, at = cell.text, cell.column
            name, unit = name_and_unit(title)
            if name not in dimensions:
                name = name.lower().replace(" ", "_")
            if name == _OWNER and self.owners and name not in units:
                units[name] = ""
            elif name not in dimensions:
                message = f"the column '{shorten(title)}' is not known here"
                hint = did_you_mean(name, dimensions, what="Columns")
                hint = f"{hint} Rename it, or remove it from the table.".strip()
                refuse(1, at, "unknown-column", message, hint)
                good = False
            elif name in units:
                refuse(
                    1, at, "duplicate-column", f"the column '{name}' is given twice", "Remove one."
                )
                good = False
            else:
                units[name] = unit or ""
                if name == "accuracy" and unit == "%":
                    continue
                try:
                    units[name] = normal_unit(unit or "", dimensions[name])
                except UnitError as error:
                    refuse(1, at, "unit", error.message, error.hint)
                    continue
                if not unit or size_in(units[name], dimensions[name]) is None:
                    message = f"'{shorten(title)}' has no unit of {with_article(dimensions[name])}"
                    hint = f"Write it in brackets. {self.header}"
                    refuse(1, at, "unit", message, hint)
        values = [name for name in self.columns if name != "accuracy"]
        missing = [axis for axis in self.axes if axis not in units]
        missing += values[:1] if not any(name in units for name in values) else []
        for name in missing if good else ():
            refuse(1, 1, "missing-column", f"there is no column '{name}'", self.header)
        return units

    def _is_own(
        self, line: int, cells: list[Cell], units: Mapping[str, str], refuse: _Refuse
    ) -> bool:
        """Whether a row is of the structure that names the file; an unknown name is refused."""
        if _OWNER not in units:
            return True
        n = list(units).index(_OWNER)
        owner = cells[n] if n < len(cells) else Cell("", 1)
        if owner.text not in self.owners:
            message = f"there is no structure '{shorten(owner.text)}'"
            hint = did_you_mean(owner.text, self.owners, what="Structures")
            refuse(line, owner.column, "unknown-structure", message, hint)
        return owner.text == self.owners[0]

    def _row(self, line: int, cells: list[Cell], units: Mapping[str, str], refuse: _Refuse) -> _Row:
        """What stands in the cells of a row, with units; what is no number is refused."""
        row: _Row = {}
        if len(cells) > len(units):
            message = f"found {len(cells)} cells; expected {len(units)}"
            hint = "Remove what is too much; a decimal comma is written as a point."
            refuse(line, cells[len(units)].column, "bad-row", message, hint)
        for n, (name, unit) in enumerate(units.items()):
            if name == _OWNER:
                continue
            text, at = (cells[n].text, cells[n].column) if n < len(cells) else ("", 1)
            not_read = not self.axes and name != next(iter(self.columns))
            if not text and (name == "accuracy" or not_read):
                continue
            try:
                read_quantity(f"{text} {unit}")
                row[name] = f"{text} {unit}"
            except UnitError:
                what = f"'{shorten(text)}' is not a number" if text else "the cell is empty"
                hint = f"Write the {name} in {unit} as a number, or remove the row."
                hint = "Write decimal points in place of commas." if "," in text else hint
                refuse(line, at, "bad-number", f"{what} ({name})", hint)
        return row


def _measured(data: Node, axes: tuple[str, ...]) -> Iterator[_Table]:
    """Files of measured values that are given by their names alone."""

    def visit(node: Node, path: KeyPath) -> Iterator[_Table]:
        for key, part in _items(node):
            field = part if key == "field" and isinstance(part, dict) else {}
            for n, entry in _items(field.get("measured")) if field else ():
                name = entry.get("file") if isinstance(entry, dict) else entry
                if isinstance(name, str) and not (isinstance(entry, dict) and "values" in entry):
                    at, constant = (*path, key, "measured", n), str(path[-1])
                    unit = "angle" if constant == "friction" else "pressure"
                    columns = dict.fromkeys(("value", constant, "accuracy"), unit)
                    header = "Begin with a line such as 'x [m], y [m], value [GPa]' "
                    header += "('accuracy [GPa]' may follow)."
                    yield _Table(at, at, name, axes, columns, "measured values", header, {})
            yield from visit(part, (*path, key))

    if isinstance(data, dict):
        yield from visit(data.get("materials"), ("materials",))


def _motions(data: Node, axes: tuple[str, ...]) -> Iterator[_Table]:
    """Files of measured motions of supports, from the beginning or a stage on."""
    columns = {name: "length" for name, axis in _MOTIONS.items() if axis in axes}
    header = "Begin with a line such as 'x [m], y [m], ux [mm], uy [mm]'."
    stages = [] if not isinstance(data, dict) else _items(data.get("stages"))
    for path, part in [((), data), *((("stages", n), stage) for n, stage in stages)]:
        for name, given in _items(part.get("supports") if isinstance(part, dict) else None):
            at: KeyPath = (*path, "supports", name, "measured")
            table = given.get("measured") if isinstance(given, dict) else None
            yield from _with_points(at, table, axes, columns, "motions", header)


def _temperatures(data: Node, axes: tuple[str, ...]) -> Iterator[_Table]:
    """Files of changes of temperature in a stage."""
    header = "Begin with a line such as 'x [m], y [m], change [K]'."
    for n, stage in _items(data.get("stages") if isinstance(data, dict) else None):
        for group, given in _items(stage.get("temperature") if isinstance(stage, dict) else None):
            at: KeyPath = ("stages", n, "temperature", group)
            columns = {"change": "temperature"}
            yield from _with_points(at, given, axes, columns, "temperatures", header)


def _ends_of_bars(data: Node, axes: tuple[str, ...]) -> Iterator[_Table]:
    """Files with the ends of bars; one file may have those of several structures."""
    structures = _items(data.get("structures") if isinstance(data, dict) else None)
    columns = tuple(f"{axis}{end}" for end in (1, 2) for axis in axes)
    header = f"Begin with a line such as '{', '.join(f'{c} [m]' for c in columns)}' (a column "
    header += "'structure' may say whose row it is)."
    for name, given in structures:
        if isinstance(given, dict) and isinstance(file := given.get("ends"), str):
            at: KeyPath = ("structures", name, "ends")
            owners = (str(name), *(str(other) for other, _ in structures if other != name))
            yield _Table(at, at, file, columns, {}, "ends of bars", header, {}, owners)


def _rows_of_tests(data: Node) -> Iterator[_Table]:
    """Files with the rows of tests."""
    for name, test in _items(data.get("tests") if isinstance(data, dict) else None):
        columns = COLUMNS.get(str(test.get("kind"))) if isinstance(test, dict) else None
        if columns and isinstance(test, dict) and isinstance(file := test.get("readings"), str):
            at: KeyPath = ("tests", name, "readings")
            units = {"strain": "%", "pressure": "kPa", "length": "mm"}
            few = list(columns.items())[:3]  # those of a drained test
            titles = ", ".join(f"{c} [{units[dimension]}]" for c, dimension in few)
            header = f"Begin with a line such as '{titles}'."
            yield _Table(at, at, file, (), columns, "readings", header, {})


def _with_points(
    at: KeyPath,
    given: Node,
    axes: tuple[str, ...],
    columns: Mapping[str, str],
    what: str,
    header: str,
) -> Iterator[_Table]:
    """The table of a mapping that has a file in place of points."""
    if isinstance(given, dict) and isinstance(name := given.get("file"), str):
        rest = {key: node for key, node in given.items() if key != "file"}
        if rest.keys().isdisjoint(("points", "values", "x", "y", "z")):
            yield _Table(at, (*at, "file"), name, axes, columns, what, header, rest)


def _items(node: Node) -> list[tuple[Any, Node]]:
    """Keys and values of a mapping, numbers and entries of a list; nothing of anything else."""
    if isinstance(node, dict):
        return list(node.items())
    return list(enumerate(node)) if isinstance(node, list) else []


def _beside(file: Path) -> str:
    """The remedy where a file is not there."""
    try:
        names = [p.name for p in file.parent.iterdir() if p.suffix == file.suffix]
    except OSError:
        return ""
    return did_you_mean(file.name, names, what="Files there")
