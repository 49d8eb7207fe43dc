"""Whatever is wrong with a mesh file is said in one sentence, and nothing else happens."""

from __future__ import annotations

import os
import random
from pathlib import Path

import gmsh
import meshio
import numpy as np
import pytest
import vtk

from geoident.errors import Fault, InputError
from geoident.io.mesh.file import read_mesh
from geoident.model.cells import CELLS

SQUARE = np.array([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0.0]])
UP = np.array([0, 0, 1.0])
CUBE = np.vstack([SQUARE, SQUARE + UP])


def fault_of(path: Path | str, *, dim: int = 2) -> Fault:
    with pytest.raises(InputError) as caught:
        read_mesh(str(path), dim=dim)
    (fault,) = caught.value.faults
    assert fault.message
    assert fault.location.file == str(path)
    return fault


def written(path: Path, points, cells, **data) -> Path:
    meshio.write_points_cells(path, points, cells, **data)
    return path


def msh2(path: Path, elements: str, nodes: str = "") -> Path:
    nodes = nodes or "1 0 0 0\n2 1 0 0\n3 1 1 0\n4 0 1 0\n"
    counts = [len(text.strip().splitlines()) for text in (nodes, elements)]
    path.write_text(
        f"$MeshFormat\n2.2 0 8\n$EndMeshFormat\n$Nodes\n{counts[0]}\n{nodes}$EndNodes\n"
        f"$Elements\n{counts[1]}\n{elements}$EndElements\n"
    )
    return path


def test_files_that_are_no_files_are_refused(tmp_path):
    assert fault_of(tmp_path / "none.msh").code == "mesh-missing"
    assert "folder" in fault_of(tmp_path).message
    assert "ordinary" in fault_of("/dev/null").message
    assert fault_of("a\0b.msh").code in ("mesh-file", "mesh-missing")
    assert fault_of("x" * 5000).code == "mesh-file"
    (tmp_path / "empty.msh").touch()
    assert "empty" in fault_of(tmp_path / "empty.msh").message


@pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="pipes with names are of POSIX")
@pytest.mark.parametrize(
    ("name", "text"),
    [
        ("m.inp", "*INCLUDE, INPUT=pipe\n*NODE\n1, 0, 0\n"),
        (
            "m.xdmf",
            '<Xdmf Version="3.0"><Domain><Grid Name="G"><Geometry GeometryType="XY">'
            '<DataItem DataType="Float" Dimensions="4 2" Format="HDF" Precision="8">\npipe:/d\n'
            "</DataItem></Geometry></Grid></Domain></Xdmf>\n",
        ),
    ],
)
def test_a_mesh_that_names_a_pipe_is_refused(name, text, tmp_path):
    """It was waited for without end."""
    os.mkfifo(tmp_path / "pipe")
    (tmp_path / name).write_text(text)
    fault = fault_of(tmp_path / name)
    assert fault.code == "mesh-file"
    assert "pipe', which is not an ordinary file" in fault.message


def test_a_file_without_permission_is_refused(tmp_path, monkeypatch):
    path = msh2(tmp_path / "m.msh", "1 2 2 0 1 1 2 3\n")

    def refuse(*_args, **_options):
        raise PermissionError(13, "Permission denied")

    monkeypatch.setattr(Path, "open", refuse)
    assert "Permission denied" in fault_of(path).message


def test_a_file_too_large_for_memory_is_refused(tmp_path, monkeypatch):
    path = msh2(tmp_path / "m.msh", "1 2 2 0 1 1 2 3\n")

    def refuse(_path):
        raise MemoryError

    monkeypatch.setattr(Path, "read_bytes", refuse)
    assert fault_of(path).code == "mesh-too-large"


def test_a_geometry_is_refused_with_the_command_that_meshes_it(tmp_path):
    (tmp_path / "cavern.geo").write_text("Point(1) = {0, 0, 0};\n")
    assert "gmsh -2 cavern.geo -o cavern.msh" in fault_of(tmp_path / "cavern.geo").hint
    assert "gmsh -3" in fault_of(tmp_path / "cavern.geo", dim=3).hint


