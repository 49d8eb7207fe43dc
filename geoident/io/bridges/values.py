"""Values of parameters from a table ``parameter,value,unit``, as other programs write it.

The first line names the columns, of which others may be there too: the table of parameters that
``geoident export`` writes is one. Numbers may have the exponents of Fortran (``1.5D+01``).
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

from geoident.errors import Fault, InputError, Location
from geoident.io.text.cells import Cell, read_text_table
from geoident.io.text.wording import did_you_mean, shorten
from geoident.model.parameter import Parameter
from geoident.units import (
    DIMENSIONLESS,
    UnitError,
    shown_unit,
    size_in,
    unit_list,
    unit_size,
    with_article,
)

_MAX_BYTES = 20_000_000
_MOST_FAULTS = 100
ROUNDING = 1e-6
"""Part of a bound by which a value may lie beyond it: that of what other programs write."""


@dataclass(frozen=True)
class WrittenValue:
    """A value of a parameter as a file has it.

    Args:
        name: of the parameter.
        text: the number.
        unit: its unit; empty for none written; None for that in which the case gives its start.
        place: of the name.
        number_place: of the number.
        unit_place: of the unit.
    """

    name: str
    text: str
    unit: str | None
    place: Location
    number_place: Location
    unit_place: Location


def read_values(path: str) -> tuple[WrittenValue, ...]:
    """The values in a table.

    Args:
        path: of the table.

    Raises:
        InputError: with all faults of the table, each with its line and column.
    """
    hint = "Its first line is 'parameter,value,unit', and each further one a parameter."
    table = read_text_table(
        path, limit=_MAX_BYTES, what="table of values", hint=hint, delimiter=","
    )
    line, cells = table.header
    header = [cell.text.lower() for cell in cells]
    missing = [name for name in ("parameter", "value") if name not in header]
    if missing:
        message = f"there is no column '{missing[0]}'; found {shorten(', '.join(header))}"
        hint = "Begin with parameter,value,unit."
        raise InputError([Fault("missing-column", message, hint, Location(path, line, 1))])
    if table.faults:
        raise InputError(table.faults)
    values = []
    for line, cells in table.rows:
        by = dict(zip(header, cells, strict=True))
        name, value, unit = (by.get(key, Cell("", 1)) for key in ("parameter", "value", "unit"))
        places = (Location(path, line, cell.column) for cell in (name, value, unit))
        values.append(WrittenValue(name.text, value.text, unit.text, *places))
    return tuple(values)


def values_of(written: Sequence[WrittenValue], parameters: Sequence[Parameter]) -> dict[str, float]:
    """The values of parameters, SI, within their bounds.

    Args:
        written: the values as a file has them.
        parameters: of the case.

    Raises:
        InputError: with all faults: parameters that are none or are there twice, no numbers, units
            of another dimension, values beyond the bounds.
    """
    known = {parameter.name: parameter for parameter in parameters}
    values: dict[str, float] = {}
    faults: list[Fault] = []
    for row in written:
        name = row.name
        if name not in known:
            hint = did_you_mean(row.name, known, what="Parameters")
            message = f"there is no parameter '{shorten(row.name)}' in the case"
            faults.append(Fault("unknown-parameter", message, hint, row.place))
        elif name in values:
            message = f"the parameter '{name}' is given twice"
            faults.append(Fault("same-parameter", message, "Keep one of them.", row.place))
        else:
            value = _value(row, known[name])
            if isinstance(value, Fault):
                faults.append(value)
            values[name] = math.nan if isinstance(value, Fault) else value
    if faults:
        raise InputError(faults[:_MOST_FAULTS])
    return values


def _value(row: WrittenValue, parameter: Parameter) -> float | Fault:
    try:
        number = float(row.text.replace("D", "e").replace("d", "e"))
    except ValueError:
        number = math.nan
    if not math.isfinite(number):
        message = f"'{shorten(row.text)}' is not a number"
        return Fault("not-a-number", message, "", row.number_place)
    try:
        value = number * _size(row, parameter)
    except UnitError as error:
        place = row.unit_place if row.unit else row.number_place
        return Fault("unit", error.message, error.hint, place)
    low, high = parameter.lower, parameter.upper
    room = ROUNDING * max(abs(low), abs(high))
    if low - room <= value <= high + room:
        return min(max(value, low), high)
    unit = shown_unit(parameter.unit, parameter.dimension)
    shown = size_in(parameter.unit, parameter.dimension) or 1.0
    bounds = f"[{low / shown:.6g}, {high / shown:.6g}] {unit}".rstrip()
    message = f"{parameter.name} = {value / shown:.6g} is outside its bounds {bounds}"
    hint = "Keep to the bounds of the case, or widen them there."
    return Fault("outside-bounds", message, hint, row.number_place)


def _size(row: WrittenValue, parameter: Parameter) -> float:
    dimension = parameter.dimension
    if row.unit is None:
        return size_in(parameter.unit, dimension) or 1.0
    if row.unit or dimension == DIMENSIONLESS:
        return unit_size(row.unit, dimension, parameter.name) if row.unit else 1.0
    message = f"'{parameter.name}' is {with_article(dimension)} and has no unit here"
    raise UnitError(message, f"Write its unit in the column 'unit': {unit_list(dimension)}.")
