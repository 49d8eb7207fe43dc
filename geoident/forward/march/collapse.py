"""How much of a stage's change of load the ground carries before it collapses.

The arc of equilibria is followed under displacement control: the forces f_0 + t (f - f_0), with f_0
those of the stage before, act, and the load factor t follows from a prescribed work-like measure
of the displacements,

    C^T V P(sigma_old + E C du) = f_0 + t (f - f_0) ,      (f - f_0)^T du = alpha .

t grows with alpha towards the limit load (Cermak, Haslinger, Kozubek, Sysala 2015, "Discretization
and numerical realization of contact problems for elastic-perfectly plastic bodies", part II). Given
alpha the problem is convex again and has a solution. alpha is doubled until t stands still, or 1
is reached; where Newton's method does not get there, it grows by less. Meshes that lock under flow
without change of volume have no limit load (Nagtegaal, Parks, Rice 1974, Comput. Methods Appl.
Mech. Eng. 4): there the arc ends where the ground has become ten thousand times softer and its
strains large.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from geoident.forward.march.equilibrium import follow_slope
from geoident.forward.march.stage_equations import StageEquations, Trial
from geoident.model.arrays import Floats

_BALANCED = 1e-7
_STANDS_STILL = 2e-4
"""Relative growth of t over a doubling of the displacement that counts as the limit."""

_SOFTER = 1e4
"""How much softer than elastic the ground is when it counts as flowing, where _LONG is passed."""

_LONG = 1.0
"""Strain up to which ground may be as soft as it likes (it may harden)."""

_MOST_DOUBLINGS = 24
_LEAST_GROWTH = 1.05
_MOST_STEPS = 40


@dataclass(frozen=True)
class Limit:
    """Where the arc of equilibria ended.

    Args:
        fraction: t that is carried, at most 1.
        du: (n_dofs,) displacement step there.
    """

    fraction: float
    du: Floats


def limit_of(equations: StageEquations) -> Limit:
    """The largest part of the change of load of a stage that can be carried."""
    before = equations.under(equations.before())
    load = (equations.forces - before.forces)[equations.dofs]
    rest = before.at(np.zeros_like(equations.forces))
    factor, _ = before.factor(rest)
    compliance = float(load @ factor.solve(load[:, None])[:, 0])
    alpha, growth = 0.25 * compliance, 2.0
    last, reached = Limit(0.0, rest.du), 0.0
    while alpha <= 2.0**_MOST_DOUBLINGS * compliance:
        found = _controlled(before, load, alpha, last)
        if found is None:
            if growth < _LEAST_GROWTH or not reached:
                return last
            growth = float(np.sqrt(growth))
            alpha = growth * reached
            continue
        softer = alpha > _SOFTER * compliance * found.fraction
        if softer and _strain(before, found) > _LONG:
            return last
        if found.fraction >= 1.0:
            return Limit(1.0, found.du)
        grown = found.fraction - last.fraction
        last = found if grown > 0.0 else last
        still = _STANDS_STILL * last.fraction * np.log2(growth)
        if alpha > compliance and grown <= still:
            return last
        reached, growth = alpha, min(growth**2, 2.0)
        alpha *= growth
    return last


def _strain(equations: StageEquations, found: Limit) -> float:
    """The largest strain."""
    return float(np.abs(equations.operators.strain(found.du)).max())


def _controlled(before: StageEquations, load: Floats, alpha: float, start: Limit) -> Limit | None:
    """Equilibrium at a prescribed measure alpha of the displacements; None if not found.

    Steps on the surface of alpha follow the slope of the potential there; f - f_0 does no work on
    them.
    """
    dofs = before.dofs
    trial, t = before.at(start.du), start.fraction
    for _ in range(_MOST_STEPS):
        rest = trial.residual + t * load
        short = alpha - float(load @ trial.du[dofs])
        on_surface = abs(short) <= 1e-9 * alpha
        if on_surface and np.abs(rest).max() <= _BALANCED * _scale(trial, t, load):
            return Limit(t, trial.du)
        factor, _ = before.factor(trial, least=1)
        free, ahead = factor.solve(np.column_stack([rest, load])).T
        step = before.spread(free + (short - load @ free) / (load @ ahead) * ahead)
        if on_surface:
            trial, _ = follow_slope(before, trial, step)
        else:
            trial = before.at(trial.du + step)
        t = -float(trial.residual @ load) / float(load @ load)
    return None


def _scale(trial: Trial, t: float, load: Floats) -> float:
    return max(trial.scale, abs(t) * float(np.abs(load).max()))
