"""How far a point may lie beside the mesh: by the heights of arcs."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest
from support.meshes import box

from geoident.forward.gauges.beyond_mesh import allowed_distance, beside_fault, is_beside


def _chain(angles):
    """Faces of length 2 that turn by some angles (degrees), as a mesh with its outline."""
    at, heading, points = np.zeros(2), 0.0, [np.zeros(2)]
    for turn in (0.0, *angles):
        heading += np.radians(turn)
        at = at + 2.0 * np.array([np.cos(heading), np.sin(heading)])
        points.append(at)
    nodes = np.stack([np.arange(len(points) - 1), np.arange(1, len(points))], axis=1)
    patch = SimpleNamespace(kind="line2", nodes=nodes)
    return SimpleNamespace(points=np.array(points), dim=2), (patch,)


def _extent(points):
    return np.linalg.norm(np.ptp(points, axis=0))


@pytest.mark.parametrize(
    ("angles", "face", "turn"),
    [
        ((10.0, 25.0, 59.0), 0, 10.0),
        ((10.0, 25.0, 59.0), 1, 25.0),
        ((10.0, 25.0, 59.0), 2, 59.0),
        ((10.0, 25.0, 61.0), 2, 25.0),  # a corner is no curve
        ((61.0, 0.0, -20.0), 0, 0.0),
        ((61.0, 0.0, -20.0), 3, 20.0),
    ],
)
def test_an_arc_is_as_high_as_its_faces_turn(angles, face, turn):
    """A hundredth of the face, and half as much again as an eighth of length times angle."""
    mesh, outline = _chain(angles)
    nodes = outline[0].nodes[face]
    middle = mesh.points[nodes].mean(axis=0) + np.array([0.0, 0.01])
    exact = _extent(mesh.points[nodes]) * (0.01 + 1.5 / 8 * np.radians(turn))
    assert allowed_distance(mesh, outline, middle) == pytest.approx(exact, rel=1e-9)


def test_faces_of_quadratic_elements_count_by_their_corners():
    mesh, (patch,) = _chain((10.0, 25.0, 30.0))
    exact = allowed_distance(mesh, (patch,), np.array([3.0, 0.0]))
    bent = np.array([[50.0, 50.0]])
    mesh = SimpleNamespace(points=np.vstack([mesh.points, bent]), dim=2)
    middles = np.full((len(patch.nodes), 1), len(mesh.points) - 1)
    three = SimpleNamespace(kind="line3", nodes=np.hstack([patch.nodes, middles]))
    assert allowed_distance(mesh, (three,), np.array([3.0, 0.0])) == exact
    two = tuple(SimpleNamespace(kind="line2", nodes=patch.nodes[[k]]) for k in range(4))
    assert allowed_distance(mesh, two, np.array([3.0, 0.0])) == exact


@pytest.mark.parametrize("way", [1, -1])
def test_faces_in_space_turn_about_their_edges(way):
    """Three squares in a row: the second rises by 20 degrees, the third by 15 more."""
    heights, x = [0.0], [0.0]
    for angle in (0.0, 20.0, 35.0):
        heights.append(heights[-1] + 2.0 * np.sin(np.radians(angle)))
        x.append(x[-1] + 2.0 * np.cos(np.radians(angle)))
    points = np.array([[a, y, h] for y in (0.0, 3.0) for a, h in zip(x, heights, strict=True)])
    nodes = np.array([[k, k + 1, k + 5, k + 4] for k in range(3)])[:, ::way]
    outline = (SimpleNamespace(kind="quad4", nodes=nodes),)
    mesh = SimpleNamespace(points=points, dim=3)
    for face, turn in ((0, 20.0), (1, 20.0), (2, 15.0)):
        place = points[nodes[face]].mean(axis=0)
        size = _extent(points[nodes[face]])
        exact = size * (0.01 + 1.5 / 8 * np.radians(turn))
        assert allowed_distance(mesh, outline, place) == pytest.approx(exact, rel=1e-9)


def test_a_point_is_beside_an_element_from_a_millionth_of_its_size_on():
    assert not is_beside(SimpleNamespace(outside=0.9e-6))
    assert is_beside(SimpleNamespace(outside=1.1e-6))
    assert not is_beside(SimpleNamespace(outside=-0.5))


@pytest.mark.parametrize(("away", "refused"), [(0.0099, False), (0.0101, True)])
def test_a_point_in_the_air_is_said_with_the_nearest_node(away, refused):
    """Beside a straight side of a box with faces of a metre: a hundredth of these is rounding."""
    mesh = box("quad4", (3, 2), size=(3.0, 2.0))
    top = np.flatnonzero(mesh.points[:, 1] > 1.9)
    top = top[np.argsort(mesh.points[top, 0])]
    outline = (SimpleNamespace(kind="line2", nodes=np.stack([top[:-1], top[1:]], axis=1)),)
    said = []
    source = SimpleNamespace(fault=lambda key, **words: said.append((key, words)) or words)
    on_mesh = SimpleNamespace(
        mesh=mesh, outline=outline, case=SimpleNamespace(source=source),
        kinematics=SimpleNamespace(in_section=lambda p: (p, np.ones(2))),
    )  # fmt: skip
    channel = SimpleNamespace(name="roof", key=("gauges", "roof"))
    point = (1.7, 2.0 + away)
    outside, inside = SimpleNamespace(outside=0.1), SimpleNamespace(outside=0.0)
    fault = beside_fault(on_mesh, channel, point, (outside,))
    assert (fault is not None) == refused
    if refused:
        assert said == [
            (
                ("gauges", "roof"),
                {
                    "code": "gauge-outside",
                    "message": "point (1.7, 2.0101) m of gauge 'roof' lies 0.01 m outside the "
                    "mesh, in the air",
                    "hint": "correct it, or take a point of the ground: the nearest node is "
                    "(2, 2) m",
                },
            )
        ]
    assert beside_fault(on_mesh, channel, point, ()) is None
    assert beside_fault(on_mesh, channel, point, (outside, inside)) is None
