"""Whether readings have reached the alarm values of their gauges, and predicted ones will."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from scipy.special import ndtr

from geoident.io.text.dates import date_text
from geoident.model.arrays import Floats
from geoident.model.case import Case
from geoident.model.gauges import named_channels
from geoident.model.results.alarms import LIKELY, AlarmState
from geoident.model.results.bands import NORMAL_95, Prediction
from geoident.model.results.findings import Finding
from geoident.model.results.result import GaugeTable


def alarm_states(
    case: Case, gauges: GaugeTable, prediction: Prediction | None
) -> tuple[AlarmState, ...]:
    """Every alarm value of every channel.

    Args:
        case: with the alarm values and the dates of the stages.
        gauges: what was read.
        prediction: of stages; None for none.
    """
    return tuple(
        _state(case, gauges, prediction, row, level, value, either=values is channel.limits)
        for row, channel in enumerate(case.channels)
        for values in (channel.alarm, channel.limits)
        for level, value in values.items()
    )


def _state(
    case: Case, gauges: GaugeTable, prediction: Prediction | None,
    row: int, level: str, value: float, *, either: bool,
) -> AlarmState:  # fmt: skip
    channel, table = case.channels[row], gauges.readings
    own = [k for k, name in enumerate(table.channel) if name == channel.name and not table.bad[k]]
    read = [k for k in own if math.isfinite(table.value[k])]
    size = np.abs(table.value) if either else math.copysign(1.0, value) * table.value
    order = {name: j for j, name in enumerate(gauges.stages)}
    beyond = [k for k in read if size[k] >= abs(value)]
    first = min(beyond, key=lambda k: (order[table.stage[k]], table.time[k]), default=None)
    later = np.full(len(gauges.stages), np.nan)
    if prediction is not None:
        sides = (value, -value) if either else (value,)
        each = [reached_probability(prediction, row, x, below=x < 0.0) for x in sides]
        later = np.sum(each, axis=0)
    known = np.flatnonzero(np.isfinite(later))
    likely = known[later[known] >= LIKELY]
    expected = gauges.stages[likely[0]] if likely.size else ""
    most = int(known[np.argmax(later[known])]) if known.size else None
    return AlarmState(
        gauge=channel.name,
        level=level,
        value=value,
        largest=float(table.value[max(read, key=lambda k: size[k])]) if read else math.nan,
        reached="" if first is None else table.stage[first],
        reached_on=math.nan if first is None else float(table.time[first]),
        expected=expected,
        expected_on=case.dates.get(expected, math.nan),
        likeliest="" if most is None else gauges.stages[most],
        probability=math.nan if most is None else float(later[most]),
        unit=channel.unit,
        dimension=channel.dimension,
        either_sign=either,
        probabilities=later,
    )


def reached_probability(prediction: Prediction, row: int, value: float, *, below: bool) -> Floats:
    """(n_stages,) probability that the reading of a channel reaches a value; NaN if not predicted.

    Each side of a band counts as half of a normal distribution, so that 2.5 % lie beyond each end
    (theory 6.3).

    Args:
        prediction: the bands.
        row: of the channel.
        value: SI.
        below: it is reached by readings that are at most as large; else at least as large.
    """
    mean, low, high = (
        table[row] for table in (prediction.mean, prediction.lower95, prediction.upper95)
    )
    beyond = value - mean
    with np.errstate(invalid="ignore", divide="ignore"):
        side = np.where(beyond > 0.0, high - mean, mean - low) / NORMAL_95
        under = ndtr(beyond / side)
    known = np.isfinite(prediction.sd[row]) & np.isfinite(under)
    return np.where(known, under if below else 1.0 - under, np.nan)


def alarm_findings(states: Sequence[AlarmState], *, dated: bool = False) -> tuple[Finding, ...]:
    """What was reached, and what is to be expected: a sentence each for each level of alarm.

    Args:
        states: of all channels.
        dated: say the date of a reading and not its stage: in service there is only one.
    """
    findings = []
    for level in dict.fromkeys(one.level for one in states):
        own = [one for one in states if one.level == level]
        for words, stages in (
            ("was reached by", {one.gauge: _when(one, dated) for one in own}),
            (
                "is expected to be reached, with a probability above 50 %, by",
                {one.gauge: one.expected for one in own if not one.reached},
            ),
        ):
            names = [gauge for gauge, stage in stages.items() if stage]
            if names:
                listed = named_channels([f"{name} ({stages[name]})" for name in names])
                sentence = f"Alarm value '{level}' {words} {listed}."
                findings.append(Finding("alarm", ", ".join(names), sentence))
    return tuple(findings)


def _when(state: AlarmState, dated: bool) -> str:
    """The stage in which a value was reached, or the date; empty where it was not."""
    return date_text(state.reached_on)[:10] if dated and state.reached else state.reached
