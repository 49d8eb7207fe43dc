"""Equilibrium of one stage with yielding points: a semismooth Newton method (theory 5).

The displacements du of a stage minimise

    Pi(du) = sum_i V_i w(sigma_old + E C du)_i  -  f^T du ,

where w is half the square of the elastic trial stress less that of its distance to the yield
surface, in the norm of E^-1. Pi is convex and once differentiable; with the projection P

    r = -grad Pi = f - C^T V P(sigma_old + E C du) = 0 .

Newton's method takes the consistent tangent K_T = C^T V T E C as derivative of P. Polyhedra make P
piecewise linear, so it ends, exactly, once the pieces are found; along each step the slope of Pi
is followed to near its zero, which makes it converge from everywhere. Where K_T is singular, a
little of the elastic stiffness is left in it.

In a large model a few places, corners mostly, are far from equilibrium long after all else is near:
a step that is right for the ground around is then far too long there. So the worst places after a
step are brought to equilibrium by themselves, all else kept (`fem.patches`): nonlinear elimination
(Lanzkron, Rose & Wilkes 1996, SIAM J. Sci. Comput. 17, 538-559). It lowers Pi, and takes factors of
a few hundred unknowns.

Flow that is not associated has no potential; its steps are judged by the next ones, and where
they are lost a path of viscous grounds leads to the solution (`viscous_path`).

A load beyond collapse has no minimum: Pi falls without end along a mechanism d. That is found
by the slope of Pi far out along the steps (the kinematic theorem of limit analysis): if it is
still falling there, d dissipates less than the loads give, and no equilibrium exists.

Cost: one factorization for every step, one for the derivatives if the last was made elsewhere.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np

from geoident.fem.solvers.direct import Factor
from geoident.forward.march.stage_equations import (
    ELASTIC_PARTS,
    EvenFlow,
    NoEquilibrium,
    StageEquations,
    Trial,
)
from geoident.forward.march.viscous_path import (
    BALANCED,
    ROUNDING,
    WAYS,
    Effort,
    PathEnd,
    Way,
    follow,
    newton,
)
from geoident.model.arrays import Floats

MOST_STEPS = 60
"""Newton steps at most; a stage rarely takes more than fifteen."""

PATIENCE = 10
"""Newton steps after which flow without potential takes another way.

Steps that wander longer may end in bands of shear where there is an even flow.
"""

_SUSPICIOUS = 4
"""Steps after which a mechanism is looked for; fewer end most stages."""

SEARCH = 240
"""Newton steps, along all ways, that a search without potential may take: the hardest that leads to
an end takes a fifth of them on its way."""

_UNBALANCED = 0.01
"""Part of the change of load that may stay unbalanced where flow is not associated."""

_HARDLY_VISCOUS = 3e-4
"""Part of the overstress that may stay whatever else might be found."""

_LITTLE_VISCOUS = 3e-3
"""The same where all else shears in bands; by how much displacements are short then is said."""

_SAME = 2e-3
"""Relative difference of displacements that are of one flow."""

FAR_OUT = 1e6
"""Where along a step its mechanism alone decides, in steps."""

_HARDLY_RISEN = 0.3
"""Slope of Pi at the end of a step, as part of that at its beginning, that is nearly none."""

_QUICK = 0.1
"""Part of the out-of-balance force that a good step leaves."""

_WORST = (0.03, 0.1, 0.3)
"""Parts of the largest out-of-balance force from which on places are solved by themselves."""

_PATCH = 0.1
"""Part of the unknowns that they are at most."""

_PATCH_STEPS = 10
"""Newton steps there at most."""

_SETTLED = 1e-3
"""Part of the out-of-balance force that is left there."""

_STIFFER = 6
"""Level from which a tangent whose step was too long is made stiffer."""


@dataclass(frozen=True)
class Balance:
    """Equilibrium at the end of a stage.

    Args:
        trial: displacements, stresses, flow.
        steps: Newton steps taken.
        factor: of the tangent before the last step, or None if none was made.
        made_at: where it was made.
        unbalanced: part of the change of load that is left, where no more could be done.
        viscosity: part of the overstress that is kept, where the even flow ends short of none.
        short: part by which displacements are then short of those that the path promises.
    """

    trial: Trial
    steps: int
    factor: Factor | None
    made_at: Trial | None
    unbalanced: float = 0.0
    viscosity: float = 0.0
    short: float = 0.0


def solve(
    equations: StageEquations,
    guesses: Iterable[Floats],
    *,
    even_only: bool = False,
    effort: Effort | None = None,
) -> Balance:
    """The equilibrium of a stage.

    Args:
        equations: of the stage.
        guesses: (n_dofs,) displacement steps; the nearest one is the start (`distance`).
        even_only: without potential, no flow in bands of shear is looked for.
        effort: steps that are left where there is no potential; None for a search of its own.

    Raises:
        NoEquilibrium: see there.
        NotPositiveDefinite: the elastic stiffness itself is singular.
    """
    start = min((equations.at(guess) for guess in guesses), key=equations.distance)
    if equations.associated:
        return _by_potential(equations, start)
    return _without_potential(
        equations, start, WAYS[:1] if even_only else WAYS, effort or Effort(SEARCH)
    )


def _by_potential(equations: StageEquations, trial: Trial) -> Balance:
    """Newton's method along the slope of Pi, from a trial."""
    factor: Factor | None = None
    made_at: Trial | None = None
    least = 0
    for step in range(MOST_STEPS):
        if trial.error <= BALANCED:
            return Balance(trial, step, factor, made_at)
        factor, level = equations.factor(trial, least=least)
        made_at = trial if level == 0 else None
        d = equations.spread(factor.solve(trial.residual[:, None])[:, 0])
        following, share = _stepped(equations, trial, d)
        if following.error >= trial.error and trial.error <= ROUNDING:
            return Balance(trial, step + 1, factor, made_at)
        if step >= _SUSPICIOUS and share == 1.0:
            _refuse_mechanism(equations, following, d)
        least = _next_level(least, share)
        trial = following
    raise NoEquilibrium(trial.du)


