"""Openings with supports, against closed forms solved otherwise, the mesh, and small steps."""

from __future__ import annotations

import json
from dataclasses import replace

import numpy as np
import pytest
from scipy.integrate import quad
from scipy.optimize import brentq
from support.cases import displacement, material
from support.derivatives import assert_slopes
from support.yielding import constant, mohr, parameters, rock

from geoident.errors import InputError
from geoident.model.actions import FaceProfile, Pressure
from geoident.model.case import Stage
from geoident.model.in_situ import HeimStress
from geoident.model.parameter import Scalar
from geoident.model.structures import Beam, BoltPattern, Ribs, Ring, SupportLine
from geoident.model.yielding import HoekBrown
from tests.support.commands import run_command

from .test_opening_model import RADIUS, MPa, agrees, quarter, staged, without_mesh

E, NU, P0 = 1e9, 0.3, 10 * MPa
G = E / (2 * (1 + NU))
PLAIN = material("rock", E, NU)
WALL = displacement("wall", (RADIUS, 0.0), (-1.0, 0.0))
NOTHING = np.empty(0)


def stages(part: float, *build: str, last: float = 1.0) -> tuple[Stage, ...]:
    """Part of the stress is released, then the supports stand, then the rest is."""
    return (
        Stage("open", ("core",), release={"core": Scalar(part)}),
        Stage("far", build=build, release={"core": Scalar(last)}),
    )


def supported(ground, history, **structures):
    """sigma_z stays the middle stress, so that the wall has a short formula; see `nondilatant`."""
    settings = {"structures": structures, "stages": history, "channels": (WALL,)}
    return without_mesh(ground, in_situ=constant(-P0, -P0, -0.7 * P0), **settings)


def reaction(model):
    found = model.survey(NOTHING, fields=True).reaction
    assert found is not None
    return found


# Hoek & Brown (1980) and Lame, written out with plain numbers
_B = RADIUS - 0.15
LINES = {
    "ring": (
        Ring(Scalar(12e9), Scalar(0.15), Scalar(0.2), Scalar(20e6)),
        12e9 * (RADIUS**2 - _B**2) / (1.2 * RADIUS * (0.6 * RADIUS**2 + _B**2)),
        0.5 * 20e6 * (1 - _B**2 / RADIUS**2),
    ),
    "ribs": (
        Ribs(Scalar(210e9), Scalar(54e-4), Scalar(1.2), Scalar(355e6)),
        210e9 * 54e-4 / (1.2 * RADIUS**2),
        355e6 * 54e-4 / (1.2 * RADIUS),
    ),
    "bolts": (
        BoltPattern(*map(Scalar, (210e9, 0.025, 4.0, 1.5, 1.2, 180e3, 7e6))),
        1 / (1.5 * 1.2 * (4 * 4.0 / (np.pi * 0.025**2 * 210e9) + 1 / 7e6)),
        180e3 / (1.5 * 1.2),
    ),
    "line": (SupportLine(Scalar(60e6), Scalar(0.5e6)), 60e6, 0.5e6),
    "shell": (
        Beam("wall", Scalar(12e9), Scalar(0.15), Scalar(0.2)),
        12e9 * 0.15 / 0.96 / 4,
        np.inf,
    ),
}


@pytest.mark.parametrize("name", LINES)
@pytest.mark.parametrize("part", [0.3, 0.97])
def test_elastic_ground_and_one_support_meet_where_their_lines_do(name, part):
    """Ground p = p0 - 2 G u / a, support p = k (u - u_0) up to its capacity."""
    structure, k, most = LINES[name]
    found = reaction(supported(PLAIN, stages(part, name), **{name: structure}))
    expected = min((1 - part) * P0 / (1 + 2 * G / (k * RADIUS)), most)
    assert found.stage_pressure[-1] == pytest.approx(expected, rel=1e-10)
    moved = (P0 - expected) * RADIUS / (2 * G)
    assert found.stage_displacement[-1] == pytest.approx(moved, rel=1e-10)


def nondilatant(c: float, phi: float, p: float) -> float:
    """Motion inwards of a wall of Mohr-Coulomb that keeps its volume (Duncan Fama 1993)."""
    N, Y = (1 + np.sin(phi)) / (1 - np.sin(phi)), 2 * c * np.cos(phi) / (1 - np.sin(phi))
    critical, s = (2 * P0 - Y) / (N + 1), Y / (N - 1)
    if p >= critical:
        return (P0 - p) * RADIUS / (2 * G)
    radius = ((critical + s) / (p + s)) ** (1 / (N - 1))
    elastic, yielded = (1 - 2 * NU) * (P0 - p), 2 * (1 - NU) * (P0 - critical) * radius**2
    return RADIUS * (1 + NU) / E * (yielded - elastic)


