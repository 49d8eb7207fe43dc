"""Strength reduction beside interfaces: blocks that slide on them, in closed form."""

from __future__ import annotations

from dataclasses import replace
from math import atan, cos, degrees, radians, sin, sqrt, tan

import numpy as np
import pytest
from scipy.optimize import brentq
from support.cases import model
from support.inner_faces import with_inner_faces
from support.meshes import from_grid, with_outer_faces
from support.yielding import NOTHING, mohr, rock

from geoident.forward.safety.search import Search, safety_factors
from geoident.model.actions import Traction
from geoident.model.case import Stage, Support
from geoident.model.interfaces import Interface
from geoident.model.mesh import ElementBlock, Mesh
from geoident.model.parameter import Scalar
from geoident.model.structures import Bolts, GroutedBars
from tests.forward.structures.test_interfaces import held_by_friction, on_level, roof
from tests.support.meshes import box

C, PHI, G = 20e3, radians(35.0), 9.81
STIFF = {"k_n": Scalar(1e10), "k_s": Scalar(1e9)}


def failure_of(staged, **search):
    """The factor of safety, and how the ground fails."""
    ((found, mechanism),) = safety_factors(staged, NOTHING, [1], Search(tolerance=0.002, **search))
    return found, mechanism


def factor_of(staged, **search):
    return failure_of(staged, **search)[0]


def bench(joint: Interface, dip: float, H: float = 10.0, ground=(), **structures):
    """A vertical face of rock of 25 kN/m3 whose joint comes out at the toe."""
    n = 4
    wide = H / tan(dip)
    grid = np.stack(np.meshgrid(np.linspace(0, wide, n + 1), np.linspace(0, H, n + 1),
                                indexing="ij"), -1).reshape(-1, 2)  # fmt: skip
    mesh = with_inner_faces(
        from_grid("tri6", grid, (n, n)),
        joint=lambda x: abs(x[..., 1] / H - x[..., 0] / wide) < 1e-6,
    )
    return model(
        mesh,
        materials={"rock": rock(1e10, 0.2, *ground, density=25e3 / G)},
        groups={"all": None},
        supports=(Support("x1", (0, 1)), Support("y0", (0, 1))),
        gravity=(0.0, -G),
        interfaces={"joint": joint},
        structures=structures,
        stages=(Stage("cut", install={"all": "rock"}, build=tuple(structures)),),
    )


@pytest.mark.parametrize(
    "dip", [radians(60.0), pytest.param(radians(45.0), marks=pytest.mark.slow)]
)
def test_plane_failure_of_a_rock_slope(dip, verification):
    """(c L + W cos(dip) tan(phi)) / (W sin(dip)), W = gamma H^2 / 2 tan(dip)."""
    H = 10.0
    W, L = 0.5 * 25e3 * H**2 / tan(dip), H / sin(dip)
    exact = (C * L + W * cos(dip) * tan(PHI)) / (W * sin(dip))
    found, mechanism = failure_of(
        bench(Interface("joint", **STIFF, cohesion=Scalar(C), friction=Scalar(PHI)), dip)
    )
    assert found.value == pytest.approx(exact, rel=0.003)
    assert "the interface 'joint' slips or opens" in found.place
    assert found.unyielding == "rock"
    mesh = mechanism.mesh
    corners = mesh.points[mesh.blocks[0].nodes[:, :3]]
    off = abs(corners[..., 1] - corners[..., 0] * tan(dip)).min(axis=1)
    shears = mechanism.shear > 0.3
    assert shears.any()
    assert off[shears].max() < 1e-6  # what is drawn dark lies on the joint
    variant = f"joint at {np.degrees(dip):.0f} degrees, tri6"
    verification("safety", variant, ["plane slide"], exact=exact, found=found.value)


@pytest.mark.slow  # the slide above
def test_part_of_a_strength_and_dilation():
    """R_inter takes its part of both before the factor does; a slide needs no dilation."""
    dip, part, H = radians(45.0), 0.7, 10.0
    W, L = 0.5 * 25e3 * H**2 / tan(dip), H / sin(dip)
    exact = part * (C * L + W * cos(dip) * tan(PHI)) / (W * sin(dip))
    joint = Interface("joint", **STIFF, cohesion=Scalar(C), friction=Scalar(PHI),
                      R_inter=Scalar(part), dilation=Scalar(radians(20.0)))  # fmt: skip
    assert factor_of(bench(joint, dip)).value == pytest.approx(exact, rel=0.003)
    stable = factor_of(bench(joint, dip, ground=(mohr(1e6, PHI),)))
    assert stable.value == pytest.approx(exact, rel=0.003)
    assert stable.unyielding == ""


