"""How far readings are from what the model says: residuals, outliers, influence.

A residual is measured minus computed. "In sd" it is divided by the standard deviation of the
reading, wherever this stands. "Unexplained" is what shared errors leave of it, or the uncertainty
of a prediction: it tells outliers.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from geoident.model.arrays import Bools, Floats
from geoident.model.results.backtest import predicted_before
from geoident.model.results.columns import ROW, Record, column
from geoident.model.results.result import DIAGNOSTIC_COLUMNS, Diagnostics, Result
from geoident.report.text.layout import TextTable, decimals, number
from geoident.report.text.rows import CsvTable, Places, attributes, beside, by_stage, objects, sheet

OUTLIER = 3.0
"""Standard deviations beyond which a reading is named."""

MOST_INFLUENTIAL = 5
"""Readings in the table of influence."""


def as_predicted(result: Result) -> Result:
    """A backtest with its readings beside what the last fit before each has predicted.

    A reading of a backtest is fitted in the end; what is told of it is how it was predicted.
    Readings before the second fit are shown as they were fitted last. Other results stay as they
    are.
    """
    if result.kind != "backtest" or result.backtest is None:
        return result
    return replace(result, prediction=predicted_before(result.backtest))


def has_prediction(result: Result) -> Bools:
    """(n_channels, n_stages) there is a prediction, determined or not."""
    if result.prediction is None:
        return np.zeros(result.gauges.computed.shape, dtype=bool)
    return np.asarray(np.isfinite(result.prediction.mean))


def beside_prediction(result: Result) -> Bools:
    """(n_channels, n_stages) a reading stands beside its prediction, not beside a fit."""
    predicted = has_prediction(result)
    return predicted if result.kind == "backtest" else predicted & ~result.gauges.used


def compared_with(result: Result) -> Floats:
    """(n_channels, n_stages) what readings stand beside, SI; NaN where it is not determined.

    That is the prediction of a reading that took no part in the fit, else what the fit computes; of
    a backtest the prediction by the last fit before, where there was one (`as_predicted`).
    """
    result = as_predicted(result)
    prediction, computed = result.prediction, result.gauges.computed
    if prediction is None:
        return computed
    mean = np.where(prediction.known, prediction.mean, np.nan)
    return np.asarray(np.where(beside_prediction(result), mean, computed), dtype=np.float64)


def residual_in_sd(result: Result) -> Floats:
    """(n_channels, n_stages) residual by the standard deviation of the reading: "in sd".

    It has the sign of the residual, and means the same beside a fit and beside a prediction. NaN
    where nothing was measured or the prediction is not determined.
    """
    return _quotient(result.gauges.measured - compared_with(result), result.gauges.sd)


def unexplained(result: Result) -> Floats:
    """(n_channels, n_stages) what is left unexplained of residuals, in its standard deviations.

    Where readings share errors, the part of them that the other readings show is taken off (theory
    7); what is left is in standard deviations of the errors that remain, the model's among them.
    Beside a prediction: the residual in standard deviations of the prediction, which include those
    of the parameters. A reading of a backtest that no fit has predicted has none. Elsewhere this is
    `residual_in_sd`. Outliers are judged by these numbers, in tables, figures and sentences.
    """
    ratio, before = residual_in_sd(result), as_predicted(result)
    if shares_errors(result) and result.diagnostics is not None:
        wide = result.diagnostics.wide(result.gauges).standardized
        ratio = np.where(np.isfinite(wide), wide, ratio)
    if before.prediction is not None:
        of_band = _quotient(result.gauges.measured - compared_with(result), before.prediction.sd)
        not_predicted = ratio if before is result else np.nan
        ratio = np.where(beside_prediction(before), of_band, not_predicted)
    return np.asarray(ratio)


def _quotient(residual: Floats, sd: Floats) -> Floats:
    known = np.isfinite(sd) & (sd > 0)
    with np.errstate(over="ignore"):  # by a standard deviation of a damaged result
        ratio: Floats = np.divide(residual, sd, out=np.full(sd.shape, np.nan), where=known)
    return ratio


def has_unexplained(result: Result, *, predictions: bool = False) -> bool:
    """Whether `unexplained` differs from `residual_in_sd`, so that a table has both.

    Args:
        result: whose readings it shows.
        predictions: it shows those beside predictions, too.
    """
    of_backtest = as_predicted(result) is not result
    return shares_errors(result) or of_backtest or (predictions and _reads_predictions(result))


def _reads_predictions(result: Result) -> bool:
    return bool((beside_prediction(result) & np.isfinite(result.gauges.measured)).any())


class ComparedReading(Record):
    """A reading that was taken or computed, of a channel in a stage; SI, NaN where there is none.

    Args:
        gauge: name of the channel.
        stage: name of the stage.
        measured: what was read.
        computed: what it is compared with: `compared_with`.
        residual: measured less computed.
        sd: standard deviation of the reading.
        unit: in which people see it.
        residual_in_sd: residual by sd.
        unexplained: see the function of this name.
        used: it took part in the identification.
        bad: it is known to be wrong.
        dimension: key of `geoident.units.DIMENSIONS`.
    """

    gauge: str
    stage: str
    measured: float = column(dimension=ROW)
    computed: float = column(dimension=ROW)
    residual: float = column(dimension=ROW)
    sd: float = column(dimension=ROW)
    unit: str = column(dimension=ROW)
    residual_in_sd: float
    unexplained: float
    used: bool
    bad: bool = column(hidden=("csv",))
    dimension: str = column(hidden=("csv", "json"))


def compared_readings(result: Result) -> list[ComparedReading]:
    """Every reading beside what it is compared with, stage by stage; none of dates alone."""
    if result.in_service:
        return []
    table, computed = result.gauges, compared_with(result)
    in_sd, left = residual_in_sd(result), unexplained(result)
    return [
        ComparedReading(
            table.channels[i], table.stages[j], table.measured[i, j], computed[i, j],
            table.measured[i, j] - computed[i, j], table.sd[i, j], table.units[i], in_sd[i, j],
            left[i, j], bool(table.used[i, j]), bool(table.bad[i, j]), table.dimensions[i],
        )
        for i, j in by_stage(np.isfinite(table.measured) | np.isfinite(computed))
    ]  # fmt: skip


def shares_errors(result: Result) -> bool:
    """Readings share errors, of zeros and surveys, of the mesh or of the model."""
    return any(result.gauges.errors) or result.model_error is not None


def in_sd_note(result: Result, *, predictions: bool = False) -> str:
    """What the columns and axes "in sd" and "unexplained" of a result are, in sentences.

    Args:
        result: whose readings are shown.
        predictions: those beside predictions, too.
    """
    note = "In sd: residual divided by the standard deviation of the reading."
    if as_predicted(result) is not result:
        return (
            f"{note} Unexplained: reading minus its prediction by the last fit before its stage, "
            "in standard deviations of that prediction (parameters, accuracy and model error "
            "together)."
        )
    if shares_errors(result):
        parts = ["errors that readings share"] if any(result.gauges.errors) else []
        parts += ["the model error"] if result.model_error is not None else []
        note += (
            f" Unexplained: what is left of the residual when {' and '.join(parts)}, as the other "
            "readings show them, are taken off, in standard deviations of what remains."
        )
    if predictions and _reads_predictions(result):
        note += (
            " Beside a prediction, unexplained is the residual in standard deviations of the "
            "prediction."
        )
    return note


@dataclass(frozen=True)
class Outlier:
    """A reading far from what the model says.

    Args:
        channel: its gauge.
        stage: its stage.
        residual: what is unexplained of it, in standard deviations.
        used: it took part in the identification.
    """

    channel: str
    stage: str
    residual: float
    used: bool


def outliers(result: Result) -> tuple[Outlier, ...]:
    """Readings beyond `OUTLIER`, the farthest first, without those known to be wrong."""
    residual, table = unexplained(result), result.gauges
    readings = [
        Outlier(table.channels[i], table.stages[j], float(residual[i, j]), bool(table.used[i, j]))
        for i, j in np.argwhere((np.abs(np.nan_to_num(residual)) > OUTLIER) & ~table.bad)
    ]
    return tuple(sorted(readings, key=lambda each: -abs(each.residual)))


def rms(result: Result) -> float:
    """Root mean square of what is unexplained of used readings; about 1 for a good fit.

    Of a backtest, of the predictions.
    """
    used = unexplained(result)[result.gauges.used]
    used = used[np.isfinite(used)]
    return float(np.sqrt(np.mean(used**2))) if used.size else np.nan


def scored(result: Result) -> tuple[int, int]:
    """Later readings inside their 95 % band, and all of those that have one."""
    prediction = result.prediction
    if prediction is None:
        return 0, 0
    measured = result.gauges.measured
    known = np.isfinite(prediction.sd) & np.isfinite(measured)
    known &= ~(result.gauges.used | result.gauges.bad)
    inside = known & (measured >= prediction.lower95) & (measured <= prediction.upper95)
    return int(inside.sum()), int(known.sum())


def influence_title(diagnostics: Diagnostics | None) -> str:
    """What the table shows; with a robust loss also the plain weighted squares."""
    if diagnostics is None:
        return ""
    scale = number(diagnostics.scale, 2)
    title = f"Most influential readings (residuals: {scale} standard deviations of all errors)"
    if diagnostics.loss != "squared":
        title += f"\nLoss {diagnostics.loss}; plain weighted squares {number(diagnostics.squares)}"
    return title


def influence_table(result: Result) -> TextTable:
    """The readings whose removal would change the answer most, and how far off they are."""
    left = "unexplained" if shares_errors(result) else "in sd"
    header = ("gauge", "stage", left, "leverage", "weight", "changes most", "by sd")
    places, diagnostics = ranked_diagnostics(result)
    rows = []
    for k, (i, j) in enumerate(places[:MOST_INFLUENTIAL]):
        assert diagnostics is not None
        name, by = "", ""
        if (change := diagnostics.influence[k]).size:
            q = int(np.argmax(np.abs(change)))
            name = result.parameters.names[q]
            by = "all" if np.isinf(change[q]) else f"{change[q]:+.2f}"
        rows.append(
            [
                result.gauges.channels[i],
                result.gauges.stages[j],
                decimals(float(diagnostics.standardized[k]), 1),
                decimals(float(diagnostics.leverage[k]), 2),
                decimals(float(diagnostics.weight[k]), 2),
                name,
                by,
            ]
        )
    return TextTable(header, rows, right="llrrrlr")


def diagnostics_sheet(result: Result) -> CsvTable:
    """How each used reading acts on the answer, the most influential first."""
    places, diagnostics = ranked_diagnostics(result)
    if diagnostics is None:
        return CsvTable()
    return beside(
        sheet(result.gauges, "gauge", "stage", rows=places, only=("channels", "stages")),
        sheet(
            diagnostics, "reading",
            labels={"parameter": result.parameters.names}, only=(*DIAGNOSTIC_COLUMNS, "influence"),
        ),
    )  # fmt: skip


def diagnostics_object(result: Result) -> dict[str, Any]:
    """The loss, the plain weighted squares, and one object for every used reading, worst first."""
    places, diagnostics = ranked_diagnostics(result)
    if diagnostics is None:
        return {}
    names = objects(result.gauges, "gauge", "stage", rows=places, only=("channels", "stages"))
    numbers = objects(diagnostics, "reading", only=DIAGNOSTIC_COLUMNS)
    influence = [
        dict(zip(result.parameters.names, change, strict=True)) for change in diagnostics.influence
    ]
    readings = [
        {**name, **row, "influence": own}
        for name, row, own in zip(names, numbers, influence, strict=True)
    ]
    return {**attributes(diagnostics), "readings": readings}


def ranked_diagnostics(result: Result) -> tuple[Places, Diagnostics | None]:
    """Channel and stage of the m used readings, the most influential first, and (m,) diagnostics.

    Several readings in one place are one: `Diagnostics.wide`.
    """
    if result.diagnostics is None:
        return [], None
    wide = result.diagnostics.wide(result.gauges)
    places = np.argwhere(np.isfinite(wide.standardized))
    i, j = places[np.argsort(-wide.distance[tuple(places.T)], kind="stable")].T
    arrays = {name: getattr(wide, name)[i, j] for name in (*DIAGNOSTIC_COLUMNS, "influence")}
    return list(zip(i.tolist(), j.tolist(), strict=True)), replace(wide, **arrays)
