"""The result of several sections as HDF5: one group a table, described in docs/result_file.md."""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import suppress
from pathlib import Path

from geoident.errors import InputError
from geoident.io.result.file import PROJECT_FORMAT
from geoident.io.result.hdf5 import hdf5_input, hdf5_output, refusal
from geoident.io.result.records import read_record, write_record
from geoident.io.text.atomic import atomic_output
from geoident.model.results.many.project import ProjectResult


def write_project_result(
    result: ProjectResult, path: str | Path, *, overwrite: bool, inputs: Sequence[str] = ()
) -> tuple[str, ...]:
    """Write the result of a project.

    Args:
        result: what to write.
        path: of the file.
        overwrite: replace an existing file.
        inputs: paths of what the command has read, which are never replaced.

    Returns:
        The path written.

    Raises:
        OutputError: the file exists or cannot be written.
    """
    with (
        atomic_output(path, overwrite=overwrite, inputs=inputs) as temporary,
        hdf5_output(temporary) as file,
    ):
        file.attrs["format"] = PROJECT_FORMAT
        file.attrs["kind"] = "fit"
        write_record(file, result, labels={}, units={})
    return (str(path),)


def is_project_result(path: str | Path) -> bool:
    """Whether a file is the result of several sections."""
    with suppress(InputError, OSError, ValueError), hdf5_input(path) as file:
        return str(file.attrs.get("format", "")).startswith("geoident-project-result/")
    return False


def read_project_result(path: str | Path) -> ProjectResult:
    """Read back what `write_project_result` wrote.

    Raises:
        InputError: no such file, not such a result, of a version this program does not know, or
            damaged.
    """
    with hdf5_input(path) as file:
        stored = file.attrs.get("format")
        if stored != PROJECT_FORMAT:
            message = f"format {stored!r} is not known; expected {PROJECT_FORMAT!r}"
            hint = "read it with the version of geoident that wrote it, or run the command again"
            raise refusal(path, "unknown-format", message, hint)
        return read_record(file, ProjectResult)
