"""Several sections: laws with the sections about them, their parameters, predicted readings."""

from __future__ import annotations

import math
from collections.abc import Sequence
from functools import partial
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Patch
from matplotlib.ticker import MaxNLocator

from geoident.model.arrays import Floats
from geoident.model.results.many.project import (
    LAW,
    LawEstimate,
    LawPoint,
    ProjectResult,
    SectionParameter,
    SectionReading,
)
from geoident.report.drawing.parameters.scale import set_scale
from geoident.report.drawing.style import (
    ACCENT,
    COMPUTED,
    FAINT,
    MEASURED,
    SMALL,
    Picture,
    key,
    labelled,
    paged,
    panel_grid,
    short,
)
from geoident.units import in_unit, shown_unit

_SECTIONS = 24
"""Sections in a figure."""
_PANELS = 9
_READINGS = 40
"""Readings in a panel."""


def law_pictures(result: ProjectResult) -> tuple[Picture, ...]:
    """Each law over each of its covariates, with the sections."""
    pictures: list[Picture] = []
    for law in result.laws:
        names = dict.fromkeys(p.covariate for p in result.points if p.parameter == law.parameter)
        for name in names:
            others = "" if len(names) < 2 else " Other covariates of the law at their medians."
            pictures.append(
                Picture(
                    f"law-{len(pictures) + 1}",
                    f"{law.parameter} over {name}: {law.formula}",
                    "Line and dark band: the law and its 95 % interval; light band: where 95 % of "
                    "sections are expected. Hollow: a section by its own fit; full: with all "
                    f"others. Bars: 95 % intervals.{others}",
                    partial(law_figure, result, law, name),
                )
            )
    return tuple(pictures)


def law_figure(result: ProjectResult, law: LawEstimate, name: str) -> Figure:
    """A law over a covariate.

    Args:
        result: with the sections.
        law: to draw.
        name: of the covariate.
    """
    points = [p for p in result.points if (p.parameter, p.covariate) == (law.parameter, name)]
    figure = Figure(figsize=(6.8, 4.4))
    axes = figure.subplots()
    known = {row.section: row for row in result.covariates if row.covariate == name}
    one = next(iter(known.values()))
    at = np.array([in_unit(p.at, one.unit, one.dimension) for p in points])
    columns = _columns(law, points)
    axes.fill_between(at, columns[3], columns[4], color=COMPUTED, alpha=0.12, lw=0)
    axes.fill_between(at, columns[1], columns[2], color=COMPUTED, alpha=0.3, lw=0)
    axes.plot(at, columns[0], color=COMPUTED, lw=1.4)
    predicted = {section.name for section in result.predicted}
    drawn: list[float] = columns.ravel().tolist()
    for row in result.parameters:
        if row.parameter == law.parameter and row.section in known:
            x = in_unit(known[row.section].value, one.unit, one.dimension)
            drawn += _draw_section(axes, x, row, predicted=row.section in predicted)
    _value_axis(axes.yaxis, np.array(drawn), log=law.scale == "log")
    unit, of = shown_unit(law.unit, law.dimension), shown_unit(one.unit, one.dimension)
    axes.set_ylabel(labelled(law.parameter, unit))
    axes.set_xlabel(labelled(name, of))
    axes.grid(visible=True)
    handles: list[Any] = [
        key("law", color=COMPUTED, lw=1.4),
        Patch(color=COMPUTED, alpha=0.3, lw=0, label="law, 95 %"),
        Patch(color=COMPUTED, alpha=0.12, lw=0, label="sections, 95 %"),
        key("own fit", marker="o", mfc="none", mec=FAINT, ls="", ms=5),
        key("with all", marker="o", color=MEASURED, ls="", ms=4),
    ]
    if predicted:
        handles.append(key("predicted", marker="D", color=ACCENT, ls="", ms=4))
    figure.legend(handles=handles, loc="outside lower center", ncols=6)
    return figure


def _columns(law: LawEstimate, points: Sequence[LawPoint]) -> Floats:
    """Law and bands (5, k) in the unit of the parameter."""
    names = ("value", "lower95", "upper95", "section_lower95", "section_upper95")
    rows = [[in_unit(getattr(p, name), law.unit, law.dimension) for p in points] for name in names]
    return np.array(rows, dtype=np.float64)


def _draw_section(axes: Axes, x: float, row: SectionParameter, *, predicted: bool) -> list[float]:
    """A section at its covariate; the values that are drawn."""
    alone = _in_units(row, row.alone, row.alone_lower95, row.alone_upper95)
    value = _in_units(row, row.value, row.lower95, row.upper95)
    if math.isfinite(alone[0]):
        axes.vlines([x], alone[1], alone[2], color=FAINT, lw=3.2, alpha=0.5)
        axes.plot([x], [alone[0]], "o", mfc="none", mec=FAINT, ms=7)
    colour, mark = (ACCENT, "D") if predicted else (MEASURED, "o")
    axes.vlines([x], value[1], value[2], color=colour, lw=1.2)
    axes.plot([x], [value[0]], mark, color=colour, ms=4)
    return [*alone, *value]


