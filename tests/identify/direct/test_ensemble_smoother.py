"""The ensemble smoother against the closed form of a linear-Gaussian problem, and Gauss-Newton."""

import numpy as np
import pytest

from geoident.errors import ModelError
from geoident.identify import assess, identify
from geoident.identify.direct.ensemble_smoother import NormalScores
from geoident.identify.problem import methods
from geoident.identify.problem.methods import refusal
from geoident.model.methods import EnsembleSmootherOptions, GaussNewtonOptions, HuberOptions
from geoident.model.parameter import Parameter, Prior

H = np.array([[1.0, 0.5, 0.0], [0.2, 1.0, -0.4], [0.0, 0.3, 1.0], [0.7, 0.0, 0.6]])
SD = 0.5
PARAMETERS = [
    Parameter("a", 0.0, -50, 50, prior=Prior(1.0, 2.0)),
    Parameter("b", 0.0, -50, 50, prior=Prior(0.0, 1.0), field="rock.E"),
    Parameter("c", 0.0, -50, 50, prior=Prior(-1.0, 0.5)),
]
MEASURED = [3.0, 0.5, -1.5, 1.0]


def silent(iteration):
    return None


@pytest.fixture
def linear(make_problem):
    return make_problem(lambda p: H @ p, PARAMETERS, MEASURED, SD)


def closed_form():
    prior = np.array([q.prior.mean for q in PARAMETERS])
    C = np.diag([q.prior.sd**2 for q in PARAMETERS])
    gain = C @ H.T @ np.linalg.inv(H @ C @ H.T + SD**2 * np.eye(4))
    return prior + gain @ (MEASURED - H @ prior), C - gain @ H @ C


def test_a_linear_gaussian_posterior_is_met_within_the_error_of_the_sample(linear):
    """Of 2000 members the mean has an error of sd / sqrt(2000): four of them are allowed."""
    mean, covariance = closed_form()
    sd = np.sqrt(np.diag(covariance))
    options = EnsembleSmootherOptions(ensemble=2000, assimilations=4)
    found = identify(linear, [options], silent)
    assert found.status == "converged"
    assert found.reason == (
        "An ensemble of 2000 was moved to the readings in 4 steps; the values are its mean."
    )
    assert np.all(np.abs(found.values - mean) <= 4 * sd * np.sqrt(5 / 2000))
    newton = identify(linear, [GaussNewtonOptions()], silent)
    assert newton.values == pytest.approx(mean, abs=1e-6)
    known = assess(linear, found.values, H)
    assert known.sd == pytest.approx(sd, rel=1e-6)  # linearized: exact here
    (said,) = found.remarks
    low, high = (float(word) for word in said.split("a ")[1].split(",")[0].split(" .. "))
    assert (low, high) == pytest.approx((mean[0] - 1.96 * sd[0], mean[0] + 1.96 * sd[0]), abs=0.15)
    assert " b " not in said  # the mode of a field


def test_the_seed_makes_the_ensemble(linear):
    one, same, other = (
        identify(linear, [EnsembleSmootherOptions(50, 3, seed)], silent).values
        for seed in (1, 1, 2)
    )
    assert np.array_equal(one, same)
    assert not np.array_equal(one, other)


def test_a_model_without_derivatives_is_enough(make_problem):
    """|p| - like kinks have no use for a Jacobian."""
    problem = make_problem(
        lambda p: np.array([p[0] ** 2 + p[0], 2 * p[0]]),
        [Parameter("k", 1.0, 0.1, 10.0, scale="log", prior=Prior(1.5, 0.8, "lognormal"))],
        [6.0, 4.0],
        0.05,
    )
    problem.response.evaluate = None
    found = identify(problem, [EnsembleSmootherOptions(300, 6)], silent)
    assert found.values == pytest.approx([2.0], abs=0.05)


def test_members_without_solution_are_left_out_and_too_many_end_the_search(make_problem):
    refused = []

    def refuse_above(limit):
        refused.clear()

        def readings(p):
            if p[0].real > limit:
                refused.append(p)
                raise ModelError("collapse")
            return np.array([p[0], 2 * p[0]])

        return make_problem(readings, PARAMETERS[:1], [1.0, 2.0], 0.1)

    few = identify(refuse_above(4.0), [EnsembleSmootherOptions(200, 3)], silent)
    assert few.status == "converged"
    assert few.values == pytest.approx([1.0], abs=0.1)
    left_out = f"{len(refused)} members of the ensemble had no solution and were left out"
    assert few.remarks[-1] == left_out
    assert 0 < len(refused) < 20
    many = identify(refuse_above(0.0), [EnsembleSmootherOptions(200, 3)], silent)
    assert many.status == "not-converged"
    assert many.reason == (
        f"Of 200 members of the ensemble {len(refused)} have no solution. Narrow the priors and "
        "bounds, so that the model stands within them."
    )


def test_scores_are_standard_normal_of_each_prior():
    parameters = (
        Parameter("a", 1.0, 0.1, 10.0, scale="log", prior=Prior(2.0, 0.6, "lognormal")),
        Parameter("b", 1.0, -9.0, 9.0, prior=Prior(1.0, 2.0)),
        Parameter("c", 1.0, 1.0, 4.0),
    )
    scores = NormalScores(parameters)
    p = scores.values(np.array([1.0, -0.5, 0.0]))
    assert p == pytest.approx([2.0 * np.exp(0.3), 0.0, 2.5])
    assert scores.scores(p) == pytest.approx([1.0, -0.5, 0.0])


def test_what_it_needs_is_said(linear, monkeypatch):
    name = "ensemble-smoother"
    assert refusal(linear.response, name) is None
    robust = refusal(linear.response, name, HuberOptions())
    assert "squared loss" in robust
    monkeypatch.setattr(methods, "find_spec", lambda package: None)
    assert 'pip install "geoident[ensemble]"' in refusal(linear.response, name)
