"""What a minimum holds, and the evidence: against quadrature, scipy and closed forms."""

from dataclasses import replace

import numpy as np
import pytest
import scipy.sparse as sp
from scipy.integrate import dblquad, quad
from scipy.stats import multivariate_normal, norm, truncnorm

from geoident.identify.assessment import laplace
from geoident.identify.assessment.diagnostics import effective_sd
from geoident.identify.assessment.laplace import (
    laplace_mass,
    log_box_probability,
    log_normalisation,
    log_prior_volume,
    mixture_interval,
)
from geoident.identify.problem.errors import SharedErrors
from geoident.identify.problem.problem import Discrepancy, Linearization, transformed
from geoident.identify.problem.scaling import Scaling
from geoident.model.methods import HuberOptions, SquaredOptions, StudentOptions
from geoident.model.parameter import Parameter, Prior


@pytest.mark.parametrize("n", [2, 3, 5, 8])
def test_the_probability_of_a_box_is_that_of_scipy(n):
    rng = np.random.default_rng(n)
    A = rng.normal(size=(n + 1, n))
    covariance, mean = np.linalg.inv(A.T @ A), rng.normal(size=n)
    sd = np.sqrt(np.diag(covariance))
    lower = mean - rng.uniform(-0.5, 3.0, n) * sd
    upper = lower + rng.uniform(0.5, 4.0, n) * sd
    expected = multivariate_normal(mean, covariance, seed=1).cdf(upper, lower_limit=lower)
    found = np.exp(log_box_probability(mean, covariance, lower, upper))
    assert found == pytest.approx(expected, rel=2e-3)


def test_a_box_far_out_keeps_its_logarithm():
    """Independent numbers 40 standard deviations off: far below what a float can hold."""
    mean, one = np.array([41.0, 0.0]), np.ones(2)
    found = log_box_probability(mean, np.eye(2), -one, one)
    expected = norm.logsf(40.0) + np.log(norm.cdf(1.0) - norm.cdf(-1.0))
    assert found == pytest.approx(expected, abs=0.05)


def _mass(problem, p):
    discrepancy = Discrepancy(problem)
    x = discrepancy.scaling.to_scaled(np.asarray(p))
    return laplace_mass(discrepancy.linearize(np.asarray(p)), x, discrepancy.scaling).log_mass


@pytest.mark.parametrize("measured", [[0.9, 0.4], [3.0, 2.2], [-5.0, 0.0]], ids=str)
def test_the_mass_of_a_linear_model_is_the_integral_over_the_bounds(make_problem, measured):
    """Inside, on one bound, and far outside of both."""
    A = np.array([[1.0, 0.3], [0.2, 0.8]])
    q = [Parameter("a", 1.0, -1.0, 2.0), Parameter("b", 1.0, -1.0, 2.0)]
    problem = make_problem(lambda p: A @ p, q, measured, 0.5)
    discrepancy = Discrepancy(problem)

    def density(b, a):
        p = discrepancy.scaling.to_natural(np.array([a, b]))
        return np.exp(-0.5 * discrepancy.objective(p))

    low, high = discrepancy.scaling.lower, discrepancy.scaling.upper
    expected, _ = dblquad(density, low[0], high[0], low[1], high[1], epsabs=0.0, epsrel=1e-6)
    for at in ([1.0, 1.0], [2.0, 0.3]):  # the linearised model is the same from everywhere
        assert _mass(problem, at) == pytest.approx(np.log(expected), abs=3e-3)


def test_what_the_readings_do_not_see_holds_its_range(make_problem):
    q = [Parameter("a", 1.0, -4.0, 4.0), Parameter("b", 1.0, 0.0, 3.0)]
    problem = make_problem(lambda p: p[:1], q, [0.5], 0.1)
    reference = Discrepancy(problem).scaling.reference
    expected = np.log(0.1 / reference[0] * np.sqrt(2 * np.pi)) + np.log(3.0 / reference[1])
    assert _mass(problem, [0.5, 1.0]) == pytest.approx(expected, abs=1e-3)


def test_the_evidence_of_a_linear_model_is_the_density_of_its_readings(make_problem):
    """y = A p + e with p ~ N(m, S) and errors that share one: y ~ N(A m, A S A' + Sigma)."""
    rng = np.random.default_rng(2)
    A, B = rng.normal(size=(6, 2)), 0.4 * rng.normal(size=(6, 1))
    m, s = np.array([1.0, -0.5]), np.array([0.4, 0.7])
    q = [
        Parameter(n, 0.1, -90.0, 90.0, prior=Prior(a, b))
        for n, a, b in zip("ab", m, s, strict=True)
    ]
    y, sd = rng.normal(size=6), rng.uniform(0.2, 0.5, 6)
    problem = replace(make_problem(lambda p: A @ p, q, y, sd), shared=SharedErrors(sp.csr_array(B)))
    found = _mass(problem, [0.3, 0.2]) - log_prior_volume(tuple(q))
    found -= log_normalisation(problem, A @ m)
    sigma = np.diag(sd**2) + B @ B.T + A @ np.diag(s**2) @ A.T
    assert found == pytest.approx(multivariate_normal(A @ m, sigma).logpdf(y), rel=1e-6)


