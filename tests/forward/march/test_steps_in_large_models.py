"""Newton's method where factors are dear: what leads, what is settled by itself, when it ends."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest
from support.one_unknown import ZERO, OneUnknown

from geoident.forward.march import equilibrium
from geoident.forward.march.equilibrium import (
    Balance,
    _by_secants,
    _LeadingFactors,
    _on_held_factors,
    _settled,
    _stepped,
    _without_potential,
    solve,
)
from geoident.forward.march.stage_equations import ELASTIC_PARTS, NoEquilibrium, Trial
from geoident.forward.march.viscous_path import WAYS, Effort, NewtonEnd, PathEnd


class Held:
    """Factors of another march: they step by a half, or by what is told."""

    most = 12

    def __init__(self, last=0.5, *, valid=True):
        self.factor = None
        if last:
            self.factor = SimpleNamespace(solve=lambda rhs: last * np.ones_like(rhs), valid=valid)
        self.whole = SimpleNamespace(solve=np.ones_like, valid=True)

    def last(self):
        return self.factor

    def elastic(self):
        return self.whole


# --- how stiff tangents begin ---


@pytest.mark.parametrize(
    ("errors", "levels"),
    [
        # far away a hundredth of the elastic stiffness is kept as long as steps do little
        ([1.0, 0.9, 0.44, 0.43, 0.0], [6, 6, 0, 0]),
        ([1.0, 0.501, 0.4, 0.0], [6, 6, 6]),
        ([1.0, 0.499, 0.4, 0.0], [6, 0, 0]),
        ([1.5e-3, 1.01e-3, 1e-12], [6, 6]),
        ([1.5e-3, 0.99e-3, 1e-12], [6, 0]),
        ([1.01e-3, 0.9e-3, 1e-12], [6, 0]),
        ([0.99e-3, 0.9e-3, 1e-12], [0, 0]),
    ],
)
def test_tangents_are_stiff_far_from_equilibrium(errors, levels):
    given = OneUnknown(dict(enumerate(errors)))
    found = solve(given, [ZERO])
    assert given.levels == levels
    assert found.steps == len(levels)


def test_small_models_begin_without():
    given = OneUnknown({0: 1.0, 1: 0.9, 2: 0.8}, large=False)
    solve(given, [ZERO])
    assert given.levels == [0, 0, 0]


@pytest.mark.parametrize(("large", "most"), [(False, 60), (True, 80)])
def test_large_models_may_take_twenty_steps_more(large, most):
    given = OneUnknown(lambda u: 1.0 if u < 1e5 else -1.0, large=large)
    with pytest.raises(NoEquilibrium):
        solve(given, [ZERO])
    assert len(given.levels) == most


# --- where it begins ---


@pytest.mark.parametrize(("error", "others"), [(0.9e-4, False), (1.1e-4, True)])
@pytest.mark.parametrize("large", [False, True])
def test_other_guesses_are_not_looked_at_where_the_last_is_sure(error, others, large):
    """In a large model: a look at the stresses costs as much as some solves."""
    given = OneUnknown(lambda u: error if u == 7.0 else 1e-12, large=large)
    solve(given, [ZERO, np.array([5.0]), np.array([7.0])])
    assert (0.0 in given.asked and 5.0 in given.asked) == (others or not large)


@pytest.mark.parametrize(("guess", "start"), [(0.79, 9.0), (0.81, 0.0)])
def test_the_elastic_step_may_be_the_better_start(monkeypatch, guess, start):
    """It has the lower potential; the elastic factor then leads."""
    given = OneUnknown({0.0: 0.8, 9.0: guess}, held=Held())
    monkeypatch.setattr(equilibrium.Directions, "guess", lambda self: np.array([9.0]))
    leading = _LeadingFactors(given, slopes=False)
    assert leading.begun(given.begun()).du[0] == start
    assert leading.lead is (given.held.whole if start else None)


@pytest.mark.parametrize(
    ("error", "steps", "leads"),
    [
        (3.1e-3, [9.0], False),  # beyond reach: the elastic step is looked at
        (2.9e-3, [], True),  # it leads the first step, and is not tried by itself
        (1.1e-3, [], True),
        (0.9e-3, [0.5, 0.55], True),  # tried as long as a tenth is left
    ],
)
def test_the_last_factor_leads_beside_equilibrium(monkeypatch, error, steps, leads):
    monkeypatch.setattr(equilibrium.Directions, "guess", lambda self: np.array([9.0]))
    script = {0.0: error, 0.5: 0.09 * error, 9.0: 1.0}
    given = OneUnknown(lambda u: script.get(u, 0.5 * error), held=Held())
    leading = _LeadingFactors(given, slopes=False)
    begun = leading.begun(given.begun())
    assert given.asked[1:] == pytest.approx(steps, abs=1e-3)
    assert begun.du[0] == (0.5 if len(steps) == 2 else 0.0)
    assert leading.lead is (given.held.factor if leads else None)
    nothing = OneUnknown({0.0: error, 9.0: 1.0}, held=Held(last=None))
    leading = _LeadingFactors(nothing, slopes=False)
    assert leading.begun(nothing.begun()).du[0] == 0.0
    assert leading.lead is None


def test_small_models_and_those_without_factors_begin_where_they_are():
    for given in (OneUnknown({0.0: 0.9e-4}, large=False, held=Held()), OneUnknown({0.0: 0.9e-4})):
        trial = given.begun()
        assert _LeadingFactors(given, slopes=False).begun(trial) is trial


# --- what leads a step ---


@pytest.fixture
def step_on(monkeypatch):
    """What is asked for on a factor that leads: it answers with a step of 3, or with none."""
    asked, answer = [], SimpleNamespace(found=np.array([3.0]))

    def fake(self, factor, trial, most, level):
        asked.append((factor, most, level))
        return answer.found

    monkeypatch.setattr(equilibrium.Directions, "step_on", fake)
    return SimpleNamespace(asked=asked, answer=answer)


def test_a_factor_that_leads_does_so_by_ten_iterations_at_most(step_on):
    given = OneUnknown({0.0: 1.0}, held=Held())
    lead = given.held.factor
    leading = _LeadingFactors(given, slopes=False, lead=lead)
    assert leading.direction(given.begun(), 7).tolist() == [3.0]
    assert step_on.asked == [(lead, 10, 7)]
    assert (leading.led, leading.own, given.levels) == (True, None, [])
    step_on.answer.found = None
    assert leading.direction(given.begun(), 7).tolist() == [1.0]
    assert given.levels == [7]
    assert (leading.led, leading.made_at) == (False, None)
    assert leading.own is leading.lead is not lead


@pytest.mark.parametrize(
    ("error", "slopes", "valid", "led"),
    [
        (1.1e-6, True, True, True),
        (0.9e-6, True, True, False),  # the pieces are known, and derivatives need their factor
        (0.9e-6, False, True, True),
        (1.0, False, False, False),
    ],
)
@pytest.mark.usefixtures("step_on")
def test_where_derivatives_are_wanted_the_factor_of_the_end_is_made(error, slopes, valid, led):
    given = OneUnknown({0.0: error}, held=Held(valid=valid))
    leading = _LeadingFactors(given, slopes=slopes, lead=given.held.factor)
    trial = given.begun()
    leading.direction(trial, 0)
    assert leading.led == led
    assert (leading.own is None) == led
    assert leading.made_at is (None if led else trial)
    small = OneUnknown({0.0: error}, held=Held(), large=False)
    alone = _LeadingFactors(small, slopes=slopes)
    alone.direction(small.begun(), 0)
    assert alone.lead is None
    assert alone.own is not None


@pytest.mark.parametrize(
    ("state", "error", "goes_on", "lead"),
    [
        ({"led": True, "lead": "lead"}, 0.51, False, None),  # a step that did little ends its lead
        ({"led": True, "lead": "lead"}, 0.49, False, "lead"),
        ({"led": True, "lead": "lead"}, 0.011, False, "lead"),
        ({"led": True, "lead": "lead"}, 0.009, "lead", "lead"),
        ({"led": False, "own": "own", "lead": "lead", "made_at": 1}, 0.9, False, "lead"),
        ({"led": False, "own": "own", "lead": "lead", "made_at": 1}, 0.009, "own", "lead"),
        ({"led": False, "own": "own", "lead": "lead"}, 0.009, False, "lead"),
        ({"led": False, "made_at": 1}, 0.009, False, None),
    ],
)
def test_a_factor_that_did_well_is_tried_once_more(monkeypatch, state, error, goes_on, lead):
    monkeypatch.setattr(equilibrium, "_by_secants", lambda equations, trial, factor: factor)
    leading = _LeadingFactors(OneUnknown({}), slopes=False, **state)
    trial = OneUnknown({0.0: 2.0 * error}).begun()
    assert leading.after(2.0, trial) == (goes_on or trial)
    assert leading.lead == lead


@pytest.mark.parametrize(
    ("errors", "end"),
    [
        ([1.0, 0.099, 0.0101], 1),  # a tenth is left at most
        ([1.0, 0.099, 0.0098, 0.5], 2),
        ([1.0, 0.101], 0),
        ([1.1e-11, 0.9e-12], 1),
        ([0.9e-11], 0),
    ],
)
def test_steps_on_one_factor_go_on_while_they_are_good(errors, end):
    """Steps of 1, but for what the ones before teach: they are told apart by their number."""
    given = OneUnknown(lambda u: errors[len(given.asked) - 1])
    factor = SimpleNamespace(solve=np.ones_like)
    found = _by_secants(given, given.begun(), factor)
    assert found.error == errors[end]
    assert len(given.asked) == len(errors)


def test_steps_on_one_factor_learn_from_each_other():
    """On the straight residual 1 - 0.95 u the second step is exact."""
    given = OneUnknown(lambda u: 1.0 - 0.95 * u)
    found = _by_secants(given, given.begun(), SimpleNamespace(solve=lambda rhs: rhs))
    assert given.asked == pytest.approx([0.0, 1.0, 1.0 / 0.95])
    assert found.error < 1e-12


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


# --- on factors that are held ---


class Leading:
    """Directions of 1, cut off or not, of levels that are told."""

    def __init__(self, cuts, levels=()):
        self.cuts, self.levels, self.least, self.cut = list(cuts), list(levels), [], False

    def at(self, trial, least):
        self.least.append(least)
        self.cut = self.cuts.pop(0) if self.cuts else False
        return np.ones(1), self.levels.pop(0) if self.levels else 0


def test_on_held_factors_it_ends_as_elsewhere():
    given = OneUnknown({0.0: 1.0, 1.0: 1.1e-11, 2.0: 0.9e-11})
    found = _on_held_factors(given, Leading([]), given.begun())
    assert (found.steps, found.factor, found.made_at, found.trial.du[0]) == (2, None, None, 2.0)
    for left, ends in ((0.9e-8, True), (1.1e-8, False)):
        given = OneUnknown(lambda u, left=left: 1.0 if u == 0.0 else left if u < 1e5 else 0.0)
        if ends:
            found = _on_held_factors(given, Leading([]), given.begun())
            assert (found.steps, found.trial.du[0]) == (2, 2.0 if left == 0.0 else 1.0)
        else:
            with pytest.raises(NoEquilibrium) as caught:
                _on_held_factors(given, Leading([]), given.begun())
            assert caught.value.mechanism.tolist() == [80.0]


@pytest.mark.parametrize(("cuts", "whole"), [([], 5), ([True, True], 7), ([False, True], 6)])
def test_on_held_factors_only_whole_steps_are_looked_along_for_a_mechanism(cuts, whole):
    """From the fifth whole step on, a million steps away."""
    given = OneUnknown(lambda u: 1.0)
    with pytest.raises(NoEquilibrium):
        _on_held_factors(given, Leading(cuts), given.begun())
    assert given.asked == [*(float(k) for k in range(whole + 1)), whole + 1e6]


def test_on_held_factors_short_steps_make_the_next_tangent_stiffer():
    """A step that is cut off comes between: after it the tangent is as it was made."""
    script = {0.0: 1.0, 1.0: -9.0}
    given = OneUnknown(lambda u: script.get(u, 1.0 if u < 0.105 else -9.0))
    leading = Leading([False, False, True, False], [0, 8, 0, 0])
    with pytest.raises(NoEquilibrium):
        _on_held_factors(given, leading, given.begun())
    assert leading.least[:5] == [0, 6, 9, 0, 6]
    assert ELASTIC_PARTS[9] == 0.3


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
