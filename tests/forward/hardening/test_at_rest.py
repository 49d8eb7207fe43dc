"""Horizontal stress at rest of soil of a known past: by hand, and with exact derivatives."""

import numpy as np
import pytest
from support.derivatives import assert_slopes
from support.in_stages import model_at, write_msh
from support.meshes import box, regroup

from geoident.forward.analysis.analysis import RunOptions

LAYERS = """\
format: geoident-case/1
analysis: plane-strain
mesh: {file: m.msh}
gravity: 10 m/s2
water: {table: 8 m}
parameters:
  OCR: {start: 3, bounds: [1, 5]}
  POP: {start: 200 kPa, bounds: [0 kPa, 400 kPa]}
  K0nc: {start: 0.6, bounds: [0.4, 0.7]}
  nu: {start: 0.25, bounds: [0.1, 0.4]}
  phi: {start: 24 deg, bounds: [15 deg, 35 deg]}
materials:
  sand:
    {E: 80 MPa, nu: 0.2, density: 2000 kg/m3, yield: {type: hardening-soil, E50: 25 MPa, m: 0.5,
      cohesion: 1 kPa, friction: 30 deg}}
  clay:
    E: 20 MPa
    nu: $nu
    density: 2000 kg/m3
    yield: {type: hardening-soil, E50: 6 MPa, Eoed: 5 MPa, m: 0.8, cohesion: 5 kPa,
      friction: $phi, K0nc: $K0nc, OCR: $OCR, POP: $POP}
  rock: {E: 1 GPa, nu: 0.2, density: 2000 kg/m3}
groups: {sand: sand, clay: clay, rock: rock}
supports: {x0: x, x1: x, y0: fixed}
in_situ: {model: geostatic, K0: {rock: 0.8}}
stages:
  - {name: load, loads: {q: {on: y1, pressure: 1 kPa}}}
gauges:
  top: {kind: stress, point: [1 m, 9.8 m], components: [xx, yy], accuracy: 1 kPa}
  clay: {kind: stress, point: [1 m, 6 m], components: [xx, yy], accuracy: 1 kPa}
  sand: {kind: stress, point: [1 m, 3 m], components: [xx, yy], accuracy: 1 kPa}
  rock: {kind: stress, point: [1 m, 1 m], components: [xx, yy], accuracy: 1 kPa}
"""


@pytest.fixture
def layers(tmp_path):
    mesh = regroup(
        box("quad8", (1, 10), size=(2.0, 10.0)),
        clay=lambda c: c[:, 1] > 4.0,
        sand=lambda c: (c[:, 1] < 4.0) & (c[:, 1] > 2.0),
    )
    write_msh(mesh, tmp_path / "m.msh", ["x0", "x1", "y0", "y1"])
    path = tmp_path / "case.yaml"
    path.write_text(LAYERS)
    return path


def test_without_a_given_ratio_it_follows_from_ocr_and_pop(layers):
    model = model_at(layers)
    start = np.array([parameter.start for parameter in model.case.parameters])

    def stresses(p, *, derivatives=False):
        run = model.at(p, RunOptions(derivatives=derivatives))
        return model.see(next(iter(run.states())), run)

    columns = stresses(start, derivatives=True).reshape(8, -1)
    found = -columns[:, 0].reshape(4, 2) / 1e3
    water = 9.81 * np.array([0.0, 2.0, 5.0, 7.0])
    upright = 20.0 * np.array([0.2, 4.0, 7.0, 9.0]) - water
    highest = 3.0 * upright[1] + 200.0
    sine, a = np.sin(np.radians(24.0)), 5.0 / np.tan(np.radians(24.0))
    sides = [
        (upright[0] + a) * (1.0 + sine) / (1.0 - sine) - a,  # no more than it bears
        0.6 * highest - 0.25 / 0.75 * (highest - upright[1]),
        0.5 * upright[2],
        0.8 * upright[3],
    ]
    np.testing.assert_allclose(found[:, 1], upright + water, rtol=1e-9)
    np.testing.assert_allclose(found[:, 0], sides + water, rtol=1e-9)
    assert (np.abs(columns[:, 1:]).max(axis=0) > 0.0).all()
    assert_slopes(
        lambda p: stresses(p)[..., 0].ravel(), start, columns[:, 1:], model.names, step=1e-4,
        rtol=1e-7,
    )  # fmt: skip


@pytest.mark.parametrize(("past", "highest"), [(150.0, 150.0), (40.0, 80.0 - 9.81 * 2.0)])
def test_a_preconsolidation_stress_counts_where_it_is_more_than_the_weight(layers, past, highest):
    text = layers.read_text().replace(
        "OCR: $OCR, POP: $POP", f"preconsolidation_stress: {past} kPa"
    )
    kept = [line for line in text.splitlines() if not line.startswith(("  OCR", "  POP"))]
    layers.write_text("\n".join(kept))
    model = model_at(layers)
    run = model.at(np.array([one.start for one in model.case.parameters]), RunOptions())
    found = -model.see(next(iter(run.states())), run).reshape(8, -1)[:, 0].reshape(4, 2) / 1e3
    upright, water = 80.0 - 9.81 * 2.0, 9.81 * 2.0
    sides = 0.6 * highest - 0.25 / 0.75 * (highest - upright)
    np.testing.assert_allclose(found[1], [sides + water, upright + water], rtol=1e-9)
