"""A lift of concrete in the air on rock against CalculiX: heat in time, and its stresses.

CalculiX marches by backward Euler; two lengths of its steps are extrapolated to none. It takes the
hydration as a flux in the volume by a table. Both programs have the same mesh of hex20; ours is the
section as a solid of one element in thickness.
"""

from __future__ import annotations

import numpy as np
import pytest
from support import calculix
from support.heated import DAY
from support.in_stages import read, write_msh
from support.meshes import box, regroup

RISE, TIME, LAST = 38.0, 1.2 * DAY, 6.0 * DAY
ROCK = {"E": 20e9, "nu": 0.25, "alpha": 8e-6, "k": 2.9, "c": 2.2e6}
CONCRETE = {"E": 30e9, "nu": 0.2, "alpha": 1.1e-5, "k": 2.3, "c": 2.4e6}
BEGAN, AIR, FILM = 14.0, 6.0, 9.0
FACES = ((0, 1, 2, 3), (4, 7, 6, 5), (0, 4, 5, 1), (1, 5, 6, 2), (2, 6, 7, 3), (3, 7, 4, 0))
"""Corners of the faces of a hexahedron as CalculiX numbers them."""

CASE = """\
format: geoident-case/1
title: A lift in the air
analysis: solid
mesh: {file: lift.msh}
parameters: {}
materials:
  rock: {E: 20 GPa, nu: 0.25, expansion: 8e-6 1/K, conductivity: 2.9 W/mK,
    heat_capacity: 2.2 MJ/m3K}
  concrete: {E: 30 GPa, nu: 0.2, expansion: 1.1e-5 1/K, conductivity: 2.3 W/mK,
    heat_capacity: 2.4 MJ/m3K, hydration: {rise: 38 K, time: 1.2 d}}
groups: {rock: rock, lift: absent}
supports: {x0: x, z0: [x, z], y0: y, y1: y}
initial_temperature: 14 degC
stages:
  - {name: cast, install: {lift: concrete}, lasts: 6 d, moments: [MOMENTS],
     heat: {z1: {temperature: 6 degC, film: 9 W/m2K}}}
gauges:
"""
PLACES = ((0.0, 0.0, 2.0), (0.0, 0.0, 1.5), (0.0, 0.0, 1.0), (2.0, 0.0, 2.0), (2.0, 0.0, 0.5))


def peer_temperatures_and_motions(mesh, folder, steps):
    """(days, places, 4): temperature and motion by CalculiX with so many steps a day."""
    nodes = [int(np.argmin(np.linalg.norm(mesh.points - at, axis=1))) for at in PLACES]
    (block,) = mesh.blocks
    lines = ["*NODE, NSET=ALL"]
    lines += [f"{n + 1}," + ",".join(f"{v:.10e}" for v in x) for n, x in enumerate(mesh.points)]
    for name, of in (("rock", ROCK), ("lift", CONCRETE)):
        lines.append(f"*ELEMENT, TYPE=C3D20, ELSET={name.upper()}")
        for e in mesh.groups[name]:
            c = [str(n + 1) for n in block.nodes[e]]
            lines += [f"{e + 1}," + ",".join(c[:15]) + ",", ",".join(c[15:])]
        lines += [f"*MATERIAL, NAME=M{name}", "*ELASTIC", f"{of['E']},{of['nu']}", "*EXPANSION",
                  f"{of['alpha']}", "*DENSITY", "1.", "*CONDUCTIVITY", f"{of['k']}",
                  "*SPECIFIC HEAT", f"{of['c']}",
                  f"*SOLID SECTION, ELSET={name.upper()}, MATERIAL=M{name}"]  # fmt: skip
    lines += ["*NSET, NSET=READ", ",".join(str(n + 1) for n in nodes), "*BOUNDARY"]
    x, y, z = mesh.points.T
    for axis, held in ((1, (x == 0) | (z == 0)), (2, (y == y.min()) | (y == y.max())), (3, z == 0)):
        lines += [f"{n + 1},{axis},{axis}" for n in np.flatnonzero(held)]
    lines += ["*INITIAL CONDITIONS, TYPE=TEMPERATURE", f"ALL,{BEGAN}", "*AMPLITUDE, NAME=HYDRATION"]
    times = np.linspace(0.0, LAST, 2001)
    lines += [f"{t:.4f},{np.exp(-t / TIME):.8e}" for t in times]
    lines += ["*STEP, INC=100000", "*UNCOUPLED TEMPERATURE-DISPLACEMENT, DIRECT",
              f"{DAY / steps},{LAST}", "*DFLUX, AMPLITUDE=HYDRATION",
              f"LIFT,BF,{CONCRETE['c'] * RISE / TIME:.8e}", "*FILM"]  # fmt: skip
    for e, corners in enumerate(block.nodes[:, :8]):
        for number, face in enumerate(FACES, start=1):
            if np.allclose(z[corners[list(face)]], z.max()):
                lines.append(f"{e + 1},F{number},{AIR},{FILM}")
    lines += ["*NODE PRINT, NSET=READ", "NT", "*NODE PRINT, NSET=READ", "U", "*END STEP", ""]
    path = folder / f"lift{steps}.inp"
    path.write_text("\n".join(lines))
    moved = calculix.solve(path, threads=1)
    order = [moved[: len(nodes), 0].tolist().index(n + 1) for n in nodes]
    motions = moved[:, 1:].reshape(-1, len(nodes), 3)
    text = path.with_suffix(".dat").read_text().splitlines()
    rows = [line.split() for line in text if line and line.split()[0].isdigit()]
    heat = np.array([float(row[1]) for row in rows if len(row) == 2]).reshape(-1, len(nodes))
    both = np.dstack([heat[:, order], motions[:, order]])
    return both[steps - 1 :: steps]


@pytest.mark.slow
@pytest.mark.skipif(calculix.PROGRAM is None, reason=calculix.REMEDY)
def test_a_lift_in_the_air_equals_calculix(tmp_path):
    mesh = box("hex20", (3, 1, 6), size=(2.0, 0.5, 2.0))
    mesh = regroup(mesh, lift=lambda x: x[:, 2] > 1.0)
    write_msh(mesh, tmp_path / "lift.msh", ["x0", "y0", "y1", "z0", "z1"])
    text = CASE.replace("MOMENTS", ", ".join(f"{day} d" for day in range(1, 6)))
    for n, at in enumerate(PLACES):
        point = "[" + ", ".join(f"{v} m" for v in at) + "]"
        text += f"  T{n}: {{kind: thermometer, point: {point}, accuracy: 0.1 degC}}\n"
        for axis in "xz":
            text += f"  {axis}{n}: {{kind: displacement, point: {point}, component: {axis}, "
            text += f"accuracy: 0.1 mm, zero: {'cast + 0 d' if at[2] > 1 else 'virgin'}}}\n"
    path = tmp_path / "case.yaml"
    path.write_text(text)
    days = [day * DAY for day in range(1, 6)]
    own = read(path, {"cast": [0.0, *days]})[:, 1:].T.reshape(6, len(PLACES), 3)
    coarse, fine = (peer_temperatures_and_motions(mesh, tmp_path, n) for n in (6, 12))
    peer = (2.0 * fine - coarse)[:6][..., [0, 1, 3]]
    np.testing.assert_allclose(own[..., 0], peer[..., 0], atol=5e-3 * RISE)
    moved = np.isfinite(own[..., 1:])
    size = np.abs(peer[..., 1:]).max()
    assert moved.all()
    np.testing.assert_allclose(own[..., 1:], peer[..., 1:], atol=5e-3 * size)
    assert np.ptp(peer[:, :, 0]) > 10.0
