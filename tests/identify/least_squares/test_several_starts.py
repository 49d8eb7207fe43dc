"""Several descents: when they begin, where, and which minima are one."""

from types import SimpleNamespace

import numpy as np
import pytest

from geoident.errors import ModelError
from geoident.identify.least_squares.acceptance import Iterate
from geoident.identify.least_squares.gauss_newton import gauss_newton
from geoident.identify.least_squares.several_starts import (
    Angles,
    at_minimum,
    distinct_minima,
    start_ranges,
)
from geoident.identify.problem.problem import Linearization
from geoident.identify.problem.scaling import Scaling
from geoident.model.methods import GaussNewtonOptions
from geoident.model.parameter import Parameter, Prior

DIP = Parameter("dip", 0.3, -1.55, 1.55, dimension="angle", period=np.pi)
E = Parameter("E", 2.0, 0.1, 50.0, "log")


def run(problem, **options):
    return gauss_newton(problem, GaussNewtonOptions(**options), lambda _: None)


def axis(p):
    """Readings of a dip and a size that repeat after half a turn, with a hill in between."""
    a = 2.0 * p[0]
    return np.array([p[1] * np.cos(a), p[1] * np.sin(a), np.cos(2.0 * a)])


def test_a_prior_keeps_starts_near():
    known = Parameter("dip", 0.3, -1.55, 1.55, prior=Prior(0.4, 0.1), period=np.pi)
    low, high = start_ranges(Scaling([known]))
    scaling = Scaling([known])
    np.testing.assert_allclose(low * scaling.reference, 0.1)
    np.testing.assert_allclose(high * scaling.reference, 0.7)
    assert Angles([known], scaling).sought == ()
    assert Angles([DIP], Scaling([DIP])).sought == (0,)


def test_a_descent_goes_on_past_the_bound_of_an_angle(make_problem):
    """The answer lies 2 degrees past the upper bound: it is found behind the lower one."""
    truth = np.array([1.58, 2.0])
    parameters = [
        Parameter("dip", 1.2, -1.57, 1.45, period=np.pi),
        Parameter("E", 2.0, 0.1, 9.0, "log"),
    ]
    problem = make_problem(axis, parameters, axis(truth), 0.01)
    outcome = run(problem, starts=1)
    assert any(step.note == "past the bound of an angle" for step in outcome.iterations)
    np.testing.assert_allclose(outcome.values, [1.58 - np.pi, 2.0], rtol=1e-6)


def test_minima_that_differ_by_a_period_are_one(make_problem):
    wide = [Parameter("dip", 0.2, -4.0, 4.0, period=np.pi), Parameter("E", 2.0, 0.1, 9.0, "log")]
    problem = make_problem(axis, wide, axis(np.array([0.5, 2.0])), 0.01)
    assert run(problem, starts=12).minima == ()
    told_nothing = [Parameter("dip", 0.2, -4.0, 4.0), wide[1]]
    assert len(run(make_problem(axis, told_nothing, problem.measured, 0.01), starts=12).minima) >= 1


def test_a_dip_turned_over_with_its_direction_is_the_same(make_problem):
    """The normal of planes that dip by -d towards a is that of d towards a + 180 degrees."""

    def normal(p):
        n = np.array([np.sin(p[0]) * np.sin(p[1]), np.sin(p[0]) * np.cos(p[1]), np.cos(p[0])])
        return np.outer(n, n)[np.triu_indices(3)]

    parameters = [
        Parameter("dip", 0.4, -1.5, 1.5, period=np.pi, mirror=("towards", np.pi)),
        Parameter("towards", 1.0, 0.0, 6.2, period=2 * np.pi),
    ]
    measured = normal(np.array([0.6, 1.4])) + 0.003 * np.array([1, -1, 1, 1, -1, 1])
    outcome = run(make_problem(normal, parameters, measured, 0.01), starts=20)
    assert outcome.minima == ()
    free = [Parameter(q.name, q.start, q.lower, q.upper) for q in parameters]
    assert len(run(make_problem(normal, free, measured, 0.01), starts=20).minima) >= 1


