"""Each rule of the steps at one viscosity and from one to the next, on equations that are given."""

from types import SimpleNamespace

import numpy as np
import pytest

from geoident.fem.solvers.direct import NotPositiveDefinite
from geoident.forward.march.stage_equations import NoEquilibrium, Trial
from geoident.forward.march.viscous_path import (
    Effort,
    Way,
    _extrapolated,
    follow,
    newton,
)


class Given:
    """Two unknowns among three degrees of freedom; residuals by hand, every factor divides by 2.

    Attributes:
        asked: mu and the first unknown where the residual was asked for.
        made: the first unknown where factors were made.
    """

    dofs = np.array([2, 0])
    forces = np.ones(3)

    def __init__(self, residual, mu=0.0, like=None, *, level=0):
        self.residual, self.mu, self.level = residual, mu, level
        self.asked, self.made = ([], []) if like is None else (like.asked, like.made)

    def viscous(self, mu):
        return type(self)(self.residual, mu, self, level=self.level)

    def at(self, du):
        u = float(du[2])
        self.asked.append((self.mu, u))
        found = self.residual(u, self.mu)
        if np.isnan(found):
            raise NoEquilibrium(None)
        assert du[1] == 0.0
        return Trial(du, np.zeros((1, 1)), (), np.array([found, 1.8 * (5.0 - du[0])]), 1.0)

    def factor(self, trial):
        self.made.append(float(trial.du[2]))
        return SimpleNamespace(solve=lambda rhs: 0.5 * rhs), self.level

    def spread(self, free):
        full = np.zeros(3)
        full[self.dofs] = free
        return full

    def begun(self, u):
        return self.at(np.array([5.0, 0.0, u]))


def steps(given):
    """Where the first unknown was looked at, the start aside."""
    return [u for _, u in given.asked[1:]]


# --- along a step ---


def rounds(values, other=0.0):
    """The first residual by place; the second unknown stays in equilibrium by its own step."""
    return lambda u, mu: values.get(round(u, 9), other)


class Lone(Given):
    """The first unknown alone."""

    def at(self, du):
        trial = super().at(du)
        return Trial(du, trial.stress, (), np.array([trial.residual[0], 0.0]), 1.0)


@pytest.mark.parametrize(
    ("after", "ends"),
    [
        # the next step is to be shorter by a quarter of the share of this one
        ({0.5: 0.74}, [0.5]),
        ({0.5: 0.76, 0.25: 0.87}, [0.5, 0.25]),
        ({0.5: -0.76, 0.25: -0.88, 0.125: 0.93}, [0.5, 0.25, 0.125]),
        ({0.5: np.nan, 0.25: 0.87}, [0.5, 0.25]),
        ({0.5: 9.0, 0.25: 9.0, 0.125: 9.0, 0.0625: 9.0, 0.03125: 0.99, 0.015625: 0.9921},
         [0.5, 0.25, 0.125, 0.0625, 0.03125, 0.015625]),
    ],
)  # fmt: skip
def test_a_step_is_halved_until_the_next_is_shorter_by_its_part(after, ends):
    """Steps are half the residual: the first of 1 is 0.5 long."""
    given = Lone(rounds({0.0: 1.0, **after}))
    found = newton(given, given.begun(0.0), most=1)
    assert steps(given) == pytest.approx(ends)
    assert found.trial.du[2] == ends[-1]
    assert (found.steps, found.converged) == (1, False)
    assert given.made == [0.0]


def test_a_step_below_a_fiftieth_is_not_made():
    """Six halves of the first, down to 1/32, then it is given up."""
    given = Lone(rounds({0.0: 1.0}, 9.0))
    found = newton(given, given.begun(0.0))
    assert steps(given) == pytest.approx([0.5 * 0.5**k for k in range(6)])
    assert (found.steps, found.converged, found.trial.du[2]) == (1, False, 0.0)
    assert found.factor is not None
    assert found.made_at is found.trial


@pytest.mark.parametrize(("left", "ends"), [(0.9e-8, True), (1.1e-8, False)])
def test_where_no_step_is_shorter_rounding_counts_as_equilibrium(left, ends):
    given = Lone(lambda u, mu: left if u == 0.0 else 1.0)
    found = newton(given, given.begun(0.0))
    assert (found.steps, found.converged) == (1, ends)


