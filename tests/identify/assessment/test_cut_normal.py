"""The cut normal piece by piece: closed forms of its parts, and the mixtures that it makes."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.stats import norm, truncnorm

from geoident.identify.assessment import posterior
from geoident.identify.assessment.posterior import NormalMixture, Posterior, cut_normal

MEAN = np.array([0.3, -0.4, 0.1, 0.2])
FACTOR = np.array([[1.0, 0.2, -0.4], [0.3, 0.8, 0.1], [-0.2, 0.5, 0.6], [0.7, -0.1, 0.9]])
C = FACTOR @ FACTOR.T
SD = np.sqrt(np.diag(C))
FAR = np.full(4, np.inf)


@pytest.mark.parametrize("cut", [(2,), (1, 3), (3, 0, 2)], ids=str)
def test_what_is_not_cut_follows_as_a_normal_given_the_rest(cut):
    """Means C_xR C_RR^-1 of where these are; covariance that they leave."""
    lower, upper = -FAR, FAR.copy()
    lower[list(cut)] = [MEAN[k] - (0.5 + k) * SD[k] * 0.7 for k in cut]
    upper[list(cut)] = [MEAN[k] + (1.5 - 0.2 * k) * SD[k] for k in cut]
    found = cut_normal(MEAN, FACTOR, lower, upper)
    assert len(found.weight) == (512 if len(cut) == 1 else 2048)
    assert found.weight.sum() == pytest.approx(1.0)
    R = list(cut)
    pull = C[:, R] @ np.linalg.inv(C[np.ix_(R, R)])
    expected = MEAN[:, None] + pull @ (found.shift[R] - MEAN[R, None])
    np.testing.assert_allclose(found.shift, expected, atol=1e-9)
    left = C - pull @ C[R]
    np.testing.assert_allclose(found.factor @ found.factor.T, left, atol=1e-12)
    inside = (found.shift[R] >= lower[R, None]) & (found.shift[R] <= upper[R, None])
    assert inside.all()
    whole = left + (found.shift * found.weight) @ found.shift.T
    np.testing.assert_allclose(found.covariance, whole, rtol=1e-12, atol=1e-12)
    picked = found.pick(np.array([3, 1]))
    np.testing.assert_array_equal(picked.shift, found.shift[[3, 1]])
    np.testing.assert_allclose(picked.covariance, whole[np.ix_([3, 1], [3, 1])])
    rows, sd = np.array([[0.5, -1.0, 2.0, 0.3]]), np.array([0.4])
    mixture = found.of(rows, sd)
    np.testing.assert_allclose(mixture.mean, rows @ found.shift)
    np.testing.assert_allclose(mixture.sd, np.sqrt(rows @ left @ rows.T + 0.16))


@pytest.mark.parametrize(("off", "cut"), [(2.99, True), (3.01, False)])
def test_bounds_farther_than_three_standard_deviations_are_not_reached(off, cut):
    for lower, upper in ((MEAN - off * SD, FAR), (-FAR, MEAN + off * SD)):
        for k in range(4):
            low, high = np.where(np.arange(4) == k, [lower, upper], [-FAR, FAR])
            found = cut_normal(MEAN, FACTOR, low, high)
            assert (len(found.weight) > 1) == cut
            if not cut:
                np.testing.assert_array_equal(found.shift, MEAN[:, None])
                np.testing.assert_array_equal(found.factor, FACTOR)
    always = cut_normal(MEAN, FACTOR, -9.0 * SD, 9.0 * SD, always=2)
    assert len(always.weight) == 2048  # of 512 hardly 200 would count
    np.testing.assert_allclose(always.factor[2], 0.0, atol=1e-12)


def test_what_is_given_is_not_cut():
    factor = FACTOR.copy()
    factor[1] = 0.0
    lower = np.where(np.arange(4) == 1, MEAN, -FAR)
    found = cut_normal(MEAN, factor, lower, np.where(np.arange(4) == 1, MEAN, FAR))
    assert found.weight.tolist() == [1.0]


def test_what_is_cut_most_is_so_by_its_own_standard_deviation():
    """Of one mode only one bound can count: the second variable's, 1.5 of its sd away, not 2."""
    mean, factor = np.array([4.0, -3.0]), np.array([[0.1], [10.0]])
    room = np.array([0.2, 15.0])
    found = cut_normal(mean, factor, np.full(2, -np.inf), mean + room)
    assert found.shift[1].max() == pytest.approx(12.0, abs=0.2)
    assert found.shift[0].max() == pytest.approx(4.15, abs=0.002)
    found = cut_normal(mean, factor, mean - room, np.full(2, np.inf))
    assert found.shift[0].min() == pytest.approx(3.85, abs=0.002)


