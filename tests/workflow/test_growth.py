"""Stiffness that grows, through the commands: found from readings of another mesh, and shown."""

from __future__ import annotations

import json

import h5py
import numpy as np
import pytest
from support.commands import run_command
from support.trench import write_mesh

from geoident.io.result.file import read_result
from geoident.report.drawing.fields.strength import utilisation
from geoident.report.drawing.scene import Scene

CASE = """\
format: geoident-case/1
title: Trench in soil
analysis: plane-strain
mesh: {file: trench.inp}
parameters:
  E_top: {start: 20 MPa, bounds: [1 MPa, 500 MPa], scale: log}
  growth: {start: 3 MPa/m, bounds: [0 MPa/m, 100 MPa/m]}
materials:
  soil:
    elastic: isotropic
    E: {at: $E_top, gradient: $growth, surface: 4 m}
    nu: 0.25
groups: {rock: soil, upper: soil, lower: soil}
supports: {left: x, right: x, bottom: [x, y]}
in_situ: {model: constant, xx: -60 kPa, yy: -50 kPa, zz: -60 kPa}
stages:
  - {name: first, excavate: [upper]}
  - {name: second, excavate: [lower]}
gauges:
  CV1: {kind: convergence, between: [[2 m, 3.5 m], [4 m, 3.5 m]], accuracy: 0.02 mm}
  CV2: {kind: convergence, between: [[2 m, 2.5 m], [4 m, 2.5 m]], accuracy: 0.02 mm}
  S:  {kind: settlement, point: [1 m, 4 m], accuracy: 0.02 mm}
  X:  {kind: extensometer, head: [2 m, 3 m], anchors: {a: [1 m, 3 m]}, accuracy: 0.02 mm}
readings: readings.csv
fit: {method: gauss-newton}
"""
TRUTH = 30.0, 12.0
DEPTH = "{at: $E_top, gradient: $growth, surface: 4 m}"
STIFFER_ABOVE = "{at: $E_top, gradient: -4 $growth, surface: 4 m}"


@pytest.fixture(scope="module")
def fitted(tmp_path_factory):
    """Readings of a mesh four times as fine, with noise, taken to a coarse one."""
    folder = tmp_path_factory.mktemp("growth")
    path = folder / "case.yaml"
    path.write_text(CASE)
    (folder / "readings.csv").write_text("gauge,stage,value,unit\n")
    write_mesh(folder / "trench.inp", n=(24, 16))
    starts = {"E_top": f"{TRUTH[0]} MPa", "growth": f"{TRUTH[1]} MPa/m"}
    given = [f"parameters.{name}.start={value}" for name, value in starts.items()]
    flags = [word for text in given for word in ("--set", text)]
    drawn = run_command("simulate", path, *flags, "--noise", "--seed", 3)
    assert drawn.exit_code == 0, drawn.output
    (folder / "readings.csv").write_text(drawn.stdout)
    write_mesh(folder / "trench.inp", n=(12, 8))
    done = run_command("fit", path)
    assert done.exit_code == 0, done.output
    return path, done


def test_gradient_and_modulus_are_found_on_another_mesh(fitted):
    path, _ = fitted
    result = read_result(str(path.with_name("case.fit.h5")))
    found = result.parameters
    assert found.names == ("E_top", "growth")
    for k, truth in enumerate(TRUTH):
        assert found.lower95[k] < 1e6 * truth < found.upper95[k]
    (varied,) = result.varied
    depth = 4.0 - varied.centres[:, 1]
    assert varied.values == pytest.approx(found.values[0] + found.values[1] * depth)
    assert (varied.name, varied.unit, varied.modes) == ("soil.E", "MPa", 0)
    assert np.all((varied.sd > 0) & (varied.sd < 0.5))


