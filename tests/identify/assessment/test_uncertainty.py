import numpy as np
import pytest
from scipy.stats import norm

from geoident.identify.assessment.prediction_bands import predict_band
from geoident.identify.assessment.uncertainty import assess
from geoident.identify.least_squares.gauss_newton import gauss_newton
from geoident.identify.problem.problem import Problem
from geoident.model.methods import GaussNewtonOptions
from geoident.model.parameter import Parameter, Prior
from geoident.model.results.findings import sentences_of

G = 6
SHAPE = np.linspace(1.0, 2.0, G)
VALUES = np.array([15e9, 8e6, 1.0, 0.25])
NAMES = ("E", "sigma_v", "K0", "nu")


def tunnel(p):
    """Readings of an elastic ground: only sigma_v / E and K0 are seen, nu is not."""
    return SHAPE * p[1] / p[0] * (1.0 + np.linspace(-0.3, 0.5, len(SHAPE)) * p[2])


def parameters(prior=None):
    return (
        Parameter("E", 15e9, 2e9, 80e9, "log"),
        Parameter("sigma_v", 8e6, 2e6, 20e6, prior=prior),
        Parameter("K0", 1.0, 0.3, 3.0),
        Parameter("nu", 0.25, 0.05, 0.45),
    )


@pytest.fixture
def assessed(make_problem):
    def make(prior=None, values=VALUES):
        v = tunnel(values)
        problem = make_problem(tunnel, parameters(prior), v, 0.01 * v.mean())
        return problem, assess(problem, values, problem.response.evaluate(values)[1])

    return make


# Against closed forms


def linear(rng, n=3, g=7, prior=None):
    A, s = rng.normal(size=(g, n)), rng.uniform(0.1, 0.3, g)
    q = tuple(Parameter(f"x{i}", 1.0, -100.0, 100.0, prior=prior) for i in range(n))
    return A, s, q


@pytest.mark.parametrize("prior", [None, Prior(0.5, 0.4)])
def test_covariance_of_a_linear_model_is_that_of_bayesian_regression(prior):
    A, s, q = linear(np.random.default_rng(1), prior=prior)
    found = assess(Problem(None, np.zeros(7), s, q), np.ones(3), A)
    precision = A.T @ np.diag(s**-2) @ A + (np.eye(3) / 0.16 if prior else 0.0)
    expected = np.linalg.inv(precision)
    sd = np.sqrt(np.diag(expected))
    np.testing.assert_allclose(found.covariance, expected, rtol=1e-10)
    np.testing.assert_allclose(found.sd, sd, rtol=1e-10)
    np.testing.assert_allclose(found.correlation, expected / np.outer(sd, sd), rtol=1e-10)
    np.testing.assert_allclose(found.upper95 - found.lower95, 2 * norm.ppf(0.975) * sd, rtol=1e-10)
    later = np.random.default_rng(2).normal(size=(2, 3))
    band = predict_band(found, later, np.array([0.1, 0.2])).sd
    variance = np.diag(later @ expected @ later.T) + np.array([0.1, 0.2]) ** 2
    np.testing.assert_allclose(band, np.sqrt(variance), rtol=1e-10)


def test_the_scale_of_a_parameter_changes_its_interval_but_not_its_standard_deviation():
    s, jacobian, value = np.array([0.1]), np.array([[1.0]]), np.array([1.0])
    log, lin = (
        assess(Problem(None, np.zeros(1), s, (Parameter("E", 1.0, 0.01, 9.0, k),)), value, jacobian)
        for k in ("log", "linear")
    )
    np.testing.assert_allclose(log.sd, lin.sd, rtol=1e-12)
    np.testing.assert_allclose(lin.lower95, 1.0 - 0.1959964)
    np.testing.assert_allclose([log.lower95, log.upper95], np.exp([[-0.1959964], [0.1959964]]))


@pytest.mark.parametrize("replicates", [60, pytest.param(1000, marks=pytest.mark.slow)])
def test_intervals_hold_the_truth_in_95_of_100_replicates(make_problem, replicates):
    t = np.linspace(0.2, 3.0, 12)
    true, s = np.array([2.0, 1.0]), 0.02

    def decay(p):
        return p[0] * np.exp(-p[1] * t)

    rng = np.random.default_rng(5)
    q = (Parameter("a", 1.5, 0.1, 10.0, "log"), Parameter("k", 1.5, 0.1, 10.0, "log"))
    inside = np.zeros(2)
    for _ in range(replicates):
        problem = make_problem(decay, q, decay(true) + s * rng.normal(size=12), s)
        values = gauss_newton(problem, GaussNewtonOptions(), lambda it: None).values
        found = assess(problem, values, problem.response.evaluate(values)[1])
        inside += (found.lower95 <= true) & (true <= found.upper95)
    # four standard deviations of a binomial proportion
    off = 4.0 * np.sqrt(0.95 * 0.05 / replicates)
    np.testing.assert_allclose(inside / replicates, 0.95, atol=off)


# What is not determined


