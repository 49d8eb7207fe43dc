"""Changes of temperature from CSV files, written into the case before it is validated.

    x [m], y [m], change [K]
    0,     70,    -4.2

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
_COLUMN = re.compile(r"\s*([A-Za-z]+)\s*[\[(]\s*([^\])]+?)\s*[\])]\s*")
_LIMIT = 10 * 10**6  # bytes
_HEADER = "Begin with a line such as 'x [m], y [m], change [K]'."


def with_temperatures(places: Places, folder: Path, faults: Faults) -> Places:
    """The case with the points and values of the files that its temperatures name.

    Args:
        places: the case.
        folder: of the case.
        faults: is told where a file cannot be read, or is no table of temperatures.
    """
    wanted = list(_named(places.data))
    if not wanted:
        return places
    data = deepcopy(places.data)
    for path, name in wanted:
        table = _read(str(folder / name), path, faults)
        if table is None:
            faults.spoils(path)
        else:
            node: Any = data
            for key in path:
                node = node[key]
            del node["file"]
            node.update(table)
    return replace(places, data=data)


def _named(data: Node) -> list[tuple[KeyPath, str]]:
    """Every temperature that is given by a file alone, with its path."""
    stages = data.get("stages") if isinstance(data, dict) else None
    found: list[tuple[KeyPath, str]] = []
    for n, stage in enumerate(stages if isinstance(stages, list) else ()):
        warmed = stage.get("temperature") if isinstance(stage, dict) else None
        for group, given in (warmed if isinstance(warmed, dict) else {}).items():
            keys = given if isinstance(given, dict) else {}
            name = keys.get("file")
            if isinstance(name, str) and not {"points", "values"} & keys.keys():
                found.append((("stages", n, "temperature", group), name))
    return found


def _read(file: str, path: KeyPath, faults: Faults) -> dict[str, Node] | None:
    place = (*path, "file")
    try:
        text = decode(read_bytes(file, limit=_LIMIT, what="table of temperatures"), file)
    except InputError as error:
        faults.add(place, error.faults[0].code, f"'{shorten(file)}': {error.faults[0].message}")
        return None
    lines = text.splitlines()
    delimiter = ";" if lines and ";" in lines[0] else ","
    rows = list(csv.reader(lines, delimiter=delimiter, skipinitialspace=True))
    columns = _columns(rows[0]) if rows else None
    if columns is None or len(rows) < 2:
        message = f"'{shorten(file)}' is no table of temperatures"
        faults.add(place, "bad-table", message, _HEADER)
        return None
    return _table(file, rows, columns, place, faults)


def _columns(header: list[str]) -> dict[str, tuple[int, str]] | None:
    """Name to place and unit of each column; None if a header does not say it."""
    found: dict[str, tuple[int, str]] = {}
    for n, title in enumerate(header):
        match = _COLUMN.fullmatch(title)
        if match is None or match[1] in found or match[1] not in (*_AXES, _CHANGE):
            return None
        try:
            found[match[1]] = (n, normal_unit(match[2]))
        except UnitError:
            return None
    return found if {"x", "y", _CHANGE} <= found.keys() else None


def _table(
    file: str,
    rows: list[list[str]],
    columns: dict[str, tuple[int, str]],
    place: KeyPath,
    faults: Faults,
) -> dict[str, Node] | None:
    points: list[Node] = []
    values: list[Node] = []
    for number, row in enumerate(rows[1:], start=2):
        if not any(cell.strip() for cell in row):
            continue
        if len(row) != len(columns):
            message = f"'{shorten(file)}', line {number}: found {len(row)} cells; "
            faults.add(place, "bad-table", f"{message}{len(columns)} expected")
            return None
        written = {name: f"{row[n].strip()} {unit}" for name, (n, unit) in columns.items()}
        points.append([written[axis] for axis in _AXES if axis in written])
        values.append(written[_CHANGE])
    return {"points": points, "values": values}
