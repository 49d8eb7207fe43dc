"""Kinds of stationary points, and the limits between them."""

import numpy as np
import pytest

from geoident.identify.least_squares.descent import Evaluator
from geoident.identify.problem.outcome import History
from geoident.identify.problem.problem import Discrepancy, Linearization, Problem
from geoident.identify.yield_limits.stationarity import (
    StationarityCheck,
    certificate,
    check,
    open_above,
)
from geoident.identify.yield_limits.yield_points import YieldIterate, headroom, strengths, unreached
from geoident.model.parameter import Parameter
from geoident.model.results.costs import Counts
from geoident.model.yielding import Activity

NAMES = ("a", "b")


def activity(*, biactive=0, points=(1, 1), reached=(0.5, 0.5), slopes=None, distances=(1.0, 1.0)):
    slopes = np.eye(2) if slopes is None else np.array(slopes, dtype=float)
    return Activity(
        planes=("p", "q"),
        stages=("dig",),
        points=np.array(points)[:, None],
        biactive=np.array([[biactive], [0]]),
        distances=np.array(distances, dtype=float),
        reached=np.array(reached, dtype=float),
        slopes=slopes,
    )


class Scripted:
    """A response of two parameters with given residuals; what is read is zero."""

    names = NAMES
    counts = Counts()

    def __init__(self, residuals, jacobian=((1.0, 0.0), (0.0, 1.0))):
        self.residuals, self.jacobian = residuals, np.array(jacobian, dtype=float)

    def admissible(self, p):
        return None

    def readings(self, p):
        return np.array(self.residuals(p), dtype=float)

    def evaluate(self, p):
        return np.array(self.residuals(p), dtype=float), self.jacobian


def searched(residuals, jacobian=((1.0, 0.0), (0.0, 1.0)), *, parameters=None, found=None):
    """An evaluator, its history and its point at the start."""
    parameters = parameters or tuple(Parameter(n, 1.0, -np.inf, np.inf) for n in NAMES)
    response = Scripted(residuals, jacobian)
    m = len(response.jacobian)
    problem = Problem(response, np.zeros(m), np.ones(m), parameters)
    history = History("test", response, lambda entry: None)
    found = activity() if found is None else found

    def look(point):
        return YieldIterate(point.x, point.p, point.linearization, np.zeros(2, dtype=bool), found)

    evaluator = Evaluator(Discrepancy(problem), history, look)
    return evaluator, history, evaluator.evaluate(evaluator.scaling.start)


def never():
    return False


# Around a point


@pytest.mark.parametrize(("cosine", "smooth"), [(0.9e-4, True), (1.1e-4, False)])
def test_a_gradient_that_is_nearly_zero_proves_a_smooth_minimum(cosine, smooth):
    J = [[cosine, 0.0], [1.0, 0.0], [0.0, 1.0]]
    evaluator, _, point = searched(lambda p: [5.0, 0.0, 0.0], J)
    found = check(evaluator, point, exact=False, spent=never)
    assert found.gradient == pytest.approx(cosine)
    assert (found.probes == 0) == smooth
    assert found.lower is None


def test_at_a_kink_points_a_thousandth_away_are_compared():
    found = activity(biactive=1)
    evaluator, history, point = searched(lambda p: [3.0, 4.0], found=found)
    checked = check(evaluator, point, exact=False, spent=never)
    away = np.array([entry.values for entry in history.iterations]) - 1.0
    assert checked.probes == len(away) == 6
    expected = [[1, 0], [0, 1], [-1, 0], [0, -1], [-0.75, -1], [-1, -1]]
    np.testing.assert_allclose(away, 1e-3 * np.array(expected), atol=1e-6)
    assert {entry.note for entry in history.iterations} == {"probe"}
    assert {entry.step for entry in history.iterations} == {1e-3}


# The certificate


def certified(checked, *, exact=False, above=(), found=None):
    return certificate(checked, found or activity(), NAMES, exact=exact, above=above)


def checked_point(*, probes=0, lower=None, jacobian=((1.0, 0.0), (0.0, 1.0))):
    point = YieldIterate(
        np.ones(2),
        np.array([3.0, 4.0]),
        Linearization(np.ones(2), np.array(jacobian, dtype=float), np.ones(2)),
        np.zeros(2, dtype=bool),
        activity(),
    )
    return StationarityCheck(point, 0.25, probes, point if lower else None)


def test_kinds_of_points():
    kink = activity(biactive=1)
    assert certified(checked_point(), exact=True, found=kink).kind == "global"
    assert certified(checked_point()).kind == "strongly stationary"
    assert certified(checked_point(probes=3)).kind == "stationary on the active pieces"
    assert certified(checked_point(probes=3), found=kink).kind == "stationary on the active pieces"
    assert certified(checked_point(probes=3, lower=True)).kind == "not stationary"
    assert certified(checked_point(), found=kink).kind == "not stationary"


