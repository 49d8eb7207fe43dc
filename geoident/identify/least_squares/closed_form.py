"""Closed form (theory 4.6): Gauss-Newton on formulas in place of a finite element model.

An evaluation costs next to nothing, so the search starts from many places. The formulas may answer
only some of the readings; the others take no part. Parameters that do not enter keep their values.

In a chain what is found is where the rest begins; where there is no closed form, the rest begins
where it would have without it, and a remark says why.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from geoident.errors import ModelError
from geoident.identify.least_squares.gauss_newton import gauss_newton
from geoident.identify.problem.methods import opening_obstacle
from geoident.identify.problem.outcome import OnIteration, Outcome
from geoident.identify.problem.problem import Problem
from geoident.identify.problem.responses import HasOpening, OpeningForm
from geoident.model.methods import ClosedFormOptions, GaussNewtonOptions


def closed_form(problem: Problem, options: ClosedFormOptions, on_iteration: OnIteration) -> Outcome:
    """Meets the readings by the closed form of an opening.

    Args:
        problem: readings, a model that may have a closed form, and parameters.
        options: the opening, starts, when to stop.
        on_iteration: is called with every evaluation; its reason to stop ends the search.

    Returns:
        The best point that was evaluated; its discrepancy counts the readings that the closed form
        answers. The start where there is no closed form or it has no solution there, with a remark.
    """
    obstacle = opening_obstacle(problem.response, options)
    if obstacle is not None:
        return _passed_over(problem, f"there is none, as {obstacle}")
    assert isinstance(problem.response, HasOpening)
    form = problem.response.opening(options.centre, options.radius)
    assert not isinstance(form, str)
    smaller = _covered(problem, form)
    search = GaussNewtonOptions(options.tolerance, options.max_iterations, options.starts)
    try:
        outcome = gauss_newton(smaller, search, on_iteration, method="closed-form")
    except ModelError as error:
        return _passed_over(problem, error.message)
    return replace(outcome, remarks=(*form.remarks(outcome.values), *_left_out(form)))


def _covered(problem: Problem, form: OpeningForm) -> Problem:
    """The problem of the readings that the closed form answers."""
    kept = form.covered
    return replace(
        problem,
        response=form,
        measured=problem.measured[kept],
        sd=problem.sd[kept],
        shared=None if problem.shared is None else problem.shared.only(kept),
    )


def _left_out(form: OpeningForm) -> list[str]:
    missing = np.count_nonzero(~form.covered)
    if not missing:
        return []
    return [f"the closed form does not give {missing} of {len(form.covered)} readings"]


def _passed_over(problem: Problem, reason: str) -> Outcome:
    """The start, with the reason why there is nothing better."""
    remark = f"the closed form was skipped: {reason}"
    text = f"The closed form was not possible: {reason}."
    return Outcome(problem.start, float("inf"), "not-converged", text, (), remarks=(remark,))
