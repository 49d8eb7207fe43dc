"""How many elements, nodes and pairs are named, and which: one, as many as are named, one more."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from support.cases import make_case, material, rollers
from support.meshes import box, build, gaping_box, regroup

from geoident.fem.kinematics import kinematics_of
from geoident.fem.orientation import oriented, turned_elements
from geoident.forward.axisymmetric_checks import revolution_faults
from geoident.forward.mesh_checks import mesh_faults, mesh_notes, parted_from
from geoident.forward.stages import CaseOnMesh
from geoident.model.actions import Seismic
from geoident.model.case import Analysis, Stage
from geoident.model.in_situ import ConstantStress, HeimStress, ProfileStress
from geoident.model.mesh import ElementBlock, Mesh
from geoident.model.parameter import Scalar

ROCK = material("rock", 1e9, 0.2)


def on(mesh, groups=None, **changes):
    settings = {
        "materials": {"rock": ROCK},
        "groups": groups or dict.fromkeys(mesh.groups, "rock"),
        "supports": rollers(mesh.dim),
    }
    case = make_case(mesh, **{**settings, **changes})
    upright = oriented(mesh, kinematics_of(case.analysis))
    return CaseOnMesh(case, upright, turned=turned_elements(mesh, upright))


def pasted(**groups: Mesh) -> Mesh:
    """Several meshes of one kind as one, their elements numbered on from 11 in tens."""
    points, nodes, members, first = [], [], {}, 0
    for name, mesh in groups.items():
        nodes.append(mesh.blocks[0].nodes + sum(map(len, points)))
        points.append(mesh.points)
        members[name] = np.arange(first, first + mesh.n_elements)
        first += mesh.n_elements
    kind = next(iter(groups.values())).blocks[0].kind
    block = ElementBlock(kind, np.concatenate(nodes), 10 * np.arange(1, first + 1))
    return Mesh(np.concatenate(points), (block,), groups=members, file="twice.msh")


def moved(mesh, *by):
    return replace(mesh, points=mesh.points + np.array(by))


def turned(mesh, rows):
    block = mesh.blocks[0]
    nodes = block.nodes.copy()
    nodes[rows] = nodes[rows][:, [0, 2, 1]]
    return replace(mesh, blocks=(replace(block, nodes=nodes),))


@pytest.mark.parametrize(
    ("rows", "said"),
    [
        ([3], "element 4 is numbered clockwise, other than the rest; they were turned"),
        ([0, 1, 2, 3, 4], "elements 1, 2, 3, 4, 5 are numbered clockwise, other than the rest"),
        (range(6), "elements 1, 2, 3, 4, 5 and 1 more are numbered clockwise, other than the rest"),
        (range(8), "all elements of the mesh are numbered clockwise; they were turned"),
        ([], None),
    ],
)
def test_elements_that_were_turned(rows, said):
    (*found,) = (
        n for n in mesh_notes(on(turned(box("tri3", (2, 2)), list(rows)))) if "turned" in n
    )
    assert [note[: len(said or "")] for note in found] == ([said] if said else [])


def test_solids_are_turned_inside_out():
    mesh = box("tet4", (1, 1, 1))
    block = mesh.blocks[0]
    nodes = block.nodes.copy()
    nodes[0] = nodes[0][[0, 2, 1, 3]]
    (note,) = mesh_notes(on(replace(mesh, blocks=(replace(block, nodes=nodes),))))
    assert note.startswith("element 1 is numbered inside out, other than the rest")


def test_a_node_that_is_a_copy_and_two_of_them():
    left, right = box("quad4", (1, 1)), moved(box("quad4", (1, 1)), 1.0, 0.0)
    (note,) = mesh_notes(on(pasted(b=right, a=left)))
    assert note.startswith(
        "2 pairs of nodes coincide (the first near (1, 0) m): 'b' and 'a' are not "
        "tied there and can part"
    )
    corner = moved(box("quad4", (1, 1)), 1.0, 1.0)
    (note,) = mesh_notes(on(pasted(a=left, b=corner)))
    assert note.startswith("two nodes coincide (near (1, 1) m): 'a' and 'b' are not tied")
    mesh = pasted(a=left, b=corner)
    mesh = replace(mesh, groups={"only": np.arange(2)})
    (note,) = mesh_notes(on(mesh))
    assert "(near (1, 1) m): elements of 'only' that do not share a node are not tied" in note


@pytest.mark.parametrize("count", [2, 5, 6, 7])
def test_pairs_of_groups_between_which_nodes_are_copies(count):
    parts = {f"g{k}": moved(box("quad4", (1, 1)), float(k), 0.0) for k in range(count + 1)}
    (note,) = mesh_notes(on(pasted(**parts), groups=dict.fromkeys(parts, "rock")))
    shown = ", of ".join(f"'g{k}' and 'g{k + 1}'" for k in range(min(count, 5)))
    more = f" and {count - 5} more pairs of groups" if count > 5 else ""
    assert f": elements of {shown}{more} that do not share a node are not tied there" in note


def test_nodes_inside_the_sides_of_others():
    points = np.array([[0, 0], [3, 0], [3, 3], [0, 3], [3, 1], [3, 2], [5, 0], [5, 1], [5, 2],
                       [5, 3]], dtype=float)  # fmt: skip
    cells = np.array([[0, 1, 2, 3], [1, 6, 7, 4], [4, 7, 8, 5], [5, 8, 9, 2]])
    (note,) = mesh_notes(on(build("quad4", points, cells)))
    assert note.startswith(
        "2 nodes stand inside the side of an element that does not have them (the first near (3, 1)"
    )


def test_faces_against_triangles():
    (note,) = mesh_notes(on(gaping_box(), groups={"all": "rock"}))
    assert note.startswith("1 quadrilateral face lies against triangles, near (0.5, 0.5, 0.5) m")
    assert not any("quadrilateral" in n for n in mesh_notes(on(box("hex8", (2, 1, 1)))))


def test_ground_that_lies_in_itself_is_named_by_its_groups():
    """Squares of 1 m, half of each in another."""
    one, two = box("quad4", (2, 1), size=(2.0, 1.0)), moved(box("quad4", (1, 1)), 0.5, 0.25)
    mesh = pasted(a=one, b=two)
    (fault,) = mesh_faults(on(mesh, groups={"a": "rock", "b": "rock"}))
    assert fault.message.startswith(
        "in the mesh twice.msh the groups 'a' and 'b' overlap: 3 elements lie in each other "
        "without sharing a face, between ("
    )
    assert "(the first: 30 and 10 near (" in fault.message
    assert fault.path == "groups.b"
    left = moved(box("quad4", (2, 1), size=(2.0, 1.0)), -0.5, 0.25)
    (fault,) = mesh_faults(on(pasted(a=one, b=left), groups={"a": "rock", "b": "rock"}))
    assert "(the first: 30 and 10 near (" in fault.message
    assert mesh_faults(on(mesh, groups={"a": "rock", "b": None})) == []
    # never there together: one leaves when the other comes
    change = Stage("change", excavate=("a",), install={"b": "rock"})
    assert mesh_faults(on(mesh, groups={"a": "rock", "b": None}, stages=(change,))) == []
    both = Stage("add", install={"b": "rock"})
    (fault,) = mesh_faults(on(mesh, groups={"a": "rock", "b": None}, stages=(both,)))
    assert "'a' and 'b' overlap" in fault.message
    alone = replace(mesh, groups={"all": np.arange(3)})
    (fault,) = mesh_faults(on(alone, groups={"all": "rock"}))
    assert "'all' overlaps itself: 3 elements" in fault.message


def fan(count: int) -> Mesh:
    """Triangles of one base, pairs of them on the same side: the base of pair k from x = 2 k on."""
    points, nodes = [], []
    for k in range(count):
        first = len(points)
        points += [(2.0 * k, 0.0), (2.0 * k + 1, 0.0), (2.0 * k, 1.0), (2.0 * k + 0.2, 0.9)]
        nodes += [(first, first + 1, first + 2), (first, first + 1, first + 3)]
    block = ElementBlock("tri3", np.array(nodes), 10 * np.arange(1, len(nodes) + 1))
    return Mesh(np.array(points), (block,), groups={"all": np.arange(len(nodes))}, file="fan.msh")


@pytest.mark.parametrize("count", [1, 5, 6, 7])
def test_elements_on_the_same_side_of_a_face(count):
    (fault,) = mesh_faults(on(fan(count), groups={"all": "rock"}))
    named = [f"{20 * k + 10} and {20 * k + 20}" for k in range(min(count, 5))]
    more = f" and {count - 5} more pairs" if count > 5 else ""
    assert fault.message == (
        f"the mesh is tangled: elements {', '.join(named)}{more} lie on the same side of the face "
        "that they share (the first near (0.5, 0) m)"
    )
    assert fault.location.file == "fan.msh"


def test_tangled_elements_that_are_never_there_together():
    mesh = replace(fan(1), groups={"a": np.array([0]), "b": np.array([1])})
    assert mesh_faults(on(mesh, groups={"a": "rock", "b": None})) == []
    (fault,) = mesh_faults(on(mesh, groups={"a": "rock", "b": "rock"}))
    assert fault.code == "tangled-mesh"
    later = Stage("later", install={"b": "rock"})
    (fault,) = mesh_faults(on(mesh, groups={"a": "rock", "b": None}, stages=(later,)))
    assert fault.code == "tangled-mesh"
    # turned before: said of those alone that were
    (fault,) = mesh_faults(on(turned(fan(1), [1]), groups={"all": "rock"}))
    assert "share, after some were turned that had their nodes clockwise (" in fault.message


def test_what_hangs_on_copies_of_nodes():
    base, block = box("quad4", (2, 1), size=(2.0, 1.0)), box("quad4", (2, 1), size=(2.0, 1.0))
    mesh = pasted(a=base, b=moved(block, 0.0, 1.0))
    mesh = regroup(mesh, low=lambda c: (c[:, 1] < 1) & (c[:, 0] < 1), side=lambda c: c[:, 1] < 1)
    found = on(mesh, groups={"low": "rock", "side": "rock", "rock": "rock"})
    assert parted_from(found, np.array([2, 3])).startswith(
        "3 of its nodes stand where nodes of 'low' stand, and are not the same (the first near "
        "(0, 1) m): merge them"
    )
    assert parted_from(found, np.arange(4)) == ""
    corner = pasted(a=box("quad4", (1, 1)), b=moved(box("quad4", (1, 1)), 1.0, 1.0))
    said = parted_from(on(corner), np.array([1]))
    assert said.startswith("One of its nodes stands where nodes of 'a' stand, and is not the same")


# About an axis ------------------------------------------------------------------------------------


def about_axis(mesh=None, **changes):
    mesh = box("quad4", (2, 2)) if mesh is None else mesh
    return revolution_faults(on(mesh, analysis=Analysis.AXISYMMETRIC, **changes))


@pytest.mark.parametrize("count", [1, 10, 11, 12])
def test_elements_across_the_axis(count):
    mesh = box("quad4", (2, count), size=(2.0, 1.0))
    mesh = moved(mesh, -0.25, 0.0)
    (fault,) = about_axis(mesh)
    shown = ", ".join(str(k) for k in range(1, min(count, 10) + 1))
    more = f" and {count - 10} more" if count > 10 else ""
    assert fault.message == (
        f"elements {shown}{more} have negative radii x, down to -0.25 m: the axis of an "
        "axisymmetric analysis is x = 0"
    )
    assert about_axis(moved(mesh, 0.25, 0.0)) == []


def components(**given):
    names = ("xx", "yy", "zz", "xy", "yz", "xz")
    return tuple(Scalar(given.get(name, 0.0)) for name in names)


def test_gravity_shaking_and_stress_across_the_axis():
    assert about_axis(gravity=(0.0, -9.81)) == []
    assert [f.path for f in about_axis(gravity=(0.1, -9.81))] == ["gravity"]
    for factors, faulty in (
        ((Scalar(0.0), Scalar(0.1)), False),
        ((Scalar(0.1), Scalar(0.0)), True),
        ((Scalar(0.0, "a"), Scalar(0.0)), True),
        ((Scalar(1.0, "a"), Scalar(0.0)), True),
    ):
        assert bool(about_axis(loads={"quake": Seismic(factors)})) == faulty
    even = {"xx": -2.0, "yy": -3.0, "zz": -2.0}
    for stress, paths in (
        (ConstantStress(components(**even)), []),
        (ConstantStress(components(**even, xy=0.5)), ["in_situ.xy"]),
        (ConstantStress(components(xx=-2.0, zz=-2.5)), ["in_situ.zz"]),
        (ConstantStress(components(xx=-2.0, zz=-2.5, xy=0.5)), ["in_situ.zz", "in_situ.xy"]),
        (ProfileStress(components(**even), components(xx=1.0), Scalar(0.0)),
         ["in_situ.gradient.zz"]),
        (ProfileStress(components(**even, xy=1.0), components(), Scalar(0.0)),
         ["in_situ.at_surface.xy"]),
        (HeimStress(Scalar(0.5), vertical=Scalar(1.0), K0_across=Scalar(0.5)), []),
        (HeimStress(Scalar(0.5), vertical=Scalar(1.0), K0_across=Scalar(0.6)), ["in_situ.K0"]),
        (HeimStress(Scalar(0.5), vertical=Scalar(1.0), tectonic=components(xx=1.0)),
         ["in_situ.tectonic.zz"]),
    ):  # fmt: skip
        assert [fault.path for fault in about_axis(in_situ=stress)] == paths
    own = {"all": ConstantStress(components(xy=0.5))}
    assert [f.path for f in about_axis(in_situ_of=own)] == ["in_situ.groups.all.xy"]
    plane = on(box("quad4", (2, 2)), gravity=(1.0, 0.0))
    assert revolution_faults(plane) == []
