"""A channel of another quantity than length: the axial force of a bolt, from a file to a figure.

Nothing here asks what is read; the model is a stand-in with two stages and one parameter.
"""

import csv
import io
import json
import math
from dataclasses import replace

import numpy as np
import pytest
import xarray

from geoident.errors import InputError
from geoident.io.case.file import read_case
from geoident.io.case.gauges.accuracy import FORCES
from geoident.io.case.site_files.calendar import Calendar
from geoident.io.case.site_files.values import READ
from geoident.io.readings.file import parse_readings
from geoident.io.readings.layout import Layout, Origin
from geoident.io.result.file import read_result, write_result
from geoident.model.case import Stage
from geoident.model.gauges import Channel
from geoident.model.results.summary import CaseSummary, GaugeSummary
from geoident.report.drawing.gauges.course import readings_figure
from geoident.report.drawing.quality import one_to_one_figure
from geoident.report.text.case import case_text, gauge_quantity
from geoident.report.text.csv_tables import csv_tables, csv_text
from geoident.report.text.gauges import readings_csv
from geoident.report.text.instruments import instruments
from geoident.report.text.json import dumps, result_object, simulation_object
from geoident.report.text.result import result_text
from geoident.workflow.diff import numbers
from geoident.workflow.running.computed import gauge_table
from geoident.workflow.running.readings import reading_table
from tests.support.cases import make_case
from tests.support.results import example_result, grid_mesh
from tests.support.trench import CASE, write_case

TAPE = Channel("CV", "CV", "convergence", (0.0, 0.0), (4.0, 0.0), (1.0, 0.0), 1e-4, "virgin")
BOLT = Channel(
    "B1", "B1", "axial force", None, (1.0, 2.0), (0.0, 1.0), 2e3, "virgin", dimension="force",
    unit="kN",
)  # fmt: skip
FILE = (
    b"gauge,stage,value,unit,accuracy\nCV,drift,-4,mm,\nB1,drift,75.5,kN,3\nB1,bench 1,0.09,MN,\n"
)
LAYOUT = Layout(dimensions={"CV": "length", "B1": "force"})


@pytest.fixture
def result(tmp_path):
    """A result with both channels, as it comes back from its file."""
    base = example_result()
    mesh = grid_mesh(2)
    stages = tuple(Stage(name) for name in base.gauges.stages)
    case = make_case(
        mesh, stages=stages, channels=(TAPE, BOLT), readings=parse_readings(FILE, "r.csv", LAYOUT)
    )
    readings = reading_table(case, ["", "", "the stage is not in fit.stages"])
    computed = np.array([[-3.9e-3, -5e-3, -6e-3], [74e3, 88.25e3, 91e3]])
    sensitivity = np.ones((2, 3, 3))
    mean = np.where([False, True, True], computed, np.nan)
    made = {
        "gauges": gauge_table(case, readings, computed),
        "sensitivity": sensitivity,
        "prediction": type(base.prediction)(mean, 0.01 * abs(mean), 0.98 * mean, 1.02 * mean),
        "diagnostics": None,
        "fields": None,
        "case_resolved": "gauges: {CV: {kind: convergence}, B1: {kind: axial force}}\n",
    }
    write_result(replace(base, **made), tmp_path / "a.h5", overwrite=False)
    return read_result(tmp_path / "a.h5")


def test_readings_files_have_the_units_of_the_channel():
    rows = parse_readings(FILE, "r.csv", LAYOUT)
    assert [(r.value, r.accuracy) for r in rows] == [
        (pytest.approx(-4e-3), None),
        (pytest.approx(75.5e3), pytest.approx(3e3)),
        (pytest.approx(90e3), None),
    ]


def test_a_unit_of_another_quantity_is_refused_with_those_that_fit():
    with pytest.raises(InputError) as caught:
        parse_readings(b"gauge,stage,value,unit\nB1,drift,1,mm\n", "r.csv", LAYOUT)
    (fault,) = caught.value.faults
    assert fault.message == "'mm' is the unit of a length; expected a force"
    assert fault.hint == "Units of force: N, kN, MN, GN, kgf, tf, lbf, kip."


def test_wide_files_have_them_too():
    layout = Layout(wide=True, dimensions=LAYOUT.dimensions, channels={"B1": Origin("bolt")})
    rows = parse_readings(b"stage,bolt (kN)\ndrift,12\n", "r.csv", layout)
    assert [(r.channel, r.value) for r in rows] == [("B1", 12e3)]


def test_text_has_a_column_of_units(result):
    lines = [line.split() for line in result_text(result).splitlines()]
    assert ["gauge", "stage", "unit", "measured", "computed", "residual", "in", "sd"] in lines
    assert ["CV", "drift", "mm", "-4.00", "-3.90", "-0.10", "-1.0"] in lines
    assert ["B1", "drift", "kN", "75.50", "74.00", "1.50", "0.5"] in lines
    assert ["B1", "bench", "1", "kN", "88.2", "86.5", "90.0", "90.00", "inside"] in lines
    assert any(line[:2] == ["Predictions", "(95"] for line in lines)


def test_json_is_in_si_with_the_unit(result):
    found = json.loads(dumps(result_object(result, case="case.yaml", output="a.h5")))
    bolt = next(g for g in found["gauges"] if (g["gauge"], g["stage"]) == ("B1", "drift"))
    assert (bolt["measured"], bolt["computed"], bolt["sd"]) == (75.5e3, 74e3, 3e3)
    assert bolt["unit"] == "N"
    assert {p["gauge"]: p["unit"] for p in found["predictions"]} == {"B1": "N", "CV": "m"}


