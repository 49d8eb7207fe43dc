"""A fit that is cut short within an evaluation goes on from the solutions that it had."""

from __future__ import annotations

import itertools
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from geoident.fem import solvers
from geoident.fem.solvers import iterative, kept_solutions
from geoident.io.result import checkpoint
from geoident.workflow.fit import fit
from geoident.workflow.running.control import Control
from geoident.workflow.running.jobs import Request, plan_fit
from tests.support.trench import write_case


class Killed(BaseException):
    """Stands for kill -9: nobody expects it."""


@pytest.fixture
def solved(tmp_path, monkeypatch):
    """Blocks that are solved by conjugate gradients, which all matrices are given to."""
    write_case(tmp_path)
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(solvers, "SMALL", 0)
    clock = itertools.count(step=60.0)  # on a machine that takes a minute for a solution
    monkeypatch.setattr(kept_solutions, "monotonic", clock.__next__)
    done = []
    true = iterative.solve_in_energy

    def counted(*args):
        if len(done) in counted.dies_at:
            counted.dies_at.remove(len(done))
            raise Killed
        done.append(1)
        return true(*args)

    counted.dies_at = []
    monkeypatch.setattr(iterative, "solve_in_energy", counted)
    done.clear()
    return done, counted.dies_at


def fitted(output):
    job = plan_fit(Request("case.yaml", output=output, solver="iterative"))
    return fit(job, Control()).result


def test_no_solution_is_computed_twice(solved, capsys):
    done, dies_at = solved
    whole = fitted("whole.h5")
    needed, _ = len(done), done.clear()
    dies_at += [1, needed // 2]
    for _ in range(2):
        with pytest.raises(Killed):
            fitted("cut.h5")
    resumed = fitted("cut.h5")
    assert len(done) == needed
    assert np.array_equal(resumed.parameters.values, whole.parameters.values)
    assert np.array_equal(resumed.parameters.sd, whole.parameters.sd)
    assert resumed.counts.evaluations == whole.counts.evaluations
    assert not Path("cut.checkpoint").exists()


def test_solutions_leave_room_on_the_disk(solved, monkeypatch):
    done, dies_at = solved
    asked = []

    def full(path):
        asked.append(path)
        return SimpleNamespace(free=10**9)

    monkeypatch.setattr(checkpoint.shutil, "disk_usage", full)
    dies_at.append(1)
    with pytest.raises(Killed):
        fitted("cut.h5")
    assert asked
    done.clear()
    fitted("cut.h5")
    kept_none = len(done)
    done.clear()
    fitted("whole.h5")
    assert kept_none == len(done)
