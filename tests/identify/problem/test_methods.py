from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from support.plastic_bars import Frame, PlasticBars

from geoident.errors import InputError
from geoident.identify.direct.scan import grid_axes, scan
from geoident.identify.problem import methods
from geoident.identify.problem.methods import METHODS, descend, identify, refusal
from geoident.identify.problem.problem import Problem
from geoident.model.methods import (
    METHOD_OPTIONS,
    ClosedFormOptions,
    ComplementarityOptions,
    CondensationOptions,
    GaussNewtonOptions,
    HuberOptions,
    ScanAxis,
    ScanOptions,
    SimplexOptions,
)
from geoident.model.parameter import Parameter

TRUE = np.array([4.0, 0.5])
QUESTION = (Parameter("E", 30.0, 1.0, 100.0, "log"), Parameter("K0", 1.0, 0.0, 2.0))


def model(p):
    return np.array([p[1] / p[0], (1.0 - p[1]) / p[0], 1.0 / p[0]])


def go_on(iteration):
    return None


@pytest.fixture
def problem(make_problem):
    return make_problem(model, QUESTION, model(TRUE), 1e-3)


def test_the_table_has_the_names_and_options_that_users_can_write():
    assert {name: method.options for name, method in METHODS.items()} == dict(METHOD_OPTIONS)
    for name, method in METHODS.items():
        assert method.name == name
        found = method.function(method.options())
        assert found.__module__.startswith(f"geoident.identify.{method.folder}.")


def test_a_chain_goes_on_where_the_method_before_ended(problem):
    chain = (ScanOptions(points=5), SimplexOptions(max_evaluations=30), GaussNewtonOptions())
    outcome = identify(problem, chain, go_on)
    assert outcome.status == "converged"
    np.testing.assert_allclose(outcome.values, TRUE, rtol=1e-8)
    methods = [it.method for it in outcome.iterations]
    assert list(dict.fromkeys(methods)) == ["scan", "simplex", "gauss-newton"]
    assert outcome.grid is not None
    first = methods.index("gauss-newton")
    best = min(outcome.iterations[:first], key=lambda it: it.objective)
    np.testing.assert_allclose(outcome.iterations[first].values, best.values, rtol=1e-12)


@pytest.mark.parametrize("options", [ScanOptions(points=5), SimplexOptions(), GaussNewtonOptions()])
def test_one_descent_is_by_gauss_newton_whatever_found_its_start(problem, options):
    outcome = descend(problem, options, go_on)
    assert outcome.status == "converged"
    np.testing.assert_allclose(outcome.values, TRUE, rtol=1e-8)
    assert {it.method for it in outcome.iterations} == {"gauss-newton"}


def test_one_descent_for_yield_limits_scans_nothing():
    bars = PlasticBars([Frame([1.0, 1.0], [0, None], [1.0, 2.0])], 1)
    question = (Parameter("k1", 0.9, 0.1, 5.0, "log"),)
    given = Problem(bars, bars.readings(np.array([0.8])), np.full(2, 1e-3), question)
    outcome = descend(given, ComplementarityOptions(), go_on)
    assert outcome.values == pytest.approx([0.8])
    assert outcome.status == "converged"
    notes = [entry.note for entry in outcome.iterations]
    assert notes[0] == "start"
    assert not any(note.startswith(("strength", "restart")) for note in notes)


def test_changed_weights_go_on_from_one_start_of_the_last_method():
    last = GaussNewtonOptions(tolerance=1e-3, starts=7)
    assert methods.continued((SimplexOptions(), ScanOptions(), last)) == (replace(last, starts=1),)
    assert methods.continued((last, SimplexOptions(size=0.3))) == (SimplexOptions(size=0.3),)
    assert methods.continued((last,)) == (replace(last, starts=1),)


class Opening:
    """A model that is a circular opening where it is asked for one of a radius of 2."""

    names = ("E", "K0")

    def __init__(self, covered):
        self.found = SimpleNamespace(covered=np.array(covered, dtype=bool))

    def opening(self, centre, radius):
        return self.found if radius == 2.0 else f"there is none of {radius} about {centre}"

    def __getattr__(self, name):
        return lambda *given: None


