"""The ways that a descent can go, step by step: stopped, left, closed, led by leaps."""

from dataclasses import dataclass, field
from types import SimpleNamespace

import numpy as np
import pytest

from geoident.errors import ModelError
from geoident.identify.least_squares.acceptance import Iterate, Step
from geoident.identify.least_squares.descent import (
    Descent,
    Stopping,
    plain_evaluator,
)
from geoident.identify.least_squares.gauss_newton import gauss_newton_step
from geoident.identify.least_squares.leap import Leap
from geoident.identify.least_squares.trust_region import TrustBox
from geoident.identify.problem.outcome import History
from geoident.identify.problem.problem import Discrepancy, Linearization, Problem
from geoident.identify.problem.scaling import Scaling
from geoident.model.parameter import Parameter
from geoident.model.results.costs import Counts

FREE = (Parameter("x", 1.0, -np.inf, np.inf),)


def iterate(x, residual, jacobian=((1.0,), (0.0,))):
    """By default one parameter that moves the first of two residuals."""
    x, r, J = (np.array(a, dtype=float) for a in (np.atleast_1d(x), residual, jacobian))
    return Iterate(x, x, Linearization(r, J))


START = iterate(0.0, [10.0, 1.0])
DETOUR = iterate(-1.0, [8.0, 30.0])  # above, and nearer
LOWER = iterate(-1.0, [9.0, 1.0])
REJECTED = iterate(-1.0, [10.0, 2.0])


class Scripted:
    """Stands for an evaluator: the points in turn, and what is noted of them."""

    def __init__(self, trials, *, stop=None, sharper=()):
        self.box = TrustBox(Scaling(FREE))
        self.history = SimpleNamespace(stop=stop)
        self.trials, self.sharp = list(trials), list(sharper)
        self.noted, self.asked = [], []

    def try_point(self, x):
        self.asked.append(float(x[0]))
        return self.trials.pop(0)

    def record(self, x, point, length, note):
        self.noted.append((float(x[0]), point, length, note))

    def sharper(self, point):
        self.asked.append("sharper")
        return self.sharp.pop(0) if self.sharp else None


@dataclass
class Rules:
    """Stands for the rules to stop: reasons in turn, and what is true."""

    reasons: list = field(default_factory=list)
    tolerance: float = 1e-6
    unseen: bool = False
    little: bool = False
    level: bool = False

    def reason(self, point, full):
        assert full.length >= 7.0  # not that of the trust region
        return self.reasons.pop(0) if self.reasons else None

    def hidden(self, point, change):
        self.compared = (point, change)
        return self.unseen

    def negligible(self, full):
        return self.little

    def flat(self, point):
        return self.level


def propose(point, radius):
    """A tenth of the radius; 7 without one, for a gain of 0.5."""
    if np.isinf(radius):
        return Step(np.array([-7.0]), 7.0, 0.5)
    return Step(np.array([-0.1 * radius]), 0.1 * radius, 0.01)


def gone(trials, rules, *, steps=9, give_up=None, leave=None, proposed=propose, leap=None, **given):
    evaluator = Scripted(trials, **given)
    more = {} if leap is None else {"leap": leap}
    descent = Descent(evaluator, proposed, rules, steps, **more)
    return evaluator, descent.run(START, give_up, leave)


def test_a_reason_at_the_first_point_ends_it_there():
    evaluator, found = gone([], Rules(["Done."]))
    assert (found.point, found.status, found.reason) == (START, "converged", "Done.")
    assert not found.abandoned
    assert evaluator.asked == ["sharper"]


def test_every_trial_is_noted_with_its_step():
    """A tenth of 1.5 downwards; a loss of 1 where 0 was promised along J d = -0.15."""
    evaluator, found = gone([LOWER, None], Rules([None, None, "Done."]))
    assert [(x, point, note) for x, point, _, note in evaluator.noted] == [
        (pytest.approx(-0.15), LOWER, "accepted"),
        (pytest.approx(-1.15), None, "rejected: no solution"),
    ]
    assert [length for *_, length, _ in evaluator.noted] == pytest.approx([0.15, 0.15])
    assert (found.point, found.status) == (LOWER, "converged")


