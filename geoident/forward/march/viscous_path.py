"""Equilibrium of flow without potential: along a path of viscous grounds (theory 5.4).

With a dilation below the friction, perfectly plastic ground is not elliptic any more: tangents at
the even flow have eigenvalues around zero, the more of them the finer the mesh, and Newton's steps
are lost among bands of shear. A ground that keeps a part mu of its overstress,

    sigma = P(s*) + mu (s* - P(s*))

(a step of Duvaut and Lions' viscoplasticity, mu = relaxation time / (time + relaxation time)), is
elliptic again from a few percent on: its tangent is (1 - mu) T + mu. So the equations are solved
for mu = 0.1 and then for less and less, every start extrapolated in mu from the last two, down to
mu = 0. Newton's steps are held by the natural monotonicity test (Deuflhard 2004, Newton
Methods for Nonlinear Problems, 3.3): the next step, made with the same factor, must be shorter.
Unlike the residual, that does not mind how badly the tangent is conditioned; it does not ask for
positive eigenvalues either, so the even flow is found also where it is not stable.

A load beyond the limit shows in the displacements: they grow like 1 / mu.

Where the ground goes into bands, every way is lost near the same mu, and each next start, ratio and
part of the load would be lost there again. So a search has a number of steps (`Effort`) and ends
with the best that it has; counted, so that it ends at the same place on every machine.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from geoident.fem.solvers.direct import Factor, NotPositiveDefinite
from geoident.forward.march.stage_equations import NoEquilibrium, StageEquations, Trial
from geoident.model.arrays import Floats

BALANCED = 1e-11
"""Out-of-balance force, relative to the forces at work, that counts as equilibrium."""

ROUNDING = 1e-8
"""The same where no step lowers it any more."""

_LAST = 1e-7
"""mu below which the next one is zero."""

_ON_THE_WAY = 1e-8
"""Out-of-balance force that is enough where mu is not zero."""

_POWERS = (1.0, 0.5, 2.0, 0.25, 4.0)
"""Of the ratio of a way, tried in turn: short of a place where the path turns, or beyond it."""

_MOST_STEPS = 30
"""Newton steps at one mu."""

_PATIENCE = 8
"""Steps after which a bold way is given up if the error has not come down by half."""

_SHORTEST = 0.02
"""Share of a step below which Newton's method is given up."""

_SHORTEST_BOLD = 0.05
"""The same on the bold way."""

_RUNS_AWAY = 0.7
"""Power of 1 / mu with which displacements of a collapse grow at least."""

_OFTEN = 2
"""Times in a row that they must, to count as one."""


@dataclass
class Effort:
    """Newton steps that a search may take; each is a factorization.

    Args:
        left: number of them.
    """

    left: int

    @property
    def spent(self) -> bool:
        """Whether none is left."""
        return self.left <= 0

    def take(self) -> bool:
        """Take one, if there is one."""
        self.left -= 1
        return self.left >= 0


@dataclass(frozen=True)
class NewtonEnd:
    """Where Newton's method ended.

    Args:
        trial: displacements, stresses, flow.
        steps: taken.
        factor: of the tangent before the last step, or None if none was made.
        made_at: where it was made, None where a part of the elastic stiffness was left in it.
        converged: whether it is in equilibrium.
    """

    trial: Trial
    steps: int
    factor: Factor | None
    made_at: Trial | None
    converged: bool


@dataclass(frozen=True)
class Way:
    """How the path is followed.

    Args:
        first: mu at which it begins: well inside of where the equations are elliptic.
        ratio: of the next mu to the last.
        bold: how Newton's method goes (`newton`).
    """

    first: float
    ratio: float
    bold: bool


WAYS = (Way(0.1, 0.15, bold=False), Way(0.05, 0.3, bold=False), Way(0.1, 0.5, bold=True))
"""Tried in turn: where one is lost at a turn of the path, the next mostly steps over it."""


@dataclass(frozen=True)
class PathEnd:
    """Where the path of viscous grounds ended.

    Args:
        found: the last equilibrium on it.
        mu: the part of the overstress that is kept there; 0: it is that of the ground itself.
        ahead: (n_dofs,) displacements that those of the last two mu promise for none.
        runs_away: (n_dofs,) how displacements grow without end, or None.
    """

    found: NewtonEnd
    mu: float
    ahead: Floats
    runs_away: Floats | None = None