def test_what_is_said_of_a_point():
    kink = activity(biactive=2)
    exact = certified(checked_point(), exact=True)
    assert exact.remarks == (
        "The readings are reproduced exactly: no parameters can fit them better.",
    )
    assert (exact.bound, exact.gradient) == (0.0, 0.25)
    assert certified(checked_point()).remarks == ()
    assert np.isnan(certified(checked_point()).bound)
    assert certified(checked_point(probes=3), found=kink).remarks == (
        "The answer lies at a kink of the response: 3 points around it were compared, and none is "
        "better.",
    )
    assert certified(checked_point(probes=3)).remarks == (
        "The answer lies very close to a kink of the response: 3 points around it were compared, "
        "and none is better.",
    )
    assert certified(checked_point(probes=3, lower=True), found=kink).remarks == (
        "The answer lies at a kink of the response, and a point near it is better.",
    )
    above = certified(checked_point(), above=("b",))
    assert above.open_above == ("b",)
    assert above.remarks == (
        "The readings do not exclude that b is so large that no strain point reaches its planes: "
        "its interval has no upper end.",
    )


def test_an_unreached_strength_has_a_lower_bound():
    found = activity(points=(1, 0), reached=(1.0, 0.3))
    lower = certified(checked_point(jacobian=((1.0, 0.0), (1.0, 0.0))), found=found).lower_bounds
    assert lower == {"b": pytest.approx(4.0 - 0.7)}
    seen = certified(checked_point(), found=found).lower_bounds  # b has a derivative
    assert seen == {}


# Intervals that are open above


@pytest.mark.parametrize(("growth", "above"), [(3.83, True), (3.85, False)])
def test_a_growth_within_the_interval_does_not_exclude_the_upper_bound(growth, above):
    """At its upper bound, all else held by a stiff reading."""
    q = (Parameter("a", 1.0, 0.0, 9.0), Parameter("b", 1.0, -np.inf, np.inf))

    def residuals(p):
        return [np.sqrt(2.0 + (growth if p[0] == 9.0 else 0.0)), 0.0]

    evaluator, history, point = searched(residuals, parameters=q)
    both = np.array([True, True])
    assert open_above(evaluator, point, both, spent=never).tolist() == [above, False]
    assert [entry.note for entry in history.iterations] == ["from above"]


def test_ground_that_has_no_solution_there_excludes_the_upper_bound():
    q = (Parameter("a", 1.0, 0.0, 9.0), Parameter("b", 1.0, -np.inf, np.inf))
    evaluator, history, point = searched(lambda p: [1.0, 0.0], parameters=q)
    evaluator.discrepancy.problem.response.admissible = lambda p: "no" if p[0] == 9.0 else None
    assert not open_above(evaluator, point, np.array([True, False]), spent=never).any()
    assert [entry.note for entry in history.iterations] == ["from above: no solution"]


def test_the_other_parameters_follow():
    q = (Parameter("a", 1.0, 0.0, 9.0), Parameter("b", 1.0, -np.inf, np.inf))
    evaluator, _, point = searched(
        lambda p: [1.0 if p[0] < 9.0 else 0.0, 3.0 if p[0] == 9.0 else 1.0], parameters=q
    )
    only = np.array([True, False])
    # b can lower the second residual of 3 by 1.5 x of the first step
    assert open_above(evaluator, point, only, spent=never).tolist() == [True, False]
    assert not open_above(evaluator, point, only, spent=lambda: True).any()


# Unreached planes


def test_how_far_a_strength_can_fall():
    found = activity(
        points=(0, 0), reached=(1.5, -np.inf), distances=(2.0, 2.0), slopes=[[2.0, -1.0], [0, 0]]
    )
    assert headroom(found) == pytest.approx([0.25, np.inf])
    reached = activity(points=(1, 0), reached=(0.5, 3.0), slopes=[[2.0, 0.0], [0.0, 4.0]])
    assert headroom(reached).tolist() == [0.0, 0.0]  # one is reached, one stands beyond its plane


def test_what_moves_planes_outwards_only_is_a_strength():
    slopes = [[1.0, 1.0], [0.5, -0.5]]
    assert strengths(activity(slopes=slopes), np.ones(2)).tolist() == [True, False]
    tiny = [[1.0, 0.5e-12], [0.0, 0.0]]
    assert strengths(activity(slopes=tiny), np.ones(2)).tolist() == [True, False]
    assert strengths(activity(slopes=tiny), np.array([1.0, 4.0])).tolist() == [True, True]
    against = [[1.0, 1.0], [0.0, -0.5e-12]]
    assert strengths(activity(slopes=against), np.ones(2)).tolist() == [True, True]


def test_unreached_is_what_moves_only_planes_that_nothing_reaches():
    idle = activity(points=(0, 1), slopes=[[1.0, 0.0], [0.0, 1.0]])
    silent = np.zeros((3, 2))
    assert unreached(idle, silent).tolist() == [True, False]
    both = activity(points=(0, 1), slopes=[[1.0, 1.0], [1.0, 0.0]])
    assert unreached(both, silent).tolist() == [False, True]
    seen = np.array([[1e-100, 0.0]])
    assert unreached(idle, seen).tolist() == [False, False]
    none = activity(points=(0, 0), slopes=np.zeros((2, 2)))
    assert unreached(none, silent).tolist() == [False, False]
