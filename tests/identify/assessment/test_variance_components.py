"""Accuracies from residuals, against the closed forms of balanced layouts and by simulation."""

import numpy as np
import pytest
import scipy.sparse as sp

from geoident.identify.assessment.variance_components import (
    LikelihoodTerms,
    RestrictedLikelihood,
    estimate_components,
    likelihood_at,
)
from geoident.identify.problem.shared_errors import ErrorStructure
from geoident.model.parameter import Parameter

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


def test_of_many_readings_the_sums_are_enough():
    """Repeated readings with zeros that are given: they are in the mean, so n - 1 it stays."""
    g = 30_000
    y = np.random.default_rng(5).normal(3.0, 0.2, g)
    zeros = sp.csr_array(np.full((g, 5), 0.07))
    own, none = np.zeros(g, dtype=int), np.full(5, -1)
    structure = ErrorStructure(np.full(g, 0.1), own, zeros, none, ("own",))
    likelihood = RestrictedLikelihood(structure, y, np.ones((g, 1)), np.zeros(0), np.zeros((0, 1)))
    found = estimate_components(likelihood, np.zeros(1))
    assert 0.01 * np.exp(found.log_factor[0]) == pytest.approx(y.var(ddof=1), rel=1e-9)
    assert found.covariance[0, 0] == pytest.approx(2.0 / (g - 1))


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


@pytest.mark.slow  # replicate by replicate: above
def test_intervals_cover():
    """100 replicates: the intervals of both sizes hold the truth as often as they say."""
    generator = np.random.default_rng(11)
    truth = np.log([1.0, 4.0])
    inside = np.zeros(2)
    for _ in range(100):
        groups = np.repeat(generator.normal(0.0, 2.0, A), N)
        found = estimate_components(one_way(groups + generator.normal(size=A * N)), np.zeros(2))
        inside += (found.lower <= truth) & (truth <= found.upper)
    assert np.all(inside >= 89)
    assert np.all(inside <= 99)


# Rules of the estimate, on likelihoods that are given


class Parabola:
    """-2 l that is a parabola."""

    def __init__(self, curvature, minimum, *, information=None):
        self.a, self.m = np.array(curvature, dtype=float), np.array(minimum, dtype=float)
        self.information = np.diag(self.a) if information is None else np.array(information)

    def value(self, t):
        return float(self.a @ (t - self.m) ** 2)

    def terms(self, t):
        return LikelihoodTerms(self.value(t), 2.0 * self.a * (t - self.m), self.information)


@pytest.mark.parametrize(("half", "begins_at_zero"), [(3.99, False), (4.01, True)])
def test_an_interval_wider_than_a_factor_of_seven_begins_at_zero(half, begins_at_zero):
    """Its upper end is where -2 l has risen by 3.84: for a parabola the same place."""
    likelihood = Parabola([(1.959963984540054 / half) ** 2, 9.0], [1.0, 0.0])
    found = estimate_components(likelihood, np.zeros(2))
    assert np.isneginf(found.lower[0]) == begins_at_zero
    assert 0.0 <= found.upper[0] - (1.0 + half) + 1e-9 <= 1e-3
    assert np.isfinite(found.lower[1])


def test_factors_end_at_their_bounds():
    found = estimate_components(Parabola([1.0, 1.0], [-30.0, 30.0]), np.zeros(2))
    assert found.log_factor.tolist() == [-18.0, 18.0]
    assert found.lower.tolist() == [-np.inf, 18.0]
    np.testing.assert_array_equal(found.covariance, np.zeros((2, 2)))
    # -2 l of the first has risen by 3.84 above that at -18 where its parabola says so
    assert 0.0 <= found.upper[0] - (-30.0 + np.sqrt(144.0 + 1.959963984540054**2)) <= 1e-3
    assert found.upper[1] == np.inf


# The model linearised at the estimate


@pytest.mark.parametrize(("lower", "freedom"), [(-9.0, 1), (3.0, 0)])
def test_a_parameter_on_its_bound_takes_no_degree_of_freedom(make_problem, y, lower, freedom):
    """Repeated readings of one quantity, whose mean is fitted or held by its bound."""
    at = np.array([y.mean() if freedom else lower])
    mean = Parameter("m", at[0], lower, 9.0)
    problem = make_problem(lambda p: np.full(40, p[0]), [mean], y, np.ones(40))
    none = sp.csr_array((40, 0))
    structure = ErrorStructure(np.ones(40), np.zeros(40, int), none, np.zeros(0, int), ("own",))
    readings, J = problem.response.evaluate(at)
    found = estimate_components(likelihood_at(problem, structure, at, readings, J), np.zeros(1))
    expected = np.sum((y - at[0]) ** 2) / (40 - freedom)
    assert np.exp(found.log_factor[0]) == pytest.approx(expected, rel=1e-6)


@pytest.mark.parametrize("t", [(0.3, -0.4, 0.2), (-9.0, -8.0, 3.0)])
def test_information_and_gradient_are_those_of_dense_matrices(y, t):
    """tr(P V_c P V_d) / 2 and tr P V_c - q^T V_c q, with P and q from Sigma itself."""
    given = likelihood_with_all(y)
    structure, J, R, prior = given.structure, given.jacobian, given.prior_rows, given.prior
    t = np.array(t)
    B = structure.columns.toarray()
    V = []
    for c in (-1, 0, 1, 2):
        columns = B[:, structure.column_component == c]
        V.append(np.diag(np.where(structure.component == c, structure.sd**2, 0)))
        V[-1] = V[-1] + columns @ columns.T
    own = [np.exp(size) * one for size, one in zip(t, V[1:], strict=True)]
    sigma = V[0] + sum(own)
    inverse = np.linalg.inv(sigma)
    M = J.T @ inverse @ J + R.T @ R
    P = inverse - inverse @ J @ np.linalg.inv(M) @ J.T @ inverse
    x = np.linalg.solve(M, J.T @ inverse @ y - R.T @ prior)
    q = inverse @ (y - J @ x)
    found = given.terms(t)
    expected = [np.trace(P @ one) - q @ one @ q for one in own]
    np.testing.assert_allclose(found.gradient, expected, rtol=1e-7)
    both = [[0.5 * np.trace(P @ a @ P @ b) for b in own] for a in own]
    np.testing.assert_allclose(found.information, both, rtol=1e-7, atol=1e-9)
    left = prior + R @ x
    value = np.linalg.slogdet(sigma)[1] + np.linalg.slogdet(M)[1]
    value += (y - J @ x) @ q + left @ left
    assert found.value == pytest.approx(value, rel=1e-9)
    assert given.value(t) == pytest.approx(value, rel=1e-9)


def test_an_interval_that_reaches_the_lowest_factor_begins_at_zero_and_only_that():
    """Of four components: one seen, one hardly, two that are not told apart."""
    information = np.diag([25.0, 0.04, 9.0, 9.0])
    information[2, 3] = information[3, 2] = 9.0
    likelihood = Parabola([25.0, 0.04, 9.0, 9.0], [1.5, 2.0, 0.0, 0.0], information=information)
    found = estimate_components(likelihood, np.zeros(4))
    half = 1.959963984540054
    assert found.lower[0] == pytest.approx(1.5 - half / 5.0)
    assert found.lower[1:].tolist() == [-np.inf] * 3
    assert found.upper[0] == pytest.approx(1.5 + half / 5.0)
    assert 0.0 <= found.upper[1] - (2.0 + half / 0.2) <= 2e-3
    assert found.upper[2:].tolist() == [np.inf, np.inf]
    np.testing.assert_allclose(found.covariance[2:, 2:], np.full((2, 2), 1 / 36.0))
