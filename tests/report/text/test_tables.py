"""CSV and JSON of one result: units, differences, percentages, and what is empty or null."""

import csv
import json
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from geoident.errors import Fault, InputError, Location
from geoident.model.gauges import Reading
from geoident.model.results.comparison import Amount, Comparison, Difference, Place
from geoident.model.results.findings import Finding
from geoident.model.results.mesh_error import MeshError
from geoident.model.results.posterior import PosteriorDraws
from geoident.model.results.result import MemberForces
from geoident.model.results.summary import Identifiability
from geoident.model.results.varied import FieldEstimate
from geoident.report.text.comparison import comparison_object, comparison_text
from geoident.report.text.csv_tables import csv_tables, csv_text
from geoident.report.text.errors.mesh_error import mesh_error_table
from geoident.report.text.json import (
    dumps,
    failure_object,
    identifiability_object,
    result_object,
    simulation_object,
)
from geoident.report.text.posterior import posterior_table
from geoident.report.text.structures import force_table
from geoident.report.text.varied import varied_table
from geoident.units import in_unit
from geoident.workflow.estimating.diagnosis import why_poor
from geoident.workflow.estimating.wrong_readings import gross_findings
from tests.io.result.conftest import make_advance
from tests.support.cases import displacement
from tests.support.results import example_result, small_result

NAN = np.nan


@pytest.fixture(scope="module")
def result():
    known = example_result()
    sensitivity = np.full((5, 3, 3), NAN)
    sensitivity[2, 1] = [-2e-13, 5e-11, 3e-3]  # m/Pa, m/Pa, m
    members = MemberForces(
        ("wall",), np.array([4]), ("drift",), np.zeros((1, 2, 2)), np.array([[-1234.5]]),
        np.array([[[50.0], [-75.0]]]), np.array([[2500.0]]), np.array([True]),
        np.array([[NAN]]), np.array([[NAN]]),
    )  # fmt: skip
    return replace(known, sensitivity=sensitivity, members=members)


def table(result, name):
    """The rows of a CSV table by their header."""
    return list(csv.DictReader(csv_text(csv_tables(result)[name]).splitlines()))


def numbers(row, *names):
    return [float(row[name]) for name in names]


def test_parameters_stand_in_their_units(result):
    rock, stress, ratio = table(result, "parameters")
    found = numbers(rock, "value", "sd", "lower95", "upper95", "start", "lower", "upper")
    assert found == pytest.approx([12.34, 0.4, 11.6, 13.1, 20.0, 2.0, 80.0])
    assert (rock["unit"], rock["at_bound"], rock["determined"]) == ("GPa", "no", "yes")
    assert rock["prior"] == "14 +- 2.5 (lognormal)"
    assert [stress[k] for k in ("value", "sd", "lower95", "determined")] == ["", "", "", "no"]
    assert numbers(stress, "start", "upper") == pytest.approx([8.0, 20.0])
    assert (ratio["unit"], ratio["at_bound"], ratio["prior"]) == ("", "yes", "")


def test_readings_stand_in_mm_with_residuals_in_accuracies(result):
    rows = {(row["gauge"], row["stage"]): row for row in table(result, "gauges")}
    assert len(rows) == 15
    off = rows["EX-1.a8", "bench 1"]
    found = numbers(off, "measured", "computed", "residual", "sd", "residual_in_sd")
    assert found == pytest.approx([1.9, 1.1, 0.8, 0.1, 8.0])
    assert (off["unit"], off["used"], rows["CV-1", "bench 2"]["used"]) == ("mm", "yes", "no")
    unread = rows["CV-1", "drift"]
    assert [unread[k] for k in ("measured", "residual", "sd", "residual_in_sd")] == [""] * 4


def test_predictions_stand_in_mm_and_are_empty_where_not_determined(result):
    rows = {row["gauge"]: row for row in table(result, "prediction")}
    found = numbers(rows["EX-1.a2"], "predicted", "sd", "lower95", "upper95", "measured")
    assert found == pytest.approx([0.8, 0.15, 0.8 - 1.96 * 0.15, 0.8 + 1.96 * 0.15, 0.7])
    assert rows["ST-1"]["predicted"] == ""
    assert float(rows["ST-1"]["measured"]) == pytest.approx(3.5)


