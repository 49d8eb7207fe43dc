"""A campaign in pictures: parameters and what varied against the misfit, or against each other."""

from __future__ import annotations

import math
import re
from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from geoident.model.arrays import Bools, Floats
from geoident.model.results.many.campaign import SAME_MISFIT, CampaignTable, RunRecord
from geoident.report.drawing.parameters.parallel import (
    MOST_LINES,
    ParallelAxis,
    parallel_figure,
    word_axis,
)
from geoident.report.drawing.parameters.scale import set_scale
from geoident.report.drawing.style import (
    ACCENT,
    COMPUTED,
    FAINT,
    SMALL,
    Picture,
    key,
    paged,
    panel_grid,
    short,
)
from geoident.units import in_unit, shown_unit

_PANELS = 9
_AXES = 7
_DECADES = 30.0
"""Ratio of the largest to the least of some values from which on an axis is logarithmic."""
_NUMBER = re.compile(r"([-+]?[0-9]*\.?[0-9]+(?:[eE][-+]?[0-9]+)?)(?:\s+(\S.*))?")


@dataclass(frozen=True)
class RunColumn:
    """A number of each run.

    Args:
        label: of its axis.
        values: (k,) of the runs; NaN where a run has none.
        low: (k,) lower ends of intervals; NaN for none.
        high: (k,) upper ends.
    """

    label: str
    values: Floats
    low: Floats
    high: Floats


def campaign_pictures(table: CampaignTable) -> tuple[Picture, ...]:
    """The figures of a campaign; none where fewer than two runs have numbers."""
    runs = [run for run in table.runs if run.finished]
    varied = varied_columns(runs, table.paths)
    found = parameter_columns(runs, table.parameter_names) if table.command != "simulate" else []
    misfit = np.array([run.objective for run in runs], dtype=np.float64)
    if len(runs) < 2:
        return ()
    good: Bools = np.array([run.exit_code == 0 for run in runs], dtype=np.bool_)
    if np.isfinite(misfit).sum() >= 2:
        words = "Dots: runs that are done; hollow: not converged, not determined or poorly fitted."
        bars = " Horizontal: 95 % interval. Of runs that end in one minimum the dots coincide."
        return (
            *_scatters(
                varied, misfit, good, "campaign-varied", "What varied, and the misfit", words
            ),
            *_scatters(
                found, misfit, good, "campaign-parameters", "Parameters, and the misfit",
                words + (bars if table.command == "fit" else ""),
            ),
            *_parallel(runs, table.paths, varied, found, misfit),
        )  # fmt: skip
    readings = reading_columns(runs)
    if not varied or not readings:
        return ()
    return tuple(
        picture
        for k, column in enumerate(varied, 1)
        for picture in paged(
            readings,
            partial(against_figure, column),
            most=_PANELS,
            picture=(
                f"campaign-readings-{k}",
                f"Readings over {column.label}",
                "One dot a run; vertical: 95 % band where there is one.",
            ),
            label=lambda reading: reading.label,
        )
    )


def _scatters(
    columns: Sequence[RunColumn], misfit: Floats, good: Bools, name: str, title: str, words: str
) -> tuple[Picture, ...]:
    if not columns:
        return ()
    return paged(
        columns,
        partial(misfit_figure, misfit=misfit, good=good),
        most=_PANELS,
        picture=(name, title, words),
        label=lambda column: column.label,
    )


def _parallel(
    runs: Sequence[RunRecord],
    paths: Sequence[str],
    varied: Sequence[RunColumn],
    found: Sequence[RunColumn],
    misfit: Floats,
) -> tuple[Picture, ...]:
    """All that varied and was found, and the misfit: a line a run."""
    numbers = {column.label.split(" (")[0]: column for column in varied}
    axes = [
        ParallelAxis(numbers[path].label, numbers[path].values)
        if path in numbers
        else word_axis(path, [dict(run.settings).get(path, "") for run in runs])
        for path in paths
    ]
    axes += [ParallelAxis(column.label, column.values) for column in found]
    axes = [axis for axis in axes if np.unique(axis.values[np.isfinite(axis.values)]).size > 1]
    if len(axes) < 2:
        return ()
    finite = int(np.isfinite(misfit).sum())
    words = "One line a run, darker with less misfit; numbers are those of the ends and the middle."
    if finite > MOST_LINES:
        words += f" Shown are the {MOST_LINES} of {finite:,} runs with the least misfit."
    return paged(
        axes,
        partial(parallel_figure, misfit=misfit),
        most=_AXES,
        picture=("campaign-parallel", "What varied, parameters and misfit together", words),
        label=lambda axis: axis.label,
    )


