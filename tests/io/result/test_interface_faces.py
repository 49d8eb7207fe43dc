"""VTK reads interfaces back as faces with their tractions and jumps."""

from __future__ import annotations

import numpy as np
import pytest

from geoident.io.result.structure_cells import interface_faces, write_structures_vtkhdf
from geoident.io.result.vtu import write_structures_vtu
from tests.forward.structures.test_interfaces import NOTHING, pulled_apart, slope
from tests.support.commands import run_command

xml = pytest.importorskip("vtkmodules.vtkIOXML", reason="needs vtk")
from vtkmodules.util.numpy_support import vtk_to_numpy  # noqa: E402
from vtkmodules.vtkIOHDF import vtkHDFReader  # noqa: E402


def grid_of(path, state: int):
    """What VTK reads of a file."""
    reader = vtkHDFReader() if path.suffix == ".vtkhdf" else xml.vtkXMLUnstructuredGridReader()
    reader.SetFileName(str(path))
    if path.suffix == ".vtkhdf":
        reader.UpdateInformation()
        reader.UpdateTimeStep(float(state))
    reader.Update()
    grid = reader.GetOutputDataObject(0)
    return grid.GetPartition(0) if grid.IsA("vtkPartitionedDataSet") else grid


@pytest.mark.parametrize("kind", ["quad8", "tri3", "tet10", "hex8", "hex20"])
def test_faces_cover_the_interface_once_with_what_they_carry(kind, tmp_path):
    """Corners in their order give the area, each point has its numbers; dug faces are not shown."""
    states = pulled_apart(kind).survey(NOTHING, fields=False).interfaces
    faces = [interface_faces(states, state) for state in range(3)]
    write_structures_vtu(faces[1], tmp_path / "a.vtu")
    write_structures_vtkhdf(faces, tmp_path / "a.vtkhdf")
    for name in ("a.vtu", "a.vtkhdf"):
        grid = grid_of(tmp_path / name, 1)
        size = sum(covered(grid.GetCell(k)) for k in range(grid.GetNumberOfCells()))
        assert size == pytest.approx(1.0)
        read = vtk_to_numpy(grid.GetPointData().GetArray("opening"))
        np.testing.assert_array_equal(read, states.opening[:, 0])
    hidden = vtk_to_numpy(grid_of(tmp_path / "a.vtkhdf", 2).GetCellData().GetArray("vtkGhostType"))
    assert (hidden == 32).all()
    write_structures_vtu(faces[2], tmp_path / "b.vtu")
    assert grid_of(tmp_path / "b.vtu", 2).GetNumberOfCells() == 0


def covered(cell) -> float:
    """Length of a line, or area of a face, through its corners in their order."""
    corners = np.array([cell.GetPoints().GetPoint(k) for k in range(cell.GetNumberOfPoints())])
    if cell.GetCellDimension() == 1:
        return float(np.linalg.norm(corners[1] - corners[0]))
    corners = corners[: cell.GetNumberOfEdges()]
    fan = np.cross(corners[1:-1] - corners[0], corners[2:] - corners[0])
    return float(np.linalg.norm(0.5 * fan.sum(axis=0)))


def test_a_placed_block_begins_without_jumps(tmp_path):
    """Its weight closes the joint by rho g h / k_n; its fields have a file of interfaces beside."""
    ended = run_command("simulate", slope(tmp_path), "--fields", tmp_path / "a.vtkhdf")
    assert ended.exit_code == 0, ended.output
    assert "a.interfaces.vtkhdf" in ended.stderr
    arrays = grid_of(tmp_path / "a.interfaces.vtkhdf", 2).GetPointData()
    opening, slip, shear = (vtk_to_numpy(arrays.GetArray(k)) for k in ("opening", "slip", "t_s"))
    assert opening.mean() == pytest.approx(-2500 * 9.81 * 0.1 / 10e9, rel=1e-3)
    assert slip.mean() == pytest.approx(-1e3 * 0.1 / 0.2e9, rel=1e-3)
    assert shear.mean() == pytest.approx(-100.0, rel=1e-3)
