"""Single steps of the samplers, against the same by hand: draws, mixtures, chains, predictions."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
import scipy.sparse as sp

from geoident.errors import CollapseError, ModelError
from geoident.identify.posterior import approximation, chains, importance
from geoident.identify.posterior.approximation import Mixture, adapted, laplace
from geoident.identify.posterior.density import PosteriorDensity
from geoident.identify.posterior.draws import Stopped, Wish
from geoident.identify.posterior.importance import Weighted, none_yet
from geoident.identify.posterior.predictive import with_errors
from geoident.identify.problem.errors import ErrorStructure, SharedErrors
from geoident.identify.problem.problem import Problem
from geoident.model.parameter import Parameter

BOX = np.array([-40.0, -40.0]), np.array([40.0, 40.0])
ROOTS = np.array([[[1.0, 0.0], [0.5, 2.0]], [[0.3, 0.0], [-0.2, 0.4]]])
TWO = Mixture(np.array([0.7, 0.3]), np.array([[1.0, 2.0], [-3.0, 0.5]]), ROOTS, np.inf, *BOX)


# Mixtures


class Scripted:
    """Random numbers that are given."""

    def __init__(self, **given):
        self.given = {name: list(values) for name, values in given.items()}
        self.asked = []

    def __getattr__(self, name):
        def take(*args, **options):
            self.asked.append((name, args, options))
            return self.given[name].pop(0)

        return take


@pytest.mark.parametrize("degrees", [np.inf, 5.0])
def test_a_draw_is_a_centre_and_a_root_times_a_normal_or_anywhere_between_the_bounds(degrees):
    one = replace(TWO, degrees=degrees, shares=np.array([0.6, 0.3]), uniform=0.1)
    normal = np.array([[0.5, -1.0], [2.0, 0.25], [9.0, 9.0], [-0.75, 1.5]])
    squares = np.array([4.0, 6.0, 5.0, 9.0])
    box = np.array([[11.0, -13.0]])
    rng = Scripted(
        choice=[np.array([0, 1, 2, 1])], standard_normal=[normal.copy()],
        chisquare=[squares], uniform=[box],
    )  # fmt: skip
    x = one._anywhere(rng, 4)
    size = np.ones(4) if np.isinf(degrees) else np.sqrt(5.0 / squares)
    expected = [
        one.centres[k] + ROOTS[k] @ (normal[i] * size[i]) for i, k in enumerate([0, 1, 0, 1])
    ]
    expected[2] = box[0]
    np.testing.assert_allclose(x, expected)
    (_, (kinds,), options), *_, (_, (low, high, shape), _) = rng.asked
    assert kinds == 3
    np.testing.assert_allclose(options["p"], [0.6, 0.3, 0.1])
    assert (low, high, shape) == (one.lower, one.upper, (1, 2))


def test_draws_are_made_by_twice_as_many_until_there_are_enough_inside():
    narrow = replace(TWO, lower=np.array([0.0, -40.0]), shares=np.array([0.1, 0.9]))
    rng = np.random.default_rng(0)
    x = narrow.draw(rng, 30)
    again, found = np.random.default_rng(0), []
    while sum(map(len, found)) < 30:
        more = narrow._anywhere(again, 60)
        found.append(more[more[:, 0] >= 0.0])
    np.testing.assert_array_equal(x, np.concatenate(found)[:30])
    assert narrow.draw(rng, 0).shape == (0, 2)


def test_a_thousand_trials_for_each_draw_are_enough(monkeypatch):
    """At 6 draws of 12 000 trials hardly anything is inside: the last are in the 501st dozen."""
    tried = []

    def anywhere(self, rng, count):
        tried.append(count)
        inside = np.zeros((count, 2))
        return inside if len(tried) == 501 else inside + 99.0

    monkeypatch.setattr(Mixture, "_anywhere", anywhere)
    assert TWO.draw(None, 6).tolist() == [[0.0, 0.0]] * 6
    assert tried == [12] * 501
    tried.append(0)
    with pytest.raises(ModelError, match="outside the bounds"):
        TWO.draw(None, 6)
    assert len(tried) == 502 + 501


def test_a_minimum_without_a_solution_is_left_out_and_the_fit_is_not():
    class Half:
        def admissible(self, p):
            return None

        def readings(self, p):
            return p

        def evaluate(self, p):
            if p[0] > 2.0:
                raise CollapseError("the ground collapses", stage="s", fraction=0.5)
            return p, np.eye(1)

    q = (Parameter("a", 1.0, -50.0, 50.0),)
    density = PosteriorDensity(Problem(Half(), np.zeros(1), np.ones(1), q))
    found = laplace(density, [np.zeros(1), np.array([3.0])])
    np.testing.assert_allclose(found.shares, [0.9])
    with pytest.raises(ModelError, match="collapses"):
        laplace(density, [np.array([3.0]), np.zeros(1)])


def test_ranges_without_bounds_are_ten_and_rows_are_filled_up_with_zeros():
    """One reading of two unbounded parameters: (3, 4) / 5 is seen, the rest drawn on its extent."""
    rows = np.array([[3.0, 4.0]])

    class Model:
        def admissible(self, p):
            return None

        def evaluate(self, p):
            return rows @ p, rows

    q = tuple(Parameter(n, 1.0, -np.inf, np.inf) for n in "ab")
    density = PosteriorDensity(Problem(Model(), np.zeros(1), np.full(1, 0.5), q))
    found = laplace(density, [np.array([4.0, -3.0])])
    C = found.roots[0] @ found.roots[0].T
    seen, free = np.array([0.6, 0.8]), np.array([0.8, -0.6])
    assert seen @ C @ seen == pytest.approx(0.01)  # sd 0.5 / 5
    assert np.sqrt(free @ C @ free) == pytest.approx(10.0 * 0.5 / 0.8)
    assert seen @ C @ free == pytest.approx(0.0, abs=1e-9)


def test_the_mass_of_a_minimum_is_its_height_and_its_root():
    """phi of 0 and 2.5 beside each other, roots by the slopes 3 and 0.7: shares half by these."""

    class Model:
        def admissible(self, p):
            return None

        def evaluate(self, p):
            slope = 3.0 if p[0] < 1.0 else 0.7
            return np.array([0.0 if p[0] < 1.0 else np.sqrt(2.5)]), np.array([[slope]])

    q = (Parameter("a", 1.0, -500.0, 500.0),)
    density = PosteriorDensity(Problem(Model(), np.zeros(1), np.ones(1), q))
    found = laplace(density, [np.zeros(1), np.array([2.0])])
    mass = np.exp([0.0, -1.25]) / [3.0, 0.7]
    np.testing.assert_allclose(found.shares, 0.9 * (0.5 * mass / mass.sum() + 0.25))


@pytest.mark.parametrize("across", [0.0, 1e-5])
def test_a_fitted_mixture_has_a_floor_in_every_direction(across):
    """A millionth of the whole variance in proportion; of draws on a line what rounding leaves."""
    rng = np.random.default_rng(0)
    t = np.linspace(-3.0, 5.0, 90)
    x = t[:, None] * [1.0, 2.0] + across * rng.normal(size=90)[:, None] * [2.0, -1.0]
    weights = np.linspace(1.0, 2.0, 90)
    weights /= weights.sum()
    first = Mixture(np.ones(1), np.zeros((1, 2)), 9.0 * np.eye(2)[None], np.inf, *BOX)
    found = adapted(first, x, weights, components=1, rng=rng)
    mean = weights @ x
    whole = ((x - mean) * weights[:, None]).T @ (x - mean)
    inner = found.roots[0] @ found.roots[0].T / 1.15**2
    along = np.array([1.0, 2.0]) / np.sqrt(5.0)
    beside = np.array([2.0, -1.0]) / np.sqrt(5.0)
    even = 0.5 * np.trace(whole)
    expected = (1.0 + 1e-6) * (beside @ whole @ beside) + 1e-12 * even
    assert beside @ inner @ beside == pytest.approx(expected, rel=0.1 if across == 0.0 else 1e-3)
    assert along @ inner @ along == pytest.approx((1.0 + 1e-6) * (along @ whole @ along), rel=1e-9)
    np.testing.assert_allclose(found.centres[0], mean)
    np.testing.assert_allclose(found.shares, [0.7, 0.2, 0.1])


def test_a_fitted_mixture_keeps_the_share_that_is_even():
    rng = np.random.default_rng(1)
    x = rng.normal(size=(200, 2))
    first = Mixture(np.array([0.9]), np.zeros((1, 2)), 3.0 * np.eye(2)[None], 5.0, *BOX, 0.1)
    found = adapted(first, x, np.full(200, 1 / 200), components=1, rng=rng)
    assert (found.uniform, found.degrees) == (0.1, 5.0)
    np.testing.assert_allclose(found.shares, [0.63, 0.18, 0.09])
    step = approximation._maximised(first, x, np.full(200, 1 / 200), np.zeros((2, 2)))
    np.testing.assert_allclose(step.shares, [0.9])


def test_centres_are_far_from_each_other_by_weight_and_squared_distance():
    """In the metric of all draws; the first by weight alone; none where no draw is left."""
    x = np.array([[0.0, 0.0], [2.0, 1.0], [5.0, -3.0], [0.5, 8.0]])
    weights = np.array([0.1, 0.4, 0.3, 0.2])
    whole = np.array([[2.0, 0.3], [0.3, 5.0]])
    rng = Scripted(choice=[1, 3, 2])
    found = approximation._centres(x, weights, 3, whole, rng)
    np.testing.assert_array_equal(found, x[[1, 3, 2]])
    inverse = np.linalg.inv(whole)

    def squares(k):
        return np.array([(one - x[k]) @ inverse @ (one - x[k]) for one in x])

    chance = [weights, weights * squares(1), weights * np.minimum(squares(1), squares(3))]
    for (_, (count,), options), expected in zip(rng.asked, chance, strict=True):
        assert count == 4
        np.testing.assert_allclose(options["p"], expected / expected.sum())
    same = np.ones((5, 2))
    found = approximation._centres(same, np.full(5, 0.2), 3, whole, np.random.default_rng(0))
    assert len(found) == 1


def test_a_component_of_expectation_has_its_part_of_each_draw():
    """Two components and an even part, heavy tails: responsibilities by the densities, by hand."""
    rng = np.random.default_rng(2)
    x, weights = rng.normal(size=(150, 2)) * [3.0, 2.0], rng.uniform(size=150)
    weights /= weights.sum()
    one = replace(TWO, shares=np.array([0.5, 0.4]), degrees=5.0, uniform=0.1)
    found = approximation._maximised(one, x, weights, 0.01 * np.eye(2))
    parts = np.exp(one._parts(x))
    belongs = weights[:, None] * parts / (parts.sum(axis=1) + 0.1 / 80.0**2)[:, None]
    for k in range(2):
        inverse = np.linalg.inv(ROOTS[k] @ ROOTS[k].T)
        gap = x - one.centres[k]
        distance = np.einsum("ki,ij,kj->k", gap, inverse, gap)
        np.testing.assert_allclose(one.distances(x, k), distance)
        pull = 7.0 / (5.0 + distance)
        mine = belongs[:, k]
        centre = (mine * pull) @ x / (mine @ pull)
        np.testing.assert_allclose(found.centres[k], centre)
        gap = x - centre
        scale = (gap * (mine * pull)[:, None]).T @ gap / mine.sum() + 0.01 * np.eye(2)
        np.testing.assert_allclose(found.roots[k] @ found.roots[k].T, scale)
    shares = belongs.sum(axis=0)
    np.testing.assert_allclose(found.shares, 0.9 * shares / shares.sum())


# Importance sampling


def test_the_next_draws_are_what_is_missing_by_the_efficiency():
    """A twentieth more; a hundred at least, 2000 at most, 300 of nothing."""
    wish = Wish(10, 500.0, 10**6)
    sampler = importance.ImportanceSampler(None, None, wish, None)
    assert sampler._missing(none_yet(TWO)) == 300
    for effective, count in ((400.0, 210), (460.0, 100), (100.0, 2000)):
        efficiency = effective / 800.0
        found = SimpleNamespace(x=np.zeros(800), effective=effective, efficiency=efficiency)
        assert sampler._missing(found) == count
    assert importance._parts(0) == []
    assert importance._parts(150) == [50, 50, 50]
    assert importance._parts(101) == [50, 50, 1]


def test_draws_that_are_added_keep_their_densities():
    class Density:
        def logarithms(self, x):
            return -np.abs(x).sum(axis=1)

    rng = np.random.default_rng(0)
    found = none_yet(TWO).more(Density(), rng, 30).more(Density(), rng, 40)
    assert found.x.shape == (70, 2)
    np.testing.assert_allclose(found.logarithms, -np.abs(found.x).sum(axis=1))
    np.testing.assert_allclose(found.proposal, TWO.logarithms(found.x))
    assert none_yet(TWO).efficiency == 0.0
    raw = np.exp(found.logarithms - found.proposal)
    low = raw < np.quantile(raw, 0.7)  # the largest are smoothed
    ratio = found.weights[low] / raw[low]
    np.testing.assert_allclose(ratio, ratio[0])
    assert found.efficiency == pytest.approx(1.0 / np.sum(found.weights**2) / 70)


def test_weights_are_asked_to_leave_as_many_draws_or_a_third_of_them():
    x = np.linspace(-6.0, 6.0, 60)[:, None] * [1.0, 0.5]
    one = Weighted(TWO, x, -8.0 * np.sum(x**2, axis=1), TWO.logarithms(x))
    for least, left in ((9.0, 9.0), (400.0, 20.0)):
        _, weights = importance._together([one], least)
        assert 1.0 / np.sum(weights**2) == pytest.approx(left, rel=1e-5)
    # what has enough is not tempered but smoothed
    flat = Weighted(TWO, x, TWO.logarithms(x), TWO.logarithms(x))
    np.testing.assert_allclose(importance._together([flat], 60.0)[1], 1 / 60)


class Counted:
    """A density that counts what it is asked."""

    def __init__(self):
        self.evaluations = 0

    def __len__(self):
        return 2

    def logarithms(self, u):
        self.evaluations += len(u)
        return -0.5 * np.sum((u - 1.0) ** 2, axis=1) / 0.7


def adapting(monkeypatch, *, rounds=1, good=None, density=None):
    """What each fit of a mixture was given, and the sampler afterwards."""
    fits = []

    def fitted(first, x, weights, *, components, rng):
        fits.append((first, len(x), components, 1.0 / np.sum(weights**2)))
        return replace(TWO, centres=TWO.centres + 0.1 * len(fits))

    monkeypatch.setattr(importance, "adapted", fitted)
    believed = []

    def believable(self, least):
        believed.append(least)
        return len(believed) == good

    monkeypatch.setattr(Weighted, "believable", believable)
    sampler = importance.ImportanceSampler(
        density or Counted(), np.random.default_rng(3), Wish(10, 500.0, 10**6), lambda told: None
    )
    for k in range(rounds):
        first = replace(TWO, centres=TWO.centres - k)
        sampler.rounds.append(none_yet(first).more(sampler._density, sampler._rng, 300))
    mixture = sampler.adapt()
    return mixture, sampler, fits, believed


def test_mixtures_of_more_and_more_components_are_fitted_to_all_draws(monkeypatch):
    """As many as rounds so far and one, at most eight; ten effective draws for each parameter."""
    mixture, sampler, fits, believed = adapting(monkeypatch)
    assert [components for _, _, components, _ in fits] == [2, 3, 4, 5, 6, 7, 8, 8]
    assert [count for _, count, _, _ in fits] == [300 * k for k in range(1, 9)]
    assert all(first is sampler.rounds[0].mixture for first, *_ in fits)
    for k, (_, count, components, effective) in enumerate(fits):
        assert effective >= min(20.0 * components, count / 3.0) * (1.0 - 1e-6), k
    assert set(believed) == {0.35}
    best = max(sampler.rounds[1:], key=lambda r: r.efficiency)
    assert mixture is best.mixture
    assert sampler._density.evaluations == 9 * 300


def test_a_second_adaptation_goes_on_from_the_first(monkeypatch):
    mixture, sampler, fits, _ = adapting(monkeypatch, rounds=3, good=2)
    assert [components for _, _, components, _ in fits] == [4, 5]
    assert [count for _, count, _, _ in fits] == [900, 1200]
    assert any(mixture is r.mixture for r in sampler.rounds[3:])


def test_weights_that_are_uneven_are_raised_for_a_fit(monkeypatch):
    class Narrow(Counted):
        def logarithms(self, u):
            return 40.0 * super().logarithms(u)

    _, _, fits, _ = adapting(monkeypatch, density=Narrow())
    sizes = [effective for *_, effective in fits]
    wanted = [min(20.0 * c, n / 3.0) for _, n, c, _ in fits]
    np.testing.assert_allclose(sizes[:3], wanted[:3], rtol=1e-5)


def test_thirty_steps_are_made_from_centres_that_share_the_whole():
    """Of two that overlap, so that they are not at their end: the same steps one by one."""
    rng = np.random.default_rng(4)
    x = np.concatenate(
        [rng.normal(size=(150, 2)), rng.normal(size=(50, 2)) + np.array([[1.5, 1.0]])]
    )
    weights = rng.uniform(0.5, 1.5, 200)
    weights /= weights.sum()
    first = Mixture(np.array([0.9]), np.zeros((1, 2)), 3.0 * np.eye(2)[None], 5.0, *BOX, 0.1)
    found = adapted(first, x, weights, components=2, rng=np.random.default_rng(5))
    gap = x - weights @ x
    whole = (gap * weights[:, None]).T @ gap
    even = 0.5 * np.trace(whole) * np.eye(2)
    whole += 1e-12 * even
    floor = 1e-6 * whole + 1e-12 * even
    centres = approximation._centres(x, weights, 2, whole, np.random.default_rng(5))
    root = np.linalg.cholesky(whole / 4.0 + floor)
    now = Mixture(np.full(2, 0.45), centres, np.stack([root, root]), 5.0, *BOX, 0.1)
    steps = [now]
    for _ in range(31):
        steps.append(approximation._maximised(steps[-1], x, weights, floor))
    np.testing.assert_allclose(found.centres[:2], steps[30].centres, rtol=1e-9)
    np.testing.assert_allclose(found.shares[:2], 0.7 * steps[30].shares, rtol=1e-9)
    for other in (29, 31):
        assert np.abs(found.centres[:2] - steps[other].centres).max() > 1e-6


# Chains


class Bowl:
    """A density of two coordinates, of which none is outside one of them."""

    evaluations = 0

    def __init__(self, edge=np.inf):
        self.edge, self.asked = edge, []

    def reference(self):
        return np.array([1.0, -2.0]), np.array([2.0, 0.5])

    def logarithms(self, u):
        self.asked.append(u.copy())
        value = -0.3 * (u[:, 0] - 0.5) ** 4 - 2.0 * np.abs(u[:, 1] + 1.7) + 0.4 * u[:, 0] * u[:, 1]
        return np.where(u[:, 0] > self.edge, -np.inf, value)


ROOT = np.array([[0.9, 0.0], [0.2, 0.3]])


def walking(density, rng):
    mixture = Mixture(np.ones(1), np.zeros((1, 2)), ROOT[None], np.inf, *BOX)
    begin = none_yet(mixture)
    begin.x = np.random.default_rng(5).normal(size=(60, 2)) * [1.0, 0.4] + [1.0, -2.0]
    begin.logarithms, begin.weights = density.logarithms(begin.x), np.full(60, 1 / 60)
    return chains._CrankNicolson(density, begin, rng)


@pytest.mark.parametrize("edge", [np.inf, 1.0])
def test_a_step_of_crank_nicolson_is_that_of_its_formula(edge):
    """In t = V^T (u - centre) / sd, with Laplace's variances c of t; b = 0.5 at first."""
    density = Bowl(edge)
    found = walking(density, np.random.default_rng(3))
    found.begin()
    centre, sd = density.reference()
    scaled = ROOT / sd[:, None]
    c, V = np.linalg.eigh(scaled @ scaled.T)
    np.testing.assert_allclose(found._variance, np.minimum(c, 1.0))
    t = ((density.asked[-1] - centre) / sd) @ V
    assert t.shape == (8, 2)
    log = density.logarithms(centre + (t @ V.T) * sd)
    np.testing.assert_allclose(found._log, log)
    taken = 0
    for b in (0.5, 0.5, 0.8):
        found._size = b
        again = np.random.default_rng()
        again.bit_generator.state = found._rng.bit_generator.state
        n = again.standard_normal((8, 2))
        size = b**2 * np.minimum(c, 1.0)
        trial = np.sqrt(1.0 - size) * t + np.sqrt(size) * n
        new = density.logarithms(centre + (trial @ V.T) * sd)
        with np.errstate(invalid="ignore"):
            gain = (new + 0.5 * (trial**2).sum(1)) - (log + 0.5 * (t**2).sum(1))
        better = np.isfinite(new) & (~np.isfinite(log) | (np.log(again.uniform(size=8)) < gain))
        t, log = np.where(better[:, None], trial, t), np.where(better, new, log)
        taken += better.sum()
        u, logs = found.advance(1)
        np.testing.assert_allclose(u[:, 0], centre + (t @ V.T) * sd)
        np.testing.assert_allclose(logs[:, 0], log)
    assert 0 < taken < 24
    assert found.acceptance == taken / 24
    u, logs = found.advance(4)
    assert (u.shape, logs.shape) == ((8, 4, 2), (8, 4))


