"""Equilibrium of flow without potential: along a path of viscous grounds (theory 5.4).

With a dilation below the friction, perfectly plastic ground is not elliptic any more: tangents at
the even flow have eigenvalues around zero, the more of them the finer the mesh, and Newton's steps
are lost among bands of shear. A ground that keeps a part mu of its overstress,

    sigma = P(s*) + mu (s* - P(s*))

(a step of Duvaut and Lions' viscoplasticity, mu = relaxation time / (time + relaxation time)), is
elliptic again from a few percent on: its tangent is (1 - mu) T + mu. So the equations are solved
for mu = 0.1 and then for less and less, every start extrapolated in mu from the last two, down to
mu = 0. Where a step in mu is not found, others are tried: a shorter one short of a turn of the
path, a longer one beyond it. Newton's steps are held by the natural monotonicity test (Deuflhard
2004, Newton Methods for Nonlinear Problems, 3.3): the next step, made with the same factor, must be
shorter. Unlike the residual, that does not mind how badly the tangent is conditioned; it does not
ask for positive eigenvalues either, so the even flow is found also where it is not stable.

A load beyond the limit shows in the displacements: they grow like 1 / mu.

Where the ground goes into bands, the path is lost near one mu whatever the steps. So a search has
a number of Newton steps (`StepBudget`) and ends with the best that it has; counted, so that it ends
at the same place on every machine.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from geoident.fem.solvers.direct import Factor, NotPositiveDefinite
from geoident.forward.analysis.stage_equations import Balance, NoEquilibrium, StageEquations, Trial
from geoident.model.arrays import Floats

BALANCED = 1e-11
"""Out-of-balance force, relative to the forces at work, that counts as equilibrium."""

NO_LOWER = 1e-8
"""The same where no step lowers it any more: what is left is rounding."""

_ON_THE_PATH = 1e-8
"""Out-of-balance force that is enough where mu is not zero: it is only a start for the next."""

_FIRST = 0.1
"""mu at which the path begins: well inside of where the equations are elliptic."""

_RATIO = 0.15
"""Of the next mu to the last: larger ones make more points than each saves steps."""

_LAST = 1e-7
"""mu below which the next one is zero."""

_POWERS = (1.0, 0.5, 2.0, 0.25, 4.0)
"""Powers of the ratio that are tried in turn."""

_MOST_STEPS = 30
"""Newton steps at one mu; where it is found, ten are usual."""

_SHORTEST = 0.02
"""Share of a step below which Newton's method is given up."""

_RUNS_AWAY = 0.7
"""Power of 1 / mu with which displacements of a collapse grow at least."""

_OFTEN = 2
"""Times in a row that they must, to count as one."""


@dataclass
class StepBudget:
    """Newton steps that a search may take; each is a factorization.

    Args:
        left: number of them.
    """

    left: int

    def take(self) -> bool:
        """Take one, if there is one."""
        self.left -= 1
        return self.left >= 0


@dataclass(frozen=True)
class PathEnd:
    """Where the path of viscous grounds ended.

    Args:
        balance: the last equilibrium on it; its viscosity is mu.
        promised: (n_dofs,) displacements to which those of the last two mu lead without viscosity.
        runs_away: (n_dofs,) how displacements grow without end, or None.
    """

    balance: Balance
    promised: Floats
    runs_away: Floats | None = None


def newton(
    equations: StageEquations,
    trial: Trial,
    *,
    balanced: float = BALANCED,
    most: int = _MOST_STEPS,
    budget: StepBudget | None = None,
) -> Balance:
    """Newton's method under the natural monotonicity test.

    Args:
        equations: of the stage.
        trial: the start.
        balanced: out-of-balance force that is enough.
        most: steps at most.
        budget: steps that are left to the whole search, less those taken here; None: enough.
    """
    end = Balance(trial, None, None, converged=False)
    share = 1.0
    for _ in range(most):
        if end.trial.error <= balanced:
            return replace(_polished(equations, end), converged=True)
        if budget is not None and budget.left <= 0:
            return end
        if budget is not None:
            budget.take()
        try:
            factor, level = equations.factor(end.trial)
        except NotPositiveDefinite:
            return Balance(end.trial, None, None, converged=False)
        end = Balance(end.trial, factor, end.trial if level == 0 else None, converged=False)
        d = factor.solve(end.trial.residual[:, None])[:, 0]
        following, share = _shorter(equations, end.trial, factor, d, min(1.0, 4.0 * share))
        near = end.trial.error <= NO_LOWER
        if following is None or (following.error >= end.trial.error and near):
            return replace(end, converged=near)
        end = replace(end, trial=following)
    return replace(end, converged=end.trial.error <= balanced)


