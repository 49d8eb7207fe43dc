"""Heat in stages that last, against closed forms, quadrature and differences."""

import numpy as np
import pytest
from scipy.integrate import quad, solve_ivp
from scipy.special import erfc
from support.creeping import computed
from support.derivatives import assert_slopes
from support.heated import (
    BLOCK,
    DAY,
    LIFTS,
    PARAMETERS,
    SLAB,
    THICKNESS,
    parameters_of,
    write_block,
    write_lifts,
    write_slab,
)
from support.in_stages import model_at, read, write_msh
from support.inner_faces import with_inner_faces
from support.meshes import box, from_grid

from geoident.forward.analysis.analysis import RunOptions

ALPHA, NU, E = 1e-5, 0.2, 10e9
DIFFUSIVITY = 1e-6
TIMES = [0.5 * DAY, 2 * DAY, 5 * DAY]


def cooled_slab(x, t, before=10.0, step=-30.0):
    """Temperature of a slab whose face x = 0 cools at once, the other being adiabatic."""
    n, wide = np.arange(6), 2.0 * np.sqrt(DIFFUSIVITY * t)
    images = erfc((2 * n * THICKNESS + x) / wide) + erfc((2 * (n + 1) * THICKNESS - x) / wide)
    return before + step * ((-1.0) ** n * images).sum()


def test_a_slab_that_is_cooled(tmp_path, verification):
    """erfc series; held across, it bears -E alpha T / (1 - nu) there, and shortens along."""
    found = read(write_slab(tmp_path, SLAB), {"cool": TIMES})
    for state, t in enumerate([*TIMES, 20 * DAY]):
        truth = [cooled_slab(x, t) for x in (0.5, 1.5)]
        np.testing.assert_allclose(found[:2, state], truth, atol=0.01)
        mean = quad(lambda x, t=t: cooled_slab(x, t) - 10.0, 0, THICKNESS, limit=200)[0]
        np.testing.assert_allclose(found[2, state], -ALPHA * (1 + NU) / (1 - NU) * mean, rtol=1e-3)
        stress = -E * ALPHA / (1 - NU) * (cooled_slab(0.5, t) - 10.0)
        np.testing.assert_allclose(found[3, state], stress, atol=2e-3 * E * ALPHA * 30.0)
    days = [t / DAY for t in (*TIMES, 20 * DAY)]
    for row, x in enumerate((0.5, 1.5)):
        exact = [cooled_slab(x, day * DAY) for day in days]
        verification("cooled-slab", f"{x} m deep", days, exact=exact, found=found[row])


def test_heat_flows_through_a_joint(tmp_path):
    """It is as warm as the slab without it; held at both ends it opens by what the slab shortens.

    sigma (L / M + 1 / k_n) = -alpha (1 + nu) / (1 - nu) int T, M of a slab that is held across.
    """
    text = SLAB.replace("x1: x,", "x0: x, x1: x,").replace(
        "stages:", "interfaces: {joint: {along: joint, k_n: 1 GPa/m, k_s: 1 GPa/m}}\nstages:"
    )
    text += "  J: {kind: joint-meter, interface: joint, point: [1 m, 0.5 m], component: opening,"
    text += " accuracy: 1 um}\n"
    mesh = box("quad8", (64, 1), size=(THICKNESS, 1.0))
    mesh = with_inner_faces(mesh, joint=lambda x: abs(x[..., 0] - 1.0) < 1e-9)
    write_msh(mesh, tmp_path / "slab.msh", ["x0", "x1", "y0", "y1", "joint"])
    (tmp_path / "case.yaml").write_text(text)
    found = read(tmp_path / "case.yaml", {"cool": TIMES})
    modulus = E * (1 - NU) / ((1 + NU) * (1 - 2 * NU))
    for state, t in enumerate([*TIMES, 20 * DAY]):
        truth = [cooled_slab(x, t) for x in (0.5, 1.5)]
        np.testing.assert_allclose(found[:2, state], truth, atol=0.05)
        mean = quad(lambda x, t=t: cooled_slab(x, t) - 10.0, 0, THICKNESS, limit=200)[0]
        stress = -ALPHA * (1 + NU) / (1 - NU) * mean / (THICKNESS / modulus + 1e-9)
        np.testing.assert_allclose(found[4, state], stress / 1e9, rtol=5e-3)


