"""The response surfaces of a table of runs: how well they foretell runs that are left out."""

from __future__ import annotations

from typing import Any

from geoident.model.results.surface import SurfaceTable
from geoident.report.text.layout import TextTable
from geoident.report.text.rows import attributes, objects
from geoident.units import in_unit, shown_unit

TITLE = "Response surfaces"

_MOST = 12
"""Rows of the table; of more readings the worst are shown."""


def surface_table(found: SurfaceTable | None) -> TextTable:
    """A row for each reading, in its unit, the worst first; of many only these."""
    header = ("reading", "surface", "left out", "here", "accuracy", "unit")
    if found is None:
        return TextTable(header, (), "llrrrl")
    share = (found.left_out / found.accuracy).tolist()
    rows = sorted(range(len(found)), key=lambda k: -share[k])[:_MOST]
    several = len(set(found.stages)) > 1
    return TextTable(header, [_row(found, k, several=several) for k in rows], "llrrrl")


def _row(found: SurfaceTable, k: int, *, several: bool) -> tuple[str, ...]:
    unit = found.units[k], found.dimensions[k]
    numbers = (
        f"{in_unit(float(values[k]), *unit):.2g}"
        for values in (found.left_out, found.own, found.accuracy)
    )
    name = f"{found.channels[k]} at {found.stages[k]}" if several else found.channels[k]
    return (name, found.words[k], *numbers, shown_unit(*unit))


def surface_words(found: SurfaceTable | None) -> str:
    """What the columns of the table are, in a sentence; empty where there is none."""
    if found is None:
        return ""
    more = f" The {_MOST} largest of {len(found)} readings." if len(found) > _MOST else ""
    return (
        f"Through {found.runs} runs of {found.file}. left out: root mean square leave-one-out "
        "error; here: standard deviation of the surface at these parameters."
        f"{more}"
    )


def surface_object(found: SurfaceTable) -> dict[str, Any]:
    """The surfaces for other programs, SI."""
    return {**attributes(found), "readings": objects(found, "column")}
