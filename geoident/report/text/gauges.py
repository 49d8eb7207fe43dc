"""Readings beside what the model says of them: tables, residuals, predictions, influence.

Readings stand in the units of their channels; residuals are measured minus computed, in standard
deviations.
"""

from __future__ import annotations

import csv
import io
import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from datetime import UTC, datetime, timedelta
from typing import Any

import numpy as np

from geoident.model.arrays import Bools, Floats, Ints
from geoident.model.gauges import Channel, Reading
from geoident.model.results.bands import told_before
from geoident.model.results.result import Diagnostics, GaugeTable, Prediction, Result
from geoident.report.text.layout import TextTable, decimals, number, with_interval
from geoident.report.text.parameters import NOT_DETERMINED
from geoident.units import in_unit, shown_unit

OUTLIER = 3.0
"""Standard deviations beyond which a reading is named."""

MOST_INFLUENTIAL = 5
"""Readings in the table of influence."""


_FINER = 1e5
"""Times an accuracy is larger than the last digit of a simulated reading."""


def readings_csv(readings: Sequence[Reading], channels: Sequence[Channel]) -> str:
    """Readings as a case reads them: ``gauge,stage,value,unit``; no value, an empty cell.

    The last digit is 1e-5 of the accuracy of the gauge, or less.

    Args:
        readings: of the channels.
        channels: know in which unit they are shown.

    >>> tape = Channel("CV", "CV", "convergence", (0.0,), (4.0,), (1.0,), 1e-4, "virgin")
    >>> print(readings_csv([Reading("CV", "bench 1", 0.0123)], [tape]), end="")
    gauge,stage,value,unit
    CV,bench 1,12.3,mm
    """
    known = {channel.name: channel for channel in channels}
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(["gauge", "stage", "value", "unit"])
    for reading in readings:
        channel = known[reading.channel]
        unit = channel.unit, channel.dimension
        value = "" if reading.value is None else _plain(in_unit(reading.value, *unit), channel)
        writer.writerow([reading.channel, reading.stage, value, shown_unit(*unit)])
    return text.getvalue()


def _plain(value: float, channel: Channel) -> str:
    """A value in the unit of its channel, with the digits that its accuracy warrants and more."""
    step = abs(in_unit(channel.accuracy, channel.unit, channel.dimension)) / _FINER
    if not (math.isfinite(step) and step > 0.0):
        return f"{value:.12g}"
    places = max(0, math.ceil(-math.log10(step) - 1e-9))
    text = f"{value:.{places}f}"
    shown = text.rstrip("0").rstrip(".") if places else text
    return "0" if shown == "-0" else shown


def reading_text(gauges: GaugeTable, row: int, value: float) -> str:
    """A value of a channel in its unit, with a decimal more than the best gauge can read.

    Args:
        gauges: all of them.
        row: of the channel.
        value: SI.
    """
    unit = gauges.units[row], gauges.dimensions[row]
    return decimals(in_unit(value, *unit), _read_places(gauges, row))


def _read_places(gauges: GaugeTable, row: int) -> int:
    """Decimals in the unit of a channel: one more than the best gauge of that unit can read."""
    unit = gauges.units[row], gauges.dimensions[row]
    finest = gauges.finest.get(gauges.shown_units[row])
    best = 0.1 if finest is None else in_unit(finest, *unit)
    return min(6, max(2, 1 - math.floor(math.log10(best) + 1e-9)))


def predicted_texts(
    gauges: GaugeTable, row: int, mean: float, low: float, high: float
) -> tuple[str, str, str]:
    """A predicted reading and the ends of its band, with the digits that the band warrants.

    Args:
        gauges: all of them.
        row: of the channel.
        mean: the prediction, SI; NaN for none.
        low: lower end of its 95 % band.
        high: upper end.
    """
    unit = gauges.units[row], gauges.dimensions[row]
    texts = with_interval(
        *(in_unit(x, *unit) for x in (mean, low, high)), most=_read_places(gauges, row)
    )
    return ("-", "-", "-") if math.isnan(mean) else texts


