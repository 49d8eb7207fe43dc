"""Strengths and angles as parameters of a whole case: exact derivatives of its readings."""

from __future__ import annotations

import numpy as np
import pytest
from support.derivatives import assert_slopes
from support.trench import CASE, write_case

from geoident.fem.solvers import pick_solver
from geoident.forward.model import staged_model
from geoident.io.case.file import read_case
from geoident.io.mesh.file import read_mesh

NUMBERS = """\
  c: {start: 0.25 MPa, bounds: [0.1 MPa, 3 MPa]}
  phi: {start: 30 deg, bounds: [5 deg, 50 deg]}
  dip: {start: 25 deg, bounds: [5 deg, 60 deg]}
  psi: {start: 10 deg, bounds: [0 deg, 20 deg]}
"""
JOINTS = "{type: weak-plane, dip: $dip, cohesion: 0.3 MPa, friction: 20 deg, tension: 0.1 $c}"
YIELDS = {
    "joints": (f"[{{type: tresca, strength: 0.6 MPa, planes: 8}}, {JOINTS}]", {"dip"}),
    "polyhedra": (
        "[{type: mohr-coulomb, cohesion: $c, friction: $phi, planes: 12}, "
        "{type: drucker-prager, cohesion: 1.2 $c, friction: $phi, tension: 0.5 $c}]",
        {"c", "phi"},
    ),
    "smooth": (
        "{type: mohr-coulomb, cohesion: $c, friction: $phi, dilation: $psi, tension: 0.5 $c}",
        {"c", "phi", "psi"},
    ),
}


@pytest.mark.parametrize("name", YIELDS)
def test_readings_follow_strengths_and_angles_exactly(name, tmp_path):
    text, used = YIELDS[name]
    lines = [line for line in NUMBERS.splitlines() if line.split(":")[0].strip() in used]
    if "$c" in text and "c" not in used:
        text = text.replace("0.1 $c", "25 kPa")
    case = CASE.replace("nu: 0.25}", f"nu: 0.25, yield: {text}}}")
    case = case.replace("parameters:\n", "\n".join(["parameters:", *lines, ""]))
    write_case(tmp_path)
    (tmp_path / "case.yaml").write_text(case, encoding="utf-8")
    loaded = read_case(str(tmp_path / "case.yaml"))
    model = staged_model(
        read_mesh(loaded.mesh_path, dim=2), loaded.case, solver=pick_solver("auto")
    )
    response = model.response([(r.channel, r.stage) for r in loaded.case.readings])
    p = np.array([parameter.start for parameter in loaded.case.parameters])
    _, jacobian = response.evaluate(p)
    assert np.abs(jacobian).max(axis=0).min() > 0
    assert_slopes(response.readings, p, jacobian, model.names, step=1e-4, rtol=1e-6)
