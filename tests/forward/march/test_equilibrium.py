"""The rules of Newton's method one by one, on one unknown whose residual is given."""

from itertools import pairwise

import numpy as np
import pytest
from support.one_unknown import ZERO, OneUnknown

from geoident.forward.march.equilibrium import (
    _next_level,
    _refuse_mechanism,
    follow_slope,
    solve,
)
from geoident.forward.march.stage_equations import ELASTIC_PARTS, NoEquilibrium


class Given(OneUnknown):
    """In a small model, without potential unless it is said."""

    associated = large = False


# --- how far along a step ---


def shares(slope):
    """Where along a step from 0 with this slope of -Pi the way is looked at, and where it ends."""
    given = Given(slope)
    following, share = follow_slope(given, given.at(ZERO), np.ones(1))
    assert following.du[0] == share
    return given.asked[1:], share


@pytest.mark.parametrize("end", [0.5, 0.0, -0.29])
def test_a_step_that_rises_little_is_taken_whole(end):
    assert shares(lambda u: 1.0 + (end - 1.0) * u) == ([1.0], 1.0)


@pytest.mark.parametrize("size", [5.0, 0.2])
def test_slopes_are_judged_in_parts_of_the_first(size):
    """At the end -0.29 and -0.31 of it; on the way 0.29 and 0.31; however long the step."""
    for length in (1.0, 2.0):
        for end, whole in ((-0.29, True), (-0.31, False)):
            values = {0.0: size, length: end * size}
            given = Given(lambda u, values=values: values.get(u, 0.0))
            _, share = follow_slope(given, given.at(ZERO), np.array([length]))
            assert (share == 1.0) == whole
    for found, steps in ((0.29, 2), (-0.29, 2), (0.31, 3), (-0.31, 3)):
        values = {0.0: size, 1.0: -4.0 * size, 0.2: found * size}
        asked, _ = shares(lambda u, values=values: values.get(round(u, 12), 0.0))
        assert len(asked) == steps, found


def test_the_zero_of_a_straight_slope_is_found_at_once():
    asked, share = shares(lambda u: 2.0 - 6.0 * u)
    assert asked == pytest.approx([1.0, 1.0 / 3.0])
    assert share == asked[-1]


def test_a_slope_of_three_tenths_is_near_enough_on_both_sides():
    """With -4 at the end the chord of 1 meets zero at 0.2."""
    for found, steps in ((0.29, 2), (-0.29, 2), (0.31, 3), (-0.31, 3)):
        values = {0.0: 1.0, 1.0: -4.0, 0.2: found}
        asked, _ = shares(lambda u, values=values: values.get(round(u, 12), 0.0))
        assert len(asked) == steps, found


def test_a_chord_whose_one_end_stays_counts_it_half():
    """The Illinois rule: after (0.2, 0.5) and (1, -4) comes the chord from 0.5 to -2."""
    below, above = {0.0: 1.0, 1.0: -4.0, 0.2: 0.5}, {0.0: 1.0, 1.0: -4.0, 0.2: -1.5}
    asked, _ = shares(lambda u: below.get(round(u, 12), 0.0))
    assert asked == pytest.approx([1.0, 0.2, 0.2 + 0.8 * 0.5 / 2.5])
    asked, _ = shares(lambda u: above.get(round(u, 12), 0.0))
    assert asked == pytest.approx([1.0, 0.2, 0.2 * 0.5 / 2.0])


def test_a_chord_keeps_a_fiftieth_from_both_ends():
    asked, _ = shares(lambda u: 1.0 if u == 0.0 else -1e9 if u == 1.0 else 0.0)
    assert asked == pytest.approx([1.0, 0.02])
    asked, _ = shares(lambda u: {0.0: 1e9, 1.0: -0.31e9, 0.763359: 1e9}.get(round(u, 6), -0.4e9))
    low = 1.0 / 1.31
    # 1e9 against half of -0.31e9, then 0.5e9 against -0.4e9: nowhere near an end
    assert asked[:3] == pytest.approx([1.0, low, low + (1.0 - low) * 1.0 / 1.155])
    steep = shares(lambda u: 1e9 if u < 0.5 else -0.31e9 if u == 1.0 else 0.0)[0]
    assert steep == pytest.approx([1.0, low])
    high = shares(lambda u: {0.0: 1.0, 1.0: -0.301}.get(u, 1e6 if u < 0.9 else 0.0))[0]
    low = 1.0 / 1.301
    assert high == pytest.approx([1.0, low, 1.0 - 0.02 * (1.0 - low)])


