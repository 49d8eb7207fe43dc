from dataclasses import replace

import numpy as np
import pytest
import scipy.sparse as sp
from scipy.optimize import least_squares

from geoident.errors import ModelError
from geoident.identify.least_squares.gauss_newton import gauss_newton
from geoident.identify.problem.problem import Problem
from geoident.identify.problem.shared_errors import SharedErrors
from geoident.model.methods import GaussNewtonOptions
from geoident.model.parameter import Parameter, Prior
from geoident.model.results.costs import Counts


def go_on(iteration):
    return None


def run(problem, on_iteration=go_on, **options):
    return gauss_newton(problem, GaussNewtonOptions(**options), on_iteration)


def free(*start):
    return [Parameter(f"x{i}", s, -np.inf, np.inf) for i, s in enumerate(start)]


def moduli(start, lower=1e-3, upper=1e3):
    return [Parameter(f"E{i}", s, lower, upper, "log") for i, s in enumerate(start)]


# The linear problem in a box


# Standard problems of More, Garbow and Hillstrom (1981), against an independent solver

T = np.arange(1, 11) * 0.1
BARD = np.array(
    [0.14, 0.18, 0.22, 0.25, 0.29, 0.32, 0.35, 0.39, 0.37, 0.58, 0.73, 0.96, 1.34, 2.10, 4.39]
)
KOWALIK_Y = np.array(
    [0.1957, 0.1947, 0.1735, 0.16, 0.0844, 0.0627, 0.0456, 0.0342, 0.0323, 0.0235, 0.0246]
)
KOWALIK_U = np.array([4.0, 2.0, 1.0, 0.5, 0.25, 0.167, 0.125, 0.1, 0.0833, 0.0714, 0.0625])


def rosenbrock(x):
    return np.array([10.0 * (x[1] - x[0] ** 2), 1.0 - x[0]])


def freudenstein(x):
    return np.array(
        [
            -13.0 + x[0] + ((5.0 - x[1]) * x[1] - 2.0) * x[1],
            -29.0 + x[0] + ((x[1] + 1.0) * x[1] - 14.0) * x[1],
        ]
    )


def powell(x):
    return np.array(
        [
            x[0] + 10.0 * x[1],
            5**0.5 * (x[2] - x[3]),
            (x[1] - 2.0 * x[2]) ** 2,
            10**0.5 * (x[0] - x[3]) ** 2,
        ]
    )


def beale(x):
    return np.array([1.5, 2.25, 2.625]) - x[0] * (1.0 - x[1] ** np.arange(1, 4))


def box(x):
    return np.exp(-T * x[0]) - np.exp(-T * x[1]) - x[2] * (np.exp(-T) - np.exp(-10.0 * T))


def bard(x):
    u = np.arange(1, 16)
    return BARD - (x[0] + u / ((16 - u) * x[1] + np.minimum(u, 16 - u) * x[2]))


def kowalik(x):
    u = KOWALIK_U
    return KOWALIK_Y - x[0] * (u**2 + u * x[1]) / (u**2 + u * x[2] + x[3])


def jennrich(x):
    i = np.arange(1, 11)
    return 2.0 + 2.0 * i - (np.exp(i * x[0]) + np.exp(i * x[1]))


STANDARD = [
    (rosenbrock, [-1.2, 1.0]),
    (freudenstein, [0.5, -2.0]),
    (powell, [3.0, -1.0, 0.0, 1.0]),
    (beale, [1.0, 1.0]),
    (box, [0.0, 10.0, 20.0]),
    (bard, [1.0, 1.0, 1.0]),
    (kowalik, [0.25, 0.39, 0.415, 0.39]),
    (jennrich, [0.3, 0.4]),
]


@pytest.mark.parametrize(("function", "start"), STANDARD, ids=lambda item: str(item)[:20])
def test_standard_problems_agree_with_an_independent_solver(make_problem, function, start):
    problem = make_problem(function, free(*start), np.zeros(len(function(np.array(start)))), 1.0)
    outcome = run(problem, max_iterations=100)
    reference = least_squares(
        function, start, x_scale="jac", xtol=1e-12, ftol=1e-12, gtol=1e-12, max_nfev=500
    )
    assert outcome.status == "converged"
    assert outcome.objective == pytest.approx(2.0 * reference.cost, rel=1e-6, abs=1e-12)
    assert len(outcome.iterations) <= 50


# Cost


def chain(p):
    """Springs in series, each end read: linear in the compliances."""
    return np.cumsum(1.0 / p)


