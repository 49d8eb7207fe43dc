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

Flow that is not associated has no potential; there the norm of r is lowered instead.

A load beyond collapse has no minimum: Pi falls without end along a mechanism d. That is found
by the slope of Pi far out along the steps (the kinematic theorem of limit analysis): if it is
still falling there, d dissipates less than the loads give, and no equilibrium exists.

Cost: one factorization for every step, one for the derivatives if the last was made elsewhere.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np

from geoident.fem.solvers.protocol import Factor
from geoident.forward.stage_equations import LEFT, NoEquilibrium, StageEquations, Trial
from geoident.model.arrays import Floats

BALANCED = 1e-11
"""Out-of-balance force, relative to the forces at work, that counts as equilibrium."""

ROUNDING = 1e-8
"""The same where no step lowers it any more."""

MOST_STEPS = 60
"""Newton steps at most; a stage rarely takes more than fifteen."""

PATIENCE = 12
"""Steps after which flow without potential is given up if the error has not come down by half."""

_SUSPICIOUS = 4
"""Steps after which a mechanism is looked for; fewer end most stages."""

FAR_OUT = 1e6
"""Where along a step its mechanism alone decides, in steps."""

_STIFFER = 6
"""Level from which a tangent whose step was too long is made stiffer."""


@dataclass(frozen=True)
class Balance:
    """Equilibrium at the end of a stage.

    Args:
        trial: displacements, stresses, projections.
        steps: Newton steps taken.
        factor: of the tangent before the last step, or None if none was made.
        made_at: where it was made.
    """

    trial: Trial
    steps: int
    factor: Factor | None
    made_at: Trial | None


def solve(equations: StageEquations, guesses: Iterable[Floats]) -> Balance:
    """The equilibrium of a stage.

    Args:
        equations: of the stage.
        guesses: (n_dofs,) displacement steps; the nearest one is the start (`distance`).

    Raises:
        NoEquilibrium: see there.
        NotPositiveDefinite: the elastic stiffness itself is singular.
    """
    trial = min((equations.at(guess) for guess in guesses), key=equations.distance)
    search = follow_slope if equations.associated else _along_norm
    factor: Factor | None = None
    made_at: Trial | None = None
    least, reached = 0, (0, np.inf)
    for step in range(MOST_STEPS):
        if trial.error <= BALANCED:
            return Balance(trial, step, factor, made_at)
        if trial.error < 0.5 * reached[1]:
            reached = step, trial.error
        if not equations.associated and step - reached[0] > PATIENCE:
            break
        factor, level = equations.factor(trial, least=least)
        made_at = trial if level == 0 else None
        d = equations.spread(factor.solve(trial.residual[:, None])[:, 0])
        following, share = search(equations, trial, d)
        if following.error >= trial.error and trial.error <= ROUNDING:
            return Balance(trial, step + 1, factor, made_at)
        if step >= _SUSPICIOUS and equations.associated and share == 1.0:
            _refuse_mechanism(equations, following, d)
        least = _next_level(least, share)
        trial = following
    raise NoEquilibrium(trial.du, proven=False)


def _next_level(level: int, share: float) -> int:
    """How much of the elastic stiffness the next tangent keeps, after a share of a step."""
    if share < 0.3:
        return min(max(level + 1, _STIFFER), len(LEFT) - 2)
    if share < 0.9:
        return level
    return level - 1 if level > _STIFFER else 0


def follow_slope(equations: StageEquations, trial: Trial, d: Floats) -> tuple[Trial, float]:
    """Follows a step to near the zero of the slope of Pi, which is monotone.

    A full step on which Pi still falls at its end, or has hardly risen, is taken as it is.
    """
    free = d[equations.dofs]
    slope = float(trial.residual @ free)
    following = equations.at(trial.du + d)
    found = float(following.residual @ free)
    if found >= -0.3 * slope:
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


def _along_norm(equations: StageEquations, trial: Trial, d: Floats) -> tuple[Trial, float]:
    """Halves a step until the residual is smaller."""
    before = float(np.linalg.norm(trial.residual))
    share, best = 1.0, None
    while share > 1e-3:
        following = equations.at(trial.du + share * d)
        if np.linalg.norm(following.residual) < (1.0 - 1e-4 * share) * before:
            return following, share
        if best is None or following.error < best[0].error:
            best = following, share
        share *= 0.5
    assert best is not None
    return best


def _refuse_mechanism(equations: StageEquations, trial: Trial, d: Floats) -> None:
    """Raise where Pi falls without end along a step."""
    far = equations.at(trial.du + FAR_OUT * d)
    free = d[equations.dofs]
    power = float(np.abs(equations.forces[equations.dofs] * free).sum())
    if float(far.residual @ free) > 1e-6 * power:
        raise NoEquilibrium(d, proven=True)
