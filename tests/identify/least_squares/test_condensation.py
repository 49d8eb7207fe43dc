"""Condensation: the paper's own matrices, exactness, convergence, noise, bounds, priors."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import scipy.sparse as sp
from scipy.optimize import lsq_linear
from support.affine import AffineToy, chain, truss, two_stages

from geoident.identify.least_squares.condensation import condensation, independent_readings
from geoident.identify.least_squares.gauss_newton import gauss_newton
from geoident.identify.problem.outcome import Outcome
from geoident.identify.problem.problem import Problem
from geoident.identify.problem.shared_errors import SharedErrors
from geoident.model.arrays import Floats
from geoident.model.methods import CondensationOptions, GaussNewtonOptions
from geoident.model.parameter import Parameter, Prior
from geoident.model.results.result import Iteration

THREE = chain([0, 0, 1, 1, 1, 2, 2], [(0, 2), (2, 3), (0, 4), (4, 6)])
TRUTH = np.array([3.0, 1.0, 2.0])
EQUATION = CondensationOptions(weighting="equation")
OUTPUT = CondensationOptions(weighting="output")
BOTH = pytest.mark.parametrize("options", [OUTPUT, EQUATION], ids=["output", "equation"])


def go_on(_: Iteration) -> None:
    return None


def problem(
    toy: AffineToy,
    measured: Floats,
    *,
    start: Floats,
    lower: float = 1e-3,
    upper: float = 1e3,
    scale: str = "log",
    sd: float = 1e-3,
) -> Problem:
    parameters = tuple(
        Parameter(
            name, start=p, lower=lower, upper=upper, scale="log" if scale == "log" else "linear"
        )
        for name, p in zip(toy.names, start, strict=True)
    )
    return Problem(toy, measured, np.full(len(measured), sd), parameters)


def with_prior(case: Problem, index: int, prior: Prior) -> Problem:
    parameters = list(case.parameters)
    parameters[index] = replace(parameters[index], prior=prior)
    return replace(case, parameters=tuple(parameters))


def iterates(outcome: Outcome) -> Floats:
    return np.array([iteration.values for iteration in outcome.iterations])


# --- the paper's formulas ---


def split(toy: AffineToy) -> tuple[Floats, Floats, int]:
    """K' and F' in the paper's displacements (v, w): measured, and others that complete them."""
    g = len(toy.G)
    others = np.random.default_rng(5).standard_normal((toy.G.shape[1] - g, toy.G.shape[1]))
    T = np.linalg.inv(np.vstack([toy.G, others]))
    return T.T @ toy.K @ T, toy.F @ T, g


def paper_step(toy: AffineToy, p: Floats, measured: Floats, *, others_too: bool) -> Floats:
    """p_{j+1} of [18] with explicit R [14], H_h [15] and L [16].

    ``others_too``: with the part (K_h^VW - R K_h^WW) w of the displacements that are not measured.
    """
    k, f, g = split(toy)
    K, F = np.tensordot(p, k[1:], 1), f[0]
    inverse = np.linalg.inv(K[g:, g:])
    R = K[:g, g:] @ inverse
    H = k[1:, :g, :g] - R @ k[1:, g:, :g]
    L = (H @ measured).T
    if others_too:
        w = inverse @ (F[g:] - K[g:, :g] @ measured)
        L = L + ((k[1:, :g, g:] - R @ k[1:, g:, g:]) @ w).T
    return np.asarray(np.linalg.lstsq(L, F[:g] - R @ F[g:], rcond=None)[0])


@pytest.mark.parametrize("toy", [THREE, truss(1), truss(2)], ids=["chain", "truss", "truss-2"])
@pytest.mark.parametrize("noise", [0.0, 0.05])
def test_one_iteration_is_that_of_the_papers_partitioned_matrices(
    toy: AffineToy, noise: float
) -> None:
    error = 1.0 + noise * np.random.default_rng(3).standard_normal(len(toy.G))
    measured = toy.readings(TRUTH) * error
    start = np.array([2.0, 1.5, 1.8])
    case = problem(toy, measured, start=start, lower=-1e3, scale="linear")
    outcome = condensation(case, replace(EQUATION, max_iterations=1), go_on)
    expected = paper_step(toy, start, measured, others_too=True)
    assert iterates(outcome)[1] == pytest.approx(expected, rel=1e-9)


