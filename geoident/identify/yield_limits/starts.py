"""Where descents for yield limits begin: a scan of the strengths, restarts around the best point.

**Scan.** Strong ground is cheap (few points yield, Newton converges at once) and has a solution;
weak ground takes many iterations and may collapse. So the scan begins with all strengths at their
upper bounds, lowers them by a common factor of at most `STEP` between two points, geometrically
between the bounds of each, and ends where the discrepancy has clearly begun to rise, is a small
part of that of the strongest ground (`NEAR`), or the ground collapses. One parameter, whatever
their number: what separates the strengths is left to the descent that follows. A given start that
is as near needs no scan. Parameters that are no strengths (moduli, in-situ stress, friction angles)
stay at their start, and a point is judged by what the linearised discrepancy would be after their
best step.

**Retreat.** A given start at which the ground collapses, as the answer for fewer stages may be, has
its strengths raised by `RAISE`, and by the square of the last factor each time that this is not
enough: what does not stand costs most of all, so few of these points are tried.

**Restarts.** The response is piecewise smooth in the strengths: every strain point that begins or
ceases to yield, and every plane that comes in front of another, is a kink, and kinks make local
minima. They lie along what the readings hardly determine, so that is where to look for a better
one. From the best point, with the singular values S and directions v of its Jacobian, a restart is

    x + sum_k  a_k xi_k v_k,     a_k = min(REACH, sqrt(phi) / S_k),     xi standard normal

which leaves phi of the linearised model at its own size; and along with it

    a strength whose planes no point reaches   comes down until one is reached and up to BELOW
                                               further, or it would never be heard of; or, with
                                               a chance of 1 - LOWERED, goes up out of the way;
    another one, with a chance of RAISED,      goes up: a plane in front gives way to others.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from geoident.identify.least_squares.descent import Evaluator
from geoident.identify.least_squares.gauss_newton import phi_after_step
from geoident.identify.problem.scaling import Scaling
from geoident.identify.yield_limits.yield_points import YieldIterate
from geoident.model.arrays import Bools, Floats

STEP = 1.5
"""Largest factor between the strengths of two points of the scan."""

RAISE = 1.1
"""First factor on the strengths of a start at which the ground collapses."""

NEAR = 0.1
"""A discrepancy below this part of that of the strongest ground is near enough for a descent."""

_MOST = 12
"""Points of a scan at most."""

_LOWEST = 50.0
"""A scan goes no further down than to this part of the upper bound, or up from the start."""

REACH = 0.3
"""Largest standard deviation of a change along one direction, relative."""

FARTHEST = 0.4
"""No parameter of a restart is further from the best point than this, relative."""

BELOW = 0.1
"""An unreached plane comes down by up to this much, relative, below where it is first reached."""

LOWERED, RAISED = 0.7, 0.3
"""Chances that an unreached plane comes down, that a reached one goes up."""

RISE = 0.3
"""A plane goes up by up to this much, relative."""


def strength_scan(
    evaluator: Evaluator[YieldIterate], strength: Bools, start: YieldIterate | None
) -> YieldIterate | None:
    """The best point of the scan or the start; None if the ground collapses even at its strongest.

    Args:
        evaluator: evaluates and records.
        strength: (n,) parameters that are lowered together.
        start: the given start, or None where it has no solution.
    """
    best, least = start, np.inf if start is None else start.phi
    strongest, lowest, worse = 0.0, np.inf, 0
    for number, x in enumerate(_ray(evaluator.scaling, strength), start=1):
        if evaluator.history.stop is not None:
            break
        point = evaluator.start(x, f"strength {number}")
        if point is None:
            break
        expected = phi_after_step(evaluator.box, point, ~strength)
        strongest = expected if number == 1 else strongest
        worse = worse + 1 if expected >= lowest else 0
        lowest = min(lowest, expected)
        if expected < least:
            best, least = point, expected
        if least <= NEAR * strongest or (worse and expected > 4.0 * lowest) or worse == 2:
            break
    return best


def raised(scaling: Scaling, strength: Bools) -> Iterator[Floats]:
    """The start (n,) with its strengths raised, ever more, as far as their upper bounds.

    Args:
        scaling: of the parameters.
        strength: (n,) those that are raised together.
    """
    begin, high = scaling.to_natural(scaling.start), scaling.to_natural(_finite_upper(scaling))
    last, factor = begin, RAISE
    while True:
        values = np.where(strength, np.minimum(begin * factor, high), begin)
        if np.array_equal(values, last):
            return
        yield scaling.to_scaled(values)
        last, factor = values, factor**2


def _ray(scaling: Scaling, strength: Bools) -> Iterator[Floats]:
    """Points x (n,), the strongest first."""
    high = np.where(strength, _finite_upper(scaling), scaling.start)
    top = scaling.to_natural(high)
    low = np.where(strength, np.maximum(scaling.to_natural(scaling.lower), top / _LOWEST), top)
    ratio = np.where(strength & (low > 0.0), low / np.where(top > 0.0, top, 1.0), 1.0)
    steps = int(np.clip(np.ceil(-np.log(ratio.min()) / np.log(STEP)), 1, _MOST))
    for part in np.arange(steps + 1) / steps:
        yield scaling.to_scaled(top * ratio**part)


def _finite_upper(scaling: Scaling) -> Floats:
    start = scaling.to_natural(scaling.start)
    far = scaling.to_scaled(start * np.sqrt(_LOWEST))
    return np.where(np.isfinite(scaling.upper), scaling.upper, far)


class Restarts:
    """New starts around the best point, the same in every run.

    Args:
        strength: (n,) parameters that only move planes, outwards.
        seed: of the random numbers.
    """

    def __init__(self, strength: Bools, seed: int) -> None:
        self._strength = strength
        self._random = np.random.default_rng(seed)

    def around(self, best: YieldIterate, unit: Floats) -> Floats:
        """A new start x (n,), bounds not heeded.

        Args:
            best: the best point, its unreached planes brought near.
            unit: (n,) what counts as a step of one in x.
        """
        d = self._hardly_seen(best.linearization.jacobian * unit, np.sqrt(best.phi))
        down, idle = self._share(LOWERED, len(d)), best.unreached
        d[idle] = np.where(down > 0.0, -BELOW * down, RISE * self._share(1.0, len(d)))[idle]
        reached = self._strength & ~idle
        d[reached] += RISE * self._share(RAISED, len(d))[reached]
        return np.asarray(best.x + unit * np.clip(d, -FARTHEST, FARTHEST))

    def _hardly_seen(self, J: Floats, size: float) -> Floats:
        """A random change (n,) by which J (rows, n) moves the readings by about this size."""
        _, S, Vt = np.linalg.svd(J, full_matrices=True)
        S = np.pad(S, (0, len(Vt) - len(S)))
        with np.errstate(divide="ignore"):
            scale = np.minimum(REACH, size / S)
        return np.asarray((scale * self._random.standard_normal(len(S))) @ Vt)

    def _share(self, chance: float, n: int) -> Floats:
        """(n,) zero, or with this chance a number between 0 and 1."""
        return self._random.uniform(size=n) * (self._random.uniform(size=n) < chance)
