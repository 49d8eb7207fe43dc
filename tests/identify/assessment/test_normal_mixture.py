"""Quantiles of mixtures of normals, against the distribution function of scipy."""

import numpy as np
import pytest
from scipy.stats import chi2, norm, t

from geoident.identify.assessment.normal_mixture import mixture_interval

SIZES = np.array([1.0, 1e-3, 1e-7])


def test_the_interval_of_a_table_of_mixtures_holds_95_percent_of_each():
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
    means[0, 0, 1] = np.inf
    expected = [[False, True], [True, False]]
    assert np.isnan(mixture_interval(odds, means, sds)).tolist() == [expected, expected]


@pytest.mark.parametrize(
    ("mean", "sd"),
    [
        ((0.3, 0.2, 0.1), (1.0, 1.0, 1.0)),
        ((-5.0, 0.0, 7.0), (0.1, 0.2, 0.1)),
        ((2.0, -1.0, 0.4), SIZES),
        ((0.0, 0.0, 0.0), SIZES),
        ((1e9, 1e9, -1e9), 1e9 * SIZES),
        ((0.0, 0.0, 0.0), (1e-13, 1.0, 1.0)),
    ],
)
def test_ends_are_where_the_probability_is_reached(mean, sd):
    """Of normals alike, far apart, and of sizes that differ by orders of magnitude."""
    weight, mean, sd = np.array([0.2, 0.5, 0.3]), np.array(mean), np.array(sd)
    for end, p in zip(mixture_interval(weight, mean, sd), (0.025, 0.975), strict=True):
        near = end + 1e-11 * sd.max() * np.array([-1.0, 1.0])[:, None]
        below, above = norm.cdf(near, mean, sd) @ weight
        assert below <= p * (1.0 + 1e-9)
        assert above >= p * (1.0 - 1e-9)


def test_normals_whose_variances_are_inverse_gamma_make_students_t():
    nu = 4.0
    u = (np.arange(4000) + 0.5) / 4000
    sd = np.sqrt(nu / chi2(nu).ppf(u))
    low, high = mixture_interval(np.full(4000, 1 / 4000), np.zeros(4000), sd)
    assert [low, high] == pytest.approx(t(nu).ppf([0.025, 0.975]).tolist(), rel=1e-3)
