"""Shells on the faces of interfaces: rings that slip, a plate that is pulled out, derivatives."""

from __future__ import annotations

from math import cosh, sqrt, tanh

import numpy as np
import pytest

from geoident.model.actions import Pressure
from geoident.model.case import Stage, Support
from geoident.model.in_situ import ConstantStress
from geoident.model.interfaces import Interface
from geoident.model.parameter import Parameter, Scalar
from geoident.model.structures import Bolts, Shell
from tests.forward.structures.test_shells import (
    E_ROCK,
    NU,
    NU_ROCK,
    OPEN,
    P0,
    RADIUS,
    SIDES,
    E,
    _lined,
)
from tests.support.cases import displacement, material, model
from tests.support.derivatives import assert_exact
from tests.support.force_gauges import gauge
from tests.support.inner_faces import with_inner_faces
from tests.support.meshes import box
from tests.support.slipping_ring import slipping_ring

NOTHING, ZERO = np.empty(0), Scalar(0.0)
T = 0.3
EA, EI = E * T / (1 - NU**2), E * T**3 / 12 / (1 - NU**2)


@pytest.mark.parametrize(
    ("kind", "n", "k_n", "k_s"),
    [
        ("hex20", 3, 5e9, 5e8),
        ("hex20", 3, 1e13, 1e4),
        pytest.param("tet10", 2, 1e13, 1e4, marks=pytest.mark.slow),  # 2 s
    ],
)
def test_a_lining_that_slips(kind, n, k_n, k_s, verification):
    """Springs, and full slip (Einstein and Schwartz 1979), in a slice of a tunnel, K = 1/2."""
    staged = _lined(kind, n, T, OPEN, interfaces={"s": Interface("wall", Scalar(k_n), Scalar(k_s))})
    found = staged.survey(NOTHING, fields=False).shells
    mean, vary, bent = slipping_ring(
        0.5, EA, EI, k_n, k_s, p=P0, radius=RADIUS, E=E_ROCK, nu=NU_ROCK
    )
    twice = np.cos(2 * np.arctan2(found.centres[:, 1], found.centres[:, 0]))
    hoop, moment = found.normal[:, 1, 0], found.moment[:, 1, 0]
    np.testing.assert_allclose(hoop, mean + vary * twice, atol=0.01 * abs(mean))
    np.testing.assert_allclose(moment, -abs(bent) * twice, atol=0.03 * abs(bent))
    ends = [np.argmax(twice), np.argmin(twice)]
    variant = f"{kind}, {'no shear stiffness' if k_s < 1e6 else 'springs'}"
    verification("slipping-shell", variant, ["spring line", "crown"],
                 exact=(mean + vary * twice)[ends], found=hoop[ends])  # fmt: skip


def test_pressure_inside_acts_on_the_shell_and_through_the_springs_on_the_rock():
    """A ring, springs and the rock one in the other: their stiffnesses by the radius add up."""
    p, k_n = 1e6, 2e9
    stages = (
        Stage("open", excavate=("core",)),
        Stage("line", build=("lining",)),
        Stage("fill", loads={"water": Pressure("wall", Scalar(p))}),
    )
    at = (RADIUS, 0.0, 0.1)
    staged = _lined(
        "hex20", 3, T, stages, in_situ=ConstantStress((ZERO,) * 6),
        interfaces={"s": Interface("wall", Scalar(k_n), Scalar(k_n))},
        channels=(displacement("u", at, (1.0, 0.0, 0.0), zero="line"),),
    )  # fmt: skip
    found = staged.survey(NOTHING, fields=False)
    ring = EA / RADIUS**2
    outside = 1 / (1 / k_n + RADIUS * (1 + NU_ROCK) / E_ROCK)
    out = p / (ring + outside)
    np.testing.assert_allclose(found.shells.normal[:, 1, 2], ring * out * RADIUS, rtol=5e-3)
    assert found.computed[0, -1] == pytest.approx(out, rel=5e-3)


# --- a plate in rigid rock -----------------------------------------------------------------------

LENGTH, WIDTH, STIFF, BOND, COHESION = 2.0, 0.5, 4e9, 5e8, 1e5


