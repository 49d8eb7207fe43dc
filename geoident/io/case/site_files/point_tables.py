"""Tables of points from CSV files, written into the case before it is validated.

Changes of temperature, and motions of supports:

    x [m], y [m], change [K]            x [m], y [m], ux [mm], uy [mm]
    0,     70,    -4.2                  12.5,  3,     -1.2,    0.3

The resolved case holds the numbers themselves, so a result needs no file beside it, and its hash
tells when a file has changed.
"""

from __future__ import annotations

import csv
import re
from copy import deepcopy
from dataclasses import replace
from pathlib import Path
from typing import Any

from geoident.errors import InputError
from geoident.io.text.faults import Faults, Places
from geoident.io.text.text_file import decode, read_bytes
from geoident.io.text.wording import shorten
from geoident.io.text.yaml_reader import Node
from geoident.model.case import KeyPath
from geoident.units import UnitError, normal_unit

_AXES = ("x", "y", "z")
_CHANGE = "change"
_MOTIONS = {"ux": "x", "uy": "y", "uz": "z"}
_COLUMN = re.compile(r"\s*([A-Za-z]+)\s*[\[(]\s*([^\])]+?)\s*[\])]\s*")
_LIMIT = 10 * 10**6  # bytes
_HEADERS = {
    "temperatures": "Begin with a line such as 'x [m], y [m], change [K]'.",
    "motions": "Begin with a line such as 'x [m], y [m], ux [mm], uy [mm]'.",
}


def with_tables(places: Places, folder: Path, faults: Faults) -> Places:
    """The case with the points and values of the files that its temperatures and motions name.

    Args:
        places: the case.
        folder: of the case.
        faults: is told where a file cannot be read, or is no such table.
    """
    wanted = list(_named(places.data))
    if not wanted:
        return places
    data = deepcopy(places.data)
    for path, name, what in wanted:
        table = _read(str(folder / name), path, what, faults)
        if table is None:
            faults.spoils(path)
        else:
            node: Any = data
            for key in path:
                node = node[key]
            del node["file"]
            node.update(table)
    return replace(places, data=data)


def _named(data: Node) -> list[tuple[KeyPath, str, str]]:
    """Every table that is given by a file alone, with its path and what it is of."""
    stages = data.get("stages") if isinstance(data, dict) else None
    found: list[tuple[KeyPath, str, str]] = []
    first: list[tuple[KeyPath, Node]] = [((), data)]
    listed = enumerate(stages if isinstance(stages, list) else ())
    for path, part in first + [(("stages", n), stage) for n, stage in listed]:
        supports = part.get("supports") if isinstance(part, dict) else None
        for name, given in (supports if isinstance(supports, dict) else {}).items():
            table = given.get("measured") if isinstance(given, dict) else None
            keys = table if isinstance(table, dict) else {}
            file = keys.get("file")
            if isinstance(file, str) and not {"points", "x", "y", "z"} & keys.keys():
                found.append(((*path, "supports", name, "measured"), file, "motions"))
    for n, stage in enumerate(stages if isinstance(stages, list) else ()):
        warmed = stage.get("temperature") if isinstance(stage, dict) else None
        for group, given in (warmed if isinstance(warmed, dict) else {}).items():
            keys = given if isinstance(given, dict) else {}
            file = keys.get("file")
            if isinstance(file, str) and not {"points", "values"} & keys.keys():
                found.append((("stages", n, "temperature", group), file, "temperatures"))
    return found


def _read(file: str, path: KeyPath, what: str, faults: Faults) -> dict[str, Node] | None:
    place = (*path, "file")
    try:
        text = decode(read_bytes(file, limit=_LIMIT, what=f"table of {what}"), file)
    except InputError as error:
        faults.add(place, error.faults[0].code, f"'{shorten(file)}': {error.faults[0].message}")
        return None
    lines = text.splitlines()
    delimiter = ";" if lines and ";" in lines[0] else ","
    rows = list(csv.reader(lines, delimiter=delimiter, skipinitialspace=True))
    columns = _columns(rows[0], what) if rows else None
    if columns is None or len(rows) < 2:
        message = f"'{shorten(file)}' is no table of {what}"
        faults.add(place, "bad-table", message, _HEADERS[what])
        return None
    return _table(file, rows, columns, place, faults)


def _columns(header: list[str], what: str) -> dict[str, tuple[int, str]] | None:
    """Name to place and unit of each column; None if a header does not say it."""
    found: dict[str, tuple[int, str]] = {}
    values = tuple(_MOTIONS) if what == "motions" else (_CHANGE,)
    for n, title in enumerate(header):
        match = _COLUMN.fullmatch(title)
        if match is None or match[1] in found or match[1] not in (*_AXES, *values):
            return None
        try:
            found[match[1]] = (n, normal_unit(match[2]))
        except UnitError:
            return None
    good = {"x", "y"} <= found.keys() and not found.keys().isdisjoint(values)
    return found if good else None


def _table(
    file: str,
    rows: list[list[str]],
    columns: dict[str, tuple[int, str]],
    place: KeyPath,
    faults: Faults,
) -> dict[str, Node] | None:
    points: list[Node] = []
    values: dict[str, list[Node]] = {}
    for number, row in enumerate(rows[1:], start=2):
        if not any(cell.strip() for cell in row):
            continue
        if len(row) != len(columns):
            message = f"'{shorten(file)}', line {number}: found {len(row)} cells; "
            faults.add(place, "bad-table", f"{message}{len(columns)} expected")
            return None
        written = {name: f"{row[n].strip()} {unit}" for name, (n, unit) in columns.items()}
        points.append([written[axis] for axis in _AXES if axis in written])
        for name in written.keys() - set(_AXES):
            values.setdefault(_MOTIONS.get(name, "values"), []).append(written[name])
    return {"points": points, **values}
