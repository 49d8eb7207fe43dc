"""Strengths by complementarity, on bars whose answers are known by hand."""

from contextlib import suppress
from dataclasses import replace

import numpy as np
import pytest
from support.derivatives import assert_exact
from support.plastic_bars import Frame, PlasticBars
from support.yield_sites import deep_opening, notched_plate, task

from geoident.errors import CollapseError, InputError, ModelError
from geoident.identify.least_squares.gauss_newton import gauss_newton
from geoident.identify.problem.methods import identify
from geoident.identify.problem.outcome import History
from geoident.identify.problem.problem import Discrepancy, Problem
from geoident.identify.yield_limits.implicit import certificate_at, descend
from geoident.identify.yield_limits.stationarity import check, open_above
from geoident.identify.yield_limits.yield_points import yield_evaluator
from geoident.model.methods import ComplementarityOptions, GaussNewtonOptions
from geoident.model.parameter import Parameter, Prior

TRUTH = np.array([1.0, 2.0, 3.0])


def three_strengths():
    """Two frames with three strengths and a bar that never yields, three stages."""
    frames = [
        Frame([1.0, 2.0, 1.0, 0.3], [0, 1, 2, None], [2.0, 5.0, 9.0]),
        Frame([3.0, 1.0, 1.0, 0.2], [0, 2, 1, None], [1.5, 4.0, 9.0]),
    ]
    return PlasticBars(frames, 3)


def unknowns(n, *, start=2.0, lower=0.1, upper=20.0, scale="log"):
    return tuple(Parameter(f"k{i + 1}", start, lower, upper, scale) for i in range(n))


def problem_of(bars, measured, parameters=None, sd=1e-3):
    measured = np.asarray(measured, dtype=float)
    return Problem(bars, measured, np.full(len(measured), sd), parameters or unknowns(bars.n))


def run(problem, **options):
    return identify(problem, [ComplementarityOptions(**options)], lambda iteration: None)


def test_the_bars_answer_as_by_hand():
    # u = 1 for F = 2 on two bars of stiffness 1; one yields at 0.75: the other bears 1.25
    bars = PlasticBars([Frame([1.0, 1.0], [0, None], [1.0, 2.0])], 1)
    v, J = bars.evaluate(np.array([0.75]))
    assert v == pytest.approx([0.5, 1.25])
    assert J.ravel() == pytest.approx([0.0, -1.0])


def test_the_derivatives_of_the_bars_are_right():
    bars, p = three_strengths(), np.array([0.9, 1.7, 2.2])
    assert_exact(bars, p, bars.names)


@pytest.mark.parametrize("scale", ["log", "linear"])
@pytest.mark.parametrize("start", [0.3, 2.0, 15.0])
def test_finds_strengths_from_anywhere(start, scale):
    bars = three_strengths()
    found = run(problem_of(bars, bars.readings(TRUTH), unknowns(3, start=start, scale=scale)))
    assert found.values == pytest.approx(TRUTH, rel=1e-6)
    assert found.status == "converged"
    assert found.certificate.kind == "global"
    assert found.certificate.bound == 0.0
    assert "reproduced exactly" in found.reason


def test_the_scan_lowers_all_strengths_from_their_upper_bounds_by_one_factor():
    bars = three_strengths()
    found = run(problem_of(bars, bars.readings(TRUTH), unknowns(3, start=15.0)))
    scan = [it.values for it in found.iterations if it.note.startswith("strength ")]
    # a fiftieth at most, so in ten steps of hardly less than 1.5; nothing yields at first
    np.testing.assert_allclose(scan, 20.0 * np.outer(50.0 ** (-np.arange(3) / 10), np.ones(3)))
    assert np.ceil(np.log(50.0) / np.log(1.5)) == 10