def test_parameters_that_scale_together_are_named_and_their_ratio_is_given(assessed):
    _, found = assessed()
    assert found.determined.tolist() == [False, False, True, False]
    assert np.isnan(found.sd).tolist() == [True, True, False, True]
    ratio, low, high = ratio_and_interval(0.01 * tunnel(VALUES).mean())
    assert set(sentences_of(found.findings)) == {
        "The readings cannot separate E and sigma_v: scaled by one factor, they leave the readings "
        f"the same within the errors. sigma_v / E is determined: {ratio:.4g} (95 %: {low:.4g} to "
        f"{high:.4g}, SI units).",
        "The readings do not determine nu.",
    }


def ratio_and_interval(sd):
    """sigma_v / E and its 95 % interval, from the two parameters that the readings determine."""
    ratio, K0 = VALUES[1] / VALUES[0], VALUES[2]
    slopes = np.linspace(-0.3, 0.5, G)
    by_log, by_K0 = SHAPE * ratio * (1.0 + slopes * K0), SHAPE * ratio * slopes
    covariance = np.linalg.inv(np.array([by_log, by_K0]) @ np.array([by_log, by_K0]).T / sd**2)
    half = norm.ppf(0.975) * np.sqrt(covariance[0, 0])
    return ratio, ratio * np.exp(-half), ratio * np.exp(half)


def test_a_determined_parameter_keeps_its_number_whatever_others_lack(assessed, make_problem):
    problem, found = assessed()
    J = problem.response.evaluate(VALUES)[1]
    columns = J[:, [0, 2]] / problem.sd[:, None]
    alone = np.sqrt(np.linalg.inv(columns.T @ columns)[1, 1])
    np.testing.assert_allclose(found.sd[2], alone, rtol=1e-3)


def test_a_prior_separates_what_the_readings_do_not(assessed):
    _, found = assessed(Prior(8e6, 1e6))
    assert found.determined.tolist() == [True, False, True, False]
    assert found.sd[0] == pytest.approx(15e9 / 8.0, rel=1e-2)
    ratio, low, high = ratio_and_interval(0.01 * tunnel(VALUES).mean())
    assert set(sentences_of(found.findings)) == {
        "The readings cannot separate E and sigma_v: scaled by one factor, they leave the readings "
        "the same within the errors. Only the prior of sigma_v separates them. "
        f"sigma_v / E is determined: {ratio:.4g} (95 %: {low:.4g} to {high:.4g}, SI units).",
        "The readings do not determine nu.",
        "sigma_v is known only from its prior: the readings hardly add to it. "
        "The results for E rest mainly on that prior.",
    }


def test_a_parameter_of_which_only_the_prior_tells_is_not_determined():
    q = (
        Parameter("E", 1.0, 0.1, 10.0, "log"),
        Parameter("nu", 0.25, 0.0, 0.5, prior=Prior(0.25, 0.02)),
    )
    J = np.array([[1.0, 0.0], [2.0, 0.0]])
    found = assess(Problem(None, np.zeros(2), np.full(2, 0.01), q), np.array([1.0, 0.25]), J)
    assert found.determined.tolist() == [True, False]
    assert sentences_of(found.findings) == (
        "The readings do not determine nu: it is known only from its prior.",
    )


def test_readings_that_say_nothing_determine_nothing():
    found = assess(Problem(None, np.zeros(2), np.ones(2), parameters()), VALUES, np.zeros((2, 4)))
    assert not found.determined.any()
    assert len(found.findings) == 4
    assert np.all(np.isinf(predict_band(found, np.ones((1, 4)), np.array([1e-4])).sd))


def test_a_bound_does_not_hide_that_two_parameters_cannot_be_told_apart(assessed):
    values = VALUES.copy()
    values[1] = 20e6
    _, found = assessed(values=values)
    assert found.at_bound.tolist() == [False, True, False, False]
    assert found.determined.tolist() == [False, False, True, False]
    assert any("sigma_v lies on its upper bound" in text for text in sentences_of(found.findings))


def test_a_parameter_on_its_bound_is_unknown_on_one_side():
    """Nothing presses it: half a normal distribution, and the others follow it."""
    A, s, q = linear(np.random.default_rng(1))
    found = assess(Problem(None, np.zeros(7), s, q), np.array([1.0, 100.0, 1.0]), A)
    free = np.linalg.inv(A.T @ np.diag(s**-2) @ A)
    np.testing.assert_allclose(found.sd, np.sqrt(np.diag(free)), rtol=3e-3)
    half = norm.ppf(0.975) * np.sqrt(free[1, 1])
    np.testing.assert_allclose(
        [found.lower95[1], found.upper95[1]], [100.0 - half, 100.0], rtol=1e-4
    )


def test_a_prediction_that_depends_on_the_ratio_only_keeps_its_band(assessed):
    problem, found = assessed()
    J = problem.response.evaluate(VALUES)[1]
    reduced = J[:, [0, 2]] / problem.sd[:, None]
    variance = np.diag(J[:, [0, 2]] @ np.linalg.inv(reduced.T @ reduced) @ J[:, [0, 2]].T)
    band = predict_band(found, J, problem.sd).sd
    np.testing.assert_allclose(band, np.sqrt(variance + problem.sd**2), rtol=1e-3)
