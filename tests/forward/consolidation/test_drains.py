"""Vertical drains in consolidating ground against Barron, Hansbo and a drain in the mesh.

R. A. Barron (Trans. ASCE 113, 1948), S. Hansbo (Proc. 10th ICSMFE, 1981), N. Carrillo (J. Math.
Phys. 21, 1942).
"""

import numpy as np
import pytest
from support.commands import run_command
from support.derivatives import assert_exact
from support.drains import resistance
from support.in_stages import model_at, read, write_msh
from support.meshes import box, from_grid, regroup

GAMMA_W, DAY, H = 9810.0, 86400.0, 6.0
M = 8e6 * 0.7 / (1.3 * 0.4)
"""Confined modulus of the clay, Pa."""
Q = 50e3
CASE = """\
format: geoident-case/1
analysis: plane-strain
mesh: {file: m.msh}
materials:
  clay:
    E: 8 MPa
    nu: 0.3
    hydraulic: {permeability: [3e-10, 1e-10 m/s], storage: 2e-8 1/Pa, drains: {DRAINS}}
groups: {all: clay}
supports: {x0: x, x1: x, y0: fixed}
DRAINED
stages:
  - {name: load, loads: {q: {on: y1, pressure: 50 kPa}}, lasts: 200 d}
gauges:
  S: {kind: settlement, point: [0.5 m, 6 m], accuracy: 0.1 mm}
  P: {kind: piezometer, point: [0.5 m, 0 m], accuracy: 1 kPa}
  R: {kind: piezometer, point: [0.5 m, 4 m], accuracy: 1 kPa}
"""
FOOT = "drained: {y1: {}}"


def column(folder, drains, drained="drained: {}", text=CASE, **replaced):
    """A column of clay of 6 m with drains, between smooth walls."""
    write_msh(box("quad8", (1, 12), size=(1.0, H)), folder / "m.msh", ["x0", "x1", "y0", "y1"])
    text = text.replace("DRAINS", drains).replace("DRAINED", drained)
    for old, new in replaced.items():
        text = text.replace(old, new)
    path = folder / "case.yaml"
    path.write_text(text)
    return path


GRIDS = [
    ("spacing: 1 m, diameter: 5 cm", (1.05, 0.05, 0.05, 1.0), 3e-10),
    ("spacing: 1.5 m, pattern: square, width: 100 mm, thickness: 4 mm, permeability: 5e-10 m/s",
     (1.13 * 1.5, 0.052, 0.052, 1.0), 5e-10),
    ("spacing: 1 m, diameter: 6 cm, smear: 20 cm, smear_ratio: 3", (1.05, 0.06, 0.2, 3.0), 3e-10),
]  # fmt: skip


def rate(grid, k_h):
    """8 T_h / (mu t) of a grid of drains in the clay, 1/s."""
    return 8.0 * k_h / GAMMA_W / (2e-8 + 1.0 / M) / (resistance(*grid) * grid[0] ** 2)


@pytest.mark.parametrize(("drains", "grid", "k_h"), GRIDS)
def test_water_that_flows_to_drains_alone_leaves_as_barron_and_hansbo_say(
    tmp_path, verification, drains, grid, k_h
):
    t = np.array([0.1, 0.3, 1.0, 2.0]) / rate(grid, k_h)
    path = column(tmp_path, drains, **{"200 d": f"{t[-1]} s"})
    settlement, foot, middle = read(path, {"load": t[:-1]})
    left = np.exp(-t * rate(grid, k_h))
    first = 1.0 / M / (2e-8 + 1.0 / M)
    np.testing.assert_allclose(foot, Q * first * left, atol=1e-3 * Q)
    np.testing.assert_allclose(middle, foot, rtol=1e-6)
    np.testing.assert_allclose(settlement, (Q * H / M) * (1.0 - first * left), rtol=1e-3)
    variant = drains.partition(", permeability")[0].replace("smear_ratio: ", "").replace(": ", " ")
    verification("barron", variant, t / 86400.0, exact=Q * first * left, found=foot)


