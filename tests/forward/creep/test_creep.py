"""Creep and ageing in stages that last, against closed forms and differences."""

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.linalg import expm
from support.creeping import (
    BAR,
    DAY,
    RADIUS,
    SHELL,
    TUNNEL,
    computed,
    write_bar,
    write_tunnel,
)
from support.derivatives import assert_slopes
from support.in_stages import model_at, write_msh
from support.meshes import box

from geoident.forward.analysis.analysis import RunOptions

P = 5e6
GM, GK = 1e9, 0.5e9
ETA_M, ETA_K = 5e9 * 365 * DAY, 0.5e9 * 60 * DAY
BURGERS = (
    f"{{kelvin: {{G: {GK!r} Pa, viscosity: {ETA_K!r} Pa s}}, "
    f"maxwell: {{viscosity: {ETA_M!r} Pa s}}}}"
)
LINED_AT = 10 * DAY
DAYS = [11.0, 20.0, 30.0, 60.0, 90.0, 180.0, 365.0, 730.0, 1825.0]


def ring_stiffness(E, nu, inner, outer):
    """Pressure on the outer face of a ring by its motion, Pa/m, in plane strain (Lame)."""
    lame, mu = E * nu / ((1 + nu) * (1 - 2 * nu)), E / (2 * (1 + nu))
    # the radial stress A - B / r^2 vanishes at the inner face and is -1 at the outer
    B = 1.0 / (1.0 / outer**2 - 1.0 / inner**2)
    return 1.0 / abs(B / inner**2 * outer / (2 * (lame + mu)) + B / (2 * mu * outer))


def burgers_tunnel(days, ks):
    """Motion of the wall of a tunnel in Burgers rock that shears, m, lined by a ring at day 10.

    u = R / 2 (s / G + y_M + y_K), where s = P - ks (u - u at the lining) flows, y_M' = s / eta_M,
    and y_K' = (s - G_K y_K) / eta_K.
    """
    half, flow = RADIUS / 2, np.array([1.0 / ETA_M, 1.0 / ETA_K])
    free = np.array([[0.0, 0.0], [0.0, -GK / ETA_K]])

    def at(t, y, pull, stiffness):
        """Strains after t where s = pull - stiffness (y_M + y_K)."""
        A = free - stiffness * np.outer(flow, [1.0, 1.0])
        whole = np.zeros((3, 3))
        whole[:2, :2], whole[:2, 2] = A, pull * flow
        return (expm(whole * t) @ [*y, 1.0])[:2]

    y_lined = at(LINED_AT, np.zeros(2), P, 0.0)
    u_lined = half * (P / GM + y_lined.sum())
    soft = 1.0 + ks * half / GM
    u = []
    for t in np.array(days) * DAY:
        if t <= LINED_AT:
            u.append(half * (P / GM + at(t, np.zeros(2), P, 0.0).sum()))
            continue
        pull, stiffness = (P + ks * u_lined) / soft, ks * half / soft
        y = at(t - LINED_AT, y_lined, pull, stiffness)
        u.append(half * ((pull - stiffness * y.sum()) / GM + y.sum()))
    return np.array(u)


def test_a_lined_tunnel_in_burgers_rock(tmp_path, verification):
    """The ring takes nothing of what crept before, and its share of all that comes after."""
    path = write_tunnel(tmp_path, TUNNEL.replace("CREEP", BURGERS))
    model = model_at(path, {"dig": [DAY, 5 * DAY], "line": [(d - 10) * DAY for d in DAYS]})
    days = [1.0, 5.0, 10.0, *DAYS, 3650.0]
    ks = ring_stiffness(20e9, 0.2, RADIUS - SHELL, RADIUS)
    exact = burgers_tunnel(days, ks)
    found = computed(model)[0, 1:]
    np.testing.assert_allclose(found, exact, rtol=2e-4)
    verification("burgers-tunnel", "", days, exact=exact, found=found)
    unlined = P * RADIUS / 2 * (1 / GM + DAY / ETA_M - np.expm1(-GK * DAY / ETA_K) / GK)
    assert exact[0] == pytest.approx(unlined, rel=1e-12)


