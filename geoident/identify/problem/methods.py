"""The table of identifiers, and chains of them.

`METHODS` maps the names that users write to the methods. A method is imported when it runs, so the
table costs nothing at start-up. In a chain each method starts where the one before ended: a scan
finds where to begin, condensation comes near at once, Gauss-Newton gives the exact minimum.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from importlib import import_module
from importlib.util import find_spec
from typing import cast

from geoident.errors import Fault, InputError
from geoident.identify.problem.outcome import OnIteration, Outcome
from geoident.identify.problem.problem import Problem
from geoident.identify.problem.responses import (
    AffineElastic,
    ComplementaritySystem,
    HasOpening,
    YieldSystem,
)
from geoident.model.methods import (
    METHOD_OPTIONS,
    ClosedFormOptions,
    ComplementarityOptions,
    CondensationOptions,
    EnsembleSmootherOptions,
    GaussNewtonOptions,
    LossOptions,
    MethodOptions,
    SquaredOptions,
    loss_name,
    method_name,
)
from geoident.model.response import Response
from geoident.model.results.result import STOPPED

Identifier = Callable[[Problem, MethodOptions, OnIteration], Outcome]

SQUARED = SquaredOptions()

FORMULATIONS = {"implicit": "implicit", "full-space": "full_space", "global": "global_bound"}
"""Formulation of the search for yield limits (theory 5) to its module and function.

    implicit     the stages are solved for every trial; a search over the strengths alone
    full-space   one nonlinear program in all unknowns, an independent check
    global       branch and bound with a proven bound, for small problems
"""

FORMULATION_PACKAGES = {"full-space": "casadi", "global": "pyscipopt"}
"""What the formulations need beside the model's equations."""


@dataclass(frozen=True)
class Method:
    """One identifier.

    Args:
        name: as users write it.
        folder: of `geoident.identify` with the module of the function that runs it, which is
            imported when it runs.
        options: type of its options.
    """

    name: str
    folder: str
    options: type[MethodOptions]

    def function(self, options: MethodOptions) -> Identifier:
        """The function that runs it with some options: (problem, options, on_iteration) -> Outcome.

        Module and function are named as the method: ``gauss-newton`` is run by `gauss_newton` in
        ``least_squares/gauss_newton.py``.
        """
        word = self.name.replace("-", "_")
        if isinstance(options, ComplementarityOptions):
            word = FORMULATIONS[options.formulation]
        module = import_module(f"geoident.identify.{self.folder}.{word}")
        return cast(Identifier, getattr(module, word))


_FOLDERS = {
    "gauss-newton": "least_squares",
    "condensation": "least_squares",
    "simplex": "direct",
    "scan": "direct",
    "closed-form": "least_squares",
    "complementarity": "yield_limits",
    "ensemble-smoother": "direct",
}

METHODS: Mapping[str, Method] = {
    name: Method(name, folder, METHOD_OPTIONS[name]) for name, folder in _FOLDERS.items()
}


def refusals(
    response: Response, methods: Sequence[MethodOptions], loss: LossOptions = SQUARED
) -> list[str]:
    """Why the methods of a chain cannot work on a model, sentences; none if they can.

    A closed form in a chain is only where the rest begins: it is passed over where there is none.

    Args:
        response: the model.
        methods: options of the methods, in their order.
        loss: of the readings.
    """
    if len(methods) > 1:
        methods = [options for options in methods if not isinstance(options, ClosedFormOptions)]
    reasons = [refusal(response, method_name(o), loss, o) for o in methods]
    return [reason for reason in reasons if reason is not None]


def refusal(
    response: Response, name: str, loss: LossOptions = SQUARED, options: MethodOptions | None = None
) -> str | None:
    """Why a method cannot work on a model and which would do, a sentence, or None if it can.

    Args:
        response: the model.
        name: of the method, as users write it.
        loss: of the readings.
        options: of the method; None for its default ones.
    """
    chosen = METHODS[name].options() if options is None else options
    why = _obstacle(response, chosen, loss)
    if why is None:
        return None
    possible = [
        other
        for other, method in METHODS.items()
        if _obstacle(response, method.options(), loss) is None
    ]
    able = [other for other in possible if other != name]
    if name in possible:
        able.append(f"{name} in its default formulation")
    return f"The method {name} is not possible here: {why}. Possible are {', '.join(able)}."


