from __future__ import annotations

import dataclasses
import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import pytest

from geoident.io.result.file import read_result, write_result
from geoident.io.result.vtkhdf import sidecar_path
from geoident.model.results.result import FieldSeries, Result
from tests.io.result.conftest import make_result

vtk = pytest.importorskip("vtkmodules.vtkIOHDF", reason="needs vtk")
from vtkmodules.util.numpy_support import vtk_to_numpy  # noqa: E402
from vtkmodules.vtkCommonExecutionModel import vtkStreamingDemandDrivenPipeline  # noqa: E402
from vtkmodules.vtkFiltersGeneral import vtkCellValidator  # noqa: E402

Make = Callable[..., Result]
CELL_TYPES = {2: [5, 5, 9, 22, 23], 3: [10, 24, 12, 25, 13, 26, 14, 27]}


@pytest.fixture(scope="module")
def folders(tmp_path_factory: pytest.TempPathFactory) -> dict[int, Path]:
    """Folders with a written result, by its dimension."""
    found = {dim: tmp_path_factory.mktemp(f"written-{dim}") for dim in (2, 3)}
    for dim, folder in found.items():
        write_result(make_result(dim), folder / "a.fit.h5", overwrite=False)
    return found


@pytest.fixture(params=["a.fit.h5", "a.fit.vtkhdf"])
def opened(request: pytest.FixtureRequest, folders: dict[int, Path], result_maker: Make) -> Any:
    """Opens a result that was written, or its sidecar, from another folder."""

    def open_(dim: int) -> tuple[FieldSeries, Any]:
        result = result_maker(dim)
        file = str(folders[dim] / request.param)
        reader = vtk.vtkHDFReader()
        assert reader.CanReadFile(file)
        reader.SetFileName(file)
        reader.UpdateInformation()
        return result.fields, reader

    return open_


def states(reader: Any) -> list[Any]:
    information = reader.GetOutputInformation(0)
    times = information.Get(vtkStreamingDemandDrivenPipeline.TIME_STEPS())
    assert times == tuple(float(number) for number in range(len(times)))
    found = []
    for time in times:
        reader.UpdateTimeStep(time)
        grid = reader.GetOutputDataObject(0).NewInstance()
        grid.DeepCopy(reader.GetOutputDataObject(0))
        found.append(grid.GetPartition(0) if grid.IsA("vtkPartitionedDataSet") else grid)
    return found


def cell_array(grid: Any, name: str) -> np.ndarray:
    return vtk_to_numpy(grid.GetCellData().GetArray(name))


@pytest.mark.parametrize("dim", [2, 3])
def test_vtk_sees_the_mesh(opened: Any, dim: int) -> None:
    fields, reader = opened(dim)
    for grid in states(reader):
        points = vtk_to_numpy(grid.GetPoints().GetData())
        np.testing.assert_array_equal(points[:, :dim], fields.mesh.points)
        assert not points[:, dim:].any()
        types = [grid.GetCellType(cell) for cell in range(grid.GetNumberOfCells())]
        assert types == CELL_TYPES[dim]
        rows = [row for block in fields.mesh.blocks for row in block.nodes.tolist()]
        for cell, row in enumerate(rows):
            ids = grid.GetCell(cell).GetPointIds()
            assert [ids.GetId(i) for i in range(ids.GetNumberOfIds())] == row


@pytest.mark.parametrize("dim", [2, 3])
def test_vtk_sees_the_fields_of_every_state(opened: Any, dim: int) -> None:
    fields, reader = opened(dim)
    grids = states(reader)
    assert len(grids) == len(fields.present)
    for state, grid in enumerate(grids):
        displacement = vtk_to_numpy(grid.GetPointData().GetArray("displacement"))
        np.testing.assert_array_equal(displacement[:, :dim], fields.displacement[state])
        assert displacement.shape[1] == 3
        assert not displacement[:, dim:].any()
        for name in ("stress", "present", "yielded"):
            expected = getattr(fields, name)[state]
            np.testing.assert_array_equal(cell_array(grid, name), expected)
        numbers = np.concatenate([block.numbers for block in fields.mesh.blocks])
        np.testing.assert_array_equal(cell_array(grid, "number"), numbers)


def test_groups_have_a_number_each(opened: Any) -> None:
    _, reader = opened(2)
    for grid in states(reader):
        assert cell_array(grid, "group").tolist() == [0, 0, 1, 0, 0]


def test_removed_elements_are_hidden(opened: Any) -> None:
    fields, reader = opened(2)
    for state, grid in enumerate(states(reader)):
        ghosts = vtk_to_numpy(grid.GetCellGhostArray())
        np.testing.assert_array_equal(ghosts, np.where(fields.present[state], 0, 32))
        assert ghosts.dtype == np.uint8


def test_elements_are_valid_in_the_eyes_of_vtk(opened: Any) -> None:
    """Node order is VTK's: a wrong one gives inverted or self-crossing elements."""
    _, reader = opened(3)
    check = vtkCellValidator()
    check.SetInputData(states(reader)[0])
    check.Update()
    assert not vtk_to_numpy(check.GetOutput().GetCellData().GetArray("ValidityState")).any()


def test_sidecar_follows_both_files_to_another_folder(tmp_path: Path, result_maker: Make) -> None:
    write_result(result_maker(), tmp_path / "a.fit.h5", overwrite=False)
    (tmp_path / "new").mkdir()
    for name in ("a.fit.h5", "a.fit.vtkhdf"):
        shutil.move(tmp_path / name, tmp_path / "new" / name)
    with h5py.File(tmp_path / "new" / "a.fit.vtkhdf") as file:
        link = file.get("VTKHDF", getlink=True)
        assert link.filename == "a.fit.h5"
        assert file["VTKHDF/Points"].shape == (15, 3)


def test_mesh_is_stored_once(tmp_path: Path, result_maker: Make) -> None:
    write_result(result_maker(), tmp_path / "a.h5", overwrite=False)
    with h5py.File(tmp_path / "a.h5") as file:
        assert file["VTKHDF/Points"].shape == (15, 3)
        for name in ("PartOffsets", "PointOffsets", "CellOffsets", "ConnectivityIdOffsets"):
            assert not file[f"VTKHDF/Steps/{name}"][()].any()


def test_neighbouring_blocks_of_one_kind_stay_apart(tmp_path: Path, result_maker: Make) -> None:
    result = result_maker()
    mesh = result.fields.mesh
    again = dataclasses.replace(mesh.blocks[0], numbers=np.array([50, 51]))
    mesh = dataclasses.replace(mesh, blocks=(mesh.blocks[0], again), groups={})
    fields = dataclasses.replace(
        result.fields,
        mesh=mesh,
        stress=result.fields.stress[:, :4],
        present=result.fields.present[:, :4],
        yielded=result.fields.yielded[:, :4],
    )
    write_result(
        dataclasses.replace(result, fields=fields, mechanism=None),
        tmp_path / "a.h5",
        overwrite=False,
    )
    found = read_result(tmp_path / "a.h5").fields
    assert [block.numbers.tolist() for block in found.mesh.blocks] == [[11, 12], [50, 51]]


@pytest.mark.parametrize(
    ("path", "sidecar"),
    [
        ("a/x.fit.h5", "a/x.fit.vtkhdf"),
        ("x.hdf5", "x.vtkhdf"),
        ("x", "x.vtkhdf"),
        ("run.v2", "run.v2.vtkhdf"),
        ("x.vtkhdf", None),
    ],
)
def test_name_of_the_sidecar(path: str, sidecar: str | None) -> None:
    assert sidecar_path(path) == (sidecar and Path(sidecar))
