"""Newton's method where factors are dear: what leads, what is settled by itself, when it ends."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest
from support.one_unknown import ZERO, OneUnknown

from geoident.forward.march import equilibrium
from geoident.forward.march.equilibrium import (
    Balance,
    _settled,
    _stepped,
    _without_potential,
    solve,
)
from geoident.forward.march.stage_equations import NoEquilibrium, Trial
from geoident.forward.march.viscous_path import WAYS, Effort, NewtonEnd, PathEnd

# --- places that are solved by themselves ---


class Patches:
    """Asked for patches; gives one only where so many unknowns or fewer are beyond the part."""

    def __init__(self, few=0):
        self.few, self.asked = few, []

    def around(self, unknowns, most):
        self.asked.append((unknowns.tolist(), most))
        return SimpleNamespace(dofs=np.array([3, 1])) if len(unknowns) <= self.few else None

    def within(self, patch):
        return "tangents"


class Own(OneUnknown):
    """A patch: one of its two displacements moves."""

    dofs = np.array([1])

    def __init__(self, residual):
        super().__init__(residual)

    def at(self, du):
        self.asked.append(du.tolist())
        found = np.array([float(self.residual(float(du[1])))])
        return Trial(du, np.zeros((1, 1)), (), found, 1.0)

    def spread(self, free):
        return np.array([0.0, free[0]])


class Whole:
    """Forty degrees of freedom, of which residuals are given."""

    dofs = np.arange(40)

    def __init__(self, patches, own=None):
        self.patches, self.own, self.given = patches, own, None

    def within(self, patch, tangents, du):
        self.given = patch, tangents, du
        return self.own

    def at(self, du):
        return Trial(du, np.zeros((1, 1)), (), np.zeros(40), 1.0)


def uneven():
    residual = np.zeros(40)
    residual[[4, 9, 11, 30]] = [2.0, -0.61, 0.21, -0.061]
    residual[[5, 10, 12]] = [0.59, -0.19, 0.059]
    return Trial(np.arange(40.0), np.zeros((1, 1)), (), residual, 1.0)


@pytest.mark.parametrize(("few", "tried"), [(7, 1), (6, 1), (5, 2), (4, 2), (3, 3), (2, 3), (1, 3)])
def test_the_worst_places_are_looked_for_from_many_to_few(few, tried):
    """More than 3, 10 and 30 % of the largest; a tenth of the unknowns at most."""
    own = Own(lambda u: 0.0)
    patches = Patches(few)
    found = _settled(Whole(patches, own), uneven())
    parts = [([4, 5, 9, 10, 11, 30], 4), ([4, 5, 9, 11], 4), ([4, 9], 4)]
    assert patches.asked == parts[:tried]
    assert (found is None) == (few < 2)


def test_places_are_solved_by_themselves_to_a_thousandth():
    """From 2 to 0.002, by its own steps of 1; the other places stay."""
    own = Own(lambda u: {1.0: 2.0, 2.0: 0.5, 3.0: 0.0021, 4.0: 0.002}[u])
    whole = Whole(Patches(9), own)
    found = _settled(whole, uneven())
    patch, tangents, du = whole.given
    assert tangents == "tangents"
    np.testing.assert_array_equal(du, np.arange(40.0))
    assert own.asked[0] == [3.0, 1.0]
    assert [at[1] for at in own.asked] == [1.0, 2.0, 3.0, 4.0]
    expected = np.arange(40.0)
    expected[patch.dofs] = [3.0, 4.0]
    np.testing.assert_array_equal(found.du, expected)
    assert own.levels == [0, 0, 0]


def test_ten_steps_are_made_there_at_most_and_stiffer_after_short_ones():
    own = Own(lambda u: 1.0)
    _settled(Whole(Patches(9), own), uneven())
    assert own.levels == [0] * 10
    turned = Own(lambda u: 1.0 if u < 1.105 else -9.0)
    _settled(Whole(Patches(9), turned), uneven())
    assert turned.levels[:3] == [0, 6, 7]


@pytest.mark.parametrize(
    ("end", "settles", "large", "patches", "asked"),
    [
        (0.099, True, True, True, False),  # a quick step is good enough
        (0.101, True, True, True, True),
        (-0.101, False, True, True, True),
        (0.5, True, False, True, False),
        (0.5, True, True, False, False),
    ],
)
def test_places_are_settled_after_a_step_that_left_much(
    monkeypatch, end, settles, large, patches, asked
):
    made = []
    settled = OneUnknown({3.0: -0.29 if settles else -0.31}).begun(3.0)

    def fake(equations, trial):
        made.append(trial.du[0])
        return settled

    monkeypatch.setattr(equilibrium, "_settled", fake)
    given = OneUnknown({0.0: 1.0, 2.0: end}, large=large, patches=Patches() if patches else None)
    found, share = _stepped(given, given.begun(), np.array([2.0]))
    assert made == ([2.0] if asked else [])
    assert share == 1.0
    assert found.du[0] == (3.0 if asked and settles else 2.0)
    assert given.asked == [0.0, 2.0]


@pytest.mark.parametrize(("end", "taken"), [(-1.17, True), (-1.23, False)])
def test_what_is_settled_may_have_risen_by_three_tenths(monkeypatch, end, taken):
    """The slope there, in parts of that where the way begins: 4 on a way of 3."""
    settled = OneUnknown({3.0: end}).begun(3.0)
    monkeypatch.setattr(equilibrium, "_settled", lambda equations, trial: settled)
    given = OneUnknown({0.0: 4.0, 2.0: 2.0}, patches=Patches())
    found, _ = _stepped(given, given.begun(), np.array([2.0]))
    assert found.du[0] == (3.0 if taken else 2.0)


def test_what_is_settled_uphill_or_not_at_all_leaves_the_step(monkeypatch):
    """The way there must begin downhill."""
    for settled in (None, OneUnknown({-3.0: 0.0}).begun(-3.0)):
        monkeypatch.setattr(equilibrium, "_settled", lambda *_, settled=settled: settled)
        given = OneUnknown({0.0: 1.0, 2.0: 0.5}, patches=Patches())
        found, _ = _stepped(given, given.begun(), np.array([2.0]))
        assert found.du[0] == 2.0


# --- without potential ---


def flow(mu, du, ahead=None, *, runs=None, steps=4):
    trial = Trial(np.array(du), np.zeros((1, 1)), (), ZERO, 1.0)
    end = NewtonEnd(trial, steps, "factor", "made", converged=True)
    return PathEnd(end, mu, np.array(du if ahead is None else ahead), runs)


@pytest.fixture
def paths(monkeypatch):
    """Newton's method that is lost, and ways that end as told."""
    told = SimpleNamespace(ends=[], ways=[], newton=[], converged=False)

    def newton(equations, start, *, most, effort):
        told.newton.append((most, effort))
        return NewtonEnd(start, 3, "own factor", "own place", converged=told.converged)

    def follow(equations, way, effort):
        told.ways.append((way, effort))
        return told.ends[len(told.ways) - 1]

    monkeypatch.setattr(equilibrium, "newton", newton)
    monkeypatch.setattr(equilibrium, "follow", follow)
    return told


