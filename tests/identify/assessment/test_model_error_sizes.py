"""Size of the model error, scatter of the gauges and errors of zeros, weighed together."""

import numpy as np
import pytest
import scipy.sparse as sp

from geoident.identify.assessment import model_error
from geoident.identify.assessment.model_error import FACTORS, SIZES, ZEROS, weigh_all
from geoident.identify.assessment.variance_components import RestrictedLikelihood
from geoident.identify.problem.errors import ErrorStructure

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
    """Of readings with accuracies of one, some of them shared, and the model error."""
    generator = np.random.default_rng(seed)
    root = sp.csr_array(np.linalg.cholesky(model_covariance()))
    shared = sp.csr_array(np.hstack([0.3 * np.ones((G, 1)), root.toarray()]))
    of = np.concatenate([[0], np.ones(G, dtype=int)])
    structure = ErrorStructure(np.ones(G), np.zeros(G, dtype=int), shared, of, ("all", "model"))
    J = generator.normal(size=(G, parameters))
    rows = np.eye(parameters)[:priors] + 0.1 * generator.normal(size=(priors, parameters))
    return RestrictedLikelihood(structure, gap, J, generator.normal(size=priors), rows)


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
    found = weigh_all(given, zeros(), free=True)
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
    """Of what a dozen draws of readings make of a size."""
    draws = [weigh_all(likelihood(noise(**kind, seed=k)), zeros(), free=True) for k in range(12)]
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
    found = weigh_all(given, zeros(), free=False)
    assert (found.factor, found.zero, len(found.components.log_factor)) == (1.0, 0.0, 0)
    assert found.minus_two_l[0, :, 0].argmin() > 3
    free = weigh_all(given, None, free=True)
    assert free.joint.shape[2] == 1
    assert free.zero == 0.0
    assert free.factor > 1.8
    assert len(free.components.log_factor) == 1


def test_quantiles_are_those_of_the_weights():
    found = weigh_all(likelihood(noise(scatter=3.0, zero=2.0)), zeros(), free=True)
    low, high = (found.factor_quantile(part) for part in (0.025, 0.975))
    assert 1.0 < low < found.factor < high < 8.0
    inside = (low <= FACTORS) & (high >= FACTORS)
    assert 0.8 < found.joint.sum(axis=(0, 2))[inside].sum() <= 1.0
    low, high = (found.zero_quantile(part) for part in (0.025, 0.975))
    assert 0.0 < low < found.zero < high < 5.6


def test_the_evidence_integrates_over_all_that_is_weighed():
    """By hand: with a constant -2 l the gain is the whole prior, one, but for what lies above 1."""
    found = weigh_all(likelihood(noise()), zeros(), free=True)
    flat = np.zeros_like(found.minus_two_l)
    known = model_error.VarianceComponents(*[np.zeros(0)] * 4, 0.0)
    gain = model_error.SizeWeights(found.joint, flat, found.prior, known).log_gain
    assert gain == pytest.approx(0.0, abs=0.02)
