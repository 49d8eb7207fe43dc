"""Groups keep their names, their members and the numbers of the user."""

from __future__ import annotations

from pathlib import Path

import gmsh
import meshio
import numpy as np
import pytest

from geoident.io.mesh.file import read_mesh


@pytest.fixture
def model():
    gmsh.initialize(interruptible=False)
    gmsh.option.setNumber("General.Terminal", 0)
    yield gmsh.model
    gmsh.finalize()


def save(path: Path, form: str) -> str:
    gmsh.option.setNumber("Mesh.MshFileVersion", 2.2 if form.startswith("msh2") else 4.1)
    gmsh.option.setNumber("Mesh.Binary", int(form.endswith("binary")))
    gmsh.write(str(path / "mesh.msh"))
    return str(path / "mesh.msh")


def square(model) -> None:
    model.occ.addRectangle(0, 0, 5, 1, 1)
    model.occ.synchronize()
    gmsh.option.setNumber("Mesh.MeshSizeMin", 0.4)


FORMS = ["msh2", "msh2-binary", "msh4", "msh4-binary"]


@pytest.mark.parametrize("form", FORMS)
def test_groups_that_overlap_share_elements_named_once(model, form, tmp_path):
    square(model)
    model.addPhysicalGroup(2, [1], 5, "rock")
    model.addPhysicalGroup(2, [1], 6, "Fels, weich")
    model.addPhysicalGroup(1, [1], 5, ".bottom")
    model.addPhysicalGroup(1, [1, 2], 7)
    model.addPhysicalGroup(0, [1], 5, "rock")
    model.mesh.generate(2)
    mesh = read_mesh(save(tmp_path, form), dim=2)
    everything = np.arange(mesh.n_elements)
    assert set(mesh.groups) == {"rock", "Fels, weich"}
    np.testing.assert_array_equal(mesh.groups["rock"], everything)
    np.testing.assert_array_equal(mesh.groups["Fels, weich"], everything)
    assert set(mesh.facet_groups) == {".bottom", "7"}
    assert set(mesh.facet_groups[".bottom"]) < set(mesh.facet_groups["7"])
    corner = mesh.points[mesh.node_groups["rock"]]
    np.testing.assert_allclose(corner, [[0, 0]])
    bottom = mesh.facets[0].nodes[mesh.facet_groups[".bottom"]]
    np.testing.assert_allclose(mesh.points[bottom][..., 1], 0, atol=1e-12)
    assert mesh.points.shape[1] == 2


@pytest.mark.parametrize("form", FORMS)
def test_element_numbers_are_those_of_gmsh(model, form, tmp_path):
    square(model)
    model.addPhysicalGroup(2, [1], 1, "rock")
    model.mesh.generate(2)
    mesh = read_mesh(save(tmp_path, form), dim=2)
    if form.startswith("msh4"):
        tags, nodes = model.mesh.getElementsByType(2)
        np.testing.assert_array_equal(mesh.blocks[0].numbers, tags)
        coordinates = dict(zip(*_nodes(model), strict=True))
        expected = np.array([coordinates[t] for t in nodes]).reshape(-1, 3, 3)[..., :2]
        np.testing.assert_allclose(mesh.points[mesh.blocks[0].nodes], expected)
    assert len(np.unique(mesh.blocks[0].numbers)) == mesh.n_elements


def _nodes(model):
    tags, coordinates, _ = model.mesh.getNodes()
    return tags, coordinates.reshape(-1, 3)


@pytest.mark.parametrize("form", FORMS[2:])
def test_elements_without_group_and_unused_nodes_are_kept(model, form, tmp_path):
    square(model)
    model.occ.addPoint(9, 9, 0)
    model.occ.addRectangle(1, 0, 5, 1, 1)
    model.occ.synchronize()
    model.addPhysicalGroup(2, [1], 1, "left")
    gmsh.option.setNumber("Mesh.SaveAll", 1)
    model.mesh.generate(2)
    mesh = read_mesh(save(tmp_path, form), dim=2)
    assert 0 < len(mesh.groups["left"]) < mesh.n_elements
    far = np.flatnonzero(np.all(mesh.points == 9, axis=1))
    assert len(far) == 1
    assert far[0] not in np.concatenate([block.nodes.ravel() for block in mesh.blocks])


def test_repeated_elements_need_not_follow_each_other(tmp_path):
    """MSH 2.2 repeats the elements of a second group, and lines may stand twice in the file."""
    (tmp_path / "m.msh").write_text(
        "$MeshFormat\n2.2 0 8\n$EndMeshFormat\n"
        '$PhysicalNames\n3\n2 1 "rock"\n2 2 "first"\n1 3 "floor"\n$EndPhysicalNames\n'
        "$Nodes\n4\n1 0 0 0\n2 1 0 0\n3 1 1 0\n4 0 1 0\n$EndNodes\n$Elements\n6\n"
        "1 1 2 3 1 1 2\n2 1 2 3 2 2 3\n3 1 2 4 3 2 1\n"
        "11 2 2 1 1 1 2 3\n12 2 2 1 1 1 3 4\n13 2 2 2 1 1 2 3\n$EndElements\n"
    )
    mesh = read_mesh(str(tmp_path / "m.msh"), dim=2)
    assert mesh.blocks[0].numbers.tolist() == [11, 12]
    assert {n: w.tolist() for n, w in mesh.groups.items()} == {"rock": [0, 1], "first": [0]}
    assert mesh.facets[0].numbers.tolist() == [1, 2]
    assert {n: w.tolist() for n, w in mesh.facet_groups.items()} == {"floor": [0, 1], "4": [0]}