def test_steps_in_time_are_of_second_order(tmp_path, verification):
    """Error against very many steps, of a tunnel whose ring takes most of what creeps."""
    path = write_tunnel(
        tmp_path, TUNNEL.replace("CREEP", BURGERS).replace("20 GPa", "200 GPa"), cells=8
    )
    model = model_at(path, {"line": [30 * DAY, 365 * DAY]})
    fine = computed(model, finer=8)[0, 3:]
    runs = [computed(model, finer=k)[0, 3:] for k in (1, 2, 4)]
    errors = [np.abs(run / fine - 1.0).max() for run in runs]
    assert errors[0] < 3e-4
    assert errors[0] / errors[1] > 3.0
    assert errors[1] / errors[2] > 3.0
    first = [run[0] for run in runs]
    verification("burgers-steps", "", [3, 6, 12], exact=fine[0], found=first)


def bar(tmp_path, creep, moments, **changes):
    """Motions of the end and the side of a bar, and its stress, at moments in days."""
    text = BAR.replace("CREEP", creep)
    for old, new in changes.items():
        assert old in text
        text = text.replace(old, new)
    return computed(model_at(write_bar(tmp_path, text), {"load": [d * DAY for d in moments]}))[
        :, 1:
    ]


ELASTIC = 1e6 * (1 - 0.2**2) / 10e9
"""Strain of the bar in plane strain."""


def test_a_kelvin_bar(tmp_path, verification):
    days = np.array([0.1, 3.0, 30.0, 100.0])
    found = bar(tmp_path, "{share: 0.8, time: 20 d}", days[:-1])
    exact = ELASTIC * (1 - 0.8 * np.expm1(-days / 20))
    np.testing.assert_allclose(found[0], exact, rtol=1e-4)
    verification("kelvin-bar", "", days, exact=exact, found=found[0])
    np.testing.assert_allclose(found[1] / found[0], -0.2 / 0.8, rtol=1e-9)


@pytest.mark.parametrize("part", ["shear", "volume", "both"])
def test_creep_in_shear_and_in_volume(tmp_path, part):
    """Under a stress that stays each part of the strain grows by itself: Hooke's law with K and G.

    In plane strain the axial stress changes meanwhile, but not where the bar is pulled along all
    three axes alike, or sheared; so a wall is pulled on both sides.
    """
    pull = "{on: x1, traction: [1 MPa, 0 MPa]}"
    text = BAR.replace("CREEP", f"{{share: 0.8, time: 20 d, in: {part}}}")
    text = text.replace(
        f"{{pull: {pull}}}",
        f"{{pull: {pull}, side: {{on: y1, traction: [0 MPa, -1 MPa]}}}}",
    )
    found = computed(model_at(write_bar(tmp_path, text), {"load": [20 * DAY]}))[:2, 1]
    G = 10e9 / 2.4
    grown = 1.0 if part == "volume" else 1 - 0.8 * np.expm1(-1.0)
    np.testing.assert_allclose(found, [1e6 / (2 * G) * grown, -1e6 / (2 * G) * grown], rtol=1e-5)


def test_a_bar_relaxes(tmp_path, verification):
    """Held at its length, the stress of a Maxwell bar dies away; steps do not swing."""
    held = "supports: {x1: {x: 0.1 mm}}"
    eta = 10e9 / 2.4 * 5 * DAY  # G T
    days = np.array([1.0, 5.0, 20.0, 100.0])
    found = bar(
        tmp_path, f"{{maxwell: {{viscosity: {eta!r} Pa s}}, in: both}}", days[:-1],
        **{"loads: {pull: {on: x1, traction: [1 MPa, 0 MPa]}}": held},
    )  # fmt: skip
    stress = 1e-4 * 10e9 / (1 - 0.2**2) * np.exp(-days / 5)
    np.testing.assert_allclose(found[2], stress, rtol=1e-3, atol=2e-4 * stress[0])
    verification("relaxation", "", days, exact=stress, found=found[2])


