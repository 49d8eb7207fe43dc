"""Later readings, given those that were used: the errors that both share are known in part.

With Sigma the covariance of the used readings, J their Jacobian and C that of later readings with
used ones (the error of a zero, for instance, is in all of them), the best prediction of later
readings is

    mean       v_l + C Sigma^-1 (v* - v)
    variance   (J_l - C Sigma^-1 J) cov (J_l - C Sigma^-1 J)^T + Sigma_l - C Sigma^-1 C^T

Where nothing is shared these are v_l and the band of theory 6. (Best linear unbiased prediction,
Goldberger 1962.)

For a draw p of the posterior the same is drawn (theory 11.6, Matheron's rule): with the shared
errors z and the own errors of used and later readings from their distributions,

    y_l = v_l(p) + B_l z + s_l n + C Sigma^-1 (y - v(p) - B z - s n')        C = B_l B^T .
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy.sparse as sp

from geoident.identify.problem.problem import Problem
from geoident.identify.problem.shared_errors import Covariance, ErrorStructure, SharedErrors
from geoident.model.arrays import Floats


@dataclass(frozen=True)
class LaterReadings:
    """l later readings as the used ones imply them.

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
    B, used = later.columns, _errors_of_used(problem, later)
    variance = later.sd**2 + used.conditional_variance(B)
    gap = problem.measured - readings
    known = B @ used.expected_shared(np.column_stack([gap, jacobian]))
    return LaterReadings(
        np.asarray(known[:, 0]),
        later_jacobian - known[:, 1:],
        np.sqrt(np.maximum(variance, later.sd**2)),
    )


def _errors_of_used(problem: Problem, later: ErrorStructure) -> Covariance:
    """Covariance of the used readings, which share nothing where the problem says so."""
    if problem.covariance is not None:
        return problem.covariance
    none = sp.csr_array((len(problem.sd), later.columns.shape[1]))
    return Covariance(problem.sd, SharedErrors(none))


def later_covariance(problem: Problem, later: ErrorStructure) -> Floats:
    """Covariance (l, l) of the errors of later readings that the used ones leave, SI.

    Args:
        problem: the used readings.
        later: the errors of the later readings, with the shared errors of the used ones.
    """
    left = _errors_of_used(problem, later).conditional_covariance(later.columns)
    return np.asarray(np.diag(later.sd**2) + left)


def simulated_readings(
    problem: Problem,
    answers: Floats,
    later_answers: Floats,
    later: ErrorStructure,
    rng: np.random.Generator,
) -> Floats:
    """Later readings (k, m) with their errors, SI, one row for each draw of the parameters.

    Args:
        problem: the used readings, with their own standard deviations as the loss leaves them.
        answers: (k, g) the model's used readings at each draw, SI.
        later_answers: (k, m) the model's later readings.
        later: the errors of the later readings, with the shared errors of the used ones.
        rng: of random numbers.
    """
    B, used = later.columns, _errors_of_used(problem, later)
    drawn = np.asarray(later_answers + later.sd * rng.standard_normal(later_answers.shape))
    if not B.shape[1]:
        return drawn
    z = rng.standard_normal((len(answers), B.shape[1]))
    errors = (used.shared.columns @ z.T).T + problem.sd * rng.standard_normal(answers.shape)
    known = used.expected_shared((problem.measured - answers - errors).T)
    return np.asarray(drawn + (B @ (z.T + known)).T)