@pytest.mark.parametrize("names", [("ring",), ("bolts",), ("ring", "bolts"), ("ribs", "line")])
def test_yielding_ground_and_several_supports_that_reach_their_capacity(names):
    c, phi, part = 0.8 * MPa, 0.5, 0.85
    lines = [LINES[name] for name in names]
    built = {name: LINES[name][0] for name in names}
    history = (*stages(part, *names, last=0.95), Stage("end", release={"core": Scalar(1.0)}))
    model = supported(rock(E, NU, mohr(c, phi, psi=0.0)), history, **built)
    found = reaction(model)
    first = nondilatant(c, phi, (1 - part) * P0)

    def excess(p: float, held: float) -> float:
        moved = nondilatant(c, phi, p) - first
        return p - held - sum(min(k * moved, most) for _, k, most in lines)

    for n, held in ((1, 0.05 * P0), (2, 0.0)):
        p = brentq(excess, held, 0.99 * P0, args=(held,), xtol=1e-6, rtol=1e-14)
        assert found.stage_pressure[n] == pytest.approx(p, rel=1e-8)
        assert found.stage_displacement[n] == pytest.approx(nondilatant(c, phi, p), rel=1e-8)
        sums = found.support_pressure[:, n].sum()
        assert sums == pytest.approx(p - held, rel=1e-7)
    assert found.supports == tuple(sorted(names))
    assert np.isnan(found.support_pressure[:, 0]).all()


def test_a_support_holds_ground_that_would_not_stand_without():
    loose = rock(E, NU, mohr(0.0, 0.5, psi=0.0))
    found = reaction(supported(loose, stages(0.9, "ring"), ring=LINES["ring"][0]))
    p = found.stage_pressure[-1]
    moved = nondilatant(0.0, 0.5, p) - nondilatant(0.0, 0.5, 0.1 * P0)
    assert p == pytest.approx(min(LINES["ring"][1] * moved, LINES["ring"][2]), rel=1e-7)


def test_supports_do_not_pull_and_take_up_again_where_they_are():
    """A pressure inside moves the wall away from a support that has yielded, and back."""
    weak = SupportLine(Scalar(500e6), Scalar(1 * MPa))
    history = (
        *stages(0.5, "line"),
        Stage("full", loads={"water": Pressure("wall", Scalar(6 * MPa))}),
        Stage("empty", loads={"water": Pressure("wall", Scalar(0.0))}),
    )
    found = reaction(supported(PLAIN, history, line=weak))
    np.testing.assert_allclose(found.support_pressure[0, 1:], [1 * MPa, 0.0, 1 * MPa], atol=1.0)
    np.testing.assert_allclose(found.stage_pressure[1:], [1 * MPa, 6 * MPa, 1 * MPa], rtol=1e-9)


def test_a_beam_on_the_wall_of_a_mesh_is_the_ring_of_the_closed_form():
    """The staged finite element model of ground that yields, with a lining of beams."""
    shell = Beam("wall", E=Scalar(12e9), nu=Scalar(0.2), thickness=Scalar(0.15),
                 clamped_on=("x0", "y0"))  # fmt: skip
    settings = {"structures": {"shell": shell}, "stages": stages(0.7, "shell")}
    ground = rock(E, 0.25, mohr(1 * MPa, 0.5, psi=0.1))
    model = staged(quarter(12, 40), ground, **settings, channels=(WALL,))
    agrees(model.response([("wall", "open"), ("wall", "far")]), 4e-3)


def slopes(ground, history, values, idle=(), **changes):
    """The Jacobian at values is exact, and all of them but some act."""
    model = without_mesh(
        ground, parameters=parameters(**values), stages=history, channels=(WALL,), **changes
    )
    response, p = model.response([("wall", s.name) for s in history]), np.array([*values.values()])
    _, jacobian = response.evaluate(p)
    acts = np.abs(jacobian).max(axis=0) > 0.0
    assert [name for name, acting in zip(values, acts, strict=True) if not acting] == list(idle)
    assert_slopes(response.readings, p, jacobian, tuple(values), step=1e-4, rtol=1e-6)


@pytest.mark.parametrize(("capacity", "idle"), [(900e3, ("cap",)), (1e3, ("d", "len", "Kh"))])
def test_derivatives_by_all_numbers_are_exact(capacity, idle):
    """Of supports below their capacity and at it, in ground that yields, by the distance."""
    values = {
        "E": 2e9, "c": 0.7 * MPa, "sv": P0, "Es": 9e9, "nus": 0.22, "t": 0.1,
        "d": 0.025, "len": 3.0, "cap": capacity, "Kh": 5e6, "x": 2.0, "R": RADIUS,
    }  # fmt: skip
    tied = {name: Scalar(1.0, name) for name in values}
    ring = Ring(tied["Es"], tied["t"], tied["nus"])
    bolts = BoltPattern(
        Scalar(2e11), tied["d"], tied["len"], Scalar(1.0), None, tied["cap"], tied["Kh"]
    )
    history = (
        Stage("open", ("core",), distance=tied["x"]),
        Stage("far", build=("bolts", "ring"), distance=Scalar(20.0)),
    )
    slopes(
        rock(tied["E"], NU, mohr(tied["c"], 0.5, psi=0.1)), history, values, idle,
        in_situ=HeimStress(K0=Scalar(1.0), vertical=tied["sv"]),
        face=FaceProfile("vlachopoulos-diederichs", ("core",), tied["R"]),
        structures={"ring": ring, "bolts": bolts},
    )  # fmt: skip


