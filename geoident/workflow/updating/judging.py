"""New readings held against what a fit had predicted of them, before they are used (theory 13.5).

The error of each prediction, in its standard deviations, has the share of the reading's own error,
of errors that it shares with readings that were used, of the model's error, and of the parameters.
These make the errors of all new readings correlated: `joint_p_value` asks for all together.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.special import chdtrc

from geoident.forward.observed import ObservedModel, Survey
from geoident.identify.assessment.scores import Innovations, joint_p_value
from geoident.identify.in_time.simulation import Correlations
from geoident.model.arrays import Bools, Floats, Ints
from geoident.model.case import Case
from geoident.model.gauges import DAY, ReadingTable
from geoident.model.results.bands import NORMAL_95, Bands, Prediction
from geoident.model.results.findings import Finding
from geoident.model.results.result import Result
from geoident.model.results.updates import LEAST_CHANCE, JudgedGauge, JudgedReading
from geoident.workflow.estimating.another_case import with_gauges_of_fit
from geoident.workflow.estimating.from_fit import KnownByFit, known_by_fit
from geoident.workflow.estimating.predictions import band_of, correlations_of
from geoident.workflow.estimating.rivals import mixed_prediction
from geoident.workflow.in_service.control import watched_gauges
from geoident.workflow.running.computed import with_computed
from geoident.workflow.running.jobs import Inputs
from geoident.workflow.running.readings import used_rows

_SAME = 1e-9
"""Part of a reading up to which two computed ones are the same."""


@dataclass(frozen=True)
class Judgement:
    """New readings, judged.

    Args:
        readings: those that were predicted.
        gauges: p-values of their gauges.
        p_value: of all together; NaN where none has a band.
    """

    readings: tuple[JudgedReading, ...] = ()
    gauges: tuple[JudgedGauge, ...] = ()
    p_value: float = float("nan")

    @property
    def judged(self) -> int:
        """How many have a band."""
        return sum(gauge.readings for gauge in self.gauges)

    @property
    def least(self) -> float:
        """The smallest p-value of a gauge; NaN without any."""
        return min((gauge.p_value for gauge in self.gauges), default=float("nan"))

    @property
    def odd(self) -> tuple[str, ...]:
        """Gauges that do not belong, whatever the others do: half of the chance is for these."""
        limit = LEAST_CHANCE / max(len(self.gauges), 1)
        return tuple(gauge.gauge for gauge in self.gauges if gauge.p_value < limit)

    @property
    def belong(self) -> bool:
        """The readings belong to the model that predicted them."""
        return not self.odd and not self.p_value < LEAST_CHANCE

    @property
    def findings(self) -> tuple[Finding, ...]:
        """That they do not, and which are farthest off; none where they do."""
        if self.belong:
            return ()
        far = [row for row in self.readings if row.outside and np.isfinite(row.sd)]
        far.sort(key=lambda row: -abs(row.value - row.predicted) / row.sd)
        named = ", ".join(
            f"{row.channel} at {row.stage} ({(row.value - row.predicted) / row.sd:+.1f} sd)"
            for row in far[:_NAMED]
        )
        worst = (
            f"Farthest off: {named}."
            if named
            else "Each lies within its band, but together they contradict the model."
        )
        odd = f" (of {', '.join(self.odd[:_NAMED])} alone {self.least:.1g})" if self.odd else ""
        sentence = (
            f"The {self.judged} new readings do not belong to the model that predicted them: "
            f"chance does as much with a probability of {self.p_value:.1g}{odd}. {worst} Check "
            "these gauges and the stage that was built; if they are right, the model lacks "
            "something, and its bands are too narrow."
        )
        numbers = {"p_value": self.p_value, "least": self.least}
        return (Finding("new-readings", ", ".join(self.odd), sentence, numbers),)


_NAMED = 4


def judged_by_fit(
    fit: Result,
    origin: Inputs,
    inputs: Inputs,
    model: ObservedModel,
    table: ReadingTable,
    rows: Sequence[int],
    *,
    same_case: bool,
) -> Judgement:
    """New readings held against a fit.

    Args:
        fit: that has not used them.
        origin: its case.
        inputs: the case with the new readings.
        model: of that.
        table: its readings.
        rows: of the new ones.
        same_case: it differs from that of the fit by its readings only.
    """
    case = with_gauges_of_fit(inputs, origin, fit).case
    later = used_rows(case, np.isin(np.arange(len(table)), rows))
    places = _places(case, table, rows)
    order = [fit.parameters.names.index(name) for name in model.names]
    sd = np.array([channel.sd(reading) for channel, reading in later], dtype=np.float64)
    parts: list[tuple[Prediction, Floats]] = []
    minima = [fit.parameters.values] if fit.rivals is None else list(fit.rivals.values)
    for values in minima:
        p = values[order]
        survey = model.survey(p, fields=False, partial=True)
        at_p = with_computed(table, case, model, survey, p)
        assert at_p.sensitivity is not None
        known = _known(fit, origin, model, case, survey, values, same_case=same_case)
        curved = None
        if known.nonlinearity is not None:
            curved = known.nonlinearity.of(places[0] * len(case.stages) + places[1])
        computed, sensitivity = at_p.computed[list(rows)], at_p.sensitivity[list(rows)]
        shift, band = band_of(known.assessment, sensitivity, sd, later, known.errors, curved)
        mean = computed + shift
        prediction = Prediction(mean, band.sd, mean + band.lower95, mean + band.upper95)
        if same_case and values is minima[0] and len(minima) == 1:
            stages = survey.computed[places[0], places[1]]
            prediction = _as_made(fit, prediction, places, np.abs(stages - computed), computed)
        R = correlations_of(known.assessment, sensitivity, band.sd, later, known.errors, curved)
        parts.append((prediction, R))
    odds = np.ones(1) if fit.rivals is None else fit.rivals.odds
    whole = parts[0][0]
    if len(parts) > 1:
        whole = _flat(mixed_prediction(odds, [_flat(one, column=True) for one, _ in parts]))
    errors = [_errors(fit, table.value[list(rows)], *part) for part in parts]
    return _judgement(case, table, rows, whole, errors, odds)


def _places(case: Case, table: ReadingTable, rows: Sequence[int]) -> tuple[Ints, Ints]:
    """Numbers (l,), (l,) of the channels and stages of some readings."""
    channels = [channel.name for channel in case.channels]
    stages = [stage.name for stage in case.stages]
    return (
        np.array([channels.index(table.channel[k]) for k in rows], dtype=np.int64),
        np.array([stages.index(table.stage[k]) for k in rows], dtype=np.int64),
    )


def _known(
    fit: Result,
    origin: Inputs,
    model: ObservedModel,
    case: Case,
    survey: Survey,
    values: Floats,
    *,
    same_case: bool,
) -> KnownByFit:
    """What a fit knows at one of its minima."""
    at = fit
    if values is not fit.parameters.values and fit.rivals is not None:
        readings = with_computed(fit.gauges.readings, case, model, survey, values)
        at = replace(
            fit,
            parameters=replace(fit.parameters, values=values),
            gauges=replace(fit.gauges, readings=readings),
        )
    return known_by_fit(at, origin.case, model, case, survey, same_case=same_case)


def _as_made(
    fit: Result,
    again: Prediction,
    places: tuple[Ints, Ints],
    moved: Floats,
    computed: Floats,
) -> Prediction:
    """The prediction that stands in the fit, where it has made one of the same.

    Args:
        fit: the fit.
        again: computed from it now.
        places: numbers (l,), (l,) of channels and stages.
        moved: (l,) by which the model differs between the time of a reading and its stage, SI.
        computed: (l,) what it says of the readings, SI.
    """
    made = fit.prediction
    if made is None or made.mean.shape[1] <= places[1].max(initial=0):
        return again
    before = [getattr(made, name)[places] for name in _COLUMNS]
    same = np.isfinite(before[0]) & (moved <= _SAME * np.abs(computed))
    now = (getattr(again, name) for name in _COLUMNS)
    return Prediction(*(np.where(same, a, b) for a, b in zip(before, now, strict=True)))


_COLUMNS = ("mean", "sd", "lower95", "upper95")


def _flat(prediction: Prediction, *, column: bool = False) -> Prediction:
    """A prediction (l,), or (l, 1) as tables of stages are."""
    shape = (-1, 1) if column else (-1,)
    return Prediction(*(getattr(prediction, name).reshape(shape) for name in _COLUMNS))


def _errors(
    fit: Result, value: Floats, prediction: Prediction, correlation: Floats
) -> tuple[Bools, Innovations]:
    """Which of the readings (l,) have a band, and the errors of their predictions."""
    bands = Bands(value, prediction.mean, prediction.lower95, prediction.upper95)
    scored, z = bands.scored, bands.z
    freedom = float("inf")
    if fit.accuracies is not None:
        # the bands are those of Student's t already, and that is what F counts again
        width = prediction.upper95 - prediction.lower95
        with np.errstate(invalid="ignore"):
            z = z * width / (2.0 * NORMAL_95 * prediction.sd)
        spare = int(np.count_nonzero(fit.gauges.readings.used)) - len(fit.parameters.names)
        freedom = max(spare / len(fit.accuracies.names), 1.0)
    return scored, Innovations(z[scored], correlation[np.ix_(scored, scored)], freedom)


def _judgement(
    case: Case,
    table: ReadingTable,
    rows: Sequence[int],
    whole: Prediction,
    errors: Sequence[tuple[Bools, Innovations]],
    odds: Floats,
) -> Judgement:
    """The p-values of the errors at each minimum, weighed by its odds."""
    weight = odds / odds.sum()

    def p_value(own: Bools) -> float:
        """Of some of the readings (l,)."""
        each = []
        for scored, e in errors:
            at = np.flatnonzero(own[scored])
            each.append(
                joint_p_value(replace(e, z=e.z[at], correlation=e.correlation[np.ix_(at, at)]))
            )
        return max(float(weight @ each), np.finfo(float).tiny)  # no chance is none: it is less

    scored = np.logical_and.reduce([one for one, _ in errors])
    gauge = np.array([table.gauge[k] for k in rows])
    gauges = tuple(
        JudgedGauge(0, str(name), int(own.sum()), p_value(own))
        for name in dict.fromkeys(gauge[scored].tolist())
        if (own := scored & (gauge == name)).any()
    )
    readings = _judged_readings(case, table, rows, whole)
    return Judgement(readings, gauges, p_value(scored) if scored.any() else float("nan"))


def _judged_readings(
    case: Case, table: ReadingTable, rows: Sequence[int], prediction: Prediction
) -> tuple[JudgedReading, ...]:
    channels = {channel.name: channel for channel in case.channels}
    return tuple(
        JudgedReading(
            update=0,
            channel=table.channel[k],
            stage=table.stage[k],
            time=float(table.time[k]),
            value=float(table.value[k]),
            predicted=float(prediction.mean[i]),
            sd=float(prediction.sd[i]),
            lower95=float(prediction.lower95[i]),
            upper95=float(prediction.upper95[i]),
            unit=channels[table.channel[k]].unit,
            dimension=channels[table.channel[k]].dimension,
        )
        for i, k in enumerate(rows)
    )


def judged_in_service(
    fit: Result, case: Case, model: ObservedModel, table: ReadingTable, rows: Sequence[int]
) -> Judgement:
    """New readings of a structure in service held against its fit, one after the other.

    Their errors are independent in time; those of a day are correlated as in the fit. Readings
    that are wrong alone take no part in p-values, and are said by the next fit.

    Args:
        fit: of a structure in service.
        case: with the new readings.
        model: of the case.
        table: of the case.
        rows: of the new ones; those that are no later than the last of their gauge are not judged.
    """
    assert fit.seasonal is not None
    last = dict(zip(fit.gauges.channels, fit.seasonal.last.tolist(), strict=True))
    ends = np.array([last.get(name, np.nan) for name in table.channel])
    later = np.isin(np.arange(len(table)), rows) & (table.time > ends)
    watched = watched_gauges(fit, case, model, replace(table, used=later))
    if not watched:
        return Judgement()
    at = np.concatenate([gauge.rows for gauge in watched])
    e = np.concatenate([gauge.e for gauge in watched])
    mean = np.concatenate([gauge.predicted for gauge in watched])
    sd = np.concatenate([gauge.filter.sd for gauge in watched])
    number = np.repeat(np.arange(len(watched)), [len(gauge.rows) for gauge in watched])
    sound = ~np.concatenate([gauge.filter.skipped for gauge in watched])
    white = np.array([new.gauge.state.noise.white for new in watched])[number]
    together = Correlations.of([new.gauge.errors for new in watched])
    day = table.time[at] // DAY
    squares = 0.0
    for one in np.unique(day[sound]):
        own = np.flatnonzero(sound & (day == one))
        R = together.of_innovations(number[own], white[own], sd[own])
        squares += float(e[own] @ np.linalg.solve(R, e[own]))
    gauges = []
    for k, gauge in enumerate(watched):
        own = sound & (number == k)
        if own.any():
            p = float(chdtrc(own.sum(), np.sum(e[own] ** 2)))
            gauges.append(JudgedGauge(0, table.channel[gauge.rows[0]], int(own.sum()), p))
    half = NORMAL_95 * sd
    bands = Prediction(mean, sd, mean - half, mean + half)
    p = float(chdtrc(sound.sum(), squares)) if sound.any() else float("nan")
    return Judgement(_judged_readings(case, table, at.tolist(), bands), tuple(gauges), p)
