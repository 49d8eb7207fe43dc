"""Readings of sections that took no part in a fit, with their bands."""

from __future__ import annotations

import math
from collections.abc import Sequence

from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator

from geoident.model.results.many.project import SectionReading
from geoident.report.drawing.style import (
    ACCENT,
    COMPUTED,
    MEASURED,
    SMALL,
    Picture,
    key,
    paged,
    panel_grid,
    short,
)
from geoident.units import in_unit, shown_unit

_PANELS = 9
_READINGS = 40
"""Readings in a panel."""


def reading_pictures(rows: Sequence[SectionReading], name: str, title: str) -> tuple[Picture, ...]:
    """Readings of sections that took no part, with their bands.

    Args:
        rows: the readings.
        name: of the figures.
        title: what they show.
    """
    sections = list(dict.fromkeys(row.section for row in rows))
    panels = [
        part
        for section in sections
        for unit in dict.fromkeys(_unit(r) for r in rows if r.section == section)
        for part in _parts([r for r in rows if r.section == section and _unit(r) == unit])
    ]
    return paged(
        panels,
        bands_figure,
        most=_PANELS,
        picture=(
            name,
            title,
            "Line and dot: 95 % band and expected reading; cross: what was read, circled where it "
            "is outside its band.",
        ),
        label=lambda part: part[0].section,
    )


def _parts(rows: Sequence[SectionReading]) -> list[Sequence[SectionReading]]:
    return [rows[k : k + _READINGS] for k in range(0, len(rows), _READINGS)]


def _unit(row: SectionReading) -> str:
    return shown_unit(row.unit, row.dimension)


def bands_figure(panels: Sequence[Sequence[SectionReading]]) -> Figure:
    """Readings with their bands.

    Args:
        panels: the readings of a section in one unit, a panel each.
    """
    longest = max(len(rows) for rows in panels)
    figure, all_axes = panel_grid(len(panels), height=max(1.8, 0.17 * longest + 0.7), extra=0.3)
    for axes, rows in zip(all_axes, panels, strict=True):
        for y, row in enumerate(rows):
            of = row.unit, row.dimension
            low, value, high, read = (
                in_unit(x, *of) for x in (row.lower95, row.computed, row.upper95, row.measured)
            )
            axes.hlines([y], low, high, color=COMPUTED, lw=1.6)
            axes.plot([value], [y], "o", color=COMPUTED, ms=3.5)
            if math.isfinite(read):
                axes.plot([read], [y], "x", color=MEASURED, ms=5, mew=1.2)
                if not row.inside:
                    axes.plot([read], [y], "o", mfc="none", mec=ACCENT, ms=9)
        several = len({row.stage for row in rows}) > 1
        names = [short(f"{r.gauge}, {r.stage}" if several else r.gauge, 20) for r in rows]
        axes.set_yticks(range(len(rows)), names, fontsize=SMALL)
        axes.set_ylim(len(rows) - 0.5, -0.5)
        axes.set_title(short(rows[0].section, 30), fontsize=SMALL)
        unit = _unit(rows[0])
        axes.set_xlabel(f"reading ({unit})" if unit else "reading", fontsize=SMALL)
        axes.xaxis.set_major_locator(MaxNLocator(5))
        axes.grid(visible=True, axis="x")
    handles = [
        key("expected, 95 %", color=COMPUTED, marker="o", ms=3.5, lw=1.6),
        key("read", color=MEASURED, marker="x", ls="", ms=5),
        key("outside its band", mfc="none", mec=ACCENT, marker="o", ls="", ms=8),
    ]
    figure.legend(handles=handles, loc="outside lower center", ncols=3)
    return figure
