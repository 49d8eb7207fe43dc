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

from collections.abc import Iterable
from dataclasses import replace

import numpy as np

from geoident.fem.solvers.direct import Factor
from geoident.forward.analysis.stage_equations import (
    Balance,
    NoEquilibrium,
    StageEquations,
    Trial,
)
from geoident.forward.analysis.viscous_path import (
    BALANCED,
    NO_LOWER,
    StepBudget,
    follow_path,
    newton,
)
from geoident.model.arrays import Floats

MOST_STEPS = 60
"""Newton steps at most; a stage rarely takes more than fifteen."""

PATIENCE = 10
"""Newton steps after which flow without potential takes the path of viscous grounds.

Steps that wander longer may end in bands of shear where there is an even flow.
"""

_SUSPICIOUS = 4
"""Steps after which a mechanism is looked for; fewer end most stages."""

SEARCH = 240
"""Newton steps that a search without potential may take: the hardest that leads to an end takes a
fifth of them."""

_UNBALANCED = 0.01
"""Part of the change of load that may stay unbalanced where flow is not associated."""

_HARDLY_VISCOUS = 3e-4
"""Part of the overstress that may stay where only even flow is looked for."""

_LITTLE_VISCOUS = 3e-3
"""The same otherwise: all else shears in bands. By how much displacements are short is said."""

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


def solve(
    equations: StageEquations,
    guesses: Iterable[Floats],
    *,
    even_only: bool = False,
    budget: StepBudget | None = None,
) -> Balance:
    """The equilibrium of a stage.

    Args:
        equations: of the stage.
        guesses: (n_dofs,) displacement steps; the nearest one is the start (`distance`).
        even_only: without potential, no flow in bands of shear is looked for.
        budget: steps that are left where there is no potential; None for a search of its own.

    Raises:
        NoEquilibrium: see there.
        NotPositiveDefinite: the elastic stiffness itself is singular.
    """
    start = min((equations.at(guess) for guess in guesses), key=equations.distance)
    if equations.associated:
        return _by_potential(equations, start)
    return _without_potential(equations, start, budget or StepBudget(SEARCH), even_only=even_only)


def _by_potential(equations: StageEquations, trial: Trial) -> Balance:
    """Newton's method along the slope of Pi, from a trial."""
    factor: Factor | None = None
    made_at: Trial | None = None
    for step in range(MOST_STEPS):
        if trial.error <= BALANCED:
            return Balance(trial, factor, made_at)
        factor, level = equations.factor(trial)
        made_at = trial if level == 0 else None
        d = equations.spread(factor.solve(trial.residual[:, None])[:, 0])
        following, share = _stepped(equations, trial, d)
        if following.error >= trial.error and trial.error <= NO_LOWER:
            return Balance(trial, factor, made_at)
        if step >= _SUSPICIOUS and share == 1.0:
            _refuse_mechanism(equations, following, d)
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
    for _ in range(_PATCH_STEPS):
        if np.abs(here.residual).max() <= _SETTLED * worst:
            break
        factor, _ = own.factor(here)
        d = own.spread(factor.solve(here.residual[:, None])[:, 0])
        here, _ = follow_slope(own, here, d)
    du = trial.du.copy()
    du[patch.dofs] = here.du
    return equations.at(du)


def _without_potential(
    equations: StageEquations, start: Trial, budget: StepBudget, *, even_only: bool
) -> Balance:
    """Newton's method, and where its steps are lost, the path of viscous grounds.

    Where the even flow folds back at little viscosity, its last point is the answer: beyond the
    fold there are only bands of shear, whose place is that of the elements. Where it folds back
    earlier, the load may still be in balance but for a little.
    """
    direct = newton(equations, start, most=PATIENCE, budget=budget)
    if direct.converged:
        return direct
    path = follow_path(equations, budget)
    if path is None:
        raise NoEquilibrium(direct.trial.du)
    if path.runs_away is not None:
        raise NoEquilibrium(path.runs_away, limit=True)
    end = path.balance
    if end.viscosity == 0.0:
        return end
    if end.viscosity <= (_HARDLY_VISCOUS if even_only else _LITTLE_VISCOUS):
        missing = np.abs(path.promised - end.trial.du).max()
        short = float(missing / (np.abs(path.promised).max() or 1.0))
        return replace(end, factor=None, made_at=None, short=short)
    refused = NoEquilibrium(end.trial.du, even=end)
    if even_only:
        raise refused
    at_rest = equations.at(np.zeros_like(equations.forces)).error
    try:
        trials = [equations.at(du) for du in (end.trial.du, path.promised)]
    except NoEquilibrium:
        raise refused from None
    trial = min(trials, key=lambda one: one.error)
    if trial.error > _UNBALANCED * at_rest:
        raise refused
    return Balance(trial, None, None, unbalanced=trial.error / at_rest)


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
    slope_there = float(following.residual @ free)
    if slope_there >= -_HARDLY_RISEN * slope:
        return following, 1.0
    low, s_low, high, s_high = 0.0, slope, 1.0, slope_there
    share = 1.0
    for _ in range(40):
        share = (low * s_high - high * s_low) / (s_high - s_low)
        share = float(np.clip(share, low + 0.02 * (high - low), high - 0.02 * (high - low)))
        following = equations.at(trial.du + share * d)
        slope_there = float(following.residual @ free)
        if abs(slope_there) <= 0.3 * slope:
            break
        if slope_there > 0.0:
            low, s_low, s_high = share, slope_there, 0.5 * s_high
        else:
            high, s_high, s_low = share, slope_there, 0.5 * s_low
    return following, share


def _refuse_mechanism(equations: StageEquations, trial: Trial, d: Floats) -> None:
    """Raise where Pi falls without end along a step."""
    far = equations.at(trial.du + FAR_OUT * d)
    free = d[equations.dofs]
    power = float(np.abs(equations.forces[equations.dofs] * free).sum())
    if float(far.residual @ free) > 1e-6 * power:
        raise NoEquilibrium(d)