def unit_title(title: str, gauges: GaugeTable, *more: str) -> str:
    """The title of a table of readings, with their unit if all have the same.

    Args:
        title: of the table.
        gauges: whose readings it has.
        more: what else stands in brackets.
    """
    said = "; ".join(word for word in (gauges.common_unit, *more) if word)
    return f"{title} ({said})" if said else title


def _unit_cell(gauges: GaugeTable, row: int) -> list[str]:
    """The unit of a channel for a column of its own, where the title cannot say it."""
    return [] if gauges.common_unit is not None else [gauges.shown_units[row]]


def _reading_table(
    gauges: GaugeTable, header: Sequence[str], rows: Sequence[Sequence[str]], right: str
) -> TextTable:
    """A table of readings; its third column is `_unit_cell` where the title cannot say it."""
    if gauges.common_unit is None:
        header, right = [*header[:2], "unit", *header[2:]], f"{right[:2]}l{right[2:]}"
    return TextTable(header, rows, right=right)


def by_stage(shown: Bools) -> list[tuple[int, int]]:
    """Channel and stage of the entries (n_channels, n_stages) that are shown, stage by stage."""
    return [(i, j) for j, i in np.argwhere(shown.T).tolist()]


def as_predicted(result: Result) -> Result:
    """A backtest with its readings beside what the last fit before each has predicted.

    A reading of a backtest is fitted in the end; what is told of it is how it was predicted.
    Readings before the second fit are shown as they were fitted last. Other results stay as they
    are.
    """
    if result.kind != "backtest" or result.backtest is None:
        return result
    return replace(result, prediction=told_before(result.backtest))


def fit_title(result: Result) -> str:
    """How many readings were used, and the misfit; of a backtest what they stand beside."""
    if as_predicted(result) is not result:
        return unit_title("Readings, each beside its prediction by the fit before", result.gauges)
    used = np.count_nonzero(result.gauges.used)
    phi = "" if math.isnan(result.objective) else f", misfit {number(result.objective)}"
    return unit_title("Readings", result.gauges, f"{used} used{phi}")


def fit_table(result: Result) -> TextTable:
    """Measured and computed readings, without those that stand among the predictions.

    Those of a backtest are all predictions, but for the first ones: `reading_table`.
    """
    if as_predicted(result) is not result:
        return reading_table(result)
    gauges = result.gauges
    shown = np.isfinite(gauges.measured) & (gauges.used | ~_has_prediction(result))
    residual = standardized(result)
    rows = []
    for i, j in by_stage(shown):
        measured, computed = float(gauges.measured[i, j]), float(gauges.computed[i, j])
        three = (measured, computed, measured - computed)
        texts = [reading_text(gauges, i, value) for value in three]
        in_sd = decimals(float(residual[i, j]), 1)
        names = [gauges.channels[i], gauges.stages[j], *_unit_cell(gauges, i)]
        rows.append([*names, *texts, in_sd, _with_note(gauges, i, j, _use(gauges, i, j))])
    header = ("gauge", "stage", "measured", "computed", "residual", "in sd", "")
    return _reading_table(gauges, header, rows, "llrrrrl")


def _has_prediction(result: Result) -> Bools:
    """(n_channels, n_stages) there is a prediction, determined or not."""
    if result.prediction is None:
        return np.zeros(result.gauges.computed.shape, dtype=bool)
    return np.asarray(np.isfinite(result.prediction.mean))


def _told(result: Result) -> Bools:
    """(n_channels, n_stages) a reading stands beside its prediction, not beside a fit."""
    told = _has_prediction(result)
    return told if result.kind == "backtest" else told & ~result.gauges.used


def _with_note(gauges: GaugeTable, i: int, j: int, state: str) -> str:
    """How a reading is used, and the remarks of the field sheet on it."""
    table, pair = gauges.readings, (gauges.channels[i], gauges.stages[j])
    if not table.note:
        return state
    remarks = [note for note, own in zip(table.note, table.pairs, strict=True) if own == pair]
    return "; ".join(dict.fromkeys(text for text in (state, *remarks) if text))


