"""Size of the model error, scatter of the gauges and errors of zeros, weighed together."""

import numpy as np
import pytest
import scipy.sparse as sp

from geoident.identify.assessment import model_error
from geoident.identify.assessment.model_error import FACTORS, SIZES, ZEROS, weigh_all, weigh_sizes
from geoident.identify.assessment.variance_components import LikelihoodTerms, RestrictedLikelihood
from geoident.identify.problem.shared_errors import ErrorStructure

G, CHANNELS = 24, 8
CHANNEL = np.arange(G) % CHANNELS
OWN = sp.csr_array((np.full(G, 0.1), (np.arange(G), CHANNEL)), shape=(G, CHANNELS))


def distances():
    place = CHANNEL * 4.0
    return np.abs(place[:, None] - place)


def model_covariance():
    """As large as the accuracies at eta = 0.1, alike in neighbouring channels."""
    return 100.0 * np.exp(-distances() / 10.0) + 1e-9 * np.eye(G)


def likelihood(gap, *, parameters=2, priors=0, seed=0):
    """Of readings with accuracies of one, some of them shared, without model error."""
    generator = np.random.default_rng(seed)
    shared, none = sp.csr_array(0.3 * np.ones((G, 1))), np.full(G, -1)
    structure = ErrorStructure(np.ones(G), none, shared, none[:1], ())
    J = generator.normal(size=(G, parameters))
    rows = np.eye(parameters)[:priors] + 0.1 * generator.normal(size=(priors, parameters))
    return RestrictedLikelihood(structure, gap, J, generator.normal(size=priors), rows)


ROOT = sp.csr_array(np.linalg.cholesky(model_covariance()))


def zeros():
    size = np.ones(G)
    return sp.csr_array((size, (np.arange(G), CHANNEL)), shape=(G, CHANNELS))


def noise(*, scatter=1.0, zero=0.0, eta=0.0, seed=1):
    generator = np.random.default_rng(seed)
    root = np.linalg.cholesky(model_covariance())
    found = scatter * generator.normal(size=G) + eta * root @ generator.normal(size=G)
    return found + zero * scatter * generator.normal(size=CHANNELS)[CHANNEL]


@pytest.mark.parametrize(("parameters", "priors"), [(2, 0), (2, 1), (40, 40), (0, 0)])
def test_minus_two_l_is_that_of_dense_matrices(parameters, priors):
    """With and without priors, and with more parameters than readings."""
    given = likelihood(noise(eta=0.1), parameters=parameters, priors=priors)
    found = weigh_all(given, ROOT, zeros(), free=True)
    Z, J, R = zeros().toarray(), given.jacobian, given.prior_rows

    def minus_two_l(eta, s, z):
        gauges = np.eye(G) + 0.09 * np.ones((G, G)) + z**2 * Z @ Z.T
        sigma = s**2 * gauges + eta**2 * model_covariance()
        M = J.T @ np.linalg.solve(sigma, J) + R.T @ R
        x = np.linalg.solve(M, J.T @ np.linalg.solve(sigma, given.gap) - R.T @ given.prior)
        left, prior = given.gap - J @ x, given.prior + R @ x
        value = np.linalg.slogdet(sigma)[1] + np.linalg.slogdet(M)[1]
        return value + left @ np.linalg.solve(sigma, left) + prior @ prior

    for m, f, z in [(0, 0, 0), (10, 3, 0), (20, 0, 4), (28, 14, 7), (15, 6, 2)]:
        expected = minus_two_l(SIZES[m], FACTORS[f], ZEROS[z])
        assert found.minus_two_l[m, f, z] == pytest.approx(expected, rel=1e-8)
    used = minus_two_l(found.size, found.factor, found.zero)
    assert found.components.minus_two_l == pytest.approx(used, rel=1e-8)
    expected = [found.factor, found.factor * found.zero]
    np.testing.assert_allclose(np.exp(0.5 * found.components.log_factor), expected)
    assert found.joint.sum() == pytest.approx(1.0)
    assert found.joint.shape == (len(SIZES), len(FACTORS), len(ZEROS))


def median(of, **kind):
    """Of what five draws of readings make of a size."""
    draws = [
        weigh_all(likelihood(noise(**kind, seed=k)), ROOT, zeros(), free=True) for k in range(5)
    ]
    return [np.median([getattr(found, name) for found in draws]) for name in of]


def test_the_readings_tell_scatter_zeros_and_model_error_apart():
    names = ("size", "factor", "zero")
    size, factor, zero = median(names)
    assert (size < 0.08, factor < 1.2, zero < 0.5) == (True, True, True)
    size, factor, zero = median(names, scatter=3.0)
    assert (size < 0.2, 2.4 < factor < 3.3, zero < 0.5) == (True, True, True)
    size, factor, zero = median(names, zero=3.0)
    assert (factor < 1.3, 1.2 < zero < 3.3) == (True, True)
    size, factor, zero = median(names, eta=0.4)
    assert (0.25 < size < 0.5, factor < 1.3) == (True, True)


