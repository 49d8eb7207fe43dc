"""Yield limits by complementarity (theory 5): the strengths with which the ground meets readings.

Three formulations of one problem, each in a module that is imported when it runs:

    implicit     the stages are solved for every trial; a search over the strengths alone
    full-space   one nonlinear program in all unknowns, an independent check
    global       branch and bound with a proven bound, for small problems
"""

from __future__ import annotations

from collections.abc import Callable
from importlib import import_module
from typing import cast

from geoident.identify.problem.problem import Observer, Outcome, Problem
from geoident.model.methods import ComplementarityOptions

Formulation = Callable[[Problem, ComplementarityOptions, Observer], Outcome]

_FUNCTIONS = {"implicit": "implicit", "full-space": "full_space", "global": "global_bound"}


def complementarity(
    problem: Problem, options: ComplementarityOptions, observe: Observer
) -> Outcome:
    """Minimises the discrepancy of a model with yield limits, theory 5.

    Args:
        problem: readings, a `YieldSystem`, and parameters.
        options: formulation, restarts, tolerance, budget.
        observe: is told of every trial; its reason to stop ends the search.

    Returns:
        The best point that was evaluated, with its certificate.

    Raises:
        InputError: the formulation is not possible for this model.
        ModelError: no start has a solution.
    """
    name = _FUNCTIONS[options.formulation]
    function = getattr(import_module(f"geoident.identify.yield_limits.{name}"), name)
    return cast(Formulation, function)(problem, options, observe)
