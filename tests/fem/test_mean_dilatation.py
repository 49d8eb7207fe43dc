"""Elements of first order that dilate alike at all their points (B-bar, theory 1.2)."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from support.anisotropy import moduli
from support.meshes import box

from geoident.fem.elasticity import isotropic
from geoident.fem.kinematics import (
    AXISYMMETRIC,
    NORMAL_COMPONENTS,
    PLANE_STRAIN,
    SOLID,
    block_geometry,
    strain_points,
)
from geoident.fem.tangent import PointBlocks

SECTIONS = [
    ("quad4", PLANE_STRAIN, (0, 1)),
    ("quad4", AXISYMMETRIC, (0, 1, 2)),
    ("tri3", AXISYMMETRIC, (0, 1, 2)),
    ("hex8", SOLID, (0, 1, 2)),
    ("wedge6", SOLID, (0, 1, 2)),
    ("pyramid5", SOLID, (0, 1, 2)),
]
elements = pytest.mark.parametrize(("kind", "kinematics", "normal"), SECTIONS)
E = moduli(isotropic, {"E": 3.0, "nu": 0.3})


def mesh_of(kind, kinematics, n=3):
    """A distorted mesh, off the axis of revolution."""
    mesh = box(kind, (n,) * kinematics.dim, distortion=0.25)
    return replace(mesh, points=mesh.points + 0.7)


def points_of(mesh, kinematics):
    geometries = tuple(block_geometry(mesh.points, b, kinematics) for b in mesh.blocks)
    return strain_points(mesh, geometries, kinematics), geometries


@elements
def test_all_points_of_an_element_dilate_alike_and_shear_as_before(kind, kinematics, normal):
    mesh = mesh_of(kind, kinematics)
    plain, _ = points_of(mesh, kinematics)
    mean, _ = points_of(mesh, kinematics.with_mean_dilatation())
    u = np.random.default_rng(3).standard_normal(mesh.points.size)
    before, after = plain.strain(u), mean.strain(u)
    dilatation = [strain[:NORMAL_COMPONENTS].sum(axis=0) for strain in (before, after)]
    by_element = [
        np.bincount(plain.element, d * plain.volume) / np.bincount(plain.element, plain.volume)
        for d in dilatation
    ]
    np.testing.assert_allclose(dilatation[1], by_element[0][plain.element], atol=1e-12)
    np.testing.assert_allclose(by_element[1], by_element[0], atol=1e-12)
    assert np.abs(dilatation[0] - dilatation[1]).max() > 0.1
    rows = list(normal)
    deviators = [s[rows] - s[rows].mean(axis=0) for s in (before, after)]
    np.testing.assert_allclose(*deviators, atol=1e-12)
    np.testing.assert_array_equal(np.delete(before, rows, axis=0), np.delete(after, rows, axis=0))


@elements
def test_patch_test_linear_motions_and_constant_stresses_stay_exact(kind, kinematics, normal):
    if kinematics.revolved:  # a motion whose strains are constant: u = (a r, b z)
        gradient, dilates = np.diag([0.3, -0.2]), [0.3, -0.2, 0.3, 0.0]
    else:
        gradient = np.random.default_rng(4).standard_normal((kinematics.dim,) * 2)
        g = np.zeros((3, 3))
        g[: kinematics.dim, : kinematics.dim] = gradient
        shears = [(0, 1), (1, 2), (0, 2)][: kinematics.n_strain - 3]
        dilates = [*np.diag(g), *(g[i, j] + g[j, i] for i, j in shears)]
    mesh = mesh_of(kind, kinematics)
    plain, _ = points_of(mesh, kinematics)
    mean, _ = points_of(mesh, kinematics.with_mean_dilatation())
    strain = mean.strain((mesh.points @ gradient.T).ravel())
    np.testing.assert_allclose(
        strain, np.tile(np.array(dilates)[:, None], plain.n_points), atol=1e-12
    )
    stress = np.tile(np.arange(1.0, kinematics.n_strain + 1)[:, None], plain.n_points)
    np.testing.assert_allclose(
        mean.forces(stress, mean.volume), plain.forces(stress, plain.volume), atol=1e-12
    )


@elements
def test_nothing_but_rigid_motions_is_free(kind, kinematics, normal):
    kinematics = kinematics.with_mean_dilatation()
    mesh = mesh_of(kind, kinematics, n=1)
    _, geometries = points_of(mesh, kinematics)
    blocks = PointBlocks(mesh, geometries, kinematics)
    n_points = blocks.n_points(0)
    B = blocks.compatibility(0, np.arange(n_points))  # of the first element
    s = kinematics.n_strain
    K = np.einsum("qsi,st,qtj,q->ij", B, E[:s, :s], B, geometries[0].volumes[0])
    sizes = np.linalg.eigvalsh(K)
    assert np.count_nonzero(sizes < 1e-10 * sizes.max()) == len(kinematics.rigid)
    assert sizes[len(kinematics.rigid)] > 1e-3 * sizes.max()


def test_elements_of_second_order_stay_as_they_are():
    mesh = mesh_of("quad8", PLANE_STRAIN)
    u = np.random.default_rng(5).standard_normal(mesh.points.size)
    plain, _ = points_of(mesh, PLANE_STRAIN)
    mean, _ = points_of(mesh, PLANE_STRAIN.with_mean_dilatation())
    np.testing.assert_array_equal(plain.strain(u), mean.strain(u))