def test_sensitivities_are_per_unit_of_the_parameter(result):
    rows = {row["parameter"]: row for row in table(result, "sensitivity")}
    assert float(rows["E_rock"]["value"]) == pytest.approx(-0.2)  # -2e-13 m/Pa in mm/GPa
    assert float(rows["sigma_v"]["value"]) == pytest.approx(0.05)  # 5e-11 m/Pa in mm/MPa
    assert float(rows["K0"]["value"]) == pytest.approx(3.0)
    assert [row["unit"] for row in rows.values()] == ["mm/GPa", "mm/MPa", "mm"]


def test_units_with_a_slash_are_bracketed_in_quotients(result):
    heavy = replace(
        result.parameters, units=("kN/m3", "MPa", ""), dimensions=("unit weight", "pressure", "")
    )
    first = table(replace(result, parameters=heavy), "sensitivity")[0]
    assert first["unit"] == "mm/(kN/m3)"
    assert float(first["value"]) == pytest.approx(-2e-13 * 1e3 * 1e3)


def test_the_grid_has_a_row_for_every_point_and_no_misfit_where_there_is_no_solution():
    rows = table(small_result(), "grid")
    found = [numbers(row, "E_rock [GPa]", "K0") for row in rows]
    assert found == [[E, K0] for E in (10.0, 20.0) for K0 in (0.5, 1.0, 2.0)]
    assert [row["objective"] for row in rows] == ["9", "4", "5", "6", "2", ""]


def test_correlations_and_diagnostics_are_those_of_the_tables(result):
    rows = {row["parameter"]: row for row in table(result, "correlation")}
    assert rows["E_rock"]["K0"] == rows["K0"]["E_rock"] == "-0.8"
    assert rows["sigma_v"]["K0"] == ""
    worst = table(result, "diagnostics")[0]
    assert (worst["gauge"], worst["stage"]) == ("EX-1.a8", "bench 1")
    names = ("standardized", "studentized", "weight", "leverage", "distance", "influence_K0")
    assert numbers(worst, *names) == pytest.approx([8.0, 8.0, 0.5, 0.5, 64.0, 0.4])


def test_programs_get_si_units_and_null_for_what_is_not_known(result):
    found = json.loads(dumps(result_object(result, case="case.yaml", output="x.h5")))
    rock, stress = found["parameters"]["E_rock"], found["parameters"]["sigma_v"]
    assert (rock["value"], rock["unit"], rock["upper95"]) == (1.234e10, "Pa", 1.31e10)
    assert (stress["value"], stress["sd"], stress["determined"]) == (None, None, False)
    readings = {(r["gauge"], r["stage"]): r for r in found["gauges"]}
    off = readings["EX-1.a8", "bench 1"]
    assert (off["measured"], off["computed"], off["sd"]) == pytest.approx((1.9e-3, 1.1e-3, 1e-4))
    assert (off["used"], off["bad"], readings["CV-1", "drift"]["measured"]) == (True, False, None)
    predicted = {p["gauge"]: p for p in found["predictions"]}
    band = [predicted["EX-1.a2"][k] for k in ("mean", "sd", "lower95", "upper95", "measured")]
    assert band == pytest.approx([8e-4, 1.5e-4, 8e-4 - 2.94e-4, 8e-4 + 2.94e-4, 7e-4])
    assert [predicted["ST-1"][k] for k in ("mean", "sd", "determined")] == [None, None, False]
    assert (found["objective"], found["exit_code"], found["output"]) == (12.5, 4, "x.h5")
    assert found["counts"] == {
        "evaluations": 5,
        "analyses": 1,
        "factorizations": 12,
        "solves": 40,
        "iterations": 0,
    }
    assert found["structures"][0]["N"] == -1234.5
    assert "grid" not in found
    scan = json.loads(dumps(result_object(small_result(), case="c", output="o")))
    assert scan["grid"]["objective"][1] == [6.0, 2.0, None]
    assert scan["grid"]["axes"]["E_rock"] == [1e10, 2e10]