def test_steps_converge_with_the_second_order(tmp_path):
    model = model_at(write_slab(tmp_path, SLAB, cells=8), {"cool": [2 * DAY]})
    T = [computed(model, finer=finer)[0, 1] for finer in (1, 2, 4, 8)]
    gaps = np.abs(np.diff(T))
    assert gaps[0] < 0.01
    assert np.all(gaps[:-1] / gaps[1:] > 3.5)


PIPE = """\
format: geoident-case/1
analysis: axisymmetric
mesh: {file: ring.msh}
parameters: {}
materials:
  soil: {E: 200 MPa, nu: 0.3, expansion: 2e-5 1/K, conductivity: 3 W/mK, heat_capacity: 2 MJ/m3K}
groups: {all: soil}
supports: {y0: y, y1: y}
initial_temperature: 12 degC
heat: {x1: {temperature: 12 degC}}
stages:
  - {name: freeze, heat: {x0: {temperature: {0 d: 12 degC, 2 d: -28 degC}}}, lasts: 400 d}
gauges:
  T: {kind: thermometer, point: [0.5 m, 0.1 m], accuracy: 0.1 degC}
  u: {kind: displacement, point: [0.1 m, 0.1 m], component: x, accuracy: 0.1 mm}
  s: {kind: stress, point: [0.5 m, 0.1 m], components: [xx, zz, yy], accuracy: 1 kPa}
"""


def test_a_freeze_pipe_in_the_end(tmp_path):
    """T falls with log r; stresses of a long hollow cylinder (Timoshenko and Goodier, art. 151)."""
    a, b, r, fall, alpha, E, nu = 0.1, 2.0, 0.5, -40.0, 2e-5, 200e6, 0.3
    radii = np.geomspace(a, b, 25)
    points = np.stack(np.meshgrid(radii, [0.0, 0.2], indexing="ij"), -1).reshape(-1, 2)
    write_msh(from_grid("quad8", points, (24, 1)), tmp_path / "ring.msh", ["x0", "x1", "y0", "y1"])
    path = tmp_path / "case.yaml"
    path.write_text(PIPE)
    T, u, radial, hoop, axial = read(path, {"freeze": []})[:, -1]

    def change(x):
        return fall * np.log(b / x) / np.log(b / a)

    def integral(x):
        return quad(lambda y: change(y) * y, a, x)[0]

    factor = alpha * E / (1 - nu)
    mean = integral(b) / (b**2 - a**2)
    np.testing.assert_allclose(T, 12.0 + change(r), atol=2e-3)
    truth_radial = factor / r**2 * ((r**2 - a**2) * mean - integral(r))
    truth_hoop = factor / r**2 * ((r**2 + a**2) * mean + integral(r) - change(r) * r**2)
    truth_axial = nu * (truth_radial + truth_hoop) - alpha * E * change(r)
    size = factor * abs(fall)
    np.testing.assert_allclose(
        [radial, hoop, axial], [truth_radial, truth_hoop, truth_axial], atol=2e-3 * size
    )
    # at the wall only the hoop is stressed: u / a = (1 + nu) alpha T + (1 - nu^2) hoop / E
    wall = factor / a**2 * (2 * a**2 * mean - change(a) * a**2)
    strain = (1 + nu) * alpha * change(a) + (1 - nu**2) * wall / E
    np.testing.assert_allclose(u, a * strain, rtol=1e-3)