def test_a_share_that_was_short_is_tried_four_times_as_long():
    """After a share of 1/16 the next begins with 1/4, after that with the whole step."""
    script = {
        0.0: 1.0, 0.5: 9.0, 0.25: 9.0, 0.125: 9.0, 0.0625: 9.0, 0.03125: 0.96,
        0.15125: 0.72, 0.51125: 0.5,
    }  # fmt: skip
    given = Lone(rounds(script))
    newton(given, given.begun(0.0), most=3)
    assert steps(given)[5:] == pytest.approx([0.03125 + 0.25 * 0.48, 0.15125 + 0.36])


@pytest.mark.parametrize(
    ("after", "ends"),
    [
        # a ten thousandth of the share at least
        ({0.5: 0.99989}, [0.5]),
        ({0.5: 0.99991, 0.25: 0.99994}, [0.5, 0.25]),
        ({0.5: np.nan, 0.25: -0.99996, 0.125: 0.9}, [0.5, 0.25, 0.125]),
    ],
)
def test_a_bold_step_is_halved_until_the_residual_is_smaller(after, ends):
    given = Lone(rounds({0.0: 1.0, **after}))
    found = newton(given, given.begun(0.0), most=1, bold=True)
    assert steps(given) == pytest.approx(ends)
    assert found.trial.du[2] == ends[-1]


def test_a_bold_step_that_is_lost_goes_where_it_does_least_harm():
    """Down to a sixteenth; the residual was smallest at a quarter."""
    script = {0.5: 1.9, 0.25: 1.7, 0.125: 1.2, 0.0625: 1.3, 0.03125: 1.4}
    given = Lone(rounds({0.0: 1.0, **script}, 0.0))
    found = newton(given, given.begun(0.0), most=1, bold=True)
    assert steps(given) == pytest.approx([0.5 * 0.5**k for k in range(5)])
    assert found.trial.du[2] == 0.125
    nowhere = Lone(lambda u, mu: 1.0 if u == 0.0 else np.nan)
    found = newton(nowhere, nowhere.begun(0.0), bold=True)
    assert (found.steps, found.converged, found.trial.du[2]) == (1, False, 0.0)


# --- from step to step ---


def straight(zero, slope=2.0):
    """A residual whose zero the first step finds where its slope is 2."""
    return lambda u, mu: slope * (zero - u)


def test_both_unknowns_come_to_equilibrium_and_are_polished_once():
    """Of a slope of 1.8 a tenth is left by each step; a last one is on the last factor."""
    given = Given(straight(3.0, 1.8))
    found = newton(given, given.at(np.zeros(3)))
    left = 3.0 - np.array([0.0, *steps(given)])
    np.testing.assert_allclose(left, 3.0 * 0.1 ** np.arange(len(left)), rtol=1e-2, atol=1e-15)
    assert found.converged
    assert found.steps == len(given.made)
    assert len(given.asked) == 1 + found.steps + 1
    np.testing.assert_allclose(found.trial.du, [5.0, 0.0, 3.0], atol=1e-10)
    assert found.trial.du[2] == steps(given)[-1]
    assert found.made_at.du[2] == given.made[-1]


def test_what_is_polished_must_be_nearer():
    """At 0.9e-11 the next step would lead to 0.95e-11: it is not taken."""
    given = Lone(lambda u, mu: {0.0: 1.0, 0.5: 0.9e-11}.get(u, 0.95e-11))
    found = newton(given, given.begun(0.0))
    assert len(given.asked) == 3
    assert (found.trial.du[2], found.steps, found.converged) == (0.5, 1, True)
    nowhere = Lone(lambda u, mu: {0.0: 1.0, 0.5: 0.9e-11}.get(u, np.nan))
    assert newton(nowhere, nowhere.begun(0.0)).trial.du[2] == 0.5


def test_a_start_in_equilibrium_needs_no_factor():
    given = Lone(lambda u, mu: 1e-11)
    found = newton(given, given.begun(0.0))
    assert (found.steps, found.factor, found.made_at, found.converged) == (0, None, None, True)
    assert (len(given.asked), given.made) == (1, [])
    rough = newton(given, given.begun(0.0), balanced=0.9e-11, most=1)
    assert given.made == [0.0]
    assert rough.factor is not None


def test_a_factor_with_elastic_parts_polishes_nothing():
    given = Lone(straight(3.0), level=2)
    found = newton(given, given.begun(0.0))
    assert (found.steps, found.converged, found.made_at) == (1, True, None)
    assert len(given.asked) == 2
    assert found.factor is not None


@pytest.mark.parametrize("at", [0.0, 1.5])
def test_where_the_tangent_has_no_factor_the_way_ends(at):
    given = Lone(straight(3.0, 1.0))
    factor = given.factor

    def refused(trial):
        if trial.du[2] == at:
            raise NotPositiveDefinite(0)
        return factor(trial)

    given.factor = refused
    found = newton(given, given.begun(0.0))
    assert found.trial.du[2] == at
    assert (found.steps, found.converged) == (len(given.made), False)
    assert found.factor is None
    assert found.made_at is None