def _use(gauges: GaugeTable, i: int, j: int) -> str:
    if gauges.bad[i, j]:
        return "bad"
    return "" if gauges.used[i, j] else "not used"


def prediction_title(result: Result) -> str:
    """What the table of predictions shows."""
    unit = result.gauges.common_unit
    return f"Predictions ({unit}, 95 % band)" if unit else "Predictions (95 % band)"


def prediction_table(result: Result) -> TextTable:
    """Predicted readings with their bands, and the readings where there are any."""
    header = ("gauge", "stage", "predicted", "from", "to", "measured", "")
    prediction = result.prediction
    if prediction is None:
        return TextTable(header, ())
    rows = [
        _prediction_row(result, prediction, *place) for place in by_stage(_has_prediction(result))
    ]
    return _reading_table(result.gauges, header, rows, "llrrrrl")


def _prediction_row(result: Result, prediction: Prediction, i: int, j: int) -> list[str]:
    gauges = result.gauges
    low, high = float(prediction.lower95[i, j]), float(prediction.upper95[i, j])
    known = math.isfinite(low) and math.isfinite(high)
    mean = float(prediction.mean[i, j]) if known else math.nan
    measured = float(gauges.measured[i, j])
    inside = _mark(measured, low, high) if known else NOT_DETERMINED
    texts = *predicted_texts(gauges, i, mean, low, high), reading_text(gauges, i, measured)
    return [gauges.channels[i], gauges.stages[j], *_unit_cell(gauges, i), *texts, inside]


def _mark(measured: float, low: float, high: float) -> str:
    if math.isnan(measured):
        return ""
    return "inside" if low <= measured <= high else "outside"


def reading_table(result: Result) -> TextTable:
    """Every reading that is measured or predicted."""
    result = as_predicted(result)
    shown = np.isfinite(result.gauges.measured) | _has_prediction(result)
    residual = standardized(result)
    told = _told(result)
    rows = [
        _reading_row(result, i, j, float(residual[i, j]), told=bool(told[i, j]))
        for i, j in by_stage(shown)
    ]
    header = ("gauge", "stage", "measured", "computed", "95 % band", "residual", "in sd", "")
    return _reading_table(result.gauges, header, rows, "llrrrrrl")


def _reading_row(result: Result, i: int, j: int, in_sd: float, *, told: bool) -> list[str]:
    gauges, prediction = result.gauges, result.prediction
    measured, computed = float(gauges.measured[i, j]), float(gauges.computed[i, j])
    state, band, determined = "used" if gauges.used[i, j] else "not used", "-", True
    said = reading_text(gauges, i, computed)
    if prediction is not None and told:
        state, determined = "predicted", bool(np.isfinite(prediction.sd[i, j]))
        if determined:
            of = (prediction.mean, prediction.lower95, prediction.upper95)
            said, low, high = predicted_texts(gauges, i, *(float(table[i, j]) for table in of))
            computed, band = float(prediction.mean[i, j]), f"{low} to {high}"
    return [
        gauges.channels[i],
        gauges.stages[j],
        *_unit_cell(gauges, i),
        reading_text(gauges, i, measured),
        said if determined else NOT_DETERMINED,
        band,
        reading_text(gauges, i, measured - computed) if determined else "-",
        decimals(in_sd, 1),
        _with_note(gauges, i, j, "known to be wrong" if gauges.bad[i, j] else state),
    ]


def standardized(result: Result) -> Floats:
    """(n_channels, n_stages) measured minus computed "in sd", in its one meaning.

    In standard deviations of all errors that the fit assumed for the reading: its own, those that
    it shares with others and the model's; of these, without what the other readings tell of them
    (theory 7). For a prediction in those of the prediction, which hold the parameters' too; so for
    all readings of a backtest (`as_predicted`), where those that no fit has predicted have none.
    Tables, figures, outliers and their sentences all have these numbers; `in_sd_note` says so to
    people. NaN where nothing was measured or the prediction is not determined.
    """
    told = as_predicted(result)
    if told is not result and told.prediction is not None:
        with np.errstate(invalid="ignore"):
            z = (told.gauges.measured - told.prediction.mean) / told.prediction.sd
        return np.where(np.isfinite(told.prediction.sd), z, np.nan)
    table = result.gauges
    sd, computed = table.sd.copy(), table.computed.copy()
    if result.prediction is not None:
        predicted = _told(result)
        sd[predicted] = result.prediction.sd[predicted]
        computed[predicted] = result.prediction.mean[predicted]
    known = np.isfinite(sd) & (sd > 0)
    residual = table.measured - computed
    found = np.divide(residual, sd, out=np.full(sd.shape, np.nan), where=known)
    if _errors_shared(result) and result.diagnostics is not None:
        wide = result.diagnostics.wide(table).standardized
        found = np.where(np.isfinite(wide), wide, found)
    return np.asarray(found)


