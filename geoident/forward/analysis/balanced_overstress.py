"""Diffuse flow where the path of viscous grounds ends: its overstress is balanced (theory 5.4).

Ground that keeps a part mu of its overstress o = s* - P(s*) has stable flow, but it moves too
little: the overstress carries a part of the load. So a multiple t of a known field o' of overstress
is taken off again,

    sigma = P(s*) + mu (o - t o') ,      r = f - C^T V sigma = 0 ,
    integral of (o - t o')^T C du = 0 ,

where t is such that what is left does no work on the motion: in the mean the ground carries no
more than its strength. o' is the overstress of the solution before, at first that of the path's
end, and its shape soon stands still. What is left of the overstress then, mu (o - t o'), has no
mean; it only keeps shear from going into bands as wide as the elements, and is reported as a
residual.

Where the path ends, and which of several equilibria without viscosity Newton's method ends at,
changes from one parameter vector to the next. So overstress is balanced at given viscosities first
(`diffuse_flow`), in a given number of solutions: from there Newton's method leads to one and the
same equilibrium, and where it leads to none the last solution is a smooth function of the
parameters. Only where that fails is it balanced where the path ends (`balance_overstress`).

Each solution takes Newton steps with two right-hand sides, the tangent of viscous ground and the
field C^T V o', so it costs what a point of the path costs. The iterates are as smooth in the
parameters as those of the path; their derivatives follow from one to the next
(`plastic_derivatives`).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from geoident.forward.analysis.stage_equations import (
    Balance,
    BalancedStep,
    NoEquilibrium,
    StageEquations,
    Tangent,
)
from geoident.forward.analysis.viscous_path import KNOWN, StepBudget, newton
from geoident.model.arrays import Floats

SOUND = 0.05
"""Residual up to which motions are known by their last change, and a load counts as carried."""

ROUGH = 0.15
"""Residual up to which the flow is taken that is balanced at a given viscosity."""

_STEPS = 60
"""Newton steps in all; 20 are usual."""

_MOST_SOLUTIONS = 4
"""Fields of overstress that are balanced one after the other; the second is good to a percent."""

_FIELDS = 3
"""The same at a given viscosity: always as many, so that the last solution is a smooth function of
the parameters; with more of them modes that are not stable would grow."""

_STANDS = 0.05
"""Change of the displacements in the last of these above which they lead nowhere."""

_EXACT_STEPS = 10
"""Newton steps from a balanced solution to the equilibrium without viscosity; six are usual."""

_SETTLED = 0.01
"""Change of the displacements, of the largest, from which on the shape stands still."""

_MOST_STEPS = 14
"""Newton steps for one solution; five are usual."""

_SHORTEST = 0.02
"""Share of a step below which Newton's method is given up."""

_ON_THE_WAY = 1e-9
"""Out-of-balance force, and work of the overstress that is left, that count as none."""

_VISCOUS = (1.0, 2.0, 4.0, 8.0, 16.0)
"""Multiples of mu at the path's end that are tried in turn, up to `_MOST_VISCOUS`."""

_MOST_VISCOUS = 0.2


def diffuse_flow(equations: StageEquations, viscous: Balance, budget: StepBudget) -> Balance | None:
    """The equilibrium near the flow of viscous ground whose overstress is balanced.

    Args:
        equations: of the stage, without viscosity.
        viscous: the equilibrium of viscous ground.
        budget: steps that are left to the whole search, less those taken here.

    Returns:
        That without viscosity where it is found, else what is balanced; None where nothing is, or
        where displacements still change.
    """
    mu = viscous.viscosity
    steps, at_mu = [BalancedStep(viscous.end, mu)], equations.viscous(mu)
    if not steps[0].overstress.any():
        return None
    for field in range(_FIELDS):
        following = _balanced(at_mu, steps[-1], budget)
        if following is None:
            return None
        steps.append(following)
        if field:
            start = equations.at(following.iterate.du)
            end = newton(equations, start, budget, most=_EXACT_STEPS)
            if end.converged:
                return end
    balance = _as_balance(equations, steps, viscous)
    return balance if _change(steps) <= _STANDS else None


@dataclass(frozen=True)
class KnownFlow:
    """A solution with balanced overstress at parameters near by, where Newton's method begins.

    Args:
        viscosity: mu.
        du: (n_dofs,) displacement step.
        multiple: t.
    """

    viscosity: float
    du: Floats
    multiple: float