def test_a_closed_form_is_refused_with_its_own_reason(problem):
    options = ClosedFormOptions(centre=(1.0, 3.0), radius=2.0)

    def why(response, options=options):
        return refusal(response, "closed-form", options=options)

    assert "the model is not a circular opening" in why(problem.response)
    assert why(Opening([False, True])) is None
    assert why(Opening([])) is None
    assert "no reading is of a stage and a point" in why(Opening([False, False]))
    assert "none of 3.0 about (1.0, 3.0)" in why(Opening([True]), replace(options, radius=3.0))
    assert "there is none of None about None" in why(Opening([True]), None)
    assert "there is none of None" in methods.refusals(Opening([True]), [ClosedFormOptions()])[0]
    chain = [ClosedFormOptions(), GaussNewtonOptions()]
    assert methods.refusals(Opening([True]), chain) == []


def test_a_loss_that_is_not_squared_is_named_where_it_cannot_be(problem):
    problem.response.obstacle = lambda: None
    problem.response.condense = lambda p, measured, sd: None
    assert refusal(problem.response, "condensation") is None
    assert "need the squared loss, and the loss is huber" in (
        refusal(problem.response, "condensation", HuberOptions())
    )
    reasons = methods.refusals(
        problem.response, [GaussNewtonOptions(), CondensationOptions()], HuberOptions()
    )
    assert len(reasons) == 1


def test_what_a_formulation_needs_is_said(monkeypatch):
    class Shown(PlasticBars):
        why = None

        def system_obstacle(self):
            return self.why

        def system(self):
            raise AssertionError

    frames = [Frame([1.0, 1.0], [0, None], [1.0])]
    hidden, shown = PlasticBars(frames, 1), Shown(frames, 1)
    obstacle = methods.formulation_obstacle
    assert obstacle(hidden, "implicit") is None
    assert obstacle(shown, "global") is obstacle(shown, "full-space") is None
    assert obstacle(hidden, "global") == (
        "the formulation global needs equations that the model does not show"
    )
    shown.why = "the ground hardens"
    assert obstacle(shown, "full-space") == "for the formulation full-space, the ground hardens"
    asked = []
    monkeypatch.setattr(methods, "find_spec", asked.append)
    assert obstacle(shown, "global") == (
        'the formulation global needs pyscipopt (pip install "geoident[global]")'
    )
    assert "needs casadi" in obstacle(shown, "full-space")
    assert asked == ["pyscipopt", "casadi"]
    elastic = PlasticBars([Frame([1.0], [None], [1.0])], 1)
    assert "no material of the model has yield limits" in refusal(elastic, "complementarity")


def test_a_method_that_the_model_cannot_serve_is_refused_before_computing(problem):
    with pytest.raises(InputError, match="Possible are gauss-newton, simplex, scan") as caught:
        identify(problem, (GaussNewtonOptions(), CondensationOptions()), go_on)
    assert [fault.code for fault in caught.value.faults] == ["method-not-possible"]
    assert problem.response.evaluations == 0
    assert refusal(problem.response, "gauss-newton") is None


def test_a_refusal_names_what_is_possible_instead(problem):
    assert refusal(problem.response, "condensation").endswith(
        "Possible are gauss-newton, simplex, scan, ensemble-smoother."
    )
    bars = PlasticBars([Frame([1.0, 1.0], [0, None], [1.0, 2.0])], 1)
    whole = ComplementarityOptions(formulation="full-space")
    assert refusal(bars, "complementarity") is None
    assert refusal(bars, "complementarity", options=whole).endswith(
        "Possible are gauss-newton, simplex, scan, ensemble-smoother, "
        "complementarity in its default formulation."
    )
    assert refusal(problem.response, "complementarity", options=whole).endswith(
        "Possible are gauss-newton, simplex, scan, ensemble-smoother."
    )


def test_a_stopped_chain_gives_the_best_point_so_far(problem):
    def on_iteration(iteration):
        return "Time is up." if iteration.method == "gauss-newton" else None

    outcome = identify(problem, (ScanOptions(points=9), GaussNewtonOptions()), on_iteration)
    assert (outcome.status, outcome.reason) == ("out-of-budget", "Time is up.")
    assert outcome.objective == min(it.objective for it in outcome.iterations)


def test_a_chain_that_is_stopped_begins_no_further_method(problem):
    told = []

    def on_iteration(iteration):
        told.append(iteration.method)
        return "Time is up." if len(told) >= 3 else None

    outcome = identify(problem, (ScanOptions(points=9), GaussNewtonOptions()), on_iteration)
    assert told == ["scan"] * 3
    assert (outcome.status, len(outcome.iterations)) == ("out-of-budget", 3)


# Scan


