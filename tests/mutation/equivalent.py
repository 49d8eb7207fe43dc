"""Changes that mean the same: `equivalent.toml`, and where its entries stand in the code.

An entry says of one place what it becomes, so it is of no use when its line is gone, and of harm
when the same line stands elsewhere, too: a change there would count as known. A test holds that
each entry fits one place of its file. White space does not count.
"""

from __future__ import annotations

import tomllib
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

LISTED = Path(__file__).with_name("equivalent.toml")
ANY = "*"
"""What a line becomes of which any change means the same."""


@dataclass(frozen=True)
class Place:
    """Some lines of a file in a row, without indentation.

    Attributes:
        lines: the lines, joined by blanks.
        beside: the nearest lines before and after them that are not empty.
    """

    lines: str
    beside: tuple[str, ...]


@dataclass(frozen=True)
class Same:
    """A change that means the same.

    Attributes:
        file: path of the module in the package.
        was: the lines before it, as `Place.lines`.
        became: the lines after it, or `ANY`.
        reason: why it means the same.
        beside: the line before or after, where `was` stands at several places of the file.
    """

    file: str
    was: str
    became: str
    reason: str
    beside: str = ""

    def stands_at(self, place: Place) -> bool:
        """Whether the change is of this place."""
        beside = not self.beside or _bare(self.beside) in map(_bare, place.beside)
        return _bare(self.was) == _bare(place.lines) and beside

    def is_of(self, file: str, place: Place, became: str) -> bool:
        """Whether it is what a place of a file becomes."""
        same = self.became == ANY or _bare(self.became) == _bare(became)
        return self.file == file and same and self.stands_at(place)

    def places(self, source: str) -> list[int]:
        """The lines of a source, from 1, at which the change can be made."""
        lines = [line.strip() for line in source.splitlines()]
        return [
            first + 1
            for first, line in enumerate(lines)
            if line and self._begins(lines, first) and self.stands_at(self._from(lines, first))
        ]

    def _begins(self, lines: list[str], first: int) -> bool:
        return _bare(self.was).startswith(_bare(lines[first]))

    def _from(self, lines: list[str], first: int) -> Place:
        """The shortest place from a line on that is as long as `was`."""
        size, last = 0, first
        while size < len(_bare(self.was)) and last < len(lines):
            size += len(_bare(lines[last]))
            last += 1
        return place(lines, first, last)


def place(lines: Sequence[str], first: int, last: int) -> Place:
    """The lines from `first` up to, but without, `last`."""
    beside = (_nearest(reversed(lines[:first])), _nearest(lines[last:]))
    return Place(" ".join(line.strip() for line in lines[first:last]), beside)


def listed() -> list[Same]:
    """What is written down."""
    return [Same(**entry) for entry in tomllib.loads(LISTED.read_text())["change"]]


def _nearest(lines: Iterable[str]) -> str:
    """The first that is not empty."""
    found: Iterator[str] = (line.strip() for line in lines if line.strip())
    return next(found, "")


def _bare(text: str) -> str:
    return "".join(text.split())
