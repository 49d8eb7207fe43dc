"""Readings from Excel workbooks, as openpyxl and Excel write them."""

import contextlib
import io
import time
import zipfile
from datetime import date, datetime
from pathlib import Path

import openpyxl
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from geoident.errors import InputError
from geoident.io.readings.file import read_readings
from geoident.io.readings.layout import Layout
from geoident.io.text.dates import read_date

DATES = "dates: {heading: 2024-03-01, bench 1: 2024-04-01}\nreadings: "
LONG = [
    ["gauge", "stage", "value", "unit", "remarks"],
    ["EX1.a5", "heading", 1.25, "mm", "after rain"],
    ["CV1", "bench 1", -3, "mm", None],
]


def workbook(rows, *, sheet="Readings", at="A1", merged=()):
    book = openpyxl.Workbook()
    page = book.active
    page.title = sheet
    row, column = openpyxl.utils.cell.coordinate_to_tuple(at)
    for i, cells in enumerate(rows):
        for j, value in enumerate(cells):
            page.cell(row + i, column + j, value)
    for cells in merged:
        page.merge_cells(cells)
    return book


@pytest.fixture
def read(project, changed):
    def read(description, book, name="r.xlsx"):
        if isinstance(book, bytes):
            Path(project.folder, name).write_bytes(book)
        else:
            book.save(Path(project.folder, name))
        return project.read(changed("readings: readings.csv", description)).case

    return read


@pytest.fixture
def refused(read):
    def refused(description, book, **options):
        with pytest.raises(InputError) as caught:
            read(description, book, **options)
        return caught.value.faults

    return refused


def values(case):
    return [
        (r.channel, r.stage, None if r.value is None else pytest.approx(1e3 * r.value))
        for r in case.readings
    ]


def test_one_reading_a_row_with_remarks_and_the_cell_of_each(read):
    case = read("readings: r.xlsx", workbook(LONG))
    assert values(case) == [("EX1.a5", "heading", 1.25), ("CV1", "bench 1", -3.0)]
    assert [r.note for r in case.readings] == ["after rain", ""]
    assert str(case.readings[1].location).endswith("r.xlsx:Readings!A3")


def test_dates_are_those_of_excel_whatever_their_format(read):
    rows = [
        ["Datum", "EX1.a5 (mm)", "CV1 [cm]", "Bemerkung"],
        [datetime(2024, 3, 2, 7, 30), 0.5, 0.1, "x"],
        [date(2024, 4, 3), 1.5, None, None],
    ]
    columns = "columns: {date: Datum, remarks: Bemerkung}"
    case = read(f"{DATES}{{file: r.xlsx, layout: wide, {columns}}}", workbook(rows))
    assert values(case)[:3] == [
        ("EX1.a5", "heading", 0.5),
        ("CV1", "heading", 1.0),
        ("EX1.a5", "bench 1", 1.5),
    ]
    assert case.readings[0].time == read_date("2024-03-02 07:30")
    assert case.readings[0].note == "x"


def test_the_dates_of_a_workbook_of_1904_are_the_same(read):
    book = workbook([["date", "CV1 (mm)"], [datetime(2024, 4, 3), 2.0]])
    book.epoch = openpyxl.utils.datetime.CALENDAR_MAC_1904
    case = read(DATES + "{file: r.xlsx, layout: wide}", book)
    assert case.readings[0].time == read_date("2024-04-03")


