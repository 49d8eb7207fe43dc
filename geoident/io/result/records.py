"""Records with declared columns in a result file: `geoident.model.results.columns`.

A group is a table: its datasets have the names and axes that the fields of the record declare, and
the labels of an axis are a dataset of its name. Single values are attributes of the group.
"""

from __future__ import annotations

import json
from collections.abc import Iterable, Mapping, Sequence
from typing import Any, TypeVar

import h5py
import numpy as np

from geoident.io.result.hdf5 import TableReader, TableWriter, plain_text, text_attribute, texts
from geoident.model.results.columns import (
    LABELS,
    Column,
    Slot,
    columns,
    coordinates,
    is_empty,
    restored,
    slots,
)
from geoident.units import si_unit

_Record = TypeVar("_Record")
_DTYPES: Mapping[str, Any] = {"float": np.float64, "int": np.int64, "bool": np.bool_}

Labels = Mapping[str, Sequence[Any]]
"""Name of an axis to what stands along it."""


def write_record(
    parent: h5py.Group,
    record: Any,
    group: str = "",
    *,
    labels: Labels,
    units: Mapping[str, str],
    more: Sequence[tuple[Slot, Any]] = (),
) -> None:
    """Writes a record, and all records in it, into their groups.

    Args:
        parent: the file, or a group of it.
        record: what to write.
        group: where its columns go that name no other; empty for the parent itself.
        labels: of axes that the record does not label itself.
        units: SI unit of numbers whose dimension is that of an axis, such as ``gauge``.
        more: further columns and their values, into the groups that they name.
    """
    tables: dict[str, list[tuple[Slot, Any]]] = {}
    own = [(slot, slot.get(record)) for slot in slots(type(record), group)]
    for slot, value in (*own, *more):
        if not (value is None or (slot.column.optional and is_empty(value))):
            tables.setdefault(slot.group, []).append((slot, value))
    for name, entries in tables.items():
        _write_table(parent, name, entries, labels, units)


def _write_table(
    parent: h5py.Group,
    name: str,
    entries: Sequence[tuple[Slot, Any]],
    labels: Labels,
    units: Mapping[str, str],
) -> None:
    arrays = _arrays([entry for entry in entries if _is_dataset(entry[0])])
    sizes = {
        axis: size
        for slot, array in arrays.values()
        if array.ndim == len(slot.dataset_axes)
        for axis, size in zip(slot.dataset_axes, array.shape, strict=True)
    }
    own = {axis: array for axis, (slot, array) in arrays.items() if slot.dataset_axes == (axis,)}
    axes = {
        axis: own.get(axis, _labels(axis, slot, labels, sizes))
        for slot, _ in arrays.values()
        for axis in slot.dataset_axes
    }
    writer = TableWriter(parent, name, axes)
    for dataset, (slot, array) in arrays.items():
        unit = _unit(slot.column, units)
        if dataset not in axes:
            shape = [len(axes[axis]) for axis in slot.dataset_axes]
            writer.add(dataset, array.reshape(shape), *slot.dataset_axes, unit=unit)
        elif unit:
            text_attribute(writer.group[dataset].id, "unit", unit)
    for slot, value in entries:
        if not _is_dataset(slot):
            _write_attribute(writer.group, slot, value)


def _is_dataset(slot: Slot) -> bool:
    return bool(slot.dataset_axes) or slot.column.dataset


def _arrays(entries: Iterable[tuple[Slot, Any]]) -> dict[str, tuple[Slot, Any]]:
    """Name of a dataset to its array (...); the fields that stand in one are put together."""
    parts: dict[str, list[Any]] = {}
    arrays: dict[str, tuple[Slot, Any]] = {}
    for slot, value in entries:
        kind = slot.column.kind
        if kind == "text":
            array = texts(value) if slot.axes else texts([value]).reshape(())
        elif kind == "json":
            array = texts([json.dumps(dict(one)) for one in value])
        else:
            array = np.asarray(value, dtype=_DTYPES[kind])
        parts.setdefault(slot.name, []).append(array)
        arrays[slot.name] = slot, array
        if slot.column.part is not None:
            stacked = np.stack(parts[slot.name], axis=min(1, len(slot.axes)))
            arrays[slot.name] = slot, stacked
    return arrays


