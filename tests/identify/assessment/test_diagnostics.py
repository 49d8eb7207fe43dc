"""Leverage and influence against their textbook forms and against refits without each reading."""

from dataclasses import replace

import numpy as np
import pytest

from geoident.identify.assessment.diagnostics import diagnose, effective_sd
from geoident.identify.assessment.uncertainty import assess
from geoident.identify.least_squares.gauss_newton import gauss_newton
from geoident.model.methods import GaussNewtonOptions, HuberOptions
from geoident.model.parameter import Parameter, Prior

X = np.array([0.0, 0.4, 1.1, 1.5, 2.2, 2.9, 3.1, 8.0])
SD = np.array([0.1, 0.1, 0.2, 0.1, 0.1, 0.3, 0.1, 0.2])


def line(p):
    return p[0] + p[1] * X


def parameters(prior=None):
    return [Parameter("a", 0.5, -50.0, 50.0), Parameter("b", 1.0, -50.0, 50.0, prior=prior)]


@pytest.fixture
def noisy():
    return 2.0 + 0.7 * X + SD * np.random.default_rng(4).normal(size=8)


def fitted(problem):
    return gauss_newton(problem, GaussNewtonOptions(tolerance=1e-12), lambda i: None).values


def diagnosed(problem, sets=None):
    p = fitted(problem)
    v, J = problem.response.evaluate(p)
    known = assess(replace(problem, sd=effective_sd(problem, v)), p, J)
    sets = np.arange(len(v)) if sets is None else np.array(sets)
    return p, known, diagnose(problem, known, v, J, sets)


def without(problem, keep):
    """The same problem without some of its readings."""
    response = replace_function(problem.response, keep)
    return replace(problem, response=response, measured=problem.measured[keep], sd=problem.sd[keep])


def replace_function(response, keep):
    return type(response)(lambda p: response.function(p)[keep], response.names)


@pytest.mark.parametrize("prior", [None, Prior(0.75, 0.02)])
def test_influence_is_the_change_by_a_refit_without_the_reading(make_problem, noisy, prior):
    problem = make_problem(line, parameters(prior), noisy, SD)
    p, known, found = diagnosed(problem)
    C = known.covariance
    for i in range(8):
        change = p - fitted(without(problem, np.arange(8) != i))
        np.testing.assert_allclose(found.influence[i], change / np.sqrt(np.diag(C)), atol=1e-6)
        cook = change @ np.linalg.solve(C, change) / 2
        assert found.distance[i] == pytest.approx(cook, rel=1e-5, abs=1e-9)


def test_readings_of_a_set_are_removed_together(make_problem, noisy):
    problem = make_problem(line, parameters(), noisy, SD)
    sets = [0, 1, 1, 2, 3, 4, 5, 1]
    p, known, found = diagnosed(problem, sets)
    change = p - fitted(without(problem, np.array(sets) != 1))
    np.testing.assert_allclose(
        found.influence[1], change / np.sqrt(np.diag(known.covariance)), atol=1e-6
    )
    assert found.leverage.sum() == pytest.approx(2.0)


def test_a_reading_that_decides_alone_has_leverage_one_and_no_studentized_residual(make_problem):
    problem = make_problem(lambda p: p[[0, 0, 1]], parameters(), [1.0, 1.2, 5.0], 0.1)
    _, _, found = diagnosed(problem)
    np.testing.assert_allclose(found.leverage, [0.5, 0.5, 1.0], atol=1e-12)
    assert np.isnan(found.studentized[2])
    assert found.influence[2].tolist() == [0.0, np.inf]
    assert np.isfinite(found.influence[:2]).all()


def test_a_parameter_on_its_bound_is_not_influenced(make_problem, noisy):
    free, held = parameters()
    _, _, found = diagnosed(
        make_problem(line, [free, replace(held, start=0.5, upper=0.6)], noisy, SD)
    )
    assert np.all(found.influence[:, 1] == 0.0)
    assert found.leverage.sum() == pytest.approx(1.0)


def test_a_gross_error_is_the_reading_that_bears_most(make_problem, noisy):
    noisy[7] += 3.0
    problem = make_problem(line, parameters(), noisy, SD)
    assert np.argmax(diagnosed(problem)[2].distance) == 7
    robust = diagnosed(replace(problem, loss=HuberOptions()))[2]
    assert robust.studentized[7] > 10.0
    assert robust.distance[7] < diagnosed(problem)[2].distance[7]
    assert robust.weight[7] < 0.2


def test_the_scale_is_that_of_the_majority(make_problem):
    rng = np.random.default_rng(0)
    measured = np.append(3.0 * rng.normal(size=900), np.full(100, 500.0))
    problem = make_problem(
        lambda p: np.zeros(1000) * p[0], [Parameter("a", 0.0, -1, 1)], measured, 1.0
    )
    known = assess(problem, np.zeros(1), np.zeros((1000, 1)))
    found = diagnose(problem, known, np.zeros(1000), np.zeros((1000, 1)), np.arange(1000))
    assert found.scale == pytest.approx(3.0, rel=0.2)
