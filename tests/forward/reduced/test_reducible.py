"""When marches are kept for a reduced model, by whom, how many, and what is lent of it."""

from __future__ import annotations

import numpy as np
import pytest
from support.reduced import PAIRS_PLANE, plane, spread

EARLY = [("side", "heading")]


def started(**options):
    staged = plane(n=4)
    response = staged.response(PAIRS_PLANE)
    response.keep_marches(**{"economical": False, **options})
    return staged, response


def start_of(staged):
    return np.array([q.start for q in staged.case.parameters])


def marched(response):
    return [s.p.tolist() for s in response.reduction.snapshots]


def test_nothing_is_kept_unless_it_is_asked_for():
    staged = plane(n=4)
    response = staged.response(PAIRS_PLANE)
    assert response.reduction is None
    assert response.reduction_obstacle() is None
    assert not response.has_reduced_model
    response.evaluate(start_of(staged))
    assert response.reduced() is None
    assert (
        response.leap(start_of(staged), b"", lambda found: found.readings(start_of(staged))) is None
    )
    response.lend(start_of(staged))
    assert not staged.is_lent(start_of(staged))
    response.march_again([start_of(staged)])
    assert staged.counts.evaluations == 1


def test_what_is_kept_answers_and_is_lent():
    staged, response = started()
    assert response.has_reduced_model
    p = start_of(staged)
    assert response.reduced() is None
    response.lend(p)
    assert not staged.is_lent(p)
    values = response.evaluate(p)[0]
    found = response.leap(p, b"", lambda model: model.readings(p))
    np.testing.assert_allclose(found, values, atol=1e-8 * np.abs(values).max())
    near = 1.001 * p
    response.lend(near)
    assert staged.is_lent(near)
    assert not staged.is_lent(p)
    other = response.reduced(reference=near)
    size = np.abs(values).max()
    np.testing.assert_allclose(other.readings(p), values, atol=1e-7 * size)


def test_a_second_request_changes_nothing():
    _, response = started(most=3)
    first = response.reduction
    assert (first.most, first.economical) == (3, False)
    response.keep_marches(economical=True, most=7)
    assert response.reduction is first


@pytest.mark.parametrize(
    ("first", "second", "shared"),
    [
        ((PAIRS_PLANE, True), (EARLY, True), True),
        ((EARLY, True), (PAIRS_PLANE, True), False),  # it does not go as far
        ((PAIRS_PLANE, False), (EARLY, True), False),
        ((PAIRS_PLANE, True), (EARLY, False), False),
        ((EARLY, True), (EARLY, True), True),
    ],
)
def test_economical_searches_share_marches_that_go_as_far(first, second, shared):
    staged = plane(n=4)
    one, other = (staged.response(pairs) for pairs, _ in (first, second))
    one.keep_marches(economical=first[1])
    other.keep_marches(economical=second[1])
    assert (other.reduction is one.reduction) == shared
    third = staged.response(EARLY)
    third.keep_marches()
    latest = other.reduction
    if latest.economical:
        assert third.reduction is latest


def test_marches_that_are_not_to_be_learned_from_are_not_kept():
    staged, response = started()
    p = start_of(staged)
    response.expect_march(0, learns=False)
    response.by_tangents(p)
    assert marched(response) == []
    response.expect_march(1)
    assert response.reduction.number == 1
    response.by_tangents(p)
    assert marched(response) == [p.tolist()]
    response.by_tangents(p)
    assert marched(response) == [p.tolist()]


def test_a_search_that_goes_on_marches_again_where_it_was_last():
    """The newest of those that count, each once, in the order of the search."""
    staged, response = started(most=2)
    visited = spread(staged, 4, seed=3)
    response.by_tangents(visited[3])
    before = staged.counts.evaluations
    numbers = []
    expect = response.expect_march
    response.expect_march = lambda number, **more: numbers.append(number) or expect(number, **more)
    response.march_again(visited)
    assert numbers == [2]
    assert staged.counts.evaluations == before + 1
    assert marched(response) == [p.tolist() for p in visited[2:]]
    response.march_again(visited)
    assert numbers == [2]
    response.march_again(visited[:2])
    assert numbers == [2, 0, 1]
    assert marched(response) == [p.tolist() for p in visited[:2]]


def test_what_stands_against_it_ends_the_marching():
    staged, response = started()
    response.reduction.obstacle = "it is not to be"
    assert response.reduction_obstacle() == "it is not to be"
    assert not response.has_reduced_model
    response.march_again([start_of(staged)])
    assert staged.counts.evaluations == 0
