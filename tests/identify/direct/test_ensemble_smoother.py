"""The ensemble smoother against the closed form of a linear-Gaussian problem, and Gauss-Newton."""

import numpy as np
import pytest
from scipy.stats import norm

from geoident.errors import ModelError
from geoident.identify.assessment.uncertainty import assess
from geoident.identify.direct.ensemble_smoother import values_at
from geoident.identify.problem import methods
from geoident.identify.problem.methods import identify, refusal
from geoident.identify.problem.scaling import Scaling
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


# Step by step, as Emerick and Reynolds write it

PAIR = (
    Parameter("E", 3.0, 0.5, 40.0, "log", Prior(2.0, 0.8, "lognormal"), "pressure", "kPa"),
    Parameter("K0", 1.0, 0.2, 1.8),
)
READ = np.array([0.8, -0.3, 1.9, 0.4])
ACCURACY = np.array([0.1, 0.2, 0.3, 0.15])


def bent(p):
    E, K0 = p
    if E.real < 1.1:
        raise ModelError("collapse")
    return np.array([K0 / E, 1.0 - K0, np.sqrt(E), K0**2 / E])


def in_domain(p):
    return "too large" if p[0] > 5.0 else None


def kalman(X, Y, target, inflation, generator):
    """One update, with all but a thousandth of the sum of the singular values of the readings."""
    members = X.shape[1]
    wanted = target[:, None] + np.sqrt(inflation) * generator.standard_normal(Y.shape)
    dX, dY = X - X.mean(axis=1, keepdims=True), Y - Y.mean(axis=1, keepdims=True)
    U, w, _ = np.linalg.svd(dY / np.sqrt(inflation), full_matrices=False)
    few = int(np.count_nonzero(np.cumsum(w) / w.sum() < 0.999)) + 1
    U, w = U[:, :few], w[:few]
    gain = dX @ dY.T @ U / (w**2 + members - 1) @ U.T / inflation
    return X + gain @ (wanted - Y)


def test_the_ensemble_moves_by_the_published_updates(make_problem):
    """Members that the model refuses, or cannot compute, are gone for good."""
    problem = make_problem(bent, PAIR, READ, ACCURACY, in_domain)
    scaling = Scaling(PAIR)
    generator = np.random.default_rng(5)
    X, expected, step, lost = generator.standard_normal((2, 30)), [], 0.0, 0
    for _ in range(3):
        points = [values_at(z, scaling) for z in X.T]
        solved = np.array([1.1 <= p[0] <= 5.0 for p in points])
        lost += np.count_nonzero(~solved)
        Y = np.array([bent(p) for p, good in zip(points, solved, strict=True) if good]).T
        X = X[:, solved]
        before = X.mean(axis=1)
        expected.append((values_at(before, scaling), step))
        X = kalman(X, Y / ACCURACY[:, None], READ / ACCURACY, 3.0, generator)
        step = np.linalg.norm(X.mean(axis=1) - before)
    expected.append((values_at(X.mean(axis=1), scaling), step))
    found = identify(problem, [EnsembleSmootherOptions(30, 3, seed=5)], silent)
    assert [entry.note for entry in found.iterations] == [
        *["assimilated"] * 3,
        "mean of the ensemble",
    ]
    for entry, (values, length) in zip(found.iterations, expected, strict=True):
        assert entry.values == pytest.approx(values, rel=1e-9)
        assert entry.step == pytest.approx(length, rel=1e-9)
        squares = np.append((bent(values) - READ) / ACCURACY, np.log(values[0] / 2.0) * 2.0 / 0.8)
        assert entry.objective == pytest.approx(squares @ squares)
    assert found.values == pytest.approx(expected[-1][0], rel=1e-9)
    assert found.objective == found.iterations[-1].objective
    assert (found.status, found.iterations[0].method) == ("converged", "ensemble-smoother")
    assert found.reason == (
        f"An ensemble of {30 - lost} was moved to the readings in 3 steps; the values are its mean."
    )
    ends = np.quantile([values_at(z, scaling) for z in X.T], [0.025, 0.975], axis=0)
    (a, b), (c, d) = ends.T
    assert 0 < lost < 15
    assert found.remarks == (
        f"95 % of the ensemble: E {a / 1e3:.4g} .. {b / 1e3:.4g} kPa, K0 {c:.4g} .. {d:.4g}",
        f"{lost} members of the ensemble had no solution and were left out",
    )


def test_an_observer_ends_it_at_the_mean_so_far(make_problem):
    problem = make_problem(bent, PAIR, READ, ACCURACY, in_domain)
    found = identify(
        problem,
        [EnsembleSmootherOptions(30, 3, seed=5)],
        lambda entry: "Enough." if entry.number == 1 else None,
    )
    assert (found.status, found.reason) == ("out-of-budget", "Enough.")
    assert len(found.iterations) == 2
    assert found.values == pytest.approx(found.iterations[1].values)
    assert found.objective == found.iterations[1].objective


def test_scores_are_those_of_the_place_between_the_bounds():
    """Of the logarithm where the scale is one; on a bound and for a fixed one they stay finite."""
    parameters = (
        Parameter("E", 3.0, 2.0, 50.0, "log"),
        Parameter("K0", 1.0, 0.2, 1.8),
        Parameter("nu", 0.3, 0.3, 0.3),
    )
    scaling = Scaling(parameters)
    part = np.array([0.3, 0.9])
    z = norm.ppf(part)
    p = values_at(np.array([*z, 0.7]), scaling)
    assert p == pytest.approx([2.0 * 25.0**0.3, 0.2 + 1.6 * 0.9, 0.3])
    believed = (Parameter("a", 1.0, -1.0, 2.0, prior=Prior(1.0, 2.0)),)
    assert values_at(np.array([0.6]), Scaling(believed)) == [2.0]
    assert values_at(np.array([-1.1]), Scaling(believed)) == [-1.0]


def test_what_it_needs_is_said(linear, monkeypatch):
    name = "ensemble-smoother"
    assert refusal(linear.response, name) is None
    robust = refusal(linear.response, name, HuberOptions())
    assert "squared loss" in robust
    monkeypatch.setattr(methods, "find_spec", lambda package: None)
    assert 'pip install "geoident[ensemble]"' in refusal(linear.response, name)
