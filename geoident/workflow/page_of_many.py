"""The page of what many cases make together: of a campaign, or of a project."""

from __future__ import annotations

import os
from collections.abc import Callable, Sequence
from pathlib import Path

from geoident.errors import UsageError
from geoident.io.result.campaign import is_campaign
from geoident.io.result.project import is_project_result, read_project_result
from geoident.model.results.many.campaign import CampaignTable
from geoident.model.results.many.project import ProjectResult
from geoident.workflow.campaign.runs import PAGE, read_runs
from geoident.workflow.running.remade import place_of_page, write_remade
from geoident.workflow.running.result_files import case_path


def kind_of_many(paths: Sequence[str]) -> str:
    """What a path is of, if it is of many cases: a campaign or a project; empty for results.

    Raises:
        UsageError: it is named together with others, which its page does not show.
    """
    kinds = (("campaign", is_campaign), ("project", is_project_result))
    kind = next((kind for kind, is_one in kinds if any(map(is_one, paths))), "")
    if kind and len(paths) > 1:
        raise UsageError(f"A {kind} has a page of its own: report it alone.")
    return kind


def write_page_of_many(
    path: str,
    output: str | None,
    *,
    force: bool,
    logo: str,
    render: Callable[[CampaignTable | ProjectResult], str],
) -> str:
    """Write the page of a campaign or a project; an earlier one of it gives way.

    Args:
        path: of the folder of a campaign, of a file in it, or of the result of a project.
        output: where it goes; None for ``report.html`` in the folder, or beside the result.
        force: replace any other file.
        logo: path of the file of a logo, which is not to be replaced; empty for none.
        render: makes the page.

    Returns:
        Its path.

    Raises:
        InputError: there is no campaign, or the result is missing or damaged.
        UsageError: it would go to stdout.
        OutputError: something else stands there, or it cannot be written.
    """
    target = Path(path)
    content: CampaignTable | ProjectResult
    if is_campaign(path):
        folder = target if target.is_dir() else target.parent
        place = place_of_page(output, folder / PAGE)
        content = read_runs(path)
        named = (content.campaign_file, content.case_file)
        files = tuple(os.path.normpath(folder / name) for name in named)
    else:
        place = place_of_page(output, target.with_suffix(".html"))
        content = read_project_result(path)
        files = (case_path(path, content.provenance.case_file), path)
    inputs = (*files, logo) if logo else files
    page = {str(place): render(content).encode()}
    write_remade(page, cases=files[:1], force=force, inputs=inputs, form="html")
    return str(place)
