"""The posterior of scatters on its nodes, where it is a product of half normal densities."""

from types import SimpleNamespace

import numpy as np
import pytest

from geoident.identify.hierarchical.restricted import scatter_posterior

SIZES = np.array([0.5, 2.0, 7.0, 1.0])


@pytest.mark.parametrize("free", [(0,), (1, 2), (0, 1, 2), (0, 1, 2, 3)])
def test_means_are_those_of_half_normal_densities(free):
    """On a grid for one or two, on Sobol's points for more; what is given stays."""
    linear = SimpleNamespace(
        largest=np.full(4, 100.0), minus_two_log=lambda tau: float(np.sum((tau / SIZES) ** 2))
    )
    tau = np.full(4, 1e-3)
    held = np.setdiff1d(range(4), free)
    found = scatter_posterior(linear, tau, np.isin(range(4), free))
    assert found.weights.sum() == pytest.approx(1.0)
    assert np.all(found.nodes >= 0.0)
    np.testing.assert_array_equal(found.nodes[:, held], 1e-3)
    chosen = list(free)
    means = found.weights @ found.nodes[:, chosen]
    np.testing.assert_allclose(means, SIZES[chosen] * np.sqrt(2.0 / np.pi), rtol=0.01)
    squares = found.weights @ found.nodes[:, chosen] ** 2
    np.testing.assert_allclose(squares, SIZES[chosen] ** 2, rtol=0.02)
