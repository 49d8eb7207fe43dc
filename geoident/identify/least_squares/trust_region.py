"""The step of a Gauss-Newton iteration: a box around the point, and least squares in it, exactly.

**The box** is relative where a parameter keeps its sign. A step of length R changes every parameter
by at most a factor exp(R): for parameters scaled by their logarithm, |d| <= R; for linear ones
whose bounds have one sign, |ln(1 + d/x)| <= R. A linear parameter that may be zero moves by at most
R in x, or by R/4 of the width between its bounds where that is more. So a Young's modulus does not
fall to its lower bound in the first step only because its user left the scale linear. A box joins
with the bounds to a box.

**The step** is

    min |A d + b|^2   subject to   lower <= d <= upper,   lower <= 0 <= upper.

The unconstrained minimum of smallest norm is tried first; near the solution it is the answer.
Otherwise an active-set method (Stark & Parker's BVLS, started at d = 0) fixes the variables that
run into the box and releases those whose gradient points back inside, until the Kuhn-Tucker
conditions hold: each variable is free with zero gradient, or on a side of the box with the gradient
pushing outwards.

Singular values of the free columns below `RANK` of the largest count as zero, and the step has no
part along their directions: what A does not see does not move.

One singular value decomposition of (rows, n) for each change of the active set; n is small.
"""

from __future__ import annotations

import numpy as np

from geoident.identify.problem.scaling import Scaling
from geoident.model.arrays import Floats

RANK = 1e-10
"""Singular values below this part of the largest count as zero."""


class TrustBox:
    """Boxes of steps around a point, joined with the bounds.

    Args:
        scaling: the scaled parameters and their bounds.
    """

    def __init__(self, scaling: Scaling) -> None:
        self._scaling = scaling
        one_sign = (scaling.lower > 0.0) | (scaling.upper < 0.0)
        self._relative = one_sign & ~scaling.log
        quarter = np.where(one_sign | scaling.log, 1.0, 0.25 * (scaling.upper - scaling.lower))
        self._unit = np.where(np.isfinite(quarter), np.maximum(quarter, 1.0), 1.0)

    def sides(self, x: Floats, radius: float) -> tuple[Floats, Floats]:
        """Lowest and highest step (n,), (n,) of length ``radius`` inside the bounds at x (n,)."""
        low, high = -radius * self._unit, radius * self._unit
        ends = np.outer(np.expm1([-radius, radius]), x[self._relative])
        low[self._relative], high[self._relative] = ends.min(axis=0), ends.max(axis=0)
        lower, upper = self._scaling.lower - x, self._scaling.upper - x
        return np.minimum(np.maximum(low, lower), 0.0), np.maximum(np.minimum(high, upper), 0.0)

    def unit(self, x: Floats) -> Floats:
        """What counts as a step of one in each parameter (n,), to first order, at x (n,)."""
        return np.where(self._relative, np.abs(x), self._unit)

    def length(self, x: Floats, d: Floats) -> float:
        """Length of the step d (n,) at x (n,): the largest change of a parameter."""
        change = np.abs(d) / self._unit
        change[self._relative] = np.abs(np.log1p(d[self._relative] / x[self._relative]))
        return float(change.max(initial=0.0))

    def reach(self, x: Floats, d: Floats) -> Floats:
        """The point x + d (n,), exactly on a bound where the step ends on it."""
        lower, upper = self._scaling.lower, self._scaling.upper
        y = np.where(d <= lower - x, lower, x + d)
        return self._scaling.clip(np.where(d >= upper - x, upper, y))


def smallest_solution(A: Floats, b: Floats) -> Floats:
    """The d (n,) of smallest norm that minimises |A d + b|, A (rows, n), b (rows,)."""
    return np.asarray(np.linalg.lstsq(A, -b, rcond=RANK)[0], dtype=np.float64)


def bounded_least_squares(A: Floats, b: Floats, lower: Floats, upper: Floats) -> Floats:
    """The d (n,) in the box that minimises |A d + b|.

    Args:
        A: (rows, n).
        b: (rows,).
        lower: (n,) lower side of the box, not above zero.
        upper: (n,) upper side, not below zero.

    Returns:
        (n,) the minimum; variables on the box are on it exactly. Rounding could make the active set
        go round in circles: after 20 (n + 1) changes the point reached, no worse than d = 0, is it.
    """
    d = smallest_solution(A, b)
    if np.all((d >= lower) & (d <= upper)):
        return d
    d, g = np.zeros(A.shape[1]), A.T @ b
    # free are the variables that can go down the gradient without leaving the box
    free = ((d > lower) | (g < 0.0)) & ((d < upper) | (g > 0.0)) & (lower < upper)
    columns, least = np.linalg.norm(A, axis=0), 1e-13 * np.linalg.norm(b)
    for _ in range(20 * (len(d) + 1)):
        # towards the minimum over the free variables, until the first of them meets the box
        step = np.zeros_like(d)
        step[free] = smallest_solution(A[:, free], A @ d + b)
        moving, side = step != 0.0, np.where(step > 0.0, upper, lower)
        reach = np.full_like(d, np.inf)
        reach[moving] = (side[moving] - d[moving]) / step[moving]
        part = float(reach.min(initial=np.inf))
        if part <= 1.0:
            blocked = reach <= part
            d = np.where(blocked, side, np.clip(d + part * step, lower, upper))
            free = free & ~blocked
            continue
        d = np.clip(d + step, lower, upper)
        # there: the fixed variable whose gradient points back into the box most is released
        g = A.T @ (A @ d + b)
        inward = np.where(d <= lower, -g, 0.0) + np.where(d >= upper, g, 0.0)
        inward[free] = 0.0  # what both bounds hold has no way in: the two terms add up to nothing
        gain = np.divide(inward, columns, out=np.zeros_like(d), where=columns > 0.0)
        most = int(np.argmax(gain))
        if gain[most] <= least:
            return d
        free[most] = True
    return d
