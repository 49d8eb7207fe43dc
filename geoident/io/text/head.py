"""What a file is, told by its beginning or its suffix, before it is read as something else."""

from __future__ import annotations

from pathlib import Path

from geoident.errors import Fault, InputError, Location, Term

_BEGINNING = 4096
"""Bytes of a file in which its format stands."""
_HDF5 = b"\x89HDF\r\n\x1a\n"
_GMSH = b"$MeshFormat"
_MESHES = frozenset(
    {".msh", ".inp", ".vtu", ".vtk", ".xdmf", ".xmf", ".med", ".bdf", ".nas", ".mesh", ".unv"}
)
_TABLES = frozenset({".csv", ".tsv", ".ags", ".xlsx", ".xlsm", ".xls", ".ods"})


def said_format(path: str | Path) -> str:
    """The format that a file says to have, such as ``geoident-case/1``; empty where it says none.

    Args:
        path: the file, which need not be there.
    """
    try:
        if not Path(path).is_file():  # a pipe would wait for who writes into it
            return ""
        with Path(path).open("rb") as file:
            return _format_in(file.read(_BEGINNING))
    except (OSError, ValueError):
        return ""


def refuse_no_case(content: bytes, path: str) -> None:
    """Refuse a mesh, a table or a result that stands in the place of a case.

    Args:
        content: of the file.
        path: of the file.

    Raises:
        InputError: with one fault, if it is one of these.
    """
    suffix = Path(path).suffix.lower()
    if _format_in(content[:_BEGINNING]):
        return
    if content.startswith(_HDF5):
        kind = "an HDF5 file, such as a result"
        hint = "A result is for `geoident show`; give the case that it was made of."
    elif content.lstrip().startswith(_GMSH) or suffix in _MESHES:
        kind = "a mesh"
        hint = f"{Term.INIT_FROM} writes a case for it, to be filled in."
    elif suffix in _TABLES:
        kind = "a table"
        hint = "Readings are named by a case: 'readings: NAME'; give that case."
    else:
        return
    message = f"this file is {kind}; expected a case"
    raise InputError([Fault("other-kind", message, hint, Location(path))])


def _format_in(head: bytes) -> str:
    """The value of the key `format` at the beginning of a text; empty where it has none."""
    lines = head.decode("utf-8", "replace").splitlines()
    formats = [line.partition(":")[2].strip(" '\"") for line in lines if line.startswith("format:")]
    return formats[0] if formats else ""
