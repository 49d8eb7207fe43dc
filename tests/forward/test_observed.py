"""What all models share, by a model of three states and two channels that is a formula.

What channels see is x_jc = (j + 1)(c + 1) a^2, so that all can be said by hand: 'roof' reads the
change since 'first', with an offset b and a drift of b a day; 'cell' reads a value.
"""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest

from geoident.errors import CollapseError, ModelError
from geoident.forward.gauges.zeros import ReadingRule
from geoident.forward.observed import Details, Observed, ObservedModel
from geoident.model.parameter import Scalar

P = np.array([3.0, 0.5])
DAY = 86400.0


def channel(name, *, zeroed, **errors):
    none = {"ratio": None, "offset": None, "drift": None, "drift_per_stage": None}
    return SimpleNamespace(name=name, is_zeroed=zeroed, **{**none, **errors})


CHANNELS = (
    channel("roof", zeroed=True, offset=Scalar(1.0, "b"), drift=Scalar(1.0 / DAY, "b")),
    channel("cell", zeroed=False),
)


class Formula(ObservedModel):
    """Of a negative a there is none; beyond 10 the last stage has no equilibrium."""

    def __init__(self):
        case = SimpleNamespace(
            parameters=[SimpleNamespace(name=name) for name in "ab"], channels=CHANNELS,
            zero_of=lambda channel: 1 if channel.is_zeroed else 0,
            readings=(),
            stage_names=("virgin", "first", "second"),
            stages=(SimpleNamespace(goes_on=False),) * 2,
            times={"first": 0.0, "second": 2 * DAY},
        )  # fmt: skip
        readable = np.array([[1, 1], [1, 0], [1, 1]], dtype=bool)
        weights = np.array([[1.0, 1.0], [-1.0, 0.0]])
        rule = ReadingRule(("roof", "cell"), np.array([1, 0]), weights, readable)
        built_on = np.triu(np.ones((3, 3), dtype=bool))
        super().__init__(case, rule, built_on, np.array([0, 0, 1]))

    def observe(self, p, query):
        self.evaluations += 1
        a = p[0]
        size = np.outer([1.0, 2.0, 3.0], [1.0, 2.0])
        seen = np.stack([size * a**2, size * 2.0 * a, 0.0 * size], axis=2)
        failures = ()
        if a > 10.0:
            failures = (CollapseError("it falls", stage="second", fraction=None),)
            if not query.partial:
                raise failures[0]
            seen[2] = np.nan
        columns = 3 if query.derivatives else 1
        return Observed(seen[: query.last + 1, :, :columns], None, failures, Details(notes=("n",)))

    def why_unseen(self, state, row):
        return "it is wet"

    def domain_fault(self, p):
        return "a is negative" if p[0] < 0.0 else None


PAIRS = [("roof", "second"), ("cell", "second"), ("roof", "first")]


def by_hand(p, days):
    """Readings of the pairs and their derivatives."""
    a, b = p
    v = [a**2 + b * (1.0 + days), 6.0 * a**2, 0.0]
    return v, [[2.0 * a, 1.0 + days], [12.0 * a, 0.0], [0.0, 0.0]]


@pytest.mark.parametrize(("times", "days"), [((), 2.0), ((DAY, None, None), 1.0)])
def test_readings_are_changes_since_the_zero_with_offset_and_drift(times, days):
    model = Formula()
    response = model.response(PAIRS, times)
    v, jacobian = by_hand(P, days)
    np.testing.assert_allclose(response.readings(P), v, rtol=1e-14)
    found = response.evaluate(P)
    np.testing.assert_allclose(found[0], v, rtol=1e-14)
    np.testing.assert_allclose(found[1], jacobian, rtol=1e-14)
    assert (response.names, response.counts.evaluations) == (("a", "b"), 2)


def test_what_each_stage_adds_makes_the_reading():
    """But for what the instrument adds."""
    model = Formula()
    steps = model.steps(PAIRS)
    np.testing.assert_array_equal(steps.T, [[0, 0, 1], [1, 1, 1], [0, 0, 0]])
    increments = model.response(PAIRS).increments(P)
    np.testing.assert_allclose(increments, 9.0 * np.array([[1, 2], [1, 0], [1, 6]]))
    assert (steps[:, 0] @ increments[:, 0]) == pytest.approx(9.0)


def test_a_survey_has_all_readings_where_they_can_be_read():
    survey = Formula().survey(P, fields=False)
    v, jacobian = by_hand(P, 2.0)
    np.testing.assert_allclose(survey.computed, [[v[2], v[0]], [np.nan, v[1]]])
    np.testing.assert_allclose(survey.sensitivity[0, 1], jacobian[0])
    assert np.isnan(survey.sensitivity[1, 0]).all()
    assert (survey.notes, survey.collapses, survey.fields) == (("n",), {}, None)
    np.testing.assert_array_equal(Formula().computed(P), survey.computed)
    early = Formula().survey(P, fields=False, last=1).computed
    np.testing.assert_array_equal(early, [[0.0, np.nan], [np.nan, np.nan]])


def test_what_a_collapse_leaves_unknown_is_said():
    weak = np.array([11.0, 0.0])
    model = Formula()
    with pytest.raises(ModelError, match="it falls"):
        model.survey(weak, fields=False)
    with pytest.raises(ModelError, match="it falls"):
        model.response(PAIRS).readings(weak)
    survey = model.survey(weak, fields=False, partial=True)
    np.testing.assert_array_equal(survey.computed, [[0.0, np.nan], [np.nan, np.nan]])
    assert survey.collapses == {"it falls": "second"}
    np.testing.assert_array_equal(model.computed(weak), survey.computed)


def test_what_can_be_read_and_where_there_is_a_model():
    model = Formula()
    stages = ("virgin", "first", "second")
    assert [model.unreadable("roof", s) for s in stages] == [
        "it is zeroed only at a later stage", None, None,
    ]  # fmt: skip
    assert [model.unreadable("cell", s) for s in stages] == [None, "it is wet", None]
    assert model.admissible(P) is None
    assert model.admissible(-P) == "a is negative"
    assert model.admissible(P * [np.nan, 1.0]) == "a parameter is not finite"
    assert model.values(P) == {"a": 3.0, "b": 0.5}


@pytest.mark.parametrize(("weights", "seen"), [((0.0, 1.0), (7.0, np.nan)), ((1, 0), (np.nan, 7))])
def test_states_that_do_not_count_in_a_reading_may_be_unknown(weights, seen):
    """What was there in situ is known though the stage collapses."""
    rule = ReadingRule(("rock",), np.array([0]), np.array([weights]).T, np.ones((2, 1), bool))
    observed = np.array(seen)[:, None, None]
    assert rule.readings(observed, np.array([0]), np.array([1])).tolist() == [[7.0]]