def valleys(p):
    """Lowest at 2, where all vanishes; other minima about every 1.4."""
    return np.array([4.0 * np.sin(4.0 * p[0]) - 4.0 * np.sin(8.0), 3.0 * (p[0] - 2.0)])


def test_a_hill_that_the_search_saw_makes_it_begin_elsewhere_too(make_problem):
    """A step led over a hill: from there the way back to the better point begins uphill."""
    straight = run(make_problem(valleys, [Parameter("x", 0.3, -4.0, 4.0)], [0, 0], 1))
    np.testing.assert_allclose(straight.values, [0.589], atol=1e-3)  # it saw nothing of the others
    assert straight.remarks == ()
    found = run(make_problem(valleys, [Parameter("x", 0.14, -4.0, 4.0)], [0, 0], 1))
    assert found.remarks == ("the search had 5 starts, as the way to a better point began uphill",)
    np.testing.assert_allclose(found.values, [2.0], atol=1e-6)
    assert any(abs(minimum.values[0] - 0.589) < 1e-3 for minimum in found.minima)


def test_a_kink_makes_the_search_begin_elsewhere_too(make_problem):
    """Readings that jump: no step lowers the misfit, although the derivatives say so."""
    q = [Parameter("x", 0.9, -4.0, 4.0)]
    jump = make_problem(
        lambda p: np.array([p[0] + (p[0].real < 0.8) * 5.0, 0.1 * p[0]]), q, [0, 0], 1
    )
    found = run(jump)
    assert run(jump, starts=1).status == "not-converged"
    assert found.objective < run(jump, starts=1).objective
    assert found.remarks == ("the search had 5 starts, as the misfit has kinks where it ended",)


def test_convex_problems_cost_what_one_descent_costs(make_problem):
    rng = np.random.default_rng(4)
    A = rng.normal(size=(6, 3))
    q = [Parameter(f"x{i}", 1.0, -9.0, 9.0) for i in range(3)]
    problem = make_problem(lambda p: A @ p, q, rng.normal(size=6), 0.1)
    assert len(run(problem).iterations) == len(run(problem, starts=1).iterations)


@pytest.mark.parametrize(("bend", "status"), [(0.1, "converged"), (3.0, "not-converged")])
def test_a_kink_that_hides_next_to_nothing_is_the_answer(make_problem, bend, status):
    """At x = 1 the second reading bends: the slopes to both sides promise bend^2 / 100 or so."""

    def function(p):
        side = p[0] - 1.0
        return np.array([10.0 * side, bend * (side if side.real > 0.0 else -side)])

    problem = make_problem(function, [Parameter("x", 0.3, -4.0, 4.0)], [0, -1.0], 1)
    found = run(problem, starts=1)
    np.testing.assert_allclose(found.values, [1.0], atol=0.05)
    assert found.status == status
    finer = run(problem, starts=1, tolerance=1e-12)  # below some length a step is rounding
    assert len(finer.iterations) <= len(found.iterations) + 2
    assert "not smooth here" in found.reason
    if status == "converged":
        promised = float(found.reason.split("at most ")[1].split(",")[0])
        assert found.objective - 1.0 <= promised <= 1e-3


def test_rough_readings_end_the_search_where_little_is_left(make_problem):
    """Readings have teeth of a thousandth, as those of a wall that sticks and slips."""

    def function(p):
        x, y = p
        teeth = 300.0 * (x + 0.37 * y)
        tooth = 1e-3 * (teeth - np.floor(teeth.real))
        return np.array([x + tooth, y - 2.0 * tooth, x + y + tooth, 0.0 * x])

    q = [Parameter("x", 0.3, -4.0, 4.0), Parameter("y", 0.3, -4.0, 4.0)]
    found = run(make_problem(function, q, [1.0, 1.2, 2.5, 5.0], 0.3), starts=1)
    assert found.status == "converged"
    assert "not smooth here" in found.reason
    assert len(found.iterations) <= 10
    np.testing.assert_allclose(found.values, [1.1, 1.3], atol=0.1 * 0.3)


