"""When a reduced model answers for a model, and when as certainly as it: by bounds that are given.

The model is v = 2 p; the reduced one says v = 3 p, so that it is seen who has answered.
"""

from types import SimpleNamespace

import numpy as np
import pytest

from geoident.errors import ModelError
from geoident.workflow.estimating import search
from geoident.workflow.estimating.search import SearchState
from geoident.workflow.running.evaluation_log import (
    EXACT,
    Remembered,
    known_certainly,
    known_nearly,
    led,
    lent,
)

from .test_remember import Notebook, Spring


class Reducible(Spring):
    """A spring with a reduced model of a given error.

    Attributes:
        error: what its bound is.
        marches: number and whether it is kept, of each march that was announced.
        lends: where displacements were lent.
    """

    has_reduced_model = True

    def __init__(self, error):
        super().__init__()
        self.error, self.marches, self.lends, self.trouble = error, [], [], None

    def leap(self, p, key, find):
        reduced = SimpleNamespace(
            error=lambda p: self.error,
            evaluate=lambda p: (3.0 * p, np.array([[3.0]])),
            increments=lambda p: np.array([[0.5 * p[0]], [2.5 * p[0]]]),
        )
        return find(reduced)

    def increments(self, p):
        return np.array([[0.0], [2.0 * p[0]]])

    def march_again(self, visited):
        if self.trouble:
            raise self.trouble

    def expect_march(self, number, *, learns=True):
        self.marches.append((number, learns))

    def lend(self, p):
        self.lends.append(p)

    def remembers(self, p):
        pass


FIRST, P = np.array([1.0]), np.array([2.0])


def begun(error):
    """A response that was evaluated once; before, there is no reduced model."""
    inner = Reducible(error)
    response = Remembered(inner, Notebook(), before=lambda: None)
    with led(response):
        assert response.evaluate(FIRST)[0] == 2.0
    return inner, response


@pytest.mark.parametrize(
    ("error", "exact", "answers", "certain"),
    [
        (0.9e-6, EXACT, True, False),
        (1.1e-6, EXACT, False, False),
        (np.nan, EXACT, False, False),
        (1.1e-9, EXACT, True, False),
        (0.9e-9, EXACT, True, True),
        (0.9e-9, 1e-9, True, True),
        (1.1e-9, 1e-9, False, False),
    ],
)
def test_a_bound_tells_who_answers_and_how_certainly(error, exact, answers, certain):
    inner, response = begun(error)
    with led(response, exact):
        v, dv_dp = response.evaluate(P)
        assert response.readings(P) == v
        assert response.increments(P).tolist() == ([[1.0], [5.0]] if answers else [[0.0], [4.0]])
    factor = 3.0 if answers else 2.0
    assert (v[0], dv_dp[0, 0]) == (factor * P[0], factor)
    assert known_nearly(response, P) == answers
    assert known_certainly(response, P) == certain
    assert inner.counts.evaluations == (1 if answers else 2)
    assert lent(response, P) == certain
    assert len(inner.lends) == certain


def test_who_is_not_led_asks_the_model_which_need_not_learn_what_was_certain():
    inner, response = begun(0.9e-9)
    with led(response):
        response.evaluate(P)
    assert response.evaluate(P)[0] == 2.0 * P
    assert inner.marches == [(0, True), (1, False)]
    assert not known_nearly(response, P)
    assert len(response.visited()) == 1
    with led(response):
        assert response.evaluate(P)[0] == 2.0 * P  # the model has answered


def test_what_cannot_be_marched_again_is_not_lent():
    inner, response = begun(0.9e-9)
    with led(response):
        response.evaluate(P)
    inner.trouble = ModelError("no time")
    assert not lent(response, P)


@pytest.mark.parametrize(
    ("error", "asked"),
    [(0.9e-9, False), (1.1e-9, True), (0.9e-6, True), (1.1e-6, False)],
)
def test_a_search_that_was_led_asks_the_model_at_its_end(monkeypatch, error, asked):
    """Not where the model itself has answered, nor where the reduced one was certain."""
    _, response = begun(error)
    with led(response):
        response.evaluate(P)
    made = search._Search((), None)
    problem = SimpleNamespace(response=response, begun_at=lambda p: p)
    outcome = SimpleNamespace(status="converged", values=P)
    monkeypatch.setattr(search._Search, "descent", lambda self, problem: f"from {problem}")
    monkeypatch.setattr(search, "after", lambda first, again: again)
    found = made._confirmed(SearchState(None, problem, outcome))
    assert found.outcome == ("from [2.]" if asked else outcome)
