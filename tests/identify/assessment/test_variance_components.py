"""Accuracies from residuals, against the closed forms of balanced layouts and by simulation."""

import numpy as np
import pytest
import scipy.sparse as sp

from geoident.identify.assessment.variance_components import (
    ConditionalLikelihood,
    LikelihoodTerms,
    RestrictedLikelihood,
    estimate_components,
    likeliest_factors,
    likelihood_at,
)
from geoident.identify.problem.errors import ErrorStructure
from geoident.model.parameter import Parameter, Prior

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


def test_a_hundred_thousand_readings_cost_their_sums_only():
    """Repeated readings with a zero that is given: the zero is in the mean, so n - 1 it stays."""
    g = 100_000
    y = np.random.default_rng(5).normal(3.0, 0.2, g)
    zero = sp.csr_array(np.full((g, 1), 0.5))
    structure = ErrorStructure(
        np.full(g, 0.1), np.zeros(g, dtype=int), zero, np.full(1, -1), ("own",)
    )
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


# The rules of the estimate one by one, on likelihoods that are given


class CaseNumber:
    """-2 l by its value, half of its slope and the information; minima of parabolas by default."""

    def __init__(self, curvature, minimum, *, value=None, information=None):
        self.a, self.m = np.array(curvature, dtype=float), np.array(minimum, dtype=float)
        self.information = np.diag(self.a) if information is None else np.array(information)
        self.given = value

    def value(self, t):
        return float(self.a @ (t - self.m) ** 2) if self.given is None else self.given(t)

    def terms(self, t):
        return LikelihoodTerms(self.value(t), 2.0 * self.a * (t - self.m), self.information)


def test_an_estimate_has_the_covariance_of_the_information_and_its_normal_interval():
    found = estimate_components(CaseNumber([4.0, 25.0], [1.5, -2.0]), np.zeros(2))
    np.testing.assert_allclose(found.log_factor, [1.5, -2.0])
    np.testing.assert_allclose(found.covariance, np.diag([0.25, 0.04]))
    half = 1.959963984540054 * np.array([0.5, 0.2])
    np.testing.assert_allclose(found.log_factor - found.lower, half)
    np.testing.assert_allclose(found.upper - found.log_factor, half)
    assert found.minus_two_l == pytest.approx(0.0, abs=1e-12)


@pytest.mark.parametrize(("half", "begins_at_zero"), [(3.99, False), (4.01, True)])
def test_an_interval_wider_than_a_factor_of_seven_begins_at_zero(half, begins_at_zero):
    """Its upper end is where -2 l has risen by 3.84: for a parabola the same place."""
    likelihood = CaseNumber([(1.959963984540054 / half) ** 2, 9.0], [1.0, 0.0])
    found = estimate_components(likelihood, np.zeros(2))
    assert np.isneginf(found.lower[0]) == begins_at_zero
    assert 0.0 <= found.upper[0] - (1.0 + half) + 1e-9 <= 1e-3
    assert np.isfinite(found.lower[1])


@pytest.mark.parametrize(
    ("information", "rise", "vanishes"),
    [(0.9e-3, 0.9e-3, True), (1.1e-3, 0.9e-3, False), (0.9e-3, 1.1e-3, False)],
)
def test_what_the_residuals_show_nothing_of_is_at_its_lowest(information, rise, vanishes):
    def value(t):
        return 7.0 + rise * (t[0] == -18.0) + t[1] ** 2

    likelihood = CaseNumber(
        [0.0, 1.0], [2.0, 3.0], value=value, information=np.diag([information, 1.0])
    )
    found, _ = likeliest_factors(likelihood, np.array([2.0, 3.0]))
    assert found.tolist() == [-18.0 if vanishes else 2.0, 3.0]


def test_factors_end_at_their_bounds():
    found = estimate_components(CaseNumber([1.0, 1.0], [-30.0, 30.0]), np.zeros(2))
    assert found.log_factor.tolist() == [-18.0, 18.0]
    assert found.lower.tolist() == [-np.inf, 18.0]
    np.testing.assert_array_equal(found.covariance, np.zeros((2, 2)))
    # -2 l of the first has risen by 3.84 above that at -18 where its parabola says so
    assert 0.0 <= found.upper[0] - (-30.0 + np.sqrt(144.0 + 1.959963984540054**2)) <= 1e-3
    assert found.upper[1] == np.inf
    likelihood = CaseNumber([1.0, 1.0], [-30.0, 30.0])
    at_ends, _ = likeliest_factors(likelihood, np.array([-40.0, 40.0]))
    assert at_ends.tolist() == [-18.0, 18.0]
    near = CaseNumber([1.0, 1.0], [-17.0, 17.0])
    inwards, _ = likeliest_factors(near, np.array([-18.0, 18.0]))
    np.testing.assert_allclose(inwards, [-17.0, 17.0])


# The model linearised at the estimate


@pytest.mark.parametrize(("part", "directions"), [(0.9e-8, 1), (1.1e-8, 2)])
def test_directions_that_the_readings_hardly_see_are_left_out(make_problem, part, directions):
    parameters = [Parameter(name, 0.0, -9.0, 9.0) for name in "ab"]
    problem = make_problem(lambda p: np.array([0.5 * p[0], 0.25 * p[1] * part, 0.0]),
                           parameters, np.zeros(3), np.array([0.5, 0.25, 1.0]))  # fmt: skip
    readings, J = problem.response.evaluate(np.zeros(2))
    found = likelihood_at(problem, OWN, np.zeros(2), readings, J)
    assert found.jacobian.shape == (3, directions)
    assert found.prior_rows.shape == (0, directions)


