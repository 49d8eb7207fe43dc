"""A backtest in words and tables: parameters as readings are added, and how predictions came true.

A fit of a backtest is called by the last stage whose readings it used ("up to bench 1").
"""

from __future__ import annotations

import math
from dataclasses import asdict
from typing import Any

import numpy as np

from geoident.model.arrays import Floats
from geoident.model.gauges import DAY
from geoident.model.results.backtest import Backtest, BacktestStep, bands_of
from geoident.model.results.bands import next_read
from geoident.model.results.columns import ROW, Record, column
from geoident.model.results.result import Result
from geoident.report.text.gauges import predicted_texts, reading_text
from geoident.report.text.layout import (
    TextTable,
    decimals,
    section,
    sections,
    shown_interval,
    with_unit,
)
from geoident.report.text.parameters import NOT_DETERMINED, unknown_words
from geoident.report.text.rows import by_stage, objects
from geoident.units import si_unit

TITLE = "Backtest"

_MOST_ROWS = 40
"""Predictions in the table on a terminal."""


def backtest_text(result: Result) -> str:
    """All of a backtest that fits a terminal; empty if there is none."""
    backtest = result.backtest
    if backtest is None or not backtest.steps:
        return ""
    if result.kind != "backtest":
        return section(
            f"{TITLE}: {tested_words(backtest)}, predicted from those before "
            f"{'it' if backtest.reach is None else 'them'}",
            prediction_table(result).folded(keys=3),
        )
    return sections(
        section("Fits of the first stages", fits_table(result).folded()),
        section("Scores of the predictions", scores_table(backtest).folded()),
        section(HORIZONS_TITLE, horizons_table(backtest).folded()),
        section(ERRORS_TITLE, errors_table(result).folded()),
    )


HORIZONS_TITLE = "Predictions by how far they look ahead"


def tested_words(backtest: Backtest) -> str:
    """What the backtest of a fit predicts."""
    if backtest.reach is None:
        return "the last fitted stage"
    return f"the last {backtest.reach.stages} fitted stages"


def horizons_table(backtest: Backtest) -> TextTable:
    """How predictions of a series came true by how far they looked ahead; without rows for none."""
    header = ("stages ahead", "days", "readings", "inside 95 %", "coverage", "rms error (sd)")
    rows = [
        [
            f"{one.first}" if one.first == one.last else f"{one.first} to {one.last}",
            "-" if math.isnan(one.time) else f"{one.time / DAY:.3g}",
            str(one.readings),
            str(one.inside),
            f"{100 * one.inside / one.readings:.0f} %",
            decimals(one.rms, 2),
        ]
        for one in backtest.horizons
    ]
    return TextTable(header, rows, right="rrrrrr")


def fits_table(result: Result) -> TextTable:
    """One row for each fit: the parameters, and the readings of the next stage that are inside."""
    backtest, table = result.backtest, result.parameters
    if backtest is None:
        return TextTable((), ())
    units = zip(table.names, table.units, table.dimensions, strict=True)
    named = [with_unit(*one) for one in units]
    rows = []
    for step in backtest.steps:
        cells = [_interval(result, step, i) for i in range(len(named))]
        inside, width = _ahead(backtest, step)
        stage = result.gauges.stages[step.last]
        rows.append([stage, str(step.readings), *cells, inside, width, step.status])
    header = ("up to", "readings", *named, "next stage inside", "band by rms", "status")
    return TextTable(header, rows, right="lr" + "r" * len(named) + "rrl")


def _interval(result: Result, step: BacktestStep, i: int) -> str:
    """Value and 95 % interval of a parameter in its unit; in words where it is not determined."""
    table = result.parameters
    if not step.determined[i]:
        return unknown_words(table, i)
    numbers = step.values[i], step.lower95[i], step.upper95[i]
    value, interval = shown_interval(*numbers, table.units[i], table.dimensions[i], between=", ")
    return f"{value} [{interval}]" if interval else value


def _ahead(backtest: Backtest, step: BacktestStep) -> tuple[str, str]:
    """Readings of the next stage inside their bands; width of these by the rms of the readings."""
    bands = bands_of(backtest, step)
    ahead = bands.only(next_read(bands))
    at = ahead.scored
    if not at.any():
        return NOT_DETERMINED if ahead.open.any() else "-", "-"
    inside = f"{np.count_nonzero(ahead.inside)} of {np.count_nonzero(at)}"
    width = float(np.mean((bands.upper95 - bands.lower95)[at]))
    return inside, decimals(width / math.sqrt(float(np.mean(bands.measured[at] ** 2))), 2)


