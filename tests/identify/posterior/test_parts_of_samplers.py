"""The parts of the samplers, each against a calculation of its own."""

from __future__ import annotations

import sys
from dataclasses import replace

import numpy as np
import pytest
from scipy.stats import multivariate_normal, multivariate_t
from support.posteriors import problem_of_ridge

from geoident.errors import ModelError, UsageError
from geoident.identify.posterior import approximation, chains, importance
from geoident.identify.posterior.approximation import Mixture, adapted, laplace
from geoident.identify.posterior.chains import Chains, thinned
from geoident.identify.posterior.density import PosteriorDensity
from geoident.identify.posterior.diagnosis import (
    diagnose_chains,
    effective_of_weights,
    library,
    limit_of_k,
)
from geoident.identify.posterior.draws import OUT_OF_EVALUATIONS, Draws, Stopped, Wish
from geoident.identify.posterior.importance import (
    ImportanceSampler,
    Weighted,
    none_yet,
    resampled,
)
from geoident.identify.problem.problem import Problem
from geoident.model.parameter import Parameter, Prior

BOX = np.array([-40.0, -40.0]), np.array([40.0, 40.0])


def mixture(degrees=np.inf, uniform=0.0, box=BOX):
    roots = np.array([[[1.0, 0.0], [0.5, 2.0]], [[0.3, 0.0], [-0.2, 0.4]]])
    shares = (1.0 - uniform) * np.array([0.7, 0.3])
    return Mixture(shares, np.array([[1.0, 2.0], [-3.0, 0.5]]), roots, degrees, *box, uniform)


def density_of(one, degrees):
    """Density of each component by scipy."""
    covariances = [root @ root.T for root in one.roots]
    if np.isfinite(degrees):
        return [
            multivariate_t(c, s, df=degrees) for c, s in zip(one.centres, covariances, strict=True)
        ]
    return [multivariate_normal(c, s) for c, s in zip(one.centres, covariances, strict=True)]


@pytest.mark.parametrize("degrees", [np.inf, 5.0])
@pytest.mark.parametrize("uniform", [0.0, 0.1])
def test_the_density_of_a_mixture_is_that_of_scipy(degrees, uniform):
    one = mixture(degrees, uniform)
    x = np.random.default_rng(0).uniform(-5.0, 5.0, (30, 2))
    parts = [law.pdf(x) for law in density_of(one, degrees)]
    expected = one.shares @ np.array(parts) + uniform / 80.0**2
    np.testing.assert_allclose(np.exp(one.logarithms(x)), expected, rtol=1e-10)


@pytest.mark.parametrize("degrees", [np.inf, 5.0])
def test_draws_of_a_mixture_are_as_its_density_says(degrees):
    """Of a box that cuts it, the share of draws in each of 9 cells; by the density on a grid."""
    low, high = np.array([-4.0, -2.0]), np.array([2.0, 4.0])
    one = mixture(degrees, 0.1, (low, high))
    x = one.draw(np.random.default_rng(1), 40_000)
    assert x.shape == (40_000, 2)
    steps = (np.arange(120) + 0.5) / 120
    fine = np.array([low + (high - low) * (i, j) for i in steps for j in steps])
    weights = np.exp(one.logarithms(fine))

    def cells(points, weight):
        at = np.minimum(((points - low) / (high - low) * 3).astype(int), 2)
        return np.bincount(at[:, 0] * 3 + at[:, 1], weight, 9)

    expected = cells(fine, weights / weights.sum())
    np.testing.assert_allclose(cells(x, np.full(len(x), 1 / len(x))), expected, atol=0.01)


def test_a_mixture_outside_its_bounds_cannot_be_drawn():
    far = replace(mixture(), lower=np.array([100.0, 100.0]), upper=np.array([101.0, 101.0]))
    with pytest.raises(ModelError) as caught:
        far.draw(np.random.default_rng(0), 3)
    assert caught.value.message == (
        "The posterior cannot be sampled: its approximation lies outside the bounds."
    )
    assert caught.value.hint == "Look at the fit: is it converged, and are its bounds meant?"


def linear(rows, measured, lower, upper):
    class Model:
        def admissible(self, p):
            return None

        def readings(self, p):
            return rows @ p

        def evaluate(self, p):
            return rows @ p, rows

    parameters = tuple(
        Parameter(f"p{i}", 0.0, lo, hi, "linear")
        for i, (lo, hi) in enumerate(zip(lower, upper, strict=True))
    )
    return Problem(Model(), measured, np.ones(len(rows)), parameters)


