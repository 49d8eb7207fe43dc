"""Readings from CSV files, as spreadsheets and loggers write them."""

import pytest

from geoident.errors import InputError, Location
from geoident.io.readings.file import parse_readings, read_readings
from geoident.io.readings.layout import Layout
from geoident.model.gauges import Reading


def readings(text):
    content = text if isinstance(text, bytes) else text.encode()
    return [
        Reading(row.channel, row.stage, row.value, row.accuracy, row.location)
        for row in parse_readings(content, "r.csv")
    ]


def refused(text, layout=None):
    content = text if isinstance(text, bytes) else text.encode()
    with pytest.raises(InputError) as caught:
        parse_readings(content, "r.csv", layout)
    return caught.value.faults


HEAD = "gauge,stage,value,unit\n"
HEAD5 = "gauge,stage,value,unit,accuracy\n"


def test_values_and_accuracies_are_in_the_unit_of_their_row():
    assert readings(HEAD5 + "EX1.a5,bench 1,1.5,mm,0.1\nCV1,bench 2,-2e-1,cm,\n") == [
        Reading("EX1.a5", "bench 1", 1.5e-3, pytest.approx(1e-4), Location("r.csv", 2, 1)),
        Reading("CV1", "bench 2", -2e-3, None, Location("r.csv", 3, 1)),
    ]


def test_blank_values_are_kept():
    rows = readings(HEAD5 + "A,b,,mm,\nB,b,,,\nC,b,,\n")
    assert [(row.channel, row.value, row.accuracy) for row in rows] == [
        ("A", None, None),
        ("B", None, None),
        ("C", None, None),
    ]


def test_comments_blank_lines_marks_and_windows_lines_are_fine():
    text = "\ufeff# from site\r\n\r\nGauge , stage,unit,value\r\n # note\r\nA, b ,mm, 1\r\n,,,\r\n"
    assert readings(text) == [Reading("A", "b", 1e-3, None, Location("r.csv", 5, 1))]


def test_columns_without_name_and_cells_are_none():
    text = "gauge,,stage,value,unit,,,\nA,,b,1,mm,,,\nA,,c,2,mm\n"
    assert [(row.stage, row.value) for row in readings(text)] == [("b", 1e-3), ("c", 2e-3)]


def test_a_file_without_header_has_one_fault_and_a_column_without_name_another():
    (fault,) = refused("A,b,1,mm\nA,c,2,mm\n")
    assert "not a header" in fault.message
    (fault,) = refused("gauge,stage,value,unit,\nA,b,1,5,mm\nA,c,1,5,mm\n")
    assert "decimal comma" in fault.hint


def test_quoted_names_hold_commas_and_quotes():
    (row,) = readings(HEAD + '"A ""1""","bench 1, left",1,mm\n')
    assert (row.channel, row.stage) == ('A "1"', "bench 1, left")


