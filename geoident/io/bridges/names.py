"""Names of readings, gauges and parameters as other programs take them.

They know neither blanks nor letters beyond ASCII, and mostly do not tell small letters from
capitals: names are in small letters, and no two are the same.
"""

from __future__ import annotations

import re
import unicodedata
from collections.abc import Iterable, Sequence

_OTHER = re.compile(r"[^a-z0-9._]+")
LONGEST = 150
"""Characters: PEST++ takes 200."""


def plain(text: str) -> str:
    """A text of small letters, digits, points, underscores and hyphens.

    >>> plain("Köln 7, Süd")
    'koln-7-sud'
    """
    letters = unicodedata.normalize("NFKD", text).encode("ascii", "ignore").decode().lower()
    return _OTHER.sub("-", letters).strip("-")[:LONGEST] or "x"


def unique(names: Iterable[str]) -> tuple[str, ...]:
    """Names of which no two are the same, in their order.

    >>> unique(["e", "k0", "e"])
    ('e', 'k0', 'e_2')
    """
    names = tuple(names)
    taken: dict[str, None] = {}
    for name in names:
        number, free = 1, name
        while free in taken or (number > 1 and free in names):
            number += 1
            free = f"{name}_{number}"
        taken[free] = None
    return tuple(taken)


def reading_names(pairs: Sequence[tuple[str, str]]) -> tuple[str, ...]:
    """The name of each reading: that of its channel and of its stage.

    Args:
        pairs: channel and stage of each.

    >>> reading_names([("EX1.a5", "bench 1"), ("CV", "bench 1")])
    ('ex1.a5_bench-1', 'cv_bench-1')
    """
    return unique(f"{plain(channel)}_{plain(stage)}" for channel, stage in pairs)
