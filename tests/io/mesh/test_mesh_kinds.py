"""Every kind of element, from every format: the nodes stand where VTK's order says."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import gmsh
import meshio
import numpy as np
import pytest
import vtk

from geoident.fem.faces import face_table, patches
from geoident.fem.kinematics import SOLID
from geoident.fem.measure import element_volumes
from geoident.fem.orientation import oriented
from geoident.io.mesh.file import read_mesh
from geoident.model.cells import CELLS
from geoident.model.mesh import Mesh

VTK_CELLS = {
    "tri3": vtk.vtkTriangle,
    "tri6": vtk.vtkQuadraticTriangle,
    "quad4": vtk.vtkQuad,
    "quad8": vtk.vtkQuadraticQuad,
    "tet4": vtk.vtkTetra,
    "tet10": vtk.vtkQuadraticTetra,
    "hex8": vtk.vtkHexahedron,
    "hex20": vtk.vtkQuadraticHexahedron,
    "wedge6": vtk.vtkWedge,
    "wedge15": vtk.vtkQuadraticWedge,
    "pyramid5": vtk.vtkPyramid,
    "pyramid13": vtk.vtkQuadraticPyramid,
}
DIM = {kind: CELLS[kind].dim for kind in VTK_CELLS}
FACETS = {
    "tri3": "line2",
    "tri6": "line3",
    "quad4": "line2",
    "quad8": "line3",
    "tet4": "tri3",
    "tet10": "tri6",
    "hex8": "quad4",
    "hex20": "quad8",
    "wedge6": "tri3",
    "wedge15": "tri6",
    "pyramid5": "quad4",
    "pyramid13": "quad8",
}
BY_GMSH = ("msh2", "msh2-binary", "msh4", "msh4-binary", "inp", "vtk", "bdf", "med")
CASES = [(kind, form) for kind in VTK_CELLS for form in BY_GMSH]
CASES.remove(("pyramid13", "vtk"))  # gmsh calls them pyramids of five nodes there


def build(kind: str, *, straight: bool = True) -> None:
    """A sheared block of one kind of element in gmsh's current model, group rock, facets floor."""
    if kind.startswith("pyramid"):
        build_pyramids(CELLS[kind].order)
        return
    geo, option = gmsh.model.geo, gmsh.option.setNumber
    corners = [(0, 0), (2, 0.1), (2.3, 1.5), (0.3, 1.4)]
    points = [geo.addPoint(*p, 0) for p in corners]
    lines = [geo.addLine(points[i], points[(i + 1) % 4]) for i in range(4)]
    if not straight:
        middle = geo.addPoint(1.0, -0.3, 0)
        lines[0] = geo.addBSpline([points[0], middle, points[1]])
    surface = geo.addPlaneSurface([geo.addCurveLoop(lines)])
    blocks = kind.startswith(("quad", "hex"))
    if blocks:
        for line in lines:
            geo.mesh.setTransfiniteCurve(line, 3)
        geo.mesh.setTransfiniteSurface(surface)
        geo.mesh.setRecombine(2, surface)
    if DIM[kind] == 3:
        layers = blocks or kind.startswith("wedge")
        geo.extrude(
            [(2, surface)], 0.3, 0.2, 1, numElements=[2] if layers else [], recombine=layers
        )
    geo.synchronize()
    gmsh.model.addPhysicalGroup(DIM[kind], [1], 9, "rock")
    gmsh.model.addPhysicalGroup(DIM[kind] - 1, [1], 4, "floor")
    option("Mesh.MeshSizeMin", 0.8)
    option("Mesh.MeshSizeMax", 0.8)
    option("Mesh.SecondOrderIncomplete", 1)
    option("Mesh.ElementOrder", CELLS[kind].order)
    gmsh.model.mesh.generate(DIM[kind])


def build_pyramids(order: int) -> None:
    """A sheared cube of six pyramids, which gmsh makes itself only between other solids."""
    corners = np.array(CELLS["hex8"].shape.corners)
    points = np.vstack([corners, np.zeros(3)]) @ [[1.0, 0.1, 0], [0.2, 0.8, 0], [0.1, 0.3, 0.5]]
    points = points.round(6)  # of longer numbers meshio makes no Nastran file
    cells = [[*(n + 1 for n in face[::-1]), 9] for face in CELLS["hex8"].faces]
    mesh = gmsh.model.mesh
    gmsh.model.addDiscreteEntity(2, 1)
    gmsh.model.addDiscreteEntity(3, 1, [1])
    mesh.addNodes(3, 1, range(1, 10), points.ravel())
    mesh.addElementsByType(1, CELLS["quad4"].gmsh, [1], cells[0][:4])
    mesh.addElementsByType(1, CELLS["pyramid5"].gmsh, range(2, 8), np.ravel(cells))
    gmsh.model.addPhysicalGroup(3, [1], 9, "rock")
    gmsh.model.addPhysicalGroup(2, [1], 4, "floor")
    gmsh.option.setNumber("Mesh.SecondOrderIncomplete", 1)
    mesh.setOrder(order)