def test_a_reason_on_a_detour_leads_back_to_the_best_point():
    """Unless the difference may be noise: then the detour's end is as good."""
    rules = Rules([None, "Done.", "Done indeed."])
    evaluator, found = gone([DETOUR, LOWER], rules)
    assert [note for *_, note in evaluator.noted] == ["accepted: detour", "accepted"]
    assert evaluator.asked[1] == pytest.approx(-0.1 * 0.25 * 0.15)  # from the best, shortened
    assert (found.point, found.reason) == (LOWER, "Done indeed.")
    assert rules.compared == (START, pytest.approx(64.0 + 900.0 - 101.0))
    _, hidden = gone([DETOUR], Rules([None, "Done."], unseen=True))
    assert (hidden.point, hidden.reason) == (DETOUR, "Done.")


@pytest.mark.parametrize(
    ("gain", "level", "status", "said"),
    [
        (0.5, True, "converged", "The misfit is flat here"),
        (0.9e-3, False, "converged", "promise 0.0009 less at most"),
        (1e-3, False, "converged", "promise 0.001 less at most"),
        (1.1e-3, False, "not-converged", "not smooth here"),
    ],
)
def test_where_the_radius_is_at_the_tolerance_slope_and_promise_decide(gain, level, status, said):
    """Of 1e-6: 0.4 of a step of 2.6e-6 is above it, of 2.49e-6 below."""

    def proposed(point, radius):
        if np.isinf(radius):
            return Step(np.array([-7.0]), 7.0, gain)
        length = 2.6e-6 if radius > 1.0 else 2.49e-6
        return Step(np.array([-length]), length, 0.01)

    evaluator, found = gone([None, None], Rules(level=level), proposed=proposed)
    assert len(evaluator.noted) == 2
    assert (found.point, found.status) == (START, status)
    assert said in found.reason
    assert found.stalled == (status == "not-converged")


def test_a_stop_ends_it_before_the_next_trial():
    evaluator, found = gone([], Rules(), stop="Enough.")
    assert evaluator.asked == []
    assert (found.status, found.stalled) == ("not-converged", True)
    evaluator, found = gone([], Rules(["Done."]), stop="Enough.")
    assert (evaluator.asked, found.status) == ([], "converged")


def test_used_up_steps_are_counted():
    evaluator, found = gone([LOWER, None, None], Rules(), steps=3)
    assert len(evaluator.noted) == 3
    assert (found.point, found.status) == (LOWER, "not-converged")
    assert "did not converge in 3 steps" in found.reason
    _, at_last = gone([LOWER], Rules([None, "Done."]), steps=1)
    assert (at_last.status, at_last.reason) == ("converged", "Done.")


@pytest.mark.parametrize(
    ("given", "status", "said"),
    [
        ({"little": True}, "converged", "what is left is rounding"),
        ({"unseen": True}, "converged", "lower the misfit by 0.5, no more than what is noise"),
        ({}, "not-converged", "did not converge in 1 steps"),
    ],
)
def test_a_rejected_trial_may_be_rounding_or_noise(given, status, said):
    rules = Rules(**given)
    _, found = gone([REJECTED], rules, steps=1)
    assert (found.point, found.status) == (START, status)
    assert said in found.reason
    if "unseen" in given:
        assert rules.compared == (START, 0.5)
    _, none = gone([None], Rules(**given), steps=1)  # no solution tells nothing of that
    assert "did not converge" in none.reason


def test_somebody_may_find_it_not_worth_going_on():
    """Asked before every step with the steps made, the radius and the lowest phi."""
    seen = []

    def give_up(number, radius, lowest):
        seen.append((number, radius, lowest))
        return number == 2

    evaluator, found = gone([DETOUR, LOWER], Rules(), give_up=give_up)
    assert (found.status, found.abandoned) == ("not-converged", True)
    assert "did not come near the best point" in found.reason
    assert seen == [(0, 1.5, 101.0), (1, 1.5, 101.0), (2, 1.5, 82.0)]
    assert "sharper" not in evaluator.asked


def test_it_is_left_by_what_comes_next():
    seen = []

    def leave(point, full):
        seen.append((point, full.length))
        return point is DETOUR

    evaluator, found = gone([DETOUR], Rules(), leave=leave)
    assert seen == [(START, 7.0), (DETOUR, 7.0)]
    assert (found.point, found.abandoned) == (START, True)
    assert len(evaluator.noted) == 1


