"""When a surrogate answers for a model, and when the model itself is asked.

The model is v = 2 p; the surrogate says v = 3 p, so that it is seen who has answered.
"""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from geoident.workflow.running.cached_response import (
    EXACT,
    CachedResponse,
    answered_approximately,
    substituting,
)

from .test_remember import Notebook, Spring


class Replaceable(Spring):
    """A spring with a surrogate of a given error."""

    def __init__(self, error):
        super().__init__()
        self.error = error

    def evaluation(self, p, *, derivatives=True):
        increments = np.array([[0.0], [2.0 * p[0]]])
        return replace(super().evaluation(p, derivatives=derivatives), increments=increments)

    def surrogate_obstacle(self):
        return None

    def visited(self):
        return ()

    def surrogate(self, visited):
        return SimpleNamespace(
            error=lambda p: self.error,
            evaluate=lambda p: (3.0 * p, np.array([[3.0]])),
            increments=lambda p: np.array([[0.5 * p[0]], [2.5 * p[0]]]),
        )


FIRST, P = np.array([1.0]), np.array([2.0])


def begun(error):
    """A response that was evaluated once; before, there is no surrogate."""
    inner = Replaceable(error)
    response = CachedResponse(inner, Notebook(), before=lambda: None)
    with substituting(response):
        assert response.evaluate(FIRST)[0] == 2.0
    return inner, response


@pytest.mark.parametrize(
    ("error", "exact", "answers"),
    [(0.9e-6, EXACT, True), (1.1e-6, EXACT, False), (np.nan, EXACT, False), (1.1e-9, 1e-9, False)],
)
def test_its_error_tells_who_answers(error, exact, answers):
    inner, response = begun(error)
    with substituting(response, exact):
        v, dv_dp = response.evaluate(P)
        assert response.readings(P) == v
        assert response.increments(P).tolist() == ([[1.0], [5.0]] if answers else [[0.0], [4.0]])
    factor = 3.0 if answers else 2.0
    assert (v[0], dv_dp[0, 0]) == (factor * P[0], factor)
    assert answered_approximately(response, P) == answers
    assert inner.counts.evaluations == (1 if answers else 2)


def test_who_is_not_led_asks_the_model():
    _, response = begun(0.9e-9)
    with substituting(response):
        response.evaluate(P)
    assert response.evaluate(P)[0] == 2.0 * P
    assert not answered_approximately(response, P)
    with substituting(response):
        assert response.evaluate(P)[0] == 2.0 * P  # the model has answered