def test_logarithmic_creep_under_steps_of_stress(tmp_path, verification):
    """Each step of stress creeps with the logarithm of its own time."""
    text = BAR.replace("CREEP", "{share: 0.3, time: 2 h, law: logarithmic}")
    text += ""
    more = (
        "  - {name: more, loads: {pull: {on: x1, traction: [3 MPa, 0 MPa]}}, lasts: 300 d}\n"
        "  - {name: less, remove: [pull], lasts: 1000 d}\n"
        "gauges:"
    )
    path = write_bar(tmp_path, text.replace("gauges:", more))
    days = {"load": [0.01, 1.0, 10.0], "more": [0.1, 30.0], "less": [0.1, 30.0]}
    found = computed(model_at(path, {k: [d * DAY for d in v] for k, v in days.items()}))[0, 1:]

    def strain(t):
        steps = ((1.0, 0.0), (2.0, 100.0), (-3.0, 400.0))
        at = [s * (1 + 0.3 * np.log1p((t - t0) * 12)) for s, t0 in steps if t > t0]
        return ELASTIC * sum(at)

    t = [0.01, 1.0, 10.0, 100.0, 100.1, 130.0, 400.0, 400.1, 430.0, 1400.0]
    exact = [strain(x) for x in t]
    np.testing.assert_allclose(found, exact, rtol=2e-3)
    verification("logarithmic-creep", "", t, exact=exact, found=found)


def test_a_stage_without_duration_is_the_end_of_creep(tmp_path):
    """The long-term moduli, also where the ground has crept for a while before."""
    text = BAR.replace("CREEP", "[{share: 0.8, time: 20 d}, {share: 0.2, time: 1 d, in: shear}]")
    later = (
        "  - {name: later}\n"
        "  - {name: more, loads: {pull: {on: x1, traction: [3 MPa, 0 MPa]}}}\n"
        "  - {name: less, loads: {pull: {on: x1, traction: [2 MPa, 0 MPa]}}}\n"
        "gauges:"
    )
    found = computed(model_at(write_bar(tmp_path, text.replace("gauges:", later))))[0, 1:]
    long = text.replace("lasts: 100 d", "lasts: 100000 d")
    at_end = computed(model_at(write_bar(tmp_path, long)))[0, 1]
    assert found[1:] == pytest.approx(at_end * np.array([1.0, 3.0, 2.0]), rel=1e-6)
    at_once = computed(model_at(write_bar(tmp_path, text.replace(", lasts: 100 d", ""))))[0, 1]
    assert at_once == pytest.approx(at_end, rel=1e-6)


PARAMETERS = """
  G: {start: 1 GPa, bounds: [0.1 GPa, 10 GPa]}
  GK: {start: 0.5 GPa, bounds: [0.1 GPa, 10 GPa]}
  eta_K: {start: 30 GPa d, bounds: [1 GPa d, 100 GPa d]}
  eta_M: {start: 0.3 GPa years, bounds: [1 GPa d, 100 GPa years]}
  share: {start: 0.2, bounds: [0, 1]}
  time: {start: 3 d, bounds: [1 d, 30 d]}
  E: {start: 25 GPa, bounds: [5 GPa, 50 GPa]}
  creep: {start: 1.2, bounds: [0, 5]}
  s: {start: 0.25, bounds: [0.1, 0.5]}
  young: {start: 10 GPa, bounds: [1 GPa, 30 GPa]}
"""