def test_laplaces_approximation_has_the_covariance_of_least_squares():
    rows = np.array([[3.0, 1.0], [0.0, 2.0], [1.0, -4.0]])
    problem = linear(rows, np.array([1.0, 2.0, 3.0]), [-50.0, -30.0], [50.0, 30.0])
    density = PosteriorDensity(problem)
    best = np.linalg.lstsq(rows, problem.measured, rcond=None)[0]
    found = laplace(density, [best])
    size = density.coordinates(np.ones(2))  # u = p / r
    np.testing.assert_allclose(found.centres[0], best * size)
    expected = np.linalg.inv(rows.T @ rows) * np.outer(size, size)
    np.testing.assert_allclose(found.roots[0] @ found.roots[0].T, expected, rtol=1e-9)
    assert found.uniform == 0.1
    assert found.shares.sum() == pytest.approx(0.9)


def test_a_direction_without_readings_is_drawn_along_half_its_extent():
    """Only p0 - p1 is read; along (1, 1) the bounds leave their diagonal, in parts of the width."""
    rows = np.array([[100.0, -100.0]])
    density = PosteriorDensity(linear(rows, np.zeros(1), [-5.0, -5.0], [5.0, 5.0]))
    found = laplace(density, [np.zeros(2)])
    width = density.upper - density.lower
    along = np.ones(2) / np.sqrt(2.0)
    inner = found.roots[0] @ found.roots[0].T / np.outer(width, width)
    # v = (1, 1) / sqrt 2: its admissible extent is 1 / max |v_i| = sqrt 2, half of it the sd
    assert np.sqrt(along @ inner @ along) == pytest.approx(np.sqrt(2.0) / 2.0, rel=1e-9)


def test_two_minima_share_by_their_mass_and_none_is_left_out():
    """Masses exp(-phi/2) det(root): half by these, half alike."""
    problem = linear(np.array([[1.0]]), np.zeros(1), [-50.0], [50.0])
    density = PosteriorDensity(problem)
    found = laplace(density, [np.zeros(1), np.array([2.0])])
    mass = np.array([1.0, np.exp(-2.0)])
    expected = 0.9 * (0.5 * mass / mass.sum() + 0.25)
    np.testing.assert_allclose(found.shares, expected, rtol=1e-12)


@pytest.mark.parametrize(
    ("n", "degrees", "uniform"),
    [(4, 5.0, 0.1), (5, 5.0, 0.0), (12, 5.0, 0.0), (13, np.inf, 0.0)],
)
def test_tails_are_heavy_up_to_twelve_parameters_and_a_flat_part_stands_up_to_four(
    n, degrees, uniform
):
    problem = linear(np.eye(n), np.zeros(n), [-9.0] * n, [9.0] * n)
    found = laplace(PosteriorDensity(problem), [np.zeros(n)])
    assert (found.degrees, found.uniform) == (degrees, uniform)


def test_no_part_is_flat_where_a_bound_is_infinite():
    problem = linear(np.eye(2), np.zeros(2), [-np.inf, -9.0], [9.0, 9.0])
    assert laplace(PosteriorDensity(problem), [np.zeros(2)]).uniform == 0.0


def test_one_step_of_expectation_and_maximisation():
    """Of a normal component: mean and covariance of the draws by their weights, and the floor."""
    rng = np.random.default_rng(2)
    x, weights = (
        rng.normal(size=(400, 2)) @ np.array([[1.0, 0.3], [0.0, 0.5]]),
        rng.uniform(size=400),
    )
    weights /= weights.sum()
    one = Mixture(np.ones(1), np.zeros((1, 2)), np.eye(2)[None], np.inf, *BOX)
    floor = 1e-3 * np.eye(2)
    found = approximation._maximised(one, x, weights, floor)
    mean = np.average(x, axis=0, weights=weights)
    np.testing.assert_allclose(found.centres[0], mean, rtol=1e-12)
    expected = np.cov(x.T, aweights=weights, bias=True) + floor
    np.testing.assert_allclose(found.roots[0] @ found.roots[0].T, expected, rtol=1e-10)
    np.testing.assert_allclose(found.shares, [1.0])


