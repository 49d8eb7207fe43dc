"""``geoident fit`` of a finite element model in service: parameters that all gauges share.

Every gauge has its constant, its motions that do not come back and its noise; they go out of the
misfit by projection (theory 16.8). The model errs for each gauge (16.9). What is left is an
ordinary search, made again with the noise and the error of the model that the residuals of the one
before show, until neither changes.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from geoident.errors import ExitCode, InputError
from geoident.forward.in_service.error_shapes import OWN_SIGN
from geoident.forward.in_service.seasonal import Effects, Scales, independent, lasting_motions
from geoident.forward.in_service.structure import Motions, ServiceModel
from geoident.identify.assessment.model_error import PRIOR_SD, SizeWeights
from geoident.identify.assessment.uncertainty import Assessment, assess
from geoident.identify.in_time.noise import Noise
from geoident.identify.in_time.regression import (
    GaugeState,
    TimeRegression,
    fitted_noise,
    likely_noises,
)
from geoident.identify.in_time.shared_parameters import (
    ErrorsOfModel,
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
from geoident.model.results.model_error import USUAL
from geoident.model.results.result import STOPPED, Result
from geoident.workflow.estimating.diagnosis import parameter_table
from geoident.workflow.estimating.finished import Finished, evaluation_log, job_at_hand, write
from geoident.workflow.estimating.model_error import percent
from geoident.workflow.estimating.model_error_covariance import correlation_length
from geoident.workflow.in_service.effects import (
    all_is_known,
    channel_rows,
    effects_of_motions,
    structure_effects,
)
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
from geoident.workflow.in_service.model_error import (
    GaugeErrors,
    gauge_errors,
    model_error_table,
    weights_of_size,
)
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

    The regression is of the readings less the model, on the terms of the gauge and the shapes of
    the error of the model.

    Args:
        motions: at its m readings, with the derivatives by the parameters that are known.
        C: (r, r) the covariance of these; they are the last of ``terms``.
        of_model: (k,) places among ``terms`` of the parts of the motion themselves.
        certain: places among ``terms`` of those of which the model does not err: one.
    """

    motions: Motions
    C: Floats
    of_model: Ints
    certain: Ints

    @cached_property
    def end(self) -> GaugeState:
        """What is known of the gauge after its last reading."""
        state = state_with_parameters(self.regression, self.motions.total[:, 1:], self.C)
        mean, P = state.mean, state.P
        at = self.certain - np.arange(len(self.certain))
        mean = np.insert(mean, at, 0.0)
        P = np.insert(np.insert(P, at, 0.0, axis=0), at, 0.0, axis=1)
        mean[self.of_model] += 1.0
        return replace(state, mean=mean, P=P)

    @property
    def read(self) -> Floats:
        """(m,) the readings, SI."""
        return self.regression.y + self.motions.total[:, 0]

    def size(self, effects: Effects, effect: str) -> tuple[float, float] | None:
        """The same; creep does not come back either."""
        if effect not in self.motions.parts:
            return super().size(effects, effect)
        own = np.flatnonzero(np.isin(self.terms, effects.of(effect)))
        if not own.size:
            return None
        by_parameters = self.motions.parts[effect][:, 1:]
        X = np.column_stack([effects.columns[self.rows][:, self.terms[own]], by_parameters])
        number = len(self.terms)
        at = [*own, *range(number - by_parameters.shape[1], number)]
        motion = X @ self.end.mean[at]
        low, high = int(np.argmin(motion)), int(np.argmax(motion))
        if effect == "creep":
            low, high = 0, -1
        step = X[high] - X[low]
        if not step.any():
            return None
        P = self.end.P[np.ix_(at, at)]
        return float(motion[high] - motion[low]), float(np.sqrt(max(step @ P @ step, 0.0)))


