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

Each solution takes Newton steps with two right-hand sides, the tangent of viscous ground and the
field C^T V o', so it costs what a point of the path costs. The iterates are as smooth in the
parameters as those of the path; their derivatives follow from one to the next
(`plastic_derivatives`).
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from geoident.forward.analysis.stage_equations import (
    Balance,
    BalancedStep,
    NoEquilibrium,
    StageEquations,
    Tangent,
)
from geoident.forward.analysis.viscous_path import StepBudget
from geoident.model.arrays import Floats

SOUND = 0.05
"""Residual up to which motions are known by their last change, and a load counts as carried."""

_STEPS = 60
"""Newton steps in all; 20 are usual."""

_MOST_SOLUTIONS = 4
"""Fields of overstress that are balanced one after the other; the second is good to a percent."""

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
        balance = _solutions(equations, equations.viscous(factor * last.viscosity), first, budget)
        if balance is not None and (best is None or balance.residual < best.residual):
            best = balance
        if best is not None and best.residual <= SOUND:
            break
    if best is not None and best.residual > SOUND:  # the end of the path is as good a guess
        apart = np.abs(best.end.du - last.end.du).max() / np.abs(best.end.du).max()
        best = replace(best, short=max(best.short, float(apart)))
    return best


def _solutions(
    equations: StageEquations, viscous: StageEquations, first: BalancedStep, budget: StepBudget
) -> Balance | None:
    """The solutions at one viscosity; None where the first is not found."""
    steps, short = [first], 0.0
    while len(steps) <= _MOST_SOLUTIONS:
        following = _balanced(viscous, steps[-1], budget)
        if following is None:
            break
        change = np.abs(following.iterate.du - steps[-1].iterate.du).max()
        short = float(change / np.abs(following.iterate.du).max())
        steps.append(following)
        if short <= _SETTLED:
            break
    if len(steps) == 1:
        return None
    return Balance(
        steps[-1].end,
        viscosity=viscous.viscosity,
        residual=residual_of(equations, steps[-1]),
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
    equations: StageEquations, before: BalancedStep, budget: StepBudget
) -> BalancedStep | None:
    """Newton's method under the natural monotonicity test; None where it does not end."""
    system = _Bordered(equations, before.overstress)
    # The first one begins in equilibrium; later the multiple is nearly one.
    multiple = 1.0
    if before.field is None:
        multiple -= before.viscosity / equations.viscosity
    step, share = system.at(before.iterate.du, multiple), 1.0
    strain = equations.operators.strain
    for _ in range(_MOST_STEPS):
        du_strain = strain(step.iterate.du)
        scale = system.work(np.abs(step.overstress), np.abs(du_strain))
        at_rest = abs(system.work(step.left, du_strain)) <= _ON_THE_WAY * scale
        if step.iterate.imbalance <= _ON_THE_WAY and at_rest:
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
