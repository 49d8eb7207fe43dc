"""Later readings, given those that were used: what both share of their errors is known in part.

With Sigma the covariance of the used readings, J their Jacobian and C that of later readings with
used ones (the error of a zero, for instance, is in all of them), the best prediction of later
readings is

    mean       v_l + C Sigma^-1 (v* - v)
    variance   (J_l - C Sigma^-1 J) cov (J_l - C Sigma^-1 J)^T + Sigma_l - C Sigma^-1 C^T

Where nothing is shared these are v_l and the band of theory 6. (Best linear unbiased prediction,
Goldberger 1962.)
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from geoident.identify.problem.errors import ErrorStructure, SharedErrors
from geoident.identify.problem.problem import Problem
from geoident.model.arrays import Floats


@dataclass(frozen=True)
class LaterReadings:
    """l later readings as the used ones let expect them.

    Args:
        shift: (l,) what to add to the model's answers, SI.
        jacobian: (l, n) derivative of the prediction, SI.
        sd: (l,) standard deviation of what errors are left, SI.
    """

    shift: Floats
    jacobian: Floats
    sd: Floats


def given_used(
    problem: Problem,
    readings: Floats,
    jacobian: Floats,
    *,
    later: ErrorStructure,
    later_jacobian: Floats,
) -> LaterReadings:
    """Later readings, given the used ones.

    Args:
        problem: the used readings, their own standard deviations as the loss leaves them.
        readings: (g,) v at the estimate, SI.
        jacobian: (g, n) its derivative, SI.
        later: the errors of the later readings, with the shared errors of the used ones.
        later_jacobian: (l, n) SI.
    """
    sd, shared = later.stated
    if problem.covariance is None or shared is None:
        total = sd**2 + _squares(shared) if shared is not None else sd**2
        return LaterReadings(np.zeros(len(sd)), later_jacobian, np.sqrt(total))
    used, B = problem.covariance, shared.columns
    found = sd**2 + used.conditional_variance(B)
    return LaterReadings(
        np.asarray(B @ used.expected_shared(problem.measured - readings)),
        later_jacobian - B @ used.expected_shared(jacobian),
        np.sqrt(np.maximum(found, sd**2)),
    )


def later_covariance(problem: Problem, later: ErrorStructure) -> Floats:
    """Covariance (l, l) of the errors of later readings that the used ones leave, SI.

    Args:
        problem: the used readings.
        later: the errors of the later readings, with the shared errors of the used ones.
    """
    sd, shared = later.stated
    found = np.array(np.diag(sd**2))
    if shared is not None and problem.covariance is None:
        found += (shared.columns @ shared.columns.T).toarray()
    elif shared is not None and problem.covariance is not None:
        found += problem.covariance.conditional_covariance(shared.columns)
    return found


def _squares(shared: SharedErrors) -> Floats:
    """Variance (l,) of what each reading shares."""
    return np.asarray(shared.columns.power(2).sum(axis=1), dtype=np.float64).ravel()