def test_a_block_warms_and_gives_heat_to_the_air(tmp_path):
    """rho c V T' = rho c V A' - h S (T - air), the air as a table; one temperature all over."""
    air = "{0 d: 10 degC, 4 d: 2 degC, 5 d: 8 degC}"
    text = BLOCK.replace("lasts: 10 d", f"heat: {{x1: {{temperature: {air}, film: 8 W/m2K}}}}, "
                         "lasts: 10 d").replace("PARAMETERS", "{}")  # fmt: skip
    times = [0.5 * DAY, 2 * DAY, 6 * DAY]
    found = read(write_block(tmp_path, text), {"cast": times})[0]
    rate = 8.0 / (2.4e6 * 0.4)

    def slope(t, T):
        beyond = np.interp(t / DAY, [0, 4, 5], [10, 2, 8])
        return 40.0 / (1.5 * DAY) * np.exp(-t / (1.5 * DAY)) - rate * (T - beyond)

    ends = [*times, 10 * DAY]
    truth = solve_ivp(slope, (0, ends[-1]), [18.0], "Radau", ends, rtol=1e-9, max_step=0.1 * DAY)
    np.testing.assert_allclose(found, truth.y[0], atol=0.02)


@pytest.mark.parametrize("curve", [False, True])
def test_without_exchange_it_warms_by_the_adiabatic_rise(tmp_path, curve):
    text = BLOCK.replace("PARAMETERS", "{}")
    truth = [18.0 + 40.0 * (1.0 - np.exp(-t / 1.5)) for t in (0.3, 3.0, 10.0)]
    if curve:
        text = text.replace("{rise: 40 K, time: 1.5 d}", "{curve: {1 d: 20 K, 4 d: 35 K}}")
        truth = [18.0 + 6.0, 18.0 + 30.0, 18.0 + 35.0]
    found = read(write_block(tmp_path, text), {"cast": [0.3 * DAY, 3 * DAY]})[0]
    np.testing.assert_allclose(found, truth, atol=2e-3)
    np.testing.assert_allclose(found[-1], truth[-1], atol=1e-9)


@pytest.mark.parametrize("creep", ["", ", creep: {share: 1.6, time: 4 d}"])
def test_concrete_that_hardens_while_it_warms(tmp_path, creep, verification):
    """Held on all sides it bears - int E(t) alpha dT / (1 - 2 nu), less what creep lets go.

    With creep s' = E(t) (- alpha T' / (1 - 2 nu) - creep'), and creep' = (share s / E(t) - creep)
    / time in a chain whose springs grow with the ground.
    """
    ageing = f"ageing: {{code: eurocode-2, s: 0.25}}{creep}, hydration"
    text = BLOCK.replace("PARAMETERS", "{}").replace("hydration", ageing)
    times = [0.5 * DAY, 2 * DAY]
    found = read(write_block(tmp_path, text), {"cast": times})[1]
    rise, tau, slow = 40.0, 1.5 * DAY, 4 * DAY

    def modulus(t):
        age = max(t, 3600.0) / DAY
        return 30e9 * np.exp(0.25 * (1 - np.sqrt(28.0 / age))) ** 0.3

    def slope(t, y):
        warms = ALPHA * rise / tau * np.exp(-t / tau) / (1 - 2 * NU)
        crept = (1.6 * y[0] / 30e9 - y[1]) / slow if creep else 0.0
        return [-modulus(t) * (warms + crept), crept]

    ends = [*times, 10 * DAY]
    truth = solve_ivp(slope, (0, ends[-1]), [0.0, 0.0], "Radau", ends, rtol=1e-9, atol=[1, 1e-12])
    np.testing.assert_allclose(found, truth.y[0], rtol=5e-3)
    name, days = "creeping" if creep else "without creep", [t / DAY for t in ends]
    verification("warming-concrete", name, days, exact=truth.y[0], found=found)


