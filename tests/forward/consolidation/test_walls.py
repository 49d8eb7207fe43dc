"""Walls on interfaces in ground whose water takes time: seepage, pits, forces, derivatives."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.special import ellipk, ellipkinc
from support.commands import run_command
from support.derivatives import assert_exact
from support.in_stages import model_at, read, write_msh
from support.inner_faces import with_inner_faces
from support.meshes import box, regroup

WEIGHT = 9.81e3  # of the water, N/m3

# --- seepage round a sheet pile ------------------------------------------------------------------

DEPTH, TIP, HEAD = 8.0, 4.0, 2.0
SEEPAGE = """\
format: geoident-case/1
analysis: plane-strain
mesh: {file: m.msh}
materials:
  sand: {E: 10 MPa, nu: 0.3, hydraulic: {permeability: 1e-8 m/s}}
groups: {all: sand}
supports: {x0: x, x1: x, y0: fixed}
water: {table: 8 m}
drained: {left: {head: 10 m}, right: {}}
structures:
  piles: {kind: beam, on: wall, EA: 1 GN/m, EI: 10 MNm2/m}
interfaces:
  contact: {along: wall, k_n: 1 GPa/m, k_s: 1 GPa/m, permeable: false}
stages:
  - {name: flow, build: [piles]}
gauges:
"""


def test_seepage_round_a_sheet_pile(tmp_path, verification):
    """Heads at both faces of a pile that reaches half of a layer (Harr 1962), 20 m on each side."""
    mesh = box("quad8", (24, 24), size=(40.0, DEPTH))
    part = mesh.points[:, 0] / 20.0 - 1.0
    across = 20.0 * np.sign(part) * (0.15 * abs(part) + 0.85 * abs(part) ** 2.5)
    mesh = replace(mesh, points=np.stack([across, mesh.points[:, 1]], axis=1))
    mesh = with_inner_faces(
        mesh, wall=lambda x: (abs(x[..., 0]) < 1e-9) & (x[..., 1] > DEPTH - TIP - 1e-9)
    )
    top = mesh.facet_groups["y1"]
    middle = mesh.points[np.concatenate([one.nodes for one in mesh.facets])[top], 0].mean(axis=1)
    halves = {"left": top[middle < 0.0], "right": top[middle > 0.0]}
    mesh = replace(mesh, facet_groups=mesh.facet_groups | halves)
    write_msh(mesh, tmp_path / "m.msh", ["x0", "x1", "y0", "wall", "left", "right"])
    places = [(side, depth) for side in (-1, 1) for depth in (1.0, 2.0, 3.0)]
    gauges = [
        f"  P{n}: {{kind: piezometer, point: [{side} mm, {DEPTH - depth} m], accuracy: 1 kPa}}\n"
        for n, (side, depth) in enumerate(places)
    ]
    (tmp_path / "case.yaml").write_text(SEEPAGE + "".join(gauges))
    side, depth = np.array(places).T
    found = (read(tmp_path / "case.yaml")[:, -1] / WEIGHT - depth) / HEAD
    down = np.tan(np.pi * depth / 2 / DEPTH) / np.tan(np.pi * TIP / 2 / DEPTH)
    m = np.sin(np.pi * TIP / 2 / DEPTH) ** 2
    exact = 0.5 - side * ellipkinc(np.arcsin(np.sqrt(1.0 - down**2)), m) / 2 / ellipk(m)
    np.testing.assert_allclose(found, exact, atol=6e-3)
    verification("sheet-pile", "24 by 24 quad8", side * depth, exact=exact, found=found)


# --- a pit ---------------------------------------------------------------------------------------

PIT = """\
format: geoident-case/1
analysis: plane-strain
mesh: {file: m.msh}
materials:
  clay:
    {E: $E, nu: 0.3, density: 1900 kg/m3, hydraulic: {permeability: $k, storage: $S}}
groups: {rock: clay, one: clay, two: clay, low: clay}
parameters:
  E: {start: 20 MPa, bounds: [1 MPa, 100 MPa]}
  k: {start: 1e-9 m/s, bounds: [1e-12 m/s, 1e-6 m/s]}
  S: {start: 1e-9 1/Pa, bounds: [1e-12 1/Pa, 1e-6 1/Pa]}
  EI: {start: 5 MNm2/m, bounds: [1 MNm2/m, 50 MNm2/m]}
  K0: {start: 0.6, bounds: [0.4, 1]}
