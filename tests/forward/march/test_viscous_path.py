"""The path of viscous grounds, on one unknown whose equations are given."""

from types import SimpleNamespace

import numpy as np
import pytest

from geoident.forward.march import equilibrium
from geoident.forward.march.equilibrium import _departs, solve
from geoident.forward.march.stage_equations import NoEquilibrium, Trial
from geoident.forward.march.viscous_path import Effort, NewtonEnd, PathEnd, Way, follow, newton


class Given:
    """One unknown u with the residual r(u, mu) and its slope; forces of 1.

    Attributes:
        asked: mu and u where the residual was asked for.
    """

    associated, at_hand, dofs = False, None, np.array([0])
    forces = np.array([1.0])

    def __init__(self, residual, slope, mu=0.0, asked=None):
        self.residual, self.slope, self.mu = residual, slope, mu
        self.asked = [] if asked is None else asked

    def viscous(self, mu):
        return Given(self.residual, self.slope, mu, self.asked)

    def at(self, du):
        u = float(du[0])
        self.asked.append((self.mu, u))
        found = self.residual(u, self.mu)
        if np.isnan(found):
            raise NoEquilibrium(None)
        return Trial(du, np.zeros((1, 1)), (), np.array([found]), 1.0)

    def distance(self, trial):
        return trial.error

    def factor(self, trial):
        slope = self.slope(float(trial.du[0]), self.mu)
        return SimpleNamespace(solve=lambda rhs: rhs / slope), 0

    def spread(self, free):
        return free


ZERO = np.zeros(1)
LIKE_GROUND = (lambda u, mu: 1.0 - np.tanh(u) - mu * u, lambda u, mu: 1 / np.cosh(u) ** 2 + mu)
CARRIED = (lambda u, mu: 0.5 - np.tanh(u) - mu * u, LIKE_GROUND[1])
BEYOND = (lambda u, mu: 1.5 - np.tanh(u) - mu * u, LIKE_GROUND[1])


@pytest.mark.parametrize("bold", [False, True])
def test_newton_finds_the_zero(bold):
    given = Given(*CARRIED)
    found = newton(given, given.at(ZERO), bold=bold)
    assert found.converged
    assert found.trial.du[0] == pytest.approx(np.arctanh(0.5))
    assert found.made_at is not None


def test_a_step_is_halved_until_the_next_is_shorter():
    """From 2 Newton's steps on atan go ever further apart; halved ones do not."""
    given = Given(lambda u, mu: -np.arctan(u), lambda u, mu: 1.0 / (1.0 + u * u))
    found = newton(given, given.at(np.array([2.0])))
    assert found.converged
    assert abs(found.trial.du[0]) < 1e-11
    assert given.asked[1][1] == pytest.approx(2.0 - np.arctan(2.0) * 5.0)
    assert given.asked[2][1] == pytest.approx(2.0 - np.arctan(2.0) * 2.5)


def test_newton_steps_back_from_where_there_is_no_stress():
    given = Given(lambda u, mu: np.nan if u > 0.6 else 0.5 - np.tanh(u), LIKE_GROUND[1])
    found = newton(given, given.at(np.array([-2.0])))
    assert found.converged


def test_the_path_leads_to_the_ground_itself():
    given = Given(*CARRIED)
    end = follow(given, Way(0.1, 0.3, bold=False))
    assert end.mu == 0.0
    assert end.runs_away is None
    assert end.found.trial.du[0] == pytest.approx(np.arctanh(0.5))
    on_the_way = list(dict.fromkeys(mu for mu, _ in given.asked))
    np.testing.assert_allclose(on_the_way[:3], [0.1, 0.03, 0.009])
    assert on_the_way[-1] == 0.0


def test_a_load_beyond_the_limit_runs_away():
    """u = 0.5 / mu: what is kept of the overstress carries what the ground does not."""
    with pytest.raises(NoEquilibrium) as caught:
        solve(Given(*BEYOND), [ZERO])
    assert caught.value.limit
    assert caught.value.mechanism[0] > 0.0


def test_a_path_that_turns_is_stepped_over():
    """No zero between mu = 0.02 and 0.004."""

    def gap(u, mu):
        return 1.0 if 0.004 < mu < 0.02 else CARRIED[0](u, mu)

    end = follow(Given(gap, CARRIED[1]), Way(0.1, 0.3, bold=False))
    assert end.mu == 0.0


@pytest.mark.parametrize(("left", "said"), [(0.0049, True), (0.0051, False)])
def test_a_hundredth_of_the_load_may_be_left_where_the_path_ends(left, said):
    """Below mu = 0.01 there is no zero."""

    def ends(u, mu):
        return CARRIED[0](u, mu) if mu >= 0.01 else 0.5 if u < 0.3 else left

    if said:
        found = solve(Given(ends, CARRIED[1]), [ZERO])
        assert found.unbalanced == pytest.approx(left / 0.5)
        assert found.trial.du[0] == pytest.approx(np.arctanh(0.5), rel=0.02)
    else:
        with pytest.raises(NoEquilibrium) as caught:
            solve(Given(ends, CARRIED[1]), [ZERO])
        assert not caught.value.limit


