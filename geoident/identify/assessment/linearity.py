"""Whether the model is linear enough for the reported intervals (theory 6.7).

The ends of a 95 % interval are where phi is 3.84 above its minimum if the model is linear. Where
the least known parameter has a wide interval, the model is evaluated at both of its ends.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from geoident.identify.assessment.uncertainty import Assessment
from geoident.identify.problem.problem import Discrepancy, Problem
from geoident.model.arrays import Floats
from geoident.model.methods import SquaredOptions
from geoident.model.results.bands import NORMAL_95

UNCERTAIN = 0.15
"""Standard deviation, relative to the value, up to which any smooth model is linear enough.

A reading that is inversely proportional to a parameter deviates by 15 % of its change there."""

OFF = 1.2
"""Factor between the end of an interval and where it should be from which on it is reported."""


@dataclass(frozen=True)
class IntervalEnds:
    """Growth of phi at the ends of an interval.

    Args:
        parameter: its number.
        below: by how much phi is larger at the lower end than at the estimate.
        above: at the upper end.
    """

    parameter: int
    below: float
    above: float

    @property
    def doubtful(self) -> bool:
        """Whether an end is farther in or out than it should be, by more than a fifth."""
        low, high = (NORMAL_95**2 * OFF**sign for sign in (-2, 2))
        return not all(low <= rise <= high for rise in (self.below, self.above))


def interval_ends(problem: Problem, assessment: Assessment, values: Floats) -> IntervalEnds | None:
    """Phi at the ends of the interval of the least known parameter; the others follow it.

    None where that is known well enough, where a bound is near (`profile_path` evaluates the
    model there), and with robust losses, which are not quadratic anyway.

    Args:
        problem: of the fit.
        assessment: of the model linearised at the estimate.
        values: (n,) the estimate, SI.
    """
    if not isinstance(problem.loss, SquaredOptions) or assessment.at_bound.any():
        return None
    candidates = assessment.determined & ~assessment.beyond_bounds & (values != 0.0)
    candidates &= np.array([not q.field for q in problem.parameters], dtype=np.bool_)
    relative = np.where(candidates, assessment.sd, 0.0) / np.where(
        values != 0.0, np.abs(values), 1.0
    )
    if not len(values) or not relative.max() > UNCERTAIN:
        return None
    i = int(np.argmax(relative))
    F = assessment.uncut_factor
    step = NORMAL_95 * (F @ F[i]) / np.linalg.norm(F[i])
    discrepancy = Discrepancy(problem)
    least = discrepancy.objective(values)
    below, above = (
        discrepancy.objective(discrepancy.scaling.away(values, sign * step)) - least
        for sign in (-1.0, 1.0)
    )
    return IntervalEnds(i, below, above)