def test_other_files_are_refused_by_their_suffix(tmp_path):
    for name, code in (
        ("m.docx", "mesh-format"),
        ("m.msh.gz", "mesh-packed"),
        ("m", "mesh-format"),
    ):
        (tmp_path / name).write_bytes(b"PK\3\4 whatever")
        assert fault_of(tmp_path / name).code == code
    (tmp_path / "m.msh").write_bytes(b"(0 fluent)\n")
    assert "$MeshFormat" in fault_of(tmp_path / "m.msh").message


@pytest.mark.parametrize("version", ["1", "4.0", "5.3"])
def test_other_versions_of_gmsh_are_refused_with_the_command_that_converts(version, tmp_path):
    path = tmp_path / "m.msh"
    path.write_text(f"$MeshFormat\n{version} 0 8\n$EndMeshFormat\n")
    fault = fault_of(path)
    assert fault.code == "mesh-version"
    assert "msh41" in fault.hint


def test_surfaces_in_a_solid_analysis_hint_at_plane_strain(tmp_path):
    path = msh2(tmp_path / "m.msh", "1 2 2 0 1 1 2 3\n")
    assert read_mesh(str(path), dim=2).n_elements == 1
    assert "plane-strain" in fault_of(path, dim=3).hint


def test_solids_in_a_plane_analysis_hint_at_solid(tmp_path):
    path = written(tmp_path / "m.vtu", CUBE, [("hexahedron", [list(range(8))])])
    assert "solid" in fault_of(path).hint
    assert read_mesh(str(path), dim=3).n_elements == 1


def test_lines_alone_are_refused(tmp_path):
    assert "lines" in fault_of(msh2(tmp_path / "m.msh", "1 1 2 0 1 1 2\n")).message
    assert "no elements" in fault_of(msh2(tmp_path / "m.msh", "1 15 2 0 1 1\n")).message


@pytest.mark.parametrize(("axes", "plane"), [((0, 2, 1), "x-z"), ((2, 0, 1), "y-z")])
def test_a_mesh_in_another_plane_is_refused_by_its_name(axes, plane, tmp_path):
    path = written(tmp_path / "m.vtu", SQUARE[:, axes], [("quad", [[0, 1, 2, 3]])])
    assert plane in fault_of(path).message


def test_a_curved_surface_is_refused(tmp_path):
    points = SQUARE + np.outer([0, 0, 0.1, 0], UP)
    fault = fault_of(written(tmp_path / "m.vtu", points, [("triangle", [[0, 1, 2], [0, 2, 3]])]))
    assert fault.code == "mesh-plane"
    assert "not plane" in fault.message


def test_any_constant_height_is_dropped(tmp_path):
    path = written(tmp_path / "m.vtu", SQUARE - 7.5 * UP, [("quad", [[0, 1, 2, 3]])])
    np.testing.assert_array_equal(read_mesh(str(path), dim=2).points, SQUARE[:, :2])


@pytest.mark.parametrize(("order", "kind", "dim"), [(2, "quad9", 2), (2, "hex27", 3), (3, "", 2)])
def test_complete_elements_are_refused_with_gmsh_option(order, kind, dim, tmp_path):
    gmsh.initialize(interruptible=False)
    gmsh.option.setNumber("General.Terminal", 0)
    surface = gmsh.model.geo.addPlaneSurface([_square_loop()])
    gmsh.model.geo.mesh.setTransfiniteSurface(surface)
    gmsh.model.geo.mesh.setRecombine(2, surface)
    if dim == 3:
        gmsh.model.geo.extrude([(2, surface)], 0, 0, 1, numElements=[1], recombine=True)
    gmsh.model.geo.synchronize()
    gmsh.option.setNumber("Mesh.ElementOrder", order)
    gmsh.model.mesh.generate(dim)
    gmsh.write(str(tmp_path / "m.msh"))
    gmsh.finalize()
    fault = fault_of(tmp_path / "m.msh", dim=dim)
    assert kind in fault.message
    assert ("SecondOrderIncomplete=1" if order == 2 else "ElementOrder") in fault.hint


def _square_loop() -> int:
    points = [gmsh.model.geo.addPoint(*p) for p in SQUARE]
    lines = [gmsh.model.geo.addLine(points[i], points[(i + 1) % 4]) for i in range(4)]
    for line in lines:
        gmsh.model.geo.mesh.setTransfiniteCurve(line, 2)
    return int(gmsh.model.geo.addCurveLoop(lines))