def test_a_slope_that_jumps_across_zero_is_enclosed():
    """Forty turns at most; the ends close in on the jump at 0.3."""
    asked, share = shares(lambda u: 1.0 if u < 0.3 else -1.0)
    assert len(asked) == 41
    assert share == pytest.approx(0.3, abs=1e-6)


def test_ways_lie_along_the_step():
    """From 3 on, with a step of 2: to 3.4 where the slope ends."""
    given = Given(lambda u: 1.0 - 2.5 * (u - 3.0))
    following, share = follow_slope(given, given.at(np.array([3.0])), np.array([2.0]))
    assert following.du[0] == pytest.approx(3.4)
    assert share == pytest.approx(0.2)


# --- how stiff the next tangent is ---


@pytest.mark.parametrize(
    ("level", "share", "following"),
    [
        *[(level, 0.29, max(6, min(level + 1, 9))) for level in range(10)],
        *[(level, share, level) for level in (0, 5, 9) for share in (0.3, 0.89)],
        *[(level, 0.9, 0) for level in range(7)],
        *[(level, share, level - 1) for level in (7, 8, 9) for share in (0.9, 1.0)],
    ],
)
def test_short_steps_make_tangents_stiffer_and_long_ones_softer(level, share, following):
    assert len(ELASTIC_PARTS) == 11
    assert _next_level(level, share) == following


def test_parts_of_the_elastic_stiffness_rise_to_the_whole():
    assert ELASTIC_PARTS[0] == 1e-10
    assert ELASTIC_PARTS[6:] == (0.01, 0.03, 0.1, 0.3, 1.0)
    assert all(0.0 < a < b for a, b in pairwise(ELASTIC_PARTS))


# --- loads that nothing carries ---


@pytest.mark.parametrize(("left", "falls"), [(0.9e-6, False), (1.1e-6, True)])
@pytest.mark.parametrize("forces", [1.0, -4.0])
def test_a_mechanism_is_proven_by_the_power_far_out(left, falls, forces):
    """A millionth of the power of the loads is rounding; the place is a million steps away."""
    given = Given(lambda u: left * abs(forces), forces=np.array([forces]))
    start = given.at(np.array([3.0]))
    if falls:
        with pytest.raises(NoEquilibrium) as caught:
            _refuse_mechanism(given, start, np.array([2.0]))
        assert caught.value.mechanism.tolist() == [2.0]
    else:
        _refuse_mechanism(given, start, np.array([2.0]))
    assert given.asked[1:] == [3.0 + 2e6]


def test_a_mechanism_is_looked_for_from_the_fifth_step_on():
    given = Given(lambda u: 1.0, associated=True)
    with pytest.raises(NoEquilibrium):
        solve(given, [ZERO])
    assert given.asked == [0.0, 1.0, 2.0, 3.0, 4.0, 5.0, 5.0 + 1e6]


def test_sixty_steps_of_a_potential_without_its_minimum_are_no_equilibrium():
    given = Given(lambda u: 1.0 if u < 1e5 else -1.0, associated=True)
    with pytest.raises(NoEquilibrium) as caught:
        solve(given, [ZERO])
    assert caught.value.mechanism.tolist() == [60.0]
    assert len(given.levels) == 60


def test_a_potential_ends_in_equilibrium_or_where_rounding_hides_it():
    given = Given(lambda u: {0.0: 1.0, 1.0: 1.1e-11}.get(u, 0.9e-11), associated=True)
    found = solve(given, [ZERO])
    assert (found.steps, found.trial.du[0], found.made_at.du[0]) == (2, 2.0, 1.0)
    for left, ends in ((0.9e-8, True), (1.1e-8, False)):
        given = Given(lambda u, left=left: 1.0 if u == 0.0 else left, associated=True, forces=ZERO)
        if ends:
            found = solve(given, [ZERO])
            assert (found.steps, found.trial.du[0]) == (2, 1.0)
        else:
            with pytest.raises(NoEquilibrium):
                solve(given, [ZERO])


def test_the_nearest_guess_is_the_start():
    given = Given(lambda u: 0.0 if u == 7.0 else 1.0 + u, associated=True)
    found = solve(given, [ZERO, np.array([7.0]), np.array([2.0])])
    assert (found.steps, found.trial.du[0]) == (0, 7.0)
    assert found.factor is None
    assert found.made_at is None