def _in_units(row: SectionParameter, *values: float) -> list[float]:
    return [in_unit(value, row.unit, row.dimension) for value in values]


def _value_axis(axis: Any, values: Floats, *, log: bool) -> None:
    known = values[np.isfinite(values)]
    low, high = float(known.min()), float(known.max())
    if log and low > 0.0:
        set_scale(axis, low=0.9 * low, high=1.1 * high, log=True)
        return
    room = 0.05 * (high - low or 1.0)
    set_scale(axis, low=low - room, high=high + room, log=False)


def estimate_pictures(result: ProjectResult) -> tuple[Picture, ...]:
    """Parameters of all sections: by the law, by themselves, and with all others."""
    pictures: list[Picture] = []
    for name in dict.fromkeys(row.parameter for row in result.parameters if row.kind == LAW):
        rows = [row for row in result.parameters if row.parameter == name]
        law = next(law for law in result.laws if law.parameter == name)
        pictures += paged(
            rows,
            partial(estimate_figure, result, law),
            most=_SECTIONS,
            picture=(
                f"sections-{len(pictures) + 1}",
                f"{name} of the sections",
                "Tick: the law at the section with its 95 % interval; hollow: the section "
                "by its own fit; full: with all others. How far the full dot is from the hollow "
                "one towards the tick is the shrinkage.",
            ),
            label=lambda row: row.section,
        )
    return tuple(pictures)


def estimate_figure(
    result: ProjectResult, law: LawEstimate, rows: Sequence[SectionParameter]
) -> Figure:
    """A parameter of some sections, one below the other.

    Args:
        result: that they are of.
        law: of the parameter.
        rows: the parameter of each section.
    """
    figure = Figure(figsize=(6.8, 0.3 * len(rows) + 1.3))
    axes = figure.subplots()
    predicted = {section.name for section in result.predicted}
    drawn: list[float] = []
    for y, row in enumerate(rows):
        mean = _in_units(row, row.law, row.law_lower95, row.law_upper95)
        alone = _in_units(row, row.alone, row.alone_lower95, row.alone_upper95)
        value = _in_units(row, row.value, row.lower95, row.upper95)
        axes.hlines([y - 0.22], mean[1], mean[2], color=COMPUTED, lw=2.5, alpha=0.35)
        axes.plot([mean[0]], [y - 0.22], "|", color=COMPUTED, ms=7)
        if math.isfinite(alone[0]):
            axes.hlines([y], alone[1], alone[2], color=FAINT, lw=1.2)
            axes.plot([alone[0]], [y], "o", mfc="white", mec=FAINT, ms=5)
        colour, mark = (ACCENT, "D") if row.section in predicted else (MEASURED, "o")
        axes.hlines([y + 0.22], value[1], value[2], color=colour, lw=1.2)
        axes.plot([value[0]], [y + 0.22], mark, color=colour, ms=4)
        drawn += [*mean, *alone, *value]
    _value_axis(axes.xaxis, np.array(drawn), log=law.scale == "log")
    axes.set_yticks(range(len(rows)), [short(row.section) for row in rows])
    axes.set_ylim(len(rows) - 0.4, -0.6)
    axes.set_xlabel(labelled(law.parameter, shown_unit(law.unit, law.dimension)))
    axes.grid(visible=True, axis="x")
    handles = [
        key("law", color=COMPUTED, marker="|", ls="-", lw=2.0, ms=7),
        key("own fit", marker="o", mfc="white", mec=FAINT, color=FAINT, lw=1.2, ms=5),
        key("with all", marker="o", color=MEASURED, lw=1.2, ms=4),
    ]
    if any(row.section in predicted for row in rows):
        handles.append(key("predicted", marker="D", color=ACCENT, lw=1.2, ms=4))
    figure.legend(handles=handles, loc="outside upper center", ncols=4)
    return figure


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
        axes.set_xlabel(labelled("measured, expected", _unit(rows[0])), fontsize=SMALL)
        axes.xaxis.set_major_locator(MaxNLocator(5))
        axes.grid(visible=True, axis="x")
    handles = [
        key("expected, 95 %", color=COMPUTED, marker="o", ms=3.5, lw=1.6),
        key("read", color=MEASURED, marker="x", ls="", ms=5),
        key("outside its band", mfc="none", mec=ACCENT, marker="o", ls="", ms=8),
    ]
    figure.legend(handles=handles, loc="outside lower center", ncols=3)
    return figure
