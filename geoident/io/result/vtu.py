"""One state of a result as a VTU file (VTK XML, unstructured grid), and the PVD list of all states.

Arrays are compressed by zlib and written in base64, after VTK's description of its XML formats.
What is removed at a state is left out, with the nodes that belong to nothing else.
"""

from __future__ import annotations

import base64
import zlib
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any
from xml.sax.saxutils import quoteattr

import numpy as np
import numpy.typing as npt

from geoident.io.result.structure_cells import StructureCells
from geoident.io.result.vtkhdf import (
    EXCESS,
    balanced_cells,
    element_groups,
    element_numbers,
    mechanism_arrays,
    principal_cells,
    varied_cells,
    with_z,
)
from geoident.model.arrays import Floats, Ints
from geoident.model.cells import CELLS
from geoident.model.mesh import Mesh, rows_in
from geoident.model.results.result import FieldSeries
from geoident.model.results.varied import FieldEstimate
from geoident.model.results.yielded import Mechanism

Arrays = Mapping[str, npt.NDArray[Any]]
_BLOCK = 1 << 20  # bytes of an array that are compressed together
_TYPES = {"f8": "Float64", "i8": "Int64", "i1": "Int8", "u1": "UInt8"}
_HEAD = (
    '<?xml version="1.0"?>\n<VTKFile type="UnstructuredGrid" version="1.0"'
    ' byte_order="LittleEndian" header_type="UInt64" compressor="vtkZLibDataCompressor">\n'
    "<UnstructuredGrid>\n"
)


def write_vtu(
    fields: FieldSeries,
    state: int,
    path: str | Path,
    varied: Sequence[FieldEstimate] = (),
    mechanism: Mechanism | None = None,
) -> None:
    """Writes what is present at a state.

    Point data: ``displacement`` (m), ``temperature`` (degC) where heat is conducted, and
    ``excess_pore_pressure`` (Pa) where water takes time to leave. Cell data: ``stress`` (Pa; xx yy
    zz xy yz xz, tension positive), its `principal_cells`, ``yielded``, ``group`` (position among
    the element groups) and ``number``, that of the element in the mesh file.

    Args:
        fields: all states.
        state: 0 is the virgin state.
        path: the file.
        varied: constants that vary from place to place, as cell data.
        mechanism: of a collapse, as point data ``mechanism`` and cell data ``mechanism_shear``.
    """
    moving, shearing = mechanism_arrays(mechanism, len(fields.present))
    fields, balanced = fields.shown, balanced_cells(fields)
    mesh, present = fields.mesh, np.flatnonzero(fields.present[state])
    types, sizes, nodes = _cells(mesh, present)
    kept, connectivity = np.unique(nodes, return_inverse=True)
    cells: Arrays = {
        "stress": fields.stress[state, present],
        **principal_cells(fields.stress[state, present]),
        "yielded": fields.yielded[state, present].astype(np.int8),
        "group": element_groups(mesh)[present],
        "number": element_numbers(mesh)[present],
        **{k: v[present] for k, v in varied_cells(varied, mesh.n_elements).items()},
        **{k: v[state, present] for k, v in (shearing | balanced).items()},
    }
    topology: Arrays = {
        "connectivity": connectivity.astype(np.int64),
        "offsets": np.cumsum(sizes).astype(np.int64),
        "types": types,
    }
    at_points = {"displacement": with_z(fields.displacement[state, kept])}
    at_points |= {k: v[state, kept] for k, v in moving.items()}
    if fields.temperature is not None:
        at_points["temperature"] = fields.temperature[state, kept]
    if fields.excess is not None:
        at_points[EXCESS] = fields.excess[state, kept]
    _write_grid(path, with_z(mesh.points[kept]), topology, at_points, cells)