def test_derivatives_in_ground_of_hoek_brown_are_exact():
    values = {"sigci": 40 * MPa, "K": 300e6, "cap": 0.3 * MPa}
    tied = {name: Scalar(1.0, name) for name in values}
    surface = HoekBrown(
        tied["sigci"], mb=Scalar(1.0), s=Scalar(1e-3), a=Scalar(0.51), dilation=Scalar(0.0)
    )
    lines = {"a": SupportLine(tied["K"]), "b": SupportLine(Scalar(2e9), tied["cap"])}
    slopes(rock(E, NU, surface), stages(0.8, "a", "b"), values, structures=lines)


PANET = FaceProfile(
    "panet", ("core",), Scalar(RADIUS), constants=(Scalar(0.25), Scalar(0.75)), conversion="direct"
)


def test_derivatives_of_shotcrete_that_hardens_are_exact():
    values = {"E": 2e9, "way": 5.0, "x": 2.0, "strength": 2 * MPa}
    tied = {name: Scalar(1.0, name) for name in values}
    ring = Ring(Scalar(9e9), Scalar(0.1), Scalar(0.2), tied["strength"], None, tied["way"])
    history = (
        Stage("open", ("core",), distance=tied["x"]),
        Stage("lined", build=("ring",), distance=Scalar(6.0)),
        Stage("far", distance=Scalar(30.0)),
    )
    ground = material("rock", tied["E"], NU)
    slopes(ground, history, values, face=PANET, structures={"ring": ring})


def test_shotcrete_that_hardens_as_the_face_goes_on():
    """Elastic: dp = k g(x) du, du = a / 2G (p0 ds - dp), integrated along the profile."""
    scale, start = 4.0, 1.0
    ring = replace(LINES["ring"][0], strength=None, hardening_distance=Scalar(scale))
    k = LINES["ring"][1] * RADIUS / (2 * G)

    def rate(x: float) -> float:
        part = k * (1 - np.exp(-(x - start) / scale))
        slope = 2 * 0.75 * 0.75**2 / RADIUS / (0.75 + x / RADIUS) ** 3
        return P0 * slope * part / (1 + part)

    exact = quad(rate, start, 40.0)[0]
    for steps, error in ((1, 0.03), (4, 0.005), (16, 0.001)):
        way = start * (40.0 / start) ** (np.arange(steps + 1) / steps)
        history = (
            Stage("open", ("core",), distance=Scalar(start)),
            *(Stage(f"to {x:.3f}", build=("ring",) * (n == 0), distance=Scalar(float(x)))
              for n, x in enumerate(way[1:])),
        )  # fmt: skip
        model = without_mesh(
            PLAIN, face=PANET, structures={"ring": ring}, stages=history, channels=(WALL,)
        )
        found = reaction(model).support_pressure[0, -1]
        assert found == pytest.approx(exact, rel=error), steps


def test_shotcrete_that_hardens_with_time_has_the_strength_of_its_age():
    day = 86400.0
    ring = replace(LINES["ring"][0], hardening_time=Scalar(2 * day))
    history = (*stages(0.2, "ring", last=0.9), Stage("end", release={"core": Scalar(1.0)}))
    dates = {"open": 0.0, "far": 3 * day, "end": 100 * day}
    model = without_mesh(
        PLAIN, structures={"ring": ring}, stages=history, channels=(WALL,), dates=dates
    )
    found = reaction(model)
    young = LINES["ring"][2] * (1 - np.exp(-1.5))
    assert found.support_capacity[0, 1] == pytest.approx(young, rel=1e-12)
    assert found.support_pressure[0, 1] == pytest.approx(young, rel=1e-9)
    with pytest.raises(InputError) as caught:
        without_mesh(PLAIN, structures={"ring": ring}, stages=history, channels=(WALL,))
    (fault,) = caught.value.faults
    assert fault.path == "structures.ring.hardening_time"
    assert "stage 'open' has no date" in fault.message