def collapsing(p):
    """Readings of ground that collapses below a strength of 1."""
    if p[0] < 1.0:
        raise ModelError("the ground collapses")
    return np.array([1.0 / p[0], 1.0 / p[0] ** 2])


def test_where_the_given_start_has_no_solution_another_one_takes_its_place(make_problem):
    strength = Parameter("strength", 0.5, 0.1, 20.0, "log")
    problem = make_problem(collapsing, [strength], collapsing(np.array([3.0])), 0.01)
    outcome = run(problem, starts=10)
    np.testing.assert_allclose(outcome.values, [3.0], rtol=1e-6)
    assert outcome.remarks == (
        "the search began elsewhere than at the given start: the ground collapses",
    )
    with pytest.raises(ModelError, match="the ground collapses"):
        run(problem, starts=1)


# Angles


def two_angles():
    """A size, a strike of period 2 pi with nearly all of it, a dip of period pi with less."""
    strike = Parameter("strike", 1.0, 0.2, 6.2, period=2.0 * np.pi)
    dip = Parameter("dip", 0.4, -1.3, 1.5, period=np.pi, mirror=("strike", np.pi))
    parameters = [E, dip, strike]
    scaling = Scaling(parameters)
    return scaling, Angles(parameters, scaling)


@pytest.mark.parametrize(("part", "sought"), [(0.251, (1,)), (0.249, ())])
def test_an_angle_is_sought_where_more_than_a_quarter_of_its_period_is_open(part, sought):
    q = [E, Parameter("a", 3.0, 2.0, 2.0 + part * 8.0, period=8.0)]
    assert Angles(q, Scaling(q)).sought == sought


def test_differences_are_the_shortest_of_all_that_mean_the_same():
    """Against all turns and the mirrored dip, tried one by one."""
    scaling, angles = two_angles()
    rng = np.random.default_rng(3)
    unit = scaling.reference
    for _ in range(20):
        x, y = rng.uniform(-9.0, 9.0, (2, 3))
        images = [y, np.array([y[0], -y[1], y[2] + np.pi / unit[2]])]
        expected = []
        for image in images:
            d = image - x
            for i, period in ((1, np.pi), (2, 2.0 * np.pi)):
                d[i] = min((d[i] + k * period / unit[i] for k in range(-20, 21)), key=abs)
            expected.append(d)
        np.testing.assert_allclose(list(angles.differences(x, y)), expected, atol=1e-12)


# Where starts lie


def test_starts_range_over_the_bounds_as_far_as_priors_let_them():
    parameters = [
        Parameter("a", 3.0, 1.0, 9.0),
        Parameter("b", 4.0, -np.inf, np.inf),
        Parameter("c", 4.0, 2.0, np.inf, "log"),
        Parameter("d", 20.0, 1.0, 900.0, "log", Prior(30.0, 6.0, "lognormal")),
        Parameter("e", 20.0, 25.0, 900.0, "log", Prior(30.0, 5.0)),
        Parameter("f", 5.0, 0.0, 90.0, prior=Prior(40.0, 10.0)),
    ]
    scaling = Scaling(parameters)
    low, high = start_ranges(scaling)
    expected = [
        (1.0, 9.0),
        (4.0 - 2.0 * 4.0, 4.0 + 2.0 * 4.0),
        (2.0, 4.0 * np.exp(2.0)),
        (30.0 * np.exp(-0.6), 30.0 * np.exp(0.6)),
        (25.0, 45.0),
        (10.0, 70.0),
    ]
    np.testing.assert_allclose(
        np.transpose([scaling.to_natural(low), scaling.to_natural(high)]), expected
    )
    beyond = Scaling([Parameter("a", 3.0, 2.0, 9.0, prior=Prior(-5.0, 1.0))])
    low, high = start_ranges(beyond)
    assert low == high == beyond.lower


# The order of descents


def told(problem, stop=None, **options):
    """What is noted of every evaluation, and the outcome."""
    notes = []

    def on_iteration(entry):
        notes.append(entry.note)
        return "Enough." if entry.note == stop else None

    return notes, gauss_newton(problem, GaussNewtonOptions(**options), on_iteration)


