"""A backtest in words and tables: parameters as readings are added, and how predictions came true.

A fit of a backtest is called by the last stage whose readings it used ("up to bench 1").
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

from geoident.model.arrays import Floats
from geoident.model.results.backtest import Backtest, BacktestStep, Scores, bands_of
from geoident.model.results.bands import next_read
from geoident.model.results.result import Result
from geoident.report.text.gauges import predicted_texts, reading_text
from geoident.report.text.layout import TextTable, decimals, section, sections, with_interval
from geoident.report.text.parameters import AS_PRIOR, NOT_DETERMINED
from geoident.report.text.rows import by_stage, objects
from geoident.units import in_unit, shown_unit, si_unit

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
            f"{TITLE}: the last fitted stage, predicted from those before it",
            prediction_table(result).folded(keys=3),
        )
    return sections(
        section("Fits of the first stages", fits_table(result).folded()),
        section("Predictions that came true", scores_table(backtest).folded()),
        section(ERRORS_TITLE, errors_table(result).folded()),
    )


def fits_table(result: Result) -> TextTable:
    """One row for each fit: the parameters, and the readings of the next stage that are inside."""
    backtest, table = result.backtest, result.parameters
    if backtest is None:
        return TextTable((), ())
    units = [shown_unit(*pair) for pair in zip(table.units, table.dimensions, strict=True)]
    named = [
        f"{name} ({unit})" if unit else name for name, unit in zip(table.names, units, strict=True)
    ]
    rows = []
    for step in backtest.steps:
        cells = [_interval(result, step, i) for i in range(len(named))]
        ahead = _ahead(backtest, step)
        stage = result.gauges.stages[step.last]
        rows.append([stage, str(step.readings), *cells, ahead, _width(backtest, step), step.status])
    header = ("up to", "readings", *named, "next stage inside", "band by rms", "status")
    return TextTable(header, rows, right="lr" + "r" * len(named) + "rrl")


def _interval(result: Result, step: BacktestStep, i: int) -> str:
    """Value and 95 % interval of a parameter in its unit; in words where it is not determined."""
    if not step.determined[i]:
        return AS_PRIOR if result.parameters.priors[i] else NOT_DETERMINED
    unit = result.parameters.units[i], result.parameters.dimensions[i]
    columns = step.values, step.lower95, step.upper95
    value, low, high = with_interval(*(in_unit(float(column[i]), *unit) for column in columns))
    return value if low == "-" else f"{value} [{low}, {high}]"


def _ahead(backtest: Backtest, step: BacktestStep) -> str:
    bands = bands_of(backtest, step)
    ahead = bands.only(next_read(bands))
    count, loose = np.count_nonzero(ahead.scored), np.count_nonzero(ahead.open)
    if not count:
        return NOT_DETERMINED if loose else "-"
    return f"{np.count_nonzero(ahead.inside)} of {count}"


def _width(backtest: Backtest, step: BacktestStep) -> str:
    """Mean width of the bands of the next stage by the root mean square of its readings."""
    bands = bands_of(backtest, step)
    at = next_read(bands) & bands.scored
    if not at.any():
        return "-"
    size = math.sqrt(float(np.mean(bands.measured[at] ** 2)))
    return decimals(float(np.mean((bands.upper95 - bands.lower95)[at])) / size, 2)


def scores_table(backtest: Backtest) -> TextTable:
    """The scores of the next stage and of those further ahead."""
    header = (
        "stages", "readings", "inside 95 %", "coverage", "rms error (sd)", "band by rms",
        "log score",
    )  # fmt: skip
    rows = [_score_row("next", backtest.next), _score_row("further", backtest.further)]
    return TextTable(header, [row for row in rows if row], right="lrrrrrr")


def _score_row(name: str, scores: Scores) -> list[str]:
    if not scores.readings:
        return []
    return [
        name,
        str(scores.readings),
        str(scores.inside),
        f"{100 * scores.coverage:.0f} %",
        decimals(scores.rms, 2),
        decimals(scores.sharpness, 2),
        decimals(scores.log_score, 2),
    ]


ERRORS_TITLE = (
    "Errors of the predictions (in their standard deviations; * outside of the 95 % band)"
)


def errors_table(result: Result, *, ahead: bool = True) -> TextTable:
    """Standardized errors by gauge and stage.

    Args:
        result: of a backtest.
        ahead: those of the next stage that was read, a column for each stage; else all later ones,
            a column for each pair of the last fitted and the predicted stage.
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
    backtest, gauges = result.backtest, result.gauges
    if backtest is None:
        return TextTable((), ())
    ranked = sorted(predictions(result), key=lambda one: -abs(one.z if one.z == one.z else 0.0))
    kept = {id(one) for one in ranked[:_MOST_ROWS]}
    rows = []
    for one in predictions(result):
        if len(ranked) > _MOST_ROWS and id(one) not in kept:
            continue
        texts = predicted_texts(gauges, one.row, one.mean, one.low, one.high)
        known = math.isfinite(one.low)
        rows.append(
            [
                gauges.channels[one.row],
                gauges.stages[one.column],
                gauges.stages[one.last],
                *(texts if known else ["-"] * 3),
                reading_text(gauges, one.row, one.measured),
                _error(one.z).strip() if known else NOT_DETERMINED,
            ]
        )
    header = ("gauge", "stage", "up to", "predicted", "from", "to", "measured", "in sd")
    return TextTable(header, rows, right="lllrrrrr")