def _plate(pull, **limits):
    """Motion of the free and of the loaded end of a plate that jacks pull along its interfaces."""
    mesh = box("hex8", (20, 1, 2), size=(LENGTH, WIDTH, 1.0))
    mesh = with_inner_faces(mesh, plate=lambda x: abs(x[..., 2] - 0.5) < 1e-9)
    jacks = tuple(((LENGTH, y, 0.5), (LENGTH + 1.0, y, 0.5)) for y in (0.0, WIDTH))
    staged = model(
        mesh,
        materials={"rock": material("rock", 1e16, 0.0)},
        groups={"all": "rock"},
        supports=(Support("z0", (0, 1, 2)), Support("z1", (0, 1, 2)),
                  Support("y0", (1,)), Support("y1", (1,))),
        interfaces={"bond": Interface("plate", Scalar(1e12), Scalar(BOND), **limits)},
        structures={
            "plate": Shell("plate", Scalar(STIFF / 0.02), Scalar(0.02), ZERO, (1.0, 0.0, 0.0),
                           mirrored_on=("y0", "y1")),
            "jack": Bolts(jacks, EA=Scalar(1e9), prestress=Scalar(pull * WIDTH / 2),
                          second_end="fixed"),
        },
        stages=(Stage("built", build=("plate",)), Stage("pull", build=("jack",))),
        channels=tuple(displacement(f"x{x:g}", (x, 0.2, 0.5), (1.0, 0.0, 0.0), zero="built")
                       for x in (0.0, LENGTH)),
    )  # fmt: skip
    return staged.computed(NOTHING)[:, -1]


def test_a_plate_is_pulled_out():
    """Both sides hold it: lambda^2 = 2 k_s / EA; at the limit of both it moves as a whole."""
    pull = 1e5
    lam = sqrt(2 * BOND / STIFF)
    whole = pull / (STIFF * lam * tanh(lam * LENGTH))
    np.testing.assert_allclose(_plate(pull), [whole / cosh(lam * LENGTH), whole], rtol=2e-3)
    limits = {"cohesion": Scalar(COHESION), "friction": ZERO}
    assert _plate(0.99 * 2 * COHESION * LENGTH, **limits)[0] < COHESION / BOND * 1.001
    assert np.isnan(_plate(1.01 * 2 * COHESION * LENGTH, **limits)).all()


def test_derivatives_by_shell_interface_and_ground_are_exact():
    starts = {"E": 20e9, "t": 0.3, "k_n": 5e9, "k_s": 5e8, "c": 5e4, "E_rock": 2e9}
    parameters = tuple(Parameter(n, x, 0.2 * x, 3.0 * x) for n, x in starts.items())
    shell = Shell("wall", Scalar(1.0, "E"), Scalar(1.0, "t"), Scalar(NU), (0.0, 0.0, 1.0),
                  mirrored_on=SIDES)  # fmt: skip
    slip = Interface("wall", Scalar(1.0, "k_n"), Scalar(1.0, "k_s"), cohesion=Scalar(1.0, "c"),
                     friction=Scalar(0.15))  # fmt: skip
    stages = (
        Stage("open", excavate=("core",), release={"core": Scalar(0.4)}),
        Stage("line", build=("lining",), release={"core": Scalar(0.7)}),
        Stage("more", release={"core": Scalar(1.0)}),
    )
    at = (RADIUS * float(np.cos(0.4)), RADIUS * float(np.sin(0.4)), 0.3)
    channels = [displacement("u", at, (0.6, 0.8, 0.0), zero="line")]
    for quantity, dimension in (("n_22", "line load"), ("m_22", "moment per length")):
        channels.append(gauge("load-cell", quantity, at, quantity, structure="lining",
                              dimension=dimension))  # fmt: skip
    channels.append(gauge("tilt", "tilt", at, structure="lining", dimension="angle",
                          direction=(1.0, 0.0, 0.0), zero="line"))  # fmt: skip
    staged = _lined(
        "hex8", 3, T, stages, reach=6, parameters=parameters, structures={"lining": shell},
        materials={"rock": material("rock", Scalar(1.0, "E_rock"), NU_ROCK)},
        interfaces={"s": slip}, channels=tuple(channels),
    )  # fmt: skip
    found = staged.survey(p := np.array(list(starts.values())), fields=False)
    assert 0.0 < found.interfaces.slips[:, -1].mean() < 1.0
    pairs = [(channel.name, "more") for channel in channels]
    assert_exact(staged.response(pairs), p, tuple(starts))
