"""Bodies that can move without strain, by piece and direction."""

from dataclasses import replace

import numpy as np
import pytest

from geoident.fem.faces import face_table
from geoident.fem.kinematics import kinematics_of
from geoident.fem.mechanism import loose_body
from geoident.model.case import Analysis
from geoident.model.mesh import ElementBlock, Mesh

SQUARE = np.array([(0.0, 0.0), (1.0, 0.0), (1.0, 1.0), (0.0, 1.0)])


def squares(*corners):
    """Unit squares with their lower left corners there; nodes at the same point are one."""
    points = np.concatenate([SQUARE + np.array(corner) for corner in corners])
    unique, node = np.unique(points, axis=0, return_inverse=True)
    nodes = node.reshape(-1, 4)
    return Mesh(unique, (ElementBlock("quad4", nodes, np.arange(len(nodes)) + 1),))


def loose(mesh, held):
    """What is loose if both components are held at the points (k, 2), or one where it is NaN."""
    fixed = np.zeros((mesh.n_nodes, 2), dtype=bool)
    for x, y, *axes in held:
        at = int(np.abs(mesh.points - (x, y)).sum(axis=1).argmin())
        fixed[at, list(axes)] = True
    present = np.ones(mesh.n_elements, dtype=bool)
    kinematics = kinematics_of(Analysis.PLANE_STRAIN)
    return loose_body(mesh, face_table(mesh), kinematics, present, fixed.ravel())


def test_a_body_on_three_rods_is_held_and_on_two_is_not():
    mesh = squares((0, 0), (1, 0))
    assert loose(mesh, [(0, 0, 0, 1), (2, 0, 1)]) is None
    turning = loose(mesh, [(0, 0, 0, 1)])
    np.testing.assert_array_equal(turning.elements, [0, 1])
    sliding = loose(mesh, [(0, 0, 1), (2, 0, 1)])
    assert (sliding.motion > 0).tolist() == [True, False]


def test_three_rods_that_meet_in_a_point_hold_nothing():
    assert loose(squares((0, 0)), [(0, 0, 0, 1), (1, 0, 0)]) is not None
    assert loose(squares((0, 0)), [(0, 0, 0, 1), (1, 0, 1)]) is None


@pytest.mark.parametrize("size", [1e-4, 1e5])
def test_what_is_loose_does_not_depend_on_its_size(size):
    """Rotations count by the size of the body, so a model in mm is judged like one in km."""
    mesh = squares((0, 0), (1, 0), (2, 0))
    mesh = replace(mesh, points=size * mesh.points)
    assert loose(mesh, [(0, 0, 0, 1), (3 * size, 0, 1)]) is None
    turning = loose(mesh, [(0, 0, 0, 1)])
    np.testing.assert_array_equal(turning.elements, [0, 1, 2])
    assert loose(mesh, [(0, 0, 1), (3 * size, 0, 1)]).motion[0] > 0


def test_a_free_body_moves_along_all_axes():
    mesh = squares((0, 0), (5, 0))
    body = loose(mesh, [(0, 0, 0, 1), (1, 0, 0, 1)])
    np.testing.assert_array_equal(body.elements, [1])
    np.testing.assert_allclose(body.centre, [5.5, 0.5])
    assert (body.motion > 0).all()


def test_a_hinge_passes_no_moment():
    """The second square hangs on the first by one corner: it turns unless it is held once more."""
    mesh = squares((0, 0), (1, 1))
    ground = [(0, 0, 0, 1), (1, 0, 0, 1)]
    np.testing.assert_array_equal(loose(mesh, ground).elements, [1])
    assert loose(mesh, [*ground, (2, 1, 1)]) is None


def test_a_ring_of_three_bodies_slides_as_one():
    """Each hangs on the two others by a hinge: a triangle, which keeps its form."""
    points = np.array([
        (0, 0), (0.5, -1), (1.5, -1), (2, 0), (2.7, 0.6), (2.2, 1.6), (1, 2), (-0.2, 1.6),
        (-0.7, 0.6),
    ], dtype=float)  # fmt: skip
    nodes = np.array([(0, 1, 2, 3), (3, 4, 5, 6), (6, 7, 8, 0)])
    mesh = Mesh(points, (ElementBlock("quad4", nodes, np.arange(3) + 1),))
    assert loose(mesh, [(0, 0, 0, 1), (2, 0, 1)]) is None
    sliding = loose(mesh, [(0, 0, 1), (2, 0, 1)])
    assert (sliding.motion > 0).tolist() == [True, False]
    assert loose(mesh, [(0, 0, 1), (2, 0, 1), (1, 2, 0)]) is None


@pytest.mark.parametrize("held", [True, False])
def test_of_many_pieces_the_one_that_is_loose_is_found(held):
    mesh = squares(*[(2 * k, 0) for k in range(200)])
    ground = [(2 * k + j, 0, 0, 1) for k in range(200 - (not held)) for j in (0, 1)]
    body = loose(mesh, ground)
    assert (body is None) == held
    if body is not None:
        assert body.centre == pytest.approx(mesh.points[mesh.blocks[0].nodes[-1]].mean(axis=0))
