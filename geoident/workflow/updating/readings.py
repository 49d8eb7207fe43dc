"""What has changed in the readings of a case since a fit has used them."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Callable, Hashable
from dataclasses import dataclass

import numpy as np

from geoident.io.text.dates import date_text
from geoident.model.gauges import ReadingTable


@dataclass(frozen=True)
class ReadingChanges:
    """Readings that a fit uses now, held against those that it used before.

    Args:
        new: rows of the table as it is now that were not used before. Of a stage of which one
            reading counts, a later one in its place is new as well.
        changed: rows of the table as it is now whose value has changed.
        removed: rows of the table before that are not used any more.
    """

    new: tuple[int, ...] = ()
    changed: tuple[int, ...] = ()
    removed: tuple[int, ...] = ()

    def __bool__(self) -> bool:
        return bool(self.new or self.changed or self.removed)


def compared_readings(before: ReadingTable, now: ReadingTable) -> ReadingChanges:
    """What has changed among the used readings.

    A reading is the same where channel, stage, time and value (to 12 digits) are: neither its row
    nor its file matters.

    Args:
        before: of the fit.
        now: of the case.
    """
    old, here = ({*table.used.nonzero()[0].tolist()} for table in (before, now))

    def place(table: ReadingTable, k: int) -> Hashable:
        return table.channel[k], table.stage[k]

    def moment(table: ReadingTable, k: int) -> Hashable:
        return place(table, k), f"{table.time[k]:.3f}"  # so that NaN equals NaN

    def whole(table: ReadingTable, k: int) -> Hashable:
        return moment(table, k), f"{table.value[k]:.12g}"

    def paired(key: Callable[[ReadingTable, int], Hashable], *, single: bool) -> list[int]:
        """Rows of now that take the place of one before; neither is asked for again."""
        known, asked = defaultdict(list), defaultdict(list)
        for k in sorted(old):
            known[key(before, k)].append(k)
        for k in sorted(here):
            asked[key(now, k)].append(k)
        pairs = [
            pair
            for at, rows in asked.items()
            if not single or (len(rows) == 1 and len(known.get(at, ())) == 1)
            for pair in zip(known.get(at, ()), rows, strict=False)
        ]
        old.difference_update(k for k, _ in pairs)
        here.difference_update(row for _, row in pairs)
        return [row for _, row in pairs]

    paired(whole, single=False)
    changed = paired(moment, single=False)
    later = paired(place, single=True)
    return ReadingChanges(
        new=tuple(sorted([*here, *later])),
        changed=tuple(sorted(changed)),
        removed=tuple(sorted(old)),
    )


def change_words(changes: ReadingChanges, before: ReadingTable, now: ReadingTable) -> str:
    """Readings that have changed or gone, in words; empty where there are none."""
    sentences = []
    for table, rows, what in (
        (now, changes.changed, "changed since the last result"),
        (before, changes.removed, "not used any more"),
    ):
        if rows:
            names = [_name(table, k) for k in rows]
            more = f" and {len(names) - _NAMED} more" if len(names) > _NAMED else ""
            verb = "reading has" if len(rows) == 1 else "readings have"
            verb = verb if table is now else verb.replace("has", "is").replace("have", "are")
            sentences.append(f"{len(rows)} {verb} {what}: {', '.join(names[:_NAMED])}{more}.")
    return " ".join(sentences)


_NAMED = 6


def _name(table: ReadingTable, k: int) -> str:
    """A reading by its channel and date, or its stage where no date is known."""
    dated = np.isfinite(table.time[k])
    when = f"on {date_text(float(table.time[k]))}" if dated else f"at {table.stage[k]}"
    return f"{table.channel[k]} {when}"