def test_plans_and_simulations_are_in_si_units(result):
    plan = Identifiability(
        result.parameters, (Finding("not-determined", "", "So."),), np.array([3.0, 0.5]), 42
    )
    found = json.loads(dumps(identifiability_object("case.yaml", plan)))
    assert (found["readings"], found["singular_values"]) == (42, [3.0, 0.5])
    assert found["parameters"]["K0"]["value"] == 3.0
    readings = [Reading("CV", "end", 0.0125), Reading("EX", "end", None)]
    channels = [displacement(name, (), ()) for name in ("CV", "EX")]
    made = simulation_object(readings, channels, case="c", output=None)
    assert [(r["value"], r["unit"]) for r in made["readings"]] == [(0.0125, "m"), (None, "m")]


def test_a_failure_has_its_faults_with_their_places():
    fault = Fault("E12", "no such gauge", "add it", Location("case.yaml", 3, 7), "gauges")
    found = failure_object(InputError([fault]), case="case.yaml")
    assert (found["status"], found["exit_code"], found["objective"]) == ("failed", 3, None)
    (told,) = found["faults"]
    assert [told[k] for k in ("code", "message", "hint", "file", "line", "column", "path")] == [
        "E12", "no such gauge", "add it", "case.yaml", 3, 7, "gauges",
    ]  # fmt: skip
    assert failure_object(InputError([fault, fault]), case="c")["faults"] == [told, told]


def comparison(**changes):
    first, second = Amount(10e9, "pressure", "GPa"), Amount(12.5e9, "pressure", "GPa")
    differences = (
        Difference(Place("parameters", "E", "value"), first, second),
        Difference(Place("gauges", "CV, end", "computed"), None, Amount(2e-3, "length", "mm")),
        Difference(Place("gauges", "EX, end", "computed"), Amount(2e-3, "length", "mm"), None),
    )
    given = {"first": "a.h5", "second": "b.h5", "statuses": ("converged", "done"), "compared": 40}
    return Comparison(**{**given, "differences": differences, **changes})


def test_differences_are_in_the_unit_and_percent_of_the_larger():
    lines = [line.split() for line in comparison_text(comparison()).splitlines()]
    assert ["E", "value", "10", "12.5", "2.5", "20", "%", "GPa"] in lines
    assert ["CV,", "end", "computed", "-", "2", "only", "in", "B", "mm"] in lines
    assert ["EX,", "end", "computed", "2", "-", "only", "in", "A", "mm"] in lines
    assert "Status: converged in A, done in B" in comparison_text(comparison())
    assert comparison_text(comparison()).endswith("Different: 3 of 40 numbers.")
    same = comparison(differences=(), statuses=("done", "done"))
    assert comparison_text(same).endswith("The same: 40 numbers agree.")
    assert "Status" not in comparison_text(same)


def test_programs_get_differences_in_si_units():
    E, only_b, only_a = comparison_object(comparison())["differences"]
    assert (E["first"], E["second"], E["unit"], E["relative"]) == (10e9, 12.5e9, "Pa", 0.2)
    assert (only_b["first"], only_b["second"], only_b["relative"]) == (None, 2e-3, None)
    assert (only_a["second"], only_a["unit"]) == (None, "m")
    falling = Difference(Place("a", "b", "c"), Amount(-4.0, "", ""), Amount(-1.0, "", ""))
    (told,) = comparison_object(comparison(differences=(falling,)))["differences"]
    assert told["relative"] == pytest.approx(0.75)
    zero = Difference(Place("a", "b", "c"), Amount(0.0, "", ""), Amount(0.0, "", ""))
    assert comparison_object(comparison(differences=(zero,)))["differences"][0]["relative"] == 0.0


