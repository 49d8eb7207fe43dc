"""Reference elements, compatibility and stiffness: invariants, exact solutions, convergence."""

from __future__ import annotations

import numpy as np
import pytest
import scipy.sparse as sp
import scipy.sparse.linalg as spla
from support.anisotropy import moduli
from support.meshes import KINDS, KINDS_2D, box, mixed_box
from support.tractions import uniform_tractions

from geoident.fem.elasticity import isotropic
from geoident.fem.elements import reference_element
from geoident.fem.faces import face_table, patches
from geoident.fem.kinematics import PLANE_STRAIN, SOLID, block_geometry, strain_points
from geoident.fem.loads import facet_geometry, pressure_forces, weight_shares
from geoident.fem.solvers.ordering import nested_dissection
from geoident.fem.stiffness import group_blocks, node_graph, stiffness_pattern
from geoident.model.cells import CELLS
from geoident.model.mesh import ElementBlock, Mesh

MIXED = {"mixed, order 1": 1, "mixed, order 2": 2}
ELASTICITY = moduli(isotropic, {"E": 3.0, "nu": 0.3})


def dim_of(kind):
    return 2 if kind in KINDS_2D else 3


def kinematics_of(mesh):
    return PLANE_STRAIN if mesh.dim == 2 else SOLID


def distorted(kind, n=3):
    if kind in MIXED:
        return mixed_box(MIXED[kind], distortion=0.2)
    return box(kind, (n,) * dim_of(kind), distortion=0.2)


def points_of(mesh):
    kinematics = kinematics_of(mesh)
    geometries = tuple(block_geometry(mesh.points, b, kinematics) for b in mesh.blocks)
    return strain_points(mesh, geometries, kinematics), geometries


def elasticity_of(mesh):
    n = kinematics_of(mesh).n_strain
    return ELASTICITY[:n, :n]


def direct_stiffness(mesh):
    """K = C^T diag(V E) C by the definition."""
    points, _ = points_of(mesh)
    weights = sp.kron(elasticity_of(mesh), sp.diags_array(points.volume))
    C = points.compatibility()
    return (C.T @ weights @ C).tocsr()


@pytest.mark.parametrize("kind", [*KINDS, "line2", "line3"])
def test_shape_functions_are_one_at_their_node_and_sum_to_one(kind):
    element = reference_element(kind)
    np.testing.assert_allclose(element.shapes(element.nodes), np.eye(element.n_nodes), atol=1e-14)
    inside = np.random.default_rng(1).uniform(0, 0.3, (5, element.dim))
    np.testing.assert_allclose(element.shapes(inside).sum(axis=1), 1.0, atol=1e-14)
    np.testing.assert_allclose(element.gradients(inside).sum(axis=1), 0.0, atol=1e-13)


@pytest.mark.parametrize("kind", KINDS)
def test_gradients_are_derivatives_of_the_shape_functions(kind):
    element = reference_element(kind)
    xi = np.random.default_rng(2).uniform(0.05, 0.3, (4, element.dim))
    for axis in range(element.dim):
        h = 1e-6 * np.eye(element.dim)[axis]
        numeric = (element.shapes(xi + h) - element.shapes(xi - h)) / 2e-6
        np.testing.assert_allclose(element.gradients(xi)[..., axis], numeric, atol=1e-8)


@pytest.mark.parametrize("kind", [*KINDS, *MIXED])
def test_constant_strain_is_reproduced_on_distorted_elements(kind):
    mesh = distorted(kind)
    points, _ = points_of(mesh)
    gradient = np.random.default_rng(3).normal(size=(mesh.dim, mesh.dim))
    strain = points.strain((mesh.points @ gradient.T).ravel())
    full = np.zeros((3, 3))
    full[: mesh.dim, : mesh.dim] = gradient
    engineering = full + full.T
    expected = [
        full[0, 0],
        full[1, 1],
        full[2, 2],
        engineering[0, 1],
        engineering[1, 2],
        engineering[0, 2],
    ]
    np.testing.assert_allclose(
        strain, np.outer(expected[: points.n_strain], np.ones(points.n_points)), atol=1e-12
    )