def _stepped(equations: StageEquations, trial: Trial, d: Floats) -> tuple[Trial, float]:
    """Follows a step (n_dofs,), its worst places brought to equilibrium by themselves.

    Returns:
        Where it ended, and the share of the step that was made.
    """
    whole = equations.at(trial.du + d)
    quick = whole.error <= _QUICK * trial.error
    if quick or equations.patches is None or not equations.large:
        return follow_slope(equations, trial, d, whole)
    settled = _settled(equations, whole)
    if settled is not None:
        way = (settled.du - trial.du)[equations.dofs]
        slope = float(trial.residual @ way)
        if slope > 0.0 and float(settled.residual @ way) >= -_HARDLY_RISEN * slope:
            return settled, 1.0
    return follow_slope(equations, trial, d, whole)


def _settled(equations: StageEquations, trial: Trial) -> Trial | None:
    """The same with the places that are farthest from equilibrium brought there, all else kept.

    None where they are too many.
    """
    patches = equations.patches
    assert patches is not None
    rest = np.abs(trial.residual)
    worst, most = float(rest.max(initial=0.0)), int(_PATCH * rest.size)
    for part in _WORST:
        patch = patches.around(np.flatnonzero(rest > part * worst), most)
        if patch is not None:
            break
    else:
        return None
    own = equations.within(patch, patches.within(patch), trial.du)
    here = own.at(trial.du[patch.dofs])
    least = 0
    for _ in range(_PATCH_STEPS):
        if np.abs(here.residual).max() <= _SETTLED * worst:
            break
        factor, _ = own.factor(here, least=least)
        d = own.spread(factor.solve(here.residual[:, None])[:, 0])
        here, share = follow_slope(own, here, d)
        least = _next_level(least, share)
    du = trial.du.copy()
    du[patch.dofs] = here.du
    return equations.at(du)


def _without_potential(
    equations: StageEquations, start: Trial, ways: Sequence[Way], effort: Effort
) -> Balance:
    """Newton's method, and where its steps are lost, the path of viscous grounds.

    Where the even flow folds back at hardly any viscosity, that is the answer: beyond the fold
    there are only bands of shear, whose place is that of the elements.
    """
    found = newton(equations, start, most=PATIENCE, effort=effort)
    if found.converged:
        return Balance(found.trial, found.steps, found.factor, found.made_at)
    best: PathEnd | None = None
    for way in ways:
        end = follow(equations, way, effort)
        if end is None:
            continue
        if end.runs_away is not None:
            raise NoEquilibrium(end.runs_away, limit=True)
        if end.mu == 0.0:
            found = end.found
            if best is not None and _departs(found.trial.du, best):
                break
            return Balance(found.trial, found.steps, found.factor, found.made_at)
        best = end if best is None or end.mu < best.mu else best
        if best.mu <= _HARDLY_VISCOUS:
            return _nearly_even(best)
    if best is None:
        raise NoEquilibrium(found.trial.du)
    return _short_of_its_end(equations, best, only_one=len(ways) < len(WAYS))


