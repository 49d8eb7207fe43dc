"""The global optimum of small problems, proven (theory 5, ``formulation: global``).

The implicit method finds what is probably the best point; here a bound is proven. Displacements are
eliminated (`condensed_system`), and branch and bound works on boxes of parameters, the one with the
lowest bound first:

    examine  planes that are reached nowhere in the box are dropped, the box is bounded from below
             and made smaller (`parameter_boxes`);
    solve    where few pairs are left, branch and bound over them, exactly (`mixed_program`);
    cut      into halves, where many are.

A box whose bound is not below the best discrepancy is done with. A better point found on the way
is taken over after Gauss-Newton on the model itself, so what is reported was evaluated by the
model. The bound is the lowest of all boxes. The discrepancy is a sum of squares in standard
deviations: a difference below ``gap`` means nothing, so the gap is measured against max(phi, 1).

For small systems: the condensed system is dense. Needs the extra ``global`` (SCIP).
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from geoident.errors import Fault, InputError, ModelError
from geoident.identify.least_squares.gauss_newton import gauss_newton
from geoident.identify.problem.methods import formulation_obstacle
from geoident.identify.problem.outcome import History, OnIteration, Outcome
from geoident.identify.problem.problem import Problem
from geoident.identify.problem.responses import ComplementaritySystem
from geoident.identify.yield_limits.condensed_system import condensed, condensing_obstacle
from geoident.identify.yield_limits.implicit import implicit
from geoident.identify.yield_limits.mixed_program import solve_box
from geoident.identify.yield_limits.parameter_boxes import ParameterBox, examined, form_of
from geoident.model.arrays import Floats
from geoident.model.methods import ComplementarityOptions, GaussNewtonOptions, loss_name
from geoident.model.response import BilinearSystem
from geoident.model.results.result import STOPPED, Iteration

MOST_PAIRS = 2000
"""Planes times strain points times stages: the condensed system is dense."""

FEW_PAIRS = 40
"""As many as branch and bound over them settles at once."""

SMALL = 0.02
"""A box this small, in parts of the parameters, is not cut before branch and bound was tried."""

SMALLEST = 1e-7
"""A box this small, in parts of the parameters, is not cut."""


def global_bound(
    problem: Problem, options: ComplementarityOptions, on_iteration: OnIteration
) -> Outcome:
    """Minimises the discrepancy and proves how far from the lowest it can be.

    Args:
        problem: readings, model and parameters with finite bounds.
        options: gap, number of boxes; the others serve the implicit method that goes first.
        on_iteration: is called with every box; its reason to stop ends the search with the bound
            so far.

    Returns:
        The best point that the model evaluated, its certificate with bound and gap.

    Raises:
        InputError: the problem is not of the kind, or too large.
        ModelError: no start has a solution.
    """
    why = formulation_obstacle(problem.response, "global") or _problem_obstacle(problem)
    _refuse(why)
    assert isinstance(problem.response, ComplementaritySystem)
    equations = problem.response.system()
    _refuse(condensing_obstacle(equations) or _size_obstacle(equations))
    best = implicit(problem, options, on_iteration)
    if best.status == STOPPED:
        return best
    first, system = best, condensed(problem, equations)
    form = None if system.products else form_of(system.work[:, None] * system.slack_by_lam)
    history = History("complementarity", problem.response, on_iteration)
    done, count = np.inf, 0  # lowest bound of the boxes that are done with, number of boxes
    todo = [ParameterBox(system.lower, system.upper, 0.0, np.arange(system.n_pairs))]
    while todo and history.stop is None and count < options.max_regions:
        todo.sort(key=lambda box: box.bound)
        allowed = options.gap * max(best.objective, 1.0)
        goal, better = best.objective - allowed, max(best.objective, allowed)
        if todo[0].bound >= goal:
            break
        box, closed = todo.pop(0), True
        count += 1
        smaller = examined(system, form, box, better)
        if smaller is None:  # nothing below the best
            done = min(done, best.objective)
        elif smaller.bound >= goal:
            box, done = smaller, min(done, smaller.bound)
        else:
            box, closed = smaller, False
            if len(box.kept) <= FEW_PAIRS or box.size <= SMALL:
                solved = solve_box(system, box, form, best=better, gap=0.5 * options.gap)
                if solved.p is not None:
                    best = _better_end(problem, options, solved.p * system.reference, best, goal)
                if solved.complete or box.size <= SMALLEST:
                    done, closed = min(done, solved.bound, best.objective), True
                else:
                    box = replace(box, bound=max(box.bound, solved.bound))
        note = f"box {count}: bound {box.bound:.6g}, {len(box.kept)} pairs"
        history.record(best.values, best.objective, step=box.size, note=note)
        todo += [] if closed else box.halves()
    bound = max(min([done, best.objective, *(box.bound for box in todo)]), 0.0)
    best = replace(best, iterations=first.iterations + history.iterations)
    return _judged(best, bound, count, options.gap, history.stop)


def _judged(best: Outcome, bound: float, count: int, allowed: float, stop: str | None) -> Outcome:
    """The best point with what the boxes prove of it."""
    gap = (best.objective - bound) / max(best.objective, 1.0)
    proven = gap <= 1.001 * allowed  # a thousandth for rounding
    if proven:
        status, reason = (
            "converged",
            (
                f"The misfit {best.objective:.6g} is the lowest within the bounds: "
                f"{bound:.6g} is a proven bound."
            ),
        )
    elif stop is not None:
        status, reason = STOPPED, stop
    else:
        status, reason = (
            "not-converged",
            (
                f"After {count} boxes the proven bound is {bound:.6g}: raise max_regions or "
                "give tighter bounds."
            ),
        )
    proof = best.certificate
    if proof is not None:
        remark = (
            f"No parameters within the bounds have a misfit below {bound:.6g}; "
            f"{count} boxes of parameters were examined"
        )
        kind = "global" if proven else proof.kind
        proof = replace(proof, kind=kind, bound=bound, gap=gap, remarks=(remark,))
    return replace(best, status=status, reason=reason, certificate=proof)


def _better_end(
    problem: Problem, options: ComplementarityOptions, p: Floats, best: Outcome, goal: float
) -> Outcome:
    """The end of a descent of the model from p (n,), SI, if it is below the goal; else the best."""
    try:
        end = gauss_newton(problem.begun_at(p), GaussNewtonOptions(), _silent)
    except ModelError:
        return best
    if end.objective >= goal:
        return best
    return implicit(problem.begun_at(end.values), replace(options, restarts=0), _silent)


def _silent(entry: Iteration) -> str | None:
    return None


def _refuse(why: str | None) -> None:
    if why is not None:
        msg = f"The formulation global is not possible here: {why}."
        raise InputError([Fault("method-not-possible", msg)])


def _problem_obstacle(problem: Problem) -> str | None:
    if loss_name(problem.loss) != "squared":
        return (
            f"its bounds hold only for the squared loss, and the loss is {loss_name(problem.loss)}"
        )
    for q in problem.parameters:
        if not (np.isfinite(q.lower) and np.isfinite(q.upper)):
            return f"{q.name} has no bounds, and a proof needs them"
        if q.prior is not None and q.prior.kind == "lognormal":
            return f"the prior of {q.name} is lognormal, and only a normal one is a square of it"
    return None


def _size_obstacle(system: BilinearSystem) -> str | None:
    if system.n_pairs <= MOST_PAIRS:
        return None
    return (
        f"{system.n_pairs} pairs of planes and multipliers are more than {MOST_PAIRS} "
        "(planes times strain points times stages); use a coarser mesh or fewer planes"
    )