def test_better_derivatives_have_the_last_word_as_often_as_there_are_any():
    """Each begins where the one before has ended, with the same rules to leave."""
    twice = [iterate(-1.0, [9.0, 1.0]), iterate(-1.0, [9.0, 1.0])]
    evaluator, found = gone([LOWER], Rules([None, "a", "b", "c"]), sharper=twice)
    assert evaluator.asked == [pytest.approx(-0.15), "sharper", "sharper", "sharper"]
    assert (found.point, found.reason) == (twice[1], "c")
    left, found = gone([], Rules(["a"]), sharper=twice, leave=lambda point, full: point is twice[0])
    assert found.abandoned
    assert left.asked == ["sharper"]


# Leaps


def quadratic(*, promised, leaps=99, steps=12):
    """Steps of 1 down r = x from 40; leaps of 2 that promise a multiple of what they find.

    Returns:
        Which of the steps were leaps, and the radius before each.
    """
    made, radii, here = [], [], iterate(40.0, [40.0], [[1.0]])

    def proposed(point, radius):
        x = float(point.x[0])
        if np.isinf(radius):
            return Step(np.array([-x]), x, x * x)
        radii.append(radius)
        made.append("step")
        return Step(np.array([-1.0]), 1.0, x * x - (x - 1.0) ** 2)

    def leap(point, radius):
        if len(made) >= leaps:
            return None
        radii.append(radius)
        made.append("leap")
        x = float(point.x[0])
        return Step(np.array([-2.0]), 2.0, promised * (x * x - (x - 2.0) ** 2))

    evaluator = Scripted([])
    evaluator.try_point = lambda x: iterate(x, x, [[1.0]])
    Descent(evaluator, proposed, Rules(), steps, leap).run(here)
    return made, radii


def test_leaps_follow_each_other_while_they_keep_a_quarter_of_their_promise():
    assert quadratic(promised=3.9)[0] == ["leap"] * 12
    # three that do not, each followed by a step; then no more
    assert quadratic(promised=4.1)[0] == ["leap", "step"] * 3 + ["step"] * 6
    # without a leap the step is the usual one
    assert quadratic(promised=3.9, leaps=2)[0] == ["leap"] * 2 + ["step"] * 10


def test_a_leap_that_fails_does_not_shorten_the_next_step():
    _, radii = quadratic(promised=4.1, steps=2)
    assert radii == [1.5, 1.5]
    _, kept = quadratic(promised=3.9, steps=2)
    assert kept == [1.5, 1.5]  # a ratio of 0.26: as it was
    _, longer = quadratic(promised=1.0, steps=2)
    assert longer == [1.5, 3.0]


class Reducible:
    """A model that is its own surrogate."""

    names = ("x",)
    counts = Counts()

    def admissible(self, p):
        return None

    def readings(self, p):
        return p

    def evaluate(self, p):
        return p, np.eye(1)

    def surrogate_obstacle(self):
        return None

    def visited(self):
        return ()

    def surrogate(self, visited):
        return self


def leaping(response, start=3.0):
    parameters = (Parameter("x", start, -np.inf, np.inf),)
    problem = Problem(response, np.zeros(1), np.ones(1), parameters)
    discrepancy = Discrepancy(problem)
    return Leap(discrepancy, TrustBox(discrepancy.scaling))


class Scout(Leap):
    """A leap whose looks at the reduced model are scripted: phi there, or None."""

    def _look(self, reduced, response, x):
        self.discrepancy.seen.append(float(x[0]))
        phi = self.discrepancy.script(len(self.discrepancy.seen))
        if phi is None:
            return None
        size = np.sqrt(phi)
        return Linearization(np.array([self.discrepancy.way * size]), np.array([[size / 100.0]]))


def scouted(script, *, radius=np.inf, start=0.0, way=1.0):
    """Where looks went, and the end, from a start with r = 100 and a slope of 1: 100 away."""
    parameters = (Parameter("x", 0.0, -np.inf, np.inf),)
    problem = Problem(Reducible(), np.zeros(1), np.ones(1), parameters)
    asked = SimpleNamespace(problem=problem, seen=[], script=script, way=way)
    scout = Scout(asked, TrustBox(Scaling(parameters)))
    point = iterate(start, [way * 100.0], [[1.0]])
    step = scout.propose(point, radius)
    return asked.seen, [start + step.d[0], point.phi - step.gain]