def test_what_is_cut_most_comes_first_and_what_always_counts_before_it(monkeypatch):
    """By the rows of the triangle: their lengths are the standard deviations."""
    rows = []
    lattice = posterior._lattice

    def noted(L, lower, upper, points):
        rows.append((L @ L.T, lower, upper))
        return lattice(L, lower, upper, points)

    monkeypatch.setattr(posterior, "_lattice", noted)
    lower = np.array([MEAN[0] - 2.0 * SD[0], -np.inf, MEAN[2] + 0.5 * SD[2], MEAN[3] - SD[3]])
    upper = np.array([np.inf, np.inf, np.inf, MEAN[3] + 1.5 * SD[3]])
    for always, order in ((None, [2, 3, 0]), (0, [0, 2, 3]), (1, [1, 2, 3])):
        cut_normal(MEAN, FACTOR, lower, upper, always=always)
        square, low, high = rows[-1]
        np.testing.assert_allclose(square, C[np.ix_(order, order)], rtol=1e-9)
        np.testing.assert_allclose(low, (lower - MEAN)[order])
        np.testing.assert_allclose(high, (upper - MEAN)[order])


def test_points_of_several_are_those_of_a_lattice_one_given_the_other():
    """The first in slices, each other at parts of the multiples of a root, by scipy's quantiles."""
    L = np.array([[1.3, 0.0, 0.0], [0.4, -0.9, 0.0], [-0.6, 0.5, 0.7]])
    lower, upper = np.array([-1.0, -0.5, 0.2]), np.array([2.0, 0.9, 4.0])
    y, weight = posterior._lattice(L, lower, upper, 64)
    k = np.arange(64) + 0.5
    first, logs = posterior._midpoints(-1.0 / 1.3, 2.0 / 1.3, k / 64)
    np.testing.assert_allclose(y[0], first)
    for j, prime in ((1, 2), (2, 3)):
        before = L[j, :j] @ y[:j]
        ends = np.sort([(lower[j] - before) / L[j, j], (upper[j] - before) / L[j, j]], axis=0)
        law = truncnorm(*ends)
        np.testing.assert_allclose(y[j], law.ppf((k * np.sqrt(prime)) % 1.0), rtol=1e-6)
        logs = logs + np.log(norm.cdf(ends[1]) - norm.cdf(ends[0]))
    expected = np.exp(logs - logs.max())
    np.testing.assert_allclose(weight, expected / expected.sum(), rtol=1e-9)
    inside = L @ y
    assert np.all((inside >= lower[:, None] - 1e-9) & (inside <= upper[:, None] + 1e-9))


def test_a_variable_that_the_others_give_is_not_divided_by_nothing():
    """The second is the first, up to rounding: both bounds hold, on either sign of the rest."""
    for rest in (1e-16, -1e-16, 0.0):
        L = np.array([[2.0, 0.0], [3.0, rest]])
        y, weight = posterior._lattice(L, np.array([-4.0, 0.0]), np.array([4.0, 3.0]), 256)
        assert np.isfinite(y).all()
        weighty = weight > 1e-9
        assert np.all((y[0, weighty] > -1e-9) & (y[0, weighty] < 1.0 + 1e-9))
        law = truncnorm(0.0, 1.0)
        mean = weight @ y[0]
        assert mean == pytest.approx(law.mean(), abs=0.02)


