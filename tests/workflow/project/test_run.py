"""A project from its file to its result: equal to one stack, resumed, kept, predicted."""

import json
import math
import shutil
from dataclasses import fields, replace
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner
from scipy.optimize import least_squares
from support.external import EXTERNAL, PROGRAM, PYTHON, SCRIPT, write_case
from support.projects import MESHED, SECTIONS, example, meshed, trenches, without

from geoident import fit_project as fit_project_here
from geoident import read_project
from geoident.cli.app import geoident
from geoident.cli.commands.export import OF_PROJECTS
from geoident.errors import ExitCode, Interrupted
from geoident.io.result.project import read_project_result
from geoident.model.results.findings import sentences_of
from geoident.report.text.project.spreadsheet import project_tables
from geoident.workflow.estimating.setup import prepare, used_response
from geoident.workflow.fit import fit
from geoident.workflow.programs.trust import decided_by, trusting
from geoident.workflow.project.plan import ProjectRequest, plan_project
from geoident.workflow.project.run import fit_project
from geoident.workflow.running.control import Control, Monitor
from geoident.workflow.running.jobs import Request, plan_fit


def fitted(path, **options):
    return fit_project(plan_project(ProjectRequest(path, **options)), Control()).result


FEW = ("km 2", "km 4", "km 5", "km 7", "km 10")


@pytest.fixture(scope="module", params=[FEW, pytest.param((), marks=pytest.mark.slow)], ids=str)
def shipped(tmp_path_factory, request):
    """The shipped project without some of its sections, and what it left out one by one."""
    path = example(tmp_path_factory.mktemp("shipped"), without(*request.param))
    return fitted(path, leave_one_out=True)


def two_sections(folder):
    """The path of a project of two sections whose errors are those of the gauges, as stated."""
    path = example(folder, SECTIONS)
    section = Path(path).with_name("section.yaml")
    section.write_text(section.read_text("utf-8") + "  model_error: none\n", "utf-8")
    return path


@pytest.fixture(scope="module")
def two(tmp_path_factory):
    """The path of a project of two sections, and its fit, which several tests look at."""
    path = two_sections(tmp_path_factory.mktemp("two"))
    return path, fitted(path)


def test_shared_parameters_over_two_cases_are_one_stack(two):
    """Against scipy on the responses of the two cases, put together by hand."""
    path, result = two
    responses, measured, sd = [], [], []
    for name, gsi in (("km-1", 34.0), ("km-2", 52.0)):
        case = str(Path(path).with_name("section.yaml"))
        setup = prepare(plan_fit(Request(case, overrides=(f"readings={name}.csv",))))
        responses.append((used_response(setup), gsi))
        measured.append(setup.readings.value)
        sd.append(setup.readings.sd)

    def residuals(x):
        log_a, b, k0 = x
        parts = [
            (one.readings(np.array([np.exp(log_a + b * gsi), k0])) - y) / s
            for (one, gsi), y, s in zip(responses, measured, sd, strict=True)
        ]
        return np.concatenate(parts)

    known = least_squares(
        residuals, [np.log(1e9), 0.03, 1.0], xtol=1e-15, ftol=1e-15, gtol=1e-15, x_scale="jac"
    )
    found = {row.name: row.value for row in result.common}
    np.testing.assert_allclose([np.log(found["a"]), found["b"], found["K0"]], known.x, rtol=1e-6)
    np.testing.assert_allclose(result.objective, 2 * known.cost, rtol=1e-7)


def test_notes_of_all_sections_stand_alone_and_those_of_some_under_their_names(two):
    _, result = two
    forms = [note for note in result.notes if "closed form of a circular opening" in note]
    assert len(forms) == 1
    assert forms[0].startswith("closed form")
    own = [note for note in result.notes if note.startswith(("km 1: ", "km 2: "))]
    assert all(note.partition(": ")[2] not in result.notes for note in own)