@pytest.mark.parametrize("kind", [*KINDS, *MIXED])
def test_patch_test_tractions_of_a_constant_stress_give_its_linear_displacement(kind):
    mesh = distorted(kind)
    E, (points, _) = elasticity_of(mesh), points_of(mesh)
    gradient = np.random.default_rng(5).normal(size=(mesh.dim, mesh.dim))
    exact = (mesh.points @ gradient.T).ravel()
    stress = E @ points.strain(exact)[:, 0]
    table = face_table(mesh)
    outer = patches(mesh, table, table.free(np.ones(mesh.n_elements, bool)))
    forces = sum(uniform_tractions(mesh, p, kinematics_of(mesh), stress) for p in outer)
    held = [*range(mesh.dim), *[mesh.dim * n + a for n, a in _three_more(mesh)]]
    free = np.setdiff1d(np.arange(len(exact)), held)
    K = direct_stiffness(mesh).tocsc()
    u = exact.copy()
    u[free] = spla.spsolve(K[free][:, free], (forces - K[:, held] @ exact[held])[free])
    np.testing.assert_allclose(u, exact, atol=1e-10)


def _three_more(mesh):
    """Degrees of freedom that, with the first node, stop all rigid motion."""

    def at(*x):
        return int(np.linalg.norm(mesh.points - np.array(x), axis=1).argmin())

    if mesh.dim == 2:
        return [(at(1, 0), 1)]
    return [(at(1, 0, 0), 1), (at(1, 0, 0), 2), (at(0, 1, 0), 2)]


@pytest.mark.parametrize("kind", [*KINDS, *MIXED])
def test_assembled_stiffness_equals_its_definition(kind):
    mesh = distorted(kind)
    _, geometries = points_of(mesh)
    order = nested_dissection(mesh.points, *node_graph(mesh))
    rank = np.empty_like(order)
    rank[order] = np.arange(len(order))
    half = mesh.n_elements // 2
    groups = {
        g: group_blocks(mesh, geometries, e, rank)
        for g, e in enumerate(np.split(np.arange(mesh.n_elements), [half]))
    }
    fixed = np.zeros(mesh.points.size, bool)
    fixed[[0, 5, 7]] = True
    pattern = stiffness_pattern(groups, node_of_rank=order, fixed=fixed, dim=mesh.dim)
    T = kinematics_of(mesh).stiffness_map(elasticity_of(mesh))
    values = pattern.values(groups, {0: T, 1: T})
    n = pattern.lower.n
    lower = sp.csc_array((values, pattern.lower.indices, pattern.lower.indptr), shape=(n, n))
    expected = sp.tril(direct_stiffness(mesh)[pattern.dofs][:, pattern.dofs]).toarray()
    np.testing.assert_allclose(lower.toarray(), expected, atol=1e-12)
    assert np.all(pattern.lower.indices[pattern.lower.indptr[:-1]] == np.arange(n))


@pytest.mark.parametrize("kind", [*KINDS, *MIXED])
@pytest.mark.parametrize("columns", [(), (1,), (3,), (0,), (2, 2)])
def test_strains_and_forces_are_products_with_compatibility(kind, columns):
    mesh = distorted(kind)
    points, _ = points_of(mesh)
    C, random = points.compatibility(), np.random.default_rng(3)
    u = random.normal(size=(mesh.points.size, *columns))
    stress = random.normal(size=(points.n_strain, points.n_points, *columns))
    volume = np.where(random.random(points.n_points) < 0.3, 0.0, points.volume)
    n = int(np.prod(columns, dtype=int))
    strain = (C @ u.reshape(len(u), n)).reshape(stress.shape)
    weights = sp.diags_array(np.tile(volume, points.n_strain))
    forces = (C.T @ weights @ stress.reshape(C.shape[0], n)).reshape(u.shape)
    np.testing.assert_allclose(points.strain(u), strain, atol=1e-12)
    np.testing.assert_allclose(points.forces(stress, volume), forces, atol=1e-12)


