"""Noise that lasts and drifts: sums over its inverse covariance are those of dense matrices."""

import numpy as np
import pytest
from support.in_time import DAY, covariance

from geoident.identify.in_time.innovations import whitening
from geoident.identify.in_time.noise import Noise, TimeCovariance

TIMES = np.array([0.0, 1.0, 2.5, 2.6, 30.0, 31.0, 400.0]) * DAY


@pytest.mark.parametrize(
    "noise",
    [
        Noise(0.3),
        Noise(0.3, 0.5, 20.0 * DAY),
        Noise(1e-3, 2.0, DAY),
        Noise(2.0, 1e-2, DAY),
        Noise(0.3, drift=0.4),
        Noise(0.3, 0.5, 20.0 * DAY, drift=2.0),
    ],
)
def test_inverse_and_determinant_are_those_of_the_dense_matrix(noise):
    values = np.random.default_rng(0).normal(size=(len(TIMES), 2))
    errors, full = TimeCovariance(noise, TIMES), covariance(noise, TIMES)
    np.testing.assert_allclose(
        errors.solve(values), np.linalg.solve(full, values), rtol=1e-6, atol=1e-9
    )
    assert errors.log_determinant == pytest.approx(np.linalg.slogdet(full)[1], abs=1e-8)


def test_whitened_errors_are_those_of_the_cholesky_factor():
    noise = Noise(0.3, 0.5, 20.0 * DAY, drift=0.7)
    e = np.random.default_rng(1).normal(size=len(TIMES))
    root = np.linalg.cholesky(covariance(noise, TIMES))
    white = whitening(noise, TIMES).effects(e[:, None])[:, 0]
    np.testing.assert_allclose(white, np.linalg.solve(root, e), rtol=1e-12)
