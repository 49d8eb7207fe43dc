"""Readings beside what the model says of them, in tables: as fitted, as predicted.

Readings stand in the units of their channels. `residuals` says what "in sd" and "unexplained" are.
"""

from __future__ import annotations

import csv
import io
import math
from collections.abc import Sequence

import numpy as np

from geoident.model.arrays import Bools, Floats
from geoident.model.gauges import Channel, Reading
from geoident.model.results.bands import Prediction
from geoident.model.results.columns import ROW, Record, column
from geoident.model.results.result import GaugeTable, Result
from geoident.report.text.layout import TextTable, decimals, moment_text, number, with_interval
from geoident.report.text.parameters import NOT_DETERMINED
from geoident.report.text.residuals import (
    as_predicted,
    beside_prediction,
    has_prediction,
    has_unexplained,
    residual_in_sd,
    unexplained,
)
from geoident.report.text.rows import by_stage
from geoident.units import in_unit, shown_unit

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
    unit = "; ".join(word for word in (gauges.common_unit, *more) if word)
    return f"{title} ({unit})" if unit else title


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


MOST_SHOWN = 300
"""Readings of a table on the screen or a page; the result file and exported tables have all."""


def _farthest(shown: Bools, result: Result) -> list[tuple[int, int]]:
    """Entries that are shown (n_channels, n_stages), stage by stage; of many the farthest off.

    Args:
        shown: which there are.
        result: says how far readings are from the model; predictions that were not read count as
            near.
    """
    if np.count_nonzero(shown) <= MOST_SHOWN:
        return by_stage(shown)
    off = np.where(shown, np.abs(np.nan_to_num(unexplained(result))), -1.0)
    kept = np.zeros_like(shown)
    kept.flat[np.argsort(-off, axis=None, kind="stable")[:MOST_SHOWN]] = True
    return by_stage(kept)


def _shown_stages(result: Result) -> Bools:
    """(n_stages,) those of which tables of readings show predictions.

    Ends of stages, what was read, and what comes after the last readings of the fit: the other
    moments of stages that last are for pictures.
    """
    gauges = result.gauges
    used = np.flatnonzero(gauges.used.any(axis=0))
    later = np.arange(len(gauges.stages)) > (used[-1] if len(used) else -1)
    return np.asarray(gauges.ends | np.isfinite(gauges.measured).any(axis=0) | later)


def few_of(count: int) -> str:
    """What a title says where a table shows some of its readings; empty where it shows all."""
    if count <= MOST_SHOWN:
        return ""
    return f"the {MOST_SHOWN} of {count} that are farthest off; the result file has all"


def _fitted(result: Result) -> Bools:
    """(n_channels, n_stages) readings that do not stand among the predictions."""
    gauges = result.gauges
    read = np.isfinite(gauges.measured) & (not result.in_service)
    return read & (gauges.used | ~has_prediction(result))


def fit_title(result: Result) -> str:
    """How many readings were used, and the misfit; of a backtest what they stand beside."""
    if as_predicted(result) is not result:
        return unit_title("Readings, each beside its prediction by the fit before", result.gauges)
    used = np.count_nonzero(result.gauges.used)
    phi = "" if math.isnan(result.objective) else f", misfit {number(result.objective)}"
    few = few_of(int(np.count_nonzero(_fitted(result))))
    return unit_title("Readings", result.gauges, f"{used} used{phi}", few)


def fit_table(result: Result) -> TextTable:
    """Measured and computed readings, without those that stand among the predictions.

    Those of a backtest are all predictions, but for the first ones: `reading_table`.
    """
    if as_predicted(result) is not result:
        return reading_table(result)
    gauges, in_sd = result.gauges, _in_sd(result)
    rows = []
    for i, j in _farthest(_fitted(result), result):
        measured, computed = float(gauges.measured[i, j]), float(gauges.computed[i, j])
        three = (measured, computed, measured - computed)
        texts = [reading_text(gauges, i, value) for value in three]
        sizes = [decimals(float(each[i, j]), 1) for each in in_sd.values()]
        names = [gauges.channels[i], gauges.stages[j], *_unit_cell(gauges, i)]
        rows.append([*names, *texts, *sizes, _with_note(gauges, i, j, _use(gauges, i, j))])
    header = ("gauge", "stage", "measured", "computed", "residual", *in_sd, "")
    return _reading_table(gauges, header, rows, f"llrrr{'r' * len(in_sd)}l")


def _in_sd(result: Result, *, predictions: bool = False) -> dict[str, Floats]:
    """Headings and columns (n_channels, n_stages) of residuals in standard deviations."""
    columns = {"in sd": residual_in_sd(result)}
    if has_unexplained(result, predictions=predictions):
        columns["unexplained"] = unexplained(result)
    return columns


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


def _predicted(result: Result) -> Bools:
    """(n_channels, n_stages) predictions that tables show."""
    return has_prediction(result) & _shown_stages(result)


def prediction_title(result: Result) -> str:
    """What the table of predictions shows."""
    few = few_of(int(np.count_nonzero(_predicted(result))))
    words = (result.gauges.common_unit, "95 % band")
    title = f"Predictions ({', '.join(text for text in words if text)})"
    return f"{title}: {few}" if few else title