def balanced(paths, *ends, ways=WAYS, given=None):
    paths.ends = list(ends)
    given = given or OneUnknown({0.0: 1.0})
    return _without_potential(given, given.begun(), ways, Effort(9))


def test_newtons_method_comes_first_with_ten_steps(paths):
    paths.converged = True
    found = balanced(paths)
    assert (found.steps, found.factor, found.made_at) == (3, "own factor", "own place")
    ((most, effort),) = paths.newton
    assert (most, effort.left) == (10, 9)
    assert paths.ways == []


def test_the_first_way_that_leads_to_the_ground_is_taken(paths):
    found = balanced(paths, None, flow(0.0, [2.0]))
    assert isinstance(found, Balance)
    assert (found.steps, found.factor, found.made_at) == (4, "factor", "made")
    assert (found.trial.du[0], found.viscosity, found.unbalanced) == (2.0, 0.0, 0.0)
    assert [way for way, _ in paths.ways] == list(WAYS[:2])
    table = [(way.first, way.ratio, way.bold) for way in WAYS]
    assert table == [(0.1, 0.15, False), (0.05, 0.3, False), (0.1, 0.5, True)]
    assert all(effort is paths.newton[0][1] for _, effort in paths.ways)


def test_a_way_that_runs_away_ends_the_search(paths):
    with pytest.raises(NoEquilibrium) as caught:
        balanced(paths, flow(0.01, [1.0]), flow(0.02, [1.0], runs=np.array([5.0])))
    assert caught.value.limit
    assert caught.value.mechanism.tolist() == [5.0]


