"""The runs of a campaign in one table: from its journal, and into its files."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from datetime import UTC, datetime
from pathlib import Path

from geoident.errors import Fault, InputError, Location
from geoident.io.result.campaign import CampaignHead, read_journal, write_over_all
from geoident.io.text.atomic import atomic_output
from geoident.io.text.campaign_folder import JOURNAL, OVER_ALL, TABLE
from geoident.model.results.many.campaign import CampaignTable, RunRecord
from geoident.workflow.executing.versions import versions
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