@pytest.mark.parametrize(("low", "high"), [(-1.0, 2.0), (0.3, 0.9), (-4.0, -2.5), (5.0, 9.0)])
def test_normal_numbers_between_two_are_those_of_scipy(low, high):
    u = np.array([0.05, 0.4, 0.93])
    z, log_p = posterior._between(np.full(3, low), np.full(3, high), u)
    np.testing.assert_allclose(z, truncnorm(low, high).ppf(u), rtol=1e-6)
    near, far = (low, high) if low > 0.0 else (-high, -low)
    expected = norm.logsf(near) + np.log1p(-np.exp(norm.logsf(far) - norm.logsf(near)))
    np.testing.assert_allclose(log_p, expected, rtol=1e-9)


def test_more_points_are_taken_where_few_have_any_weight(monkeypatch):
    """Four times as many until 200 count, or 65536 are there."""
    asked, counted = [], [0]

    def lattice(L, lower, upper, points):
        asked.append(points)
        weight = np.zeros(points)
        some = counted[0] or points // 50
        weight[:some] = 1.0 / some
        return np.zeros((len(L), points)), weight

    monkeypatch.setattr(posterior, "_lattice", lattice)
    lower = np.array([-1.0, -1.0, -np.inf, -np.inf])
    for some, expected in (
        (201, [2048]),
        (199, [2048, 8192, 32768, 131072]),
        (0, [2048, 8192, 32768]),
    ):
        counted[0] = some
        asked.clear()
        cut_normal(MEAN, FACTOR, lower, FAR)
        assert asked == expected


# Mixtures


def test_probabilities_and_moments_of_a_mixture():
    mean, sd = np.array([[0.0, 2.0, -1.0], [3.0, 3.5, 8.0]]), np.array([[0.5], [2.0]])
    weight = np.array([0.2, 0.5, 0.3])
    found = NormalMixture(mean, sd, weight)
    np.testing.assert_allclose(found.centre, mean @ weight)
    np.testing.assert_allclose(found.rms, np.sqrt((mean**2 + sd**2) @ weight))
    t = np.array([[0.1, -2.0], [4.0, 9.0]])
    expected = [[weight @ norm.cdf(x, m, s[0]) for x in row]
                for row, m, s in zip(t, mean, sd, strict=True)]  # fmt: skip
    np.testing.assert_allclose(found.below(t), expected)
    spread = np.sqrt((mean - (mean @ weight)[:, None]) ** 2 @ weight)
    np.testing.assert_allclose(found._grain()[:, 0], 0.02 * spread)
    other = NormalMixture(mean[:, :2] + 1.0, np.array([[0.1, 0.2], [0.3, 0.4]]),
                          np.array([0.6, 0.4]))  # fmt: skip
    both = NormalMixture.joined([(0.7, found), (0.3, other)])
    np.testing.assert_allclose(both.weight, [0.14, 0.35, 0.21, 0.18, 0.12])
    np.testing.assert_allclose(both.mean, np.hstack([mean, mean[:, :2] + 1.0]))
    np.testing.assert_allclose(both.sd, np.hstack([np.repeat(sd, 3, 1), other.sd]))
    grain = np.hstack([np.repeat(found._grain(), 3, 1), np.repeat(other._grain(), 2, 1)])
    np.testing.assert_allclose(both._grain(), grain)
    np.testing.assert_allclose(both._of(np.array([1])).grain, grain[[1]])
    np.testing.assert_allclose(both.rms**2, 0.7 * found.rms**2 + 0.3 * other.rms**2)


