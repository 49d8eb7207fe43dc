"""Interfaces in stages that last: columns on each other, creep, derivatives while they slip."""

from __future__ import annotations

import numpy as np
import pytest
from support.derivatives import assert_exact
from support.in_stages import model_at, read, write_msh
from support.inner_faces import with_inner_faces
from support.meshes import box, regroup

from tests.forward.consolidation.test_closed_forms import HEAD, Terzaghi

CLAY = {"E": 1e7, "nu": 0.25, "k": 1e-8, "S": 3e-8, "biot": 1.0}
TIMES = np.array([0.02, 0.1, 0.5, 1.0])
LOAD, K_N = 1e5, 1e9
COLUMN = """\
  sand: {E: 20 MPa, nu: 0.25}
groups: {rock: clay, low: LOW}
supports: {x0: x, x1: x, SIDES BASE: fixed}
drained: {TOP: {}}
interfaces:
  joint: {along: joint, k_n: 1 GPa/m, k_s: 1 GPa/m, permeable: PERMEABLE}
stages:
  - {name: load, loads: {q: {on: TOP, pressure: 100 kPa}}, lasts: END s}
gauges:
  S: {kind: settlement, point: [TIP], accuracy: 0.1 mm}
  H: {kind: piezometer, point: [HIGH], accuracy: 1 kPa}
  P: {kind: piezometer, point: [FOOT], accuracy: 1 kPa}
  J: {kind: joint-meter, interface: joint, point: [MIDDLE], WAY, accuracy: 0.01 mm}
"""


WALL = """\
structures:
  wall: {kind: KIND, on: joint, SECTION}
"""
SECTIONS = {
    "beam": "EA: 1 N/m, EI: 1 Nm2/m",
    "shell": "E: 1 Pa, nu: 0, thickness: 1 mm, axis: [1, 0, 0]",
}


def column(
    folder, kind: str, lasts: float, *, permeable: str, low: str = "clay", wall: bool = False
):
    """Two columns of 5 m on each other, with an interface between, or a wall of no stiffness."""
    solid = kind == "hex20"
    cells, size = ((1, 1, 20), (0.5, 0.5, 10.0)) if solid else ((1, 20), (0.5, 10.0))
    mesh = with_inner_faces(box(kind, cells, size=size), joint=lambda x: abs(x[..., -1] - 5) < 1e-9)
    mesh = regroup(mesh, low=lambda x: x[:, -1] < 5.0)
    write_msh(mesh, folder / "m.msh", sorted(set(mesh.facet_groups) - {"outer"}))
    across = "0.2 m, 0.3 m" if solid else "0.2 m"
    text = HEAD.format(analysis="solid" if solid else "plane-strain", **CLAY) + COLUMN
    if wall:
        of = "shell" if solid else "beam"
        text = text.replace("stages:\n", "stages:\n  - {name: wall, build: [wall]}\n")
        text = text.replace("WAY,", "WAY, zero: wall,") + WALL.replace("KIND", of)
        text = text.replace("SECTION", SECTIONS[of])
    words = {
        "SIDES": "y0: y, y1: y," if solid else "", "BASE": "z0" if solid else "y0",
        "TOP": "z1" if solid else "y1", "LOW": low, "PERMEABLE": permeable, "END": str(lasts),
        "TIP": f"{across}, 10 m", "MIDDLE": f"{across}, 5 m",
        "HIGH": f"{across}, 5.1 m" if low == "clay" else f"{across}, 7.5 m",
        "FOOT": f"{across}, 0 m" if low == "clay" else f"{across}, 9 m",
        "WAY": f"direction: [0, {'0, ' if solid else ''}1], towards: [{across}, 6 m]",
    }  # fmt: skip
    for word, by in words.items():
        text = text.replace(word, by)
    path = folder / "case.yaml"
    path.write_text(text)
    return path


@pytest.mark.parametrize("wall", [False, True])
@pytest.mark.parametrize("kind", ["tri6", "hex20"])
def test_columns_on_a_permeable_joint_are_one(tmp_path, kind, wall, verification):
    """Terzaghi's column; the joint closes by the effective stress in it over k_n.

    That on either side of a beam or shell does.
    """
    closed = Terzaghi(**CLAY, h=10.0, q=LOAD)
    times = TIMES * closed.h**2 / closed.c
    path = column(tmp_path, kind, times[-1], permeable="true", wall=wall)
    settlement, high, foot, joint = read(path, {"load": times[:-1]})[:, -len(times) :]
    np.testing.assert_allclose(foot, closed.pressure(0.0, TIMES), atol=3e-3 * closed.p0)
    effective = LOAD - closed.pressure(5.0, TIMES)
    np.testing.assert_allclose(joint, -effective / K_N, atol=3e-3 * LOAD / K_N)
    expected = closed.settlement(TIMES) + (1 + wall) * effective / K_N
    np.testing.assert_allclose(settlement, expected, atol=2e-3 * closed.end)
    variant = f"{kind}, water flows across{' a wall' if wall else ''}"
    verification("joint-columns", variant, TIMES, exact=expected, found=settlement)
    np.testing.assert_allclose(high, closed.pressure(5.1, TIMES), atol=5e-3 * closed.p0)


