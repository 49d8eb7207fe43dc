"""What readings share of their errors, from what a case says of its gauges."""

import numpy as np
import pytest

from geoident.model.gauges import Channel, ErrorParts, Reading
from geoident.workflow.running.readings import error_structure

DAY = 86400.0


def channel(name, gauge="", along=0.0, run="", **parts):
    errors = ErrorParts(**({"reading": 1e-4} | parts)) if parts else None
    accuracy = 1e-4 if errors is None else errors.total(along)
    place = {"first": None, "second": (0.0, along), "direction": (1.0, 0.0)}
    return Channel(
        name, gauge or name, "displacement", accuracy=accuracy, zero="virgin", errors=errors,
        run=run, along=along, **place,
    )  # fmt: skip


def covariance(rows):
    structure = error_structure(rows)
    B = structure.columns.toarray()
    return np.diag(structure.sd**2) + B @ B.T


def test_independent_readings_share_nothing():
    own = Reading("b", "s", 1.0, accuracy=3e-4)
    structure = error_structure([(channel("a"), Reading("a", "s", 1.0)), (channel("b"), own)])
    sd, shared = structure.stated
    assert sd.tolist() == [1e-4, 3e-4]
    assert shared is None
    assert structure.names == ()


def test_a_zero_is_shared_by_all_readings_of_its_channel_and_by_no_other():
    a, b = (channel(name, zero=3e-4) for name in "ab")
    rows = [
        (a, Reading("a", "s1", 0.0)),
        (b, Reading("b", "s1", 0.0)),
        (a, Reading("a", "s2", 0.0)),
    ]
    expected = np.diag([1e-7] * 3)
    expected[0, 2] = expected[2, 0] = 9e-8
    np.testing.assert_allclose(covariance(rows), expected)


def test_anchors_of_an_extensometer_share_its_head_at_a_stage():
    anchors = [channel(f"X.{k}", "X", head=2e-4) for k in (1, 2)]
    other = channel("Y.1", "Y", head=2e-4)
    rows = [(c, Reading(c.name, stage, 0.0)) for stage in ("s1", "s2") for c in (*anchors, other)]
    shared = np.zeros((6, 6))
    for group in ([0, 1], [2], [3, 4], [5]):
        shared[np.ix_(group, group)] = 4e-8
    np.testing.assert_allclose(covariance(rows), shared + 1e-8 * np.eye(6), atol=1e-20)


def test_gauges_of_one_survey_share_its_set_up_on_a_day():
    together = [channel(name, epoch=2e-4, survey="monday") for name in "ab"]
    alone = channel("c", epoch=2e-4)
    times = [10.2 * DAY, 10.9 * DAY, 11.1 * DAY]
    rows = [(c, Reading(c.name, "s", 0.0, time=t)) for t in times for c in (*together, alone)]
    shared = np.zeros((9, 9))
    for group in ([0, 1, 3, 4], [2, 5], [6, 7], [8]):
        shared[np.ix_(group, group)] = 4e-8
    np.testing.assert_allclose(covariance(rows), shared + 1e-8 * np.eye(9), atol=1e-20)


def test_errors_along_a_casing_are_a_random_walk_from_its_reference_end():
    places = [0.0, 0.5, 2.0, 12.5, 30.0]
    casing = [channel(f"I.A{x}", "I", along=x, run="I.A", zero=1e-4) for x in places]
    casing = [Channel(**{**c.__dict__, "errors": ErrorParts(1e-4, along=2e-4)}) for c in casing]
    order = [3, 0, 4, 2, 1]
    rows = [(casing[k], Reading(casing[k].name, "s", 0.0)) for k in order]
    x = np.array(places)[order]
    expected = 1e-8 * np.eye(5) + 4e-8 * np.minimum.outer(x, x)
    np.testing.assert_allclose(covariance(rows), expected, atol=1e-20)
    # 1.24 mm in 30 m is what Mikkelsen (2003) found; ours with the error of a reading
    assert casing[4].sd(Reading("I.A30.0", "s", 0.0)) == pytest.approx(1.1e-3, rel=0.01)
    apart = [*rows, (casing[4], Reading("I.A30.0", "later", 0.0))]
    assert covariance(apart)[:5, 5].max() == 0.0


def test_means_average_what_each_day_has_and_not_the_zero():
    one = channel("a", zero=3e-4, epoch=2e-4)
    mean = Reading("a", "s", 0.0, count=8, epochs=4)
    assert one.own_sd(mean) == pytest.approx(1e-4 / 8**0.5)
    expected = (1e-8 / 8 + 9e-8 + 4e-8 / 4) ** 0.5
    assert one.sd(mean) == pytest.approx(expected)
    assert covariance([(one, mean)])[0, 0] == pytest.approx(expected**2)
    own = Reading("a", "s", 0.0, accuracy=5e-4)  # a reading with its own accuracy keeps it
    assert one.sd(own) == pytest.approx((25e-8 + 13e-8) ** 0.5)


def test_estimated_parts_are_components_of_their_kind():
    estimated = (("reading", "displacement: reading"), ("zero", "displacement: reading"))
    a, b = (channel(name, zero=1e-4, estimated=estimated) for name in "ab")
    given = channel("c", epoch=1e-4)
    rows = [(a, Reading("a", "s", 0.0)), (b, Reading("b", "s", 0.0, accuracy=2e-4))]
    rows.append((given, Reading("c", "s", 0.0)))
    structure = error_structure(rows)
    assert structure.names == ("displacement: reading",)
    assert structure.component.tolist() == [0, -1, -1]
    assert structure.column_component.tolist() == [0, 0, -1]
    sd, shared = structure.at(np.log([4.0]))
    np.testing.assert_allclose(sd, [2e-4, 2e-4, 1e-4])
    np.testing.assert_allclose(shared.columns.toarray(), 1e-4 * np.diag([2.0, 2.0, 1.0]))
