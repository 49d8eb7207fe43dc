"""How far readings are from what the model says: residuals, outliers, influence.

Residuals are measured minus computed, in standard deviations ("in sd", with one meaning).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from geoident.model.arrays import Bools, Floats
from geoident.model.results.backtest import predicted_before
from geoident.model.results.columns import ROW, column
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


def standardized(result: Result) -> Floats:
    """(n_channels, n_stages) measured minus computed "in sd", in its one meaning.

    In standard deviations of all errors that the fit assumed for the reading: its own, those that
    it shares with others and the model's. What the other readings explain of these errors is
    subtracted first (theory 7). A prediction has its own standard deviations, which include those
    of the parameters. So have all readings of a backtest (`as_predicted`); those that no fit has
    predicted have none. Tables, figures, outliers and their sentences all have these numbers;
    `in_sd_note` explains them in the output. NaN where nothing was measured or the prediction is
    not determined.
    """
    before = as_predicted(result)
    if before is not result and before.prediction is not None:
        with np.errstate(invalid="ignore"):
            z = (before.gauges.measured - before.prediction.mean) / before.prediction.sd
        return np.where(np.isfinite(before.prediction.sd), z, np.nan)
    table = result.gauges
    sd, computed = table.sd.copy(), table.computed.copy()
    if result.prediction is not None:
        predicted = beside_prediction(result)
        sd[predicted] = result.prediction.sd[predicted]
        computed[predicted] = result.prediction.mean[predicted]
    known = np.isfinite(sd) & (sd > 0)
    residual = table.measured - computed
    with np.errstate(over="ignore"):  # by a standard deviation of a damaged result
        ratio = np.divide(residual, sd, out=np.full(sd.shape, np.nan), where=known)
    if _errors_shared(result) and result.diagnostics is not None:
        wide = result.diagnostics.wide(table).standardized
        ratio = np.where(np.isfinite(wide), wide, ratio)
    return np.asarray(ratio)


@dataclass(frozen=True)
class ComparedReading:
    """A reading that was taken or computed, of a channel in a stage; SI, NaN where there is none.

    Args:
        gauge: name of the channel.
        stage: name of the stage.
        measured: what was read.
        computed: what it is compared with.
        residual: measured less computed.
        sd: standard deviation of what it is compared with.
        unit: in which people see it.
        residual_in_sd: the residual "in sd": see `standardized`.
        used: it took part in the identification.
        bad: it is known to be wrong.
        dimension: key of `geoident.units.DIMENSIONS`.
    """

    gauge: str
    stage: str
    measured: float = field(metadata=column(dimension=ROW))
    computed: float = field(metadata=column(dimension=ROW))
    residual: float = field(metadata=column(dimension=ROW, hidden=("json",)))
    sd: float = field(metadata=column(dimension=ROW))
    unit: str = field(metadata=column(dimension=ROW))
    residual_in_sd: float = field(metadata=column(hidden=("json",)))
    used: bool
    bad: bool = field(metadata=column(hidden=("csv",)))
    dimension: str = field(metadata=column(hidden=("csv", "json")))


def compared_readings(result: Result) -> list[ComparedReading]:
    """Every reading beside what it is compared with, stage by stage.

    That is what a fit computes, with the accuracies; of a backtest its predictions
    (`as_predicted`) with their standard deviations, NaN where they are not determined. Readings
    before which there was no fit stand beside what the last one computes, without standard
    deviation.
    """
    table, in_sd = result.gauges, standardized(result)
    computed, sd = table.computed, table.sd
    predicted = as_predicted(result)
    if predicted is not result and predicted.prediction is not None:
        prediction = predicted.prediction
        sd = np.where(prediction.known, prediction.sd, np.nan)
        first = ~np.isfinite(prediction.mean)
        later = np.where(prediction.known, prediction.mean, np.nan)
        computed = np.where(first, table.computed, later)
    return [
        ComparedReading(
            table.channels[i], table.stages[j], table.measured[i, j], computed[i, j],
            table.measured[i, j] - computed[i, j], sd[i, j], table.units[i], in_sd[i, j],
            bool(table.used[i, j]), bool(table.bad[i, j]), table.dimensions[i],
        )
        for i, j in by_stage(np.isfinite(table.measured) | np.isfinite(computed))
    ]  # fmt: skip


def _errors_shared(result: Result) -> bool:
    """Readings share errors, of zeros and surveys or of the model."""
    return any(result.gauges.errors) or result.model_error is not None


def in_sd_note(result: Result) -> str:
    """What the columns and axes "in sd" of a result are, in a sentence."""
    if as_predicted(result) is not result:
        return (
            "in sd: reading minus its prediction by the last fit before its stage, in standard "
            "deviations of that prediction (parameters, accuracy and model error together)."
        )
    predicted = (
        "" if result.prediction is None else " For predictions: those of the prediction itself."
    )
    if not _errors_shared(result):
        return f"in sd: residual in standard deviations of the accuracy.{predicted}"
    parts = ["accuracy"]
    parts += ["errors that readings share"] if any(result.gauges.errors) else []
    parts += ["model error"] if result.model_error is not None else []
    return (
        f"in sd: residual in standard deviations of {_listed(parts)} together. What the other "
        f"readings explain of these errors is subtracted first.{predicted}"
    )


def _listed(words: Sequence[str]) -> str:
    return words[0] if len(words) == 1 else f"{', '.join(words[:-1])} and {words[-1]}"


@dataclass(frozen=True)
class Outlier:
    """A reading far from what the model says.

    Args:
        channel: its gauge.
        stage: its stage.
        residual: measured minus computed, in standard deviations.
        used: it took part in the identification.
    """

    channel: str
    stage: str
    residual: float
    used: bool


def outliers(result: Result) -> tuple[Outlier, ...]:
    """Readings beyond `OUTLIER`, the farthest first, without those known to be wrong."""
    residual, table = standardized(result), result.gauges
    readings = [
        Outlier(table.channels[i], table.stages[j], float(residual[i, j]), bool(table.used[i, j]))
        for i, j in np.argwhere((np.abs(np.nan_to_num(residual)) > OUTLIER) & ~table.bad)
    ]
    return tuple(sorted(readings, key=lambda each: -abs(each.residual)))


def rms(result: Result) -> float:
    """Root mean square of the standardized residuals that were used; about 1 for a good fit.

    Of a backtest, of the predictions.
    """
    used = standardized(result)[result.gauges.used]
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
    header = ("gauge", "stage", "in sd", "leverage", "weight", "changes most", "by sd")
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
