"""A block pushed along a joint: its stiffness and friction from noisy readings of a finer mesh."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from support.commands import run_command
from support.in_stages import model_at, write_msh
from support.inner_faces import with_inner_faces
from support.meshes import box, regroup

from geoident.api import read_result
from geoident.workflow.running.workers import ModelParts

CASE = """\
format: geoident-case/1
title: A block that is pushed along a joint
analysis: plane-strain
mesh: {file: m.msh}
parameters:
  k_n: {start: 10 GPa/m, bounds: [0.5 GPa/m, 100 GPa/m], scale: log}
  k_s: {start: 2 GPa/m, bounds: [0.1 GPa/m, 20 GPa/m], scale: log}
  phi: {start: 38 deg, bounds: [15 deg, 55 deg]}
materials:
  rock: {E: 5 GPa, nu: 0.2}
groups: {rock: rock, low: rock}
supports: {y0: fixed}
interfaces:
  joint: {along: joint, k_n: $k_n, k_s: $k_s, friction: $phi}
stages:
  - {name: press, loads: {weight: {on: y1, pressure: 1 MPa}}}
  - {name: push, loads: {thrust: {on: end, pressure: 0.8 MPa}}}
  - {name: slip, loads: {thrust: {on: end, pressure: 1.5 MPa}}}
  - {name: later, loads: {thrust: {on: end, pressure: 2.0 MPa}}}
gauges:
  S1:
    {kind: joint-meter, interface: joint, point: [1 m, 2 m], component: slip, accuracy: 0.01 mm}
  S2:
    {kind: joint-meter, interface: joint, point: [6 m, 2 m], component: slip, accuracy: 0.01 mm}
  O1:
    {kind: joint-meter, interface: joint, point: [2 m, 2 m], component: opening, accuracy: 0.01 mm}
  O2:
    {kind: joint-meter, interface: joint, point: [8 m, 2 m], component: opening, accuracy: 0.01 mm}
  X: {kind: displacement, component: x, point: [1 m, 4 m], accuracy: 0.02 mm}
  Y: {kind: settlement, point: [5 m, 4 m], accuracy: 0.02 mm}
readings: readings.csv
fit: {backtest: false, method: gauss-newton}
"""
GIVEN = "readings: readings.csv\n"
TRUE = np.array([5e9, 1e9, np.radians(30.0)])
ACCURACY = np.array([0.01] * 4 + [0.02] * 2)
"""Of the gauges, mm."""


def write_case(folder: Path, cells: tuple[int, int], text: str) -> Path:
    mesh = box("quad8", cells, size=(10.0, 4.0))
    facets = np.array([mesh.points[n].mean(axis=0) for f in mesh.facets for n in f.nodes])
    mesh.facet_groups["end"] = np.flatnonzero((facets[:, 0] < 1e-9) & (facets[:, 1] > 2.0))
    mesh = with_inner_faces(mesh, joint=lambda x: abs(x[..., 1] - 2.0) < 1e-9)
    mesh = regroup(mesh, low=lambda x: x[:, 1] < 2.0)
    write_msh(mesh, folder / "m.msh", ["y0", "y1", "end", "joint"])
    path = folder / "case.yaml"
    path.write_text(text)
    return path


@pytest.mark.slow  # a fit of a joint that slips takes 5 s
def test_stiffness_and_friction_are_found_and_a_later_stage_predicted(tmp_path):
    """Its far half holds still while its near one slips, so that all three are told apart."""
    truth = tmp_path / "truth"
    truth.mkdir()
    finer = model_at(write_case(truth, (20, 8), CASE.replace(GIVEN, "")))
    true = finer.computed(TRUE) * 1e3
    path, rng = write_case(tmp_path, (10, 4), CASE), np.random.default_rng(7)
    noisy = true + ACCURACY[:, None] * rng.standard_normal(true.shape)
    rows = [
        f"{channel.name},{stage},{noisy[n, j]:.4f},mm"
        for n, channel in enumerate(finer.case.channels)
        for j, stage in enumerate(("press", "push", "slip"))
    ]
    (tmp_path / "readings.csv").write_text("\n".join(["gauge,stage,value,unit", *rows, ""]))
    said = run_command("fit", str(path))
    assert said.exit_code == 0, said.output
    found = read_result(str(tmp_path / "case.fit.h5")).parameters
    for name, right in zip(("k_n", "k_s", "phi"), TRUE, strict=True):
        one = found[name]
        assert one.lower95 < right < one.upper95, (name, one)
        assert one.upper95 - one.lower95 < 0.25 * right  # the readings say something of it
    said = run_command("check", str(tmp_path / "case.fit.h5"), "--mesh-error")
    assert "40 elements became 160" in said.output  # split anew after their edges are halved
    assert "Little of the accuracy of the readings is lost to mesh error" in said.output
    said = run_command(
        "report", str(tmp_path / "case.fit.h5"), "--figures", str(tmp_path / "figures")
    )
    assert said.exit_code == 0, said.output
    page = next(tmp_path.glob("*.html")).read_text()
    assert "k_n = " in page
    assert "|slip| up to" in page
    drawn = {path.stem for path in (tmp_path / "figures").iterdir()}
    assert {"interface-1", "interfaces", "model"} <= drawn
    said = run_command("export", str(tmp_path / "case.fit.h5"), "--format", "vtu")
    assert "case.fit.interfaces.pvd" in said.output
    said = run_command("export", str(tmp_path / "case.fit.h5"), "--table", "interfaces")
    assert said.stdout.splitlines()[0].endswith(
        "t_n (kPa),t_s (kPa),opening (mm),slip (mm),slips,opens"
    )
    said = run_command("predict", str(tmp_path / "case.fit.h5"))
    assert said.exit_code == 0, said.output
    rows = read_result(str(tmp_path / "case.predict.h5")).predictions.rows
    later = {row[0]: row for row in rows if row[1] == "later"}
    for n, channel in enumerate(finer.case.channels):
        _, _, _, _, low, high, *_ = later[channel.name]
        assert low - ACCURACY[n] < true[n, 3] < high + ACCURACY[n], said.output


def test_another_process_builds_the_same_model(tmp_path):
    """It is given the mesh before the split; of one that is split nothing could be made."""
    model = model_at(write_case(tmp_path, (4, 2), CASE.replace(GIVEN, "")))
    parts = ModelParts.of(model, model.case, "auto")
    assert parts is not None
    again = parts.build()
    np.testing.assert_array_equal(again.computed(TRUE), model.computed(TRUE))
