"""Shells of revolution alone: membranes, edge loads and plates in closed form; hinges in beams."""

from __future__ import annotations

import numpy as np
import pytest
import scipy.sparse as sp
import scipy.sparse.linalg as spla

from geoident.fem.structures import area_shares, beams, section_forces, shells
from geoident.model.mesh import Mesh

E, NU, THICK = 2e10, 0.2, 0.1
D = E * THICK / (1 - NU**2)
B = D * THICK**2 / 12
WHOLE_TURN = 2 * np.pi


def _meridian(points):
    points = np.asarray(points, dtype=np.float64)
    n = len(points) - 1
    return Mesh(points, ()), np.stack([np.arange(n), np.arange(1, n + 1)], axis=1)


def _shell(points, clamped=(), hinged=(), nu=NU):
    mesh, edges = _meridian(points)
    nodes = np.arange(mesh.n_nodes)
    return mesh, shells(mesh, edges, np.isin(nodes, clamped), np.isin(nodes, hinged), nu)


def _solve(members, forces, fixed, axial=D, bending=B):
    moduli = np.where(members.rigidity == 1, bending, axial)
    stiffness = members.operator.T @ sp.diags_array(members.weight * moduli)
    stiffness = (stiffness @ members.operator).tocsc()
    free = np.setdiff1d(np.arange(len(forces)), fixed)
    u = np.zeros(len(forces))
    u[free] = spla.spsolve(stiffness[free][:, free], forces[free])
    return u.reshape(-1, 2), section_forces(members, moduli * (members.operator @ u))


def _cylinder(n, radius, height, **more):
    y = np.linspace(0, height, n + 1)
    return _shell(np.stack([np.full(n + 1, radius), y], axis=1), **more)


def test_motion_along_the_axis_strains_nothing():
    mesh, members = _shell([(1.0, 0.0), (2.0, 1.0), (2.5, 3.0)])
    assert np.abs(members.operator @ np.tile([0.0, 1.0], 3)).max() < 1e-14
    assert members.weight[: len(members) * 2].sum() == pytest.approx(
        (1 + NU) / 2 * area_shares(mesh, members).sum(), rel=1e-14
    )


def test_cylinder_under_inner_pressure_is_a_membrane():
    """N_t = p R, u_r = p R^2 / (E t); it shortens by nu p R h / (E t) where its ends are free."""
    radius, height, p = 3.0, 2.0, 4e5
    mesh, members = _cylinder(5, radius, height)
    forces = np.zeros((mesh.n_nodes, 2))
    forces[:, 0] = p * area_shares(mesh, members)
    u, found = _solve(members, forces.ravel(), [1])
    np.testing.assert_allclose(u[:, 0], p * radius**2 / (E * THICK), rtol=1e-12)
    assert u[-1, 1] == pytest.approx(-NU * p * radius / (E * THICK) * height, rel=1e-12)
    np.testing.assert_allclose(found.hoop, p * radius, rtol=1e-12)
    np.testing.assert_allclose(found.stretch / D, -NU * p * radius / (E * THICK), rtol=1e-9)
    np.testing.assert_allclose(found.axial, 0, atol=1e-7 * p)
    np.testing.assert_allclose(found.first, 0, atol=1e-7 * p)