@pytest.mark.usefixtures("plain_pictures")
def test_people_are_shown_how_stiff_the_ground_is(fitted):
    path, done = fitted
    out = path.with_name("case.fit.h5")
    assert "soil.E" in done.output
    assert "soil.E" in run_command("show", out).output
    (told,) = json.loads(run_command("show", out, "--json").stdout)["fields"]
    assert (told["name"], told["modes"], told["best_seen"]) == ("soil.E", 0, None)
    with h5py.File(out) as file:
        assert file["VTKHDF/CellData/soil.E"].shape == (96,)
    checked = " ".join(run_command("check", path).output.split())
    assert "E of soil grows with depth: at the start values 20." in checked
    assert "to 3" in checked
    reported = run_command("report", out, "-o", path.with_name("report.html"))
    assert reported.exit_code == 0, reported.output
    drawn = run_command("sample", out, "--draws", 100)
    assert drawn.exit_code in (0, 4), drawn.output


def test_what_does_not_cover_growth_says_so(fitted):
    path, _ = fitted
    done = run_command("fit", path, "--set", "fit.method=condensation", "--force")
    assert done.exit_code != 0
    assert "E of soil grows with depth" in " ".join(done.output.split())


def test_a_modulus_that_is_not_positive_is_said_where_it_is_written(fitted):
    path, _ = fitted
    other = path.with_name("other.yaml")
    other.write_text(CASE.replace(DEPTH, STIFFER_ABOVE))
    done = run_command("check", other)
    assert done.exit_code != 0
    said = " ".join(done.output.split())
    assert "other.yaml:11" in said
    assert "where it must be positive" in said


CLAY = (
    CASE.replace(DEPTH, "30 MPa")
    .replace(
        "E_top: {start: 20 MPa, bounds: [1 MPa, 500 MPa]",
        "su: {start: 25 kPa, bounds: [1 kPa, 500 kPa]",
    )
    .replace(
        "growth: {start: 3 MPa/m, bounds: [0 MPa/m, 100 MPa/m]}",
        "growth: {start: 6 kPa/m, bounds: [0 kPa/m, 100 kPa/m]}",
    )
    .replace(
        "nu: 0.25",
        "nu: 0.25\n    yield: {type: tresca, strength: {at: $su, gradient: $growth, surface: 4 m}}",
    )
)


@pytest.mark.usefixtures("plain_pictures")
def test_strength_and_its_growth_are_found_and_shown(tmp_path):
    """The ground yields around the trench."""
    path = tmp_path / "case.yaml"
    path.write_text(CLAY)
    (tmp_path / "readings.csv").write_text("gauge,stage,value,unit\n")
    write_mesh(tmp_path / "trench.inp", n=(8, 6))
    given = ("--set", "parameters.su.start=24 kPa", "--set", "parameters.growth.start=4 kPa/m")
    drawn = run_command("simulate", path, *given, "--noise", "--seed", 3)
    assert drawn.exit_code == 0, drawn.output
    (tmp_path / "readings.csv").write_text(drawn.stdout)
    quick = ("--set", "fit.backtest=false", "--set", "fit.mesh_error=false")
    done = run_command("fit", path, *quick)
    assert done.exit_code == 0, done.output
    result = read_result(str(tmp_path / "case.fit.h5"))
    for k, truth in enumerate((24e3, 4e3)):
        assert result.parameters.lower95[k] < truth < result.parameters.upper95[k]
    (varied,) = result.varied
    depth = 4.0 - varied.centres[:, 1]
    assert varied.name == "soil.cohesion"
    assert varied.values == pytest.approx(result.parameters.values @ [np.ones_like(depth), depth])
    checked = " ".join(run_command("check", path).output.split())
    assert "strength of soil grows with depth: at the start values 25.85 kPa" in checked
    reported = run_command("report", tmp_path / "case.fit.h5", "-o", tmp_path / "report.html")
    assert reported.exit_code == 0, reported.output
    assert "Utilisation of the strength" in (tmp_path / "report.html").read_text()
    scene = Scene(result, result.fields)
    shares, yielded = utilisation(scene, 2), result.fields.yielded[2]
    assert yielded.sum() > 5
    assert np.mean(shares[yielded]) > 0.9  # some elements yield in a part of their points
    assert np.nanmax(shares) < 1.05