def test_the_shipped_project_finds_its_law_and_predicts(shipped):
    common = {row.name: row for row in shipped.common}
    assert shipped.status == "converged"
    assert common["K0"].lower95 <= 1.4 <= common["K0"].upper95
    assert common["a"].lower95 <= 0.6e9 <= common["a"].upper95
    assert common["b"].lower95 <= 0.045 <= common["b"].upper95
    assert shipped.laws[0].lower95 <= 0.25 <= shipped.laws[0].upper95
    assert all(row.inside for row in shipped.readings if not row.used)
    left_out = shipped.left_out_readings
    assert len(left_out) == 4 * len({row.section for row in left_out}) >= 16
    assert sum(row.inside for row in left_out) >= 0.87 * len(left_out)


def test_a_section_lies_between_its_law_and_what_it_says_by_itself(shipped):
    for row in shipped.parameters:
        if row.kind == "law" and not math.isnan(row.alone):
            assert 0.0 <= row.shrinkage < 0.2
            assert row.lower95 < row.value < row.upper95


def test_a_result_is_read_as_it_was_written(two):
    path, result = two
    again = read_project_result(Path(path).with_name("project.fit.h5"))
    for entry in fields(result):
        if entry.name in ("history", "provenance"):
            continue
        np.testing.assert_equal(
            [_plain(row) for row in _rows(getattr(again, entry.name))],
            [_plain(row) for row in _rows(getattr(result, entry.name))],
        )
    assert [one.objective for one in again.history] == [one.objective for one in result.history]
    assert again.provenance.identity == result.provenance.identity


def _rows(value):
    return value if isinstance(value, tuple) else (value,)


def _plain(row):
    return vars(row) if hasattr(row, "__dict__") else row


def test_a_result_of_the_same_input_is_kept_and_one_of_other_input_set_aside(two, tmp_path):
    shutil.copytree(Path(two[0]).parent, tmp_path, dirs_exist_ok=True)
    path, run = str(tmp_path / "project.yaml"), CliRunner()
    assert "up to date" in run.invoke(geoident, ["fit", path]).stderr
    example(tmp_path, SECTIONS.replace("GSI: 34", "GSI: 35"))
    again = run.invoke(geoident, ["fit", path])
    assert "project.fit.1.h5" in again.stderr
    assert (tmp_path / "project.fit.1.h5").is_file()
    (tmp_path / "km-2.csv").write_text((tmp_path / "km-3.csv").read_text())
    assert "up to date" not in run.invoke(geoident, ["fit", path]).stderr


class Stops(Monitor):
    """Asks to stop at the third iteration."""

    def __init__(self, control):
        self.control, self.count = control, 0

    def step(self, iteration):
        self.count += 1
        if self.count == 3:
            self.control.stop.ask(ExitCode.INTERRUPTED)


def test_an_interrupted_fit_goes_on_from_its_checkpoint(two, tmp_path):
    path = two_sections(tmp_path)
    control = Control()
    stopping = replace(control, monitor=Stops(control))
    with pytest.raises(Interrupted, match="continues from there"):
        fit_project(plan_project(ProjectRequest(path)), stopping)
    checkpoint = tmp_path / "project.fit.checkpoint"
    assert checkpoint.stat().st_size > 1000
    whole = fitted(path)
    assert not checkpoint.exists()
    assert not list(tmp_path.glob("*.checkpoint*"))
    fresh = two[1]
    assert whole.common == fresh.common
    assert whole.counts.evaluations < fresh.counts.evaluations