def newton(
    equations: StageEquations,
    trial: Trial,
    *,
    balanced: float = BALANCED,
    most: int = _MOST_STEPS,
    bold: bool = False,
    effort: Effort | None = None,
) -> NewtonEnd:
    """Newton's method under the natural monotonicity test, or boldly.

    Args:
        equations: of the stage.
        trial: the start.
        balanced: out-of-balance force that is enough.
        most: steps at most.
        bold: lower the residual instead, or take the step of the least harm and go on.
        effort: steps that are left to the whole search, less those taken here; None: enough.
    """
    factor: Factor | None = None
    made_at: Trial | None = None
    share, reached = 1.0, (0, np.inf)
    for step in range(most):
        if trial.error <= balanced:
            if factor is not None and made_at is not None:
                trial = _polished(equations, trial, factor)
            return NewtonEnd(trial, step, factor, made_at, converged=True)
        if trial.error < 0.5 * reached[1]:
            reached = step, trial.error
        if effort is not None and not effort.take():
            return NewtonEnd(trial, step, factor, made_at, converged=False)
        try:
            factor, level = equations.factor(trial)
        except NotPositiveDefinite:
            return NewtonEnd(trial, step, None, None, converged=False)
        made_at = trial if level == 0 else None
        d = factor.solve(trial.residual[:, None])[:, 0]
        if bold:
            following = _least_harm(equations, trial, d)
        else:
            following, share = _shorter(equations, trial, factor, d, min(1.0, 4.0 * share))
        if following is None or (following.error >= trial.error and trial.error <= ROUNDING):
            return NewtonEnd(trial, step + 1, factor, made_at, converged=trial.error <= ROUNDING)
        trial = following
        if bold and step - reached[0] > _PATIENCE:
            break
    return NewtonEnd(trial, most, factor, made_at, converged=trial.error <= balanced)


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


def _least_harm(equations: StageEquations, trial: Trial, d: Floats) -> Trial | None:
    """A step (n,) halved until the residual is smaller, else where it was smallest."""
    before = float(np.linalg.norm(trial.residual))
    tried, share = [], 1.0
    while share > _SHORTEST_BOLD:
        following = _moved(equations, trial, share * d)
        if following is not None:
            if np.linalg.norm(following.residual) < (1.0 - 1e-4 * share) * before:
                return following
            tried.append(following)
        share *= 0.5
    return min(tried, key=lambda one: one.error, default=None)


def _polished(equations: StageEquations, trial: Trial, factor: Factor) -> Trial:
    """One step more on the same factor, where it lowers what is left.

    Eigenvalues are small, so forces in balance to `BALANCED` leave displacements a millionth off.
    """
    following = _moved(equations, trial, factor.solve(trial.residual[:, None])[:, 0])
    return following if following is not None and following.error < trial.error else trial


def _moved(equations: StageEquations, trial: Trial, d: Floats) -> Trial | None:
    """Where a step (n,) leads; None beyond where flow leads back to a stress."""
    try:
        return equations.at(trial.du + equations.spread(d))
    except NoEquilibrium:
        return None


def follow(equations: StageEquations, way: Way, effort: Effort | None = None) -> PathEnd | None:
    """The path from viscous ground to the ground itself, as far as it can be followed.

    Args:
        equations: of the stage.
        way: how.
        effort: steps that are left to the whole search, less those taken here; None: enough.

    Returns:
        Where it ends; None where not even its first point was found.
    """
    mu = way.first
    viscous = equations.viscous(mu)
    found = newton(
        viscous,
        viscous.at(0.0 * equations.forces),
        balanced=_ON_THE_WAY,
        bold=way.bold,
        effort=effort,
    )
    if not found.converged:
        return None
    known, growing = [(mu, found.trial.du)], 0
    while mu > 0.0:
        following, ahead = _next(equations, known, way, effort)
        if ahead is None:
            return PathEnd(found, mu, _extrapolated(known, 0.0))
        change = ahead.trial.du - found.trial.du
        if following > 0.0:
            sizes = [float(np.linalg.norm(du)) for du in (found.trial.du, ahead.trial.du)]
            grows = sizes[1] > sizes[0] * (mu / following) ** _RUNS_AWAY
            growing = growing + 1 if grows else 0
        mu, found = following, ahead
        known = [known[-1], (mu, found.trial.du)]
        if growing >= _OFTEN:
            return PathEnd(found, mu, found.trial.du, change)
    return PathEnd(found, 0.0, found.trial.du)


def _extrapolated(known: list[tuple[float, Floats]], mu: float) -> Floats:
    """Displacements (n_dofs,) at another mu, from what is known of the last one or two."""
    last, du = known[-1]
    if len(known) == 1:
        return du
    before, first = known[0]
    return du + (mu - last) / (last - before) * (du - first)


def _next(
    equations: StageEquations,
    known: list[tuple[float, Floats]],
    way: Way,
    effort: Effort | None,
) -> tuple[float, NewtonEnd | None]:
    """A smaller mu, and the equilibrium there, from what the last two say; None if not found."""
    last = mu = known[-1][0]
    for power in _POWERS:
        if effort is not None and effort.spent:
            break
        mu = last * way.ratio**power
        mu = mu if mu > _LAST else 0.0
        viscous = equations.viscous(mu)
        try:
            trial = viscous.at(_extrapolated(known, mu))
        except NoEquilibrium:
            continue
        balanced = _ON_THE_WAY if mu > 0.0 else BALANCED
        found = newton(viscous, trial, balanced=balanced, bold=way.bold, effort=effort)
        if found.converged:
            return mu, found
    return mu, None
