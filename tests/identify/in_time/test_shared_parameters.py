"""Parameters shared by gauges against generalized least squares of all readings at once, dense."""

from itertools import pairwise

import numpy as np
import pytest
from scipy.linalg import block_diag

from geoident.identify.assessment.uncertainty import assess
from geoident.identify.in_time.noise import Noise
from geoident.identify.in_time.regression import TimeRegression
from geoident.identify.in_time.shared_parameters import (
    ErrorsOfModel,
    GaugeProjection,
    ProjectedResponse,
    state_with_parameters,
)
from geoident.identify.least_squares.gauss_newton import gauss_newton
from geoident.identify.problem.problem import Problem
from geoident.model.in_service import YEAR
from geoident.model.methods import GaussNewtonOptions
from geoident.model.parameter import Parameter
from geoident.model.results.costs import NO_COST

NOISES = (Noise(0.5, 0.8, 30.0, drift=300.0), Noise(0.3), Noise(0.2, 0.5, 4.0))


def covariance(noise, times):
    gap = np.abs(times[:, None] - times)
    both = 1.0 + (np.minimum(times[:, None], times) - times[0]) / YEAR  # of a random walk
    errors = noise.white**2 * np.eye(len(times)) + noise.lasting**2 * np.exp(-gap / noise.time)
    return errors + noise.drift**2 * both


@pytest.fixture(scope="module")
def readings():
    """Three gauges of 40 to 60 readings at odd times, with two parameters that all share."""
    rng = np.random.default_rng(11)
    times = [np.sort(rng.uniform(0, 200, m)) for m in (40, 60, 50)]
    X = [np.column_stack([np.ones(len(t)), t / 200.0][: 1 + (k != 1)]) for k, t in enumerate(times)]
    J = [rng.standard_normal((len(t), 2)) + np.sin(t / 20.0)[:, None] for t in times]
    y = [
        j @ [2.0, -1.0] + x @ np.arange(1.0, 1 + x.shape[1])
        + np.linalg.cholesky(covariance(noise, t)) @ rng.standard_normal(len(t))
        for j, x, t, noise in zip(J, X, times, NOISES, strict=True)
    ]  # fmt: skip
    return times, X, J, y


@pytest.fixture(scope="module")
def dense(readings):
    """Estimate and covariance of (two parameters, own terms of each gauge), in one system."""
    times, X, J, y = readings
    columns = np.hstack([np.concatenate(J), block_diag(*X)])
    S = block_diag(*(covariance(n, t) for n, t in zip(NOISES, times, strict=True)))
    C = np.linalg.inv(columns.T @ np.linalg.solve(S, columns))
    return C @ columns.T @ np.linalg.solve(S, np.concatenate(y)), C


def fitted(readings):
    times, X, J, y = readings
    rows = [slice(a, b) for a, b in pairwise(np.cumsum([0, *map(len, times)]))]
    projections = [GaugeProjection(*parts) for parts in zip(NOISES, times, X, strict=True)]
    jacobian = np.concatenate(J)
    response = ProjectedResponse(
        ("a", "b"), lambda p: (jacobian @ p, jacobian), lambda _: None, lambda: NO_COST, rows,
        projections,
    )  # fmt: skip
    measured = response.projected(np.concatenate(y)[:, None])[:, 0]
    parameters = tuple(Parameter(name, 1.0, -50.0, 50.0) for name in "ab")
    problem = Problem(response, measured, np.ones(len(measured)), parameters)
    values = gauss_newton(problem, GaussNewtonOptions(), lambda _: None).values
    return problem, values, assess(problem, values, response.evaluate(values)[1])


def test_estimate_and_covariance_are_those_of_all_readings_at_once(readings, dense):
    _, values, assessment = fitted(readings)
    b, C = dense
    assert values == pytest.approx(b[:2], rel=1e-7)
    assert assessment.covariance == pytest.approx(C[:2, :2], rel=1e-4)


def test_what_is_known_of_a_gauge_is_that_of_all_readings_at_once(readings, dense):
    """Its terms, the parameters, and the error that lasts, which goes on from its last reading."""
    times, X, J, y = readings
    _, values, assessment = fitted(readings)
    b, C = dense
    first = 2
    for k, noise in enumerate(NOISES):
        q = X[k].shape[1]
        regression = TimeRegression(times[k], y[k] - J[k] @ values, X[k], noise)
        state = state_with_parameters(regression, J[k], assessment.covariance)
        own = [*range(first, first + q), 0, 1]
        assert state.mean[:q] == pytest.approx(b[own[:q]], rel=1e-6)
        assert state.P[:-2, :-2] == pytest.approx(C[np.ix_(own, own)], rel=1e-3, abs=1e-9)
        # errors u at the end given all readings: k S^-1 (y - columns b), with what is unknown of b
        since = times[k][-1] - times[k]
        lasting = noise.lasting**2 * np.exp(-since / noise.time)
        drift = noise.drift**2 * (1.0 + (times[k] - times[k][0]) / YEAR)
        kept = np.column_stack([lasting, drift])
        solved = np.linalg.solve(covariance(noise, times[k]), kept)
        columns = np.hstack([X[k], J[k]])
        left = y[k] - columns @ b[own]
        assert state.mean[-2:] == pytest.approx(solved.T @ left, rel=1e-5, abs=1e-6)
        pull = columns.T @ solved
        known = C[np.ix_(own, own)]
        own_part = np.diag(kept[-1]) - kept.T @ solved
        assert state.P[-2:, -2:] == pytest.approx(
            own_part + pull.T @ known @ pull, rel=1e-3, abs=1e-6
        )
        assert state.P[:-2, -2:] == pytest.approx(-known @ pull, rel=1e-3, abs=1e-5)
        first += q


def test_errors_of_the_model_are_those_of_all_readings_at_once(readings):
    """Coefficients of gauges that go together add their covariance to that of the readings."""
    times, X, J, y = readings
    rng = np.random.default_rng(12)
    Z = [np.column_stack([np.sin(t / 9.0), rng.standard_normal(len(t))]) for t in times]
    root, eta = np.tril(rng.standard_normal((6, 6))), 0.4
    W = block_diag(*Z) @ root
    S = block_diag(*(covariance(n, t) for n, t in zip(NOISES, times, strict=True)))
    S = S + eta**2 * W @ W.T
    columns = np.hstack([np.concatenate(J), block_diag(*X)])
    C = np.linalg.inv(columns.T @ np.linalg.solve(S, columns))
    b = C @ columns.T @ np.linalg.solve(S, np.concatenate(y))
    projections = [GaugeProjection(*parts) for parts in zip(NOISES, times, X, strict=True)]
    errors = ErrorsOfModel([of(own) for of, own in zip(projections, Z, strict=True)], root)
    rows = [slice(a, b) for a, b in pairwise(np.cumsum([0, *map(len, times)]))]
    jacobian = np.concatenate(J)
    response = ProjectedResponse(
        ("a", "b"), lambda p: (jacobian @ p, jacobian), lambda _: None, lambda: NO_COST, rows,
        projections, (errors, eta),
    )  # fmt: skip
    both = response.projected(np.column_stack([jacobian, np.concatenate(y)]))
    N = both[:, :2].T @ both[:, :2]
    assert np.linalg.inv(N) == pytest.approx(C[:2, :2], rel=1e-4)
    assert np.linalg.solve(N, both[:, :2].T @ both[:, 2]) == pytest.approx(b[:2], rel=1e-5)