def test_the_way_down_the_reduced_model_has_its_own_radius():
    """From 10 to three tenths of what failed, twice what was taken, never above 10."""
    answers = {1: None, 2: 2e4, 3: 9000.0, 4: 8000.0, 5: 7000.0, 6: 6000.0, 7: 5000.0}
    seen, end = scouted(lambda n: answers.get(n) if n <= 7 else None)
    assert seen[:8] == pytest.approx([-10, -3, -0.9, -2.7, -6.3, -13.5, -23.5, -33.5])
    assert seen[8:12] == pytest.approx([-23.5 - 3.0 * 0.3**k for k in range(4)])
    assert end == pytest.approx([-23.5, 5000.0])
    # 3 * 0.3^k is above 1e-11 for 21 of them
    assert len(seen) == 8 + 22


def test_the_way_ends_after_sixty_steps_or_at_the_trust_region():
    seen, end = scouted(lambda n: 9e3 - n)
    assert seen == pytest.approx(-10.0 * np.arange(1, 61))
    assert end == pytest.approx([-600.0, 8940.0])
    seen, end = scouted(lambda n: 9e3 - n, radius=24.0)
    assert seen == pytest.approx([-10.0, -20.0, -24.0])
    assert end == pytest.approx([-24.0, 8997.0])


@pytest.mark.parametrize("way", [1.0, -1.0])
@pytest.mark.parametrize("start", [7.0, -3.0])
def test_the_trust_region_lies_about_the_start_on_both_sides(start, way):
    seen, end = scouted(lambda n: 9e3 - n, radius=24.0, start=start, way=way)
    assert seen == pytest.approx(start - way * np.array([10.0, 20.0, 24.0]))
    assert end[0] == pytest.approx(start - way * 24.0)


@pytest.mark.parametrize(("error", "followed"), [(0.1, True), (0.101, False)])
def test_the_reduced_model_is_trusted_to_a_tenth(error, followed):
    def fail(p):
        raise ModelError("singular")

    response = Reducible()
    response.error = lambda p: error
    leap = leaping(response)
    found = leap._look(leap.discrepancy, response, np.array([0.5]))
    assert (found is not None) == followed
    assert not followed or found.residual == pytest.approx([0.5 * 3.0])
    response.evaluate = fail
    assert leap._look(leap.discrepancy, response, np.array([0.5])) is None


# Stopping where readings are noisy

NOISE = np.array([3e-6, 4e-6])
UNSEEN = 2.0 * 2.0 * np.sqrt(2.0) * np.hypot(3e-6 * 5.0, 4e-6 * 2.0) + 25e-12


@pytest.mark.parametrize(
    ("times", "limit"),
    [
        (1.0, UNSEEN),
        (100.0, 1e-3),  # above it a kink's limit holds
        (2e4, 0.01),  # or the noise of the readings itself
    ],
)
def test_a_gain_that_may_be_noise_ends_a_descent(times, limit):
    """Readings of 5 and 2 standard deviations; the last residual is of a prior."""
    point = iterate(1.0, [5.0, 2.0, 7.0], np.ones((3, 1)))
    stopping = Stopping(TrustBox(Scaling(FREE)), 1e-12, noise=lambda: times * NOISE)

    def reason(gain):
        return stopping.reason(point, Step(np.ones(1), 1.0, gain))

    assert "no more than what is noise" in reason(0.999 * limit)
    assert f"{0.999 * limit:.1g}" in reason(0.999 * limit)
    assert reason(1.001 * limit) is None


def test_a_difference_may_be_noise_where_there_is_any():
    point = iterate(1.0, [5.0, 2.0, 7.0], np.ones((3, 1)))
    box = TrustBox(Scaling(FREE))
    noisy = Stopping(box, 1e-8, noise=lambda: NOISE)
    assert noisy.hidden(point, 0.999 * UNSEEN)
    assert noisy.hidden(point, -1.0)
    assert not noisy.hidden(point, 1.001 * UNSEEN)
    silent = Stopping(box, 1e-8)
    assert not silent.hidden(point, 0.0)
    assert not silent.hidden(point, -1.0)


# The evaluator


def evaluating(make_problem, function, parameters, **given):
    problem = make_problem(function, parameters, [0.0, 0.0], 1.0, **given)
    entries = []
    history = History("test", problem.response, entries.append)
    return plain_evaluator(Discrepancy(problem), history), entries


def two(p):
    return np.array([p[0] - 3.0, 2.0 * p[1]])


PAIR = (Parameter("E", 2.0, 0.5, 9.0, "log"), Parameter("K", 1.0, 0.5, 3.0))


