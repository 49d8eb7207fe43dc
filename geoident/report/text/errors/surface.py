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


def surface_table(surface: SurfaceTable | None) -> TextTable:
    """A row for each reading, in its unit, the worst first; of many only these."""
    header = ("reading", "surface", "left out", "here", "accuracy", "unit")
    if surface is None:
        return TextTable(header, (), "llrrrl")
    share = (surface.left_out / surface.accuracy).tolist()
    rows = sorted(range(len(surface)), key=lambda k: -share[k])[:_MOST]
    several = len(set(surface.stages)) > 1
    return TextTable(header, [_row(surface, k, several=several) for k in rows], "llrrrl")


def _row(surface: SurfaceTable, k: int, *, several: bool) -> tuple[str, ...]:
    unit = surface.units[k], surface.dimensions[k]
    numbers = (
        f"{in_unit(float(values[k]), *unit):.2g}"
        for values in (surface.left_out, surface.own, surface.accuracy)
    )
    name = f"{surface.channels[k]} at {surface.stages[k]}" if several else surface.channels[k]
    return (name, surface.words[k], *numbers, shown_unit(*unit))


def surface_words(surface: SurfaceTable | None) -> str:
    """What the columns of the table are, in a sentence; empty where there is none."""
    if surface is None:
        return ""
    more = f" The {_MOST} largest of {len(surface)} readings." if len(surface) > _MOST else ""
    return (
        f"Through {surface.runs} runs of {surface.file}. left out: root mean square leave-one-out "
        "error; here: standard deviation of the surface at these parameters."
        f"{more}"
    )


def surface_object(surface: SurfaceTable) -> dict[str, Any]:
    """The surfaces for other programs, SI."""
    return {**attributes(surface), "readings": objects(surface, "column")}
