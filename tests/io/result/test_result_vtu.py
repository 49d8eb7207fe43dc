"""VTK reads back from VTU files what was present at each state, and nothing else."""

from dataclasses import replace
from xml.etree import ElementTree

import numpy as np
import pytest

from geoident.io.result.vtu import write_pvd, write_vtu
from geoident.model.mesh import ElementBlock, Mesh
from geoident.model.results.result import FieldSeries, LastStates
from geoident.model.results.yielded import Mechanism

xml = pytest.importorskip("vtkmodules.vtkIOXML", reason="needs vtk")
from vtkmodules.util.numpy_support import vtk_to_numpy  # noqa: E402
from vtkmodules.vtkFiltersGeneral import vtkCellValidator  # noqa: E402

CELL_TYPES = {2: [5, 5, 9, 22, 23], 3: [10, 24, 12, 25, 13, 26, 14, 27]}
BIG = 300_000  # numbers, more than two blocks of a compressed array


def read(path):
    reader = xml.vtkXMLUnstructuredGridReader()
    reader.SetFileName(str(path))
    reader.Update()
    return reader.GetOutput()


def nodes_of(grid, cell):
    ids = grid.GetCell(cell).GetPointIds()
    return [ids.GetId(k) for k in range(ids.GetNumberOfIds())]


@pytest.mark.parametrize("dim", [2, 3])
def test_each_state_has_its_elements_with_their_values(tmp_path, result_maker, dim):
    fields = result_maker(dim).fields
    elements = [row for block in fields.mesh.blocks for row in block.nodes.tolist()]
    for state, present in enumerate(fields.present):
        write_vtu(fields, state, tmp_path / "a.vtu")
        grid = read(tmp_path / "a.vtu")
        there = np.flatnonzero(present)
        kinds = [grid.GetCellType(cell) for cell in range(grid.GetNumberOfCells())]
        assert kinds == [CELL_TYPES[dim][element] for element in there]
        points = vtk_to_numpy(grid.GetPoints().GetData())
        moved = vtk_to_numpy(grid.GetPointData().GetArray("displacement"))
        for cell, element in enumerate(there):
            here, origin = nodes_of(grid, cell), elements[element]
            np.testing.assert_array_equal(points[here, :dim], fields.mesh.points[origin])
            np.testing.assert_array_equal(moved[here, :dim], fields.displacement[state, origin])
        assert not points[:, dim:].any()
        stress = vtk_to_numpy(grid.GetCellData().GetArray("stress"))
        np.testing.assert_array_equal(stress, fields.stress[state, there])
        yielded = vtk_to_numpy(grid.GetCellData().GetArray("yielded"))
        np.testing.assert_array_equal(yielded, fields.yielded[state, there])
        # sigma n = sigma_k n, the trace, and the order, without an eigenvalue solver
        xx, yy, zz, xy, yz, xz = stress.T
        tensors = np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]]).transpose(2, 0, 1)
        principal = vtk_to_numpy(grid.GetCellData().GetArray("principal_stress"))
        np.testing.assert_allclose(principal.sum(axis=1), xx + yy + zz, atol=1e-8)
        assert np.all(np.diff(principal, axis=1) <= 0.0)
        for name, k in (("principal_direction_1", 0), ("principal_direction_3", 2)):
            n = vtk_to_numpy(grid.GetCellData().GetArray(name))
            np.testing.assert_allclose(np.linalg.norm(n, axis=1), 1.0)
            pulled = np.einsum("qij,qj->qi", tensors, n)
            np.testing.assert_allclose(pulled, principal[:, k : k + 1] * n, atol=1e-8)


