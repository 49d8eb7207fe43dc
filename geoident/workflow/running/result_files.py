"""The files that a result came from, as seen from where it lies."""

from __future__ import annotations

import os
from pathlib import Path

from geoident.io.case.file import files_of_text
from geoident.io.mesh.file import mesh_files
from geoident.model.results.result import Result


def files_of_result(result: Result, path: str) -> tuple[str, ...]:
    """Paths of a result, of its case and of all files that the case names, as far as they exist.

    Args:
        result: holds the case.
        path: of its file.
    """
    case = case_path(path, result.provenance.case_file)
    texts = (result.case_text, result.case_resolved)
    named = [name for text in texts for name in files_of_text(text, case)]
    return tuple(dict.fromkeys((path, case, *(part for n in named for part in mesh_files(n)))))


def case_path(output: Path | str, case_file: str) -> str:
    """The case that a result was made from, as seen from here."""
    if Path(case_file).is_absolute():
        return case_file
    return os.path.normpath(Path(output).parent / case_file)
