"""Accuracies from residuals, against the closed forms of balanced layouts and by simulation."""

import numpy as np
import pytest
import scipy.sparse as sp

from geoident.identify.assessment.variance_components import (
    RestrictedLikelihood,
    estimate_components,
)
from geoident.identify.problem.errors import ErrorStructure

A, N = 8, 5
GROUPS = sp.csr_array(np.kron(np.eye(A), np.ones((N, 1))))


def one_way(y, columns=GROUPS, of_columns=1):
    """Groups of repeated readings of one quantity: y = mean + group + own."""
    g, size = columns.shape
    structure = ErrorStructure(
        np.ones(g), np.zeros(g, dtype=int), columns, np.full(size, of_columns), ("own", "group")
    )
    nothing = np.zeros((0, 1))
    return RestrictedLikelihood(structure, y, np.ones((g, 1)), np.zeros(0), nothing)


@pytest.fixture
def y():
    generator = np.random.default_rng(1)
    groups = np.repeat(generator.normal(0.0, 2.0, A), N)
    return 3.0 + groups + generator.normal(0.0, 1.0, A * N)


def test_the_balanced_one_way_layout_has_the_estimator_of_the_analysis_of_variance(y):
    table = y.reshape(A, N)
    within = ((table - table.mean(1, keepdims=True)) ** 2).sum() / (A * (N - 1))
    between = N * ((table.mean(1) - table.mean()) ** 2).sum() / (A - 1)
    for start in (np.zeros(2), np.array([3.0, -6.0])):
        found = estimate_components(one_way(y), start)
        expected = [within, (between - within) / N]
        np.testing.assert_allclose(np.exp(found.log_factor), expected, rtol=1e-6)
    # information of the own part: chi-squared with A (N - 1) degrees of freedom
    assert found.covariance[0, 0] == pytest.approx(2.0 / (A * (N - 1)), rel=1e-6)


def test_repeated_readings_of_one_quantity_have_the_variance_with_n_less_one(y):
    structure = ErrorStructure(
        np.full(40, 0.1), np.zeros(40, dtype=int), sp.csr_array((40, 0)), np.zeros(0, int), ("own",)
    )
    likelihood = RestrictedLikelihood(structure, y, np.ones((40, 1)), np.zeros(0), np.zeros((0, 1)))
    found = estimate_components(likelihood, np.zeros(1))
    assert 0.01 * np.exp(found.log_factor[0]) == pytest.approx(y.var(ddof=1), rel=1e-6)
    assert found.covariance[0, 0] == pytest.approx(2.0 / 39)


def likelihood_with_all(y):
    """Own errors of two sizes, a given part, shared steps, a prior."""
    generator = np.random.default_rng(3)
    g = len(y)
    columns = sp.csr_array(np.concatenate([GROUPS.toarray(), generator.normal(size=(g, 3))], 1))
    structure = ErrorStructure(
        generator.uniform(0.5, 2.0, g),
        np.where(np.arange(g) < 8, -1, np.arange(g) % 2),
        columns,
        np.array([2] * A + [-1, 0, 0]),
        ("odd", "even", "group"),
    )
    J, R = generator.normal(size=(g, 3)), np.array([[0.0, 2.0, 0.0]])
    return RestrictedLikelihood(structure, y, J, np.array([0.4]), R)


def test_derivatives_of_the_restricted_likelihood(y):
    likelihood = likelihood_with_all(y)
    t = np.array([0.3, -0.4, 0.2])
    terms = likelihood.terms(t)
    for c in range(3):
        steps = [1e-3, 5e-4]
        slopes = []
        for h in steps:
            ends = [likelihood.value(t + sign * h * np.eye(3)[c]) for sign in (1, -1)]
            slopes.append((ends[0] - ends[1]) / (2.0 * h))
        richardson = (4.0 * slopes[1] - slopes[0]) / 3.0
        assert terms.gradient[c] == pytest.approx(richardson, rel=1e-7)


def test_the_restricted_likelihood_is_that_of_error_contrasts(y):
    """Up to a constant, the likelihood of all that the parameters cannot change (without prior)."""
    likelihood = one_way(y)
    contrasts = np.linalg.svd(np.ones((40, 1)))[0][:, 1:]

    def of_contrasts(t):
        sigma = np.exp(t[0]) * np.eye(40) + np.exp(t[1]) * (GROUPS @ GROUPS.T).toarray()
        V = contrasts.T @ sigma @ contrasts
        u = contrasts.T @ y
        return np.linalg.slogdet(V)[1] + u @ np.linalg.solve(V, u)

    ts = (np.zeros(2), np.array([0.5, -1.0]), np.array([-0.3, 2.0]))
    gaps = [likelihood.value(t) - of_contrasts(t) for t in ts]
    np.testing.assert_allclose(gaps, gaps[0], rtol=1e-9)


def test_what_the_readings_cannot_separate_keeps_its_ratio(y):
    found = estimate_components(one_way(y, sp.csr_array(np.eye(40))), np.zeros(2))
    total = np.exp(found.log_factor)
    assert total[0] == pytest.approx(total[1])
    assert total.sum() == pytest.approx(y.var(ddof=1), rel=1e-6)
    assert np.all(np.isinf(found.upper))


def test_a_part_of_which_the_residuals_show_nothing_is_zero_with_an_upper_end():
    for seed in range(6):
        y = np.random.default_rng(seed).normal(size=40)
        found = estimate_components(one_way(y), np.zeros(2))
        table = y.reshape(A, N)
        within = ((table - table.mean(1, keepdims=True)) ** 2).sum() / (A * (N - 1))
        between = N * ((table.mean(1) - table.mean()) ** 2).sum() / (A - 1)
        if between <= within:
            assert found.log_factor[1] <= -17.9
            assert found.lower[1] == -np.inf
            assert np.isfinite(found.upper[1])
            return
    pytest.fail("no replicate has less between groups than within")


def test_intervals_cover(y):
    """200 replicates: the intervals of both sizes hold the truth as often as they say."""
    generator = np.random.default_rng(11)
    truth = np.log([1.0, 4.0])
    inside = np.zeros(2)
    for _ in range(200):
        groups = np.repeat(generator.normal(0.0, 2.0, A), N)
        found = estimate_components(one_way(groups + generator.normal(size=A * N)), np.zeros(2))
        inside += (found.lower <= truth) & (truth <= found.upper)
    assert np.all(inside / 200 >= 0.91)
    assert np.all(inside / 200 <= 0.99)
