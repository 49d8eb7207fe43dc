"""A case that was read, for those who need nothing of what reads cases."""

from __future__ import annotations

from dataclasses import dataclass

from geoident.model.case import Case


@dataclass(frozen=True)
class LoadedCase:
    """A case and the texts that it comes from.

    Args:
        case: the case.
        text: the file verbatim.
        resolved: the same as YAML with overrides and defaults filled in, without comments.
        mesh_path: path of the mesh, relative paths against the folder of the case; None for none.
        readings_paths: paths of the files of readings, in their order.
        files: paths of all files that the case names, with overrides or without, and that exist.
        computed: what is resolved, without what no computation sees; the same as resolved if empty.
    """

    case: Case
    text: str
    resolved: str
    mesh_path: str | None
    readings_paths: tuple[str, ...]
    files: tuple[str, ...] = ()
    computed: str = ""
