"""A campaign in pictures: parameters and what varied against the misfit, or against each other.

All of a run together are a line across parallel axes (Inselberg 1985): each number of a run is a
point of an axis of its own. Runs with a small misfit lie over the others and are darker.
"""

from __future__ import annotations

import math
import re
from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np
from matplotlib import colormaps
from matplotlib.collections import LineCollection
from matplotlib.colors import Normalize
from matplotlib.figure import Figure

from geoident.model.arrays import Bools, Floats
from geoident.model.results.many.campaign import SAME_MISFIT, CampaignTable, RunRecord
from geoident.report.drawing.parameters.scale import set_scale
from geoident.report.drawing.style import (
    ACCENT,
    COMPUTED,
    FAINT,
    LENGTHS,
    SMALL,
    Picture,
    key,
    labelled,
    paged,
    panel_grid,
    short,
)
from geoident.units import in_unit, shown_unit

_PANELS = 9
_AXES = 7
_DECADES = 30.0
"""Ratio of the largest to the least of some values from which on an axis is logarithmic."""
MOST_LINES = 500
"""Runs that are drawn across parallel axes, those with the least misfit: more are a dark area."""
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
    columns = parameter_columns(runs, table.parameter_names) if table.command != "simulate" else []
    misfit = np.array([run.objective for run in runs], dtype=np.float64)
    if len(runs) < 2:
        return ()
    good: Bools = np.array([run.exit_code == 0 for run in runs], dtype=np.bool_)
    if np.isfinite(misfit).sum() >= 2:
        words = "Dots: runs that are done; hollow: not converged, not determined or poorly fitted."
        bars = " Horizontal: 95 % interval. Of runs that end in one minimum the dots coincide."
        draw = partial(misfit_figure, misfit=misfit, good=good)
        first = "campaign-varied", "What varied, and the misfit", words
        words += bars if table.command == "fit" else ""
        second = "campaign-parameters", "Parameters, and the misfit", words
        return (
            *paged(varied, draw, most=_PANELS, picture=first, label=_label),
            *paged(columns, draw, most=_PANELS, picture=second, label=_label),
            *_parallel(runs, table.paths, varied, columns, misfit),
        )
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
            label=_label,
        )
    )


def _label(one: RunColumn | ParallelAxis) -> str:
    return one.label


