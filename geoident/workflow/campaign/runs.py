"""The runs of a campaign in one table: from its journal, and into its files."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterable, Sequence
from datetime import UTC, datetime
from pathlib import Path

from geoident.errors import Fault, InputError, Location
from geoident.io.result.campaign import (
    CampaignHead,
    read_journal,
    write_over_all,
)
from geoident.io.text.atomic import atomic_output
from geoident.io.text.campaign_folder import JOURNAL, OVER_ALL, TABLE
from geoident.model.results.campaign import CampaignTable, RunRecord
from geoident.workflow.running.jobs import versions
from geoident.workflow.running.remade import place_of_page, write_remade
from geoident.workflow.running.result_files import case_path, outdated_words

PAGE = "report.html"
"""Name of the page of a campaign, in its folder."""


def table_of(
    head: CampaignHead, records: Iterable[RunRecord], *, outdated: str = ""
) -> CampaignTable:
    """The runs of a campaign as a table.

    Args:
        head: of the campaign.
        records: of the runs that have ended.
        outdated: a sentence where they were made from an earlier fit than its file holds now.
    """
    return CampaignTable(
        title=head.title,
        command=head.command,
        campaign_file=head.campaign_file,
        case_file=head.case_file,
        paths=head.paths,
        runs=tuple(records),
        total=head.total,
        versions=versions(),
        created=datetime.now(UTC).isoformat(timespec="seconds"),
        outdated=outdated,
    )


def write_tables(
    table: CampaignTable,
    folder: Path,
    csv: Callable[[CampaignTable], str],
    *,
    inputs: tuple[str, ...],
) -> None:
    """Write ``runs.csv`` and ``campaign.h5``.

    Args:
        table: of the runs.
        folder: of the campaign.
        csv: makes the text of the former.
        inputs: paths that were read, and so must not be written.
    """
    with atomic_output(folder / TABLE, overwrite=True, inputs=inputs) as temporary:
        Path(temporary).write_text(csv(table), encoding="utf-8")
    write_over_all(table, folder / OVER_ALL, inputs=inputs)


def read_runs(path: str) -> CampaignTable:
    """All runs of a campaign that have ended, from its folder; of one that still runs as well.

    Args:
        path: of the folder, or of a file in it.

    Raises:
        InputError: there is no journal of a campaign.
    """
    place = Path(path)
    folder = place if place.is_dir() else place.parent
    head, records = read_journal(folder)
    if head is None:
        message = f"the folder has no journal of a campaign ({JOURNAL})"
        hint = "Give the folder that `geoident batch` has written, such as CAMPAIGN.batch."
        raise InputError([Fault("no-campaign", message, hint, Location(str(folder)))])
    return table_of(
        head, sorted(records, key=lambda record: record.name), outdated=_outdated(head, folder)
    )


def _outdated(head: CampaignHead, folder: Path) -> str:
    """Whether the fit that is predicted from has changed since."""
    if not head.fit_file:
        return ""
    fit, campaign = (case_path(folder / PAGE, name) for name in (head.fit_file, head.campaign_file))
    return outdated_words(fit, head.fit_fingerprint, f"geoident batch {campaign}")


def write_campaign_page(
    path: str,
    output: str | None,
    *,
    force: bool,
    inputs: Sequence[str] = (),
    render: Callable[[CampaignTable], str],
) -> str:
    """Write the page of a campaign; an earlier one of it gives way.

    Args:
        path: of its folder, or of a file in it.
        output: where it goes; None for ``report.html`` in the folder.
        force: replace any other file.
        inputs: files beside the campaign and its case that are not to be replaced.
        render: makes the page.

    Returns:
        Its path.

    Raises:
        InputError: there is no campaign.
        UsageError: it would go to stdout.
        OutputError: something else stands there, or it cannot be written.
    """
    place = Path(path)
    folder = place if place.is_dir() else place.parent
    page = place_of_page(output, folder / PAGE)
    table = read_runs(path)
    named = (table.campaign_file, table.case_file)
    campaign, case = (os.path.normpath(folder / name) for name in named)
    write_remade({str(page): render(table).encode()}, cases=(campaign,), force=force,
                 inputs=(campaign, case, *inputs), form="html")  # fmt: skip
    return str(page)
