"""Alarm values of gauges: reached, or to be expected with some probability."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

import numpy as np

from geoident.model.results.alarms import AlarmState
from geoident.model.results.columns import ROW
from geoident.model.results.result import Result
from geoident.report.text.gauges import reading_text
from geoident.report.text.layout import TextTable, moment_text, sentence
from geoident.report.text.rows import objects

NAME = "Alarm values"
BY_STAGE = "Probability of alarm values by stage"
NOTE = (
    "Expected: the first predicted stage in which the value is more probably reached than not. "
    "Probability: of the stage in which it is largest; 2.5 % lie beyond each end of a 95 % band. "
    "A value with both signs is a limit, which the size of a reading reaches."
)
IN_SERVICE_NOTE = (
    "Expected: a reading of the next year more probably reaches the value than not. Probability: "
    "with loads as in one of the past years, and all that is not known of coefficients and errors."
)

_FAR = 0.01
"""Probability below which a value that was not reached is no matter."""


def alarm_note(result: Result) -> str:
    """What the columns of the table mean; empty where there are no alarm values."""
    if not result.alarms:
        return ""
    return IN_SERVICE_NOTE if result.in_service else NOTE


def alarm_parts(result: Result) -> tuple[str, ...]:
    """For a terminal: the alarm values that were or may be reached, and how many are far."""
    near = [one for one in result.alarms if one.reached or one.probability >= _FAR]
    far = len(result.alarms) - len(near)
    shown = replace(result, alarms=tuple(near))
    table, by_stage = alarm_table(shown), stage_table(shown)
    words = f"{far} of {len(result.alarms)} alarm values were not reached, and will hardly be."
    later = f"{BY_STAGE}\n{by_stage.folded(3)}" if len(by_stage.header) > 4 else ""
    return table.filled.folded(3), sentence(words) if far else "", later


def alarms_list(result: Result) -> list[dict[str, Any]]:
    """Every alarm value for programs, SI, with its probability in each predicted stage."""
    stages = result.gauges.stages
    return [
        {
            **entry,
            "probabilities": {
                stage: float(p)
                for stage, p in zip(stages, one.probabilities, strict=False)
                if np.isfinite(p)
            },
        }
        for entry, one in zip(objects(result.alarms, ROW), result.alarms, strict=True)
    ]


def alarm_sentence(result: Result) -> str:
    """Whether alarm values were reached; empty where there are none."""
    reached = sum(bool(one.reached) for one in result.alarms)
    expected = sum(bool(one.expected) and not one.reached for one in result.alarms)
    if not result.alarms:
        return ""
    words = f"{reached} of {len(result.alarms)} alarm values were reached"
    return f"{words}, {expected} more are expected to be." if expected else f"{words}."


def alarm_table(result: Result) -> TextTable:
    """Every alarm value of every channel: when it was reached, and when that is to be expected."""
    gauges = result.gauges
    rows = []
    for one in result.alarms:
        row = gauges.channels.index(one.gauge)
        rows.append(
            [
                one.gauge,
                one.level,
                _value(result, one),
                reading_text(gauges, row, one.largest),
                _when("" if result.in_service else one.reached, one.reached_on),
                _when(one.expected, one.expected_on),
                probable(one.probability) + (f" ({one.likeliest})" if one.likeliest else ""),
            ]
        )
    header = ("gauge", "level", "value", "read up to", "reached", "expected", "probability")
    return TextTable(header, rows, right="llrrlll")


def _when(stage: str, seconds: float) -> str:
    """A stage with its date, where there is one."""
    date = moment_text(seconds)
    day = date.partition("T")[0] if date else ""
    return f"{stage} ({day})" if stage and day else stage or day or "-"


def stage_table(result: Result) -> TextTable:
    """The probability of every alarm value in each predicted stage; without rows for none."""
    known = [np.isfinite(one.probabilities) for one in result.alarms]
    shown = np.flatnonzero(np.any(known, axis=0)) if known else np.zeros(0, dtype=np.int64)
    rows = [
        [one.gauge, one.level, _value(result, one), *map(probable, one.probabilities[shown])]
        for one, some in zip(result.alarms, known, strict=True)
        if some.any()
    ]
    header = ("gauge", "level", "value", *(result.gauges.stages[j] for j in shown))
    return TextTable(header, rows, right="llr" + "r" * len(shown))


def _value(result: Result, one: AlarmState) -> str:
    """An alarm value with its unit; a limit with both signs."""
    row = result.gauges.channels.index(one.gauge)
    sign = "\N{PLUS-MINUS SIGN}" if one.either_sign else ""
    text = reading_text(result.gauges, row, one.value)
    return f"{sign}{text} {result.gauges.shown_units[row]}".rstrip()


def probable(probability: float) -> str:
    """A probability in words; a dash for none."""
    if math.isnan(probability):
        return "-"
    percent = 100.0 * probability
    return "below 1 %" if percent < 1.0 else "above 99 %" if percent > 99.0 else f"{percent:.0f} %"
