"""Records with declared columns as rows: for spreadsheets and data frames, and for programs.

A table is asked for by the axes of its rows, such as stage and member. It has the columns of a
record along these axes; what stands along a further axis, such as the directions in space, is
several columns of a spreadsheet and a list for programs: `geoident.model.results.columns`. Several
records of one type are a table as well, with the axis `ROW`.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from itertools import chain, product
from operator import attrgetter
from typing import Any

import numpy as np

from geoident.model.results.columns import LABELS, ROW, Column, columns
from geoident.report.text.layout import moment_text, with_unit
from geoident.units import in_unit, shown_unit, si_unit

CsvCell = str | int | float | bool
CsvRow = tuple[CsvCell, ...]
Labels = Mapping[str, Sequence[str]]
"""Axis to what its entries are called."""
Quantities = Mapping[str, Sequence[tuple[str, str]]]
"""Axis to unit and dimension of each entry along it: `geoident.model.results.result.Result`."""

Places = Sequence[Sequence[int]]
"""Numbers along the axes of a table, a sequence for each row."""

NO_QUANTITIES: Quantities = {}


@dataclass(frozen=True)
class CsvTable:
    """One table.

    Args:
        header: names of the columns.
        rows: the cells; NaN is an empty cell.
    """

    header: tuple[str, ...] = ()
    rows: tuple[CsvRow, ...] = ()


def by_stage(shown: Any) -> list[tuple[int, int]]:
    """Channel and stage of the entries (n_channels, n_stages) that are shown, stage by stage."""
    return [(i, j) for j, i in np.argwhere(shown.T).tolist()]


def headed(name: str, unit: str, dimension: str) -> str:
    """The header of a column of a spreadsheet, with its unit where it has one."""
    return with_unit(name, unit, dimension, form="{} [{}]")


def sheet(
    source: Any,
    *axes: str,
    rows: Places | None = None,
    quantities: Quantities = NO_QUANTITIES,
    labels: Labels = LABELS,
    only: Sequence[str] = (),
    si: bool = False,
) -> CsvTable:
    """A table for spreadsheets, in the units of people.

    Args:
        source: a record with columns, or several of one type; nothing, for an empty table.
        *axes: of the rows; `ROW` for several records.
        rows: numbers along the axes, a sequence for each row; None for all.
        quantities: unit and dimension along axes.
        labels: of further axes, whose entries are columns.
        only: fields that are asked for, in this order; all if empty.
        si: SI units in place of those of the user.
    """
    if source is None or _is_empty(source):
        return CsvTable()
    table = _Table(source, axes, rows, quantities, si=si)
    header: list[str] = []
    cells: list[list[CsvCell]] = []
    for one in table.chosen("csv", only, labels):
        values, units = table.values(one), table.units(one)
        further = [axis for axis in one.axes if axis not in axes]
        sizes = values.shape[1:]
        for place in product(*(range(len(labels[axis])) for axis in further)):
            at = dict(zip(further, place, strict=True))
            name = (one.sheet or one.title).format(**{a: labels[a][k] for a, k in at.items()})
            header.append(f"{name} ({one.shown})" if one.shown else name)
            within = all(k < size for k, size in zip(place, sizes, strict=True))
            column = values[:, *place] if within else np.full(len(values), np.nan)
            if one.dimension in at:
                units = [quantities[one.dimension][at[one.dimension]]] * len(column)
            cells.append([_cell(one, *cell) for cell in zip(column, units, strict=True)])
    return CsvTable(tuple(header), tuple(zip(*cells, strict=True)))


def beside(*tables: CsvTable) -> CsvTable:
    """Tables with the same rows as one."""
    header = chain.from_iterable(table.header for table in tables)
    rows = zip(*(table.rows for table in tables), strict=True)
    return CsvTable(tuple(header), tuple(tuple(chain.from_iterable(parts)) for parts in rows))


def objects(
    source: Any,
    *axes: str,
    rows: Places | None = None,
    quantities: Quantities = NO_QUANTITIES,
    only: Sequence[str] = (),
) -> list[dict[str, Any]]:
    """The rows of a table for programs, SI; None for what is no finite number.

    Args:
        source: a record with columns, or several of one type; nothing, for an empty table.
        *axes: of the rows; `ROW` for several records.
        rows: numbers along the axes, a sequence for each row; None for all.
        quantities: unit and dimension along axes.
        only: fields that are asked for, in this order; all if empty.
    """
    if source is None or _is_empty(source):
        return []
    table = _Table(source, axes, rows, quantities, si=True)
    entries: list[dict[str, Any]] = [{} for _ in table.rows]
    for one in table.chosen("json", only, LABELS):
        values = table.values(one)
        if one.kind == "float" and not one.dated:
            values = np.where(np.isfinite(values), values, None)
        for entry, value in zip(entries, values.tolist(), strict=True):
            entry[one.title] = value
    return entries


def _is_empty(source: Any) -> bool:
    return isinstance(source, Sequence) and not source


def attributes(record: Any) -> dict[str, Any]:
    """The single numbers and texts of a record, for programs."""
    return {
        one.title: getattr(record, one.field)
        for one in columns(type(record))
        if not one.axes and one.of is None and "json" not in one.hidden
    }


@dataclass
class _Table:
    """The columns of a record, or of several, along the axes of rows."""

    source: Any
    axes: Sequence[str]
    given: Places | None
    quantities: Quantities
    si: bool = field(kw_only=True)

    def __post_init__(self) -> None:
        several = isinstance(self.source, Sequence)
        own = columns(type(self.source[0] if several else self.source))
        self.columns = {one.field: one for one in own if one.of is None}
        if several:
            self.columns |= {
                f"{outer.field}.{one.field}": one
                for outer in own
                if outer.of is not None and not outer.rows
                for one in columns(outer.of)
            }
            self.columns = {
                name: replace(one, field=name, axes=(ROW, *one.axes))
                for name, one in self.columns.items()
            }
            if {"unit", "dimension"} <= self.columns.keys():
                units = [(one.unit, one.dimension) for one in self.source]
                self.quantities = {**self.quantities, ROW: units}
        self.rows = self._all_rows() if self.given is None else self.given
        self._at = {axis: [row[k] for row in self.rows] for k, axis in enumerate(self.axes)}

    def _read(self, name: str) -> Any:
        get = attrgetter(name)
        several = isinstance(self.source, Sequence)
        return [get(one) for one in self.source] if several else get(self.source)

    def _all_rows(self) -> Places:
        sizes: dict[str, int] = {}
        for name, one in self.columns.items():
            value = self._read(name) if one.axes else None
            if value is not None:
                sizes |= dict(zip(one.axes, np.shape(value), strict=True))
        return list(product(*(range(sizes[axis]) for axis in self.axes)))

    def chosen(self, view: str, only: Sequence[str], labels: Labels) -> Sequence[Column]:
        """The columns that are asked for, or all that stand along the axes of rows."""
        if only:
            return [self.columns[name] for name in only]
        return [
            one
            for name, one in self.columns.items()
            if view not in one.hidden
            and (along := {*one.axes} - labels.keys())
            and along <= {*self.axes}
            and (value := self._read(name)) is not None
            and (not isinstance(value, tuple) or len(value))  # what this result does not have
        ]

    def values(self, one: Column) -> Any:
        """The values (k, ...) of a column in the k rows, SI; texts as objects."""
        if one.kind == "text" and one.dimension:  # the unit itself
            units = self.units(one)
            return np.array([shown_unit(*unit) for unit in units], dtype=object)
        chosen = tuple(self._at.get(axis, slice(None)) for axis in one.axes)
        kind = object if one.kind == "text" else None
        values = np.asarray(self._read(one.field), dtype=kind)[chosen]
        if one.dated:
            return np.array([moment_text(float(time)) for time in values], dtype=object)
        if one.known:
            values = np.where(np.asarray(self._read(one.known))[chosen], values, np.nan)
        return values

    def units(self, one: Column) -> list[tuple[str, str]]:
        """Unit and dimension of a column in each of the k rows."""
        own, fixed = self.quantities.get(one.dimension), (one.shown, one.dimension)
        at = self._at.get(one.dimension)
        units = [fixed] * len(self.rows) if own is None or at is None else [own[k] for k in at]
        return [(si_unit(unit[1]), unit[1]) for unit in units] if self.si else units


def _cell(one: Column, value: Any, unit: tuple[str, str]) -> CsvCell:
    """A value in a unit; an infinite one (not determined, an open bound) has an empty cell."""
    if isinstance(value, float | np.floating):
        number = in_unit(float(value), *unit) + 0.0  # no -0
        return math.nan if math.isinf(number) and one.dimension else number
    cell: CsvCell = value.item() if isinstance(value, np.generic) else value
    return "" if cell is None else cell
