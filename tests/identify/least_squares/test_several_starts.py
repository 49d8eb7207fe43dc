"""Several descents: when they begin, where, and which minima are one."""

from types import SimpleNamespace

import numpy as np
import pytest

from geoident.errors import ModelError
from geoident.identify.least_squares.descent import plain_evaluator
from geoident.identify.least_squares.gauss_newton import gauss_newton
from geoident.identify.least_squares.several_starts import (
    Angles,
    SeveralStarts,
    spread,
    start_ranges,
)
from geoident.identify.problem.outcome import History
from geoident.identify.problem.problem import Discrepancy
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


def test_a_start_is_spread_over_the_circle_from_where_the_user_began():
    scaling = Scaling([E, DIP])
    angles = Angles([E, DIP], scaling)
    points = spread(scaling, angles, scaling.start, angles.sought)
    x = np.array([scaling.start, *(next(points) for _ in range(3))])
    np.testing.assert_array_equal(x[:, 0], scaling.start[0])  # the rest starts as given
    turn = (x[:, 1] - x[0, 1]) / (3.1 / scaling.reference[1])
    np.testing.assert_allclose(np.sort(turn % 1.0), [0.0, 0.25, 0.5, 0.75], atol=1e-12)


def boxes(count):
    return [Parameter(f"p{n}", 1.0, -1.0 - n, 2.0 + n) for n in range(count)]


def spread_shares(parameters, count):
    """Starts (count, n) as parts of the way from bound to bound."""
    scaling = Scaling(parameters)
    angles = Angles(parameters, scaling)
    points = spread(scaling, angles, scaling.start, range(len(parameters)))
    x = np.array([next(points) for _ in range(count)])
    return (x - scaling.lower) / (scaling.upper - scaling.lower)


@pytest.mark.parametrize("first", [0, 1, 17])
def test_thirty_successive_starts_fill_every_cell_once(first):
    """Halton's sequence in the bases 2, 3 and 5."""
    shares = spread_shares(boxes(3), first + 30)[first:]
    cells = {tuple(cell) for cell in np.floor(shares * (2, 3, 5) + 1e-9).astype(int).tolist()}
    assert len(cells) == 30


def test_of_many_parameters_twelve_are_spread_angles_first():
    shares = spread_shares([*boxes(14), DIP], 20)
    varied = np.flatnonzero(np.ptp(shares, axis=0) > 0.0)
    assert varied.tolist() == [*range(11), 14]
    assert len(np.unique(shares[:, 14])) == 20


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


@pytest.mark.parametrize("starts", [1, 3])
def test_an_explicit_number_of_starts_stays(make_problem, starts):
    problem = make_problem(axis, [DIP, E], axis(np.array([0.5, 2.0])), 0.01)
    notes = [step.note for step in run(problem, starts=starts).iterations]
    assert sum(note.startswith("start") for note in notes) == starts


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
    promised = bend**2 / (100.0 + bend**2)
    said = f"promise {promised:.1g} less" if status == "converged" else "not smooth here"
    assert said in found.reason


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


def cubic(p):
    """phi = r^2 with r = p^3 - 3 p + 4: with half its gradient r r' by hand."""
    return np.array([p[0] ** 3 - 3.0 * p[0] + 4.0])


@pytest.mark.parametrize(("part", "seen"), [(0.99, True), (1.01, False)])
def test_a_way_begins_uphill_where_the_slope_promises_a_part_of_the_fall(make_problem, part, seen):
    """From 0.9 to -2 phi falls from 4.12 to 4, while its slope promises a rise of 2 r r' (-2.9)."""
    problem = make_problem(cubic, [Parameter("x", 0.9, -4.0, 4.0)], [0.0], 1.0)
    discrepancy = Discrepancy(problem)
    evaluator = plain_evaluator(discrepancy, History("", problem.response, lambda one: None))
    for value in (0.9, -2.0):
        evaluator.evaluate(discrepancy.scaling.to_scaled(np.array([value])))
    r, slope = 0.9**3 - 2.7 + 4.0, 3.0 * 0.81 - 3.0
    fall, rise = r**2 - 4.0, 2.0 * r * slope * (-2.9)
    assert evaluator.begins_uphill(part * rise / fall, 0.0) is seen
    assert not evaluator.begins_uphill(0.1 * rise / fall, 1.001 * fall)


def given_up(phi, gain, length, *, best=10.0, status="converged", away=0.4):
    """Whether a further descent is left at phi, before a step of a gain that ends at 1 + away.

    The best one has ended at 1; the whole has five readings more than parameters.
    """
    model = SimpleNamespace(jacobian=np.eye(1))
    minimum = SimpleNamespace(phi=best, x=np.array([1.0]), model=model)
    search = SimpleNamespace(
        _endings=[SimpleNamespace(point=minimum, status=status)],
        freedom=5,
        angles=SimpleNamespace(differences=lambda x, y: [y - x]),
        evaluator=SimpleNamespace(box=SimpleNamespace(reach=lambda x, d: np.array([1.0 + away]))),
    )
    step = SimpleNamespace(gain=gain, length=length, d=None)
    return SeveralStarts._not_worth_it(search, SimpleNamespace(phi=phi, x=None), step)


@pytest.mark.parametrize(
    ("phi", "gain", "length", "best", "left"),
    [
        # phi 10 with five readings to spare: its scatter is 2, so rivals may lie 8 above it; twice
        # that, 16, is left where three times the gain of a short step does not lead below
        (33.0, 2.0, 1.0, 10.0, True),
        (33.0, 2.0, 1.01, 10.0, False),
        (33.0, 2.4, 1.0, 10.0, False),
        # phi 2 is less than can be expected: rivals lie 4 above it
        (15.0, 1.6, 0.5, 2.0, True),
        (15.0, 1.7, 0.5, 2.0, False),
    ],
)
def test_a_descent_that_ends_far_above_the_best_is_left(phi, gain, length, best, left):
    assert given_up(phi, gain, length, best=best) == left


def test_a_descent_that_ends_at_a_known_minimum_is_left():
    near = {"phi": 12.05, "gain": 2.0, "length": 0.3}
    assert given_up(**near)
    assert not given_up(**{**near, "length": 0.31})
    assert not given_up(**{**near, "phi": 12.15})
    assert not given_up(**{**near, "phi": 11.85})
    assert not given_up(**near, away=0.6)
    assert not given_up(**near, status="stopped")
    # 10.05 leads to 9.95, a minimum known at 10: it is left from above, and not where it is lower
    assert given_up(10.05, 0.1, 0.3)
    assert given_up(10.0, 0.1, 0.3)
    assert not given_up(9.99, 0.01, 0.3)