def test_commands_say_what_came_out(tmp_path):
    path = example(tmp_path, SECTIONS)
    run = CliRunner()
    plan = run.invoke(geoident, ["fit", path, "--dry-run"])
    assert "2 sections to fit, 1 to predict" in plan.stdout
    assert not (tmp_path / "project.fit.h5").exists()
    found = run.invoke(geoident, ["fit", path, "--json", "-q"])
    assert found.exit_code == 0, found.output
    said = json.loads(found.stdout)
    assert said["status"] == "converged"
    assert set(said["common"]) == {"K0", "a", "b"}
    assert [one["name"] for one in said["sections"]] == ["A", "B", "C"]
    shown = run.invoke(geoident, ["show", said["output"]])
    assert "a * exp(b * GSI)" in shown.stdout
    assert "C: predicted readings" in shown.stdout
    assert json.loads(run.invoke(geoident, ["show", said["output"], "--json"]).stdout) == said
    assert run.invoke(geoident, ["fit", path, path]).exit_code == ExitCode.USAGE
    assert run.invoke(geoident, ["fit", path, "--set", "title=x"]).exit_code == ExitCode.USAGE
    case = str(tmp_path / "section.yaml")
    assert run.invoke(geoident, ["fit", case, "--leave-one-out"]).exit_code == ExitCode.USAGE
    refused = run.invoke(geoident, ["predict", said["output"]])
    assert refused.exit_code == ExitCode.INVALID_INPUT
    assert "the result of several sections" in refused.stderr


@pytest.mark.slow  # what is said: test_findings.py; how it is found: tests/identify/hierarchical
def test_a_section_of_other_ground_is_named(tmp_path):
    path = example(tmp_path)
    wrong = (tmp_path / "km-3.csv").read_text().splitlines()
    rows = [line.split(",") for line in wrong]
    scaled = [rows[0], *([r[0], r[1], f"{6 * float(r[2]):.2f}", r[3]] for r in rows[1:])]
    (tmp_path / "km-3.csv").write_text("".join(",".join(row) + "\n" for row in scaled))
    result = fitted(path)
    assert [
        text
        for text in sentences_of(result.findings)
        if text.startswith("The section km 3 does not fit")
    ]
    assert not [
        text for text in sentences_of(result.findings) if text.startswith("The section km 5")
    ]


def test_too_few_sections_do_not_tell_the_scatter(tmp_path):
    result = fitted(example(tmp_path, SECTIONS.replace("scatter: none", "scatter: estimate")))
    assert result.status == "not-determined"
    assert result.laws[0].state == "not determined"
    assert any(
        "is not determined: there are too few" in text for text in sentences_of(result.findings)
    )


@pytest.mark.parametrize("real", [False, pytest.param(True, marks=pytest.mark.slow)])
def test_sections_on_meshes_are_computed_in_processes(tmp_path, request, real):
    """Two elastic sections on a mesh: in two processes as in this one."""
    if not real:
        request.getfixturevalue("answered_here")
    path = trenches(tmp_path)
    here = fitted(path, jobs=1)
    processes = fitted(path, jobs=2, fresh=True)
    for one, other in zip(here.common, processes.common, strict=True):
        np.testing.assert_allclose(one.value, other.value, rtol=1e-9)
    found = {row.name: row.value for row in processes.common}
    np.testing.assert_allclose(
        [found["K0"], found["a"], found["b"]], [1.4, 0.6e9, 0.045], rtol=2e-3
    )


@pytest.mark.slow  # one section: tests/forward/openings
def test_formulas_meet_readings_of_a_mesh(tmp_path):
    """The truth is on a mesh of finite extent; sections in closed form find its law nonetheless."""
    meshed(tmp_path)
    example(tmp_path)
    gauges = ["D0,CV0", "D90,CV90"]
    text = SECTIONS.replace("km-1", "a").replace("km-2", "b")
    for name in "AB":
        rows = (tmp_path / f"{name}.csv").read_text()
        for pair in gauges:
            rows = rows.replace(*pair.split(","))
        kept = [row for row in rows.splitlines() if not row.startswith("D45")]
        (tmp_path / f"{name.lower()}.csv").write_text("\n".join(kept) + "\n")
    # the chamber on the mesh has 3 m, that of the formulas as well
    section = (tmp_path / "section.yaml").read_text().replace("2.5", "1.5")
    (tmp_path / "section.yaml").write_text(section.replace("5.5 m", "4.5 m"))
    text = text.replace("a.csv}", "a.csv, in_situ.vertical: 8 MPa}")
    text = text.replace("b.csv}", "b.csv, in_situ.vertical: 5 MPa}")
    (tmp_path / "project.yaml").write_text(text)
    found = {row.name: row.value for row in fitted(str(tmp_path / "project.yaml")).common}
    np.testing.assert_allclose(
        [found["K0"], found["a"], found["b"]], [1.4, 0.6e9, 0.045], rtol=0.03
    )