def test_sphere_under_inner_pressure_converges_to_its_membrane():
    """N_s = N_t = p R / 2, u_r = p R^2 (1 - nu) / (2 E t)."""
    radius, p, errors = 4.0, 3e5, []
    for n in (20, 40):
        angle = np.linspace(-np.pi / 2, np.pi / 2, n + 1)
        points = radius * np.stack([np.cos(angle), np.sin(angle)], axis=1)
        points[[0, -1], 0] = 0.0
        mesh, members = _shell(points, clamped=(0, n))
        forces = p * area_shares(mesh, members)[:, None] * points / radius
        u, found = _solve(members, forces.ravel(), [0, 2 * n, 2 * (n // 2) + 1])
        out = np.sum(u * points, axis=1) / radius
        middle = slice(n // 4, 3 * n // 4)
        errors.append(abs(out[n // 2] / (p * radius**2 * (1 - NU) / (2 * E * THICK)) - 1))
        np.testing.assert_allclose(found.hoop[middle], p * radius / 2, rtol=0.02)
        np.testing.assert_allclose(found.axial[middle], p * radius / 2, rtol=0.02)
    assert errors[1] < 0.3 * errors[0] < 0.01


def test_ring_force_at_the_edge_of_a_long_cylinder_decays(verification):
    """w = P e^-bx cos bx / (2 b^3 B), M = P e^-bx sin bx / b (Timoshenko, section 115)."""
    radius, force = 3.0, 1e4
    b = (E * THICK / (4 * radius**2 * B)) ** 0.25
    errors = []
    for n in (60, 120):
        height = 12 / b
        mesh, members = _cylinder(n, radius, height)
        forces = np.zeros((mesh.n_nodes, 2))
        forces[0, 0] = force * WHOLE_TURN * radius
        u, found = _solve(members, forces.ravel(), [2 * n + 1])
        x = np.linspace(0, height, n + 1)
        exact = force / (2 * b**3 * B) * np.exp(-b * x) * np.cos(b * x)
        errors.append(np.abs(u[:, 0] - exact).max() / exact[0])
        moment = force / b * np.exp(-b * x) * np.sin(b * x)
        peak = moment.max()
        np.testing.assert_allclose(np.abs(found.first), np.abs(moment[:-1]), atol=0.03 * peak)
        shear = force * np.exp(-b * x) * (np.cos(b * x) - np.sin(b * x))
        middle = (shear[1:] + shear[:-1]) / 2
        np.testing.assert_allclose(np.abs(found.shear), np.abs(middle), atol=0.05 * force)
        np.testing.assert_allclose(np.abs(found.axial), 0, atol=1e-6 * force)
    assert errors[1] < 0.3 * errors[0] < 0.02
    near = x < 3 / b
    verification("cylinder-edge", "", x[near], exact=exact[near], found=u[near, 0])
    assert peak == pytest.approx(0.3224 * force / b, rel=1e-3)


@pytest.mark.parametrize(("clamped", "factor"), [(True, 1.0), (False, (5 + NU) / (1 + NU))])
def test_round_plate_under_uniform_load(clamped, factor, verification):
    """w(0) = q a^4 / (64 B), of a plate that turns at its edge (5 + nu) / (1 + nu) times that."""
    a, q, errors = 2.0, 1e3, []
    for n in (16, 32):
        points = np.stack([np.linspace(0, a, n + 1), np.zeros(n + 1)], axis=1)
        mesh, members = _shell(points, clamped=(0, n) if clamped else (0,))
        forces = np.zeros((mesh.n_nodes, 2))
        forces[:, 1] = -q * area_shares(mesh, members)
        u, found = _solve(members, forces.ravel(), [0, 2 * n + 1])
        errors.append(abs(-u[0, 1] / (factor * q * a**4 / (64 * B)) - 1))
        variant = f"{'clamped' if clamped else 'turning'} edge, {n} elements"
        exact = factor * q * a**4 / (64 * B)
        verification("round-plate", variant, ["centre"], exact=exact, found=-u[0, 1])
        share = (1 + NU) / 16 if clamped else (3 + NU) / 16
        centre = share / (1 + NU) * q * a**2  # both curvatures are equal there
        assert found.bent_first[1] == pytest.approx(centre, rel=0.03)
        assert found.first[1] == pytest.approx(share * q * a**2, rel=0.03)
        assert found.second[-1] == pytest.approx(
            -q * a**2 / 8 if clamped else 0, rel=0.05, abs=0.02 * q * a**2
        )
    assert errors[1] < 0.3 * errors[0] < 0.01


def test_moment_is_zero_at_a_hinge_of_a_shell_and_of_a_beam():
    n = 20
    mesh, members = _cylinder(n, 3.0, 1.0, clamped=(0,), hinged=(8,))
    forces = np.zeros((mesh.n_nodes, 2))
    forces[-1, 0] = 1e4
    _, found = _solve(members, forces.ravel(), [0, 1])
    largest = np.abs(found.first).max()
    assert abs(found.second[7]) < 1e-9 * largest
    assert abs(found.first[8]) < 1e-9 * largest
    assert abs(found.first[7]) > 1e-3 * largest


def test_beam_of_three_spans_with_hinges_bears_what_statics_say():
    """A Gerber beam: supports at 0, 3, 7, 10; hinges at 4 and 6; a force in its middle at 5.

    The middle piece is a simple beam, M = P l / 4 with l = 2; at its supports M = -P / 2 times 1.
    """
    x = np.linspace(0, 10, 21)
    mesh, edges = _meridian(np.stack([x, np.zeros(21)], axis=1))
    hinged = np.isin(x, [4.0, 6.0])
    members = beams(mesh, edges, np.zeros(21, dtype=bool), hinged)
    forces = np.zeros((21, 2))
    forces[10, 1] = -1e4
    fixed = [0, *(2 * np.flatnonzero(np.isin(x, [0.0, 3.0, 7.0, 10.0])) + 1)]
    _, found = _solve(members, forces.ravel(), fixed, 3e9, 2e7)
    moments = np.append(found.first, found.second[-1])
    expected = np.interp(x, [0, 3, 4, 5, 6, 7, 10], [0, -5e3, 0, 5e3, 0, -5e3, 0])
    np.testing.assert_allclose(moments, expected, atol=1e-5)


def test_hinge_at_a_clamped_node_turns():
    """A beam whose one end is clamped and hinged at once stands on two hinges."""
    x = np.linspace(0, 4, 5)
    mesh, edges = _meridian(np.stack([x, np.zeros(5)], axis=1))
    forces = np.zeros((5, 2))
    forces[2, 1] = 1e4
    members = beams(mesh, edges, x == 0.0, x == 0.0)
    u, found = _solve(members, forces.ravel(), [0, 1, 9], 3e9, 2e7)
    assert found.first[0] == pytest.approx(0.0, abs=1e-5)
    assert u[2, 1] == pytest.approx(1e4 * 4**3 / (48 * 2e7), rel=1e-9)
