"""What is said of a section alone is said of it in a project, too."""

import json
import re

import numpy as np
import pytest
from support.commands import run_command
from support.projects import SECTIONS, example
from support.settlement_plates import days_of, hyperbola, measured, settlement, write_plate

from geoident.workflow.project import run

PROJECT = """\
format: geoident-project/1
sections:
  - {name: east, case: east/case.yaml}
  - {name: west, case: west/case.yaml}
shared: [m]
"""


@pytest.fixture
def project(tmp_path):
    """What a project of two plates says, of truths and numbers of readings."""

    def fitted(*truths, count=24, more=""):
        rng = np.random.default_rng(0)
        for name, truth in zip(("east", "west"), truths, strict=True):
            (tmp_path / name).mkdir()
            days = days_of(rng, count)
            write_plate(
                tmp_path / name, days, measured(rng, truth, days), fitted=len(days), more=more
            )
        (tmp_path / "project.yaml").write_text(PROJECT)
        return json.loads(run_command("fit", tmp_path / "project.yaml", "--json", "-q").stdout)

    return fitted


def test_residuals_that_come_in_runs(project):
    """The east creeps, which its model does not know; the west is as its model has it."""
    creeps = settlement(np.random.default_rng(100))
    result = project(creeps, hyperbola(), more=", model_error: none")
    found = [one for one in result["findings"] if one["kind"] == "correlated-residuals"]
    assert [one["subject"] for one in found] == ["east, P"]
    assert found[0]["sentence"].startswith("In the section east by itself: Residuals of P come")


def test_the_line_that_helps_against_runs_does(project, tmp_path):
    creeps = settlement(np.random.default_rng(100))
    before = project(creeps, hyperbola(), more=", model_error: none")
    (found,) = [one for one in before["findings"] if one["kind"] == "correlated-residuals"]
    (line,) = re.findall(r"Write '(model_error: \{time: .*?\})' under 'fit'", found["sentence"])
    case = tmp_path / "east" / "case.yaml"
    case.write_text(case.read_text("utf-8").replace("model_error: none", line), "utf-8")
    after = json.loads(run_command("fit", tmp_path / "project.yaml", "--json", "-q").stdout)
    assert "correlated-residuals" not in [one["kind"] for one in after["findings"]]
    assert after["common"]["m"]["sd"] > 1.5 * before["common"]["m"]["sd"]


def test_the_line_that_is_proposed_states_the_model_error_of_all_sections(project, tmp_path):
    before = project(hyperbola(), hyperbola())
    (said,) = [note for note in before["notes"] if "All sections together" in note]
    assert "write 'model_error: 30 %' under 'fit' of the cases" in said
    for name in ("east", "west"):
        case = tmp_path / name / "case.yaml"
        text = case.read_text("utf-8")
        case.write_text(text.replace("backtest: false", "backtest: false, model_error: 30 %"))
    after = json.loads(run_command("fit", tmp_path / "project.yaml", "--json", "-q").stdout)
    assert not [note for note in after["notes"] if "All sections together" in note]
    assert after["common"]["m"]["sd"] > 2.0 * before["common"]["m"]["sd"]


def test_sections_of_few_readings_have_a_model_error_together(project):
    """Three readings beside two parameters say nothing of it; those of two sections do."""
    result = project(hyperbola(), hyperbola(), count=3)
    (said,) = [note for note in result["notes"] if "All sections together" in note]
    assert "% of the motion" in said


@pytest.mark.parametrize(("factor", "least", "most"), [(1.0, 0.0, 15.0), (1.6, 20.0, 60.0)])
def test_how_far_the_models_of_all_sections_are_from_the_ground(tmp_path, factor, least, most):
    """The readings are those of the model, or all vertical closures are 60 % larger."""
    path = example(tmp_path, SECTIONS)
    for file in tmp_path.glob("km-*.csv"):
        head, *rows = (line.split(",") for line in file.read_text("utf-8").splitlines())
        for row in rows:
            row[2] = f"{float(row[2]) * (factor if row[0] == 'CV0' else 1.0):.3f}"
        file.write_text("".join(",".join(row) + "\n" for row in (head, *rows)), "utf-8")
    result = json.loads(run_command("fit", path, "--json", "-q").stdout)
    (said,) = [note for note in result["notes"] if "All sections together" in note]
    size = float(re.search(r"a model error of ([\d.]+) % of the motion", said)[1])
    assert least <= size <= most


def test_turns_that_do_not_come_to_rest(tmp_path, monkeypatch):
    monkeypatch.setattr(run, "TURNS", 1)
    path = example(tmp_path, SECTIONS)
    result = json.loads(run_command("fit", path, "--json", "-q").stdout)
    (said,) = [one for one in result["findings"] if one["kind"] == "model-error-doubt"]
    assert "did not come to rest" in said["sentence"]
    assert "'model_error: 15 %' under 'fit' of the cases" in said["sentence"]


@pytest.mark.parametrize(("stated", "words"), [(0.1, "less"), (1.0, None), (12.0, "more")])
def test_a_section_whose_accuracies_are_off_is_named_with_the_line_to_write(
    tmp_path, stated, words
):
    """One of four plates states them ten times too good, as they are, or far too bad."""
    rng, names = np.random.default_rng(1), ("east", "west", "north", "south")
    for name in names:
        (tmp_path / name).mkdir()
        days = days_of(rng)
        readings = measured(rng, hyperbola(), days)
        case = write_plate(tmp_path / name, days, readings, fitted=len(days))
    text = case.read_text("utf-8")
    assert "accuracy: 5 mm" in text
    case.write_text(text.replace("accuracy: 5 mm", f"accuracy: {5 * stated:g} mm"), "utf-8")
    rows = [f"  - {{name: {name}, case: {name}/case.yaml}}\n" for name in names]
    head = "format: geoident-project/1\nsections:\n"
    (tmp_path / "project.yaml").write_text(head + "".join(rows) + "shared: [m]\n")
    result = json.loads(run_command("fit", tmp_path / "project.yaml", "--json", "-q").stdout)
    off = [one for one in result["findings"] if one["kind"] == "accuracy"]
    assert [one["subject"] for one in off] == (["south"] if words else [])
    for one in off:
        assert f"times {words} accurate than its case states" in one["sentence"]
        (size,) = re.findall(r"write 'accuracy: (\S+) mm' for P in", one["sentence"])
        assert 3.0 <= float(size) <= 8.0
