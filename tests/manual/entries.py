"""The entries of the verification manual: what is compared with what (``entries.yaml``)."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import yaml


@dataclass(frozen=True)
class Entry:
    """One comparison.

    Attributes:
        title: heading.
        about: what is computed.
        source: of what is exact.
        quantity: that is compared, with its unit.
        scale: from SI to that unit.
        x: what stands in the first column.
        allowed: what the test demands.
    """

    title: str
    about: str
    source: str
    quantity: str
    scale: float
    x: str
    allowed: str


@dataclass(frozen=True)
class Chapter:
    """A page of entries."""

    title: str
    about: str
    entries: dict[str, Entry]


def _read() -> dict[str, Chapter]:
    text = Path(__file__).with_suffix(".yaml").read_text(encoding="utf-8")
    return {
        name: Chapter(
            given["title"],
            given["about"],
            {key: Entry(**entry) for key, entry in given["entries"].items()},
        )
        for name, given in yaml.safe_load(text).items()
    }


CHAPTERS = _read()
ENTRIES = {name: entry for chapter in CHAPTERS.values() for name, entry in chapter.entries.items()}