def test_a_face_that_goes_on_is_in_tables_and_json(result):
    """What each stage releases, and what was lost before the first reading."""
    given = replace(result, advance=make_advance())
    first, far = table(given, "face")
    assert [first["stage"], far["stage"]] == ["first reading", "far on"]
    columns = ("distance (m)", "share_of_motion", "released_stress")
    assert numbers(first, *columns) == [2.0, 0.825, 0.9]
    assert numbers(far, *columns) == [8.0, 0.9773, 0.99]
    assert [first["zero_of_gauges"], far["zero_of_gauges"]] == ["yes", "no"]
    curve = [
        numbers(row, "distance (m)", "share_of_motion") for row in table(given, "face-profile")
    ]
    assert curve == [[0.0, 0.25], [2.0, 0.825], [8.0, 0.9773]]
    said = json.loads(dumps(result_object(given, case="case.yaml", output="out.h5")))["face"]
    assert (said["profile"], said["radius"], said["lost"]) == ("panet", 2.5, 0.825)
    assert said["curve"] == {"distance": [0.0, 2.0, 8.0], "share": [0.25, 0.825, 0.9773]}
    assert said["stages"][1] == {
        "stage": "far on", "distance": 8.0, "share": 0.9773, "released": 0.99, "zero": False,
    }  # fmt: skip
    never = replace(make_advance(), stage_zero=np.array([False, False]))
    assert result_object(replace(result, advance=never), case="", output="")["face"]["lost"] is None
    assert "face" not in result_object(result, case="", output="")
    assert not {"face", "face-profile"} & set(csv_tables(result))


def test_parts_of_accuracies_variances_and_motions_are_percent():
    mesh = MeshError(
        ("CV",), ("drift",), np.array([[2e-4]]), np.array([[8e-4]]), ("mm",), ("length",),
        "refinement", np.array([[1e-2]]), np.array([[1e-4]]), 2.0, (10, 40),
    )  # fmt: skip
    (row,) = mesh_error_table(mesh).rows
    assert tuple(row) == ("CV", "drift", "10", "0.1", "0.2", "0.8", "mm", "25 %")
    field = FieldEstimate(
        "rock.E", "rock", "E", "pressure", "GPa", np.arange(2), np.zeros((2, 2)),
        np.array([2e9, 3e9]), np.full(2, 0.1), np.full(2, 0.3), np.array([0.2, 0.62]), 3, 0.9,
    )  # fmt: skip
    assert "62 %" in varied_table([field]).rows[0]
    error = SimpleNamespace(kind="estimated", size=2.0, lower95=1.3, upper95=3.8, large=True)
    calm = SimpleNamespace(above=1.0, misfit=1.0)
    said = why_poor(calm, np.zeros(0, dtype=int), error)
    assert "200 % of the computed motion (95 %: 130 to 380 %)" in said


def test_draws_have_their_mean_and_deviation_in_the_unit():
    values = 1e10 + 2e9 * np.random.default_rng(3).standard_normal((1, 4000, 1))
    draws = PosteriorDraws(
        ("E_rock",), ("",), values, np.zeros((1, 4000)), "importance", 0.1, np.array([4000.0]),
        np.array([NAN]), 0.9, 5000, (), (), np.zeros((1, 1, 0)), np.zeros(1, dtype=int),
    )  # fmt: skip
    table = posterior_table(replace(example_result(2), posterior=draws))
    row = dict(zip(table.header, table.rows[0], strict=True))
    assert (float(row["mean"]), float(row["sd"])) == pytest.approx((10.0, 2.0), rel=0.02)
    assert row["unit"] == "GPa"


def test_forces_of_shells_go_from_the_least_to_the_largest():
    hoop = np.array([[-3e5], [1e5]])
    members = MemberForces(
        ("shell", "shell"), np.array([1, 2]), ("drift",), np.zeros((2, 2, 2)), hoop,
        np.zeros((2, 2, 1)), np.zeros((2, 1)), np.array([True, True]), hoop, np.full((2, 1), NAN),
    )  # fmt: skip
    table = force_table(members)
    row = dict(zip(table.header, table.rows[0], strict=True))
    assert (row["N from"], row["N to"]) == ("-300", "100")
    assert (row["hoop N from"], row["hoop N to"]) == ("-300", "100")


def test_a_grossly_wrong_reading_is_said_as_it_was_written():
    channel = displacement("CV", (0.0, 0.0), (1.0, 0.0))
    case = SimpleNamespace(
        channels=(channel,),
        readings=(Reading("CV", "drift", -0.25, location=Location("r.csv", 3, 1)),),
    )
    table = SimpleNamespace(channel=("CV",), stage=("drift",), value=np.array([-0.25]))
    (gross,) = gross_findings(np.array([0]), table, case)
    shown = in_unit(-0.25, channel.unit, channel.dimension)
    assert f"CV at drift (r.csv:3:1: {shown:.4g} {channel.unit})" in gross.sentence
    assert gross.subject == "CV"
    assert "-" in f"{shown:.4g}"