def test_what_is_placed_meets_what_is_there(tmp_path):
    """Without exchange the heat of two lifts stays, and hot concrete on cold rock goes halfway."""
    text = LIFTS.replace("film: $film", "film: 1e-9 W/m2K").replace("PARAMETERS", "{}")
    text = text.replace("MORE", "").replace("heat: {y0: {temperature: 9 degC}}\n", "")
    values = PARAMETERS | {"rise": "0 K", "k": "2 W/mK", "k_rock": "2 W/mK", "placed": "30 degC"}
    for name, value in values.items():
        text = text.replace(f"${name},", f"{value},").replace(f"${name}}}", f"{value}}}")
        text = text.replace(f"${name}\n", f"{value}\n")
    text = text.replace("heat_capacity: 2.2", "heat_capacity: 2.28")
    model = model_at(write_lifts(tmp_path, text, cells=3), {"lift 1": [0.0, 0.2 * DAY]})
    run = model.at(np.zeros(0), RunOptions())
    ends = {model.case.stage_names[end.number]: end.temperatures.copy() for end in run.states()}
    up = model.mesh.points[:, 1]
    np.testing.assert_allclose(ends["lift 1 + 0 d"][np.isclose(up, 2.0)], 20.0, atol=1e-9)
    M = model.analysis.conduction.operators(1, run.point).capacity.value
    heat = [
        M.sum(axis=1) @ ends[name][:, 0] for name in ("lift 1 + 0 d", "lift 1 + 4.8 h", "lift 1")
    ]
    np.testing.assert_allclose(heat[1:], heat[0], rtol=1e-9)
    np.testing.assert_allclose(heat[0], 2.28e6 * (4.0 * 10.0 + 2.0 * 30.0), rtol=1e-2)
    at = np.isclose(up, 2.0)
    np.testing.assert_allclose(ends["lift 1 + 4.8 h"][at, 0], 20.0, atol=0.3)


def seen(model, p, options):
    """What all channels see after the virgin state, in units of about one, (g, 1 + n)."""
    run = model.at(p, options)
    read = np.array([model.see(end, run) for end in run.states()])[1:]
    there = np.array([c.reads.name != "CHANGE" for c in model.case.channels])
    sizes = np.array([1e-3 if c.dimension == "length" else 1e5 if "pressure" in c.dimension else 1.0
                      for c in model.case.channels])  # fmt: skip
    assert there.any()
    return (read / sizes[:, None]).reshape(-1, read.shape[2])


OF_CONCRETE = {
    "elastic": "",
    "ageing": ", ageing: {code: eurocode-2}, creep: {kelvin: {G: 6 GPa, viscosity: 20 GPa d}}",
    "water": ", hydraulic: {permeability: 1e-10 m/s, porosity: 0.1}",
    "water and creep": ", hydraulic: {permeability: 1e-10 m/s}, creep: {share: 1, time: 3 d}",
}


SLOW = "water and creep"


@pytest.mark.parametrize(
    "more",
    [pytest.param(name, marks=[pytest.mark.slow] * (name == SLOW)) for name in OF_CONCRETE],
)
def test_derivatives_are_exact(tmp_path, more):
    text = LIFTS.replace("PARAMETERS", parameters_of(PARAMETERS)).replace("MORE", OF_CONCRETE[more])
    if "water" in more:
        text = text.replace("stages:", "drained: {x1: {}}\nstages:")
        text = text.replace("heat_capacity: 2.2 MJ/m3K}",
                            "heat_capacity: 2.2 MJ/m3K, hydraulic: impervious}")  # fmt: skip
    path = write_lifts(tmp_path, text.replace("stages:", "time_steps: 1\nstages:"))
    model = model_at(path, {"lift 1": [0.0, 0.6 * DAY], "lift 2": [2 * DAY]})
    p = np.array([parameter.start for parameter in model.case.parameters])
    found = seen(model, p, RunOptions())
    plain = RunOptions(derivatives=False)
    np.testing.assert_allclose(found[:, 0], seen(model, p, plain)[:, 0], rtol=1e-9, atol=1e-9)
    assert np.all(np.abs(found[:, 1:]).max(axis=0) > 0)
    assert_slopes(lambda q: seen(model, q, plain)[:, 0], p, found[:, 1:], model.names, step=1e-2)


STRONG = ", yield: {type: mohr-coulomb, cohesion: 1 GPa, friction: 30 deg}"


