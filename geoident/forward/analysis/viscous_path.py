"""Equilibrium with non-associated flow: along a path of viscous grounds (theory 5.4).

With a dilation below the friction, perfectly plastic ground is not elliptic any more: tangents at
the diffuse flow have eigenvalues around zero, the more of them the finer the mesh, and Newton's
steps are lost among bands of shear. A ground that keeps a part mu of its overstress,

    sigma = P(s*) + mu (s* - P(s*))

(a step of Duvaut and Lions' viscoplasticity, mu = relaxation time / (time + relaxation time)), is
elliptic again from a few percent on: its tangent is (1 - mu) T + mu. So the equations are solved
for mu = 0.1 and then for less and less, every start extrapolated in mu from the last two, down to
mu = 0. Where a step in mu is not found, a shorter one is tried, short of a turn of the path; at the
turn the path ends (`balanced_overstress`). Newton's steps are held by the natural monotonicity test
(Deuflhard 2004, Newton Methods for Nonlinear Problems, 3.3): the next step, made with the same
factor, must be shorter. Unlike the residual, that does not mind how badly the tangent is
conditioned; it does not ask for positive eigenvalues either, so diffuse flow is found also where it
is not stable. Where interfaces slip all along no share of a step passes it (`_followed`).

A load beyond the limit shows in the displacements: they grow like 1 / mu.

Where the ground goes into bands, the path is lost near one mu whatever the steps. So a search has
a number of Newton steps (`StepBudget`) and ends with what it has; counted, so that it ends at the
same place on every machine.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from geoident.fem.solvers.direct import NotPositiveDefinite
from geoident.forward.analysis.line_search import zero_along
from geoident.forward.analysis.stage_equations import (
    Balance,
    Iterate,
    NoEquilibrium,
    StageEquations,
    Tangent,
)
from geoident.model.arrays import Floats

BALANCED = 1e-11
"""Out-of-balance force, relative to the forces at work, that counts as equilibrium."""

KNOWN = 1e-13
"""The same of a start: what near parameters led to is less exact than it is balanced."""

NO_LOWER = 1e-8
"""The same where no step lowers it any more: what is left is rounding."""

_ON_THE_PATH = 1e-8
"""Out-of-balance force that is enough where mu is not zero: it is only a start for the next."""

_FIRST = (0.1, 0.025, 0.0125)
"""mu of viscous grounds that are reached first: where the equations are mostly elliptic."""

_RATIO = 0.15
"""Of the next mu to the last: a larger ratio needs more points and saves few steps at each."""

_LAST = 1e-7
"""mu below which the next one is zero."""

_POWERS = (1.0, 0.5, 0.25)
"""Powers of the ratio that are tried in turn, short of a turn of the path."""

_MOST_STEPS = 14
"""Newton steps at one mu; ten are usual where there is an equilibrium."""

_SHORTEST = 0.02
"""Share of a step below which Newton's method is given up."""

_RUNS_AWAY = 0.7
"""Power of 1 / mu with which displacements of a collapse grow at least."""

_OFTEN = 2
"""Points of the path in a row at which displacements must grow so fast to count as a collapse."""

_FASTER = 4.0
"""Times the last share of a step that the next one may be."""

_SHORTENED = 0.25
"""Part of its share by which a step must shorten the next one (natural monotonicity test)."""


@dataclass
class StepBudget:
    """Newton steps that a search may take; each is a factorization.

    Args:
        left: number of them.
    """

    left: int

    def take(self) -> bool:
        """Take one, if there is one."""
        if self.left <= 0:
            return False
        self.left -= 1
        return True


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
    start: Iterate,
    budget: StepBudget,
    *,
    balanced: float = BALANCED,
    at_start: float = 1.0,
    most: int = _MOST_STEPS,
) -> Balance:
    """Newton's method under the natural monotonicity test.

    Args:
        equations: of the stage.
        start: first displacements.
        budget: steps that are left to the whole search, less those taken here.
        balanced: out-of-balance force that is enough.
        at_start: the same of the start, where it is less.
        most: steps at most.
    """
    iterate, tangent = start, None
    share = 1.0
    for _ in range(most):
        if iterate.imbalance <= (min(at_start, balanced) if tangent is None else balanced):
            if tangent is not None and tangent.consistent:
                # Eigenvalues are small: balance to 1e-11 leaves displacements a millionth off.
                last = _moved(equations, iterate, tangent.solve(iterate.residual))
                iterate = (
                    last if last is not None and last.imbalance < iterate.imbalance else iterate
                )
            return Balance(iterate, tangent, viscosity=equations.viscosity)
        if not budget.take():
            break
        try:
            tangent = equations.tangent(iterate)
        except NotPositiveDefinite:
            return Balance(iterate, converged=False, viscosity=equations.viscosity)
        d = tangent.solve(iterate.residual)
        length, share, following = equations.length(d), min(1.0, _FASTER * share), None
        while share > _SHORTEST:
            following = _moved(equations, iterate, share * d)
            if following is not None:
                ahead = equations.length(tangent.solve(following.residual))
                if ahead <= (1.0 - _SHORTENED * share) * length:
                    break
            share, following = 0.5 * share, None
        near = iterate.imbalance <= NO_LOWER
        if following is None and equations.structures_flow_aside and not near:
            following, share = _followed(equations, iterate, tangent, d), 1.0
        if following is None or (following.imbalance >= iterate.imbalance and near):
            return Balance(iterate, tangent, converged=near, viscosity=equations.viscosity)
        iterate = following
    return Balance(iterate, tangent, iterate.imbalance <= balanced, equations.viscosity)


