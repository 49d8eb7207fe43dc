"""A bound limits, it does not inform: intervals and bands are those of the posterior cut at it.

Judges: closed forms of the cut normal, and the posterior by quadrature on a grid.
"""

from __future__ import annotations

import numpy as np
import pytest
from scipy.optimize import brentq
from scipy.stats import norm, truncnorm

from geoident.identify.assessment.posterior import NormalMixture, _midpoints, cut_normal
from geoident.identify.assessment.uncertainty import assess, predict_band
from geoident.identify.problem.problem import Problem
from geoident.model.parameter import Parameter


def problem_of(jacobian, measured=None):
    n = jacobian.shape[1]
    parameters = tuple(Parameter(f"p{k}", 0.5, 0.0, 1.0) for k in range(n))
    readings = np.zeros(len(jacobian)) if measured is None else measured
    return Problem(None, readings, np.ones(len(jacobian)), parameters)


def shortest(ppf):
    """Ends of the shortest 95 % interval."""
    tails = np.linspace(0.0, 0.05, 2001)
    k = np.argmin(ppf(tails + 0.95) - ppf(tails))
    return ppf(tails[k]), ppf(tails[k] + 0.95)


def on_a_grid(mean, covariance, lower, upper, points=450):
    """Two cut normal variables by brute force: places (points, points, 2), and density there."""
    sd = np.sqrt(np.diag(covariance))
    first, last = np.maximum(lower, mean - 8.0 * sd), np.minimum(upper, mean + 8.0 * sd)
    for count in (90, 90, points):  # where the density is
        axes = [np.linspace(a, b, count) for a, b in zip(first, last, strict=True)]
        x = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1)
        d = x - mean
        density = np.exp(-0.5 * np.einsum("...i,ij,...j", d, np.linalg.inv(covariance), d))
        there = x[density > 1e-7 * density.max()]
        first, last = there.min(axis=0), there.max(axis=0)
    return x, density


def along(x, density, row):
    """Distribution of a linear function of what is on a grid.

    Probability of being below, its inverse, and the root mean square.
    """
    density = density.ravel()
    z = (x @ row).ravel()
    order = np.argsort(z)
    F = np.cumsum(density[order]) / density.sum()
    root = np.sqrt(density @ z**2 / density.sum())
    return lambda t: np.interp(t, z[order], F), lambda p: np.interp(p, F, z[order]), root


@pytest.mark.parametrize(
    ("mean", "lower", "upper"),
    [(0.0, 0.0, np.inf), (-3.0, 0.0, np.inf), (-50.0, 0.0, 5.0), (40.0, -np.inf, 0.0), (1, 0, 9)],
)
def test_one_parameter_has_the_interval_of_the_cut_normal(mean, lower, upper):
    law = truncnorm(lower - mean, upper - mean, loc=mean)
    found = cut_normal(*(np.array(each, dtype=float) for each in ([mean], [[1]], [lower], [upper])))
    mixture = found.of(np.eye(1), np.zeros(1))
    low, high = mixture.interval(np.array([lower]), np.array([upper]))
    width = law.std()
    np.testing.assert_allclose([low[0], high[0]], shortest(law.ppf), atol=0.03 * width)
    np.testing.assert_allclose(mixture.rms[0], np.hypot(law.std(), law.mean()), rtol=5e-3)


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
    found = cut_normal(mean, np.linalg.cholesky(covariance), lower, upper)
    grid = on_a_grid(mean, covariance, lower, upper)
    for row in np.array([(0.0, 1.0), (1.0, 1.0), (1.0, -1.0)]):
        mixture = found.of(row[None], np.zeros(1))
        below, inverse, root = along(*grid, row)
        least, most = shortest(inverse)
        low, high = (end[0] for end in mixture.interval())
        assert below(high) - below(low) == pytest.approx(0.95, abs=0.01), row
        assert high - low == pytest.approx(most - least, rel=0.03), row
        np.testing.assert_allclose(mixture.rms[0], root, rtol=0.03, err_msg=str(row))


