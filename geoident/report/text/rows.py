"""Records with declared columns as rows: for spreadsheets and data frames, and for programs.

A table is asked for by the axes of its rows, such as stage and member. It has the columns of a
record along these axes; what stands along a further axis, such as the directions in space, is
several columns of a spreadsheet and a list for programs: `geoident.model.results.columns`.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import product
from typing import Any

import numpy as np

from geoident.model.results.columns import LABELS, Column, columns
from geoident.units import in_unit, shown_unit, si_unit

CsvCell = str | int | float | bool
CsvRow = tuple[CsvCell, ...]
Quantities = Mapping[str, Sequence[tuple[str, str]]]
"""Axis to unit and dimension of each entry along it: `geoident.model.results.result.Result`."""

NO_QUANTITIES: Quantities = {}


@dataclass(frozen=True)
class CsvTable:
    """One table.

    Args:
        header: names of the columns.
        rows: the cells; NaN is an empty cell.
    """

    header: tuple[str, ...]
    rows: tuple[CsvRow, ...]


def by_stage(shown: Any) -> list[tuple[int, int]]:
    """Channel and stage of the entries (n_channels, n_stages) that are shown, stage by stage."""
    return [(i, j) for j, i in np.argwhere(shown.T).tolist()]


def sheet(
    record: Any,
    *axes: str,
    rows: Sequence[Sequence[int]] | None = None,
    quantities: Quantities = NO_QUANTITIES,
    only: Sequence[str] = (),
    si: bool = False,
) -> CsvTable:
    """A table for spreadsheets, in the units of people.

    Args:
        record: with the columns.
        *axes: of the rows.
        rows: numbers along the axes, a sequence for each row; None for all.
        quantities: unit and dimension along axes.
        only: fields that are asked for; all if empty.
        si: SI units in place of those of the user.
    """
    places = _places(record, axes, rows)
    header: list[str] = []
    cells: list[list[CsvCell]] = []
    for one in _chosen(record, axes, only, "csv"):
        values, units = _values(record, one, axes, places, quantities, si=si)
        further = [axis for axis in one.axes if axis not in axes]
        for labels in product(*(range(len(LABELS[axis])) for axis in further)):
            names = {axis: LABELS[axis][k] for axis, k in zip(further, labels, strict=True)}
            name = (one.sheet or one.title).format(**names)
            header.append(f"{name} ({one.shown})" if one.shown else name)
            cells.append([
                _cell(values[(r, *labels)] if _within(values, labels) else math.nan, units[r])
                for r in range(len(places))
            ])  # fmt: skip
    return CsvTable(tuple(header), tuple(zip(*cells, strict=True)) if places else ())


def objects(
    record: Any,
    *axes: str,
    rows: Sequence[Sequence[int]] | None = None,
    quantities: Quantities = NO_QUANTITIES,
    only: Sequence[str] = (),
) -> list[dict[str, Any]]:
    """The rows of a table for programs, SI; None for what is no finite number.

    Args:
        record: with the columns.
        *axes: of the rows.
        rows: numbers along the axes, a sequence for each row; None for all.
        quantities: unit and dimension along axes.
        only: fields that are asked for; all if empty.
    """
    places = _places(record, axes, rows)
    entries: list[dict[str, Any]] = [{} for _ in places]
    for one in _chosen(record, axes, only, "json"):
        values, _ = _values(record, one, axes, places, quantities, si=True)
        if one.kind == "float":
            values = np.where(np.isfinite(values), values, None)
        for entry, value in zip(entries, values.tolist(), strict=True):
            entry[one.title] = value
    return entries


def attributes(record: Any) -> dict[str, Any]:
    """The single numbers and texts of a record, for programs."""
    return {
        one.title: getattr(record, one.field)
        for one in columns(type(record))
        if not one.axes and one.of is None and "json" not in one.hidden
    }


def _places(
    record: Any, axes: Sequence[str], rows: Sequence[Sequence[int]] | None
) -> Sequence[Sequence[int]]:
    """Numbers along the axes of each row."""
    if rows is not None:
        return rows
    sizes: dict[str, int] = {}
    for one in columns(type(record)):
        value = getattr(record, one.field) if one.of is None and one.axes else None
        if value is not None:
            sizes |= dict(zip(one.axes, np.shape(value), strict=True))
    return list(product(*(range(sizes[axis]) for axis in axes)))


def _chosen(record: Any, axes: Sequence[str], only: Sequence[str], view: str) -> Iterator[Column]:
    """The columns of a record that stand along these axes of rows."""
    for one in columns(type(record)):
        along = {*one.axes} - LABELS.keys()
        asked = view not in one.hidden and (not only or one.field in only)
        present = one.of is None and getattr(record, one.field) is not None
        if asked and present and along and along <= {*axes}:
            yield one


def _values(
    record: Any,
    one: Column,
    axes: Sequence[str],
    places: Sequence[Sequence[int]],
    quantities: Quantities,
    *,
    si: bool,
) -> tuple[Any, list[tuple[str, str]]]:
    """The values (k, ...) of a column in some rows, SI, and how each is shown."""
    at = {axis: [place[k] for place in places] for k, axis in enumerate(axes)}
    chosen = tuple(at.get(axis, slice(None)) for axis in one.axes)
    kind = object if one.kind == "text" else None
    values = np.asarray(getattr(record, one.field), dtype=kind)[chosen]
    if one.known:
        values = np.where(np.asarray(getattr(record, one.known))[chosen], values, np.nan)
    own, fixed = quantities.get(one.dimension), (one.shown, one.dimension)
    units = [own[k] for k in at[one.dimension]] if own else [fixed] * len(places)
    if one.kind == "text" and own:  # the unit itself
        texts = [si_unit(unit[1]) if si else shown_unit(*unit) for unit in units]
        values = np.array(texts, dtype=object)
    return values, [("", unit[1]) for unit in units] if si else units


def _within(values: Any, labels: Sequence[int]) -> bool:
    return all(k < size for k, size in zip(labels, values.shape[1:], strict=True))


def _cell(value: Any, unit: tuple[str, str]) -> CsvCell:
    if isinstance(value, float | np.floating):
        return in_unit(float(value), *unit) + 0.0  # no -0
    cell: CsvCell = value.item() if isinstance(value, np.generic) else value
    return cell