def test_a_scan_finds_the_lowest_point_of_its_grid(problem):
    grid = {"E": ScanAxis(1.0, 16.0, 5), "K0": ScanAxis(0.0, 1.0, 3)}
    outcome = scan(problem, ScanOptions(grid), go_on)
    np.testing.assert_allclose(outcome.grid.axes[0], [1.0, 2.0, 4.0, 8.0, 16.0])
    np.testing.assert_allclose(outcome.grid.axes[1], [0.0, 0.5, 1.0])
    np.testing.assert_allclose(outcome.values, TRUE)
    assert outcome.grid.objective.shape == (5, 3)
    assert outcome.objective == pytest.approx(0.0, abs=1e-20)
    expected = np.sum((model(np.array([8.0, 1.0])) - model(TRUE)) ** 2) * 1e6
    assert outcome.grid.objective[3, 2] == pytest.approx(expected)
    assert problem.response.evaluations == 15


def test_a_scan_along_one_parameter_keeps_the_others_at_their_start(problem):
    outcome = scan(problem, ScanOptions({"K0": ScanAxis(0.1, 0.9, 5)}), go_on)
    assert outcome.grid.names == ("K0",)
    assert {it.values[0] for it in outcome.iterations} == {30.0}
    assert {(it.step, it.note) for it in outcome.iterations} == {(0.0, "grid")}


def test_points_without_a_solution_are_infinite(make_problem):
    def refuse(p):
        return "E is too low." if p[0] < 3.0 else None

    problem = make_problem(model, QUESTION, model(TRUE), 1e-3, refuse)
    outcome = scan(problem, ScanOptions({"E": ScanAxis(1.0, 16.0, 5)}), go_on)
    assert np.isinf(outcome.grid.objective).tolist() == [True, True, False, False, False]
    nowhere = scan(problem, ScanOptions({"E": ScanAxis(1.0, 2.0, 3)}), go_on)
    assert nowhere.status == "not-converged"
    np.testing.assert_array_equal(nowhere.values, [30.0, 1.0])


def test_a_stopped_scan_keeps_what_it_has(problem):
    stop = scan(problem, ScanOptions(points=4), lambda it: "Enough." if it.number == 5 else None)
    assert (stop.status, stop.reason) == ("out-of-budget", "Enough.")
    assert int(np.isnan(stop.grid.objective).sum()) == 10


MODE = Parameter("rock.mode-1", 0.0, -4.0, 4.0, field="rock")


@pytest.mark.parametrize(
    ("grid", "code", "said"),
    [
        ({"G": ScanAxis(1.0, 2.0)}, "unknown-parameter", "over G: the parameters are E, K0."),
        ({"E": ScanAxis(0.0, 2.0)}, "scan-axis", "over E: no grid from 0 to 2 with 21 points."),
        ({"E": ScanAxis(2.0, 0.0, 3)}, "scan-axis", "from 2 to 0 with 3 points."),
        ({"K0": ScanAxis(0.0, np.inf)}, "scan-axis", "over K0: no grid from 0 to inf"),
        ({"K0": ScanAxis(np.nan, 1.0)}, "scan-axis", "from nan to 1"),
        ({"K0": ScanAxis(0.5, 1.0, 0)}, "scan-axis", "from 0.5 to 1 with 0 points."),
        (
            {"E": ScanAxis(1.0, 9.0, 101), "K0": ScanAxis(0.0, 1.0, 9901)},
            "scan-size",
            "the scan has 1,000,001 points; 1,000,000 are the most",
        ),
    ],
)
def test_an_axis_that_cannot_be_is_refused(grid, code, said):
    with pytest.raises(InputError, match="scan") as caught:
        grid_axes((MODE, *QUESTION), ScanOptions(grid))
    assert [fault.code for fault in caught.value.faults] == [code]
    (fault,) = caught.value.faults
    assert said in fault.message
    hints = {"scan-axis": "Give finite ends.", "scan-size": "Lower 'points' in fit.scan."}
    assert fault.hint == hints.get(code, "")


def test_a_scan_without_a_grid_takes_the_first_two_parameters_that_the_case_names():
    third = Parameter("nu", 0.2, 0.0, 0.4)
    axes = grid_axes((MODE, *QUESTION, third), ScanOptions(points=2))
    assert {name: axis.tolist() for name, axis in axes.items()} == {
        "E": pytest.approx([1.0, 100.0]),
        "K0": [0.0, 2.0],
    }
    with pytest.raises(InputError, match="nothing to scan") as caught:
        grid_axes((MODE,), ScanOptions())
    assert [(f.code, f.path) for f in caught.value.faults] == [("no-parameters", "fit.scan")]