def save(path: Path, form: str) -> Path:
    """Write gmsh's current model."""
    gmsh.option.setNumber("Mesh.MshFileVersion", 2.2 if form.startswith("msh2") else 4.1)
    gmsh.option.setNumber("Mesh.Binary", int(form.endswith("binary")))
    gmsh.option.setNumber("Mesh.SaveGroupsOfElements", 1)
    file = path / ("mesh." + ("msh" if form.startswith("msh") else form))
    gmsh.write(str(file))
    return file


@pytest.fixture(autouse=True)
def _model():
    gmsh.initialize(interruptible=False)
    gmsh.option.setNumber("General.Terminal", 0)
    yield
    gmsh.finalize()


def interpolation_error(mesh: Mesh, f: Callable[[np.ndarray], np.ndarray]) -> float:
    """Largest error of f, interpolated from the nodes by VTK's own shape functions."""
    random = np.random.default_rng(1)
    worst = 0.0
    points = np.column_stack([mesh.points, np.zeros((mesh.n_nodes, 3 - mesh.dim))])
    for block in mesh.blocks:
        cell = VTK_CELLS[block.kind]()
        weights = np.zeros(block.nodes.shape[1])
        for row in block.nodes:
            at = random.uniform(0, 0.3, size=3)
            cell.InterpolateFunctions(at, weights)
            inside = weights @ points[row]
            worst = max(worst, float(abs(weights @ f(points[row]) - f(inside[None])[0])))
    return worst


def quadratic(x: np.ndarray) -> np.ndarray:
    return 1 + x @ [1.0, -2, 3] + x[:, 0] * x[:, 1] - 2 * x[:, 2] ** 2 + x[:, 0] * x[:, 2]


def linear(x: np.ndarray) -> np.ndarray:
    return 1 + x @ [1.0, -2, 3]


def middle_error(mesh: Mesh) -> float:
    """Largest distance of a node from the middle of its edge, over elements and facets."""
    worst = 0.0
    for block in (*mesh.blocks, *mesh.facets):
        for place, (a, b) in enumerate(CELLS[block.kind].edges, start=CELLS[block.kind].n_corners):
            ends = mesh.points[block.nodes[:, [a, b]]].mean(axis=1)
            away = np.linalg.norm(mesh.points[block.nodes[:, place]] - ends, axis=1)
            worst = max(worst, float(away.max()))
    return worst


@pytest.mark.parametrize(("kind", "form"), CASES)
def test_a_file_of_gmsh_opens_with_nodes_in_vtk_order(kind, form, tmp_path):
    build(kind)
    mesh = read_mesh(str(save(tmp_path, form)), dim=DIM[kind])
    assert [block.kind for block in mesh.blocks] == [kind]
    facets = [block.kind for block in mesh.facets]
    assert facets == [FACETS[kind]] or (form == "bdf" and DIM[kind] == 2)
    rock = {"vtk": "9", "bdf": "1"}.get(form, "rock")
    floor = {"vtk": "4", "bdf": "1"}.get(form, "floor")
    assert len(mesh.groups[rock]) == mesh.n_elements
    assert len(mesh.facet_groups[floor]) == sum(map(len, mesh.facets))
    tolerance = 2e-5 if form == "bdf" else 1e-11
    assert middle_error(mesh) < tolerance
    assert interpolation_error(mesh, linear) < 1e-11
    if kind in ("tri6", "tet10"):
        assert interpolation_error(mesh, quadratic) < tolerance