def membrane(rng):
    """A membrane of ten patches under uniform load, 25 points read: K = sum of E_h K_h."""
    N, n = 12, 10
    K = np.zeros((n, N * N, N * N))
    for i in range(N):
        for j in range(N):
            h = ((i * 5) // N * 2 + (j * 2) // N) % n
            for neighbour in [(i + 1) * N + j] + ([i * N + j + 1] if j + 1 < N else []):
                e = np.zeros(N * N)
                e[i * N + j] = 1.0
                e[neighbour % (N * N)] -= 1.0 if neighbour < N * N else 0.0
                K[h] += np.outer(e, e)
    read = rng.choice(N * N, 25, replace=False)
    return lambda p: np.linalg.solve(np.tensordot(p, K, 1), np.ones(N * N))[read]


@pytest.mark.parametrize("factor", [2.0, 4.0])
@pytest.mark.parametrize("seed", range(3))
@pytest.mark.parametrize("model", ["chain", "membrane"])
def test_ten_moduli_a_factor_off_are_found_in_nine_evaluations(make_problem, model, seed, factor):
    rng = np.random.default_rng(seed)
    function = chain if model == "chain" else membrane(rng)
    true = np.exp(0.3 * rng.normal(size=10))
    start = true * np.where(rng.random(10) < 0.5, factor, 1.0 / factor)
    v = np.real(function(true))
    problem = make_problem(function, moduli(start), v, 1e-3 * np.abs(v).max())
    outcome = run(problem)
    np.testing.assert_allclose(outcome.values, true, rtol=1e-8)
    assert outcome.status == "converged"
    assert problem.response.evaluations == len(outcome.iterations) <= 9


def test_a_linear_model_needs_two_evaluations(make_problem):
    A = np.random.default_rng(0).normal(size=(6, 3))
    true = np.array([1.2, -0.7, 0.3])
    q = [Parameter(f"x{i}", 0.5, -2.0, 2.0) for i in range(3)]
    problem = make_problem(lambda p: A @ p, q, A @ true, 1.0)
    outcome = run(problem)
    np.testing.assert_allclose(outcome.values, true, rtol=1e-12)
    assert problem.response.evaluations == 2


def test_a_start_at_the_solution_costs_one_evaluation(make_problem):
    problem = make_problem(chain, moduli([1.0, 2.0]), chain(np.array([1.0, 2.0])), 1e-3)
    assert run(problem).status == "converged"
    assert problem.response.evaluations == 1


def test_a_modulus_whose_scale_was_left_linear_is_found_as_well(make_problem):
    q = [Parameter("E", 40e9, 1e9, 100e9)]
    problem = make_problem(lambda p: 1e6 / p, q, [1e-4], 1e-6)
    outcome = run(problem)
    np.testing.assert_allclose(outcome.values, 10e9, rtol=1e-8)
    assert len(outcome.iterations) <= 9


# Bounds, missing information, missing solutions


def test_the_minimum_on_a_bound_is_found_exactly(make_problem):
    q = [Parameter("a", 0.5, 0.0, 0.8), Parameter("b", 0.5, -5.0, 5.0)]
    A = np.array([[1.0, 0.5], [0.2, 1.0], [1.0, -1.0]])
    target = A @ np.array([1.5, 0.3])
    problem = make_problem(lambda p: A @ p + 0.05 * p[0] ** 2, q, target, 0.1)
    outcome = run(problem)
    reference = least_squares(
        lambda p: (A @ p + 0.05 * p[0] ** 2 - target) / 0.1,
        [0.5, 0.5],
        bounds=([0.0, -5.0], [0.8, 5.0]),
        xtol=1e-14,
        ftol=1e-14,
        gtol=1e-14,
    )
    assert outcome.status == "converged"
    assert outcome.values[0] == 0.8
    np.testing.assert_allclose(outcome.values, reference.x, rtol=1e-6)
    assert np.all(np.array([it.values for it in outcome.iterations])[:, 0] <= 0.8)


def test_a_parameter_that_no_reading_sees_stays_where_it_started(make_problem):
    q = moduli([3.0, 7.0])
    problem = make_problem(lambda p: np.array([1.0, 2.0]) / p[0], q, [0.5, 1.0], 1e-2)
    outcome = run(problem)
    assert outcome.status == "converged"
    np.testing.assert_allclose(outcome.values, [2.0, 7.0], rtol=1e-9)


def test_only_the_ratio_moves_where_only_the_ratio_is_seen(make_problem):
    q = moduli([1.0, 1.0])
    problem = make_problem(lambda p: np.array([1.0, 2.0]) * p[1] / p[0], q, [4.0, 8.0], 1e-2)
    outcome = run(problem)
    np.testing.assert_allclose(outcome.values[1] / outcome.values[0], 4.0, rtol=1e-8)
    np.testing.assert_allclose(outcome.values[1] * outcome.values[0], 1.0, rtol=1e-6)


def test_trial_points_without_a_solution_are_avoided(make_problem):
    def guarded(p):
        if np.real(p[0]) < 0.9:
            raise ModelError("The cavern falls in.")
        return np.array([1.0 / p[0]])

    problem = make_problem(guarded, moduli([4.0]), [1.0], 1e-3)
    outcome = run(problem)
    np.testing.assert_allclose(outcome.values, 1.0, rtol=1e-8)
    refused = [it for it in outcome.iterations if it.note == "rejected: no solution"]
    assert refused
    assert all(it.objective == np.inf for it in refused)


def test_a_start_outside_the_domain_is_refused_with_the_reason_of_the_model(make_problem):
    problem = make_problem(chain, moduli([4.0]), [1.0], 1e-3, refuse=lambda p: "nu must be < 0.5.")
    with pytest.raises(ModelError, match=r"nu must be < 0\.5"):
        run(problem)


# Stopping


def test_the_observer_ends_the_search_with_the_best_point(make_problem):
    problem = make_problem(chain, moduli([4.0, 4.0]), chain(np.ones(2)), 1e-3)
    outcome = run(problem, lambda it: "Time is up." if it.number == 3 else None)
    assert (outcome.status, outcome.reason) == ("out-of-budget", "Time is up.")
    assert len(outcome.iterations) == 4
    assert outcome.objective == min(it.objective for it in outcome.iterations)


def test_used_up_steps_are_said_with_a_remedy(make_problem):
    outcome = run(make_problem(chain, moduli([4.0]), [1.0], 1e-3), max_iterations=2)
    assert outcome.status == "not-converged"
    assert "max_iterations" in outcome.reason


def test_a_wrong_jacobian_ends_in_a_stall_not_in_a_loop(make_problem):
    problem = make_problem(lambda p: np.array([p[0], 1.0]), free(1.0), [0.0, 0.0], 1.0)
    right = problem.response.evaluate
    problem.response.evaluate = lambda p: (right(p)[0], -right(p)[1])
    outcome = run(problem, starts=1)
    assert outcome.status == "not-converged"
    assert "simplex" in outcome.reason
    assert len(outcome.iterations) < 50


def test_further_starts_find_the_lower_of_two_valleys(make_problem):
    q = [Parameter("x", -1.5, -2.0, 2.0)]
    problem = make_problem(lambda p: np.array([p[0] ** 2 - 1.0, 0.3 * (p[0] - 1.0)]), q, [0, 0], 1)
    assert run(problem).values[0] < 0.0
    np.testing.assert_allclose(run(problem, starts=3).values, [1.0], atol=1e-8)
    assert (
        run(problem, starts=3).iterations[-1].number == len(run(problem, starts=3).iterations) - 1
    )


def test_a_prior_pulls_a_linear_model_to_the_bayesian_estimate(make_problem):
    rng = np.random.default_rng(3)
    A, v, s = rng.normal(size=(5, 2)), rng.normal(size=5), 0.3
    q = [Parameter(f"x{i}", 0.1, -50.0, 50.0, prior=Prior(0.5 + i, 0.4)) for i in range(2)]
    outcome = run(make_problem(lambda p: A @ p, q, v, s))
    precision = A.T @ A / s**2 + np.eye(2) / 0.16
    expected = np.linalg.solve(precision, A.T @ v / s**2 + np.array([0.5, 1.5]) / 0.16)
    np.testing.assert_allclose(outcome.values, expected, rtol=1e-9)


def test_a_start_where_nothing_has_a_slope_is_flat(make_problem):
    """Between two minima: the derivative of the one residual vanishes."""
    problem = make_problem(lambda p: np.array([p[0] ** 2 - 1.0]), free(0.0), [-3.0], 1.0)
    outcome = run(problem, starts=1)
    assert (outcome.status, outcome.values.tolist()) == ("converged", [0.0])


class Noisy:
    """Readings with an error of their computation, which the model knows of."""

    names = ("x",)
    counts = Counts()
    noise = np.full(40, 0.05)

    def admissible(self, p):
        return None

    def readings(self, p):
        return np.linspace(0.0, 1.0, 40) * p[0] + 0.05 * np.sin(1e7 * p[0] + np.arange(40))

    def evaluate(self, p):
        return self.readings(p), np.linspace(0.0, 1.0, 40)[:, None]


def test_a_descent_ends_in_the_noise_of_the_computed_readings():
    unknown = (Parameter("x", 1.0, -9.0, 9.0),)
    problem = Problem(Noisy(), np.linspace(0.0, 2.0, 40), np.full(40, 1.0), unknown)
    outcome = run(problem, starts=1)
    assert outcome.status == "converged"
    assert "no more than what is noise of the computed readings" in outcome.reason
    assert outcome.values == pytest.approx([2.0], abs=0.1)


def test_noise_counts_the_same_whether_errors_are_own_or_shared():
    """Errors of 1 that each reading has by itself, or all but 0.01 of them as shared ones."""
    unknown = (Parameter("x", 1.0, -9.0, 9.0),)
    own = Problem(Noisy(), np.linspace(0.0, 2.0, 40), np.full(40, 1.0), unknown)
    columns = sp.csr_array(np.sqrt(1.0 - 0.01**2) * np.eye(40))
    shared = replace(own, sd=np.full(40, 0.01), shared=SharedErrors(columns))
    one, other = (run(problem, starts=1) for problem in (own, shared))
    np.testing.assert_allclose(other.values, one.values, rtol=1e-9)
    assert len(other.iterations) == len(one.iterations)
    assert other.reason == one.reason
