"""Later readings of draws: at fixed parameters exactly what conditioning says (theory 7.4)."""

from __future__ import annotations

import numpy as np
import scipy.sparse as sp

from geoident.identify.assessment.later_readings import given_used, simulated_readings
from geoident.identify.problem.problem import Problem
from geoident.identify.problem.shared_errors import ErrorStructure, SharedErrors
from geoident.model.parameter import Parameter
from geoident.model.results.costs import Counts

DRAWS = 200_000


class Fixed:
    names = ("a",)
    counts = Counts()

    def admissible(self, p):
        return None

    def readings(self, p):
        return np.zeros(3)

    def evaluate(self, p):
        return np.zeros(3), np.zeros((3, 1))


def test_means_variances_and_covariances_of_later_readings():
    used = sp.csr_array(np.array([[1.0, 0.0, 0.0], [1.0, 0.5, 0.0], [0.0, 0.5, 0.0]]))
    rows = sp.csr_array(np.array([[1.0, 0.0, 0.3], [0.0, 0.5, 0.3]]))
    problem = Problem(
        Fixed(),
        np.array([0.9, 1.4, -0.2]),
        np.array([0.3, 0.4, 0.2]),
        (Parameter("a", 1.0, 0.0, 2.0),),
        shared=SharedErrors(used),
    )
    later = ErrorStructure(
        np.array([0.25, 0.35]), np.array([-1, -1]), rows, np.array([-1, -1, -1]), ()
    )
    v, later_v = np.array([0.1, 0.2, 0.3]), np.array([5.0, 7.0])
    found = simulated_readings(
        problem,
        np.tile(v, (DRAWS, 1)),
        np.tile(later_v, (DRAWS, 1)),
        later,
        np.random.default_rng(0),
    )
    expected = given_used(
        problem, v, np.zeros((3, 1)), later=later, later_jacobian=np.zeros((2, 1))
    )
    np.testing.assert_allclose(found.mean(axis=0), later_v + expected.shift, atol=0.005)
    np.testing.assert_allclose(found.std(axis=0), expected.sd, rtol=0.01)
    B, L = used.toarray(), rows.toarray()
    sigma = np.diag(problem.sd**2) + B @ B.T
    cross = L @ B.T
    whole = np.diag([0.25**2, 0.35**2]) + L @ L.T - cross @ np.linalg.solve(sigma, cross.T)
    np.testing.assert_allclose(np.cov(found.T), whole, atol=0.003)