@pytest.mark.parametrize(("drains", "strength"), [(False, ""), (True, ""), (False, STRONG)])
def test_water_holds_ground_back_that_warms(tmp_path, drains, strength):
    """Held across, (M + 1/c) strain = 3 K alpha T with water that stays (c p = - strain).

    Without it 1/c drops out. The water itself does not expand.
    """
    c, G, K = 2e-10, E / (2 * (1 + NU)), E / (3 * (1 - 2 * NU))
    permeability = 1e-3 if drains else 1e-19
    text = SLAB.replace("groups: {all: rock}", "groups: {all: absent}\ndrained: {x0: {}}").replace(
        "heat: {x0: {temperature: -20 degC}}", "install: {all: rock}"
    )
    hydraulic = f"{{permeability: {permeability} m/s, storage: {c} 1/Pa}}"
    text = text.replace("MJ/m3K}", f"MJ/m3K,\n    hydration: {{rise: 30 K, time: 2 d}},"
                        f" hydraulic: {hydraulic}{strength}}}")  # fmt: skip
    text += "  p: {kind: piezometer, point: [3 m, 0.5 m], accuracy: 1 kPa}\n"
    found = read(write_slab(tmp_path, text), {"cool": [2 * DAY]})
    rises = 30.0 * (1.0 - np.exp(-np.array([1.0, 10.0])))
    strain = 3 * K * ALPHA * rises / (K + 4 / 3 * G + (0.0 if drains else 1.0 / c))
    np.testing.assert_allclose(-found[2], THICKNESS * strain, rtol=4e-3)
    pressure = 0.0 * strain if drains else -strain / c
    np.testing.assert_allclose(found[4], pressure, rtol=2e-3, atol=100.0)


def test_concrete_is_young_when_ground_becomes_it(tmp_path):
    text = BLOCK.replace("PARAMETERS", "{}").replace("{all: absent}", "{all: old}")
    text = text.replace(
        "  - {name: cast, install: {all: concrete}, placed_at: {all: 18 degC},",
        "  - {name: wait, lasts: 3 d}\n  - {name: cast, change: {all: concrete},",
    )
    old = "old: {E: 1 GPa, nu: 0.2, conductivity: 2 W/mK, heat_capacity: 2 MJ/m3K,"
    old += " hydration: {rise: 9 K, time: 1 d}}"
    text = text.replace("materials:\n", f"materials:\n  {old}\n")
    found = read(write_block(tmp_path, text), {"cast": [1.5 * DAY]})[0]
    truth = [10.0, *(10.0 + 40.0 * (1.0 - np.exp(-t / 1.5)) for t in (1.5, 10.0))]
    np.testing.assert_allclose(found, truth, atol=2e-3)


@pytest.mark.parametrize("since", ["lift 1", "lift 2"])
def test_what_covers_a_cold_face_ends_it_and_a_pipe_stays_cold(tmp_path, since):
    """The line is the top of lift 1, and inside the ground once lift 2 is on it."""
    text = LIFTS.replace("MORE", "").replace("PARAMETERS", parameters_of(PARAMETERS))
    film = "{top1: {temperature: {0 d: 12 degC, 2 d: $air, 3 d: 8 degC}, film: $film}}"
    cold_top = "{top1: {temperature: -5 degC}}" if since == "lift 1" else "{}"
    text = text.replace(film, cold_top)
    if since == "lift 2":
        text = text.replace("heat: {y1:", "heat: {top1: {temperature: -5 degC}, y1:")
    model = model_at(write_lifts(tmp_path, text), {"lift 1": [2 * DAY], "lift 2": [2 * DAY]})
    run = model.at(
        np.array([p.start for p in model.case.parameters]), RunOptions(derivatives=False)
    )
    on_line = np.isclose(model.mesh.points[:, 1], 3.0)
    cold = {}
    for end in run.states():
        temperatures = end.temperatures[on_line, 0]
        cold[model.case.stage_names[end.number]] = bool(np.allclose(temperatures, -5.0))
    assert cold["lift 1 + 2 d"] == (since == "lift 1")
    assert cold["lift 2 + 2 d"] == (since == "lift 2")
