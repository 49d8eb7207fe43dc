"""Choosing gauges: against the posterior of a linear model, and against all sets of few gauges."""

from itertools import combinations

import numpy as np
import pytest
from scipy.stats import multivariate_normal

from geoident.identify.assessment.design import Gauges, Outlook, choose


@pytest.fixture
def rng():
    return np.random.default_rng(7)


def site(rng, *, parameters=4, gauges=8, own=0.3, prior=1.0):
    """A linear model: targets, readings (two a gauge, which share an error), and all of Sigma."""
    J = rng.standard_normal((2 * gauges, parameters))
    target = rng.standard_normal((2, parameters))
    shared = np.kron(np.eye(gauges), np.ones((2, 1))) * 0.2
    left = np.vstack([target, J])
    S = prior**2 * left @ left.T
    S[2:, 2:] += shared @ shared.T
    return S, np.full(2 * gauges, own**2), [np.array([2 * g, 2 * g + 1]) for g in range(gauges)]


def outlook_of(S, own, limit=(np.nan, np.nan)):
    start = np.diag(S)[:2]
    return Outlook(S, own, np.arange(len(own)), start, np.array(limit), start)


def conditional(S, own, rows):
    """Variance of the targets by the formula of the textbook, with the inverse written out."""
    rows = np.asarray(rows, dtype=int) + 2
    within = S[np.ix_(rows, rows)] + np.diag(own[rows - 2])
    across = S[:2, rows]
    return np.diag(S[:2, :2] - across @ np.linalg.inv(within) @ across.T)


def test_blocks_one_after_the_other_leave_what_all_leave_together(rng):
    S, own, groups = site(rng)
    one = outlook_of(S, own)
    for g in (3, 0, 5):
        one = one.given(groups[g])
    every = np.concatenate([groups[g] for g in (3, 0, 5)])
    assert one.variances == pytest.approx(conditional(S, own, every))
    assert outlook_of(S, own).left(every) == pytest.approx(conditional(S, own, every))
    assert one.left(groups[1]) == pytest.approx(conditional(S, own, [*every, *groups[1]]))


def test_however_little_was_known_before_rounding_leaves_the_variance_right(rng):
    S, own, groups = site(rng, prior=1e4)
    every = np.concatenate(groups)
    one = outlook_of(S, own)
    for g in range(8):
        one = one.given(groups[g])
    together = outlook_of(S, own).left(every)
    assert (one.variances > 0.0).all()
    assert one.variances == pytest.approx(together, rel=1e-3)
    assert (together < 20.0).all()


def best_of_all(gauges, budget):
    """The least that any affordable set leaves."""
    n = len(gauges.costs)
    sets = [c for k in range(n + 1) for c in combinations(range(n), k)
            if gauges.costs[list(c)].sum() <= budget]  # fmt: skip
    return min(gauges.part(c) for c in sets)


@pytest.mark.parametrize("seed", range(5))
@pytest.mark.parametrize("equal", [True, False])
def test_of_few_gauges_it_finds_nearly_the_best_set(seed, equal):
    rng = np.random.default_rng(seed)
    outlooks = []
    for _ in range(2):  # two draws of the parameters
        S, own, groups = site(rng)
        outlooks.append(outlook_of(S, own))
    costs = np.ones(8) if equal else rng.uniform(0.5, 3.0, 8)
    gauges = Gauges(tuple(outlooks), tuple(groups), costs)
    chosen = choose(gauges, 3.0)
    assert costs[list(chosen)].sum() <= 3.0 + 1e-9
    best = best_of_all(gauges, 3.0)
    assert best <= gauges.part(chosen) <= best * 1.1 + 1e-12


def test_nearly_always_it_is_the_best_set():
    hits = 0
    for seed in range(15):
        rng = np.random.default_rng(100 + seed)
        S, own, groups = site(rng, gauges=7)
        gauges = Gauges((outlook_of(S, own),), tuple(groups), np.ones(7))
        best = best_of_all(gauges, 3.0)
        hits += gauges.part(choose(gauges, 3.0)) <= best * (1.0 + 1e-9)
    assert hits >= 14


@pytest.mark.slow  # counts many draws
def test_what_a_limit_leaves_unsettled_is_the_mean_over_readings(rng):
    """E[p (1 - p)] by drawing what would be read, and p from what is then known."""
    S, own, groups = site(rng)
    a = 0.7
    one = outlook_of(S, own, (a, np.nan))
    v0, v = S[0, 0], one.left(groups[2])[0]
    means = rng.standard_normal(400_000) * np.sqrt(v0 - v)
    p = 1.0 - multivariate_normal(0.0, 1.0).cdf((a * np.sqrt(v0) - means) / np.sqrt(v))
    p0 = multivariate_normal(0.0, 1.0).cdf(-a)
    expected = np.mean(p * (1.0 - p)) / (p0 * (1.0 - p0))
    rest = np.delete(np.delete(S, 1, 0), 1, 1)
    single = Outlook(rest, own, one.numbers, one.start[:1], one.limit[:1], one.start[:1])
    assert single.part(single.left(groups[2])) == pytest.approx(expected, rel=5e-3)
    assert single.part(single.variances) == pytest.approx(1.0)
    # what some readings leave of what others have left
    after = single.given(groups[2]).begun()
    both = single.part(single.left(np.concatenate(groups[2:4])))
    assert after.part(after.left(groups[3])) == pytest.approx(both / expected, rel=5e-3)


def test_a_gauge_that_tells_nothing_is_not_bought(rng):
    S, own, groups = site(rng, gauges=4)
    for g in (1, 2, 3):
        S[:2, groups[g] + 2] = S[groups[g] + 2, :2] = 0.0
    S[np.ix_(groups[0] + 2, np.r_[groups[1], groups[2], groups[3]] + 2)] = 0.0
    S[np.ix_(np.r_[groups[1], groups[2], groups[3]] + 2, groups[0] + 2)] = 0.0
    gauges = Gauges((outlook_of(S, own),), tuple(groups), np.ones(4))
    assert choose(gauges, 10.0) == (0,)
