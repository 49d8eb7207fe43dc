"""Vertical drains by their definition (Barron 1948, Hansbo 1981)."""

from __future__ import annotations

import numpy as np
from scipy.integrate import quad


def resistance(D: float, d: float, d_s: float, ratio: float) -> float:
    """Mu: the mean pressure under equal strain, where the flow at each radius meets its ground.

    du/dr = k / k(r) (R^2 / r - r) in units of gamma_w / (2 k) times the rate of strain.

    Args:
        D: diameter of the ground around a drain.
        d: of the drain.
        d_s: of the disturbed ground.
        ratio: permeability of the ground by that of the disturbed ground.
    """
    R, w, s = D / 2.0, d / 2.0, d_s / 2.0

    def passed(r: float) -> float:
        return R**2 * np.log(r / w) - (r**2 - w**2) / 2.0

    def moment(r: float) -> float:
        return (passed(r) + (ratio - 1.0) * passed(min(r, s))) * 2.0 * r

    total = quad(moment, w, R, points=[s] if s > w else None)[0]
    return float(total / (R**2 - w**2) / R**2)
