"""Motions of supports as parameters: a shield tunnel with readings from another mesh."""

from __future__ import annotations

import csv
import io
import json
from pathlib import Path

import numpy as np
import pytest
from support.commands import run_command
from support.dam_on_mesh import write_mesh
from support.shield import CASE, ring

from geoident.io.result.file import read_result

TRUTH = {"V": (0.015, "1.5 %"), "E": (60e6, "60 MPa"), "u": (-2e-3, "-2 mm")}


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """The case, and readings with errors that a finer mesh gives for the truth."""
    monkeypatch.chdir(tmp_path)
    Path("case.yaml").write_text(CASE)
    write_mesh(Path("mesh.msh"), ring(3, whole=True))
    true = [f"--set=parameters.{name}.start={text}" for name, (_, text) in TRUTH.items()]
    found = run_command("simulate", "case.yaml", *true)
    assert found.exit_code == 0, found.output
    rows = list(csv.DictReader(io.StringIO(found.stdout)))
    rng = np.random.default_rng(5)
    text = "gauge,stage,value,unit\n"
    for row in rows:
        value = float(row["value"]) + 0.1 * rng.standard_normal()
        text += f"{row['gauge']},{row['stage']},{value:.3f},{row['unit']}\n"
    Path("readings.csv").write_text(text)
    write_mesh(Path("mesh.msh"), ring(2, whole=True))
    return tmp_path


def test_volume_loss_modulus_and_motion_are_recovered(folder):
    found = run_command("fit", "case.yaml", "--json")
    assert found.exit_code == 0, found.output
    parameters = json.loads(found.stdout)["parameters"]
    for name, (truth, _) in TRUTH.items():
        value, sd = parameters[name]["value"], parameters[name]["sd"]
        assert abs(value - truth) < 2.5 * sd, name
        assert sd < 0.3 * abs(truth), name
    result = read_result("case.fit.h5")
    reactions = result.reactions
    assert reactions is not None
    assert reactions.supports == ("rim", "wall")
    # the ground is in balance: what the wall takes the rim gives back
    drive, grout = reactions.states.index("shift"), reactions.states.index("grout")
    np.testing.assert_allclose(
        reactions.force[:, drive].sum(axis=0),
        0.0,
        atol=1e-6 * np.abs(reactions.force[1, drive]).max(),
    )
    assert np.isnan(reactions.force[1, grout]).all()
    shown = run_command("show", "case.fit.h5").stdout
    assert "Reactions of supports" in shown
    exported = run_command("export", "case.fit.h5", "--table", "reactions").stdout
    assert exported.splitlines()[0] == "support,stage,R_x (kN),R_y (kN),R_z (kN)"
