"""All other mesh formats, through meshio (VTU, VTK, XDMF, MED, Nastran, Medit, ...).

meshio prints, exits the interpreter on files that it cannot read, and with some formats goes on
with a warning when it has lost cells. All of that ends here, as one `Refused`.
"""

from __future__ import annotations

import contextlib
import io
import re
import warnings
from collections import defaultdict
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from geoident.io.mesh.raw import RawCells, RawMesh, Refused, join, split_by
from geoident.model.arrays import Ints
from geoident.model.cells import CELLS
from geoident.model.mesh import spans

if TYPE_CHECKING:
    import meshio

_FORGOTTEN = ("wedge15", "pyramid13")
"""Kinds that meshio 5.3.5 reads and then stumbles over."""

_KINDS = {cell.meshio: cell.kind for cell in CELLS.values()} | {"tetra4": "tet4"}

GROUP_ARRAYS = (
    *("gmsh:physical", "medit:ref", "nastran:ref", "tetgen:ref", "netgen:index", "su2:tag"),
    *("avsucd:material", "flac3d:group", "cell_tags", "CellEntityIds", "MaterialIDs"),
    *("material", "material_id", "materials", "group", "group_id", "groups", "physical"),
    *("physical_group", "region", "region_id", "subdomain", "domain", "tag", "tags", "mat", "ref"),
)
"""Arrays of whole numbers on cells that give the groups: the first of these names that a file
has, without regard to case. If it has none of them, but just one array of whole numbers on its
cells, that one is taken. The group of a cell has the number as its name."""

SUFFIXES = (
    *(".vtu", ".vtk", ".xdmf", ".xmf", ".med", ".bdf", ".fem", ".nas", ".mesh", ".meshb"),
    *(".vol", ".f3grid", ".cgns", ".e", ".exo", ".ex2", ".su2", ".xml", ".h5m", ".hmf", ".ugrid"),
)
"""Formats that are read. meshio has more: those of mere surfaces, and those (Tecplot, TetGen,
Kratos) over whose damaged files it hangs."""

_LOSSES = re.compile(r"cannot handle|could not parse|doesn't know|not closed|Skipping cell block")

_NO_GROUP_0 = ("gmsh:physical", "cell_tags")
"""In these arrays 0 means: in no group."""


def read_other(path: Path) -> RawMesh:
    """The mesh in a file of any format that meshio reads, told by its suffix.

    Raises:
        Refused: meshio cannot read it, or not all of it.
    """
    printed = io.StringIO()
    try:
        with _silence(printed):
            mesh = _read_silently(path)
    except Refused:
        raise
    except ImportError as error:
        message = f"this format needs the Python package {error.name}"
        raise Refused("mesh-format", message, "install it, or write the mesh as .msh") from error
    except (Exception, SystemExit) as error:
        raise _unreadable(path, error, printed.getvalue()) from error
    loss = next((k for k in printed.getvalue().splitlines() if _LOSSES.search(k)), None)
    if loss is not None:
        message = f"parts of the file are not understood ({loss.strip()})"
        raise Refused("mesh-malformed", message, "write the mesh as .msh with gmsh")
    if path.suffix.lower() == ".vtk":
        _check_vtk(path.read_bytes(), mesh)
    return _raw(mesh)


def _check_vtk(data: bytes, mesh: meshio.Mesh) -> None:
    """Refuse a VTK file of which meshio has read less than it announces, as it does silently."""
    counts = {b"POINTS": len(mesh.points), b"CELL_TYPES": sum(map(len, mesh.cells))}
    for key, n in counts.items():
        match = re.search(rb"^%s[ \t]+(\d+)" % key, data, re.MULTILINE)
        if match is not None and int(match[1]) != n:
            message = f"the file announces {int(match[1])} {key.decode()} and holds {n}"
            raise Refused("mesh-truncated", message, "copy or write the whole file again")


def _read_silently(path: Path) -> meshio.Mesh:
    """The mesh as meshio has it.

    A Nastran deck must end with ENDDATA, or meshio's reader would hang on it, and is given the
    BEGIN BULK that gmsh does not write.
    """
    import meshio  # noqa: PLC0415 - 0.1 s, for these formats alone
    from meshio._mesh import topological_dimension  # noqa: PLC0415

    for kind in _FORGOTTEN:
        topological_dimension.setdefault(kind, 3)
    if path.suffix.lower() not in (".bdf", ".fem", ".nas"):
        return meshio.read(path)
    deck = path.read_text(encoding="utf-8", errors="replace")
    if re.search(r"^ENDDATA", deck, re.MULTILINE) is None:
        raise Refused("mesh-truncated", "the file has no ENDDATA", "copy the whole file")
    if re.search(r"^BEGIN BULK", deck, re.MULTILINE) is None:
        deck = "BEGIN BULK\n" + deck
    return meshio.read(io.StringIO(deck), file_format="nastran")


@contextlib.contextmanager
def _silence(printed: io.StringIO) -> Iterator[None]:
    """Catch what is printed or warned of."""
    with (
        contextlib.redirect_stdout(printed),
        contextlib.redirect_stderr(printed),
        warnings.catch_warnings(),
        np.errstate(all="ignore"),
    ):
        warnings.simplefilter("ignore")
        yield


