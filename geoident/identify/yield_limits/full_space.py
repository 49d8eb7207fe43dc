"""Yield limits by one nonlinear program in all unknowns (theory 5, ``formulation: full-space``).

An independent check of the implicit method: parameters p and all unknowns x of the model's
`BilinearSystem` (displacements, stresses and multipliers of all stages) are variables of one
program, solved by IPOPT (Wachter & Biegler 2006). Its constraints are the equations and, for every
pair of a slack s and a multiplier lam, complementarity as the smoothed equation of Fischer and
Burmeister (Kanzow 1996),

    a + b - sqrt(a^2 + b^2 + 2 mu) = 0        a = s / S,  b = lam / L

which for mu > 0 says a > 0, b > 0, a b = mu, and is the complementarity itself for mu = 0. Signs
need no bounds of their own then, which saves an interior-point method nine tenths of its steps. All
variables are measured by the answer of the model at the start without multipliers (the elastic
one): unknowns of one kind by the largest of them, slacks by S, that of their kind, multipliers by
L = S / stiffness. So the program is of the order of one throughout.

The smoothing mu is lowered from 1 to 1e-12, each solution the start of the next. What counts in the
end is the model itself: it is evaluated at the parameters found, and that discrepancy is what is
reported. Only a local method, as the implicit one is.

Needs the extra ``full-space`` (casadi), whose derivatives are exact and sparse.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from importlib import import_module
from typing import Any

import numpy as np
import scipy.sparse as sp

from geoident.errors import Fault, InputError
from geoident.identify.problem.methods import formulation_obstacle
from geoident.identify.problem.outcome import History, OnIteration, Outcome
from geoident.identify.problem.problem import Discrepancy, Problem
from geoident.identify.problem.responses import ComplementaritySystem
from geoident.identify.yield_limits.condensed_system import determined_unknowns, sizes_of_kinds
from geoident.identify.yield_limits.implicit import certificate_at
from geoident.model.arrays import Floats
from geoident.model.methods import (
    ComplementarityOptions,
    HuberOptions,
    SquaredOptions,
    StudentOptions,
)
from geoident.model.parameter import Parameter
from geoident.model.response import Bilinear, BilinearSystem

_SMOOTHINGS = tuple(10.0**-k for k in range(0, 14, 2))
"""mu, from what hides every kink to what hides none; a b = mu in stresses and strains of one."""

_MOST_STEPS = 500
"""Iterations of the solver for one mu."""

_AGREE = 1e-3
"""Relative difference of the discrepancies of program and model up to which they agree."""

Expression = Any
"""A casadi expression; the package has no types."""


@dataclass(frozen=True)
class Program:
    """Minimise f(z) subject to g(z, mu) = 0 and bounds on z; all of the order of one.

    Args:
        variables: z, (n + N + K + 2 g,); the n parameters first, then the N unknowns, the K shared
            errors of the readings (theory 7) where the loss is robust, and the parts of the
            residuals beyond delta, up and down, with Huber's loss.
        mu: the smoothing.
        objective: f, the discrepancy.
        constraints: g, (N,): the equations, then the complementarity of every pair.
        lower: bounds on z, like z.
        upper: likewise.
        start: z, the elastic answer at the start.
        reference: (n,) p = reference times the first n variables, SI.
    """

    variables: Expression
    mu: Expression
    objective: Expression
    constraints: Expression
    lower: Floats
    upper: Floats
    start: Floats
    reference: Floats


def nonlinear_program(problem: Problem, system: BilinearSystem) -> Program:
    """The program of a problem, started from its elastic answer.

    Args:
        problem: readings and parameters.
        system: the equations of its model.

    Raises:
        ModelError: the equations do not determine the unknowns.
    """
    ca: Any = import_module("casadi")
    start, (lower, upper) = problem.start, problem.bounds
    reference = np.array([_size(q) for q in problem.parameters])
    constant, matrix = system.equations.at(start)
    x = determined_unknowns(system, matrix, constant[:, None])[:, 0]
    size = sizes_of_kinds(system, x)
    S = size[system.kind_of_slack]
    unit = size[system.kind_of_unknown]
    unit[system.multipliers] = S / system.stiffness  # of no kind themselves
    z_p, z_x, mu = ca.SX.sym("p", len(reference)), ca.SX.sym("x", len(x)), ca.SX.sym("mu")
    p = z_p * reference

    def values(bilinear: Bilinear, by: Floats) -> Expression:
        """The values (m,) over ``by`` (m,), as expressions in scaled unknowns."""

        def product(A: sp.csr_array) -> Expression:
            return ca.DM(sp.csc_matrix(sp.diags_array(1.0 / by) @ A @ sp.diags_array(unit))) @ z_x

        total = product(bilinear.by_x)
        for h, A in bilinear.products.items():
            total += p[h] * product(A)
        straight = ca.sparsify(ca.DM(bilinear.by_p / by[:, None]))
        return total + ca.DM(bilinear.constant / by) + straight @ p

    # equations by the size of their kind; those of no kind by their largest terms
    equation_size = size[system.kind_of_equation]
    no_kind, free = system.kind_of_equation < 0, system.determined
    terms = np.abs(constant[no_kind]), (abs(matrix[:, free]) @ unit[free])[no_kind]
    equation_size[no_kind] = max(float(np.concatenate(terms).max(initial=0.0)), 1e-300)
    a, b = values(system.slacks, S), z_x[system.multipliers.tolist()]
    complementarity = a + b - ca.sqrt(a**2 + b**2 + 2.0 * mu)
    robust = problem.shared is not None and not isinstance(problem.loss, SquaredOptions)
    z_s = ca.SX.sym("s", len(problem.shared) if problem.shared is not None and robust else 0)
    g = len(problem.measured)
    beyond = ca.SX.sym("beyond", 2 * g if isinstance(problem.loss, HuberOptions) else 0)
    unbounded = np.full(len(x) + z_s.numel(), np.inf)
    misfit = values(system.readings, np.ones(g)) - problem.measured
    return Program(
        ca.vertcat(z_p, z_x, z_s, beyond),
        mu,
        _objective(ca, problem, misfit, p, z_s, beyond),
        ca.vertcat(values(system.equations, equation_size), complementarity),
        np.concatenate([lower / reference, -unbounded, np.zeros(beyond.numel())]),
        np.concatenate([upper / reference, unbounded, np.full(beyond.numel(), np.inf)]),
        np.concatenate([start / reference, x / unit, np.zeros(z_s.numel() + beyond.numel())]),
        reference,
    )


def _size(parameter: Parameter) -> float:
    """A value of the order of the parameter, SI."""
    width = parameter.upper - parameter.lower
    size = abs(parameter.start)
    return max(size, 0.1 * width) if np.isfinite(width) and width > 0.0 else size or 1.0


def _objective(
    ca: Any, problem: Problem, misfit: Expression, p: Expression, z: Expression, beyond: Expression
) -> Expression:
    """Phi with the priors' part, as an expression (the formulas of `problem`).

    Huber's loss is the least of a smooth function of two more unknowns (Mangasarian & Musicant
    2000),

        rho(r) = min  (r - u + v)^2 + 2 delta (u + v)    over  u >= 0,  v >= 0,

    as its curvature jumps at delta: where delta is small, Newton's steps go back and forth.

    Args:
        ca: casadi.
        problem: errors, loss and priors.
        misfit: (g,) v - v*, SI.
        p: (n,) parameters, SI.
        z: (K,) shared errors, unknowns of the program where the loss is robust; else none.
        beyond: (2 g,) u, then v, with Huber's loss; else none.
    """

    def rho(r: Expression) -> Expression:
        match problem.loss:
            case HuberOptions(delta):
                u, v = ca.vertsplit(beyond, r.numel())
                return (r - u + v) ** 2 + 2.0 * delta * (u + v)
            case StudentOptions(nu):
                return (nu + 1.0) * ca.log1p(r**2 / nu)
            case _:
                return r**2

    if problem.shared is None:
        total = ca.sum1(rho(misfit / problem.sd))
    elif z.numel() == 0:
        total = ca.sumsqr(ca.DM(problem.whiten(np.eye(len(problem.sd)))) @ misfit)
    else:
        own = (misfit - ca.DM(problem.shared.columns.toarray()) @ z) / problem.sd
        total = ca.sum1(rho(own)) + ca.sumsqr(z)
    for i, q in enumerate(problem.parameters):
        if q.prior is not None and q.prior.kind == "normal":
            total += ((p[i] - q.prior.mean) / q.prior.sd) ** 2
        elif q.prior is not None:
            total += (ca.log(p[i] / q.prior.mean) * q.prior.mean / q.prior.sd) ** 2
    return total


def full_space(
    problem: Problem, options: ComplementarityOptions, on_iteration: OnIteration
) -> Outcome:
    """Minimises the discrepancy in the full space.

    Args:
        problem: readings, model and parameters.
        options: of the method; the formulation has been chosen.
        on_iteration: is called with every iteration; its reason to stop ends the search.

    Returns:
        The best parameters at which the model itself was evaluated.

    Raises:
        InputError: the model does not offer its equations, or casadi is missing.
        ModelError: the stiffness of a stage is singular.
    """
    why = formulation_obstacle(problem.response, "full-space")
    if why is not None:
        raise InputError([Fault("method-not-possible", f"This is not possible here: {why}.")])
    assert isinstance(problem.response, ComplementaritySystem)
    discrepancy = Discrepancy(problem)
    history = History("complementarity", problem.response, on_iteration)
    program = nonlinear_program(problem, problem.response.system())
    mu = np.inf

    def natural(z: Floats) -> Floats:
        """Parameters (n,), SI, inside their bounds."""
        return np.clip(z[: len(program.reference)] * program.reference, *problem.bounds)

    def confirmed(p: Floats, note: str) -> tuple[Floats, float]:
        """The parameters (n,) with the discrepancy of the model, infinite without a solution."""
        phi = discrepancy.objective(p)
        history.record(p, phi, step=0.0, note=note)
        return p, phi

    def watch(z: Floats, objective: float) -> bool:
        history.record(natural(z), objective, step=0.0, note=f"smoothing {mu:.0e}")
        return history.stop is not None

    start = confirmed(problem.start, "start")
    solve, solution = solver(program, watch), Solution(program.start, np.nan, False, "stopped")
    for mu in _SMOOTHINGS:
        if history.stop is not None:
            break
        solution = solve(solution.z, mu)
    best = min(start, confirmed(natural(solution.z), "model"), key=lambda pair: pair[1])
    status, reason = "not-converged", ""
    if not solution.success:
        reason = (
            f"The nonlinear program was not solved ({solution.word}): use the formulation "
            "implicit, or start nearer to the expected values."
        )
    elif abs(best[1] - solution.objective) > _AGREE * max(best[1], 1.0):
        reason = (
            f"The model gives a misfit of {best[1]:.6g} where the nonlinear program "
            f"gives {solution.objective:.6g}: use the formulation implicit."
        )
    else:
        status = "converged"
        reason = (
            "The nonlinear program in the full space is solved, with complementarity to "
            f"{_SMOOTHINGS[-1]:.0e}, and the model confirms its misfit."
        )
    outcome = history.outcome(*best, status, reason)
    proof = certificate_at(problem, best[0], history)
    return replace(outcome, iterations=history.iterations, certificate=proof)


@dataclass(frozen=True)
class Solution:
    """Where the solver ended for one mu: z, its objective, its word for the end."""

    z: Floats
    objective: float
    success: bool
    word: str


def solver(
    program: Program, watch: Callable[[Floats, float], bool]
) -> Callable[[Floats, float], Solution]:
    """A function (z, mu) -> solution that calls IPOPT without printing anything.

    Args:
        program: what to solve.
        watch: is told z and the objective of every iteration; True stops the solver.
    """
    casadi: Any = import_module("casadi")
    n, m = program.variables.numel(), program.constraints.numel()

    class Callback(casadi.Callback):  # type: ignore[misc]
        """What IPOPT calls after every iteration; an exception in it stops IPOPT and is kept."""

        def __init__(self) -> None:
            super().__init__()
            self.failure: BaseException | None = None
            self.construct("watch", {})

        def get_n_in(self) -> int:
            return int(casadi.nlpsol_n_out())

        def get_n_out(self) -> int:
            return 1

        def get_sparsity_in(self, i: int) -> Any:
            size = {"f": 1, "x": n, "lam_x": n, "g": m, "lam_g": m, "lam_p": 1}
            return casadi.Sparsity.dense(size[casadi.nlpsol_out(i)], 1)

        def eval(self, arguments: Any) -> list[int]:
            z = np.asarray(arguments[0], dtype=np.float64).ravel()
            try:
                return [int(watch(z, float(arguments[1])))]
            except BaseException as error:
                self.failure = error
                return [1]

    callback = Callback()
    nlp = {
        "x": program.variables,
        "p": program.mu,
        "f": program.objective,
        "g": program.constraints,
    }
    quiet = {"print_time": False, "show_eval_warnings": False, "error_on_fail": False}
    ipopt = {"print_level": 0, "sb": "yes", "max_iter": _MOST_STEPS, "mu_strategy": "adaptive"}
    options = {**quiet, "iteration_callback": callback, "ipopt": ipopt}
    function = casadi.nlpsol("full_space", "ipopt", nlp, options)
    bounds = {"lbx": program.lower, "ubx": program.upper, "lbg": 0.0, "ubg": 0.0}

    def solve(z: Floats, mu: float) -> Solution:
        end = function(x0=z, p=mu, **bounds)
        if callback.failure is not None:
            raise callback.failure
        stats = function.stats()
        z = np.asarray(end["x"], dtype=np.float64).ravel()
        return Solution(z, float(end["f"]), bool(stats["success"]), str(stats["return_status"]))

    return solve
