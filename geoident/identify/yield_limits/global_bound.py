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
from geoident.identify.problem.outcome import History, Observer, Outcome
from geoident.identify.problem.problem import Problem
from geoident.identify.problem.responses import ComplementaritySystem
from geoident.identify.yield_limits.condensed_system import (
    CondensedSystem,
    condensed,
    condensing_obstacle,
)
from geoident.identify.yield_limits.implicit import implicit
from geoident.identify.yield_limits.mixed_program import solve_box
from geoident.identify.yield_limits.parameter_boxes import (
    EnergyForm,
    ParameterBox,
    examined,
    form_of,
)
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


def global_bound(problem: Problem, options: ComplementarityOptions, observe: Observer) -> Outcome:
    """Minimises the discrepancy and proves how far from the lowest it can be.

    Args:
        problem: readings, model and parameters with finite bounds.
        options: gap, number of boxes; the others serve the implicit method that goes first.
        observe: is told of every box; its reason to stop ends the search with the bound so far.

    Returns:
        The best point that the model evaluated, its certificate with bound and gap.

    Raises:
        InputError: the problem is not of the kind, or too large.
        ModelError: no start has a solution.
    """
    why = formulation_obstacle(problem.response, "global") or _problem_obstacle(problem)
    _refuse(why)
    assert isinstance(problem.response, ComplementaritySystem)
    system = problem.response.system()
    _refuse(_system_obstacle(system))
    first = implicit(problem, options, observe)
    if first.status == STOPPED:
        return first
    return BranchAndBound(problem, options, observe, first).run(condensed(problem, system))


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


def _system_obstacle(system: BilinearSystem) -> str | None:
    why = condensing_obstacle(system)
    if why is None and system.n_pairs > MOST_PAIRS:
        return (
            f"{system.n_pairs} pairs of planes and multipliers are more than {MOST_PAIRS} "
            "(planes times strain points times stages); use a coarser mesh or fewer planes"
        )
    return why


class BranchAndBound:
    """Branch and bound over boxes of parameters.

    Args:
        problem: readings, model and parameters with finite bounds.
        options: gap and number of boxes.
        observe: is told of every box; its reason to stop ends the search.
        first: what the implicit method found.

    Attributes:
        best: the best point so far.
        done: lowest bound of the boxes that are done with.
        examined: number of boxes so far.
        form: of the energy of all pairs, or None where parameters change it.
    """

    def __init__(
        self,
        problem: Problem,
        options: ComplementarityOptions,
        observe: Observer,
        first: Outcome,
    ) -> None:
        self.problem, self.options = problem, options
        self.history = History("complementarity", problem.response, observe)
        self.best = first
        self.before = first.iterations
        self.done = np.inf
        self.examined = 0
        self.form: EnergyForm | None = None

    def run(self, system: CondensedSystem) -> Outcome:
        """All boxes, the most promising first."""
        everything = np.arange(system.n_pairs)
        if not system.products:
            self.form = form_of(system.work[:, None] * system.slack_by_lam)
        todo = [ParameterBox(system.lower, system.upper, 0.0, everything)]
        while todo and self.history.stop is None and self.examined < self.options.max_regions:
            todo.sort(key=lambda box: box.bound)
            if todo[0].bound >= self.goal:
                break
            todo += self.visit(system, todo.pop(0))
        return self.outcome(todo)

    @property
    def allowed(self) -> float:
        """What the gap allows."""
        return self.options.gap * max(self.best.objective, 1.0)

    @property
    def goal(self) -> float:
        """A box with a bound of this is done with."""
        return self.best.objective - self.allowed

    def visit(self, system: CondensedSystem, box: ParameterBox) -> list[ParameterBox]:
        """What is left to do of a box."""
        self.examined += 1
        better = max(self.best.objective, self.allowed)
        found = examined(system, self.form, box, better)
        if found is None:
            self.close(self.best.objective)
            return self.reported(box, [])
        if found.bound >= self.goal:
            self.close(found.bound)
            return self.reported(found, [])
        if len(found.kept) <= FEW_PAIRS or found.size <= SMALL:
            solved = solve_box(system, found, self.form, best=better, gap=0.5 * self.options.gap)
            if solved.p is not None:
                self.improve(solved.p * system.reference)
            if solved.complete or found.size <= SMALLEST:
                self.close(min(solved.bound, self.best.objective))
                return self.reported(found, [])
            found = replace(found, bound=max(found.bound, solved.bound))
        return self.reported(found, list(found.halves()))

    def close(self, bound: float) -> None:
        """Keeps the lowest bound of the boxes that are done with."""
        self.done = min(self.done, bound)

    def reported(self, box: ParameterBox, left: list[ParameterBox]) -> list[ParameterBox]:
        """Tells the observer; returns what is left."""
        note = f"box {self.examined}: bound {box.bound:.6g}, {len(box.kept)} pairs"
        self.history.record(self.best.values, self.best.objective, step=box.size, note=note)
        return left

    def improve(self, p: Floats) -> None:
        """Takes over a better point p (n,), SI, after a descent on the model from there."""
        try:
            found = gauss_newton(self.problem.begun_at(p), GaussNewtonOptions(), _silent)
        except ModelError:
            return
        if found.objective < self.goal:
            options = replace(self.options, restarts=0)
            self.best = implicit(self.problem.begun_at(found.values), options, _silent)

    def outcome(self, todo: list[ParameterBox]) -> Outcome:
        """The best point with what is proven."""
        bound = min([self.done, self.best.objective, *(box.bound for box in todo)])
        bound = max(bound, 0.0)
        gap = (self.best.objective - bound) / max(self.best.objective, 1.0)
        proven = gap <= 1.001 * self.options.gap
        proof = self.best.certificate
        if proof is not None:
            words = (
                f"No parameters within the bounds have a misfit below {bound:.6g}; "
                f"{self.examined} boxes of parameters were examined",
            )
            kind = "global" if proven else proof.kind
            proof = replace(proof, kind=kind, bound=bound, gap=gap, remarks=words)
        status, reason = self.ending(bound, proven)
        iterations = self.before + self.history.iterations
        return replace(
            self.best, status=status, reason=reason, iterations=iterations, certificate=proof
        )

    def ending(self, bound: float, proven: bool) -> tuple[str, str]:
        """Status and reason."""
        if self.history.stop is not None and not proven:
            return STOPPED, self.history.stop
        if proven:
            return "converged", (
                f"The misfit {self.best.objective:.6g} is the lowest within the bounds: "
                f"{bound:.6g} is a proven bound."
            )
        return "not-converged", (
            f"After {self.examined} boxes the proven bound is {bound:.6g}: raise max_regions or "
            "give tighter bounds."
        )


def _silent(entry: Iteration) -> str | None:
    return None
