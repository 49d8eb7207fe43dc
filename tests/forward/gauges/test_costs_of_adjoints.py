"""When adjoints cost less than tangents, counted by hand; which readings have none."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest
from support.load_cells import GAUGES, nailed

from geoident.errors import Fault
from geoident.forward.gauges.adjoints import ReadingAdjoints
from geoident.forward.gauges.kinds import reading_faults


@pytest.fixture(scope="module")
def staged():
    return nailed(*GAUGES)


def _adjoints(staged, *pairs):
    return staged.response(pairs).adjoints


def test_columns_are_counted_of_all_states_that_act_on_a_reading(staged):
    """Four states with the virgin one; n1 at the third acts on all, d at the first on two."""
    found = _adjoints(staged, ("n1", "go on"), ("d", "open"))
    assert found.last == 3
    assert found.columns(1) == (4 * 2, "tangents")  # 6 are not less than 1.5 times 4
    assert found.columns(2) == (4 + 6, "adjoints")
    assert found.columns(5) == (4 + 6, "adjoints")
    assert found.columns(0) == (4, "tangents")
    one = _adjoints(staged, ("n1", "go on"))
    assert one.columns(1) == (4 + 4, "adjoints")
    twice = _adjoints(staged, ("n1", "go on"), ("n1", "go on"), ("n2", "bolt"))
    assert twice.columns(2) == (4 + 4 + 3, "adjoints")
    three = _adjoints(staged, ("n1", "go on"), ("d", "go on"), ("n2", "bolt"))
    assert three.columns(1) == (4 * 2, "tangents")
    assert three.columns(2) == (4 + 11, "adjoints")
    assert (found.cost_less(1), found.cost_less(2)) == (False, True)


def test_without_readings_there_is_nothing_to_take_back(staged):
    none = _adjoints(staged)
    assert not none.cost_less(3)
    assert none.columns(3) == ((none.last + 1) * 4, "tangents")


def _stub(yields, last):
    """Three states; the ground of some of them yields."""
    states = [SimpleNamespace(materials={0: "rock", 1: f"of {n}"}) for n in range(3)]
    materials = {f"of {n}": SimpleNamespace(yields=n in yields) for n in range(3)}
    materials["rock"] = SimpleNamespace(yields=False)
    points = SimpleNamespace(n_strain=4, n_points=5)
    analysis = SimpleNamespace(
        sequence=SimpleNamespace(states=states),
        case=SimpleNamespace(materials=materials, start={}),
        systems=SimpleNamespace(
            discretization=SimpleNamespace(points=points, n_dofs=6),
            structures=SimpleNamespace(n_rows=2),
        ),
    )
    observation = SimpleNamespace(
        zero=np.zeros(2, int), weights=np.ones((2, 2)),
        linear=lambda state, rows: None if 1 in rows else rows,
    )  # fmt: skip
    return lambda row: ReadingAdjoints(analysis, observation, np.array([row]), np.array([1]), last)


def test_ground_that_yields_up_to_the_last_state_has_no_adjoints():
    for yields, last, why in (
        ((2,), 2, "of 2 yields"),
        ((2,), 1, None),
        ((0, 2), 1, "of 0 yields"),
        ((), 2, None),
    ):
        assert _stub(yields, last)(0).obstacle == why
    assert _stub((), 2)(1).obstacle == "a channel reads a principal stress"


def test_readings_of_states_at_which_a_gauge_cannot_be_read():
    """Those of faulty gauges, blank and bad ones are not judged."""

    def reading(channel, stage, value=1.0, *, bad=False):
        return SimpleNamespace(channel=channel, stage=stage, value=value, bad=bad,
                               location=f"{channel} {stage}")  # fmt: skip

    channels = [
        SimpleNamespace(name=name, key=("gauges", key))
        for name, key in (("a", "a"), ("b", "b"), ("b.1", "bb"), ("c", "c"))
    ]
    case = SimpleNamespace(
        stage_names=("virgin", "one", "two"),
        channels=channels,
        readings=[
            reading("a", "one"), reading("a", "two"), reading("a", "one", None),
            reading("a", "one", bad=True), reading("b", "one"), reading("b.1", "one"),
            reading("c", "one"),
        ],
    )  # fmt: skip
    observation = SimpleNamespace(unreadable=lambda c, state: "it is gone" if state == 1 else None)

    def fault(path):
        return Fault("some", "a fault", "", None, path=path)

    found = reading_faults(case, observation, [fault("gauges.b.at"), fault("gauges.c[1]")])
    assert [f.location for f in found] == ["a one", "b.1 one"]
    assert found[0].code == "unreadable-gauge"
    assert found[0].message == "gauge 'a' can't have been read at stage 'one': it is gone"
    assert "leave the value blank" in found[0].hint
    assert len(reading_faults(case, observation)) == 4
    assert len(reading_faults(case, observation, [fault("gauges.b")])) == 3
    assert len(reading_faults(case, observation, [fault("gauges")])) == 4
