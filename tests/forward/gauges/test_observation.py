"""What channels make of what they see of states: weights, zeros, steps, rows; by small tables."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest
import scipy.sparse as sp

from geoident.forward.analysis.stage import LinearRows
from geoident.forward.gauges.observation import AnalysisState, Observation, RelativeDisplacements

NAMES = ("moves", "presses", "shifts", "major", "given")
# a change since state 1, a value, a change since 3, what there was in the virgin state, a value
WEIGHTS = np.array([[1.0, 1.0, 1.0, 0.0, 1.0], [-1.0, 0.0, -1.0, 1.0, 0.0]])
ZERO = np.array([1, 0, 3, 0, 0])
READABLE = np.array(
    [[0, 1, 0, 1, 1], [1, 1, 0, 1, 0], [1, 0, 0, 1, 1], [0, 1, 1, 1, 1], [1, 1, 1, 0, 1]]
).astype(bool)
MOVING = sp.csr_array(np.arange(12.0).reshape(2, 6) + 1.0)


class _Pressing:
    """Three channels by stresses: two are linear, of the second values coincide."""

    rows = None

    def linear(self, state, wanted):
        if wanted[1]:
            return None
        return LinearRows(
            stress=sp.csr_array(np.array([[1.0, 2.0], [0.0, 0.0], [3.0, 5.0]])),
            members=sp.csr_array(np.array([[7.0], [0.0], [11.0]])),
        )

    def values(self, state):
        return state.end.u[:3] * np.array([[10.0], [100.0], [1000.0]])

    def coinciding(self, state):
        return ("presses", "major") if state.end.state != 2 else ()


PARTS = (
    (np.array([2, 0]), RelativeDisplacements(MOVING)),
    (np.array([1, 3, 4]), _Pressing()),
)


def _observation(parts=PARTS):
    return Observation(NAMES, ZERO, WEIGHTS, READABLE, parts, ("", "gone", "", "dry", "old"))


def _state(number=0, columns=2):
    u = np.arange(6.0 * columns).reshape(6, columns) + 1.0
    return AnalysisState(SimpleNamespace(u=u, state=number), None, None)


def test_values_stand_in_the_rows_of_their_channels():
    state = _state()
    found = _observation().values(state)
    u = state.end.u
    exact = np.zeros((5, 2))
    exact[[2, 0]] = MOVING @ u
    exact[[1, 3, 4]] = u[:3] * np.array([[10.0], [100.0], [1000.0]])
    np.testing.assert_array_equal(found, exact)


def test_readings_count_their_stage_and_their_zero():
    """States that do not count may be NaN; zeros beyond the last state seen are the last's."""
    observed = np.random.default_rng(1).standard_normal((5, 5, 3))
    rows, states = np.array([0, 1, 2, 3, 0, 4]), np.array([2, 3, 4, 2, 4, 1])
    found = _observation().readings(observed, rows, states)
    exact = [
        observed[2, 0] - observed[1, 0], observed[3, 1], observed[4, 2] - observed[3, 2],
        observed[0, 3], observed[4, 0] - observed[1, 0], observed[1, 4],
    ]  # fmt: skip
    np.testing.assert_array_equal(found, exact)
    tension_limit = observed.copy()
    tension_limit[0, 1] = tension_limit[2, 3] = tension_limit[0, 4] = np.nan
    np.testing.assert_array_equal(_observation().readings(tension_limit, rows, states), exact)
    short = _observation().readings(observed[:3], np.array([2, 0]), np.array([1, 2]))
    np.testing.assert_array_equal(
        short, [observed[1, 2] - observed[2, 2], observed[2, 0] - observed[1, 0]]
    )


def test_how_often_steps_and_states_count():
    """State 4 builds on 2, which builds on 1; 3 is a load case on the side of 1."""
    history = {0: {0}, 1: {0, 1}, 2: {0, 1, 2}, 3: {0, 1, 3}, 4: {0, 1, 2, 4}}
    built_on = np.array([[i in history[j] for j in range(5)] for i in range(5)])
    rows, states = np.array([0, 1, 2, 3]), np.array([4, 3, 4, 2])
    steps = _observation().steps(built_on, rows, states)
    np.testing.assert_array_equal(
        steps.T, [[0, 0, 1, 0, 1], [1, 1, 0, 1, 0], [0, 0, 1, -1, 1], [1, 0, 0, 0, 0]]
    )
    weights = _observation().weights_of_states(rows, states, 4)
    np.testing.assert_array_equal(
        weights.T, [[0, -1, 0, 0, 1], [0, 0, 0, 1, 0], [0, 0, 0, -1, 1], [1, 0, 0, 0, 0]]
    )
    assert _observation().weights_of_states(rows, states, 3).shape == (4, 4)
    same = _observation().weights_of_states(np.array([0]), np.array([1]), 2)
    np.testing.assert_array_equal(same, np.zeros((3, 1)))