def test_check_says_what_is_wrong_with_every_section(tmp_path):
    path = example(tmp_path, SECTIONS)
    run = CliRunner()
    found = run.invoke(geoident, ["check", path])
    assert found.exit_code == 0, found.output
    assert "law: E_rock = a * exp(b * GSI) (scatter: none)" in found.stdout
    said = json.loads(run.invoke(geoident, ["check", path, "--json"]).stdout)
    assert [one["readings"] for one in said["sections"]] == [4, 4, 0]
    wrong = SECTIONS.replace("km-1.csv}", "km-1.csv, gauges.EX0.zero: nowhere}")
    wrong = wrong.replace("km-2.csv}", "km-2.csv, gauges.EX90.zero: nowhere}")
    refused = run.invoke(geoident, ["check", example(tmp_path, wrong)])
    assert refused.exit_code == ExitCode.INVALID_INPUT
    assert "project.yaml:4:" in refused.stderr
    assert "project.yaml:5:" in refused.stderr
    assert run.invoke(geoident, ["check", path, "--identifiability"]).exit_code == ExitCode.USAGE


@pytest.mark.usefixtures("answered_here")
def test_a_section_on_a_mesh_that_does_not_fit_is_said_where_it_is(tmp_path):
    trenches(tmp_path)
    wrong = MESHED.replace("B.csv,", "B.csv, gauges.CV.between: [[-99, 0 m], [99, 0 m]],")
    (tmp_path / "project.yaml").write_text(wrong)
    for command in ("check", "fit"):
        found = CliRunner().invoke(geoident, [command, str(tmp_path / "project.yaml")])
        assert found.exit_code == ExitCode.INVALID_INPUT, command
        assert "project.yaml:4:" in found.stderr, command


def test_tables_hold_what_was_found_in_the_units_of_the_cases(two, shipped):
    tables = project_tables(shipped)
    assert tuple(tables) == OF_PROJECTS
    common = {row[0]: row for row in tables["common"].rows}
    found = {row.name: row for row in shipped.common}
    assert common["a"][2:4] == ("GPa", pytest.approx(found["a"].value / 1e9))
    rows = [dict(zip(tables["section-readings"].header, row, strict=True))
            for row in tables["section-readings"].rows]  # fmt: skip
    for row, one in zip(rows, shipped.readings, strict=True):
        assert row["unit"] == "mm"
        np.testing.assert_allclose(row["computed"], 1e3 * one.computed)
        assert row["inside"] in ("", True, False)
    path, folder = two[0], Path(two[0]).parent
    run = CliRunner()
    result = run.invoke(geoident, ["fit", path]).stdout.strip()
    shown = run.invoke(geoident, ["show", result, "--csv"])
    assert "# section-parameters\nsection,parameter,kind,unit,value" in shown.stdout
    written = run.invoke(geoident, ["export", result]).stdout.split()
    assert len(written) == 6
    (only,) = [file for file in written if file.endswith("project.fit.common.csv")]
    alone = run.invoke(geoident, ["export", result, "--table", "common"])
    assert alone.stdout == (folder / only).read_text()
    assert run.invoke(geoident, ["export", result]).exit_code == 0  # as they were made
    for words in (["--format", "vtu"], ["--table", "left-out-readings"]):
        assert run.invoke(geoident, ["export", result, *words]).exit_code == ExitCode.USAGE


