"""What readings to come would tell, with all errors that a fit would take into account."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from geoident.errors import ModelError
from geoident.forward.observed import ObservedModel, Survey
from geoident.identify.assessment.design import Outlook
from geoident.identify.assessment.uncertainty import Assessment, assess
from geoident.identify.problem.problem import Problem
from geoident.identify.problem.scaling import Scaling
from geoident.model.arrays import Floats, Ints
from geoident.model.case import Case
from geoident.model.decision import Condition
from geoident.model.results.result import Result
from geoident.workflow.estimating.from_fit import known_by_fit
from geoident.workflow.estimating.model_error import FittedModelError, LaterModelError
from geoident.workflow.estimating.model_error_covariance import (
    ReadingSteps,
    correlation_length,
    correlation_time,
)
from geoident.workflow.estimating.predictions import KnownErrors, joint_readings
from geoident.workflow.running.computed import accuracies

ASSUMED = 0.15
"""Model error that is assumed where it is to be estimated, and there are no residuals yet."""


@dataclass(frozen=True)
class Wanted:
    """One of what is to be known.

    Args:
        text: as it was asked for.
        parameter: number of a parameter; None for a reading.
        row: number of the channel.
        stage: number of the stage; of a parameter that after the last one. Readings before it tell.
        condition: on the reading, or None.
    """

    text: str
    parameter: int | None
    row: int
    stage: int
    condition: Condition | None = None


@dataclass(frozen=True)
class Plannable:
    """A case whose readings to come may tell of something.

    Args:
        model: of the case.
        case: with all gauges that may be read.
        values: (n,) parameters, SI.
        fit: what was found so far, or None.
        origin: the case of the fit.
    """

    model: ObservedModel
    case: Case
    values: Floats
    fit: Result | None = None
    origin: Case | None = None

    @property
    def last(self) -> int:
        """Number of the last stage that was read; -1 before any."""
        return last_read(self.fit)

    @property
    def model_error(self) -> float:
        """Size of the model error, as a part of the computed motion; 0 for none."""
        if self.fit is not None:
            return self.fit.model_error.size if self.fit.model_error is not None else 0.0
        options = self.case.fit.model_error
        return {"none": 0.0, "given": options.size}.get(options.kind, ASSUMED)

    def survey(self, p: Floats, *, fields: bool = False) -> Survey:
        """The model at parameters (n,), SI, as far as it has a solution."""
        return self.model.survey(p, fields=fields, partial=True)

    def known(self, survey: Survey) -> tuple[Assessment, KnownErrors | None]:
        """What is known of the parameters, and of the errors of readings to come."""
        if self.fit is not None and self.origin is not None:
            known = known_by_fit(
                self.fit, self.origin, self.model, self.case, survey, same_case=True, follow=False
            )
            return known.assessment, known.errors
        none = np.zeros(0)
        problem = Problem(self.model.response(()), none, none, self.case.parameters)
        jacobian = np.zeros((0, len(self.values)))
        error, later = self._model_error_before(), None
        if error is not None:
            later = LaterModelError(error, self.case, self.model, survey.increments)
        errors = None
        if later is not None or any(channel.errors for channel in self.case.channels):
            errors = KnownErrors(self.case, problem, none, jacobian, (), later)
        return assess(problem, self.values, jacobian), errors

    def _model_error_before(self) -> FittedModelError | None:
        """The model error before anything was read; None for none."""
        case, options = self.case, self.case.fit.model_error
        if not self.model_error:
            return None
        pairs = [(c.name, s.name) for c in case.channels for s in case.stages]
        time = correlation_time(case, options, pairs)
        none = np.zeros((0, len(case.stage_names)))
        moments = None if time is None else np.zeros(0)
        used = ReadingSteps((), case.stage_names, none, none, moments)
        length = correlation_length(case, options)
        return FittedModelError(used, self.model_error, length, time=time)

    def drawn(self, assessment: Assessment, count: int, seed: int) -> list[Floats]:
        """Parameters (n,) from what is known of them."""
        rng, posterior = np.random.default_rng(seed), assessment.posterior
        shift = posterior.shift[:, rng.choice(len(posterior.weight), count, p=posterior.weight)]
        step = shift + posterior.factor @ rng.standard_normal((posterior.factor.shape[1], count))
        scaling = Scaling(self.case.parameters)
        return [scaling.away(self.values, column) for column in step.T]


def last_read(fit: Result | None) -> int:
    """Number of the last stage of which a fit has used a reading; -1 for none."""
    if fit is None:
        return -1
    return int(np.flatnonzero(fit.gauges.used.any(axis=0)).max(initial=-1))


@dataclass(frozen=True)
class Linearised:
    """The model linearised at one parameter vector.

    Args:
        outlooks: one for each time at which something is due.
        targets: numbers of what is wanted, of each outlook.
        mean: (t,) what is expected of all that is wanted, SI.
        size: (t,) factor from standard deviations in the outlooks to SI.
    """

    outlooks: tuple[Outlook, ...]
    targets: tuple[Ints, ...]
    mean: Floats
    size: Floats

    def of_wanted(self, variances: Sequence[Floats]) -> Floats:
        """Standard deviations (t,), SI, of all that is wanted, from variances of each outlook."""
        sd = np.full(len(self.size), np.nan)
        for targets, each in zip(self.targets, variances, strict=True):
            sd[targets] = np.sqrt(each)
        return sd * self.size


def linearised(
    planned: Plannable, p: Floats, survey: Survey, wanted: Sequence[Wanted], places: Ints
) -> Linearised:
    """The normal distribution of what is wanted and of readings to come.

    Args:
        planned: the case.
        p: (n,) where it is linearised, SI.
        survey: of the model there.
        wanted: t of them.
        places: (m, 2) channels and stages of all readings to come.

    Raises:
        ModelError: the model says nothing of some of them there.
    """
    assessment, errors = planned.known(survey)
    assessment = _centred(replace(assessment, dp_dx=Scaling(planned.case.parameters).dp_dx(p)))
    readings = [k for k, one in enumerate(wanted) if one.parameter is None]
    parameters = [k for k, one in enumerate(wanted) if one.parameter is not None]
    numbers = [one.parameter for one in wanted if one.parameter is not None]
    due = np.array([[wanted[k].row, wanted[k].stage] for k in readings], dtype=np.int64)
    every = np.concatenate([due.reshape(-1, 2), places])
    if not np.isfinite(survey.sensitivity[*every.T]).all():
        raise ModelError("some of the readings have no value")
    sd = accuracies(planned.case)[*every.T]
    joint = joint_readings(assessment, survey.sensitivity[*every.T], sd, every, errors)
    C = assessment.posterior.covariance[numbers]
    across = C @ joint.rows.T
    within = C[:, numbers]
    S = np.block([[within, across], [across.T, joint.covariance]])
    t, order = len(wanted), [*parameters, *readings]
    own = joint.own[len(readings) :]
    S[np.arange(t, len(S)), np.arange(t, len(S))] -= own
    mean = np.array([p[one.parameter] if one.parameter is not None else 0.0 for one in wanted])
    mean[readings] = survey.computed[*due.reshape(-1, 2).T]
    if errors is not None and readings:
        mean[readings] += errors.of(due, survey.sensitivity[*due.T]).shift
    size = np.ones(t)
    size[parameters] = assessment.dp_dx[numbers]
    outlooks, targets = [], []
    for stage in sorted({one.stage for one in wanted}):
        own_targets = [k for k in order if wanted[k].stage == stage]
        rows = np.flatnonzero(places[:, 1] < stage)
        kept = np.concatenate([[order.index(k) for k in own_targets], t + rows]).astype(np.int64)
        start = np.diag(S)[kept[: len(own_targets)]].copy()
        values = [one.value if (one := wanted[k].condition) else np.nan for k in own_targets]
        limit = (np.array(values) - mean[own_targets]) / np.sqrt(start)
        outlooks.append(Outlook(S[np.ix_(kept, kept)], own[rows], rows, start, limit, start))
        targets.append(np.array(own_targets, dtype=np.int64))
    return Linearised(tuple(outlooks), tuple(targets), mean, size)


def _centred(assessment: Assessment) -> Assessment:
    """With deviations of the parameters from their mean, not from the estimate."""
    posterior = assessment.posterior
    mean = posterior.shift @ posterior.weight
    return replace(assessment, posterior=replace(posterior, shift=posterior.shift - mean[:, None]))
