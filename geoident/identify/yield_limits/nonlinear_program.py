"""The whole identification problem as one nonlinear program (theory 5, full space).

Variables are the parameters p and all unknowns x of the model's `BilinearSystem` (displacements,
stresses and multipliers of all stages); the constraints are its equations and, for every pair of a
slack s and a multiplier lam, complementarity as the smoothed equation of Fischer and Burmeister
(Kanzow 1996),

    a + b - sqrt(a^2 + b^2 + 2 mu) = 0        a = s / S,  b = lam / L

which for mu > 0 says a > 0, b > 0, a b = mu, and is the complementarity itself for mu = 0. Signs
need no bounds of their own then, which saves an interior-point method nine tenths of its steps. All
variables are measured by the answer of the model at the start without multipliers (the elastic
one): unknowns of one kind by the largest of them, slacks by S, that of their kind, multipliers by
L = S / stiffness. So the program is of the order of one throughout.

The program is written with casadi, whose derivatives are exact and sparse.
"""

from __future__ import annotations

from dataclasses import dataclass
from importlib import import_module
from typing import Any

import numpy as np
import scipy.sparse as sp

from geoident.identify.problem.problem import Problem
from geoident.identify.yield_limits.condensed_system import determined_unknowns, sizes_of_kinds
from geoident.model.arrays import Floats
from geoident.model.methods import HuberOptions, LossOptions, StudentOptions
from geoident.model.parameter import Parameter
from geoident.model.response import Bilinear, BilinearSystem

Expression = Any
"""A casadi expression; the package has no types."""


@dataclass(frozen=True)
class Program:
    """Minimise f(z) subject to g(z, mu) = 0 and bounds on z; all of the order of one.

    Args:
        variables: z, (n + N,); the n parameters first.
        mu: the smoothing.
        objective: f, the discrepancy.
        constraints: g, (N,): the equations, then the complementarity of every pair.
        lower: (n + N,) bounds on z.
        upper: (n + N,).
        start: (n + N,) the elastic answer at the start.
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
    return Program(
        ca.vertcat(z_p, z_x),
        mu,
        _objective(ca, problem, values(system.readings, one), p),
        ca.vertcat(
            values(system.equations, _sizes_of_equations(system, size, start, unit)), paired
        ),
        np.append(lower / reference, -endless),
        np.append(upper / reference, endless),
        np.append(start / reference, x / unit),
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


def _objective(ca: Any, problem: Problem, readings: Expression, p: Expression) -> Expression:
    """Phi with the priors' part, for readings (g,) and parameters (n,) as expressions."""
    r = (readings - problem.measured) / problem.sd
    if problem.shared is not None:
        r = ca.DM(problem.whiten(np.eye(len(problem.sd)))) @ (readings - problem.measured)
    total = ca.sum1(_loss(ca, problem.loss, r))
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