def test_sheet_header_rows_units_range_and_blanks_are_declared(read):
    rows = [
        ["Monitoring report 7", None, None, None, None, "x"],
        [None, "Extensometer", None, "Tape", None, None],
        ["Date", "a5", "a15", "CV1", "foreman", None],
        [None, "mm", "mm", "cm", None, None],
        ["serial", "no. 12", "no. 13", "no. 4", None, None],
        [datetime(2024, 3, 2), 0.5, "n/a", 0.1, "Meier", 99],
        [datetime(2024, 4, 2), 1.5, 2.5, "---", "Meier", 99],
        [None, None, None, "mean", 3.0, None],
    ]
    book = workbook(rows, sheet="March", at="C3", merged=["D4:E4"])
    book.create_sheet("Notes")
    case = read(
        DATES + "{file: r.xlsx, layout: wide, sheet: March, range: 'C3:G9', header_row: 4,\n"
        "  header_rows: 2, unit_row: true, data_row: 8, blank: [n/a, '---'],\n"
        "  columns: {date: Date}, channels: {EX1.a5: Extensometer a5, CV1: Tape CV1}}",
        book,
    )
    assert values(case) == [
        ("EX1.a5", "heading", 0.5),
        ("CV1", "heading", 1.0),
        ("EX1.a5", "bench 1", 1.5),
        ("CV1", "bench 1", None),
    ]


def test_a_cell_that_joins_rows_holds_for_each_of_them(read):
    rows = [
        ["gauge", "date", "value", "unit"],
        ["EX1.a5", datetime(2024, 3, 2), 0.5, "mm"],
        ["CV1", None, 0.1, "mm"],
    ]
    case = read(DATES + "{file: r.xlsx}", workbook(rows, merged=["B2:B3"]))
    assert values(case) == [("EX1.a5", "heading", 0.5), ("CV1", "heading", 0.1)]


@pytest.mark.parametrize("merged", ["B2:B3", "B2:C2", "B2:C3"])
def test_a_reading_in_a_cell_that_joins_several_is_nobodys(refused, merged):
    """It was taken for a reading of each row, and of the first of several columns."""
    rows = [
        ["date", "EX1.a5 (mm)", "CV1 (mm)"],
        [datetime(2024, 3, 2), 0.5, 1.5],
        [datetime(2024, 4, 2), 2.5, 3.5],
    ]
    faults = refused(DATES + "{file: r.xlsx, layout: wide}", workbook(rows, merged=[merged]))
    assert {fault.code for fault in faults} == {"joined-cell"}
    assert "the reading '0.5' stands in a cell that joins several" in faults[0].message
    assert faults[0].location.cell == "B2"


def changed_sheet(data, change):
    """The same workbook with another text of its sheet."""
    found = io.BytesIO()
    with zipfile.ZipFile(io.BytesIO(data)) as old, zipfile.ZipFile(found, "w") as new:
        for name in old.namelist():
            part = old.read(name)
            new.writestr(name, change(part) if name == "xl/worksheets/sheet1.xml" else part)
    return found.getvalue()


def saved(book):
    found = io.BytesIO()
    book.save(found)
    return found.getvalue()


@pytest.mark.parametrize("quote", [b'"', b"'"])
def test_a_workbook_that_joins_all_its_cells_is_refused_at_once(refused, quote):
    """openpyxl makes each of them: a file of 5 kB took 4 GB and minutes."""
    joins = b'</sheetData><mergeCells><mergeCell ref="A1:XFD1048576"/></mergeCells>'
    joins = joins.replace(b'"', quote)
    book = changed_sheet(saved(workbook(LONG)), lambda old: old.replace(b"</sheetData>", joins))
    (fault,) = refused("readings: r.xlsx", book)
    assert fault.code == "too-large"
    assert fault.message == "a sheet joins 17,179,869,184 cells, more than 200,000"


def test_a_number_beyond_all_numbers_is_no_reading(refused):
    """A workbook can hold 1e999, which was read as infinite."""
    data = saved(workbook(LONG))
    found = changed_sheet(data, lambda old: old.replace(b"<v>1.25</v>", b"<v>1e999</v>"))
    (fault,) = refused("readings: r.xlsx", found)
    assert str(fault.location).endswith("r.xlsx:Readings!C2")
    assert fault.code == "bad-number"


def test_a_cell_far_down_costs_nothing(read):
    """A blank left there by somebody: all cells above it were made, 105 s."""
    book = workbook(LONG)
    book.active["A900000"] = " "
    begun = time.process_time()
    assert len(read("readings: r.xlsx", book).readings) == 2
    assert time.process_time() - begun < 2.0


