"""How far ground yields: a table, a sentence, and the same for JSON."""

from __future__ import annotations

import math

from geoident.model.results.yielded import YieldedGround
from geoident.report.text.layout import TextTable, number

NAME = "Yielded ground"
UNITS = "All that has yielded so far; lengths in m, to the strain points"
TITLE = f"{NAME} ({UNITS[0].lower()}{UNITS[1:]})"

_DIGITS = 3


def extent_table(found: YieldedGround | None) -> TextTable:
    """One row for each state in which something has yielded; columns that say nothing left out."""
    if found is None:
        return TextTable(("stage",), [])
    axes = "xyz"[: found.lower.shape[1]]
    rows = [j for j, volume in enumerate(found.volume) if volume > 0.0]
    columns = {
        "stage": [found.states[j] for j in rows],
        found.unit: [number(float(found.volume[j]), _DIGITS) for j in rows],
        "of the ground": [_per_cent(found.share[j]) for j in rows],
    }
    for title, distance in (("from the wall", found.reach), ("from the centre", found.radius)):
        if any(math.isfinite(distance[j]) for j in rows):
            columns[title] = [number(float(distance[j]), _DIGITS) for j in rows]
    for k, axis in enumerate(axes):
        ends = [(float(found.lower[j, k]), float(found.upper[j, k])) for j in rows]
        columns[axis] = [f"{number(a, _DIGITS)} to {number(b, _DIGITS)}" for a, b in ends]
    cells = [list(row) for row in zip(*columns.values(), strict=True)]
    return TextTable(tuple(columns), cells, right="l" + "r" * (len(columns) - 1))


def extent_sentence(found: YieldedGround | None) -> str:
    """The stage in which most has yielded, in one sentence; empty where nothing does."""
    most = None if found is None else found.most
    if found is None or most is None:
        return ""
    text = f"Yielded ground: {number(float(found.volume[most]), _DIGITS)} {found.unit} "
    text += f"({_per_cent(found.share[most])}) at stage '{found.states[most]}'"
    if math.isfinite(found.radius[most]):
        text += f", up to {number(float(found.radius[most]), _DIGITS)} m from the centre"
    elif math.isfinite(found.reach[most]):
        text += f", up to {number(float(found.reach[most]), _DIGITS)} m from the excavation"
    return text + "."


def _per_cent(share: float) -> str:
    return f"{number(100.0 * float(share), 2)} %"
