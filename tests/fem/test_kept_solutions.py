"""Solutions that took long are kept: a run that goes on gets the same bits without solving."""

from __future__ import annotations

import numpy as np
import pytest

from geoident.fem.solvers import iterative, kept_solutions
from tests.fem.test_iterative import ground, iterative_solver, loads, system


class Kept:
    """A store in memory."""

    def __init__(self):
        self.of = {}

    def find_solution(self, name):
        return self.of.get(name)

    def add_solution(self, name, arrays):
        self.of[name] = {k: v.copy() for k, v in arrays.items()}


@pytest.fixture
def solved(monkeypatch):
    """How many blocks of right-hand sides are solved; everything is worth keeping."""
    monkeypatch.setattr(kept_solutions, "WORTH", 0.0)
    done = []
    true = iterative.solve_in_energy

    def counted(product, precondition, rhs, *rest):
        done.append(rhs.shape[1])
        return true(product, precondition, rhs, *rest)

    monkeypatch.setattr(iterative, "solve_in_energy", counted)
    return done


def with_store(kept):
    solver = iterative_solver()
    solver.keep_solutions(kept)
    return solver


def test_what_was_solved_before_is_found_bit_by_bit(solved, monkeypatch):
    pattern, values = system(ground("tet10", 2))
    kept, rhs = Kept(), loads(pattern)
    plain = iterative_solver()
    exact = plain.analyse(pattern).factorize(values).solve(rhs)
    first = with_store(kept)
    assert np.array_equal(first.analyse(pattern).factorize(values).solve(rhs), exact)
    assert len(solved) == 2
    monkeypatch.setattr(iterative, "least_eigenvalue", None)  # is not even asked
    again = with_store(kept)
    assert np.array_equal(again.analyse(pattern).factorize(values).solve(rhs), exact)
    assert len(solved) == 2
    assert again.counts.iterations == 0


def test_nothing_is_taken_for_the_solution_of_something_else(solved):
    pattern, values = system(ground("tet10", 2))
    kept, rhs = Kept(), loads(pattern)
    with_store(kept).analyse(pattern).factorize(values).solve(rhs)
    other = rhs.copy()
    other[5, 2] = np.nextafter(other[5, 2], np.inf)
    stiffer = 2.0 * values
    for v, b in ((values, other), (values, rhs[:, :2]), (stiffer, rhs)):
        found = with_store(kept).analyse(pattern).factorize(v).solve(b)
        plain = iterative_solver().analyse(pattern).factorize(v).solve(b)
        assert np.array_equal(found, plain)
    assert len(solved) == 1 + 2 * 3