@pytest.mark.parametrize("suffix", ["vtu", "vtk"])
@pytest.mark.parametrize("kind", VTK_CELLS)
def test_a_file_of_vtk_opens_as_vtk_wrote_it(kind, suffix, tmp_path):
    build(kind)
    mesh = read_mesh(str(save(tmp_path, "msh4")), dim=DIM[kind])
    grid = vtk.vtkUnstructuredGrid()
    points = vtk.vtkPoints()
    points.SetDataTypeToDouble()
    for point in mesh.points:
        points.InsertNextPoint(*point, *[0.0] * (3 - mesh.dim))
    grid.SetPoints(points)
    for row in mesh.blocks[0].nodes:
        grid.InsertNextCell(VTK_CELLS[kind]().GetCellType(), len(row), row.tolist())
    material = vtk.vtkIntArray()
    material.SetName("MaterialIDs")
    for k in range(mesh.n_elements):
        material.InsertNextValue(k % 2)
    grid.GetCellData().AddArray(material)
    vtu = suffix == "vtu"
    writer = vtk.vtkXMLUnstructuredGridWriter() if vtu else vtk.vtkUnstructuredGridWriter()
    writer.SetFileName(str(tmp_path / f"vtk.{suffix}"))
    writer.SetInputData(grid)
    writer.Write()
    copy = read_mesh(str(tmp_path / f"vtk.{suffix}"), dim=DIM[kind])
    if kind == "wedge6":  # meshio turns them, as old versions of VTK would have it
        copy = oriented(copy, SOLID)
    np.testing.assert_array_equal(copy.blocks[0].nodes, mesh.blocks[0].nodes)
    np.testing.assert_allclose(copy.points, mesh.points, rtol=0, atol=1e-9)
    np.testing.assert_array_equal(copy.groups["1"], np.arange(1, mesh.n_elements, 2))


@pytest.mark.parametrize("suffix", ["xdmf", "vtu", "vtk", "med", "bdf"])
@pytest.mark.parametrize("kind", VTK_CELLS)
def test_a_file_of_meshio_opens_with_nodes_in_vtk_order(kind, suffix, tmp_path):
    build(kind)
    mesh = read_mesh(str(save(tmp_path, "msh4")), dim=DIM[kind])
    points = np.column_stack([mesh.points, np.zeros((mesh.n_nodes, 3 - mesh.dim))])
    cells = [(CELLS[kind].meshio, mesh.blocks[0].nodes)]
    meshio.write_points_cells(tmp_path / f"m.{suffix}", points, cells)
    copy = read_mesh(str(tmp_path / f"m.{suffix}"), dim=DIM[kind])
    np.testing.assert_array_equal(copy.blocks[0].nodes, mesh.blocks[0].nodes)


@pytest.mark.parametrize(
    ("kind", "order"),
    [
        (kind, order)
        for kind in VTK_CELLS
        for order in (CELLS[kind].gmsh_order, *CELLS[kind].other_orders)
        if order
    ],
)
@pytest.mark.parametrize("straight", [True, False])
def test_a_wrong_order_is_found_and_put_right(kind, order, straight, tmp_path):
    build(kind, straight=straight)
    mesh = read_mesh(str(save(tmp_path, "msh4")), dim=DIM[kind])
    wrong = np.empty_like(mesh.blocks[0].nodes)
    wrong[:, order] = mesh.blocks[0].nodes
    points = np.column_stack([mesh.points, np.zeros((mesh.n_nodes, 3 - mesh.dim))])
    meshio.write_points_cells(tmp_path / "m.vtu", points, [(CELLS[kind].meshio, wrong)])
    copy = read_mesh(str(tmp_path / "m.vtu"), dim=DIM[kind])
    np.testing.assert_array_equal(copy.blocks[0].nodes, mesh.blocks[0].nodes)


@pytest.mark.parametrize("cell", CELLS.values(), ids=CELLS)
def test_types_nodes_and_orders_are_those_of_gmsh(cell):
    """gmsh itself says how many nodes its type has, and where they stand."""
    _, dim, order, n_nodes, local, n_corners = gmsh.model.mesh.getElementProperties(cell.gmsh)
    assert (dim, n_nodes, n_corners) == (cell.dim, cell.n_nodes, cell.n_corners)
    if not cell.usable:
        return
    assert order == cell.order
    nodes = local.reshape(n_nodes, dim)[list(cell.gmsh_order or range(n_nodes))]
    corners = np.array(cell.shape.corners)
    middles = [(corners[a] + corners[b]) / 2 for a, b in cell.edges]
    np.testing.assert_allclose(nodes, np.vstack([corners, *middles]), atol=1e-12)


@pytest.mark.parametrize("kind", VTK_CELLS)
def test_types_edges_and_faces_are_those_of_vtk(kind):
    cell, peer = CELLS[kind], VTK_CELLS[kind]()
    assert (cell.vtk, cell.n_nodes) == (peer.GetCellType(), peer.GetNumberOfPoints())
    for n in range(cell.n_nodes):
        peer.GetPointIds().SetId(n, n)

    def ids(part):
        return [part.GetPointId(n) for n in range(part.GetNumberOfPoints())]

    edges = {frozenset(ids(peer.GetEdge(n))) for n in range(peer.GetNumberOfEdges())}
    own = [
        (*edge, *([cell.n_corners + n] if cell.edges else []))
        for n, edge in enumerate(cell.shape.edges)
    ]
    assert edges == {frozenset(edge) for edge in own}
    faces = {_turned(ids(peer.GetFace(n))) for n in range(peer.GetNumberOfFaces())}
    assert faces == ({_turned(face) for face in cell.faces} if cell.dim == 3 else set())


