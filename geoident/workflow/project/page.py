"""The page of a project beside its result."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path

from geoident.io.result.project import read_project_result
from geoident.model.results.project import ProjectResult
from geoident.workflow.running.remade import place_of_page, write_remade
from geoident.workflow.running.result_files import case_path


def write_project_page(
    path: str,
    output: str | None,
    *,
    force: bool,
    inputs: Sequence[str] = (),
    render: Callable[[ProjectResult], str],
) -> str:
    """Write the page of a project; an earlier one of it gives way.

    Args:
        path: of the result.
        output: where it goes; None for beside the result.
        force: replace any other file.
        inputs: files beside the project and its result that are not to be replaced.
        render: makes the page.

    Returns:
        Its path.

    Raises:
        InputError: the result is missing or damaged.
        UsageError: it would go to stdout.
        OutputError: something else stands there, or it cannot be written.
    """
    place = place_of_page(output, Path(path).with_suffix(".html"))
    result = read_project_result(path)
    project = case_path(path, result.provenance.case_file)
    write_remade({str(place): render(result).encode()}, cases=(project,), force=force,
                 inputs=(path, project, *inputs), form="html")  # fmt: skip
    return str(place)