def _obstacle(response: Response, options: MethodOptions, loss: LossOptions) -> str | None:
    """Why a method cannot work on a model, a clause; None if it can."""
    squared = isinstance(loss, SquaredOptions)
    match options:
        case CondensationOptions():
            if not squared:
                reason = f"the loss is {loss_name(loss)}"
                return f"its linear least squares need the squared loss, and {reason}"
            if not isinstance(response, AffineElastic):
                return "the model does not offer its equations"
            return response.obstacle()
        case ComplementarityOptions(formulation=formulation):
            if not isinstance(response, YieldSystem):
                return "the model does not offer its equations"
            if not response.yields():
                return "no material of the model has yield limits"
            return formulation_obstacle(response, formulation)
        case ClosedFormOptions():
            return opening_obstacle(response, options)
        case EnsembleSmootherOptions():
            if not squared:
                reason = f"the loss is {loss_name(loss)}"
                return f"its updates are those of the squared loss, and {reason}"
            if find_spec("iterative_ensemble_smoother") is None:
                needed = 'pip install "geoident[ensemble]"'
                return f"it needs iterative_ensemble_smoother ({needed})"
    return None


def formulation_obstacle(response: Response, formulation: str) -> str | None:
    """Why a formulation is not possible for a model, a clause, or None if it is."""
    package = FORMULATION_PACKAGES.get(formulation)
    if package is None:
        return None
    if not isinstance(response, ComplementaritySystem):
        return f"the formulation {formulation} needs equations that the model does not show"
    if find_spec(package) is None:
        return (
            f'the formulation {formulation} needs {package} (pip install "geoident[{formulation}]")'
        )
    why = response.system_obstacle()
    return None if why is None else f"for the formulation {formulation}, {why}"


def opening_obstacle(response: Response, options: ClosedFormOptions) -> str | None:
    """Why a model has no closed form, a clause, or None if it has one."""
    if not isinstance(response, HasOpening):
        return "the model is not a circular opening"
    opening = response.opening(options.centre, options.radius)
    if isinstance(opening, str):
        return opening
    if len(opening.covered) and not opening.covered.any():
        return "no reading is of a stage and a point that the closed form covers"
    return None


def identify(
    problem: Problem, methods: Sequence[MethodOptions], on_iteration: OnIteration
) -> Outcome:
    """Runs a chain of methods, each from where the one before ended.

    Args:
        problem: readings, model and parameters with the first start.
        methods: options of the methods, in their order, at least one.
        on_iteration: is called with every iteration; its reason to stop ends the chain.

    Returns:
        The outcome of the last method with the histories of all, and the last grid of a scan.
        Where `on_iteration` stopped the chain, the best point so far.

    Raises:
        InputError: a method of the chain needs what the model cannot offer; nothing was computed.
        ModelError: the model has no solution at the start.
    """
    reasons = refusals(problem.response, methods, problem.loss)
    if reasons:
        raise InputError([Fault("method-not-possible", reason) for reason in reasons])
    done: list[Outcome] = []
    for options in methods:
        outcome = METHODS[method_name(options)].function(options)(problem, options, on_iteration)
        done.append(outcome)
        if outcome.status == STOPPED:
            break
        problem = problem.begun_at(outcome.values)
    last = done[-1]
    best = min(done, key=lambda outcome: outcome.objective) if last.status == STOPPED else last
    return replace(
        last,
        values=best.values,
        objective=best.objective,
        iterations=tuple(entry for outcome in done for entry in outcome.iterations),
        remarks=tuple(remark for outcome in done for remark in outcome.remarks),
        grid=next((outcome.grid for outcome in reversed(done) if outcome.grid is not None), None),
    )


def descend(problem: Problem, options: MethodOptions, on_iteration: OnIteration) -> Outcome:
    """One descent from the start of a problem that differs little from one that was solved.

    Whatever method solved it, its solution is near: yield limits go down without scan and restarts,
    a closed form by its formulas, all else by Gauss-Newton steps.

    Args:
        problem: readings, model, and parameters that start at that solution.
        options: of the method that found it.
        on_iteration: is called with every iteration; its reason to stop ends the descent.

    Raises:
        ModelError: the model has no solution at the start.
    """
    if isinstance(options, ComplementarityOptions):
        limits = import_module("geoident.identify.yield_limits.implicit")
        return cast(Identifier, limits.descend)(problem, options, on_iteration)
    if isinstance(options, ClosedFormOptions):
        return identify(problem, [replace(options, starts=1)], on_iteration)
    steps = options if isinstance(options, GaussNewtonOptions) else GaussNewtonOptions()
    return identify(problem, [replace(steps, starts=1)], on_iteration)


def continued(methods: Sequence[MethodOptions]) -> tuple[MethodOptions, ...]:
    """The method that goes on from where a chain ended, with changed weights: from one start."""
    last = methods[-1]
    return (replace(last, starts=1) if isinstance(last, GaussNewtonOptions) else last,)
