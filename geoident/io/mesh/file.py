"""Reading the mesh of a case, from whatever file its generator wrote."""

from __future__ import annotations

import re
from collections.abc import Iterator
from pathlib import Path

from geoident.errors import Fault, InputError, Location
from geoident.io.mesh.abaqus import read_abaqus
from geoident.io.mesh.build import build_mesh
from geoident.io.mesh.gmsh import is_gmsh, read_gmsh
from geoident.io.mesh.other import SUFFIXES, read_other
from geoident.io.mesh.raw import RawMesh, Refused
from geoident.model.mesh import Mesh

_GEOMETRY = (".step", ".stp", ".iges", ".igs", ".brep", ".xao", ".dxf")
_REFERENCES = {
    ".inp": re.compile(r"\s*\*\s*include\s*,.*?input\s*=\s*\"?([^\",]+)", re.IGNORECASE),
    ".xdmf": re.compile(r"(?:.*>)?\s*([^\s<>:]+):/"),
    ".xmf": re.compile(r"(?:.*>)?\s*([^\s<>:]+):/"),
}
"""Suffix of a mesh to the lines by which it names files that hold a part of it."""
_PACKED = (".gz", ".zip", ".bz2", ".xz", ".7z", ".zst")


def read_mesh(path: str, *, dim: int | None) -> Mesh:
    """Read a mesh.

    The format is told by the suffix, gmsh's also by its contents: gmsh (MSH 2.2 and 4.1, text and
    binary), Abaqus (.inp), and through meshio VTU, VTK, XDMF, MED, Nastran, Medit and others (see
    `SUFFIXES` in `geoident.io.mesh.other`, and `GROUP_ARRAYS` there for what gives the groups).
    Groups carry the names of physical groups or sets, or their numbers as text.

    Args:
        path: the file.
        dim: dimensions of the analysis, 2 (z is dropped and must be constant) or 3; None for
            those of the elements of the file.

    Returns:
        The mesh, coordinates in m as in the file, nodes in VTK's order. Nodes that no element
        uses are kept.

    Raises:
        InputError: the file cannot be read, or does not hold a mesh for this analysis.
    """
    try:
        raw = _read(Path(path), dim)
        if dim is None:
            dim = 3 if any(cells.dim == 3 and len(cells) for cells in raw.cells) else 2
        return build_mesh(raw, dim=dim, file=path)
    except Refused as refused:
        place = Location(path, refused.line, 1 if refused.line else 0)
        raise InputError([Fault(refused.code, refused.message, refused.hint, place)]) from refused


def mesh_files(path: str) -> tuple[str, ...]:
    """Paths of the files that a mesh consists of: its own, and those that it includes."""
    return tuple(dict.fromkeys(_with_parts(Path(path), set())))


def _with_parts(path: Path, seen: set[Path]) -> Iterator[str]:
    yield str(path)
    pattern = _REFERENCES.get(path.suffix.lower())
    if pattern is None or path in seen:
        return
    seen.add(path)
    if not path.is_file():  # a pipe would never end
        return
    try:
        with path.open(encoding="utf-8", errors="replace") as lines:
            names = [match[1].strip() for line in lines if (match := pattern.match(line))]
    except (OSError, ValueError):
        return
    for name in names:
        yield from _with_parts(path.parent / name, seen)


def _read(path: Path, dim: int | None) -> RawMesh:
    """What the file says."""
    try:
        _check_file(path, dim)
        with path.open("rb") as stream:
            head = stream.read(4096)
        return _dispatch(path, head)
    except (OSError, ValueError) as error:
        reason = getattr(error, "strerror", None) or str(error)
        hint = "check the name, and that you may read the file"
        raise Refused("mesh-file", f"the mesh cannot be opened: {reason}", hint) from error
    except MemoryError as error:
        hint = "mesh more coarsely, or use a machine with more memory"
        raise Refused("mesh-too-large", "the mesh does not fit into memory", hint) from error


def _check_file(path: Path, dim: int | None) -> None:
    """Refuse what cannot be a mesh before it is opened."""
    if not path.exists():
        hint = "check the name; that of `mesh: {file: ...}` counts from the folder of the case"
        raise Refused("mesh-missing", "the mesh file does not exist", hint)
    if not path.is_file():
        what = "a folder" if path.is_dir() else "not an ordinary file"
        raise Refused("mesh-file", f"the mesh is {what}", "give the mesh file itself")
    if path.stat().st_size == 0:
        raise Refused("mesh-empty", "the mesh file is empty", "make or copy it again")
    for name in mesh_files(str(path))[1:]:
        if Path(name).exists() and not Path(name).is_file():
            message = f"the mesh names '{name}', which is not an ordinary file"
            raise Refused("mesh-file", message, "name the file that holds the rest of the mesh")
    suffix, mesh = path.suffix.lower(), path.with_suffix(".msh").name
    if suffix in (".geo", ".geo_unrolled", *_GEOMETRY):
        hint = f"mesh it first: gmsh -{dim or 3} {path.name} -o {mesh}"
        raise Refused("mesh-geometry", "the file holds a geometry, not a mesh", hint)
    if suffix in _PACKED:
        raise Refused("mesh-packed", "the file is packed", f"unpack {path.name} and give the mesh")


def _dispatch(path: Path, head: bytes) -> RawMesh:
    """Read with the reader of the format."""
    suffix = path.suffix.lower()
    if is_gmsh(head):
        return read_gmsh(path.read_bytes())
    if suffix == ".msh":
        message = "the file does not begin with $MeshFormat: it is not a mesh of gmsh"
        raise Refused("mesh-format", message, "write it with gmsh, or give it its proper suffix")
    if suffix == ".inp":
        text = path.read_text(encoding="utf-8", errors="replace")
        return read_abaqus(text, folder=path.parent)
    if suffix not in SUFFIXES:
        known = " ".join((".msh", ".inp", *SUFFIXES))
        message = f"the format of a mesh file {suffix or 'without suffix'} is not known"
        raise Refused("mesh-format", message, f"known are {known}; meshio can convert others")
    return read_other(path)
