"""The fields of a result as VTKHDF, which ParaView reads, and the rest of the mesh beside them.

``/VTKHDF`` is an unstructured grid with one time step a state (0 is the virgin state), of which the
value is its number, or days since the case began where stages last. The
mesh does not change with time: it is stored once, and the offset of every step into it is 0. Data
of all steps stand one after the other; the offset of step t is t times their number. In 2-D the
coordinates and displacements are padded with z = 0. Removed elements have ``vtkGhostType`` 32
(hidden), so that pictures leave them out.

``/mesh`` holds what VTK has no place for: blocks, facets, named groups.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import numpy.typing as npt

from geoident.io.result.hdf5 import TableReader, hdf5_input, hdf5_output, plain_text, refusal, texts
from geoident.model.arrays import Floats, Ints
from geoident.model.cells import CELLS
from geoident.model.mesh import ElementBlock, Mesh
from geoident.model.results.result import FieldSeries, LastStates
from geoident.model.results.varied import FieldEstimate
from geoident.model.results.yielded import Mechanism

HIDDEN_CELL = 32
GROUP = "VTKHDF"
REFIT = "results of fit and predict hold them, those of scan and of 'tests' do not"
_SUFFIXES = (".h5", ".hdf5", ".hdf")


def sidecar_path(path: str | Path) -> Path | None:
    """Path of the sidecar of a result, or None if ParaView opens the result itself by its suffix.

    >>> str(sidecar_path("cavern.fit.h5"))
    'cavern.fit.vtkhdf'
    """
    path = Path(path)
    if path.suffix == ".vtkhdf":
        return None
    stem = path.name.removesuffix(path.suffix) if path.suffix in _SUFFIXES else path.name
    return path.with_name(f"{stem}.vtkhdf")


def write_sidecar(path: str, result_name: str) -> None:
    """Writes a file whose ``/VTKHDF`` is that of the file ``result_name`` in the same folder."""
    with hdf5_output(path) as file:
        file[GROUP] = h5py.ExternalLink(result_name, f"/{GROUP}")


def copy_fields(result_path: str | Path, path: str) -> None:
    """Writes a file with a copy of the fields of a result, which ParaView opens without the result.

    It also has the principal stresses, which the result leaves to its stresses.

    Raises:
        InputError: the result has no fields, or is none.
    """
    with hdf5_output(path) as file, hdf5_input(result_path) as source:
        if GROUP not in source:
            raise refusal(result_path, "no-fields", "holds no displacements and stresses", REFIT)
        source.copy(GROUP, file)
        add_principal_stresses(file)


def add_principal_stresses(file: h5py.File) -> None:
    """Adds the `principal_cells` of all states to the stresses in ``/VTKHDF``.

    Args:
        file: with fields; no result, since its readers compute them from the stresses.
    """
    data, offsets = file[f"{GROUP}/CellData"], file[f"{GROUP}/Steps/CellDataOffsets"]
    for name, array in principal_cells(data["stress"][()]).items():
        data[name], offsets[name] = array, offsets["stress"][()]
    data["principal_stress"].attrs["unit"] = "Pa"


def sidecar_target(path: str | Path) -> str | None:
    """Name of the result that a sidecar points to, or None if the file is no sidecar."""
    try:
        with h5py.File(path, "r", locking=False) as file:
            link = file.get(GROUP, getlink=True)
            return str(link.filename) if isinstance(link, h5py.ExternalLink) else None
    except (OSError, RuntimeError):
        return None


EXCESS = "excess_pore_pressure"
"""Point data where water takes time to leave."""


def write_fields(
    file: h5py.File,
    fields: FieldSeries,
    varied: Sequence[FieldEstimate] = (),
    mechanism: Mechanism | None = None,
    times: Floats | None = None,
) -> None:
    """Writes ``/VTKHDF`` and ``/mesh``.

    Args:
        file: the result.
        fields: the states.
        varied: constants that vary from place to place, as cell data that are the same at all
            states: ``NAME``, ``NAME.sd`` (of the logarithm) and ``NAME.reduction``.
        mechanism: of a collapse, as point data ``mechanism`` and cell data ``mechanism_shear``.
        times: (n_states,) of the states, days; None for their numbers.

    States without equilibrium have the last one that was found on the way to them, since viewers
    draw nothing where a number is missing, and 0 in the cell data ``equilibrium``.
    """
    fields, balanced = fields.shown, balanced_cells(fields)
    group = file.create_group(GROUP)
    group.attrs["Version"] = np.array([2, 0], dtype=np.int64)
    group.attrs["Type"] = np.bytes_(b"UnstructuredGrid")
    _write_grid(group, fields.mesh)
    cell_data: dict[str, npt.NDArray[Any]] = {
        "stress": fields.stress,
        "present": fields.present.astype(np.int8),
        "yielded": fields.yielded.astype(np.int8),
        "vtkGhostType": np.where(fields.present, 0, HIDDEN_CELL).astype(np.uint8),
    }
    cell_data |= balanced
    static: dict[str, npt.NDArray[Any]] = {
        "group": element_groups(fields.mesh),
        "number": element_numbers(fields.mesh),
        **varied_cells(varied, fields.mesh.n_elements),
    }
    moving, shearing = mechanism_arrays(mechanism, len(fields.present))
    point_data = {"displacement": with_z(fields.displacement), **moving}
    if fields.temperature is not None:
        point_data["temperature"] = fields.temperature
    if fields.excess is not None:
        point_data[EXCESS] = fields.excess
    cell_data |= shearing
    _write_data(group, "PointData", point_data)
    _write_data(group, "CellData", cell_data | static)
    group["PointData/displacement"].attrs["unit"] = "m"
    for name in ("CellData/stress", f"PointData/{EXCESS}"):
        if name in group:
            group[name].attrs["unit"] = "Pa"
    if fields.temperature is not None:
        group["PointData/temperature"].attrs["unit"] = "degC"
    names = texts(tuple(fields.mesh.groups))
    group["CellData/group"].attrs.create("names", names, dtype=h5py.string_dtype())
    sizes = {f"PointData/{name}": fields.mesh.n_nodes for name in point_data}
    sizes |= {f"CellData/{name}": fields.mesh.n_elements for name in cell_data}
    sizes |= {f"CellData/{name}": 0 for name in static}
    _write_step_offsets(group, len(fields.present), sizes, times)
    _write_mesh(file.create_group("mesh"), fields.mesh)


def write_cells(
    file: h5py.File,
    points: Floats,
    sizes: Ints,
    types: npt.NDArray[np.uint8],
    *,
    points_data: Mapping[str, npt.NDArray[Any]],
    cells: Mapping[str, npt.NDArray[Any]],
    static: Mapping[str, npt.NDArray[Any]],
    times: Floats | None = None,
) -> h5py.Group:
    """Writes ``/VTKHDF`` of cells with points of their own, with one time step a state.

    Args:
        file: the file.
        points: (k, 3) of the cells, one after the other, m.
        sizes: (n,) points of each.
        types: (n,) VTK's numbers of their kinds.
        points_data: arrays (n_states, k, ...).
        cells: arrays (n_states, n, ...).
        static: arrays (n, ...) that are the same at all states.
        times: (n_states,) of the states, days; None for their numbers.

    Returns:
        The group.
    """
    k, n = len(points), len(sizes)
    group = file.create_group(GROUP)
    group.attrs["Version"] = np.array([2, 0], dtype=np.int64)
    group.attrs["Type"] = np.bytes_(b"UnstructuredGrid")
    group["NumberOfPoints"] = np.array([k], dtype=np.int64)
    group["NumberOfCells"] = np.array([n], dtype=np.int64)
    group["NumberOfConnectivityIds"] = np.array([k], dtype=np.int64)
    group["Points"] = points
    group["Points"].attrs["unit"] = "m"
    group["Types"] = types
    group["Connectivity"] = np.arange(k, dtype=np.int64)
    group["Offsets"] = np.concatenate([[0], np.cumsum(sizes)]).astype(np.int64)
    _write_data(group, "PointData", points_data)
    _write_data(group, "CellData", cells)
    for name, array in static.items():
        group[f"CellData/{name}"] = array
    states = len(next(iter(cells.values())))
    counts = {f"PointData/{name}": k for name in points_data}
    counts |= {f"CellData/{name}": n for name in cells}
    counts |= {f"CellData/{name}": 0 for name in static}
    _write_step_offsets(group, states, counts, times)
    return group


def varied_cells(varied: Sequence[FieldEstimate], n_elements: int) -> dict[str, Floats]:
    """Constants that vary from place to place as arrays (n_elements,); NaN in other materials.

    Args:
        varied: what is known of each.
        n_elements: of the mesh.
    """
    cells: dict[str, Floats] = {}
    for estimate in varied:
        parts = {"": estimate.values, ".sd": estimate.sd, ".reduction": estimate.reduction}
        for suffix, values in parts.items():
            array = np.full(n_elements, np.nan)
            array[estimate.elements] = values
            cells[f"{estimate.name}{suffix}"] = array
    return cells


def principal_cells(stress: Floats) -> dict[str, Floats]:
    """Principal stresses as cell data: what a viewer of tensors needs no filter for.

    Args:
        stress: (n, 6) xx, yy, zz, xy, yz, xz, tension positive, Pa.

    Returns:
        ``principal_stress`` (n, 3), the largest (of tension) first, and the unit vectors
        ``principal_direction_1`` and ``principal_direction_3`` (n, 3) of the first and the last.
    """
    xx, yy, zz, xy, yz, xz = stress.T
    tensors = np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]]).transpose(2, 0, 1)
    known = np.asarray(np.isfinite(stress).all(axis=1))
    values, vectors = np.linalg.eigh(np.where(known[:, None, None], tensors, 0.0))
    largest = np.take_along_axis(vectors, np.abs(vectors).argmax(axis=1)[:, None], axis=1)
    vectors *= np.where(largest < 0.0, -1.0, 1.0)  # of two opposite vectors always the same one
    return {
        "principal_stress": np.where(known[:, None], values[:, ::-1], np.nan),
        "principal_direction_1": np.ascontiguousarray(vectors[:, :, 2]),
        "principal_direction_3": np.ascontiguousarray(vectors[:, :, 0]),
    }


BALANCED = "equilibrium"
"""Cell data: 0 at states without equilibrium."""


def balanced_cells(fields: FieldSeries) -> dict[str, npt.NDArray[np.int8]]:
    """``equilibrium`` (n_states, n_elements); nothing where every state is in equilibrium.

    Args:
        fields: the states.
    """
    if fields.last is None:
        return {}
    balanced = np.ones(fields.present.shape, dtype=np.int8)
    balanced[fields.last.states] = 0
    return {BALANCED: balanced}


def mechanism_arrays(
    mechanism: Mechanism | None, states: int
) -> tuple[dict[str, Floats], dict[str, Floats]]:
    """The mechanism of a collapse at nodes and in elements, zero at states other than its own.

    Args:
        mechanism: the mechanism; None for no arrays.
        states: how many there are.

    Returns:
        ``mechanism``, velocities (n_states, n_nodes, 3), and ``mechanism_shear``, rates of shear
        (n_states, n_elements), both in parts of the largest.
    """
    if mechanism is None:
        return {}, {}
    velocity = np.zeros((states, *mechanism.velocity.shape))
    shear = np.zeros((states, len(mechanism.shear)))
    velocity[mechanism.state], shear[mechanism.state] = mechanism.velocity, mechanism.shear
    return {"mechanism": with_z(velocity)}, {"mechanism_shear": shear}


def _write_grid(group: h5py.Group, mesh: Mesh) -> None:
    sizes = [np.full(len(block), block.nodes.shape[1]) for block in mesh.blocks]
    types = [np.full(len(block), CELLS[block.kind].vtk) for block in mesh.blocks]
    connectivity = _joined([block.nodes.ravel() for block in mesh.blocks])
    group["NumberOfPoints"] = np.array([mesh.n_nodes], dtype=np.int64)
    group["NumberOfCells"] = np.array([mesh.n_elements], dtype=np.int64)
    group["NumberOfConnectivityIds"] = np.array([len(connectivity)], dtype=np.int64)
    group["Points"] = with_z(mesh.points)
    group["Points"].attrs["unit"] = "m"
    group["Types"] = _joined(types).astype(np.uint8)
    group["Connectivity"] = connectivity
    group["Offsets"] = np.concatenate([[0], np.cumsum(_joined(sizes))]).astype(np.int64)


def _write_data(group: h5py.Group, name: str, arrays: Mapping[str, npt.NDArray[Any]]) -> None:
    """Writes arrays (n_states, n, ...) one state after the other, and arrays (n,) as they are."""
    data = group.create_group(name)
    for key, array in arrays.items():
        data[key] = array.reshape(-1, *array.shape[2:])


def _write_step_offsets(
    group: h5py.Group, states: int, sizes: Mapping[str, int], times: Floats | None
) -> None:
    """Where the data of each state begin: so many entries a state, 0 for what stays the same."""
    steps = group.create_group("Steps")
    steps.attrs["NSteps"] = np.int64(states)
    number, zeros = np.arange(states, dtype=np.int64), np.zeros(states, dtype=np.int64)
    steps["Values"] = number.astype(np.float64) if times is None else times[:states]
    if times is not None:
        steps["Values"].attrs["unit"] = "d"
    steps["NumberOfParts"] = zeros + 1
    steps["PartOffsets"] = zeros
    steps["PointOffsets"] = zeros
    steps["CellOffsets"] = zeros[:, None]
    steps["ConnectivityIdOffsets"] = zeros[:, None]
    for name, size in sizes.items():
        kind, _, array = name.partition("/")
        steps[f"{kind}Offsets/{array}"] = number * size


def _write_mesh(group: h5py.Group, mesh: Mesh) -> None:
    group.attrs["dim"] = np.int64(mesh.dim)
    group.attrs["file"] = plain_text(mesh.file)
    group["blocks/kind"] = texts([block.kind for block in mesh.blocks])
    group["blocks/count"] = np.array([len(block) for block in mesh.blocks], dtype=np.int64)
    group["facets/kind"] = texts([block.kind for block in mesh.facets])
    group["facets/count"] = np.array([len(block) for block in mesh.facets], dtype=np.int64)
    group["facets/nodes"] = _joined([block.nodes.ravel() for block in mesh.facets])
    group["facets/number"] = _joined([block.numbers for block in mesh.facets])
    _write_sets(group, "groups", mesh.groups)
    _write_sets(group, "facet_groups", mesh.facet_groups)
    _write_sets(group, "node_groups", mesh.node_groups)


def _write_sets(group: h5py.Group, name: str, sets: Mapping[str, Ints]) -> None:
    """Named index lists as names, lengths, and all indices one after the other."""
    group[f"{name}/name"] = texts(tuple(sets))
    group[f"{name}/count"] = np.array([len(index) for index in sets.values()], dtype=np.int64)
    group[f"{name}/index"] = _joined(list(sets.values()))


def read_fields(file: h5py.File) -> FieldSeries:
    """The fields as they were written."""
    mesh = _read_mesh(file)
    group = TableReader(file, GROUP)
    steps = TableReader(group.group, "Steps")
    points, cells = TableReader(group.group, "PointData"), TableReader(group.group, "CellData")
    states, rows = len(steps.array("Values", "f")), mesh.n_elements
    displacement = points.floats("displacement", states * mesh.n_nodes, 3)
    temperature = None
    if "temperature" in points.group:
        temperature = points.floats("temperature", states * mesh.n_nodes)
        temperature = temperature.reshape(states, mesh.n_nodes)
    shown = FieldSeries(
        mesh=mesh,
        displacement=displacement.reshape(states, mesh.n_nodes, 3)[:, :, : mesh.dim].copy(),
        stress=cells.floats("stress", states * rows, 6).reshape(states, rows, 6),
        present=cells.bools("present", states * rows).reshape(states, rows),
        yielded=cells.bools("yielded", states * rows).reshape(states, rows),
        temperature=temperature,
        excess=points.floats(EXCESS, states * mesh.n_nodes).reshape(states, -1)
        if EXCESS in points.group
        else None,
    )
    if BALANCED not in cells.group:
        return shown
    balanced = cells.bools(BALANCED, states * rows).reshape(states, rows)
    return _without(shown, np.flatnonzero(~balanced.all(axis=1)))


def _without(shown: FieldSeries, states: Ints) -> FieldSeries:
    """Fields in which some states (k,) are without equilibrium, as they were before writing."""
    moved, stress, yielded = shown.displacement, shown.stress, shown.yielded
    last = LastStates(states, moved[states], stress[states], yielded[states])
    moved[states] = stress[states] = np.nan
    yielded[states] = False
    return replace(shown, last=last)


def _read_mesh(file: h5py.File) -> Mesh:
    rest, grid = TableReader(file, "mesh"), TableReader(file, GROUP)
    dim = int(rest.group.attrs["dim"])
    nodes = grid.array("NumberOfPoints", "i")[0]
    facets = TableReader(rest.group, "facets")
    numbers = TableReader(grid.group, "CellData").array("number", "i")
    return Mesh(
        points=grid.floats("Points", nodes, 3)[:, :dim].copy(),
        blocks=_blocks(TableReader(rest.group, "blocks"), grid.array("Connectivity", "i"), numbers),
        facets=_blocks(facets, facets.array("nodes", "i"), facets.array("number", "i")),
        groups=_read_sets(rest, "groups"),
        facet_groups=_read_sets(rest, "facet_groups"),
        node_groups=_read_sets(rest, "node_groups"),
        file=str(rest.group.attrs["file"]),
    )


def _blocks(table: TableReader, nodes: Ints, numbers: Ints) -> tuple[ElementBlock, ...]:
    """Cuts joined node lists and numbers into blocks."""
    kinds = table.texts("kind")
    blocks, node, number = [], 0, 0
    for kind, count in zip(kinds, table.ints("count", len(kinds)).tolist(), strict=True):
        width = CELLS[kind].n_nodes
        block = nodes[node : node + count * width].reshape(count, width)
        blocks.append(ElementBlock(kind, block, numbers[number : number + count]))
        node, number = node + count * width, number + count
    return tuple(blocks)


def _read_sets(parent: TableReader, name: str) -> dict[str, Ints]:
    table = TableReader(parent.group, name)
    names = table.texts("name")
    ends = np.cumsum(table.ints("count", len(names)))
    return dict(zip(names, np.split(table.array("index", "i"), ends)[:-1], strict=True))


def with_z(array: Floats) -> Floats:
    """(..., 2) or (..., 3) to (..., 3)."""
    missing = 3 - array.shape[-1]
    return np.pad(array, [(0, 0)] * (array.ndim - 1) + [(0, missing)]) if missing else array


def _joined(arrays: list[Ints]) -> Ints:
    return np.concatenate([np.empty(0, dtype=np.int64), *arrays]).astype(np.int64)


def element_numbers(mesh: Mesh) -> Ints:
    """(n_elements,) numbers under which the user knows the elements."""
    return _joined([block.numbers for block in mesh.blocks])


def element_groups(mesh: Mesh) -> Ints:
    """(n_elements,) position in ``mesh.groups`` of the first group of each element, else -1."""
    first = np.full(mesh.n_elements, -1, dtype=np.int64)
    for position, index in reversed(list(enumerate(mesh.groups.values()))):
        first[index] = position
    return first
