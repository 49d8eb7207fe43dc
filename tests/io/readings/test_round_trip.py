"""Whatever readings are written as text or workbook, long or wide, the same ones are read."""

import csv
import io

import openpyxl
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from geoident.errors import InputError
from geoident.io.readings.file import parse_readings, read_readings
from geoident.io.readings.layout import Layout
from geoident.io.text.dates import date_text

QUICK = settings(max_examples=40, deadline=None, suppress_health_check=list(HealthCheck))
SIZES = {"mm": 1e-3, "cm": 1e-2, "m": 1.0}
DAY = 86400.0

names = st.text(
    st.characters(codec="utf-8", categories=("L", "N", "P", "S")) | st.just(" "), min_size=1
).filter(lambda text: text == text.strip() and not text.startswith(("#", "=")))
numbers = st.none() | st.floats(-1e6, 1e6, allow_subnormal=False).map(lambda x: x + 0.0)
days = st.integers(0, 20000).map(lambda n: n * DAY)
delimiters = st.sampled_from([(",", "."), (";", "."), (";", ","), ("\t", "."), ("|", ",")])


def channels(wide):
    """Names of columns are told apart without regard to capitals, and end before their unit."""
    if not wide:
        return names
    taken = {"date", "stage", "remarks"}
    return names.filter(lambda name: not set(name) & set("()[]") and name.lower() not in taken)


@st.composite
def tables(draw, *, wide):
    """Columns (channel, unit), and rows of a date with a number for each."""
    columns = st.lists(
        st.tuples(channels(wide), st.sampled_from(sorted(SIZES))),
        min_size=1, max_size=4, unique_by=lambda column: column[0].lower(),
    )  # fmt: skip
    columns = draw(columns)
    rows = st.tuples(days, st.lists(numbers, min_size=len(columns), max_size=len(columns)))
    return columns, draw(st.lists(rows, min_size=1, max_size=5))


def cells(columns, rows, *, wide, number=lambda x: x, date=date_text):
    """The rows of a file."""
    if wide:
        head = ["date", *(f"{name} ({unit})" for name, unit in columns)]
        return [head, *([date(day), *map(number, values)] for day, values in rows)]
    head = ["gauge", "value", "date", "unit"]
    return [head] + [
        [name, number(value), date(day), unit]
        for day, values in rows
        for (name, unit), value in zip(columns, values, strict=True)
    ]


def same(readings, columns, rows):
    expected = [
        (name, day, value if value is None else pytest.approx(value * SIZES[unit], rel=1e-14))
        for day, values in rows
        for (name, unit), value in zip(columns, values, strict=True)
    ]
    assert [(r.channel, r.time, r.value) for r in readings] == expected


@QUICK
@given(data=st.data(), wide=st.booleans(), signs=delimiters, quoted=st.booleans())
def test_a_text_gives_the_readings_that_were_written(data, wide, signs, quoted):
    delimiter, decimal = signs
    columns, rows = data.draw(tables(wide=wide))
    written = io.StringIO()
    writer = csv.writer(
        written,
        delimiter=delimiter,
        quoting=csv.QUOTE_ALL if quoted else csv.QUOTE_MINIMAL,
        lineterminator=data.draw(st.sampled_from(["\n", "\r\n"])),
    )

    def number(x):
        return "" if x is None else repr(x).replace(".", decimal)

    writer.writerows(cells(columns, rows, wide=wide, number=number))
    layout = Layout(delimiter=delimiter, decimal=decimal, wide=wide)
    same(parse_readings(written.getvalue().encode(), "r.csv", layout), columns, rows)


@QUICK
@given(data=st.data(), wide=st.booleans())
def test_a_workbook_gives_the_readings_that_were_written(data, wide, tmp_path):
    columns, rows = data.draw(tables(wide=wide))
    book = openpyxl.Workbook()
    for row in cells(columns, rows, wide=wide):
        book.active.append(row)
    path = tmp_path / "r.xlsx"
    book.save(path)
    same(read_readings(str(path), Layout(wide=wide)), columns, rows)


@QUICK
@given(
    rows=st.lists(st.lists(names | numbers.map(repr), max_size=6), max_size=6),
    head=st.sampled_from(["gauge,date,value,unit", "date,CV1 (mm),CV2 [cm]", ""]),
    stray=st.sampled_from(["", '"', ";", "\t", "\\"]),
    wide=st.booleans(),
)
def test_any_lines_give_readings_or_faults_that_have_a_place(rows, head, stray, wide):
    text = "\n".join([head, *(stray.join(row) + "," + ",".join(row) for row in rows)])
    try:
        places = [r.location for r in parse_readings(text.encode(), "r.csv", Layout(wide=wide))]
    except InputError as error:
        places = [fault.location for fault in error.faults if fault.code != "empty"]
    assert all(place.file == "r.csv" and place.line > 0 for place in places)
