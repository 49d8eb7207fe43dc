"""``geoident fit`` of a finite element model in service: parameters that all gauges share.

Every gauge has its constant, its motions that do not come back and its noise; they go out of the
misfit by projection (theory 16.8). What is left is an ordinary search, made again with the noise
that the residuals of the one before show, until neither changes.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from geoident.errors import ExitCode, InputError
from geoident.forward.in_service.seasonal import Effects, Scales, independent, lasting_motions
from geoident.forward.in_service.structure import Motions, ServiceModel
from geoident.identify.assessment.uncertainty import Assessment, assess
from geoident.identify.in_time.noise import Noise
from geoident.identify.in_time.regression import (
    GaugeState,
    TimeRegression,
    fitted_noise,
    likely_noises,
)
from geoident.identify.in_time.shared_parameters import (
    GaugeProjection,
    ProjectedResponse,
    state_with_parameters,
)
from geoident.identify.problem.methods import continued, identify
from geoident.identify.problem.outcome import Outcome
from geoident.identify.problem.problem import Problem
from geoident.model.arrays import Floats, Ints
from geoident.model.case import Case
from geoident.model.gauges import ReadingTable
from geoident.model.methods import method_name
from geoident.model.results.costs import Counts
from geoident.model.results.findings import Finding
from geoident.model.results.result import STOPPED, Result
from geoident.workflow.estimating.diagnosis import parameter_table
from geoident.workflow.estimating.finished import Finished, evaluation_log, job_at_hand, write
from geoident.workflow.in_service.effects import all_is_known, channel_rows, structure_effects
from geoident.workflow.in_service.fit import (
    FURTHER,
    GaugeFit,
    explained,
    gauge_findings,
    judged_later,
    no_reading,
    rows_in_time,
    seasonal_fit,
    too_few,
    with_reasons,
)
from geoident.workflow.in_service.logged_motions import LoggedMotions
from geoident.workflow.running.computed import gauge_table
from geoident.workflow.running.control import Control
from geoident.workflow.running.evaluation_log import Log
from geoident.workflow.running.jobs import Job, build_model, job_provenance
from geoident.workflow.running.plausible import implausible_findings
from geoident.workflow.running.readings import LATER, select_readings, unused_notes

_MOST_ROUNDS = 6
"""Searches with ever better noise; two or three are usual."""

_STEADY = 0.1
"""Standard deviations of a parameter by which a new noise may still move it."""

_SAME_SIZE = 0.03
"""Part by which the sizes of the noise may still change."""

_UNLIKELY_LARGE = 3.0
"""Scatter of a gauge, by its accuracy, from which on the model does not explain its readings."""


def fit_structure(job: Job, control: Control) -> Finished:
    """Fit a structure in service to its readings; keep a result that is up to date.

    Raises:
        InputError, ModelError, OutputError: see the commands' exit codes.
        Interrupted: a stop was asked for; a checkpoint is there.
    """
    if (before := job_at_hand(job)) is not None:
        return before
    model = build_model(job.inputs, solver=job.request.solver)
    assert isinstance(model, ServiceModel)
    with evaluation_log(job, control, model) as log:
        result = job.joined(_result(job, model, control, log))
        force = job.request.force
        return write(result, job.place, job.existing, inputs=job.inputs.files, force=force)


@dataclass(frozen=True)
class _Gauge:
    """A gauge with enough readings.

    Args:
        number: of its channel.
        rows: (m,) rows of its readings in their table, in the order of time.
        times: (m,) s.
        y: (m,) the readings, SI.
        X: (m, q) its own terms, of full rank.
        terms: (q,) their numbers.
    """

    number: int
    rows: Ints
    times: Floats
    y: Floats
    X: Floats
    terms: Ints


@dataclass(frozen=True)
class StructureGaugeFit(GaugeFit):
    """What is known of a gauge, with the parameters that it shares.

    Args:
        own: number q of its own terms among ``terms``; then come the parts of the motion, and the
            parameters that are known.
        motions: at its m readings, with the derivatives by these.
        C: (r, r) their covariance.
    """

    own: int
    motions: Motions
    C: Floats

    @property
    def end(self) -> GaugeState:
        """What is known of the gauge after its last reading."""
        state = state_with_parameters(self.regression, self.motions.total[:, 1:], self.C)
        q, number = self.own, len(self.motions.parts)  # whose coefficient is one, and certain
        mean = np.insert(state.mean, q, np.ones(number))
        P = np.insert(np.insert(state.P, [q] * number, 0.0, axis=0), [q] * number, 0.0, axis=1)
        return replace(state, mean=mean, P=P)

    @property
    def read(self) -> Floats:
        """(m,) the readings, SI."""
        return self.regression.y + self.motions.total[:, 0]

    def size(self, effects: Effects, effect: str) -> tuple[float, float] | None:
        """The same; creep does not come back either."""
        if effect not in self.motions.parts:
            return super().size(effects, effect)
        motion = self.motions.parts[effect]
        low, high = int(np.argmin(motion[:, 0])), int(np.argmax(motion[:, 0]))
        if effect == "creep":
            low, high = 0, -1
        step = motion[high] - motion[low]
        if step[0] == 0.0:
            return None
        return float(step[0]), float(np.sqrt(step[1:] @ self.C @ step[1:]))


@dataclass(frozen=True)
class _Fitted:
    """The end of all searches.

    Args:
        outcome: of the last one.
        assessment: how well the parameters are known.
        noises: of each gauge.
        motions: of all g readings, gauge by gauge.
        counts: what it has cost.
    """

    outcome: Outcome
    assessment: Assessment
    noises: tuple[Noise, ...]
    motions: Motions
    counts: Counts


def _result(job: Job, model: ServiceModel, control: Control, log: Log) -> Result:
    case = model.case
    selected = select_readings(case, model)
    known = all_is_known(case, model, selected.time)
    table = with_reasons(selected, model.service, known)
    if not table.used.any():
        raise InputError([no_reading(case, table)])
    gauges = list(_gauges(model, table))
    if not gauges:
        raise InputError([too_few(case, table, 1 + len(_own_columns(model, table)))])
    fitted = _fitted(job, model, gauges, control, log)
    control.finish()
    p, assessment = fitted.outcome.values, fitted.assessment
    certain = np.isfinite(assessment.sd)
    effects = structure_effects(model, p, channel_rows(case, table), table.time)
    fits: list[GaugeFit | None] = [None] * len(case.channels)
    q, parts = len(effects.own), len(fitted.motions.parts)
    for gauge, noise, at in zip(gauges, fitted.noises, _slices(gauges), strict=True):
        columns = np.concatenate([[0], 1 + np.flatnonzero(certain)])
        motions = Motions({k: part[at][:, columns] for k, part in fitted.motions.parts.items()})
        left = gauge.y - motions.total[:, 0]
        likely = likely_noises(gauge.times, left, gauge.X, noise)
        fits[gauge.number] = StructureGaugeFit(
            rows=gauge.rows,
            terms=np.concatenate(
                [gauge.terms, q + np.arange(parts), q + parts + np.flatnonzero(certain)]
            ),
            regression=TimeRegression(gauge.times, left, gauge.X, noise, likely=likely),
            own=len(gauge.terms),
            motions=motions,
            C=assessment.covariance[np.ix_(certain, certain)],
        )
    seasonal = seasonal_fit(fits, effects, Scales())
    later = judged_later(fits, table, effects)
    channels = [channel.name for channel in case.channels]
    table = replace(table, computed=explained(seasonal, channels, table, effects))
    loose = [q.name for q, has in zip(case.parameters, certain, strict=True) if not has]
    status = fitted.outcome.status
    if status == "converged" and loose:
        status = "not-determined"
    values = {
        q.name: float(v) for q, v, has in zip(case.parameters, p, certain, strict=True) if has
    }
    return Result(
        kind="fit",
        status=status,
        exit_code=ExitCode.DONE if status == "converged" else ExitCode.NOT_CONVERGED,
        method=" + ".join(method_name(options) for options in job.methods),
        reason=fitted.outcome.reason + (f" Not determined: {', '.join(loose)}." if loose else ""),
        objective=fitted.outcome.objective,
        findings=(
            *assessment.findings,
            *implausible_findings(case, values),
            *_unexplained(case, gauges, fitted.noises),
            *gauge_findings(case, fits, effects, later, table),
        ),
        case_text=job.inputs.loaded.text,
        case_resolved=job.inputs.loaded.resolved,
        provenance=job_provenance(job),
        parameters=parameter_table(case.parameters, p, assessment),
        gauges=gauge_table(case, table, np.full((len(case.channels), len(case.stages)), np.nan)),
        counts=fitted.counts,
        history=fitted.outcome.iterations,
        singular_values=assessment.singular_values,
        seasonal=seasonal,
        judged=later if table.reason.count(LATER) else None,
        notes=(
            *case.notes,
            *dict.fromkeys((*model.notes, *fitted.outcome.remarks)),
            *unused_notes(table),
        ),
    )


def _own_columns(model: ServiceModel, table: ReadingTable) -> list[Floats]:
    """What does not come back, at the times of all readings."""
    return [values for _, values in lasting_motions(model.service, table.time)]


def _gauges(model: ServiceModel, table: ReadingTable) -> Iterator[_Gauge]:
    """The gauges that have enough readings."""
    columns = np.column_stack([np.ones(len(table)), *_own_columns(model, table)])
    for number, channel in enumerate(model.case.channels):
        rows = rows_in_time(table, channel.name, table.used)
        if len(rows) < columns.shape[1] + FURTHER:
            continue
        terms = independent(columns[rows])
        X = columns[rows][:, terms]
        yield _Gauge(number, rows, table.time[rows], table.value[rows], X, terms)


def _slices(gauges: Sequence[_Gauge]) -> list[slice]:
    """Where the readings of each gauge stand among those of all."""
    ends = np.cumsum([len(gauge.rows) for gauge in gauges]).tolist()
    return [slice(a, b) for a, b in zip([0, *ends], ends, strict=False)]


def _fitted(
    job: Job, model: ServiceModel, gauges: Sequence[_Gauge], control: Control, log: Log
) -> _Fitted:
    """Search after search, each with the noise that the one before has left."""
    case, slices = model.case, _slices(gauges)
    rows = np.concatenate([np.full(len(gauge.rows), gauge.number) for gauge in gauges])
    times, y = (np.concatenate([getattr(g, name) for g in gauges]) for name in ("times", "y"))
    logged = LoggedMotions(model, rows, times, log, control)

    def motion(p: Floats) -> tuple[Floats, Floats]:
        total = logged.at(p).total
        return total[:, 0], total[:, 1:]

    noises = tuple(Noise(case.channels[gauge.number].accuracy) for gauge in gauges)
    methods = job.methods
    before: Outcome | None = None
    for number in range(_MOST_ROUNDS):
        control.stop.check()
        control.monitor.detail(f"search {number + 1}")
        projections = [
            GaugeProjection(noise, gauge.times, gauge.X)
            for noise, gauge in zip(noises, gauges, strict=True)
        ]
        response = ProjectedResponse(
            model.names, motion, model.admissible, lambda: logged.counts, slices, projections
        )
        measured = response.projected(y[:, None])[:, 0]
        problem = Problem(response, measured, np.ones(len(y)), case.parameters)
        if before is not None:
            problem = problem.begun_at(before.values)
        elif job.earlier is not None:
            problem = problem.begun_at(
                np.array([job.earlier.values[parameter.name] for parameter in case.parameters])
            )
        outcome = identify(problem, methods, control.on_iteration)
        if before is not None:
            history = (*before.iterations, *outcome.iterations)
            outcome = replace(outcome, iterations=history)
        methods = tuple(continued(methods))
        v, jacobian = response.evaluate(outcome.values)
        assessment = assess(problem, outcome.values, jacobian, v)
        motions = logged.at(outcome.values)
        left = y - motions.total[:, 0]
        after = tuple(
            fitted_noise(gauge.times, left[at], gauge.X)
            for gauge, at in zip(gauges, slices, strict=True)
        )
        same = all(_alike(a, b) for a, b in zip(noises, after, strict=True))
        if outcome.status == STOPPED or same or (
            before is not None and _stays(before.values, outcome.values, assessment)
        ):  # fmt: skip
            break
        noises, before = after, outcome
    return _Fitted(outcome, assessment, noises, motions, logged.counts)


def _alike(one: Noise, other: Noise) -> bool:
    return all(
        abs(getattr(one, name) - getattr(other, name)) <= _SAME_SIZE * one.sd
        for name in ("white", "lasting", "drift")
    )


def _stays(before: Floats, after: Floats, assessment: Assessment) -> bool:
    """Whether a new noise has moved no parameter that is known."""
    known = np.isfinite(assessment.sd) & (assessment.sd > 0.0)
    return bool(np.all(np.abs(after - before)[known] <= _STEADY * assessment.sd[known]))


def _unexplained(
    case: Case, gauges: Sequence[_Gauge], noises: Sequence[Noise]
) -> Iterator[Finding]:
    """Gauges whose readings scatter far more than their accuracy lets expect."""
    for gauge, noise in zip(gauges, noises, strict=True):
        channel = case.channels[gauge.number]
        times = noise.sd / channel.accuracy
        if times > _UNLIKELY_LARGE:
            yield Finding(
                "misfit",
                channel.name,
                f"The readings of {channel.name} scatter {times:.1f} times its stated accuracy "
                "about the model: something acts that the model does not have, or the accuracy is "
                "not that of this gauge. Intervals and bands hold the scatter.",
                {"times": float(times)},
            )
