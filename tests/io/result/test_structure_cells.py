"""VTK reads walls, linings and bars back as lines, shells as faces, with their forces."""

import numpy as np
import pytest

from geoident.io.result.structure_cells import (
    shell_faces,
    structure_lines,
    write_structures_vtkhdf,
)
from geoident.io.result.vtu import write_structures_vtu
from geoident.model.results.result import MemberForces
from geoident.model.results.shells import ShellForces

xml = pytest.importorskip("vtkmodules.vtkIOXML", reason="needs vtk")
from vtkmodules.util.numpy_support import vtk_to_numpy  # noqa: E402
from vtkmodules.vtkCommonExecutionModel import vtkStreamingDemandDrivenPipeline  # noqa: E402
from vtkmodules.vtkIOHDF import vtkHDFReader  # noqa: E402

HIDDEN = 32
NAN = np.nan


def members(dim=2):
    """A wall of two pieces that stands from the first stage on, and a strut from the second."""
    ends = np.array(
        [[[1.0, 0.0], [1.0, -2.0]], [[1.0, -2.0], [1.0, -4.0]], [[0.0, -1.0], [1.0, -1.0]]]
    )
    return MemberForces(
        structures=("wall", "wall", "strut"),
        numbers=np.array([1, 2, 1]),
        stages=("dig", "prop"),
        ends=np.pad(ends, [(0, 0), (0, 0), (0, dim - 2)]),
        axial=np.array([[-1e3, -2e3], [-3e3, -4e3], [NAN, -5e4]]),
        moment=np.array([[[0.0, 0.0], [1e3, 2e3]], [[1e3, 2e3], [0.0, 0.0]], [[NAN] * 2] * 2]),
        shear=np.array([[-500.0, -1e3], [500.0, 1e3], [NAN, NAN]]),
        per_metre=np.array([True, True, False]),
        hoop=np.full((3, 2), NAN),
        prestress=np.array([[NAN, NAN], [NAN, NAN], [NAN, -5e4]]),
    )


def read_vtu(path):
    reader = xml.vtkXMLUnstructuredGridReader()
    reader.SetFileName(str(path))
    reader.Update()
    return reader.GetOutput()


def at_time(reader, state):
    reader.UpdateTimeStep(float(state))
    grid = reader.GetOutputDataObject(0)
    return grid.GetPartition(0) if grid.IsA("vtkPartitionedDataSet") else grid


def at_points(grid, name):
    return vtk_to_numpy(grid.GetPointData().GetArray(name))


def test_a_vtu_has_the_lines_that_stand_with_the_forces_at_their_ends(tmp_path):
    found = members()
    for state, there in ((0, []), (1, [0, 1]), (2, [0, 1, 2])):
        write_structures_vtu(structure_lines(found, state), tmp_path / "a.vtu")
        grid = read_vtu(tmp_path / "a.vtu")
        assert [grid.GetCellType(k) for k in range(grid.GetNumberOfCells())] == [3] * len(there)
        if not there:
            continue
        points = vtk_to_numpy(grid.GetPoints().GetData()).reshape(-1, 2, 3)
        np.testing.assert_array_equal(points[..., :2], found.ends[there])
        moment = at_points(grid, "M").reshape(-1, 2)
        np.testing.assert_array_equal(moment, found.moment[there, :, state - 1])
        axial = at_points(grid, "N").reshape(-1, 2)
        np.testing.assert_array_equal(axial[:, 0], found.axial[there, state - 1])
        np.testing.assert_array_equal(axial[:, 0], axial[:, 1])
        # going down the wall, its right is -x
        np.testing.assert_array_equal(at_points(grid, "right")[0], [-1.0, 0.0, 0.0])
    assert vtk_to_numpy(grid.GetCellData().GetArray("stressed_to"))[2] == -5e4
    assert vtk_to_numpy(grid.GetCellData().GetArray("structure")).tolist() == [0, 0, 1]


