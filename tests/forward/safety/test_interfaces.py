"""Strength reduction beside interfaces: blocks that slide on them, in closed form."""

from __future__ import annotations

from math import cos, radians, sin, tan

import numpy as np
import pytest
from scipy.optimize import brentq
from support.cases import model
from support.inner_faces import with_inner_faces
from support.meshes import from_grid
from support.yielding import NOTHING, mohr, rock

from geoident.forward.safety.search import Search, safety_factors
from geoident.model.actions import Traction
from geoident.model.case import Stage, Support
from geoident.model.interfaces import Interface
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
