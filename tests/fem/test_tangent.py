"""Changes of moduli at single strain points against C^T V change C by its definition."""

from __future__ import annotations

import numpy as np
import pytest
import scipy.sparse as sp
from support.meshes import box, mixed_box

from geoident.fem.kinematics import PLANE_STRAIN, SOLID, block_geometry, strain_points
from geoident.fem.solvers.ordering import nested_dissection
from geoident.fem.stiffness import group_blocks, node_graph, stiffness_pattern
from geoident.fem.tangent import PointBlocks, TangentPattern


def prepared(mesh):
    """Strain points, the pattern of K with some directions fixed, and the tangents on it."""
    kinematics = PLANE_STRAIN if mesh.dim == 2 else SOLID
    geometries = tuple(block_geometry(mesh.points, b, kinematics) for b in mesh.blocks)
    order = nested_dissection(mesh.points, *node_graph(mesh))
    rank = np.argsort(order)
    fixed = np.zeros(mesh.points.size, dtype=bool)
    fixed[[1, 4, 9]] = True
    blocks = {0: group_blocks(mesh, geometries, np.arange(mesh.n_elements), rank)}
    pattern = stiffness_pattern(blocks, node_of_rank=order, fixed=fixed, dim=mesh.dim)
    points = strain_points(mesh, geometries, kinematics)
    return points, pattern, TangentPattern(PointBlocks(mesh, geometries, kinematics), pattern)


@pytest.mark.parametrize("symmetric", [True, False])
@pytest.mark.parametrize(
    "mesh",
    [
        box("tri6", (2, 2), distortion=0.2),
        box("wedge6", (2, 2, 1), distortion=0.2),
        box("pyramid13", (1, 1, 1)),
        mixed_box(1, distortion=0.2),
    ],
    ids=["tri6", "wedge6", "pyramid13", "mixed"],
)
def test_tangent_is_that_of_its_definition(mesh, symmetric):
    points, pattern, tangent = prepared(mesh)
    random = np.random.default_rng(1)
    s = points.n_strain
    for share in (0.1, 0.4, 1.0):  # later calls know some elements from earlier ones
        chosen = np.flatnonzero(random.random(points.n_points) < share)
        change = random.normal(size=(len(chosen), s, s))
        if symmetric:
            change = change + change.transpose(0, 2, 1)
        full = np.zeros((s, points.n_points, s, points.n_points))
        for k, point in enumerate(chosen):
            full[:, point, :, point] = change[k]
        dense = full.reshape(s * points.n_points, -1)
        C = points.compatibility().toarray()[:, pattern.dofs]
        expected = C.T @ dense @ C
        below, above = tangent.added(chosen, change, symmetric=symmetric)
        n = pattern.lower.n
        lower, upper = (
            sp.csc_array((v, pattern.lower.indices, pattern.lower.indptr), shape=(n, n)).toarray()
            for v in (below, above)
        )
        np.testing.assert_allclose(lower, np.tril(expected), atol=1e-12 * np.abs(expected).max())
        np.testing.assert_allclose(upper.T, np.triu(expected), atol=1e-12 * np.abs(expected).max())