def test_lines_of_a_solid_mesh_become_node_groups(model, tmp_path):
    model.occ.addBox(0, 0, 0, 1, 1, 1)
    model.occ.synchronize()
    model.addPhysicalGroup(3, [1], 1, "rock")
    model.addPhysicalGroup(2, [5], 2, "floor")
    model.addPhysicalGroup(1, [1], 3, "edge")
    model.mesh.generate(3)
    mesh = read_mesh(save(tmp_path, "msh4"), dim=3)
    edge = mesh.points[mesh.node_groups["edge"]]
    assert len(edge) >= 2
    assert np.count_nonzero(np.ptp(edge, axis=0) > 1e-9) == 1
    assert set(mesh.facet_groups) == {"floor"}


INP = """*Heading
*NODE, NSET=first
1, 0, 0
2, 1, 0
*Node
10, 1, 1
11, 0, 1
20, 2, 0
21, 2, 1
*ELEMENT, type=cpe4r, ELSET=rock
7, 1, 2,
10, 11
*ELEMENT, TYPE=CPE3
8, 2, 20, 21
*Element, type=CPE3, elset=Rock
9, 2, 21, 10
*Element, type=T2D2, elset=bottom
100, 1, 2
101, 2, 20
*NSET, NSET=Ends, GENERATE
1, 2
20, 21
*ELSET, ELSET=tail
8,
9
*ELSET, ELSET=all of it
rock, tail
*NSET, NSET=more
Ends, 11
*STEP
*END STEP
"""


def test_sets_of_abaqus_are_read_over_all_blocks(tmp_path):
    (tmp_path / "m.inp").write_text(INP)
    mesh = read_mesh(str(tmp_path / "m.inp"), dim=2)
    numbers = np.concatenate([block.numbers for block in mesh.blocks])
    groups = {name: sorted(numbers[where]) for name, where in mesh.groups.items()}
    assert groups == {"rock": [7, 9], "tail": [8, 9], "all of it": [7, 8, 9]}
    lines = {
        name: sorted(mesh.facets[0].numbers[where]) for name, where in mesh.facet_groups.items()
    }
    assert lines == {"bottom": [100, 101]}
    nodes = {name: mesh.points[where].tolist() for name, where in mesh.node_groups.items()}
    assert nodes == {
        "first": [[0, 0], [1, 0]],
        "Ends": [[0, 0], [1, 0], [2, 0], [2, 1]],
        "more": [[0, 0], [1, 0], [0, 1], [2, 0], [2, 1]],
    }


def test_an_included_file_is_read(tmp_path):
    head, tail = INP.split("*ELSET, ELSET=tail")
    (tmp_path / "nodes.inp").write_text(head)
    (tmp_path / "m.inp").write_text("*INCLUDE, INPUT=nodes.inp\n*ELSET, ELSET=tail" + tail)
    assert "all of it" in read_mesh(str(tmp_path / "m.inp"), dim=2).groups


POINTS = np.array([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0], [2, 0, 0], [2, 1, 0.0]])
CELLS = [("quad", [[0, 1, 2, 3]]), ("line", [[0, 1], [1, 4]]), ("quad", [[1, 4, 5, 2]])]


@pytest.mark.parametrize("suffix", ["vtu", "vtk", "xdmf"])
@pytest.mark.parametrize("name", ["MaterialIDs", "Group", "cell_tags", "anything whole"])
@pytest.mark.parametrize("kind", [np.int32, np.float64])
def test_numbers_on_cells_give_the_groups(suffix, name, kind, tmp_path):
    if suffix == "vtk" or (kind is np.float64 and " " in name):
        name = "material"
    data = {name: [np.array(v, dtype=kind) for v in ([3], [7, 8], [0])]}
    data["stress"] = [np.full(n, 0.5) for n in (1, 2, 1)]
    path = tmp_path / f"m.{suffix}"
    meshio.write_points_cells(path, POINTS, CELLS, cell_data=data)
    mesh = read_mesh(str(path), dim=2)
    groups = {name: where.tolist() for name, where in mesh.groups.items()}
    assert groups == ({"3": [0]} if name == "cell_tags" else {"0": [1], "3": [0]})
    assert {n: w.tolist() for n, w in mesh.facet_groups.items()} == {"7": [0], "8": [1]}


def test_names_that_an_xdmf_file_holds_are_used(tmp_path):
    data = {"gmsh:physical": [np.array([3]), np.array([3, 4]), np.array([0])]}
    path = tmp_path / "m.xdmf"
    meshio.write_points_cells(path, POINTS, CELLS, cell_data=data)
    names = '<main><map key="rock" dim="2">3</map><map key="floor" dim="1">3</map></main>'
    information = f'<Information Name="f"><![CDATA[{names}]]></Information></Grid>'
    path.write_text(path.read_text().replace("</Grid>", information))
    mesh = read_mesh(str(path), dim=2)
    assert {n: w.tolist() for n, w in mesh.groups.items()} == {"rock": [0]}
    assert {n: w.tolist() for n, w in mesh.facet_groups.items()} == {"floor": [0], "4": [1]}


def test_groups_of_a_med_file_have_their_names(model, tmp_path):
    square(model)
    model.addPhysicalGroup(2, [1], 5, "rock")
    model.addPhysicalGroup(1, [1], 6, "floor")
    model.mesh.generate(2)
    gmsh.write(str(tmp_path / "m.med"))
    mesh = read_mesh(str(tmp_path / "m.med"), dim=2)
    assert set(mesh.groups) == {"rock"}
    assert set(mesh.facet_groups) == {"floor"}
