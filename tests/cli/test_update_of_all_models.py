"""``geoident update`` and ``watch`` of models without parameters of their own, or without stages.

Seasonal models of structures in service, and convergence laws whose stages are days.
"""

import json
from datetime import date, timedelta
from pathlib import Path

import numpy as np
import pytest

from geoident import update
from geoident.io.result.file import read_result
from tests.support.commands import run_command

DAM = """\
format: geoident-case/1
title: Pendulums of a dam
model: {kind: seasonal, since: 2012-01-01, level: 1, season: 1}
loads:
  level: {file: level.csv, unit: m}
gauges:
  P1: {kind: reading, accuracy: 0.1 mm}
  P2: {kind: reading, accuracy: 0.1 mm}
readings: readings.csv
"""
BEGIN = date(2012, 1, 1)


def write_dam(folder, days, step=0.0):
    """A dam read every ten days; P2 steps by so many mm after day 1000."""
    folder = Path(folder)
    (folder / "case.yaml").write_text(DAM, encoding="utf-8")
    level = [f"{BEGIN + timedelta(days=d)},{_level(d):.3f}" for d in range(0, 1400, 2)]
    (folder / "level.csv").write_text("\n".join(["date,level", *level]) + "\n", encoding="utf-8")
    lines = ["gauge,date,value,unit"]
    for day in range(10, days, 10):
        for gauge, share in (("P1", 0.3), ("P2", -0.2)):
            error = np.random.default_rng([day, len(lines)]).normal(0.0, 0.08)
            season = np.sin(2.0 * np.pi * day / 365.25)
            off = step if gauge == "P2" and day > 1000 else 0.0
            value = share * (_level(day) - 60.0) + season + error + off
            lines.append(f"{gauge},{BEGIN + timedelta(days=day)},{value:.3f},mm")
    (folder / "readings.csv").write_text("\n".join(lines) + "\n", encoding="utf-8")
    return folder / "case.yaml"


def _level(day):
    return 80.0 + 12.0 * np.sin(day / 58.0)


def test_a_seasonal_model_is_updated_and_judged_by_gauge(tmp_path):
    case = write_dam(tmp_path, 1001)
    first = update(case)
    assert first.updates == ()
    write_dam(tmp_path, 1100)
    good = update(case).updates[-1]
    assert (good.new, good.judged, good.belong, good.case_changed) == (18, 18, True, False)
    assert 0.005 < good.p_value < 0.995
    done = run_command("update", write_dam(tmp_path, 1200))
    assert "geoident control" in done.stderr  # of what to do next
    assert "geoident predict" not in done.stderr
    history = read_result(tmp_path / "case.fit.h5").updates
    low, high = history.values_of("P1: level")[1:3]
    truth = 1e-3 * 0.3 * 24.0  # mm a metre, over a range of 24 m
    assert (low < 1.02 * truth).all()
    assert (high > 0.98 * truth).all()


def test_a_step_of_one_gauge_of_a_seasonal_model_does_not_belong(tmp_path):
    case = write_dam(tmp_path, 1001)
    update(case)
    write_dam(tmp_path, 1100, step=0.4)
    found = update(case).data
    (finding,) = [one for one in found.findings if one.kind == "new-readings"]
    assert finding.subject == "P2"
    assert found.updates.steps[-1].alarm


