"""The path of somebody who has never met geoident: from nothing to a report, asking nobody."""

import os
import shlex
import subprocess
import sys
import venv
from pathlib import Path

import pytest

from geoident.io.docs.templates import TEMPLATES

ROOT = Path(__file__).parents[2]


def path_of(name):
    """The commands, in the order in which the program itself proposes them."""
    picture = [] if name == "opening" else ["--picture", "mine/case.svg"]  # it has no mesh
    return [
        ["init", "mine", "--template", name],
        ["check", "mine/case.yaml", *picture],
        ["fit", "mine/case.yaml"],
        ["show", "mine/case.fit.h5"],
        ["predict", "mine/case.fit.h5"],
        ["report", "mine/case.fit.h5"],
        ["export", "mine/case.fit.h5"],
        ["diff", "mine/case.fit.h5", "mine/case.fit.h5"],
    ]


@pytest.mark.parametrize(
    "name", [n if n == "cavern" else pytest.param(n, marks=pytest.mark.slow) for n in TEMPLATES]
)
def test_every_command_on_the_way_succeeds_and_names_the_next(tmp_path, monkeypatch, run, name):
    monkeypatch.chdir(tmp_path)
    proposed = []
    for command in path_of(name):
        done = run(*command)
        assert done.exit_code == 0, (command, done.output)
        assert "\nNext:\n" in done.stderr, command
        proposed += done.stderr.split("\nNext:\n")[1].splitlines()
    asked = {shlex.join(["geoident", *command[:2]]) for command in path_of(name)[1:-1]}
    assert asked <= {line.strip() for line in proposed}
    assert Path("mine/case.fit.html").exists()


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