def prediction_table(result: Result) -> TextTable:
    """Predicted readings with their bands, and the readings where there are any."""
    header = ("gauge", "stage", "predicted", "from", "to", "measured", "")
    prediction = result.prediction
    if prediction is None:
        return TextTable(header, ())
    rows = [
        _prediction_row(result, prediction, *place)
        for place in _farthest(_predicted(result), result)
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


def read_or_predicted(result: Result) -> Bools:
    """(n_channels, n_stages) readings that are measured or predicted in a stage."""
    read = np.isfinite(result.gauges.measured) & (not result.in_service)
    return read | _predicted(as_predicted(result))


def reading_table(result: Result) -> TextTable:
    """Every reading that is measured or predicted; of many those that are farthest off."""
    result = as_predicted(result)
    in_sd, predicted = _in_sd(result, predictions=True), beside_prediction(result)
    rows = []
    for i, j in _farthest(read_or_predicted(result), result):
        *first, note = _reading_row(result, i, j, predicted=bool(predicted[i, j]))
        rows.append([*first, *(decimals(float(each[i, j]), 1) for each in in_sd.values()), note])
    header = ("gauge", "stage", "measured", "computed", "95 % band", "residual", *in_sd, "")
    return _reading_table(result.gauges, header, rows, f"llrrrr{'r' * len(in_sd)}l")


def _reading_row(result: Result, i: int, j: int, *, predicted: bool) -> list[str]:
    gauges, prediction = result.gauges, result.prediction
    measured, computed = float(gauges.measured[i, j]), float(gauges.computed[i, j])
    state, band, determined = "used" if gauges.used[i, j] else "not used", "-", True
    shown = reading_text(gauges, i, computed)
    if prediction is not None and predicted:
        state, determined = "predicted", bool(np.isfinite(prediction.sd[i, j]))
        if determined:
            of = (prediction.mean, prediction.lower95, prediction.upper95)
            shown, low, high = predicted_texts(gauges, i, *(float(table[i, j]) for table in of))
            computed, band = float(prediction.mean[i, j]), f"{low} to {high}"
    return [
        gauges.channels[i],
        gauges.stages[j],
        *_unit_cell(gauges, i),
        reading_text(gauges, i, measured),
        shown if determined else NOT_DETERMINED,
        band,
        reading_text(gauges, i, measured - computed) if determined else "-",
        _with_note(gauges, i, j, "known to be wrong" if gauges.bad[i, j] else state),
    ]


class ListedReading(Record):
    """A reading of the files; SI, NaN where there is none.

    Args:
        gauge: name of the channel.
        stage: name of the stage.
        time: when it was taken (ISO 8601); None where only the stage is known.
        value: what was read.
        computed: the model at the time of the reading.
        sd: standard deviation.
        unit: in which people see it.
        used: it took part in the identification.
        reason: why it did not.
        note: remark of the field sheet.
        dimension: key of `geoident.units.DIMENSIONS`.
    """

    gauge: str
    stage: str
    time: str | None = column()
    value: float = column(dimension=ROW)
    computed: float = column(dimension=ROW)
    sd: float = column(dimension=ROW)
    unit: str = column(dimension=ROW)
    used: bool
    reason: str
    note: str
    dimension: str = column(hidden=("csv", "json"))


def each_reading(gauges: GaugeTable) -> list[ListedReading]:
    """Every reading with its time, and why it is not used, in the order of the files."""
    table = gauges.readings
    units = dict(
        zip(gauges.channels, zip(gauges.units, gauges.dimensions, strict=True), strict=True)
    )
    readings = []
    for k, channel in enumerate(table.channel):
        unit, dimension = units[channel]
        time = moment_text(float(table.time[k]))
        value, computed, sd = (float(x[k]) for x in (table.value, table.computed, table.sd))
        readings.append(
            ListedReading(
                channel, table.stage[k], time, value, computed, sd, unit, bool(table.used[k]),
                table.reason[k], table.notes[k], dimension,
            )
        )  # fmt: skip
    return readings


class PredictedReading(Record):
    """A predicted reading; SI, NaN where there is none.

    Args:
        gauge: name of the channel.
        stage: name of the stage.
        mean: the prediction.
        sd: its standard deviation; NaN where it is not determined.
        lower95: lower end of its 95 % band.
        upper95: upper end.
        measured: what was read.
        unit: in which people see it.
        determined: the fit determines it.
        dimension: key of `geoident.units.DIMENSIONS`.
    """

    gauge: str
    stage: str
    mean: float = column(dimension=ROW, known="determined", sheet="predicted")
    sd: float = column(dimension=ROW)
    lower95: float = column(dimension=ROW)
    upper95: float = column(dimension=ROW)
    measured: float = column(dimension=ROW)
    unit: str = column(dimension=ROW)
    determined: bool = column(hidden=("csv",))
    dimension: str = column(hidden=("csv", "json"))


def predicted_readings(result: Result) -> list[PredictedReading]:
    """Every predicted reading, stage by stage."""
    prediction, gauges = result.prediction, result.gauges
    if prediction is None:
        return []
    return [
        PredictedReading(
            gauges.channels[i], gauges.stages[j], prediction.mean[i, j], prediction.sd[i, j],
            prediction.lower95[i, j], prediction.upper95[i, j], gauges.measured[i, j],
            gauges.units[i], bool(prediction.known[i, j]), gauges.dimensions[i],
        )
        for i, j in by_stage(np.isfinite(prediction.mean))
    ]  # fmt: skip