@pytest.mark.parametrize("dim", [2, 3])
def test_a_vtkhdf_has_all_states_and_hides_what_does_not_stand(tmp_path, dim):
    found = members(dim)
    states = [structure_lines(found, state) for state in range(3)]
    write_structures_vtkhdf(states, tmp_path / "a.vtkhdf")
    reader = vtkHDFReader()
    reader.SetFileName(str(tmp_path / "a.vtkhdf"))
    reader.UpdateInformation()
    key = vtkStreamingDemandDrivenPipeline.TIME_STEPS()
    assert reader.GetOutputInformation(0).Get(key) == (0.0, 1.0, 2.0)
    for state, standing in enumerate(([0, 0, 0], [1, 1, 0], [1, 1, 1])):
        grid = at_time(reader, state)
        ghosts = vtk_to_numpy(grid.GetCellData().GetArray("vtkGhostType"))
        assert ghosts.tolist() == [0 if stands else HIDDEN for stands in standing]
        if state:
            shear = at_points(grid, "Q").reshape(-1, 2)[:2, 0]
            np.testing.assert_array_equal(shear, found.shear[:2, state - 1])
    points = vtk_to_numpy(grid.GetPoints().GetData()).reshape(-1, 2, 3)
    np.testing.assert_array_equal(points[..., :dim], found.ends)


def of_cells(grid, name):
    return vtk_to_numpy(grid.GetCellData().GetArray(name))


def slab():
    """A square and a triangle beside it, the second shell from the second stage on."""
    square = [[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [1.0, 1.0, 0.0], [0.0, 1.0, 0.0]]
    triangle = [[1.0, 0.0, 0.0], [2.0, 0.0, 0.0], [1.0, 1.0, 0.0], [NAN] * 3]
    moment = np.array([[3e3, -1e3, 1.5e3], [0.0, 4e3, 0.0]])
    there = np.array([[1.0, 1.0], [NAN, 1.0]])[:, None]
    corners = np.array([square, triangle])
    return ShellForces(
        structures=("floor", "flap"),
        numbers=np.array([1, 1]),
        stages=("cast", "extend"),
        centres=np.nanmean(corners, axis=1),
        corners=corners,
        axes=np.tile(np.eye(3), (2, 1, 1)),
        normal=np.full((2, 3, 2), -5e4) * there,
        moment=moment[:, :, None] * there,
    )


def test_shells_are_faces_with_their_forces_and_principal_moments(tmp_path):
    found = slab()
    states = [shell_faces(found, state) for state in range(3)]
    write_structures_vtkhdf(states, tmp_path / "a.vtkhdf")
    reader = vtkHDFReader()
    reader.SetFileName(str(tmp_path / "a.vtkhdf"))
    reader.UpdateInformation()
    write_structures_vtu(states[1], tmp_path / "a.vtu")
    assert read_vtu(tmp_path / "a.vtu").GetNumberOfCells() == 1
    write_structures_vtu(states[2], tmp_path / "a.vtu")
    for grid in (read_vtu(tmp_path / "a.vtu"), at_time(reader, 2)):
        assert [grid.GetCellType(k) for k in range(2)] == [9, 5]
        points = vtk_to_numpy(grid.GetPoints().GetData())
        np.testing.assert_array_equal(points, found.corners.reshape(-1, 3)[:7])
        np.testing.assert_array_equal(of_cells(grid, "m_12"), found.moment[:, 2, 1])
        # 1 +- 2.5 kNm/m, the larger at atan(1.5 / 2) / 2 from axis 1 (Mohr's circle)
        np.testing.assert_allclose(of_cells(grid, "m_principal"), [[3.5e3, -1.5e3], [4e3, 0.0]])
        tilt = np.arctan2(1.5, 2.0) / 2
        direction = of_cells(grid, "m_direction")
        np.testing.assert_allclose(direction[0], [np.cos(tilt), np.sin(tilt), 0.0])
        np.testing.assert_allclose(np.abs(direction[1]), [0.0, 1.0, 0.0], atol=1e-12)
    assert of_cells(at_time(reader, 1), "vtkGhostType").tolist() == [0, HIDDEN]