def test_both_ways_go_together_as_carrillo_says(tmp_path, verification):
    drains, grid, k_h = GRIDS[2]
    c_v = 1e-10 / GAMMA_W / (2e-8 + 1.0 / M)
    t = np.array([0.02, 0.05, 0.1, 0.3]) * H**2 / c_v
    path = column(tmp_path, drains.replace("1 m", "5 m"), FOOT, **{"200 d": f"{t[-1]} s"})
    settlement, foot, _ = read(path, {"load": t[:-1]})
    n = 2.0 * np.arange(400) + 1.0
    fade = np.exp(-np.outer(n**2, t * c_v / H**2) * np.pi**2 / 4.0)
    aside = np.exp(-t * rate((5.25, *grid[1:]), k_h))
    first = 1.0 / M / (2e-8 + 1.0 / M)
    below = 4.0 / np.pi * ((-1.0) ** np.arange(400) / n) @ fade
    mean = 8.0 / np.pi**2 * (n**-2) @ fade
    assert 0.1 < aside[-1] < 0.9
    np.testing.assert_allclose(foot, Q * first * below * aside, atol=2e-3 * Q)
    whole = Q * H / M
    settled = whole * (1.0 - first * mean * aside)
    np.testing.assert_allclose(settlement, settled, atol=2e-3 * whole)
    verification("carrillo", "", t / 86400.0, exact=settled, found=settlement)


CELL = """\
format: geoident-case/1
analysis: axisymmetric
mesh: {file: m.msh}
materials:
  clay: {E: 8 MPa, nu: 0.3, hydraulic: {permeability: 3e-10 m/s}}
  disturbed: {E: 8 MPa, nu: 0.3, hydraulic: {permeability: 1e-10 m/s}}
groups: {near: disturbed, rock: clay}
supports: {x0: x, x1: x, y0: y}
drained: {x0: {}}
structures: {plate: {kind: beam, on: y1, EA: 1 N/m, EI: PLATE}}
stages:
  - {name: load, build: [plate], loads: {q: {on: y1, pressure: 50 kPa}}, lasts: END s}
gauges:
"""