def _followed(
    equations: StageEquations, iterate: Iterate, tangent: Tangent, d: Floats
) -> Iterate | None:
    """Where a step (n,) leads of which no share shortens the next one; None where that is away.

    Where an interface begins to slip the tangent is too stiff, and the next step as long: the step
    itself is right. Where all of it slips the tangent is all but singular: the step is a motion of
    metres, on which a point sticks, or slips the other way, after microns.
    """

    def at(share: float) -> Iterate:
        return equations.at(iterate.du + share * equations.spread(d))

    def drive(there: Iterate) -> float:
        return equations.along(d, tangent.solve(there.residual))

    try:
        end = at(1.0)
        last = drive(end)
        if last >= 0.0:
            return end if tangent.consistent else None
        return zero_along(at, drive, drive(iterate), last)
    except NoEquilibrium:
        return None


def _moved(equations: StageEquations, iterate: Iterate, d: Floats) -> Iterate | None:
    """Where a step (n,) leads; None where its stress cannot be returned."""
    try:
        return equations.at(iterate.du + equations.spread(d))
    except NoEquilibrium:
        return None


def first_points(equations: StageEquations, budget: StepBudget) -> Iterator[Balance]:
    """Equilibria of viscous grounds with which a search begins, as far as they are found.

    Args:
        equations: of the stage.
        budget: steps that are left to the whole search, less those taken here.
    """
    points: list[Balance] = []
    for mu in _FIRST:
        viscous = equations.viscous(mu)
        start = _extrapolated(points[-2:], mu) if points else 0.0 * equations.forces
        try:
            balance = newton(viscous, viscous.at(start), budget, balanced=_ON_THE_PATH)
        except NoEquilibrium:
            return
        if not balance.converged:
            return
        points.append(balance)
        yield balance


def follow_path(equations: StageEquations, first: Balance, budget: StepBudget) -> PathEnd:
    """The path from viscous ground to the ground itself, as far as it can be followed.

    Args:
        equations: of the stage.
        first: the first of `first_points`; its own steps are longer than theirs.
        budget: steps that are left to the whole search, less those taken here.
    """
    previous = last = first
    growing = 0
    while last.viscosity > 0.0:
        following = _next(equations, previous, last, budget)
        if following is None:
            return PathEnd(last, _extrapolated([previous, last], 0.0))
        previous, last = last, following
        if last.viscosity > 0.0:
            sizes = [float(np.linalg.norm(one.end.du)) for one in (previous, last)]
            ratio = previous.viscosity / last.viscosity
            growing = growing + 1 if sizes[1] > sizes[0] * ratio**_RUNS_AWAY else 0
        if growing >= _OFTEN:
            return PathEnd(last, last.end.du, last.end.du - previous.end.du)
    return PathEnd(last, last.end.du)


def _extrapolated(points: Sequence[Balance], mu: float) -> Floats:
    """Displacements (n_dofs,) at another mu, on the line through the last two."""
    previous, last = points[0], points[-1]
    if previous is last:
        return last.end.du
    slope = (last.end.du - previous.end.du) / (last.viscosity - previous.viscosity)
    return np.asarray(last.end.du + (mu - last.viscosity) * slope)


def _next(
    equations: StageEquations, previous: Balance, last: Balance, budget: StepBudget
) -> Balance | None:
    """The equilibrium at a smaller mu, from the last two; None if not found."""
    for power in _POWERS:
        mu = last.viscosity * _RATIO**power
        mu = mu if mu > _LAST else 0.0
        viscous = equations.viscous(mu)
        try:
            iterate = viscous.at(_extrapolated([previous, last], mu))
        except NoEquilibrium:
            continue
        balance = newton(viscous, iterate, budget, balanced=_ON_THE_PATH if mu > 0.0 else BALANCED)
        if balance.converged:
            return balance
    return None
