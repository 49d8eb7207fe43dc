"""``geoident fit`` of a seasonal model: the coefficients and the noise of each gauge by itself."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.special import bdtr

from geoident.errors import ExitCode, Fault, InputError
from geoident.forward.in_service.seasonal import (
    EFFECTS,
    ON_A_MESH,
    Effects,
    Scales,
    effects_at,
    independent,
)
from geoident.identify.in_time.innovations import Filter
from geoident.identify.in_time.noise import PROCESSES
from geoident.identify.in_time.regression import (
    GaugeState,
    TimeRegression,
    regression_in_time,
)
from geoident.io.text.dates import date_text
from geoident.model.arrays import Bools, Floats, Ints
from geoident.model.case import Case
from geoident.model.gauges import ReadingTable, named_channels
from geoident.model.in_service import SeasonalModel, StructureInService
from geoident.model.results.bands import NORMAL_95
from geoident.model.results.costs import NO_COST
from geoident.model.results.findings import Finding
from geoident.model.results.in_service import Judged, SeasonalFit
from geoident.model.results.result import Result
from geoident.workflow.estimating.diagnosis import bare_parameter_table
from geoident.workflow.estimating.finished import Finished, job_at_hand, write
from geoident.workflow.running.computed import gauge_table
from geoident.workflow.running.control import Control
from geoident.workflow.running.jobs import Job, build_model, job_provenance
from geoident.workflow.running.readings import LATER, select_readings, unused_notes

FURTHER = 5
"""Readings that a gauge needs beyond its coefficients."""

_FAR = 5.0
"""Standard deviations from which on a reading is named: chance does it once in two million."""

_TOO_LONG = 0.2
"""Part of the record from which on an error that lasts so long hides effects of time."""


def fit_seasonal(job: Job, control: Control) -> Finished:
    """Fit a seasonal model to the readings of each gauge; keep a result that is up to date.

    Raises:
        InputError, OutputError: see the commands' exit codes.
        Interrupted: a stop was asked for; nothing is kept, as it takes little time.
    """
    if (before := job_at_hand(job)) is not None:
        return before
    case = job.inputs.case
    assert isinstance(case.elsewhere, SeasonalModel)
    result = job.joined(_result(job, case, case.elsewhere, control))
    force = job.request.force
    return write(result, job.place, job.existing, inputs=job.inputs.files, force=force)


def _result(job: Job, case: Case, model: SeasonalModel, control: Control) -> Result:
    scales = Scales.of(model)
    selected = select_readings(case, build_model(job.inputs))
    effects = effects_at(model, scales, selected.time)
    table = with_reasons(selected, model, effects.known)
    if not table.used.any():
        raise InputError([no_reading(case, table)])
    fits: list[GaugeFit | None] = []
    for number, channel in enumerate(case.channels):
        control.stop.check()
        control.monitor.part(channel.name, number / len(case.channels))
        fits.append(fitted(table, effects, channel.name))
    control.finish()
    if not any(fits):
        raise InputError([too_few(case, table, len(effects.names))])
    seasonal, later = seasonal_fit(fits, effects, scales), judged_later(fits, table, effects)
    channels = [channel.name for channel in case.channels]
    table = replace(table, computed=explained(seasonal, channels, table, effects))
    stage = np.full((len(case.channels), len(case.stages)), np.nan)
    return Result(
        kind="fit",
        status="converged",
        exit_code=ExitCode.DONE,
        method="restricted likelihood",
        reason="Each gauge has its own coefficients and noise.",
        objective=float("nan"),
        findings=tuple(gauge_findings(case, fits, effects, later, table)),
        case_text=job.inputs.loaded.text,
        case_resolved=job.inputs.loaded.resolved,
        provenance=job_provenance(job),
        parameters=bare_parameter_table(case.parameters, np.zeros(0)),
        gauges=gauge_table(case, table, stage),
        counts=NO_COST,
        seasonal=seasonal,
        judged=later if table.reason.count(LATER) else None,
        notes=(*case.notes, *unused_notes(table)),
    )


@dataclass(frozen=True)
class GaugeFit:
    """The regression of one gauge.

    Args:
        rows: (m,) rows of its readings in their table, in the order of time.
        terms: (r,) numbers of the terms that its readings can tell from each other.
        regression: of the readings on these.
    """

    rows: Ints
    terms: Ints
    regression: TimeRegression

    @property
    def end(self) -> GaugeState:
        """What is known of the gauge after its last reading: of the terms, and of its errors."""
        return self.regression.end

    @property
    def read(self) -> Floats:
        """(m,) the readings, SI."""
        return self.regression.y

    def size(self, effects: Effects, effect: str) -> tuple[float, float] | None:
        """The range of the readings that an effect causes, or its motion if it does not come back.

        With its standard deviation; None where the effect has no term that the readings can tell.
        """
        own = np.flatnonzero(np.isin(self.terms, effects.of(effect)))
        if not own.size:
            return None
        X = self.regression.X[:, own]
        motion = X @ self.regression.b[own]
        low, high = int(np.argmin(motion)), int(np.argmax(motion))
        if effect == "irreversible":
            low, high = 0, -1
        step = X[high] - X[low]
        C = self.regression.covariance[np.ix_(own, own)]
        return float(motion[high] - motion[low]), float(np.sqrt(step @ C @ step))


def with_reasons(
    table: ReadingTable, model: SeasonalModel | StructureInService, known: Bools
) -> ReadingTable:
    """Readings of which those are not used, and say why, whose time or loads are not known.

    Of several of a gauge at one time the last is used.

    Args:
        table: all k readings.
        model: what acts.
        known: (k,) whether all that acts is known at their times.
    """
    acting = " or ".join(f"the {series.name}" for series in model.series)
    reasons = list(table.reason)
    latest: dict[tuple[str, float], int] = {}
    for k in range(len(table)):
        if reasons[k] not in ("", LATER):
            continue
        if np.isnan(table.time[k]):
            reasons[k] = "it has no date"
        elif not known[k]:
            reasons[k] = f"{acting} is not known then"
        else:
            place = table.channel[k], float(table.time[k])
            if place in latest:
                reasons[latest[place]] = "another one of the same time is used"
            latest[place] = k
    used = np.array([not reason for reason in reasons], dtype=np.bool_)
    return replace(table, reason=tuple(reasons), used=used)


def rows_in_time(table: ReadingTable, channel: str, chosen: Bools) -> Ints:
    """Rows (m,) of the chosen readings of a channel, in the order of time."""
    own = np.array(table.channel) == channel
    rows = np.flatnonzero(own & chosen)
    return np.asarray(rows[np.argsort(table.time[rows], kind="stable")])


def fitted(table: ReadingTable, effects: Effects, channel: str) -> GaugeFit | None:
    """The regression of a channel; None where it has too few readings."""
    rows = rows_in_time(table, channel, table.used)
    X = effects.columns[rows]
    terms = independent(X)
    if len(rows) < len(terms) + FURTHER or not len(terms):
        return None
    return GaugeFit(
        rows, terms, regression_in_time(table.time[rows], table.value[rows], X[:, terms])
    )


def seasonal_fit(fits: Sequence[GaugeFit | None], effects: Effects, scales: Scales) -> SeasonalFit:
    """What is known of all gauges, from their regressions."""
    n, q = len(fits), len(effects.names)
    unknown = np.full(n, np.nan)
    columns = {
        name: unknown.copy()
        for name in (
            "lasting_now",
            "drift_now",
            "last",
            "white",
            "lasting",
            "fades",
            "drift",
            "explained",
        )
    }
    named = [name for name in EFFECTS if name not in ON_A_MESH or name in effects.effects]
    columns |= {name: unknown.copy() for effect in named for name in (effect, f"{effect}_sd")}
    states = q + PROCESSES
    coefficients, covariance = np.full((n, q), np.nan), np.full((n, states, states), np.nan)
    number = np.zeros(n, dtype=np.int64)
    most = max((len(fit.regression.likely) for fit in fits if fit is not None), default=0)
    likely = np.full((n, most, 4), np.nan)
    for i, fit in enumerate(fits):
        if fit is None:
            continue
        regression, noise = fit.regression, fit.regression.noise
        end = fit.end
        at = np.append(fit.terms, q + np.arange(PROCESSES))
        coefficients[i, fit.terms] = end.mean[:-PROCESSES]
        covariance[i][np.ix_(at, at)] = end.P
        for k, one in enumerate(regression.likely):
            likely[i, k] = one.white, one.lasting, one.time, one.drift
        number[i] = len(fit.rows)
        columns["lasting_now"][i], columns["drift_now"][i] = end.mean[-PROCESSES:]
        columns["last"][i], columns["drift"][i] = end.time, noise.drift
        columns["white"][i], columns["lasting"][i] = noise.white, noise.lasting
        columns["fades"][i] = noise.time if noise.lasting else np.nan
        left, spread = regression.residual.var(), fit.read.var()
        columns["explained"][i] = max(1.0 - left / spread, 0.0) if spread else np.nan
        for effect in named:
            size = fit.size(effects, effect)
            if size is not None:
                columns[effect][i], columns[f"{effect}_sd"][i] = size
    return SeasonalFit(
        terms=effects.names, effects=effects.effects, coefficients=coefficients,
        covariance=covariance, likely_noises=likely, number=number, level_low=scales.level_low,
        level_high=scales.level_high, air_mean=scales.air_mean, **columns,
    )  # fmt: skip


def judged_later(fits: Sequence[GaugeFit | None], table: ReadingTable, effects: Effects) -> Judged:
    """The readings after `fit.until`."""
    later = np.array([reason == LATER for reason in table.reason], dtype=np.bool_)
    filters = []
    for fit in fits:
        if fit is not None:
            rows = rows_in_time(table, table.channel[fit.rows[0]], later)
            rows = rows[table.time[rows] > fit.regression.times[-1]]
            X = effects.columns[rows][:, fit.terms]
            filters.append((rows, Filter(fit.end, table.time[rows], X)))
    return judged(table, filters)


def judged(table: ReadingTable, filters: Sequence[tuple[Ints, Filter]]) -> Judged:
    """What readings were expected to be, each before it was taken.

    Args:
        table: all k readings.
        filters: rows (m,) of those of a gauge, and the filter over them, for each gauge.
    """
    predicted, sd = (np.full(len(table), np.nan) for _ in range(2))
    for rows, filtered in filters:
        predicted[rows], sd[rows] = filtered.predicted(table.value[rows]), filtered.sd
    return Judged(predicted, sd, (table.value - predicted) / sd)


def explained(
    fit: SeasonalFit, channels: Sequence[str], table: ReadingTable, effects: Effects
) -> Floats:
    """(k,) what the effects make of each reading, without the error that lasts, SI.

    Args:
        fit: what is known of the gauges.
        channels: n_gauges names.
        table: the k readings.
        effects: at their times.
    """
    row = {name: i for i, name in enumerate(channels)}
    rows = np.array([row[name] for name in table.channel], dtype=np.int64)
    b = np.nan_to_num(fit.coefficients)[rows]
    sums = np.einsum("kq,kq->k", effects.columns, b)
    return np.where(np.isfinite(fit.white)[rows], sums, np.nan)


def unknown_later(case: Case, table: ReadingTable) -> Iterator[str]:
    """Loads that end before the last reading, and which file is to go on."""
    assert case.in_time is not None
    for series in case.in_time.series:
        end = float(series.times[-1])
        if (table.time > end).any():
            yield f"The {series.name} is known to {date_text(end)}: extend '{series.path}'."


def too_few(case: Case, table: ReadingTable, number: int) -> Fault:
    """No gauge has as many readings as a number of coefficients needs."""
    need = number + FURTHER
    most = max(int(table.used[np.array(table.channel) == c.name].sum()) for c in case.channels)
    message = (
        f"no gauge has enough readings: {number} coefficients need {need} of a gauge, "
        f"and there are {most} at most"
    )
    why = sorted({reason for reason in table.reason if reason})
    hint = "Add readings, or leave out effects of the model."
    hint += f" Not used: {'; '.join(why)}." if why else ""
    return case.source.fault(("readings",), "too-few-readings", message, hint)


def no_reading(case: Case, table: ReadingTable) -> Fault:
    """No reading can be used at all."""
    why = sorted({reason for reason in table.reason if reason})
    hint = f"Not used: {'; '.join(why)}." if why else "Add readings with dates."
    hint = " ".join([hint, *unknown_later(case, table), *case.notes])
    message = "there is no reading to which the model could be fitted"
    return case.source.fault(("readings",), "too-few-readings", message, hint)


def gauge_findings(
    case: Case,
    fits: Sequence[GaugeFit | None],
    effects: Effects,
    later: Judged,
    table: ReadingTable,
) -> Iterator[Finding]:
    """What an engineer must know before using the numbers."""
    names = [channel.name for channel in case.channels]
    few = [name for name, fit in zip(names, fits, strict=True) if fit is None]
    if few:
        number = len(effects.own)
        need = number + FURTHER
        yield Finding(
            "not-determined",
            ", ".join(few),
            f"{named_channels(few)} cannot be fitted: for {number} coefficients a "
            f"gauge needs {need} readings with known loads.",
        )
    known = [(name, fit) for name, fit in zip(names, fits, strict=True) if fit is not None]
    for words, gauges in _not_told(known, effects).items():
        yield Finding(
            "not-separated",
            ", ".join(gauges),
            f"The readings of {named_channels(gauges)} cannot tell {words} from the other effects: "
            "it is left out there.",
        )
    lasting = [name for name, fit in known if _hides_time(fit.regression)]
    if lasting:
        yield Finding(
            "correlated-residuals",
            ", ".join(lasting),
            f"The residuals of {named_channels(lasting)} drift over more than a fifth of the "
            "record: an effect is missing, and motions of that length cannot be told from errors.",
        )
    for name, fit in known:
        noise = fit.regression.noise
        residual = fit.regression.residual / np.hypot(noise.white, noise.lasting)
        far = np.flatnonzero(np.abs(residual) > _FAR)
        if far.size:
            yield Finding(
                "far-reading",
                name,
                f"{name} is far off on {far_readings(fit.regression.times[far], residual[far])}: "
                "what is wrong, mark as bad.",
            )
    yield from _later_findings(later, table)


def far_readings(times: Floats, sd: Floats) -> str:
    """Dates of single readings that are far off, of many the farthest.

    Args:
        times: (n,) s since 1970.
        sd: (n,) how far off each is, standard deviations.
    """
    far = np.sort(np.argsort(-np.abs(sd))[:_NAMED])
    named = ", ".join(f"{date_text(float(times[k]))[:10]} ({sd[k]:+.0f} sd)" for k in far)
    return named + (f" and {len(sd) - len(far)} more" if len(sd) > len(far) else "")


_NAMED = 5
"""Far readings of a gauge that are named."""


def _not_told(known: Sequence[tuple[str, GaugeFit]], effects: Effects) -> dict[str, list[str]]:
    """Terms that were left out, in words, to the gauges of which they were."""
    together: dict[str, list[str]] = {}
    for name, fit in known:
        left_out = np.setdiff1d(effects.own, fit.terms)
        if left_out.size:
            words = ", ".join(f"'{effects.names[j]}'" for j in left_out)
            together.setdefault(words, []).append(name)
    return together


def _hides_time(regression: TimeRegression) -> bool:
    """Whether an error lasts so long that it is like a motion."""
    span = regression.times[-1] - regression.times[0]
    return regression.noise.lasting > 0.0 and regression.noise.time > _TOO_LONG * span


def _later_findings(later: Judged, table: ReadingTable) -> Iterator[Finding]:
    """Gauges whose later readings are not as expected: more outside than chance leaves."""
    channels = np.array(table.channel)
    off = []
    for name in dict.fromkeys(table.channel):
        e = later.innovation[channels == name]
        e = e[np.isfinite(e)]
        inside = int(np.count_nonzero(np.abs(e) <= NORMAL_95))
        if e.size and bdtr(inside, e.size, 0.95) < _BY_CHANCE:
            off.append((name, inside, e.size))
    for name, inside, number in off:
        yield Finding(
            "bands",
            name,
            f"Of the {number} readings of {name} after fit.until {inside} lie inside their 95 % "
            "bands: it no longer moves as it did. `geoident control` says since when, and how.",
            {"inside": inside, "number": number},
        )


_BY_CHANCE = 1e-3
"""Probability of as few readings inside their bands, below which it is said."""