def test_a_support_in_the_stage_that_opens_in_parts_is_refused():
    history = (
        Stage("open", ("core",), release={"core": Scalar(0.4)}, build=("ring",)),
        Stage("far", release={"core": Scalar(1.0)}),
    )
    with pytest.raises(InputError) as caught:
        supported(PLAIN, history, ring=LINES["ring"][0])
    (fault,) = caught.value.faults
    assert "'{name: lined, build: [ring], release: {core: 1}}'" in fault.hint


def test_what_supports_carry_is_said_with_its_part_of_their_capacity():
    names = ("ring", "bolts")
    model = supported(PLAIN, stages(0.3, *names), **{name: LINES[name][0] for name in names})
    (text,) = (t for t in model.response(()).remarks(NOTHING) if "supports" in t)
    found = reaction(model)
    bolts, ring = found.support_pressure[:, -1] / MPa
    part = f"{100 * bolts * MPa / LINES['bolts'][2]:.0f} % of what it carries"
    assert f"with {bolts + ring:.3g} MPa: 'bolts' {bolts:.3g} MPa ({part})" in text
    assert f"'ring' {ring:.3g} MPa (all of what it carries)" in text


def test_supports_resist_the_mean_of_an_uneven_stress_only():
    uneven = constant(-8 * MPa, -12 * MPa, -10 * MPa)
    settings = {"structures": {"ring": LINES["ring"][0]}, "in_situ": uneven}
    model = without_mesh(PLAIN, stages=stages(0.5, "ring"), channels=(WALL,), **settings)
    assert any("supports resist the mean of the stress only" in note for note in model.notes)


def test_a_ring_thicker_than_its_opening_is_outside_the_domain():
    ring = replace(LINES["ring"][0], thickness=Scalar(1.0, "t"))
    model = without_mesh(
        PLAIN, parameters=parameters(t=0.3), structures={"ring": ring}, stages=stages(0.5, "ring")
    )
    assert model.domain_fault(np.array([0.4])) is None
    assert "less than the radius of the opening, 2 m" in model.domain_fault(np.array([2.5]))


def test_a_fit_finds_ground_and_support_from_convergence(tmp_path):
    """Readings by hand: ground p = p0 - 2 G u / a, Panet's s, support p = k (u - u_0)."""
    modulus, k, a = 1.2e9, 150e6, 2.5
    shear = modulus / 2.5
    x = np.array([2.0, 5.0, 12.0, 60.0]) / a
    share = 0.25 + 0.75 * (1 - (0.75 / (0.75 + x)) ** 2)
    held = np.array([P0 * (1 - s) for s in share])
    first = P0 * share[1] * a / (2 * shear)  # the support stands from 5 m on
    moved = (P0 - held) * a / (2 * shear)
    moved[2:] = first + (moved[2:] - first) / (1 + k * a / (2 * shear))
    read = -2e3 * (moved - moved[0])
    case = tmp_path / "case.yaml"
    case.write_text(f"""\
format: geoident-case/1
analysis: plane-strain
parameters:
  E: {{start: 3 GPa, bounds: [0.2 GPa, 20 GPa], scale: log}}
  k: {{start: 60 MPa/m, bounds: [1 MPa/m, 900 MPa/m], scale: log}}
materials: {{rock: {{E: $E, nu: 0.25}}}}
groups: {{rock: rock, tunnel: rock}}
in_situ: {{model: heim, vertical: 10 MPa, K0: 1.0}}
face: {{profile: panet}}
structures: {{shell: {{kind: support-line, stiffness: $k}}}}
stages:
  - {{name: s0, distance: 2 m, excavate: [tunnel]}}
  - {{name: s1, distance: 5 m}}
  - {{name: s2, distance: 12 m, build: [shell]}}
  - {{name: s3, distance: 60 m}}
gauges:
  CV: {{kind: convergence, between: [[-2.5, 0 m], [2.5, 0 m]], accuracy: 0.01 mm, zero: s0}}
readings:
  - {{gauge: CV, stage: s1, value: {read[1]:.6f} mm}}
  - {{gauge: CV, stage: s2, value: {read[2]:.6f} mm}}
  - {{gauge: CV, stage: s3, value: {read[3]:.6f} mm}}
fit: {{method: closed-form, closed-form: {{centre: [0, 0 m], radius: 2.5 m, starts: 1}}}}
""")
    run = run_command("fit", case, "--json", "-q")
    found = json.loads(run.stdout)
    assert found["parameters"]["E"]["value"] == pytest.approx(modulus, rel=1e-4)
    assert found["parameters"]["k"]["value"] == pytest.approx(k, rel=1e-3)
    (note,) = (text for text in found["notes"] if "supports press" in text)
    assert f"with {k * (moved[3] - first) / 1e6:.3g} MPa: 'shell'" in note
    text = case.read_text()
    case.write_text(text.replace(", build: [shell]", ""))
    assert "no stage builds the structure 'shell'" in run_command("check", case).stdout
