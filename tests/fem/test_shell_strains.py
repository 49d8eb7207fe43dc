"""Strains of shells in space: rigid motions, patches of constant strain, a cylinder that widens."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from geoident.fem.shells import corners_of, rotation_nodes, shell_members
from geoident.model.mesh import with_rotations
from tests.support.meshes import box
from tests.support.shelled import tunnel_slice

KINDS = ["hex8", "hex20", "tet4", "tet10"]
AXIS = np.array([1.0, 0.3, 0.2])


def _members(mesh, group, *, turned=None, axis=AXIS):
    faces = mesh.facet_groups[group]
    nodes = np.unique(np.concatenate([b.nodes.ravel() for b in mesh.facets]))
    mesh = with_rotations(mesh, nodes)
    back = np.zeros(len(faces), dtype=bool) if turned is None else turned
    sides = back, np.ones(len(faces), dtype=bool)
    return mesh, shell_members(mesh, faces, corners_of(mesh, faces), sides, axis)


def _motion(mesh, u, theta):
    """Displacements and rotations (n_dofs,) by functions of the places (n, 3)."""
    own = mesh.rotations_of
    values = np.zeros((mesh.n_nodes, 3))
    n = mesh.n_nodes - len(own)
    values[:n] = u(mesh.points[:n])
    values[rotation_nodes(mesh, own)] = theta(mesh.points[own])
    return values.ravel()


def _plate(kind):
    """The upper face of a skewed block, with straight edges."""
    mesh = box(kind, (3, 2, 1))
    x, y, z = mesh.points.T
    return replace(mesh, points=np.column_stack([x + 0.3 * y, y - 0.2 * x, z]))


@pytest.mark.parametrize("kind", KINDS)
def test_a_rigid_motion_strains_nothing(kind):
    mesh = box(kind, (3, 2, 1))
    x, y, z = mesh.points.T
    bulged = np.column_stack([x + 0.1 * y**2, y, z + 0.3 * x**2 - 0.2 * x * y])
    mesh, members = _members(replace(mesh, points=bulged), "z1")
    turn = np.array([0.3, -0.7, 0.5])
    moved = _motion(mesh, lambda p: 0.2 + np.cross(turn, p), lambda p: turn)
    assert np.abs(members.operator @ moved).max() < 1e-11


@pytest.mark.parametrize("kind", KINDS)
def test_a_patch_strains_evenly_and_its_faces_may_be_turned(kind):
    """e and k constant in space: n and m have the components in axes 1 and 2, turned or not."""
    slopes, bent = np.array([[1.0, 0.6], [-0.2, 2.0]]), np.array([[0.5, 0.3], [0.3, -0.8]])

    def u(p):
        deflection = 0.5 * np.einsum("ni,ij,nj->n", p[:, :2], bent, p[:, :2])
        return np.column_stack([p[:, :2] @ slopes.T, deflection])

    def theta(p):
        slope = p[:, :2] @ bent
        spin = np.full(len(p), (slopes[1, 0] - slopes[0, 1]) / 2)
        return np.column_stack([slope[:, 1], -slope[:, 0], spin])

    mesh = _plate(kind)
    turned = np.arange(len(mesh.facet_groups["z1"])) % 3 == 1
    mesh, members = _members(mesh, "z1", turned=turned)
    ones = 0.5, 0.5, 0.5, 0.5  # E t = 1, t^2/12 = 1, nu = 0
    forces = np.array(ones)[members.rigidity] * (members.operator @ _motion(mesh, u, theta))
    found = members.face_forces(forces).T
    for face, axes in enumerate(members.face_axes):
        strain, curved = (slopes + slopes.T) / 2, -bent
        side = np.sign(axes[2, 2])
        n, m = (axes[:2, :2] @ each @ axes[:2, :2].T for each in (strain, side * curved))
        exact = [n[0, 0], n[1, 1], n[0, 1], m[0, 0], m[1, 1], m[0, 1]]
        np.testing.assert_allclose(found[face], exact, atol=1e-11)
    assert (members.face_axes[:, 2, 2] > 0).tolist() != [True] * len(turned)
    assert members.node_area.sum() == pytest.approx(members.area.sum(), rel=1e-12)


@pytest.mark.parametrize(
    ("kind", "bends"), [("hex8", 1e-9), ("hex20", 1e-4), ("tet4", 0.25), ("tet10", 2e-3)]
)
def test_a_cylinder_that_only_widens_does_not_bend(kind, bends):
    """By u its hoops strain by u / R; flat triangles that lean would bend by up to u / R^2."""
    R = 3.0
    mesh = tunnel_slice(kind, n=4, layers=1, radius=R, reach=4.0, width=1.8, rows=3)
    mesh, members = _members(mesh, "wall", axis=np.array([0.0, 0.0, 1.0]))

    def u(p):
        return p * [1.0, 1.0, 0.0] / R

    strains = members.operator @ _motion(mesh, u, lambda p: 0.0 * p)
    forces = np.array([0.5] * 4)[members.rigidity] * strains
    found = members.face_forces(forces)
    np.testing.assert_allclose(found[1], 1.0 / R, rtol=0.02)
    x, y, z = members.centres.T
    inner = (abs(z - 0.9) < 0.3) & (np.minimum(x, y) > 0.6)  # at edges faces have no neighbours
    assert np.abs(found[3:, inner]).max() < bends / R**2
