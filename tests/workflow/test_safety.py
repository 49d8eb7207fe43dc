"""``--safety`` of a case and of a fit, where the posterior of the factor is known."""

from __future__ import annotations

import csv
import json
from math import exp, log

import numpy as np
import pytest
from scipy.stats import norm
from support.commands import run_command
from support.in_stages import write_msh
from support.meshes import box

from geoident.io.result.file import read_result

CASE = """\
format: geoident-case/1
title: A block of clay
analysis: plane-strain
mesh: {file: block.msh}
parameters:
  E: {start: 20 MPa, bounds: [1 MPa, 200 MPa], scale: log}
  su: SU
materials:
  clay: {elastic: isotropic, E: $E, nu: 0.3, YIELD}
groups: {all: clay}
supports: {x0: x, y0: y}
stages:
  - {name: some, loads: {top: {on: y1, pressure: 20 kPa}}}
  - {name: all, loads: {top: {on: y1, pressure: 80 kPa}}}
gauges:
  S: {kind: settlement, point: [0.5 m, 1 m], accuracy: 0.01 mm}
  T: {kind: settlement, point: [0.5 m, 0.5 m], accuracy: 0.01 mm}
readings:
  - {gauge: S, stage: some, value: 0.9 mm}
  - {gauge: T, stage: some, value: 0.45 mm}
fit: {stages: [some], mesh_error: false}
"""
PRIOR = (
    "{start: 50 kPa, bounds: [5 kPa, 500 kPa], scale: log, "
    "prior: {kind: lognormal, mean: 50 kPa, sd: 7.5 kPa}}"
)
TRESCA = "yield: {type: mohr-coulomb, cohesion: $su, friction: 0 deg}"


def write_case(folder, su: str = PRIOR, limits: str = TRESCA):
    write_msh(box("quad4", (1, 1)), folder / "block.msh", ["x0", "x1", "y0", "y1"])
    path = folder / "case.yaml"
    path.write_text(CASE.replace("SU", su).replace("YIELD", limits))
    return path


def test_factors_of_two_stages(tmp_path):
    """They are 2 su / q; the critical one has a picture, and its mechanism in the result."""
    path, file = write_case(tmp_path), tmp_path / "case.safety.h5"
    ended = run_command("simulate", path, "--safety", "--at", "some,all", "--json")
    assert ended.exit_code == 0, ended.output
    some, every = json.loads(ended.stdout)["stages"]
    assert some["factor"] == pytest.approx(5.0, rel=0.01)
    assert every["factor"] == pytest.approx(1.25, rel=0.01)
    assert every["proven"]
    assert json.loads(run_command("show", file, "--json").stdout)["safety"] == [some, every]
    assert "95 %" not in run_command("show", file).stdout.partition("Factors of safety\n")[2]
    assert np.abs(read_result(file).mechanism.velocity).max() == pytest.approx(1.0)
    assert file.with_suffix(".png").exists()
    assert file.with_suffix(".vtkhdf").exists()


def test_factor_at_other_values(tmp_path):
    """Overrides and tables of values count, and a result of others is kept beside."""
    path, values = write_case(tmp_path), tmp_path / "v.csv"
    values.write_text("parameter,value,unit\nsu,48,kPa\n")
    ended = run_command("simulate", path, "--safety", "--values", values)
    assert "Stage 'all': factor of safety 1.2 " in ended.stdout
    ended = run_command("simulate", path, "--safety", "--set", "parameters.su.start=24 kPa")
    assert "Stage 'all': factor of safety 0.599" in ended.stdout
    assert "does not carry the loads" in ended.stdout
    assert "it is kept as" in ended.stderr
    assert read_result(tmp_path / "case.safety.1.h5").parameters.values[1] == 48e3


def test_band_of_a_fit_is_the_posterior(tmp_path):
    """The factor is proportional to su, whose posterior is its prior: lognormal."""
    path = write_case(tmp_path)
    assert run_command("fit", path, "-q").exit_code == 0
    words = ("--safety", "--json", "--draws", "16")
    ended = run_command("predict", path.with_name("case.fit.h5"), *words)
    assert ended.exit_code == 0, ended.output
    (stage,) = json.loads(ended.stdout)["stages"]
    band, sd = stage["band"], 0.15
    assert band["median"] == pytest.approx(1.25, rel=0.01)
    assert band["lower95"] == pytest.approx(1.25 * exp(-1.96 * sd), rel=0.015)
    assert band["upper95"] == pytest.approx(1.25 * exp(1.96 * sd), rel=0.015)
    exact = norm.cdf(log(1 / 1.25) / sd)
    assert band["below_one"] == pytest.approx(exact, abs=0.008)
    assert abs(band["below_one"] - exact) < 4 * band["below_one_sd"]
    assert band["influence"]["su"] == pytest.approx(sd, rel=0.05)
    assert band["undetermined"] == []
    _is_in_the_result(path.with_name("case.safety.h5"), stage)
    again = run_command("predict", path.with_name("case.fit.h5"), *words)
    assert json.loads(again.stdout)["stages"] == [stage]
    assert "up to date" in again.stderr