def test_values_and_points_are_noted_in_natural_numbers(make_problem):
    evaluator, entries = evaluating(make_problem, two, PAIR)
    x = np.array([np.log(4.0), 0.8])
    assert evaluator.value(x, 0.25, "probe") == pytest.approx(1.0 + 1.6**2)
    point = evaluator.start(x, "start 3")
    assert point.phi == pytest.approx(1.0 + 1.6**2)
    evaluator.record(x, None, 0.5, "rejected")
    assert [entry.values.tolist() for entry in entries] == [pytest.approx([4.0, 0.8])] * 3
    assert [(entry.step, entry.note) for entry in entries] == [
        (0.25, "probe"),
        (0.0, "start 3"),
        (0.5, "rejected"),
    ]
    assert [entry.objective for entry in entries] == pytest.approx([3.56, 3.56, np.inf])


def test_a_start_without_a_solution_says_so(make_problem):
    evaluator, entries = evaluating(make_problem, two, PAIR, refuse=lambda p: "no")
    assert evaluator.start(np.zeros(2), "start 3") is None
    assert (entries[0].note, entries[0].objective) == ("start 3: no solution", np.inf)
    assert evaluator.value(np.zeros(2), 0.0, "probe") == np.inf


def test_points_that_were_evaluated_near_are_known_at_no_cost(make_problem):
    """Within a length of 0.2: a factor e^0.2 of a size, 0.2 where the sign may change."""
    evaluator, entries = evaluating(make_problem, two, PAIR)
    assert list(evaluator.evaluated_near(np.zeros(2), 9.0)) == []
    known = [[4.0 * np.exp(0.199), 0.8], [4.0 * np.exp(0.201), 0.8], [4.0, 0.8 * np.exp(-0.19)]]
    response = evaluator.discrepancy.problem.response
    response.evaluated = lambda: [np.array(p) for p in known]
    found = list(evaluator.evaluated_near(np.array([np.log(4.0), 0.8]), 0.2))
    assert [one.p.tolist() for one in found] == [known[0], known[2]]
    assert found[0].x == pytest.approx([np.log(known[0][0]), 0.8])
    assert found[1].phi == pytest.approx(1.0 + (1.6 * np.exp(-0.19)) ** 2)
    assert entries == []


def test_ways_between_points_are_tried_both_ways(make_problem):
    """phi = r^2 of r = x^2 - 1: from 0.2 to -1.5 phi rises; from there the slope leads down."""

    def hill(p):
        return np.array([p[0] ** 2 - 1.0, 0.0 * p[0]])

    for order in ((0.2, -1.1), (-1.1, 0.2)):
        evaluator, _ = evaluating(make_problem, hill, FREE)
        for value in order:
            evaluator.evaluate(np.array([value]))
        fall = 0.96**2 - 0.21**2
        rise = 4.0 * 0.2 * (0.04 - 1.0) * -1.3  # 4 x (x^2 - 1), along the way to -1.1
        assert evaluator.begins_uphill(0.99 * rise / fall, 0.99 * fall)
        assert not evaluator.begins_uphill(1.01 * rise / fall, 0.99 * fall)
        assert not evaluator.begins_uphill(0.99 * rise / fall, 1.01 * fall)


def test_a_way_that_rises_and_falls_just_as_much_is_no_sign(make_problem):
    """A fall of 2 and a rise of 2 promised, in numbers without rounding."""
    evaluator, _ = evaluating(make_problem, two, PAIR)
    evaluator._visited = [(np.array([0.0]), 4.0, np.ones(1)), (np.ones(1), 2.0, np.zeros(1))]
    assert evaluator.begins_uphill(0.5, 1.0)
    assert not evaluator.begins_uphill(1.0, 1.0)
    assert not evaluator.begins_uphill(0.5, 2.0)


def test_a_step_of_any_radius_stays_in_its_box():
    box = TrustBox(Scaling(FREE))
    point = iterate(4.0, [3.0, 1.0], [[2.0], [1.0]])
    found = gauss_newton_step(box, point, 0.5)
    assert (found.d.tolist(), found.length) == ([-0.5], 0.5)
    assert found.gain == pytest.approx(9.0 + 1.0 - 2.0**2 - 0.5**2)
    full = gauss_newton_step(box, point, np.inf)
    assert full.d == pytest.approx([-7.0 / 5.0])
    assert full.gain == pytest.approx(49.0 / 5.0)
