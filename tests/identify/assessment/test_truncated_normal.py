"""The truncated normal against closed forms, quadrature on a grid, and scipy."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.stats import multivariate_normal, norm, truncnorm

from geoident.identify.assessment.truncated_normal import log_probability_within, truncated_normal

MEAN = np.array([0.3, -0.4, 0.1, 0.2])
FACTOR = np.array([[1.0, 0.2, -0.4], [0.3, 0.8, 0.1], [-0.2, 0.5, 0.6], [0.7, -0.1, 0.9]])
C = FACTOR @ FACTOR.T
SD = np.sqrt(np.diag(C))
FAR = np.full(4, np.inf)


def shortest(ppf):
    """Ends of the shortest 95 % interval."""
    tails = np.linspace(0.0, 0.05, 2001)
    k = np.argmin(ppf(tails + 0.95) - ppf(tails))
    return ppf(tails[k]), ppf(tails[k] + 0.95)


def on_a_grid(mean, covariance, lower, upper, points=450):
    """Two truncated normals by brute force: places (points, points, 2), and density there."""
    sd = np.sqrt(np.diag(covariance))
    first, last = np.maximum(lower, mean - 8.0 * sd), np.minimum(upper, mean + 8.0 * sd)
    for count in (90, 90, points):  # where the density is
        middles = (np.arange(count) + 0.5) / count
        axes = [a + (b - a) * middles for a, b in zip(first, last, strict=True)]
        x = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1)
        d = x - mean
        density = np.exp(-0.5 * np.einsum("...i,ij,...j", d, np.linalg.inv(covariance), d))
        dense = x[density > 1e-7 * density.max()]
        cell = (last - first) / (2.0 * count)
        first, last = dense.min(axis=0) - cell, dense.max(axis=0) + cell
    return x, density


def along(x, density, row):
    """Of a linear function on a grid: probability below, its inverse, the root mean square."""
    density = density.ravel()
    z = (x @ row).ravel()
    order = np.argsort(z)
    F = (np.cumsum(density[order]) - 0.5 * density[order]) / density.sum()
    root = np.sqrt(density @ z**2 / density.sum())
    return lambda t: np.interp(t, z[order], F), lambda p: np.interp(p, F, z[order]), root


@pytest.mark.parametrize(
    ("mean", "lower", "upper"),
    [(0.0, 0.0, np.inf), (-3.0, 0.0, np.inf), (-50.0, 0.0, 5.0), (40.0, -np.inf, 0.0), (1, 0, 9)],
)
def test_one_parameter_has_the_interval_of_the_truncated_normal(mean, lower, upper):
    law = truncnorm(lower - mean, upper - mean, loc=mean)
    given = (np.array(each, dtype=float) for each in ([mean], [[1]], [lower], [upper]))
    found = truncated_normal(*given).summary(
        np.eye(1), limits=(np.array([lower]), np.array([upper]))
    )
    low, high = shortest(law.ppf)
    ends = [found.lower95[0], found.upper95[0]]
    np.testing.assert_allclose(ends, [low, high], atol=0.01 * (high - low))
    np.testing.assert_allclose(found.rms[0], np.hypot(law.std(), law.mean()), rtol=2e-3)


@pytest.mark.parametrize("correlation", [0.0, 0.7, -0.9, 0.99])
@pytest.mark.parametrize(
    ("mean", "lower", "upper"),
    [
        ((-1.0, 0.0), (0.0, -np.inf), (np.inf, np.inf)),
        ((0.0, 0.0), (-0.5, -0.5), (2.0, 2.0)),
        ((-2.0, -1.0), (0.0, 0.0), (np.inf, np.inf)),
    ],
)
def test_linear_functions_of_two_have_those_of_a_grid(correlation, mean, lower, upper):
    covariance = np.array([[1.0, correlation], [correlation, 1.0]])
    mean, lower, upper = (np.array(each) for each in (mean, lower, upper))
    drawn = truncated_normal(mean, np.linalg.cholesky(covariance), lower, upper)
    grid = on_a_grid(mean, covariance, lower, upper)
    rows = np.array([(0.0, 1.0), (1.0, 1.0), (1.0, -1.0)])
    found = drawn.summary(rows)
    for row, low, high, rms in zip(rows, found.lower95, found.upper95, found.rms, strict=True):
        below, inverse, root = along(*grid, row)
        least, most = shortest(inverse)
        assert below(high) - below(low) == pytest.approx(0.95, abs=0.004), row
        assert high - low == pytest.approx(most - least, rel=0.015), row
        np.testing.assert_allclose(rms, root, rtol=0.01, err_msg=str(row))


@pytest.mark.parametrize(("mean", "sd"), [(0.0, 0.5), (-1.5, 2.0), (0.8, 0.1)])
def test_an_own_error_is_added_to_what_is_truncated(mean, sd):
    """A half-line normal and a normal: its density is that of a skew normal, by quadrature."""
    found = truncated_normal(np.array([mean]), np.eye(1), np.zeros(1), np.full(1, np.inf))
    summary = found.summary(np.ones((1, 1)), np.array([sd]))
    x = np.linspace(-8.0 * sd, 8.0 + 8.0 * sd, 4001)
    left = sd / np.sqrt(1.0 + sd**2)
    density = norm.pdf(x, mean, np.sqrt(1.0 + sd**2)) * norm.cdf(
        ((x - mean) / (1.0 + sd**2) + mean) / left * 1.0
    )
    F = np.cumsum(density) / density.sum()
    low, high = shortest(lambda p: np.interp(p, F, x))
    ends = summary.lower95[0], summary.upper95[0]
    np.testing.assert_allclose(ends, [low, high], atol=0.015 * (high - low))
    assert summary.own_sd[0] == sd
    expected = truncnorm(-mean, np.inf, loc=mean).var()
    assert summary.shift_variance[0] == pytest.approx(expected, rel=5e-3)


@pytest.mark.parametrize("cut", [(2,), (1, 3), (3, 0, 2)], ids=str)
def test_what_is_not_truncated_follows_as_a_normal_given_the_rest(cut):
    """Means C_xR C_RR^-1 of where these are; covariance that they leave."""
    lower, upper = -FAR, FAR.copy()
    lower[list(cut)] = [MEAN[k] - (0.5 + k) * SD[k] * 0.7 for k in cut]
    upper[list(cut)] = [MEAN[k] + (1.5 - 0.2 * k) * SD[k] for k in cut]
    found = truncated_normal(MEAN, FACTOR, lower, upper)
    assert found.weight.sum() == pytest.approx(1.0)
    R = list(cut)
    pull = C[:, R] @ np.linalg.inv(C[np.ix_(R, R)])
    expected = MEAN[:, None] + pull @ (found.shift[R] - MEAN[R, None])
    np.testing.assert_allclose(found.shift, expected, atol=1e-9)
    left = C - pull @ C[R]
    np.testing.assert_allclose(found.factor @ found.factor.T, left, atol=1e-12)
    assert np.all((found.shift[R] >= lower[R, None]) & (found.shift[R] <= upper[R, None]))
    whole = left + (found.shift * found.weight) @ found.shift.T
    np.testing.assert_allclose(found.covariance, whole, rtol=1e-12, atol=1e-12)
    picked = found.pick(np.array([3, 1]))
    np.testing.assert_allclose(picked.covariance, whole[np.ix_([3, 1], [3, 1])])


def test_without_a_bound_near_intervals_are_exactly_normal():
    found = truncated_normal(np.zeros(2), np.eye(2), np.full(2, -5.0), np.full(2, 5.0))
    ends = found.summary(np.array([[1.0, 2.0]]), np.array([2.0]))
    expected = np.sqrt(9.0) * norm.ppf([0.025, 0.975])
    np.testing.assert_allclose([ends.lower95[0], ends.upper95[0]], expected, rtol=1e-12)
    cut = ends = found.summary(np.eye(2), limits=(np.array([-1.0, -9.0]), np.array([9.0, 0.5])))
    np.testing.assert_allclose(cut.lower95, [-1.0, norm.ppf(0.025)])
    np.testing.assert_allclose(cut.upper95, [norm.ppf(0.975), 0.5])


def test_many_bounds_are_met_by_their_probability():
    """Equicorrelated normals by half are all positive with the probability 1 / (n + 1)."""
    for n in (3, 6, 10):
        covariance = 0.5 * (np.eye(n) + np.ones((n, n)))
        none, far = np.zeros(n), np.full(n, np.inf)
        log_p = log_probability_within(none, covariance, none, far)
        assert np.exp(log_p) == pytest.approx(1.0 / (n + 1.0), rel=5e-3)
        found = truncated_normal(none, np.linalg.cholesky(covariance), none, far)
        assert found.shift.min() >= 0.0
        centre = found.shift @ found.weight  # by symmetry all have the same mean
        np.testing.assert_allclose(centre, centre.mean(), rtol=0.01)


@pytest.mark.parametrize("rest", [1e-16, -1e-16, 0.0])
def test_a_parameter_that_another_gives_is_not_divided_by_nothing(rest):
    """The second is 1.5 times the first, up to rounding: both bounds hold."""
    factor = np.array([[2.0, 0.0], [3.0, rest]])
    found = truncated_normal(np.zeros(2), factor, np.array([-4.0, 0.0]), np.array([4.0, 3.0]))
    counts = found.weight > 1e-9
    first = found.shift[0, counts] / 2.0
    assert np.all((first > -1e-6) & (first < 1.0 + 1e-6))
    mean = found.weight @ found.shift[0] / 2.0
    assert mean == pytest.approx(truncnorm(0.0, 1.0).mean(), abs=0.01)


def test_deviations_from_linear_move_each_draw():
    """exp of a half normal in place of itself: quantiles are those of the exponential."""
    found = truncated_normal(np.zeros(1), np.eye(1), np.zeros(1), np.full(1, np.inf))
    x = found.shift[0]
    bent = found.summary(np.ones((1, 1)), deviation=lambda rows: (np.exp(x) - x)[None][rows])
    law = truncnorm(0.0, np.inf)
    low, high = shortest(lambda p: np.exp(law.ppf(p)))
    np.testing.assert_allclose([bent.lower95[0], bent.upper95[0]], [low, high], rtol=0.01)


# Probability between bounds


@pytest.mark.parametrize("n", [2, 3, 5, 8])
def test_the_probability_of_a_box_is_that_of_scipy(n):
    rng = np.random.default_rng(n)
    A = rng.normal(size=(n + 1, n))
    covariance, mean = np.linalg.inv(A.T @ A), rng.normal(size=n)
    sd = np.sqrt(np.diag(covariance))
    lower = mean - rng.uniform(-0.5, 3.0, n) * sd
    upper = lower + rng.uniform(0.5, 4.0, n) * sd
    expected = multivariate_normal(mean, covariance, seed=1).cdf(upper, lower_limit=lower)
    found = np.exp(log_probability_within(mean, covariance, lower, upper))
    assert found == pytest.approx(expected, rel=2e-3)


def test_a_box_far_out_keeps_its_logarithm():
    """Independent numbers 40 standard deviations off: far below what a float can hold."""
    mean, one = np.array([41.0, 0.0]), np.ones(2)
    found = log_probability_within(mean, np.eye(2), -one, one)
    expected = norm.logsf(40.0) + np.log(norm.cdf(1.0) - norm.cdf(-1.0))
    assert found == pytest.approx(expected, abs=1e-4)


@pytest.mark.parametrize(
    ("lower", "upper"),
    [(-0.4, 1.7), (-np.inf, 0.3), (0.6, np.inf), (2.0, 2.5), (-3.0, -2.9), (-9.0, -8.5), (20, 21)],
)
def test_one_number_between_two_bounds_has_its_normal_probability(lower, upper):
    """Also far out on either side, by logarithms of the tail that holds it."""
    mean, sd = 3.0, 0.7
    m, variance, low, high = (
        np.array([one]) for one in (mean, sd**2, mean + sd * lower, mean + sd * upper)
    )
    found = log_probability_within(m, variance[None], low, high)
    far, near = (-upper, -lower) if lower > 0.0 else (lower, upper)
    expected = norm.logcdf(near) + np.log1p(-np.exp(norm.logcdf(far) - norm.logcdf(near)))
    assert found == pytest.approx(expected, rel=1e-9)
