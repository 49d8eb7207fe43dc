"""What is said of a section alone is said of it in a project, too."""

import json

import numpy as np
import pytest
from support.commands import run_command
from support.settlement_plates import days_of, hyperbola, measured, settlement, write_plate

PROJECT = """\
format: geoident-project/1
sections:
  - {name: east, case: east/case.yaml}
  - {name: west, case: west/case.yaml}
shared: [m]
"""


@pytest.fixture
def project(tmp_path):
    """What a project of two plates says, of truths and numbers of readings."""

    def fitted(*truths, count=24, more=""):
        rng = np.random.default_rng(0)
        for name, truth in zip(("east", "west"), truths, strict=True):
            (tmp_path / name).mkdir()
            days = days_of(rng, count)
            write_plate(
                tmp_path / name, days, measured(rng, truth, days), fitted=len(days), more=more
            )
        (tmp_path / "project.yaml").write_text(PROJECT)
        return json.loads(run_command("fit", tmp_path / "project.yaml", "--json", "-q").stdout)

    return fitted


def test_residuals_that_come_in_runs(project):
    """The east creeps, which its model does not know; the west is as its model has it."""
    creeps = settlement(np.random.default_rng(100))
    result = project(creeps, hyperbola(), more=", model_error: none")
    found = [one for one in result["findings"] if one["kind"] == "correlated-residuals"]
    assert [one["subject"] for one in found] == ["east, P"]
    assert found[0]["sentence"].startswith("In the section east by itself: Residuals of P come")


def test_sections_of_few_readings_have_a_model_error_together(project):
    """Three readings beside two parameters say nothing of it; those of two sections do."""
    result = project(hyperbola(), hyperbola(), count=3)
    (said,) = [note for note in result["notes"] if "All sections together" in note]
    assert "% of the motion" in said
