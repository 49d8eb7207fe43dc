"""What a search ends with: the model there, how well all is known, what is said of readings."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from geoident.errors import TimeIsUp
from geoident.forward.observed import Survey
from geoident.identify.assessment.diagnostics import effective_sd
from geoident.identify.assessment.profile_path import Nonlinearity
from geoident.identify.assessment.uncertainty import Assessment
from geoident.identify.assessment.unknown_variances import OverAccuracies
from geoident.identify.problem.outcome import Outcome
from geoident.identify.problem.problem import Discrepancy, Problem
from geoident.model.arrays import Bools, Floats
from geoident.model.case import Case
from geoident.model.gauges import ReadingTable
from geoident.model.results.bands import Prediction
from geoident.model.results.costs import Counts
from geoident.model.results.result import Diagnostics, Result
from geoident.model.results.rivals import Evidence, Rivals
from geoident.workflow.estimating.accuracies import Possible
from geoident.workflow.estimating.diagnosis import assess_robustly, at_used, diagnostics_table
from geoident.workflow.estimating.finished import Finished, run_job
from geoident.workflow.estimating.model_error import LaterModelError
from geoident.workflow.estimating.predictions import KnownErrors, follow_model, predict_stages
from geoident.workflow.estimating.rivals import mixed_prediction, weighed_minima
from geoident.workflow.estimating.search import estimated
from geoident.workflow.estimating.setup import Setup, prepare
from geoident.workflow.running.cached_response import substituting
from geoident.workflow.running.computed import accuracies, survey_of_used, with_computed
from geoident.workflow.running.control import Control
from geoident.workflow.running.evaluation_log import Log
from geoident.workflow.running.jobs import Job
from geoident.workflow.running.readings import unused_by_stage, used_rows


def surveyed(
    setup: Setup, problem: Problem, outcome: Outcome, *, fields: bool, last: int | None = None
) -> tuple[Survey, ReadingTable, Counts]:
    """The model at the end of a search, what it says of each reading, and what both have cost.

    Args:
        setup: model and readings.
        problem: of the search.
        outcome: of the search.
        fields: whether displacements and stresses are wanted.
        last: index of the last state wanted; None for all.
    """
    model, p = setup.model, outcome.values
    before = model.counts
    try:
        survey = model.survey(p, fields=fields, partial=True, last=last)
    except TimeIsUp:
        with substituting(problem.response):
            survey = survey_of_used(setup.readings, setup.case, model, problem, p)
    counts = problem.response.counts.joined(model.counts.since(before))
    return survey, with_computed(setup.readings, setup.case, model, survey, p), counts


def details_of(source: Survey | Result, case: Case) -> dict[str, Any]:
    """What only some models know, and a result has: fields, forces in structures and others.

    Of a case of tests nothing: places in a specimen of unit size tell nothing.
    """
    names = (
        "fields", "members", "shells", "interfaces", "reactions", "yielded", "mechanism",
        "reaction", "advance",
    )  # fmt: skip
    return {} if case.of_tests else {name: getattr(source, name) for name in names}


@dataclass(frozen=True)
class Estimate:
    """What a search found, and what the model says there.

    Args:
        outcome: of the identifiers.
        assessment: how well the parameters are known.
        readings: with what the model says of each.
        diagnostics: the influence of each of them on the parameters.
        survey: the model at the parameters.
        counts: of all.
        errors: what the used readings tell of those that later ones share; None where none do.
        nonlinearity: how readings deviate from linear where a bound truncates a parameter, or None.
        rivals: other minima, with the lowest; None where there are none.
        others: what is known at the rivals, in their order without the first.
        evidence: of the model, None where the search did not converge.
    """

    outcome: Outcome
    assessment: Assessment
    readings: ReadingTable
    diagnostics: Diagnostics
    survey: Survey
    counts: Counts
    errors: KnownErrors | None = None
    nonlinearity: Nonlinearity | None = None
    rivals: Rivals | None = None
    others: tuple[Estimate, ...] = ()
    evidence: Evidence | None = None


def assess_fit(
    setup: Setup, problem: Problem, outcome: Outcome, *, fields: bool, last: int | None = None
) -> Estimate:
    """One survey of the model at the end of a search says everything else.

    Args:
        setup: model and readings, as `estimated` gives them.
        problem: likewise.
        outcome: likewise.
        fields: whether displacements and stresses are wanted.
        last: index of the last state wanted; None for all.
    """
    survey, readings, counts = surveyed(setup, problem, outcome, fields=fields, last=last)
    counts = counts + setup.spent
    computed, jacobian = at_used(readings)
    outcome = as_computed(problem, outcome, computed)
    over = over_accuracies(setup, problem, outcome.values, computed, jacobian)
    assessment = assess_robustly(problem, outcome.values, computed, jacobian, over)
    diagnostics = diagnostics_table(problem, readings, outcome.values, assessment)
    before = setup.model.counts
    assessment, nonlinearity = follow_model(
        setup.model, setup.case, problem, outcome.values, survey, readings, assessment,
        converged=outcome.status == "converged",
    )  # fmt: skip
    counts = counts.joined(setup.model.counts.since(before))
    left = replace(problem, sd=effective_sd(problem, computed))
    known = known_errors(setup, left, survey, computed, jacobian)
    estimate = Estimate(
        outcome, assessment, readings, diagnostics, survey, counts, known, nonlinearity
    )
    rivals, evidence = weighed_minima(problem, outcome, computed, jacobian)
    weighed = None if setup.model_error is None else setup.model_error.weighed
    if evidence is not None and weighed is not None:
        over_sizes = evidence.log_evidence + weighed.log_gain
        evidence = replace(evidence, log_evidence=over_sizes)
    if rivals is None:
        return replace(estimate, evidence=evidence)
    places = zip(rivals.values[1:], rivals.objectives[1:], strict=True)
    elsewhere = [
        replace(outcome, values=p, objective=float(phi), minima=(), certificate=None)
        for p, phi in places
    ]
    others = tuple(assess_fit(setup, problem, other, fields=False) for other in elsewhere)
    for other in others:  # each counts the search, too
        counts = counts.joined(other.counts.since(problem.response.counts + setup.spent))
    return replace(estimate, rivals=rivals, others=others, evidence=evidence, counts=counts)


def as_computed(problem: Problem, outcome: Outcome, computed: Floats) -> Outcome:
    """The outcome of a search with the misfit of the readings that stand in the result.

    A model that gives other readings at the end than while it was searched, as ground that flows
    may whose stages have several solutions, has not met what the search has met.

    Args:
        problem: of the search.
        outcome: of it.
        computed: (g,) what the model says of the used readings at the end, SI.
    """
    phi = Discrepancy(problem).objective_of(outcome.values, computed)
    noticed = max(_SAME_MISFIT, _SAME_PART * outcome.objective)
    if not np.isfinite(phi) or abs(phi - outcome.objective) <= noticed:
        return outcome
    reason = (
        f"At these parameters the model gave a misfit of {outcome.objective:.3g} while they were "
        f"searched and {phi:.3g} at the end, for which the table of readings stands: it does not "
        "always give the same. Fit again from these values, in stages that release less at once."
    )
    return replace(outcome, objective=phi, status="not-converged", reason=reason, certificate=None)


_SAME_MISFIT, _SAME_PART = 0.1, 0.01
"""Difference of misfits that no interval notices, and as a part of the misfit: noise of a model."""


def known_errors(
    setup: Setup, problem: Problem, survey: Survey, computed: Floats, jacobian: Floats
) -> KnownErrors | None:
    """What the used readings tell of the errors of later ones; None where none have to do with it.

    Args:
        setup: model and readings.
        problem: the used readings, with their own standard deviations as the loss leaves them.
        survey: the model at the estimate.
        computed: (g,) what it says of the used readings, SI.
        jacobian: (g, n) its derivative, SI.
    """
    case, model_error = setup.case, setup.model_error
    if model_error is None and not any(channel.errors for channel in case.channels):
        return None
    rows = used_rows(case, setup.readings.used)
    later = None
    if model_error is not None:
        later = LaterModelError(model_error, case, setup.model, survey.increments)
    possible = Possible.of(setup.accuracies, setup.readings.used)
    return KnownErrors(case, problem, computed, jacobian, rows, later, possible)


def possible_problems(setup: Setup, problem: Problem) -> list[Problem]:
    """The used readings at the estimated accuracies, then at all that the residuals leave possible.

    Args:
        setup: model and readings, with what was estimated.
        problem: the used readings with the estimated accuracies.

    Returns:
        1 + K problems; none where the accuracies are given.
    """
    possible = Possible.of(setup.accuracies, setup.readings.used)
    if possible is None:
        return []
    structure = possible.structure(used_rows(setup.case, setup.readings.used))
    if setup.model_error is not None:
        structure = setup.model_error.with_later(structure)
    return possible.problems(problem, structure)


def over_accuracies(
    setup: Setup, problem: Problem, p: Floats, computed: Floats, jacobian: Floats
) -> OverAccuracies | None:
    """What is known at all accuracies that the residuals leave possible; None for given ones.

    Args:
        setup: model and readings, with what was estimated.
        problem: the used readings.
        p: (n,) the estimate, SI.
        computed: (g,) what the model says of them there, SI.
        jacobian: (g, n) its derivative, SI.
    """
    problems = possible_problems(setup, problem)
    if not problems:
        return None
    assert setup.accuracies is not None
    return OverAccuracies.of(problems, setup.accuracies.odds, p, computed, jacobian)


def predicted(setup: Setup, estimate: Estimate, places: Bools) -> Prediction:
    """Bands of some readings, from an estimate and its rivals.

    Args:
        setup: model and readings.
        estimate: the estimate.
        places: (n_channels, n_stages) which, or (n_stages,) of all channels.
    """
    sd = accuracies(setup.case)
    first = predict_stages(
        estimate.survey, estimate.assessment, sd, places, estimate.errors, estimate.nonlinearity
    )
    if estimate.rivals is None:
        return first
    others = [predicted(setup, other, places) for other in estimate.others]
    return mixed_prediction(estimate.rivals.odds, [first, *others])


def searched(
    job: Job, control: Control, result: Callable[[Setup, Problem, Outcome, Log], Result]
) -> Finished:
    """Runs the search of a command and writes its result; keeps one that is up to date.

    Args:
        job: what to do.
        control: progress, budget and stops.
        result: what is written of the case, its problem and the outcome of the search; it may
            evaluate more, and log that.

    Raises:
        Interrupted: a stop was asked for; a checkpoint is there.
    """

    def prepared(job: Job) -> Setup:
        setup = prepare(job)
        control.monitor.detail(f"{np.count_nonzero(setup.readings.used)} readings are used")
        for unused in unused_by_stage(setup.readings):
            control.monitor.detail(f"not used: {unused}")
        return setup

    def of_search(setup: Setup, log: Log) -> Result:
        start = None
        if job.earlier is not None:
            values = [job.earlier.values[parameter.name] for parameter in setup.case.parameters]
            start = np.array(values, dtype=np.float64)
        near = job.earlier is not None and job.earlier.ended
        search_end = estimated(setup, job.methods, log, control, start=start, near=near)
        control.finish()
        return result(*search_end, log)

    return run_job(job, control, prepared, of_search)