def test_a_component_of_t_weighs_far_draws_less():
    """The step of Liu and Rubin (1995): draws count (nu + m) / (nu + distance), sums by hand."""
    rng = np.random.default_rng(3)
    x, weights = rng.standard_t(3.0, size=(300, 2)), np.full(300, 1 / 300)
    one = Mixture(np.ones(1), np.zeros((1, 2)), np.eye(2)[None], 5.0, *BOX)
    found = approximation._maximised(one, x, weights, np.zeros((2, 2)))
    pull = 7.0 / (5.0 + np.sum(x**2, axis=1))
    mean = (pull @ x) / pull.sum()
    np.testing.assert_allclose(found.centres[0], mean, rtol=1e-12)
    expected = ((x - mean) * pull[:, None]).T @ (x - mean) / 300
    np.testing.assert_allclose(found.roots[0] @ found.roots[0].T, expected, rtol=1e-10)


def test_a_component_with_hardly_any_draws_is_given_up():
    """Less than three effective draws for each parameter."""
    x = np.concatenate([np.random.default_rng(4).normal(size=(200, 2)), [[30.0, 30.0]] * 5])
    weights = np.full(len(x), 1 / len(x))
    centres = np.array([[0.0, 0.0], [30.0, 30.0]])
    two = Mixture(np.full(2, 0.5), centres, np.tile(np.eye(2), (2, 1, 1)), np.inf, *BOX)
    found = approximation._maximised(two, x, weights, 1e-6 * np.eye(2))
    assert len(found.shares) == 1
    more = np.concatenate([x, [[30.0, 30.0]] * 2])
    found = approximation._maximised(two, more, np.full(207, 1 / 207), 1e-6 * np.eye(2))
    np.testing.assert_allclose(found.shares, [200 / 207, 7 / 207])


def test_an_adapted_mixture_finds_two_clusters_and_keeps_the_first_and_wide_copies():
    rng = np.random.default_rng(5)
    x = np.concatenate([rng.normal(size=(300, 2)), rng.normal(size=(100, 2)) * 0.5 + [12.0, -9.0]])
    first = Mixture(np.ones(1), np.zeros((1, 2)), 9.0 * np.eye(2)[None], np.inf, *BOX)
    found = adapted(first, x, np.full(400, 1 / 400), components=2, rng=rng)
    order = np.argsort(found.shares[:2])
    np.testing.assert_allclose(found.shares[:2][order], 0.7 * np.array([0.25, 0.75]), rtol=1e-6)
    np.testing.assert_allclose(found.shares[2:4][order], 0.2 * np.array([0.25, 0.75]), rtol=1e-6)
    assert found.shares[4] == pytest.approx(0.1)
    np.testing.assert_allclose(found.centres[order[0]], x[300:].mean(axis=0), atol=1e-6)
    np.testing.assert_array_equal(found.centres[:2], found.centres[2:4])
    np.testing.assert_allclose(found.roots[2:4] / 2.5, found.roots[:2] / 1.15)
    scale = np.cov(x[300:].T, bias=True)
    inner = found.roots[order[0]] / 1.15
    np.testing.assert_allclose(inner @ inner.T, scale, rtol=1e-3, atol=1e-3)
    np.testing.assert_array_equal(found.roots[4], first.roots[0])


def test_draws_of_several_mixtures_weigh_by_all_of_them():
    """Balance heuristic (Veach and Guibas 1995): pi over the mixture of all, by their counts."""
    rng = np.random.default_rng(6)
    rounds, laws = [], []
    for centre, count in (([0.0, 0.0], 100), ([1.0, 0.5], 300)):
        one = Mixture(np.ones(1), np.array([centre]), 1.5 * np.eye(2)[None], np.inf, *BOX)
        x = one.draw(rng, count)
        logs = np.where(x[:, 0] > 3.0, -np.inf, -0.5 * np.sum(x**2, axis=1))
        rounds.append(Weighted(one, x, logs, one.logarithms(x)))
        laws.append(multivariate_normal(centre, 2.25 * np.eye(2)))
    x, weights = importance._together(rounds, 1.0)
    every = np.concatenate([r.x for r in rounds])
    assert len(x) == np.count_nonzero(every[:, 0] <= 3.0) < 400
    raw = np.exp(-0.5 * np.sum(x**2, axis=1)) / (0.25 * laws[0].pdf(x) + 0.75 * laws[1].pdf(x))
    low = raw < np.quantile(raw, 0.8)  # the largest weights are smoothed
    ratio = weights[low] / raw[low]
    np.testing.assert_allclose(ratio, ratio[0], rtol=1e-9)