def test_csv_has_the_unit_of_each_row(result):
    tables = csv_tables(result)
    rows = list(csv.DictReader(io.StringIO(csv_text(tables["gauges"]))))
    bolt = next(row for row in rows if (row["gauge"], row["stage"]) == ("B1", "drift"))
    assert [bolt[k] for k in ("measured", "computed", "residual", "sd", "unit")] == [
        "75.5", "74", "1.5", "3", "kN",
    ]  # fmt: skip
    tape = next(row for row in rows if (row["gauge"], row["stage"]) == ("CV", "drift"))
    assert [tape[k] for k in ("measured", "unit")] == ["-4", "mm"]
    slopes = list(csv.DictReader(io.StringIO(csv_text(tables["sensitivity"]))))
    units = {(row["gauge"], row["parameter"]): row["unit"] for row in slopes}
    assert units["B1", "E_rock"] == "kN/GPa"
    assert units["CV", "E_rock"] == "mm/GPa"
    value = next(float(row["value"]) for row in slopes if row["gauge"] == "B1")
    assert value == pytest.approx(1e-3 * 1e9)  # 1 N/Pa
    bands = list(csv.DictReader(io.StringIO(csv_text(tables["prediction"]))))
    assert {row["unit"] for row in bands if row["gauge"] == "B1"} == {"kN"}


def test_the_result_file_has_the_unit_of_each_channel_and_reading(result, tmp_path):
    def table(group):
        return xarray.open_dataset(tmp_path / "a.h5", group=group, engine="h5netcdf")

    with table("readings") as readings:
        assert readings.unit.values.tolist() == ["m", "N", "N"]
        assert readings.value.values[1] == 75.5e3
    with table("gauges") as gauges:
        assert gauges.unit.values.tolist() == ["m", "N"]
        assert gauges.display_unit.values.tolist() == ["mm", "kN"]
        assert gauges.measured.attrs["unit"] == "SI, see /gauges/unit"
    assert result.gauges.dimensions == ("length", "force")


def test_figures_have_the_unit_on_their_axes(result):
    figure = readings_figure(result, instruments(result))
    labels = [axes.get_ylabel() for axes in figure.axes]
    assert labels[:2] == ["change of length (mm)", "force (kN)"]
    heights = [y for line in figure.axes[1].lines for y in np.atleast_1d(line.get_ydata())]
    assert 74.0 in [pytest.approx(float(y)) for y in heights if math.isfinite(y)]
    units = [axes.get_xlabel() for axes in one_to_one_figure(result).axes]
    assert units == ["measured (mm)", "measured (kN)"]
    assert gauge_quantity(result, "B1") == "force (kN)"


def test_differences_and_simulated_readings_know_their_unit(result):
    amounts = {place.item: amount for place, amount in numbers(result) if place.table == "readings"}
    assert (amounts["B1, drift"].dimension, amounts["B1, drift"].unit) == ("force", "kN")
    rows = parse_readings(FILE, "r.csv", LAYOUT)
    text = readings_csv(rows, (TAPE, BOLT))
    assert text.splitlines()[1:] == ["CV,drift,-4,mm", "B1,drift,75.5,kN", "B1,bench 1,90,kN"]
    again = parse_readings(text.encode(), "again.csv", LAYOUT)
    assert [r.value for r in again] == pytest.approx([r.value for r in rows])
    made = simulation_object(rows, (TAPE, BOLT), case="c", output=None)
    assert [r["unit"] for r in made["readings"]] == ["m", "N", "N"]


def test_check_has_the_accuracy_in_the_unit_of_each_gauge():
    gauges = tuple(
        GaugeSummary(c.name, c.kind, c.zero, c.accuracy, 1, 0, c.dimension, c.unit)
        for c in (TAPE, BOLT)
    )
    summary = CaseSummary(
        "c", "", "plane-strain", "m", 1, 1, (), (), gauges, (), (), (), (), 0, (), None, ()
    )
    lines = [line.split() for line in case_text(summary).splitlines()]
    assert ["CV", "convergence", "virgin", "0.1", "mm", "1", "0"] in lines
    assert ["B1", "axial", "force", "virgin", "2", "kN", "1", "0"] in lines


def test_readings_may_have_the_dimensions_of_all_kinds_of_gauges():
    assert set(READ) == {"length", "angle", "pressure", "strain", "temperature", *FORCES}


def test_a_reading_in_the_case_must_be_of_the_quantity_of_its_channel(tmp_path, monkeypatch):
    """As if a convergence were read in kN: the unit is held against the gauge, not the file."""
    monkeypatch.setattr(Calendar, "dimensions", {"CV": "force", "S": "length", "X.a": "length"})
    case = write_case(tmp_path)
    inline = "readings: [{gauge: CV, stage: first, value: -0.6 mm, accuracy: 1 mm}]"
    case.write_text(CASE.replace("readings: readings.csv", inline))
    with pytest.raises(InputError) as caught:
        read_case(str(case))
    assert [fault.path for fault in caught.value.faults] == [
        "readings[0].value",
        "readings[0].accuracy",
    ]
    assert caught.value.faults[0].message == "'-0.6 mm' is a length; expected a force"