def test_single_modulus_needs_no_more_than_the_papers_measured_part() -> None:
    toy = chain([0, 0, 0, 0, 0], [(0, 1), (1, 3)])
    measured = toy.readings(np.array([4.0])) * [1.02, 0.99]
    case = problem(toy, measured, start=np.array([1.0]))
    expected = paper_step(toy, np.array([1.0]), measured, others_too=False)
    outcome = condensation(case, EQUATION, go_on)
    assert iterates(outcome)[1] == pytest.approx(expected, rel=1e-12)


def test_everything_measured_needs_no_iteration() -> None:
    toy = replace(THREE, G=np.eye(6))
    measured = toy.readings(TRUTH) * (1.0 + 0.01 * np.sin(np.arange(6.0)))
    case = problem(toy, measured, start=np.array([1.0, 10.0, 0.3]))
    outcome = condensation(case, EQUATION, go_on)
    strains = np.array([K @ measured for K in toy.K[1:]]).T
    assert outcome.values == pytest.approx(np.linalg.lstsq(strains, toy.F[0], rcond=None)[0])
    assert len(outcome.iterations) == 2


# --- exactness and convergence ---


@BOTH
@pytest.mark.parametrize("start", [1e-2, 0.5, 1e2])
def test_one_modulus_is_exact_in_one_iteration(options: CondensationOptions, start: float) -> None:
    toy = chain([0, 0, 0, 0, 0], [(0, 1), (1, 3)])
    case = problem(toy, toy.readings(np.array([4.0])), start=np.array([start]))
    outcome = condensation(case, options, go_on)
    assert outcome.status == "converged"
    assert outcome.values == pytest.approx([4.0], rel=1e-12)
    assert len(outcome.iterations) == 2


@BOTH
@pytest.mark.parametrize("toy", [THREE, truss(1), truss(2)], ids=["chain", "truss", "truss-2"])
@pytest.mark.parametrize("factor", [10.0, 0.1])
def test_approaches_the_truth_as_in_figure_6(
    options: CondensationOptions, toy: AffineToy, factor: float
) -> None:
    start = TRUTH * factor * np.array([1.0, 1.2, 0.8])
    outcome = condensation(problem(toy, toy.readings(TRUTH), start=start), options, go_on)
    error = np.abs(iterates(outcome) / TRUTH - 1.0).max(axis=1)
    assert outcome.status == "converged"
    assert np.all(np.diff(error[error > 1e-12]) < 0.0)
    assert error[min(10, len(error) - 1)] < 1e-8


@BOTH
def test_convergence_is_quadratic_without_noise(options: CondensationOptions) -> None:
    case = problem(THREE, THREE.readings(TRUTH), start=TRUTH * [1.3, 0.8, 1.2])
    error = np.abs(iterates(condensation(case, options, go_on)) / TRUTH - 1.0).max(axis=1)
    assert np.all(error[1:4] < 2.0 * error[:3] ** 2)


@BOTH
def test_several_stages_with_in_situ_stress(options: CondensationOptions) -> None:
    toy, truth = two_stages(), np.array([3.0, 1.0, 2.0, 4.0])
    measured = toy.readings(truth)
    flexibility = toy.condense(truth, measured, np.ones(5)).flexibility
    assert not np.allclose(flexibility, flexibility.T)
    case = problem(toy, measured, start=truth * [10.0, 12.0, 8.0, 0.5], lower=1e-2)
    outcome = condensation(case, options, go_on)
    assert outcome.status == "converged"
    assert outcome.values == pytest.approx(truth, rel=1e-8)


def test_several_stages_are_weighed_with_their_unsymmetric_flexibility() -> None:
    toy, start = two_stages(), np.array([2.0, 1.5, 1.8, 5.0])
    measured = toy.readings(np.array([3.0, 1.0, 2.0, 4.0])) * [1.02, 0.99, 1.01, 0.98, 1.0]
    model = toy.condense(start, measured, np.ones(5))
    M = np.linalg.inv(model.flexibility)
    expected = np.linalg.lstsq(M @ model.matrix, M @ model.vector)[0]
    case = problem(toy, measured, start=start, lower=-1e3, scale="linear")
    outcome = condensation(case, EQUATION, go_on)
    assert iterates(outcome)[1] == pytest.approx(expected, rel=1e-9)