@pytest.mark.parametrize("scale", ["linear", "log"])
@pytest.mark.parametrize("kind", ["normal", "lognormal"])
def test_the_volume_of_a_prior_is_its_integral_between_the_bounds(scale, kind):
    parameter = Parameter("E", 3.0, 1.0, 6.0, scale, Prior(4.0, 1.3, kind))
    scaling = Scaling([parameter])

    def density(x):
        return np.exp(
            -0.5 * float(scaling.prior_residuals(scaling.to_natural(np.array([x])))[0]) ** 2
        )

    expected, _ = quad(density, scaling.lower[0], scaling.upper[0], epsabs=0.0, epsrel=1e-10)
    assert log_prior_volume((parameter,)) == pytest.approx(np.log(expected), abs=1e-8)


@pytest.mark.parametrize("upper", [1.05, 2.0, 50.0])
def test_the_volume_without_priors_is_that_of_the_box(upper):
    """Narrow or wide; what cannot move takes nothing away."""
    logarithmic = Parameter("E", 1.02, 1.0, upper, "log")
    held, K0 = Parameter("nu", 0.3, 0.3, 0.3), Parameter("K0", 1.0, 0.9, 1.1)
    wide = float(np.diff([Scaling([K0]).lower[0], Scaling([K0]).upper[0]])[0])
    expected = np.log(np.log(upper)) + np.log(wide)
    assert log_prior_volume((logarithmic, held, K0)) == pytest.approx(expected, abs=1e-12)


def test_a_parameter_without_bounds_and_prior_has_no_volume():
    assert log_prior_volume((Parameter("a", 1.0, -np.inf, np.inf),)) == np.inf


@pytest.mark.parametrize("loss", [SquaredOptions(), HuberOptions(), StudentOptions()], ids=str)
def test_the_normalisation_is_the_integral_over_the_readings(make_problem, loss):
    problem = replace(
        make_problem(lambda p: p, [Parameter("a", 1.0, 0.0, 2.0)], [0.5], 0.3), loss=loss
    )

    def density(y):
        f, _ = transformed(loss, np.array([y / 0.3]))
        return float(np.exp(-0.5 * f[0] ** 2))

    expected, _ = quad(density, -np.inf, np.inf, epsabs=0.0, epsrel=1e-10, limit=500)
    assert log_normalisation(problem, np.array([0.5])) == pytest.approx(np.log(expected), abs=1e-6)


def test_shared_errors_under_a_robust_loss_are_counted_as_under_the_squared_one(make_problem):
    """Where no reading is off the two losses agree, but for the tails of the one."""
    B = np.full((4, 1), 0.5)
    q = [Parameter("a", 1.0, 0.0, 2.0)]
    given = replace(
        make_problem(lambda p: np.ones(4) * p[0], q, [1.0, 1.1, 0.9, 1.0], 0.3),
        shared=SharedErrors(sp.csr_array(B)),
    )
    v = np.ones(4)
    squared = log_normalisation(given, v)
    huber = log_normalisation(replace(given, loss=HuberOptions(9.0)), v)
    assert huber == pytest.approx(squared, abs=1e-6)


def test_the_interval_of_a_mixture_holds_95_percent_of_it():
    odds, means, sds = np.array([0.7, 0.3]), np.array([[1.0], [6.0]]), np.array([[0.5], [1.0]])
    low, high = mixture_interval(odds, means, sds)
    below = [float(odds @ norm.cdf(end, means[:, 0], sds[:, 0])) for end in (low[0], high[0])]
    np.testing.assert_allclose(below, [0.025, 0.975], atol=1e-9)
    one = mixture_interval(np.ones(1), means[:1], sds[:1])
    np.testing.assert_allclose(np.ravel(one), [1.0 - 0.98, 1.0 + 0.98], atol=1e-4)
    assert np.isnan(mixture_interval(odds, means, np.array([[0.5], [np.inf]]))[0][0])


