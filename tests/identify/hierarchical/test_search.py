"""The rounds between all unknowns and their scatter, with descents that are given."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from support.three_sections import HEAD, LARGEST, MODULUS, ORDERS, Site

from geoident.identify.hierarchical import search
from geoident.identify.hierarchical.search import SectionsStart, fit_sections
from geoident.identify.problem.outcome import Outcome
from geoident.model.methods import GaussNewtonOptions
from geoident.model.project.project import Scatter
from geoident.model.results.costs import Counts
from geoident.model.results.result import Iteration

ESTIMATED = (
    replace(MODULUS, scatter=Scatter("estimate")),
    replace(HEAD, scatter=Scatter("given", 1.5)),
)
"""Of the second 1.5, on its scale 0.15."""


@pytest.fixture
def site():
    return Site()


class Rounds:
    """Descents that move all unknowns by one in a hundred, and scatters that come in turn."""

    def __init__(self, monkeypatch, scatters, statuses=()):
        self.scatters, self.statuses = list(scatters), list(statuses)
        self.problems, self.options, self.free, self.linear = [], [], [], []
        monkeypatch.setattr(search, "_descended", self.descended)
        monkeypatch.setattr(search, "most_likely", self.most_likely)
        monkeypatch.setattr(search.LinearSections, "at", self.at)

    def descended(self, problem, options, observe):
        self.problems.append(problem)
        self.options.append(options)
        values = 1.01 * problem.start
        steps = tuple(
            Iteration("gauss-newton", n, 3.0 - n, values, 0.1, Counts()) for n in range(2)
        )
        status = self.statuses.pop(0) if self.statuses else "converged"
        return Outcome(values, 7.0, status, "because", steps)

    def at(self, made, models, values):
        self.linear.append((made, values))
        return f"linear {len(self.linear)}"

    def most_likely(self, linear, tau, free):
        assert linear == f"linear {len(self.linear)}"
        self.free.append(free.tolist())
        return np.array(self.scatters.pop(0))


def searched(site, laws=ESTIMATED, **more):
    return fit_sections(site.sections, ("K0",), laws, site.models, None, **more)


def test_descents_are_rough_until_the_scatter_is_settled_and_then_one_is_to_the_end(
    site, monkeypatch
):
    first = 0.25 * LARGEST[0]
    rounds = Rounds(monkeypatch, [[0.5, 0.15], [0.4, 0.15], [0.4 * (1 - 0.9e-5), 0.15]])
    found = searched(site, options=GaussNewtonOptions(tolerance=1e-10, max_iterations=33))
    assert [one.tolerance for one in rounds.options] == [1e-8, 1e-8, 1e-8, 1e-10]
    assert {one.max_iterations for one in rounds.options} == {33}
    scatters = [first, 0.5, 0.4, 0.4 * (1 - 0.9e-5)]
    for problem, tau in zip(rounds.problems, scatters, strict=True):
        rows = problem.sd[-6:]
        np.testing.assert_allclose(rows, [tau, 0.15, 0.15, tau, tau, 0.15])
    assert rounds.free == [[True, False]] * 3
    np.testing.assert_allclose(found.tau, [scatters[-1], 0.15])
    assert found.free.tolist() == [True, False]
    assert [step.number for step in found.outcome.iterations] == list(range(8))
    assert found.outcome.status == "converged"
    assert found.linear == "linear 4"
    assert found.problem is rounds.problems[-1]
    starts = np.array([q.start for q in found.arrangement.unknowns])
    starts = np.where([q.name == "K0" for q in found.arrangement.unknowns], 1.2, starts)
    np.testing.assert_allclose(found.outcome.values[:5], starts[:5] * 1.01**4)
    np.testing.assert_allclose(rounds.problems[2].start[:5], starts[:5] * 1.01**2)
    values = dict(
        zip([q.name for q in found.arrangement.unknowns], found.outcome.values, strict=True)
    )
    # what scatters begins on its law, what is a section's own at its prior or start
    assert values["nu of S0"] == pytest.approx(0.22 * 1.01**4)
    assert values["c of S2"] == pytest.approx(2.0 * 1.01**4)
    law = 1.0 * np.exp(0.02 * 47.0)
    assert values["E of S1"] == pytest.approx(law * 1.01**4)


@pytest.mark.parametrize(("change", "settled"), [(0.9e-5, True), (1.1e-5, False)])
@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_a_scatter_is_settled_within_a_hundred_thousandth_of_the_larger(
    site, monkeypatch, change, settled, sign
):
    rounds = Rounds(monkeypatch, [[0.3 * (1.0 + sign * change), 0.15]] * 2)
    begin = SectionsStart(tau=np.array([0.3, 99.0]))
    searched(site, begin=begin)
    assert len(rounds.options) == (2 if settled else 3)
    assert [one.tolerance for one in rounds.options][-1] == 1e-12
    np.testing.assert_allclose(rounds.problems[0].sd[-6:], [0.3, 0.15, 0.15, 0.3, 0.3, 0.15])


def test_options_that_are_rougher_than_rough_hold_in_all_rounds(site, monkeypatch):
    rounds = Rounds(monkeypatch, [[0.3, 0.15]] * 2)
    searched(site, options=GaussNewtonOptions(tolerance=1e-4))
    assert {one.tolerance for one in rounds.options} == {1e-4}


def test_where_no_scatter_is_to_be_found_one_descent_is_all(site, monkeypatch):
    rounds = Rounds(monkeypatch, [])
    found = searched(site, laws=(MODULUS, replace(HEAD, scatter=Scatter("none"))))
    assert [one.tolerance for one in rounds.options] == [1e-12]
    assert rounds.free == []
    np.testing.assert_allclose(found.tau, [0.3, 0.0])
    assert found.arrangement.scattering.tolist() == [True, False]
    assert [step.number for step in found.outcome.iterations] == [0, 1]


def test_a_scatter_that_vanishes_leaves_the_unknowns_of_its_law(site, monkeypatch):
    rounds = Rounds(monkeypatch, [[0.0, 0.15], [0.0, 0.15]])
    found = searched(site)
    assert [len(problem.sd) for problem in rounds.problems] == [27, 24, 24][: len(rounds.problems)]
    assert found.arrangement.scattering.tolist() == [False, True]
    assert found.tau[0] == 0.0
    assert len(rounds.problems) == 3


def test_a_descent_that_does_not_converge_ends_the_search(site, monkeypatch):
    rounds = Rounds(monkeypatch, [[0.5, 0.15]], ["converged", "out-of-budget"])
    found = searched(site)
    assert len(rounds.problems) == 2
    assert (found.outcome.status, found.outcome.reason) == ("out-of-budget", "because")
    np.testing.assert_allclose(found.tau, [0.5, 0.15])


def test_forty_rounds_are_made_at_most_and_that_is_said(site, monkeypatch):
    rounds = Rounds(monkeypatch, [[0.3 + 0.001 * k, 0.15] for k in range(41)])
    found = searched(site)
    assert len(rounds.problems) == 40
    assert found.outcome.status == "not-converged"
    assert found.outcome.reason == ("The scatter about the laws was not settled after 40 rounds.")
    assert len(found.outcome.iterations) == 80


def test_a_search_may_begin_elsewhere(site, monkeypatch):
    """Common values as given; of points what is a number, the rest from what is common."""
    rounds = Rounds(monkeypatch, [[0.5, 0.15]], ["stopped"])
    common = np.array([1.4, 1.5, 0.03, 3.0, 0.7])
    points = tuple(np.full(len(order), np.nan) for order in ORDERS)
    points[0][0], points[2][0] = 8.0, 3.3
    searched(site, begin=SectionsStart(common=common, points=points))
    problem = rounds.problems[0]
    start = dict(zip([q.name for q in problem.parameters], problem.start, strict=True))
    np.testing.assert_allclose(problem.start[:5], common)
    assert (start["E of S0"], start["c of S2"]) == (8.0, 3.3)
    assert start["E of S1"] == pytest.approx(1.5 * np.exp(0.03 * 47.0))
    assert start["h of S2"] == pytest.approx(3.0 + 0.7 * 3.2)
    assert start["nu of S0"] == 0.22
    rows = problem.sd[-6:]
    np.testing.assert_allclose(rows[0], 0.25 * LARGEST[0])