def test_a_sheet_that_unpacks_to_more_than_it_can_hold_is_refused(refused, monkeypatch):
    monkeypatch.setattr("geoident.io.readings.workbook.MAX_UNPACKED", 10_000)
    (fault,) = refused("readings: r.xlsx", workbook([*LONG, *[LONG[1]] * 100]))
    assert fault.code == "too-large"


@pytest.mark.parametrize("cell", ["1.5-", "1.5*", "1.5 *"])
def test_marks_behind_a_number_are_not_left_out(refused, cell):
    """Some programs write the sign there: 1.5- is -1.5, and was read as 1.5."""
    (fault,) = refused("readings: r.xlsx", workbook([*LONG, ["CV1", "heading", cell, "mm", None]]))
    assert "behind its number" in fault.message


def test_a_percentage_is_no_length(refused):
    book = workbook(LONG)
    book.active["C2"].number_format = "0.0%"
    (fault,) = refused("readings: r.xlsx", book)
    assert "'125 %' has a unit" in fault.message


def test_a_number_is_no_date(refused):
    rows = [["date", "CV1 (mm)"], [45352, 1.0], ["03.02.2024", 1.0]]
    faults = refused(DATES + "{file: r.xlsx, layout: wide}", workbook(rows))
    assert [fault.location.cell for fault in faults] == ["A2", "A3"]
    assert faults[0].message == "the cell holds the number 45352, not a date"
    assert "'03.02.2024' is not a date of the form YYYY-MM-DD" in faults[1].message


def test_stored_results_of_formulas_are_read(read, tmp_path):
    """As Excel stores them: the value beside the formula."""
    book = workbook(LONG)
    book.active["C2"] = "=5/4"
    book.save(tmp_path / "f.xlsx")
    found = io.BytesIO()
    with zipfile.ZipFile(tmp_path / "f.xlsx") as old, zipfile.ZipFile(found, "w") as new:
        for name in old.namelist():
            data = old.read(name)
            if name == "xl/worksheets/sheet1.xml":
                assert b"<f>5/4</f><v" in data
                data = data.replace(b"<f>5/4</f><v />", b"<f>5/4</f><v>1.25</v>")
                data = data.replace(b"<f>5/4</f><v/>", b"<f>5/4</f><v>1.25</v>")
            new.writestr(name, data)
    assert values(read("readings: r.xlsx", found.getvalue()))[0] == ("EX1.a5", "heading", 1.25)


@pytest.mark.parametrize(
    ("description", "book", "name", "words", "hint"),
    [
        ("{file: r.xlsx, sheet: Reading}", LONG, "r.xlsx", "no sheet 'Reading'", "'Readings'?"),
        ("r.xlsx", b"PK\x03\x04 broken", "r.xlsx", "not a readable Excel workbook", "save it"),
        ("r.xlsx", b"gauge,stage,value,unit\n", "r.xlsx", "not a readable Excel workbook", ""),
        ("r.xlsx", b"\xd0\xcf\x11\xe0\xa1\xb1", "r.xlsx", "encrypted or of the old", "(.xlsx)"),
        ("r.xls", b"\xd0\xcf\x11\xe0", "r.xls", "a .xls workbook cannot be read", "(.xlsx)"),
        ("r.ods", b"PK\x03\x04", "r.ods", "a .ods workbook cannot be read", "LibreOffice"),
        ("r.xlsx", [], "r.xlsx", "the file is empty", "gauge,stage,value,unit"),
    ],
)  # fmt: skip
def test_what_is_no_sheet_is_refused_with_the_remedy(refused, description, book, name, words, hint):
    given = book if isinstance(book, bytes) else workbook(book)
    (fault,) = refused(f"readings: {description}", given, name=name)
    assert words in fault.message
    assert hint in fault.hint


