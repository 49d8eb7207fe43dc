"""Which trial points a Gauss-Newton descent goes to, and how far it trusts its next step.

A trial is taken where phi falls. Where phi rises the step may be good all the same: readings that
react strongly and bend early can hide that all parameters come nearer. The natural level of
Deuflhard tells: with J and r at the point, the trial is nearer if the correction that J asks for
there,

    |J^+ r(x + d)|  <=  NEARER |J^+ r(x)|      (smallest solutions, over the parameters that moved)

is shorter. That costs no evaluation. Such a detour may last `DETOUR` steps; if none of them is
below the best phi so far, the search goes back to the best point with a shorter radius. So phi
of the best point never rises, and detours cannot go in circles.

The radius follows the ratio of the gain found to the gain promised, as usual (More 1978).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Generic, TypeVar

import numpy as np

from geoident.identify.least_squares.trust_region import smallest_solution
from geoident.identify.problem.problem import Linearization
from geoident.model.arrays import Floats

FIRST_RADIUS = 1.5
"""No parameter changes by more than a factor 4.5 in the first step."""

NEARER = 0.9
"""A correction shortened to this part makes up for a rise of phi: less may be chance."""

DETOUR = 2
"""Steps above the best phi that are allowed in a row: the second mostly comes below it."""


@dataclass(frozen=True)
class Iterate:
    """A point where the model was evaluated.

    Args:
        x: (n,) scaled parameters.
        p: (n,) parameters, SI.
        linearization: residuals and their derivative there.
    """

    x: Floats
    p: Floats
    linearization: Linearization

    @property
    def phi(self) -> float:
        """The discrepancy."""
        return self.linearization.objective


IterateT = TypeVar("IterateT", bound=Iterate)
"""What a search knows of a point: an `Iterate`, perhaps with more."""


@dataclass(frozen=True)
class Step:
    """A proposed step.

    Args:
        d: (n,) the step in x.
        length: in the measure of the trust region.
        gain: by how much it promises to lower phi.
    """

    d: Floats
    length: float
    gain: float


class Acceptance(Generic[IterateT]):
    """Judges the trials of one descent.

    Args:
        start: the first point.

    Attributes:
        point: where the next step starts.
        best: the point of lowest phi so far.
        radius: length that the next step may have.
    """

    def __init__(self, start: IterateT) -> None:
        self.point = start
        self.best = start
        self.radius = FIRST_RADIUS
        self._detour = 0
        self._first_length = FIRST_RADIUS

    def judge(self, step: Step, trial: IterateT | None) -> str:
        """Takes or rejects the trial that a step led to, None where there is no solution.

        Returns:
            What became of it, for the history.
        """
        if trial is None:
            self._shorten(0.4 * step.length)
            return "rejected: no solution"
        gain = self.point.phi - trial.phi
        if gain > 0.0:
            ratio = gain / step.gain
            if ratio < 0.25:
                self.radius = 0.5 * step.length
            elif ratio > 0.75 and step.length > 0.9 * self.radius:
                self.radius *= 2.0
        elif self._detour >= DETOUR or not _nearer(self.point, step, trial):
            # to where the parabola through phi, its slope and the trial is lowest
            J, r = self.point.linearization.jacobian, self.point.linearization.residual
            slope = 2.0 * float(r @ (J @ step.d))
            part = float(np.clip(-0.5 * slope / (-gain - slope), 0.2, 0.5))
            self._shorten(part * step.length)
            return "rejected"
        self._take(step, trial)
        return "accepted" if self._detour == 0 else "accepted: detour"

    def return_to_best(self) -> None:
        """Ends a detour that led nowhere; the next one needs a new best point first."""
        self.point = self.best
        self.radius = 0.25 * self._first_length
        self._detour = DETOUR

    def _take(self, step: Step, trial: IterateT) -> None:
        if self.point is self.best:
            self._first_length = step.length
        self.point = trial
        if trial.phi < self.best.phi:
            self.best = trial
            self._detour = 0
        elif self._detour == DETOUR:
            self.return_to_best()
        else:
            self._detour += 1

    def _shorten(self, radius: float) -> None:
        self.radius = radius
        if self.point is not self.best:
            self.return_to_best()


def _nearer(point: Iterate, step: Step, trial: Iterate) -> bool:
    """The natural level test of the module's head."""
    J = point.linearization.jacobian[:, step.d != 0.0]
    before = smallest_solution(J, point.linearization.residual)
    after = smallest_solution(J, trial.linearization.residual)
    return float(np.linalg.norm(after)) <= NEARER * float(np.linalg.norm(before))
