"""The error of the steps in time in a project: columns of clay whose answer is known (Terzaghi)."""

import numpy as np
import pytest
from support.column import DAY, FILL, E, K, settlement, write_column
from support.commands import run_command

from geoident.io.result.project import read_project_result

DAYS = (30, 50, 70, 100, 130, 160, 200)
PROJECT = """\
format: geoident-project/1
title: Two columns of the same clay
sections:
  - {name: A, case: case.yaml, set: {readings: A.csv}}
  - {name: B, case: case.yaml, set: {readings: B.csv}}
  - {name: C, case: case.yaml, set: {readings: B.csv}, predict: true}
shared: [E, k]
"""


def fitted(folder, steps):
    """A project of two sections with few steps in time, each read seven times to 0.02 mm."""
    case = write_column(
        folder,
        stages=f"  - {{name: fill, lasts: 400 d, moments: [300 d], {FILL}}}",
        more=f"readings: A.csv\ntime_steps: {steps}\n",
        fit=", model_error: none",
    )
    case.write_text(case.read_text().replace("accuracy: 0.2 mm", "accuracy: 0.02 mm"))
    for seed, name in enumerate("AB", 1):
        noise = np.random.default_rng(seed).normal(0.0, 0.02, len(DAYS))
        values = 1e3 * settlement(np.array(DAYS) * DAY) + noise
        rows = [f"S1,fill + {d} d,{value:.5f},mm" for d, value in zip(DAYS, values, strict=True)]
        (folder / f"{name}.csv").write_text("\n".join(["gauge,stage,value,unit", *rows, ""]))
    (folder / "project.yaml").write_text(PROJECT)
    done = run_command("fit", folder / "project.yaml")
    assert done.exit_code == 0, done.output
    return read_project_result(folder / "project.fit.h5")


@pytest.mark.slow  # of one case: tests/workflow/moments
def test_coarse_steps_are_told_of_each_section_and_counted(tmp_path):
    """Without their errors the models do not fit, and E is off by ten standard deviations."""
    result = fitted(tmp_path, 1)
    told = {f.subject: f.sentence for f in result.findings if f.kind == "step-error"}
    assert set(told) == {"A", "B"}
    assert told["A"].startswith("In the section A: The error by the steps in time is at most")
    assert "Write 'time_steps: " in told["B"]
    common = {row.name: row for row in result.common}
    for name, value in {"E": E, "k": K}.items():
        assert common[name].lower95 < value < common[name].upper95, name
    # a section without a fit of its own has those at its start values
    assert any(note.startswith("C: The error by the steps in time") for note in result.notes)
    ahead = [r for r in result.readings if r.section == "C"]
    truth = settlement(np.array(DAYS) * DAY)
    inside = [r.lower95 < t < r.upper95 for r, t in zip(ahead, truth, strict=True)]
    assert np.mean(inside) >= 0.85


@pytest.mark.slow
def test_usual_steps_are_a_note(tmp_path):
    result = fitted(tmp_path, 12)
    assert not [f for f in result.findings if f.kind == "step-error"]
    assert any("error by the steps in time is at most" in note for note in result.notes)
