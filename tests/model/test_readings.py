"""The wide tables of a result are views of the readings."""

import numpy as np
import pytest

from geoident.model.gauges import ReadingTable
from geoident.model.results.result import Diagnostics, GaugeTable

VALUE = np.array([1.0, 3.0, np.nan, 9.0, 5.0, 7.0])
SD = np.array([0.1, 0.2, 0.1, 0.1, 0.1, 0.3])


def table():
    """Two good readings and a bad one of A at the first stage; of B a blank, and a bad one."""
    return ReadingTable(
        channel=("A", "A", "B", "A", "B", "B"),
        gauge=("A", "A", "B", "A", "B", "B"),
        stage=("one", "one", "one", "one", "two", "one"),
        time=np.full(6, np.nan),
        value=VALUE,
        sd=SD,
        used=np.array([True, True, False, False, True, False]),
        bad=np.array([False, False, False, True, False, True]),
        reason=("", "", "no value was read", "hit", "", "hit"),
        computed=np.zeros(6),
    )


@pytest.fixture
def gauges():
    nowhere = np.zeros((2, 2))
    return GaugeTable(
        ("A", "B"), ("one", "two"), np.zeros((2, 2)), nowhere, nowhere, table(), ("A", "B"),
        ("length",) * 2, ("mm",) * 2, np.array([0.1, 0.2]),
    )  # fmt: skip


def test_several_good_readings_are_seen_as_their_weighted_mean(gauges):
    weight = 1.0 / SD[:2] ** 2
    assert gauges.measured[0, 0] == pytest.approx(weight @ VALUE[:2] / weight.sum(), rel=1e-15)
    assert gauges.sd[0, 0] == pytest.approx(weight.sum() ** -0.5, rel=1e-15)
    assert gauges.used.tolist() == [[True, False], [False, True]]
    assert np.isnan(gauges.measured[0, 1])


def test_a_bad_reading_is_seen_only_where_there_is_no_good_one(gauges):
    assert gauges.measured[1].tolist() == [7.0, 5.0]
    assert gauges.bad.tolist() == [[False, False], [True, False]]


def test_readings_of_one_place_keep_the_information_that_the_loss_leaves_them(gauges):
    """The place has what is left of all weights, not that of the reading farthest off."""
    t = np.array([0.5, -2.0, np.nan, np.nan, np.nan, np.nan])
    weight = np.array([1.0, 0.25, np.nan, np.nan, 0.5, np.nan])
    change = np.arange(6.0)[:, None]
    found = Diagnostics("huber", 1.0, 1.0, t, t, weight, np.full(6, 0.3), t**2, change)
    wide = found.wide(gauges)
    left = weight[:2] / SD[:2] ** 2
    assert wide.weight[0, 0] == pytest.approx(left.sum() / (1.0 / SD[:2] ** 2).sum(), rel=1e-15)
    assert wide.weight[1, 1] == 0.5
    assert wide.standardized[0, 0] == -2.0
    assert wide.leverage[0, 0] == pytest.approx(0.6)
    assert wide.influence[0, 0, 0] == 1.0
    assert np.isnan(wide.distance[0, 1])
