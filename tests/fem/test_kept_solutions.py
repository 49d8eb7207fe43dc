"""Solutions that took long are kept: a run that goes on gets the same bits without solving."""

from __future__ import annotations

import itertools

import numpy as np

from geoident.fem.solvers import kept_solutions
from tests.fem.test_iterative import iterative_solver, loads, system


class Kept:
    """A store in memory."""

    def __init__(self):
        self.of = {}

    def find_solution(self, name):
        return self.of.get(name)

    def add_solution(self, name, arrays):
        self.of[name] = {k: v.copy() for k, v in arrays.items()}


def solved_with(store, values, rhs, pattern):
    """Solutions, and how many steps they took."""
    solver = iterative_solver()
    solver.keep_solutions(store)
    return solver.analyse(pattern).factorize(values).solve(rhs), solver.counts.iterations


def test_what_was_solved_before_is_found_bit_by_bit_and_nothing_is_taken_for_it(monkeypatch):
    clock = itertools.count(step=60.0)  # on a machine that takes a minute for a solution
    monkeypatch.setattr(kept_solutions, "monotonic", clock.__next__)
    pattern, values = system("tet10", 2)
    kept, rhs = Kept(), loads(pattern)
    exact, _ = solved_with(None, values, rhs, pattern)
    first, steps = solved_with(kept, values, rhs, pattern)
    again, no_steps = solved_with(kept, values, rhs, pattern)
    assert np.array_equal(first, exact)
    assert np.array_equal(again, exact)
    assert steps > no_steps == 0
    other = rhs.copy()
    other[5, 2] = np.nextafter(other[5, 2], np.inf)
    for v, b in ((values, other), (values, rhs[:, :2]), (2.0 * values, rhs)):
        found, steps = solved_with(kept, v, b, pattern)
        assert np.array_equal(found, solved_with(None, v, b, pattern)[0])
        assert steps > 0
