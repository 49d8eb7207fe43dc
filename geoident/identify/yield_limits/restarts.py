"""Out of local minima: new starts along what the readings hardly see.

The response is piecewise smooth in the strengths: every strain point that begins or ceases to
yield, and every plane that comes in front of another, is a kink, and kinks make local minima. They
lie in the valley of the discrepancy, so that is where to look for a better one. From the best
point, with the singular values S and directions v of its Jacobian, a new start is

    x + sum_k  a_k xi_k v_k,     a_k = min(REACH, sqrt(phi) / S_k),     xi standard normal

which leaves phi of the linearised model at its own size; and along with it

    a strength whose planes no point reaches    comes down until one is reached and up to BITE
                                                further, or it would never be heard of; or, with
                                                a chance of 1 - WOKEN, goes up out of the way;
    another one, with a chance of RAISED,       goes up: a plane in front gives way to others.
"""

from __future__ import annotations

import numpy as np

from geoident.identify.least_squares.acceptance import Point
from geoident.model.arrays import Bools, Floats

REACH = 0.3
"""Largest standard deviation of a change along one direction, relative."""

FARTHEST = 0.4
"""No parameter of a new start is further from the best point than this, relative."""

BITE = 0.1
"""An unreached plane comes down by up to this much, relative, below where it is first reached."""

WOKEN, RAISED = 0.7, 0.3
"""Chances that an unreached plane comes down, that a reached one goes up."""

RISE = 0.3
"""A plane goes up by up to this much, relative."""


class Valley:
    """New starts around the best point, the same in every run.

    Args:
        strength: (n,) parameters that only move planes, outwards.
        seed: of the random numbers.
    """

    def __init__(self, strength: Bools, seed: int) -> None:
        self._strength = strength
        self._random = np.random.default_rng(seed)

    def start(self, best: Point, idle: Bools, unit: Floats) -> Floats:
        """A new start x (n,), bounds not heeded.

        Args:
            best: the best point; idle strengths are just not reached there (`slack`).
            idle: (n,) strengths whose planes no strain point reaches.
            unit: (n,) what counts as a step of one in x.
        """
        d = self._along_valley(best.model.jacobian * unit, np.sqrt(best.phi))
        down = self._share(WOKEN, len(d))
        d[idle] = np.where(down > 0.0, -BITE * down, RISE * self._share(1.0, len(d)))[idle]
        awake = self._strength & ~idle
        d[awake] += RISE * self._share(RAISED, len(d))[awake]
        return np.asarray(best.x + unit * np.clip(d, -FARTHEST, FARTHEST))

    def _along_valley(self, J: Floats, size: float) -> Floats:
        """A random change (n,) by which J (rows, n) moves the readings by about this size."""
        _, S, Vt = np.linalg.svd(J, full_matrices=True)
        S = np.pad(S, (0, len(Vt) - len(S)))
        with np.errstate(divide="ignore"):
            scale = np.minimum(REACH, size / S)
        return np.asarray((scale * self._random.standard_normal(len(S))) @ Vt)

    def _share(self, chance: float, n: int) -> Floats:
        """(n,) zero, or with this chance a number between 0 and 1."""
        return self._random.uniform(size=n) * (self._random.uniform(size=n) < chance)