@pytest.mark.parametrize("least", [20.0, 60.0])
def test_weights_are_tempered_to_the_effective_size_that_is_asked_for(least):
    """To the largest power: theirs is that size, and their logarithms are in proportion."""
    logs = 3.0 * np.random.default_rng(7).normal(size=200)
    weights = importance._tempered(logs, least)
    assert effective_of_weights(weights) == pytest.approx(least, rel=1e-6)
    assert weights.sum() == pytest.approx(1.0)
    power = np.polyfit(logs, np.log(weights), 1)
    assert 0.0 < power[0] < 1.0
    np.testing.assert_allclose(np.polyval(power, logs), np.log(weights), atol=1e-9)


def test_resampling_takes_every_draw_as_often_as_its_weight_says():
    """Systematic: within one of N w, without an order."""
    one = mixture()
    x = one.draw(np.random.default_rng(8), 50)
    found = Weighted(one, x, -np.sum(x**2, axis=1) / 20.0, np.zeros(50))
    draws = resampled(found, Wish(1000, 100.0, 10), np.random.default_rng(9), "importance")
    assert draws.x.shape == (1, 1000, 2)
    taken = np.array([np.flatnonzero((x == row).all(axis=1))[0] for row in draws.x[0]])
    counts = np.bincount(taken, minlength=50)
    assert np.all(np.abs(counts - 1000 * found.weights) < 1.0)
    np.testing.assert_array_equal(draws.logarithms[0], found.logarithms[taken])
    assert np.abs(np.corrcoef(taken, np.arange(1000))[0, 1]) < 0.1
    assert draws.effective.tolist() == [found.effective] * 2
    assert draws.acceptance == pytest.approx(found.effective / 50)
    few = resampled(found, Wish(5, 100.0, 10), np.random.default_rng(9), "importance")
    assert few.effective.tolist() == [5.0] * 2


def test_weights_are_believed_by_their_tail_and_their_efficiency():
    found = Weighted(mixture(), np.zeros((100, 2)), np.zeros(100), np.zeros(100))
    assert found.efficiency == pytest.approx(1.0)
    assert found.believable(1.0)
    found.pareto_k = 0.5  # the limit of 100 draws
    assert limit_of_k(100) == pytest.approx(0.5)
    assert found.believable(1.0)
    found.pareto_k = 0.5001
    assert not found.believable(1.0)
    found.pareto_k, found.weights = 0.0, np.append(np.full(10, 0.1), np.zeros(90))
    assert found.believable(0.0999)
    assert not found.believable(0.1001)


def test_bounds_themselves_are_inside():
    density = PosteriorDensity(problem_of_ridge(None))
    beyond = 1e-12 * np.ones(2)
    u = np.array([density.lower, density.upper, density.lower - beyond, density.upper + beyond])
    assert density.inside(u).tolist() == [True, True, False, False]


class Normal:
    """A density of two independent normal coordinates, and how often it was asked."""

    def __init__(self, most=10**9):
        self.evaluations, self._most = 0, most

    def __len__(self):
        return 2

    def logarithms(self, x):
        self.evaluations += len(x)
        if self.evaluations > self._most:
            raise Stopped("enough of it")
        return -0.5 * np.sum(x**2, axis=1)


def wide(size):
    return Mixture(np.ones(1), np.zeros((1, 2)), size * np.eye(2)[None], 5.0, *BOX)


def sampler(density, **wish):
    told = []
    wished = Wish(**({"draws": 100, "effective": 800.0, "evaluations": 10**5} | wish))

    def watch(progress):
        told.append(progress)

    return ImportanceSampler(density, np.random.default_rng(0), wished, watch), told


def test_a_good_mixture_is_drawn_until_the_effective_size_is_reached():
    density = Normal()
    found, told = sampler(density)
    result = found.of(wide(1.1), "importance")
    assert 800.0 <= result.effective < 1300.0
    assert found.rounds == [result]
    assert density.evaluations == len(result.x)
    # the first question after 50 evaluations, then after each 50 more or what is left of a part
    steps = np.diff([0, *(t.evaluations for t in told)])
    assert steps[:6].tolist() == [50] * 6
    assert steps.max() == 50
    assert {(t.sampler, t.wanted) for t in told} == {("importance", 800.0)}