def carried_from(least):
    """As `CARRIED`, with no zero below a part of the overstress."""
    return Given(
        lambda u, mu: CARRIED[0](u, mu) if mu >= least else 1.0,
        lambda u, mu: CARRIED[1](u, mu) if mu >= least else 1.0,
    )


def test_the_even_flow_may_end_at_hardly_any_viscosity():
    """A way at 2.1e-4, below 3e-4, is the answer at once; one at 3.4e-4 asks for other ways."""
    given = carried_from(2e-4)
    found = solve(given, [ZERO])
    assert 2e-4 <= found.viscosity < 3e-4
    assert found.unbalanced == 0.0
    assert found.trial.du[0] == pytest.approx(np.arctanh(0.5), rel=1e-3)
    assert 0.05 not in [mu for mu, _ in given.asked]  # where the second way begins
    assert solve(carried_from(2e-4), [ZERO], even_only=True).viscosity == found.viscosity
    with pytest.raises(NoEquilibrium):
        solve(carried_from(3e-4), [ZERO], even_only=True)


@pytest.mark.parametrize(("least", "answers"), [(2.5e-3, True), (3.0e-3, False)])
def test_after_all_ways_it_may_be_ten_times_as_much(least, answers):
    """The last way comes down to 2.6e-3 and to 3.1e-3; the limit is 3e-3."""
    given = carried_from(least)
    if answers:
        assert least <= solve(given, [ZERO]).viscosity < 3e-3
        assert 0.05 in [mu for mu, _ in given.asked]
    else:
        with pytest.raises(NoEquilibrium):
            solve(given, [ZERO])


@pytest.mark.parametrize(
    ("end", "mu", "far", "departs"),
    [
        # the even flow ends 0.01 short of what it promises
        (0.99, 1e-3, 0.0101, True), (0.99, 1e-3, -0.0099, False),
        # it has come nearer than a five-hundredth of 2, the largest displacement
        (1.0, 1e-3, -0.0041, True), (1.0, 1e-3, 0.0039, False),
        # an even flow that ends early promises nothing
        (0.99, 3.1e-3, 0.5, False), (0.99, 2.9e-3, 0.5, True),
    ],
)  # fmt: skip
def test_another_flow_is_farther_from_the_promise_than_the_even_one(end, mu, far, departs):
    ahead = np.array([1.0, -2.0])
    trial = Trial(np.array([end, -2.0]), np.zeros((1, 1)), (), ZERO, 1.0)
    even = PathEnd(NewtonEnd(trial, 1, None, None, converged=True), mu, ahead)
    assert _departs(np.add(ahead, [far, 0.0]), even) == departs


@pytest.mark.parametrize(("end", "viscous"), [(3.0, True), (np.arctanh(0.5), False)])
def test_bands_that_another_way_has_met_are_not_the_answer(end, viscous):
    """The first way is lost at 2.3e-3; the second comes to the ground, and to another flow."""

    def again():
        return 0.05 in (mu for mu, _ in given.asked)  # where the second way begins

    def residual(u, mu):
        if mu > 1e-3 or (mu > 0.0 and again()):
            return CARRIED[0](u, mu)
        return end - u if again() else 1.0

    given = Given(residual, lambda u, mu: CARRIED[1](u, mu) if mu > 1e-3 else 1.0)
    found = solve(given, [ZERO])
    assert (found.viscosity > 0.0) == viscous
    assert found.trial.du[0] == pytest.approx(np.arctanh(0.5), rel=4e-3)


def folded(u, mu):
    """A tenth of the load is missing at u = 1; the path turns near mu = 0.05, flow ends at 3."""
    return np.nan if abs(u) > 3.0 else 0.5 - 0.45 * u * np.exp(1.0 - u) - mu * u


@pytest.mark.parametrize("most", [7, 30, 100_000])
def test_a_search_whose_path_turns_takes_no_more_steps_than_it_may(monkeypatch, most):
    """Each factor is counted; what it has found by then is handed on."""
    made = []

    def slope(u, mu):
        made.append((u, mu))
        return 0.45 * (1.0 - u) * np.exp(1.0 - u) + mu

    monkeypatch.setattr(equilibrium, "SEARCH", most)
    with pytest.raises(NoEquilibrium) as caught:
        solve(Given(folded, slope), [ZERO])
    assert len(made) <= most
    if most > 20:
        assert 0.04 < caught.value.even.viscosity < 0.1
    if most > 1000:
        assert len(made) < 400  # the ways end by themselves


def test_steps_of_one_search_are_shared_by_its_parts():
    effort = Effort(9)
    given = Given(*CARRIED)
    first = newton(given, given.at(ZERO), effort=effort)
    assert first.converged
    assert effort.left == 9 - first.steps
    again = newton(given, given.at(np.array([-2.0])), effort=Effort(1))
    assert (again.steps, again.converged) == (1, False)
    assert follow(given, Way(0.1, 0.3, bold=False), Effort(0)) is None
