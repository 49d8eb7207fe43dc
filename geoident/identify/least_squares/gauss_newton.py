"""Gauss-Newton in a trust region, with bounds (theory 4.2).

With the weighted residuals r and their Jacobian J in the scaled parameters x (see `discrepancy`),
each iteration minimises the linearised discrepancy

    m(d) = |r + J d|^2    over    lower <= x + d <= upper  and  d in the trust region

exactly (see `trust_region`). The trust region is a box too: no parameter changes by more than a
factor exp(radius) in one step. So bounds need no special treatment: a step ends on a bound, and
leaves it, as the Kuhn-Tucker conditions of m ask. A direction that J does not see has no part in
the step: a parameter without information stays where it started.

Which trials are kept, and the next radius, is decided in `acceptance`; the loop and its ends are in
`descent`.
"""

from __future__ import annotations

import numpy as np

from geoident.identify.least_squares.acceptance import FIRST_RADIUS, Iterate, Step
from geoident.identify.least_squares.descent import (
    Descent,
    Ending,
    Stopping,
    halton_starts,
    plain_evaluator,
)
from geoident.identify.least_squares.trust_region import TrustBox, bounded_least_squares
from geoident.identify.objective.discrepancy import Discrepancy
from geoident.identify.problem.problem import History, Observer, Outcome, Problem
from geoident.model.arrays import Bools
from geoident.model.methods import GaussNewtonOptions


def gauss_newton(
    problem: Problem,
    options: GaussNewtonOptions,
    observe: Observer,
    *,
    method: str = "gauss-newton",
) -> Outcome:
    """Minimises the discrepancy with its exact Jacobian, theory [20] and 4.2.

    Descents begin at the given start, which must have a solution, and at others that are even over
    the bounds.

    Args:
        problem: readings, model and parameters.
        options: tolerance, steps, starts.
        observe: is told of every trial; its reason to stop ends the search.
        method: its name in the history.

    Returns:
        The best point that was evaluated.

    Raises:
        ModelError: the model has no solution at the start.
    """
    history = History(method, problem.response, observe)
    descent = gauss_newton_descent(Discrepancy(problem), options, history)
    evaluator = descent.evaluator
    point = evaluator.evaluate(evaluator.scaling.start)
    evaluator.record(point.x, point, 0.0, "start")
    best = descent.run(point)
    for number, x in enumerate(halton_starts(evaluator.scaling, options.starts - 1), start=2):
        if history.stop is not None:
            break
        further = evaluator.start(x, f"start {number}")
        if further is not None:
            best = min(best, descent.run(further), key=_phi)
    return history.outcome(best.point.p, best.point.phi, best.status, best.reason)


def gauss_newton_descent(
    discrepancy: Discrepancy, options: GaussNewtonOptions, history: History
) -> Descent[Iterate]:
    """A plain descent.

    Args:
        discrepancy: what is to be lowered.
        options: tolerance and steps.
        history: is told of every trial; its reason to stop ends the descent.
    """
    evaluator = plain_evaluator(discrepancy, history)
    box = evaluator.box
    return Descent(
        evaluator,
        lambda point, radius: gauss_newton_step(box, point, radius),
        Stopping(box, options.tolerance),
        options.max_iterations,
    )


def gauss_newton_step(box: TrustBox, point: Iterate, radius: float) -> Step:
    """The best step of the linearised problem.

    Args:
        box: measures steps and knows the bounds.
        point: where from.
        radius: length at most; may be infinite.
    """
    J, r = point.model.jacobian, point.model.residual
    d = bounded_least_squares(J, r, *box.sides(point.x, radius))
    change = J @ d
    gain = -float(change @ (2.0 * r + change))
    return Step(d, box.length(point.x, d), gain)


def phi_after_step(box: TrustBox, point: Iterate, free: Bools) -> float:
    """The linearised discrepancy after the best first step of some parameters.

    Args:
        box: measures steps and knows the bounds.
        point: where from.
        free: (n,) the parameters that move.
    """
    if not free.any():
        return point.phi
    J, r = point.model.jacobian[:, free], point.model.residual
    low, high = box.sides(point.x, FIRST_RADIUS)
    d = bounded_least_squares(J, r, low[free], high[free])
    return float(np.sum((r + J @ d) ** 2))


def _phi(ending: Ending[Iterate]) -> float:
    return ending.point.phi