def test_the_starts_before_the_first_that_has_a_solution_are_not_made_again(make_problem):
    """Halton's points are 1.4, 0.4, 5.3, 0.2, 2.7: only two of them stand."""
    strength = Parameter("strength", 0.5, 0.1, 20.0, "log")

    def weak(p):
        if p[0].real < 2.0:
            raise ModelError("the ground collapses.")
        return collapsing(p)

    problem = make_problem(weak, [strength], collapsing(np.array([3.0])), 0.01)
    notes, outcome = told(problem, starts=6)
    starts = [note for note in notes if note.startswith("start")]
    assert starts == [
        "start 2: no solution",
        "start 3: no solution",
        "start 4",
        "start 5: no solution",
        "start 6",
    ]
    places = [0.1 * 200.0**share for share in (0.5, 0.25, 0.75, 0.125, 0.625)]
    assert [entry.values[0] for entry in outcome.iterations if entry.note in starts] == (
        pytest.approx(places)
    )
    assert outcome.remarks == (
        "the search began elsewhere than at the given start: the ground collapses",
    )
    with pytest.raises(ModelError, match="collapses"):
        told(problem, starts=3)


def test_an_observer_stops_before_the_next_start(make_problem):
    problem = make_problem(axis, [DIP, E], axis(np.array([0.5, 2.0])), 0.01)
    notes, outcome = told(problem, "start 2", starts=4)
    assert notes[-1] == "start 2"
    assert (outcome.status, outcome.reason) == ("out-of-budget", "Enough.")


def test_what_makes_a_search_begin_elsewhere_is_named(make_problem):
    """Only the angles vary then."""
    other = Parameter("strike", 1.0, 0.0, 6.2, period=2.0 * np.pi)

    def function(p):
        return np.array([p[1] * np.cos(2 * p[0]), p[1] * np.sin(2 * p[0]), p[1] * np.cos(p[2])])

    measured = function(np.array([0.5, 2.0, 1.2]))
    notes, one = told(make_problem(lambda p: function([*p, 1.0]), [DIP, E], measured, 0.01))
    assert one.remarks == ("the search had 5 starts, as dip is an angle",)
    assert [n for n in notes if n.startswith("start")] == [
        "start",
        *(f"start {k}" for k in range(2, 6)),
    ]
    _, two = told(make_problem(function, [DIP, E, other], measured, 0.01))
    assert two.remarks == ("the search had 5 starts, as dip and strike are angles",)
    begun = [entry.values for entry in two.iterations if entry.note.startswith("start")]
    assert {p[1] for p in begun} == {begun[0][1]}
    assert len({p[0] for p in begun}) == len({p[2] for p in begun}) == 5


def minimum(phi, x, J):
    J = np.array(J, dtype=float)
    r = np.array([np.sqrt(phi), 0.0])
    return Iterate(np.array(x), np.array(x), Linearization(r, J, r))


NO_ANGLES = SimpleNamespace(differences=lambda x, y: [y - x])
WEAK, STIFF = [[1.0, 0.0], [0.0, 1.0]], [[2.0, 0.0], [0.0, 1.0]]


def test_two_points_are_one_minimum_where_the_readings_of_both_are_alike():
    """Half a standard deviation apart, as both see it, and a tenth of phi."""
    first = minimum(4.0, [0.0, 0.0], WEAK)
    assert at_minimum(first, np.array([0.3, 0.4]), NO_ANGLES)
    assert not at_minimum(first, np.array([0.3, 0.41]), NO_ANGLES)
    images = SimpleNamespace(differences=lambda x, y: [y - x + 9.0, y - x])
    assert at_minimum(first, np.array([0.3, 0.4]), images)
    near = {"phi": 4.09, "x": [0.3, 0.0], "J": WEAK}
    for other, kept in (
        (near, 1),
        (near | {"phi": 4.11}, 2),
        (near | {"x": [0.51, 0.0]}, 2),
        (near | {"J": STIFF}, 2),  # seen from there they are 0.6 apart
        (near | {"J": STIFF, "x": [0.24, 0.0]}, 1),
    ):
        assert len(distinct_minima([first, minimum(**other)], NO_ANGLES)) == kept