def test_a_poor_mixture_is_left_after_the_first_300_draws():
    found, _ = sampler(Normal())
    result = found.of(wide(12.0), "importance", least=0.5)
    assert len(result.x) == 300
    assert result.efficiency < 0.5


def test_a_mixture_is_adapted_until_it_is_good():
    """300 draws a round, and none after the first round that is good."""
    found, told = sampler(Normal())
    found.of(wide(12.0), "importance", least=0.5)
    mixture = found.adapt()
    good = [r.believable(0.35) for r in found.rounds]
    assert good == [False] * (len(good) - 1) + [True]
    assert [len(r.x) for r in found.rounds] == [300] * len(good)
    assert mixture is found.rounds[-1].mixture
    assert told[-1].sampler == "adapting"
    better = found.of(mixture, "adapted importance")
    assert better.believable(0.35)


def test_a_density_that_no_mixture_meets_is_adapted_to_eight_times(monkeypatch):
    monkeypatch.setattr(importance, "_GOOD", 2.0)
    found, _ = sampler(Normal())
    found.of(wide(3.0), "importance", least=0.99)
    mixture = found.adapt()
    assert len(found.rounds) == 9
    best = max(found.rounds[1:], key=lambda r: r.efficiency)
    assert mixture is best.mixture


def test_importance_sampling_keeps_to_its_budget_and_to_the_time():
    found, _ = sampler(Normal(), evaluations=120)
    assert len(found.of(wide(1.1), "importance").x) == 120
    assert found.stopped == OUT_OF_EVALUATIONS
    late, _ = sampler(Normal(most=170))
    assert len(late.of(wide(1.1), "importance").x) == 150
    assert late.stopped == "enough of it"


def growing(**wish):
    """Four chains of independent normal numbers in 2 coordinates, and their parts."""
    rng, density = np.random.default_rng(0), Normal()
    parts = []

    def advance(steps):
        x = rng.normal(size=(4, steps, 2))
        logs = density.logarithms(x.reshape(-1, 2)).reshape(4, steps)
        parts.append((x, logs))
        return x, logs

    wished = Wish(**({"draws": 100, "effective": 150.0, "evaluations": 10**5} | wish))
    found = Chains("ensemble", density, wished, lambda told: None, advance, lambda: 0.3, 4)
    return found, parts, density


def test_chains_give_their_second_half_once_they_are_long_enough():
    found, parts, _ = growing()
    draws = found.run()
    whole = np.concatenate([x for x, _ in parts], axis=1)
    assert whole.shape[1] == 100
    np.testing.assert_array_equal(draws.x, whole[:, 50:])
    logs = np.concatenate([of for _, of in parts], axis=1)
    np.testing.assert_array_equal(draws.logarithms, logs[:, 50:])
    assert draws.least_effective >= 150.0
    assert draws.stopped == ""
    assert draws.acceptance == 0.3


