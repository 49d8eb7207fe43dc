"""Identification by the closed form of an opening: alone, without a mesh, and as a start."""

from __future__ import annotations

import csv
import json
import shutil
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from support.cases import model, rollers
from support.commands import run_command
from support.meshes import box, opening, regroup
from support.yielding import constant, mohr, rock

from geoident.errors import InputError, ModelError
from geoident.forward.model import StagedModel
from geoident.identify.least_squares.closed_form import closed_form
from geoident.identify.problem.methods import identify
from geoident.identify.problem.problem import Problem
from geoident.io.result.file import read_result
from geoident.model.case import Stage
from geoident.model.gauges import Channel
from geoident.model.methods import ClosedFormOptions, GaussNewtonOptions
from geoident.model.parameter import Parameter, Scalar
from geoident.model.results.costs import Counts
from tests.support.commands import said_findings

MPa = 1e6
CASE = """\
format: geoident-case/1
title: Round tunnel behind its face, no mesh
analysis: plane-strain
parameters:
  c: {start: 2 MPa, bounds: [0.2 MPa, 10 MPa], scale: log}
  phi: {start: 30 deg, bounds: [10 deg, 50 deg]}
  E: {start: 5 GPa, bounds: [1 GPa, 50 GPa], scale: log}
materials:
  rock:
    elastic: isotropic
    E: $E
    nu: 0.25
    yield: {type: mohr-coulomb, cohesion: $c, friction: $phi, dilation: 5 deg}
groups: {rock: rock, tunnel: rock}
in_situ: {model: heim, vertical: 20 MPa, K0: 1.0}
stages:
  - {name: face, excavate: [tunnel], release: {tunnel: 0.4}}
  - {name: near, release: {tunnel: 0.8}}
  - {name: far, release: {tunnel: 1.0}}
gauges:
  CV: {kind: convergence, between: [[-2.5 m, 0 m], [2.5 m, 0 m]], accuracy: 0.05 mm}
  EX: {kind: extensometer, head: [0 m, 2.5 m], anchors: {a1: [0 m, 3.2 m], a6: [0 m, 8.5 m]}, \
accuracy: 0.05 mm}
readings: readings.csv
fit:
  method: closed-form
  closed-form: {centre: [0 m, 0 m], radius: 2.5 m}
"""
TRUTH = {"c": "3 MPa", "phi": "25 deg", "E": "8 GPa"}
SI = {"c": 3 * MPa, "phi": np.deg2rad(25), "E": 8e9}


@pytest.fixture(scope="module")
def shipped(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, dict]:
    """The folder of a case without mesh, the readings of its truth, and its fit as it comes."""
    folder = tmp_path_factory.mktemp("closed")
    (folder / "case.yaml").write_text(CASE)
    true = [f"--set=parameters.{name}.start={value}" for name, value in TRUTH.items()]
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(folder)
        readings = run_command("simulate", "case.yaml", *true)
        assert readings.exit_code == 0, readings.stderr
        (folder / "readings.csv").write_text(readings.stdout)
        return folder, json.loads(run_command("fit", "case.yaml", "--json").stdout)