def _is_in_the_result(file, stage):
    """The file says the same as the command: to programs, in a table, on the screen."""
    shown = run_command("show", file, "--json")
    found = json.loads(shown.stdout)
    assert found["safety"] == [stage]
    (row,) = csv.DictReader(run_command("export", file, "--table", "safety").stdout.splitlines())
    assert float(row["below_one"]) == stage["band"]["below_one"]
    assert float(row["influence_su"]) == pytest.approx(stage["band"]["influence"]["su"])
    said = run_command("show", file).stdout
    assert "P(below 1)" in said
    assert f"{100 * stage['band']['below_one']:.2g} %" in said
    opened = read_result(file)
    assert opened.mechanism is not None
    assert np.abs(opened.mechanism.velocity).max() == pytest.approx(1.0)


@pytest.mark.slow  # draws a page
def test_the_page_of_a_factor(tmp_path):
    """It has the table, the words and the mechanism, which says by what strength is divided."""
    path = write_case(tmp_path)
    run_command("fit", path, "-q")
    run_command("predict", path.with_name("case.fit.h5"), "--safety", "--draws", "8")
    assert run_command("report", path.with_name("case.safety.h5")).exit_code == 0
    page = path.with_name("case.safety.html").read_text()
    assert "<h2" in page
    assert "Factors of safety" in page
    assert "with strength divided by 1.25" in page
    run_command("simulate", path, "--safety")
    assert run_command("report", path.with_name("case.safety.h5")).exit_code == 0
    page = path.with_name("case.safety.html").read_text()
    assert "with strength divided by 1.25" in page
    assert "P(below 1)" not in page
    assert "How well it fits" not in page


@pytest.mark.slow  # starts processes
def test_several_processes_find_the_same_band(tmp_path):
    path = write_case(tmp_path)
    assert run_command("fit", path, "-q").exit_code == 0
    words = (
        "predict",
        path.with_name("case.fit.h5"),
        "--safety",
        "--draws",
        "12",
        "--json",
        "--fresh",
    )
    one, three = (json.loads(run_command(*words, "-j", jobs).stdout) for jobs in ("1", "3"))
    assert one["stages"] == three["stages"]


@pytest.mark.slow  # the band above
def test_what_a_fit_does_not_determine_is_said(tmp_path):
    path = write_case(tmp_path, "{start: 50 kPa, bounds: [20 kPa, 120 kPa], scale: log}")
    run_command("fit", path, "-q")
    ended = run_command("predict", path.with_name("case.fit.h5"), "--safety", "--draws", "12")
    words = " ".join(ended.stdout.split())
    assert ended.exit_code == 4
    assert "The fit does not determine 'su'" in words
    assert "The probability that it is below one is" in words


@pytest.mark.parametrize(
    ("limits", "words", "code", "said"),
    [
        (TRESCA, ["--safety", "--at", "al"], 2, "no stage 'al'; the stages are: some, all"),
        (TRESCA, ["--at", "all"], 2, "--at needs --safety"),
        (TRESCA, ["--safety", "--noise"], 2, "--noise does not go with --safety"),
        (TRESCA, ["--safety", "--fields", "a.vtkhdf"], 2, "ParaView opens what it writes"),
        (
            "yield: {type: planes, planes: [{name: a, normal: [0.6, -0.8, 0], distance: $su}]}",
            ["--safety"],
            3,
            "given planes have no cohesion and friction",
        ),
    ],
)
def test_faulty_words(tmp_path, limits, words, code, said):
    ended = run_command("simulate", write_case(tmp_path, limits=limits), *words)
    assert ended.exit_code == code
    assert said in " ".join(ended.output.split())


def test_a_moment_that_the_case_does_not_have(tmp_path):
    wet = TRESCA + ", hydraulic: {permeability: 1e-9 m/s}"
    path = write_case(tmp_path, limits=wet)
    text = path.read_text().replace("name: some", "lasts: 10 d, name: some")
    text = text.replace("block.msh}", "block.msh, order: 2}\ndrained: {x1: {}}")
    path.write_text(text)
    ended = run_command("simulate", path, "--safety", "--at", "some + 3 d")
    assert ended.exit_code == 2
    assert "Add 'moments: [3 d]' to the stage 'some'" in " ".join(ended.output.split())


def test_nothing_yields(tmp_path):
    path = write_case(tmp_path, limits="density: $d").with_name("case.yaml")
    su = "{start: 2000 kg/m3, bounds: [1000 kg/m3, 3000 kg/m3]}"
    path.write_text(path.read_text().replace("su: " + PRIOR, "d: " + su))
    ended = run_command("simulate", path, "--safety")
    assert ended.exit_code == 3
    assert "no ground and no interface has a strength that could be divided" in " ".join(
        ended.output.split()
    )