def test_a_start_that_collapses_is_said_and_left():
    bars = PlasticBars([Frame([1.0, 2.0], [0, 1], [2.0, 3.5])] * 2, 2)
    start = unknowns(2, start=0.5)
    with pytest.raises(CollapseError):
        bars.readings(np.array([0.5, 0.5]))
    found = run(problem_of(bars, bars.readings(np.array([1.5, 2.1])), start))
    assert found.objective < 1e-10
    assert found.iterations[0].note == "start: no solution"
    assert any("cannot carry the load" in remark for remark in found.remarks)


def test_a_start_that_collapses_retreats_to_stronger_ground():
    """As the answer for fewer stages may: 3 are carried, 3.5 need a sixth more of both."""
    bars = PlasticBars([Frame([1.0, 2.0], [0, 1], [2.0, 3.5])] * 2, 2)
    parameters = (Parameter("k1", 1.2, 0.1, 20.0, "log"), Parameter("k2", 1.8, 0.1, 20.0, "log"))
    found = run(problem_of(bars, bars.readings(np.array([1.5, 2.1])), parameters))
    assert found.objective < 1e-10
    tried = [(it.note, list(it.values)) for it in found.iterations]
    stronger = [values for note, values in tried if note.startswith("stronger")]
    np.testing.assert_allclose(stronger, np.outer([1.1, 1.21], [1.2, 1.8]))
    assert [note for note, _ in tried if note.startswith("stronger")] == [
        "stronger: no solution",
        "stronger",
    ]
    # the scan sees soon that this is better than what lies above: it is not lowered as far as here
    assert sum(note.startswith("strength ") for note, _ in tried) <= 3


def test_where_everything_in_the_bounds_collapses_the_start_is_refused():
    bars = PlasticBars([Frame([1.0], [0], [50.0])], 1)
    with pytest.raises(CollapseError):
        run(problem_of(bars, [1.0]))


def one_unreached():
    """k1 = 1 is reached in both frames; then u = (3.875 - 1) / 2.5 = 1.15, and bar 2 bears 2.3."""
    first = Frame([1.0, 2.0, 0.5], [0, 1, None], [1.0, 3.875])
    return PlasticBars([first, Frame([1.0, 1.0], [0, None], [1.0, 2.5])], 2)


def test_a_plane_that_nothing_reaches_has_only_a_lower_bound():
    bars = one_unreached()
    found = run(problem_of(bars, bars.readings(np.array([1.0, 5.0]))))
    assert found.values[0] == pytest.approx(1.0, rel=1e-6)
    assert found.certificate.lower_bounds == {"k2": pytest.approx(2.3, rel=1e-5)}
    assert found.values[1] >= 2.3


@pytest.mark.parametrize(("sd", "told"), [(0.2, True), (1e-4, False)])
def test_a_strength_that_few_readings_bound_from_above_is_told(sd, told):
    """k2 = 2.2 is reached with 2.3, a little, which readings of 0.2 do not see."""
    bars = one_unreached()
    noise = sd * np.array([0.1, -0.2, 0.3, 0.2])
    problem = problem_of(bars, bars.readings(np.array([1.0, 2.2])) + noise, sd=sd)
    found = run(problem)
    said = any("k2 is so large" in remark for remark in found.certificate.remarks)
    assert said == told
    assert not any("k1 is so large" in remark for remark in found.certificate.remarks)


def test_a_strength_without_upper_bound_does_not_end_the_test_of_those_after_it():
    bars, p = one_unreached(), np.array([0.9, 2.2])
    first, second = unknowns(2)
    endless = replace(first, upper=np.inf)
    problem = problem_of(bars, bars.readings(p), (endless, second), sd=0.2)
    search = evaluator_of(problem)
    both = np.array([True, True])
    found = open_above(search, search.evaluate(np.log(p)), both, spent=lambda: False)
    assert found.tolist() == [False, True]