@pytest.mark.parametrize(("most", "ends"), [(5, False), (6, True)])
def test_the_last_step_may_end_in_equilibrium(most, ends):
    """A hundredth is left by each step: 1e-12 after six, of which nothing is polished."""
    given = Lone(straight(1.0, 1.98))
    found = newton(given, given.begun(0.0), most=most)
    assert (found.steps, found.converged, len(given.made)) == (most, ends, most)
    assert len(given.asked) == 1 + most


def test_thirty_steps_are_made_at_most():
    given = Lone(straight(1.0, 0.6))  # seven tenths are left by each
    found = newton(given, given.begun(0.0))
    assert (found.steps, found.converged, len(given.made)) == (30, False, 30)


def test_a_bold_way_is_given_up_after_eight_steps_without_half_the_error():
    """At 1.1e-8 nothing is in equilibrium, at 0.9e-8 what is not lowered is."""
    lasting = Lone(lambda u, mu: 1.0 + u)
    found = newton(lasting, lasting.begun(0.0), bold=True)
    assert (len(lasting.made), found.steps, found.converged) == (10, 30, False)

    def halved(u, mu):  # below half of the error once, at the fourth step
        return 0.49 if len(halving.made) >= 4 else 1.0

    halving = Lone(halved)
    newton(halving, halving.begun(0.0), bold=True)
    assert len(halving.made) == 14
    for left, made, ends in ((0.9e-8, 1, True), (1.1e-8, 10, False)):
        given = Lone(lambda u, mu, left=left: left)
        found = newton(given, given.begun(0.0), bold=True)
        assert (len(given.made), found.converged) == (made, ends)
        if ends:
            assert (found.steps, found.trial.du[2]) == (1, 0.0)


def test_an_effort_counts_down_to_none():
    effort = Effort(2)
    assert not effort.spent
    assert effort.take()
    assert (effort.left, effort.spent) == (1, False)
    assert effort.take()
    assert (effort.left, effort.spent) == (0, True)
    assert not effort.take()
    assert effort.spent


def test_a_spent_effort_ends_the_steps_with_what_there_is():
    given = Lone(straight(1.0, 1.8))
    found = newton(given, given.begun(0.0), effort=Effort(2))
    assert (found.steps, found.converged, len(given.made)) == (2, False, 2)
    assert found.trial.du[2] == pytest.approx(0.99)
    assert found.made_at.du[2] == pytest.approx(0.9)


# --- from one viscosity to the next ---


def test_displacements_are_extrapolated_along_the_last_two():
    first, last = np.array([1.0, 2.0]), np.array([3.0, -1.0])
    assert _extrapolated([(0.1, first)], 0.01).tolist() == [1.0, 2.0]
    found = _extrapolated([(0.1, first), (0.04, last)], 0.01)
    np.testing.assert_allclose(found, [4.0, -2.5], rtol=1e-14)


def viscosities(given):
    """Each mu once, in the order in which it was asked for."""
    return list(dict.fromkeys(mu for mu, _ in given.asked))


@pytest.mark.parametrize(("power", "runs"), [(0.69, False), (0.71, True)])
def test_displacements_that_grow_like_one_over_mu_run_away(power, runs):
    """Faster than its power 0.7 twice in a row; what grows is what the last one added."""
    given = Lone(lambda u, mu: 2.0 * (mu**-power - u) if mu else 1.0)
    end = follow(given, Way(0.1, 0.5, bold=False))
    if runs:
        assert viscosities(given) == pytest.approx([0.1, 0.05, 0.025])
        assert end.mu == pytest.approx(0.025)
        assert end.runs_away[2] == pytest.approx(0.025**-power - 0.05**-power)
        assert end.ahead[2] == end.found.trial.du[2] == pytest.approx(0.025**-power)
    else:
        assert end.runs_away is None
        assert end.mu < 1e-6


def test_growth_that_pauses_does_not_run_away():
    """Tenfold, then none, then tenfold, ..., and it ends in the ground itself."""
    sizes = {0: 1.0, 1: 10.0, 2: 10.0, 3: 100.0, 4: 100.0}

    def zero(mu):
        return 7.0 if mu == 0.0 else sizes.get(round(np.log2(0.1 / mu)), 100.0)

    given = Lone(lambda u, mu: 2.0 * (zero(mu) - u))
    end = follow(given, Way(0.1, 0.5, bold=False))
    assert (end.mu, end.runs_away) == (0.0, None)
    assert end.ahead[2] == end.found.trial.du[2] == pytest.approx(7.0)
    # 0.1 2^-k is above 1e-7 up to k = 19
    assert viscosities(given) == pytest.approx([0.1 * 0.5**k for k in range(20)] + [0.0])


