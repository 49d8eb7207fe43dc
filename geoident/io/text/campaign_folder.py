"""The files in the folder of a campaign: their names, and paths that mean them."""

from __future__ import annotations

from contextlib import suppress
from pathlib import Path

JOURNAL = "runs.jsonl"
OVER_ALL = "campaign.h5"
TABLE = "runs.csv"


def over_all_of(path: Path) -> Path | None:
    """The file over all runs of a campaign that a path means: its folder, or a file in it.

    Args:
        path: as a user names it.

    Returns:
        It, which need not be there while the campaign has not ended; None where the path means
        something else.
    """
    with suppress(OSError, ValueError):  # too long or strange for a name
        if path.is_dir():
            is_campaign = any((path / name).is_file() for name in (OVER_ALL, JOURNAL))
            return path / OVER_ALL if is_campaign else None
        beside = path.with_name(OVER_ALL)
        if path.name == OVER_ALL or (path.name in (TABLE, JOURNAL) and beside.is_file()):
            return beside
    return None
