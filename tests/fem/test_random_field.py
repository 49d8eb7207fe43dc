"""Random fields: covariance, values at points and modes against dense formulas and GSTools."""

import numpy as np
import pytest
from scipy.special import gamma, kv

from geoident.fem.random_field import (
    Conditioning,
    Matern,
    conditioning,
    matern,
    principal_modes,
    scaling_of,
)

TURNED = np.array([[np.cos(0.5), 0, -np.sin(0.5)], [np.sin(0.5), 0, np.cos(0.5)]])
FIELD = Matern(0.3, scaling_of(TURNED, np.array([20.0, 20.0, 5.0])))
AT = np.array([[0.0, 0.0], [10.0, 3.0], [-4.0, 8.0]])
VALUES, NOISE = np.array([0.1, -0.2, 0.25]), np.array([0.0, 0.01, 0.0025])


def scattered(n=300, dim=2, seed=1):
    return np.random.default_rng(seed).uniform(-30, 30, size=(n, dim))


def free(points):
    return Conditioning(np.zeros((len(points), 0)), np.zeros((0, len(points))))


def dense(field, points, given):
    return field.between(points, points) - given.factor.T @ given.factor


@pytest.mark.parametrize("nu", [0.5, 0.8, 1.5, 2.5, 3.7])
def test_matern_is_that_of_the_books(nu):
    r = np.array([1e-3, 0.1, 0.5, 1.0, 3.0])
    x = np.sqrt(2 * nu) * r
    assert matern(r, nu) == pytest.approx(2 ** (1 - nu) / gamma(nu) * x**nu * kv(nu, x), rel=1e-12)
    assert matern(np.zeros(1), nu) == 1.0


def test_lengths_go_along_their_axes():
    """A length along axis 1 away the correlation is that of r = 1, along axis 3 of a fourth."""
    start, along, across = np.zeros((1, 2)), 20 * TURNED[:, 0], 5 * TURNED[:, 2]
    ends = np.array([along, across, 4 * across])
    expected = 0.09 * matern(np.array([1.0, 1.0, 4.0]), 1.5)
    assert FIELD.between(start, ends)[0] == pytest.approx(expected, rel=1e-12)


def test_values_at_points_give_what_gstools_gives(verification):
    """Mean and variance of gstools.krige.Simple (1.7.0): Matern of rescale sqrt(2), angle 0.5."""
    points = np.array([[1.0, 1.0], [6.0, -2.0], [-3.0, 7.5], [30.0, 10.0]])
    found = conditioning(FIELD, points, AT, NOISE)
    mean, variance = found.weights @ VALUES, 0.09 - np.sum(found.factor**2, axis=0)
    means = [0.1015854, -0.1154066, 0.2396764, -0.0886661]
    variances = [0.00255093, 0.04539872, 0.0092916, 0.07871898]
    assert mean == pytest.approx(means, abs=1e-7)
    assert variance == pytest.approx(variances, abs=1e-8)
    places = [f"{x:g}, {y:g}" for x, y in points]
    verification("gstools", "mean", places, exact=means, found=mean)
    verification("gstools", "variance", places, exact=variances, found=variance)


def test_an_exact_value_is_met_and_leaves_nothing():
    found = conditioning(FIELD, AT[:1], AT, NOISE)
    assert found.weights @ VALUES == pytest.approx(VALUES[:1], abs=1e-6)
    assert 0.09 - np.sum(found.factor**2) == pytest.approx(0.0, abs=1e-9)


@pytest.mark.parametrize("dim", [2, 3])
@pytest.mark.parametrize("tests", [False, True])
def test_modes_are_the_principal_ones_of_the_exact_covariance(dim, tests):
    field = Matern(0.3, np.eye(dim) / 12.0)
    points = scattered(dim=dim)
    at = np.array([np.zeros(dim), np.full(dim, 9.0)])
    given = conditioning(field, points, at, np.zeros(2)) if tests else free(points)
    exact = dense(field, points, given)
    modes = principal_modes(field, points, given, explained=0.99, most=300)
    sizes = np.sort(np.linalg.eigvalsh(exact))[::-1]
    held = np.cumsum(sizes) / np.trace(exact)
    n = modes.shapes.shape[1]
    least = int(np.searchsorted(held, 0.99)) + 1
    assert least <= n <= 1.05 * least + 1
    assert 0.99 <= modes.explained <= held[n - 1] + 1e-9
    assert np.sum(modes.shapes**2, axis=0)[:10] == pytest.approx(sizes[:10], rel=0.01)
    inner = modes.shapes.T @ modes.shapes
    assert inner - np.diag(np.diag(inner)) == pytest.approx(0, abs=1e-10 * inner[0, 0])
    left = exact - modes.shapes @ modes.shapes.T
    assert np.trace(left) == pytest.approx((1 - modes.explained) * np.trace(exact), rel=1e-6)
    assert np.linalg.eigvalsh(left).min() > -1e-9


def test_a_maximum_keeps_the_largest_and_says_what_they_hold():
    points = scattered()
    few = principal_modes(FIELD, points, free(points), explained=0.99, most=8)
    sizes = np.sort(np.linalg.eigvalsh(dense(FIELD, points, free(points))))[::-1]
    assert few.shapes.shape == (300, 8)
    assert few.explained == pytest.approx(np.sum(few.shapes**2) / (300 * 0.09), rel=1e-9)
    assert few.explained > 0.9 * sizes[:8].sum() / (300 * 0.09)


def test_nothing_varies_where_everything_was_measured():
    points = scattered(n=5)
    given = conditioning(FIELD, points, points, np.zeros(5))
    modes = principal_modes(FIELD, points, given, explained=0.99, most=10)
    assert modes.shapes.shape == (5, 0)