def balance_again(equations: StageEquations, known: Sequence[KnownFlow]) -> Balance | None:
    """The flow that is balanced as at parameters near by: of as many fields, at their viscosities.

    Args:
        equations: of the stage, without viscosity.
        known: the viscous ground's equilibrium near by, and the solutions that followed.

    Returns:
        None where nothing is known or found, or the residual is above `ROUGH`.
    """
    steps, budget = list[BalancedStep](), StepBudget(_STEPS)
    try:
        for one in known:
            viscous = equations.viscous(one.viscosity)
            if steps:
                step = _balanced(viscous, steps[-1], budget, one)
                if step is None:
                    return None
                steps.append(step)
                continue
            first = newton(viscous, viscous.at(one.du), budget, balanced=_ON_THE_WAY)
            if not first.converged:
                return None
            steps.append(BalancedStep(first.end, one.viscosity))
    except NoEquilibrium:
        return None
    balance = _as_balance(equations, steps, first) if steps else None
    return balance if balance is not None and balance.residual <= ROUGH else None


def _change(steps: list[BalancedStep]) -> float:
    """By how much displacements changed in the last solution, of the largest."""
    before, last = (step.iterate.du for step in steps[-2:])
    return float(np.abs(last - before).max() / np.abs(last).max())


def balance_overstress(equations: StageEquations, last: Balance) -> Balance | None:
    """The diffuse flow near the end of a path of viscous grounds; None if not found.

    Args:
        equations: of the stage, without viscosity.
        last: the last equilibrium on the path.
    """
    budget, best = StepBudget(_STEPS), None
    first = BalancedStep(last.end, last.viscosity)
    if not first.overstress.any():
        return None
    for factor in _VISCOUS:
        if factor > 1.0 and factor * last.viscosity > _MOST_VISCOUS:
            break
        viscous = equations.viscous(factor * last.viscosity)
        balance = _solutions(equations, viscous, first, budget, last)
        if balance is not None and (best is None or balance.residual < best.residual):
            best = balance
        if best is not None and best.residual <= SOUND:
            break
    return best


def _solutions(
    equations: StageEquations,
    viscous: StageEquations,
    first: BalancedStep,
    budget: StepBudget,
    path_end: Balance,
) -> Balance | None:
    """The solutions at one viscosity; None where the first is not found."""
    steps = [first]
    while len(steps) <= _MOST_SOLUTIONS:
        following = _balanced(viscous, steps[-1], budget)
        if following is None:
            break
        steps.append(following)
        if _change(steps) <= _SETTLED:
            break
    return _as_balance(equations, steps, path_end) if len(steps) > 1 else None


def _as_balance(equations: StageEquations, steps: list[BalancedStep], on_path: Balance) -> Balance:
    """The last of two or more solutions, with what it lacks.

    Args:
        equations: of the stage.
        steps: the solutions.
        on_path: where they begin; where much is left of the overstress it is as good a guess.
    """
    residual, short = residual_of(equations, steps[-1]), _change(steps)
    if residual > SOUND:
        du = steps[-1].iterate.du
        short = max(short, float(np.abs(du - on_path.end.du).max() / np.abs(du).max()))
    return Balance(
        steps[-1].end,
        viscosity=steps[-1].viscosity,
        residual=residual,
        short=short,
        steps=tuple(steps),
    )


def unbalanced(equations: StageEquations, last: Balance, promised: Floats) -> Balance:
    """The last equilibrium of a path of viscous grounds as it is, with what it lacks.

    Args:
        equations: of the stage.
        last: the equilibrium.
        promised: (n_dofs,) displacements to which the path leads without viscosity.
    """
    short = np.abs(promised - last.end.du).max() / (np.abs(promised).max() or 1.0)
    residual = residual_of(equations, BalancedStep(last.end, last.viscosity))
    return replace(last, tangent=None, residual=residual, short=float(short))


