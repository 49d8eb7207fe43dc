"""Draws of a posterior against quadrature on a grid, which shares no idea with a sampler."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.stats import lognorm, norm, truncnorm
from support.posteriors import grid_quantiles, problem_of_ridge

from geoident.errors import CollapseError
from geoident.identify.posterior import chains
from geoident.identify.posterior.density import PosteriorDensity
from geoident.identify.posterior.draws import SamplingRequest, Stopped, smoothed
from geoident.identify.posterior.importance import Proposal, WeightedDraws
from geoident.identify.posterior.sampling import sample_posterior
from geoident.identify.problem.methods import identify
from geoident.identify.problem.problem import Problem
from geoident.model.methods import GaussNewtonOptions
from geoident.model.parameter import Parameter, Prior
from geoident.model.results.result import Counts

ENDS = (0.025, 0.5, 0.975)


def drawn(problem, *minima, draws=10_000, effective=1000, evaluations=50_000, seed=0):
    density = PosteriorDensity(problem)
    found = sample_posterior(
        density,
        [np.asarray(p) for p in minima],
        SamplingRequest(draws, effective, evaluations),
        rng=np.random.default_rng(seed),
        watch=lambda progress: None,
    )
    p = density.natural(found.x.reshape(-1, found.x.shape[2]))
    return found, p, density


def levels(problem, p):
    """The probabilities (2, 3) below the 2.5, 50 and 97.5 % quantiles of the draws, by the grid."""
    return np.array(
        [
            np.interp(np.quantile(p[:, of], ENDS), at, cumulated)
            for of, (at, cumulated) in enumerate(grid_quantiles(problem))
        ]
    )


@pytest.mark.parametrize("prior", [None, Prior(8.0, 2.0), Prior(8.0, 2.0, "lognormal")])
def test_modulus_and_stress_along_their_ridge(prior):
    """E and sigma_v scale together: only their ratio is seen, within 2 %."""
    problem = problem_of_ridge(prior)
    found, p, density = drawn(problem, [10.0, 8.0])
    assert found.reliable(density.evaluations)
    assert density.evaluations < 6000
    assert np.all(np.abs(levels(problem, p) - ENDS) < (0.012, 0.05, 0.012))


def test_a_density_on_a_bound_is_cut_by_it():
    """Of a normal density around -1 sd only the part above 0 is left: quantiles in closed form."""
    problem = Problem(
        Line(), np.array([-1.0]), np.ones(1), (Parameter("a", 0.1, 0.0, 50.0, "linear"),)
    )
    found, p, density = drawn(problem, [0.0])
    expected = truncnorm(1.0, np.inf, loc=-1.0).ppf(ENDS)
    np.testing.assert_allclose(np.quantile(p[:, 0], ENDS), expected, atol=0.09)
    assert found.reliable(density.evaluations)


class Line:
    """v = a for each of g readings."""

    names = ("a",)
    counts = Counts()

    def admissible(self, p):
        return None

    def readings(self, p):
        return p[:1]

    def evaluate(self, p):
        return p[:1], np.ones((1, 1))


@pytest.mark.parametrize(
    ("scale", "kind", "lower"),
    [("log", "normal", 0.5), ("linear", "lognormal", 0.5), ("linear", "lognormal", 5.0),
     ("linear", "normal", 0.5), ("log", "lognormal", 0.5)],
)  # fmt: skip
def test_a_prior_is_a_density_in_the_variable_of_its_name(scale, kind, lower):
    """Readings that tell nothing leave the prior, cut at the bounds, whatever the scale."""
    prior = Prior(7.0, 2.8, kind)
    problem = Problem(
        Line(), np.array([7.0]), np.array([1e6]), (Parameter("a", 7.0, lower, 9.9, scale, prior),)
    )
    _, p, _ = drawn(problem, [7.0])
    law = norm(7.0, 2.8) if kind == "normal" else lognorm(0.4, scale=7.0)
    below = (law.cdf(np.quantile(p[:, 0], ENDS)) - law.cdf(lower)) / (law.cdf(9.9) - law.cdf(lower))
    assert np.all(np.abs(below - ENDS) < (0.013, 0.05, 0.013))


@pytest.mark.parametrize("scale", ["log", "linear"])
def test_without_a_prior_the_density_is_flat_in_the_scale(scale):
    problem = Problem(
        Line(), np.array([7.0]), np.array([1e6]), (Parameter("a", 7.0, 1.0, 20.0, scale),)
    )
    _, p, _ = drawn(problem, [7.0])
    found = np.quantile(p[:, 0], 0.5)
    assert found == pytest.approx(np.sqrt(20.0) if scale == "log" else 10.5, rel=0.13)


class Bimodal:
    """v = x^2 and a weak reading of x: two minima, at +2 and -2."""

    names = ("x",)
    counts = Counts()

    def admissible(self, p):
        return None

    def readings(self, p):
        return np.array([p[0] ** 2, p[0]])

    def evaluate(self, p):
        return self.readings(p), np.array([[2.0 * p[0]], [1.0]])


def test_both_of_two_minima_are_found():
    problem = Problem(
        Bimodal(), np.array([4.0, 0.5]), np.array([0.2, 4.0]),
        (Parameter("x", 2.0, -5.0, 5.0, "linear"),),
    )  # fmt: skip
    found, p, density = drawn(problem, [2.0], [-2.0])
    odds = np.exp(0.5 * ((-2.0 - 0.5) ** 2 - (2.0 - 0.5) ** 2) / 16.0)
    share = np.mean(p[:, 0] > 0.0)
    assert share / (1.0 - share) == pytest.approx(odds, rel=0.2)
    assert found.reliable(density.evaluations)


def test_the_ensemble_has_the_quantiles_of_a_grid():
    problem = problem_of_ridge(Prior(8.0, 2.0))
    density, rng = PosteriorDensity(problem), np.random.default_rng(0)
    proposal = Proposal.laplace(density, [np.array([10.0, 8.0])])
    begin = WeightedDraws.none_of(proposal).more(density, rng, 200)
    request = SamplingRequest(3000, 300.0, 50_000)
    found = chains.ensemble(density, begin, request, rng, lambda progress: None)
    p = density.natural(found.x.reshape(-1, 2))
    assert found.sampler == "ensemble"
    assert found.reliable(density.evaluations, wanted=300.0)
    assert found.largest_r_hat <= 1.01
    assert np.all(np.abs(levels(problem, p) - ENDS) < (0.02, 0.08, 0.02))


class Banana:
    """A sharp reading of y - b x^2 and a blunt one of x: a ridge that is bent."""

    names = ("x", "y")
    counts = Counts()

    def __init__(self, bend):
        self.bend = bend

    def admissible(self, p):
        return None

    def readings(self, p):
        return np.array([p[0], 10.0 * (p[1] - self.bend * p[0] ** 2)])

    def evaluate(self, p):
        return self.readings(p), np.array([[1.0, 0.0], [-20.0 * self.bend * p[0], 10.0]])


@pytest.mark.parametrize("bend", [0.3, pytest.param(1.0, marks=pytest.mark.slow)])
def test_along_a_bent_ridge_other_proposals_are_tried(bend):
    """x ~ N(0, 1) whatever the bend is: its quantiles in closed form, cut at the bounds."""
    problem = Problem(
        Banana(bend), np.zeros(2), np.ones(2),
        (Parameter("x", 0.1, -6.0, 6.0, "linear"), Parameter("y", 0.1, -9.0, 40.0, "linear")),
    )  # fmt: skip
    found, p, density = drawn(problem, [0.0, 0.0])
    assert found.sampler == "adapted importance"
    assert found.reliable(density.evaluations)
    assert density.evaluations < 30_000
    assert np.all(np.abs(norm.cdf(np.quantile(p[:, 0], ENDS)) - ENDS) < (0.03, 0.06, 0.03))
    np.testing.assert_allclose((p[:, 1] - bend * p[:, 0] ** 2).std(), 0.1, rtol=0.1)


NOISE = 1.0


class Many:
    """A linear model of n parameters whose priors are N(0, 1)."""

    counts = Counts()

    def __init__(self, matrix):
        self.matrix = matrix
        self.names = tuple(f"m{i}" for i in range(matrix.shape[1]))

    def admissible(self, p):
        return None

    def readings(self, p):
        return self.matrix @ p

    def evaluate(self, p):
        return self.matrix @ p, self.matrix


def many(n, bend=0.0):
    rng = np.random.default_rng(5)
    matrix = rng.normal(size=(8, n)) / np.sqrt(n)
    prior = Prior(0.0, 1.0)
    modes = tuple(
        Parameter(f"m{i}", 0.0, -np.inf, np.inf, "linear", prior, field="E") for i in range(n)
    )
    truth = rng.normal(size=n)
    model = Many(matrix)
    if bend:
        model = Bent(matrix, bend)
    return Problem(model, model.readings(truth), np.full(8, NOISE), modes), matrix


class Bent(Many):
    """The same with readings that grow exponentially, as displacements with a lognormal field."""

    def __init__(self, matrix, bend):
        super().__init__(matrix)
        self.bend = bend

    def readings(self, p):
        return np.expm1(self.bend * (self.matrix @ p)) / self.bend

    def evaluate(self, p):
        return self.readings(p), np.exp(self.bend * (self.matrix @ p))[:, None] * self.matrix


def test_modes_of_a_linear_field_have_their_gaussian_posterior():
    problem, G = many(40)
    precision = G.T @ G / NOISE**2 + np.eye(40)
    mean = np.linalg.solve(precision, G.T @ problem.measured / NOISE**2)
    found, p, _ = drawn(problem, mean)
    covariance = np.linalg.inv(precision)
    np.testing.assert_allclose(p.mean(axis=0), mean, atol=0.13)
    np.testing.assert_allclose(p.std(axis=0), np.sqrt(np.diag(covariance)), rtol=0.1)
    assert found.sampler == "importance"  # Laplace's approximation is exact


@pytest.mark.parametrize(
    ("n", "effective", "evaluations"),
    [
        (20, 60, 15_000),
        pytest.param(40, 250, 60_000, marks=pytest.mark.slow),
        pytest.param(80, 800, 60_000, marks=pytest.mark.slow),
    ],
)
def test_crank_nicolson_does_not_depend_on_the_number_of_modes(n, effective, evaluations):
    """Readings that are bent: chains meet, and the share of accepted steps is that of few modes.

    What the readings see, G p, is compared with importance sampling of G p itself (8 numbers).
    Of 60 draws the means are known to 0.13 standard deviations, a third of what is allowed.
    """
    problem, G = many(n, bend=0.8)
    fit = identify(problem, (GaussNewtonOptions(),), lambda iteration: None)
    density = PosteriorDensity(problem)

    rng = np.random.default_rng(3)
    proposal = Proposal.laplace(density, [fit.values])
    begin = WeightedDraws.none_of(proposal).more(density, rng, 200)
    request = SamplingRequest(5 * effective, effective, evaluations)
    found = chains.crank_nicolson(density, begin, request, rng, lambda _: None)
    assert found.largest_r_hat <= (1.01 if effective > 60 else 1.05)
    assert found.acceptance > 0.15
    assert found.sampler == "preconditioned Crank-Nicolson"
    p = density.natural(found.x.reshape(-1, n))
    # the prior of w = G p is N(0, G G^T): the posterior of w by brute force
    draws = np.random.default_rng(4).normal(size=(100_000, 8)) @ np.linalg.cholesky(G @ G.T).T
    gap = (np.expm1(0.8 * draws) / 0.8 - problem.measured) / NOISE
    logs = -0.5 * np.sum(gap**2, axis=1)
    weights = np.exp(logs - logs.max())
    assert weights.sum() ** 2 / np.sum(weights**2) > 500.0
    expected = weights @ draws / weights.sum()
    sd = np.sqrt(weights @ (draws - expected) ** 2 / weights.sum())
    w = p @ G.T
    assert np.all(np.abs(w.mean(axis=0) - expected) < 0.35 * sd)
    np.testing.assert_allclose(w.std(axis=0), sd, rtol=0.3)


def test_modes_of_fields_take_crank_nicolson_steps_where_importance_sampling_fails():
    problem, _ = many(20, bend=1.2)
    fit = identify(problem, (GaussNewtonOptions(),), lambda iteration: None)
    found, _, _ = drawn(problem, fit.values, draws=60, effective=60, evaluations=1500)
    assert found.sampler == "preconditioned Crank-Nicolson"


def test_where_there_is_no_solution_there_are_no_draws():
    class Half(Line):
        def readings(self, p):
            if p[0] < 2.0:
                raise CollapseError("the ground collapses", stage="s", fraction=0.5)
            return p[:1]

    problem = Problem(
        Half(), np.array([2.0]), np.ones(1), (Parameter("a", 2.5, 0.0, 50.0, "linear"),)
    )
    _, p, _ = drawn(problem, [2.5])
    assert p.min() >= 2.0
    assert np.quantile(p, 0.5) == pytest.approx(2.0 + 0.6745, abs=0.1)


def test_a_fixed_parameter_stays_where_it_is():
    problem = problem_of_ridge(None)
    fixed = replace(problem.parameters[1], lower=8.0, upper=8.0)
    problem = replace(problem, parameters=(problem.parameters[0], fixed))
    _, p, _ = drawn(problem, [10.0, 8.0])
    assert np.all(p[:, 1] == 8.0)
    assert np.std(np.log(p[:, 0])) < 0.03


def test_the_same_seed_gives_the_same_draws_and_another_one_others():
    problem = problem_of_ridge(None)
    first, again, other = (drawn(problem, [10.0, 8.0], seed=seed)[1] for seed in (1, 1, 2))
    np.testing.assert_array_equal(first, again)
    assert not np.array_equal(first, other)


@pytest.mark.parametrize("evaluations", [60, 500, 1500])
def test_a_budget_is_kept_and_told(evaluations):
    problem = problem_of_ridge(None)
    found, _, density = drawn(problem, [10.0, 8.0], evaluations=evaluations, effective=5000)
    assert density.evaluations <= evaluations
    assert "used up" in found.stopped
    assert found.logarithms.size == 10_000


def test_a_model_may_say_that_the_time_is_up():
    problem = problem_of_ridge(None)
    asked = []

    def answering(points):
        asked.append(len(points))
        if sum(asked) > 700:
            raise Stopped("no time left")
        return [problem.response.readings(p) for p in points]

    density = PosteriorDensity(problem, answering)
    found = sample_posterior(
        density, [np.array([10.0, 8.0])], SamplingRequest(1000, 900, 10**6),
        rng=np.random.default_rng(0), watch=lambda progress: None,
    )  # fmt: skip
    assert found.stopped == "no time left"
    assert 50 < found.least_effective < 700


def test_pareto_k_tells_weights_without_a_variance():
    rng = np.random.default_rng(0)
    uneven = 1.2 * rng.exponential(size=4000)  # weights whose tail falls with the power 1/1.2
    even = 0.3 * rng.exponential(size=4000)
    assert smoothed(uneven)[1] == pytest.approx(1.2, abs=0.25)
    assert smoothed(even)[1] == pytest.approx(0.3, abs=0.2)
    weights, k = smoothed(np.zeros(100))
    assert k == 0.0
    np.testing.assert_allclose(weights, 0.01)