@pytest.mark.parametrize(
    ("number", "kind"), [(10, "quad9"), (12, "hex27"), (13, "wedge18"), (14, "pyramid14")]
)
def test_kinds_with_nodes_inside_their_faces_are_refused(number, kind, tmp_path):
    n = CELLS[kind].n_nodes
    points = np.random.default_rng(1).random((n + 1, 3))
    nodes = "".join(f"{k} {x} {y} {z}\n" for k, (x, y, z) in enumerate(points, start=1))
    row = " ".join(map(str, range(1, n + 1)))
    path = msh2(tmp_path / "m.msh", f"1 4 2 0 1 1 2 3 {n + 1}\n2 {number} 2 0 1 {row}\n", nodes)
    fault = fault_of(path, dim=3)
    assert f"element 2 is of the kind {kind}, which cannot be used" in fault.message
    assert "Mesh.SecondOrderIncomplete=1" in fault.hint


def test_kinds_of_order_three_are_refused(tmp_path):
    nodes = "".join(f"{k} {k} {k * k} {k % 3}\n" for k in range(1, 41))
    row = " ".join(map(str, range(1, 41)))
    fault = fault_of(msh2(tmp_path / "m.msh", f"2 90 2 0 1 {row}\n", nodes), dim=3)
    assert "gmsh's type 90, which is not of order 1 or 2" in fault.message


def test_a_duplicate_element_is_refused_by_number(tmp_path):
    path = msh2(tmp_path / "m.msh", "11 2 2 3 1 1 2 3\n12 2 2 3 1 3 4 1\n15 2 2 4 2 2 3 1\n")
    fault = fault_of(path)
    assert fault.code == "mesh-duplicate"
    assert "11 and 15" in fault.message
    same_group = "11 2 2 3 1 1 2 3\n15 2 2 3 1 1 2 3\n"
    assert fault_of(msh2(path, same_group)).code == "mesh-duplicate"


def test_a_collapsed_element_is_refused_by_number(tmp_path):
    fault = fault_of(msh2(tmp_path / "m.msh", "8 3 2 0 1 1 2 3 4\n9 3 2 0 1 1 2 3 3\n"))
    assert fault.code == "mesh-collapsed"
    assert "element 9" in fault.message


def test_nodes_that_are_missing_or_double_are_refused_by_number(tmp_path):
    path = tmp_path / "m.msh"
    fault = fault_of(msh2(path, "9 2 2 0 1 1 2 77\n"))
    assert "element 9" in fault.message
    assert "node 77" in fault.message
    nodes = "1 0 0 0\n2 1 0 0\n2 1 1 0\n"
    assert "node 2" in fault_of(msh2(path, "9 2 2 0 1 1 2 2\n", nodes)).message
    vtu = written(tmp_path / "m.vtu", SQUARE, [("triangle", [[0, 1, 9]])])
    assert "element 1" in fault_of(vtu).message
    vtu = written(tmp_path / "m.vtu", SQUARE, [("triangle", [[0, 1, -1]])])
    assert "element 1" in fault_of(vtu).message


def test_a_missing_node_is_found_also_among_sparse_numbers(tmp_path):
    nodes = "10 0 0 0\n20 1 0 0\n40 1 1 0\n"
    path = tmp_path / "m.msh"
    assert read_mesh(str(msh2(path, "9 2 2 0 1 40 10 20\n", nodes)), dim=2).n_elements == 1
    assert "node 30" in fault_of(msh2(path, "9 2 2 0 1 10 20 30\n", nodes)).message


@pytest.mark.parametrize("section", ["Nodes", "Elements"])
def test_a_section_with_more_than_it_announces_is_refused(section, tmp_path):
    path = msh2(tmp_path / "m.msh", "9 2 2 0 1 1 2 3\n")
    path.write_text(path.read_text().replace(f"$End{section}", f"7 7 7 7\n$End{section}"))
    assert fault_of(path).code == "mesh-malformed"


@pytest.mark.parametrize("value", ["nan", "inf", "1e300"])
def test_coordinates_that_are_no_numbers_are_refused(value, tmp_path):
    nodes = f"1 0 0 0\n2 {value} 0 0\n3 1 1 0\n"
    fault = fault_of(msh2(tmp_path / "m.msh", "9 2 2 0 1 1 2 3\n", nodes))
    assert fault.code == "mesh-coordinate"
    assert "node 2" in fault.message


