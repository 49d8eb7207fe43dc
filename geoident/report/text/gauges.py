"""Readings beside what the model says of them: tables, residuals, predictions, influence.

Readings in mm. Residuals are measured minus computed, in standard deviations.
"""

from __future__ import annotations

import csv
import io
import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from geoident.model.arrays import Bools, Floats, Ints
from geoident.model.gauges import Reading
from geoident.model.result import Diagnostics, GaugeTable, Prediction, Result
from geoident.report.text.layout import TextTable, decimals, number
from geoident.report.text.parameters import NOT_DETERMINED

OUTLIER = 3.0
"""Standard deviations beyond which a reading is named."""

MOST_INFLUENTIAL = 5
"""Readings in the table of influence."""


def readings_csv(readings: Sequence[Reading]) -> str:
    """Readings as a case reads them: ``gauge,stage,value,unit``, in mm; no value, an empty cell.

    >>> print(readings_csv([Reading("EX1", "bench 1", 0.0123)]), end="")
    gauge,stage,value,unit
    EX1,bench 1,12.3,mm
    """
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(["gauge", "stage", "value", "unit"])
    for reading in readings:
        value = "" if reading.value is None else f"{1e3 * reading.value:.12g}"
        writer.writerow([reading.channel, reading.stage, value, "mm"])
    return text.getvalue()


def in_mm(value: float, result: Result) -> str:
    """A length in m as millimetres, with a decimal more than the best gauge can read."""
    known = result.gauges.sd[result.gauges.sd > 0.0]
    best = float(known.min()) if known.size else 1e-4
    return decimals(1e3 * value, min(6, max(2, 1 - math.floor(math.log10(1e3 * best) + 1e-9))))


def by_stage(shown: Bools) -> list[tuple[int, int]]:
    """Channel and stage of the entries (n_channels, n_stages) that are shown, stage by stage."""
    return [(i, j) for j, i in np.argwhere(shown.T).tolist()]


def fit_title(result: Result) -> str:
    """How many readings were used, and the misfit."""
    used = np.count_nonzero(result.gauges.used)
    phi = "" if math.isnan(result.objective) else f", misfit {number(result.objective)}"
    return f"Readings (mm; {used} used{phi})"


def fit_table(result: Result) -> TextTable:
    """Measured and computed readings, without those that stand among the predictions."""
    gauges = result.gauges
    shown = np.isfinite(gauges.measured) & (gauges.used | ~_has_prediction(result))
    rows = []
    for i, j in by_stage(shown):
        measured, computed = float(gauges.measured[i, j]), float(gauges.computed[i, j])
        lengths = [in_mm(length, result) for length in (measured, computed, measured - computed)]
        in_sd = decimals((measured - computed) / float(gauges.sd[i, j]), 1)
        rows.append([gauges.channels[i], gauges.stages[j], *lengths, in_sd, _use(gauges, i, j)])
    header = ("gauge", "stage", "measured", "computed", "residual", "in sd", "")
    return TextTable(header, rows, right="llrrrrl")


def _has_prediction(result: Result) -> Bools:
    """(n_channels, n_stages) there is a prediction, determined or not."""
    if result.prediction is None:
        return np.zeros(result.gauges.computed.shape, dtype=bool)
    return np.asarray(np.isfinite(result.prediction.mean))


def _use(gauges: GaugeTable, i: int, j: int) -> str:
    if gauges.bad[i, j]:
        return "bad"
    return "" if gauges.used[i, j] else "not used"


def prediction_table(result: Result) -> TextTable:
    """Predicted readings with their bands, and the readings where there are any."""
    header = ("gauge", "stage", "predicted", "from", "to", "measured", "")
    prediction = result.prediction
    if prediction is None:
        return TextTable(header, ())
    places = by_stage(_has_prediction(result))
    return TextTable(
        header, [_prediction_row(result, prediction, i, j) for i, j in places], right="llrrrrl"
    )


def _prediction_row(result: Result, prediction: Prediction, i: int, j: int) -> list[str]:
    gauges = result.gauges
    low, high = float(prediction.lower95[i, j]), float(prediction.upper95[i, j])
    known = math.isfinite(low) and math.isfinite(high)
    cells = (float(prediction.mean[i, j]), low, high) if known else (math.nan,) * 3
    measured = float(gauges.measured[i, j])
    inside = _mark(measured, low, high) if known else NOT_DETERMINED
    texts = [in_mm(cell, result) for cell in (*cells, measured)]
    return [gauges.channels[i], gauges.stages[j], *texts, inside]


def _mark(measured: float, low: float, high: float) -> str:
    if math.isnan(measured):
        return ""
    return "inside" if low <= measured <= high else "outside"


def reading_table(result: Result) -> TextTable:
    """Every reading that is measured or predicted."""
    shown = np.isfinite(result.gauges.measured) | _has_prediction(result)
    residual = standardized(result)
    rows = [_reading_row(result, i, j, float(residual[i, j])) for i, j in by_stage(shown)]
    header = ("gauge", "stage", "measured", "computed", "95 % band", "residual", "in sd", "")
    return TextTable(header, rows, right="llrrrrrl")


