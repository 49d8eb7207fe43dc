"""A start for yield limits: the strengths lowered together from what hardly yields.

Strong ground is cheap (few points yield, Newton converges at once) and has a solution; weak
ground is dear and may collapse. So the scan begins with all strengths at their upper bounds, lowers
them by a common factor of at most `STEP` between two points, geometrically between the bounds of
each, and ends where the discrepancy has clearly begun to rise, is a small part of that of the
strongest ground (`NEAR`), or the ground collapses. One parameter, whatever their number: what
separates the strengths is left to the descent that follows. A given start that is as near needs no
scan.

Parameters that are no strengths (moduli, in-situ stress, friction angles) stay at their start, and
a point is judged by what the linearised discrepancy would be after their best step.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from geoident.identify.least_squares.acceptance import FIRST_RADIUS, Point
from geoident.identify.least_squares.bounded import bounded_least_squares
from geoident.identify.least_squares.gauss_newton import Search
from geoident.identify.problem.scaling import Scaling
from geoident.model.arrays import Bools, Floats

STEP = 1.5
"""Largest factor between the strengths of two points of the scan."""

NEAR = 0.1
"""A discrepancy below this part of that of the strongest ground is near enough for a descent."""

_MOST = 12
"""Points of a scan at most."""

_REACH = 50.0
"""A scan goes no further down than to this part of the upper bound, or up from the start."""


def strength_scan(search: Search, strength: Bools, start: Point | None) -> Point | None:
    """The best point of the scan or the start; None if the ground collapses even at its strongest.

    Args:
        search: evaluates and records.
        strength: (n,) parameters that are lowered together.
        start: the given start, or None where it has no solution.
    """
    best, least = start, np.inf if start is None else start.phi
    strongest, lowest, worse = 0.0, np.inf, 0
    for number, x in enumerate(_ray(search.scaling, strength), start=1):
        if search.history.stop is not None:
            break
        point = search.try_point(x)
        search.record(x, point, 0.0, f"strength {number}" + (": no solution" if not point else ""))
        if point is None:
            break
        expected = _expected(search, point, strength)
        strongest = expected if number == 1 else strongest
        worse = worse + 1 if expected >= lowest else 0
        lowest = min(lowest, expected)
        if expected < least:
            best, least = point, expected
        if least <= NEAR * strongest or (worse and expected > 4.0 * lowest) or worse == 2:
            break
    return best


def _ray(scaling: Scaling, strength: Bools) -> Iterator[Floats]:
    """Points x (n,), the strongest first."""
    high = np.where(strength, _finite_upper(scaling), scaling.start)
    top = scaling.to_natural(high)
    low = np.where(strength, np.maximum(scaling.to_natural(scaling.lower), top / _REACH), top)
    ratio = np.where(strength & (low > 0.0), low / np.where(top > 0.0, top, 1.0), 1.0)
    steps = int(np.clip(np.ceil(-np.log(ratio.min()) / np.log(STEP)), 1, _MOST))
    for part in np.arange(steps + 1) / steps:
        yield scaling.to_scaled(top * ratio**part)


def _finite_upper(scaling: Scaling) -> Floats:
    start = scaling.to_natural(scaling.start)
    far = scaling.to_scaled(start * np.sqrt(_REACH))
    return np.where(np.isfinite(scaling.upper), scaling.upper, far)


def _expected(search: Search, point: Point, strength: Bools) -> float:
    """The linearised discrepancy after the best step of all that is no strength."""
    others = ~strength
    if not others.any():
        return point.phi
    J, r = point.model.jacobian[:, others], point.model.residual
    low, high = search.box.sides(point.x, FIRST_RADIUS)
    d = bounded_least_squares(J, r, low[others], high[others])
    return float(np.sum((r + J @ d) ** 2))
