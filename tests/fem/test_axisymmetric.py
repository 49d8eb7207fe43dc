"""Bodies of revolution: strains, quadrature, loads, and the order of convergence."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import scipy.sparse as sp
import scipy.sparse.linalg as spla
from support.anisotropy import moduli
from support.meshes import KINDS_2D, box
from support.tractions import uniform_tractions

from geoident.fem.elasticity import isotropic
from geoident.fem.elements import reference_element
from geoident.fem.faces import face_table, patches
from geoident.fem.kinematics import (
    AXISYMMETRIC,
    PLANE_STRAIN,
    Kinematics,
    block_geometry,
    strain_points,
)
from geoident.fem.loads import facet_geometry, pressure_forces, stress_forces, weight_shares
from geoident.fem.mechanism import loose_body
from geoident.fem.stiffness import group_blocks, stiffness_pattern

ELASTICITY = moduli(isotropic, {"E": 3.0, "nu": 0.3})
E = ELASTICITY[:4, :4]
ON_AXIS, OFF_AXIS = 0.0, 0.7
both = pytest.mark.parametrize("inner", [ON_AXIS, OFF_AXIS])
kinds = pytest.mark.parametrize("kind", KINDS_2D)


def ring(kind, inner, n=3, distortion=0.2):
    """The section of a ring of 1 m by 1 m, inner radius ``inner``."""
    mesh = box(kind, (n, n), distortion=distortion)
    return replace(mesh, points=mesh.points + np.array([inner, 0.0]))


def points_of(mesh, kinematics=AXISYMMETRIC):
    geometries = tuple(block_geometry(mesh.points, b, kinematics) for b in mesh.blocks)
    return strain_points(mesh, geometries, kinematics), geometries


def outer_patches(mesh):
    table = face_table(mesh)
    return patches(mesh, table, table.free(np.ones(mesh.n_elements, bool)))


def stiffness(mesh, elasticity=E):
    """K = C^T diag(V E) C by the definition."""
    points, _ = points_of(mesh)
    weights = sp.kron(elasticity, sp.diags_array(points.volume))
    C = points.compatibility()
    return (C.T @ weights @ C).tocsc()


def admissible(mesh, a=0.3, b=-0.7, c=0.2):
    """u_r = a r, u_z = b z + c: the displacements whose strain and stress are constant."""
    return np.stack([a * mesh.points[:, 0], b * mesh.points[:, 1] + c], axis=1).ravel()


@kinds
@both
def test_strains_are_those_of_a_body_of_revolution(kind, inner):
    mesh = ring(kind, inner)
    points, _ = points_of(mesh)
    a, b, slope = 0.3, -0.7, 0.4
    u = admissible(mesh, a, b).reshape(-1, 2)
    u[:, 1] += slope * mesh.points[:, 0]
    expected = np.outer([a, b, a, slope], np.ones(points.n_points))
    np.testing.assert_allclose(points.strain(u.ravel()), expected, atol=1e-12)
    # The hoop strain is u_r / r whatever the motion: here a shift by 1 m.
    shift = np.tile([1.0, 0.0], mesh.n_nodes)
    np.testing.assert_allclose(points.strain(shift)[2], 1 / points.position[:, 0], rtol=1e-12)


@kinds
@both
def test_only_a_shift_along_the_axis_makes_no_strain(kind, inner):
    mesh = ring(kind, inner)
    K = stiffness(mesh).toarray()
    free = np.ones(len(K), bool)
    free[::2] = ~AXISYMMETRIC.on_axis(mesh.points)
    eigenvalues = np.linalg.eigvalsh(K[np.ix_(free, free)])
    assert abs(eigenvalues[0]) < 1e-12 * eigenvalues[-1] < eigenvalues[1]
    np.testing.assert_allclose(K @ np.tile([0.0, 1.0], mesh.n_nodes), 0.0, atol=1e-12)


@kinds
def test_one_element_off_the_axis_can_only_shift_too(kind):
    """One point would leave the linear triangle a turn about its centre: hence three."""
    mesh = ring(kind, OFF_AXIS, n=1, distortion=0.0)
    lone = replace(mesh.blocks[0], nodes=mesh.blocks[0].nodes[:1])
    used = np.unique(lone.nodes)
    dofs = np.stack([2 * used, 2 * used + 1], axis=1).ravel()
    eigenvalues = np.linalg.eigvalsh(
        stiffness(replace(mesh, blocks=(lone,)))[dofs][:, dofs].toarray()
    )
    assert np.count_nonzero(eigenvalues < 1e-10 * eigenvalues[-1]) == 1


@kinds
@both
def test_patch_test_tractions_of_a_constant_stress_give_its_displacement(kind, inner):
    mesh = ring(kind, inner)
    exact = admissible(mesh)
    stress = E @ points_of(mesh)[0].strain(exact)[:, 0]
    forces = sum(uniform_tractions(mesh, p, AXISYMMETRIC, stress) for p in outer_patches(mesh))
    K = stiffness(mesh)
    np.testing.assert_allclose(K @ exact, forces, atol=1e-12)
    held = np.union1d(2 * np.flatnonzero(AXISYMMETRIC.on_axis(mesh.points)), [1])
    free = np.setdiff1d(np.arange(len(exact)), held)
    u = exact.copy()
    u[free] = spla.spsolve(K[free][:, free], (forces - K[:, held] @ exact[held])[free])
    np.testing.assert_allclose(u, exact, atol=1e-12)


@kinds
@both
def test_assembled_stiffness_equals_its_definition_for_any_symmetry(kind, inner):
    mesh = ring(kind, inner)
    root = np.random.default_rng(8).normal(size=(4, 4))
    moduli = root @ root.T
    _, geometries = points_of(mesh)
    rank = np.random.default_rng(9).permutation(mesh.n_nodes)
    order = np.argsort(rank)
    half = mesh.n_elements // 2
    groups = {
        g: group_blocks(mesh, geometries, e, rank)
        for g, e in enumerate(np.split(np.arange(mesh.n_elements), [half]))
    }
    fixed = np.repeat(AXISYMMETRIC.on_axis(mesh.points), 2)
    pattern = stiffness_pattern(groups, node_of_rank=order, fixed=fixed, dim=2)
    values = pattern.values(groups, dict.fromkeys(groups, AXISYMMETRIC.stiffness_map(moduli)))
    n = pattern.lower.n
    lower = sp.csc_array((values, pattern.lower.indices, pattern.lower.indptr), shape=(n, n))
    expected = np.tril(stiffness(mesh, moduli)[pattern.dofs][:, pattern.dofs].toarray())
    np.testing.assert_allclose(lower.toarray(), expected, atol=1e-11)


def fine_rule(kind, n=24):
    """Gauss points folded onto triangles (Duffy), so fine that rational terms are right too."""
    x, w = np.polynomial.legendre.leggauss(n)
    grid = np.stack(np.meshgrid(x, x, indexing="ij"), -1).reshape(-1, 2)
    weight = np.outer(w, w).ravel()
    if kind.startswith("quad"):
        return grid, weight
    t = (grid + 1) / 2
    return np.stack([t[:, 0], t[:, 1] * (1 - t[:, 0])], 1), weight / 4 * (1 - t[:, 0])


class Finely(Kinematics):
    """With a rule so fine that it is exact."""

    def quadrature(self, kind):
        return fine_rule(kind)


FINELY = Finely(AXISYMMETRIC.dim, AXISYMMETRIC.strains, AXISYMMETRIC.rigid, revolved=True)


def gradient_products(mesh, kinematics):
    """Integrals (n_el, n_a, 3, n_a, 3) of the products of gradient vectors."""
    g = block_geometry(mesh.points, mesh.blocks[0], kinematics)
    return np.einsum("eq,eqaj,eqbl->eajbl", g.volumes, g.gradients, g.gradients)


@kinds
def test_quadrature_is_exact_where_the_integrand_is_a_polynomial(kind):
    """All gradient and coupling terms; the hoop terms of elements with an edge on the axis."""
    for inner in (ON_AXIS, OFF_AXIS):
        mesh = ring(kind, inner, n=2, distortion=0.0)
        error = gradient_products(mesh, AXISYMMETRIC) - gradient_products(mesh, FINELY)
        hoop = error[:, :, 2, :, 2].copy()
        error[:, :, 2, :, 2] = 0.0
        np.testing.assert_allclose(error, 0.0, atol=1e-13)
        nodes = mesh.blocks[0].nodes
        axis = AXISYMMETRIC.on_axis(mesh.points)[nodes]
        moving = ~axis
        hoop *= moving[:, :, None] & moving[:, None, :]
        with_edge = axis.sum(axis=1) == reference_element(kind).cell.order + 1
        assert with_edge.any() is np.bool_(inner == ON_AXIS)
        np.testing.assert_allclose(hoop[with_edge], 0.0, atol=1e-13)


@kinds
def test_weight_and_pressure_resultants_are_those_of_the_whole_ring(kind):
    mesh = ring(kind, OFF_AXIS)
    volume = np.pi * ((OFF_AXIS + 1) ** 2 - OFF_AXIS**2)
    _, geometries = points_of(mesh)
    shares = weight_shares(mesh, geometries, np.arange(mesh.n_elements))
    assert shares.sum() == pytest.approx(volume, rel=1e-12)
    centroid = shares @ mesh.points / shares.sum()
    thirds = (OFF_AXIS + 1) ** 3 - OFF_AXIS**3
    assert centroid[0] == pytest.approx(2 * np.pi * thirds / 3 / volume, rel=1e-12)
    outer = outer_patches(mesh)
    total = sum(pressure_forces(mesh, p, AXISYMMETRIC) for p in outer).reshape(-1, 2).sum(axis=0)
    assert total[1] == pytest.approx(0.0, abs=1e-12)
    # Divergence theorem in space: the flux of (r, z) is three times the volume.
    facets = [facet_geometry(mesh.points, p, AXISYMMETRIC) for p in outer]
    flux = sum(np.sum(g.positions * g.normals) for g in facets)
    assert flux == pytest.approx(3 * volume, rel=1e-12)


@kinds
def test_a_linear_stress_in_balance_with_weight_leaves_no_rest(kind):
    """Heim's stress: zz = -z, rr = tt = -K0 z, with its weight, on straight-sided elements."""
    mesh = ring(kind, ON_AXIS)
    points, geometries = points_of(mesh)

    def stress(x):
        s = x[:, 1] - 2.0
        return np.stack([0.6 * s, s, 0.6 * s, 0.0 * s])

    internal = points.forces(stress(points.position), points.volume).reshape(-1, 2)
    rest = -internal
    rest[:, 1] -= weight_shares(mesh, geometries, np.arange(mesh.n_elements))
    for patch in outer_patches(mesh):
        geometry = facet_geometry(mesh.points, patch, AXISYMMETRIC)
        sigma = stress(geometry.positions.reshape(-1, 2))
        rest += stress_forces(mesh, patch, geometry, sigma).reshape(-1, 2)
    rest[AXISYMMETRIC.on_axis(mesh.points), 0] = 0.0
    np.testing.assert_allclose(rest, 0.0, atol=1e-13)


