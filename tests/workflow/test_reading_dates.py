"""What went where, from a dated sheet to `check`, its JSON, and the remarks in a result."""

import openpyxl
import pytest

from geoident import fit
from geoident.errors import InputError
from geoident.io.result.file import read_result
from geoident.report.text.case import case_text
from geoident.report.text.csv_tables import csv_tables
from geoident.report.text.gauges import each_reading, fit_table
from geoident.report.text.json import summary_object
from geoident.workflow.check import check
from tests.support.trench import write_case

ROWS = [
    ["date", "CV (mm)", "S (mm)", "X.a (mm)", "remarks"],
    ["2024-03-01", -0.598, -0.1226, 0.0627, "after rain"],
    ["2024-03-20", -0.6, None, None, None],
    ["2024-04-01", -1.077, 0.0376, 0.282, None],
]


@pytest.fixture
def case(tmp_path):
    """The trench with readings of a workbook, and stages dated by the test."""

    def make(first, second):
        path = write_case(tmp_path)
        book = openpyxl.Workbook()
        for row in ROWS:
            book.active.append(row)
        book.save(tmp_path / "r.xlsx")
        dates = f"dates: {{first: {first}, second: {second}}}\n"
        text = path.read_text()
        entry = "readings: {file: r.xlsx, layout: wide}"
        path.write_text(text.replace("readings: readings.csv", dates + entry))
        return str(path)

    return make


def test_right_dates_are_shown_and_nothing_is_found(case):
    summary = check(case("2024-03-01", "2024-04-01")).summary
    assert not [note for note in summary.notes if "Inside" in note or "no reading since" in note]
    text = case_text(summary)
    assert "stage   complete on  readings  channels  first       last        nearer to the" in text
    assert "first   2024-03-01          4         3  2024-03-01  2024-03-20" in text
    assert "second  2024-04-01          3         3  2024-04-01  2024-04-01" in text


def test_late_dates_are_seen_in_text_and_json(case):
    summary = check(case("2024-03-04", "2024-04-04")).summary
    assert "first   2024-03-04          4         3  2024-03-20  2024-04-01" in case_text(summary)
    virgin, first, second = summary_object(summary)["when_read"]
    assert (virgin["stage"], virgin["complete"], virgin["number"]) == ("virgin", None, 3)
    assert (first["first"], first["between"]) == ("2024-03-20T00:00:00", 4)
    assert (second["complete"], second["number"], second["first"]) == (
        "2024-04-04T00:00:00",
        0,
        None,
    )
    notes = " ".join(summary.notes)
    assert "3 readings count for 'first' (2024-03-04), the last stage that was complete" in notes
    assert "taken on 2024-04-01" in notes
    assert "Inside 'first' the channel changes by more than 4 standard deviations" in notes
    assert "most CV: -0.477 mm from 2024-03-20 to 2024-04-01" in notes
    assert "The stage 'second' has no reading since it was complete (2024-04-04)." in notes


def test_remarks_go_with_the_readings_into_the_result(case, tmp_path):
    fit(case("2024-03-01", "2024-04-01"), output=tmp_path / "r.h5")
    kept = read_result(tmp_path / "r.h5")
    assert kept.gauges.readings.notes == ("", "after rain", "after rain", "", "", "")
    remarks = [row[-1] for row in fit_table(kept).rows if row[0] == "S"]
    assert remarks == ["after rain"]  # the other stage is not of the fit
    (table,) = [table for name, table in csv_tables(kept).items() if name == "readings"]
    at = table.header.index("note")
    assert [row[at] for row in table.rows] == list(kept.gauges.readings.notes)
    assert each_reading(kept.gauges)[1].note == "after rain"


def dated(tmp_path, pattern, rows, fitted="first, second"):
    """The notes of a case with a file of dated readings; the stages end in March and April."""
    path = write_case(tmp_path)
    text = path.read_text().replace(
        "readings: readings.csv",
        "dates: {first: 2024-03-01, second: 2024-04-10}\n"
        f"readings: {{file: r.csv, layout: wide, date_format: {pattern}}}",
    )
    path.write_text(text.replace("stages: [first]", f"stages: [{fitted}]"))
    lines = ["date,CV (mm),S (mm),X.a (mm)", *rows]
    (tmp_path / "r.csv").write_text("\n".join([*lines, ""]))
    return " ".join(check(str(path)).summary.notes)


SPRING = ("03.02.2024,-0.598,-0.1226,0.0627", "04.11.2024,-1.077,0.0376,0.282")
"""Of 2 March and 11 April, the month first."""


def test_days_and_months_in_each_others_place_are_seen(tmp_path):
    notes = dated(tmp_path, "DD.MM.YYYY", SPRING)
    assert "The dates of 'r.csv', read as DD.MM.YYYY, lie outside those of the stages" in notes
    assert "2024-03-01 to 2024-04-10 (3 of them are" in notes
    assert "r.csv:3:1). Read as MM.DD.YYYY they are in order and within" in notes
    assert "check 'date_format'" not in dated(tmp_path, "MM.DD.YYYY", SPRING)


def test_dates_that_leave_too_few_readings_are_said_in_the_refusal(tmp_path):
    with pytest.raises(InputError, match=r"too few|cannot determine") as caught:
        dated(tmp_path, "DD.MM.YYYY", SPRING, fitted="first")
    assert "Read as MM.DD.YYYY they are in order" in caught.value.faults[0].hint


def test_dates_that_go_back_are_seen(tmp_path):
    rows = [SPRING[0], "04.01.2024,-0.9,0.01,0.2"]  # 2 March, 1 April; as days first January
    notes = dated(tmp_path, "DD.MM.YYYY", rows)
    assert "go back (from 2024-02-03 to 2024-01-04 in" in notes
    assert "check 'date_format'" not in dated(tmp_path, "MM.DD.YYYY", rows)


def test_a_late_reading_alone_says_nothing_of_the_format(tmp_path):
    """The other way round it would lie outside, too, or is none: 25 is no month."""
    rows = ["02.03.2024,-0.598,-0.1226,0.0627", "25.12.2024,-1.077,0.0376,0.282"]
    assert "check 'date_format'" not in dated(tmp_path, "DD.MM.YYYY", rows)


@pytest.mark.parametrize(("zero", "counts"), [("virgin", True), ("first", False)])
def test_a_series_that_begins_with_0_was_perhaps_zeroed_there(tmp_path, zero, counts):
    path = write_case(tmp_path)
    path.write_text(path.read_text().replace("[1 m, 4 m],", f"[1 m, 4 m], zero: {zero},"))
    readings = path.with_name("readings.csv")
    readings.write_text(readings.read_text().replace("S,first,-0.1226", "S,first,0.00"))
    said = (
        "The first reading of S, at 'first', is 0. It is used as a reading: no motion since the "
        "zero at 'virgin'. If it is the zero reading itself, write 'zero: first' at the gauge; if "
        "nothing was read then, leave its value empty."
    )
    summary = check(str(path)).summary
    assert (said in summary.notes) == counts
    assert summary.used == (3 if counts else 2)