@pytest.mark.parametrize(
    ("plate", "ratio", "error"),
    [
        ("1e3 MNm2/m", 3.0, 0.01),
        ("1e-9 Nm2/m", 3.0, 0.013),
        ("1e3 MNm2/m", 1.0, 0.022),
        ("1e-9 Nm2/m", 1.0, 0.03),
    ],
)
def test_a_drain_in_the_mesh_does_as_drains_in_the_material(tmp_path, plate, ratio, error):
    """A cell about a drain, its smear another material, under a rigid plate and a soft fill."""
    w, s, R, n = 0.03, 0.1, 0.525, 24
    radii = np.concatenate([np.geomspace(w, s, n // 3 + 1), np.geomspace(s, R, 2 * n // 3 + 1)[1:]])
    grid = np.stack(np.meshgrid(radii, [0.0, 0.1], indexing="ij"), -1).reshape(-1, 2)
    mesh = regroup(from_grid("quad8", grid, (n, 1)), near=lambda c: c[:, 0] < s)
    write_msh(mesh, tmp_path / "cell.msh", ["x0", "x1", "y0", "y1"])
    t = np.array([0.1, 0.3, 1.0, 2.0]) / rate((2 * R, 2 * w, 2 * s, ratio), 3e-10)
    gauges = "".join(
        f"  S{k}: {{kind: settlement, point: [{r} m, 0.1 m], accuracy: 0.1 mm}}\n"
        for k, r in enumerate(0.5 * (radii[1:] + radii[:-1]))
    )
    text = CELL.replace("m.msh", "cell.msh").replace("PLATE", plate).replace("END", str(t[-1]))
    path = tmp_path / "cell.yaml"
    path.write_text(text.replace("1e-10", str(3e-10 / ratio)) + gauges)
    areas = np.diff(radii**2) / (R**2 - w**2)
    meshed = areas @ read(path, {"load": t[:-1]}) / 0.1
    drains = f"spacing: 1 m, diameter: 6 cm, smear: 20 cm, smear_ratio: {ratio}"
    path = column(tmp_path, drains, **{"200 d": f"{t[-1]} s", "storage: 2e-8 1/Pa, ": ""})
    found = read(path, {"load": t[:-1]})[0] / H
    np.testing.assert_allclose(found, meshed, atol=error * Q / M)
    np.testing.assert_allclose(found[2:], meshed[2:], atol=0.005 * Q / M)


TWO = """\
    hydraulic: {permeability: [3e-10, 1e-10 m/s], storage: 2e-8 1/Pa}
  drained clay:
"""


def test_drains_act_from_the_stage_on_that_changes_the_ground_to_theirs(tmp_path):
    """Pressures are kept when the material changes, and then fade."""
    drains, grid, k_h = GRIDS[2]
    stages = """\
  - {name: load, loads: {q: {on: y1, pressure: 50 kPa}}, lasts: 0 d}
  - {name: drains, change: {all: drained clay}, lasts: 200 d}
"""
    clay = CASE[CASE.index("    E: 8") : CASE.index("    hydraulic")]
    text = CASE.replace(clay, clay + TWO + clay)
    text = text[: text.index("  - {name")] + stages + text[text.index("gauges:") :]
    t = np.array([0.1, 1.0]) / rate(grid, k_h)
    path = column(tmp_path, drains, text=text, **{"200 d": f"{t[-1]} s"})
    settlement, foot, middle = read(path, {"drains": [0.0, t[0]]})
    first = 1.0 / M / (2e-8 + 1.0 / M)
    left = first * np.exp(-np.array([0.0, 0.0, *t]) * rate(grid, k_h))
    assert foot[0] == pytest.approx(Q * first, rel=1e-9)
    assert foot[1] == pytest.approx(foot[0], rel=1e-9)
    np.testing.assert_allclose([foot, middle], [Q * left] * 2, atol=1e-3 * Q)
    np.testing.assert_allclose(settlement, Q * H / M * (1.0 - left), atol=1e-3 * Q * H / M)


def test_heads_and_drains_make_a_steady_flow_in_the_end_and_in_time(tmp_path):
    """k_v p'' = 8 k_h / (mu D^2) p: the pressure of a head fades with the distance from it."""
    drains, grid, k_h = GRIDS[2]
    head = "drained: {y1: {head: 8 m}}"
    apart = drains.replace("1 m", "5 m")
    found = [
        read(column(tmp_path, apart, head, **{", lasts: 200 d": lasts}))
        for lasts in ("", ", lasts: 1000 years")
    ]
    grid = (5.25, *grid[1:])
    b = np.sqrt(8.0 * k_h / (resistance(*grid) * grid[0] ** 2) / 1e-10)
    for _, foot, middle in found:
        assert foot[0] == pytest.approx(2.0 * GAMMA_W / np.cosh(b * H), rel=5e-3)
        assert middle[0] == pytest.approx(foot[0] * np.cosh(b * 4.0), rel=5e-3)


def test_in_a_solid_water_flows_to_drains_by_the_mean_of_both_axes(tmp_path):
    drains, grid, _ = GRIDS[0]
    t = np.array([0.5, 1.0]) / rate(grid, 6e-10)
    mesh = box("hex20", (1, 1, 2), size=(1.0, 1.0, H))
    write_msh(mesh, tmp_path / "m.msh", ["x0", "x1", "y0", "y1", "z0", "z1"])
    text = CASE.replace("[3e-10, 1e-10 m/s]", "[4e-10, 9e-10, 1e-10 m/s]").replace("DRAINS", drains)
    text = text.replace("plane-strain", "solid").replace("y0: fixed", "y0: y, y1: y, z0: fixed")
    text = text.replace("on: y1", "on: z1").replace("[0.5 m, ", "[0.5 m, 0.5 m, ")
    path = tmp_path / "case.yaml"
    path.write_text(text.replace("DRAINED", "drained: {}").replace("200 d", f"{t[-1]} s"))
    _, foot, _ = read(path, {"load": t[:-1]})
    left = np.exp(-t * rate(grid, 6e-10)) / M / (2e-8 + 1.0 / M)
    np.testing.assert_allclose(foot, Q * left, atol=1e-3 * Q)


SITE = """\
format: geoident-case/1
analysis: plane-strain
mesh: {file: m.msh}
parameters:
  E: {start: 8 MPa, bounds: [1 MPa, 100 MPa]}
  k: {start: 2e-9 m/s, bounds: [1e-10 m/s, 1e-7 m/s]}
  kh: {start: 4e-9 m/s, bounds: [1e-10 m/s, 1e-7 m/s]}
  ratio: {start: 2.5, bounds: [1, 10]}
  smear: {start: 20 cm, bounds: [15 cm, 40 cm]}
  spacing: {start: 1.5 m, bounds: [1 m, 3 m]}
  width: {start: 10 cm, bounds: [5 cm, 12 cm]}
  head: {start: 7.5 m, bounds: [0 m, 10 m]}
materials:
  clay: {E: $E, nu: 0.3, hydraulic: {permeability: [1.5 $k, $k]}}
  drained clay:
    E: $E
    nu: 0.3
    hydraulic:
      permeability: [1.5 $k, $k]
      drains:
        {spacing: $spacing, width: $width, thickness: 4 mm, smear: $smear, smear_ratio: $ratio}
  silt:
    E: 12 MPa
    nu: 0.25
    hydraulic:
      permeability: $k
      biot: 0.9
      drains: {spacing: $spacing, pattern: square, diameter: 6 cm, permeability: $kh}
groups: {upper: clay, rock: silt}
supports: {x0: x, x1: x, y0: fixed}
water: {table: 6 m}
drained: {y1: {}}
stages:
  - {name: load, loads: {q: {on: y1, pressure: 50 kPa}}, lasts: 20 d, over: 5 d}
  - {name: drains, change: {upper: drained clay}, lasts: 40 d}
  - {name: head, drained: {y1: {head: $head}}, lasts: 30 d}
  - {name: end}
gauges:
  S: {kind: settlement, point: [0.5 m, 6 m], accuracy: 0.1 mm}
  P: {kind: piezometer, point: [0.5 m, 0 m], accuracy: 1 kPa}
  R: {kind: piezometer, point: [0.5 m, 4 m], accuracy: 1 kPa}
"""


def test_derivatives_by_all_that_drains_are_made_of_are_exact(tmp_path):
    mesh = regroup(box("quad8", (2, 8), size=(1.0, H)), upper=lambda c: c[:, 1] > 3.0)
    write_msh(mesh, tmp_path / "m.msh", ["x0", "x1", "y0", "y1"])
    path = tmp_path / "case.yaml"
    path.write_text(SITE)
    model = model_at(path, {"load": [3 * DAY], "drains": [0.0, DAY, 10 * DAY]})
    pairs = [(c.name, s) for c in model.case.channels for s in model.case.stage_names[1:]]
    p = np.array([parameter.start for parameter in model.case.parameters])
    assert_exact(model.response(pairs), p, model.names)


def test_check_says_what_drains_are_made_of(tmp_path):
    path = column(tmp_path, GRIDS[2][0])
    said = " ".join(run_command("check", str(path)).stdout.split())
    assert "drains spacing 1 m, pattern triangle, diameter 6 cm, smear 20 cm, smear_ratio 3" in said