def test_one_of_several_sheets_must_be_named(refused):
    book = workbook(LONG)
    book.create_sheet("Notes")
    (fault,) = refused("readings: r.xlsx", book)
    assert fault.message == "the workbook has 2 sheets, and none is declared"
    assert fault.hint == "Add 'sheet: NAME': Readings, Notes."


@pytest.mark.parametrize(
    ("description", "path", "words"),
    [
        ("{file: r.csv, sheet: A}", "readings.sheet", "'sheet' belongs to an Excel workbook"),
        ("{file: r.csv, range: 'A1:B2'}", "readings.range", "'range' belongs to an Excel workbook"),
        ("{file: r.xlsx, range: 'B2:A1'}", "readings.range", "first cell is not the upper left"),
        ("{file: r.xlsx, encoding: utf-8}", "readings.encoding", "a workbook has its own"),
        ("{file: r.xlsx, header_row: 4, data_row: 4}", "readings.data_row", "not below the header"),
    ],
)  # fmt: skip
def test_keys_that_do_not_fit_are_refused(refused, description, path, words):
    (fault,) = refused(f"readings: {description}", workbook(LONG))
    assert fault.path == path
    assert words in fault.message


cells = (
    st.none() | st.text(max_size=8) | st.floats() | st.booleans() | st.integers(-9, 10**6)
    | st.datetimes(datetime(1900, 1, 1), datetime(2100, 1, 1))
    | st.sampled_from(["#REF!", "=A1", "gauge", "date", "value", "unit", "CV1", "mm", "CV1 (mm)"])
)  # fmt: skip


@settings(max_examples=20, deadline=None, suppress_health_check=list(HealthCheck))
@given(rows=st.lists(st.lists(cells, max_size=5), max_size=5), wide=st.booleans())
def test_any_cells_end_with_readings_or_faults(rows, wide, tmp_path):
    book = openpyxl.Workbook()
    for row in rows:
        with contextlib.suppress(ValueError, openpyxl.utils.exceptions.IllegalCharacterError):
            book.active.append(row)
    book.save(tmp_path / "r.xlsx")
    with contextlib.suppress(InputError):
        read_readings(str(tmp_path / "r.xlsx"), Layout(wide=wide, header_rows=1 + wide))


@settings(max_examples=20, deadline=None, suppress_health_check=list(HealthCheck))
@given(at=st.integers(0, 3000), spoiled=st.binary(min_size=1, max_size=40))
def test_spoiled_workbooks_end_with_readings_or_faults(at, spoiled, tmp_path):
    workbook(LONG).save(tmp_path / "r.xlsx")
    data = (tmp_path / "r.xlsx").read_bytes()
    at = min(at, len(data))
    (tmp_path / "r.xlsx").write_bytes(data[:at] + spoiled + data[at + len(spoiled) :])
    with contextlib.suppress(InputError):
        read_readings(str(tmp_path / "r.xlsx"), Layout())


@settings(max_examples=15, deadline=None, suppress_health_check=list(HealthCheck))
@given(data=st.data())
def test_spoiled_parts_end_with_readings_or_faults(data, tmp_path):
    """The parts of the archive are spoiled, so that it still opens and the XML is reached."""
    workbook(LONG).save(tmp_path / "r.xlsx")
    with zipfile.ZipFile(tmp_path / "r.xlsx") as old:
        parts = {name: old.read(name) for name in old.namelist()}
    name = data.draw(st.sampled_from(sorted(parts)))
    at = data.draw(st.integers(0, len(parts[name])))
    bit = data.draw(st.sampled_from([b"", b"<", b">", b'"', b"9", b"<c/>", b"</row>", b"\xff"]))
    parts[name] = parts[name][:at] + bit + parts[name][at + data.draw(st.integers(0, 9)) :]
    with zipfile.ZipFile(tmp_path / "r.xlsx", "w") as new:
        for key, part in parts.items():
            new.writestr(key, part)
    with contextlib.suppress(InputError):
        read_readings(str(tmp_path / "r.xlsx"), Layout())