# --- noise ---


def test_noise_biases_condensation_as_in_forces_but_not_least_squares() -> None:
    toy, truth = chain([0] * 6 + [1] * 6, [(0, i) for i in range(1, 12)]), np.array([3.0, 1.0])
    toy.F[0] = 1.0
    exact = toy.readings(truth)
    sd = 0.02 * float(exact.mean())
    errors = []
    for seed in range(25):
        noise = sd * np.random.default_rng(seed).standard_normal(len(exact))
        case = problem(toy, exact + noise, start=truth, sd=sd)
        plain, output = (condensation(case, options, go_on) for options in (EQUATION, OUTPUT))
        parameters = [
            replace(q, start=value) for q, value in zip(case.parameters, output.values, strict=True)
        ]
        after = gauss_newton(
            replace(case, parameters=tuple(parameters)), GaussNewtonOptions(), go_on
        )
        least = gauss_newton(case, GaussNewtonOptions(), go_on)
        assert after.values == pytest.approx(least.values, rel=1e-5)
        assert least.objective <= output.objective * (1.0 + 1e-9) < plain.objective
        errors.append(np.log([plain.values, output.values, least.values] / truth))
    bias = np.mean(errors, axis=0)
    doubt = np.std(errors, axis=0) / np.sqrt(len(errors))
    assert np.all(bias[0] < -5.0 * doubt[0])
    assert np.all(bias[0] < -0.2)
    assert np.all(np.abs(bias[1:]) < 3.0 * doubt[1:])
    assert np.all(np.abs(bias[1:]) < 0.01)


# --- what the readings do not determine, bounds, priors, dependent readings ---


@BOTH
def test_direction_without_information_stays_at_its_start(options: CondensationOptions) -> None:
    # springs 1 and 2 side by side: only their sum is felt; 4 belongs to nothing
    toy = replace(THREE, K=np.concatenate([THREE.K[[0, 1, 1, 2, 3]], np.zeros((1, 6, 6))]))
    toy.F = np.concatenate([THREE.F[:1], np.zeros((5, 6))])
    measured = THREE.readings(TRUTH)
    start = np.array([2.0, 2.0, 1.5, 2.5, 7.0])
    outcome = condensation(problem(toy, measured, start=start), options, go_on)
    assert outcome.status == "converged"
    assert outcome.values == pytest.approx([1.5, 1.5, 1.0, 2.0, 7.0], rel=1e-7)
    assert outcome.values[4] == 7.0


@BOTH
def test_step_into_a_bound_is_the_bounded_least_squares_solution(
    options: CondensationOptions,
) -> None:
    start, lower, upper = np.array([2.0, 1.5, 1.8]), 1.4, 2.2
    measured = THREE.readings(TRUTH)
    case = problem(THREE, measured, start=start, lower=lower, upper=upper)
    model = THREE.condense(start, measured, case.sd)
    M = np.linalg.inv(model.flexibility) if options is EQUATION else np.diag(1.0 / case.sd)
    expected = lsq_linear(M @ model.matrix, M @ model.vector, (lower, upper), tol=1e-14).x
    outcome = condensation(case, options, go_on)
    assert iterates(outcome)[1] == pytest.approx(expected, rel=1e-6)
    assert outcome.status == "converged"
    assert np.all((iterates(outcome) >= lower) & (iterates(outcome) <= upper))
    assert set(outcome.values) & {lower, upper}


def test_normal_prior_is_one_more_reading() -> None:
    start, measured = np.array([2.0, 1.5, 1.8]), THREE.readings(TRUTH)
    for scale in ("log", "linear"):
        bare = problem(THREE, measured, start=start, scale=scale, sd=0.1)
        case = with_prior(bare, 0, Prior(mean=2.0, sd=0.3))
        model = THREE.condense(start, measured, case.sd)
        rows = np.vstack([model.matrix / 0.1, [1.0 / 0.3, 0.0, 0.0]])
        expected = np.linalg.lstsq(rows, np.append(model.vector / 0.1, 2.0 / 0.3))[0]
        outcome = condensation(case, OUTPUT, go_on)
        assert iterates(outcome)[1] == pytest.approx(expected, rel=1e-9)
        assert outcome.iterations[0].objective == pytest.approx(
            np.sum(((THREE.readings(start) - measured) / 0.1) ** 2)
        )


