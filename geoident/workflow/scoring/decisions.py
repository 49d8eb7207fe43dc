"""How probable the decisions of a case are, and which earlier readings would make them so.

Predictions of two readings are normal together (theory 17): what is expected of the later one, once
the earlier one is read, moves with it in proportion.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace

import numpy as np
from scipy.special import ndtri

from geoident.model.arrays import Bools, Floats, Ints
from geoident.model.case import Case
from geoident.model.decision import Condition, Decision
from geoident.model.results.bands import Prediction
from geoident.model.results.decisions import DecisionState, TellingReading
from geoident.model.results.findings import Finding
from geoident.model.results.result import GaugeTable, Result
from geoident.units import in_unit, shown_unit
from geoident.workflow.scoring.alarms import reached_probability

_LIKELY = 0.5
"""Probability from which on a decision is to be prepared."""

_FARTHEST = 4.0
"""Standard deviations from what is expected beyond which a reading is not asked for."""

_TOGETHER = 300
"""Predictions whose correlations are computed at a time."""

Correlated = Callable[[Prediction, Bools], Floats]
"""Correlations (l, l) of the errors of l predictions, of which it is said where they are."""


def with_decisions(
    result: Result, case: Case, prediction: Prediction, correlated: Correlated
) -> Result:
    """A result with what it knows of the decisions of its case.

    Args:
        result: with its readings.
        case: with the decisions.
        prediction: of all that was not read.
        correlated: tells how the predictions hang together.
    """
    gauges = result.gauges
    states = tuple(_state(one, case, gauges, prediction) for one in case.decisions)
    telling = tuple(
        reading
        for one, state in zip(case.decisions, states, strict=True)
        if state.state == "open"
        for reading in _telling(one.condition, case, gauges, prediction, correlated)
    )
    findings = (*_findings(states), *result.findings)
    return replace(result, decisions=states, telling=telling, findings=findings)


def _place(condition: Condition, gauges: GaugeTable) -> tuple[int, int]:
    return gauges.channels.index(condition.channel), gauges.stages.index(condition.stage)


def _state(
    decision: Decision, case: Case, gauges: GaugeTable, prediction: Prediction
) -> DecisionState:
    condition = decision.condition
    row, stage = _place(condition, gauges)
    channel = case.channels[row]
    value, below = condition.value, condition.below
    measured = np.nan if gauges.bad[row, stage] else float(gauges.measured[row, stage])
    probability = float(reached_probability(prediction, row, value, below=below)[stage])
    if np.isfinite(measured):
        beyond = measured < value if below else measured > value
        state, probability = ("due", 1.0) if beyond else ("not due", 0.0)
    elif gauges.used[:, stage:].any():
        state = "not read"
    else:
        state = "open" if np.isfinite(probability) else "unknown"
    return DecisionState(
        condition=condition.text,
        then=decision.then,
        gauge=channel.name,
        stage=condition.stage,
        value=value,
        state=state,
        probability=probability,
        measured=measured,
        unit=channel.unit,
        dimension=channel.dimension,
    )


def _telling(
    condition: Condition, case: Case, gauges: GaugeTable, prediction: Prediction,
    correlated: Correlated,
) -> Iterator[TellingReading]:  # fmt: skip
    """Readings at each stage that comes before: of the gauge itself, and of the best other one."""
    row, stage = _place(condition, gauges)
    unread = np.isfinite(prediction.sd) & np.isnan(gauges.measured)
    used = gauges.used.any(axis=0)
    later = np.flatnonzero(~used)
    if case.lasts:  # moments between those that were read are past
        later = later[later > np.flatnonzero(used).max(initial=-1)]
    for before in later[later < stage].tolist():
        rows = np.flatnonzero(unread[:, before])
        parts = np.array_split(rows, 1 + len(rows) // _TOGETHER)
        r = np.concatenate([_with_target(part, before, (row, stage), prediction, correlated)
                            for part in parts])  # fmt: skip
        others = np.flatnonzero(rows != row)
        best = others[np.argsort(-np.abs(r[others]))][:1]
        for k in (*np.flatnonzero(rows == row).tolist(), *best.tolist()):
            yield _reading(condition, case, prediction, (row, stage), (int(rows[k]), before), r[k])


def _with_target(
    rows: Ints, stage: int, target: tuple[int, int], prediction: Prediction, correlated: Correlated
) -> Floats:
    """Correlations of predictions of a stage with another one, in the order of their channels."""
    places = np.zeros(prediction.sd.shape, dtype=np.bool_)
    places[rows, stage] = places[target] = True
    is_target = (np.argwhere(places) == target).all(axis=1)
    return np.asarray(correlated(prediction, places)[is_target][0, ~is_target])


def _reading(
    condition: Condition, case: Case, prediction: Prediction,
    target: tuple[int, int], place: tuple[int, int], r: float,
) -> TellingReading:  # fmt: skip
    """The readings at a place that make it 5 % and 50 % likely that the target is beyond."""
    channel = case.channels[place[0]]
    mean, sd = prediction.mean[place], prediction.sd[place]
    sign = -1.0 if condition.below else 1.0
    left = prediction.sd[target] * np.sqrt(max(1.0 - r**2, 0.0))
    readings = []
    for likely in (0.05, 0.5):
        wanted = condition.value + sign * ndtri(likely) * left  # of the mean of the target then
        with np.errstate(divide="ignore", invalid="ignore"):
            away = (wanted - prediction.mean[target]) / (r * prediction.sd[target])
        readings.append(float(mean + away * sd) if abs(away) <= _FARTHEST else np.nan)
    return TellingReading(
        condition=condition.text,
        gauge=channel.name,
        stage=case.stages[place[1]].name,
        predicted=float(mean),
        lower95=float(prediction.lower95[place]),
        upper95=float(prediction.upper95[place]),
        correlation=r,
        at_5=readings[0],
        at_50=readings[1],
        unit=channel.unit,
        dimension=channel.dimension,
    )


def _findings(states: Sequence[DecisionState]) -> Iterator[Finding]:
    """What is due, what was missed, and what is more probable than not."""
    for one in states:
        if one.state == "due":
            read = f"{in_unit(one.measured, one.unit, one.dimension):.4g}"
            unit = shown_unit(one.unit, one.dimension)
            sentence = f"{one.condition}: {read} {unit} was read. Then: {one.then}."
        elif one.state == "not read":
            sentence = f"{one.condition}: the stage is past, and {one.gauge} was not read. "
            sentence += "The probability is that of what it would have read."
        elif one.state == "open" and one.probability >= _LIKELY:
            percent = f"{100 * one.probability:.0f} %"
            sentence = f"{one.condition} is {percent} probable. Then: {one.then}."
        else:
            continue
        yield Finding("decision", one.gauge, sentence, {"probability": one.probability})