def _reading_row(result: Result, i: int, j: int, in_sd: float) -> list[str]:
    gauges, prediction = result.gauges, result.prediction
    measured, computed = float(gauges.measured[i, j]), float(gauges.computed[i, j])
    state, band, determined = "used" if gauges.used[i, j] else "not used", "-", True
    if prediction is not None and not gauges.used[i, j] and np.isfinite(prediction.mean[i, j]):
        state, determined = "predicted", bool(np.isfinite(prediction.sd[i, j]))
        if determined:
            ends = (prediction.lower95[i, j], prediction.upper95[i, j])
            band = " to ".join(in_mm(float(end), result) for end in ends)
    return [
        gauges.channels[i],
        gauges.stages[j],
        in_mm(measured, result),
        in_mm(computed, result) if determined else NOT_DETERMINED,
        band,
        in_mm(measured - computed, result) if determined else "-",
        decimals(in_sd, 1),
        "known to be wrong" if gauges.bad[i, j] else state,
    ]


def standardized(result: Result) -> Floats:
    """(n_channels, n_stages) measured minus computed in standard deviations.

    That of the gauge, and for a prediction that of the prediction, which holds both the gauge's and
    the parameters'. NaN where nothing was measured or the prediction is not determined.
    """
    table = result.gauges
    sd = table.sd.copy()
    if result.prediction is not None:
        predicted = _has_prediction(result) & ~table.used
        sd[predicted] = result.prediction.sd[predicted]
    known = np.isfinite(sd) & (sd > 0)
    residual = table.measured - table.computed
    return np.asarray(np.divide(residual, sd, out=np.full(sd.shape, np.nan), where=known))


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
    found = [
        Outlier(table.channels[i], table.stages[j], float(residual[i, j]), bool(table.used[i, j]))
        for i, j in np.argwhere((np.abs(np.nan_to_num(residual)) > OUTLIER) & ~table.bad)
    ]
    return tuple(sorted(found, key=lambda each: -abs(each.residual)))


def rms(result: Result) -> float:
    """Root mean square of the standardized residuals that were used; about 1 for a good fit."""
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


def influence_title(found: Diagnostics | None) -> str:
    """What the table shows; with a robust loss also the plain weighted squares."""
    if found is None:
        return ""
    scale = number(found.scale, 2)
    title = f"Most influential readings (residuals have {scale} of the stated standard deviation)"
    if found.loss != "squared":
        title += f"\nLoss {found.loss}; plain weighted squares {number(found.squares)}"
    return title


def influence_table(result: Result) -> TextTable:
    """The readings whose removal would change the answer most, and how far off they are."""
    header = ("gauge", "stage", "in sd", "leverage", "weight", "changes most", "by sd")
    found = wide_diagnostics(result)
    if found is None:
        return TextTable(header, ())
    worst = by_distance(found)[:MOST_INFLUENTIAL].tolist()
    return TextTable(
        header, [_influence_row(result, found, *each) for each in worst], right="llrrrlr"
    )


def _influence_row(result: Result, found: Diagnostics, i: int, j: int) -> list[str]:
    change = found.influence[i, j]
    k = int(np.argmax(np.abs(change))) if change.size else -1
    return [
        result.gauges.channels[i],
        result.gauges.stages[j],
        decimals(float(found.studentized[i, j]), 1),
        decimals(float(found.leverage[i, j]), 2),
        decimals(float(found.weight[i, j]), 2),
        result.parameters.names[k] if change.size else "",
        ("all" if np.isinf(change[k]) else f"{change[k]:+.2f}") if change.size else "",
    ]


def diagnostics_object(result: Result) -> dict[str, Any]:
    """The loss, the plain weighted squares, and one object for every used reading, worst first."""
    found = wide_diagnostics(result)
    if found is None:
        return {}
    names = ("standardized", "studentized", "weight", "leverage", "distance")
    readings = [
        {
            "gauge": result.gauges.channels[i],
            "stage": result.gauges.stages[j],
            **{name: getattr(found, name)[i, j] for name in names},
            "influence": dict(zip(result.parameters.names, found.influence[i, j], strict=True)),
        }
        for i, j in by_distance(found)
    ]
    return {
        "loss": found.loss,
        "weighted_squares": found.squares,
        "scale": found.scale,
        "readings": readings,
    }


def wide_diagnostics(result: Result) -> Diagnostics | None:
    """The diagnostics by channel and stage: several readings in one place in one row."""
    return None if result.diagnostics is None else result.diagnostics.wide(result.gauges)


def by_distance(found: Diagnostics) -> Ints:
    """(m, 2) channel and stage of the used readings, the most influential first."""
    places = np.argwhere(np.isfinite(found.standardized))
    distance = found.distance[places[:, 0], places[:, 1]]
    return np.asarray(places[np.argsort(-distance, kind="stable")], dtype=np.int64)