OF_EVERYTHING = (
    TUNNEL.replace("parameters: {}", f"parameters:{PARAMETERS.rstrip()}")
    .replace("G: 1 GPa, creep: CREEP", """G: $G, creep: [
    {kelvin: {G: $GK, viscosity: $eta_K}, maxwell: {viscosity: $eta_M}},
    {share: $share, time: $time, law: logarithmic, in: shear},
    {share: 0.5 $share, time: 2 $time}, {kelvin: {K: 2 $GK, viscosity: $eta_K}, in: volume}]""")
    .replace("{E: 20 GPa, nu: 0.2}", """
    {E: $E, nu: 0.2, ageing: {code: eurocode-2, s: $s}, creep: {share: $creep, time: $time}}
  more: {E: $E, nu: 0.2, ageing: {curve: {1 d: $young, 28 d: 25 GPa}}}""")
    .replace("install: {shell: ring}, lasts: 3640 d}", "install: {shell: ring}, lasts: 50 d}\n"
             "  - {name: thick, install: {core: more}, lasts: 100 d}")
)  # fmt: skip


def test_derivatives_are_exact(tmp_path):
    path = write_tunnel(tmp_path, OF_EVERYTHING, cells=4)
    assert_exact(model_at(path, {"dig": [DAY], "line": [3 * DAY], "thick": [2 * DAY]}), 3)


def test_derivatives_with_water_are_exact(tmp_path):
    parameters = """parameters:
  E: {start: 2 MPa, bounds: [1 MPa, 9 MPa]}
  share: {start: 0.6, bounds: [0, 3]}
  time: {start: 200 d, bounds: [1 d, 900 d]}
  k: {start: 1e-9 m/s, bounds: [1e-11 m/s, 1e-7 m/s], scale: log}"""
    text = SOFT_CLAY.replace("parameters: {}", parameters).replace("E: 2 MPa, nu", "E: $E, nu")
    text = text.replace("share: 0.6, time: 200 d", "share: $share, time: $time, in: shear")
    text = text.replace("permeability: 1e-9 m/s", "permeability: $k")
    write_msh(box("quad8", (1, 5), size=(0.4, 5.0)), tmp_path / "m.msh", ["x0", "x1", "y0", "y1"])
    path = tmp_path / "case.yaml"
    path.write_text(text)
    assert_exact(model_at(path, {"load": [10 * DAY, 200 * DAY]}), 0)


def assert_exact(model, second_from):
    """Derivatives of what two channels see, the second from a state on, are those of differences.

    Args:
        model: whose first channel is a motion, and whose second is a stress or a pressure.
        second_from: the first state after the virgin one at which the second exists.
    """
    p = np.array([parameter.start for parameter in model.case.parameters])

    def observed(p):
        run = model.at(p, RunOptions(derivatives=False))
        seen = np.array([model.see(end, run)[:, 0] for end in run.states()])[1:]
        return np.concatenate([seen[:, 0] * 1e3, seen[second_from:, 1] / 1e5])

    run = model.at(p, RunOptions())
    seen = np.array([model.see(end, run) for end in run.states()])[1:]
    found = np.concatenate([seen[:, 0] * 1e3, seen[second_from:, 1] / 1e5])
    np.testing.assert_allclose(found[:, 0], observed(p), rtol=1e-12)
    assert np.all(np.abs(found[:, 1:]).max(axis=0) > 0)
    assert_slopes(observed, p, found[:, 1:], model.names, step=1e-2)


SOFT_CLAY = """\
format: geoident-case/1
analysis: plane-strain
mesh: {file: m.msh}
parameters: {}
materials:
  clay:
    {E: 2 MPa, nu: 0.25, creep: {share: 0.6, time: 200 d},
     hydraulic: {permeability: 1e-9 m/s, storage: 1e-12 1/Pa}}
groups: {all: clay}
supports: {x0: x, x1: x, y0: [x, y]}
drained: {y1: {}}
stages:
  - {name: load, loads: {q: {on: y1, pressure: 100 kPa}}, lasts: 2000 d}
gauges:
  S: {kind: settlement, point: [0.2 m, 5 m], accuracy: 0.1 mm}
  P: {kind: piezometer, point: [0.2 m, 0 m], accuracy: 1 kPa}
"""