def _labels(axis: str, slot: Slot, labels: Labels, sizes: Mapping[str, int]) -> Any:
    """What stands along an axis: names of the result, directions, fields of a record, or counts."""
    if slot.column.part is not None and slot.column.part[0] == axis:
        return slot.column.labels
    if axis in labels:
        return labels[axis]
    if axis in LABELS:
        return LABELS[axis][: sizes.get(axis)]
    return np.arange(sizes.get(axis, 0))


def _unit(column: Column, units: Mapping[str, str]) -> str:
    """The unit of a dataset, as its attribute says it; empty for none."""
    unit = units.get(column.dimension, "") or si_unit(column.dimension)
    return column.unit.format(unit) if column.unit else unit


def _write_attribute(group: h5py.Group, slot: Slot, value: Any) -> None:
    column = slot.column
    if column.listed:
        group.attrs.create(slot.name, texts(value), dtype=h5py.string_dtype())
    elif column.kind == "float":
        group.attrs[slot.name] = np.float64(value)
    elif column.kind in ("int", "bool"):
        group.attrs[slot.name] = np.int64(value)
    else:
        text = json.dumps(dict(value)) if column.kind == "json" else value
        group.attrs[slot.name] = plain_text(text)


def read_record(
    parent: h5py.Group,
    record: type[_Record],
    group: str = "",
    *,
    sizes: Mapping[str, int] | None = None,
    **more: Any,
) -> _Record:
    """The record that `write_record` wrote.

    Args:
        parent: the file, or a group of it.
        record: its type.
        group: where its columns stand that name no other.
        sizes: of axes that the record does not label itself; they must be those of the file.
        **more: fields that are no columns.

    Raises:
        InputError: a dataset, an attribute or a group is missing, or of another shape or type.
    """
    own = {group: coordinates(record)}
    own |= {one.group: coordinates(one.of) for one in columns(record) if one.of and one.group}
    return restored(record, RecordReader(parent, sizes or {}, own), group, **more)


class RecordReader:
    """What a file holds of the columns of records.

    Args:
        parent: the file, or a group of it.
        sizes: of the axes that all tables of the file share.
        own: group to the axes that its table labels itself.
    """

    def __init__(
        self, parent: h5py.Group, sizes: Mapping[str, int], own: Mapping[str, set[str]]
    ) -> None:
        self._parent, self._sizes, self._own = parent, sizes, own
        self._tables: dict[str, TableReader] = {}

    def __call__(self, column: Column, group: str, name: str, axes: tuple[str, ...]) -> Any:
        """The value of a column; None where an optional one is missing.

        Raises:
            InputError: it is missing, or of another shape or type.
        """
        if column.optional and column.group and not self._has(group):
            return None
        if column.of is not None:
            return True
        if group not in self._tables:
            self._tables[group] = TableReader(self._parent, group)
        table = self._tables[group]
        if column.dataset:
            return table.text(name)
        if not axes:
            return _attribute(table, column, name)
        if not column.optional or name in table or name == group:  # then it is all of the group
            shape = self._shape(table, group, axes)
            if column.kind == "json":
                return tuple(json.loads(text) for text in table.column(name, "text", shape))
            return table.column(name, column.kind, shape)
        if column.required and column.kind == "float":
            return np.full(self._shape(table, group, axes), np.nan)
        return None

    def _has(self, group: str) -> bool:
        """Whether the file is to have a group; one that it says to have and has not is damage."""
        contents = self._parent.attrs.get("contents")
        return group in (self._parent if contents is None else str(contents).split())

    def _shape(self, table: TableReader, group: str, axes: tuple[str, ...]) -> tuple[int, ...]:
        shared = self._sizes.keys() - self._own.get(group, set())
        return tuple(self._sizes[axis] if axis in shared else table.size(axis) for axis in axes)


def _attribute(table: TableReader, column: Column, name: str) -> Any:
    if column.listed:
        return table.attribute_texts(name)
    if column.optional and name not in table.group.attrs:
        return None
    match column.kind:
        case "float":
            return table.attribute(name, float)
        case "int":
            return int(table.attribute(name, float))
        case "bool":
            return bool(table.attribute(name, float))
        case "json":
            return json.loads(table.attribute(name, str))
        case _:
            return table.attribute(name, str)
