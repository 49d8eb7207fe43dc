"""Readings of a reduced model, what is rounding of them, and what they cost."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest
from support.sums import CHANNELS, summed_model

from geoident.errors import ModelError
from geoident.forward.gauges.zeros import ReadingRule
from geoident.forward.reduced.duals.bounds import ReadingBounds
from geoident.forward.reduced.response import ROUNDING, ReadingsAsked, ReducedResponse

VALUES = np.array([[1.1, 4.6], [2.3, 3.1], [9.0, 1.0]])
ROWS, STATES = np.array([1, 2, 0, 1]), np.array([1, 3, 2, 3])
ZERO = np.array([0, 1, 2])
WEIGHTS = np.array([[1.0, 1.0, 1.0], [-1.0, -1.0, 0.0]])
ADDED = np.array([[0.5, 0.0, 2.0], [0.0, 0.0, 0.0], [-1.0, 3.0, 0.0], [0.25, 1.0, -1.0]])
KINDS = ("length", "pressure", "length", "force")


def _observation():
    return ReadingRule(("a", "b", "c"), ZERO, WEIGHTS, np.ones((4, CHANNELS), dtype=bool))


def _inside(p):
    return "too large" if p[0] > 5.0 else None


class _Duals:
    """Corrections and errors that are given, one row for each of the values."""

    def __init__(self, correction, error, rounding):
        self.correction, self.error, self.rounding = correction, error, rounding

    def bounds(self, found, energy):
        count = len(found.at.loads)
        return ReadingBounds(self.correction[:count].copy(), self.error[:count].copy())


def _response(duals=None, dimensions=KINDS):
    asked = ReadingsAsked(ROWS, STATES, ADDED, dimensions)
    bases = np.array([0, 0, 1, 1])
    return ReducedResponse(summed_model(), _observation(), asked, bases, _inside, duals)


def _readings(p):
    """By what channels see, with weights of stage and zero, and what instruments add."""
    model = summed_model()
    seen = model.observed(model.states(p[None], derivatives=False))[:, :, 0, 0]
    found = []
    for row, state, added in zip(ROWS, STATES, ADDED, strict=True):
        value = WEIGHTS[0, row] * seen[state, row]
        value += WEIGHTS[1, row] * seen[ZERO[row], row]
        found.append(value + added[0] + added[1:] @ (p - model.reference))
    return np.array(found)


def test_readings_are_those_of_channels_against_their_zeros_and_of_instruments():
    response = _response()
    assert response.names == ("one", "two")
    for p in VALUES[:2]:
        v, J = response.evaluate(p)
        np.testing.assert_allclose(v, _readings(p), rtol=1e-12)
        np.testing.assert_array_equal(response.readings(p), v)
        for h in range(2):
            step = 1e-5 * np.eye(2)[h]
            slope = (_readings(p + step) - _readings(p - step)) / 2e-5
            np.testing.assert_allclose(J[:, h], slope, rtol=1e-5, atol=1e-6)
    table, energy = response.many(VALUES[:2])
    np.testing.assert_allclose(table, [_readings(p) for p in VALUES[:2]], rtol=1e-12)
    assert response.error(VALUES[1]) == pytest.approx(energy.relative[1], rel=1e-12)


def test_increments_are_what_each_stage_adds_to_what_is_seen():
    model = summed_model()
    seen = model.observed(model.states(VALUES[:1]))[:, :, 0, 0]
    base = [0, 0, 1, 1]
    exact = seen - seen[base]
    exact[0] = seen[0]
    np.testing.assert_allclose(_response().increments(VALUES[0]), exact, rtol=1e-12)


def test_every_vector_that_is_solved_for_is_counted_once():
    response = _response(_Duals(np.zeros((3, 4)), np.zeros((3, 4)), 0.0))
    assert response.counts.evaluations == 0
    response.evaluate(VALUES[0])
    response.readings(VALUES[0])
    response.error(VALUES[0])
    assert response.counts.evaluations == 1
    response.many(VALUES[:2])
    assert response.counts.evaluations == 3
    response.certified(VALUES)  # the last one is outside
    assert response.counts.evaluations == 5
    spent = response.counts
    assert (spent.factorizations, response.admissible(VALUES[2])) == (0, "too large")


def test_bounds_are_errors_and_corrections_and_what_is_rounding():
    """Of the largest reading of the same dimension."""
    correction = np.array([[1.0, -2.0, 0.5, 0.0], [0.25, 3.0, -4.0, 1.0]])
    error = np.array([[0.125, 0.5, 0.0, 2.0], [1.0, 0.0, 3.0, 0.5]])
    for rounding in (0.0, 0.01):
        response = _response(_Duals(correction, error, rounding))
        table, bound = response.certified(VALUES)
        assert np.isnan(table[2]).all()
        assert np.isnan(bound[2]).all()
        for n, p in enumerate(VALUES[:2]):
            v = np.abs(_readings(p))
            largest = np.array([max(v[0], v[2]), v[1], max(v[0], v[2]), v[3]])
            exact = error[n] + np.abs(correction[n]) + (ROUNDING + rounding) * largest
            np.testing.assert_allclose(bound[n], exact, rtol=1e-12)
            np.testing.assert_allclose(table[n], _readings(p), rtol=1e-12)
    assert ROUNDING == 1e-10


def test_without_adjoints_there_are_no_bounds():
    with pytest.raises(ValueError, match="has no adjoints of these readings"):
        _response().certified(VALUES)


def test_outside_the_domain_nothing_is_asked_of_the_model():
    response = _response(_Duals(np.zeros((3, 4)), np.zeros((3, 4)), 0.0))
    table, bound = response.certified(VALUES[2:])
    assert np.isnan(table).all()
    assert np.isnan(bound).all()
    assert response.counts.evaluations == 0


def test_what_is_rounding_is_seen_at_the_reference():
    """The largest part of a reading that neither model nor correction tells, by dimension."""
    model = summed_model()
    v = _readings(model.reference) - ADDED[:, 0]
    noise = np.array([3e-7, -5e-6, 2e-8, 0.0]) * np.abs(v).max()
    correction = np.array([[0.25, -0.5, 1.0, 2.0]])
    duals = _Duals(correction, np.zeros((1, 4)), 0.0)
    response = _response(duals)
    moved = v + correction[0] + noise
    response.see_rounding(moved)
    m = np.abs(moved)
    largest = np.array([max(m[0], m[2]), m[1], max(m[0], m[2]), m[3]])
    assert duals.rounding == pytest.approx(np.max(np.abs(noise) / largest), rel=1e-4)
    duals.rounding = 7.0
    response.see_rounding(np.zeros(4))
    assert duals.rounding == 7.0
    _response().see_rounding(moved)  # without adjoints there is nothing to find


def test_a_dimension_of_which_nothing_moves_rounds_nothing():
    duals = _Duals(np.zeros((1, 4)), np.zeros((1, 4)), 0.5)
    response = _response(duals)
    v = _readings(summed_model().reference) - ADDED[:, 0]
    response.see_rounding(v * np.array([1.0, 0.0, 1.0, 1.0]))
    assert duals.rounding < 1e-12


@pytest.mark.parametrize("error", [ValueError("left the span"), np.linalg.LinAlgError("singular")])
def test_a_model_without_answer_says_so(error):
    def fails(*_, **__):
        raise error

    form = SimpleNamespace(names=("one", "two"))
    broken = SimpleNamespace(form=form, states=fails, reference=np.zeros(2))
    asked = ReadingsAsked(ROWS, STATES, ADDED, KINDS)
    duals = _Duals(np.zeros((3, 4)), np.zeros((3, 4)), 0.0)
    response = ReducedResponse(broken, _observation(), asked, np.zeros(4, int), _inside, duals)
    with pytest.raises(ModelError, match=f"the reduced model has no answer: {error}"):
        response.evaluate(VALUES[0])
    table, bound = response.certified(VALUES)
    assert np.isnan(table).all()
    assert np.isnan(bound).all()


def test_without_bounds_of_stresses_their_error_is_infinite():
    def singular(_):
        raise np.linalg.LinAlgError

    model = summed_model()
    blind = SimpleNamespace(form=model.form, states=model.states, bounds=singular)
    asked = ReadingsAsked(ROWS, STATES, ADDED, KINDS)
    response = ReducedResponse(blind, _observation(), asked, np.zeros(4, int), _inside)
    assert response.error(VALUES[0]) == np.inf


def test_of_no_readings_there_are_none():
    none = np.zeros(0, dtype=np.int64)
    asked = ReadingsAsked(none, none, np.zeros((0, 3)), ())
    response = ReducedResponse(summed_model(), _observation(), asked, np.zeros(4, int), _inside)
    v, J = response.evaluate(VALUES[0])
    assert (v.shape, J.shape) == ((0,), (0, 2))
    assert response._largest(np.zeros((2, 0))).shape == (2, 0)
