"""Records with declared columns.

A table of a result is a frozen dataclass whose fields are declared once, by `column`: the names of
their axes, the dimension of the quantity, how files and people call them. The result file, JSON,
CSV, data frames, xarray, the tables on the screen and `geoident diff` read this declaration, so a
new column needs no line in any of them. Only one with a `label` is a column of its own on the
screen and on the page::

    @dataclass(frozen=True)
    class YieldedGround:
        states: tuple[str, ...] = field(metadata=column("state", name="state"))
        share: Floats = field(metadata=column("state"))
        lower: Floats = field(metadata=column("state", "axis", dimension="length"))
        unit: str

A column that has the name of its only axis holds the labels of this axis. Axes without such a
column are those of the result (`parameter`, `gauge`, `stage`), directions in space (`axis`), ends
of a line (`end`), or plain counts. Fields of a single number or text are columns as they are. A
field whose type is another record is a part of the table; a tuple of records is a row each along
one axis. A property with `derived` is written and shown, not read.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import MISSING, dataclass, fields, replace
from functools import cache
from types import NoneType
from typing import Any, Literal, TypeVar, get_args, get_origin, get_type_hints

import numpy as np

from geoident.model.arrays import Bools, Floats, Ints

LABELS: Mapping[str, tuple[str, ...]] = {
    "axis": ("x", "y", "z"),
    "end": ("first", "second"),
    "shell_axis": ("1", "2", "n"),
    "shell_part": ("11", "22", "12"),
    "principal": ("I", "II"),
    "section": ("1", "2", "most"),
}
"""Labels of axes that mean the same everywhere; the first of them where an axis is shorter."""

VIEWS = ("json", "csv", "xarray", "diff")
"""All views of a table but the result file."""

ROW = "row"
"""Axis along which several records of one type stand."""

_KINDS: Mapping[Any, str] = {
    Floats: "float", Ints: "int", Bools: "bool", tuple[str, ...]: "text",
    float: "float", int: "int", bool: "bool", str: "text", Mapping[str, str]: "json",
    Mapping[str, float]: "json",
}  # fmt: skip

_SINGLE = (float, int, bool, str)
"""Types of fields that are columns without being declared."""

BLANK: Mapping[str, Any] = {"float": np.nan, "int": 0, "bool": False, "text": "", "json": {}}
"""What stands in a row of a table that has no record."""

_Function = TypeVar("_Function", bound=Callable[..., Any])
_Record = TypeVar("_Record")


@dataclass(frozen=True)
class Column:
    """How one field of a record stands in tables.

    Args:
        axes: names of the axes of its array; none for a single value.
        name: in the result file; the name of the field if empty.
        group: of the result file; that of its record if empty.
        part: axis and label, where several fields stand in one dataset along one more axis.
        prefix: before the names of the columns of a record in this field.
        dimension: key of `geoident.units.DIMENSIONS`; or ``parameter`` or ``gauge``, where each
            entry along this axis has its own; or `ROW`, where the record names `unit`, `dimension`.
        unit: in the result file, where it is not the SI unit of the dimension.
        optional: not written where there is nothing; a file without it is read.
        stored: a derived column that is read, for `restored` of its record.
        title: as programs and spreadsheets call it; the name if empty.
        sheet: header in CSV and data frames, where it is not the title.
        array: name in data sets of xarray, where it is not the title.
        label: heading on the screen and on the page; empty where it stands in other columns there.
        shown: unit for people of a fixed dimension.
        hidden: views without it: ``json``, ``csv``, ``xarray``, ``diff``.
        dataset: a single text that is a dataset, not an attribute.
        known: name of the truth values of the record that say which numbers people may be given.
        field: that it is of.
        kind: ``float``, ``int``, ``bool``, ``text`` or ``json``.
        of: type of the record in this field.
        rows: there is a tuple of such records, along the only axis.
        gaps: a row may have none.
        listed: a tuple without axis.
        labels: all of the axis of `part`.
        required: the field has no default.
    """

    axes: tuple[str, ...] = ()
    name: str = ""
    group: str = ""
    part: tuple[str, str] | None = None
    prefix: str = ""
    dimension: str = ""
    unit: str = ""
    optional: bool = False
    stored: bool = True
    title: str = ""
    sheet: str = ""
    array: str = ""
    label: str = ""
    shown: str = ""
    hidden: tuple[str, ...] = ()
    dataset: bool = False
    known: str = ""
    field: str = ""
    kind: str = ""
    of: type[Any] | None = None
    rows: bool = False
    gaps: bool = False
    listed: bool = False
    labels: tuple[str, ...] = ()
    required: bool = False


def column(*axes: str, **declared: Any) -> dict[str, Column]:
    """Metadata that declare a field of a record as a column: ``field(metadata=column(...))``.

    Args:
        *axes: names of the axes of its array; none for a single value.
        **declared: see `Column`.
    """
    return {"column": Column(axes=axes, **declared)}


def derived(*axes: str, **declared: Any) -> Callable[[_Function], _Function]:
    """Declare a property of a record as a column that follows from the others; below `property`.

    Args:
        *axes: names of the axes of its array; none for a single value.
        **declared: see `Column`.
    """

    def declare(function: _Function) -> _Function:
        function.column = Column(axes=axes, **{"stored": False, **declared})  # type: ignore[attr-defined]  # a function may have attributes, which mypy does not know
        return function

    return declare


def columns(record: type[Any]) -> tuple[Column, ...]:
    """The columns of a type of record, as declared: its fields, then what is derived."""
    kind: Any = record
    return _declared(kind)


@cache
def _declared(record: Any) -> tuple[Column, ...]:
    hints = get_type_hints(record)
    columns = [
        _resolved(
            entry.metadata.get("column", Column()),
            entry.name,
            hints[entry.name],
            required=entry.default is MISSING and entry.default_factory is MISSING,
        )
        for entry in fields(record)
        if "column" in entry.metadata
        or hints[entry.name] in _SINGLE
        or get_origin(hints[entry.name]) is Literal
    ]
    for name in dir(record):
        function: Any = getattr(getattr(record, name), "fget", None)
        if hasattr(function, "column"):
            hint = get_type_hints(function)["return"]
            columns.append(_resolved(function.column, name, hint, required=False))
    return tuple(replace(one, labels=_labels(columns, one)) for one in columns)


def _labels(all_: Sequence[Column], one: Column) -> tuple[str, ...]:
    """Labels of the columns that stand in one dataset along the axis of a part."""
    return tuple(
        other.part[1] for other in all_ if one.part and other.part and one.part[0] == other.part[0]
    )


def _resolved(declared: Column, name: str, hint: Any, *, required: bool) -> Column:
    """A column with all that follows from its field."""
    some = [part for part in get_args(hint) if part is not NoneType]
    if NoneType in get_args(hint):
        hint = some[0] if len(some) == 1 else hint
    of, rows, gaps = hint, False, False
    if get_origin(hint) is tuple and hint not in _KINDS:
        rows, of = True, get_args(hint)[0]
        gaps = bool(get_args(of))
        of = get_args(of)[0] if gaps else of
    kind = "text" if get_origin(hint) is Literal else _KINDS.get(hint, "")
    return replace(
        declared,
        name=declared.name or name,
        title=declared.title or (name if declared.part else declared.name or name),
        field=name,
        kind=kind,
        of=None if kind else of,
        rows=rows,
        gaps=gaps,
        listed=hint == tuple[str, ...] and not declared.axes,
        required=required,
    )


@dataclass(frozen=True)
class Slot:
    """One dataset or attribute of a table, and how it is taken from a record.

    Args:
        column: that it is of.
        group: of the result file.
        name: there.
        axes: of its array; none for an attribute.
        get: record to value; None where there is none.
    """

    column: Column
    group: str
    name: str
    axes: tuple[str, ...]
    get: Callable[[Any], Any]

    @property
    def dataset_axes(self) -> tuple[str, ...]:
        """The same with the axis along which several fields stand in one dataset."""
        if self.column.part is None:
            return self.axes
        first = min(1, len(self.axes))
        return (*self.axes[:first], self.column.part[0], *self.axes[first:])


def slots(record: type[Any], group: str = "", prefix: str = "") -> tuple[Slot, ...]:
    """All datasets and attributes that records of a type have, with those of the records in them.

    Args:
        record: the type.
        group: in which its columns stand that name no other.
        prefix: before their names.
    """
    kind: Any = record
    return _slots(kind, group, prefix)


@cache
def _slots(record: Any, group: str, prefix: str) -> tuple[Slot, ...]:
    found = []
    for one in columns(record):
        home = one.group or group
        if one.of is None:
            found.append(Slot(one, home, prefix + one.name, one.axes, _getter(one.field)))
            continue
        for inner in slots(one.of, home, one.prefix):
            blank = BLANK.get(inner.column.kind)
            get = _rows_getter(one, inner.get, blank) if one.rows else _inner_getter(one, inner.get)
            optional = (one.rows and one.optional) or inner.column.optional
            outer = one if one.part else inner.column
            joined = replace(inner.column, part=outer.part, labels=outer.labels, optional=optional)
            found.append(replace(inner, column=joined, axes=(*one.axes, *inner.axes), get=get))
    return tuple(found)


def _getter(name: str) -> Callable[[Any], Any]:
    return lambda record: getattr(record, name)


def _inner_getter(one: Column, get: Callable[[Any], Any]) -> Callable[[Any], Any]:
    def value(record: Any) -> Any:
        inner = getattr(record, one.field)
        return None if inner is None else get(inner)

    return value


def _rows_getter(one: Column, get: Callable[[Any], Any], blank: Any) -> Callable[[Any], Any]:
    def values(record: Any) -> Any:
        rows = getattr(record, one.field)
        if one.optional and not any(row is not None for row in rows):
            return None
        return [blank if row is None else get(row) for row in rows]

    return values


def coordinates(record: type[Any]) -> set[str]:
    """Axes whose labels a type of record holds itself."""
    return {slot.name for slot in slots(record) if slot.axes == (slot.name,)}


def is_empty(value: Any) -> bool:
    """Whether an optional value says nothing: none, no entries, or a number that is NaN."""
    if isinstance(value, float):
        return bool(np.isnan(value))
    if isinstance(value, np.ndarray) and value.dtype == np.float64:
        return not np.isfinite(value).any() and not np.isinf(value).any()
    return value is None or (isinstance(value, Sequence | np.ndarray) and len(value) == 0)


Source = Callable[[Column, str, str, tuple[str, ...]], Any]
"""Column, group, name, axes to the value that is stored; None where an optional one is missing."""


def restored(
    record: type[_Record], source: Source, group: str = "", prefix: str = "", **more: Any
) -> _Record:
    """A record from what is stored of it.

    A type of record with fields that are no columns may make itself: `from_columns`.

    Args:
        record: its type.
        source: of what is stored.
        group: in which its columns stand that name no other.
        prefix: before their names.
        **more: fields that are stored otherwise.
    """
    values: dict[str, Any] = {}
    for one in columns(record):
        if not one.stored:
            continue
        home, at = one.group or group, _at_label(source, one)
        if one.of is None:
            value = at(one, home, prefix + one.name, one.axes)
        elif one.optional and one.group and source(one, home, "", ()) is None:
            value = () if one.rows else None
        elif one.rows:
            value = _restored_rows(one, source, home)
        else:
            value = restored(one.of, at, home, one.prefix)
        if value is not None or one.required:
            values[one.field] = value
    build: Callable[..., _Record] = getattr(record, "from_columns", record)
    return build(**values, **more)


def _at_label(source: Source, one: Column) -> Source:
    """What stands at one label of datasets that hold several fields of a record."""
    if one.part is None:
        return source
    axis, label = one.part
    place = one.labels.index(label)

    def at_label(column: Column, group: str, name: str, axes: tuple[str, ...]) -> Any:
        first = min(1, len(axes))
        whole = source(column, group, name, (*axes[:first], axis, *axes[first:]))
        return None if whole is None else _python(np.take(whole, place, axis=first))

    return at_label


def _restored_rows(one: Column, source: Source, group: str) -> tuple[Any, ...] | None:
    """The records along an axis; None where their table is missing.

    Where they have a group of their own and that is there, no column of it may be missing.
    """
    of: Any = one.of
    absent_allowed = one.optional and not one.group
    stored: dict[str, Any] = {}

    def whole(column: Column, group: str, name: str, axes: tuple[str, ...]) -> Any:
        if name not in stored:
            asked = replace(column, optional=True, required=False) if absent_allowed else column
            stored[name] = source(asked, group, name, (*one.axes, *axes))
        return stored[name]

    def row(k: int) -> Any:
        def at_row(column: Column, group: str, name: str, axes: tuple[str, ...]) -> Any:
            values = whole(column, group, name, axes)
            return None if values is None else values[k] if axes else _python(values[k])

        known = restored(of, at_row, group, one.prefix)
        return None if one.gaps and _is_blank(known) else known

    first = slots(of, group, one.prefix)[0]
    labelled = whole(first.column, first.group, first.name, first.dataset_axes)
    return None if labelled is None else tuple(row(k) for k in range(len(labelled)))


def _python(value: Any) -> Any:
    return value.item() if isinstance(value, np.generic) else value


def _is_blank(record: Any) -> bool:
    """Whether a row stands for no record: no number of it is known."""
    values = [getattr(record, one.field) for one in columns(type(record))]
    return all(np.isnan(value) for value in values if isinstance(value, float))


def select(record: _Record, axes: Sequence[str], order: Ints) -> _Record:
    """Some entries (k,) of a record along axes, in all its columns and the records in it.

    Args:
        record: with the columns.
        axes: names of axes with the same entries, such as ``parameter`` and ``other``.
        order: numbers of the entries.
    """
    changes: dict[str, Any] = {}
    declared = {one.field: one for one in columns(type(record))}
    for entry in fields(record):  # type: ignore[arg-type]  # a record is a dataclass
        one = declared.get(entry.name)
        value = getattr(record, entry.name)
        if one is None or (is_empty(value) and not isinstance(value, np.ndarray)):
            continue
        own = [place for place, axis in enumerate(one.axes) if axis in axes]
        if one.of is not None and not own:
            changes[entry.name] = (
                tuple(row and select(row, axes, order) for row in value)
                if one.rows
                else select(value, axes, order)
            )
        elif isinstance(value, np.ndarray):
            for place in own:
                value = np.take(value, order, axis=place)
            changes[entry.name] = value
        elif own:
            changes[entry.name] = tuple(value[k] for k in order)
    return replace(record, **changes)  # type: ignore[type-var]  # likewise