def of_transform(transform, t, terms=24):
    """A function of time by its Laplace transform: fixed Talbot contour (Abate & Valko 2004)."""
    r = 2 * terms / (5 * t)
    theta = np.arange(1, terms) * np.pi / terms
    cot = 1 / np.tan(theta)
    s = r * theta * (cot + 1j)
    sigma = theta + (theta * cot - 1) * cot
    parts = np.exp(t * s) * np.array([transform(x) for x in s]) * (1 + 1j * sigma)
    return r / terms * (0.5 * np.exp(r * t) * transform(r).real + parts.real.sum())


def test_a_clay_layer_consolidates_and_creeps(tmp_path):
    """The theory of Taylor and Merchant, a skeleton with a Kelvin element: Laplace transforms."""
    write_msh(box("quad8", (1, 40), size=(0.4, 5.0)), tmp_path / "m.msh", ["x0", "x1", "y0", "y1"])
    path = tmp_path / "case.yaml"
    path.write_text(SOFT_CLAY)
    days = np.array([10.0, 50.0, 200.0, 500.0, 2000.0])
    found = computed(model_at(path, {"load": days[:-1] * DAY}))[:, 1:]
    E, nu, q, H = 2e6, 0.25, 1e5, 5.0
    M = E * (1 - nu) / ((1 + nu) * (1 - 2 * nu))

    def layer(s):
        soft = (1 + 0.6 / (1 + s * 200 * DAY)) / M
        root = np.sqrt(9810.0 * s * soft / 1e-9)
        return soft, root

    def settlement(s):
        soft, root = layer(s)
        return soft * q / s * np.tanh(root * H) / root

    def pressure(s):
        return q / s * (1 - 1 / np.cosh(layer(s)[1] * H))

    exact = [[of_transform(f, d * DAY) for d in days] for f in (settlement, pressure)]
    np.testing.assert_allclose(found[0], exact[0], rtol=2e-3)
    np.testing.assert_allclose(found[1], exact[1], atol=2e-3 * q)


CAST = """  - {name: cast, install: {all: bar}, lasts: 7 d}
  - {name: load, loads: {pull: {on: x1, traction: [1 MPa, 0 MPa]}}, lasts: 100 d}
gauges:"""


def cast(tmp_path, ageing, load):
    """What is seen of a bar that is cast seven days before it is loaded."""
    text = BAR[: BAR.index("  - {name: load")] + CAST + BAR[BAR.index("gauges:") + 7 :]
    text = text.replace("creep: CREEP", f"ageing: {ageing}").replace(
        "{all: bar}\nsup", "{all: absent}\nsup"
    )
    text = text.replace("loads: {pull: {on: x1, traction: [1 MPa, 0 MPa]}}", load)
    return computed(model_at(write_bar(tmp_path, text), {"load": [0.1 * DAY, 30 * DAY]}))[:, 2:]


LAWS = {
    "{code: eurocode-2}": lambda d: np.exp(0.25 * (1 - np.sqrt(28 / d))) ** 0.3,
    "{code: fib, s: 0.38}": lambda d: np.exp(0.38 * (1 - np.sqrt(28 / d))) ** 0.5,
    "{share: 0.5, time: 10 d}": lambda d: 1 - 0.5 * np.expm1(-d / 10),
    "{curve: {1 d: 2 GPa, 14 d: 6 GPa, 28 d: 9 GPa}}": lambda d: np.interp(
        d, [1, 14, 28], [0.2, 0.6, 0.9]
    ),
}


@pytest.mark.parametrize("ageing", LAWS)
def test_young_concrete_strains_by_its_modulus_when_it_is_loaded(tmp_path, ageing):
    """And not again as it hardens."""
    found = cast(tmp_path, ageing, "loads: {pull: {on: x1, traction: [1 MPa, 0 MPa]}}")[0]
    np.testing.assert_allclose(found, ELASTIC / LAWS[ageing](7.0), rtol=1e-6)