def test_each_start_is_extrapolated_from_the_last_two():
    given = Lone(lambda u, mu: 2.0 * (1.0 + mu**2 - u))
    follow(given, Way(0.2, 0.25, bold=False))
    starts = {}
    for mu, u in given.asked:
        starts.setdefault(mu, u)
    zeros = [1.0 + mu**2 for mu in (0.2, 0.05, 0.0125)]
    assert list(starts.values())[:4] == pytest.approx([
        0.0, zeros[0],
        zeros[1] + (0.0125 - 0.05) / (0.05 - 0.2) * (zeros[1] - zeros[0]),
        zeros[2] + (0.003125 - 0.0125) / (0.0125 - 0.05) * (zeros[2] - zeros[1]),
    ])  # fmt: skip


@pytest.mark.parametrize("lost", [1.0, np.nan])
def test_where_a_way_is_lost_other_steps_of_mu_are_tried(lost):
    """Powers 1, 1/2, 2, 1/4 and 4 of the ratio; then it ends with what the last two promise."""
    given = Lone(lambda u, mu: 2.0 * (1.0 - 3.0 * mu - u) if mu > 0.039 else lost)
    end = follow(given, Way(0.1, 0.4, bold=False))
    after = 0.04 * 0.4 ** np.array([1.0, 0.5, 2.0, 0.25, 4.0])
    assert viscosities(given) == pytest.approx([0.1, 0.04, *after])
    assert end.mu == pytest.approx(0.04)
    assert end.runs_away is None
    assert end.found.trial.du[2] == pytest.approx(0.88)
    assert end.ahead[2] == pytest.approx(1.0)


def test_the_first_power_that_leads_on_is_taken():
    """From 0.1 with 0.2: not to 0.02, but to 0.0447; then by the ratio again."""
    given = Lone(lambda u, mu: 1.0 if 0.015 < mu < 0.03 else 2.0 * (1.0 - mu - u))
    follow(given, Way(0.1, 0.2, bold=False))
    root = 0.1 * 0.2**0.5
    assert viscosities(given)[:4] == pytest.approx([0.1, 0.02, root, root * 0.2])


@pytest.mark.parametrize(("first", "second"), [(1.02e-6, 1.02e-7), (0.98e-6, 0.0)])
def test_below_a_ten_millionth_the_next_mu_is_none(first, second):
    given = Lone(lambda u, mu: 2.0 * (1.0 - mu - u))
    end = follow(given, Way(first, 0.1, bold=False))
    assert end.mu == 0.0
    assert viscosities(given)[1] == pytest.approx(second)


def test_on_the_way_less_is_in_balance_than_at_its_end():
    """Starts with 0.9e-8 are taken where mu is not zero; at zero they are solved."""
    given = Lone(lambda u, mu: 0.9e-8 if u == 0.0 else 0.0)
    end = follow(given, Way(5e-6, 0.1, bold=False))
    assert given.made == [0.0]
    assert end.found.steps == 1
    assert [mu for mu, _ in given.asked][:3] == pytest.approx([5e-6, 5e-7, 0.0], abs=1e-12)
    lost = Lone(lambda u, mu: 1.1e-8 if u == 0.0 else 1.0)
    assert follow(lost, Way(1e-5, 0.1, bold=False)) is None


def test_a_bold_way_is_bold_from_its_first_point_on():
    """Where the residual is smaller and the next step is not shorter: only boldly it is found."""
    script = {0.0: 1.0, 0.5: 0.9, 0.25: 0.95, 0.95: 0.0}

    def residual(u, mu):
        return script.get(round(u, 9), 5.0)

    assert follow(Lone(residual), Way(0.1, 0.5, bold=False)) is None
    assert follow(Lone(residual), Way(0.1, 0.5, bold=True)).mu == 0.0


def test_a_spent_effort_ends_the_path_where_it_is():
    """Each mu takes one step: with three of them the path comes to the third."""
    given = Lone(lambda u, mu: 2.0 * (1.0 + mu**2 - u))
    effort = Effort(3)
    end = follow(given, Way(0.1, 0.5, bold=False), effort)
    assert effort.spent
    assert len(given.made) == 3
    assert viscosities(given) == pytest.approx([0.1, 0.05, 0.025])
    assert end.mu == 0.025
