import numpy as np
import pytest
from support.plastic_bars import Frame, PlasticBars

from geoident.errors import InputError
from geoident.identify import METHODS, descend, identify, refusal
from geoident.identify.direct.scan import grid_axes, scan
from geoident.model.methods import (
    METHOD_OPTIONS,
    ComplementarityOptions,
    CondensationOptions,
    GaussNewtonOptions,
    ScanAxis,
    ScanOptions,
    SimplexOptions,
)
from geoident.model.parameter import Parameter
from geoident.model.response import Response

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
        assert callable(method.function(method.options()))


def test_the_toy_is_a_response(problem):
    assert isinstance(problem.response, Response)


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


def test_one_descent_has_the_options_of_its_method_and_one_start(problem):
    few = descend(problem, GaussNewtonOptions(max_iterations=2, starts=9), go_on)
    assert few.status == "not-converged"
    assert len(few.iterations) <= 3
    loose = descend(problem, GaussNewtonOptions(tolerance=0.5, starts=9), go_on)
    assert len(loose.iterations) < len(descend(problem, GaussNewtonOptions(), go_on).iterations)


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


def test_the_obstacle_of_the_model_is_the_reason(problem):
    problem.response.obstacle = lambda: "Its ground yields."
    problem.response.condense = lambda p, measured, sd: None
    assert "Its ground yields." in refusal(problem.response, "condensation")
    problem.response.obstacle = lambda: None
    assert refusal(problem.response, "condensation") is None


def test_a_stopped_chain_gives_the_best_point_so_far(problem):
    def observe(iteration):
        return "Time is up." if iteration.method == "gauss-newton" else None

    outcome = identify(problem, (ScanOptions(points=9), GaussNewtonOptions()), observe)
    assert (outcome.status, outcome.reason) == ("out-of-budget", "Time is up.")
    assert outcome.objective == min(it.objective for it in outcome.iterations)


def test_a_chain_that_is_stopped_begins_no_further_method(problem):
    told = []

    def observe(iteration):
        told.append(iteration.method)
        return "Time is up." if len(told) >= 3 else None

    outcome = identify(problem, (ScanOptions(points=9), GaussNewtonOptions()), observe)
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


def test_a_scan_without_a_grid_spans_the_bounds():
    axes = grid_axes(QUESTION, ScanOptions(points=3))
    np.testing.assert_allclose(axes["E"], [1.0, 10.0, 100.0])
    np.testing.assert_allclose(axes["K0"], [0.0, 1.0, 2.0])


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


@pytest.mark.parametrize(
    ("grid", "code", "message", "hint"),
    [
        (
            {"G": ScanAxis(1.0, 2.0)}, "unknown-parameter",
            "scan over G: the parameters are E, K0.", "",
        ),
        (
            {"E": ScanAxis(0.0, 2.0, 7)}, "scan-axis",
            "scan over E: no grid from 0 to 2 with 7 points.", "Give finite ends.",
        ),
        (
            {"K0": ScanAxis(0.0, np.inf, 7)}, "scan-axis",
            "scan over K0: no grid from 0 to inf with 7 points.", "Give finite ends.",
        ),
        (
            {"E": ScanAxis(1.0, 2.0, 1001), "K0": ScanAxis(1.0, 2.0, 1000)}, "scan-size",
            "the scan has 1,001,000 points; 1,000,000 are the most",
            "Lower 'points' in fit.scan.",
        ),
    ],
)  # fmt: skip
def test_an_axis_that_cannot_be_is_refused(grid, code, message, hint):
    with pytest.raises(InputError) as caught:
        grid_axes(QUESTION, ScanOptions(grid))
    (fault,) = caught.value.faults
    assert (fault.code, fault.message, fault.hint) == (code, message, hint)
