"""The history of a fit over its updates: written by each, and looked at as of any date."""

from __future__ import annotations

import re
from collections.abc import Iterator
from dataclasses import replace
from datetime import UTC, datetime

import numpy as np

from geoident.errors import UsageError
from geoident.forward.in_service.seasonal import EFFECTS
from geoident.io.text.dates import DateError, read_date, utc_offset
from geoident.model.gauges import DAY
from geoident.model.results.bands import NORMAL_95, Prediction
from geoident.model.results.costs import NO_COST
from geoident.model.results.findings import Finding, sentences_of
from geoident.model.results.result import GaugeTable, ParameterTable, Result
from geoident.model.results.updates import (
    PastParameter,
    PastPrediction,
    UpdateHistory,
    UpdateStep,
)
from geoident.workflow.updating.judging import Judgement
from geoident.workflow.updating.readings import ReadingChanges


def history_of(before: Result) -> UpdateHistory:
    """The history of a fit: its own, or itself as the first."""
    if before.updates is not None:
        return before.updates
    used = int(np.count_nonzero(before.gauges.readings.used))
    first = step_of(before, ReadingChanges(new=tuple(range(used))), Judgement(), alarm=False)
    return _with_answer(UpdateHistory((first,)), before)


def step_of(
    result: Result,
    changes: ReadingChanges,
    judgement: Judgement,
    *,
    alarm: bool,
    case_changed: bool = False,
) -> UpdateStep:
    """What is kept of one update.

    Args:
        result: that it found.
        changes: of the readings.
        judgement: of the new ones.
        alarm: they do not belong, or reach an alarm value.
        case_changed: so has the case beside them.
    """
    return UpdateStep(
        made=result.provenance.created,
        readings=int(np.count_nonzero(result.gauges.readings.used)),
        new=len(changes.new),
        changed=len(changes.changed),
        removed=len(changes.removed),
        judged=judgement.judged,
        p_value=judgement.p_value,
        least=judgement.least,
        belong=judgement.belong,
        alarm=alarm,
        status=result.status,
        objective=result.objective,
        case_changed=case_changed,
        finding=" ".join(sentences_of(judgement.findings)),
    )


def extended(
    before: UpdateHistory, step: UpdateStep, judgement: Judgement, result: Result
) -> UpdateHistory:
    """A history with one more update.

    Args:
        before: the history.
        step: the update.
        judgement: of its new readings.
        result: that it found.
    """
    number = before.last + 1
    longer = UpdateHistory(
        steps=(*before.steps, step),
        gauges=(*before.gauges, *(replace(one, update=number) for one in judgement.gauges)),
        readings=(*before.readings, *(replace(one, update=number) for one in judgement.readings)),
        parameters=before.parameters,
        predictions=before.predictions,
    )
    return _with_answer(longer, result)


def made_again(history: UpdateHistory, step: UpdateStep, result: Result) -> UpdateHistory:
    """A history whose last update, cut short, has been finished: its readings were judged then.

    Args:
        history: with the update that was cut short.
        step: how it has ended now.
        result: that it found.
    """
    cut = history.steps[-1]
    ended = replace(cut, made=step.made, status=step.status, objective=step.objective,
                    alarm=cut.alarm or step.alarm)  # fmt: skip
    last = history.last
    kept = replace(
        history,
        steps=(*history.steps[:-1], ended),
        parameters=tuple(row for row in history.parameters if row.update < last),
        predictions=tuple(row for row in history.predictions if row.update < last),
    )
    return _with_answer(kept, result)


def without_last(history: UpdateHistory) -> UpdateHistory:
    """A history without its last update, which is made again."""
    last = history.last
    return UpdateHistory(
        history.steps[:-1],
        tuple(row for row in history.gauges if row.update < last),
        tuple(row for row in history.readings if row.update < last),
        tuple(row for row in history.parameters if row.update < last),
        tuple(row for row in history.predictions if row.update < last),
    )


def _with_answer(history: UpdateHistory, result: Result) -> UpdateHistory:
    """A history with parameters and predictions of its last update."""
    number, shown = history.last, result.for_people
    return replace(
        history,
        parameters=(*history.parameters, *_parameters(number, shown), *_effects(number, shown)),
        predictions=(*history.predictions, *_predictions(number, shown)),
    )


def _parameters(number: int, result: Result) -> Iterator[PastParameter]:
    table = result.parameters
    for i, name in enumerate(table.names):
        yield PastParameter(
            update=number,
            parameter=name,
            value=float(table.values[i]),
            sd=float(table.sd[i]),
            lower95=float(table.lower95[i]),
            upper95=float(table.upper95[i]),
            at_bound=bool(table.at_bound[i]),
            determined=bool(table.determined[i]),
            unit=table.units[i],
            dimension=table.dimensions[i],
        )


def _effects(number: int, result: Result) -> Iterator[PastParameter]:
    """The sizes of the effects that a seasonal model finds on each gauge."""
    fit, gauges = result.seasonal, result.gauges
    if fit is None:
        return
    for i, gauge in enumerate(gauges.channels):
        for effect in EFFECTS:
            sizes = getattr(fit, effect)
            if sizes is not None and np.isfinite(sizes[i]):
                size, sd = float(sizes[i]), float(getattr(fit, f"{effect}_sd")[i])
                yield PastParameter(
                    update=number,
                    parameter=f"{gauge}: {effect}",
                    value=size,
                    sd=sd,
                    lower95=size - NORMAL_95 * sd,
                    upper95=size + NORMAL_95 * sd,
                    at_bound=False,
                    determined=True,
                    unit=gauges.units[i],
                    dimension=gauges.dimensions[i],
                )


