"""``fit: {reduced: false}``: nothing goes by a reduced model."""

from __future__ import annotations

import pytest

from geoident.forward.reducible import ReducibleResponse


@pytest.mark.parametrize("command", ["fit", "scan"])
def test_a_case_may_leave_it_out(trench, run, monkeypatch, command):
    asked = []
    monkeypatch.setattr(ReducibleResponse, "record", lambda self, **_: asked.append(command))
    scan = ("--set", "fit.scan.points=6") if command == "scan" else ()
    run(command, "case.yaml", *scan, "--set", "fit.reduced=false")
    assert asked == []
    run(command, "case.yaml", *scan, "--fresh", "--force")
    assert asked