supports: {x0: x, x1: x, y0: fixed}
gravity: 9.81 m/s2
in_situ: {model: geostatic, K0: $K0}
water: {table: 8 m}
drained: {y1: {}}
time_steps: 1
structures:
  wall: {kind: beam, on: wall, EA: 2 GN/m, EI: $EI}
  strut: {kind: strut, ends: [[[4 m, 7 m], [0 m, 7 m]]], spacing: 2 m, EA: 200 MN,
          prestress: 20 kN, second_end: symmetry}
stages:
  - {name: fill, loads: {q: {on: y1, pressure: 10 kPa}}, lasts: 1 d}
  - {name: wall, build: [wall], remove: [q], lasts: 0 d}
  - {name: dig one, excavate: [one], lasts: 2 d}
  - {name: strut, build: [strut], lasts: 1 d}
  - {name: dig two, excavate: [two], drained: {bottom: {head: 5 m}}, lasts: 2 d}
  - {name: wait, lasts: 40 d}
gauges:
  T: {kind: displacement, component: x, point: [4 m, 8 m], zero: wall, accuracy: 0.1 mm}
  A: {kind: displacement, component: x, point: [4 m, 5 m], zero: wall, accuracy: 0.1 mm}
  S: {kind: settlement, point: [5 m, 8 m], accuracy: 0.1 mm}
  N: {kind: load-cell, structure: strut, accuracy: 1 kN}
  M: {kind: load-cell, structure: wall, quantity: M, point: [4 m, 6 m], accuracy: 1 kNm/m}
  P: {kind: piezometer, point: [4.05 m, 4.5 m], accuracy: 1 kPa}
  Q: {kind: piezometer, point: [3.95 m, 4.5 m], accuracy: 1 kPa}
