"""Alarm values of gauges in service: reached, and how probably in the year to come."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from geoident.identify.in_time.extremes import simulated_readings
from geoident.identify.in_time.noise import Noise
from geoident.identify.in_time.regression import GaugeState
from geoident.model.arrays import Floats, Ints
from geoident.model.in_service import YEAR, SeasonalModel, StructureInService
from geoident.model.results.alarms import LIKELY, AlarmState
from geoident.workflow.in_service.effects import EffectsOf

NEXT_YEAR = "next year"

_SIMULATED = 1000
"""Years to come that are simulated."""

_KNOWN = 0.9
"""Part of a past year in which its loads must be known."""


@dataclass(frozen=True)
class Ahead:
    """What is known of a gauge after its last reading.

    Args:
        number: of its channel.
        state: of its coefficients and errors.
        terms: numbers of the terms of its coefficients.
        likely: noises that it may have.
        since: (m,) times after the last reading at which it is read in a year, s.
    """

    number: int
    state: GaugeState
    terms: Ints
    likely: Sequence[Noise]
    since: Floats


def with_next_year(
    alarms: Sequence[AlarmState],
    gauges: Mapping[str, Ahead],
    acting: SeasonalModel | StructureInService,
    effects_of: EffectsOf,
    rng: np.random.Generator,
) -> tuple[AlarmState, ...]:
    """Alarm values with the probability that a reading of the next year reaches them.

    Args:
        alarms: what is known of them from readings.
        gauges: what is known of gauges; of others nothing is said.
        acting: what acts.
        effects_of: gives the effects of it.
        rng: random numbers.
    """
    extremes: dict[str, tuple[Floats, Floats]] = {}
    for name in dict.fromkeys(alarm.gauge for alarm in alarms if alarm.gauge in gauges):
        gauge = gauges[name]
        times, columns = _next_years(gauge, acting, effects_of)
        if len(columns) and len(times):
            state, likely = gauge.state, gauge.likely
            readings = simulated_readings(state, likely, times, columns, _SIMULATED, rng)
            extremes[name] = readings.min(axis=1), readings.max(axis=1)
    return tuple(
        _expected(alarm, extremes[alarm.gauge]) if alarm.gauge in extremes else alarm
        for alarm in alarms
    )


def _expected(alarm: AlarmState, extremes: tuple[Floats, Floats]) -> AlarmState:
    low, high = extremes
    up, down = high >= abs(alarm.value), low <= -abs(alarm.value)
    reached = up | down if alarm.either_sign else down if alarm.value < 0.0 else up
    probability = float(np.mean(reached))
    expected = NEXT_YEAR if probability >= LIKELY else ""
    return replace(alarm, expected=expected, likeliest=NEXT_YEAR, probability=probability)


def _next_years(
    gauge: Ahead, acting: SeasonalModel | StructureInService, effects_of: EffectsOf
) -> tuple[Floats, Floats]:
    """Times (m,) of the year to come, and (c, m, q) the effects if loads are as in a past year.

    Level and temperatures are those of the same days of the year, all of one year; season and time
    are those to come. Times at which a load was not known in one of the years are left out.
    """
    now = gauge.state.time
    times = now + gauge.since
    first = max((series.times[0] for series in acting.series), default=now - YEAR)
    years = range(1, 1 + max(1, int((now - first) // YEAR)))
    rows = np.full(len(times), gauge.number)
    possible = []
    for back in years:
        columns = effects_of(rows, times, times - back * YEAR).columns
        if np.isfinite(columns).all(axis=1).mean() >= _KNOWN:
            possible.append(columns[:, gauge.terms])
        if not acting.series:
            break
    if not possible:
        return times, np.zeros((0, len(times), len(gauge.terms)))
    stacked = np.stack(possible)
    known = np.isfinite(stacked).all(axis=(0, 2))
    return times[known], stacked[:, known]
