"""Samplings fill their space, on the scale of each value."""

import numpy as np
import pytest
from scipy.stats import kstest

from geoident.errors import Location
from geoident.model.campaign import SampledRange, Sampling
from geoident.workflow.campaign.sampling import sampled, unit_points

PLACE = Location("campaign.yaml", 1, 1)


@pytest.mark.parametrize("method", ["latin-hypercube", "sobol"])
def test_every_part_of_each_axis_holds_one_point(method):
    points = unit_points(method, 3, 64, seed=4)
    for axis in points.T:
        assert sorted((axis * 64).astype(int)) == list(range(64))
    assert np.array_equal(points, unit_points(method, 3, 64, seed=4))
    assert not np.array_equal(points, unit_points(method, 3, 64, seed=5))


def test_sobol_points_are_even_in_every_pair_of_axes():
    points = unit_points("sobol", 2, 64, seed=1)
    cells = {(int(8 * x), int(8 * y)) for x, y in points}
    assert len(cells) == 64


@pytest.mark.parametrize(
    ("kind", "first", "second", "distribution"),
    [
        ("linear", 2.0, 6.0, lambda x: (x - 2.0) / 4.0),
        ("log", 1.0, 100.0, lambda x: np.log10(x) / 2.0),
        ("normal", 3.0, 0.5, None),
        ("lognormal", 3.0, 0.6, None),
    ],
)
def test_values_have_their_distribution(kind, first, second, distribution):
    span = SampledRange("a.b", kind, first, second, "MPa", PLACE)
    runs = sampled(Sampling("latin-hypercube", 400, 2, (span,)), "case.yaml")
    texts = [dict(run.settings)["a.b"] for run in runs]
    assert all(text.endswith(" MPa") for text in texts)
    values = np.array([float(text.removesuffix(" MPa")) for text in texts])
    if distribution is None:
        values = np.log(values) if kind == "lognormal" else values
        mean, sd = (np.log(first), second / first) if kind == "lognormal" else (first, second)
        assert kstest((values - mean) / sd, "norm").statistic < 0.01
    else:
        assert kstest(distribution(values), "uniform").statistic < 0.01
    assert [run.name for run in runs[:2]] == ["0001", "0002"]