def test_a_chain_outside_takes_the_first_place_inside():
    density = Bowl(edge=1.0)
    found = walking(density, np.random.default_rng(3))
    found.begin()
    outside = np.isneginf(found._log)
    assert 0 < outside.sum() < 8
    before = found._t.copy()
    found._step()
    moved = np.any(found._t != before, axis=1)
    inside = density.asked[-1][:, 0] <= 1.0
    np.testing.assert_array_equal(moved[outside], inside[outside])
    assert np.all(np.isfinite(found._log[moved]))


def test_chains_that_are_stopped_before_they_begin_are_none():
    class Late(Bowl):
        def logarithms(self, u):
            if self.asked:
                raise Stopped("no time left")
            return super().logarithms(u)

    density = Late()
    begin = none_yet(Mixture(np.ones(1), np.zeros((1, 2)), ROOT[None], np.inf, *BOX))
    begin.x = np.random.default_rng(5).normal(size=(60, 2))
    begin.logarithms, begin.weights = density.logarithms(begin.x), np.full(60, 1 / 60)
    rng = np.random.default_rng(0)
    wish = Wish(10, 10.0, 10**6)
    assert chains.crank_nicolson(density, begin, rng, wish, lambda told: None) is None


def test_chains_begin_anywhere_where_no_draw_has_a_density():
    begin = none_yet(TWO)
    begin.x, begin.weights = np.zeros((4, 2)), np.zeros(4)
    begin.logarithms = np.full(4, -np.inf)
    x = chains._starts(begin, np.random.default_rng(7), 5)
    np.testing.assert_array_equal(x, TWO.draw(np.random.default_rng(7), 5))