@pytest.fixture
def project(shipped, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """The same case and readings in a folder of their own."""
    monkeypatch.chdir(tmp_path)
    for name in ("case.yaml", "readings.csv"):
        shutil.copy(shipped[0] / name, tmp_path)
    return tmp_path / "case.yaml"


ALONE = ("--set=fit.backtest=false", "--set=fit.model_error=none", "--set=fit.closed-form.starts=4")
"""For what asks of the answer alone."""


def fitted(*arguments: str) -> dict:
    said = run_command("fit", "case.yaml", "--json", "--force", *ALONE, *arguments)
    return json.loads(said.stdout)


def test_strength_and_modulus_are_recovered(shipped):
    found = shipped[1]
    for name, truth in SI.items():
        assert found["parameters"][name]["value"] == pytest.approx(truth, rel=1e-6)
    assert found["objective"] < 1e-10
    assert found["counts"]["factorizations"] == 0


@pytest.mark.parametrize(
    "method", ["gauss-newton", pytest.param("simplex", marks=pytest.mark.slow)]
)
def test_every_method_works_on_the_formulas(project, method):
    # closed-form is gauss-newton with many starts; one start and the simplex find it from here too
    few = ("--set=fit.simplex.delta=1e-4", "--set=fit.simplex.restarts=0")
    found = fitted(f"--set=fit.method={method}", *few)
    assert found["parameters"]["c"]["value"] == pytest.approx(SI["c"], rel=1e-3)


def test_strength_and_far_stress_are_recovered(project):
    text = CASE.replace("E: $E", "E: 8 GPa").replace("vertical: 20 MPa", "vertical: $s")
    text = text.replace(
        "  E: {start: 5 GPa, bounds: [1 GPa, 50 GPa], scale: log}",
        ("  s: {start: 12 MPa, bounds: [5 MPa, 50 MPa]}"),
    )
    project.write_text(text)
    found = fitted()
    for name, truth in {"c": SI["c"], "phi": SI["phi"], "s": 20 * MPa}.items():
        assert found["parameters"][name]["value"] == pytest.approx(truth, rel=1e-6)


def test_one_convergence_determines_no_strength(project):
    """One reading of the wall tells one combination of c and phi, and that is said."""
    project.write_text(
        CASE.replace("E: $E", "E: 8 GPa").replace(
            "  E: {start: 5 GPa, bounds: [1 GPa, 50 GPa], scale: log}\n", ""
        )
    )
    rows = (project.parent / "readings.csv").read_text().splitlines()
    kept = [row for row in rows if row.startswith(("gauge", "CV,far", "CV,face"))]
    (project.parent / "readings.csv").write_text("\n".join(kept))
    found = fitted()
    assert found["status"] == "not-determined"
    assert not found["parameters"]["c"]["determined"]
    assert any("c and phi" in finding for finding in said_findings(found))


@pytest.mark.usefixtures("plain_pictures")
def test_every_command_works_without_a_mesh(shipped, monkeypatch):
    monkeypatch.chdir(shipped[0])
    for words in (
        ("check", "case.yaml"),
        ("check", "case.yaml", "--identifiability"),
        ("show", "case.fit.h5"),
        ("show", "case.fit.h5", "--json"),
        ("predict", "case.fit.h5"),
        ("scan", "case.yaml", "--set", "fit.scan.points=4"),
        ("report", "case.fit.h5"),
        ("export", "case.fit.h5", "--format", "csv", "-o", "tables"),
        ("fit", "case.yaml", "--dry-run", "--force"),
    ):
        done = run_command(*words)
        assert done.exit_code == 0, (words, done.stderr)
    assert "closed form of a circular opening" in run_command("check", "case.yaml").stdout
    said = run_command("show", "case.fit.h5").stdout
    assert "the ground yields up to" in said
    assert "radius 2.5 m" in said


def test_the_closed_form_is_exported(shipped, monkeypatch):
    """The tables, the object and the result file say the same of the opening."""
    monkeypatch.chdir(shipped[0])
    found = read_result("case.fit.h5").reaction

    def table(name):
        text = run_command("export", "case.fit.h5", "--table", name).stdout
        return list(csv.DictReader(text.splitlines()))

    stages, curve, stresses = (table(n) for n in ("opening", "ground-reaction", "opening-stresses"))
    assert [row["stage"] for row in stages] == list(found.stages)
    shown = [1e-3 * float(row["wall_inwards (mm)"]) for row in stages]
    assert shown == pytest.approx(found.stage_displacement)
    assert [1e6 * float(row["pressure (MPa)"]) for row in curve] == pytest.approx(found.pressure)
    radii = [float(row["plastic_radius (m)"] or "nan") for row in curve]
    assert radii == pytest.approx(found.plastic_radius, nan_ok=True)
    hoop = [1e6 * float(row["hoop_compression (MPa)"]) for row in stresses]
    assert hoop == pytest.approx(found.hoop.ravel())
    said = json.loads(run_command("show", "case.fit.h5", "--json").stdout)["opening"]
    assert said["stages"][-1]["displacement"] == found.stage_displacement[-1]
    assert said["stresses"]["radial"][found.stages[0]] == found.radial[0].tolist()
    assert said["radius"] == 2.5


def test_what_a_case_without_mesh_lacks_is_said(project):
    project.write_text(CASE.replace(", radius: 2.5 m", ""))
    refused = run_command("check", "case.yaml")
    assert refused.exit_code == 3
    assert "there is no mesh" in refused.stderr
    project.write_text(
        CASE.replace("type: mohr-coulomb", "type: drucker-prager").replace(", dilation: 5 deg", "")
    )
    refused = run_command("check", "case.yaml")
    assert refused.exit_code == 3
    assert "other yield limits than one of Mohr-Coulomb or Hoek-Brown" in refused.stderr
    project.write_text(CASE)
    assert run_command("check", "case.yaml", "--picture", "x.svg").exit_code == 2


E, C = (Scalar(1.0, name) for name in ("E", "c"))
TRUE = np.array([6e9, 1.2 * MPa])
UNKNOWN = (
    Parameter("E", 3e9, 1e9, 50e9, "log"),
    Parameter("c", 6 * MPa, 0.3 * MPa, 20 * MPa, "log"),
)


def gauge(name: str, first: tuple[float, float], second: tuple[float, float]) -> Channel:
    way = np.subtract(second, first)
    along = tuple(map(float, way / np.linalg.norm(way)))
    return Channel(name, name, "extensometer", first, second, along, 1e-4, "virgin")


GAUGES = (gauge("a", (0.0, 1.0), (0.0, 1.6)), gauge("b", (0.0, 1.0), (0.0, 5.0)))
STAGES = (
    Stage("face", ("core",), release={"core": Scalar(0.4)}),
    Stage("open", release={"core": Scalar(1.0)}),
)


def staged(mesh, **changes) -> StagedModel:
    settings = {
        "parameters": UNKNOWN,
        "materials": {"rock": rock(E, 0.25, mohr(C, 0.5, psi=0.1))},
        "groups": {"core": "rock", "rock": "rock"},
        "supports": rollers(2),
        "in_situ": constant(*(-12 * MPa,) * 3),
        "stages": STAGES,
        "channels": GAUGES,
    }
    return model(mesh, **{**settings, **changes})


def problem(ground: StagedModel) -> Problem:
    response = ground.response([(c.name, s.name) for s in STAGES for c in ground.case.channels])
    measured = response.readings(TRUE)
    return Problem(response, measured, np.full(len(measured), 1e-5), ground.case.parameters)


def ignore(_) -> None:
    return None


ROUND = ClosedFormOptions((0.0, 0.0), 1.0)


def test_closed_form_is_near_and_shortens_the_rest():
    given = problem(staged(opening("quad8", 2, n=4, layers=16, radius=1.0, reach=30.0)))
    before = given.response.counts.evaluations
    start = identify(given, [ROUND], ignore)
    assert given.response.counts.evaluations == before
    np.testing.assert_allclose(start.values, TRUE, rtol=0.05)
    both = identify(given, [ROUND, GaussNewtonOptions()], ignore)
    np.testing.assert_allclose(both.values, TRUE, rtol=1e-6)
    assert given.response.counts.evaluations - before <= 6
    assert {entry.method for entry in both.iterations} == {"closed-form", "gauss-newton"}
    assert any("closed form of a circular opening" in remark for remark in both.remarks)


def square() -> StagedModel:
    mesh = box("quad4", (12, 12), size=(24.0, 24.0))
    core = regroup(mesh, core=lambda x: (abs(x - 12) < 2.5).all(axis=1))
    gauges = (gauge("a", (12.0, 16.0), (12.0, 18.0)), gauge("b", (12.0, 16.0), (12.0, 22.0)))
    return staged(core, channels=gauges)


def test_where_there_is_no_opening_the_rest_begins_at_the_start():
    given = problem(square())
    alone = identify(given, [GaussNewtonOptions()], ignore)
    both = identify(given, [ROUND, GaussNewtonOptions()], ignore)
    np.testing.assert_array_equal(both.values, alone.values)
    (remark,) = both.remarks
    assert remark.startswith("the closed form was skipped")
    assert "no group that is excavated lies within 1 m of (0, 0) m" in remark


def test_alone_it_is_refused_where_there_is_no_opening():
    with pytest.raises(InputError, match=r"closed-form is not possible here: no group") as said:
        identify(problem(square()), [ROUND], ignore)
    assert "Possible are gauss-newton" in str(said.value)


def test_parameters_that_do_not_enter_keep_their_values():
    spare = Parameter("spare", 7.0, 1.0, 9.0)
    ground = staged(
        opening("quad8", 2, n=3, layers=8, radius=1.0, reach=10.0), parameters=(*UNKNOWN, spare)
    )
    pairs = [(c.name, s.name) for s in STAGES for c in GAUGES]
    response = ground.response(pairs)
    measured = response.readings(np.array([*TRUE, 7.0]))
    given = Problem(response, measured, np.full(len(measured), 1e-5), ground.case.parameters)
    assert identify(given, [ROUND], ignore).values[2] == 7.0


def test_readings_without_closed_form_take_no_part():
    later = Stage("fill", install={"core": "rock"})
    ground = staged(
        opening("quad8", 2, n=3, layers=8, radius=1.0, reach=10.0), stages=(*STAGES, later)
    )
    pairs = [(c.name, s.name) for s in (*STAGES, later) for c in GAUGES]
    response = ground.response(pairs)
    measured = response.readings(TRUE)
    measured[-2:] = 1.0  # nonsense
    given = Problem(response, measured, np.full(len(measured), 1e-5), ground.case.parameters)
    found = identify(given, [ROUND], ignore)
    np.testing.assert_allclose(found.values, TRUE, rtol=0.1)
    assert any("does not give 2 of 6 readings" in remark for remark in found.remarks)
    last = ground.response(pairs[-2:])
    given = replace(given, response=last, measured=measured[-2:], sd=given.sd[-2:])
    with pytest.raises(InputError, match="no reading is of a stage"):
        identify(given, [ROUND], ignore)


class WithoutSolution:
    """A model, and a closed form of it of two of its three readings, with no solution anywhere."""

    names = ("k",)
    counts = Counts()
    covered = np.array([True, False, True])

    def opening(self, centre, radius):
        return self

    def remarks(self, p):
        return ()

    def admissible(self, p):
        return None

    def readings(self, p):
        raise ModelError("The formula has no solution there.")

    evaluate = readings


def test_a_closed_form_without_a_solution_leaves_the_start_and_says_why():
    parameter = Parameter("k", 2.0, 1.0, 3.0)
    problem = Problem(WithoutSolution(), np.zeros(3), np.ones(3), (parameter,))
    found = closed_form(problem, ROUND, lambda entry: None)
    assert (found.values.tolist(), found.objective) == ([2.0], np.inf)
    assert (found.status, found.iterations) == ("not-converged", ())
    reason = "The formula has no solution there."
    assert found.remarks[0].startswith("the closed form was skipped: ")
    assert reason.rstrip(".") in found.remarks[0]
    assert reason.rstrip(".") in found.reason


FEW = (*ALONE, "--set=fit.closed-form.starts=2")


def test_a_backtest_needs_no_mesh(project):
    """Face, near and far, of which the first two do not determine cohesion and friction."""
    prior = "--set=parameters.phi.prior={mean: 25 deg, sd: 2 deg}"
    done = run_command("backtest", "case.yaml", "--json", prior, *FEW)
    assert done.exit_code == 0, done.stderr
    told = json.loads(done.stdout)["backtest"]
    assert [fit["up_to"] for fit in told["fits"]] == ["face", "near", "far"]
    assert told["next"]["inside"] == told["next"]["readings"] > 0
    for name, truth in SI.items():
        assert told["fits"][-1]["parameters"][name]["value"] == pytest.approx(truth, rel=1e-3)
