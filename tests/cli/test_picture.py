"""The picture of a case: every kind of mesh, the same bytes each time, nothing overwritten."""

import re
from pathlib import Path

import numpy as np
import pytest
from matplotlib.image import imread

from geoident.io.docs.templates import TEMPLATES


def painted(file: str) -> float:
    """The share of a picture that is not white."""
    return float(np.mean(np.any(imread(file)[..., :3] < 0.98, axis=-1)))


@pytest.mark.parametrize("name", TEMPLATES)
def test_every_template_is_valid(tmp_path, monkeypatch, run, name):
    monkeypatch.chdir(tmp_path)
    run("init", "--template", name)
    assert run("check", "case.yaml", "-q").exit_code == 0


@pytest.mark.parametrize(
    "name", [n if n == "dam" else pytest.param(n, marks=pytest.mark.slow) for n in TEMPLATES
             if n != "opening"]  # it has no mesh
)  # fmt: skip
def test_every_template_is_drawn(tmp_path, monkeypatch, run, name):
    monkeypatch.chdir(tmp_path)
    run("init", "--template", name)
    told = run("check", "case.yaml", "--picture", "case.png")
    assert told.exit_code == 0, told.stderr
    assert "Picture: case.png" in told.stdout
    assert painted("case.png") > 0.1


def test_the_same_case_gives_the_same_picture_and_what_others_drew_is_kept(trench, run):
    def drawn(*words):
        return run("check", "case.yaml", "-q", "--picture", "one.svg", *words).exit_code

    assert drawn() == 0
    before = Path("one.svg").read_bytes()
    assert drawn("--set", "gauges.S.point=[5 m, 4 m]") == 0
    assert Path("one.svg").read_bytes() != before
    Path("one.svg").write_text("<svg>drawn by somebody</svg>")
    stopped = run("check", "case.yaml", "--picture", "one.svg")
    assert stopped.exit_code == 6
    assert "--force replaces it" in stopped.stderr
    assert Path("one.svg").read_text() == "<svg>drawn by somebody</svg>"
    assert drawn("--force") == 0
    assert Path("one.svg").read_bytes() == before
    assert re.search(r"<svg[^>]*viewBox", before.decode())


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (["case.yaml", "case.yaml", "--picture", "a.svg"], "one case"),
        (["case.yaml", "--picture", "a.gif"], "must end in .svg"),
        (["case.yaml", "--picture", "a.svg", "--identifiability"], "no --identifiability"),
    ],
)
def test_flags_that_make_no_picture(trench, run, words, said):
    refused = run("check", *words)
    assert refused.exit_code == 2
    assert said in refused.stderr


def test_without_matplotlib_the_remedy_is_said(trench, run, monkeypatch):
    monkeypatch.setattr("geoident.cli.commands.check.find_spec", lambda name: None)
    refused = run("check", "case.yaml", "--picture", "a.svg")
    assert refused.exit_code == 2
    assert 'pip install "geoident[report]"' in refused.stderr