# Predictions


def readings(shared, rows):
    problem = Problem(
        None, np.array([0.9, 1.4, -0.2]), np.array([0.3, 0.4, 0.2]),
        (Parameter("a", 1.0, 0.0, 2.0),),
        shared=None if shared is None else SharedErrors(sp.csr_array(shared)),
    )  # fmt: skip
    later = ErrorStructure(
        np.array([0.25, 0.35]), np.array([-1, -1]), sp.csr_array(rows),
        np.full(rows.shape[1], -1), (),
    )  # fmt: skip
    return problem, later


ANSWERS = np.array([[0.1, 0.2, 0.3], [0.4, 0.1, 0.0], [0.7, 0.7, -0.7], [1.0, 2.0, 0.5]])
LATER = np.array([[5.0, 7.0], [5.5, 6.0], [4.0, 8.0], [3.0, 9.0]])


def test_later_readings_have_their_own_errors_where_nothing_is_shared():
    problem, later = readings(None, np.zeros((2, 0)))
    found = with_errors(problem, ANSWERS, LATER, later, np.random.default_rng(2))
    normal = np.random.default_rng(2).standard_normal((4, 2))
    np.testing.assert_allclose(found, LATER + [0.25, 0.35] * normal)


ROWS = np.array([[1.0, 0.0, 0.3], [0.6, 0.5, -0.2]])


