"""A parameter on its bound must not make what depends on the others look better known."""

from __future__ import annotations

import numpy as np

from geoident.identify.assessment.uncertainty import assess, predict_band
from geoident.identify.problem.problem import Problem
from geoident.model.parameter import Parameter


def _problem(jacobian):
    n = jacobian.shape[1]
    parameters = tuple(Parameter(f"p{k}", 0.5, 0.0, 1.0) for k in range(n))
    readings = np.zeros(len(jacobian))
    return Problem(None, readings, np.ones(len(jacobian)), parameters)


def test_a_direction_does_not_fall_between_two_spectra():
    jacobian = np.linalg.cholesky(np.array([[10.0, 1.0], [1.0, 10.0]])).T
    known = assess(_problem(jacobian), np.array([0.0, 0.5]), jacobian)
    (band,) = predict_band(known, np.array([[0.0, 1.0]]), np.array([0.01]))
    conditional = np.hypot(1 / np.sqrt(10.0), 0.01)
    assert band >= 0.99 * conditional


def test_bands_at_a_bound_are_those_of_the_problem_without_the_parameter():
    rng = np.random.default_rng(1)
    for _ in range(300):
        n = int(rng.integers(2, 5))
        jacobian = rng.normal(size=(n + 1, n)) * 10 ** rng.uniform(-1, 2, n)
        values = np.full(n, 0.5)
        values[0] = 0.0
        row, sd = rng.normal(size=(1, n)), np.array([0.01])
        known = assess(_problem(jacobian), values, jacobian)
        reduced = assess(_problem(jacobian[:, 1:]), values[1:], jacobian[:, 1:])
        np.testing.assert_allclose(
            predict_band(known, row, sd), predict_band(reduced, row[:, 1:], sd), rtol=1e-9
        )
