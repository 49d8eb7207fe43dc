"""What a fit knows, from its result: the parameters, and the errors that later readings share."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from geoident.forward.observed import ObservedModel, Survey
from geoident.identify.assessment.diagnostics import effective_sd
from geoident.identify.assessment.uncertainty import Assessment
from geoident.identify.problem.problem import Problem
from geoident.model.case import Case
from geoident.model.results.result import Result
from geoident.workflow.estimating.accuracies import Possible
from geoident.workflow.estimating.another_case import pick_assessment
from geoident.workflow.estimating.diagnosis import assess_robustly, at_used
from geoident.workflow.estimating.estimate import over_accuracies
from geoident.workflow.estimating.model_error import LaterModelError
from geoident.workflow.estimating.predictions import KnownErrors
from geoident.workflow.estimating.setup import problem_of_result, setup_of_result, used_response
from geoident.workflow.running.readings import used_rows


@dataclass(frozen=True)
class KnownFromFit:
    """What is known of parameters and of errors of readings.

    Args:
        problem: the used readings.
        assessment: how well the parameters are known.
        errors: what used readings tell of those of later ones; None where all are independent.
    """

    problem: Problem
    assessment: Assessment
    errors: KnownErrors | None


def known_from_fit(
    fit: Result, origin: Case, model: ObservedModel, case: Case, survey: Survey, *,
    same: bool = True,
    others: bool = False,
) -> KnownFromFit:  # fmt: skip
    """What a fit knows, assessed again from the sensitivities that it holds.

    Of gauges that are others than those of the fit it knows no error, nor that of the model where
    they are.

    Args:
        fit: its result.
        origin: its case.
        model: of the case whose later readings are asked for.
        case: that case, maybe the same.
        survey: of the model at the parameters of the fit.
        same: it has the gauges of the fit.
        others: nothing that the fit knows of gauges is of its own.
    """
    p, readings = fit.parameters.values, fit.gauges.readings
    setup = setup_of_result(fit, origin, model)
    response = used_response(setup) if same else model.response(())
    problem = problem_of_result(fit, setup.case, response)
    computed, jacobian = at_used(readings)
    over = over_accuracies(setup, problem, p, computed, jacobian)
    order = np.array([fit.parameters.names.index(name) for name in model.names], dtype=np.int64)
    assessment = pick_assessment(assess_robustly(problem, p, computed, jacobian, over), order)
    error = setup.model_error
    if error is not None and others:
        error = error.of_nothing_used()
    if error is None and not any(c.errors for c in (*setup.case.channels, *case.channels)):
        return KnownFromFit(problem, assessment, None)
    errors = KnownErrors(
        case,
        replace(problem, sd=effective_sd(problem, computed)),
        computed,
        jacobian[:, order],
        used_rows(setup.case, readings.used),
        None if error is None else LaterModelError(error, case, model, survey.increments),
        Possible.of(fit.accuracies, readings.used),
    )
    return KnownFromFit(problem, assessment, errors.of_nothing_used() if others else errors)