def test_later_readings_share_errors_with_each_other_alone():
    problem, later = readings(None, ROWS)
    found = with_errors(problem, ANSWERS, LATER, later, np.random.default_rng(2))
    rng = np.random.default_rng(2)
    expected = LATER + [0.25, 0.35] * rng.standard_normal((4, 2))
    np.testing.assert_allclose(found, expected + rng.standard_normal((4, 3)) @ ROWS.T)


def test_later_readings_are_moved_by_what_the_used_ones_tell_of_shared_errors():
    """Matheron's rule, with dense matrices."""
    B = np.array([[1.0, 0.0, 0.2], [1.0, 0.5, 0.0], [0.0, 0.5, 0.4]])
    problem, later = readings(B, ROWS)
    found = with_errors(problem, ANSWERS, LATER, later, np.random.default_rng(2))
    rng = np.random.default_rng(2)
    expected = LATER + [0.25, 0.35] * rng.standard_normal((4, 2))
    z = rng.standard_normal((4, 3))
    errors = z @ B.T + problem.sd * rng.standard_normal((4, 3))
    sigma = np.diag(problem.sd**2) + B @ B.T
    gap = problem.measured - ANSWERS - errors
    expected += z @ ROWS.T + gap @ np.linalg.inv(sigma) @ B @ ROWS.T
    np.testing.assert_allclose(found, expected)


