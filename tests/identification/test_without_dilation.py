"""c and phi from readings of ground that flows without dilation, as a user would: all defaults.

Readings are those of quadrilaterals in rows, with noise; the model has unstructured triangles, on
which the diffuse flow is not stable. The error of the mesh is asked for, as always.
"""

from __future__ import annotations

import json

import numpy as np
import pytest
from support.commands import run_command
from support.yielding import Cavity

from geoident.model.mesh import Mesh
from tests.forward.yielding.test_little_dilation import unstructured

CASE = """\
format: geoident-case/1
title: Circular opening without dilation
analysis: plane-strain
mesh: {file: MESH}
parameters:
  c:   {start: C, bounds: [0.5 MPa, 15 MPa], scale: log}
  phi: {start: PHI, bounds: [10 deg, 50 deg]}
materials:
  rock:
    elastic: isotropic
    E: 6.7776 GPa
    nu: 0.21034
    yield: {type: mohr-coulomb, cohesion: $c, friction: $phi, dilation: 0 deg}
groups: {rock: rock, core: rock}
supports: {left: x, bottom: y}
in_situ: {model: constant, xx: -30 MPa, yy: -30 MPa, zz: -30 MPa}
stages:
  - {name: first, excavate: [core], release: {core: 0.6}}
  - {name: second, release: {core: 0.9}}
  - {name: whole, release: {core: 1.0}}
gauges:
  C1: {kind: displacement, point: [1 m, 0 m], direction: [-1, 0], accuracy: 0.05 mm}
  C2: {kind: displacement, point: [0 m, 1 m], direction: [0, -1], accuracy: 0.05 mm}
  X: {kind: extensometer, head: [1 m, 0 m], anchors: {a13: [1.3 m, 0 m], a4: [4 m, 0 m]}, accuracy: 0.05 mm}
  Y: {kind: extensometer, head: [0 m, 1 m], anchors: {a2: [0 m, 2 m], a4: [0 m, 4 m]}, accuracy: 0.05 mm}
"""  # noqa: E501 - a case has lines of any length

TRUTH = {"c": 3.45e6, "phi": np.radians(30.0)}


def deck(mesh: Mesh) -> str:
    """A mesh for Abaqus, with the edges that are held."""
    lines = ["*NODE"]
    lines += [f"{k}, {x!r}, {y!r}, 0" for k, (x, y) in enumerate(mesh.points.tolist(), start=1)]
    (block,) = mesh.blocks
    lines.append(f"*ELEMENT, TYPE={ {'tri6': 'CPE6', 'quad8': 'CPE8'}[block.kind] }")
    for number, row in enumerate((block.nodes + 1).tolist(), start=1):
        lines.append(", ".join(map(str, [number, *row])))
    for name, members in mesh.groups.items():
        lines += [f"*ELSET, ELSET={name}", *map(str, (members + 1).tolist())]
    for name, axis in (("left", 0), ("bottom", 1)):
        held = 1 + np.flatnonzero(mesh.points[:, axis] < 1e-9)
        lines += [f"*NSET, NSET={name}", *map(str, held.tolist())]
    return "\n".join([*lines, ""])


@pytest.mark.slow
@pytest.mark.parametrize("method", ["gauss-newton", "complementarity"])
def test_strengths_without_dilation_are_identified(tmp_path, monkeypatch, method):
    monkeypatch.chdir(tmp_path)
    rows = Cavity().mesh("quad8", n=6, layers=80, reach=40)
    (tmp_path / "rows.inp").write_text(deck(rows))
    (tmp_path / "triangles.inp").write_text(deck(unstructured(0.10)))
    truth = CASE.replace("MESH", "rows.inp").replace("start: C", "start: 3.45 MPa")
    (tmp_path / "truth.yaml").write_text(truth.replace("start: PHI", "start: 30 deg"))
    case = CASE.replace("MESH", "triangles.inp").replace("start: C", "start: 5 MPa")
    case = case.replace("start: PHI", "start: 25 deg") + "readings: readings.csv\n"
    (tmp_path / "case.yaml").write_text(f"{case}fit: {{method: {method}}}\n")
    made = run_command("simulate", "truth.yaml", "--noise", "--seed", "3", "-o", "readings.csv")
    assert made.exit_code == 0, made.output
    done = run_command("fit", "case.yaml", "--json")
    assert done.exit_code == 0, done.output
    found = json.loads(done.stdout)
    assert found["status"] == "converged"
    for name, value in TRUTH.items():
        parameter = found["parameters"][name]
        assert parameter["lower95"] < value < parameter["upper95"]
        assert parameter["upper95"] - parameter["lower95"] < 0.2 * value
    assert found["counts"]["factorizations"] < 2000  # that of a search which is lost has no end
