"""What a bound leaves open, through the commands: the cases of the issue."""

from __future__ import annotations

import json
import shutil
from pathlib import Path

import numpy as np
import pytest
from support.commands import run_command
from support.mesh_scripts import make_mesh

import geoident
from tests.support.commands import said_findings

PACKAGE = Path(geoident.__file__).parent
CAVERN = PACKAGE.parent / "cases" / "cavern"


def predictions(found):
    return {(p["gauge"], p["stage"]): p for p in found["predictions"]}


@pytest.fixture(scope="module")
def opening(tmp_path_factory):
    """The template without its prior of phi: c ends on its bound, and c and phi are not known."""
    folder = tmp_path_factory.mktemp("opening")
    shutil.copytree(PACKAGE / "templates" / "opening", folder, dirs_exist_ok=True)
    case = folder / "case.yaml"
    text = "\n".join(row for row in case.read_text().splitlines() if "prior:" not in row)
    case.write_text(text + "\n")
    few = ("--set", "fit.closed-form.starts=3", "--set", "fit.backtest=false")
    return case, run_command("fit", str(case), "--json", "-q", *few)


def test_what_rests_on_an_open_strength_is_not_determined(opening):
    _, run = opening
    found = json.loads(run.stdout)
    assert run.exit_code == 4
    assert found["parameters"]["c"]["at_bound"]
    assert not found["parameters"]["c"]["determined"]
    for prediction in found["predictions"]:
        assert prediction["sd"] is None or np.isinf(prediction["sd"])
    assert any("how far above it the value may be" in text for text in said_findings(found))


def test_predict_says_what_the_fit_says(opening):
    case, run = opening
    result = str(case.with_name("case.fit.h5"))
    again = run_command("predict", result, "--json", "-q")
    assert json.loads(again.stdout)["predictions"] == json.loads(run.stdout)["predictions"]


@pytest.mark.slow  # an open strength: above
@pytest.mark.parametrize("coarse", [True, pytest.param(False, marks=pytest.mark.slow)])
def test_a_fault_that_was_not_yet_seen_leaves_its_gauges_undetermined(tmp_path, coarse):
    """cases/cavern fitted on the heading: the modulus of the fault ends on its bound."""
    for name in ("cavern.msh", "readings.csv", "case.yaml"):
        shutil.copy(CAVERN / name, tmp_path)
    if coarse:
        make_mesh(CAVERN, tmp_path / "cavern.msh", size=3.0, order=1)
    alone = ("fit.stages=[heading]", "fit.mesh_error=false", "fit.backtest=false")
    flags = [word for one in alone for word in ("--set", one)]
    fit = run_command("fit", str(tmp_path / "case.yaml"), "--json", "-q", *flags)
    found = json.loads(fit.stdout)
    assert fit.exit_code == 4
    known = {
        place: p
        for place, p in predictions(found).items()
        if p["sd"] is not None and np.isfinite(p["sd"]) and p["measured"] is not None
    }
    behind_the_fault = {place for place in predictions(found) if place[0] == "EX-R1.a15"}
    assert behind_the_fault
    assert not behind_the_fault & set(known)
    inside = [p["lower95"] <= p["measured"] <= p["upper95"] for p in known.values()]
    assert len(inside) > 3
    assert np.mean(inside) > 0.8
