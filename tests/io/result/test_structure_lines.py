"""VTK reads walls, linings and bars back as lines with their forces."""

import numpy as np
import pytest

from geoident.io.result.structure_lines import write_structures_vtkhdf
from geoident.io.result.vtu import write_structures_vtu
from geoident.model.results.result import MemberForces

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


def at_points(grid, name):
    return vtk_to_numpy(grid.GetPointData().GetArray(name))


def test_a_vtu_has_the_lines_that_stand_with_the_forces_at_their_ends(tmp_path):
    found = members()
    for state, there in ((0, []), (1, [0, 1]), (2, [0, 1, 2])):
        write_structures_vtu(found, state, tmp_path / "a.vtu")
        reader = xml.vtkXMLUnstructuredGridReader()
        reader.SetFileName(str(tmp_path / "a.vtu"))
        reader.Update()
        grid = reader.GetOutput()
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
    write_structures_vtkhdf(found, tmp_path / "a.vtkhdf")
    reader = vtkHDFReader()
    reader.SetFileName(str(tmp_path / "a.vtkhdf"))
    reader.UpdateInformation()
    key = vtkStreamingDemandDrivenPipeline.TIME_STEPS()
    assert reader.GetOutputInformation(0).Get(key) == (0.0, 1.0, 2.0)
    for state, standing in enumerate(([0, 0, 0], [1, 1, 0], [1, 1, 1])):
        reader.UpdateTimeStep(float(state))
        grid = reader.GetOutputDataObject(0)
        grid = grid.GetPartition(0) if grid.IsA("vtkPartitionedDataSet") else grid
        ghosts = vtk_to_numpy(grid.GetCellData().GetArray("vtkGhostType"))
        assert ghosts.tolist() == [0 if stands else HIDDEN for stands in standing]
        if state:
            shear = at_points(grid, "Q").reshape(-1, 2)[:2, 0]
            np.testing.assert_array_equal(shear, found.shear[:2, state - 1])
    points = vtk_to_numpy(grid.GetPoints().GetData()).reshape(-1, 2, 3)
    np.testing.assert_array_equal(points[..., :dim], found.ends)
