"""What the model says of the readings of a case: of each where it was read, of all channels."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from geoident.forward.gauges.instrument_errors import ReadingPlaces
from geoident.forward.observed import ObservedModel, Survey
from geoident.identify.problem.problem import Problem
from geoident.identify.problem.responses import HasIncrements
from geoident.model.arrays import Floats, Ints
from geoident.model.case import Case
from geoident.model.gauges import ReadingTable, named_channels
from geoident.model.results.result import GaugeTable
from geoident.model.results.times import StageTimes


def with_computed(
    readings: ReadingTable, case: Case, model: ObservedModel, survey: Survey, p: Floats
) -> ReadingTable:
    """The readings with what the model says of each at p, and its derivatives.

    The survey has one value a channel and stage, at the mean of the times of its readings. What
    drift adds between that and the time of a reading is added here.

    Args:
        readings: k of them.
        case: of the model.
        model: knows the drift.
        survey: of the model at p.
        p: (n,) parameters, SI.
    """
    place, more = _drift(readings, case, model, p)
    return replace(
        readings,
        computed=survey.computed[place] + more[:, 0],
        sensitivity=survey.sensitivity[place] + more[:, 1:],
    )


def survey_of_used(
    readings: ReadingTable, case: Case, model: ObservedModel, problem: Problem, p: Floats
) -> Survey:
    """What the search knows of the model at p: the readings used, and nothing of the others.

    Args:
        readings: k of them, of which g are used.
        case: of the model.
        model: knows the drift.
        problem: of the search.
        p: (n,) parameters, SI, that it has evaluated.

    Raises:
        TimeIsUp: it has not, and there is no time for it.
    """
    v, J = problem.response.evaluate(p)
    (rows, stages), more = _drift(readings, case, model, p)
    place, more = (rows[readings.used], stages[readings.used]), more[readings.used]
    shape = len(case.channels), len(case.stages)
    computed, sensitivity = np.full(shape, np.nan), np.full((*shape, len(p)), np.nan)
    computed[place], sensitivity[place] = v - more[:, 0], J - more[:, 1:]
    response = problem.response
    steps = response.increments(p) if isinstance(response, HasIncrements) else np.zeros((0, 0))
    return Survey(computed, sensitivity, notes=(NO_TIME_LEFT,), increments=steps)


NO_TIME_LEFT = (
    "No time was left to compute all stages at the answer: the result has the fitted readings "
    "alone, no predictions, forces and fields."
)


def _drift(
    readings: ReadingTable, case: Case, model: ObservedModel, p: Floats
) -> tuple[tuple[Ints, Ints], Floats]:
    """Channels and stages of k readings, and what drift adds at their own times, (k, 1 + n)."""
    common = ReadingPlaces.of(case, readings.pairs, ())
    own = replace(common, times=readings.time)
    values = model.values(p)
    at_own, at_common = (
        model.instrument_errors.added(values, model.names, places) for places in (own, common)
    )
    return (common.rows, common.states - 1), at_own - at_common  # without the virgin state


def gauge_table(case: Case, readings: ReadingTable, computed: Floats) -> GaugeTable:
    """The channels of a case with their readings, and what the model says at all stages.

    Args:
        case: the case.
        readings: all of them.
        computed: (n_channels, n_stages) SI.
    """
    channels = case.channels
    return GaugeTable(
        channels=tuple(channel.name for channel in channels),
        stages=tuple(stage.name for stage in case.stages),
        computed=computed,
        first=_points([channel.first for channel in channels], case),
        second=_points([channel.second for channel in channels], case),
        readings=readings,
        gauges=tuple(channel.gauge for channel in channels),
        dimensions=tuple(channel.dimension for channel in channels),
        units=tuple(channel.unit for channel in channels),
        accuracy=np.array([channel.accuracy for channel in channels], dtype=np.float64),
        errors=tuple(channel.errors for channel in channels),
        times=StageTimes.of(case),
    )


def _points(points: Sequence[tuple[float, ...] | None], case: Case) -> Floats:
    none = (np.nan,) * case.analysis.dim
    table = [point or none for point in points]  # a plain reading is nowhere
    return np.array(table, dtype=np.float64).reshape(len(table), case.analysis.dim)


def accuracies(case: Case) -> Floats:
    """Standard deviation of what is read of each channel (n_channels, n_stages), SI.

    NaN at the stage at which a channel is zeroed: it reads nothing there.
    """
    zero = [
        [channel.is_zeroed and channel.zero == stage.name for stage in case.stages]
        for channel in case.channels
    ]
    at_zero = np.array(zero, dtype=np.bool_).reshape(case.accuracies.shape)
    return np.where(at_zero, np.nan, case.accuracies)


def silent_gauges(model: ObservedModel) -> tuple[str, ...]:
    """Gauges that nobody can read, such as those in ground that the only stage takes away."""
    case, silent = model.case, dict[str, list[str]]()
    for channel in case.channels:
        later = case.stages[case.zero_of(channel) :]  # states count from the virgin one
        reasons = [model.unreadable(channel.name, stage.name) for stage in later]
        if None not in reasons:
            why = next((why for why in reasons if why), "it is zeroed at the last stage")
            silent.setdefault(why, []).append(channel.name)
    return tuple(
        f"no readable stage after the zero: {named_channels(names)}, as {why}"
        for why, names in silent.items()
    )