@pytest.mark.parametrize(("values", "directions"), [(0.0, 2), (-9.0, 1), (9.0, 1)])
def test_parameters_on_a_bound_are_left_out(make_problem, values, directions):
    parameters = [
        Parameter("a", 0.0, -9.0, 9.0, prior=Prior(mean=1.0, sd=2.0)),
        Parameter("b", 0.0, -9.0, 9.0),
    ]
    problem = make_problem(lambda p: np.array([p[0], 3.0 * p[1], p[0]]),
                           parameters, np.ones(3), np.ones(3))  # fmt: skip
    at = np.array([2.0, values])
    readings, J = problem.response.evaluate(at)
    found = likelihood_at(problem, OWN, at, readings, J)
    assert found.jacobian.shape == (3, directions)
    np.testing.assert_allclose(found.gap, [-1.0, 1.0 - 3.0 * values, -1.0])
    np.testing.assert_allclose(found.prior @ found.prior, 0.25)
    # what is kept spans the same normal matrix
    scale = 2.0  # of a, if any: the rows of readings are twice those of the prior
    free = found.jacobian @ found.jacobian.T
    expected = J[:, :directions] @ J[:, :directions].T
    ratio = np.trace(free) / np.trace(expected)
    np.testing.assert_allclose(free, ratio * expected, atol=1e-9)
    rows = found.prior_rows @ found.prior_rows.T
    np.testing.assert_allclose(rows, ratio / scale**2)


OWN = ErrorStructure(
    np.ones(3), np.zeros(3, dtype=int), sp.csr_array((3, 0)), np.zeros(0, int), ("own",)
)


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


def test_the_last_of_the_components_may_be_held_with_a_weak_prior_of_the_others(y):
    whole = likelihood_with_all(y)
    held = ConditionalLikelihood(whole, 0.2, 1.7)
    t = np.array([0.3, -0.4])
    at = np.array([0.3, -0.4, 0.2])
    prior = (0.15 / 1.7) ** 2 + (0.2 / 1.7) ** 2
    assert held.value(t) == pytest.approx(whole.value(at) + prior, rel=1e-12)
    found, terms = held.terms(t), whole.terms(at)
    assert found.value == pytest.approx(terms.value + prior, rel=1e-12)
    np.testing.assert_allclose(found.gradient, terms.gradient[:2] + 0.5 * t / 1.7**2)
    expected = terms.information[:2, :2] + 0.25 * np.eye(2) / 1.7**2
    np.testing.assert_allclose(found.information, expected)


def test_an_interval_that_reaches_the_lowest_factor_begins_at_zero_and_only_that():
    """Of four components: one seen, one hardly, two that are not told apart."""
    information = np.diag([25.0, 0.04, 9.0, 9.0])
    information[2, 3] = information[3, 2] = 9.0
    likelihood = CaseNumber([25.0, 0.04, 9.0, 9.0], [1.5, 2.0, 0.0, 0.0], information=information)
    found = estimate_components(likelihood, np.zeros(4))
    half = 1.959963984540054
    assert found.lower[0] == pytest.approx(1.5 - half / 5.0)
    assert found.lower[1:].tolist() == [-np.inf] * 3
    assert found.upper[0] == pytest.approx(1.5 + half / 5.0)
    assert 0.0 <= found.upper[1] - (2.0 + half / 0.2) <= 2e-3
    assert found.upper[2:].tolist() == [np.inf, np.inf]
    np.testing.assert_allclose(found.covariance[2:, 2:], np.full((2, 2), 1 / 36.0))


def test_derivatives_by_parameters_are_in_their_scales(make_problem):
    """J dp/dx and the rows of the priors, of the directions that are seen; gaps as measured."""
    parameters = [
        Parameter("a", 2.0, 0.5, 9.0, "log", Prior(3.0, 0.8)),
        Parameter("b", 4.0, -9.0, 9.0, prior=Prior(1.0, 2.0)),
        Parameter("c", 1.0, 1.0, 3.0),
    ]
    A = np.array([[1.0, 0.4, 2.0], [-0.3, 0.7, 1.0], [0.5, 0.1, -1.0]])
    problem = make_problem(lambda p: A @ p, parameters, np.array([5.0, 1.0, 2.0]),
                           np.array([0.5, 0.2, 0.9]))  # fmt: skip
    values = np.array([2.5, 3.0, 1.0])
    readings, J = problem.response.evaluate(values)
    found = likelihood_at(problem, OWN, values, readings, J)
    size = np.array([2.5, 4.0])
    expected = A[:, :2] * size
    np.testing.assert_allclose(found.jacobian @ found.jacobian.T, expected @ expected.T)
    rows = np.diag(size / [0.8, 2.0])
    square = found.prior_rows @ found.prior_rows.T
    np.testing.assert_allclose(square, rows @ rows.T, atol=1e-12)
    np.testing.assert_allclose(found.jacobian @ found.prior_rows.T, expected @ rows.T)
    np.testing.assert_allclose(found.prior, [(2.5 - 3.0) / 0.8, (3.0 - 1.0) / 2.0])
    np.testing.assert_allclose(found.gap, np.array([5.0, 1.0, 2.0]) - A @ values)
