"""Beams and bars alone: rigid motions, and closed forms of straight beams and rings."""

from __future__ import annotations

import numpy as np
import pytest
import scipy.sparse as sp
import scipy.sparse.linalg as spla

from geoident.fem.structures import beams
from geoident.model.mesh import Mesh

EA, EI = 3e9, 2e7


def _line(n, length=5.0, angle=0.3):
    s = np.linspace(0, length, n + 1)
    points = np.outer(s, [np.cos(angle), np.sin(angle)])
    return Mesh(points, ()), np.stack([np.arange(n), np.arange(1, n + 1)], axis=1)


def _ring(n, radius):
    angle = 2 * np.pi * np.arange(n) / n
    points = radius * np.stack([np.cos(angle), np.sin(angle)], axis=1)
    return Mesh(points, ()), np.stack([np.arange(n), (np.arange(n) + 1) % n], axis=1)


def _moduli(members):
    return np.where(members.rigidity == 1, EI, EA)


def _solve(members, forces, fixed):
    stiffness = members.operator.T @ sp.diags_array(members.weight * _moduli(members))
    stiffness = (stiffness @ members.operator).tocsc()
    free = np.setdiff1d(np.arange(len(forces)), fixed)
    u = np.zeros(len(forces))
    u[free] = spla.spsolve(stiffness[free][:, free], forces[free])
    return u, (_moduli(members) * (members.operator @ u)).reshape(3, -1)


def _clamped(mesh, *nodes):
    return np.isin(np.arange(mesh.n_nodes), nodes)


@pytest.mark.parametrize("n", [1, 2, 7])
def test_cantilever_under_a_force_at_its_tip(n, verification):
    mesh, edges = _line(n)
    across = np.array([-np.sin(0.3), np.cos(0.3)])
    forces = np.zeros(mesh.points.size)
    forces[-2:] = 1e4 * across
    members = beams(mesh, edges, _clamped(mesh, 0))
    u, (axial, middle, shear) = _solve(members, forces, [0, 1])
    assert u[-2:] @ across == pytest.approx(1e4 * 5**3 / (3 * EI), rel=1e-10)
    assert np.abs(axial).max() < 1e-5
    # M = EI w'' = P (L - s): it falls from P L at the clamp to zero at the tip.
    s = (np.arange(n) + 0.5) * 5 / n
    np.testing.assert_allclose(middle, 1e4 * (5 - s), rtol=1e-8)
    verification("cantilever", f"{n} elements", s, exact=1e4 * (5 - s), found=middle)
    np.testing.assert_allclose(shear, -1e4, rtol=1e-8)


def test_beam_clamped_at_both_ends():
    mesh, edges = _line(8)
    across = np.array([-np.sin(0.3), np.cos(0.3)])
    forces = np.zeros(mesh.points.size)
    forces[8:10] = 1e4 * across
    members = beams(mesh, edges, _clamped(mesh, 0, 8))
    u, (_, middle, shear) = _solve(members, forces, [0, 1, 16, 17])
    assert u[8:10] @ across == pytest.approx(1e4 * 5**3 / (192 * EI), rel=1e-9)
    assert middle[0] - shear[0] * 5 / 16 == pytest.approx(1e4 * 5 / 8, rel=1e-8)


def test_beam_on_two_hinges():
    mesh, edges = _line(8)
    across = np.array([-np.sin(0.3), np.cos(0.3)])
    forces = np.zeros(mesh.points.size)
    forces[8:10] = 1e4 * across
    u, _ = _solve(beams(mesh, edges, _clamped(mesh)), forces, [0, 1, 16, 17])
    assert u[8:10] @ across == pytest.approx(1e4 * 5**3 / (48 * EI), rel=1e-9)


def _on_ring(n, radius, pressure):
    mesh, edges = _ring(n, radius)
    angle = np.arctan2(*mesh.points.T[::-1])
    normal = mesh.points / radius
    forces = normal * (pressure(angle) * 2 * np.pi * radius / n)[:, None]
    members = beams(mesh, edges, _clamped(mesh))
    u, forces = _solve(members, forces.ravel(), [1, n // 2, n + 1])
    return mesh, np.sum(u.reshape(-1, 2) * normal, axis=1), forces


def test_ring_under_uniform_pressure():
    """N = -p R, w = -p R^2 / EA, no bending."""
    n, radius = 64, 3.0
    _, w, (axial, middle, _) = _on_ring(n, radius, lambda a: -1e5 + 0 * a)
    np.testing.assert_allclose(axial, -1e5 * radius, rtol=1e-3)
    np.testing.assert_allclose(w - w.mean(), 0, atol=1e-9)
    assert w.mean() == pytest.approx(-1e5 * radius**2 / EA, rel=2e-3)
    assert np.abs(middle).max() < 1e-3 * 1e5 * radius**2


def test_ring_under_ovalising_pressure_converges(verification):
    """p cos 2a: w = p R^4 / (9 EI) cos 2a, |M| = p R^2 / 3, |N| = p R / 3 (Timoshenko, rings)."""
    radius, errors = 3.0, []
    for n in (32, 64):
        _, w, (axial, middle, _) = _on_ring(n, radius, lambda a: 1e4 * np.cos(2 * a))
        sway = 1e4 * radius**2 / 9 * (radius**2 / EI + 1 / EA)  # the ring also stretches
        out_of_round = (w.max() - w.min()) / 2
        errors.append(abs(out_of_round / sway - 1))
        verification("ring", f"{n} elements", ["out of round"], exact=sway, found=out_of_round)
        assert np.abs(middle).max() == pytest.approx(1e4 * radius**2 / 3, rel=1.2 / n)
        assert np.abs(axial).max() == pytest.approx(1e4 * radius / 3, rel=1.2 / n)
    assert errors[1] < 0.3 * errors[0] < 0.01