def test_second_order_cells_mixed_in_xdmf_are_refused_in_words(tmp_path):
    points = np.array([[0, 0], [1, 0], [0, 1], [0.5, 0], [0.5, 0.5], [0, 0.5]])
    cells = [("triangle6", [[0, 1, 2, 3, 4, 5]]), ("line3", [[0, 1, 3]])]
    assert "mixed" in fault_of(written(tmp_path / "m.xdmf", points, cells)).message


def test_a_node_far_from_its_edge_is_refused_by_element(tmp_path):
    points = np.array([[0, 0], [1, 0], [0, 1], [0.5, 0], [0.5, 0.5], [3, 0.5]])
    path = written(tmp_path / "m.xdmf", points, [("triangle6", [[0, 1, 2, 3, 4, 5]])])
    fault = fault_of(path)
    assert fault.code == "mesh-mid-node"
    assert "element 1" in fault.message


def test_an_edge_without_length_is_refused_whatever_the_size_of_the_mesh(tmp_path):
    points = np.array([[0, 0], [0, 0], [0, 1e10], [5e9, 0], [5e9, 0.5], [0, 5e9]])
    path = written(tmp_path / "m.xdmf", points, [("triangle6", [[0, 1, 2, 3, 4, 5]])])
    assert fault_of(path).code == "mesh-mid-node"


def test_a_vtk_cell_that_would_be_dropped_is_refused(tmp_path):
    voxel = tmp_path / "voxel.vtk"
    cells = "CELLS 2 14\n8 0 1 2 3 4 5 6 7\n4 0 1 2 5\nCELL_TYPES 2\n11\n10\n"
    numbers = "\n".join(" ".join(map(str, p)) for p in CUBE)
    voxel.write_text(
        "# vtk DataFile Version 3.0\nx\nASCII\nDATASET UNSTRUCTURED_GRID\n"
        f"POINTS 8 double\n{numbers}\n{cells}"
    )
    assert fault_of(voxel, dim=3).code in ("mesh-malformed", "mesh-truncated")


def test_a_voxel_in_a_vtu_file_is_refused_and_not_dropped(tmp_path):
    path = tmp_path / "m.vtu"
    grid = vtk.vtkUnstructuredGrid()
    points = vtk.vtkPoints()
    for point in CUBE:
        points.InsertNextPoint(*point)
    grid.SetPoints(points)
    grid.InsertNextCell(vtk.VTK_VOXEL, 8, [0, 1, 3, 2, 4, 5, 7, 6])
    grid.InsertNextCell(vtk.VTK_TETRA, 4, [0, 1, 2, 5])
    writer = vtk.vtkXMLUnstructuredGridWriter()
    writer.SetFileName(str(path))
    writer.SetInputData(grid)
    writer.Write()
    assert "cannot handle" in fault_of(path, dim=3).message


def test_a_vtk_file_cut_within_the_cell_types_is_refused(tmp_path):
    numbers = "\n".join(" ".join(map(str, p)) for p in SQUARE)
    path = tmp_path / "m.vtk"
    path.write_text(
        "# vtk DataFile Version 3.0\nx\nASCII\nDATASET UNSTRUCTURED_GRID\n"
        f"POINTS 4 double\n{numbers}\nCELLS 2 8\n3 0 1 2\n3 0 2 3\nCELL_TYPES 2\n5\n"
    )
    assert fault_of(path).code in ("mesh-truncated", "mesh-malformed")


INP = "*NODE\n1, 0, 0\n2, 1, 0\n3, 1, 1\n"


@pytest.mark.parametrize(
    ("text", "line", "word"),
    [
        (INP + "*ELEMENT, TYPE=COH2D4\n1, 1, 2, 3\n", 5, "COH2D4"),
        (INP + "*ELEMENT, TYPE=CPE3\n1, 1, 2\n", 5, "3 nodes"),
        (INP + "*ELEMENT, TYPE=CPE3\n1, 1, 2, x\n", 5, "not a number"),
        (INP + "*ELEMENT, TYPE=CPE3\n1, 1, 2, 3\n*ELSET, ELSET=a\nb\n", 7, "set b"),
        (INP + "*ELSET\n1\n", 5, "no name"),
        (INP + "*NSET, NSET=a, GENERATE\n1\n", 5, "GENERATE"),
        (INP + "*NGEN\n1, 3\n", 5, "NGEN"),
        (INP + "*INSTANCE, NAME=a, PART=b\n1, 0\n", 5, "instance"),
        ("*NODE, SYSTEM=C\n1, 0, 0\n", 1, "SYSTEM"),
        ("*NODE\n1\n", 1, "too short"),
        ("1, 0, 0\n", 1, "keyword"),
        ("*INCLUDE, INPUT=none.inp\n", 1, "none.inp"),
        (INP, 0, "*ELEMENT"),
        (INP + "*ELEMENT, TYPE=CPE3\n1, 1, 2, 3", 0, "ends within a line"),
        (INP + "*ELEMENT, TYPE=CPE3\n1, 1, 2, 3\n1, 2, 3, 1\n", 0, "element 1"),
    ],
)
def test_faults_in_abaqus_files_have_their_line(text, line, word, tmp_path):
    (tmp_path / "m.inp").write_text(text)
    fault = fault_of(tmp_path / "m.inp")
    assert word in fault.message
    assert fault.location.line == line


