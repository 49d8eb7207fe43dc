"""Interfaces that open close again: a gap bears nothing until it is closed, but for dilation."""

from __future__ import annotations

from math import radians, tan

import numpy as np
import pytest
from scipy.optimize import brentq

from geoident.model.case import Stage, Support
from geoident.model.interfaces import Interface
from geoident.model.parameter import Parameter, Scalar
from tests.forward.structures.test_interfaces import NOTHING, RIGID, meter, on_level
from tests.support.cases import material, model
from tests.support.derivatives import assert_slopes
from tests.support.meshes import KINDS_2D, box

STIFF, SOFT = 1e9, 2e8


def block(kind: str, motions: list[tuple[float, float]], rock=RIGID, **more):
    """A block on a joint, whose top is moved along it and away, m, stage by stage."""
    dim = 2 if kind in KINDS_2D else 3
    base, top = "xyz"[dim - 1] + "0", "xyz"[dim - 1] + "1"
    every = tuple(range(dim))

    def moved(along: float, away: float) -> Support:
        return Support(top, every, motions=((0, Scalar(along)), (dim - 1, Scalar(away))))

    return model(
        on_level(box(kind, (2,) * dim), 0.5),
        materials={"stone": rock},
        groups={"rock": "stone", "low": "stone"},
        supports=(Support(base, every), Support(top, every)),
        stages=tuple(Stage(f"{n}", supports={top: moved(*m)}) for n, m in enumerate(motions)),
        **more,
    )


def sheared(kind: str, motions: list[tuple[float, float]], **limits: float):
    """What the joint below a rigid block bears."""
    joint = Interface("joint", Scalar(STIFF), Scalar(SOFT), **_scalars(limits))
    staged = block(kind, motions, interfaces={"joint": joint})
    return staged.survey(NOTHING, fields=False).interfaces


def _scalars(numbers: dict[str, float]) -> dict[str, Scalar]:
    return {name: Scalar(number) for name, number in numbers.items()}


@pytest.mark.parametrize(("kind", "tensile"), [("tri6", 0.0), ("quad4", 5e4), ("tet4", 5e4)])
def test_a_gap_closes_without_stress(kind, tensile, verification):
    """t_n = min(k_n d, f_t) whatever came before; |t_s| <= c - t_n tan(phi)."""
    away = np.array([-1e-3, 2e-3, 1e-3, 2e-5, -1e-5, -5e-4])
    limits = {"friction": radians(30.0), "cohesion": tan(radians(30.0)) * tensile}
    states = sheared(kind, [(0.0, d) for d in away], tensile_strength=tensile, **limits)
    expected = np.minimum(STIFF * away, tensile)
    np.testing.assert_allclose(
        states.normal_traction, expected[None].repeat(len(states.points), 0), atol=1e-3
    )
    np.testing.assert_allclose(states.shear_traction, 0.0, atol=1e-3)
    np.testing.assert_array_equal(states.parts[0], STIFF * away > tensile)
    variant = f"{kind}, tensile strength {tensile / 1e3:g} kPa"
    found = states.normal_traction[0]
    verification("joint-gap", variant, away * 1e3, exact=expected, found=found)


@pytest.mark.parametrize(("kind", "near"), [("quad8", 1e-6), ("hex8", 0.02)])
def test_what_slip_has_dilated_stays_open(kind, near):
    """Direct shear at constant height: t_s = (k_n (d + s_p tan(psi))) tan(phi), s_p the slip less
    t_s / k_s. Then the block is lifted, and meets its bed again where the slip has led it."""
    phi, psi, pressed, along = radians(30.0), radians(10.0), 1e-3, 1e-2
    moved = [(0.0, -pressed), (along, -pressed), (along, 5e-3), (along, 2e-3), (along, 1e-3)]
    states = sheared(kind, moved, friction=phi, dilation=psi)

    def excess(slip: float) -> float:
        return SOFT * (along - slip) - STIFF * (pressed + slip * tan(psi)) * tan(phi)

    slip = brentq(excess, 0.0, along)
    normal = -STIFF * (pressed + slip * tan(psi))
    gap = along * tan(psi)
    expected = [-STIFF * pressed, normal, 0.0, 0.0, STIFF * (1e-3 - gap)]
    np.testing.assert_allclose(states.normal_traction.mean(axis=0), expected, rtol=near, atol=1.0)
    shear = SOFT * (along - slip)
    assert np.abs(states.shear_traction[:, 1]) == pytest.approx(shear, rel=near)
    assert np.ptp(states.normal_traction, axis=0).max() < 1e-6 * abs(normal)


STARTS = {
    "E": 4e8, "k_n": 1e9, "k_s": 2e8, "cohesion": 6e4, "friction": radians(30.0),
    "dilation": radians(10.0), "tensile_strength": 3e4, "R_inter": 0.8,
}  # fmt: skip


@pytest.mark.parametrize("kind", ["quad8", "hex8"])
def test_derivatives_where_a_joint_slips_opens_and_closes(kind):
    """By the rock, stiffness, strength and dilation; soft rock makes openings depend on them."""
    dim = 2 if kind in KINDS_2D else 3
    one = {name: Scalar(1.0, name) for name in STARTS}
    staged = block(
        kind,
        [(0.0, -4e-4), (2e-3, -4e-4), (2.2e-3, 1.2e-3), (2.2e-3, 1e-4), (2.6e-3, -1e-3)],
        material("rock", one["E"], 0.25),
        parameters=tuple(Parameter(n, v, 0.5 * v, 1.5 * v) for n, v in STARTS.items()),
        interfaces={"joint": Interface("joint", **{n: one[n] for n in STARTS if n != "E"})},
        channels=tuple(
            meter(f"{way}{x}", (x, *(0.6,) * (dim - 2), 0.5), way)
            for way in ("opening", "slip")
            for x in (0.2, 0.7)
        ),
    )
    start = np.array(list(STARTS.values()))
    states = staged.survey(start, fields=False).interfaces
    assert states.slips[:, 1].all()
    assert states.parts[:, 2].any()
    assert not states.parts[:, 4].all()
    pairs = [(c.name, s) for c in staged.case.channels for s in staged.case.stage_names[1:]]
    response = staged.response(pairs)
    _, jacobian = response.evaluate(start)
    assert_slopes(response.readings, start, jacobian, tuple(STARTS), step=2e-4)