@pytest.mark.parametrize("kind", [*KINDS, *MIXED])
def test_weight_and_pressure_resultants(kind):
    mesh = distorted(kind)
    _, geometries = points_of(mesh)
    shares = weight_shares(mesh, geometries, np.arange(mesh.n_elements))
    assert shares.sum() == pytest.approx(1.0, abs=1e-12)
    np.testing.assert_allclose(shares @ mesh.points, 0.5, atol=0.05)
    table = face_table(mesh)
    outer = patches(mesh, table, table.free(np.ones(mesh.n_elements, bool)))
    total = sum(pressure_forces(mesh, p, kinematics_of(mesh)) for p in outer).reshape(-1, mesh.dim)
    np.testing.assert_allclose(total.sum(axis=0), 0.0, atol=1e-13)
    # Divergence theorem: the integral of x . n over the surface is dim times the volume.
    facets = [facet_geometry(mesh.points, p, kinematics_of(mesh)) for p in outer]
    flux = sum(np.sum(g.positions * g.normals) for g in facets)
    assert flux == pytest.approx(mesh.dim, abs=1e-12)


def _manufactured(x):
    """A smooth displacement, its strains (n_strain, n) and the body force that it needs."""
    dim = x.shape[1]
    k = np.array([1.3, 0.9, 1.1])[:dim]
    phase = x @ k
    a = np.array([0.7, -0.4, 0.5])[:dim]
    u = np.outer(np.sin(phase), a)
    # div sigma = -(lambda + mu) k (a.k) sin - mu a (k.k) sin; the body force balances it.
    lam, mu = ELASTICITY[0, 1], ELASTICITY[3, 3]
    force = np.outer(np.sin(phase), (lam + mu) * k * (a @ k) + mu * a * (k @ k))
    return u, force


def _l2_error(kind, n):
    mesh = box(kind, (n,) * dim_of(kind), distortion=0.1)
    K = direct_stiffness(mesh).tocsc()
    element = reference_element(kind)
    xi, w = _fine_rule(kind)
    block = mesh.blocks[0]
    corners = mesh.points[block.nodes]
    jacobian = np.einsum("eai,qaj->eqij", corners, element.gradients(xi))
    weight = np.linalg.det(jacobian) * w
    shapes = element.shapes(xi)
    positions = np.einsum("qa,eai->eqi", shapes, corners)
    exact, force = (
        f.reshape(positions.shape) for f in _manufactured(positions.reshape(-1, mesh.dim))
    )
    F = np.zeros(mesh.points.shape)
    np.add.at(F, block.nodes, np.einsum("qa,eq,eqi->eai", shapes, weight, force))
    u = _manufactured(mesh.points)[0].ravel()
    border = np.any((mesh.points < 1e-9) | (mesh.points > 1 - 1e-9), axis=1)
    free = np.flatnonzero(~np.repeat(border, mesh.dim))
    held = np.flatnonzero(np.repeat(border, mesh.dim))
    u[free] = spla.spsolve(K[free][:, free], F.ravel()[free] - K[free][:, held] @ u[held])
    computed = np.einsum("qa,eai->eqi", shapes, u.reshape(-1, mesh.dim)[block.nodes])
    return np.sqrt(np.sum(weight[..., None] * (computed - exact) ** 2))


def _fine_rule(kind):
    """Five Gauss points an axis, folded onto what is no square or cube (Duffy)."""
    dim = dim_of(kind)
    x, w = np.polynomial.legendre.leggauss(5)
    grid = np.stack(np.meshgrid(*[x] * dim, indexing="ij"), -1).reshape(-1, dim)
    weight = np.prod(np.stack(np.meshgrid(*[w] * dim, indexing="ij"), -1).reshape(-1, dim), axis=1)
    if kind.startswith(("quad", "hex")):
        return grid, weight
    t = (grid + 1) / 2
    weight = weight / 2**dim
    if dim == 2:
        return np.stack([t[:, 0], t[:, 1] * (1 - t[:, 0])], 1), weight * (1 - t[:, 0])
    a, b, c = t.T
    if kind.startswith("wedge"):
        return np.stack([a, b * (1 - a), grid[:, 2]], 1), 2 * weight * (1 - a)
    if kind.startswith("pyramid"):
        return np.column_stack([grid[:, :2] * (1 - t[:, 2:]), c]), 4 * weight * (1 - c) ** 2
    xi = np.stack([a, b * (1 - a), c * (1 - a) * (1 - b)], 1)
    return xi, weight * (1 - a) ** 2 * (1 - b)


