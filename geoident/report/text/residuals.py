"""How far readings are from what the model says: residuals, outliers, influence.

Residuals are measured minus computed, in standard deviations ("in sd", with one meaning).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from geoident.model.arrays import Bools, Floats, Ints
from geoident.model.results.backtest import predicted_before
from geoident.model.results.result import Diagnostics, Result
from geoident.report.text.layout import TextTable, decimals, number

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
    it shares with others and the model's; of these, without what the other readings tell of them
    (theory 7). For a prediction in those of the prediction, which hold the parameters' too; so for
    all readings of a backtest (`as_predicted`), where those that no fit has predicted have none.
    Tables, figures, outliers and their sentences all have these numbers; `in_sd_note` says so to
    people. NaN where nothing was measured or the prediction is not determined.
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


def compared_with(result: Result) -> tuple[Floats, Floats]:
    """What readings are compared with, and its standard deviations, (n_channels, n_stages) each.

    What a fit computes, and the accuracies; of a backtest its predictions (`as_predicted`) and
    their standard deviations, NaN where they are not determined. Readings before which there was
    no fit stand beside what the last one computes, without standard deviation.
    """
    predicted = as_predicted(result)
    if predicted is result or predicted.prediction is None:
        return result.gauges.computed, result.gauges.sd
    known = np.isfinite(predicted.prediction.sd)
    first = ~np.isfinite(predicted.prediction.mean)
    computed = np.where(known, predicted.prediction.mean, np.nan)
    return (
        np.where(first, result.gauges.computed, computed),
        np.where(known, predicted.prediction.sd, np.nan),
    )


def _errors_shared(result: Result) -> bool:
    """Readings share errors, of zeros and surveys or of the model."""
    return any(result.gauges.errors) or result.model_error is not None


def in_sd_note(result: Result) -> str:
    """What the columns and axes "in sd" of a result are, in a sentence."""
    if as_predicted(result) is not result:
        return (
            "in sd: reading less its prediction by the last fit before its stage, in standard "
            "deviations of that prediction (of parameters, accuracy and model error together)."
        )
    predicted = "" if result.prediction is None else "; of predictions, those of the prediction"
    if not _errors_shared(result):
        return f"in sd: residual in standard deviations of the accuracy{predicted}."
    parts = ["accuracy"]
    parts += ["errors that readings share"] if any(result.gauges.errors) else []
    parts += ["model error"] if result.model_error is not None else []
    return (
        f"in sd: residual in standard deviations of {_listed(parts)} together, without what the "
        f"other readings tell of them{predicted}."
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
    diagnostics = wide_diagnostics(result)
    if diagnostics is None:
        return TextTable(header, ())
    worst = by_distance(diagnostics)[:MOST_INFLUENTIAL].tolist()
    return TextTable(
        header, [_influence_row(result, diagnostics, *each) for each in worst], right="llrrrlr"
    )


def _influence_row(result: Result, diagnostics: Diagnostics, i: int, j: int) -> list[str]:
    change = diagnostics.influence[i, j]
    k = int(np.argmax(np.abs(change))) if change.size else -1
    return [
        result.gauges.channels[i],
        result.gauges.stages[j],
        decimals(float(diagnostics.standardized[i, j]), 1),
        decimals(float(diagnostics.leverage[i, j]), 2),
        decimals(float(diagnostics.weight[i, j]), 2),
        result.parameters.names[k] if change.size else "",
        ("all" if np.isinf(change[k]) else f"{change[k]:+.2f}") if change.size else "",
    ]


def diagnostics_object(result: Result) -> dict[str, Any]:
    """The loss, the plain weighted squares, and one object for every used reading, worst first."""
    diagnostics = wide_diagnostics(result)
    if diagnostics is None:
        return {}
    names = ("standardized", "studentized", "weight", "leverage", "distance")
    readings = [
        {
            "gauge": result.gauges.channels[i],
            "stage": result.gauges.stages[j],
            **{name: getattr(diagnostics, name)[i, j] for name in names},
            "influence": dict(
                zip(result.parameters.names, diagnostics.influence[i, j], strict=True)
            ),
        }
        for i, j in by_distance(diagnostics)
    ]
    return {
        "loss": diagnostics.loss,
        "weighted_squares": diagnostics.squares,
        "scale": diagnostics.scale,
        "misfit": diagnostics.misfit,
        "above": diagnostics.above,
        "below": diagnostics.below,
        "readings": readings,
    }


def wide_diagnostics(result: Result) -> Diagnostics | None:
    """The diagnostics by channel and stage: several readings in one place in one row."""
    return None if result.diagnostics is None else result.diagnostics.wide(result.gauges)


def by_distance(diagnostics: Diagnostics) -> Ints:
    """(m, 2) channel and stage of the used readings, the most influential first."""
    places = np.argwhere(np.isfinite(diagnostics.standardized))
    distance = diagnostics.distance[places[:, 0], places[:, 1]]
    return np.asarray(places[np.argsort(-distance, kind="stable")], dtype=np.int64)
