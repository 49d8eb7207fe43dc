"""Stresses and strains at points, from the strain points around them."""

from __future__ import annotations

import numpy as np
import pytest
from support.meshes import KINDS, box, mixed_box, regroup
from support.revolved import section

from geoident.fem.kinematics import AXISYMMETRIC, PLANE_STRAIN, SOLID, block_geometry, strain_points
from geoident.fem.location import Locator
from geoident.fem.recovery import linear_fit, recovery

PLANE = (0.43, 0.61)
SPACE = (0.43, 0.61, 0.37)


def _points(mesh, kinematics):
    geometries = tuple(block_geometry(mesh.points, b, kinematics) for b in mesh.blocks)
    return strain_points(mesh, geometries, kinematics)


def _at(mesh, kinematics, place, group=None):
    element = Locator(mesh).sites(place)[0].element
    group = np.ones(mesh.n_elements, bool) if group is None else group
    return recovery(mesh, kinematics, element, group, np.array(place))


@pytest.mark.parametrize("kind", KINDS)
def test_a_stress_that_is_linear_in_space_is_met_exactly(kind):
    dim = 3 if kind[:3] in {"tet", "hex", "wed", "pyr"} else 2
    mesh = box(kind, (3,) * dim, distortion=0.2)
    kinematics, place = (PLANE_STRAIN, PLANE) if dim == 2 else (SOLID, SPACE)
    rng = np.random.default_rng(1)
    start, slope = rng.normal(size=kinematics.n_strain), rng.normal(size=(kinematics.n_strain, dim))
    points = _points(mesh, kinematics)
    field = start[:, None] + slope @ points.position.T
    for where in (place, (0.02,) * dim, (1.0, *place[1:])):  # inside, near a corner, on a face
        found = _at(mesh, kinematics, where).at(field)
        np.testing.assert_allclose(found, start + slope @ np.array(where), rtol=1e-9, atol=1e-9)


@pytest.mark.parametrize("order", [1, 2])
def test_it_is_met_across_kinds_of_elements(order):
    mesh = mixed_box(order)
    points = _points(mesh, SOLID)
    field = np.tile(points.position @ [1.0, -2.0, 0.5] + 3.0, (6, 1))
    for element in range(0, mesh.n_elements, 7):
        place = points.position[points.element == element].mean(axis=0) + 1e-3
        found = recovery(mesh, SOLID, element, np.ones(mesh.n_elements, bool), place).at(field)
        np.testing.assert_allclose(found, place @ [1.0, -2.0, 0.5] + 3.0, rtol=1e-9)


@pytest.mark.parametrize("kind", ["tri3", "tri6", "quad4", "quad8"])
def test_the_strain_is_that_of_the_displacements(kind):
    mesh = section(kind, (4, 3), (1.0, 1.0), inner=2.0)
    place = (2.43, 0.61)
    points = _points(mesh, AXISYMMETRIC)
    u = np.random.default_rng(3).normal(size=mesh.points.size)
    found = _at(mesh, AXISYMMETRIC, place)
    np.testing.assert_allclose(found.gradients @ u, found.at(points.strain(u)), rtol=1e-10)
    assert np.abs(found.gradients @ u).min() > 0  # the hoop strain among them


@pytest.mark.parametrize("kind", ["tri3", "quad4", "quad8", "tri6"])
def test_any_other_stress_converges_with_the_square_of_the_size(kind):
    def error(n):
        mesh = box(kind, (n, n))
        points = _points(mesh, PLANE_STRAIN)
        field = np.tile(np.exp(2.0 * points.position @ [1.0, 0.7]), (4, 1))
        places = np.random.default_rng(5).uniform(0.05, 0.95, (30, 2))
        exact = np.exp(2.0 * places @ [1.0, 0.7])
        found = np.array([_at(mesh, PLANE_STRAIN, tuple(place)).at(field)[0] for place in places])
        return np.sqrt(np.mean((found / exact - 1) ** 2))

    assert np.log(error(8) / error(20)) / np.log(2.5) > 1.6


def test_no_stress_of_other_ground_mixes_in():
    mesh = regroup(box("quad4", (8, 8)), left=lambda x: x[:, 0] < 0.5)
    points, left = _points(mesh, PLANE_STRAIN), np.zeros(mesh.n_elements, bool)
    left[mesh.groups["left"]] = True
    field = np.where(left[points.element], 1.0, 7.0)[None].repeat(4, axis=0)
    assert _at(mesh, PLANE_STRAIN, (0.45, 0.5), left).at(field) == pytest.approx(1.0)
    assert _at(mesh, PLANE_STRAIN, (0.55, 0.5), ~left).at(field) == pytest.approx(7.0)


def test_across_a_single_layer_it_is_constant():
    mesh = box("tri3", (6, 1), size=(6.0, 0.1))
    points = _points(mesh, PLANE_STRAIN)
    field = np.tile(3.0 + points.position[:, 0], (4, 1))
    assert _at(mesh, PLANE_STRAIN, (3.0, 0.05)).at(field) == pytest.approx(6.0, rel=1e-9)
    # all on a line that the place does not lie on
    weights = linear_fit(np.array([[0.0, 1.0], [1.0, 1.0]]), np.ones(2), np.array([0.5, 9.0]))
    np.testing.assert_allclose(weights, [0.5, 0.5])
