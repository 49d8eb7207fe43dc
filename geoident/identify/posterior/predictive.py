"""Readings that draws of the posterior predict, with their errors (theory 11.6).

With the shared errors z and the own errors of used and later readings drawn from their
distributions, later readings given the used ones y are (Matheron's rule)

    y_l = v_l(p) + B_l z + s_l n + C Sigma^-1 (y - v(p) - B z - s n')        C = B_l B^T

for every draw p: exactly normal with the mean and covariance of theory 7.4 at fixed p.
"""

from __future__ import annotations

import numpy as np

from geoident.identify.problem.errors import ErrorStructure
from geoident.identify.problem.problem import Problem
from geoident.model.arrays import Floats


def with_errors(
    problem: Problem,
    answers: Floats,
    later_answers: Floats,
    later: ErrorStructure,
    rng: np.random.Generator,
) -> Floats:
    """Later readings (k, m), SI, one row for each draw.

    Args:
        problem: the used readings, with their own standard deviations as the loss leaves them.
        answers: (k, g) what the model says of the used readings at each draw, SI.
        later_answers: (k, m) what it says of the later ones.
        later: the errors of the later readings, with the shared errors of the used ones.
        rng: of random numbers.
    """
    sd, shared = later.stated
    found = later_answers + sd * rng.standard_normal(later_answers.shape)
    if shared is None:
        return np.asarray(found)
    z = rng.standard_normal((len(answers), len(shared)))
    found += (shared.columns @ z.T).T
    used = problem.covariance
    if used is None:
        return np.asarray(found)
    errors = (used.shared.columns @ z.T).T + problem.sd * rng.standard_normal(answers.shape)
    known = used.expected_shared((problem.measured - answers - errors).T)
    return np.asarray(found + (shared.columns @ known).T)