def _shorter(
    equations: StageEquations, trial: Trial, factor: Factor, d: Floats, share: float
) -> tuple[Trial | None, float]:
    """A step (n,) halved until the next one on the same factor is shorter, and its share."""
    length = float(np.linalg.norm(d))
    while share > _SHORTEST:
        following = _moved(equations, trial, share * d)
        if following is not None:
            ahead = np.linalg.norm(factor.solve(following.residual[:, None]))
            if ahead <= (1.0 - 0.25 * share) * length:
                return following, share
        share *= 0.5
    return None, share


def _polished(equations: StageEquations, end: Balance) -> Balance:
    """After one step more on the same factor, where it lowers what is left.

    Eigenvalues are small, so forces in balance to `BALANCED` leave displacements a millionth off.
    """
    if end.factor is None or end.made_at is None:
        return end
    d = end.factor.solve(end.trial.residual[:, None])[:, 0]
    following = _moved(equations, end.trial, d)
    better = following is not None and following.error < end.trial.error
    return replace(end, trial=following) if following is not None and better else end


def _moved(equations: StageEquations, trial: Trial, d: Floats) -> Trial | None:
    """Where a step (n,) leads; None beyond where flow leads back to a stress."""
    try:
        return equations.at(trial.du + equations.spread(d))
    except NoEquilibrium:
        return None


def follow_path(equations: StageEquations, budget: StepBudget | None = None) -> PathEnd | None:
    """The path from viscous ground to the ground itself, as far as it can be followed.

    Args:
        equations: of the stage.
        budget: steps that are left to the whole search, less those taken here; None: enough.

    Returns:
        Where it ends; None where not even its first point was found.
    """
    viscous = equations.viscous(_FIRST)
    start = viscous.at(0.0 * equations.forces)
    balance = newton(viscous, start, balanced=_ON_THE_PATH, budget=budget)
    if not balance.converged:
        return None
    last = replace(balance, viscosity=_FIRST)
    known, growing = [last], 0
    while last.viscosity > 0.0:
        following = _next(equations, known, budget)
        if following is None:
            return PathEnd(last, _extrapolated(known, 0.0))
        before, last = last, following
        known = [before, last]
        if last.viscosity > 0.0:
            sizes = [float(np.linalg.norm(one.trial.du)) for one in known]
            ratio = before.viscosity / last.viscosity
            growing = growing + 1 if sizes[1] > sizes[0] * ratio**_RUNS_AWAY else 0
        if growing >= _OFTEN:
            return PathEnd(last, last.trial.du, last.trial.du - before.trial.du)
    return PathEnd(last, last.trial.du)


def _extrapolated(known: list[Balance], mu: float) -> Floats:
    """Displacements (n_dofs,) at another mu, from what is known of the last one or two."""
    last = known[-1]
    if len(known) == 1:
        return last.trial.du
    slope = (last.trial.du - known[0].trial.du) / (last.viscosity - known[0].viscosity)
    return np.asarray(last.trial.du + (mu - last.viscosity) * slope)


def _next(
    equations: StageEquations, known: list[Balance], budget: StepBudget | None
) -> Balance | None:
    """The equilibrium at a smaller mu, from what the last two say; None if not found."""
    for power in _POWERS:
        if budget is not None and budget.left <= 0:
            return None
        mu = known[-1].viscosity * _RATIO**power
        mu = mu if mu > _LAST else 0.0
        viscous = equations.viscous(mu)
        try:
            trial = viscous.at(_extrapolated(known, mu))
        except NoEquilibrium:
            continue
        balanced = _ON_THE_PATH if mu > 0.0 else BALANCED
        balance = newton(viscous, trial, balanced=balanced, budget=budget)
        if balance.converged:
            return replace(balance, viscosity=mu)
    return None
