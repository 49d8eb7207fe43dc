"""The ways that a descent can go, step by step: stopped, left, closed."""

from dataclasses import dataclass, field
from types import SimpleNamespace

import numpy as np
import pytest

from geoident.identify.least_squares.acceptance import Iterate, Step
from geoident.identify.least_squares.descent import (
    Descent,
)
from geoident.identify.least_squares.trust_region import TrustBox
from geoident.identify.problem.problem import Linearization
from geoident.identify.problem.scaling import Scaling
from geoident.model.parameter import Parameter

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


def gone(trials, rules, *, steps=9, give_up=None, leave=None, proposed=propose, **given):
    evaluator = Scripted(trials, **given)
    descent = Descent(evaluator, proposed, rules, steps)
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