"""
SLIP = "  slip: {along: wall, k_n: K MPa/m, k_s: K MPa/m, permeable: FLOWS}\n"
TAIL = "  tail: {along: tail, k_n: K MPa/m, k_s: K MPa/m}\n"


def pit(folder, interfaces: str = "", *changes: tuple[str, str], n: int = 4):
    """A pit beside a wall whose lower end is 3 m above rock; the case file."""
    mesh = with_inner_faces(
        box("quad8", (n, 8), size=(8.0, 8.0)),
        wall=lambda x: (abs(x[..., 0] - 4.0) < 1e-9) & (x[..., 1] > 2.9),
        tail=lambda x: (abs(x[..., 0] - 4.0) < 1e-9) & (x[..., 1] > 0.9) & (x[..., 1] < 3.1),
        bottom=lambda x: (x[..., 0] < 4.1) & (abs(x[..., 1] - 5.0) < 1e-9),
    )
    mesh = regroup(
        mesh,
        one=lambda x: (x[:, 0] < 4.0) & (x[:, 1] > 7.0),
        two=lambda x: (x[:, 0] < 4.0) & (x[:, 1] > 5.0) & (x[:, 1] < 7.0),
        low=lambda x: x[:, 1] < 3.0,
    )
    write_msh(mesh, folder / "m.msh", ["x0", "x1", "y0", "y1", "wall", "tail", "bottom"])
    text = PIT + (f"interfaces:\n{interfaces}" if interfaces else "")
    for old, new in changes:
        assert old in text, old
        text = text.replace(old, new)
    (folder / "case.yaml").write_text(text)
    return folder / "case.yaml"


def test_a_wall_that_lets_water_through_between_stiff_interfaces_is_tied(tmp_path):
    """Motions, forces and pressures of the wall whose nodes are those of the ground, as 1 / k."""
    tied = read(pit(tmp_path))
    size = np.nanmax(np.abs(tied), axis=1, keepdims=True)
    off = []
    for k in ("1e4", "1e6"):
        found = read(pit(tmp_path, SLIP, ("K MPa", f"{k} MPa"), ("FLOWS", "true")))
        off.append(np.nanmax(np.abs(found - tied) / size))
    (leaks,) = [one for one in model_at(tmp_path / "case.yaml").notes if "flows" in one]
    assert "through the walls on 'slip'" in leaks
    assert off[0] < 0.005
    assert off[1] < 0.02 * off[0] + 1e-4  # water flows across a ten-thousandth of a face
    # one that holds it back does so from when it is built
    tight = read(pit(tmp_path, SLIP, ("K MPa", "1e6 MPa"), ("FLOWS", "false")))
    shown = ~np.isnan(tied[:, 0])
    assert (abs(tight - tied) < 2e-4 * size)[shown, 0].all()
    assert tight[-2, -1] > tied[-2, -1] + 5e3
    assert tight[-1, -1] < tied[-1, -1]


def test_strut_and_pressures_on_the_wall_are_in_balance(tmp_path):
    """Tractions and water on both sides of a wall whose tip is free."""
    heights = np.arange(3.0, 8.1)
    gauges = "".join(
        f"  {side}{y:g}: {{kind: piezometer, point: [{x} m, {y} m], accuracy: 1 kPa}}\n"
        for side, x in (("R", 4.0001), ("L", 3.9999)) for y in heights
    )  # fmt: skip
    changes = ("FLOWS", "false"), ("K MPa", "200 MPa"), ("gauges:\n", f"gauges:\n{gauges}")
    staged = model_at(pit(tmp_path, SLIP + TAIL, *changes))
    assert not any("flows" in one for one in staged.notes)
    found = staged.survey(start_of(staged), fields=False)
    joints, stages = found.interfaces, slice(-2, None)
    slip, left = sides(joints)
    bears = -(joints.areas[:, None] * joints.normal_traction[:, stages])[slip]
    water = found.computed[: 2 * len(heights), stages].reshape(2, len(heights), -1)
    right = np.nansum(bears[~left], axis=0) + np.trapezoid(water[0], heights, axis=0)
    stays = np.nansum(bears[left], axis=0) + np.trapezoid(water[1, :3], heights[:3], axis=0)
    strut = found.computed[-4, stages] / 2.0
    np.testing.assert_allclose(right - stays, strut, rtol=1e-3)


def test_a_wall_that_slips_on_both_sides_is_in_balance(tmp_path):
    """Its ground sinks beside it and heaves in the pit; without dilation, in undrained clay.

    Nearly all of both sides slip, and then nothing but a little friction holds the wall.
    """
    limits = "permeable: false, cohesion: 2 kPa, friction: 15 deg"
    changes = ("permeable: FLOWS", limits), ("K MPa", "200 MPa")
    path = pit(tmp_path, SLIP + TAIL, *changes)
    lines = path.read_text().splitlines(True)
    text = "".join(one for one in lines if "name: wait" not in one)
    path.write_text(text.replace("lasts: 2 d", "lasts: 0 d").replace("lasts: 1 d", "lasts: 0 d"))
    staged = model_at(path)
    joints = staged.survey(start_of(staged), fields=False).interfaces
    slip, left = sides(joints)
    stands = np.isfinite(joints.shear_traction[slip, -1])
    shear = (joints.areas * joints.shear_traction[:, -1])[slip]
    assert joints.slips[slip, -1].sum() >= 0.9 * stands.sum()
    np.testing.assert_allclose(shear[left].sum(), shear[~left & stands].sum(), rtol=1e-9)


def sides(joints) -> tuple[np.ndarray, np.ndarray]:
    """Which points of interfaces are on the wall, and which of these on the left below the pit."""
    slip = np.array(joints.interfaces) == "slip"
    below = joints.points[slip, 1] < 5.1
    return slip, below & (np.cumsum(below) <= 6)  # two faces of three points, then the right


def start_of(staged) -> np.ndarray:
    return np.array([one.start for one in staged.case.parameters])


def test_a_dig_beside_a_wall_is_released_in_parts(tmp_path):
    """Undrained: with none released nothing moves, with half of it half, in the end as by one."""
    whole = ("lasts: 2 d}\n  - {name: wait, lasts: 40 d}\n", "lasts: 0 d}\n")
    dig = "  - {name: dig two, excavate: [two], drained: {bottom: {head: 5 m}}, lasts: 0 d}\n"
    changes = ("K MPa", "200 MPa"), ("FLOWS", "false"), whole
    at_once = read(pit(tmp_path, SLIP + TAIL, *changes))[:, -2:]
    parts = "".join(
        f"  - {{name: part {n}, {first}release: {{two: {part}}}, lasts: 0 d}}\n"
        for n, (first, part) in enumerate((("excavate: [two], ", 0), ("", 0.5), ("", 1)))
    )
    found = read(pit(tmp_path, SLIP + TAIL, *changes, (dig, parts)))[:, -4:]
    before, change = at_once[:, 0], at_once[:, 1] - at_once[:, 0]
    size = 1e-8 * np.abs(at_once).max(axis=1)
    for k, part in enumerate((0.0, 0.5, 1.0)):
        moved = found[:, k + 1] - found[:, 0]
        assert (np.abs(moved - part * change) < size).all(), part
    np.testing.assert_allclose(found[:, 0], before, rtol=1e-12)


MORE = """\
parameters:
  k_n: {start: 80 MPa/m, bounds: [10 MPa/m, 1 GPa/m]}
  k_s: {start: 20 MPa/m, bounds: [1 MPa/m, 1 GPa/m]}