@pytest.mark.parametrize(
    ("lower", "upper"),
    [
        (-0.4, 1.7),
        (-np.inf, 0.3),
        (0.6, np.inf),
        (2.0, 2.5),
        (-3.0, -2.9),
        (-9.0, -8.5),
        (20.0, 21),
    ],
)
def test_one_number_between_two_bounds_has_its_normal_probability(lower, upper):
    """Also far out on either side, by logarithms of the tail that holds it."""
    mean, sd = 3.0, 0.7
    args = (np.array([one]) for one in (mean, sd**2, mean + sd * lower, mean + sd * upper))
    m, variance, low, high = args
    found = log_box_probability(m, variance[None], low, high)
    far, near = (-upper, -lower) if lower > 0.0 else (lower, upper)
    expected = norm.logcdf(near) + np.log1p(-np.exp(norm.logcdf(far) - norm.logcdf(near)))
    assert found == pytest.approx(expected, rel=1e-9)


@pytest.mark.parametrize(("far", "cut"), [(7.9, True), (8.1, False)])
def test_bounds_eight_standard_deviations_off_cut_nothing(far, cut):
    for lower, upper in ((-far, np.inf), (-np.inf, far)):
        one = np.array([[4.0]])
        found = log_box_probability(np.ones(1), one, *np.array([[lower], [upper]]) * 2.0 + 1.0)
        assert (found != 0.0) == cut
        assert found == pytest.approx(-norm.cdf(-far) if cut else 0.0, rel=0.1)
    # of two, one is cut: the probability is that of this one alone
    mean, sd = np.array([1.0, -2.0]), np.array([2.0, 0.5])
    C = np.array([[4.0, 0.3], [0.3, 0.25]])
    for k in (0, 1):
        z = np.full(2, 8.1)
        z[k] = 0.7
        found = log_box_probability(mean, C, mean - z * sd, np.full(2, np.inf))
        assert found == pytest.approx(norm.logcdf(0.7), rel=1e-9)


def test_two_numbers_between_bounds_are_integrated_one_given_the_other():
    """By scipy's quadrature of what the second has, given the first."""
    mean, C = np.array([0.5, -1.0]), np.array([[2.0, -1.1], [-1.1, 1.5]])
    lower, upper = np.array([-0.3, -1.2]), np.array([1.4, 3.0])

    def given(x):
        centre = mean[1] + C[1, 0] / C[0, 0] * (x - mean[0])
        sd = np.sqrt(C[1, 1] - C[0, 1] ** 2 / C[0, 0])
        inner = norm.cdf(upper[1], centre, sd) - norm.cdf(lower[1], centre, sd)
        return inner * norm.pdf(x, mean[0], np.sqrt(C[0, 0]))

    expected = np.log(quad(given, lower[0], upper[0], epsabs=0.0, epsrel=1e-12)[0])
    assert log_box_probability(mean, C, lower, upper) == pytest.approx(expected, abs=2e-4)
    turned = [np.array(one)[::-1] for one in (mean, lower, upper)]
    found = log_box_probability(turned[0], C[::-1, ::-1], turned[1], turned[2])
    assert found == pytest.approx(expected, abs=2e-4)


def test_points_of_the_lattice_are_folded_multiples_of_roots_of_primes():
    found = laplace._lattice(4)
    assert found.shape == (4, 4096)
    k = np.arange(1, 4097)
    for row, prime in zip(found, (2, 3, 5, 7), strict=True):
        part = (k * np.sqrt(prime)) % 1.0
        np.testing.assert_allclose(row, np.minimum(2.0 * part, 2.0 - 2.0 * part), atol=1e-9)
    assert np.all((found > 0.0) & (found < 1.0))


def test_quantiles_between_two_bounds_are_those_of_the_cut_normal():
    """Where both are above zero from the upper end: computed in the lower tail."""
    low, high = np.array([-2.0, 0.5, -np.inf, -5.0]), np.array([1.0, 0.9, -1.0, -4.0])
    u = np.array([0.1, 0.7, 0.4, 0.95])
    found = laplace._within(low, high, u)
    np.testing.assert_allclose(found, truncnorm(low, high).ppf([0.1, 0.3, 0.4, 0.95]), rtol=1e-6)
    mirrored = laplace._within(-high[2:], -low[2:], u[2:])
    np.testing.assert_allclose(mirrored, -found[2:], rtol=1e-6)