def test_many_bounds_are_met_by_their_probability():
    """Equicorrelated normals by half are all positive with the probability 1 / (n + 1)."""
    for n in (3, 6, 10):
        covariance = 0.5 * (np.eye(n) + np.ones((n, n)))
        found = cut_normal(
            np.zeros(n), np.linalg.cholesky(covariance), np.zeros(n), np.full(n, np.inf)
        )
        assert found.shift.min() >= 0.0
        # by symmetry all have the same margin: the mean of the whole by that of each
        each = found.of(np.eye(n), np.zeros(n))
        np.testing.assert_allclose(each.centre, each.centre.mean(), rtol=0.04)


def test_many_parameters_on_their_bounds_do_not_follow_each_other():
    """Independent half normals, of which the mean and the variance are known."""
    n = 40
    found = cut_normal(np.zeros(n), np.eye(n), np.zeros(n), np.full(n, np.inf))
    mean = found.shift @ found.weight
    np.testing.assert_allclose(mean, np.sqrt(2.0 / np.pi), atol=0.02)
    covariance = found.covariance - np.outer(mean, mean)
    np.testing.assert_allclose(covariance / (1.0 - 2.0 / np.pi), np.eye(n), atol=0.3)


def test_where_no_bound_is_near_nothing_is_cut():
    found = cut_normal(np.zeros(2), np.eye(2), np.full(2, -5.0), np.full(2, 5.0))
    assert found.weight.tolist() == [1.0]
    low, high = found.of(np.array([[1.0, 2.0]]), np.array([2.0])).interval()
    np.testing.assert_allclose([low, high], np.sqrt(9.0) * norm.ppf([[0.025], [0.975]]), rtol=1e-12)


def test_mixtures_join():
    one, other = (NormalMixture(np.array([[m]]), np.ones((1, 1)), np.ones(1)) for m in (0.0, 8.0))
    both = NormalMixture.joined([(0.5, one), (0.5, other)])
    assert both.centre == pytest.approx([4.0])
    assert both.rms == pytest.approx([np.sqrt(1.0 + 32.0)])
    assert both.below(np.array([[4.0]])) == pytest.approx(0.5)


def test_on_a_bound_with_a_gradient_the_density_falls_from_it():
    """A reading says -0.1 +- 0.1 of what is at least 0."""
    jacobian = np.array([[10.0]])
    problem = problem_of(jacobian, np.array([-1.0]))
    found = assess(problem, np.zeros(1), jacobian, np.zeros(1))
    law = truncnorm(1.0, np.inf, loc=-0.1, scale=0.1)
    np.testing.assert_allclose(
        [found.lower95[0], found.upper95[0]], [0.0, law.ppf(0.95)], rtol=0.01
    )
    assert found.at_bound.tolist() == [True]
    assert found.beyond_bounds.tolist() == [True]


def test_the_interval_of_another_parameter_follows_the_one_on_its_bound():
    """Their difference is known to 0.01, the first to 0.1: both are open to the same side."""
    jacobian = np.array([[10.0, 0.0], [100.0, -100.0]])
    values = np.array([0.0, 0.3])
    found = assess(problem_of(jacobian), values, jacobian)
    half = norm.ppf(0.975) * 0.1
    np.testing.assert_allclose([found.lower95[0], found.upper95[0]], [0.0, half], rtol=0.01)
    assert found.lower95[1] == pytest.approx(0.29, abs=0.01)
    assert found.upper95[1] == pytest.approx(0.3 + half, abs=0.01)
    band = predict_band(found, np.array([[0.0, 1.0]]), np.array([0.02]))
    assert band.upper95[0] == pytest.approx(half, abs=0.02)
    assert -0.05 < band.lower95[0] < 0.0
    assert band.upper95[0] > 3.0 * -band.lower95[0]


