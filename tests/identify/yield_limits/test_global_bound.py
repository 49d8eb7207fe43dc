"""The account of branch and bound: what is proven by boxes that are done with or left."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from support.plastic_bars import Frame, PlasticBars

from geoident.errors import InputError, ModelError
from geoident.identify.problem.outcome import History, Outcome
from geoident.identify.problem.problem import Problem
from geoident.identify.yield_limits import global_bound
from geoident.identify.yield_limits.condensed_system import CondensedSystem
from geoident.identify.yield_limits.global_bound import BranchAndBound
from geoident.identify.yield_limits.mixed_program import Solved
from geoident.identify.yield_limits.parameter_boxes import ParameterBox
from geoident.model.methods import ComplementarityOptions, HuberOptions
from geoident.model.parameter import Parameter, Prior
from geoident.model.yielding import Certificate

MANY, FEW = np.arange(41), np.arange(40)


def box(bound, *, size=1.0, kept=MANY):
    return ParameterBox(np.zeros(1), np.array([size]), bound, kept)


def counted(phi=2.0, *, gap=1e-2, stop=None, **options):
    bars = PlasticBars([Frame([1.0, 1.0], [0, None], [2.0])], 1)
    problem = Problem(bars, np.array([1.2]), np.ones(1), (Parameter("k", 0.5, 0.1, 1.0),))
    activity = bars.activity(np.array([0.8]))
    first = Outcome(
        np.array([0.8]), phi, "converged", "", (),
        certificate=Certificate("strongly stationary", 0.0, activity),
    )  # fmt: skip
    given = ComplementarityOptions(formulation="global", gap=gap, **options)
    return BranchAndBound(problem, given, lambda entry: stop, first)


@pytest.mark.parametrize(("phi", "allowed"), [(2.0, 0.02), (0.5, 0.01)])
def test_the_gap_is_measured_against_the_discrepancy_or_one(phi, allowed):
    search = counted(phi)
    assert search.allowed == pytest.approx(allowed)
    assert search.goal == pytest.approx(phi - allowed)


@pytest.mark.parametrize(("bound", "proven"), [(1.98001, True), (1.97999, True), (1.9799, False)])
def test_the_lowest_bound_of_all_boxes_is_what_is_proven(bound, proven):
    """A thousandth of the gap is left to rounding."""
    found = counted().outcome([box(1.995), box(bound), box(1.999)])
    assert found.certificate.bound == bound
    assert found.certificate.gap == pytest.approx((2.0 - bound) / 2.0)
    assert found.certificate.kind == ("global" if proven else "strongly stationary")
    assert found.status == ("converged" if proven else "not-converged")
    assert (
        f"No parameters within the bounds have a misfit below {bound:.6g}"
        in (found.certificate.remarks[0])
    )
    if proven:
        assert found.reason == (
            f"The misfit 2 is the lowest within the bounds: {bound:.6g} is a proven bound."
        )
    else:
        assert found.reason == (
            f"After 0 boxes the proven bound is {bound:.6g}: raise max_regions or give tighter "
            "bounds."
        )


def test_boxes_that_are_done_with_count_and_no_bound_is_above_the_best_or_below_zero():
    search = counted()
    search.close(1.7)
    search.close(1.9)
    assert search.outcome([box(1.8)]).certificate.bound == 1.7
    assert counted().outcome([box(7.0)]).certificate.bound == 2.0
    assert counted().outcome([]).certificate.gap == 0.0
    assert counted().outcome([box(-3.0)]).certificate.bound == 0.0
    assert counted(0.5).outcome([box(0.4)]).certificate.gap == pytest.approx(0.1)


def test_a_stop_is_said_unless_all_is_proven():
    search = counted(stop="enough")
    search.reported(box(0.0), [])
    assert search.outcome([box(0.0)]).status == "out-of-budget"
    assert search.outcome([box(0.0)]).reason == "enough"
    assert search.outcome([box(1.999)]).status == "converged"


@pytest.fixture
def scripted(monkeypatch):
    """Branch and bound whose boxes are examined and solved as told."""

    def make(examined, solved=None):
        calls = []
        monkeypatch.setattr(global_bound, "examined", lambda system, form, box, best: examined(box))

        def solve(system, box, form, *, best, gap):
            assert best == 2.0
            assert gap == pytest.approx(0.5e-2)
            calls.append(box)
            return solved

        monkeypatch.setattr(global_bound, "solve_box", solve)
        return calls

    return make


class System:
    """What is asked of a condensed system here."""

    reference = np.ones(1)


def whole_system():
    """Of one parameter between 0 and 1 and no pairs."""
    nothing = np.zeros(0)
    return CondensedSystem(
        nothing, np.zeros((0, 1)), np.zeros((0, 0)), np.zeros(1), np.zeros((1, 1)),
        np.zeros((1, 0)), {}, np.zeros(1), np.ones(1), np.ones(1), nothing, nothing,
    )  # fmt: skip


def test_the_box_of_the_lowest_bound_is_next_and_no_more_than_necessary(scripted):
    """A box is no better than 1.9 left of its middle; all is proven within four boxes."""
    seen = []

    def look(box):
        seen.append((box.lower[0], box.upper[0]))
        return replace(box, bound=1.9 if box.upper[0] <= 0.5 else 1.985, kept=MANY)

    scripted(look)
    search = counted(max_regions=3)
    found = search.run(whole_system())
    assert seen == [(0.0, 1.0)]
    assert found.certificate.bound == 1.985
    assert found.status == "converged"

    seen.clear()
    bounds = iter([0.5, 1.6, 1.4, 1.5, 1.7])
    scripted(lambda box: look(box) and replace(box, bound=next(bounds), kept=MANY))
    left = counted(max_regions=4).run(whole_system())
    # halves have the bound of the whole, in order: left 1.6, right 1.4, then the right one's halves
    assert seen == [(0.0, 1.0), (0.0, 0.5), (0.5, 1.0), (0.5, 0.75)]
    assert left.certificate.bound == 1.4
    assert left.status == "not-converged"
    assert "After 4 boxes the proven bound is 1.4" in left.reason


def test_an_empty_box_has_nothing_below_the_best(scripted):
    scripted(lambda box: None)
    search = counted()
    assert search.visit(System, box(0.0)) == []
    assert search.done == 2.0
    assert search.examined == 1


@pytest.mark.parametrize(("bound", "left"), [(1.981, 0), (1.98, 0), (1.979, 2)])
def test_a_box_without_anything_better_is_done_with(scripted, bound, left):
    scripted(lambda box: replace(box, bound=bound))
    search = counted()
    assert len(search.visit(System, box(0.0))) == left
    assert search.done == (np.inf if left else bound)


@pytest.mark.parametrize(
    ("size", "kept", "solves"),
    [(1.0, MANY, False), (1.0, FEW, True), (0.019, MANY, True), (0.021, MANY, False)],
)
def test_boxes_of_few_pairs_and_small_ones_are_solved(scripted, size, kept, solves):
    calls = scripted(lambda box: box, Solved(1.0, None, False))
    left = counted().visit(System, box(0.0, size=size, kept=kept))
    assert len(calls) == solves
    assert len(left) == 2
    assert left[0].bound == (1.0 if solves else 0.0)


@pytest.mark.parametrize(
    ("size", "complete", "left"),
    [(1.0, True, 0), (1.0, False, 2), (0.9e-7, False, 0), (1.1e-7, False, 2)],
)
def test_what_is_solved_or_too_small_is_not_cut(scripted, size, complete, left):
    scripted(lambda box: box, Solved(1.5, None, complete))
    search = counted()
    assert len(search.visit(System, box(0.0, size=size, kept=FEW))) == left
    assert search.done == (np.inf if left else 1.5)


def test_a_solution_without_anything_better_proves_no_more_than_the_best(scripted):
    scripted(lambda box: box, Solved(np.inf, None, True))
    search = counted()
    search.visit(System, box(0.0, kept=FEW))
    assert search.done == 2.0


def test_what_is_solved_is_taken_over_in_the_units_of_the_model(scripted):
    class Scaled(System):
        reference = np.array([0.5])

    scripted(lambda box: box, Solved(1.5, np.array([1.4]), True))
    search, seen = counted(), []
    search.improve = lambda p: seen.append(p.tolist())
    search.visit(Scaled, box(0.0, kept=FEW))
    assert seen == [[0.7]]


def test_a_better_point_is_taken_over_after_a_descent_on_the_model():
    search = counted()
    search.improve(np.array([0.7]))
    assert search.best.objective == pytest.approx(0.0, abs=1e-9)
    assert search.best.values == pytest.approx([0.8], rel=1e-3)
    kept = counted(1e-9)
    kept.improve(np.array([0.7]))
    assert kept.best.objective == 1e-9


def test_a_point_without_a_solution_is_not_taken_over():
    search = counted()
    first = search.best
    search.problem.response.evaluate = lambda p: (_ for _ in ()).throw(ModelError("collapse"))
    search.improve(np.array([0.7]))
    assert search.best is first


@pytest.mark.parametrize(("best", "taken"), [(0.0099, False), (0.0101, True)])
def test_what_is_better_by_no_more_than_the_gap_is_not_taken_over(best, taken):
    """The descent comes to zero: below what is allowed, 0.01 of 1, or not."""
    search = counted(best)
    search.improve(np.array([0.7]))
    assert (search.best.objective < best) == taken


def test_a_search_that_was_stopped_before_its_boxes_proves_nothing(monkeypatch):
    search = counted()
    stopped = replace(search.best, status="out-of-budget", reason="Enough.")
    monkeypatch.setattr(global_bound, "formulation_obstacle", lambda response, name: None)
    monkeypatch.setattr(global_bound, "_system_obstacle", lambda system: None)
    monkeypatch.setattr(global_bound, "implicit", lambda problem, options, observe: stopped)
    bars = search.problem.response
    bars.system_obstacle = bars.system = lambda: None
    found = global_bound.global_bound(search.problem, search.options, lambda entry: None)
    assert found is stopped


def test_what_a_proof_needs_is_said():
    search = counted()
    obstacle = global_bound._problem_obstacle
    (k,) = search.problem.parameters

    def with_parameter(**given):
        return obstacle(replace(search.problem, parameters=(replace(k, **given),)))

    assert obstacle(search.problem) is None
    assert "the loss is huber" in obstacle(replace(search.problem, loss=HuberOptions()))
    assert with_parameter(lower=-np.inf) == "k has no bounds, and a proof needs them"
    assert with_parameter(upper=np.inf) == "k has no bounds, and a proof needs them"
    assert "the prior of k is lognormal" in with_parameter(prior=Prior(1.0, 0.1, "lognormal"))
    assert with_parameter(prior=Prior(1.0, 0.1)) is None
    with pytest.raises(InputError, match="global is not possible here: k has no bounds") as caught:
        global_bound._refuse("k has no bounds")
    assert caught.value.faults[0].code == "method-not-possible"
    global_bound._refuse(None)


@pytest.mark.parametrize(("pairs", "fine"), [(2000, True), (2001, False)])
def test_more_than_two_thousand_pairs_are_too_many(monkeypatch, pairs, fine):
    monkeypatch.setattr(global_bound, "condensing_obstacle", lambda system: None)
    why = global_bound._system_obstacle(SimpleNamespace(n_pairs=pairs))
    assert (why is None) == fine
    assert fine or why.startswith("2001 pairs of planes and multipliers are more than 2000")
    monkeypatch.setattr(global_bound, "condensing_obstacle", lambda system: "it hardens")
    assert global_bound._system_obstacle(SimpleNamespace(n_pairs=pairs)) == "it hardens"


def test_boxes_are_told_with_their_bounds_and_sizes(scripted):
    notes = []
    search = counted(max_regions=2)
    search.history = History("complementarity", search.problem.response, notes.append)
    scripted(lambda box: replace(box, bound=1.25, kept=MANY))
    found = search.run(whole_system())
    assert [(e.note, e.step, e.objective) for e in notes] == [
        ("box 1: bound 1.25, 41 pairs", 1.0, 2.0),
        ("box 2: bound 1.25, 41 pairs", 0.5, 2.0),
    ]
    assert [entry.values.tolist() for entry in notes] == [[0.8]] * 2
    assert len(found.iterations) == 2


def test_the_search_ends_where_the_lowest_bound_is_near_enough(scripted):
    """Halves of 1.99 are within the gap of 2: no more boxes."""
    bounds = iter([1.97, 1.99, 1.99])
    seen = []

    def look(box):
        seen.append(box.lower[0])
        return replace(box, bound=next(bounds), kept=FEW)

    scripted(look, Solved(1.985, None, False))
    search = counted()
    found = search.run(whole_system())
    assert seen == [0.0]
    assert (found.status, found.certificate.bound) == ("converged", 1.985)


def test_the_size_of_a_small_box_is_its_own():
    assert box(0.0, size=0.25).size == 0.25