def compared_with(result: Result) -> tuple[Floats, Floats]:
    """What readings are compared with, and its standard deviations, (n_channels, n_stages) each.

    What a fit computes, and the accuracies; of a backtest its predictions (`as_predicted`) and
    their standard deviations, NaN where they are not determined. Readings before which there was
    no fit stand beside what the last one computes, without standard deviation.
    """
    told = as_predicted(result)
    if told is result or told.prediction is None:
        return result.gauges.computed, result.gauges.sd
    known = np.isfinite(told.prediction.sd)
    first = ~np.isfinite(told.prediction.mean)
    computed = np.where(known, told.prediction.mean, np.nan)
    return (
        np.where(first, result.gauges.computed, computed),
        np.where(known, told.prediction.sd, np.nan),
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
    found = [
        Outlier(table.channels[i], table.stages[j], float(residual[i, j]), bool(table.used[i, j]))
        for i, j in np.argwhere((np.abs(np.nan_to_num(residual)) > OUTLIER) & ~table.bad)
    ]
    return tuple(sorted(found, key=lambda each: -abs(each.residual)))


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


def influence_title(found: Diagnostics | None) -> str:
    """What the table shows; with a robust loss also the plain weighted squares."""
    if found is None:
        return ""
    scale = number(found.scale, 2)
    title = f"Most influential readings (residuals: {scale} of the stated standard deviation)"
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
        decimals(float(found.standardized[i, j]), 1),
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
        "misfit": found.misfit,
        "above": found.above,
        "below": found.below,
        "readings": readings,
    }


def wide_diagnostics(result: Result) -> Diagnostics | None:
    """The diagnostics by channel and stage: several readings in one place in one row."""
    return None if result.diagnostics is None else result.diagnostics.wide(result.gauges)


def each_reading(gauges: GaugeTable) -> list[dict[str, Any]]:
    """Every reading with its time, and why it is not used, in the order of the files.

    Values in SI, the time as text or None; ``shown`` is unit and dimension of its channel.
    """
    table = gauges.readings
    units = zip(gauges.channels, gauges.units, gauges.dimensions, strict=True)
    shown = {channel: (unit, dimension) for channel, unit, dimension in units}
    return [
        {
            "gauge": table.channel[k],
            "stage": table.stage[k],
            "time": moment_text(float(table.time[k])),
            "value": float(table.value[k]),
            "computed": float(table.computed[k]),
            "sd": float(table.sd[k]),
            "used": bool(table.used[k]),
            "reason": table.reason[k],
            "note": table.notes[k],
            "shown": shown[table.channel[k]],
        }
        for k in range(len(table))
    ]


def moment_text(seconds: float) -> str | None:
    """Date and time (ISO 8601) of seconds since 1970; None for NaN.

    >>> moment_text(86400.0)
    '1970-01-02T00:00:00'
    """
    if math.isnan(seconds):
        return None
    moment = datetime(1970, 1, 1, tzinfo=UTC) + timedelta(seconds=seconds)
    return moment.replace(tzinfo=None).isoformat(timespec="seconds")


def by_distance(found: Diagnostics) -> Ints:
    """(m, 2) channel and stage of the used readings, the most influential first."""
    places = np.argwhere(np.isfinite(found.standardized))
    distance = found.distance[places[:, 0], places[:, 1]]
    return np.asarray(places[np.argsort(-distance, kind="stable")], dtype=np.int64)
