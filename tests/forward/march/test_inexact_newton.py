"""Which factor leads which step, how far it is iterated, and steps corrected by earlier ones."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest

from geoident.fem.solvers.conjugate_gradients import Iterated
from geoident.forward.march import inexact_newton
from geoident.forward.march.inexact_newton import Directions, SecantSteps
from geoident.forward.march.stage_equations import ELASTIC_PARTS, Trial

N = 5
RNG = np.random.default_rng(3)
HALF = RNG.normal(size=(N, N))
K = HALF @ HALF.T + N * np.eye(N)
NEARBY = K + 0.05 * np.diag(np.arange(1.0, N + 1.0))
ELASTIC = 3.0 * K
RESIDUAL = RNG.normal(size=N)
BEGIN = RNG.bit_generator.state


@pytest.fixture(autouse=True)
def same_draws():
    """Each test draws the same numbers, whatever ran before it."""
    RNG.bit_generator.state = BEGIN


def factor_of(matrix):
    return SimpleNamespace(solve=lambda rhs: np.linalg.solve(matrix, rhs), matrix=matrix)


class Hand:
    """Factors of given matrices; products with K less the part of it that is the change."""

    most = 17

    def __init__(self, last=None):
        self._last, self.changes = last, []

    def elastic(self):
        return factor_of(ELASTIC)

    def last(self):
        return self._last

    def product(self, points, change):
        self.changes.append((points, float(change)))
        return lambda x: K @ x


class Equations:
    """Residuals of one size everywhere; unknowns are the first of the degrees of freedom."""

    forces = np.ones(N + 2)

    def __init__(self, error=1.0):
        self.error, self.levels, self.asked = error, [], []

    def at(self, du):
        self.asked.append(du)
        return self.trial(self.error)

    def trial(self, error):
        residual = RESIDUAL / np.abs(RESIDUAL).max() * error
        return Trial(np.zeros(N + 2), np.zeros((1, 1)), (), residual, 1.0)

    def changes(self, trial):
        return "points", 2.0

    def factor(self, trial, *, least=0):
        self.levels.append(least)
        return factor_of(K), least + 1

    def spread(self, free):
        return np.append(free, [0.0, 0.0])


@pytest.fixture
def iterated(monkeypatch):
    """What conjugate gradients are asked for; they answer with x, reached or not."""
    asked = []
    answer = SimpleNamespace(reached=True, x=np.full((N, 1), 7.0))

    def fake(product, rhs, precondition, *, tolerance, most):
        asked.append((rhs, precondition(np.eye(N)), tolerance, most))
        return Iterated(answer.x, 1, answer.reached)

    monkeypatch.setattr(inexact_newton, "conjugate_gradients", fake)
    return SimpleNamespace(asked=asked, answer=answer)


def leads(asked):
    """Which matrix led."""
    inverse = {"elastic": np.linalg.inv(ELASTIC), "last": np.linalg.inv(NEARBY)}
    return next(name for name, one in inverse.items() if np.allclose(asked[1], one))


# --- directions ---


def test_a_guess_is_three_steps_on_the_elastic_factor(iterated):
    equations, hand = Equations(), Hand(factor_of(NEARBY))
    guess = Directions(equations, hand, 1e-11).guess()
    assert guess.tolist() == [7.0] * N + [0.0, 0.0]
    (asked,) = iterated.asked
    assert leads(asked) == "elastic"
    assert asked[2:] == (0.1, 3)
    np.testing.assert_array_equal(asked[0][:, 0], equations.trial(1.0).residual)
    np.testing.assert_array_equal(equations.asked[0], np.zeros(N + 2))
    assert hand.changes == [("points", (1.0 - ELASTIC_PARTS[0]) * 2.0)]


FAR, CLOSE = 3.1e-4, 2.9e-4


@pytest.mark.parametrize(
    ("error", "least", "state", "last", "reached", "led", "after"),
    [
        # far away: the elastic factor, cut off
        (FAR, 0, {}, True, False, "elastic", {"cut": True, "far_steps": 1}),
        (FAR, 0, {}, True, True, "elastic", {"cut": True, "far_steps": 1}),
        (FAR, 0, {"far_steps": 19}, True, True, "elastic", {"cut": True, "far_steps": 20}),
        # twenty times at most: then a factor is made
        (FAR, 0, {"far_steps": 20}, True, True, None, {"own": True, "far_steps": 20}),
        # beside it: the last factor where it leads there, else one is made
        (CLOSE, 0, {}, True, True, "last", {"cut": False, "own": False}),
        (CLOSE, 0, {"cut": True}, True, True, "last", {"cut": False}),
        (CLOSE, 0, {}, True, False, "last+made", {"own": True, "failed": True}),
        (CLOSE, 0, {}, False, True, None, {"own": True, "failed": True}),
        (CLOSE, 0, {"failed": True}, True, True, None, {"own": True, "failed": True}),
        # one's own factor serves everywhere
        (FAR, 0, {"own": True}, True, True, "last", {"own": True, "far_steps": 0}),
        (FAR, 0, {"own": True, "failed": True}, True, True, "last", {"own": True}),
        (FAR, 0, {"own": True}, True, False, "last+made", {"own": True, "failed": True}),
        # after a step that was far too long one on the elastic factor comes between
        (CLOSE, 2, {"own": True}, True, False, "elastic", {"cut": True, "far_steps": 1}),
        (CLOSE, 2, {"own": True, "far_steps": 20}, True, True, None, {"cut": False}),
    ],
)
def test_what_leads_a_direction(iterated, error, least, state, last, reached, led, after):
    equations, hand = Equations(), Hand(factor_of(NEARBY) if last else None)
    directions = Directions(equations, hand, 1e-11)
    for name, value in state.items():
        setattr(directions, name, value)
    iterated.answer.reached = reached
    trial = equations.trial(error)
    found, level = directions.at(trial, least)
    for name, value in after.items():
        assert getattr(directions, name) == value, name
    if led is None or led == "last+made":
        assert equations.levels == [least]
        assert level == least + 1
        np.testing.assert_allclose(found, np.linalg.solve(K, trial.residual), rtol=1e-12)
        assert [leads(one) for one in iterated.asked] == (["last"] if led else [])
    else:
        assert (equations.levels, level) == ([], 0)
        assert found.tolist() == [7.0] * N
        assert [leads(one) for one in iterated.asked] == [led]
    for asked in iterated.asked:
        assert asked[3] == hand.most
        np.testing.assert_array_equal(asked[0], trial.residual[:, None])


@pytest.mark.parametrize(
    ("error", "wanted"),
    [(1e-3, 1e-2), (1e-6, 1e-4), (0.5, 0.1), (1e-9, 1e-3), (3e-8, 3.0**-1 * 1e-4)],
)
def test_how_far_a_step_is_iterated(iterated, error, wanted):
    """To the power 2/3 of the error, a tenth at most; no further than a tenth of the balance."""
    equations, hand = Equations(), Hand(factor_of(NEARBY))
    directions = Directions(equations, hand, 1e-11, own=True)
    directions.at(equations.trial(error), 0)
    assert iterated.asked[0][2] == pytest.approx(wanted, rel=1e-9)


@pytest.mark.parametrize(
    ("error", "wanted"), [(1e-3, 1e-2), (1e-6, 1e-3), (0.5, 0.1), (1e-11, 0.1)]
)
def test_far_away_it_is_iterated_to_a_thousandth_at_least(iterated, error, wanted):
    equations, hand = Equations(), Hand(factor_of(NEARBY))
    Directions(equations, hand, 1e-11).at(equations.trial(error), 1)
    assert leads(iterated.asked[0]) == "elastic"
    assert iterated.asked[0][2] == pytest.approx(wanted, rel=1e-9)


def test_derivatives_are_solved_on_the_last_factor_or_on_one_that_is_made(iterated):
    equations, rhs = Equations(), RNG.normal(size=(N, 2))
    trial = equations.trial(1.0)
    found = Directions(equations, Hand(factor_of(NEARBY)), 1e-11).solve(trial, rhs)
    assert found is iterated.answer.x
    assert leads(iterated.asked[0]) == "last"
    assert iterated.asked[0][2:] == (1e-11, 17)
    assert iterated.asked[0][0] is rhs
    iterated.answer.reached = False
    found = Directions(equations, Hand(factor_of(NEARBY)), 1e-11).solve(trial, rhs)
    np.testing.assert_allclose(found, np.linalg.solve(K, rhs))
    iterated.asked.clear()
    found = Directions(equations, Hand(), 1e-11).solve(trial, rhs)
    np.testing.assert_allclose(found, np.linalg.solve(K, rhs))
    assert iterated.asked == []
    directions = Directions(equations, Hand(), 1e-11)
    assert directions.solved_on(factor_of(ELASTIC), trial, rhs, 6) is None
    assert leads(iterated.asked[0]) == "elastic"
    assert iterated.asked[0][2:] == (1e-11, 6)


@pytest.mark.parametrize(("part", "good"), [(0.19, True), (0.21, False)])
def test_a_step_that_was_not_brought_as_far_as_wanted_leaves_a_fifth_at_most(iterated, part, good):
    equations, hand = Equations(), Hand()
    trial = equations.trial(1e-3)
    exact = np.linalg.solve(K, trial.residual)
    iterated.answer.x = ((1.0 - part) * exact)[:, None]
    iterated.answer.reached = False
    directions = Directions(equations, hand, 1e-11)
    found = directions.step_on(factor_of(NEARBY), trial, 9, 6)
    assert (found is not None) == good
    if good:
        np.testing.assert_allclose(found, (1.0 - part) * exact)
    assert iterated.asked[0][2:] == (pytest.approx(1e-2), 9)
    assert hand.changes == [("points", (1.0 - ELASTIC_PARTS[6]) * 2.0)]
    iterated.answer.reached = True
    assert directions.step_on(factor_of(NEARBY), trial, 9, 6) is not None


def test_steps_lead_to_the_solution_of_the_tangent():
    """Without fakes: on the factor of a matrix near by, and on the elastic one."""
    equations = Equations()
    directions = Directions(equations, Hand(factor_of(NEARBY)), 1e-11, own=True)
    trial = equations.trial(1e-9)
    exact = np.linalg.solve(K, trial.residual)
    found, _ = directions.at(trial, 0)
    np.testing.assert_allclose(found, exact, rtol=2e-3)
    rhs = RNG.normal(size=(N, 3))
    np.testing.assert_allclose(directions.solve(trial, rhs), np.linalg.solve(K, rhs), rtol=1e-9)
    guess = directions.guess()
    np.testing.assert_allclose(guess[:N], np.linalg.solve(K, equations.trial(1.0).residual))


# --- secants ---


def inverse(pairs):
    """The matrix that L-BFGS stands for, pair by pair (Nocedal 1980, equation 2.1)."""
    H = np.linalg.inv(NEARBY)
    for d, y in pairs:
        V = np.eye(N) - np.outer(y, d) / (d @ y)
        H = V.T @ H @ V + np.outer(d, d) / (d @ y)
    return H


def test_steps_are_those_of_the_inverse_that_explains_the_last_ones():
    steps, pairs = SecantSteps(factor_of(NEARBY)), []
    residuals = RNG.normal(size=(4, N))
    for residual in residuals:
        kept = residual.copy()
        found = steps.direction(residual)
        np.testing.assert_allclose(found, inverse(pairs) @ residual, rtol=1e-10, atol=1e-13)
        np.testing.assert_array_equal(residual, kept)
        d = found + 0.3 * RNG.normal(size=N)
        pairs.append((d, K @ d))
        steps.learn(d, K @ d)
    for d, y in pairs[-1:]:
        np.testing.assert_allclose(steps.direction(y), d, rtol=1e-10)


@pytest.mark.parametrize("work", [-0.5, 0.0, 0.5])
def test_a_step_against_its_residual_teaches_nothing(work):
    steps = SecantSteps(factor_of(NEARBY))
    d, y = np.eye(N)[0], np.array([work, 1.0, 0.0, 0.0, 0.0])
    steps.learn(d, y)
    pairs = [(d, y)] if work > 0.0 else []
    residual = RNG.normal(size=N)
    np.testing.assert_allclose(steps.direction(residual), inverse(pairs) @ residual, rtol=1e-10)