def varied_columns(runs: Sequence[RunRecord], paths: Sequence[str]) -> list[RunColumn]:
    """What varies, as far as it is numbers in one unit.

    Args:
        runs: of the campaign.
        paths: of the values.
    """
    columns = []
    none = np.full(len(runs), np.nan)
    for path in paths:
        texts = [dict(run.settings).get(path, "") for run in runs]
        found = [_NUMBER.fullmatch(text.strip()) for text in texts]
        units = {match[2] or "" for match in found if match}
        if len(units) != 1 or not all(
            match or not text for match, text in zip(found, texts, strict=True)
        ):
            continue
        values = np.array([float(match[1]) if match else math.nan for match in found])
        unit = units.pop()
        columns.append(RunColumn(f"{path} ({unit})" if unit else path, values, none, none))
    return columns


def parameter_columns(runs: Sequence[RunRecord], names: Sequence[str]) -> list[RunColumn]:
    """The parameters of runs, in the units of the case.

    Args:
        runs: of the campaign.
        names: of the parameters.
    """
    columns = []
    for name in names:
        own = [next((p for p in run.parameters if p.name == name), None) for run in runs]
        first = next(p for p in own if p is not None)
        unit = shown_unit(first.unit, first.dimension)
        rows = [
            [math.nan] * 3 if p is None else [in_unit(x, p.unit, p.dimension) for x in
                                              (p.value, p.lower95, p.upper95)]
            for p in own
        ]  # fmt: skip
        columns.append(RunColumn(f"{name} ({unit})" if unit else name, *np.array(rows).T))
    return columns


def reading_columns(runs: Sequence[RunRecord]) -> list[RunColumn]:
    """What runs simulate or predict, channel by channel and stage by stage.

    Args:
        runs: of the campaign.
    """
    places = dict.fromkeys((r.gauge, r.stage) for run in runs for r in run.readings)
    columns = []
    for place in places:
        own = [next((r for r in run.readings if (r.gauge, r.stage) == place), None) for run in runs]
        first = next(r for r in own if r is not None)
        unit = shown_unit(first.unit, first.dimension)
        rows = [
            [math.nan] * 3 if r is None else [in_unit(x, r.unit, r.dimension) for x in
                                              (r.value, r.lower95, r.upper95)]
            for r in own
        ]  # fmt: skip
        label = f"{short(place[0])} at {short(place[1])} ({unit})"
        columns.append(RunColumn(label, *np.array(rows).T))
    return columns


def misfit_figure(columns: Sequence[RunColumn], *, misfit: Floats, good: Bools) -> Figure:
    """Numbers of runs against their misfit.

    Args:
        columns: the numbers, one panel each.
        misfit: (k,) of the runs.
        good: (k,) runs that are done.
    """
    figure, panels = panel_grid(len(columns), height=2.4, extra=0.3)
    for axes, column in zip(panels, columns, strict=True):
        _bars(axes, column.low, column.high, misfit)
        for chosen, face in ((good, COMPUTED), (~good, "none")):
            axes.plot(
                column.values[chosen], misfit[chosen], "o", ms=3.5, mec=COMPUTED, mfc=face, mew=0.8
            )
        least = float(np.nanmin(misfit))
        best = misfit <= least + SAME_MISFIT * abs(least)
        axes.plot(column.values[best], misfit[best], "*", ms=9, color=ACCENT)
        _scale(axes, "x", column.values)
        _scale(axes, "y", misfit)
        axes.set_xlabel(column.label, fontsize=SMALL)
        axes.set_ylabel("misfit", fontsize=SMALL)
        axes.grid(visible=True)
    handles = [key("least misfit", marker="*", ls="", color=ACCENT, ms=9)]
    figure.legend(handles=handles, loc="outside lower center")
    return figure


def against_figure(varied: RunColumn, readings: Sequence[RunColumn]) -> Figure:
    """Readings of runs over what varied.

    Args:
        varied: what varied.
        readings: one panel each.
    """
    figure, panels = panel_grid(len(readings), height=2.2, extra=0.1)
    for axes, column in zip(panels, readings, strict=True):
        band = np.isfinite(column.low) & np.isfinite(column.high)
        axes.vlines(varied.values[band], column.low[band], column.high[band], color=FAINT, lw=0.8)
        axes.plot(varied.values, column.values, "o", ms=3.5, color=COMPUTED)
        _scale(axes, "x", varied.values)
        axes.set_title(column.label, fontsize=SMALL)
        axes.set_xlabel(varied.label, fontsize=SMALL)
        axes.grid(visible=True)
    return figure


def _bars(axes: Axes, low: Floats, high: Floats, misfit: Floats) -> None:
    shown = np.isfinite(low) & np.isfinite(high)
    axes.hlines(misfit[shown], low[shown], high[shown], color=FAINT, lw=0.8)


def _scale(axes: Axes, which: str, values: Floats) -> None:
    """A logarithmic axis where positive values lie decades apart."""
    known = values[np.isfinite(values)]
    if known.size and known.min() > 0.0 and known.max() > _DECADES * known.min():
        axis = axes.xaxis if which == "x" else axes.yaxis
        set_scale(axis, low=0.8 * float(known.min()), high=1.25 * float(known.max()), log=True)