@pytest.mark.parametrize(
    ("text", "line", "column", "words"),
    [
        ("", 0, 0, "the file is empty"),
        ("# only a comment\n", 0, 0, "gauge,stage,value,unit"),
        ("gauge,stage,valeu,unit\n", 1, 13, "Did you mean 'value'?"),
        ("A,b,1,mm\n", 1, 1, "put a header above it: gauge,stage,value,unit"),
        ("sensor,stage,value,unit\n", 1, 1, "Did you mean 'gauge'?"),
        ("gauge,stage,value\n", 1, 1, "columns missing in the header: unit"),
        ("gauge,stage,value,unit,unit\n", 1, 24, "twice"),
        ("gauge;stage;value;unit\n", 1, 1, "semicolons"),
        (HEAD + "A,b,one,mm\n", 2, 5, "'one' is not a number"),
        (HEAD + "A,b,nan,mm\n", 2, 5, "not a finite number"),
        (HEAD + "A,b,-inf,mm\n", 2, 5, "not a finite number"),
        (HEAD + "A,b,1.5 mm,mm\n", 2, 5, "Units stand in the column 'unit'"),
        (HEAD + 'A,b,"1,5",mm\n', 2, 6, "Write '1.5'"),
        (HEAD + "A,b,1,5,mm\n", 2, 9, "decimal comma"),
        (HEAD5 + "A,b,1,5,mm\n", 2, 7, "decimal comma"),
        (HEAD + "A,b,1,mmm\n", 2, 7, "Did you mean 'mm'?"),
        (HEAD + "A,b,1,MPa\n", 2, 7, "expected a length"),
        (HEAD + "A,b,1,\n", 2, 7, "no unit; expected a length"),
        (HEAD + "A,b,1\n", 2, 6, "3 columns"),
        ("gauge,stage,value,unit,,\nA,b,1,mm,,\nA,c,1,mm,,7\n", 3, 11, "column 6 has no name"),
        (HEAD + ",b,1,mm\n", 2, 1, "name of the gauge is missing"),
        (HEAD + "A,,1,mm\n", 2, 3, "name of the stage is missing"),
        (HEAD5 + "A,b,1,mm,0\n", 2, 10, "not positive"),
        (HEAD + '"A,b,1,mm\n', 2, 1, "quote"),
        (HEAD + 'A"x",b,1,mm\n', 2, 1, "quote"),
        (HEAD.encode() + b"\xc4,b,1,mm\n", 2, 1, "not UTF-8"),
    ],
)
def test_faults_are_said_at_their_cells(text, line, column, words):
    fault = refused(text)[0]
    assert words in f"{fault.message} {fault.hint}"
    assert fault.location == Location("r.csv", line, column)


def test_a_column_for_each_gauge_is_one_fault_with_the_line_to_write():
    layout = Layout(dimensions={"P1": "length", "P2": "length"})
    (fault,) = refused("date,P1 (mm),P2 (mm)\n2024-03-01,1,2\n", layout)
    assert fault.location == Location("r.csv", 1, 6)
    assert "readings: {file: r.csv, layout: wide}" in fault.hint


def test_all_faults_are_said_at_once_up_to_a_hundred():
    assert len(refused(HEAD + "A,b,x,mm\nA,b,y,mmm\n")) == 3
    faults = refused(HEAD + "A,b,x,mm\n" * 1000)
    assert len(faults) == 101
    assert faults[-1].message == "and 900 more faults"


def test_a_file_with_more_than_a_million_rows_is_refused_before_it_is_parsed():
    (fault,) = refused(b"\n" * 1_000_001)
    assert "more than 1,000,000 rows" in fault.message


def test_a_file_that_cannot_be_read_is_refused(tmp_path):
    with pytest.raises(InputError, match="readings file cannot be read"):
        read_readings(str(tmp_path))


@pytest.mark.parametrize(
    ("rows", "words", "at"),
    [
        ("CV2,bench 1,1,mm\n", "Did you mean 'CV1'?", (2, 1)),
        ("EX1,bench 1,1,mm\n", "one reading for each of its channels: EX1.a5", (2, 1)),
        ("CV1,bench1,1,mm\n", "Did you mean 'bench 1'?", (2, 5)),
        ("CV1,virgin,1,mm\n", "before the first stage", (2, 5)),
        ("CV1,bench 1,1,mm\nCV1,bench 1,2,mm\n", "readings.csv:2:1", (3, 1)),
    ],
)
def test_names_must_be_those_of_the_case(rows, words, at, project):
    text = project.read().text
    (project.folder / "readings.csv").write_text(HEAD + rows, encoding="utf-8")
    (fault,) = project.faults(text)
    assert words in f"{fault.message} {fault.hint}"
    assert fault.location == Location(project.readings_file, *at)


def test_nothing_is_read_before_the_zero_of_its_gauge(project, changed):
    (project.folder / "readings.csv").write_text(HEAD + "CV1,heading,1,mm\n", encoding="utf-8")
    (fault,) = project.faults(changed("zero: heading", "zero: bench 1"))
    assert "read at 'heading', before its zero at 'bench 1'" in fault.message
    assert fault.location == Location(project.readings_file, 2, 5)


def test_inline_readings_are_checked_alike(project, changed):
    text = changed("readings.csv", "[{gauge: CV1, stage: «benhc 1, value: 1 mm}]")
    fault = project.only_fault(text)
    assert fault.path == "readings[0].stage"
    assert "Did you mean 'bench 1'?" in fault.hint
