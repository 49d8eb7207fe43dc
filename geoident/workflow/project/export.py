"""Tables of the result of a project as files."""

from __future__ import annotations

from collections.abc import Mapping
from functools import partial
from pathlib import Path

from geoident.io.text.atomic import atomic_output
from geoident.model.results.many.project import ProjectResult
from geoident.workflow.export import ListedFiles, Writer, export_folder, stem
from geoident.workflow.running.result_files import case_path


def export_project(
    path: str, result: ProjectResult, texts: Mapping[str, str], *, output: str | None, force: bool
) -> tuple[str, ...]:
    """Write tables, ``FOLDER/RESULT.TABLE.csv``, and ``RESULT.sha256``, the list of them.

    Args:
        path: of the result.
        result: what it holds.
        texts: name of a table to its text.
        output: the folder; None for ``RESULT.export`` beside the result.
        force: replace any other files of these names.

    Returns:
        The files.

    Raises:
        OutputError: one of them exists, is an input, or cannot be written; none is there then.
    """
    folder = export_folder(path, output)
    project = case_path(path, result.provenance.case_file)
    writers: dict[Path, Writer] = {
        folder / f"{stem(path)}.{name}.csv": partial(_write, text) for name, text in texts.items()
    }
    files = ListedFiles(
        folder=folder,
        stem=stem(path),
        case=project,
        inputs=(path, project),
        identity=result.provenance.identity,
        overwrite=force,
    )
    return files.write(writers)


def write_project_table(
    path: str, result: ProjectResult, text: str, *, output: str, force: bool
) -> None:
    """Write one table to a file that the user has named.

    Args:
        path: of the result.
        result: what it holds.
        text: of the table.
        output: the file.
        force: replace another one.

    Raises:
        OutputError: another file is there, it is an input, or cannot be written.
    """
    inputs = (path, case_path(path, result.provenance.case_file))
    with atomic_output(output, overwrite=force, inputs=inputs) as part:
        _write(text, part)


def _write(text: str, part: str) -> None:
    Path(part).write_text(text, encoding="utf-8", newline="")