def test_files_that_include_each_other_are_refused(tmp_path):
    (tmp_path / "m.inp").write_text("*INCLUDE, INPUT=m.inp\n")
    assert "without end" in fault_of(tmp_path / "m.inp").message


@pytest.fixture(scope="module")
def real_files(tmp_path_factory) -> list[Path]:
    folder = tmp_path_factory.mktemp("real")
    gmsh.initialize(interruptible=False)
    gmsh.option.setNumber("General.Terminal", 0)
    gmsh.model.occ.addRectangle(0, 0, 0, 1, 1)
    gmsh.model.occ.synchronize()
    gmsh.model.addPhysicalGroup(2, [1], 5, "rock")
    gmsh.model.addPhysicalGroup(1, [1], 6, "floor")
    gmsh.option.setNumber("Mesh.ElementOrder", 2)
    gmsh.option.setNumber("Mesh.SaveGroupsOfElements", 1)
    gmsh.option.setNumber("Mesh.MeshSizeMin", 0.5)
    gmsh.model.mesh.generate(2)
    for version in (2.2, 4.1):
        for binary in (0, 1):
            gmsh.option.setNumber("Mesh.MshFileVersion", version)
            gmsh.option.setNumber("Mesh.Binary", binary)
            gmsh.write(str(folder / f"v{version}-{binary}.msh"))
    gmsh.option.setNumber("Mesh.Binary", 0)
    for suffix in ("inp", "vtk", "bdf", "med"):
        gmsh.write(str(folder / f"m.{suffix}"))
    gmsh.finalize()
    mesh = meshio.read(folder / "m.vtk")
    meshio.write(folder / "m.vtu", mesh)
    triangles = [("triangle6", mesh.cells_dict["triangle6"])]
    meshio.write_points_cells(folder / "m.xdmf", mesh.points, triangles)
    return sorted(path for path in folder.iterdir() if path.suffix != ".h5")


def damaged(data: bytes) -> list[tuple[str, bytes]]:
    """Pieces cut off, bytes changed, bytes lost, and garbage."""
    chance = random.Random(7)
    cut = [("cut", data[: len(data) * k // 25]) for k in range(1, 25)]
    places = [chance.randrange(len(data)) for _ in range(9)]
    lost = [("lost", data[:k] + data[k + 40 :]) for k in places]
    noise = []
    for _ in range(15):
        bad = bytearray(data)
        for _ in range(5):
            bad[chance.randrange(len(bad))] = chance.randrange(256)
        noise.append(("noise", bytes(bad)))
    garbage = [("garbage", data[:40] + chance.randbytes(300)), ("garbage", chance.randbytes(500))]
    return [*cut, *noise, *lost, *garbage]


def opens(path: Path) -> bool:
    """Whether a file opens; if not, it must be refused in words."""
    try:
        read_mesh(str(path), dim=2)
    except InputError as refused:
        return not str(refused)
    return True


def test_damaged_files_are_refused_silently_whatever_the_damage(real_files, tmp_path, capfd):
    for path in real_files:
        whole = path.read_bytes()
        assert opens(path)
        for kind, data in damaged(whole):
            bad = tmp_path / path.name
            bad.write_bytes(data)
            opened = opens(bad)
            assert not (opened and kind == "garbage"), path
            assert not (opened and kind == "cut" and path.suffix in (".msh", ".vtu", ".bdf")), path
    out, err = capfd.readouterr()
    assert out == ""
    assert err == ""
