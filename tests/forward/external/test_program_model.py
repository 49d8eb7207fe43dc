"""Readings that runs give: changes since zeros, given derivatives, what is asked and what fails."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from support.cases import displacement, make_case

from geoident.errors import ModelError
from geoident.forward.external.program import ProgramModel
from geoident.forward.external.runs import FailedRun
from geoident.model.case import Stage
from geoident.model.gauges import Reads
from geoident.model.mesh import Mesh
from geoident.model.parameter import Parameter, Scalar

NOWHERE = Mesh(np.empty((0, 2)), ())
PARAMETERS = (
    Parameter("E", 5.0, 1.0, 50.0, scale="log"),
    Parameter("K", 1.2, 0.3, 3.0),
    Parameter("b", 0.25, -4.0, 4.0),
)
P = np.array([7.0, 1.4, 0.5])
GIVEN = np.array([[1, 1, 1, 0], [1, 0, 1, 1], [1, 1, 1, 1]], dtype=bool)
SIZES = np.arange(1.0, 13.0).reshape(3, 4)


def channel(name, zero="virgin", **changes):
    return replace(displacement(name, (0.0, 0.0), (1.0, 0.0), zero=zero), **changes)


CHANNELS = (
    channel("plain", reads=Reads.VALUE, accuracy=2e-3),
    channel("since", offset=Scalar(1.0, "b")),
    channel("late", zero="b"),
    channel("lost", zero="a", accuracy=5e-4),
)


def whole(p):
    """(3, 4) readings: none is linear, none like another."""
    E, K = p[:2]
    return SIZES * K / E + SIZES**2 * K**2


def slopes(p):
    E, K = p[:2]
    by_E, by_K = -SIZES * K / E**2, SIZES / E + 2.0 * SIZES**2 * K
    return np.stack([by_E, by_K, np.zeros((3, 4))], axis=-1)


class FormulaRuns:
    """The formula as runs, with derivatives that may be scaled, or fail."""

    at_once = 3
    notes = ("of a formula",)

    def __init__(self, factors=None, fails=lambda p: False):
        self.seen, self.provided = np.array([True, True, False]), GIVEN
        self.factors, self.fails = factors, fails
        self.asked, self.derived = [], 0

    @property
    def has_jacobian(self):
        return self.factors is not None

    def written(self, p):
        return p

    def quantum(self, p):
        return 2.3e-16 * np.abs(p)

    def each(self, points, check):
        for p in points:
            check()
            self.asked.append(p.copy())
            yield FailedRun("no") if self.fails(p) else np.where(GIVEN, whole(p), np.nan)

    def jacobian(self, p, check):
        check()
        self.derived += 1
        return FailedRun("torn") if self.fails(p) else slopes(p) * self.factors


def model_of(runs):
    stages = tuple(Stage(name) for name in "abc")
    case = make_case(NOWHERE, parameters=PARAMETERS, stages=stages, channels=CHANNELS)
    return ProgramModel(case, runs)


READABLE = np.array([[0, 0, 0, 0], [1, 1, 0, 0], [1, 0, 1, 0], [1, 1, 1, 0]], dtype=bool)


def by_hand(p):
    """(4, 4) readings: of `since` with its offset, of `late` the change since b."""
    seen = np.concatenate([np.zeros((1, 4)), whole(p)])
    found = seen - np.array([0.0, 0.0, seen[2, 2], seen[1, 3]]) + [0.0, p[2], 0.0, 0.0]
    return np.where(READABLE, found, np.nan)


def by_hand_slopes(p):
    seen = np.concatenate([np.zeros((1, 4, 3)), slopes(p)])
    found = seen - np.stack([seen[0, 0], seen[0, 1], seen[2, 2], seen[1, 3]])
    found[:, 1, 2] = 1.0
    return np.where(READABLE[..., None], found, np.nan)


def test_what_can_be_read_and_why_not():
    model = model_of(FormulaRuns())
    np.testing.assert_array_equal(model.rule.readable, READABLE)
    first = "the model gives nothing before the first stage"
    there = "the model gives no reading of it there"
    later = "it is zeroed only at a later stage"
    zero = "the model gives no reading of it at its zero"
    expected = {
        "plain": [first, None, None, None],
        "since": [first, None, there, None],
        "late": [later, later, None, None],
        "lost": [later, there, zero, zero],
    }
    stages = ("virgin", *"abc")
    found = {name: [model.unreadable(name, stage) for stage in stages] for name in expected}
    assert found == expected
    assert model.n_dofs == (0, 0, 0, 0)
    assert model.notes == ("of a formula",)
    assert [state.base for state in model.sequence.states] == [0, 0, 1, 2]


@pytest.mark.parametrize("factors", [None, np.ones(3)])
def test_readings_and_derivatives_by_hand(factors):
    model = model_of(FormulaRuns(factors))
    survey = model.survey(P, fields=True)
    np.testing.assert_allclose(survey.computed, by_hand(P)[1:].T, rtol=1e-12)
    np.testing.assert_allclose(
        survey.sensitivity, by_hand_slopes(P)[1:].swapaxes(0, 1), rtol=1e-6, atol=1e-8
    )
    assert survey.increments.shape == (4, 4)
    np.testing.assert_array_equal(model.computed(P), survey.computed)
    pairs = [("late", "c"), ("plain", "b"), ("since", "c"), ("lost", "c")]
    response = model.response(pairs)
    places = ([3, 2, 3, 3], [2, 0, 1, 3])
    np.testing.assert_allclose(response.readings(P), by_hand(P)[places], rtol=1e-12)
    values, jacobian = response.evaluate(P)
    np.testing.assert_array_equal(values, response.readings(P))
    np.testing.assert_allclose(jacobian, by_hand_slopes(P)[places], rtol=1e-6, atol=1e-8)
    assert response.at_once == 3


def test_costs_are_the_points_that_runs_can_tell_apart():
    """The third parameter is not seen by the runs."""
    model = model_of(FormulaRuns())
    for p in (P, P, P + np.array([0.0, 0.0, 0.5]), P + np.array([0.1, 0.0, 0.0])):
        model.computed(p)
    assert model.counts.evaluations == 2
    assert model.values(P) == {"E": 7.0, "K": 1.4, "b": 0.5}


def test_a_parameter_that_is_no_number_is_not_admissible():
    model = model_of(FormulaRuns())
    assert model.admissible(P) is None
    assert model.admissible(P * [1.0, np.nan, 1.0]) == "a parameter is not finite"


def test_given_derivatives_are_tested_once():
    runs = FormulaRuns(np.ones(3))
    model = model_of(runs)
    np.testing.assert_allclose(model.linear(P).dv_dp, slopes(P)[GIVEN], rtol=1e-12)
    tested = len(runs.asked)
    model.linear(P * 1.1)
    assert len(runs.asked) == tested + 1
    assert not model.response([("plain", "a")]).sharpen(P)


@pytest.mark.parametrize(
    ("factors", "words"),
    [
        ((0.991, 1.009, 1.0), None),
        ((1.0, 1.012, 1.0), "those by K by 1.2 %"),
        ((0.93, 1.012, 1.0), "those by E by 7 %"),
        ((1.3, 0.5, 1.0), "those by K by 50 %"),
    ],
)
def test_given_derivatives_may_differ_by_a_hundredth(factors, words):
    model = model_of(FormulaRuns(np.array(factors)))
    if words is None:
        model.linear(P)
        return
    said = f"differ from differences of its readings, {words}"
    with pytest.raises(ModelError, match=said) as caught:
        model.linear(P)
    assert caught.value.fault.path == "model.jacobian"
    assert "remove 'jacobian'" in caught.value.hint


def test_a_derivative_that_should_be_zero_counts_as_wrong():
    """Of a parameter that no run sees differences are zero: any other derivative is beyond them."""
    runs = FormulaRuns(np.ones(3))
    runs.jacobian = lambda p, check: slopes(p) + np.array([0.0, 0.0, 1e-3])
    with pytest.raises(ModelError, match="those by b by"):
        model_of(runs).linear(P)


def test_runs_that_fail_are_errors():
    fails = FormulaRuns(np.ones(3), fails=lambda p: p[0] > 6.0)
    with pytest.raises(ModelError, match="The run of the model failed: no"):
        model_of(fails).linear(P)
    fails = FormulaRuns(np.ones(3))
    fails.jacobian = lambda p, check: FailedRun("torn", "00012")
    with pytest.raises(ModelError, match=r"derivatives of the model failed: torn \(00012\)"):
        model_of(fails).linear(P)
    alone = FormulaRuns(fails=lambda p: not np.allclose(p, P, rtol=1e-9))
    response = model_of(alone).response([("plain", "a")])
    response.readings(P)
    assert not response.sharpen(P)
