"""The surrogate of a response is a function of the parameter vectors that were visited."""

from __future__ import annotations

import numpy as np
from support.reduced import PAIRS_PLANE, plane, spread

from geoident.model.response import CERTAIN


def recording(**options):
    staged = plane(n=4)
    response = staged.response(PAIRS_PLANE)
    response.record(**{"economical": False, **options})
    return staged, response


def test_it_depends_on_what_was_visited_alone():
    """Whether the analyses were made before, in which order, and what else was visited."""
    staged, response = recording(most=3)
    visited = spread(staged, 4, seed=3)
    before, asked = response.surrogate(visited[:3]), 1.01 * visited[0]
    assert staged.counts.evaluations == 3
    for p in visited[::-1]:
        response.evaluate(p)
    after = response.surrogate(visited[:3])
    other = recording(most=3)[1].surrogate(visited[:3])
    for found in (after, other):
        np.testing.assert_array_equal(found.readings(asked), before.readings(asked))
        assert found.error(asked) == before.error(asked)
    assert not np.array_equal(
        response.surrogate(visited[:2]).readings(asked), found.readings(asked)
    )


def test_only_the_last_ones_count():
    staged, response = recording(most=2)
    visited = spread(staged, 3, seed=3)
    asked = 1.01 * visited[0]
    whole, last = response.surrogate(visited), response.surrogate(visited[1:])
    np.testing.assert_array_equal(whole.readings(asked), last.readings(asked))
    assert staged.counts.evaluations == 2


def test_an_evaluation_does_not_depend_on_the_surveys_before_it():
    """A survey may take displacements from the reduced model; an evaluation never does."""
    staged, response = recording()
    p = spread(staged, 1, seed=3)[0]
    response.surrogate([p])
    q = p * (1.0 + 1e-5)
    assert response.surrogate([p]).error(q) <= CERTAIN
    staged.survey(q, fields=True)
    expected = plane(n=4).response(PAIRS_PLANE).evaluate(q)
    for value, fresh in zip(staged.response(PAIRS_PLANE).evaluate(q), expected, strict=True):
        np.testing.assert_array_equal(value, fresh)
