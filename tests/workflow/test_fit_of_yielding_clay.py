"""A quick embankment on soft clay: strength, modulus and permeability from noisy readings."""

from pathlib import Path

import numpy as np
import pytest
from support.commands import run_command
from support.in_stages import model_at, write_msh
from support.meshes import box

from geoident.api import read_result

CASE = """\
format: geoident-case/1
title: Quick embankment on soft clay
analysis: plane-strain
mesh: {file: m.msh}
time_steps: 1
parameters:
  c: {start: 9 kPa, bounds: [1 kPa, 40 kPa]}
  E: {start: 5 MPa, bounds: [0.5 MPa, 50 MPa], scale: log}
  k: {start: 2e-9 m/s, bounds: [1e-11 m/s, 1e-7 m/s], scale: log}
materials:
  clay:
    E: $E
    nu: 0.3
    density: 1700 kg/m3
    hydraulic: {permeability: $k}
    yield: {type: mohr-coulomb, cohesion: $c, friction: 22 deg, dilation: 0 deg}
groups: {all: clay}
supports: {x0: x, x1: x, y0: fixed}
gravity: 9.81 m/s2
in_situ: {model: geostatic, K0: 0.65}
water: {table: 6 m}
drained: {y1: {}}
stages:
  - {name: fill, loads: {bank: {on: strip, pressure: 42 kPa}}, lasts: 5 d, over: 5 d}
  - {name: wait, lasts: 60 d}
  - {name: later, lasts: 300 d}
gauges:
  S: {kind: settlement, point: [0 m, 6 m], accuracy: 2 mm}
  T: {kind: displacement, component: x, point: [4 m, 4 m], accuracy: 1 mm}
  H: {kind: settlement, point: [5 m, 6 m], accuracy: 2 mm}
  P: {kind: piezometer, point: [1 m, 3 m], accuracy: 0.7 kPa}
  Q: {kind: piezometer, point: [3 m, 4 m], accuracy: 0.7 kPa}
readings: readings.csv
fit: {backtest: false, method: gauss-newton}
"""
TRUE = np.array([7e3, 3e6, 1e-9])
ACCURACY = np.array([2.0, 1.0, 2.0, 0.7, 0.7])
"""Of the gauges, mm and kPa."""


def write_case(folder: Path, cells, text: str) -> Path:
    mesh = box("tri6", cells, size=(12.0, 6.0))
    top = mesh.points[np.concatenate([facets.nodes for facets in mesh.facets])]
    under = (top[..., 1] > 6.0 - 1e-9) & (top[..., 0] < 4.01)
    mesh.facet_groups["strip"] = np.flatnonzero(under.all(axis=1))
    write_msh(mesh, folder / "m.msh", ["x0", "x1", "y0", "y1", "strip"])
    path = folder / "case.yaml"
    path.write_text(text)
    return path


@pytest.mark.slow
def test_strength_modulus_and_permeability_are_found_and_later_readings_predicted(tmp_path):
    truth = tmp_path / "truth"
    truth.mkdir()
    bare = CASE.replace("readings: readings.csv\n", "")
    finer = model_at(write_case(truth, (12, 8), bare.replace("time_steps: 1\n", "time_steps: 3\n")))
    true = finer.computed(TRUE) / np.array([1e-3, 1e-3, 1e-3, 1e3, 1e3])[:, None]
    path, rng = write_case(tmp_path, (9, 6), CASE), np.random.default_rng(3)
    noisy = true + ACCURACY[:, None] * rng.standard_normal(true.shape)
    rows = [
        f"{gauge},{stage},{noisy[n, j]:.4f},{'mm' if n < 3 else 'kPa'}"
        for n, gauge in enumerate("STHPQ")
        for j, stage in enumerate(("fill", "wait"))
    ]
    (tmp_path / "readings.csv").write_text("\n".join(["gauge,stage,value,unit", *rows, ""]))
    said = run_command("fit", str(path))
    assert "converged" in said.stderr
    found = read_result(str(tmp_path / "case.fit.h5")).parameters
    for name, right in (("c", 7e3), ("E", 3e6), ("k", 1e-9)):
        one = found[name]
        assert one.lower95 < right < one.upper95, (name, one)
    said = run_command("predict", str(tmp_path / "case.fit.h5"))
    later = read_result(str(tmp_path / "case.predict.h5")).predictions
    rows = {row[0]: row for row in later.rows if row[1] == "later"}
    for n, gauge in enumerate("STHPQ"):
        _, _, _, _, low, high, *_ = rows[gauge]
        assert low - ACCURACY[n] < true[n, 2] < high + ACCURACY[n], said.stderr
