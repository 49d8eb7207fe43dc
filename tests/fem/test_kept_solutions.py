"""Solutions that took long are kept: a run that goes on gets the same bits without solving."""

from __future__ import annotations

import numpy as np
import pytest

from geoident.fem.solvers import iterative, kept_solutions, pick_solver
from geoident.fem.solvers.iterative import IterativeSolver
from geoident.fem.solvers.kept_solutions import KeepsSolutions
from geoident.fem.solvers.splu import SpluSolver
from tests.fem.test_iterative import ground, loads, system


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

    def counted(product, precondition, rhs, least):
        done.append(rhs.shape[1])
        return true(product, precondition, rhs, least)

    monkeypatch.setattr(iterative, "solve_in_energy", counted)
    return done


def with_store(kept):
    solver = IterativeSolver(SpluSolver, few=0)
    solver.keep_solutions(kept)
    return solver


def test_what_was_solved_before_is_found_bit_by_bit_with_its_counts(solved, monkeypatch):
    pattern, values = system(ground("tet10", 2))
    kept, rhs = Kept(), loads(pattern)
    plain = IterativeSolver(SpluSolver, few=0)
    exact = plain.analyse(pattern).factorize(values).solve(rhs)
    first = with_store(kept)
    assert np.array_equal(first.analyse(pattern).factorize(values).solve(rhs), exact)
    assert len(solved) == 2
    monkeypatch.setattr(iterative, "spectrum", None)  # is not even asked
    again = with_store(kept)
    assert np.array_equal(again.analyse(pattern).factorize(values).solve(rhs), exact)
    assert len(solved) == 2
    assert again.counts.iterations == first.counts.iterations == plain.counts.iterations > 0


def test_nothing_is_taken_for_the_solution_of_something_else(solved):
    pattern, values = system(ground("tet10", 2))
    kept, rhs = Kept(), loads(pattern)
    with_store(kept).analyse(pattern).factorize(values).solve(rhs)
    other = rhs.copy()
    other[5, 2] = np.nextafter(other[5, 2], np.inf)
    stiffer = 2.0 * values
    for v, b in ((values, other), (values, rhs[:, :2]), (stiffer, rhs)):
        found = with_store(kept).analyse(pattern).factorize(v).solve(b)
        plain = IterativeSolver(SpluSolver, few=0).analyse(pattern).factorize(v).solve(b)
        assert np.array_equal(found, plain)
    assert len(solved) == 1 + 2 * 3


def test_what_is_solved_quickly_is_not_kept(solved, monkeypatch):
    monkeypatch.setattr(kept_solutions, "WORTH", 1e9)
    pattern, values = system(ground("tet10", 2))
    kept = Kept()
    with_store(kept).analyse(pattern).factorize(values).solve(loads(pattern))
    assert not kept.of


def test_the_choice_among_solvers_passes_the_store_on():
    solver = pick_solver("auto")
    assert isinstance(solver, KeepsSolutions)
    kept = Kept()
    solver.keep_solutions(kept)
    assert solver._beyond._kept.store is kept
    assert not isinstance(pick_solver("splu"), KeepsSolutions)