def _predictions(number: int, result: Result) -> Iterator[PastPrediction]:
    prediction, gauges = result.prediction, result.gauges
    if prediction is None:
        return
    for i, j in np.argwhere(np.isfinite(prediction.mean)).tolist():
        yield PastPrediction(
            update=number,
            channel=gauges.channels[i],
            stage=gauges.stages[j],
            mean=float(prediction.mean[i, j]),
            sd=float(prediction.sd[i, j]),
            lower95=float(prediction.lower95[i, j]),
            upper95=float(prediction.upper95[i, j]),
            unit=gauges.units[i],
            dimension=gauges.dimensions[i],
        )


_OF_PREDICTION = ("mean", "sd", "lower95", "upper95")


def as_of(result: Result, when: str) -> Result:
    """A fit as it was at a date, or after an update: its parameters, bands and predictions then.

    What only the last fit knows (fields, diagnostics, what the model says of readings) is left out.
    A date without time of day is its end; one without an offset is in UTC, as `UpdateStep.made`.

    Args:
        result: with a history.
        when: a date, ISO 8601, or ``update 3``.

    Raises:
        UsageError: there is no history, or no fit so early; or the text is neither.
    """
    number = re.fullmatch(r"\s*update\s+(\d+)\s*", when)
    until = 0.0 if number else _end_of(when)
    history = result.updates
    if history is None:
        raise UsageError("The result has no history yet: the first update begins one.")
    if number:
        last = int(number[1])
        if last > history.last:
            raise UsageError(f"There was no update {last}: the last one is update {history.last}.")
    else:
        made = [_seconds(step.made) for step in history.steps]
        before = [k for k, time in enumerate(made) if time <= until]
        if not before:
            first = history.steps[0].made
            raise UsageError(f"There was no fit on {when}: the first was made {first}.")
        last = before[-1]
    if last == history.last:
        return result
    then = history
    while then.last > last:
        then = without_last(then)
    step = then.steps[last]
    said = (Finding("new-readings", "", step.finding),)
    return Result(
        kind=result.kind,
        status=step.status,
        exit_code=result.exit_code,
        method=result.method,
        reason=f"As of {when}: update {last} of {history.last}, made {step.made}",
        objective=step.objective,
        findings=said if step.finding else (),
        case_text=result.case_text,
        case_resolved=result.case_resolved,
        provenance=replace(result.provenance, created=step.made),
        parameters=_parameters_then(result.parameters, then),
        gauges=_gauges_then(result.gauges, history, last),
        counts=NO_COST,
        prediction=_prediction_then(result.gauges, then),
        updates=then,
    )


def _end_of(date: str) -> float:
    """The last second of a date, since 1970."""
    try:
        until = read_date(date) - (utc_offset(date) or 0.0)
    except DateError:
        hint = "write it as 2025-03-21, 2025-03-21T16:00 or 'update 3'"
        raise UsageError(f"'{date}' is not a date: {hint}.") from None
    if len(date.strip()) <= len("2025-03-21"):
        until += DAY - 1.0  # times are kept in whole seconds
    return until


def _seconds(made: str) -> float:
    when = datetime.fromisoformat(made)
    return (when if when.tzinfo else when.replace(tzinfo=UTC)).timestamp()


def _parameters_then(table: ParameterTable, then: UpdateHistory) -> ParameterTable:
    """The parameters of the last update of a history; what is no number of it is as it is now."""
    rows = {row.parameter: row for row in then.parameters if row.update == then.last}
    kept = np.array([i for i, name in enumerate(table.names) if name in rows], dtype=np.int64)
    table = table.picked(kept)
    own = [rows[name] for name in table.names]
    unknown = np.full((len(own), len(own)), np.nan)
    return replace(
        table,
        values=np.array([row.value for row in own], dtype=np.float64),
        sd=np.array([row.sd for row in own], dtype=np.float64),
        lower95=np.array([row.lower95 for row in own], dtype=np.float64),
        upper95=np.array([row.upper95 for row in own], dtype=np.float64),
        at_bound=np.array([row.at_bound for row in own], dtype=np.bool_),
        determined=np.array([row.determined for row in own], dtype=np.bool_),
        covariance=unknown,
        correlation=unknown,
    )


def _gauges_then(gauges: GaugeTable, history: UpdateHistory, last: int) -> GaugeTable:
    """The gauges without readings that came later, and without what the model says now."""
    came = {(row.channel, row.stage, row.value) for row in history.readings if row.update > last}
    table = gauges.readings
    later = np.array(
        [
            key in came
            for key in zip(*(table.channel, table.stage, table.value.tolist()), strict=True)
        ],
        dtype=np.bool_,
    )
    readings = replace(
        table,
        value=np.where(later, np.nan, table.value),
        used=table.used & ~later,
        reason=tuple(
            LATER if came_later else why
            for came_later, why in zip(later, table.reason, strict=True)
        ),
        computed=np.full(len(table), np.nan),
        sensitivity=None,
    )
    return replace(gauges, readings=readings, computed=np.full(gauges.computed.shape, np.nan))


LATER = "it came later"
"""Why a reading is not used as of a date."""


def _prediction_then(gauges: GaugeTable, then: UpdateHistory) -> Prediction | None:
    """The predictions of the last update of a history; None where it made none."""
    tables = np.full((len(_OF_PREDICTION), *gauges.computed.shape), np.nan)
    for row in then.predictions:
        here = row.channel in gauges.channels and row.stage in gauges.stages
        if row.update == then.last and here:
            i, j = gauges.channels.index(row.channel), gauges.stages.index(row.stage)
            tables[:, i, j] = [getattr(row, name) for name in _OF_PREDICTION]
    return Prediction(*tables) if np.isfinite(tables[0]).any() else None