def write_structures_vtu(cells: StructureCells, path: str | Path) -> None:
    """Writes the structures that stand at a state as cells with their forces.

    Each cell has points of its own, since forces may leap between cells.

    Args:
        cells: of the structures at the state.
        path: the file.
    """
    present = cells.present
    topology: Arrays = {
        "connectivity": np.arange(cells.sizes[present].sum(), dtype=np.int64),
        "offsets": np.cumsum(cells.sizes[present]).astype(np.int64),
        "types": cells.types[present],
    }
    of_present = np.repeat(present, cells.sizes)
    at_points = {k: v[of_present] for k, v in cells.at_points.items()}
    of_cells = {k: v[present] for k, v in (*cells.of_cells.items(), *cells.static.items())}
    _write_grid(path, cells.points[of_present], topology, at_points, of_cells)


def _write_grid(
    path: str | Path, points: Floats, topology: Arrays, at_points: Arrays, cells: Arrays
) -> None:
    """Writes points (n, 3), the cells of them, and what is known at the points and of the cells."""
    with Path(path).open("w", encoding="utf-8", newline="\n") as file:
        file.write(_HEAD)
        count = len(topology["types"])
        file.write(f'<Piece NumberOfPoints="{len(points)}" NumberOfCells="{count}">\n')
        file.writelines(_section("Points", {"Points": points}))
        file.writelines(_section("Cells", topology))
        file.writelines(_section("PointData", at_points))
        file.writelines(_section("CellData", cells))
        file.write("</Piece>\n</UnstructuredGrid>\n</VTKFile>\n")


def write_pvd(
    files: Sequence[str], names: Sequence[str], path: str | Path, times: Floats | None = None
) -> None:
    """Writes the list of the states, which ParaView opens as one series.

    Args:
        files: names of the VTU files beside the list, the virgin state first.
        names: of the states.
        path: the file.
        times: (n_states,) of the states, days; None for their numbers.
    """
    steps = np.arange(len(files)) if times is None else times
    entries = (
        f'<DataSet timestep="{step:.10g}" part="0" name={quoteattr(name)} '
        f"file={quoteattr(file)}/>\n"
        for step, file, name in zip(steps.tolist(), files, names, strict=True)
    )
    head = '<?xml version="1.0"?>\n<VTKFile type="Collection" version="1.0">\n<Collection>\n'
    text = head + "".join(entries) + "</Collection>\n</VTKFile>\n"
    Path(path).write_text(text, encoding="utf-8", newline="\n")


def _cells(mesh: Mesh, present: Ints) -> tuple[npt.NDArray[np.uint8], Ints, Ints]:
    """VTK's type and the number of nodes of each present element, and their nodes in a row."""
    types: list[npt.NDArray[np.uint8]] = [np.empty(0, dtype=np.uint8)]
    sizes: list[Ints] = [np.empty(0, dtype=np.int64)]
    nodes: list[Ints] = [np.empty(0, dtype=np.int64)]
    for block, rows in rows_in(mesh.blocks, present):
        types.append(np.full(len(rows), CELLS[block.kind].vtk, dtype=np.uint8))
        sizes.append(np.full(len(rows), block.nodes.shape[1], dtype=np.int64))
        nodes.append(block.nodes[rows].ravel())
    return np.concatenate(types), np.concatenate(sizes), np.concatenate(nodes)


def _section(name: str, arrays: Arrays) -> Iterator[str]:
    yield f"<{name}>\n"
    for key, array in arrays.items():
        kind = _TYPES[array.dtype.str[1:]]
        width = array.shape[1] if array.ndim > 1 else 1
        yield f'<DataArray type="{kind}" Name="{key}" NumberOfComponents="{width}" format="binary">'
        yield _encoded(array)
        yield "</DataArray>\n"
    yield f"</{name}>\n"


def _encoded(array: npt.NDArray[Any]) -> str:
    """Base64 of the sizes of the blocks, followed by that of the compressed blocks."""
    raw = np.ascontiguousarray(array, dtype=array.dtype.newbyteorder("<")).tobytes()
    blocks = [zlib.compress(raw[start : start + _BLOCK]) for start in range(0, len(raw), _BLOCK)]
    rest = len(raw) % _BLOCK
    head = np.array([len(blocks), _BLOCK, rest, *map(len, blocks)], dtype="<u8").tobytes()
    return (base64.b64encode(head) + base64.b64encode(b"".join(blocks))).decode("ascii")