@pytest.mark.parametrize(("m", "walkers"), [(2, 8), (4, 10)])
def test_an_ensemble_is_four_of_walkers_that_know_nothing_of_each_other(m, walkers):
    """Twice as many as one more than the parameters, at least 8; 30 steps, of which half count."""

    class Normals:
        evaluations = 0

        def __len__(self):
            return m

        def logarithms(self, u):
            self.evaluations += len(u)
            return -0.5 * np.sum(u**2, axis=1) - u[:, 0]

    density = Normals()
    one = Mixture(
        np.ones(1), np.zeros((1, m)), np.eye(m)[None], np.inf, np.full(m, -40.0), np.full(m, 40.0)
    )
    begin = none_yet(one).more(density, np.random.default_rng(0), 400)
    density.evaluations = 0
    # nearly in a plane, from which emcee by itself would not begin
    begin.x[:, 0] = begin.x[:, 1] + 1e-9 * begin.x[:, 0]
    told = []
    step = 4 * walkers
    # the walkers are asked where they begin, then once each step
    wish = Wish(100, 50.0, 31 * step)
    found = chains.ensemble(density, begin, np.random.default_rng(1), wish, told.append)
    assert density.evaluations == 31 * step
    assert [one.evaluations for one in told] == [(1 + 10 * k) * step for k in (1, 2, 3)]
    assert found.x.shape == (4 * walkers, 15, m)
    np.testing.assert_allclose(
        found.logarithms, -0.5 * np.sum(found.x**2, axis=2) - found.x[..., 0]
    )
    moved = np.any(np.diff(found.x, axis=1) != 0.0, axis=2)
    assert found.acceptance == pytest.approx(moved.mean(), abs=0.15)
    assert found.sampler == told[0].sampler == "ensemble"
    again = chains.ensemble(density, begin, np.random.default_rng(2), wish, lambda progress: None)
    assert again is None  # nothing is left of the budget