def scores_table(backtest: Backtest) -> TextTable:
    """The scores of the next stage and of those further ahead."""
    header = (
        "stages", "readings", "inside 95 %", "coverage", "rms error (sd)", "band by rms",
        "log score",
    )  # fmt: skip
    rows = [
        [
            name,
            str(scores.readings),
            str(scores.inside),
            f"{100 * scores.coverage:.0f} %",
            decimals(scores.rms, 2),
            decimals(scores.sharpness, 2),
            decimals(scores.log_score, 2),
        ]
        for name, scores in (("next", backtest.next), ("further", backtest.further))
        if scores.readings
    ]
    return TextTable(header, rows, right="lrrrrrr")


ERRORS_TITLE = (
    "Errors of the predictions (in their standard deviations; * outside of the 95 % band)"
)


def errors_table(result: Result, *, ahead: bool = True) -> TextTable:
    """Standardized errors by gauge and stage.

    Args:
        result: of a backtest.
        ahead: those of the next stage that was read, a column for each stage; else all later ones,
            a column for each pair of the last fitted and the predicted stage. Rows where stages
            last and there are more of them than gauges.
    """
    backtest, gauges = result.backtest, result.gauges
    if backtest is None:
        return TextTable((), ())
    columns: list[tuple[str, Floats]] = []
    for step in backtest.steps:
        bands = bands_of(backtest, step)
        part = next_read(bands)
        z = np.where(part == ahead, bands.z, np.nan)
        for j in np.flatnonzero(np.isfinite(z).any(axis=0)).tolist():
            name = gauges.stages[j]
            columns.append((name if ahead else f"{gauges.stages[step.last]} > {name}", z[:, j]))
    shown = [i for i in range(len(gauges.channels)) if any(np.isfinite(z[i]) for _, z in columns)]
    if gauges.times is not None and len(columns) > len(shown):  # moments are rows, as in a log
        rows = [[name, *(_error(float(z[i])) for i in shown)] for name, z in columns]
        header = ("stage", *(gauges.channels[i] for i in shown))
        return TextTable(header, rows, right="l" + "r" * len(shown))
    rows = [[gauges.channels[i], *(_error(float(z[i])) for _, z in columns)] for i in shown]
    return TextTable(
        ("gauge", *(name for name, _ in columns)), rows, right="l" + "r" * len(columns)
    )


def _error(z: float) -> str:
    if math.isnan(z):
        return ""
    return f"{z:+.1f}{'*' if abs(z) > 1.96 else ' '}"


def prediction_table(result: Result) -> TextTable:
    """Every reading that was predicted and read, with its band; those farthest off if many."""
    gauges, every = result.gauges, list(predictions(result))
    distances = sorted(
        range(len(every)), key=lambda k: -abs(0.0 if math.isnan(every[k].z) else every[k].z)
    )
    rows = []
    for one in (every[k] for k in sorted(distances[:_MOST_ROWS])):
        row = one.place[0]
        texts = predicted_texts(gauges, row, one.mean, one.lower95, one.upper95)
        known = math.isfinite(one.lower95)
        rows.append(
            [
                one.gauge,
                one.stage,
                one.up_to,
                *(texts if known else ["-"] * 3),
                reading_text(gauges, row, one.measured),
                _error(one.z).strip() if known else NOT_DETERMINED,
            ]
        )
    header = ("gauge", "stage", "up to", "predicted", "from", "to", "measured", "in sd of band")
    return TextTable(header, rows, right="lllrrrrr")


class Predicted(Record):
    """A reading that a fit of a backtest has predicted, SI.

    Args:
        up_to: last stage that was fitted.
        gauge: name of the channel.
        stage: name of the stage.
        next: it is of the next stage that was read.
        mean: what was predicted.
        sd: its standard deviation.
        lower95: lower end of the 95 % band; infinite where it is not determined.
        upper95: its upper end.
        measured: what was read.
        unit: in which people see it.
        z: standardized error.
        log_density: logarithm of the predicted density.
        dimension: key of `geoident.units.DIMENSIONS`.
        place: numbers of channel and stage.
    """

    up_to: str
    gauge: str
    stage: str
    next: bool
    mean: float = column(dimension=ROW, known="determined", sheet="predicted")
    sd: float = column(dimension=ROW)
    lower95: float = column(dimension=ROW, known="determined")
    upper95: float = column(dimension=ROW, known="determined")
    measured: float = column(dimension=ROW)
    unit: str = column(dimension=ROW)
    z: float = column(sheet="error_in_sd")
    log_density: float = column(hidden=("csv",))
    dimension: str = column(hidden=("csv", "json"))
    place: tuple[int, int]

    @property
    def determined(self) -> bool:
        """The fit determines the prediction."""
        return math.isfinite(self.sd)


