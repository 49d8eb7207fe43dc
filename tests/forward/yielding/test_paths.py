"""Histories of load on ground that yields: elements worked by hand, stages of every kind."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from support.cases import model, rollers
from support.meshes import box, regroup
from support.tunnels import walled
from support.yielding import NOTHING, Cavity, analysed, given, mohr, mohr_limit, rock

from geoident.errors import CollapseError
from geoident.model.actions import Traction
from geoident.model.case import Stage, Support
from geoident.model.parameter import Scalar
from geoident.model.structures import Beam

E, K = 1e9, 1e6
UP, DOWN = np.eye(6)[1], -np.eye(6)[1]


def pull(size: float) -> dict[str, Traction]:
    return {"pull": Traction("y1", (Scalar(0.0), Scalar(size)))}


def bar(*stages: Stage, hardening: float = 0.0, planes=None, **changes):
    """One square, pulled along y, free along x; nu = 0, so the strain is E times the stress.

    Out of plane nothing moves. It yields along y at K in tension and 2 K in compression.
    """
    planes = planes or given(np.stack([UP, DOWN]), [K, 2 * K], hardening)
    settings = {
        "materials": {"rock": rock(E, 0.0, planes)},
        "groups": {"all": "rock"},
        "supports": rollers(2),
        "stages": stages,
    }
    return model(box("quad8", (1, 1)), **{**settings, **changes})


def lengths(staged) -> np.ndarray:
    """Motion of the upper edge, state by state."""
    top = np.flatnonzero(np.abs(staged.mesh.points[:, 1] - 1) < 1e-9)
    return np.array([s.u[2 * top + 1, 0].mean() for s in analysed(staged)])


def test_beyond_yield_and_back_and_beyond_on_the_other_side():
    """With h: eps = sigma / E + (sigma - K) / h beyond K; unloading is elastic, and k has grown.

    The multiplier of a plane counts for that plane alone.
    """
    h = 0.25 * E
    path = [0.8 * K, 1.5 * K, 0.2 * K, -1.9 * K, -2.6 * K, 0.0, 1.4 * K, 1.7 * K]
    stages = [Stage(f"s{n}", loads=pull(sigma)) for n, sigma in enumerate(path)]
    found = lengths(bar(*stages, hardening=h))[1:]
    first, second, third = 0.5 * K / h, 0.6 * K / h, 0.2 * K / h
    residual = np.array(
        [0.0, first, first, first, first - second, first - second, first - second,
         first - second + third]
    )  # fmt: skip
    np.testing.assert_allclose(found, np.array(path) / E + residual, atol=1e-13)


@pytest.mark.parametrize("explain", [True, False])
def test_large_strains_that_a_growing_load_leads_to_are_an_equilibrium(explain):
    """Strains of 2: whether there is an equilibrium does not depend on what is to be explained."""
    h, sigma = 1e-3 * E, 3 * K
    top = bar(Stage("pulled", loads=pull(sigma)), hardening=h)
    _, end = analysed(top, explain=explain)
    assert end.u[:, 0].max() == pytest.approx(sigma / E + (sigma - K) / h, rel=1e-9)


def test_residual_strain_of_perfect_plasticity():
    """A weak bar beside a strong one: what the weak one flowed stays when the load goes."""
    mesh = regroup(box("quad4", (2, 1), size=(2.0, 1.0)), weak=lambda c: c[:, 0] < 1)
    bars = {
        "weak": rock(E, 0.0, given(np.stack([UP, DOWN]), [K, K]), name="weak"),
        "strong": rock(E, 0.0, given(UP[None], [100 * K]), name="strong"),
    }
    # The top is held level by a very stiff beam that has no weight in the balance along y.
    both = {"supports": (Support("y0", (1,)), Support("x0", (0,)), Support("x1", (0,)))}
    cap = Beam("y1", EA=Scalar(1e3), EI=Scalar(1e13), clamped_on=("x0", "x1"))
    stages = tuple(
        Stage(f"s{n}", loads=pull(sigma), build=("cap",) if n == 0 else ())
        for n, sigma in enumerate((0.9 * K, 3 * K, 0.0, -2.5 * K, 0.0))
    )
    staged = model(
        mesh,
        materials=bars,
        groups={"weak": "weak", "rock": "strong"},
        stages=stages,
        structures={"cap": cap},
        **both,
    )
    top = np.abs(mesh.points[:, 1] - 1) < 1e-9
    moved = [s.u[1::2, 0][top] for s in analysed(staged)[1:]]
    # Sum of both stresses is 2 sigma; the weak one bears K at most. s1: the strong one bears 5 K,
    # so eps = 5 K / E and the weak one has flowed 4 K / E. Unloaded, both move back together by
    # 3 K / E, the weak one to -2 K: it flows back at -K, the strong one bears +K.
    expected = [0.9 * K, 5 * K, 1 * K, -4 * K, -1 * K]
    for found, stress in zip(moved, expected, strict=True):
        np.testing.assert_allclose(found, stress / E, rtol=1e-4)


def test_load_cases_branch_off_the_hardened_state():
    h = 0.5 * E
    stages = (
        Stage("yield", loads=pull(1.5 * K)),
        Stage("more", loads=pull(2.0 * K), independent=True),
        Stage("less", loads=pull(1.4 * K), independent=True),
        Stage("after", loads=pull(1.8 * K)),
        Stage("virgin again", loads=pull(1.4 * K), base="virgin"),
    )
    found = lengths(bar(*stages, hardening=h))[1:]
    plastic = np.array([0.5, 1.0, 0.5, 0.8, 0.4]) * K / h
    np.testing.assert_allclose(
        found, np.array([1.5, 2.0, 1.4, 1.8, 1.4]) * K / E + plastic, rtol=1e-12
    )


def test_what_is_placed_anew_has_not_hardened():
    h = 0.5 * E
    stages = (
        Stage("yield", loads=pull(1.5 * K)),
        Stage("away", remove=("pull",), install={"all": "rock"}),
        Stage("again", loads=pull(1.5 * K)),
    )
    found = lengths(bar(*stages, hardening=h))[1:]
    once = 1.5 * K / E + 0.5 * K / h
    assert found[0] == pytest.approx(once, rel=1e-12)
    # Placed free of stress where the old one stood, it moves as the first did.
    assert found[2] - found[1] == pytest.approx(once, rel=1e-12)


def test_change_to_a_weaker_material_makes_it_flow():
    """The stress that stays is outside the weak surface: collapse, or flow where it hardens."""
    weak = rock(E, 0.0, given(UP[None], [K]), name="weak")
    strong = rock(E, 0.0, given(UP[None], [10 * K]))
    stages = (
        Stage("load", loads=pull(3 * K)),
        Stage("weaken", change={"all": "weak"}),
    )
    staged = bar(*stages, materials={"rock": strong, "weak": weak})
    with pytest.raises(CollapseError, match="weaken") as caught:
        staged.survey(NOTHING, fields=False)
    assert caught.value.stage == "weaken"
    hardens = rock(E, 0.0, given(UP[None], [K], 0.5 * E), name="weak")
    found = lengths(bar(*stages, materials={"rock": strong, "weak": hardens}))
    assert found[1] == pytest.approx(3 * K / E, rel=1e-12)
    assert found[2] == pytest.approx(3 * K / E + 2 * K / (0.5 * E), rel=1e-12)


def test_lift_is_placed_free_of_stress_and_then_yields():
    """The lower of two lifts yields under the weight of the upper one, in hardening compression."""
    mesh = regroup(box("quad8", (1, 2), size=(1.0, 2.0)), low=lambda c: c[:, 1] < 1)
    weight, h = 2e4, 0.2 * E
    k = 1.2 * weight  # bears its own weight, not that of another lift on top
    soft = rock(E, 0.0, given(DOWN[None], [k], h), density=weight / 10)
    staged = model(
        mesh,
        materials={"rock": soft},
        groups={"low": "rock", "rock": None},
        supports=(Support("x0", (0,)), Support("x1", (0,)), Support("y0", (1,))),
        gravity=(0.0, -10.0),
        stages=(Stage("second", install={"rock": "rock"}),),
    )
    states = analysed(staged)
    middle = np.abs(mesh.points[:, 1] - 1) < 1e-9
    # Stress in the lower lift afterwards: -(2 - y) weight; plastic where 2 - y > 1.2.
    plastic = 0.5 * (0.8 * weight) ** 2 / weight / h
    # Points of one element do not see exactly where yielding ends.
    moved = states[1].u[1::2, 0][middle]
    np.testing.assert_allclose(moved, -weight / E - plastic, rtol=0.05)
    below = -weight * (2 - staged.discretization.points.position[:, 1])
    np.testing.assert_allclose(states[1].stress[1, :, 0], below, atol=0.03 * weight)


CAVITY = Cavity(pressure=10e6, E=2e9, nu=0.3, radius=3.0)


def released(*parts: float, cohesion: float = 1e6, planes: int | None = None):
    stages = tuple(
        Stage(f"s{n}", excavate=() if n else ("core",), release={"core": Scalar(part)})
        for n, part in enumerate(parts)
    )
    mesh = CAVITY.mesh("quad8", n=3, layers=16, reach=12)
    return CAVITY.staged(mesh, mohr(cohesion, 0.5, planes=planes), stages=stages)


def test_parts_of_a_release_follow_the_ground_reaction_curve():
    parts = (0.3, 0.6, 0.8, 0.9, 1.0)
    staged = released(*parts, cohesion=2e6)
    limit = mohr_limit(2e6, 0.5)
    for part, end in zip(parts, analysed(staged)[1:], strict=True):
        exact = CAVITY.closed_form(limit, part).displacement(np.array([CAVITY.radius])).value[0]
        assert CAVITY.outwards(staged, end).mean() == pytest.approx(exact, rel=0.03)


def test_lining_in_yielding_ground_is_in_equilibrium_with_it():
    """Its thrust is R times the pressure that the ground leaves at the wall, and it helps."""
    EA = 2e9
    mesh = walled("quad8", n=4, layers=24, radius=CAVITY.radius, reach=15 * CAVITY.radius)
    lining = Beam("wall", EA=Scalar(EA), EI=Scalar(1e6), clamped_on=("x0", "y0"))
    stages = (
        Stage("open", excavate=("core",), release={"core": Scalar(0.7)}),
        Stage("line", build=("lining",), release={"core": Scalar(1.0)}),
    )
    staged = CAVITY.staged(mesh, mohr(1e6, 0.5), stages=stages, structures={"lining": lining})
    survey = staged.survey(NOTHING, fields=True)
    states = analysed(staged)
    inwards = [-CAVITY.outwards(staged, s).mean() for s in states[1:]]
    pressure = EA / CAVITY.radius**2 * (inwards[1] - inwards[0])
    np.testing.assert_allclose(survey.members.axial[:, 1], -pressure * CAVITY.radius, rtol=0.01)
    # The ground under that pressure alone moves as far.
    part = 1 - pressure / CAVITY.pressure
    alone = CAVITY.staged(
        mesh, mohr(1e6, 0.5),
        stages=(Stage("open", excavate=("core",), release={"core": Scalar(0.7)}),
                Stage("more", release={"core": Scalar(part)})),
    )  # fmt: skip
    assert -CAVITY.outwards(alone, analysed(alone)[-1]).mean() == pytest.approx(
        inwards[1], rel=0.01
    )
    assert states[2].yielded.sum() >= states[1].yielded.sum() > 0
    bare = replace(stages[1], build=())
    unlined = CAVITY.staged(mesh, mohr(1e6, 0.5), stages=(stages[0], bare))
    assert -CAVITY.outwards(unlined, analysed(unlined)[-1]).mean() > 1.2 * inwards[1]
