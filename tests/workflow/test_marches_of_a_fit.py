"""A whole fit by way of the surrogate says what the model alone would."""

from __future__ import annotations

import shutil
from dataclasses import replace

import numpy as np
import pytest

from geoident.forward.reduced import reduction
from geoident.model.results.findings import sentences_of
from geoident.workflow.fit import fit
from geoident.workflow.running.control import Control
from geoident.workflow.running.jobs import Request, plan_fit
from geoident.workflow.simulate import simulate
from tests.support.deck import write_deck
from tests.support.meshes import box

CASE = """\
format: geoident-case/1
title: A drift in four rounds
analysis: solid
mesh: {file: drift.inp}
parameters:
  E: {start: 15 GPa, bounds: [1 GPa, 80 GPa], scale: log, prior: {mean: 9 GPa, sd: 2 GPa}}
  sv: {start: 5 MPa, bounds: [1 MPa, 15 MPa], prior: {mean: 5 MPa, sd: 0.5 MPa}}
  K0: {start: 1.0, bounds: [0.1, 10]}
materials:
  rock: {E: $E, nu: 0.25}
  shotcrete: {E: 10 GPa, nu: 0.2}
groups: {rock: rock, r1: rock, r2: rock, r3: rock, r4: rock, l1: rock, l2: rock, l3: rock}
supports: {x0: x, x1: x, y0: y, y1: y, z0: z}
in_situ: {model: heim, vertical: $sv, K0: $K0}
stages:
  - {name: one, excavate: [r1, l1]}
  - {name: two, excavate: [r2, l2], install: {l1: shotcrete}}
  - {name: three, excavate: [r3, l3], install: {l2: shotcrete}}
  - {name: four, excavate: [r4], install: {l3: shotcrete}}
gauges:
  roof: {kind: settlement, point: [0 m, 6 m, 8 m], accuracy: 0.2 mm}
  side:
    kind: extensometer
    head: [16 m, 6 m, 6 m]
    anchors: {a: [4 m, 6 m, 6 m], b: [8 m, 6 m, 6 m]}
    accuracy: 0.05 mm
  over:
    kind: extensometer
    head: [0 m, 10 m, 16 m]
    anchors: {a: [0 m, 10 m, 8 m], b: [0 m, 10 m, 12 m]}
    accuracy: 0.05 mm
readings: readings.csv
fit: {method: gauss-newton, stages: [one, two, three]}
"""

ROUNDS = 4


def drift(n):
    """A quarter of a drift of 8 m by 4 m, with a lining at its side; n cells a side of 16 m."""
    mesh = box("hex8", (n, n, n), size=(16.0, 16.0, 16.0))
    x, y, z = mesh.points[mesh.blocks[0].nodes].mean(axis=1).T
    level = (z > 4.0) & (z < 8.0)
    found = {}
    for k in range(ROUNDS):
        here = level & (y > 4.0 * k) & (y < 4.0 * k + 4.0)
        found[f"r{k + 1}"] = np.flatnonzero(here & (x < 4.0))
        found[f"l{k + 1}"] = np.flatnonzero(here & (x > 4.0) & (x < 8.0))
    del found["l4"]
    taken = np.concatenate(list(found.values()))
    return replace(mesh, groups=found | {"rock": np.setdiff1d(np.arange(len(x)), taken)})


@pytest.fixture(scope="module")
def files(tmp_path_factory):
    """Readings of a finer mesh, disturbed, so that errors of mesh and model are looked for."""
    folder = tmp_path_factory.mktemp("drift")
    (folder / "case.yaml").write_text(CASE)
    write_deck(drift(8), folder / "drift.inp")
    found = simulate(
        str(folder / "case.yaml"), overrides=["parameters.E.start=8 GPa", "parameters.K0.start=0.7"]
    )
    noise = 1.0 + 0.04 * np.sin(np.arange(1.0, len(found.readings) + 1))
    rows = [
        f"{r.channel},{r.stage},{1e3 * r.value * part!r},mm"
        for r, part in zip(found.readings, noise.tolist(), strict=True)
    ]
    (folder / "readings.csv").write_text("\n".join(["gauge,stage,value,unit", *rows]) + "\n")
    write_deck(drift(4), folder / "drift.inp")
    return folder


@pytest.fixture
def case(files, tmp_path, monkeypatch):
    """The case in the current folder, with a reduced model, small as its mesh is."""
    monkeypatch.setattr(reduction, "PROJECTED", 0.0)
    monkeypatch.chdir(shutil.copytree(files, tmp_path / "here"))


def fitted(*overrides, control=None, **options):
    job = plan_fit(Request("case.yaml", overrides, **options))
    return fit(job, control or Control()).result


@pytest.fixture(scope="module")
def whole(files, tmp_path_factory):
    """A fit of the case, uninterrupted and with nothing known before."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(reduction, "PROJECTED", 0.0)
        patch.chdir(shutil.copytree(files, tmp_path_factory.mktemp("whole") / "here"))
        return fitted()


def test_a_fit_and_all_that_it_says_takes_fewer_evaluations(case, whole):
    plain = fitted("fit.reduced=false", output="plain.h5")
    assert whole.status == "converged"
    assert whole.prediction is not None
    assert len(whole.backtest.steps) == 1
    assert any("The mesh is too coarse" in said for said in sentences_of(whole.findings))
    assert plain.counts.evaluations > whole.counts.evaluations
    wide = whole.parameters.upper95 - whole.parameters.lower95
    for name in ("values", "lower95", "upper95"):
        ours, theirs = (getattr(r.parameters, name) for r in (whole, plain))
        assert np.all(np.abs(ours - theirs) <= 1e-4 * wide)
