"""Patches: strains, forces and stiffness of a part of a mesh are those of the whole."""

from __future__ import annotations

import numpy as np
import pytest
import scipy.sparse as sp
from support.meshes import box

from geoident.fem.kinematics import PLANE_STRAIN, block_geometry, strain_points
from geoident.fem.patches import PatchTangents, patch_around

MESH = box("tri6", (8, 8), distortion=0.2)
POINTS = strain_points(
    MESH, tuple(block_geometry(MESH.points, b, PLANE_STRAIN) for b in MESH.blocks), PLANE_STRAIN
)
RANDOM = np.random.default_rng(3)
HELD = RANDOM.choice(POINTS.n_dofs, 40, replace=False)
DOFS = RANDOM.permutation(np.setdiff1d(np.arange(POINTS.n_dofs), HELD))
HERE = POINTS.position[:, 0] < 0.8
VOLUME = np.where(HERE, POINTS.volume, 0.0)
E = np.diag([3.0, 3.0, 3.0, 1.0]) + 1.0
E[3, :3] = E[:3, 3] = 0.0
CENTRE = int(np.argmin(np.linalg.norm(MESH.points[DOFS // 2] - 0.5, axis=1)))


def patch():
    """Around one unknown in the middle of the mesh."""
    found = patch_around(POINTS, HERE, DOFS, np.array([CENTRE]), DOFS.size)
    assert found is not None
    return found


def dense(moduli):
    """C^T V moduli C of the points that are there, (n_dofs, n_dofs), point by point."""
    C = POINTS.compatibility().toarray().reshape(POINTS.n_strain, POINTS.n_points, -1)
    total = np.zeros((POINTS.n_dofs,) * 2)
    for q in range(POINTS.n_points):
        total += VOLUME[q] * C[:, q].T @ moduli[q] @ C[:, q]
    return total


def test_strains_and_forces_are_those_of_the_whole():
    found = patch()
    u, stress = RANDOM.normal(size=POINTS.n_dofs), RANDOM.normal(size=(4, POINTS.n_points))
    assert found.strain(u[found.dofs]) == pytest.approx(POINTS.strain(u)[:, found.points])
    forces = found.forces(stress[:, found.points], VOLUME[found.points])
    moving = DOFS[found.unknowns]
    assert np.array_equal(found.dofs[found.places], moving)
    assert forces[found.places] == pytest.approx(POINTS.forces(stress, VOLUME)[moving])


def test_its_tangent_is_that_of_the_whole():
    found = patch()
    here = np.sort(RANDOM.choice(found.n_points, 9, replace=False))
    parts = RANDOM.random(9)
    moduli = np.repeat(E[None], POINTS.n_points, axis=0)
    moduli[found.points[here]] *= (1.0 - parts)[:, None, None]
    mine = DOFS[found.unknowns]
    elastic = dense(np.repeat(E[None], POINTS.n_points, axis=0))[np.ix_(mine, mine)]
    coupled = np.nonzero(np.tril(dense(np.ones((POINTS.n_points, 4, 4)))[np.ix_(mine, mine)]))
    lower = sp.coo_array((elastic[coupled], coupled), shape=elastic.shape)  # with its zeros
    tangents = PatchTangents(found, sp.csc_array(lower))
    change = -parts[:, None, None] * E * VOLUME[found.points[here]][:, None, None]
    rhs = RANDOM.normal(size=(mine.size, 2))
    for some, expected in (
        (slice(0), elastic),
        (slice(None), dense(moduli)[np.ix_(mine, mine)]),
    ):
        solved = tangents.factorize(here[some], change[some], symmetric=True).solve(rhs)
        assert expected @ solved == pytest.approx(rhs, abs=1e-9)