@pytest.mark.parametrize(
    "kind",
    [
        kind
        if kind in ("tri3", "tri6", "quad8", "tet10", "hex8")
        else pytest.param(kind, marks=pytest.mark.slow)
        for kind in KINDS
    ],
)
def test_displacement_converges_with_order_p_plus_one(kind):
    """Of the other kinds slow: that each has all polynomials and passes patch tests is quick."""
    order = CELLS[kind].order
    coarse, fine = (4, 8) if dim_of(kind) == 2 else (3, 6) if order == 1 else (2, 4)
    slope = np.log2(_l2_error(kind, coarse) / _l2_error(kind, fine))
    assert slope > order + 1 - 0.25


@pytest.mark.parametrize("kind", KINDS)
def test_polynomials_of_the_order_are_reproduced_exactly(kind):
    """Also with their gradients, and also by the rational functions of pyramids."""
    element = reference_element(kind)
    random = np.random.default_rng(9)
    xi = random.dirichlet(np.ones(CELLS[kind].n_corners), 20) @ np.array(CELLS[kind].shape.corners)
    exponents = [e for e in np.ndindex(*(3,) * element.dim) if sum(e) <= CELLS[kind].order]
    for e in exponents:
        values = np.prod(element.nodes**e, axis=1)
        np.testing.assert_allclose(element.shapes(xi) @ values, np.prod(xi**e, axis=1), atol=1e-13)
        for axis in range(element.dim):
            lower = np.array(e) - np.eye(element.dim, dtype=int)[axis]
            slope = e[axis] * np.prod(xi ** np.maximum(lower, 0), axis=1)
            found = element.gradients(xi)[..., axis] @ values
            np.testing.assert_allclose(found, slope, atol=1e-12)


@pytest.mark.parametrize("kind", KINDS)
def test_quadrature_is_exact_for_the_stiffness_of_affine_elements(kind):
    element = reference_element(kind)
    slant = np.random.default_rng(10).normal(size=(element.dim, element.dim))
    nodes = element.nodes @ (slant + 3 * np.eye(element.dim))

    def products(xi, weights):
        local = element.gradients(xi)
        jacobian = np.einsum("ai,qaj->qij", nodes, local)
        gradients = np.einsum("qaj,qji->qai", local, np.linalg.inv(jacobian))
        volumes = weights * np.linalg.det(jacobian)
        return np.einsum("q,qai,qbj->aibj", volumes, gradients, gradients)

    exact = products(*_fine_rule(kind))
    np.testing.assert_allclose(
        products(element.points, element.weights), exact, atol=1e-12 * np.abs(exact).max()
    )


@pytest.mark.parametrize("kind", KINDS)
def test_the_stiffness_of_one_element_has_only_rigid_motions_without_energy(kind):
    element = reference_element(kind)
    mesh = Mesh(element.nodes, (ElementBlock(kind, np.arange(element.n_nodes)[None], np.ones(1)),))
    eigenvalues = np.linalg.eigvalsh(direct_stiffness(mesh).toarray())
    rigid = 3 if mesh.dim == 2 else 6
    assert np.all(np.abs(eigenvalues[:rigid]) < 1e-12 * eigenvalues[-1])
    assert eigenvalues[rigid] > 1e-3 * eigenvalues[-1]


@pytest.mark.parametrize("kind", ["pyramid5", "pyramid13", "wedge6", "wedge15"])
def test_shape_functions_on_a_face_are_those_of_the_face(kind):
    """So neighbours of other kinds meet without gaps."""
    cell, element = CELLS[kind], reference_element(kind)
    for face, face_kind in zip(cell.faces, cell.face_kinds, strict=True):
        flat = reference_element(face_kind)
        st = np.random.default_rng(11).uniform(0.05, 0.45, (5, 2))
        xi = flat.shapes(st) @ element.nodes[list(face)]
        others = np.setdiff1d(np.arange(cell.n_nodes), face)
        np.testing.assert_allclose(element.shapes(xi)[:, face], flat.shapes(st), atol=1e-13)
        np.testing.assert_allclose(element.shapes(xi)[:, others], 0.0, atol=1e-13)