def _turned(face):
    """A face with its corners from the lowest on, which keeps the side to which it looks."""
    n = {3: 3, 6: 3, 4: 4, 8: 4}[len(face)]
    start = int(np.argmin(face[:n]))
    parts = [face[k : k + n] for k in range(0, len(face), n)]
    return tuple(int(node) for part in parts for node in (*part[start:], *part[:start]))


def test_triangles_and_quadrangles_mix(tmp_path):
    occ = gmsh.model.occ
    occ.addRectangle(0, 0, 0, 1, 1)
    occ.addRectangle(1, 0, 0, 1, 1)
    occ.fragment([(2, 1)], [(2, 2)])
    occ.synchronize()
    gmsh.model.mesh.setRecombine(2, 1)
    gmsh.model.addPhysicalGroup(2, [1, 2], 1, "all of it")
    gmsh.model.addPhysicalGroup(2, [2], 2, "right")
    gmsh.option.setNumber("Mesh.MeshSizeMin", 0.4)
    gmsh.option.setNumber("Mesh.RecombinationAlgorithm", 2)
    gmsh.model.mesh.generate(2)
    for form in ("msh2", "msh4", "msh2-binary", "msh4-binary"):
        mesh = read_mesh(str(save(tmp_path, form)), dim=2)
        sizes = {block.kind: len(block) for block in mesh.blocks}
        assert set(sizes) == {"tri3", "quad4"}
        np.testing.assert_array_equal(mesh.groups["all of it"], np.arange(mesh.n_elements))
        start = 0
        for block in mesh.blocks:
            for row, nodes in enumerate(block.nodes):
                inside = mesh.points[nodes].mean(axis=0)[0] > 1
                assert ((start + row) in mesh.groups["right"]) == inside
            start += len(block)


def test_hexahedra_pyramids_and_tetrahedra_of_gmsh_share_their_faces(tmp_path):
    """gmsh itself puts pyramids between a mapped volume and a free one."""
    geo = gmsh.model.geo
    points = [geo.addPoint(x, y, 0) for x, y in ((0, 0), (1, 0), (1, 1), (0, 1), (2, 0), (2, 1))]
    pairs = ((0, 1), (1, 2), (2, 3), (3, 0), (1, 4), (4, 5), (5, 2))
    lines = [geo.addLine(points[a], points[b]) for a, b in pairs]
    for line in lines[:4]:
        geo.mesh.setTransfiniteCurve(line, 4)
    mapped = geo.addPlaneSurface([geo.addCurveLoop(lines[:4])])
    free = geo.addPlaneSurface([geo.addCurveLoop([*lines[4:], -lines[1]])])
    geo.mesh.setTransfiniteSurface(mapped)
    geo.mesh.setRecombine(2, mapped)
    hexes = geo.extrude([(2, mapped)], 0, 0, 1, numElements=[3], recombine=True)
    tets = geo.extrude([(2, free)], 0, 0, 1)
    geo.synchronize()
    gmsh.model.addPhysicalGroup(3, [hexes[1][1]], name="mapped")
    gmsh.model.addPhysicalGroup(3, [tets[1][1]], name="free")
    gmsh.option.setNumber("Mesh.MeshSizeMin", 0.4)
    gmsh.option.setNumber("Mesh.MeshSizeMax", 0.4)
    gmsh.option.setNumber("Mesh.SecondOrderIncomplete", 1)
    for order in (1, 2):
        gmsh.option.setNumber("Mesh.ElementOrder", order)
        gmsh.model.mesh.generate(3)
        for form in ("msh2", "msh4", "msh4-binary"):
            mesh = oriented(read_mesh(str(save(tmp_path, form)), dim=3), SOLID)
            assert {CELLS[block.kind].shape.name for block in mesh.blocks} == {
                "hex",
                "pyramid",
                "tet",
            }
            assert element_volumes(mesh, SOLID).sum() == pytest.approx(2.0)
            table = face_table(mesh)
            outer = patches(mesh, table, table.free(np.ones(mesh.n_elements, bool)))
            for patch in outer:
                x = mesh.points[patch.nodes] / [2, 1, 1]
                on = np.isclose(x, 0, atol=1e-9) | np.isclose(x, 1, atol=1e-9)
                assert np.all(on.all(axis=1).any(axis=1))