@pytest.mark.parametrize(("kind", "wall"), [("quad8", False), ("quad8", True), ("hex20", True)])
def test_an_impermeable_joint_leaves_two_columns(tmp_path, kind, wall, verification):
    """The upper one of 5 m consolidates, the lower one keeps its first pressure."""
    closed = Terzaghi(**CLAY, h=5.0, q=LOAD)
    times = TIMES * closed.h**2 / closed.c
    path = column(tmp_path, kind, times[-1], permeable="false", wall=wall)
    settlement, high, foot, joint = read(path, {"load": times[:-1]})[:, -len(times) :]
    np.testing.assert_allclose(high, closed.pressure(0.1, TIMES), atol=3e-3 * closed.p0)
    np.testing.assert_allclose(foot, closed.p0, rtol=2e-3)
    # the mean of both pressures stands in the joint, beside a wall that of its own side; and the
    # lower column keeps its first strain
    above, below = LOAD - closed.pressure(0.0, TIMES), LOAD - closed.p0
    closes = above if wall else 0.5 * (above + below)
    np.testing.assert_allclose(joint, -closes / K_N, atol=5e-3 * LOAD / K_N)
    closes = above + below if wall else closes
    expected = closed.settlement(TIMES) + closed.u0 + closes / K_N
    np.testing.assert_allclose(settlement, expected, atol=3e-3 * closed.end)
    variant = f"{kind}, water is held back{' by a wall' if wall else ''}"
    verification("joint-columns", variant, TIMES, exact=expected, found=settlement)


@pytest.mark.parametrize("wall", [False, True])
def test_a_permeable_joint_beside_ground_that_drains_drains(tmp_path, wall):
    """Clay on sand: drained at both of its faces, it is a column of 2.5 m, twice."""
    closed = Terzaghi(**CLAY, h=2.5, q=LOAD)
    times = TIMES * closed.h**2 / closed.c
    path = column(tmp_path, "quad8", times[-1], permeable="true", low="sand", wall=wall)
    _, middle, far, _ = read(path, {"load": times[:-1]})[:, -len(times) :]
    np.testing.assert_allclose(middle, closed.pressure(0.0, TIMES), atol=3e-2 * closed.p0)
    np.testing.assert_allclose(far, closed.pressure(1.5, TIMES), atol=3e-2 * closed.p0)


def test_faces_on_an_interface_are_drained_on_both_sides(tmp_path):
    """The upper column is drained at both of its ends, the lower one at its top."""
    closed, low = (Terzaghi(**CLAY, h=h, q=LOAD) for h in (2.5, 5.0))
    times = TIMES * closed.h**2 / closed.c
    path = column(tmp_path, "quad8", times[-1], permeable="false", wall=True)
    text = path.read_text().replace("{y1: {}}", "{y1: {}, joint: {}}").replace("5.1 m", "7.5 m")
    path.write_text(text)
    _, middle, foot, _ = read(path, {"load": times[:-1]})[:, -len(times) :]
    np.testing.assert_allclose(middle, closed.pressure(0.0, TIMES), atol=3e-2 * closed.p0)
    np.testing.assert_allclose(foot, low.pressure(0.0, TIMES / 4.0), atol=3e-2 * closed.p0)


SITE = """\
format: geoident-case/1
analysis: plane-strain
mesh: {file: m.msh}
parameters:
  E: {start: 8 MPa, bounds: [1 MPa, 100 MPa]}
  k: {start: 2e-9 m/s, bounds: [1e-10 m/s, 1e-7 m/s]}
  k_silt: {start: 1e-8 m/s, bounds: [1e-10 m/s, 1e-6 m/s]}
  S: {start: 2e-8 1/Pa, bounds: [1e-10 1/Pa, 1e-6 1/Pa]}
  k_n: {start: 50 MPa/m, bounds: [10 MPa/m, 1 GPa/m]}
  k_s: {start: 20 MPa/m, bounds: [1 MPa/m, 1 GPa/m]}
  c: {start: 3 kPa, bounds: [1 kPa, 30 kPa]}
  phi: {start: 15 deg, bounds: [5 deg, 30 deg]}
  level: {start: 3.6 m, bounds: [2 m, 4 m]}
materials:
  clay: {E: $E, nu: 0.3, density: 1900 kg/m3, hydraulic: {permeability: $k}}
  silt: {E: 15 MPa, nu: 0.25, density: 1900 kg/m3, hydraulic: {permeability: $k_silt, storage: $S}}
groups: {rock: clay, low: silt}
supports: {y0: fixed}
gravity: 9.81 m/s2
in_situ: {model: geostatic, K0: 0.6, held: true}
water: {table: 4 m}
drained: {y1: {}}
time_steps: 1
interfaces:
  joint: {along: joint, k_n: $k_n, k_s: $k_s, LIMIT permeable: PERMEABLE}
stages:
  - {name: load, loads: {q: {on: y1, traction: [TAU kPa, -40 kPa]}}, lasts: 20 d}
  - {name: lower, water: {table: $level}, lasts: 10 d}
  - {name: end}
gauges:
  S: {kind: settlement, point: [1 m, 4 m], accuracy: 0.1 mm}
  P: {kind: piezometer, point: [1.5 m, 1.7 m], accuracy: 1 kPa}
  J: {kind: joint-meter, interface: joint, point: [1 m, 2 m], component: slip, accuracy: 0.01 mm}
"""
SLIPS = "cohesion: $c, friction: $phi, dilation: $phi,"
SLIDES = "cohesion: $c, friction: $phi,"
"""The same without dilation: tangents are not symmetric."""


