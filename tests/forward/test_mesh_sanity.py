"""Meshes that can be computed on and are not what was meant: tangled, turned, parted."""

from dataclasses import replace

import numpy as np
import pytest

from geoident.errors import InputError
from geoident.fem.faces import face_table
from geoident.fem.measure import coinciding_nodes
from geoident.fem.orientation import overlapping
from geoident.model.case import Stage
from geoident.model.in_situ import HeimStress
from geoident.model.mesh import ElementBlock
from geoident.model.parameter import Scalar
from tests.support.cases import material, model, rollers
from tests.support.meshes import KINDS, KINDS_2D, box, build, regroup


def on(mesh):
    dim = mesh.dim
    return model(
        mesh, materials={"rock": material("rock", 1e9, 0.2)}, groups={"all": "rock"},
        supports=rollers(dim),
    )  # fmt: skip


def size(kind):
    return (5, 4) if kind in KINDS_2D else (3, 3, 3)


def inner_corner(mesh):
    """A corner node in the middle of the mesh."""
    corners = np.unique(mesh.blocks[0].nodes[:, 0])
    away = np.linalg.norm(mesh.points[corners] - 0.5, axis=1)
    return corners[np.argmin(away)]


@pytest.mark.parametrize("kind", KINDS)
def test_sound_meshes_have_nothing_to_say(kind):
    mesh = box(kind, size(kind), distortion=0.1)
    assert len(overlapping(mesh, face_table(mesh))) == 0
    assert len(coinciding_nodes(mesh)) == 0
    assert not any("turned" in note or "one place" in note for note in on(mesh).notes)


@pytest.mark.parametrize("kind", ["tri3", "tet4"])
def test_a_node_that_was_moved_far_off_tangles_the_mesh(kind):
    mesh = box(kind, size(kind))
    points = mesh.points.copy()
    points[inner_corner(mesh), 0] += 60.0
    with pytest.raises(InputError) as caught:
        on(replace(mesh, points=points))
    (fault,) = caught.value.faults
    assert fault.code == "tangled-mesh"
    assert "same side of the face that they share, after some were turned" in fault.message
    assert "a node in the wrong place" in fault.hint


def test_two_elements_on_one_another_tangle_the_mesh():
    points = np.array([[0, 0], [1, 0], [0, 1], [0.2, 0.9], [1, 1.0]])
    nodes = np.array([[0, 1, 2], [0, 1, 3], [1, 4, 2]])
    mesh = box("tri3", (1, 1))
    mesh = replace(mesh, points=points, blocks=(ElementBlock("tri3", nodes, np.arange(7, 10)),),
                   facets=(), facet_groups={}, groups={"all": np.arange(3)})  # fmt: skip
    assert overlapping(mesh, face_table(mesh)).tolist() == [[0, 1]]
    held = {"x0": np.array([0, 2]), "y0": np.array([0, 1])}
    with pytest.raises(InputError, match="elements 7 and 8 lie on the same side"):
        on(replace(mesh, node_groups=held))


def test_more_pairs_of_elements_are_tangled_than_are_named():
    """Seven triangles with another on each; the first have (0, 0) to (1, 0) in common."""
    triangles = np.array([[0, 1, 2], [0, 1, 3]])
    points = np.array([[0, 0], [1, 0], [0, 1], [0.2, 0.9]])
    mesh = build(
        "tri3", np.concatenate([points + np.array([2 * n, 0]) for n in range(7)]),
        np.concatenate([triangles + 4 * n for n in range(7)]),
    )  # fmt: skip
    with pytest.raises(InputError) as caught:
        on(mesh)
    (fault,) = (fault for fault in caught.value.faults if fault.code == "tangled-mesh")
    assert fault.message == (
        "the mesh is tangled: elements 1 and 2, 3 and 4, 5 and 6, 7 and 8, 9 and 10 and 2 more "
        "pairs lie on the same side of the face that they share (the first near (0.5, 0) m)"
    )


def turned(mesh, rows):
    block = mesh.blocks[0]
    nodes = block.nodes.copy()
    nodes[rows] = nodes[rows][:, [0, 2, 1]]
    return replace(mesh, blocks=(replace(block, nodes=nodes),))


def test_elements_that_are_turned_are_named():
    mesh = box("tri3", (2, 2))
    assert any(
        note == "elements 2, 4 are numbered clockwise, other than the rest; they were turned"
        for note in on(turned(mesh, [1, 3])).notes
    )
    assert any(
        note == "all elements of the mesh are numbered clockwise; they were turned"
        for note in on(turned(mesh, np.arange(8))).notes
    )


def test_an_element_on_a_node_of_its_own_is_told():
    """The node of one element is a copy of that of its neighbours: the ground can part there."""
    mesh = box("quad4", (4, 4))
    node = inner_corner(mesh)
    block = mesh.blocks[0]
    nodes = block.nodes.copy()
    element, corner = np.argwhere(nodes == node)[0]
    nodes[element, corner] = mesh.n_nodes
    parted = replace(
        mesh, points=np.vstack([mesh.points, mesh.points[node] + 1e-6]),
        blocks=(replace(block, nodes=nodes),),
    )  # fmt: skip
    assert coinciding_nodes(parted).tolist() == [[node, mesh.n_nodes]]
    note = next(note for note in on(parted).notes if "one place" in note)
    assert note.startswith("two nodes stand at one place (near (0.5, 0.5")


def test_a_node_inside_the_side_of_another_element_is_told():
    """Two elements on the right of one on the left share only its corners."""
    points = np.array(
        [[0, 0], [1, 0], [1, 1], [0, 1], [1, 0.5], [2, 0], [2, 0.5], [2, 1]], dtype=float
    )
    mesh = build("quad4", points, np.array([[0, 1, 2, 3], [1, 5, 6, 4], [4, 6, 7, 2]]))
    note = next(note for note in on(mesh).notes if "inside the side" in note)
    assert note.startswith("a node stands inside the side of an element that does not have it")
    assert "(near (1, 0.5" in note
    assert not any("inside the side" in note for note in on(box("quad4", (4, 4))).notes)


def test_ground_that_is_missing_is_told_where_the_case_says_so():
    mesh = regroup(box("quad4", (2, 2)), top=lambda c: c[:, 1] > 0.5)
    common = {"materials": {"rock": material("rock", 1e9, 0.2)}, "supports": rollers(2)}
    with pytest.raises(InputError) as none_at_first:
        model(mesh, groups={"rock": None, "top": None}, **common)
    with pytest.raises(InputError) as none_left:
        model(mesh, groups={"rock": "rock", "top": "rock"}, stages=(
            Stage("all", excavate=("rock", "top")),), **common)  # fmt: skip
    later = model(mesh, groups={"rock": None, "top": None}, stages=(
        Stage("wait"), Stage("first lift", install={"rock": "rock"})), **common)  # fmt: skip
    assert later.survey(np.empty(0), fields=True).fields.present.any(axis=1).tolist() == [
        False, False, True
    ]  # fmt: skip
    first, last = none_at_first.value.faults[0], none_left.value.faults[0]
    assert (first.path, last.path) == ("groups", "stages[0]")
    assert "fill on a rigid base" in first.hint
    assert "after stage 'all'" in last.message
    with pytest.raises(InputError) as stressed:
        model(
            mesh,
            groups={"rock": None, "top": None},
            in_situ=HeimStress(vertical=Scalar(1e6), K0=Scalar(1.0)),
            stages=(Stage("first lift", install={"rock": "rock"}),),
            **common,
        )
    assert [fault.path for fault in stressed.value.faults] == ["in_situ"]