@pytest.mark.parametrize("dim", [2, 3])
def test_the_mechanism_of_a_collapse_stands_at_its_state(tmp_path, result_maker, dim):
    fields = result_maker(dim).fields
    mesh, rng = fields.mesh, np.random.default_rng(4)
    velocity = rng.uniform(-1.0, 1.0, mesh.points.shape)
    shear = rng.uniform(size=mesh.n_elements)
    found = Mechanism("s", 1, 0.5, mesh, fields.present[1], velocity, shear)
    elements = [row for block in mesh.blocks for row in block.nodes.tolist()]
    for state in (0, 1):
        write_vtu(fields, state, tmp_path / "a.vtu", mechanism=found)
        grid, there = read(tmp_path / "a.vtu"), np.flatnonzero(fields.present[state])
        moves = vtk_to_numpy(grid.GetPointData().GetArray("mechanism"))
        shears = vtk_to_numpy(grid.GetCellData().GetArray("mechanism_shear"))
        assert moves.shape[1] == 3
        if state == 0:
            assert not moves.any()
            assert not shears.any()
            continue
        np.testing.assert_array_equal(shears, shear[there])
        for cell, element in enumerate(there):
            here = nodes_of(grid, cell)
            np.testing.assert_array_equal(moves[here, :dim], velocity[elements[element]])


def test_a_state_without_equilibrium_has_the_last_one_that_was_found(tmp_path, result_maker):
    fields = result_maker(2).fields
    moved, stress = fields.displacement[2:], fields.stress[2:]
    last = LastStates(np.array([2]), moved.copy(), stress.copy(), fields.yielded[2:].copy())
    moved[:] = stress[:] = np.nan
    fields = replace(fields, last=last)
    for state, balanced in ((1, 1), (2, 0)):
        write_vtu(fields, state, tmp_path / "a.vtu")
        grid, there = read(tmp_path / "a.vtu"), np.flatnonzero(fields.present[state])
        flags = vtk_to_numpy(grid.GetCellData().GetArray("equilibrium"))
        np.testing.assert_array_equal(flags, np.full(len(there), balanced))
    shown = vtk_to_numpy(grid.GetPointData().GetArray("displacement"))
    assert np.isfinite(shown).all()
    np.testing.assert_array_equal(
        vtk_to_numpy(grid.GetCellData().GetArray("stress")), last.stress[0, there]
    )


def test_nodes_that_belong_to_nothing_are_left_out(tmp_path, result_maker):
    fields = result_maker(3).fields
    used = {node for block in fields.mesh.blocks for node in block.nodes.ravel().tolist()}
    assert len(used) < fields.mesh.n_nodes
    write_vtu(fields, 0, tmp_path / "a.vtu")
    assert read(tmp_path / "a.vtu").GetNumberOfPoints() == len(used)


@pytest.mark.parametrize("dim", [2, 3])
def test_vtk_finds_the_cells_valid(tmp_path, result_maker, dim):
    """Quadratic nodes stand where VTK has them."""
    write_vtu(result_maker(dim).fields, 0, tmp_path / "a.vtu")
    validator = vtkCellValidator()
    validator.SetInputData(read(tmp_path / "a.vtu"))
    validator.Update()
    wrong_points = 1
    state = vtk_to_numpy(validator.GetOutput().GetCellData().GetArray("ValidityState"))
    assert not (state & wrong_points).any()


def test_a_state_without_any_element(tmp_path, result_maker):
    fields = result_maker(2).fields
    fields.present[1] = False
    write_vtu(fields, 1, tmp_path / "a.vtu")
    assert read(tmp_path / "a.vtu").GetNumberOfCells() == 0


def test_arrays_of_several_blocks(tmp_path):
    points = np.random.default_rng(1).normal(size=(BIG, 2))
    triangles = np.arange(BIG).reshape(-1, 3)
    mesh = Mesh(points, (ElementBlock("tri3", triangles, np.arange(len(triangles))),))
    present = np.ones((1, len(triangles)), dtype=bool)
    stress = np.zeros((1, len(triangles), 6))
    write_vtu(FieldSeries(mesh, points[None], stress, present, present), 0, tmp_path / "a.vtu")
    found = vtk_to_numpy(read(tmp_path / "a.vtu").GetPoints().GetData())
    np.testing.assert_array_equal(found[:, :2], points)


def test_the_list_names_files_and_stages(tmp_path):
    write_pvd(["a.0.vtu", 'b".vtu'], ["virgin", "bench <1> & ü"], tmp_path / "a.pvd")
    sets = list(ElementTree.parse(tmp_path / "a.pvd").getroot()[0])
    assert [s.attrib["timestep"] for s in sets] == ["0", "1"]
    assert [s.attrib["file"] for s in sets] == ["a.0.vtu", 'b".vtu']
    assert [s.attrib["name"] for s in sets] == ["virgin", "bench <1> & ü"]
