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
from geoident.model.parameter import Scalar
from tests.support.cases import material, model, rollers
from tests.support.meshes import KINDS, KINDS_2D, box, regroup


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
    note = next(note for note in on(parted).notes if "coincide" in note)
    assert note.startswith("two nodes coincide (near (0.5, 0.5")


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