BOLT = {"ends": (((0.0, 4.0), (9.0, 4.0)),), "spacing": Scalar(1.0), "EA": Scalar(1e8)}


@pytest.mark.parametrize(
    "bolt",
    [
        Bolts(**BOLT, capacity=Scalar(300e3)),
        pytest.param(
            GroutedBars(**BOLT, k_grout=Scalar(5e8), bond=Scalar(60e3), pieces=9),
            marks=pytest.mark.slow,
        ),
    ],
)
def test_a_bolt_keeps_its_strength(bolt):
    """T is added to what holds the slide, and is not divided: of steel, or of 5 m of grout."""
    dip, T = radians(45.0), 300e3
    W, L = 0.5 * 25e3 * 10.0**2, 10.0 / sin(dip)
    exact = (C * L + (W * cos(dip) + T * sin(dip)) * tan(PHI)) / (W * sin(dip) - T * cos(dip))
    joint = Interface("joint", **STIFF, cohesion=Scalar(C), friction=Scalar(PHI))
    found = factor_of(bench(joint, dip, bolt=bolt), guess=exact)
    assert found.value == pytest.approx(exact, rel=0.003)
    assert found.kept == "bolt"


@pytest.mark.slow  # the slide above, whose factor is below one as well
def test_a_slope_that_slides_as_it_is():
    dip = radians(60.0)
    exact = tan(PHI) / tan(dip)
    found = factor_of(bench(Interface("joint", **STIFF, friction=Scalar(PHI)), dip))
    assert found.value == pytest.approx(exact, rel=0.003)


@pytest.mark.slow  # the slide in the plane
def test_a_roof_wedge():
    """Bray's weight at the friction that is left, elastic up to there (relaxation by stiffness)."""
    friction = radians(45.0)
    weight = 0.6 * held_by_friction(friction)
    left = brentq(lambda phi: held_by_friction(phi) - weight, radians(21.0), friction)
    found = factor_of(roof(weight, friction))
    assert found.value == pytest.approx(tan(friction) / tan(left), rel=0.003)


@pytest.mark.parametrize("kind", ["quad4", pytest.param("hex8", marks=pytest.mark.slow)])
def test_a_contact_that_is_pulled(kind):
    """Its tensile strength is divided as c and tan(phi) are; in space, too."""
    dim = 2 if kind == "quad4" else 3
    top, base = "xyz"[dim - 1] + "1", "xyz"[dim - 1] + "0"
    load = Traction(top, (*(Scalar(0.0),) * (dim - 1), Scalar(2e5)))
    joint = Interface("joint", **STIFF, cohesion=Scalar(1e6), friction=Scalar(PHI),
                      tensile_strength=Scalar(3e5))  # fmt: skip
    staged = model(
        on_level(box(kind, (2,) * dim), 0.5),
        materials={"rock": rock(1e9, 0.0)},
        groups={"rock": "rock", "low": "rock"},
        supports=(Support(base, tuple(range(dim))),),
        interfaces={"joint": joint},
        stages=(Stage("pull", loads={"pull": load}),),
    )
    assert factor_of(staged).value == pytest.approx(1.5, rel=0.003)


# --- a wedge on two joints -----------------------------------------------------------------------

HALF, PLUNGE = radians(45.0), atan(0.5)
WEDGE = Interface("joint", **STIFF, friction=Scalar(PHI))


def wedge(joint: Interface, half: float = HALF, plunge: float = PLUNGE, turn=None):
    """A symmetric wedge on two joints whose line dips in x; ``turn`` (3, 3) turns all of it."""
    wide, turn = tan(half), np.eye(3) if turn is None else turn
    section = 4.0 * np.array(
        [[0, 0], [wide, 1], [-wide, 1], [2, 1], [2, -1], [-2, -1], [-2, 1]], float
    )
    points = np.concatenate([np.insert(section, 0, x, axis=1) for x in (0.0, 8.0)])
    front = np.array([[0, 1, 2], [0, 3, 1], [0, 4, 3], [0, 5, 4], [0, 6, 5], [0, 2, 6]])
    cells = np.concatenate([front, front + len(section)], axis=1)
    groups = {"wedge": np.array([0]), "rock": np.arange(1, 6)}
    mesh = Mesh(points, (ElementBlock("wedge6", cells, np.arange(1, 7)),), groups=groups)
    mesh = with_inner_faces(
        with_outer_faces(mesh), joint=lambda x: abs(abs(x[..., 1]) - wide * x[..., 2]) < 1e-9
    )
    return model(
        replace(mesh, points=mesh.points @ turn.T),
        materials={"rock": rock(1e10, 0.2, density=2500.0)},
        groups=dict.fromkeys(groups),
        supports=tuple(Support(face, (0, 1, 2)) for face in ("y0", "y1", "z0")),
        gravity=tuple(G * turn @ [sin(plunge), 0.0, -cos(plunge)]),
        interfaces={"joint": joint},
        stages=(Stage("cut", install=dict.fromkeys(groups, "rock")),),
    )