@pytest.mark.parametrize("asked", [{"effective": 900.0}, {"draws": 900, "effective": 1.0}])
def test_chains_go_on_by_hundreds_and_then_by_a_quarter_of_what_they_are(asked):
    found, parts, _ = growing(**asked)
    draws = found.run()
    assert draws.x.shape[0] * draws.x.shape[1] >= 900
    length, judged = 0, []
    while length < len(parts) * 10:
        length += max(100, length // 4 // 10 * 10)
        judged.append(length)
    assert judged[-1] == len(parts) * 10
    assert draws.least_effective >= asked["effective"]


def test_chains_that_are_stopped_give_what_there_is_and_nothing_of_a_single_part():
    """A part is of ten steps of four chains: 40 evaluations."""
    for evaluations, parts in ((0, 0), (1, 1), (41, 2), (100, 3)):
        found, made, _ = growing(evaluations=evaluations)
        draws = found.run()
        assert len(made) == parts
        if parts < 2:
            assert draws is None
        else:
            assert draws.stopped == OUT_OF_EVALUATIONS
            assert draws.x.shape == (4, 5 * parts, 2)


def test_chains_stop_where_the_watch_or_the_model_says_so():
    found, parts, _ = growing()
    found.watch = lambda told: "no time left" if told.evaluations >= 120 else None
    assert found.run().stopped == "no time left"
    assert len(parts) == 3
    found, _, density = growing()
    density._most = 130
    draws = found.run()
    assert draws.stopped == "enough of it"
    assert draws.x.shape[1] == 15


def test_draws_are_thinned_evenly_and_to_the_last():
    x = np.arange(2 * 101.0).reshape(2, 101, 1)
    whole = Draws("ensemble", x, x[..., 0], np.ones(1), np.ones(1), np.nan, 0.3, "why")
    found = thinned(whole, 12)
    assert found.x[:, :, 0].tolist() == [[0, 20, 40, 60, 80, 100], [101, 121, 141, 161, 181, 201]]
    np.testing.assert_array_equal(found.logarithms, found.x[:, :, 0])
    assert (found.stopped, found.acceptance) == ("why", 0.3)
    assert thinned(whole, 1).x.shape[1] == 1
    assert thinned(whole, 10**6).x.shape[1] == 101


def walk():
    problem = problem_of_ridge(Prior(8.0, 2.0))
    density = PosteriorDensity(problem)
    rng = np.random.default_rng(1)
    begin = importance.none_yet(laplace(density, [np.array([10.0, 8.0])])).more(density, rng, 60)
    return chains._CrankNicolson(density, begin, rng)


@pytest.mark.parametrize(
    ("shares", "size"),
    [
        ([0.3], 0.5),
        ([0.19, 0.3], 0.3),
        ([0.41, 0.3], 0.75),
        ([0.2], 0.5),
        ([0.4], 0.5),
        ([0.9, 0.9, 0.9], 1.0),
        ([0.1] * 12, 0.5 * 0.6**10),
    ],
)
def test_the_length_of_a_step_is_tuned_to_the_share_that_is_accepted(shares, size):
    """0.6 of it where less than a fifth is, half as much again up to one where over 40 % are."""
    found, asked = walk(), []

    def advance(steps):
        asked.append(steps)
        share = shares[min(len(asked), len(shares)) - 1]
        found._accepted, found._steps = round(1000 * share), 1000

    found.advance = advance
    found.tune(lambda: True)
    assert found._size == pytest.approx(size)
    assert asked == [20] * min(len(shares), 10)
    assert found.acceptance == 0.0  # what was tuned does not count


def weighted(weights, logarithms, x=None):
    found = none_yet(mixture())
    found.x = np.arange(2.0 * len(weights)).reshape(-1, 2) if x is None else x
    found.logarithms, found.weights = np.asarray(logarithms, float), np.asarray(weights, float)
    return found


def test_chains_begin_at_different_draws_likely_by_the_root_of_their_weights():
    """Of weights 1 : 9 among many the second kind is drawn three times as often."""
    weights = np.tile([0.001, 0.009], 100)
    begin, rng = weighted(weights, np.zeros(200)), np.random.default_rng(0)
    counts = np.zeros(2)
    for _ in range(400):
        x = chains._starts(begin, rng, 4)
        taken = (x[:, 0] / 2.0).astype(int)
        assert len(set(taken.tolist())) == 4
        np.testing.assert_array_equal(x, begin.x[taken])
        counts += np.bincount(taken % 2, minlength=2)
    assert counts[1] / counts[0] == pytest.approx(3.0, rel=0.25)


def test_where_hardly_any_draw_has_weight_chains_begin_at_those_of_the_best_density():
    logs = np.array([-np.inf, 5.0, 1.0, 4.0, 3.0])
    begin = weighted([0.0, 1.0, 0.0, 0.0, 0.0], logs)
    x = chains._starts(begin, np.random.default_rng(0), 3)
    assert sorted((x[:, 0] / 2.0).tolist()) == [1.0, 3.0, 4.0]
    more = chains._starts(begin, np.random.default_rng(0), 7)  # the rest are of the mixture
    of_draws = [row for row in more.tolist() if row in begin.x[1:].tolist()]
    assert len(of_draws) == 4
    assert more.shape == (7, 2)


@pytest.mark.parametrize(
    ("parameter", "centre", "sd"),
    [
        (Parameter("a", 3.0, 1.0, 9.0, "log"), np.log(9.0) / 2.0, np.log(9.0) / 2.0),
        (Parameter("a", 3.0, -1.0, 9.0, "linear"), 4.0 / 3.0, 5.0 / 3.0),  # u = p / 3
        (Parameter("a", 3.0, 2.0, np.inf, "log"), np.log(3.0), 2.5),
        (Parameter("a", 3.0, -np.inf, 9.0, "linear"), 1.0, 5.0),
        (Parameter("a", 0.0, -np.inf, np.inf, "linear"), 0.0, 5.0),
        (Parameter("a", 3.0, 1.0, 9.0, "log", Prior(4.0, 1.0)), np.log(4.0), 0.25),
        (Parameter("a", 3.0, -1.0, 9.0, "linear", Prior(6.0, 1.5)), 2.0, 0.5),
    ],
)
def test_what_is_known_before_is_the_prior_or_as_wide_as_the_bounds(parameter, centre, sd):
    """In u: half of the distance of the bounds; of none, 2.5 in ln p, or five of the start."""
    problem = Problem(None, np.zeros(1), np.ones(1), (parameter,))
    found = PosteriorDensity(problem).reference()
    assert found[0][0] == pytest.approx(centre)
    assert found[1][0] == pytest.approx(sd)


def test_chains_of_a_group_count_as_one_for_r_hat():
    """Two groups of two, of which one agrees with the other and one does not."""
    rng = np.random.default_rng(0)
    x = rng.normal(size=(4, 300, 2))
    x[1::2, :, 0] += 3.0  # in each group one that stays elsewhere: the groups agree nonetheless
    x[2:, :, 1] += 3.0  # groups that do not agree
    size, r_hat = diagnose_chains(x, groups=2)
    assert r_hat[0] < 1.02
    assert r_hat[1] > 1.5
    alone = diagnose_chains(x, groups=4)[1]
    assert alone[0] > 1.5
    arviz = library("arviz")
    for i in range(2):
        kinds = [float(arviz.ess(x[:, :, i], method=kind)) for kind in ("bulk", "tail")]
        assert size[i] == pytest.approx(min(kinds))
    # one after the other in time: halves of a group are both halves of its chains
    drift = np.linspace(0.0, 4.0, 300)[None, :, None] + rng.normal(size=(4, 300, 1))
    assert diagnose_chains(drift, groups=2)[1][0] > 1.1
    still = np.zeros((4, 10, 1))
    assert np.isnan(diagnose_chains(still, groups=2)).all()


def test_weights_that_are_all_zero_are_worth_nothing():
    assert effective_of_weights(np.zeros(4)) == 0.0
    assert effective_of_weights(np.array([0.5, 0.5, 0.0])) == pytest.approx(2.0)


def test_adaptation_ends_with_the_budget():
    found, _ = sampler(Normal(), evaluations=450)
    found.of(wide(12.0), "importance", least=0.5)
    found.adapt()
    assert found.stopped == OUT_OF_EVALUATIONS
    assert [len(r.x) for r in found.rounds] == [300, 150]


def test_weights_of_a_twentieth_are_worth_using_and_less_are_not():
    """A mixture k times too wide in 2 coordinates has an efficiency of about 2 / k^2 (normal)."""
    for size, enough in ((5.0, True), (7.5, False)):
        found, _ = sampler(Normal())
        one = Mixture(np.ones(1), np.zeros((1, 2)), size * np.eye(2)[None], np.inf, *BOX)
        result = found.of(one, "importance")
        assert result.efficiency == pytest.approx(2.0 / size**2, rel=0.4)
        assert (len(result.x) > 300) is enough
    at = Weighted(mixture(), np.zeros((100, 2)), np.zeros(100), np.zeros(100))
    at.pareto_k = 0.0
    for last, effective, enough in ((0.25, 4.446, False), (0.6, 4.855, False), (2.0, 5.0, True)):
        raw = np.array([1.0, 1.0, 1.0, 1.0, last, last - 1.0 if last > 1.0 else 0.0])
        at.weights = np.append(raw / raw.sum(), np.zeros(94))
        assert at.effective == pytest.approx(effective, rel=0.1)
        assert at.believable() is enough


def test_a_step_is_not_tuned_where_nothing_may_be_asked():
    found = walk()
    found.advance = pytest.fail
    found.tune(lambda: False)
    assert found._size == 0.5


def test_a_missing_library_is_told_and_another_error_is_not_hidden(tmp_path, monkeypatch):
    monkeypatch.syspath_prepend(tmp_path)
    with pytest.raises(UsageError, match=r'sampling needs midsampler: pip install "geoident'):
        library("midsampler")
    for missing in ("aa_missing", "zz_missing"):
        name = f"needs_{missing}"
        (tmp_path / f"{name}.py").write_text(f"import {missing}\n")
        with pytest.raises(ModuleNotFoundError, match=missing):
            library(name)
        assert name not in sys.modules
