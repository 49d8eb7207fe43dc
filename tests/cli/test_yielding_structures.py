"""The capacity of a bolt, found again from readings that the command itself simulates."""

from __future__ import annotations

import json

import pytest

from tests.support.commands import run_command
from tests.support.trench import write_case

NAIL = """\
structures:
  nail: {kind: bolt, EA: 400 MN, spacing: 1 m, ends: [[[4, 2.5 m], [5.6, 2.3 m]]], capacity: $F}
"""


def test_capacity_of_a_bolt_is_identified(tmp_path):
    case = write_case(tmp_path)
    text = case.read_text()
    for old, new in (
        ("parameters:\n", "parameters:\n  F: {start: 80 kN, bounds: [10 kN, 1 MN], scale: log}\n"),
        ("stages:\n", f"{NAIL}stages:\n"),
        ("excavate: [upper]", "excavate: [upper], build: [nail]"),
        ("gauges:\n", "gauges:\n  LC: {kind: load-cell, structure: nail, accuracy: 1 kN}\n"),
        ("stages: [first]", "stages: [first, second]"),
    ):
        assert old in text
        text = text.replace(old, new, 1)
    case.write_text(text)
    truth = ["--set", "readings=[]", "--set", "parameters.F.start=60 kN"]
    run = run_command("simulate", case, *truth, "-o", tmp_path / "simulated.csv")
    assert run.exit_code == 0, run.output
    assert "LC,second,60,kN" in (tmp_path / "simulated.csv").read_text()
    run = run_command("fit", case, "--set", "readings=simulated.csv", "--json", "-o", tmp_path)
    assert run.exit_code == 0, run.output
    assert json.loads(run.stdout)["parameters"]["F"]["value"] == pytest.approx(60e3, rel=1e-3)
