"""Between the ends of an axis readings follow a cubic, beyond them a straight line."""

import numpy as np
import pytest
from scipy.stats import norm

from geoident.errors import ModelError
from geoident.identify.hierarchical import bands
from geoident.identify.hierarchical.knowledge import FurtherSection, Interval95
from geoident.identify.problem.scaling import Scaling
from geoident.model.parameter import Parameter


def curve(z):
    """A reading that follows a cubic of the parameter, and one that it does not move."""
    return np.array([z + 0.3 * z**3, 4.0])


@pytest.mark.parametrize(
    ("known_from", "lowest"),
    [
        (-np.inf, -1.96 - 0.3 * 1.96**3),
        (-1.5, -1.3 - 0.96 * 1.9),  # by the tangent at -1, the next place that is tried
        (-0.01, -1.96),  # by the slope at the middle
    ],
)
def test_bands_follow_readings_that_are_not_linear(known_from, lowest):
    """The ends of the band are the readings at the ends of the parameter's interval."""
    scaling = Scaling([Parameter("a", 10.0, -np.inf, np.inf)])
    unit = scaling.reference[0]

    def evaluate(points):
        z = [(p[0] - 10.0) / unit for p in points]
        slopes = [np.array([[1.0 + 0.9 * x**2], [0.0]]) / unit for x in z]
        made = [(curve(x), slope) for x, slope in zip(z, slopes, strict=True)]
        return [one if x > known_from else None for x, one in zip(z, made, strict=True)]

    one = np.ones(1)
    none = Interval95(one, one, one, one)
    section = FurtherSection(
        10.0 * one, none, np.zeros((1, 1)), np.ones((1, 1, 1)), np.ones(1), scaling
    )
    found = bands.reading_bands(section, evaluate, np.array([0.0, 0.5]))
    np.testing.assert_array_equal(found.computed, curve(0.0))
    slope = 1.0 + 0.9 * 1.96**2
    assert found.upper95[0] == pytest.approx(curve(1.96)[0], abs=0.05 * slope)
    assert found.lower95[0] == pytest.approx(lowest, abs=0.05 * slope)
    ends = found.lower95[1], found.upper95[1]
    assert ends == pytest.approx((4.0 - 0.98, 4.0 + 0.98), abs=0.03)


TWO = Scaling([Parameter("a", 4.0, 0.5, 60.0, "log"), Parameter("b", -3.0, -20.0, 20.0)])
REFERENCE = 4.0  # of b: a tenth of its range
MEANS = np.array([[0.02, -0.03], [-0.05, 0.04]])
COVARIANCES = np.array([[[0.01, 0.004], [0.004, 0.02]], [[0.03, -0.01], [-0.01, 0.05]]])
WEIGHTS = np.array([0.3, 0.7])


def two(means=MEANS, covariances=COVARIANCES, weights=WEIGHTS, values=(4.0, -3.0)):
    none = Interval95(*[np.zeros(2)] * 4)
    return FurtherSection(np.array(values), none, means, covariances, weights, TWO)


def test_parameters_keep_to_their_bounds():
    """A band of the parameters themselves, beside a bound of each."""
    near = two(values=(59.0, -19.9))

    def evaluate(points):
        return [(p.copy(), np.eye(2)) for p in points]

    found = bands.reading_bands(near, evaluate, np.full(2, 1e-9))
    assert found.upper95[0] == pytest.approx(60.0, rel=0.01)  # along tangents of ln a
    assert found.lower95[1] == pytest.approx(-20.0, abs=0.05)


def test_bands_of_readings_that_are_linear_are_those_of_the_mixture():
    """Along both axes together; by its moments, and its quantiles by the normals themselves."""
    M = np.array([[1.0, 0.4], [-0.7, 2.0], [0.3, 0.2]])
    sd = np.array([0.05, 0.3, 0.01])

    def evaluate(points):
        x = [np.array([np.log(p[0] / 4.0), (p[1] + 3.0) / REFERENCE]) for p in points]
        return [
            (7.0 + M @ one, M / np.array([p[0], REFERENCE]))
            for one, p in zip(x, points, strict=True)
        ]

    found = bands.reading_bands(two(), evaluate, sd)
    np.testing.assert_array_equal(found.computed, np.full(3, 7.0))
    for g, row in enumerate(M):
        centres = MEANS @ row
        widths = np.sqrt([row @ one @ row + sd[g] ** 2 for one in COVARIANCES])
        for got, part in (
            (found.lower95[g], 0.025),
            (found.upper95[g], 0.975),
        ):
            below = WEIGHTS @ norm.cdf(got - 7.0, centres, widths)
            assert below == pytest.approx(part, abs=4.0 * np.sqrt(part * (1 - part) / 20000))


def test_a_band_holds_what_is_computed():
    """Where the distribution lies to one side of it."""
    far = two(np.array([[3.0, 0.0]]), np.diag([1e-4, 1e-4])[None], np.ones(1), (1.0, 0.0))

    def evaluate(points):
        return [(np.log(p[:1]), np.array([[1.0 / p[0], 0.0]])) for p in points]

    found = bands.reading_bands(far, evaluate, np.array([0.01]))
    assert found.lower95[0] == found.computed[0] == 0.0


def test_readings_are_needed_where_the_parameters_are_expected():
    with pytest.raises(ModelError, match="no solution at the parameters that are expected"):
        bands.reading_bands(two(), lambda points: [None] * len(points), np.ones(1))


def test_a_section_of_which_all_is_known_has_the_errors_of_its_readings():
    known = two(np.zeros((1, 2)), np.zeros((1, 2, 2)), np.ones(1))
    asked = []

    def evaluate(points):
        asked.extend(points)
        return [(p.copy(), np.eye(2)) for p in points]

    found = bands.reading_bands(known, evaluate, np.array([0.5, 2.0]))
    assert len(asked) == 1
    half = norm.ppf(0.975) * np.array([0.5, 2.0])
    np.testing.assert_allclose(found.upper95, np.array([4.0, -3.0]) + half, atol=0.05)
