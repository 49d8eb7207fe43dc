"""What displacements leave open, readings of stress settle: E, the vertical stress and K0 together.

Displacements of an elastic ground depend on stress over modulus alone. One extensometer, read in
five stages, gives thirty of them and determines none of the three; two pressure cells, or one
overcoring test, determine all. The truth is computed on another, finer mesh of other elements, and
the readings have noise of the accuracy that the case states.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from support.deck import write_deck
from support.meshes import opening

from geoident.api import fit, predict
from geoident.workflow.simulate import Noise, simulate

TRUE = {"E": 6e9, "sigma_v": 9e6, "K0": 0.7}

CASE = """\
format: geoident-case/1
title: What readings of stress are worth
analysis: plane-strain
mesh: {file: MESH}
parameters:
  E:       {start: START_E, bounds: [0.1 GPa, 200 GPa], scale: log}
  sigma_v: {start: START_V, bounds: [0.1 MPa, 200 MPa], scale: log}
  K0:      {start: START_K, bounds: [0.1, 5]}
materials:
  rock: {elastic: isotropic, E: $E, nu: 0.25}
groups: {rock: rock, core: rock}
supports: {x0: x, y0: y}
in_situ: {model: heim, vertical: $sigma_v, K0: $K0}
stages:
  - {name: s1, excavate: [core], release: {core: 0.3}}
  - {name: s2, release: {core: 0.5}}
  - {name: s3, release: {core: 0.7}}
  - {name: s4, release: {core: 0.85}}
  - {name: s5, release: {core: 1}}
gauges:
  X:
    kind: extensometer
    head: [3 m, 0 m]
    anchors: {a: [12 m, 0 m], b: [13 m, 0 m], c: [14 m, 0 m], d: [15 m, 0 m], e: [17 m, 0 m],
              f: [20 m, 0 m]}
    accuracy: 0.3 mm
"""
CELLS = """\
  P1: {kind: pressure-cell, point: [1 m, 5 m], normal: [1, 0], accuracy: 0.2 MPa}
  P2: {kind: pressure-cell, point: [5 m, 1 m], normal: [0, 1], accuracy: 0.2 MPa}
"""
OVERCORING = """\
  O:
    kind: stress
    point: [12 m, 9 m]
    components: [xx, yy, zz, xy]
    state: virgin
    accuracy: 0.2 MPa
"""
FIT = "fit: {method: gauss-newton, model_error: none}\n"


def _write(folder: Path, name: str, mesh: str, values: tuple[str, str, str], more: str) -> Path:
    text = (CASE + more + FIT).replace("MESH", mesh)
    for key, value in zip(("START_E", "START_V", "START_K"), values, strict=True):
        text = text.replace(key, value)
    path = folder / name
    path.write_text(text)
    return path


def _identified(folder: Path, more: str, seed: int):
    """A fit to what the true ground shows on another mesh."""
    shape = {"radius": 3.0, "reach": 90.0}
    write_deck(opening("quad8", 2, n=4, layers=10, **shape), folder / "coarse.inp")
    write_deck(opening("tri6", 2, n=8, layers=20, **shape), folder / "fine.inp")
    truth = _write(folder, "truth.yaml", "fine.inp", ("6 GPa", "9 MPa", "0.7"), more)
    shown = simulate(str(truth), noise=Noise.ACCURACY, seed=seed)
    rows = [f"{r.channel},{r.stage},{r.value!r}" for r in shown.readings]
    units = {c.name: "Pa" if c.dimension == "pressure" else "m" for c in shown.case.channels}
    rows = [f"{row},{units[row.split(',')[0]]}" for row in rows]
    # the virgin stress is measured once
    rows = [row for row in rows if not row.startswith("O.") or ",s1," in row]
    (folder / "readings.csv").write_text("gauge,stage,value,unit\n" + "\n".join(rows) + "\n")
    start = ("15 GPa", "4 MPa", "1.2")
    case = _write(folder, "case.yaml", "coarse.inp", start, more)
    case.write_text(case.read_text() + "readings: readings.csv\n")
    assert sum(row.startswith("X.") for row in rows) == 30
    return fit(case)


def test_thirty_displacements_determine_none_of_the_three(tmp_path):
    found = _identified(tmp_path, "", 1)
    assert not any(estimate.determined for estimate in found.parameters.values())


@pytest.mark.parametrize("more", [CELLS, OVERCORING], ids=["two pressure cells", "one overcoring"])
@pytest.mark.parametrize("seed", [1, pytest.param(2, marks=pytest.mark.slow)])
def test_a_few_stresses_beside_them_determine_all_to_ten_percent(tmp_path, more, seed):
    found = _identified(tmp_path, more, seed)
    assert found.converged
    for name, true in TRUE.items():
        estimate = found.parameters[name]
        assert estimate.determined
        assert estimate.value == pytest.approx(true, rel=0.1)
        assert 1.96 * estimate.sd < 0.1 * true
        assert abs(estimate.value - true) < 3.5 * estimate.sd + 0.01 * true


def test_later_stages_are_predicted_as_values_with_bands(tmp_path):
    """What a result is read again from keeps that cells have no zero."""
    found = _identified(tmp_path, CELLS, 3)
    later = predict(found, stages=("s4", "s5")).data
    gauges, row = later.gauges, later.gauges.channels.index("P1")
    columns = [gauges.stages.index(stage) for stage in ("s4", "s5")]
    fitted = found.data.gauges
    own = fitted.computed[fitted.channels.index("P1")]
    computed = own[[fitted.stages.index(stage) for stage in ("s4", "s5")]]
    np.testing.assert_allclose(gauges.computed[row, columns], computed, rtol=1e-9)
    assert np.all(computed > 3e6)
    band = later.prediction
    assert np.all(band.sd[row, columns] > 0)
    assert np.all(band.lower95[row, columns] < computed)
    assert np.all(computed < band.upper95[row, columns])
