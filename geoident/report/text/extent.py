"""How far ground yields: a table, a sentence, and the same for JSON."""

from __future__ import annotations

import math

from geoident.model.results.yielded import YieldedGround
from geoident.report.text.layout import TextTable, number

NAME = "Yielded ground"
UNITS = "All that has yielded so far; lengths in m, to the strain points"
TITLE = f"{NAME} ({UNITS[0].lower()}{UNITS[1:]})"

_DIGITS = 3


def extent_table(yielded: YieldedGround | None) -> TextTable:
    """One row for each state in which something has yielded; columns that say nothing left out."""
    if yielded is None:
        return TextTable(("stage",), [])
    axes = "xyz"[: yielded.lower.shape[1]]
    rows = [j for j, volume in enumerate(yielded.volume) if volume > 0.0]
    columns = {
        "stage": [yielded.states[j] for j in rows],
        yielded.unit: [number(float(yielded.volume[j]), _DIGITS) for j in rows],
        "of the ground": [_per_cent(yielded.share[j]) for j in rows],
    }
    for title, distance in (("from the wall", yielded.reach), ("from the centre", yielded.radius)):
        if any(math.isfinite(distance[j]) for j in rows):
            columns[title] = [number(float(distance[j]), _DIGITS) for j in rows]
    for k, axis in enumerate(axes):
        ends = [(float(yielded.lower[j, k]), float(yielded.upper[j, k])) for j in rows]
        columns[axis] = [f"{number(a, _DIGITS)} to {number(b, _DIGITS)}" for a, b in ends]
    cells = [list(row) for row in zip(*columns.values(), strict=True)]
    return TextTable(tuple(columns), cells, right="l" + "r" * (len(columns) - 1))


def extent_sentence(yielded: YieldedGround | None) -> str:
    """The stage in which most has yielded, in one sentence; empty where nothing does."""
    most = None if yielded is None else yielded.most
    if yielded is None or most is None:
        return ""
    text = f"Yielded ground: {number(float(yielded.volume[most]), _DIGITS)} {yielded.unit} "
    text += f"({_per_cent(yielded.share[most])}) at stage '{yielded.states[most]}'"
    if math.isfinite(yielded.radius[most]):
        text += f", up to {number(float(yielded.radius[most]), _DIGITS)} m from the centre"
    elif math.isfinite(yielded.reach[most]):
        text += f", up to {number(float(yielded.reach[most]), _DIGITS)} m from the excavation"
    return text + "."


def _per_cent(share: float) -> str:
    return f"{number(100.0 * float(share), 2)} %"