def test_mechanism_is_a_shift_along_the_axis_and_nothing_else():
    mesh = ring("quad4", OFF_AXIS)
    table = face_table(mesh)
    present, fixed = np.ones(mesh.n_elements, bool), np.zeros(mesh.points.size, bool)
    body = loose_body(mesh, table, AXISYMMETRIC, present, fixed)
    assert body is not None
    assert body.motion[0] == 0
    assert abs(body.motion[1]) == pytest.approx(1.0)
    fixed[1] = True
    assert loose_body(mesh, table, AXISYMMETRIC, present, fixed) is None
    assert loose_body(mesh, table, PLANE_STRAIN, present, fixed) is not None


# A smooth displacement u_r = a sin(m r) cos(k z), u_z = b cos(m r) sin(k z), and its body force.
A, B, M, K_Z = 0.7, -0.4, 1.1, 1.3


def manufactured(x):
    """Displacement and body force (n, 2) at points (n, 2) off the axis."""
    r, z = x.T
    s, c = np.sin(M * r), np.cos(M * r)
    S, C = np.sin(K_Z * z), np.cos(K_Z * z)
    lam, mu = E[0, 1], E[3, 3]
    q = A * K_Z + B * M
    curl = A * (M * c / r - s / r**2)
    by_r = lam * (-A * M**2 * s + curl - B * K_Z * M * s)
    by_r += mu * (-2 * A * M**2 * s + 2 * curl - q * K_Z * s)
    by_z = -mu * q * (M * c + s / r) - lam * K_Z * (A * M * c + A * s / r + B * K_Z * c)
    by_z -= 2 * mu * B * K_Z**2 * c
    return np.stack([A * s * C, B * c * S], 1), -np.stack([by_r * C, by_z * S], 1)