def test_increments_are_what_is_seen_less_that_of_the_state_before():
    """Zero where a channel cannot be read then, or nothing was computed."""
    observed = np.random.default_rng(2).standard_normal((4, 5))
    observed[3, 4] = np.nan
    base = np.array([0, 0, 1, 1, 2])
    found = _observation().increments(observed, base)
    exact = np.zeros((5, 5))
    for state in range(4):
        for row in range(5):
            if not READABLE[state, row] or np.isnan(observed[state, row]):
                continue
            before = base[state]
            seen = READABLE[before, row] and state > 0
            exact[state, row] = observed[state, row] - (observed[before, row] if seen else 0.0)
    np.testing.assert_array_equal(found, exact)
    assert found.shape == (5, 5)


def test_rows_of_channels_that_read_displacements():
    observation = _observation()
    np.testing.assert_array_equal(
        observation.operator(np.array([0, 2, 0])).toarray(), MOVING.toarray()[[1, 0, 1]]
    )
    assert observation.operator(np.array([], dtype=np.int64)).shape == (0, 6)
    for rows in ([1], [0, 4], [3, 2]):
        with pytest.raises(ValueError, match="a channel reads more than displacements"):
            observation.operator(np.array(rows))
    assert observation.not_linear(np.array([0, 2])) is None
    said = "gauge '{}' reads something else than displacements"
    assert observation.not_linear(np.array([4, 0])) == said.format("given")
    assert observation.not_linear(np.array([3, 1])) == said.format("presses")
    assert not observation.displacements_only
    moving = Observation(NAMES[:1], ZERO, WEIGHTS, READABLE, PARTS[:1], ("",))
    assert moving.displacements_only


def test_channels_as_linear_functions_of_a_state():
    observation, state = _observation(), _state()
    found = observation.linear(state, np.array([4, 0, 1]))
    np.testing.assert_array_equal(
        found.u.toarray(), [np.zeros(6), MOVING.toarray()[1], np.zeros(6)]
    )
    np.testing.assert_array_equal(found.stress.toarray(), [[3.0, 5.0], [0.0, 0.0], [1.0, 2.0]])
    np.testing.assert_array_equal(found.members.toarray(), [[11.0], [0.0], [7.0]])
    assert observation.linear(state, np.array([0, 3])) is None
    moved = observation.linear(state, np.array([2]))
    assert moved.stress is None
    assert moved.members is None
    np.testing.assert_array_equal(moved.u.toarray(), MOVING.toarray()[:1])
    twice = Observation(
        ("a", "b", "c", "d"), ZERO, WEIGHTS, READABLE,
        ((np.array([3, 1]), RelativeDisplacements(MOVING)),
         (np.array([0, 2]), RelativeDisplacements(sp.csr_array(10.0 * MOVING)))),
        ("",) * 4,
    )  # fmt: skip
    whole = twice.linear(state, np.array([2, 3, 0])).u.toarray()
    dense = MOVING.toarray()
    np.testing.assert_array_equal(whole, [10 * dense[1], dense[0], 10 * dense[0]])
    both = twice.operator(np.array([0, 1, 2, 3])).toarray()
    np.testing.assert_array_equal(both, [10 * dense[0], dense[1], 10 * dense[1], dense[0]])


def test_principal_values_that_coincide_are_named_where_they_are_read():
    """Of 'presses', a value, where it can be read; of 'major' in the virgin state alone."""
    observation = _observation()
    assert observation.coinciding(_state(0)) == ("presses", "major")
    assert observation.coinciding(_state(1)) == ("presses",)
    assert observation.coinciding(_state(2)) == ()
    assert observation.coinciding(_state(3)) == ("presses",)
    assert observation._counts(0, 1)  # at its zero
    assert observation._counts(0, 2)
    assert not observation._counts(0, 3)  # not readable then
    assert not observation._counts(0, 0)


def test_why_a_channel_cannot_be_read():
    observation = _observation()
    later = "it is zeroed only at a later stage"
    assert observation.unreadable("moves", 0) == later
    assert observation.unreadable("moves", 1) is None
    assert observation.unreadable("shifts", 2) == later
    assert observation.unreadable("shifts", 3) is None
    assert observation.unreadable("presses", 2) == "gone"
    assert observation.unreadable("presses", 1) is None
    assert observation.unreadable("major", 4) == "dry"
    assert observation.unreadable("given", 1) == "old"


def test_motions_are_rows_times_displacements():
    moving, state = RelativeDisplacements(MOVING), _state(columns=3)
    np.testing.assert_array_equal(moving.values(state), MOVING.toarray() @ state.end.u)
    assert moving.linear(state, np.array([True, False])).u is MOVING
    assert moving.coinciding(state) == ()