def test_what_is_not_free_is_looked_at_and_not_used():
    given = likelihood(noise(scatter=3.0))
    found = weigh_all(given, ROOT, zeros(), free=False)
    assert (found.factor, found.zero) == pytest.approx((1.0, 0.0))
    assert len(found.components.log_factor) == 0
    assert found.minus_two_l[0, :, 0].argmin() > 3
    free = weigh_all(given, ROOT, None, free=True)
    assert free.joint.shape[2] == 1
    assert free.zero == 0.0
    assert free.factor > 1.8
    assert len(free.components.log_factor) == 1


def table(m=29, f=15, z=8, seed=4):
    """Weights that are known, of no symmetry."""
    rng = np.random.default_rng(seed)
    joint = rng.uniform(size=(m, f, z)) ** 3
    return joint / joint.sum()


NOTHING = model_error.VarianceComponents(*[np.zeros(0)] * 4, 3.7)


def test_means_and_quantiles_are_those_of_the_table():
    joint = table()
    found = model_error.SizeWeights(joint, np.zeros_like(joint), np.ones((15, 8)), NOTHING)
    of_size, of_factor, of_zero = (joint.sum(axis=axes) for axes in ((1, 2), (0, 2), (0, 1)))
    np.testing.assert_allclose(found.weights, of_size)
    assert found.size == pytest.approx(np.sqrt(of_size @ SIZES**2))
    assert found.factor == pytest.approx(np.sqrt(of_factor @ FACTORS**2))
    both = np.einsum("mfz,f,z->", joint, FACTORS**2, ZEROS**2)
    assert found.zero == pytest.approx(np.sqrt(both) / found.factor)
    middles = [0.0, *(0.5 * (SIZES[1:] + SIZES[:-1])), 1.0]
    for part in (0.1, 0.5, 0.97):
        expected = np.exp(np.interp(part, np.cumsum(of_factor), np.log(FACTORS)))
        assert found.factor_quantile(part) == pytest.approx(expected)
        expected = np.interp(part, np.cumsum(of_zero), ZEROS)
        assert found.zero_quantile(part) == pytest.approx(expected)
        expected = np.interp(part, np.append(0.0, np.cumsum(of_size)), middles)
        assert found.quantile(part) == pytest.approx(expected)


def half_normal_of_sizes():
    """Weight of each piece of eta in the half-normal prior of 0.3, by its density and width."""
    width = np.gradient(SIZES)
    return np.sqrt(2.0 / np.pi) / 0.3 * np.exp(-0.5 * (SIZES / 0.3) ** 2) * width


def test_the_evidence_is_the_sum_of_likelihood_times_priors_by_that_at_what_is_used():
    rng = np.random.default_rng(2)
    values, prior = rng.uniform(0.0, 9.0, (29, 15, 8)), rng.uniform(size=(15, 8))
    prior[3] = 0.0
    prior /= prior.sum()
    found = model_error.SizeWeights(table(), values, prior, NOTHING).log_gain
    whole = half_normal_of_sizes()[:, None, None] * prior * np.exp(-0.5 * (values - 3.7))
    assert found == pytest.approx(np.log(whole.sum()), rel=1e-9)


class Slopes:
    """-2 l of one accuracy and the model error, a parabola whose minimum follows the last."""

    def __init__(self):
        self.asked = []

    def value(self, t):
        self.asked.append(t.tolist())
        away = t[0] - 0.4 + 0.2 * (t[-1] + 3.0)
        return float(8.0 * away**2 + 0.5 * (t[-1] + 3.0) ** 2)

    def terms(self, t):
        away = t[0] - 0.4 + 0.2 * (t[-1] + 3.0)
        last = 3.2 * away + (t[-1] + 3.0)
        curvature = np.array([[8.0, 1.6], [1.6, 0.9]])
        return LikelihoodTerms(self.value(t), np.array([16.0 * away, last]), curvature)


def test_sizes_are_weighed_with_the_accuracies_that_are_likeliest_at_each():
    """A parabola with its weak prior (t / 2 ln 3)^2 has its least value in closed form."""
    found = weigh_sizes(Slopes(), np.array([1.3]))
    weak = 0.25 / np.log(3.0) ** 2
    centre = 0.4 - 0.2 * (2.0 * np.log(SIZES) + 3.0)
    least = 8.0 * weak / (8.0 + weak) * centre**2
    expected = least + 0.5 * (2.0 * np.log(SIZES) + 3.0) ** 2
    assert found.minus_two_l.shape == (29, 1, 1)
    np.testing.assert_allclose(found.minus_two_l[:, 0, 0], expected, rtol=1e-6)
    raw = half_normal_of_sizes() * np.exp(-0.5 * expected)
    np.testing.assert_allclose(found.weights, raw / raw.sum(), rtol=1e-5)
    np.testing.assert_array_equal(found.prior, [[1.0]])
    size = np.sqrt(raw @ SIZES**2 / raw.sum())
    assert found.size == pytest.approx(size, rel=1e-6)
    at = 0.4 - 0.2 * (2.0 * np.log(size) + 3.0)
    t = 8.0 * at / (8.0 + weak)
    np.testing.assert_allclose(found.components.log_factor, [t], rtol=1e-5)
    np.testing.assert_allclose(found.components.covariance, [[1.0 / (8.0 + weak)]], rtol=1e-6)
    whole = 8.0 * (t - at) ** 2 + 0.5 * (2.0 * np.log(size) + 3.0) ** 2 + weak * t**2
    assert found.components.minus_two_l == pytest.approx(whole, rel=1e-6)