def l2_error(kind, n):
    mesh = ring(kind, ON_AXIS, n=n, distortion=0.1)
    element, block = reference_element(kind), mesh.blocks[0]
    xi, w = fine_rule(kind, 5)
    corners = mesh.points[block.nodes]
    jacobian = np.einsum("eai,qaj->eqij", corners, element.gradients(xi))
    shapes = element.shapes(xi)
    positions = np.einsum("qa,eai->eqi", shapes, corners)
    weight = np.linalg.det(jacobian) * w * 2 * np.pi * positions[..., 0]
    exact, force = (f.reshape(positions.shape) for f in manufactured(positions.reshape(-1, 2)))
    F = np.zeros(mesh.points.shape)
    np.add.at(F, block.nodes, np.einsum("qa,eq,eqi->eai", shapes, weight, force))
    at = np.maximum(mesh.points, [1e-30, 0.0])
    u = manufactured(at)[0].ravel()
    border = np.any((mesh.points[:, 1:] < 1e-9) | (mesh.points > 1 - 1e-9), axis=1)
    held = np.repeat(border, 2)
    held[::2] |= AXISYMMETRIC.on_axis(mesh.points)
    free, held = np.flatnonzero(~held), np.flatnonzero(held)
    K = stiffness(mesh)
    u[free] = spla.spsolve(K[free][:, free], F.ravel()[free] - K[free][:, held] @ u[held])
    computed = np.einsum("qa,eai->eqi", shapes, u.reshape(-1, 2)[block.nodes])
    return np.sqrt(np.sum(weight[..., None] * (computed - exact) ** 2))


@kinds
def test_displacement_converges_with_order_p_plus_one_up_to_the_axis(kind):
    slope = np.log2(l2_error(kind, 6) / l2_error(kind, 12))
    assert slope > reference_element(kind).cell.order + 1 - 0.25