def test_at_a_kink_the_sides_are_compared():
    # readings pull the strength up to 1, where a bar ceases to yield, and down from there
    bars = kinked()
    found = run(problem_of(bars, [0.9, 3.05], sd=1.0))
    assert found.values == pytest.approx([1.0], abs=1e-3)
    assert found.objective == pytest.approx(0.1**2 + 0.05**2, rel=1e-3)
    assert found.certificate.kind == "stationary on the active pieces"
    assert any("kink" in remark for remark in found.certificate.remarks)
    assert found.status == "converged"


def kinked():
    return PlasticBars(
        [Frame([1.0, 1.0], [0, None], [2.0]), Frame([1.0, 1.0], [0, None], [4.0])], 1
    )


def test_a_point_beside_a_kink_that_is_lower_is_found():
    problem = problem_of(kinked(), [0.9, 3.05], sd=1.0)
    search = evaluator_of(problem)
    high = search.evaluate(np.log([1.1]))
    found = check(search, high, exact=False, spent=lambda: False)
    assert found.gradient > 0.1
    assert found.lower.phi < high.phi
    assert found.lower.p[0] < high.p[0]


def quiet(iteration):
    return None


def evaluator_of(problem):
    history = History("test", problem.response, quiet)
    return yield_evaluator(Discrepancy(problem), history, problem.response)


def test_smooth_minima_are_strongly_stationary():
    bars = three_strengths()
    noise = 1e-3 * np.random.default_rng(3).standard_normal(6)
    problem = problem_of(bars, bars.readings(TRUTH) + noise)
    found = run(problem)
    truth = float(np.sum((noise / 1e-3) ** 2))
    assert found.objective <= truth
    assert found.certificate.kind == "strongly stationary"
    assert found.certificate.gradient < 1e-4
    assert np.isnan(found.certificate.bound)


@pytest.mark.slow
@pytest.mark.parametrize("site", [deep_opening, notched_plate])
def test_finds_on_real_meshes_what_a_descent_alone_does_not(site):
    found, alone = [], []
    for seed in range(4):
        given = task(site(4), seed)
        exact = 1e-8 * len(given.problem.measured)
        found.append(run(given.problem).objective < exact)
        with suppress(ModelError):
            single = gauss_newton(given.problem, GaussNewtonOptions(), quiet)
            alone.append(single.objective < exact)
    assert all(found)
    assert sum(alone) < len(found)


def many_kinks():
    rng = np.random.default_rng(1)
    frames = [
        Frame([*rng.uniform(0.2, 5.0, 8), 0.1], [*rng.integers(0, 4, 8), None], [3.0, 8.0, 12.0])
        for _ in range(3)
    ]
    bars = PlasticBars(frames, 4)
    problems = []
    for _ in range(4):
        truth, start = rng.uniform(0.7, 1.4, (2, 4))
        parameters = tuple(
            replace(q, start=float(s)) for q, s in zip(unknowns(4), 1.5 * start, strict=True)
        )
        problems.append(problem_of(bars, bars.readings(truth), parameters))
    return problems


def test_the_budget_of_evaluations_ends_the_search():
    bars = three_strengths()
    measured = bars.readings(TRUTH) * 1.05
    found = run(problem_of(bars, measured), max_evaluations=12)
    assert found.status == "not-converged"
    assert "max_evaluations" in found.reason
    assert len(found.iterations) <= 14


def test_the_observer_ends_the_search():
    bars = three_strengths()
    problem = problem_of(bars, bars.readings(TRUTH) * 1.05)

    def on_iteration(iteration):
        return "enough" if iteration.number == 7 else None

    found = identify(problem, [ComplementarityOptions()], on_iteration)
    assert (found.status, found.reason) == ("out-of-budget", "enough")
    assert len(found.iterations) == 8


def test_the_same_seed_gives_the_same_run():
    problem, *_ = many_kinks()
    first, second = run(problem), run(problem)
    assert np.array_equal(first.values, second.values)
    assert len(first.iterations) == len(second.iterations)