def _unreadable(path: Path, error: BaseException, printed: str) -> Refused:
    """The refusal of a file on which meshio failed."""
    if isinstance(error, MemoryError):
        message = "the file announces more data than there is memory for"
        return Refused("mesh-malformed", message, "it is damaged, or mesh more coarsely")
    reason = " ".join(printed.split()) if isinstance(error, SystemExit) else f"{error}"
    if path.suffix.lower() in (".xdmf", ".xmf") and isinstance(error, KeyError):
        reason = "second-order cells mixed with others are not read from XDMF, nor unknown kinds"
    detail = f" ({reason[:200]})" if reason.strip() else ""
    return Refused(
        "mesh-malformed",
        f"the file cannot be read as {path.suffix}{detail}",
        "it is damaged or of another format: write it again, best as .msh with gmsh",
    )


def _raw(mesh: meshio.Mesh) -> RawMesh:
    """The mesh as meshio has it, as ours."""
    points = np.asarray(mesh.points, dtype=np.float64)
    if points.ndim != 2 or points.shape[1] not in (2, 3):
        raise Refused(
            "mesh-malformed", "the nodes do not have 2 or 3 coordinates", "write it again"
        )
    numbers = _numbers(mesh)
    cells = tuple(map(_cells, mesh.cells, numbers))
    groups: dict[str, list[Ints]] = defaultdict(list)
    for read in (_array_groups, _family_groups, _set_groups):
        for name, where in read(mesh):
            groups[name].append(where)
    return RawMesh(points, cells, groups=join(groups), node_groups=_node_groups(mesh))


def _numbers(mesh: meshio.Mesh) -> list[Ints]:
    """Numbers of the cells of each block: of the file (Nastran), else counted from 1."""
    ids = getattr(mesh, "cells_id", None)
    if ids is not None:
        return [np.asarray(block, dtype=np.int64) for block in ids]
    return [np.arange(span.start, span.stop) + 1 for _, span in spans(mesh.cells)]


def _cells(block: meshio.CellBlock, numbers: Ints) -> RawCells:
    """A block of cells."""
    kind = _KINDS.get(block.type, block.type)
    dim = CELLS[kind].dim if kind in CELLS else int(block.dim)
    if block.type.startswith("polyhedron"):
        return RawCells(kind, dim, np.zeros((len(block), 1), dtype=np.int64), numbers)
    return RawCells(kind, dim, np.asarray(block.data).astype(np.int64), numbers)


def _array_groups(mesh: meshio.Mesh) -> Iterator[tuple[str, Ints]]:
    """Groups by the numbers in an array on the cells, with names where the file has them."""
    key = None if hasattr(mesh, "cell_tags") else _group_array(mesh)
    if key is None:
        return
    names = _field_names(mesh.field_data)
    for (block, span), values in zip(spans(mesh.cells), mesh.cell_data[key], strict=True):
        for tag, where in split_by(np.asarray(values).ravel().astype(np.int64)):
            if tag or key not in _NO_GROUP_0:
                yield names.get((int(block.dim), tag), str(tag)), span.start + where


def _group_array(mesh: meshio.Mesh) -> str | None:
    """The array on the cells that gives the groups (see `GROUP_ARRAYS`)."""
    whole = [str(key) for key, parts in mesh.cell_data.items() if all(map(_is_whole, parts))]
    by_name = {key.lower(): key for key in whole}
    for name in GROUP_ARRAYS:
        if name.lower() in by_name:
            return by_name[name.lower()]
    integer = [k for k in whole if k != "gmsh:geometrical" and _is_integer(mesh.cell_data[k])]
    return integer[0] if len(integer) == 1 else None


def _is_whole(values: np.ndarray) -> bool:
    """One whole number per cell, also if it is stored as a float."""
    flat = np.asarray(values)
    if flat.dtype.kind not in "iuf" or flat.size != len(flat):
        return False
    return bool(np.all(np.abs(flat) < 2**53) and np.all(flat == np.round(flat)))


def _is_integer(parts: list[np.ndarray]) -> bool:
    return all(np.asarray(part).dtype.kind in "iu" for part in parts)


def _field_names(field_data: Mapping[str, np.ndarray]) -> dict[tuple[int, int], str]:
    """Names of physical groups by dimension and tag, as meshio's files keep them."""
    pairs = ((name, np.asarray(value)) for name, value in field_data.items())
    tags = {n: v.ravel() for n, v in pairs if v.size == 2 and v.dtype.kind in "iu"}
    return {(int(value[1]), int(value[0])): name for name, value in tags.items()}


def _family_groups(mesh: meshio.Mesh) -> Iterator[tuple[str, Ints]]:
    """Groups of a MED file: each cell has a family, and each family some names."""
    families = getattr(mesh, "cell_tags", None) or {}
    tags = mesh.cell_data.get("cell_tags", ())
    for (_, span), values in zip(spans(mesh.cells), tags, strict=False):
        for family, where in split_by(np.asarray(values).ravel().astype(np.int64)):
            for name in families.get(family, ()):
                yield name, span.start + where


def _set_groups(mesh: meshio.Mesh) -> Iterator[tuple[str, Ints]]:
    """Groups that meshio itself knows as sets of cells."""
    for name, parts in mesh.cell_sets.items():
        for (_, span), where in zip(spans(mesh.cells), parts, strict=False):
            if where is not None and not name.startswith("gmsh:"):
                yield name, span.start + np.asarray(where, dtype=np.int64)


def _node_groups(mesh: meshio.Mesh) -> dict[str, Ints]:
    """Sets of nodes, and groups of nodes of a MED file."""
    groups: dict[str, list[Ints]] = defaultdict(list)
    for name, where in mesh.point_sets.items():
        groups[name].append(np.asarray(where, dtype=np.int64))
    families = getattr(mesh, "point_tags", None) or {}
    tags = np.asarray(mesh.point_data.get("point_tags", ()), dtype=np.int64)
    for family, where in split_by(tags):
        for name in families.get(family, ()):
            groups[name].append(where)
    return join(groups)
