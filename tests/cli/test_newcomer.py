"""The path of somebody who has never met geoident: from nothing to a report, asking nobody."""

import os
import re
import shlex
import subprocess
import sys
import venv
from pathlib import Path

import pytest

from geoident.io.docs.templates import TEMPLATES
from geoident.io.result.file import read_result

ROOT = Path(__file__).parents[2]


def path_of(name):
    """The commands, in the order in which the program itself proposes them."""
    picture = [] if name == "opening" else ["--picture", "mine/case.svg"]  # it has no mesh
    return [
        ["init", "mine", "--template", name],
        ["check", "mine/case.yaml", *picture],
        ["check", "mine/case.yaml", "--identifiability"],
        ["simulate", "mine/case.yaml", "-o", "mine/simulated.csv"],
        # what it finds without noise needs neither the error of the mesh nor a backtest
        ["fit", "mine/case.yaml", "--set", "readings=simulated.csv",
         "--set", "fit.mesh_error=false", "--set", "fit.backtest=false"],
        ["fit", "mine/case.yaml"],
        ["show", "mine/case.fit.h5"],
        ["predict", "mine/case.fit.h5"],
        ["show", "mine/case.predict.h5"],
        ["report", "mine/case.fit.h5"],
        ["export", "mine/case.fit.h5"],
        ["diff", "mine/case.fit.h5", "mine/case.fit.h5"],
    ]  # fmt: skip


FURTHER = [
    ["scan", "mine/case.yaml", "--set", "fit.scan.points=3"],
    ["sample", "mine/case.fit.h5", "-n", "200", "--effective", "100"],
    ["show", "mine/case.sample.h5"],
    ["backtest", "mine/case.yaml"],
    ["show", "mine/case.backtest.h5"],
    ["compare", "mine/case.fit.2.h5", "mine/case.fit.h5"],
]
"""What goes beyond, in the same folder, after the case was edited and fitted again."""

OFFERED = {"init", "check", "simulate", "fit", "show", "predict", "report", "export", "diff",
           "scan", "sample", "backtest", "compare"}  # fmt: skip


@pytest.mark.usefixtures("plain_pictures")
@pytest.mark.parametrize(
    "name", [n if n == "opening" else pytest.param(n, marks=pytest.mark.slow) for n in TEMPLATES]
)
def test_every_command_on_the_way_succeeds_and_names_the_next(tmp_path, monkeypatch, run, name):
    monkeypatch.chdir(tmp_path)
    proposed = []

    def follow(command):
        done = run(*command)
        assert done.exit_code == 0, (command, done.output)
        assert "\nNext:\n" in done.stderr, command
        proposed.extend(line.strip() for line in done.stderr.split("\nNext:\n")[1].splitlines())
        return " ".join(done.output.split())

    said = {shlex.join(command): follow(command) for command in path_of(name)}
    asked = {shlex.join(["geoident", *command[:2]]) for command in path_of(name)[1:-1]}
    asked -= {"geoident simulate mine/case.yaml"}  # a template has readings
    assert asked <= set(proposed)
    assert "geoident fit mine/case.yaml --set readings=simulated.csv" in proposed
    assert Path("mine/case.fit.html").exists()
    assert "readings inside" in said["show mine/case.fit.h5"]  # of the stage that was left out
    # the readings of the site take the place of those that were simulated, and nothing is lost
    assert "is kept as mine/case.fit.1.h5" in said["fit mine/case.yaml"]
    the_start_comes_back(read_result("mine/case.fit.1.h5"))
    edited = edit_and_fit_again(follow)
    assert "is kept as mine/case.fit.2.h5" in edited
    if name == "cavern":
        for command in FURTHER:
            follow(command)
        assert {command[0] for command in path_of(name) + FURTHER} == OFFERED


def the_start_comes_back(simulated):
    """Readings that were simulated without noise are met by the parameters they were made with."""
    table = simulated.parameters
    assert simulated.status == "converged"
    for k, start in enumerate(table.start):
        assert table.lower95[k] <= start <= table.upper95[k] or not table.determined[k]


def edit_and_fit_again(follow):
    """Another start value, and the same answer."""
    before = read_result("mine/case.fit.h5").parameters
    case = Path("mine/case.yaml")
    text, count = re.subn(
        r"(start: )([\d.]+)", lambda m: f"{m[1]}{1.1 * float(m[2]):.6g}", case.read_text(), count=1
    )
    assert count == 1
    case.write_text(text)
    said = follow(["fit", "mine/case.yaml"])
    after = read_result("mine/case.fit.h5").parameters
    assert after.values == pytest.approx(before.values, rel=1e-3)
    return said


@pytest.mark.slow
def test_it_works_from_a_wheel_in_a_fresh_environment(tmp_path):
    env = {k: v for k, v in os.environ.items() if k != "PYTHONPATH"}

    def call(*words, cwd=tmp_path):
        done = subprocess.run(
            [str(word) for word in words],
            cwd=cwd,
            env=env,
            capture_output=True,
            text=True,
            check=False,
        )
        assert done.returncode == 0, (words, done.stdout, done.stderr)
        return done

    call(sys.executable, "-m", "pip", "wheel", "--no-deps", "--quiet", "-w", tmp_path, ROOT)
    (wheel,) = tmp_path.glob("geoident-*.whl")
    venv.create(tmp_path / "env", with_pip=True)
    scripts = tmp_path / "env" / ("Scripts" if os.name == "nt" else "bin")
    call(scripts / "python", "-m", "pip", "install", "--quiet", f"{wheel}[report]")
    for name in TEMPLATES:
        folder = tmp_path / name
        folder.mkdir()
        for command in path_of(name):
            assert "\nNext:\n" in call(scripts / "geoident", *command, cwd=folder).stderr
