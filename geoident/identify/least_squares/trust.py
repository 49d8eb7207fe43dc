"""The measure of a step: relative where a parameter keeps its sign.

A step of length R changes every parameter by at most a factor exp(R): for parameters scaled by
their logarithm, |d| <= R; for linear ones whose bounds have one sign, |ln(1 + d/x)| <= R. A linear
parameter that may be zero moves by at most R in x, or by R/4 of the width between its bounds where
that is more. So a Young's modulus does not fall to its lower bound in the first step only because
its user left the scale linear.
"""

from __future__ import annotations

import numpy as np

from geoident.identify.problem.scaling import Scaling
from geoident.model.arrays import Floats


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