def held_on_two_joints(psi: float, half: float, plunge: float) -> tuple[float, float]:
    """Factor of safety of a rigid wedge with friction PHI and dilation psi on both joints.

    As it moves by 1 along their line it rises by z = tan(psi) / sqrt(sin^2 h - tan^2(psi) cos^2 h),
    which is given, too. Shear has the parts a along the line and b up the joints. With N on each

        2 N (sin h - b cos h tan(phi)) = W cos(dip) ,    2 N a tan(phi) = W sin(dip) ;

    without dilation tan(phi) / tan(dip) / sin h: E. Hoek and J. W. Bray, Rock slope engineering.
    """
    rise = tan(psi) / sqrt(sin(half) ** 2 - (tan(psi) * cos(half)) ** 2)
    a, b = np.array([1.0, rise * cos(half)]) / np.hypot(1.0, rise * cos(half))
    return tan(PHI) * (a / tan(plunge) + b * cos(half)) / sin(half), rise


@pytest.mark.parametrize(
    ("half", "plunge", "dilations"),
    [
        (HALF, PLUNGE, (0.0, 10.0)),
        pytest.param(radians(30.0), radians(30.0), (0.0, 5.0, 10.0), marks=pytest.mark.slow),
    ],
)
def test_a_wedge_slides_on_two_joints(half, plunge, dilations, verification):
    """Shear is against the slide on both: nothing is left across it, with dilation or without."""
    found, exact = [], []
    for psi in map(radians, dilations):
        factor, rise = held_on_two_joints(psi, half, plunge)
        joint = replace(WEDGE, dilation=Scalar(psi))
        one, mechanism = failure_of(wedge(joint, half, plunge), guess=factor)
        slides = mechanism.velocity
        slides = slides[np.abs(slides).max(axis=1) > 0.5].mean(axis=0)
        np.testing.assert_allclose(slides / slides[0], [1.0, 0.0, rise], atol=0.02)
        found.append(one.value)
        exact.append(factor)
    np.testing.assert_allclose(found, exact, rtol=0.002)
    variant = f"joints {2 * degrees(half):.0f} degrees apart, dip {degrees(plunge):.1f} degrees"
    verification("sliding-wedge", variant, dilations, exact=np.array(exact), found=found)


def test_a_wedge_moves_alike_however_it_is_turned():
    """Joints of any direction have slips in directions of their own; strength is alike in all."""
    joint = replace(WEDGE, friction=Scalar(radians(21.0)), dilation=Scalar(radians(5.0)))
    turn = np.linalg.qr(np.random.default_rng(3).normal(size=(3, 3)))[0]
    turn *= np.linalg.det(turn)
    whole, turned = (wedge(joint, turn=Q).survey(NOTHING, fields=True) for Q in (None, turn))
    assert whole.interfaces.slips.any()
    moved = whole.fields.displacement[-1]
    np.testing.assert_allclose(
        turned.fields.displacement[-1], moved @ turn.T, atol=1e-9 * np.abs(moved).max()
    )


def test_a_block_is_held_alike_in_every_direction():
    """Moved along a joint by prescribed ways between its axes: c - t_n tan(phi), to rounding."""
    base, top, every = "z0", "z1", (0, 1, 2)
    joint = Interface("joint", **STIFF, cohesion=Scalar(C), friction=Scalar(PHI))
    for turn in radians(11.0), radians(37.0), radians(198.0):
        ways = zip(every, (5e-3 * cos(turn), 5e-3 * sin(turn), -1e-5), strict=True)
        pushed = Support(top, every, motions=tuple((n, Scalar(way)) for n, way in ways))
        staged = model(
            on_level(box("hex8", (1, 1, 2)), 0.5),
            materials={"rock": rock(1e16, 0.0)},
            groups={"rock": "rock", "low": "rock"},
            supports=(Support(base, every), Support(top, every)),
            interfaces={"joint": joint},
            stages=(Stage("push", supports={top: pushed}),),
        )
        states = staged.survey(NOTHING, fields=False).interfaces
        held = C - states.normal_traction * tan(PHI)
        np.testing.assert_allclose(states.shear_traction, held, rtol=1e-9)
