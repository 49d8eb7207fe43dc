"""Ground that consolidates against OpenGeoSys, an independent program, on the same mesh.

OpenGeoSys steps through time by backward Euler; two lengths of its steps are extrapolated to none.
What it said is kept in `opengeosys.json` beside this file, so that it is compared where the program
is not installed; where it is, the slow test computes these numbers again. To keep new ones:

    GEOIDENT_RENEW_VERIFICATION=1 .venv/bin/python -m pytest -m slow tests/peers/test_opengeosys.py
"""

from __future__ import annotations

import json
import os
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import pytest
from manual.records import RENEW
from support import opengeosys
from support.in_stages import read, write_msh
from support.meshes import box, regroup
from support.opengeosys import Clay

from geoident.model.mesh import Mesh

KEPT = Path(__file__).with_name("opengeosys.json")
DAY = 86400.0
DAYS = (3.0, 10.0, 30.0, 100.0, 300.0, 1000.0)
LOAD = 60e3
LAYERS = {
    "upper": Clay(E=5e6, nu=0.3, k=(2e-9, 5e-10), biot=0.9),
    "rock": Clay(E=12e6, nu=0.2, k=(1e-10, 1e-10), biot=0.8),
}
FIXED = {"x0": [0], "x1": [0], "y0": [0, 1]}
PLACES = np.array([[0.0, 10.0], [4.0, 10.0], [0.0, 8.0], [0.0, 4.0], [4.0, 6.0]])
"""Two plates and three piezometers, at nodes."""


@dataclass(frozen=True)
class Problem:
    """A strip or a round load on two layers of clay, drained at the top."""

    analysis: str
    kind: str


PROBLEMS = {
    "strip, quad8": Problem("plane-strain", "quad8"),
    "strip, tri6": Problem("plane-strain", "tri6"),
    "disc, quad8": Problem("axisymmetric", "quad8"),
}


def layers(problem: Problem) -> Mesh:
    """The mesh: the upper layer is 4 m thick, the load reaches 4 m from the middle."""
    mesh = box(problem.kind, (20, 10), size=(20.0, 10.0))
    mesh = regroup(mesh, upper=lambda x: x[:, 1] > 6.0)
    nodes = np.concatenate([facets.nodes for facets in mesh.facets])
    top = mesh.facet_groups["y1"]
    loaded = top[mesh.points[nodes[top], 0].max(axis=1) < 4.0 + 1e-9]
    return replace(mesh, facet_groups={**mesh.facet_groups, "loaded": loaded})


def ours(problem: Problem, mesh, folder: Path) -> np.ndarray:
    """What geoident reads (5, t): settlements, then pressures."""
    write_msh(mesh, folder / "m.msh", [*FIXED, "y1", "loaded"])
    materials = "".join(
        f"  {name}: {{E: {clay.E!r} Pa, nu: {clay.nu}, hydraulic: {{permeability: "
        f"{[f'{k!r} m/s' for k in clay.k]}, storage: {clay.storage!r} 1/Pa, "
        f"biot: {clay.biot}}}}}\n"
        for name, clay in LAYERS.items()
    ).replace("'", "")
    supports = ", ".join(
        f"{face}: [{', '.join('xyz'[a] for a in held)}]" for face, held in FIXED.items()
    )
    points = [[f"{x!r} m" for x in place] for place in PLACES.tolist()]
    gauges = "".join(
        f"  G{n}: {{kind: {'settlement' if n < 2 else 'piezometer'}, point: "
        f"[{', '.join(point)}], accuracy: {'0.1 mm' if n < 2 else '1 kPa'}}}\n"
        for n, point in enumerate(points)
    )
    path = folder / "case.yaml"
    path.write_text(f"""\
format: geoident-case/1
analysis: {problem.analysis}
mesh: {{file: m.msh}}
materials:
{materials}groups: {{upper: upper, rock: rock}}
supports: {{{supports}}}
drained: {{y1: {{}}}}
stages:
  - {{name: load, loads: {{q: {{on: loaded, pressure: {LOAD!r} Pa}}}}, lasts: {DAYS[-1]!r} d}}
gauges:
{gauges}""")
    return read(path, {"load": [day * DAY for day in DAYS[:-1]]})


def theirs(problem: Problem, mesh, folder: Path, steps: int) -> np.ndarray:
    """What OpenGeoSys says of the same nodes (5, t)."""
    folder.mkdir()
    moved, pressure = opengeosys.solve(
        mesh,
        folder,
        LAYERS,
        axial=problem.analysis == "axisymmetric",
        fixed=FIXED,
        drained="y1",
        loaded=("loaded", LOAD),
        times=[day * DAY for day in DAYS],
        steps=steps,
    )
    nodes = [int(np.argmin(np.linalg.norm(mesh.points - place, axis=1))) for place in PLACES]
    return np.vstack([-moved[:, nodes[:2], -1].T, pressure[:, nodes[2:]].T])


def deviations(found: np.ndarray, exact: np.ndarray) -> float:
    """The largest, by the largest that a gauge reads."""
    return float((np.abs(found - exact).max(axis=1) / np.abs(exact).max(axis=1)).max())


@pytest.mark.parametrize("name", list(PROBLEMS))
def test_layers_of_clay_consolidate_as_opengeosys_says(name, tmp_path, verification):
    problem = PROBLEMS[name]
    found = ours(problem, layers(problem), tmp_path)
    exact = np.array(json.loads(KEPT.read_text())[name])
    assert deviations(found, exact) < 1e-3
    for entry, row in (("opengeosys-settlement", 0), ("opengeosys-pressure", 2)):
        verification(entry, name, DAYS, exact=exact[row], found=found[row])


@pytest.mark.slow
@pytest.mark.skipif(opengeosys.PROGRAM is None, reason=opengeosys.REMEDY)
@pytest.mark.parametrize("name", list(PROBLEMS))
def test_opengeosys_still_says_what_is_kept(name, tmp_path):
    """And its backward Euler comes nearer to what is ours as its steps do."""
    problem = PROBLEMS[name]
    mesh = layers(problem)
    few, many = (theirs(problem, mesh, tmp_path / str(n), n) for n in (10, 20))
    exact = 2.0 * many - few
    kept = json.loads(KEPT.read_text()) if KEPT.exists() else {}
    if os.environ.get(RENEW):
        kept[name] = [[float(f"{value:.6g}") for value in row] for row in exact.tolist()]
        KEPT.write_text(json.dumps(kept, indent=1) + "\n")
    assert deviations(np.array(kept[name]), exact) < 1e-5
    found = ours(problem, mesh, tmp_path)
    gap = [np.abs(said - found)[:2].max() for said in (few, many)]
    assert 1.8 < gap[0] / gap[1] < 2.2
