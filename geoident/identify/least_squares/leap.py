"""Steps to where a reduced model is lowest, instead of the linearised one (theory 14).

Where the model has a reduced one, which agrees with it in readings and derivatives at all points
that were evaluated, a step may go to the minimum of that: what is not linear is in it. The step
costs no evaluation. It counts like any other: the trial is evaluated in full, taken or rejected by
the same rules, and whether anything is left to do is judged by the full model and its derivatives
alone. So the reduced model decides only which points are looked at.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from geoident.errors import ModelError
from geoident.identify.least_squares.acceptance import Iterate, Step
from geoident.identify.least_squares.trust_region import TrustBox, bounded_least_squares
from geoident.identify.problem.problem import Discrepancy, Linearization
from geoident.model.arrays import Floats
from geoident.model.response import HasSurrogate, Surrogate

TRUSTED = 0.1
"""Bound of the relative error in energy up to which the reduced model leads the way."""

_STEPS = 60
"""Steps on the reduced model at most; ten are usual."""

_FAR = 10.0
"""Length of any step."""

_SETTLED = 1e-11
"""A step on the reduced model that is shorter changes nothing."""


@dataclass(frozen=True)
class Leap:
    """Proposes steps of one problem by its reduced model.

    Args:
        discrepancy: of the problem.
        box: measures steps and knows the bounds.
    """

    discrepancy: Discrepancy
    box: TrustBox

    def propose(self, point: Iterate, radius: float) -> Step | None:
        """The step to the minimum of the reduced model; None where it is of no use.

        Args:
            point: where from.
            radius: length at most.
        """
        response = self.discrepancy.problem.response
        if not isinstance(response, HasSurrogate):
            return None
        try:
            surrogate = response.surrogate(response.visited())
        except ModelError:  # such as no time for an evaluation
            return None
        if surrogate is None:
            return None
        problem = replace(self.discrepancy.problem, response=surrogate)
        lower, upper = self.box.sides(point.x, radius)
        x, phi = self._descend(
            Discrepancy(problem), surrogate, point, point.x + lower, point.x + upper
        )
        step = x - point.x
        if not phi < point.phi or not step.any():
            return None
        return Step(step, self.box.length(point.x, step), point.phi - phi)

    def _descend(
        self,
        reduced: Discrepancy,
        response: Surrogate,
        point: Iterate,
        lower: Floats,
        upper: Floats,
    ) -> tuple[Floats, float]:
        """The lowest point x (n,) of the reduced model between two corners, and phi there."""
        x, model, radius = point.x, point.model, _FAR
        for _ in range(_STEPS):
            low, high = self.box.sides(x, radius)
            d = bounded_least_squares(
                model.jacobian,
                model.residual,
                np.minimum(np.maximum(low, lower - x), 0.0),
                np.maximum(np.minimum(high, upper - x), 0.0),
            )
            length = self.box.length(x, d)
            if length <= _SETTLED:
                break
            y = self.box.reach(x, d)
            trial = self._look(reduced, response, y)
            if trial is not None and trial.objective < model.objective:
                x, model, radius = y, trial, min(2.0 * max(radius, length), _FAR)
            else:
                radius = 0.3 * length
        return x, model.objective

    def _look(self, reduced: Discrepancy, response: Surrogate, x: Floats) -> Linearization | None:
        """The reduced model at x (n,); None where it is not trusted, or has no answer."""
        p = reduced.scaling.to_natural(x)
        try:
            found = reduced.linearize(p)
        except ModelError:
            return None
        return found if response.error(p) <= TRUSTED else None
