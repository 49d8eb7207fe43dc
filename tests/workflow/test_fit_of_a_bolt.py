"""A pull-out test: stiffness and strength of the grout from noisy readings of head and strain."""

from __future__ import annotations

import numpy as np
from support.commands import run_command
from support.in_stages import model_at, write_msh
from support.meshes import box

from geoident.api import read_result

PULLS = (30, 60, 90, 120, 150)
STEPS = "".join(
    f"  - {{name: {p} kN, loads: {{pull: {{on: bolt, pull: {p} kN}}}}}}\n" for p in PULLS
)
CASE = f"""\
format: geoident-case/1
title: Pull-out test of a rock bolt
analysis: solid
mesh: {{file: m.msh}}
parameters:
  k_grout: {{start: 4 GPa, bounds: [0.1 GPa, 20 GPa], scale: log}}
  bond: {{start: 200 kN/m, bounds: [40 kN/m, 900 kN/m], scale: log}}
materials:
  rock: {{E: 20 GPa, nu: 0.2}}
groups: {{all: rock}}
supports: {{x0: x, x1: x, y0: y, y1: y, z0: fixed}}
structures:
  bolt:
    kind: bolt
    E: 200 GPa
    diameter: 25 mm
    ends: [[[0.7, 0.7, 2 m], [0.7, 0.7, 0 m]]]
    k_grout: $k_grout
    bond: $bond
    head: free
    pieces: 24
stages:
  - {{name: set, build: [bolt]}}
{STEPS}\
gauges:
  HEAD: {{kind: bar-displacement, structure: bolt, zero: set, accuracy: 0.01 mm}}
  S: {{kind: strain, structure: bolt, point: [0.7, 0.7, 1.5 m], accuracy: 10 microstrain}}
readings: readings.csv
fit: {{method: gauss-newton, backtest: false}}
"""
TRUE = np.array([1.2e9, 1.1e5])


def test_a_pull_out_test_determines_stiffness_and_bond(tmp_path):
    write_msh(
        box("tet4", (2, 2, 2), size=(2.0,) * 3), tmp_path / "m.msh", ["x0", "x1", "y0", "y1", "z0"]
    )
    path = tmp_path / "case.yaml"
    path.write_text(CASE.replace("readings: readings.csv\n", ""))
    true, rng = model_at(path).computed(TRUE), np.random.default_rng(3)
    rows = ["gauge,stage,value,unit"]
    for row, (name, scale, sd, unit) in enumerate(
        (("HEAD", 1e3, 0.01, "mm"), ("S", 1e6, 10.0, "microstrain"))
    ):
        for column, pull in enumerate(PULLS, start=1):
            value = true[row, column] * scale + sd * rng.standard_normal()
            rows.append(f"{name},{pull} kN,{value:.5f},{unit}")
    path.write_text(CASE)
    (tmp_path / "readings.csv").write_text("\n".join(rows) + "\n")
    done = run_command("fit", str(path))
    assert done.exit_code == 0, done.stderr
    table = read_result(str(tmp_path / "case.fit.h5")).parameters
    for name, value, part in zip(("k_grout", "bond"), TRUE, (1.2, 0.2), strict=True):
        one = table[name]
        assert one.lower95 < value < one.upper95, (name, one)
        assert one.upper95 - one.lower95 < part * value, (name, one)  # the readings say so
