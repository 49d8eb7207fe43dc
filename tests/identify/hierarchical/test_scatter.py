"""The posterior of scatters on its nodes, where it is a product of half normal densities."""

from types import SimpleNamespace

import numpy as np
import pytest

from geoident.identify.hierarchical.restricted_likelihood import (
    ScatterPosterior,
    most_likely,
    scatter_posterior,
)

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


def likelihood(centre, precision, none=np.inf):
    """-2 log L, a quadratic form of the logarithms of two scatters; `none` more where one is 0."""

    def minus_two_log(tau):
        if not tau.all():
            return none
        away = np.log(tau) - centre
        return float(away @ precision @ away)

    return SimpleNamespace(largest=np.array([10.0, 40.0]), minus_two_log=minus_two_log)


@pytest.mark.parametrize("first", np.linspace(-7.0, 2.0, 8))
def test_the_most_likely_scatters_are_at_the_minimum(first):
    """Wherever between the places that are tried it lies, and though one pulls the other along."""
    centre = np.array([first, 1.3])
    linear = likelihood(centre, np.array([[40.0, 25.0], [25.0, 30.0]]))
    found = most_likely(linear, np.ones(2), np.array([True, True]))
    np.testing.assert_allclose(np.log(found), centre, atol=1e-5)
    alone = most_likely(linear, np.array([1.0, 5.0]), np.array([True, False]))
    assert alone[1] == 5.0
    pulled = first - 25.0 / 40.0 * (np.log(5.0) - 1.3)
    np.testing.assert_allclose(np.log(alone[0]), pulled, atol=1e-5)


@pytest.mark.parametrize(("none", "zero"), [(0.2, False), (-0.2, True), (0.0, True)])
def test_a_scatter_is_zero_where_that_is_as_likely(none, zero):
    linear = likelihood(np.array([0.0, 1.3]), np.eye(2), none)
    found = most_likely(linear, np.exp([0.5, 1.3]), np.array([True, False]))
    assert (found[0] == 0.0) == zero
    assert found[0] == pytest.approx(0.0 if zero else 1.0, abs=1e-5)


def test_a_scatter_beyond_the_ends_of_what_is_tried_is_at_the_end():
    """A hundred-thousandth of the largest, and the largest."""
    for first, end in ((-30.0, 1e-4), (30.0, 10.0)):
        linear = likelihood(np.array([first, 1.3]), np.diag([1.0, 2.0]))
        found = most_likely(linear, np.exp([0.5, 1.3]), np.array([True, False]))
        assert found[0] == pytest.approx(end, rel=1e-5)


@pytest.mark.parametrize(
    ("weights", "ends"),
    [
        # half of each node lies below it: 0.95 is reached between nodes 3 and 4, at 3 + 0.01 / 0.05
        ([0.6, 0.3, 0.08, 0.02], (0.0, 3.2)),
        ([0.1, 0.2, 0.3, 0.4], (1.0, 4.0)),
        # shortest where 0.02 is below, at 1 + 0.01 / 0.025, and 0.97 below 4
        ([0.02, 0.03, 0.91, 0.02, 0.02], (1.4, 4.0)),
    ],
)
def test_the_interval_of_a_scatter_is_the_shortest_between_its_nodes(weights, ends):
    sizes = np.arange(1.0, len(weights) + 1)
    turned = np.arange(len(weights))[::-1]
    nodes = np.stack([np.ones(len(weights)), sizes], axis=1)[turned]
    found = ScatterPosterior(nodes, np.array(weights)[turned])
    assert found.interval(1) == pytest.approx(ends)
    twice = ScatterPosterior(
        np.concatenate([nodes, nodes]), np.tile(0.5 * np.array(weights)[turned], 2)
    )
    assert twice.interval(1) == pytest.approx(ends)