@pytest.mark.parametrize("scale", ["log", "linear"])
def test_lognormal_prior_is_in_balance_with_the_readings(scale: str) -> None:
    measured = THREE.readings(TRUTH)
    bare = problem(THREE, measured, start=np.array([2.0, 1.5, 1.8]), scale=scale, sd=0.1)
    mean, sd = 2.0, 0.3
    outcome = condensation(with_prior(bare, 0, Prior(mean, sd, "lognormal")), OUTPUT, go_on)
    p = outcome.values
    model = THREE.condense(p, measured, bare.sd)
    pull = model.matrix.T @ (model.matrix @ p - model.vector) / 0.1**2
    pull[0] += np.log(p[0] / mean) * (mean / sd) ** 2 / p[0]
    assert outcome.status == "converged"
    assert 2.0 < p[0] < 3.0
    assert pull == pytest.approx(np.zeros(3), abs=1e-4)


@BOTH
def test_three_distances_of_a_line_are_two_readings(options: CondensationOptions) -> None:
    toy = chain([0, 0, 0, 1, 1, 1], [(1, 3), (3, 4), (1, 4)])
    truth = np.array([3.0, 1.0])
    exact = toy.readings(truth)
    case = problem(toy, exact, start=10.0 * truth)
    assert condensation(case, options, go_on).values == pytest.approx(truth, rel=1e-8)
    # the closing error is shared out before anything else, equal weights: a third each
    apart = exact + np.array([0.03, 0.0, 0.0])
    closed = apart - 0.03 / 3.0 * np.array([1.0, 1.0, -1.0])
    found = condensation(problem(toy, apart, start=10.0 * truth), options, go_on)
    two = replace(toy, G=toy.G[:2])
    expected = condensation(problem(two, closed[:2], start=10.0 * truth), options, go_on)
    assert found.values == pytest.approx(expected.values, rel=1e-8)


def test_errors_that_readings_share_are_the_metric() -> None:
    """One step from where two stages lead, with the whole covariance, by hand."""
    start, measured = np.array([2.0, 1.5, 1.8]), THREE.readings(TRUTH) * [1.02, 0.97, 1.01, 0.99]
    sd = np.array([0.02, 0.05, 0.03, 0.04])
    columns = np.array([[0.1, 0.0], [0.05, 0.0], [0.0, 0.07], [0.02, 0.03]])
    bare = problem(THREE, measured, start=start, scale="linear", lower=-1e3)
    case = replace(bare, sd=sd, shared=SharedErrors(sp.csr_array(columns)))
    M = np.linalg.inv(np.linalg.cholesky(np.diag(sd**2) + columns @ columns.T))
    model = THREE.condense(start, measured, M)
    expected = np.linalg.lstsq(M @ model.matrix, M @ model.vector)[0]
    outcome = condensation(case, replace(OUTPUT, max_iterations=1), go_on)
    assert iterates(outcome)[1] == pytest.approx(expected, rel=1e-9)
    r = M @ (THREE.readings(start) - measured)
    assert outcome.iterations[0].objective == pytest.approx(r @ r)


def test_independent_readings_are_a_largest_independent_set() -> None:
    toy = chain([0, 0, 0, 1, 1, 1], [(0, 6), (1, 3), (3, 4), (1, 4), (1, 3), (0, 2)])
    S = toy.condense(np.array([3.0, 1.0]), np.zeros(6), np.ones(6)).flexibility
    rows = independent_readings(S)  # the first gauge joins the two walls: nothing moves it
    assert len(rows) == np.linalg.matrix_rank(toy.G) == 3
    assert np.linalg.matrix_rank(toy.G[rows]) == 3
    assert independent_readings(np.zeros((2, 2))).size == 0