def _parallel(
    runs: Sequence[RunRecord],
    paths: Sequence[str],
    varied: Sequence[RunColumn],
    columns: Sequence[RunColumn],
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
    axes += [ParallelAxis(column.label, column.values) for column in columns]
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
        label=_label,
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
        matches = [_NUMBER.fullmatch(text.strip()) for text in texts]
        units = {match[2] or "" for match in matches if match}
        if len(units) != 1 or not all(
            match or not text for match, text in zip(matches, texts, strict=True)
        ):
            continue
        values = np.array([float(match[1]) if match else math.nan for match in matches])
        columns.append(RunColumn(labelled(path, units.pop()), values, none, none))
    return columns


def parameter_columns(runs: Sequence[RunRecord], names: Sequence[str]) -> list[RunColumn]:
    """The parameters of runs, in the units of the case.

    Args:
        runs: of the campaign.
        names: of the parameters.
    """
    own = {name: [next((p for p in r.parameters if p.name == name), None) for r in runs]
           for name in names}  # fmt: skip
    return [_column(name, estimates) for name, estimates in own.items()]


def reading_columns(runs: Sequence[RunRecord]) -> list[RunColumn]:
    """What runs simulate or predict, channel by channel and stage by stage.

    Args:
        runs: of the campaign.
    """
    columns = []
    for place in dict.fromkeys((r.gauge, r.stage) for run in runs for r in run.readings):
        own = [next((r for r in run.readings if (r.gauge, r.stage) == place), None) for run in runs]
        columns.append(_column(f"{short(place[0])} at {short(place[1])}", own))
    return columns


def _column(name: str, records: Sequence[Any]) -> RunColumn:
    """Value and interval of one record a run, None where a run has none, in their unit."""
    first = next(one for one in records if one is not None)
    rows = [
        [math.nan] * 3 if one is None else
        [in_unit(x, one.unit, one.dimension) for x in (one.value, one.lower95, one.upper95)]
        for one in records
    ]  # fmt: skip
    label = labelled(name, shown_unit(first.unit, first.dimension))
    return RunColumn(label, *np.array(rows, dtype=np.float64).T)


def misfit_figure(columns: Sequence[RunColumn], *, misfit: Floats, good: Bools) -> Figure:
    """Numbers of runs against their misfit.

    Args:
        columns: the numbers, one panel each.
        misfit: (k,) of the runs.
        good: (k,) runs that are done.
    """
    figure, panels = panel_grid(len(columns), height=2.4, extra=0.3)
    for axes, column in zip(panels, columns, strict=True):
        band = np.isfinite(column.low) & np.isfinite(column.high)
        axes.hlines(misfit[band], column.low[band], column.high[band], color=FAINT, lw=0.8)
        for chosen, face in ((good, COMPUTED), (~good, "none")):
            axes.plot(
                column.values[chosen], misfit[chosen], "o", ms=3.5, mec=COMPUTED, mfc=face, mew=0.8
            )
        least = float(np.nanmin(misfit))
        best = misfit <= least + SAME_MISFIT * abs(least)
        axes.plot(column.values[best], misfit[best], "*", ms=9, color=ACCENT)
        _scale(axes.xaxis, column.values)
        _scale(axes.yaxis, misfit)
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
        _scale(axes.xaxis, varied.values)
        axes.set_title(column.label, fontsize=SMALL)
        axes.set_xlabel(varied.label, fontsize=SMALL)
        axes.grid(visible=True)
    return figure


def _scale(axis: Any, values: Floats) -> None:
    """A logarithmic axis where positive values lie decades apart."""
    known = values[np.isfinite(values)]
    if _decades_apart(known):
        set_scale(axis, low=0.8 * float(known.min()), high=1.25 * float(known.max()), log=True)


def _decades_apart(values: Floats) -> bool:
    return bool(values.size and values.min() > 0.0 and values.max() > _DECADES * values.min())


@dataclass(frozen=True)
class ParallelAxis:
    """One axis.

    Args:
        label: of it.
        values: (k,) of the runs; NaN where a run has none. Of words their places among `words`.
        words: what stands for 0, 1, ...; none where the values are numbers.
    """

    label: str
    values: Floats
    words: tuple[str, ...] = ()

    @property
    def log(self) -> bool:
        """The values lie decades apart."""
        return not self.words and _decades_apart(self.values[np.isfinite(self.values)])

    def places(self) -> Floats:
        """(k,) where the values lie on the axis, 0 to 1; in the middle where all are one."""
        values = np.log(self.values) if self.log else self.values
        known = values[np.isfinite(values)]
        low, high = (known.min(), known.max()) if known.size else (0.0, 0.0)
        if high <= low:
            return np.where(np.isfinite(values), 0.5, np.nan)
        return np.asarray((values - low) / (high - low))

    def ticks(self) -> list[tuple[float, str]]:
        """Places with what is written there."""
        if self.words:
            places = ParallelAxis("", np.arange(len(self.words), dtype=np.float64)).places()
            return [(float(y), short(word)) for y, word in zip(places, self.words, strict=True)]
        known = self.values[np.isfinite(self.values)]
        if not known.size:
            return []
        low, high = float(known.min()), float(known.max())
        if low == high:
            return [(0.5, f"{low:.4g}")]
        middle = float(np.sqrt(low * high)) if self.log else 0.5 * (low + high)
        return [(0.0, f"{low:.3g}"), (0.5, f"{middle:.3g}"), (1.0, f"{high:.3g}")]


def word_axis(label: str, words: Sequence[str]) -> ParallelAxis:
    """An axis of what is no number.

    Args:
        label: of it.
        words: (k) of the runs; empty where a run has none.
    """
    known = tuple(dict.fromkeys(word for word in words if word))
    values = [float(known.index(word)) if word else np.nan for word in words]
    return ParallelAxis(label, np.array(values, dtype=np.float64), known)


def parallel_figure(axes: Sequence[ParallelAxis], *, misfit: Floats) -> Figure:
    """Lines of runs across axes, the misfit last.

    Args:
        axes: what varied and what was found.
        misfit: (k,) of the runs.
    """
    shown = [*axes, ParallelAxis("misfit", misfit)]
    order = np.argsort(-misfit, kind="stable")
    order = order[np.isfinite(misfit[order])][-MOST_LINES:]
    x = np.arange(len(shown), dtype=np.float64)
    lines = np.stack([axis.places() for axis in shown], axis=1)[order]
    figure = Figure(figsize=(max(5.0, 1.5 * len(shown) + 1.0), 3.6))
    panel = figure.subplots()
    rank = np.linspace(0.25, 0.95, len(order)) if len(order) > 1 else np.array([0.95])
    colours = colormaps[LENGTHS](Normalize(0.0, 1.0)(rank))
    paths = [np.column_stack([x, line]) for line in lines]
    panel.add_collection(LineCollection(paths, colors=list(colours), linewidths=0.8))
    if len(order):
        panel.plot(x, lines[-1], color=ACCENT, lw=2.0)
    for place, axis in zip(x, shown, strict=True):
        panel.axvline(place, color=FAINT, lw=0.8, zorder=0.5)
        for y, text in axis.ticks():
            panel.annotate(
                text, (place, y), xytext=(3, 0), textcoords="offset points", fontsize=SMALL,
                va="center", bbox={"fc": "white", "ec": "none", "pad": 0.6, "alpha": 0.8},
            )  # fmt: skip
    panel.set_xticks(x, [_folded(axis.label) for axis in shown], fontsize=SMALL)
    panel.set_yticks([])
    panel.set_xlim(-0.15, len(shown) - 0.5)
    panel.set_ylim(-0.05, 1.05)
    panel.spines[["left", "bottom"]].set_visible(False)
    panel.tick_params(axis="x", length=0)
    handles = [key("least misfit", color=ACCENT, lw=2.0)]
    figure.legend(handles=handles, loc="outside lower center")
    return figure


def _folded(label: str) -> str:
    """A path in lines, one a key, that stand beside those of others.

    >>> _folded("parameters.E_rock.start (GPa)").splitlines()
    ['parameters', '.E_rock', '.start (GPa)']
    """
    path, unit, rest = label.partition(" (")
    return "\n.".join(path.split(".")) + unit + rest