def predictions(result: Result) -> list[Predicted]:
    """All predictions of readings, fit by fit and stage by stage."""
    gauges, backtest = result.gauges, result.backtest
    rows: list[Predicted] = []
    if backtest is None:
        return rows
    for step in backtest.steps:
        bands = bands_of(backtest, step)
        ahead, z, sd = next_read(bands), bands.z, step.prediction.sd
        rows += [
            Predicted(
                gauges.stages[step.last], gauges.channels[i], gauges.stages[j], bool(ahead[i, j]),
                float(bands.mean[i, j]), float(sd[i, j]),
                float(bands.lower95[i, j]), float(bands.upper95[i, j]),
                float(bands.measured[i, j]), gauges.units[i], float(z[i, j]),
                float(step.log_density[i, j]), gauges.dimensions[i], (i, j),
            )
            for i, j in by_stage(np.isfinite(bands.mean) & np.isfinite(bands.measured))
        ]  # fmt: skip
    return rows


class StepParameter(Record):
    """A parameter as a fit of a backtest has found it, SI.

    Args:
        up_to: last stage that was fitted.
        readings: how many were fitted.
        parameter: its name.
        value: kept also where it is not determined.
        sd: standard deviation.
        lower95: lower end of the 95 % interval.
        upper95: upper end.
        unit: in which people see it.
        status: how the search ended.
        determined: readings or prior determine it.
        dimension: key of `geoident.units.DIMENSIONS`.
    """

    up_to: str
    readings: int
    parameter: str
    value: float = column(dimension=ROW, known="determined")
    sd: float = column(dimension=ROW, known="determined")
    lower95: float = column(dimension=ROW, known="determined")
    upper95: float = column(dimension=ROW, known="determined")
    unit: str = column(dimension=ROW)
    status: str
    determined: bool = column(hidden=("csv",))
    dimension: str = column(hidden=("csv",))


def step_parameters(result: Result) -> list[StepParameter]:
    """The parameters of each fit."""
    table, rows = result.parameters, []
    for step in () if result.backtest is None else result.backtest.steps:
        for i, name in enumerate(table.names):
            columns = step.values, step.sd, step.lower95, step.upper95
            value, sd, low, high = (float(column[i]) for column in columns)
            rows.append(
                StepParameter(
                    result.gauges.stages[step.last], step.readings, name,
                    value, sd, low, high,
                    table.units[i], step.status, bool(step.determined[i]), table.dimensions[i],
                )
            )  # fmt: skip
    return rows


def backtest_object(result: Result) -> dict[str, Any]:
    """A backtest for other programs, SI."""
    backtest, table, stages = result.backtest, result.parameters, result.gauges.stages
    if backtest is None:
        return {}
    return {
        "next": {**asdict(backtest.next), "coverage": backtest.next.coverage},
        "further": {**asdict(backtest.further), "coverage": backtest.further.coverage},
        "chance_of_so_few_inside": backtest.few,
        "chance_of_so_large_errors": backtest.far,
        "horizons": [asdict(one) for one in backtest.horizons],
        "reach": None if backtest.reach is None else asdict(backtest.reach),
        "fits": [
            {
                "up_to": stages[step.last],
                "readings": step.readings,
                "status": step.status,
                "reason": step.reason,
                "parameters": {
                    name: {**row, "unit": si_unit(dimension)}
                    for name, dimension, row in zip(
                        table.names, table.dimensions, objects(step, "parameter"), strict=True
                    )
                },
                "stress_excess": {
                    stage: excess
                    for stage, excess in zip(stages, step.excess, strict=True)
                    if np.isfinite(excess)
                },
                "counts": asdict(step.counts),
            }
            for step in backtest.steps
        ],
        "skipped": [asdict(one) for one in backtest.skipped],
        "predictions": objects(predictions(result), ROW),
    }