def test_a_project_is_fitted_from_python(tmp_path):
    path = example(tmp_path, SECTIONS)
    found = fit_project_here(path, leave_one_out=True)
    assert found.converged
    assert found.common["K0"].lower95 < 1.4 < found.common["K0"].upper95
    assert found.laws["E_rock"].state == "none"
    assert found.sections["C"].predicted
    assert all(row.lower95 < row.computed < row.upper95 for row in found.sections["C"].readings)
    assert found.sections["A"].parameters["E_rock"].kind == "law"
    assert set(found.left_out) <= {"A", "B"}
    assert len(found.tables["section-parameters"]) == 6
    with pytest.raises(KeyError, match="there is no section 'D'"):
        found.sections["D"]
    assert "a * exp(b * GSI)" in str(found)
    again = fit_project_here(path, leave_one_out=True)
    assert again.up_to_date
    assert read_project(found.path).common == again.common
    assert len(found.export(tmp_path / "tables")) == len(found.tables)


ELSEWHERE = """\
format: geoident-project/1
sections:
  - {name: A, case: A/case.yaml}
  - {name: B, case: B/case.yaml}
shared: [E, K0]
"""


@pytest.mark.parametrize("kind", ["external", "python", "table"])
def test_sections_whose_model_is_elsewhere_are_one_stack(tmp_path, monkeypatch, kind):
    """Two sections of the same readings: the values of one, and a standard deviation by sqrt 2."""
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path / "state"))
    model = {"external": EXTERNAL, "python": PYTHON, "table": TABLE}[kind]
    for name in "AB":
        case = write_case(tmp_path / name, model, script=SCRIPT if kind == "python" else PROGRAM)
        text = case.read_text().replace("backtest: false", "backtest: false, model_error: none")
        text = text.replace("[1 GPa, 50 GPa]", "[2 GPa, 30 GPa]").replace(
            "[0.3, 3.0]", "[0.4, 2.4]"
        )
        case.write_text(text)
        write_runs(tmp_path / name)
    (tmp_path / "project.yaml").write_text(ELSEWHERE)
    run, path = CliRunner(), str(tmp_path / "project.yaml")
    if kind != "table":
        refused = run.invoke(geoident, ["fit", path])
        assert refused.exit_code == ExitCode.INVALID_INPUT
        assert "it is not trusted yet" in refused.stderr
    done = run.invoke(geoident, ["fit", path, "--trust"])
    assert done.exit_code in (0, ExitCode.NOT_CONVERGED), done.output
    found = {row.name: row for row in read_project_result(tmp_path / "project.fit.h5").common}
    with decided_by(trusting(trust=True)):
        alone = fit(plan_fit(Request(str(tmp_path / "A" / "case.yaml"))), Control()).result
    names = list(alone.parameters.names)
    for name, row in found.items():
        k = names.index(name)
        np.testing.assert_allclose(row.value, alone.parameters.values[k], rtol=2e-3)
        np.testing.assert_allclose(row.sd, alone.parameters.sd[k] / math.sqrt(2), rtol=0.35)


TABLE = """\
format: geoident-case/1
model: {kind: table, file: runs.csv}
"""


def write_runs(folder):
    """A grid of runs of the script."""
    names = {}
    exec(SCRIPT, names)
    lines = []
    for E in np.geomspace(2e9, 30e9, 9):
        for K in np.linspace(0.4, 2.4, 7):
            given = names["readings"]({"E": E, "K0": K})
            values = [1e3 * given[g][s] for g in "HVD" for s in ("half", "open")]
            lines.append(",".join(map(repr, map(float, (E / 1e9, K, *values)))))
    head = ",".join(f"{g} @ {s} [mm]" for g in "HVD" for s in ("half", "open"))
    (folder / "runs.csv").write_text("\n".join([f"E [GPa],K0,{head}", *lines, ""]))
