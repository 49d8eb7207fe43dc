"""The braced pit: a workbook as it is delivered, and what forces and shared errors are worth."""

from __future__ import annotations

import re
from collections import Counter
from math import log
from pathlib import Path

import openpyxl
import pytest

from geoident import fit, load_case
from geoident.io.case.file import read_case
from tests.support.commands import run_command

CASE = Path(__file__).parents[2] / "cases" / "braced-pit" / "case.yaml"


@pytest.fixture(scope="module")
def readings():
    return read_case(str(CASE)).case.readings


@pytest.fixture(scope="module")
def found(tmp_path_factory):
    """Fits the case with changes to it; the error of the mesh is small beside that of the model."""

    def find(name, **changes):
        output = tmp_path_factory.mktemp("pit") / f"{name}.h5"
        changes["fit.backtest"] = changes["fit.mesh_error"] = False
        return fit(load_case(str(CASE), changes), output=str(output))

    return find


@pytest.fixture(scope="module")
def as_shipped(found):
    return found("shipped")


def test_all_sheets_are_read_and_their_days_go_to_their_stages(readings):
    read = Counter((r.stage, r.channel.split(".")[0]) for r in readings if r.value is not None)
    depths = 14
    assert {read[stage, "I1"] for stage in ("dig 1", "dig 2", "strut 2", "dig 4")} == {depths}
    assert read["strut 1", "I1"] == 0  # not read on that day
    assert (read["dig 1", "L1"], read["dig 2", "L1"]) == (5, 4)  # one point was not accessible
    assert (read["strut 1", "LC1"], read["strut 1", "LC2"], read["dig 3", "LC2"]) == (1, 0, 1)


def test_two_days_of_a_stage_are_averaged_and_remarks_are_kept(readings):
    of = {(r.channel, r.stage): r for r in readings}
    assert of["I1.A0", "strut 2"].epochs == 2
    assert of["I1.A0", "dig 2"].epochs == 1
    assert "skip" in of["L1.P4", "dig 2"].note


def test_heights_become_settlements_since_the_zero(readings):
    sheet = openpyxl.load_workbook(CASE.with_name("readings.xlsx"))["Levelling"]
    heights = {row[0].date().isoformat(): row[2] for row in sheet.iter_rows(4, values_only=True)}
    of = {(r.channel, r.stage): r.value for r in readings}
    lost = heights["2025-03-04"] - heights["2025-03-17"]
    assert of["L1.P2", "dig 1"] == pytest.approx(lost, abs=1e-9)
    assert 0 < lost < 0.01  # m


def test_a_date_that_is_a_few_days_late_is_found_by_check():
    done = run_command("check", str(CASE), "--set", "dates.dig 2=2025-04-10")
    said = " ".join(done.stdout.split())
    assert "The stage 'dig 2' has no reading since it was complete" in said
    assert "most LC1: +245 kN from 2025-03-24 to 2025-04-09" in said


@pytest.mark.slow  # on a small model: tests/identification/test_load_cells.py
def test_load_cells_determine_the_stress_that_displacements_hardly_see(found, as_shipped):
    bad = [{"gauge": name, "reason": "try"} for name in ("LC1", "LC2")]
    without = found("without", bad=bad)
    ratio = without.parameters["K0_clay"].sd / as_shipped.parameters["K0_clay"].sd
    assert 2.1 < ratio < 3.5


@pytest.mark.slow  # in small: tests/identify/problem/test_shared_errors.py
def test_counted_as_independent_the_same_readings_promise_too_much(found, as_shipped):
    """Unless the model error takes what they do not explain."""
    changes = {"gauges.I1.accuracy": "0.3 mm", "gauges.L1.accuracy": "0.5 mm"}
    given = {"fit.model_error": "none"}
    independent = found("independent", **changes, **given)
    assert width(independent, "E_clay") < 0.5 * width(found("no-error", **given), "E_clay")
    assert inside(as_shipped, "dig 4") >= 0.95
    assert inside(independent, "dig 4") < 0.75
    estimated = found("estimated", **changes)
    assert estimated.data.model_error.lower95 > 0.02
    assert inside(estimated, "dig 4") > 0.85


def width(found, name):
    """Of the 95 % interval of a modulus, as a part of it."""
    parameter = found.parameters[name]
    return log(parameter.upper95 / parameter.lower95)


def inside(found, stage):
    """Part of the readings of a stage that lie in the bands of its prediction."""
    (note,) = (n for n in found.notes if n.startswith(f"Predicted stage '{stage}'"))
    match = re.search(r"(\d+) of (\d+) readings inside", note)
    return int(match[1]) / int(match[2])
