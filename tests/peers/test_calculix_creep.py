"""Ground that creeps against CalculiX, an independent program, on the same mesh of hex20.

CalculiX steps through time by backward Euler; two lengths of its steps are extrapolated to none.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from support import calculix
from support.creeping import DAY, computed
from support.in_stages import model_at, write_msh
from support.meshes import box, regroup

PRESSURE, INNER, MIDDLE, OUTER = 4e6, 2.0, 2.4, 5.0
E_RING, E, NU = 20e9, 2e9, 0.3
G, K = E / 2.6, E / 1.2
G_K, ETA_K, ETA_M = 0.6e9, 0.6e9 * 12, 4e9 * 30  # Pa, Pa d
DAYS = (3.0, 10.0, 30.0, 90.0)
CREEP = {
    "Maxwell": f"{{maxwell: {{viscosity: {ETA_M!r} Pa d}}}}",
    "Kelvin": f"{{kelvin: {{G: {G_K!r} Pa, viscosity: {ETA_K!r} Pa d}}}}",
    "Burgers": f"{{kelvin: {{G: {G_K!r} Pa, viscosity: {ETA_K!r} Pa d}}, "
    f"maxwell: {{viscosity: {ETA_M!r} Pa d}}}}",
}
CASE = f"""\
format: geoident-case/1
title: A ring in a thick cylinder that creeps
analysis: solid
mesh: {{file: cylinder.msh}}
parameters: {{}}
materials:
  ring: {{E: {E_RING!r} Pa, nu: 0.2}}
  rock: {{E: {E!r} Pa, nu: {NU}, creep: CREEP}}
groups: {{ring: ring, rock: rock}}
supports: {{y0: y, y1: x, z0: z, z1: z}}
stages:
  - {{name: load, loads: {{inside: {{on: x0, pressure: {PRESSURE!r} Pa}}}}, lasts: 90 d}}
gauges:
"""


def cylinder():
    """A quarter: first axis the radius, second the angle; grouped into the ring and the rock."""
    mesh = box("hex20", (5, 2, 1))
    r = np.interp(mesh.points[:, 0], [0.0, 0.2, 1.0], [INNER, MIDDLE, OUTER])
    angle = 0.5 * np.pi * mesh.points[:, 1]
    points = np.column_stack([r * np.cos(angle), r * np.sin(angle), mesh.points[:, 2]])
    return replace(regroup(mesh, ring=lambda x: x[:, 0] < 0.2), points=points)


@pytest.mark.skipif(calculix.PROGRAM is None, reason=calculix.REMEDY)
@pytest.mark.parametrize(
    "law",
    ["Maxwell", *(pytest.param(law, marks=pytest.mark.slow) for law in ("Kelvin", "Burgers"))],
)
def test_a_cylinder_that_creeps_equals_calculix(law, tmp_path, verification):
    """The ring takes over what the rock around it gives up, so stress moves while it creeps."""
    mesh = cylinder()
    write_msh(mesh, tmp_path / "cylinder.msh", ["x0", "y0", "y1", "z0", "z1"])
    nodes = [
        int(np.argmin(np.linalg.norm(mesh.points - [r, 0.0, 0.0], axis=1)))
        for r in (INNER, MIDDLE, OUTER)
    ]
    gauges = "".join(
        f"  n{n}: {{kind: displacement, point: [{float(mesh.points[n, 0])!r} m, 0 m, 0 m], "
        "direction: [1, 0, 0], accuracy: 1 um}\n"
        for n in nodes
    )
    path = tmp_path / "case.yaml"
    path.write_text(CASE.replace("CREEP", CREEP[law]) + gauges)
    model = model_at(path, {"load": [0.0, *(day * DAY for day in DAYS[:-1])]})
    ours = computed(model)[:, 1:]
    kelvin = (G_K, ETA_K) if law != "Maxwell" else (np.inf, np.inf)
    flows = ETA_M if law != "Kelvin" else np.inf
    chains = [(G, ETA_M)] if law == "Maxwell" else calculix.side_by_side(G, kelvin, flows)
    parts = {
        "ring": [(E_RING, 0.2, np.inf)],
        # each has its part of K as of G: nu is theirs all
        "rock": [(2 * g * (1 + NU), NU, eta) for g, eta in chains],
    }
    few, many = (run(model, parts, tmp_path, steps, nodes) for steps in (6, 12))
    exact = 2.0 * many - few
    np.testing.assert_allclose(ours, exact, rtol=5e-4)
    # backward Euler comes nearer to what is ours as its steps do
    gap = [np.abs(peer - ours)[:, 1:].max() for peer in (few, many)]
    assert 1.7 < gap[0] / gap[1] < 2.3
    days = [f"{day:g}" for day in (0.0, *DAYS)]
    verification("calculix-creep", law, days, exact=exact[0], found=ours[0])


def run(model, parts, folder, steps, nodes):
    """Displacements (nodes, moments) along x, the first one when the load has come."""
    path = folder / f"steps{steps}.inp"
    calculix.write_creep(model, path, parts, DAYS, steps)
    rows = calculix.solve(path, threads=1)
    moments = rows.reshape(1 + len(DAYS), -1, 4)
    assert np.all(moments[:, nodes, 0] == np.array(nodes) + 1)
    return moments[:, nodes, 1].T
