"""A scan of a model elsewhere: runs are made several at a time, the scan is that of single runs."""

import json

import numpy as np
import pytest

from geoident.workflow.running.control import Control
from geoident.workflow.running.jobs import Request, plan_scan
from geoident.workflow.scan import scan
from tests.support.external import PYTHON, SCRIPT, trusted, write_case

MEETING = """
import os, time


def together(values, count=4):
    # no run ends before another one has begun
    with open("begun.txt", "a") as file:
        file.write("x")
    over = time.monotonic() + 60
    while len(open("begun.txt").read()) < 2 and time.monotonic() < over:
        time.sleep(0.005)
    assert len(open("begun.txt").read()) >= 2
    return readings(values)
"""
GRID = (
    "fit.scan.grid={E: {from: 4 GPa, to: 8 GPa, points: 3}, K0: {from: 0.8, to: 2.95, points: 3}}"
)


def scanned(folder, model, script):
    case = write_case(folder, model, script=script)
    with trusted():
        found = scan(plan_scan(Request(str(case), (GRID,))), Control()).result
    lines = (folder / "case.runs" / "runs.jsonl").read_text().splitlines()
    return found, [json.loads(line) for line in lines]


def test_runs_of_a_grid_are_made_together_and_failed_ones_are_survived(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    plain, _ = scanned(tmp_path / "plain", PYTHON, SCRIPT)
    several = PYTHON.replace('opening:readings"', 'opening:together", at_once: 2')
    found, lines = scanned(tmp_path / "several", several, SCRIPT + MEETING)
    assert np.isinf(found.grid.objective[:, 2]).all()  # K0 = 2.95 has no solution
    assert np.isfinite(found.grid.objective[:, :2]).all()
    assert np.array_equal(found.grid.objective, plain.grid.objective)
    assert found.counts == plain.counts
    assert len(lines) == len({line["key"] for line in lines})  # none was made twice
    assert any("3 of" in note and "failed" in note for note in found.notes)


def test_the_history_is_in_the_order_of_the_grid(tmp_path):
    found, _ = scanned(tmp_path, PYTHON, SCRIPT)
    assert [entry.values[1] for entry in found.history[:3]] == pytest.approx([0.8, 1.875, 2.95])
