"""Faces: neighbours find each other in meshes of any size and of several kinds."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from support.meshes import KINDS, KINDS_2D, box, build, gaping_box, mixed_box, opening

from geoident.fem.faces import (
    FacetPatch,
    distance_to_faces,
    face_table,
    hanging_nodes,
    nonconforming,
    patches,
)
from geoident.model.cells import CELLS
from geoident.model.mesh import Mesh


def everywhere(mesh):
    return np.ones(mesh.n_elements, dtype=bool)


def renumbered(mesh, first, n_nodes):
    """The mesh with its nodes counted from a number on, among very many (without their memory)."""
    points = np.broadcast_to(np.zeros(mesh.dim), (n_nodes, mesh.dim))

    def shift(blocks):
        return tuple(replace(block, nodes=block.nodes + first) for block in blocks)

    return Mesh(points, shift(mesh.blocks), shift(mesh.facets), mesh.groups, mesh.facet_groups)


@pytest.mark.parametrize("kind", ["tet4", "hex8", "quad8", "wedge6", "mixed"])
@pytest.mark.parametrize("n_nodes", [2**20, 1_664_511, 2**21 + 1, 2**31])
def test_faces_are_the_same_in_a_mesh_of_any_size(kind, n_nodes):
    mesh = mixed_box(1) if kind == "mixed" else box(kind, (3,) * CELLS[kind].dim)
    small, large = (
        face_table(m) for m in (mesh, renumbered(mesh, n_nodes - mesh.n_nodes, n_nodes))
    )
    assert large.n_faces == small.n_faces
    np.testing.assert_array_equal(large.face, small.face)
    np.testing.assert_array_equal(large.free(everywhere(mesh)), small.free(everywhere(mesh)))
    far = renumbered(mesh, n_nodes - mesh.n_nodes, n_nodes)
    for block, moved in zip(mesh.facets, far.facets, strict=True):
        np.testing.assert_array_equal(large.find(moved), small.find(block))
        assert np.all(large.find(moved) >= 0)
        assert np.all(large.find(replace(moved, nodes=moved.nodes[:, ::-1] - mesh.n_nodes)) == -1)


@pytest.mark.parametrize("order", [1, 2])
def test_a_mixed_mesh_ends_at_the_faces_of_its_box_only(order):
    mesh = mixed_box(order, distortion=0.2)
    table = face_table(mesh)
    outer = patches(mesh, table, table.free(everywhere(mesh)))
    assert {patch.kind for patch in outer} == set(
        ("tri3", "quad4") if order == 1 else ("tri6", "quad8")
    )
    for patch in outer:
        x = mesh.points[patch.nodes]
        on = np.isclose(x, 0, atol=1e-12) | np.isclose(x, 1, atol=1e-12)
        assert np.all(on.all(axis=1).any(axis=1))
    assert {block.kind[:3] for block in mesh.blocks} == {"wed", "hex", "pyr", "tet"}


def coarse_beside_fine(dim):
    """A cell beside two of half its height; node 4 (and 12 above it) is no node of the first."""
    points = np.array(
        [[0, 0], [1, 0], [1, 1], [0, 1], [1, 0.5], [2, 0], [2, 0.5], [2, 1]], dtype=float
    )
    cells = np.array([[0, 1, 2, 3], [1, 5, 6, 4], [4, 6, 7, 2]])
    if dim == 2:
        return build("quad4", points, cells)
    solid = np.vstack([np.column_stack([points, np.full(8, z)]) for z in (0.0, 1.0)])
    return build("hex8", solid, np.hstack([cells, cells + 8]))


@pytest.mark.parametrize(("dim", "hanging"), [(2, [4]), (3, [4, 12])])
def test_nodes_inside_the_side_of_another_element_are_found(dim, hanging):
    mesh = coarse_beside_fine(dim)
    assert hanging_nodes(mesh, face_table(mesh)).tolist() == hanging
    apart = replace(mesh, points=mesh.points + 1e-3 * (np.arange(len(mesh.points)) == 4)[:, None])
    assert 4 not in hanging_nodes(apart, face_table(apart))


@pytest.mark.parametrize("kind", KINDS)
def test_no_node_hangs_in_a_sound_mesh(kind):
    dim = 2 if kind in KINDS_2D else 3
    meshes = [box(kind, (2, 3, 2)[:dim])]
    if not kind.startswith("pyramid"):
        meshes.append(opening(kind, dim, n=2, layers=2, radius=1.0, reach=4.0))
    for mesh in meshes:
        assert not len(hanging_nodes(mesh, face_table(mesh)))


def test_no_node_hangs_where_kinds_of_elements_meet():
    for mesh in (mixed_box(1), mixed_box(2, distortion=0.2)):
        assert not len(hanging_nodes(mesh, face_table(mesh)))


def test_quadrilaterals_that_lie_against_triangles_are_found():
    mesh = gaping_box()
    table = face_table(mesh)
    np.testing.assert_allclose(nonconforming(mesh, table), [[0.5, 0.5, 0.5]])
    for good in (mixed_box(1), mixed_box(2), box("hex8", (2, 1, 1)), box("quad4", (2, 2))):
        assert nonconforming(good, face_table(good)).shape == (0, good.dim)


@pytest.mark.parametrize("kind", KINDS)
def test_faces_are_outward_and_their_nodes_are_those_of_their_kind(kind):
    cell = CELLS[kind]
    corners = np.array(cell.shape.corners, float)
    nodes = np.vstack([corners, *((corners[a] + corners[b]) / 2 for a, b in cell.edges)])
    for face, face_kind in zip(cell.faces, cell.face_kinds, strict=True):
        own = CELLS[face_kind]
        assert len(face) == own.n_nodes
        on = nodes[list(face)]
        for n, (a, b) in enumerate(own.edges):
            np.testing.assert_allclose(on[own.n_corners + n], (on[a] + on[b]) / 2)
        along = on[1] - on[0]
        normal = (
            np.cross(along, on[2] - on[1]) if cell.dim == 3 else np.array([along[1], -along[0]])
        )
        assert normal @ (corners.mean(axis=0) - on[0]) < 0


@pytest.mark.parametrize(
    ("point", "expected"),
    [((0.2, 0.2, 3.0), 3.0), ((-1.0, 0.5, 0.0), 1.0), ((2.0, 2.0, 0.0), 2**0.5), ((1, 1, 0), 0.0)],
)
def test_distance_from_a_square(point, expected):
    corners = np.array([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0.0]])
    square = FacetPatch("quad4", np.array([[0, 1, 2, 3]]), np.array([0]))
    mesh = Mesh(corners, ())
    assert distance_to_faces(mesh, (square,), np.array(point)) == pytest.approx(expected)


def test_distance_from_faces_of_both_kinds():
    mesh = mixed_box(1)
    table = face_table(mesh)
    outer = patches(mesh, table, table.free(everywhere(mesh)))
    assert distance_to_faces(mesh, outer, np.array([0.5, 0.4, 0.3])) == pytest.approx(0.3)
    assert distance_to_faces(mesh, outer, np.array([1.2, 0.4, 0.3])) == pytest.approx(0.2)
    assert distance_to_faces(mesh, (), np.array([1.2, 0.4, 0.3])) == np.inf
