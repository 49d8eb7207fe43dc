"""The closed form in the terms of a case: against the staged model, and where there is none."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from support.cases import displacement, make_case, material, model, rollers
from support.derivatives import assert_exact
from support.meshes import opening
from support.tunnels import walled
from support.yielding import constant, mohr, parameters, rock

from geoident.errors import CollapseError
from geoident.forward.openings.model import OpeningResponse, opening_model
from geoident.model.actions import Pressure
from geoident.model.case import Stage
from geoident.model.gauges import Channel
from geoident.model.ground import Isotropic
from geoident.model.in_situ import HeimStress
from geoident.model.methods import ClosedFormOptions
from geoident.model.parameter import Scalar

MPa = 1e6
RADIUS = 2.0
STAGES = (
    Stage("face", excavate=("core",), release={"core": Scalar(0.6)}),
    Stage("open", release={"core": Scalar(1.0)}),
    Stage("grout", loads={"grout": Pressure("wall", Scalar(2 * MPa))}),
)


def gauge(name: str, first: tuple[float, float], second: tuple[float, float]) -> Channel:
    way = np.subtract(second, first)
    along = tuple(map(float, way / np.linalg.norm(way)))
    return Channel(name, name, "extensometer", first, second, along, 1e-4, "virgin")


GAUGES = (
    gauge("across", (0.0, RADIUS), (RADIUS, 0.0)),
    gauge("up", (0.0, RADIUS), (0.0, 3 * RADIUS)),
    gauge("beside", (RADIUS, 0.0), (2 * RADIUS, 0.0)),
    displacement("slope", (1.8 * RADIUS, 1.1 * RADIUS), (0.6, -0.8)),
)
SLOPING = gauge("sloping", (-0.6 * RADIUS, -0.8 * RADIUS), (0.9 * RADIUS, -1.2 * RADIUS))
PAIRS = tuple((c.name, s.name) for c in GAUGES for s in STAGES)


def staged(mesh, ground, **changes):
    settings = {
        "materials": {"rock": ground},
        "groups": {"core": "rock", "rock": "rock"},
        "supports": rollers(2),
        "in_situ": constant(*(-10 * MPa,) * 3),
        "stages": STAGES,
        "channels": GAUGES,
    }
    return model(mesh, **{**settings, **changes})


def quarter(n: int = 8, layers: int = 26, reach: float = 60.0):
    return walled("quad8", n=n, layers=layers, radius=RADIUS, reach=reach * RADIUS)


def without_mesh(ground, *, centre=(0.0, 0.0), radius=RADIUS, **changes):
    fit = replace(make_case(quarter(1, 2)).fit, closed_form=ClosedFormOptions(centre, radius))
    settings = {
        "mesh_file": None,
        "materials": {"rock": ground},
        "groups": {"core": "rock", "rock": "rock"},
        "in_situ": constant(*(-10 * MPa,) * 3),
        "stages": STAGES,
        "channels": GAUGES,
        "fit": fit,
    }
    return opening_model(make_case(quarter(1, 2), **{**settings, **changes}))


def form(response) -> OpeningResponse:
    found = response.opening((0.0, 0.0), RADIUS)
    assert isinstance(found, OpeningResponse), found
    return found


def agrees(response, tolerance: float) -> None:
    closed = form(response)
    assert closed.covered.all()
    exact = response.readings(np.empty(0))
    found = closed.readings(np.empty(0))
    np.testing.assert_allclose(found, exact, atol=tolerance * np.abs(exact).max())


def test_shear_far_away_is_that_of_the_mesh():
    """A whole model: the shear is no symmetric load. Held at three points of its round edge."""
    mesh = opening("quad8", 2, n=4, layers=20, radius=RADIUS, reach=60 * RADIUS, whole=True)
    edge = np.flatnonzero(np.linalg.norm(mesh.points, axis=1) > 59.9 * RADIUS)
    mesh = replace(mesh, node_groups={"edge": edge})
    found = model(
        mesh,
        materials={"rock": material("rock", 5e9, 0.3)},
        groups={"core": "rock", "rock": "rock"},
        supports=(replace(rollers(2)[0], group="edge", components=(0, 1)),),
        in_situ=constant(-6 * MPa, -11 * MPa, -8 * MPa, 3 * MPa),
        stages=STAGES[:2],
        channels=(*GAUGES, SLOPING),
    )
    pairs = [(c.name, s.name) for c in (*GAUGES, SLOPING) for s in STAGES[:2]]
    agrees(found.response(pairs), 3e-3)


@pytest.mark.parametrize("psi", [0.0, None])
def test_yielding_ground_is_that_of_the_mesh(psi):
    ground = rock(5e9, 0.25, mohr(1 * MPa, 0.5, psi=psi))
    agrees(staged(quarter(12, 40), ground, stages=STAGES).response(PAIRS), 1e-2)


def test_a_pressure_tunnel_is_that_of_the_mesh():
    """Excavated, then pressed outwards far beyond the in-situ stress, in strong ground."""
    ground = rock(5e9, 0.25, mohr(7 * MPa, 0.5))
    stages = (
        Stage("open", excavate=("core",)),
        Stage("press", loads={"water": Pressure("wall", Scalar(40 * MPa))}),
        Stage("more", loads={"water": Pressure("wall", Scalar(45 * MPa))}),
    )
    pairs = [(c.name, s.name) for c in GAUGES for s in stages]
    agrees(staged(quarter(12, 40), ground, stages=stages).response(pairs), 1e-2)


def test_derivatives_are_exact():
    names = {"K0": 0.9, "sv": 11 * MPa, "E": 5e9, "c": MPa, "phi": 0.5, "part": 0.7, "p": 0.3 * MPa}
    E, c, phi, part, p = (Scalar(1.0, name) for name in ("E", "c", "phi", "part", "p"))
    ground = rock(E, 0.25, mohr(c, phi, psi=Scalar(0.4, "phi")))
    stages = (
        Stage("face", excavate=("core",), release={"core": part}),
        Stage("open", release={"core": Scalar(1.0)}, loads={"grout": Pressure("wall", p)}),
    )
    opened = without_mesh(
        ground,
        parameters=parameters(**names),
        in_situ=HeimStress(K0=Scalar(1.0, "K0"), vertical=Scalar(1.0, "sv")),
        stages=stages,
    )
    response = opened.response([(c.name, s.name) for c in GAUGES for s in stages])
    assert_exact(response, np.array(list(names.values())), tuple(names))
    assert any("off its mean" in remark for remark in response.remarks([*names.values()]))


def test_bulk_and_shear_modulus_say_the_same():
    E, nu = 5e9, 0.25
    K, G = E / (3 * (1 - 2 * nu)), E / (2 * (1 + nu))
    given = replace(material("rock", E, nu), elastic=Isotropic(K=Scalar(K), G=Scalar(G)))
    one, other = (
        without_mesh(m).survey(np.empty(0), fields=False) for m in (given, material("rock", E, nu))
    )
    np.testing.assert_allclose(one.computed, other.computed, rtol=1e-12)


def test_survey_and_response_agree():
    opened = without_mesh(rock(5e9, 0.25, mohr(1 * MPa, 0.5)))
    table = opened.survey(np.empty(0), fields=True)
    assert table.fields is None
    listed = opened.response(PAIRS).readings(np.empty(0)).reshape(len(GAUGES), len(STAGES))
    np.testing.assert_allclose(table.computed, listed, rtol=1e-14)


def test_depth_makes_the_stress_at_the_centre():
    weight = HeimStress(K0=Scalar(1.0), unit_weight=Scalar(25e3), surface=Scalar(100.0))
    deep = without_mesh(
        material("rock", 5e9, 0.25),
        in_situ=weight,
        centre=(0.0, -300.0),
        channels=(displacement("side", (RADIUS, -300.0), (1.0, 0.0)),),
    )
    G = 5e9 / 2.5
    expected = -400 * 25e3 * RADIUS / (2 * G)
    assert deep.survey(np.empty(0), fields=False).computed[0, 1] == pytest.approx(expected)


def test_a_gauge_zeroed_at_a_stage_reads_the_motion_since_then():
    late = replace(GAUGES[0], name="late", zero="open")
    opened = without_mesh(rock(5e9, 0.25, mohr(1 * MPa, 0.5)), channels=(GAUGES[0], late))
    assert opened.unreadable("late", "face") == "it is zeroed only at a later stage"
    assert opened.unreadable("late", "open") is None
    assert opened.unreadable("across", "face") is None
    whole, since = opened.survey(np.empty(0), fields=False).computed
    np.testing.assert_allclose(since, [np.nan, 0.0, whole[2] - whole[1]], rtol=1e-12)
    pairs = [("across", "face"), ("across", "grout"), ("late", "open"), ("late", "grout")]
    steps = opened.steps(pairs)
    np.testing.assert_array_equal(steps[1:].T, [[1, 0, 0], [1, 1, 1], [0, 0, 0], [0, 0, 1]])
    response = opened.response(pairs)
    readings = response.readings(np.empty(0))
    assert response.opening(None, None) is response
    parts = steps * response.increments(np.empty(0))[:, [0, 0, 1, 1]]
    np.testing.assert_allclose(parts.sum(axis=0), readings, rtol=1e-12)
    last = opened.response(pairs[1:2])  # the steps to a reading are known without their readings
    parts = opened.steps(pairs[1:2])[:, 0] * last.increments(np.empty(0))[:, 0]
    np.testing.assert_allclose(parts, steps[:, 1] * response.increments(np.empty(0))[:, 0])
    np.testing.assert_allclose(parts.sum(), readings[1], rtol=1e-12)


def test_stages_that_have_no_closed_form_are_left_out():
    filled = Stage("fill", install={"core": "rock"}, remove=("grout",))
    ring = (*STAGES, filled, Stage("later"))
    response = staged(quarter(), material("rock", 5e9, 0.25), stages=ring).response(
        [(c.name, s.name) for c in GAUGES for s in ring]
    )
    covered = form(response).covered.reshape(len(GAUGES), len(ring))
    np.testing.assert_array_equal(covered.all(axis=0), [True, True, True, False, False])
    assert not covered[:, 3:].any()


def test_what_comes_before_a_collapse_is_known():
    ground = rock(5e9, 0.25, mohr(0.0, 0.5))
    opened = without_mesh(ground, stages=STAGES[:2])
    early = [(c.name, "face") for c in GAUGES]
    assert np.isfinite(opened.response(early).readings(np.empty(0))).all()
    with pytest.raises(CollapseError, match="stage 'open'"):
        opened.response(PAIRS[:2]).readings(np.empty(0))
    known = opened.survey(np.empty(0), fields=False, partial=True)
    np.testing.assert_array_equal(np.isfinite(known.computed), [[True, False]] * len(GAUGES))
    (said,) = known.collapses
    assert "'open'" in said