class _Bordered:
    """The equations in u and t, with a field of overstress and its forces.

    Args:
        equations: of viscous ground, under the loads of the stage.
        field: o' (s, m), Pa.
    """

    def __init__(self, equations: StageEquations, field: Floats) -> None:
        self.equations, self.field = equations, field
        mu = equations.viscosity
        self.forces = mu * equations.operators.forces(field, equations.volume)

    def at(self, du: Floats, multiple: float) -> BalancedStep:
        """The step at displacements (n_dofs,) and t.

        Raises:
            NoEquilibrium: non-associated flow leads back to no stress.
        """
        loaded = self.equations.under(self.equations.forces + multiple * self.forces)
        return BalancedStep(loaded.at(du), self.equations.viscosity, multiple, self.field)

    def work(self, stress: Floats, strain: Floats) -> float:
        """Work of a stress (s, m) on strains (s, m), J."""
        return float((stress * strain).sum(axis=0) @ self.equations.volume)

    def correction(self, step: BalancedStep, tangent: Tangent) -> tuple[Floats, float]:
        """Newton's step (n_dofs,) in u, and that in t, with a tangent that was made nearby.

        Raises:
            NoEquilibrium: the field does no work.
        """
        equations = self.equations
        strain = equations.operators.strain(step.iterate.du)
        right = np.column_stack([step.iterate.residual, self.forces[equations.dofs]])
        free, along = tangent.factor.solve(right).T
        ways = [equations.spread(free), equations.spread(along)]
        by_free, by_along = (self._work_by(step, tangent, strain, way) for way in ways)
        by_multiple = by_along - self.work(self.field, strain)
        if not by_multiple:
            raise NoEquilibrium(None)
        more = -(self.work(step.left, strain) + by_free) / by_multiple
        return ways[0] + more * ways[1], more

    def _work_by(self, step: BalancedStep, tangent: Tangent, strain: Floats, way: Floats) -> float:
        """What displacements (n_dofs,) more change in the work of what is left."""
        more = self.equations.operators.strain(way)
        # V do = V (1 - T) E C d, of which the tangent has minus its part 1 - mu
        kept = self.equations.of_ground[tangent.points]
        points, change = tangent.points[kept], tangent.change[kept]
        of_overstress = -np.einsum("qst,tq,sq->", change, more[:, points], strain[:, points])
        of_overstress /= 1.0 - self.equations.viscosity
        return self.work(step.left, more) + float(of_overstress)


def _balanced(
    equations: StageEquations,
    before: BalancedStep,
    budget: StepBudget,
    start: KnownFlow | None = None,
) -> BalancedStep | None:
    """Newton's method under the natural monotonicity test; None where it does not end.

    Without a start it begins with the solution before.
    """
    system = _Bordered(equations, before.overstress)
    # The first one begins in equilibrium; later the multiple is nearly one.
    du, multiple = before.iterate.du, 1.0
    if start is not None:
        du, multiple = start.du, start.multiple
    elif before.field is None:
        multiple -= before.viscosity / equations.viscosity
    step, share = system.at(du, multiple), 1.0
    strain = equations.operators.strain
    for taken in range(_MOST_STEPS):
        du_strain = strain(step.iterate.du)
        scale = system.work(np.abs(step.overstress), np.abs(du_strain))
        at_rest = abs(system.work(step.left, du_strain)) <= _ON_THE_WAY * scale
        known = start is not None and not taken
        if step.iterate.imbalance <= (KNOWN if known else _ON_THE_WAY) and at_rest:
            return step
        if not budget.take():
            return None
        tangent = equations.tangent(step.iterate)
        try:
            way, more = system.correction(step, tangent)
        except NoEquilibrium:
            return None
        length, share, following = float(np.linalg.norm(way)), min(1.0, 4.0 * share), None
        while share > _SHORTEST:
            try:
                following = system.at(step.iterate.du + share * way, step.multiple + share * more)
                ahead, _ = system.correction(following, tangent)
                if float(np.linalg.norm(ahead)) <= (1.0 - 0.25 * share) * length:
                    break
            except NoEquilibrium:
                pass
            share, following = 0.5 * share, None
        if following is None:
            return None
        step = following
    return None


def residual_of(equations: StageEquations, step: BalancedStep) -> float:
    """The part of the change of load of a stage that stress beyond the yield surface carries.

    It is the largest unbalanced force if that stress were taken back to the surface, of the largest
    at the beginning of the stage.

    Args:
        equations: of the stage.
        step: its end.
    """
    change = np.abs(equations.at(np.zeros_like(equations.forces)).residual).max()
    forces = equations.operators.forces(step.left, equations.volume)[equations.dofs]
    return float(step.viscosity * np.abs(forces).max() / (change or 1.0))