@pytest.mark.parametrize("ageing", LAWS)
def test_strain_that_comes_evenly_meets_the_modulus_of_each_day(tmp_path, verification, ageing):
    found = cast(tmp_path, ageing, "supports: {x1: {x: 0.1 mm}}, over: 50 d")[2, [1, 2]]
    days = np.linspace(7.0, 57.0, 20001)
    E = LAWS[ageing](days)
    part = np.concatenate([[0.0], np.cumsum(0.5 * (E[1:] + E[:-1]) * np.diff(days) / 50.0)])
    exact = 1e-4 * 10e9 / (1 - 0.2**2) * np.interp([37.0, 57.0], days, part)
    np.testing.assert_allclose(found, exact, rtol=1e-3)
    verification("ageing", ageing[1:-1], [37.0, 57.0], exact=exact, found=found)


BEAM_RING = TUNNEL.replace("install: {shell: ring}", "build: [ring]").replace(
    "gauges:",
    """structures:
  ring: {kind: beam, on: wall, E: $E, thickness: 0.25 m, ageing: {code: eurocode-2, s: $s}}
gauges:""",
).replace("parameters: {}", """parameters:
  E: {start: 25 GPa, bounds: [5 GPa, 50 GPa]}
  s: {start: 0.25, bounds: [0.1, 0.5]}
  tau: {start: 20 d, bounds: [1 d, 50 d]}""").replace(
    "ring: {kind: stress, point: [4.99 m, 0.1 m], components: [xx], accuracy: 1 kPa}",
    "near: {kind: displacement, point: [6 m, 0 m], direction: [-1, 0], accuracy: 0.1 mm}",
)  # fmt: skip


def test_a_lining_that_hardens_as_it_is_squeezed(tmp_path, verification):
    """Kelvin rock on a thin ring, p' = E(t) h / R^2 u': against another integration in time."""
    path = write_tunnel(tmp_path, BEAM_RING.replace("CREEP", "{share: 2, time: $tau, in: shear}"))
    model = model_at(path, {"line": [DAY, 5 * DAY, 30 * DAY]})
    found = computed(model)[:, 2:]
    half, tau, days = RADIUS / 2, 20 * DAY, np.array([1.0, 5.0, 30.0, 3640.0])
    begun = 2.0 * P / GM * -np.expm1(-LINED_AT / tau)

    def rate(t, y):
        """Of the strain of the Kelvin element, and of the pressure on the ring."""
        strain, p = y
        flows = (2.0 * (P - p) / GM - strain) / tau
        age = max(t, 3600.0) / DAY
        k = 25e9 * np.exp(0.25 * (1 - np.sqrt(28 / age))) ** 0.3 * SHELL / RADIUS**2
        return [flows, k * half * flows / (1 + k * half / GM)]

    begin, end = [begun, 0.0], 3640 * DAY
    solution = solve_ivp(rate, (0, end), begin, "Radau", days * DAY, rtol=1e-8, atol=1e-9)
    strain, pressure = solution.y
    exact = half * ((P - pressure) / GM + strain)
    np.testing.assert_allclose(found[0], exact, rtol=1e-3)
    verification("hardening-lining", "", days, exact=exact, found=found[0])
    assert pressure[-1] > 0.2 * P
    coarse = write_tunnel(tmp_path, path.read_text(), cells=3)
    assert_exact(model_at(coarse, {"line": [DAY, 30 * DAY]}), 2)


@pytest.mark.parametrize("part", ["shear", "volume"])
def test_an_oedometer_creeps_by_one_part_of_its_strain(tmp_path, part):
    """Shear and volume strain together there, and one hands stress over to the other."""
    days = np.array([1.0, 10.0, 30.0, 100.0])
    creep = f"{{share: 3, time: 20 d, in: {part}}}"
    found = bar(tmp_path, creep, days[:-1], **{"x0: x, y0: y": "x0: x, y0: y, y1: y"})[0]
    K, G = 10e9 / (3 * (1 - 0.4)), 10e9 / 2.4

    def strain(s):
        soft = 1 + 3 / (1 + s * 20 * DAY)
        of_K, of_G = (1, soft) if part == "shear" else (soft, 1)
        return 1e6 / s / (K / of_K + 4 / 3 * G / of_G)

    np.testing.assert_allclose(found, [of_transform(strain, d * DAY) for d in days], rtol=1e-3)
