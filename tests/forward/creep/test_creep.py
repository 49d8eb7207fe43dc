"""Creep and ageing in stages that last, against closed forms and differences."""

import numpy as np
import pytest
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
from support.in_stages import model_at

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


def test_a_lined_tunnel_in_burgers_rock(tmp_path):
    """The ring takes nothing of what crept before, and its share of all that comes after."""
    path = write_tunnel(tmp_path, TUNNEL.replace("CREEP", BURGERS))
    model = model_at(path, {"dig": [DAY, 5 * DAY], "line": [(d - 10) * DAY for d in DAYS]})
    days = [1.0, 5.0, 10.0, *DAYS, 3650.0]
    ks = ring_stiffness(20e9, 0.2, RADIUS - SHELL, RADIUS)
    exact = burgers_tunnel(days, ks)
    found = computed(model)[0, 1:]
    np.testing.assert_allclose(found, exact, rtol=2e-4)
    unlined = P * RADIUS / 2 * (1 / GM + DAY / ETA_M - np.expm1(-GK * DAY / ETA_K) / GK)
    assert exact[0] == pytest.approx(unlined, rel=1e-12)


def test_steps_in_time_are_of_second_order(tmp_path):
    """Error against very many steps, of a tunnel whose ring takes most of what creeps."""
    path = write_tunnel(
        tmp_path, TUNNEL.replace("CREEP", BURGERS).replace("20 GPa", "200 GPa"), cells=8
    )
    model = model_at(path, {"line": [30 * DAY, 365 * DAY]})
    fine = computed(model, finer=8)[0, 3:]
    errors = [np.abs(computed(model, finer=k)[0, 3:] / fine - 1.0).max() for k in (1, 2, 4)]
    assert errors[0] < 3e-4
    assert errors[0] / errors[1] > 3.0
    assert errors[1] / errors[2] > 3.0


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


def test_a_kelvin_bar(tmp_path):
    days = np.array([0.1, 3.0, 30.0, 100.0])
    found = bar(tmp_path, "{share: 0.8, time: 20 d}", days[:-1])
    np.testing.assert_allclose(found[0], ELASTIC * (1 - 0.8 * np.expm1(-days / 20)), rtol=1e-4)
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


def test_a_bar_relaxes(tmp_path):
    """Held at its length, the stress of a Maxwell bar dies away; steps do not swing."""
    held = "supports: {x1: {x: 0.1 mm}}"
    eta = 10e9 / 2.4 * 5 * DAY  # G T
    days = np.array([1.0, 5.0, 20.0, 100.0])
    found = bar(
        tmp_path, f"{{maxwell: {{viscosity: {eta!r} Pa s}}, in: both}}", days[:-1],
        **{"loads: {pull: {on: x1, traction: [1 MPa, 0 MPa]}}": held},
    )  # fmt: skip
    stress = 1e-4 * 10e9 / (1 - 0.2**2) * np.exp(-days / 5)
    np.testing.assert_allclose(found[2], stress, rtol=1e-3, atol=1.0)


def test_logarithmic_creep_under_steps_of_stress(tmp_path):
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
    np.testing.assert_allclose(found, [strain(x) for x in t], rtol=2e-3)


def test_a_stage_without_duration_is_the_end_of_creep(tmp_path):
    """The long-term moduli, also where the ground has crept for a while before."""
    text = BAR.replace("CREEP", "[{share: 0.8, time: 20 d}, {share: 0.2, time: 1 d, in: shear}]")
    later = "  - {name: later}\ngauges:"
    found = computed(model_at(write_bar(tmp_path, text.replace("gauges:", later))))[0, 1:]
    long = text.replace("lasts: 100 d", "lasts: 100000 d")
    at_end = computed(model_at(write_bar(tmp_path, long)))[0, 1]
    assert found[1] == pytest.approx(at_end, rel=1e-6)
    at_once = computed(model_at(write_bar(tmp_path, text.replace(", lasts: 100 d", ""))))[0, 1]
    assert at_once == pytest.approx(at_end, rel=1e-6)


PARAMETERS = """
  G: {start: 1 GPa, bounds: [0.1 GPa, 10 GPa]}
  GK: {start: 0.5 GPa, bounds: [0.1 GPa, 10 GPa]}
  eta_K: {start: 30 GPa d, bounds: [1 GPa d, 100 GPa d]}
  eta_M: {start: 5 GPa years, bounds: [1 GPa d, 100 GPa years]}
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
    {E: $E, nu: 0.2, ageing: {law: eurocode-2, s: $s}, creep: {share: $creep, time: $time}}
  more: {E: $E, nu: 0.2, ageing: {curve: {1 d: $young, 28 d: 25 GPa}}}""")
    .replace("install: {shell: ring}, lasts: 3640 d}", "install: {shell: ring}, lasts: 50 d}\n"
             "  - {name: thick, install: {core: more}, lasts: 100 d}")
)  # fmt: skip


def test_derivatives_are_exact(tmp_path):
    path = write_tunnel(tmp_path, OF_EVERYTHING, cells=4)
    model = model_at(path, {"dig": [DAY], "line": [3 * DAY], "thick": [2 * DAY]})
    p = np.array([parameter.start for parameter in model.case.parameters])

    def observed(p):
        run = model.at(p, RunOptions(derivatives=False))
        seen = np.array([model.see(end, run)[:, 0] for end in run.states()])[1:]
        return np.concatenate([seen[:, 0] * 1e3, seen[3:, 1] / 1e6])

    run = model.at(p, RunOptions())
    seen = np.array([model.see(end, run) for end in run.states()])[1:]
    found = np.concatenate([seen[:, 0] * 1e3, seen[3:, 1] / 1e6])
    np.testing.assert_allclose(found[:, 0], observed(p), rtol=1e-12)
    assert np.all(np.abs(found[:, 1:]).max(axis=0) > 0)
    assert_slopes(observed, p, found[:, 1:], model.names, step=2e-3)