@dataclass(frozen=True)
class _Fitted:
    """The end of all searches.

    Args:
        outcome: of the last one.
        assessment: how well the parameters are known.
        noises: of each gauge.
        motions: of all g readings, gauge by gauge.
        errors: of the model; None for none.
        eta: their size, and what the residuals say of it; None where it is given.
        length: over which they are alike, m.
        counts: what it has cost.
    """

    outcome: Outcome
    assessment: Assessment
    noises: tuple[Noise, ...]
    motions: Motions
    errors: GaugeErrors | None
    eta: float
    weights: SizeWeights | None
    length: float
    counts: Counts

    def regression_of(self, gauge: _Gauge, number: int, left: Floats) -> TimeRegression:
        """Readings of a gauge, less the model, on its own terms and the shapes of the errors."""
        return _regression(gauge, left, self.noises[number], self.errors, self.eta, number)


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
    scales = _scales(model, table)
    fitted = _fitted(job, model, gauges, scales, control, log)
    control.finish()
    p, assessment = fitted.outcome.values, fitted.assessment
    certain = np.isfinite(assessment.sd)
    effects = structure_effects(model, p, scales, channel_rows(case, table), table.time)
    fits: list[GaugeFit | None] = [None] * len(case.channels)
    shapes = np.concatenate([effects.of("level"), effects.of("temperature")])
    of_model = np.array([j for j in shapes if effects.names[j] in OWN_SIGN], dtype=np.int64)
    of_errors, creep = of_model if fitted.errors is None else shapes, effects.of("creep")
    sure = creep if fitted.errors is not None else np.concatenate([of_model, creep])
    determined = len(effects.names) - len(p) + np.flatnonzero(certain)
    for k, (gauge, at) in enumerate(zip(gauges, _slices(gauges), strict=True)):
        columns = np.concatenate([[0], 1 + np.flatnonzero(certain)])
        motions = Motions({k: part[at][:, columns] for k, part in fitted.motions.parts.items()})
        left = gauge.y - motions.total[:, 0]
        regression = fitted.regression_of(gauge, k, left)
        terms = np.concatenate([gauge.terms, of_errors, creep, determined])
        fits[gauge.number] = StructureGaugeFit(
            rows=gauge.rows,
            terms=terms,
            regression=replace(regression, likely=likely_noises(regression)),
            motions=motions,
            C=assessment.covariance[np.ix_(certain, certain)],
            of_model=np.flatnonzero(np.isin(terms, [*of_model, *creep])),
            certain=np.flatnonzero(np.isin(terms, sure)),
        )
    seasonal = seasonal_fit(fits, effects, scales)
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
            *_poor(case, fits, fitted, effects),
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
        model_error=None
        if fitted.errors is None
        else model_error_table(fitted.eta, fitted.weights, fitted.length, len(table)),
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


def _scales(model: ServiceModel, table: ReadingTable) -> Scales:
    """What the level counts from: its range at the readings that are used."""
    if model.service.level is None:
        return Scales()
    level = model.service.level.at(table.time[table.used])
    low, high = float(level.min()), float(level.max())
    return Scales(low, high if high > low else low + 1.0)


def _regression(
    gauge: _Gauge,
    left: Floats,
    noise: Noise,
    errors: GaugeErrors | None,
    eta: float,
    number: int,
) -> TimeRegression:
    """Readings of a gauge less the model on its own terms, and on the shapes of model errors.

    Args:
        gauge: with m readings.
        left: (m,) these less the model, SI.
        noise: of them.
        errors: of the model; None for none.
        eta: their size.
        number: of the gauge among these.
    """
    if errors is None:
        return TimeRegression(gauge.times, left, gauge.X, noise)
    spread = np.concatenate([np.full(gauge.X.shape[1], np.inf), eta * errors.sd[number]])
    X = np.column_stack([gauge.X, errors.columns[number]])
    return TimeRegression(gauge.times, left, X, noise, spread=spread)


