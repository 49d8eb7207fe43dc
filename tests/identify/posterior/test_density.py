"""The density that is sampled, term by term, and the coordinates it is sampled in."""

from __future__ import annotations

import numpy as np
import pytest

from geoident.errors import CollapseError, ModelError
from geoident.identify.posterior.density import PosteriorDensity
from geoident.identify.problem.problem import Problem
from geoident.model.parameter import Parameter, Prior

MATRIX = np.array([[0.3, -0.2, 0.5, 0.1, 0.7, 0.4], [0.2, 0.6, -0.1, 0.9, 0.3, -0.5]])
MEASURED, SD = np.array([3.0, 5.0]), np.array([0.7, 1.3])
PARAMETERS = (
    Parameter("log", 3.0, 1.0, 9.0, "log"),
    Parameter("held", 2.0, 2.0, 2.0),
    Parameter("wide", 4.0, 1.5, 6.0, "linear"),
    Parameter("narrow", 4.0, 3.0, 6.0, "linear", Prior(4.5, 0.8, "lognormal")),
    Parameter("normal", 5.0, 2.0, 8.0, "log", Prior(4.0, 1.5)),
    Parameter("lognormal", 3.0, 1.0, 7.0, "linear", Prior(2.5, 0.6, "lognormal")),
)
"""In u: ln p, -, ln p (flat in p), p / r (one in ln p), ln p (one in p), ln p (one in ln p)."""

R = 3.0
"""Reference of ``narrow``: its width."""

P = np.array([2.0, 2.0, 3.0, 4.2, 6.0, 1.7])


class Model:
    names = tuple(q.name for q in PARAMETERS)

    def __init__(self):
        self.asked = []

    def admissible(self, p):
        return "forbidden" if p[0] > 8.0 else None

    def readings(self, p):
        self.asked.append(p)
        if p[0] > 7.0:
            raise CollapseError("the ground collapses", stage="s", fraction=0.5)
        return MATRIX @ p**1.2

    def evaluate(self, p):
        return self.readings(p), MATRIX * 1.2 * p**0.2


@pytest.fixture
def problem():
    return Problem(Model(), MEASURED, SD, PARAMETERS)


def coordinates(p):
    return np.array([np.log(p[0]), np.log(p[2]), p[3] / R, np.log(p[4]), np.log(p[5])])


def logarithm(p):
    """Of the density in the coordinates: of the readings, of each prior in its own variable."""
    off = (MATRIX @ p**1.2 - MEASURED) / SD
    value = -0.5 * off @ off
    value += np.log(p[2])  # flat in p
    value += -0.5 * (np.log(p[3] / 4.5) / (0.8 / 4.5)) ** 2 - np.log(p[3])
    value += -0.5 * ((p[4] - 4.0) / 1.5) ** 2 + np.log(p[4])
    return value - 0.5 * (np.log(p[5] / 2.5) / (0.6 / 2.5)) ** 2


def test_coordinates_are_logarithms_where_the_bounds_are_a_factor_of_two_apart(problem):
    density = PosteriorDensity(problem)
    assert len(density) == 5
    assert density.free.tolist() == [True, False, True, True, True, True]
    np.testing.assert_allclose(density.coordinates(P), coordinates(P))
    np.testing.assert_allclose(density.natural(coordinates(P)[None])[0], P)
    lower, upper = (np.array([getattr(q, end) for q in PARAMETERS]) for end in ("lower", "upper"))
    np.testing.assert_allclose(density.lower, coordinates(lower))
    np.testing.assert_allclose(density.upper, coordinates(upper))
    far = density.natural(np.stack([density.lower - 9.0, density.upper + 1e4]))
    np.testing.assert_array_equal(far, [lower, upper])


def test_the_density_is_that_of_readings_and_priors_in_their_variables(problem):
    density = PosteriorDensity(problem)
    rng = np.random.default_rng(0)
    u = rng.uniform(density.lower, density.upper, (7, 5))
    u[:, 0] = np.minimum(u[:, 0], np.log(6.9))
    expected = np.array([logarithm(p) for p in density.natural(u)])
    found = density.logarithms(u)
    np.testing.assert_allclose(found - found[0], expected - expected[0], rtol=1e-10)
    assert density.evaluations == 7
    at = density.logarithm(P, MATRIX @ P**1.2)
    assert at - found[0] == pytest.approx(logarithm(P) - expected[0])


def test_nothing_is_asked_outside_the_bounds_and_no_solution_has_no_density(problem):
    density = PosteriorDensity(problem)
    u = np.tile(coordinates(P), (5, 1))
    u[1, 2] = density.upper[2] + 1e-9
    u[2, 0], u[3, 0] = np.log(7.5), np.log(8.5)  # no solution; not admissible
    u[4, 4] = density.lower[4] - 1e-9
    found = density.logarithms(u)
    assert np.isfinite(found).tolist() == [True, False, False, False, False]
    assert np.all(found[1:] == -np.inf)
    assert density.evaluations == 3
    assert len(problem.response.asked) == 2
    assert np.all(density.logarithms(u[[1, 4]]) == -np.inf)
    assert (density.evaluations, len(problem.response.asked)) == (3, 2)


def test_rows_are_derivatives_by_the_coordinates(problem):
    """Of the residuals of readings and priors, by differences."""
    density = PosteriorDensity(problem)
    rows, phi = density.rows(P)
    assert density.evaluations == 1

    def residuals(u):
        p = density.natural(u[None])[0]
        return np.array([
            *(MATRIX @ p**1.2 - MEASURED) / SD,
            np.log(p[3] / 4.5) / (0.8 / 4.5),
            (p[4] - 4.0) / 1.5,
            np.log(p[5] / 2.5) / (0.6 / 2.5),
        ])  # fmt: skip

    u = coordinates(P)
    assert phi == pytest.approx(residuals(u) @ residuals(u))
    for j in range(5):
        step = 1e-6 * np.eye(5)[j]
        slope = (residuals(u + step) - residuals(u - step)) / 2e-6
        np.testing.assert_allclose(rows[:, j], slope, rtol=1e-6, atol=1e-8)
    with pytest.raises(ModelError, match="forbidden"):
        density.rows(np.array([8.5, *P[1:]]))