def _short_of_its_end(equations: StageEquations, best: PathEnd, *, only_one: bool) -> Balance:
    """What is taken of a path that ends short of the ground itself.

    Args:
        equations: of the stage.
        best: the end with the least viscosity.
        only_one: not all ways were tried.

    Raises:
        NoEquilibrium: it is too far.
    """
    if only_one:
        raise NoEquilibrium(best.found.trial.du, even=EvenFlow(best.found.trial, best.mu))
    if best.mu <= _LITTLE_VISCOUS:
        return _nearly_even(best)
    return _nearly(equations, best)


def _nearly_even(end: PathEnd) -> Balance:
    """The even flow of ground that keeps hardly any of its overstress."""
    found = end.found
    short = np.abs(end.ahead - found.trial.du).max() / (np.abs(end.ahead).max() or 1.0)
    return Balance(found.trial, found.steps, None, None, viscosity=end.mu, short=float(short))


def _departs(du: Floats, even: PathEnd) -> bool:
    """Whether displacements (n_dofs,) are farther from what the even flow promises than its end.

    They are then those of another flow, in bands of shear, that a coarse way has met.
    """
    if even.mu > _LITTLE_VISCOUS:
        return False
    short, size = np.abs(even.found.trial.du - even.ahead).max(), np.abs(even.ahead).max()
    return bool(np.abs(du - even.ahead).max() > max(short, _SAME * size))


def _nearly(equations: StageEquations, end: PathEnd) -> Balance:
    """The even flow where its path turns before its end, if little of the load is left there.

    Raises:
        NoEquilibrium: it is not little.
    """
    found, at_rest = end.found, equations.at(np.zeros_like(equations.forces)).error
    even = EvenFlow(found.trial, end.mu)
    try:
        trials = [equations.at(du) for du in (found.trial.du, end.ahead)]
    except NoEquilibrium:
        raise NoEquilibrium(found.trial.du, even=even) from None
    trial = min(trials, key=lambda one: one.error)
    if trial.error > _UNBALANCED * at_rest:
        raise NoEquilibrium(found.trial.du, even=even)
    return Balance(trial, found.steps, None, None, trial.error / at_rest)


def _next_level(level: int, share: float) -> int:
    """How much of the elastic stiffness the next tangent keeps, after a share of a step."""
    if share < 0.3:
        return min(max(level + 1, _STIFFER), len(ELASTIC_PARTS) - 2)
    if share < 0.9:
        return level
    return level - 1 if level > _STIFFER else 0


def follow_slope(
    equations: StageEquations, trial: Trial, d: Floats, whole: Trial | None = None
) -> tuple[Trial, float]:
    """Follows a step to near the zero of the slope of Pi, which is monotone.

    A full step on which Pi still falls at its end, or has hardly risen, is taken as it is.

    Args:
        equations: of the stage.
        trial: where the step begins.
        d: (n_dofs,) the step.
        whole: what is at its end, if that is known.

    Returns:
        Where it ended, and the share of the step that was made.
    """
    free = d[equations.dofs]
    slope = float(trial.residual @ free)
    following = equations.at(trial.du + d) if whole is None else whole
    found = float(following.residual @ free)
    if found >= -_HARDLY_RISEN * slope:
        return following, 1.0
    low, s_low, high, s_high = 0.0, slope, 1.0, found
    share = 1.0
    for _ in range(40):
        share = (low * s_high - high * s_low) / (s_high - s_low)
        share = float(np.clip(share, low + 0.02 * (high - low), high - 0.02 * (high - low)))
        following = equations.at(trial.du + share * d)
        found = float(following.residual @ free)
        if abs(found) <= 0.3 * slope:
            break
        if found > 0.0:
            low, s_low, s_high = share, found, 0.5 * s_high
        else:
            high, s_high, s_low = share, found, 0.5 * s_low
    return following, share


def _refuse_mechanism(equations: StageEquations, trial: Trial, d: Floats) -> None:
    """Raise where Pi falls without end along a step."""
    far = equations.at(trial.du + FAR_OUT * d)
    free = d[equations.dofs]
    power = float(np.abs(equations.forces[equations.dofs] * free).sum())
    if float(far.residual @ free) > 1e-6 * power:
        raise NoEquilibrium(d)
