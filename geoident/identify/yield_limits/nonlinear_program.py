"""The whole identification problem as one nonlinear program (theory 5, full space).

Variables are the parameters and, stage by stage, the steps du and dlam and the stresses sigma of
every present point set; the equations are those of `geoident.model.equations`. With the slack
s = k + H lam - N^T sigma of a plane, complementarity is the smoothed equation of Fischer and
Burmeister (Kanzow 1996),

    a + b - sqrt(a^2 + b^2 + 2 mu) = 0        a = s / S,  b = dlam / L

which for mu > 0 says a > 0, b > 0, a b = mu, and is the complementarity itself for mu = 0. Signs
need no bounds of their own then, which saves an interior-point method nine tenths of its steps. All
variables are measured by the elastic answer of the model at the start: S, the largest stress of a
point set; L, the plastic strain n^T E n L = S; u by the largest displacement. So the program is of
the order of one throughout.

The program is written with casadi, whose derivatives are exact and sparse.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from importlib import import_module
from typing import Any

import numpy as np

from geoident.identify.problem.problem import Problem
from geoident.identify.yield_limits.elastic_march import (
    ElasticStep,
    elastic_march,
    weighted_transpose,
)
from geoident.model.arrays import Floats
from geoident.model.equations import Affine, LoadStage, PointLaw, StagedSystem
from geoident.model.methods import HuberOptions, LossOptions, StudentOptions
from geoident.model.parameter import Parameter

Expression = Any
"""A casadi expression; the package has no types."""


@dataclass(frozen=True)
class Program:
    """Minimise f(x) under lower <= g(x, mu) <= upper and bounds on x; all of the order of one.

    Args:
        x: the variables, (N,); the n parameters first.
        mu: the smoothing.
        objective: f, the discrepancy.
        constraints: g, (M,), all equations.
        lower: (N,) bounds on x.
        upper: (N,).
        start: (N,) the elastic answer at the start.
        reference: (n,) p = reference times the first n variables, SI.
    """

    x: Expression
    mu: Expression
    objective: Expression
    constraints: Expression
    lower: Floats
    upper: Floats
    start: Floats
    reference: Floats


def nonlinear_program(problem: Problem, system: StagedSystem) -> Program:
    """The program of a problem, started from its elastic answer.

    Args:
        problem: readings and parameters.
        system: the equations of its model.
    """
    return _Writer(problem, system).program()


@dataclass
class _SetState:
    """A point set at the end of a stage: stress and multipliers so far, scaled or None."""

    stress: Expression
    multipliers: Expression


class _Writer:
    """Collects variables and equations stage by stage."""

    def __init__(self, problem: Problem, system: StagedSystem) -> None:
        self.ca: Any = import_module("casadi")
        self.problem, self.system = problem, system
        p0 = np.array([q.start for q in problem.parameters])
        self.reference = np.array([_size(q) for q in problem.parameters])
        self.variables: list[Expression] = []
        self.bounds: list[tuple[Floats, Floats]] = []
        self.start: list[Floats] = []
        self.equations: list[Expression] = []
        self.mu = self.ca.SX.sym("mu")
        lower = np.array([q.lower for q in problem.parameters]) / self.reference
        upper = np.array([q.upper for q in problem.parameters]) / self.reference
        scaled = self.variable("p", p0 / self.reference, lower, upper)
        self.p = scaled * self.reference
        self.steps = self._elastic_answer(p0)
        self.stress_size = self._stress_sizes()
        self.length = max(float(np.abs(s.du).max(initial=0.0)) for s in self.steps) or 1.0
        self.moduli = [law.elasticity.at(p0) for law in system.laws]

    def program(self) -> Program:
        """All stages, then the discrepancy."""
        done: list[dict[int, _SetState]] = []
        readings = self.affine(self.system.offset)
        for stage, step in zip(self.system.stages, self.steps, strict=True):
            du, states = self.stage(stage, step, done)
            done.append(states)
            rows = self.system.rows[:, stage.dofs]
            seen = self.sparse(rows) @ du * self.length
            readings = readings + self.system.active[step.stage] * seen
        lower, upper = (np.concatenate(side) for side in zip(*self.bounds, strict=True))
        return Program(
            self.ca.vertcat(*self.variables),
            self.mu,
            self.objective(readings),
            self.ca.vertcat(*self.equations),
            lower,
            upper,
            np.concatenate(self.start),
            self.reference,
        )

    def stage(
        self, stage: LoadStage, step: ElasticStep, done: Sequence[dict[int, _SetState]]
    ) -> tuple[Expression, dict[int, _SetState]]:
        """The variables and equations of one stage; its free du, scaled, and where it ends."""
        du = self.variable("u", step.du[stage.dofs, 0] / self.length)
        base = {} if stage.base < 0 else done[stage.base]
        states, force = {}, self.affine(stage.forces)[stage.dofs.tolist()]
        size = np.maximum(np.abs(stage.forces.at(self.start[0] * self.reference)).max(), 1e-300)
        for s, law in stage.laws.items():
            points = self.system.sets[s]
            states[s] = self.points(s, self.system.laws[law], law, du, stage, step, base.get(s))
            back = weighted_transpose(points)[stage.dofs]
            force = force - self.sparse(back) @ states[s].stress
            reach = abs(back).sum(axis=1).max() * self.stress_size[s] if stage.dofs.size else 0.0
            size = max(size, float(reach))
        self.equations.append(force / size)
        return du, states

    def points(
        self,
        s: int,
        law: PointLaw,
        number: int,
        du: Expression,
        stage: LoadStage,
        step: ElasticStep,
        base: _SetState | None,
    ) -> _SetState:
        """Law and complementarity of one point set; its stress, Pa, and multipliers."""
        points, size = self.system.sets[s], self.stress_size[s]
        m, y = points.n_points, law.n_planes
        stress = self.variable("s", step.stress[s][..., 0].ravel() / size) * size
        strain = self.sparse(points.compatibility[:, stage.dofs]) @ du * self.length
        before, lam = self._before(s, stage, base, y * m)
        if y:
            unit = np.repeat(self._multiplier_sizes(law, number, size), m)
            dlam = self.variable("l", np.zeros(y * m))
            lam = lam + dlam * unit
            strain = strain - self.kron(law.normals.T, m) @ (dlam * unit)
            slack = self._slack(law, m, stress, lam)
            self.equations.append(self._smoothed(slack / size, dlam))
        change = stress - before - self._elastic(law.elasticity, m, strain)
        self.equations.append(change / size)
        return _SetState(stress, lam)

    def objective(self, readings: Expression) -> Expression:
        """Phi with the priors' part."""
        r = (readings - self.problem.measured) / self.problem.sd
        total = self.ca.sum1(_loss(self.ca, self.problem.loss, r))
        for i, q in enumerate(self.problem.parameters):
            if q.prior is not None and q.prior.kind == "normal":
                total += ((self.p[i] - q.prior.mean) / q.prior.sd) ** 2
            elif q.prior is not None:
                ratio = self.ca.log(self.p[i] / q.prior.mean)
                total += (ratio * q.prior.mean / q.prior.sd) ** 2
        return total

    def variable(
        self, name: str, start: Floats, lower: Floats | None = None, upper: Floats | None = None
    ) -> Expression:
        """A block of variables of the order of one."""
        block = self.ca.SX.sym(name, len(start))
        free = np.full(len(start), np.inf)
        self.variables.append(block)
        self.bounds.append((-free if lower is None else lower, free if upper is None else upper))
        self.start.append(start)
        return block

    def affine(self, array: Affine) -> Expression:
        """A vector that is affine in the parameters."""
        value = self.ca.DM(array.constant)
        return value + self.ca.sparsify(self.ca.DM(array.slopes)) @ self.p

    def sparse(self, matrix: Any) -> Expression:
        """A scipy matrix as casadi keeps it."""
        return self.ca.DM(matrix.tocsc())

    def kron(self, small: Floats, m: int) -> Expression:
        """Small (x) 1_m: a small matrix at each of m points, component by component."""
        return self.ca.kron(self.ca.sparsify(self.ca.DM(small)), self.ca.DM.eye(m))

    def _elastic(self, law: Affine, m: int, strain: Expression) -> Expression:
        total = self.kron(law.constant, m) @ strain
        for h in np.flatnonzero(law.depends_on):
            total += self.p[int(h)] * (self.kron(law.slopes[..., h], m) @ strain)
        return total

    def _slack(self, law: PointLaw, m: int, stress: Expression, lam: Expression) -> Expression:
        slack = self.kron(np.eye(law.n_planes), m) @ self.ca.kron(
            self.affine(law.distances), self.ca.DM.ones(m, 1)
        )
        slack -= self.kron(law.normals, m) @ stress
        if np.any(law.hardening.constant):
            slack += self.kron(law.hardening.constant, m) @ lam
        for h in np.flatnonzero(law.hardening.depends_on):
            slack += self.p[int(h)] * (self.kron(law.hardening.slopes[..., h], m) @ lam)
        return slack

    def _smoothed(self, a: Expression, b: Expression) -> Expression:
        return a + b - self.ca.sqrt(a**2 + b**2 + 2.0 * self.mu)

    def _before(
        self, s: int, stage: LoadStage, base: _SetState | None, size: int
    ) -> tuple[Expression, Expression]:
        """Stress and multipliers at the beginning of the stage."""
        points = self.system.sets[s]
        none = self.ca.DM.zeros(size, 1)
        if s in stage.fresh or (base is None and stage.base >= 0):
            return self.ca.DM.zeros(points.n_strain * points.n_points, 1), none
        if base is None:
            initial, n = points.initial, len(self.system.names)
            return self.affine(
                Affine(initial.constant.ravel(), initial.slopes.reshape(-1, n))
            ), none
        return base.stress, base.multipliers if base.multipliers.numel() == size else none

    def _multiplier_sizes(self, law: PointLaw, number: int, size: float) -> Floats:
        """(y,) L of the module's head."""
        n = law.normals
        return np.asarray(size / np.einsum("yi,ij,yj->y", n, self.moduli[number], n))

    def _elastic_answer(self, p: Floats) -> list[ElasticStep]:
        system = self.system
        return list(
            elastic_march(
                system,
                [law.elasticity.at(p) for law in system.laws],
                initial={s: q.initial.at(p)[..., None] for s, q in enumerate(system.sets)},
                forces=[stage.forces.at(p)[:, None] for stage in system.stages],
            )
        )

    def _stress_sizes(self) -> Floats:
        """(n_sets,) the largest elastic stress of each point set, Pa."""
        size = np.zeros(len(self.system.sets))
        for step in self.steps:
            for s, stress in step.stress.items():
                size[s] = max(size[s], float(np.abs(stress).max(initial=0.0)))
        return np.asarray(np.where(size > 0.0, size, size.max(initial=0.0) or 1.0))


def _size(parameter: Parameter) -> float:
    """A value of the order of the parameter, SI."""
    width = parameter.upper - parameter.lower
    size = abs(parameter.start)
    return max(size, 0.1 * width) if np.isfinite(width) and width > 0.0 else size or 1.0


def _loss(ca: Any, options: LossOptions, r: Expression) -> Expression:
    """rho(r), the formulas of `loss`."""
    match options:
        case HuberOptions(delta):
            tail = 2.0 * delta * ca.fabs(r) - delta**2
            return ca.if_else(ca.fabs(r) <= delta, r**2, tail)
        case StudentOptions(nu):
            return (nu + 1.0) * ca.log1p(r**2 / nu)
        case _:
            return r**2
