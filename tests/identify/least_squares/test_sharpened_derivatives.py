"""Where derivatives are differences, a descent ends only where better ones let it."""

import numpy as np
import pytest

from geoident.identify.problem.methods import identify
from geoident.identify.problem.problem import Problem
from geoident.model.methods import GaussNewtonOptions
from geoident.model.parameter import Parameter
from geoident.model.results.costs import Counts

A = np.array([[1.0, 0.2], [0.5, 1.0], [-0.3, 0.8], [0.9, -0.4]])
OFF = A + 0.1 * np.array([[1.0, -1.0], [-1.0, 0.5], [0.5, 1.0], [0.2, -0.7]])
MEASURED = np.array([2.0, 1.0, 3.0, -1.0])


class Rough:
    """Readings A p, with derivatives that are off until they are asked to be better."""

    names = ("a", "b")
    counts = Counts(0, 0, 0, 0)

    def __init__(self, *, sharpens=True):
        self.sharpens, self.exact = sharpens, []

    def admissible(self, p):
        return None

    def readings(self, p):
        return A @ p

    def evaluate(self, p):
        known = any(np.array_equal(p, q) for q in self.exact)
        return A @ p, (A if known else OFF)

    def sharpen(self, p):
        if not self.sharpens or any(np.array_equal(p, q) for q in self.exact):
            return False
        self.exact.append(p.copy())
        return True


def end_of(response):
    parameters = tuple(Parameter(n, start=0.5, lower=-9.0, upper=9.0) for n in response.names)
    problem = Problem(response, MEASURED, np.ones(4), parameters)
    return identify(problem, (GaussNewtonOptions(starts=1),), lambda iteration: None)


def test_the_end_is_that_of_the_better_derivatives():
    best = np.linalg.lstsq(A, MEASURED, rcond=None)[0]
    response = Rough()
    found = end_of(response)
    assert found.status == "converged"
    assert found.values == pytest.approx(best, rel=1e-6)
    assert any(np.array_equal(found.values, p) for p in response.exact)
    assert len(response.exact) <= 4


def test_without_them_it_would_be_elsewhere():
    best = np.linalg.lstsq(A, MEASURED, rcond=None)[0]
    assert np.abs(end_of(Rough(sharpens=False)).values - best).max() > 1e-2