def _fitted(
    job: Job,
    model: ServiceModel,
    gauges: Sequence[_Gauge],
    scales: Scales,
    control: Control,
    log: Log,
) -> _Fitted:
    """Search after search, each with the noise and the model error that the one before has left."""
    case, slices = model.case, _slices(gauges)
    numbers, moments = [gauge.number for gauge in gauges], [gauge.times for gauge in gauges]
    rows = np.repeat(numbers, [len(own) for own in moments])
    times, y = np.concatenate(moments), np.concatenate([gauge.y for gauge in gauges])
    asked = case.fit.model_error
    eta = asked.size if asked.kind == "given" else PRIOR_SD
    length = correlation_length(case, asked)
    weights: SizeWeights | None = None
    logged = LoggedMotions(model, rows, times, log, control)

    def motion(p: Floats) -> tuple[Floats, Floats]:
        total = logged.at(p).total
        return total[:, 0], total[:, 1:]

    def errors_at(p: Floats) -> GaugeErrors | None:
        if asked.kind == "none":
            return None
        effects = effects_of_motions(model, logged.at(p), scales, times)
        return gauge_errors(model, effects, numbers, moments, length)

    noises = tuple(Noise(case.channels[number].accuracy) for number in numbers)
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
        problem = Problem(response, y, np.ones(len(y)), case.parameters)
        if before is not None:
            problem = problem.begun_at(before.values)
        elif job.earlier is not None:
            problem = problem.begun_at(
                np.array([job.earlier.values[parameter.name] for parameter in case.parameters])
            )
        errors = errors_at(problem.start)
        if errors is not None:
            shapes = [of(Z) for of, Z in zip(projections, errors.columns, strict=True)]
            response = replace(response, errors=(ErrorsOfModel(shapes, errors.root), eta))
        measured = response.projected(y[:, None])[:, 0]
        problem = replace(problem, response=response, measured=measured)
        outcome = identify(problem, methods, control.on_iteration)
        if before is not None:
            history = (*before.iterations, *outcome.iterations)
            outcome = replace(outcome, iterations=history)
        methods = tuple(continued(methods))
        v, jacobian = response.evaluate(outcome.values)
        assessment = assess(problem, outcome.values, jacobian, v)
        motions = logged.at(outcome.values)
        left = y - motions.total[:, 0]
        eta_after = eta
        if errors is not None and asked.kind == "estimate":
            columns = []
            for Z, of, at in zip(shapes, projections, slices, strict=True):
                white = of(np.column_stack([motions.total[at, 1:], left[at]]))
                columns.append((Z, white[:, :-1], white[:, -1]))
            weights = weights_of_size(problem, outcome.values, columns, errors.root)
            eta_after = weights.size
        errors_after = errors_at(outcome.values)
        after = tuple(
            fitted_noise(_regression(gauge, left[at], noise, errors_after, eta_after, k))
            for k, (gauge, at, noise) in enumerate(zip(gauges, slices, noises, strict=True))
        )
        same = all(_alike(a, b) for a, b in zip(noises, after, strict=True))
        same &= abs(eta_after - eta) <= _SAME_SIZE * eta
        if outcome.status == STOPPED or same or (
            before is not None and _stays(before.values, outcome.values, assessment)
        ):  # fmt: skip
            break
        noises, eta, before = after, eta_after, outcome
    counts = logged.counts
    return _Fitted(outcome, assessment, noises, motions, errors, eta, weights, length, counts)


def _alike(one: Noise, other: Noise) -> bool:
    return all(
        abs(getattr(one, name) - getattr(other, name)) <= _SAME_SIZE * one.sd
        for name in ("white", "lasting", "drift")
    )


def _stays(before: Floats, after: Floats, assessment: Assessment) -> bool:
    """Whether a new noise has moved no parameter that is known."""
    known = np.isfinite(assessment.sd) & (assessment.sd > 0.0)
    return bool(np.all(np.abs(after - before)[known] <= _STEADY * assessment.sd[known]))


def _poor(
    case: Case, fits: Sequence[GaugeFit | None], fitted: _Fitted, effects: Effects
) -> Iterator[Finding]:
    """Gauges of which the model errs by much of what level or temperature do to them."""
    for channel, fit in zip(case.channels, fits, strict=True):
        if not isinstance(fit, StructureGaugeFit) or fitted.errors is None:
            continue
        columns, mean = effects.columns[fit.rows][:, fit.terms], fit.end.mean[: len(fit.terms)]
        for effect in ("level", "temperature"):
            own = np.isin(fit.terms, effects.of(effect))
            motion = fit.motions.parts[effect][:, 0]
            off = columns[:, own] @ mean[own] - motion
            part = float(np.std(off) / np.std(motion)) if np.std(motion) > 0.0 else 0.0
            if part > USUAL and np.std(off) > channel.accuracy:
                yield Finding(
                    "model-error",
                    channel.name,
                    f"The model errs by {percent(part)} of what the {effect} does to "
                    f"{channel.name}: something acts there that it does not have. Intervals and "
                    "bands hold that.",
                    {"part": part},
                )


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