def skew(n=300):
    """Two quantities: an exponential density in points, and that of a sum with a normal."""
    x = (np.arange(n) + 0.5) / n * 7.0
    weight = np.exp(-x)
    mean = np.stack([x, 2.0 - 0.5 * x])
    return NormalMixture(mean, np.array([[0.02], [0.4]]), weight / weight.sum())


def test_the_interval_is_the_shortest_of_those_that_leave_thousandths():
    """Ends by scipy's search of the smeared mixture; the tail below is a multiple of 0.001."""
    mixture = skew()
    low, high = mixture.interval()
    for q in range(2):
        sd = np.hypot(mixture.sd[q, 0], mixture._grain()[q, 0])
        part = NormalMixture(mixture.mean[[q]], np.array([[sd]]), mixture.weight)
        below = part.below(np.array([[low[q], high[q]]]))[0]
        assert below[1] - below[0] == pytest.approx(0.95, abs=1e-9)
        tail = below[0] * 1000.0
        assert tail == pytest.approx(round(tail), abs=1e-5)
        fine = np.linspace(low[q] - 1.0, high[q] + 4.0, 4_000)
        F = part.below(fine[None])[0]
        tails = np.arange(51) / 1000.0
        ends = np.interp(tails, F, fine), np.interp(tails + 0.95, F, fine)
        width = (ends[1] - ends[0])[1:-1]  # without those that end with the tails of normals
        assert high[q] - low[q] <= width.min() * 1.005


@pytest.mark.parametrize(("lump", "tail"), [(0.0018, 0.002), (0.0026, 0.003)])
@pytest.mark.parametrize("off", [0.04, 0.06])
def test_an_interval_ends_with_what_is_possible_where_hardly_anything_is_between(lump, tail, off):
    """No more than a four-hundredth beyond, and no farther than a twentieth of the interval."""
    base = skew()
    x, weight = base.mean[0], base.weight
    mean = np.append(x, -0.5)[None]
    both = np.append((1.0 - lump) * weight, lump)
    mixture = NormalMixture(mean, np.full((1, 1), 1e-3), both, np.full((1, 1), 1e-3))
    (low,), (high,) = mixture.interval()
    assert mixture.below(np.array([[low]]))[0, 0] == pytest.approx(tail, abs=4e-4)
    lower = low - off * (high - low)
    ends = mixture.interval(np.array([lower]))
    assert ends[0][0] == (lower if (tail, off) == (0.002, 0.04) else low)
    assert ends[1][0] == high
    turned = NormalMixture(-mean, mixture.sd, both, mixture.grain)
    down, up = turned.interval(np.array([-np.inf]), np.array([-lower]))
    assert up[0] == pytest.approx(-lower if (tail, off) == (0.002, 0.04) else -low, abs=1e-6)
    assert down[0] == pytest.approx(-high, abs=1e-3)


def test_an_interval_is_cut_at_what_is_possible():
    one = NormalMixture(np.zeros((2, 1)), np.array([[1.0], [2.0]]), np.ones(1))
    low, high = one.interval(np.array([-1.0, -9.0]), np.array([9.0, 3.0]))
    half = norm.ppf(0.975)
    np.testing.assert_allclose(low, [-1.0, -2.0 * half])
    np.testing.assert_allclose(high, [half, 3.0])


def test_many_quantities_are_judged_some_at_a_time(monkeypatch):
    mixture = NormalMixture(
        np.repeat(skew(40).mean, 4, axis=0) + np.arange(8)[:, None], np.full((8, 1), 0.3),
        skew(40).weight,
    )  # fmt: skip
    whole = mixture.interval()
    monkeypatch.setattr(posterior, "_TOGETHER", 65 * 40 * 3)
    np.testing.assert_allclose(mixture.interval(), whole, rtol=1e-13)


