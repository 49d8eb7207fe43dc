"""What a reading may be, and the values that describe files of readings."""

from __future__ import annotations

from typing import Annotated, get_args

from pydantic import BeforeValidator, WithJsonSchema

from geoident.io.case.gauges.kinds import GaugeSection
from geoident.io.readings.layout import COLUMNS, POINT_COLUMNS
from geoident.io.readings.workbook import range_problem
from geoident.io.schema.values import require_text
from geoident.io.text.dates import format_problem, from_strftime
from geoident.io.text.text_file import encoding_problem
from geoident.io.text.wording import Refusal, listing, shorten
from geoident.units import UnitError, normal_unit, size_in, units_of


def _date_format(value: object) -> str:
    text = require_text(value, "a date format")
    problem = format_problem(text)
    if problem:
        message = f"'{shorten(text)}' is not a date format: {problem}"
        here = from_strftime(text)
        usual = "Write it like DD.MM.YYYY or DD/MM/YYYY hh:mm."
        hint = f"Here it is written {here}." if here else usual
        raise Refusal("bad-date-format", message, hint)
    return text


READ = tuple(
    dict.fromkeys(one for kind in get_args(get_args(GaugeSection)[0]) for one in kind.measures)
)
"""Dimensions of what gauges read."""
_WHAT = " or ".join(READ)
_UNITS = tuple(dict.fromkeys(unit for name in READ for unit in units_of(name) if unit))


def _unit_read(value: object) -> str:
    text = require_text(value, f"a unit of {_WHAT}")
    try:
        unit = normal_unit(text)
    except UnitError as error:
        raise Refusal("unit", error.message, error.hint) from None
    if all(size_in(unit, dimension) is None for dimension in READ):
        message = f"'{text}' is not a unit of {_WHAT}"
        raise Refusal("unit", message, f"Units of {_WHAT}: {listing(_UNITS)}.")
    return unit


def _sign(value: object) -> int:
    text = str(value)
    if text.lstrip("+") not in {"1", "-1"}:
        message = f"found '{shorten(text)}'; expected 1 or -1"
        raise Refusal("not-listed", message)
    return int(text)


def _column_key(key: object) -> str:
    text = require_text(key, "the name of a column")
    if text not in (*COLUMNS, *POINT_COLUMNS):
        message = f"there is no column '{shorten(text)}'"
        hint = f"Columns: {listing(COLUMNS)}; of coordinates: {listing(POINT_COLUMNS)}."
        raise Refusal("unknown-key", message, hint)
    return text


def _encoding(value: object) -> str:
    text = require_text(value, "the name of an encoding")
    problem = encoding_problem(text)
    if problem:
        message = f"'{shorten(text)}' is not an encoding of texts: {problem}"
        hint = "Usual ones: utf-8, windows-1252 (Excel in the West), utf-16, shift-jis, gb18030."
        raise Refusal("bad-encoding", message, hint)
    return text


def _cells(value: object) -> str:
    text = require_text(value, "a range of cells")
    problem = range_problem(text)
    if problem:
        message = f"'{shorten(text)}' is not a range of cells: {problem}"
        raise Refusal("bad-range", message, "Write it like B4:H60.")
    return text


DateFormat = Annotated[
    str,
    BeforeValidator(_date_format),
    WithJsonSchema({"type": "string", "description": "made of YYYY, MM, DD, hh, mm, ss"}),
]
TextEncoding = Annotated[
    str,
    BeforeValidator(_encoding),
    WithJsonSchema({"type": "string", "description": "a name such as windows-1252"}),
]
Cells = Annotated[
    str,
    BeforeValidator(_cells),
    WithJsonSchema({"type": "string", "description": "a range such as B4:H60"}),
]
UnitRead = Annotated[str, BeforeValidator(_unit_read), WithJsonSchema({"enum": list(_UNITS)})]
Sign = Annotated[int, BeforeValidator(_sign), WithJsonSchema({"enum": [1, -1]})]
ColumnKey = Annotated[str, BeforeValidator(_column_key)]
