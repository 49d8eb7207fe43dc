"""Scores of predictions: worked by hand, and against the distributions that they stand for."""

import numpy as np
import pytest
from scipy.integrate import quad
from scipy.stats import binom, multivariate_normal, norm, t

from geoident.identify.assessment.scores import Innovations, changes, p_value, scores
from geoident.model.results.backtest import bands_of
from geoident.model.results.bands import Bands, next_read

HALF = 1.959963984540054


def bands(measured, mean, below, above):
    """Predictions with standard deviations below and above the mean."""
    measured, mean, below, above = (np.array(x, float) for x in (measured, mean, below, above))
    return Bands(measured, mean, mean - HALF * below, mean + HALF * above)


class TestOneBand:
    def test_errors_count_in_the_deviation_of_their_side(self):
        found = bands([[4.0, -1.0]], [[2.0, 2.0]], [[1.0, 1.0]], [[4.0, 4.0]])
        assert found.z[0] == pytest.approx([0.5, -3.0])
        assert found.inside.tolist() == [[True, False]]

    def test_a_symmetric_band_is_a_normal_density(self):
        found = bands([[1.7]], [[1.0]], [[0.5]], [[0.5]])
        assert found.log_density[0, 0] == pytest.approx(norm.logpdf(1.7, 1.0, 0.5))

    def test_an_asymmetric_density_has_95_percent_in_its_band(self):
        def density(y):
            return np.exp(bands([[y]], [[1.0]], [[0.5]], [[2.0]]).log_density[0, 0])

        low, high = 1.0 - HALF * 0.5, 1.0 + HALF * 2.0
        assert quad(density, -5.0, 20.0, points=[1.0])[0] == pytest.approx(1.0)
        assert quad(density, low, high, points=[1.0])[0] == pytest.approx(0.95)

    def test_the_interval_score_adds_40_times_what_is_beyond(self):
        one = Bands(*(np.array([[x]]) for x in (3.0, 1.0, 0.0, 2.0)))
        assert one.interval_score[0, 0] == pytest.approx(2.0 + 40.0)
        inside = Bands(*(np.array([[x]]) for x in (1.5, 1.0, 0.0, 2.0)))
        assert inside.interval_score[0, 0] == pytest.approx(2.0)


class TestScores:
    def test_by_hand(self):
        found = bands([[3.0, 4.0]], [[3.0, 3.0]], [[0.25, 0.25]], [[0.25, 0.25]])
        told = scores(found, np.array([0.5]), ["length"])
        size = np.sqrt((9.0 + 16.0) / 2.0)
        width = 2.0 * HALF * 0.25
        beyond = 40.0 * (4.0 - 3.0 - HALF * 0.25)
        assert (told.readings, told.inside, told.coverage) == (2, 1, 0.5)
        assert told.rms == pytest.approx(np.sqrt(16.0 / 2.0))  # 0 and 4 standard deviations
        assert told.sharpness == pytest.approx(width / size)
        assert told.interval_score == pytest.approx((width + beyond / 2.0) / size)
        expected = np.log(0.5 / (0.25 * np.sqrt(2.0 * np.pi))) - 8.0 / 2.0
        assert told.log_score == pytest.approx(expected)

    def test_units_do_not_matter(self):
        """A stress in Pa beside motions in m: each kind by its own size."""
        one = bands([[1.0], [2.0]], [[1.5], [2.5]], [[0.5], [1.0]], [[0.5], [1.0]])
        factor = np.array([[1.0], [1e6]])
        other = Bands(*(x * factor for x in (one.measured, one.mean, one.lower95, one.upper95)))
        kinds, accuracy = ["length", "pressure"], np.array([[0.1], [0.2]])
        first = scores(one, accuracy, kinds)
        second = scores(other, accuracy * factor, kinds)
        for name in ("rms", "sharpness", "interval_score", "log_score"):
            assert getattr(second, name) == pytest.approx(getattr(first, name))

    def test_of_nothing(self):
        told = scores(bands([[np.nan]], [[1.0]], [[1.0]], [[1.0]]), np.ones(1), ["length"])
        assert told.readings == 0
        assert np.isnan(told.coverage)

    def test_the_next_stage_is_the_first_that_was_read(self):
        found = bands(
            [[np.nan, np.nan, 1.0, 1.0], [np.nan, np.nan, np.nan, 1.0]], np.zeros((2, 4)),
            np.ones((2, 4)), np.ones((2, 4)),
        )  # fmt: skip
        assert np.argwhere(next_read(found)).tolist() == [[0, 2]]


