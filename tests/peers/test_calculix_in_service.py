"""A dam section in service against CalculiX, an independent program, on the same mesh of hex8.

CalculiX marches through the days by backward Euler; two lengths of its steps are extrapolated to
none. geoident solves for no day: it has modes, and temperature fields as load cases.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from support import calculix
from support.cases import displacement, make_case, material
from support.meshes import box

from geoident.fem.solvers import pick_solver
from geoident.forward.in_service.structure import service_model
from geoident.model.case import Analysis, Stage, Support
from geoident.model.in_service import DAY, Series, StructureInService
from geoident.model.parameter import Scalar

E, NU, ALPHA, K, RHO, SPECIFIC, FILM = 2.4e10, 0.2, 1e-5, 2.3, 2400.0, 900.0, 18.0
HEIGHT, BASE, COLD = 12.0, 8.0, 5.0
REST, SPAN = 366, 40  # days at rest, and days of weather
LEVELS = 5.3, 9.8
DATE = np.arange(REST + SPAN + 2.0)
SINCE = np.maximum(DATE - REST, 0.0)
AIR = COLD + 9.0 * np.sin(2.0 * np.pi * SINCE / 60.0) + 4.0 * np.sin(2.0 * np.pi * SINCE / 20.0)
WATER = COLD + 3.0 * np.sin(2.0 * np.pi * SINCE / 31.0)
LEVEL = np.where(SINCE < 15.0, *LEVELS)
FACES = ((0, 1, 2, 3), (4, 7, 6, 5), (0, 4, 5, 1), (1, 5, 6, 2), (2, 6, 7, 3), (3, 7, 4, 0))
"""Corners of the faces of a hexahedron as CalculiX numbers them."""


def dam():
    """Vertical upstream (x0), sloping downstream; thin behind both; one element along the axis."""
    mesh = box("hex8", (20, 1, 8), size=(1.0, 1.0, HEIGHT))
    x, y, z = mesh.points.T
    x = 0.5 * BASE * (1.0 - np.cos(np.pi * x))
    return replace(mesh, points=np.column_stack([x * (1.0 - 0.6 * z / HEIGHT), y, z]))


def read_nodes(mesh):
    """Crest upstream and downstream, and the middle of the downstream face."""
    places = (0.0, 0.0, HEIGHT), (0.4 * BASE, 0.0, HEIGHT), (0.7 * BASE, 0.0, HEIGHT / 2)
    return [int(np.argmin(np.linalg.norm(mesh.points - place, axis=1))) for place in places]


def own_motions(mesh):
    """What level and temperature make of the nodes that are read, day by day: (3 nodes x, z; d)."""
    axes = (1, 0, 0), (0, 0, 1)
    gauges = tuple(
        displacement(f"{n}{axis}", tuple(mesh.points[n]), axis)
        for n in read_nodes(mesh)
        for axis in axes
    )
    concrete = replace(
        material("concrete", E, NU), density=Scalar(RHO), expansion=Scalar(ALPHA),
        conductivity=Scalar(K), specific_heat=Scalar(SPECIFIC),
    )  # fmt: skip
    level, air, water = (
        Series(name, "", DATE * DAY, values, 2 * DAY)
        for name, values in (("level", LEVEL), ("air", AIR), ("water", WATER))
    )
    case = make_case(
        mesh, analysis=Analysis.SOLID, materials={"concrete": concrete},
        groups=dict.fromkeys(mesh.groups, "concrete"), stages=(Stage("in service"),),
        supports=(Support("z0", (0, 1, 2)), Support("y0", (1,)), Support("y1", (1,))),
        channels=gauges,
        service=StructureInService(
            0.0, wetted=("x0",), in_air=("x1",), film=Scalar(FILM), level=level, air=air,
            water=water,
        ),
    )  # fmt: skip
    model = service_model(mesh, case, solver=pick_solver("auto"))
    days = REST + np.arange(SPAN + 1.0)
    rows, times = np.repeat(np.arange(len(gauges)), len(days)), np.tile(days, len(gauges))
    parts = model.motions(np.zeros(0), rows, times * DAY).parts
    return {name: part[:, 0].reshape(len(gauges), -1) for name, part in parts.items()}


def deck(mesh):
    """The body, and what holds it."""
    lines = ["*NODE, NSET=ALL"]
    lines += [f"{n + 1}," + ",".join(f"{v:.10e}" for v in x) for n, x in enumerate(mesh.points)]
    lines += ["*ELEMENT, TYPE=C3D8, ELSET=E"]
    (block,) = mesh.blocks
    lines += [f"{e + 1}," + ",".join(str(n + 1) for n in c) for e, c in enumerate(block.nodes)]
    lines += ["*MATERIAL, NAME=M", "*ELASTIC", f"{E},{NU}", "*EXPANSION", f"{ALPHA}", "*DENSITY",
              f"{RHO}", "*CONDUCTIVITY", f"{K}", "*SPECIFIC HEAT", f"{SPECIFIC}",
              "*SOLID SECTION, ELSET=E, MATERIAL=M", "*NSET, NSET=READ",
              ",".join(str(n + 1) for n in read_nodes(mesh)), "*BOUNDARY"]  # fmt: skip
    z = mesh.points[:, 2]
    lines += [f"{n + 1},1,3" for n in np.flatnonzero(z == 0.0)]
    return [*lines, *(f"{n + 1},2,2" for n in np.flatnonzero(z > 0.0))]


def marched(mesh, folder, steps):
    """Motions of the nodes that are read by CalculiX, (6, d), by so many steps a day."""
    days = np.arange(SPAN + 1)
    lines = [*deck(mesh), "*INITIAL CONDITIONS, TYPE=TEMPERATURE", f"ALL,{COLD}"]
    x, _, z = mesh.points.T
    heights = np.unique(z)
    wet = LEVEL[REST + days] >= heights[:, None]
    air, water = AIR[REST + days], WATER[REST + days]
    tables = {f"Z{k}": np.where(row, water, air) for k, row in enumerate(wet)} | {"AIR": air}
    for name, values in tables.items():
        lines.append(f"*AMPLITUDE, NAME={name}")
        lines += [f"{d * DAY:.1f},{v:.8e}" for d, v in zip(days, values, strict=True)]
    lines += ["*STEP, INC=100000", "*UNCOUPLED TEMPERATURE-DISPLACEMENT, DIRECT",
              f"{DAY / steps},{SPAN * DAY}"]  # fmt: skip
    for k, height in enumerate(heights):
        lines.append(f"*BOUNDARY, AMPLITUDE=Z{k}")
        lines += [f"{n + 1},11,11,1." for n in np.flatnonzero((x == 0.0) & (z == height))]
    lines.append("*FILM, AMPLITUDE=AIR")
    outer = x > BASE * (1.0 - 0.6 * z / HEIGHT) - 1e-6
    (block,) = mesh.blocks
    for e, corners in enumerate(block.nodes):
        for number, face in enumerate(FACES, start=1):
            if outer[corners[list(face)]].all():
                lines.append(f"{e + 1},F{number},1.,{FILM}")
    lines += ["*NODE PRINT, NSET=READ", "U", "*END STEP", ""]
    path = folder / f"march{steps}.inp"
    path.write_text("\n".join(lines))
    rows = calculix.solve(path, threads=1)[:, [1, 3]].reshape(-1, 6)
    return rows[steps - 1 :: steps].T


@pytest.mark.slow
@pytest.mark.skipif(calculix.PROGRAM is None, reason=calculix.REMEDY)
def test_a_march_through_the_weather_equals_calculix(tmp_path):
    """A film downstream, water and air by the level upstream, which steps.

    CalculiX takes the mean temperature of an element of first order for its expansion, so both
    differ by the square of the elements: from 20 x 8 to 28 x 16 of them 0.6 % of the range becomes
    0.26 % along x, and 2.0 % becomes 0.7 % along z.
    """
    mesh = dam()
    own = own_motions(mesh)["temperature"]
    coarse, fine = (marched(mesh, tmp_path, steps) for steps in (2, 4))
    peer = 2.0 * fine - coarse
    ours = (own - own[:, :1])[:, 1:]
    assert np.ptp(peer, axis=1).min() > 1e-5
    off = np.abs(ours - peer).max(axis=1) / np.ptp(peer, axis=1)
    assert off[0::2].max() < 8e-3
    assert off[1::2].max() < 2.5e-2


@pytest.mark.skipif(calculix.PROGRAM is None, reason=calculix.REMEDY)
def test_a_level_that_steps_equals_calculix(tmp_path):
    """Its nodal forces are integrated here: gamma (z - y) by each of the shape functions."""
    mesh = dam()
    x, _, z = mesh.points.T
    heights = np.unique(z)
    lines = deck(mesh)
    for level in LEVELS:
        y = (np.arange(200_000) + 0.5) / 200_000 * HEIGHT
        pressure = 9810.0 * np.maximum(level - y, 0.0) * HEIGHT / len(y)
        lines += ["*STEP", "*STATIC", "*CLOAD, OP=NEW"]
        for k, height in enumerate(heights):
            force = 0.5 * (pressure * np.interp(y, heights, np.eye(len(heights))[k])).sum()
            lines += [f"{n + 1},1,{force:.8e}" for n in np.flatnonzero((x == 0) & (z == height))]
        lines += ["*NODE PRINT, NSET=READ", "U", "*END STEP"]
    path = tmp_path / "level.inp"
    path.write_text("\n".join([*lines, ""]))
    peer = calculix.solve(path, threads=1)[:, [1, 3]].reshape(2, 6)
    own = own_motions(mesh)["level"]
    for motions, days in zip(peer, (slice(0, 14), slice(16, None)), strict=True):
        off = np.abs(own[:, days] - motions[:, None]).max() / np.abs(motions).max()
        assert off < 5e-5