def test_a_mixture_of_one_normal_or_of_the_same_is_a_normal():
    mean = np.array([[1.0, 1.0, 1.0], [2.0, 2.0, 2.0]])
    found = NormalMixture(mean, np.array([[0.5], [3.0]]), np.array([0.2, 0.3, 0.5]))
    half = norm.ppf(0.975) * np.array([0.5, 3.0])
    np.testing.assert_allclose(
        found.interval(), np.array([1.0, 2.0]) + np.outer([-1.0, 1.0], half), rtol=1e-12
    )
    apart = NormalMixture(mean + np.outer([1.0, 0.0], [0.0, 0.0, 0.4]), found.sd, found.weight)
    low, high = apart.interval()
    assert low[1] == pytest.approx(2.0 - half[1], rel=1e-12)
    assert high[0] - low[0] > 2.0 * half[0] * 1.02


def test_parts_without_weight_do_not_count():
    mean = np.array([[0.0, 0.5, 1e9]])
    weight = np.array([0.5, 0.5 - 1e-13, 1e-13])
    found = NormalMixture(mean, np.ones((1, 1)), weight, np.zeros((1, 3))).interval()
    known = NormalMixture(mean[:, :2], np.ones((1, 1)), np.full(2, 0.5), np.zeros((1, 2)))
    np.testing.assert_allclose(found, known.interval(), rtol=1e-6)


def test_a_posterior_is_a_mixture_of_normals_of_one_covariance():
    shift, weight = np.array([[0.0, 1.0], [2.0, -1.0]]), np.array([0.25, 0.75])
    one = Posterior(shift, weight, np.array([[0.5], [0.1]]))
    expected = np.array([[0.25, 0.05], [0.05, 0.01]])
    expected = expected + 0.25 * np.outer([0, 2], [0, 2]) + 0.75 * np.outer([1, -1], [1, -1])
    np.testing.assert_allclose(one.covariance, expected)


SIZES = np.array([1.0, 1e-3, 1e-7])


@pytest.mark.parametrize("p", [1e-9, 0.025, 0.5, 0.64, 0.975])
def test_a_quantile_is_where_the_probability_is_reached(p):
    """Of normals alike, far apart, and of sizes that differ by orders of magnitude."""
    mean = np.array([[0.3, 0.2, 0.1], [-5.0, 0.0, 7.0], [2.0, -1.0, 0.4], [1e9, 1e9, -1e9]])
    sd = np.array([[1.0, 1.0, 1.0], [0.1, 0.2, 0.1], SIZES, 1e9 * SIZES])
    weight = np.array([0.2, 0.5, 0.3])
    reach = np.abs(mean).max(axis=1) + 10.0 * sd.max(axis=1)
    found = NormalMixture(mean, sd, weight).quantile(np.full(4, p), -reach, reach)
    for one, m, s in zip(found, mean, sd, strict=True):
        ends = one + 1e-11 * s.max() * np.array([-1.0, 1.0])[:, None]
        below, above = norm.cdf(ends, m, s) @ weight
        assert below <= p * (1.0 + 1e-9)
        assert above >= p * (1.0 - 1e-9)


def test_a_quantile_is_sought_beyond_a_normal_that_is_next_to_nothing():
    """Every step beside it is small, though not since the quantile were near."""
    mixture = NormalMixture(np.zeros((2, 2)), np.array([[1e-13, 1.0]]), np.array([0.9, 0.1]))
    found = mixture.quantile(np.array([0.025, 0.975]), np.full(2, -10.0), np.full(2, 10.0))
    np.testing.assert_allclose(found, norm.ppf([0.25, 0.75]), rtol=1e-11)


def test_a_quantile_beyond_the_ends_is_the_end():
    one = NormalMixture(np.zeros((3, 1)), np.ones((3, 1)), np.ones(1))
    found = one.quantile(np.array([0.0, 0.5, 1.0]), np.full(3, 1.0), np.full(3, 2.0))
    assert found.tolist() == [1.0, 1.0, 2.0]
    assert one.quantile(np.full(3, 0.5), np.full(3, -3.0), np.full(3, -2.0)).tolist() == [-2.0] * 3
