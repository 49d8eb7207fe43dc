"""Thousands of answers: by the reduced model where it is close enough, else by the model."""

from __future__ import annotations

import numpy as np
import pytest
from support.reduced import PAIRS_PLANE, plane, spread

from geoident.workflow.running.answers import Answer
from geoident.workflow.running.reduced_answers import CLOSE, ReducedAnswers, reduced_around


@pytest.fixture(scope="module")
def near():
    """The plane case with its reduced model around the start, and points some way around."""
    staged = plane()
    response = staged.response(PAIRS_PLANE)
    start = np.array([q.start for q in staged.case.parameters])
    training = spread(staged, 20, seed=9, part=0.3)
    return response, reduced_around(response, start, training), training


class Counting:
    """Answers of the model, counted."""

    def __init__(self, response) -> None:
        self.response, self.asked = response, 0

    def __call__(self, points):
        for p in points:
            self.asked += 1
            v = self.response.readings(p)
            yield Answer(v[:4], v[4:])


@pytest.mark.parametrize("accuracy", [1e-4, 1e-7, 1e-12])
def test_every_answer_is_close_to_that_of_the_model(near, accuracy):
    response, reduced, _ = near
    points = spread(plane(), 25, seed=10, part=0.4)
    limit = np.full(len(PAIRS_PLANE), CLOSE * accuracy)
    model = Counting(response)
    answers = ReducedAnswers(reduced, 4, limit, model)
    for p, answer in zip(points, answers(points), strict=True):
        found = np.concatenate([answer.used, answer.later])
        np.testing.assert_allclose(found, response.readings(p), rtol=0, atol=limit[0])
    assert answers.by_model == model.asked
    assert answers.by_reduced + answers.by_model == len(points)
    assert (answers.by_model == 0) == (accuracy == 1e-4)
    assert (answers.by_reduced == 0) == (accuracy == 1e-12)


def test_what_is_outside_the_domain_is_left_to_the_model(near):
    _, reduced, _ = near
    outside = spread(plane(), 3, seed=11, part=0.2)
    outside[1, 2] = 0.7  # Poisson's ratio

    def elsewhere(points):
        return (Answer(None, np.zeros(0)) for _ in points)

    answers = ReducedAnswers(reduced, 4, np.full(len(PAIRS_PLANE), 1e-3), elsewhere)
    assert [answer.used is None for answer in answers(outside)] == [False, True, False]


def test_how_many_are_whose_is_said(near):
    response, reduced, _ = near
    answers = ReducedAnswers(reduced, 4, np.full(len(PAIRS_PLANE), 1e-5), Counting(response))
    assert "full model" in answers.note
    list(answers(spread(plane(), 1200, seed=12, part=0.1)))
    assert answers.note.startswith("1,200 of 1,200 evaluations are those of a reduced model")
    assert "2 % of their accuracies" in answers.note