def test_a_prior_holds_what_readings_do_not_see():
    bars = one_unreached()
    first, second = unknowns(2)
    parameters = (first, replace(second, prior=Prior(3.0, 0.1)))
    found = run(problem_of(bars, bars.readings(np.array([1.0, 5.0])), parameters))
    assert found.values == pytest.approx([1.0, 3.0], rel=1e-4)


def test_it_needs_yield_limits():
    elastic = PlasticBars([Frame([1.0], [None], [1.0])], 1)
    with pytest.raises(InputError, match="no material of the model has yield limits"):
        identify(problem_of(elastic, [1.0]), [ComplementarityOptions()], quiet)


def test_only_unreached_strengths_are_moved():
    """An evaluation must not touch what is no idle strength, whatever its sign."""
    bars = PlasticBars([Frame([1.0, 1.0], [0, None], [2.0])], 2)
    second = Parameter("k2", -3.0, -9.0, -1.0)
    bars.admissible = lambda p: None
    problem = problem_of(bars, [1.2], (unknowns(1)[0], second))
    search = evaluator_of(problem)
    start = search.scaling.start
    seen = search.evaluate(start)
    assert seen.p[1] == -3.0
    assert seen.p[0] == pytest.approx(1.0, rel=1e-5)  # nothing yields at 2: brought near


def test_an_unreached_plane_is_brought_to_a_millionth_of_where_it_is_reached():
    """The bars carry 1 each of a load of 2; a strength that is nearer stays."""
    bars = PlasticBars([Frame([1.0, 1.0], [k, None], [2.0]) for k in range(3)], 3)
    search = evaluator_of(problem_of(bars, bars.readings(np.full(3, 0.8))))
    point = search.evaluate(search.scaling.start)
    assert point.unreached.all()
    assert point.p == pytest.approx(np.full(3, 1.0 + 2e-6), abs=1e-9)
    assert np.all(point.p > 1.0)
    p = np.array([1.0 + 4e-7, 1.0 + 8e-7, 1.5])
    near = search.evaluate(search.scaling.to_scaled(p))
    assert near.p == pytest.approx([*p[:2], 1.0 + 1.5e-6], rel=0.0, abs=1e-10)


def test_a_descent_alone_begins_at_the_start_and_scans_nothing():
    bars, seen = three_strengths(), []
    problem = problem_of(bars, bars.readings(TRUTH), unknowns(3, start=2.5))
    found = descend(problem, ComplementarityOptions(), seen.append)
    assert found.values == pytest.approx(TRUTH, rel=1e-6)
    assert found.certificate.kind == "global"
    assert seen[0].note == "start"
    assert {note.note for note in seen} <= {"start", "accepted", "accepted: detour", "rejected"}
    weak = problem_of(PlasticBars([Frame([1.0], [0], [0.9])], 1), [1.0], unknowns(1, start=0.5))
    with pytest.raises(CollapseError):
        descend(weak, ComplementarityOptions(), quiet)


def test_where_no_start_has_a_solution_the_first_says_why():
    bars, notes = PlasticBars([Frame([1.0], [0], [5.0])], 1), []
    problem = problem_of(bars, [1.0], unknowns(1, start=1.0, upper=4.0))
    with pytest.raises(CollapseError, match="cannot carry the load"):
        identify(problem, [ComplementarityOptions()], lambda entry: notes.append(entry.note))
    assert notes == ["start: no solution", *["rescue: no solution"] * 9]
    assert certificate_at(problem, np.array([1.0]), History("test", bars, quiet)) is None


def test_the_end_of_another_search_is_judged_by_the_same_rules():
    bars = three_strengths()
    problem = problem_of(bars, bars.readings(TRUTH))
    exact = certificate_at(problem, TRUTH, History("test", bars, quiet))
    assert (exact.kind, exact.bound) == ("global", 0.0)
    off = certificate_at(problem, 1.1 * TRUTH, History("test", bars, quiet))
    assert off.kind == "not stationary"
