"""What went where, from a dated sheet to `check`, its JSON, and the remarks in a result."""

import openpyxl
import pytest

from geoident import fit
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