def test_a_prediction_that_rests_on_what_a_bound_hides_is_not_determined():
    """The sum is known, nothing else; the first lies on its bound."""
    jacobian = np.array([[100.0, 100.0]])
    found = assess(problem_of(jacobian), np.array([0.0, 0.5]), jacobian)
    band = predict_band(found, np.array([[0.0, 1.0], [1.0, 1.0]]), np.full(2, 0.01))
    assert np.isinf(band.sd).tolist() == [True, False]
    assert band.lower95[0] == -np.inf


def test_a_direction_does_not_fall_between_two_spectra():
    jacobian = np.linalg.cholesky(np.array([[10.0, 1.0], [1.0, 10.0]])).T
    known = assess(problem_of(jacobian), np.array([0.0, 0.5]), jacobian)
    band = predict_band(known, np.array([[0.0, 1.0]]), np.array([0.01]))
    # within its bounds the second is not known at all, so hardly less than evenly spread
    assert band.sd[0] >= 0.8 / np.sqrt(12.0)


@pytest.mark.parametrize("ratio", [10.0, 1e3, 1e6, 1e9])
@pytest.mark.parametrize(("weight", "apart"), [(0.97, 0.0), (0.5, 0.0), (0.2, 0.0), (0.96, 30.0)])
def test_normals_of_very_different_widths_have_their_shortest_interval(ratio, weight, apart):
    mean, sd = np.array([[0.0, apart * ratio]]), np.array([[1.0, ratio]])
    mixture = NormalMixture(mean, sd, np.array([weight, 1.0 - weight]), np.zeros((1, 2)))
    (low,), (high,) = mixture.interval()
    held = weight * (norm.cdf(high) - norm.cdf(low)) + (1 - weight) * (
        norm.cdf(high / ratio - apart) - norm.cdf(low / ratio - apart)
    )
    assert held == pytest.approx(0.95, abs=1e-9)
    if apart == 0.0:  # symmetric
        half = brentq(
            lambda h: weight * (2 * norm.cdf(h) - 1) + (1 - weight) * (2 * norm.cdf(h / ratio) - 1)
            - 0.95, 0.0, 10.0 * ratio,
        )  # fmt: skip
        assert high - low == pytest.approx(2.0 * half, rel=2e-3)
    else:
        inside = norm.ppf(0.5 + 0.475 / weight)
        assert high - low == pytest.approx(2.0 * inside, rel=0.02)


def test_parts_that_are_far_from_each_other_do_not_smear_each_other():
    parts = [
        (0.97, NormalMixture(np.zeros((1, 1)), np.ones((1, 1)), np.ones(1))),
        (0.03, NormalMixture(np.full((1, 1), 1e4), np.ones((1, 1)), np.ones(1))),
    ]
    (low,), (high,) = NormalMixture.joined(parts).interval()
    half = norm.ppf(0.5 + 0.475 / 0.97)
    assert (low, high) == pytest.approx((-half, half), rel=0.02)


@pytest.mark.parametrize(("low", "high"), [(-1.0, 2.0), (0.5, 0.7), (-9.0, 1.5), (-3.0, 40.0)])
def test_slices_between_bounds_fill_them_and_weigh_by_the_normal_density(low, high):
    """Ends at a bound that is near; where it is far, where hardly any probability is left."""
    part = (np.arange(50) + 0.5) / 50
    y, logs = _midpoints(low, high, part)
    law = truncnorm(low, high)
    first, last = law.ppf([1e-8, 1.0 - 1e-8])
    first = low if low > first - 0.1 * (last - first) else first
    last = high if high < last + 0.1 * (last - first) else last
    assert ((first == low), (last == high)) == (low > -9.0, high < 40.0)
    near = 1e-12 if (first, last) == (low, high) else 1e-6  # else by scipy's quantiles
    np.testing.assert_allclose(y, first + part * (last - first), rtol=0.0, atol=near)
    np.testing.assert_allclose(logs - logs[0], norm.logpdf(y) - norm.logpdf(y[0]), atol=1e-12)