@pytest.mark.parametrize(
    ("ends", "answer", "tried"),
    [
        ([2.9e-4, 1e-5, 1e-5], 2.9e-4, 1),
        ([3.1e-4, 2.9e-4, 1e-5], 2.9e-4, 2),
        ([2.9e-3, 0.05, 3.2e-4], 3.2e-4, 3),
        ([1e-3, 2e-3, 0.05], 1e-3, 3),
    ],
)
def test_the_end_of_least_viscosity_counts(paths, ends, answer, tried):
    """Hardly any at once; a little after all ways."""
    found = balanced(paths, *(flow(mu, [1.0 + mu]) for mu in ends))
    assert found.viscosity == answer
    assert found.trial.du[0] == 1.0 + answer
    assert len(paths.ways) == tried
    assert (found.steps, found.factor, found.made_at) == (4, None, None)


def test_what_is_short_is_said_in_parts_of_what_is_promised(paths):
    end = flow(1e-4, [0.5, -3.0, 2.0], [0.8, -4.0, 1.9])
    assert balanced(paths, end).short == pytest.approx(1.0 / 4.0)
    paths.ways.clear()
    assert balanced(paths, flow(1e-4, [0.0])).short == 0.0


def test_bands_met_by_a_later_way_do_not_count(paths):
    even = flow(2e-3, [1.0], [1.1])
    found = balanced(paths, even, flow(0.0, [3.0]))
    assert (found.viscosity, found.trial.du[0]) == (2e-3, 1.0)
    paths.ways.clear()
    found = balanced(paths, even, flow(0.0, [1.15]))
    assert (found.viscosity, found.trial.du[0]) == (0.0, 1.15)


def test_where_no_way_begins_there_is_no_equilibrium(paths):
    with pytest.raises(NoEquilibrium) as caught:
        balanced(paths, None, None, None)
    assert caught.value.even is None
    assert not caught.value.limit
    assert caught.value.mechanism.tolist() == [0.0]


def test_where_one_way_is_tried_its_end_is_handed_on(paths):
    with pytest.raises(NoEquilibrium) as caught:
        balanced(paths, flow(3.1e-4, [1.5]), ways=WAYS[:1])
    assert caught.value.mechanism.tolist() == [1.5]
    assert (caught.value.even.viscosity, caught.value.even.trial.du[0]) == (3.1e-4, 1.5)


@pytest.mark.parametrize(("left", "good"), [(0.0198, True), (0.0202, False)])
@pytest.mark.parametrize("better", [0, 1])
def test_a_hundredth_of_the_load_may_stay_at_the_end_or_where_it_leads(paths, left, good, better):
    """In parts of what is out of balance at rest, 2 here."""
    errors = {0.0: 2.0, 1.5: 0.5, 1.7: 0.5}
    errors[(1.5, 1.7)[better]] = left
    given, end = OneUnknown(errors), flow(0.05, [1.5], [1.7])
    if good:
        found = balanced(paths, end, None, None, given=given)
        assert found.unbalanced == pytest.approx(left / 2.0)
        assert found.trial.du[0] == (1.5, 1.7)[better]
        assert (found.steps, found.factor, found.viscosity) == (4, None, 0.0)
        return
    with pytest.raises(NoEquilibrium) as caught:
        balanced(paths, end, None, None, given=given)
    assert (caught.value.even.viscosity, caught.value.even.trial.du[0]) == (0.05, 1.5)
    assert caught.value.mechanism.tolist() == [1.5]


def test_an_end_without_stress_is_no_equilibrium_either(paths):
    def nowhere(u):
        if u == 1.7:
            raise NoEquilibrium(None)
        return 1.0

    with pytest.raises(NoEquilibrium) as caught:
        balanced(paths, flow(0.05, [1.5], [1.7]), None, None, given=OneUnknown(nowhere))
    assert caught.value.even.viscosity == 0.05
    assert caught.value.mechanism.tolist() == [1.5]
    assert caught.value.__cause__ is None


def test_a_search_has_two_hundred_and_forty_steps_or_what_is_left(paths):
    paths.converged = True
    given = OneUnknown({0.0: 3.0, 5.0: 1.0, 6.0: 2.0}, associated=False)
    found = solve(given, [ZERO, np.array([5.0]), np.array([6.0])])
    assert found.trial.du[0] == 5.0
    assert paths.newton[0][1].left == 240
    effort = Effort(11)
    solve(given, [ZERO], effort=effort)
    assert paths.newton[1][1] is effort


def test_even_flow_alone_is_looked_for_on_the_first_way(paths):
    paths.ends = [None] * 3
    for even_only, ways in ((True, 1), (False, 3)):
        paths.ways.clear()
        with pytest.raises(NoEquilibrium):
            solve(OneUnknown({0.0: 1.0}, associated=False), [ZERO], even_only=even_only)
        assert len(paths.ways) == ways
