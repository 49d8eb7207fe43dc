"""What the gauges will show at stages that took no part in the fit, and how well that came true."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from geoident.errors import ModelError
from geoident.forward.observed import ObservedModel, Survey
from geoident.identify.assessment.diagnostics import effective_sd
from geoident.identify.assessment.later_readings import LaterReadings, given_used, later_covariance
from geoident.identify.assessment.linearity import IntervalEnds, interval_ends
from geoident.identify.assessment.prediction_bands import Band, predict_band
from geoident.identify.assessment.profile_path import (
    Nonlinearity,
    PathReadings,
    path_parameter,
    with_profile,
)
from geoident.identify.assessment.uncertainty import Assessment
from geoident.identify.problem.problem import Problem
from geoident.identify.problem.shared_errors import ErrorStructure
from geoident.model.arrays import Bools, Floats, Ints
from geoident.model.case import Case
from geoident.model.gauges import ReadingTable
from geoident.model.results.bands import Prediction
from geoident.model.results.findings import Finding
from geoident.model.results.result import GaugeTable
from geoident.model.results.sections import section_uses
from geoident.model.structures import Struts
from geoident.workflow.estimating.accuracies import Possible
from geoident.workflow.estimating.diagnosis import at_used
from geoident.workflow.estimating.model_error import LaterModelError
from geoident.workflow.running.cached_response import substituting
from geoident.workflow.running.computed import with_computed
from geoident.workflow.running.readings import ChannelReading, error_structure

Later = Ints | tuple[ChannelReading, ...]
"""Later readings: numbers (l, 2) of their channels and stages, or the readings themselves."""

_MOST_STAGES = 4
"""Predicted stages of which each has its sentence; of more there is one for all."""


def predicted_stages(gauges: GaugeTable) -> Bools:
    """(n_stages,) the stages of which no reading was used."""
    return np.asarray(~np.any(gauges.used, axis=0), dtype=np.bool_)


def predicted_places(gauges: GaugeTable, left_out: Bools) -> Bools:
    """(n_channels, n_stages) what a fit predicts: all that it has no reading of.

    These are stages that it did not use, gauges left out, and at fitted stages gauges that nobody
    has read there.

    Args:
        gauges: with the readings of the fit.
        left_out: (n_channels,) channels that it was told to leave out.
    """
    unread = ~gauges.used & np.isnan(gauges.measured)
    return np.asarray(predicted_stages(gauges)[None] | left_out[:, None] | unread)


def chosen_stages(gauges: GaugeTable, names: Sequence[str]) -> Bools:
    """(n_stages,) the stages of these names."""
    return np.array([stage in names for stage in gauges.stages], dtype=np.bool_)


def predict_stages(
    survey: Survey,
    assessment: Assessment,
    accuracy: Floats,
    places: Bools,
    known: KnownErrors | None = None,
    nonlinearity: Nonlinearity | None = None,
) -> Prediction:
    """Bands of computed readings.

    Args:
        survey: the model at the estimate; its readings are NaN where a channel cannot be read.
        assessment: how well the parameters are known.
        accuracy: (n_channels, n_stages) standard deviation of a reading, SI; NaN for no prediction.
        places: (n_channels, n_stages) those to predict, or (n_stages,) of all channels.
        known: what the used readings tell of errors that later ones share; None where all are
            independent.
        nonlinearity: how the readings of all channels and stages, row by row, deviate from linear
            where a bound truncates a parameter; None for not at all.
    """
    computed = survey.computed
    wanted = np.isfinite(computed) & np.isfinite(accuracy) & places
    curved = None if nonlinearity is None else nonlinearity.of(wanted.ravel())
    shift, band = band_of(
        assessment, survey.sensitivity[wanted], accuracy[wanted], np.argwhere(wanted), known, curved
    )
    mean = np.where(wanted, computed, np.nan)
    mean[wanted] += shift

    def placed(values: Floats) -> Floats:
        table = np.full(computed.shape, np.nan)
        table[wanted] = values
        return table

    return Prediction(
        mean, placed(band.sd), mean + placed(band.lower95), mean + placed(band.upper95)
    )


@dataclass(frozen=True)
class JointReadings:
    """Later readings together, as they are expected (theory 6.3, 7).

    Args:
        rows: (l, n) their derivatives by the scaled parameters, less what used readings tell of
            errors that they share, SI.
        covariance: (l, l) of the readings, own errors included, SI.
        own: (l,) variance of what each has by itself, SI.
    """

    rows: Floats
    covariance: Floats
    own: Floats


def joint_readings(
    assessment: Assessment,
    sensitivity: Floats,
    sd: Floats,
    later: Later,
    known: KnownErrors | None = None,
    curved: Nonlinearity | None = None,
) -> JointReadings:
    """Later readings together: what the parameters lack is common to all of them.

    So is what is left of errors that they share with used readings or with each other.

    Args:
        assessment: how well the parameters are known.
        sensitivity: (l, n) derivatives of what the model says of the readings, SI.
        sd: (l,) standard deviations of their own errors where these are independent, SI.
        later: the readings.
        known: what the used readings tell of shared errors; None where all are independent.
        curved: how they deviate from linear; None for not at all.
    """
    rows, own = sensitivity, sd**2
    left = np.diag(own)
    if known is not None and len(rows):
        rows = known.of(later, sensitivity).jacobian
        curved = None if curved is None else known.left_of(later, curved)
        problem, errors = known.with_later(later)
        left, own = later_covariance(problem, errors), errors.sd**2
    rows = rows * assessment.dp_dx
    deviation = None if curved is None else curved.at_draws
    return JointReadings(rows, assessment.posterior.products(rows, deviation) + left, own)


def band_of(
    assessment: Assessment,
    sensitivity: Floats,
    sd: Floats,
    later: Later,
    known: KnownErrors | None,
    curved: Nonlinearity | None = None,
) -> tuple[Floats, Band]:
    """What later readings differ from the model by (l,), SI, and their bands about that.

    Args:
        assessment: how well the parameters are known.
        sensitivity: (l, n) derivatives of what the model says of them, SI.
        sd: (l,) standard deviations of their errors, SI.
        later: the readings.
        known: what the used readings tell of their errors; None where all are independent.
        curved: how they deviate from linear; None for not at all.
    """
    if known is None:
        return np.zeros(len(sd)), predict_band(assessment, sensitivity, sd, curved)
    given = known.of(later, sensitivity)
    if curved is not None:
        curved = known.left_of(later, curved)
    wider = known.wider(later, sensitivity, assessment)
    return given.shift, predict_band(assessment, given.jacobian, given.sd, curved, wider)


def correlations(
    survey: Survey,
    assessment: Assessment,
    prediction: Prediction,
    places: Bools,
    known: KnownErrors | None = None,
    nonlinearity: Nonlinearity | None = None,
) -> Floats:
    """Of the errors of predictions, see `correlations_of`.

    Args:
        survey: the model at the estimate.
        assessment: how well the parameters are known.
        prediction: the bands.
        places: (n_channels, n_stages) the l predictions, all with a finite band.
        known: what the used readings tell of shared errors; None where all are independent.
        nonlinearity: how the readings of all channels and stages, row by row, deviate from linear;
            None for not at all.

    Returns:
        (l, l).
    """
    curved = None if nonlinearity is None else nonlinearity.of(places.ravel())
    sensitivity, sd = survey.sensitivity[places], prediction.sd[places]
    return correlations_of(assessment, sensitivity, sd, np.argwhere(places), known, curved)


def correlations_of(
    assessment: Assessment,
    sensitivity: Floats,
    sd: Floats,
    later: Later,
    known: KnownErrors | None = None,
    curved: Nonlinearity | None = None,
) -> Floats:
    """Of the errors of predictions.

    Args:
        assessment: how well the parameters are known.
        sensitivity: (l, n) derivatives of what the model says of the readings, SI.
        sd: (l,) standard deviations of their predictions, SI.
        later: the readings.
        known: what the used readings tell of shared errors; None where all are independent.
        curved: how they deviate from linear; None for not at all.

    Returns:
        (l, l).
    """
    exact = np.zeros_like(sd)  # independent errors stand in the diagonal alone
    joint = joint_readings(assessment, sensitivity, exact, later, known, curved).covariance
    sd = np.maximum(sd, np.sqrt(np.diag(joint)))
    matrix = joint / np.outer(sd, sd)
    np.fill_diagonal(matrix, 1.0)
    return np.asarray(matrix)


@dataclass(frozen=True)
class KnownErrors:
    """What the used readings tell of errors that later ones share with them (theory 7).

    Args:
        case: whose gauges are predicted.
        problem: the used readings, with their own standard deviations as the loss leaves them.
        computed: (g,) what the model says of them at the estimate, SI.
        jacobian: (g, n) its derivative, SI.
        rows: the g readings with their channels.
        model_error: that of the model in later readings; None for none.
        possible: accuracies that were estimated; None where they are given.
    """

    case: Case
    problem: Problem
    computed: Floats
    jacobian: Floats
    rows: tuple[ChannelReading, ...]
    model_error: LaterModelError | None = None
    possible: Possible | None = None

    def of_nothing_used(self) -> KnownErrors:
        """The same where no used reading has to do with the gauges that are predicted."""
        problem = self.problem
        nothing = replace(problem, measured=problem.measured[:0], sd=problem.sd[:0], shared=None)
        return replace(
            self,
            problem=nothing,
            computed=self.computed[:0],
            jacobian=self.jacobian[:0],
            rows=(),
            possible=None,
        )

    def of(self, later: Later, sensitivity: Floats) -> LaterReadings:
        """Later readings as the used ones let expect them.

        Args:
            later: the readings.
            sensitivity: (l, n) derivatives of what the model says of them, SI.
        """
        problem, errors = self.with_later(later)
        return given_used(
            problem, self.computed, self.jacobian, later=errors, later_jacobian=sensitivity
        )

    def left_of(self, later: Later, curved: Nonlinearity) -> Nonlinearity:
        """Deviations from linear less what the used readings, which deviate too, tell of them.

        Args:
            later: the readings.
            curved: of these, along a path.
        """
        if not self.rows:
            return curved
        problem, errors = self.with_later(later)
        used, at_later = curved.used_deviation.T, curved.deviation.T
        left = given_used(problem, self.computed, used, later=errors, later_jacobian=at_later)
        return replace(curved, deviation=left.jacobian.T)

    def with_later(self, later: Later) -> tuple[Problem, ErrorStructure]:
        """The used readings and the errors of later ones, with the same columns for what is shared.

        Args:
            later: the readings.
        """
        used, errors = self._structures(later)
        return replace(self.problem, shared=used.stated[1]), errors

    def wider(
        self, later: Later, sensitivity: Floats, assessment: Assessment
    ) -> tuple[Floats, Floats] | None:
        """How much farther out the ends of bands are as accuracies were estimated.

        Args:
            later: the readings.
            sensitivity: (l, n) derivatives of what the model says of them, SI.
            assessment: how well the parameters are known.

        Returns:
            Factors (l,), (l,) on the lower and the upper end; None where accuracies are given.
        """
        over = assessment.over
        if over is None:
            return None
        if self.possible is None:  # gauges of another section, as accurate as they state
            given = self.of(later, sensitivity)
            each = np.broadcast_to(given.sd, (len(over.shift), len(given.sd)))
            return over.wider(given.jacobian * assessment.dp_dx, sd=each)
        used, errors = self._structures(later)
        points = self.possible.padded(used)
        problems = [
            given_used(
                problem,
                self.computed,
                self.jacobian,
                later=errors.sized(t),
                later_jacobian=sensitivity,
            )
            for problem, t in zip(
                self.possible.problems(replace(self.problem, shared=used.stated[1]), used),
                [np.zeros(points.shape[1]), *points],
                strict=True,
            )
        ]
        return over.wider(
            np.array([each.jacobian * assessment.dp_dx for each in problems]),
            np.array([each.shift for each in problems]),
            np.array([each.sd for each in problems]),
        )

    def at_possible(self, number: int, later: Later) -> tuple[Problem, ErrorStructure]:
        """`with_later` at one of the accuracies that are possible.

        Args:
            number: of these, from 0.
            later: the readings.
        """
        assert self.possible is not None
        used, errors = self._structures(later)
        t = self.possible.padded(used)[number]
        sd, shared = used.at(t)
        return replace(self.problem, sd=sd, shared=shared), errors.sized(t)

    def _structures(self, later: Later) -> tuple[ErrorStructure, ErrorStructure]:
        """The errors of the used and of later readings, with the same columns."""
        case = self.case
        if not isinstance(later, tuple):
            later = tuple(
                (case.channels[i], case.reading_at(case.channels[i], case.stages[j].name))
                for i, j in later.tolist()
            )
        rows = [*self.rows, *later]
        whole = error_structure(rows) if self.possible is None else self.possible.structure(rows)
        if self.model_error is not None:
            pairs = [(reading.channel, reading.stage) for _, reading in later]
            whole = self.model_error.added(whole, pairs)
        g = len(self.rows)
        return whole.rows(np.arange(g)), whole.rows(np.arange(g, g + len(later)))


def score(gauges: GaugeTable, prediction: Prediction, left_out: Bools) -> tuple[str, ...]:
    """How well predictions came true: a sentence for each stage that was read, of many one for all.

    Args:
        gauges: what was read.
        prediction: of all that is predicted.
        left_out: (n_channels,) channels that the fit left out; they have scores of their own.
    """
    sentences, parts = [], list[tuple[str, int, int]]()
    total = 0.0
    measured = np.where(gauges.bad, np.nan, gauges.measured)  # without those known to be wrong
    within = (measured >= prediction.lower95) & (measured <= prediction.upper95)
    for column, stage in enumerate(gauges.stages):
        error = measured[:, column] - prediction.mean[:, column]
        sd = prediction.sd[:, column]
        read = np.isfinite(error) & np.isfinite(sd) & ~left_out
        if np.any(read):
            inside = within[read, column]
            squares = float(np.sum((error[read] / sd[read]) ** 2))
            rms, total = float(np.sqrt(squares / inside.size)), total + squares
            parts.append((stage, int(np.count_nonzero(inside)), inside.size))
            sentences.append(
                f"Predicted stage {stage!r}: {np.count_nonzero(inside)} of {inside.size} readings"
                f" inside the 95 % band ({100 * np.mean(inside):.0f} %),"
                f" RMS of the standardized residuals {rms:.2f}."
            )
    if len(sentences) <= _MOST_STAGES:
        return tuple(sentences)
    held, count = sum(part[1] for part in parts), sum(part[2] for part in parts)
    worst = min(parts, key=lambda part: part[1] / part[2])
    return (
        f"Predicted stages: {len(parts)} were read, {held} of {count} readings inside the 95 % band"
        f" ({100 * held / count:.0f} %), RMS of the standardized residuals"
        f" {np.sqrt(total / count):.2f}; fewest at {worst[0]!r}, {worst[1]} of {worst[2]}.",
    )


def collapse_findings(survey: Survey) -> tuple[Finding, ...]:
    """One for every stage that the ground does not survive at the estimate."""
    return tuple(
        Finding(
            "collapse", stage, f"With these parameters, {text}. Nothing is predicted from there on."
        )
        for text, stage in survey.collapses.items()
    )


def strength_findings(survey: Survey) -> tuple[Finding, ...]:
    """One for every lining or shell whose section does not bear N and M at the estimate."""
    uses = section_uses(survey.members, survey.shells)
    beyond = [use for use in uses if (use.most > 1.0).any()]
    findings = []
    for name in dict.fromkeys(use.structure for use in beyond):
        own = [use for use in beyond if use.structure == name]
        shares: list[str] = []
        for use in own:
            part = float(np.fmax.reduce(use.most))
            share = f"{100.0 * part:.0f} % of it" if np.isfinite(part) else "more than any part"
            if not any(one.startswith(share) for one in shares):  # mostly an axis is the worst
                shares.append(f"{share} {use.direction}".strip())
        most = np.fmax.reduce([use.most for use in own])
        largest = float(np.fmax.reduce(most))
        stages = [own[0].stages[j] for j in np.flatnonzero(most > 1.0)]
        findings.append(
            Finding(
                "strength",
                name,
                f"The strength of {name} is exceeded: N and M need {', '.join(shares)} "
                f"(stage{'s' * (len(stages) > 1)} {', '.join(stages)}). The analysis takes it "
                "as elastic.",
                {"utilisation": largest} if np.isfinite(largest) else {},
            )
        )
    return tuple(findings)


_PULL = 1e-3
"""Part of the largest force of a strut below which a pull is rounding, or none that matters."""


def pull_findings(case: Case, survey: Survey) -> tuple[Finding, ...]:
    """One for every structure of struts that pull, as struts that are wedged in do not."""
    findings = []
    for name, struts in case.structures.items():
        if not isinstance(struts, Struts) or struts.compression_only or survey.members is None:
            continue
        own = [n for n, one in enumerate(survey.members.structures) if one == name]
        forces = np.nan_to_num(survey.members.axial[own])
        most = forces.max(axis=0)
        pulls = np.flatnonzero(most > _PULL * np.abs(forces).max())
        if len(pulls):
            stages = ", ".join(survey.members.stages[j] for j in pulls)
            findings.append(
                Finding(
                    "pull",
                    name,
                    f"{name} pulls, with up to {most.max() / 1e3:.3g} kN (stage"
                    f"{'s' * (len(pulls) > 1)} {stages}). Struts that are wedged in do not: give "
                    "them 'compression_only: true'.",
                    {"force": float(most.max())},
                )
            )
    return tuple(findings)


# Where the model is not linear over what the readings leave possible (theory 6.3, 6.7)

ENOUGH = 1e-4
"""Estimate of the relative error in energy with which the reduced model tells whether the model is
linear over an interval, where the misfit must rise by 3.8 within a fifth."""


def _path_readings(survey: Survey, readings: ReadingTable) -> PathReadings:
    """What a survey says of the used readings and of all channels and stages."""
    rows = survey.sensitivity.reshape(survey.computed.size, -1)
    return PathReadings(*at_used(readings), survey.computed.ravel(), rows)


def follow_model(
    model: ObservedModel,
    case: Case,
    problem: Problem,
    values: Floats,
    survey: Survey,
    readings: ReadingTable,
    assessment: Assessment,
    *,
    converged: bool,
) -> tuple[Assessment, Nonlinearity | None]:
    """The assessment and the readings along the parameter over which the model is least linear.

    That is one that its bounds limit (`path_parameter`), or the least known one where the misfit at
    the ends of its interval is not that of a linear model. Costs nothing where all is known well
    and no bound is near, and one or two evaluations where the model is linear.

    Args:
        model: of the case.
        case: the case.
        problem: the used readings, with the accuracies as stated or estimated.
        values: (n,) the estimate, SI.
        survey: the model there.
        readings: with what the model says of each there.
        assessment: of the linearised model.
        converged: the search ended at the estimate; ends of intervals are asked for no other.
    """

    def evaluate(p: Floats) -> PathReadings | None:
        try:
            if model.admissible(p) is not None:
                return None
            surveyed = model.survey(p, fields=False, partial=True)
        except ModelError:
            return None
        return _path_readings(surveyed, with_computed(readings, case, model, surveyed, p))

    def evaluate_used(p: Floats) -> PathReadings | None:
        """The same without the stages that no used reading needs."""
        try:
            if model.admissible(p) is not None:
                return None
            v, jacobian = problem.response.evaluate(p)
        except ModelError:
            return None
        return PathReadings(v, jacobian, v, jacobian)

    weighted = replace(problem, sd=effective_sd(problem, readings.computed[readings.used]))
    at_estimate = _path_readings(survey, readings)
    if path_parameter(assessment, weighted) is not None:
        return with_profile(
            assessment, weighted, values, at_estimate, evaluate, of_used=evaluate_used
        )
    ends = None
    if converged:
        with substituting(problem.response, ENOUGH):
            ends = interval_ends(problem, assessment, values)
    if ends is None or not ends.doubtful:
        return assessment, None
    i = ends.parameter
    known, curved = with_profile(
        assessment, weighted, values, at_estimate, evaluate, i, of_used=evaluate_used
    )
    if curved is None:  # it has no solution beside the estimate
        name = problem.parameters[i].name
        known = replace(known, findings=(*known.findings, nonlinear_finding(ends, name)))
    return known, curved


def nonlinear_finding(ends: IntervalEnds, name: str) -> Finding:
    """The finding that a model is not linear over an interval, where it could not be followed.

    Args:
        ends: rise of the misfit at the ends of the interval.
        name: of the parameter.
    """
    at_ends = " and ".join(
        f"at its {end} end the misfit rises by {rise:.3g} instead of 3.8"
        if math.isfinite(rise)
        else f"at its {end} end the model has no solution"
        for end, rise in (("lower", ends.below), ("upper", ends.above))
    )
    if not math.isfinite(min(ends.below, ends.above)):
        at_ends = "at both of its ends the model has no solution"
    sentence = (
        f"The model is not linear over the interval of {name}: {at_ends}. So intervals and bands "
        "may contain less or more than 95 %. `geoident sample` draws from the posterior itself."
    )
    numbers = {"rise_below": ends.below, "rise_above": ends.above}
    return Finding("nonlinear", name, sentence, numbers)