def test_the_covariance_of_a_minimum_is_that_of_the_readings_and_a_hundred_ranges():
    """Ranges of a parameter between bounds, and ten of one that has none or is held."""
    parameters = (
        Parameter("a", 2.0, 1.0, 4.0),
        Parameter("b", 3.0, -np.inf, np.inf),
        Parameter("c", 5.0, 5.0, 5.0),
        Parameter("d", 2.0, 1.0, 8.0, "log"),
    )
    J = np.array([[0.7, 0.0, 0.02, 0.3], [0.2, 1e-4, 0.0, -0.6]])
    r = np.array([0.4, -0.9])
    scaling = Scaling(parameters)
    x = scaling.to_scaled(np.array([2.5, 4.0, 5.0, 3.0]))
    found = laplace_mass(Linearization(r, J), x, scaling)
    width = np.array([3.0 / 2.0, 10.0, 10.0, np.log(8.0)])
    curvature = J.T @ J + np.diag((100.0 * width) ** -2.0)
    np.testing.assert_allclose(found.covariance_x, np.linalg.inv(curvature), rtol=1e-6)
    lowest = r @ r - (J.T @ r) @ np.linalg.solve(curvature, J.T @ r)
    mean = x - np.linalg.solve(curvature, J.T @ r)
    inside = log_box_probability(mean, found.covariance_x, scaling.lower, scaling.upper)
    expected = -0.5 * lowest + 2.0 * np.log(2.0 * np.pi) - 0.5 * np.linalg.slogdet(curvature)[1]
    assert found.log_mass == pytest.approx(expected + inside, abs=1e-6)


def test_volumes_of_priors_and_widths_multiply():
    q = (
        Parameter("a", 3.0, 1.0, 6.0, "linear", Prior(4.0, 1.3)),
        Parameter("b", 3.0, 1.0, 7.0, "linear"),
        Parameter("c", 3.0, 2.0, 5.0, "log", Prior(2.5, 0.5, "lognormal")),
    )
    parts = [log_prior_volume((one,)) for one in q]
    assert log_prior_volume(q) == pytest.approx(sum(parts), rel=1e-12)
    # a: sd over its reference, 3; b: its width over 3; c: sd / mean
    between = norm.cdf((6.0 - 4.0) / 1.3) - norm.cdf((1.0 - 4.0) / 1.3)
    assert parts[0] == pytest.approx(np.log(1.3 / 3.0 * np.sqrt(2.0 * np.pi) * between))
    assert parts[1] == pytest.approx(np.log(6.0 / 3.0))
    ends = np.log(np.array([2.0, 5.0]) / 2.5) / 0.2
    between = norm.cdf(ends[1]) - norm.cdf(ends[0])
    assert parts[2] == pytest.approx(np.log(0.2 * np.sqrt(2.0 * np.pi) * between))


def test_shared_errors_count_beside_the_own_ones_under_any_loss(make_problem):
    """Half the determinant of all by that of the own; with weights of a robust loss in both."""
    B = np.array([[0.5, 0.0], [0.4, 0.2], [0.0, 0.7], [0.3, 0.3]])
    sd, y = np.array([0.3, 0.2, 0.4, 0.25]), np.array([1.0, 1.1, 3.9, 1.0])
    q = [Parameter("a", 1.0, 0.0, 2.0)]
    base = make_problem(lambda p: np.ones(4) * p[0], q, y, sd)
    base = replace(base, shared=SharedErrors(sp.csr_array(B)))
    v = np.ones(4)
    for loss in (SquaredOptions(), HuberOptions(1.3), StudentOptions(4.0)):
        problem = replace(base, loss=loss)
        alone = replace(problem, shared=None)
        own = effective_sd(problem, v)
        assert (own[2] > 2.0 * sd[2]) == (loss != SquaredOptions())
        more = np.linalg.slogdet(np.diag(own**2) + B @ B.T)[1] - 2.0 * np.log(own).sum()
        expected = log_normalisation(alone, v) + 0.5 * more
        assert log_normalisation(problem, v) == pytest.approx(expected, rel=1e-9)


def test_the_interval_of_a_mixture_of_many_is_that_of_each():
    """Two components of quantities in a table, of which one is nowhere known."""
    odds = np.array([0.35, 0.65])
    means = np.array([[[1.0, -4.0], [0.0, 2.0]], [[2.5, 7.0], [0.0, 2.0]]])
    sds = np.array([[[0.5, 2.0], [np.nan, 0.0]], [[1.5, 0.1], [1.0, 3.0]]])
    low, high = mixture_interval(odds, means, sds)
    assert np.isnan([low[1, 0], high[1, 0]]).all()
    for at in ((0, 0), (0, 1), (1, 1)):
        for end, part in ((low[at], 0.025), (high[at], 0.975)):
            below = odds @ norm.cdf(end, means[:, *at], np.maximum(sds[:, *at], 1e-12))
            assert below == pytest.approx(part, abs=1e-9)
    means[0, 0, 1] = np.nan
    expected = [[False, True], [True, False]]
    assert np.isnan(mixture_interval(odds, means, sds)).tolist() == [expected, expected]