@dataclass(frozen=True)
class Predicted:
    """A reading that a fit of a backtest has predicted, SI.

    Args:
        last: number of the last fitted stage.
        row: number of the channel.
        column: number of the stage.
        ahead: whether it is the next stage that was read.
        mean: what was predicted.
        sd: its standard deviation.
        low: lower end of the 95 % band; infinite where it is not determined.
        high: its upper end.
        measured: what was read.
        z: standardized error.
        log_density: logarithm of the predicted density.
    """

    last: int
    row: int
    column: int
    ahead: bool
    mean: float
    sd: float
    low: float
    high: float
    measured: float
    z: float
    log_density: float


def predictions(result: Result) -> Iterator[Predicted]:
    """All predictions of readings, fit by fit and stage by stage."""
    backtest = result.backtest
    if backtest is None:
        return
    for step in backtest.steps:
        bands = bands_of(backtest, step)
        ahead, z = next_read(bands), bands.z
        for i, j in by_stage(np.isfinite(bands.mean) & np.isfinite(bands.measured)):
            yield Predicted(
                step.last,
                i,
                j,
                bool(ahead[i, j]),
                mean=float(bands.mean[i, j]),
                sd=float(step.prediction.sd[i, j]),
                low=float(bands.lower95[i, j]),
                high=float(bands.upper95[i, j]),
                measured=float(bands.measured[i, j]),
                z=float(z[i, j]),
                log_density=float(step.log_density[i, j]),
            )


def backtest_object(result: Result) -> dict[str, Any]:
    """A backtest for other programs, SI."""
    backtest, gauges, table = result.backtest, result.gauges, result.parameters
    if backtest is None:
        return {}
    return {
        "next": _scores_object(backtest.next),
        "further": _scores_object(backtest.further),
        "chance_of_so_few_inside": backtest.few,
        "chance_of_so_large_errors": backtest.far,
        "fits": [
            {
                "up_to": gauges.stages[step.last],
                "readings": step.readings,
                "status": step.status,
                "reason": step.reason,
                "parameters": {
                    name: {**row, "unit": si_unit(dimension)}
                    for name, row, dimension in zip(
                        table.names, objects(step, "parameter"), table.dimensions, strict=True
                    )
                },
                "stress_excess": {
                    stage: step.excess[j]
                    for j, stage in enumerate(gauges.stages)
                    if np.isfinite(step.excess[j])
                },
                "counts": asdict(step.counts),
            }
            for step in backtest.steps
        ],
        "skipped": [asdict(one) for one in backtest.skipped],
        "predictions": [
            {
                "up_to": gauges.stages[one.last],
                "gauge": gauges.channels[one.row],
                "stage": gauges.stages[one.column],
                "next": one.ahead,
                "mean": one.mean if math.isfinite(one.sd) else None,
                "sd": one.sd,
                "lower95": one.low,
                "upper95": one.high,
                "measured": one.measured,
                "z": one.z,
                "log_density": one.log_density,
                "unit": si_unit(gauges.dimensions[one.row]),
            }
            for one in predictions(result)
        ],
    }


def _scores_object(scores: Scores) -> dict[str, Any]:
    return {**asdict(scores), "coverage": scores.coverage}


BacktestRows = list[tuple[str | int | float | bool, ...]]


def csv_rows(result: Result) -> tuple[tuple[str, ...], BacktestRows]:
    """Header and rows of the predictions for spreadsheets, in the units of the channels."""
    gauges = result.gauges
    rows: BacktestRows = [
        (
            gauges.stages[one.last],
            gauges.channels[one.row],
            gauges.stages[one.column],
            one.ahead,
            *(
                in_unit(x, gauges.units[one.row], gauges.dimensions[one.row])
                if math.isfinite(x) and math.isfinite(one.sd)
                else math.nan
                for x in (one.mean, one.sd, one.low, one.high)
            ),
            in_unit(one.measured, gauges.units[one.row], gauges.dimensions[one.row]),
            gauges.shown_units[one.row],
            one.z,
        )
        for one in predictions(result)
    ]
    header = (
        "up_to", "gauge", "stage", "next", "predicted", "sd", "lower95", "upper95", "measured",
        "unit", "error_in_sd",
    )  # fmt: skip
    return header, rows


def csv_fit_rows(result: Result) -> tuple[tuple[str, ...], BacktestRows]:
    """Header and rows of the parameters of each fit, in their units."""
    header = (
        "up_to",
        "readings",
        "parameter",
        "value",
        "sd",
        "lower95",
        "upper95",
        "unit",
        "status",
    )
    backtest, table = result.backtest, result.parameters
    rows: BacktestRows = [
        (
            result.gauges.stages[step.last],
            float(step.readings),
            name,
            *(
                in_unit(float(column[i]), table.units[i], table.dimensions[i])
                if step.determined[i]
                else math.nan
                for column in (step.values, step.sd, step.lower95, step.upper95)
            ),
            shown_unit(table.units[i], table.dimensions[i]),
            step.status,
        )
        for step in (() if backtest is None else backtest.steps)
        for i, name in enumerate(table.names)
    ]
    return header, rows