def test_log_scores_of_next_readings_add_up_to_the_density_of_all():
    """The prequential identity: what comes after what was known, one by one, is everything."""
    random = np.random.default_rng(3)
    c, s, prior = np.array([1.0, 0.7, 2.0, 1.5]), 0.3, 2.0
    y = c * 1.2 + s * random.standard_normal(4)
    total = 0.0
    for k in range(4):
        precision = prior**-2 + np.sum(c[:k] ** 2) / s**2
        mean = (c[:k] @ y[:k]) / s**2 / precision * c[k]
        sd = np.sqrt(c[k] ** 2 / precision + s**2)
        total += bands([[y[k]]], [[mean]], [[sd]], [[sd]]).log_density[0, 0]
    covariance = prior**2 * np.outer(c, c) + s**2 * np.eye(4)
    assert total == pytest.approx(multivariate_normal.logpdf(y, np.zeros(4), covariance))


class TestChance:
    def test_of_independent_errors_is_binomial(self):
        z = np.array([0.1, 2.5, -3.0, 0.4, 1.0, -0.3])  # four of six inside
        assert p_value([Innovations(z, np.eye(6))]).few == pytest.approx(
            binom.cdf(4, 6, 0.95), abs=0.004
        )

    def test_errors_that_are_one_are_all_outside_as_often_as_one(self):
        z, R = np.full(10, 2.5), np.ones((10, 10))
        assert p_value([Innovations(z, R)]).few == pytest.approx(0.05, abs=0.005)
        assert p_value([Innovations(z, np.eye(10))]).few < 1e-3

    def test_one_error_that_is_far_off_is_seen_among_many(self):
        z = np.zeros(20)
        z[3] = 9.0
        found = p_value([Innovations(z, np.eye(20))])
        assert found.few > 0.3
        assert found.far < 1e-3

    def test_fits_count_as_independent(self):
        one = Innovations(np.array([2.5, 2.5]), np.ones((2, 2)))
        assert p_value([one]).few == pytest.approx(0.05, abs=0.005)
        assert p_value([one, one]).few == pytest.approx(0.05**2, abs=0.0015)

    def test_estimated_accuracies_make_large_errors_less_rare(self):
        """One reading from an accuracy with 5 degrees of freedom: Student's distribution."""
        z, R = np.array([3.0]), np.ones((1, 1))
        assert p_value([Innovations(z, R, 5.0)]).far == pytest.approx(2 * t.sf(3.0, 5), abs=0.004)
        assert p_value([Innovations(z, R)]).far == pytest.approx(2 * norm.sf(3.0), abs=0.001)

    def test_of_nothing(self):
        assert (p_value([]).few, p_value([]).far) == (1.0, 1.0)


def test_changes_of_a_mean_that_grows_are_independent_standard_normal():
    random = np.random.default_rng(8)
    y = random.standard_normal((4000, 12))
    counts = np.array([2, 4, 7, 12])
    means = np.stack([y[:, :n].mean(axis=1) for n in counts], axis=1)
    z = np.array([changes(x, 1.0 / counts) for x in means])
    assert np.std(z, axis=0) == pytest.approx(np.ones(3), abs=0.04)
    assert np.corrcoef(z.T) == pytest.approx(np.eye(3), abs=0.05)


def test_a_change_without_information_is_not_blown_up():
    z = changes(np.array([1.0, 1.02]), np.array([0.01, 0.01]))
    assert abs(z[0]) == pytest.approx(0.02 / (0.2 * 0.1))


def test_bands_of_a_step_stand_beside_what_was_read():
    class Told:
        mean, lower95, upper95 = np.zeros((1, 1)), -np.ones((1, 1)), np.ones((1, 1))

    class Step:
        prediction = Told

    class Whole:
        measured = np.full((1, 1), 0.5)

    assert bands_of(Whole, Step).inside.all()