"""
LIMITS = """\
  c: {start: 5 kPa, bounds: [1 kPa, 30 kPa]}
  phi: {start: 18 deg, bounds: [5 deg, 30 deg]}
"""
SLIPS = "permeable: false, cohesion: $c, friction: $phi"
SOIL = """yield: {type: hardening-soil, E50: 0.3 $E, Eoed: 0.3 $E, m: 0.5, cohesion: 5 kPa,
    friction: 28 deg, OCR: 1.3}, """
METER = (
    "gauges:\n",
    "gauges:\n  J: {kind: joint-meter, interface: slip, point: [4 m, 5.5 m], component: slip, "
    "towards: [6 m, 5 m], zero: wall, accuracy: 0.1 mm}\n",
)


@pytest.mark.parametrize(
    ("limits", "soil"),
    [
        pytest.param("permeable: true", "", id="lets through", marks=pytest.mark.slow),
        pytest.param("permeable: false", "", id="holds back"),
        pytest.param(f"{SLIPS}, dilation: $phi", "", id="slips", marks=pytest.mark.slow),
        pytest.param(SLIPS, SOIL, id="hardens", marks=pytest.mark.slow),
    ],
)
def test_derivatives_by_all_constants_are_exact(tmp_path, limits, soil):
    """Of ground, wall, interface and in-situ stress, in a pit that is dug and consolidates."""
    changes = [
        ("permeable: FLOWS", limits), ("k_n: K MPa/m, k_s: K MPa/m", "k_n: $k_n, k_s: $k_s"),
        ("parameters:\n", MORE + (LIMITS if "$c" in limits else "")), METER,
        ("hydraulic:", f"{soil}hydraulic:"),
    ]  # fmt: skip
    staged = model_at(pit(tmp_path, SLIP + TAIL, *changes, n=2))
    p, stages = start_of(staged), staged.case.stage_names[2:]
    if "$c" in limits:
        assert staged.survey(p, fields=False).interfaces.slips.any()
    pairs = [
        (c.name, s) for c in staged.case.channels for s in stages if c.name != "N" or s != "dig one"
    ]
    step, rtol = (5e-5, 1e-5) if soil else (5e-4, 1e-7)
    assert_exact(staged.response(pairs), p, staged.names, step=step, rtol=rtol)


def test_check_lists_interfaces_with_their_strength_at_the_start(tmp_path):
    """A part R of c and tan(phi) of the soil: 0.6 times 5 kPa and tan 28 deg."""
    part = "permeable: false, R_inter: $R, of: clay"
    start = "  R: {start: 0.6, bounds: [0.2, 1]}\n"
    strength = "yield: {type: mohr-coulomb, cohesion: 5 kPa, friction: 28 deg}, hydraulic:"
    changes = [
        ("permeable: FLOWS", part), ("K MPa", "100 MPa"), ("hydraulic:", strength),
        ("parameters:\n", "parameters:\n" + start),
    ]  # fmt: skip
    said = run_command("check", str(pit(tmp_path, SLIP + TAIL, *changes))).stdout
    listed = " ".join(said[said.index("Interfaces") : said.index("Supports")].split())
    assert listed == (
        "Interfaces - slip: along wall, on both sides of wall; k_n = 100 MPa/m; k_s = 100 MPa/m; "
        "limits R_inter = R (start 0.6) of clay: cohesion 3 kPa, friction 17.7 deg at the start; "
        "holds water back "
        "- tail: along tail; k_n = 100 MPa/m; k_s = 100 MPa/m; limits none, elastic"
    )