@pytest.mark.slow  # as `update` and `control` do
def test_watch_controls_a_structure_in_service(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    assert run_command("fit", write_dam(".", 1001), "-q").exit_code == 0
    assert run_command("watch", ".", "--once").exit_code == 0
    fit = Path("case.fit.h5").read_bytes()
    write_dam(".", 1200, step=1.0)
    done = run_command("watch", ".", "--once", "--json")
    assert done.exit_code == 8, done.output
    found = json.loads(done.stdout)
    assert found["kind"] == "control"
    assert "A gauge has changed" in done.stderr
    assert Path("case.fit.h5").read_bytes() == fit


LAW = """\
format: geoident-case/1
model:
  kind: convergence-law
  face: {FACE}
  sections: {A: {chainage: 0 m}}
  C_inf: $C
  X: $X
parameters:
  C: {start: 20 mm, bounds: [1 mm, 500 mm], scale: log}
  X: {start: 8 m, bounds: [1 m, 60 m], scale: log}
gauges:
  H: {kind: reading, accuracy: 0.1 mm, zero: day 0}
readings: readings.csv
"""
FACE = {"day 0": 1, "day 1": 3, "day 2": 6, "day 4": 12, "day 8": 25, "day 16": 50}


def write_law(folder, days, off=0.0):
    """Convergences of 30 mm (1 - (10 / (10 + x))^2), of which the last is off, mm."""
    names = list(FACE)[:days]
    face = ", ".join(f"{name}: {FACE[name]} m" for name in names)
    text = LAW.replace("{FACE}", f"{{{face}}}")
    (folder / "case.yaml").write_text(text, encoding="utf-8")
    lines = ["gauge,stage,value,unit"]
    for k, name in enumerate(names[1:]):
        wall = 30.0 * ((10.0 / 11.0) ** 2 - (10.0 / (10.0 + FACE[name])) ** 2)
        error = np.random.default_rng(k).normal(0.0, 0.1)
        wall += off if name == names[-1] else 0.0
        lines.append(f"H,{name},{wall + error:.3f},mm")
    (folder / "readings.csv").write_text("\n".join(lines) + "\n", encoding="utf-8")
    return folder / "case.yaml"


@pytest.mark.parametrize(("off", "belong"), [(0.0, True), (6.0, False)])
def test_a_convergence_law_is_updated_with_days_that_are_new(tmp_path, off, belong):
    update(write_law(tmp_path, 5))
    found = update(write_law(tmp_path, 6, off))
    last = found.updates[-1]
    assert (last.new, last.judged, last.belong, last.case_changed) == (1, 1, belong, True)
    if belong:
        assert found.parameters["C"].lower95 < 0.030 < found.parameters["C"].upper95


TABLE = """\
format: geoident-case/1
model: {kind: table, file: runs.csv}
parameters: {E: {start: 8 GPa, bounds: [4 GPa, 16 GPa]}}
stages: [{name: s1}, {name: s2}]
gauges: {A: {kind: reading, accuracy: 0.02 mm}}
readings: readings.csv
"""


def test_a_table_of_runs_is_updated(tmp_path):
    lines = [f"{E},{12.0 / E:.5f},{20.0 / E:.5f}" for E in np.arange(4.0, 16.1, 0.5)]
    text = "\n".join(["E [GPa],A @ s1 [mm],A @ s2 [mm]", *lines])
    (tmp_path / "runs.csv").write_text(f"{text}\n", encoding="utf-8")
    case = tmp_path / "case.yaml"
    case.write_text(TABLE, encoding="utf-8")
    head = "gauge,stage,value,unit\nA,s1,1.51,mm\n"  # 12 / 8
    (tmp_path / "readings.csv").write_text(head, encoding="utf-8")
    update(case)
    (tmp_path / "readings.csv").write_text(f"{head}A,s2,2.49,mm\n", encoding="utf-8")
    last = update(case).updates[-1]
    assert (last.judged, last.belong) == (1, True)
    found = read_result(tmp_path / "case.fit.h5").parameters
    assert found.values[0] == pytest.approx(8e9, rel=0.02)


def test_of_two_minima_new_readings_are_judged_by_both(tmp_path):
    """Readings of s1 leave E = 6 or 10; that of s2 tells which, and chance has one half of each."""

    def at(E):
        return f"{E},{(E - 8.0) ** 2:.5f},{2.0 * E:.5f}"

    text = "\n".join(["E [GPa],A @ s1 [mm],A @ s2 [mm]", *map(at, np.arange(4.0, 16.1, 0.5))])
    (tmp_path / "runs.csv").write_text(f"{text}\n", encoding="utf-8")
    case = tmp_path / "case.yaml"
    starts = TABLE.replace("start: 8 GPa", "start: 7 GPa")
    case.write_text(
        f"{starts}fit: {{method: gauss-newton, gauss-newton: {{starts: 8}}}}\n", encoding="utf-8"
    )
    head = "gauge,stage,value,unit\nA,s1,4.0,mm\n"
    (tmp_path / "readings.csv").write_text(head, encoding="utf-8")
    assert len(update(case).data.rivals) == 2
    (tmp_path / "readings.csv").write_text(f"{head}A,s2,20.01,mm\n", encoding="utf-8")
    found = update(case)
    assert found.updates[-1].p_value == pytest.approx(0.5 * 0.85, abs=0.15)
    assert found.updates[-1].belong
    assert found.parameters["E"].value == pytest.approx(10e9, rel=0.01)
