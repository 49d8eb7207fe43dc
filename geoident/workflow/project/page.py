"""The page of a project beside its result."""

from __future__ import annotations

from pathlib import Path

from geoident.errors import Term, UsageError
from geoident.io.text.text_file import STDIN
from geoident.workflow.running.remade import write_remade
from geoident.workflow.running.result_files import case_path


def write_project_page(
    path: str, project_file: str, content: str, output: str | None, *, force: bool
) -> str:
    """Write the page of a project; an earlier one of it gives way.

    Args:
        path: of the result.
        project_file: of the project, as seen from the result.
        content: of the page.
        output: where it goes; None for beside the result.
        force: replace any other file.

    Returns:
        Its path.

    Raises:
        UsageError: it would go to stdout.
        OutputError: something else stands there, or it cannot be written.
    """
    if output == STDIN:
        raise UsageError(f"A page cannot be written to stdout: give a file to {Term.OUTPUT}.")
    beside = Path(path).with_suffix(".html")
    place = beside if output is None else Path(output)
    place = place / beside.name if place.is_dir() else place
    project = case_path(path, project_file)
    write_remade({str(place): content.encode()}, cases=(project,), force=force,
                 inputs=(path, project), form="html")  # fmt: skip
    return str(place)
