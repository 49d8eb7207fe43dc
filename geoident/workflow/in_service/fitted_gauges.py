"""Gauges of a structure in service as their fit left them, and what chance does to them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from geoident.identify.in_time.detection import Detector
from geoident.identify.in_time.innovations import Filter
from geoident.identify.in_time.noise import PROCESSES, Noise
from geoident.identify.in_time.regression import GaugeState
from geoident.identify.in_time.simulation import Correlations, FittedErrors, sound_innovations
from geoident.model.arrays import Floats, Ints
from geoident.model.in_service import DAY, YEAR
from geoident.model.results.in_service import SeasonalFit
from geoident.model.results.result import Result
from geoident.workflow.in_service.effects import EffectsOf
from geoident.workflow.in_service.fit import rows_in_time

STANDARD = 731.0 * DAY
"""Length of the period in which simulated false alarms are counted, s: two years, in whole days."""

_SIMULATED = 200
"""Simulated periods in which nothing changes."""


@dataclass(frozen=True)
class FittedGauge:
    """What a fit knows of a gauge.

    Args:
        number: of its channel.
        terms: numbers of the terms that explain its readings.
        state: of its coefficients and errors after its last reading.
        likely: noises that it may have.
        errors: of the fitted readings.
        standard: a filter over dates as usual after them.
        shared: (h,) which of its terms are parameters that all gauges share.
    """

    number: int
    terms: Ints
    state: GaugeState
    likely: tuple[Noise, ...]
    errors: FittedErrors
    standard: Filter
    shared: Ints

    @property
    def read_in_a_year(self) -> Floats:
        """(m,) times since the last reading at which the gauge is read in a year, s."""
        usual = self.standard.times
        return np.asarray(usual[usual > usual[-1] - YEAR] - usual[-1] + YEAR)


def fitted_gauges(fit: Result, effects_of: EffectsOf) -> list[FittedGauge]:
    """All gauges that have a fit.

    Args:
        fit: of a structure in service.
        effects_of: gives the effects that it has coefficients of.
    """
    seasonal, table = fit.seasonal, fit.gauges.readings
    assert seasonal is not None
    latest = float(np.nanmax(seasonal.last))
    gauges = []
    for number in np.flatnonzero(np.isfinite(seasonal.white)).tolist():
        state, terms = _state_of(seasonal, number)
        rows = rows_in_time(table, fit.gauges.channels[number], table.used)
        times = table.time[rows]
        columns = effects_of(np.full(len(times), number), times).columns[:, terms]
        residual = table.value[rows] - columns @ state.mean[:-PROCESSES]
        # the days of the last two years again, with what acted then: what was read on one day stays
        # on one day; or of a gauge that has not been read for so long
        end = latest if state.time > latest - STANDARD else state.time
        usual = times[times > end - STANDARD]
        ahead = effects_of(np.full(len(usual), number), usual + STANDARD, usual)
        draws = seasonal.likely_noises[number]
        gauges.append(
            FittedGauge(
                number,
                terms,
                state,
                tuple(Noise(*draw) for draw in draws[np.isfinite(draws[:, 0])].tolist()),
                FittedErrors.of(state.noise, times, residual),
                Filter(state, usual + STANDARD, ahead.columns[:, terms]),
                np.flatnonzero(np.isin(terms, seasonal.shared)),
            )
        )
    return gauges


def _state_of(fit: SeasonalFit, number: int) -> tuple[GaugeState, Ints]:
    """What a fit knows of a gauge after its last reading, and the numbers of its terms."""
    terms = np.flatnonzero(np.isfinite(fit.coefficients[number]))
    noise = Noise(
        float(fit.white[number]), float(fit.lasting[number]), drift=float(fit.drift[number])
    )
    if noise.lasting:
        noise = replace(noise, time=float(fit.fades[number]))
    processes = [fit.lasting_now[number], fit.drift_now[number]]
    mean = np.append(fit.coefficients[number, terms], processes)
    at = np.append(terms, len(fit.terms) + np.arange(PROCESSES))
    P = fit.covariance[number][np.ix_(at, at)]
    return GaugeState(noise, float(fit.last[number]), mean, P), terms


class Sound:
    """What gauges show as long as nothing changes, over dates as usual.

    Args:
        gauges: of a fit.
        between: two false alarms of all of them together, s, on the average.
        rng: random numbers.
        parameters: what parameters that rise do to the readings of each gauge on these dates.

    Attributes:
        innovations: (m, s) simulated, of each gauge.
        detector: that looks for changes in these, with the correlations that they have.
    """

    def __init__(
        self,
        gauges: Sequence[FittedGauge],
        between: float,
        rng: np.random.Generator,
        parameters: Sequence[Floats] = (),
    ) -> None:
        self.gauges, self._between = gauges, between
        filters = [gauge.standard for gauge in gauges]
        together = Correlations.of([gauge.errors for gauge in gauges])
        likely = [gauge.likely for gauge in gauges]
        self.innovations = sound_innovations(
            filters, together, _SIMULATED, rng, likely, [gauge.shared for gauge in gauges]
        )
        usual = Detector(filters, parameters=parameters)
        self.detector = usual.correlated(self.innovations)

    @cached_property
    def threshold(self) -> float:
        """The surprise that chance passes as seldom as asked for."""
        return self.detector.threshold(self._between, self.innovations)
