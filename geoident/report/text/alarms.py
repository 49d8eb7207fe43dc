"""Alarm values of gauges: reached, or to be expected with some probability."""

from __future__ import annotations

import math
from dataclasses import replace

from geoident.model.results.alarms import AlarmState
from geoident.model.results.result import Result
from geoident.report.text.gauges import moment_text, reading_text
from geoident.report.text.layout import TextTable, sentence

NAME = "Alarm values"
NOTE = (
    "Expected: the first predicted stage in which the value is more probably reached than not. "
    "Probability: of the stage in which it is largest; 2.5 % lie beyond each end of a 95 % band."
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
    table = alarm_table(replace(result, alarms=tuple(near)))
    words = f"{far} of {len(result.alarms)} alarm values were not reached, and will hardly be."
    return table.filled.folded(3), sentence(words) if far else ""


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
                f"{reading_text(gauges, row, one.value)} {gauges.shown_units[row]}".rstrip(),
                reading_text(gauges, row, one.largest),
                _when("" if result.in_service else one.reached, one.reached_on),
                _when(one.expected, one.expected_on),
                _probability(one),
            ]
        )
    header = ("gauge", "level", "value", "read up to", "reached", "expected", "probability")
    return TextTable(header, rows, right="llrrlll")


def _when(stage: str, seconds: float) -> str:
    """A stage with its date, where there is one."""
    date = moment_text(seconds)
    day = date.partition("T")[0] if date else ""
    return f"{stage} ({day})" if stage and day else stage or day or "-"


def _probability(one: AlarmState) -> str:
    if math.isnan(one.probability):
        return "-"
    percent = 100.0 * one.probability
    words = "below 1 %" if percent < 1.0 else "above 99 %" if percent > 99.0 else f"{percent:.0f} %"
    return f"{words} ({one.likeliest})"
