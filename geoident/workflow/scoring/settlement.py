"""What a fitted settlement law says of each gauge: final settlement, degree, dates, what remains.

All of this is a function of readings at days that are no stages: the end, the dates that are asked
for, days between. The case with stages there is predicted as any later readings are, with the model
error that lasts in time; from draws of these readings together follow the intervals (theory 4.10).
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from geoident.forward.external.settlement import SettlementModel
from geoident.forward.gauges.instrument_errors import ReadingPlaces
from geoident.forward.observed import Query
from geoident.identify.assessment.later_readings import simulated_readings
from geoident.identify.assessment.prediction_bands import predict_band
from geoident.identify.problem.scaling import Scaling
from geoident.io.text.dates import date_text
from geoident.model.arrays import Bools, Floats
from geoident.model.case import Stage
from geoident.model.gauges import DAY, Channel
from geoident.model.results.settlement import SettlementState
from geoident.units import DIMENSIONLESS, in_unit, shown_unit
from geoident.workflow.estimating.estimate import Estimate
from geoident.workflow.estimating.setup import Setup

_DRAWS = 500
_FEWEST = 100
"""Draws from which quantiles are taken."""
_FAR = 1e5 * 365.25 * DAY
"""Time after which settlement without end is taken as final, s: of a hyperbola but T / 1e5 years.
"""
_STEPS = 40
"""Days, in ratio of time, between which the date of a degree is interpolated."""
_LAST_DATE = 2e11
"""Seconds since 1970 beyond which there is no date to be written."""


@dataclass(frozen=True)
class _Course:
    """Readings of one channel at the days that are wanted.

    Args:
        times: (m,) seconds since 1970, the last of them the end.
        mean: (m,) as they are expected, SI.
        drawn: (k, m) as they may be, SI.
        determined: whether readings or priors tell the end.
    """

    times: Floats
    mean: Floats
    drawn: Floats
    determined: bool


def settlement_states(setup: Setup, estimate: Estimate) -> tuple[SettlementState, ...]:
    """Rows for each gauge of a settlement law, with 95 % intervals; none of other models.

    Args:
        setup: model and readings.
        estimate: the estimate.
    """
    model = setup.model
    used = setup.readings.used_pairs
    if not isinstance(model, SettlementModel) or not used:
        return ()
    law, now = model.law, max(model.case.dates[stage] for _, stage in used)
    end = law.until if np.isfinite(law.until) else law.since + _FAR
    now = min(now, end)
    times = {now, *law.after}
    if law.degrees:
        first = max(0.5 * DAY, 1e-4 * (now - law.since))
        times |= set((law.since + np.geomspace(first, end - law.since, _STEPS)).tolist())
    days = np.array([*sorted(time for time in times if time < end), end])
    asked = np.isin(days, [now, *law.after])
    rows = []
    for channel, course in zip(
        model.case.channels, _courses(setup, model, estimate, days, asked), strict=True
    ):
        rows += list(_rows_of(model, channel, course, now))
    return tuple(rows)


def _courses(
    setup: Setup, model: SettlementModel, estimate: Estimate, days: Floats, asked: Bools
) -> Iterator[_Course]:
    """The readings of all channels at some days (m,), as the used readings let expect them.

    Args:
        setup: model and readings.
        model: the model.
        estimate: the estimate.
        days: (m,) seconds since 1970, the last of them the end.
        asked: (m,) which of them are asked for.
    """
    case, p = model.case, estimate.outcome.values
    names = {f"{day:.0f} s": float(day) for day in days}
    begin, *stages = case.stage_names
    known_days = {name: case.dates[name] for name in stages}
    dates = dict(sorted((known_days | names).items(), key=lambda item: item[1]))
    law = replace(model.law, times=np.array(list(dates.values())))
    longer = replace(
        case,
        stages=tuple(Stage(name) for name in dates),
        dates={begin: case.dates[begin], **dates},
        elsewhere=law,
    )
    extended = SettlementModel(longer, law)
    used = setup.readings.used_pairs
    g, m = len(used), len(days)
    pairs = [*used, *((channel.name, name) for channel in case.channels for name in names)]
    places = ReadingPlaces.of(longer, pairs, ())
    query = Query(places, len(dates))

    def readings(point: Floats, *, derivatives: bool = False) -> Floats:
        observed = extended.observe(point, replace(query, derivatives=derivatives))
        return extended.readings_of(point, observed, places, derivatives=derivatives)

    computed, jacobian = np.split(readings(p, derivatives=True), [1], axis=1)
    rng = np.random.default_rng(_DRAWS)
    points = _points(estimate, Scaling(case.parameters), rng)
    answers = np.array([readings(point)[:, 0] for point in points])
    known = estimate.errors
    if known is not None:
        error = known.model_error
        if error is not None:
            steps = extended.survey(p, fields=False).increments
            error = replace(error, case=longer, model=extended, increments=steps)
        known = replace(known, case=longer, model_error=error)
    order = list(dates)
    stage = [order.index(name) for name in names]
    for k in range(len(case.channels)):
        own = slice(g + k * m, g + (k + 1) * m)
        mean, drawn = computed[own, 0], answers[:, own]
        rows, sd = jacobian[own], np.full(m, case.channels[k].accuracy)
        if known is not None:
            later = np.column_stack([np.full(m, k), stage])
            given = known.of(later, jacobian[own])
            mean, rows, sd = mean + given.shift, given.jacobian, given.sd
            problem, errors = known.with_later(later)
            errors = replace(errors, sd=np.zeros(m))  # what it would show without its own
            drawn = simulated_readings(problem, answers[:, :g], drawn, errors, rng)
        band = predict_band(estimate.assessment, rows[-1:], sd[-1:])  # as of a stage there
        forwards = _forwards(drawn, asked, float(np.sign(mean[-1])))
        yield _Course(days, mean, forwards, bool(np.isfinite(band.upper95[0])))


def _points(estimate: Estimate, scaling: Scaling, rng: np.random.Generator) -> Floats:
    """Parameters (k, n) as they may be, SI."""
    posterior = estimate.assessment.posterior
    chosen = rng.choice(len(posterior.weight), _DRAWS, p=posterior.weight)
    normal = rng.standard_normal((_DRAWS, posterior.factor.shape[1]))
    steps = posterior.shift[:, chosen].T + normal @ posterior.factor.T
    return np.array([scaling.away(estimate.outcome.values, step) for step in steps])


def _forwards(drawn: Floats, asked: Bools, sign: float) -> Floats:
    """The draws (k, m) that do not go back until the end, as a fill that stays does not rise.

    A model error that is drawn by itself would let it. All where these are too few to say.

    Args:
        drawn: the draws.
        asked: (m,) days after which they do not.
        sign: of settlement.
    """
    left = (drawn[:, -1:] - drawn[:, asked]) * sign
    kept = drawn[np.all(left >= 0.0, axis=1)]
    return kept if len(kept) >= _FEWEST else drawn


def _rows_of(
    model: SettlementModel, channel: Channel, course: _Course, now: float
) -> Iterator[SettlementState]:
    """What is asked of a channel."""
    law = model.law
    unit = channel.unit, channel.dimension
    part = "%", DIMENSIONLESS
    final = date_text(law.until) if np.isfinite(law.until) else ""

    def at(time: float) -> tuple[Floats, Floats]:
        """The expected reading with the drawn ones, (1 + k,); likewise that of the end."""
        j = int(np.flatnonzero(course.times == time)[0])
        both = np.concatenate([course.mean[None], course.drawn])
        return both[:, j], both[:, -1]

    reading, end = at(now)
    yield _state(channel, "final", final, end, unit, course)
    yield _state(channel, "degree", date_text(now), reading / end, part, course)
    for time in law.after:
        reading, end = at(time)
        yield _state(channel, "remaining", date_text(time), end - reading, unit, course)
    for degree in law.degrees:
        both = np.concatenate([course.mean[None], course.drawn])
        since = np.array([_reached(course.times - law.since, one, degree) for one in both])
        state = _state(channel, "reached", f"{100 * degree:g} %", since, ("days", "time"), course)
        ends = state.value, state.lower95, state.upper95
        dates = [_date(law.since + one) for one in ends]
        yield replace(state, date=dates[0], date_lower95=dates[1], date_upper95=dates[2])


def _reached(elapsed: Floats, readings: Floats, degree: float) -> float:
    """When readings (m,) reach a part of the last one, s; in ratio of time between days."""
    part = readings / readings[-1]
    later = np.flatnonzero(part >= degree)
    j = int(later[0])
    if j == 0:
        return float(elapsed[0])
    weight = (degree - part[j - 1]) / (part[j] - part[j - 1])
    before = max(elapsed[j - 1], 1e-3 * elapsed[j])
    return float(before * (elapsed[j] / before) ** weight)


def _date(time: float) -> str:
    return date_text(time // DAY * DAY) if abs(time) < _LAST_DATE else ""


def _state(
    channel: Channel, quantity: str, at: str, both: Floats, unit: tuple[str, str], course: _Course
) -> SettlementState:
    """A row.

    Args:
        channel: of it.
        quantity: see `SettlementState`.
        at: likewise.
        both: (1 + k,) the expected value, and those that may be.
        unit: in which people see it, and dimension.
        course: says whether it is determined.
    """
    low, high = -np.inf, np.inf
    if course.determined:
        low, high = np.quantile(both[1:], [0.025, 0.975]).tolist()
    value = float(both[0])
    return SettlementState(
        channel.name, quantity, at, value, min(low, value), max(high, value), "", "", "", *unit
    )


def settlement_notes(states: Sequence[SettlementState]) -> tuple[str, ...]:
    """The same, a sentence for each gauge.

    Args:
        states: of the gauges.
    """
    parts: dict[str, list[str]] = {}
    for one in states:
        parts.setdefault(one.gauge, []).append(_words(one))
    return tuple(f"settlement of {gauge}: {'; '.join(own)}" for gauge, own in parts.items())


def _words(of: SettlementState) -> str:
    """A quantity in words, without numbers where the readings do not determine it."""
    if not np.isfinite([of.lower95, of.upper95]).all():
        return {
            "final": f"its end{' at ' + of.at if of.at else ''} is not determined",
            "degree": f"what part of that it has shown on {of.at} is not determined",
            "remaining": f"what remains after {of.at} is not determined",
            "reached": f"when it has shown {of.at} of that is not determined",
        }[of.quantity]
    if of.quantity == "reached":
        first, last = of.date_lower95, of.date_upper95 or "never"
        return f"{of.at} of that on {of.date or 'no date'} (95 %: {first} to {last})"
    unit = of.unit, of.dimension
    name = f" {shown_unit(*unit)}".rstrip()
    number, low, high = (f"{in_unit(x, *unit):.4g}" for x in (of.value, of.lower95, of.upper95))
    interval = f"(95 %: {low} to {high}{name})"
    if of.quantity == "final":
        return f"{'until ' + of.at if of.at else 'in the end'} {number}{name} {interval}"
    if of.quantity == "degree":
        return f"on {of.at} it has shown {number}{name} of that {interval}"
    return f"after {of.at} {number}{name} remain {interval}"
