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
from geoident.identify.problem.outcome import History, Observer, Outcome
from geoident.identify.problem.problem import Discrepancy, Problem
from geoident.identify.problem.responses import ComplementaritySystem
from geoident.identify.yield_limits.condensed_system import determined_unknowns, sizes_of_kinds
from geoident.identify.yield_limits.implicit import certificate_at
from geoident.model.arrays import Floats
from geoident.model.methods import (
    ComplementarityOptions,
    HuberOptions,
    LossOptions,
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
        variables: z, (n + N + K,); the n parameters first, last the shared errors of the readings
            (theory 7) where the loss is robust.
        mu: the smoothing.
        objective: f, the discrepancy.
        constraints: g, (N,): the equations, then the complementarity of every pair.
        lower: (n + N + K,) bounds on z.
        upper: (n + N + K,).
        start: (n + N + K,) the elastic answer at the start.
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
    z_p, z_x = ca.SX.sym("p", len(reference)), ca.SX.sym("x", len(x))
    p, mu = z_p * reference, ca.SX.sym("mu")

    def values(given: Bilinear, by: Floats) -> Expression:
        """The values (m,) over ``by`` (m,), as expressions."""
        total = _matrix(ca, given.by_x, unit, by) @ z_x
        for h, product in given.products.items():
            total += p[h] * (_matrix(ca, product, unit, by) @ z_x)
        straight = ca.sparsify(ca.DM(given.by_p / by[:, None]))
        return total + ca.DM(given.constant / by) + straight @ p

    a, b = values(system.slacks, S), z_x[system.multipliers.tolist()]
    paired = a + b - ca.sqrt(a**2 + b**2 + 2.0 * mu)
    one = np.ones(len(problem.measured))
    endless = np.full(len(x), np.inf)
    robust = problem.shared is not None and not isinstance(problem.loss, SquaredOptions)
    free = np.full(len(problem.shared) if problem.shared is not None and robust else 0, np.inf)
    z_s = ca.SX.sym("s", len(free))
    return Program(
        ca.vertcat(z_p, z_x, z_s),
        mu,
        _objective(ca, problem, values(system.readings, one), p, z_s),
        ca.vertcat(
            values(system.equations, _sizes_of_equations(system, size, start, unit)), paired
        ),
        np.concatenate([lower / reference, -endless, -free]),
        np.concatenate([upper / reference, endless, free]),
        np.concatenate([start / reference, x / unit, np.zeros(len(free))]),
        reference,
    )


def _sizes_of_equations(
    system: BilinearSystem, size: Floats, start: Floats, unit: Floats
) -> Floats:
    """(N - q,) the size of their kind; of those without a kind, that of their largest terms.

    Args:
        system: the equations.
        size: (n_kinds,) of unknowns.
        start: (n,) parameters, SI.
        unit: (N,) of unknowns.
    """
    found = size[system.kind_of_equation]
    own = system.kind_of_equation < 0
    constant, matrix = system.equations.at(start)
    free = system.determined
    terms = abs(matrix[:, free]) @ unit[free]
    found[own] = max(
        float(np.abs(constant[own]).max(initial=0.0)), float(terms[own].max(initial=0.0)), 1e-300
    )
    return found


def _matrix(ca: Any, matrix: sp.csr_array, unit: Floats, by: Floats) -> Expression:
    """A matrix (m, N) for scaled unknowns and values, as casadi keeps it."""
    scaled = sp.diags_array(1.0 / by) @ matrix @ sp.diags_array(unit)
    return ca.DM(sp.csc_matrix(scaled))


def _objective(
    ca: Any, problem: Problem, readings: Expression, p: Expression, z: Expression
) -> Expression:
    """Phi with the priors' part, as an expression.

    Args:
        ca: casadi.
        problem: the measured readings.
        readings: (g,) those of the model, as expressions.
        p: (n,) parameters.
        z: (K,) shared errors, unknowns of the program where the loss is robust; else none.
    """
    gap = readings - problem.measured
    if problem.shared is None:
        total = ca.sum1(_loss(ca, problem.loss, gap / problem.sd))
    elif z.numel() == 0:
        total = ca.sumsqr(ca.DM(problem.whiten(np.eye(len(problem.sd)))) @ gap)
    else:
        own = (gap - ca.DM(problem.shared.columns.toarray()) @ z) / problem.sd
        total = ca.sum1(_loss(ca, problem.loss, own)) + ca.sumsqr(z)
    for i, q in enumerate(problem.parameters):
        if q.prior is not None and q.prior.kind == "normal":
            total += ((p[i] - q.prior.mean) / q.prior.sd) ** 2
        elif q.prior is not None:
            total += (ca.log(p[i] / q.prior.mean) * q.prior.mean / q.prior.sd) ** 2
    return total


def _size(parameter: Parameter) -> float:
    """A value of the order of the parameter, SI."""
    width = parameter.upper - parameter.lower
    size = abs(parameter.start)
    return max(size, 0.1 * width) if np.isfinite(width) and width > 0.0 else size or 1.0


def _loss(ca: Any, options: LossOptions, r: Expression) -> Expression:
    """rho(r), the formulas of `discrepancy`."""
    match options:
        case HuberOptions(delta):
            tail = 2.0 * delta * ca.fabs(r) - delta**2
            return ca.if_else(ca.fabs(r) <= delta, r**2, tail)
        case StudentOptions(nu):
            return (nu + 1.0) * ca.log1p(r**2 / nu)
        case _:
            return r**2


def full_space(problem: Problem, options: ComplementarityOptions, observe: Observer) -> Outcome:
    """Minimises the discrepancy in the full space.

    Args:
        problem: readings, model and parameters.
        options: of the method; the formulation has been chosen.
        observe: is told of every iteration; its reason to stop ends the search.

    Returns:
        The best parameters at which the model itself was evaluated.

    Raises:
        InputError: the model does not offer its equations, or casadi is missing.
        ModelError: the stiffness of a stage is singular.
    """
    why = formulation_obstacle(problem.response, "full-space")
    if why is not None:
        raise InputError([Fault("method-not-possible", f"This is not possible here: {why}.")])
    return _Smoothing(problem, observe).run()


@dataclass(frozen=True)
class _Solution:
    """Where the solver ended for one mu: x (N,), its discrepancy, its own word for the end."""

    x: Floats
    objective: float
    success: bool
    word: str


class _Smoothing:
    """The sequence of programs."""

    def __init__(self, problem: Problem, observe: Observer) -> None:
        assert isinstance(problem.response, ComplementaritySystem)
        self.problem = problem
        self.discrepancy = Discrepancy(problem)
        self.history = History("complementarity", problem.response, observe)
        self.program = nonlinear_program(problem, problem.response.system())
        self.mu = np.inf

    def run(self) -> Outcome:
        """All smoothings, then the model."""
        best = self.problem.start, self.confirm(self.problem.start, "start")
        solve, found = solver(self.program, self.note), None
        x = self.program.start
        for mu in _SMOOTHINGS:
            if self.history.stop is not None:
                break
            self.mu = mu
            found = solve(x, mu)
            x = found.x
        p = self.natural(x)
        best = min(best, (p, self.confirm(p, "model")), key=lambda pair: pair[1])
        outcome = self.history.outcome(*best, *self.ending(found, best))
        proof = certificate_at(self.problem, best[0], self.history)
        return replace(outcome, iterations=self.history.iterations, certificate=proof)

    def natural(self, x: Floats) -> Floats:
        """Parameters (n,), SI, inside their bounds."""
        reference = self.program.reference
        return np.clip(x[: len(reference)] * reference, *self.problem.bounds)

    def confirm(self, p: Floats, note: str) -> float:
        """The discrepancy of the model at p (n,); infinite where it has no solution."""
        phi = self.discrepancy.objective(p)
        self.history.record(p, phi, step=0.0, note=note)
        return phi

    def note(self, x: Floats, objective: float) -> bool:
        """Records an iterate of the solver; whether it is to stop."""
        note = f"smoothing {self.mu:.0e}"
        self.history.record(self.natural(x), objective, step=0.0, note=note)
        return self.history.stop is not None

    def ending(self, found: _Solution | None, best: tuple[Floats, float]) -> tuple[str, str]:
        """Status and reason."""
        if found is None or not found.success:
            word = "stopped" if found is None else found.word
            return "not-converged", (
                f"The nonlinear program was not solved ({word}): use the formulation "
                "implicit, or start nearer to the expected values."
            )
        if abs(best[1] - found.objective) > _AGREE * max(best[1], 1.0):
            return "not-converged", (
                f"The model gives a misfit of {best[1]:.6g} where the nonlinear program "
                f"gives {found.objective:.6g}: use the formulation implicit."
            )
        return "converged", (
            "The nonlinear program in the full space is solved, with complementarity to "
            f"{_SMOOTHINGS[-1]:.0e}, and the model confirms its misfit."
        )


def solver(
    program: Program, watch: Callable[[Floats, float], bool]
) -> Callable[[Floats, float], _Solution]:
    """A function (x (N,), mu) -> solution that calls IPOPT, without a word on any screen.

    Args:
        program: what to solve.
        watch: is told x (N,) and the objective of every iteration; True stops the solver.
    """
    casadi: Any = import_module("casadi")
    n, m = program.variables.numel(), program.constraints.numel()
    callback = _callback(casadi, n, m, watch)
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

    def solve(x: Floats, mu: float) -> _Solution:
        bounds = {"lbx": program.lower, "ubx": program.upper, "lbg": 0.0, "ubg": 0.0}
        found = function(x0=x, p=mu, **bounds)
        if callback.failure is not None:
            raise callback.failure
        stats = function.stats()
        end = np.asarray(found["x"], dtype=np.float64).ravel()
        return _Solution(
            end, float(found["f"]), bool(stats["success"]), str(stats["return_status"])
        )

    return solve


def _callback(casadi: Any, n: int, m: int, watch: Callable[[Floats, float], bool]) -> Any:
    """What IPOPT calls after every iteration. An exception in it stops IPOPT and is kept."""

    class Callback(casadi.Callback):  # type: ignore[misc]
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
            x = np.asarray(arguments[0], dtype=np.float64).ravel()
            try:
                return [int(watch(x, float(arguments[1])))]
            except BaseException as error:
                self.failure = error
                return [1]

    return Callback()
