"""A bound limits, it does not inform: intervals and bands are those of a truncated posterior."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.stats import norm, truncnorm

from geoident.identify.assessment.prediction_bands import predict_band
from geoident.identify.assessment.uncertainty import assess
from geoident.identify.problem.problem import Problem
from geoident.model.parameter import Parameter


def problem_of(jacobian, measured=None):
    n = jacobian.shape[1]
    parameters = tuple(Parameter(f"p{k}", 0.5, 0.0, 1.0) for k in range(n))
    readings = np.zeros(len(jacobian)) if measured is None else measured
    return Problem(None, readings, np.ones(len(jacobian)), parameters)


def test_on_a_bound_with_a_gradient_the_density_falls_from_it():
    """A reading says -0.1 +- 0.1 of what is at least 0."""
    jacobian = np.array([[10.0]])
    problem = problem_of(jacobian, np.array([-1.0]))
    found = assess(problem, np.zeros(1), jacobian, np.zeros(1))
    law = truncnorm(1.0, np.inf, loc=-0.1, scale=0.1)
    np.testing.assert_allclose(
        [found.lower95[0], found.upper95[0]], [0.0, law.ppf(0.95)], rtol=0.01
    )
    assert found.at_bound.tolist() == [True]
    assert found.beyond_bounds.tolist() == [True]


def test_the_interval_of_another_parameter_follows_the_one_on_its_bound():
    """Their difference is known to 0.01, the first to 0.1: both are open to the same side."""
    jacobian = np.array([[10.0, 0.0], [100.0, -100.0]])
    values = np.array([0.0, 0.3])
    found = assess(problem_of(jacobian), values, jacobian)
    half = norm.ppf(0.975) * 0.1
    np.testing.assert_allclose([found.lower95[0], found.upper95[0]], [0.0, half], rtol=0.01)
    assert found.lower95[1] == pytest.approx(0.29, abs=0.01)
    assert found.upper95[1] == pytest.approx(0.3 + half, abs=0.01)
    band = predict_band(found, np.array([[0.0, 1.0]]), np.array([0.02]))
    assert band.upper95[0] == pytest.approx(half, abs=0.02)
    assert -0.05 < band.lower95[0] < 0.0
    assert band.upper95[0] > 3.0 * -band.lower95[0]


def test_a_prediction_that_rests_on_what_a_bound_hides_is_not_determined():
    """The sum is known, nothing else; the first lies on its bound."""
    jacobian = np.array([[100.0, 100.0]])
    found = assess(problem_of(jacobian), np.array([0.0, 0.5]), jacobian)
    band = predict_band(found, np.array([[0.0, 1.0], [1.0, 1.0]]), np.full(2, 0.01))
    assert np.isinf(band.sd).tolist() == [True, False]
    assert band.lower95[0] == -np.inf


def test_a_direction_does_not_fall_between_two_spectra():
    jacobian = np.linalg.cholesky(np.array([[10.0, 1.0], [1.0, 10.0]])).T
    known = assess(problem_of(jacobian), np.array([0.0, 0.5]), jacobian)
    band = predict_band(known, np.array([[0.0, 1.0]]), np.array([0.01]))
    # within its bounds the second is not known at all, so hardly less than evenly spread
    assert band.sd[0] >= 0.8 / np.sqrt(12.0)
