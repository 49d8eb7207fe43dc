"""Lekhnitskii's hole in inclined strata: displacements around the wall, plane strain."""

from __future__ import annotations

import numpy as np
import pytest
from support.anisotropy import STRATA, attitude, general, scalars, turn_matrix
from support.cases import model, moduli_at
from support.closed_forms import kirsch, lekhnitskii
from support.meshes import opening

from geoident.model.case import Material, Stage, Support
from geoident.model.ground import TransverselyIsotropic
from geoident.model.in_situ import ConstantStress
from geoident.model.parameter import Scalar

RADIUS = 2.0
FAR = (-9e6, -6e6, 1.5e6)
DIPS = (0.0, 35.0, -70.0)


def strata(dip: float) -> Material:
    frame = attitude(np.radians(dip))
    return Material("rock", TransverselyIsotropic(**scalars(STRATA), frame=frame))


def wall_motion(mesh, material):
    """Places on the wall, and displacements there."""
    xx, yy, xy = (Scalar(v) for v in FAR)
    zero = Scalar(0.0)
    staged = model(
        mesh,
        materials={"rock": material},
        groups={"core": "rock", "rock": "rock"},
        supports=(Support("outer", (0, 1)),),
        in_situ=ConstantStress((xx, yy, Scalar(-7e6), xy, zero, zero)),
        stages=(Stage("open", excavate=("core",)),),
    )
    u = staged.survey(np.empty(0), fields=True).fields.displacement[-1]
    used = np.unique(mesh.blocks[0].nodes)
    wall = used[np.abs(np.linalg.norm(mesh.points[used], axis=1) - RADIUS) < 1e-9]
    return mesh.points[wall], u[wall]


def wall_error(mesh, material, exact) -> float:
    """Largest error of a wall displacement relative to the largest wall displacement."""
    at, u = wall_motion(mesh, material)
    return error(u, exact(at))


def error(u, expected) -> float:
    return np.linalg.norm(u - expected, axis=1).max() / np.linalg.norm(expected, axis=1).max()


def hole(n: int, layers: int, reach: float):
    return opening("quad8", 2, n=n, layers=layers, radius=RADIUS, reach=reach * RADIUS, whole=True)


def closed_form(material: Material):
    compliance = np.linalg.inv(elasticity_of_section(material))
    return lambda x: lekhnitskii(x, radius=RADIUS, compliance=compliance, stress=FAR)


def elasticity_of_section(material: Material) -> np.ndarray:
    """All six components in the axes of the section, from the law in a solid turned by hand."""
    upright = np.array([[1.0, 0, 0], [0, 0, 1], [0, -1, 0]])  # x, y, z of the section
    E = moduli_at(material, {}, 6)
    return turn_matrix(E, upright)


@pytest.mark.parametrize("dip", DIPS)
def test_wall_displacements_of_a_hole_in_strata(dip, verification):
    rock = strata(dip)
    at, u = wall_motion(hole(4, 24, 40), rock)
    expected = closed_form(rock)(at)
    assert error(u, expected) < 0.005
    angle = np.degrees(np.arctan2(at[:, 1], at[:, 0]))
    sizes = {"exact": np.linalg.norm(expected, axis=1), "found": np.linalg.norm(u, axis=1)}
    verification("strata", f"dip {dip:g} degrees", angle, **sizes)


def test_error_falls_with_the_mesh_and_the_domain():
    rock = strata(DIPS[1])
    errors = [
        wall_error(hole(n, 6 * n, reach), rock, closed_form(rock))
        for n, reach in ((1, 8), (2, 16), (4, 32))
    ]
    # The held outer edge disturbs by (radius / reach)^2, a fourth at twice the reach.
    assert errors[0] / errors[1] > 3
    assert errors[1] / errors[2] > 3


def test_general_entries_of_inclined_strata_open_the_same_hole():
    rock = strata(DIPS[2])
    same = Material("rock", general(elasticity_of_section(rock)))
    mesh, exact = hole(2, 12, 20), closed_form(rock)
    assert wall_error(mesh, same, exact) == pytest.approx(wall_error(mesh, rock, exact), rel=1e-9)


def test_the_closed_form_goes_over_into_kirsch():
    E, nu, share = 10e9, 0.2, 1 + 1e-6
    shear = E / 2 / (1 + nu)
    S = np.diag([1 / E, 1 / E, 1 / E, share / shear, 1 / shear, 1 / shear])
    S[:3, :3] += -nu / E * (1 - np.eye(3))
    angle = np.linspace(0, 6, 9)
    x = RADIUS * np.stack([np.cos(angle), np.sin(angle)], 1)
    close = lekhnitskii(x, radius=RADIUS, compliance=S, stress=(-9e6, -6e6, 0.0))
    exact = kirsch(x, radius=RADIUS, E=E, nu=nu, horizontal=9e6, vertical=6e6)
    np.testing.assert_allclose(close, exact, atol=1e-5 * np.abs(exact).max())