SOIL = """yield: {type: hardening-soil, E50: 0.3 $E, Eoed: 0.3 $E, m: 0.5, cohesion: 50 kPa,
    friction: 28 deg}, """


@pytest.mark.parametrize(
    ("limit", "permeable", "shear", "soil"),
    [
        pytest.param("", "false", 10, "", id="elastic"),
        pytest.param(SLIPS, "true", 16, "", id="slips", marks=pytest.mark.slow),  # takes 15 s
        pytest.param(SLIDES, "true", 10, "", id="slides", marks=pytest.mark.slow),
        pytest.param(SLIDES, "true", 13.7, SOIL, id="hardens", marks=pytest.mark.slow),
    ],
)
def test_derivatives_by_all_constants_are_exact(tmp_path, limit, permeable, shear, soil):
    """Of water that flows across, or not, and of a joint that slips while it does."""
    mesh = with_inner_faces(
        box("tri6", (2, 2), size=(3.0, 4.0)), joint=lambda x: abs(x[..., -1] - 2.0) < 1e-9
    )
    mesh = regroup(mesh, low=lambda x: x[:, -1] < 2.0)
    write_msh(mesh, tmp_path / "m.msh", ["x0", "y0", "y1", "joint"])
    text = SITE.replace("LIMIT ", limit).replace("PERMEABLE", permeable).replace("TAU", f"{shear}")
    text = text.replace("hydraulic: {permeability: $k}", f"{soil}hydraulic: {{permeability: $k}}")
    if not limit:
        lines = [x for x in text.splitlines(True) if not x.startswith(("  c:", "  phi:"))]
        text = "".join(lines)
    (tmp_path / "case.yaml").write_text(text)
    model = model_at(tmp_path / "case.yaml", {"load": [3 * 86400.0]})
    pairs = [(c.name, s) for c in model.case.channels for s in model.case.stage_names[1:4]]
    p = np.array([parameter.start for parameter in model.case.parameters])
    step, rtol = (5e-4 if soil else 2e-3), (1e-5 if limit == SLIDES else 1e-7)
    if limit:
        assert model.survey(p, fields=False).interfaces.slips.any()
    assert_exact(model.response(pairs), p, model.names, step=step, rtol=rtol)


CREEP = """\
format: geoident-case/1
analysis: plane-strain
mesh: {file: m.msh}
materials:
  clay: {E: 10 MPa, nu: 0, creep: {kelvin: {G: 2 MPa, viscosity: 1e12 Pa s}}}
groups: {rock: clay, low: clay}
supports: {x0: x, x1: x, y0: fixed}
interfaces:
  joint: {along: joint, k_n: 10 MPa/m, k_s: 1 MPa/m}
stages:
  - {name: load, loads: {q: {on: y1, pressure: 100 kPa}}, lasts: 30 d}
  - {name: end}
gauges:
  S: {kind: settlement, point: [0.2 m, 2 m], accuracy: 0.1 mm}
  J: {kind: joint-meter, interface: joint, point: [0.2 m, 1 m], component: opening, accuracy: 1 um}
"""


def test_a_joint_in_ground_that_creeps_closes_by_what_it_carries(tmp_path):
    """Under a constant pressure the column creeps as one without it, which is q / k_n longer."""
    mesh = box("quad8", (1, 4), size=(0.5, 2.0))
    mesh = with_inner_faces(mesh, joint=lambda x: abs(x[..., -1] - 1.0) < 1e-9)
    mesh = regroup(mesh, low=lambda x: x[:, -1] < 1.0)
    write_msh(mesh, tmp_path / "m.msh", ["x0", "x1", "y0", "y1", "joint"])
    path = tmp_path / "case.yaml"
    path.write_text(CREEP)
    settlement, opening = read(path, {"load": [86400.0]})
    lines = CREEP.splitlines(True)
    path.write_text("".join(x for x in lines if "joint" not in x and "interfaces" not in x))
    (whole,) = read(path, {"load": [86400.0]})
    np.testing.assert_allclose(opening, -1e5 / 1e7, rtol=1e-9)
    np.testing.assert_allclose(settlement, whole + 1e5 / 1e7, rtol=1e-9)
    assert whole[2] > 1.05 * whole[0]
