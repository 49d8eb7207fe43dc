"""False alarms come as often as stated, and changes are seen sooner than by simple rules."""

from functools import cache

import numpy as np
import pytest
from support.in_time import DAY, TRUTH, B, covariance, effects

from geoident.identify.in_time.detection import Detector
from geoident.identify.in_time.innovations import Filter
from geoident.identify.in_time.regression import TimeRegression
from geoident.identify.in_time.simulation import Correlations, sound_innovations

YEAR = 365.25 * DAY
EVERY = 12.0 * DAY


def days(years, before):
    return np.arange(0.0, (before + years) * YEAR, EVERY)


@cache
def root_of(years, before):
    return np.linalg.cholesky(covariance(TRUTH, days(years, before)))


def gauge(rng, years, before=6.0):
    """State after six years, and the readings and effects of the years after."""
    t = days(years, before)
    y = effects(t) @ B + root_of(years, before) @ rng.standard_normal(len(t))
    old = t < before * YEAR
    end = TimeRegression(t[old], y[old], effects(t)[old], TRUTH).end
    return end, t[~old], effects(t)[~old], y[~old]


def detector(rng, years, gauges):
    parts = [gauge(rng, years) for _ in range(gauges)]
    filters = [Filter(end, t, X) for end, t, X, _ in parts]
    innovations = [
        (y - f.predicted(y)) / f.sd for f, (_, _, _, y) in zip(filters, parts, strict=True)
    ]
    return Detector(filters), innovations


def threshold(usual, between):
    """The surprise that independent sound gauges pass so often."""
    alike = np.eye(len(usual.filters))
    rng = np.random.default_rng(0)
    sound = sound_innovations(usual.filters, Correlations(alike, alike), 200, rng)
    return usual.threshold(between, sound)


def test_chance_raises_an_alarm_as_seldom_as_stated():
    """Of 50 periods of two years without a change, a fifth has one if one comes in nine years."""
    rng = np.random.default_rng(7)
    usual, _ = detector(rng, 2.0, 3)
    limit = threshold(usual, 9.0 * YEAR)
    alarms = [bool(one.changes(e, limit)) for one, e in (detector(rng, 2.0, 3) for _ in range(50))]
    assert 0.04 <= np.mean(alarms) <= 0.38  # 0.2, and three standard deviations of 50


def test_a_step_is_seen_sooner_than_by_three_in_a_row_outside_two_sigma():
    """At no more false alarms: a step of two standard deviations of a reading."""
    rng = np.random.default_rng(8)
    usual, _ = detector(rng, 2.0, 1)
    limit = threshold(usual, 10.0 * YEAR)
    begun, delays, simple = 0.5 * YEAR, [], []
    for _ in range(25):
        one, (e,) = detector(rng, 2.0, 1)
        f = one.filters[0]
        since = f.times[0] + begun
        e = e + f.effects(np.where(f.times > since, 2.0 * TRUTH.sd, 0.0)[:, None])[:, 0]
        changes = one.changes([e], limit)
        seen = [c.shown for c in changes if c.shown > since]
        delays.append((min(seen) - since) if seen else 1.5 * YEAR)
        outside = np.abs(e) > 2.0
        three = np.flatnonzero(outside[2:] & outside[1:-1] & outside[:-2] & (f.times[2:] > since))
        simple.append(f.times[2:][three[0]] - since if three.size else 1.5 * YEAR)
    assert np.median(delays) < 0.5 * np.median(simple)


@pytest.mark.parametrize("kind", ["step", "drift"])
def test_size_and_beginning_of_a_change_are_within_their_intervals(kind):
    """Where a change is of the kind that is said; a doubt about that is a number."""
    rng = np.random.default_rng(9)
    usual, _ = detector(rng, 2.0, 1)
    limit = threshold(usual, 10.0 * YEAR)
    size = 2.5 * TRUTH.sd if kind == "step" else 4.0 * TRUTH.sd
    right, odds, held = [], [], []
    for _ in range(25):
        one, (e,) = detector(rng, 2.0, 1)
        f = one.filters[0]
        elapsed = f.times - f.times[0] - 0.6 * YEAR
        pattern = np.where(elapsed > 0.0, 1.0 if kind == "step" else elapsed / YEAR, 0.0)
        e = e + f.effects(size * pattern[:, None])[:, 0]
        for c in one.changes([e], limit):
            right.append(c.kind == kind)
            odds.append(c.odds if c.kind == kind else 1.0 - c.odds)
            if c.kind == kind:
                begun = f.times[0] + 0.6 * YEAR
                inside = c.earliest - 10 * DAY <= begun <= c.latest + 10 * DAY
                held.append(abs(c.size[0] - size) < 2.5 * c.sd[0] and inside)
    assert len(right) >= 22
    assert np.mean(held) >= 0.85
    assert np.mean(odds) > 0.6


SHARES = np.array([[1.0, 0.4], [0.7, 0.9], [0.5, 0.1], [0.3, 0.6]])
"""What two parameters do to four gauges, in a level that goes up and down."""


def with_parameters(rng, years=2.0, shares=SHARES):
    """A detector of gauges that parameters move, what these do to each, and sound innovations."""
    parts = [gauge(rng, years) for _ in shares]
    filters = [Filter(end, t, X) for end, t, X, _ in parts]
    e = [(y - f.predicted(y)) / f.sd for f, (_, _, _, y) in zip(filters, parts, strict=True)]
    slopes = [own * (1.5 + np.sin(f.times / (60.0 * DAY)))[:, None]
              for f, own in zip(filters, shares, strict=True)]  # fmt: skip
    return Detector(filters, parameters=slopes), slopes, e


def moved(one, e, motions, begun):
    """Innovations with motions from a time on, s since the first reading."""
    return [
        own + f.effects(np.where(f.times - f.times[0] > begun, motion, 0.0)[:, None])[:, 0]
        for own, f, motion in zip(e, one.filters, motions, strict=True)
    ]


def parameter_threshold(one):
    alike = np.eye(len(one.filters))
    sound = sound_innovations(
        one.filters, Correlations(alike, alike), 200, np.random.default_rng(0)
    )
    return one.threshold(10.0 * YEAR, sound), sound


def test_a_parameter_that_changes_is_found_with_its_size_and_date():
    rng = np.random.default_rng(21)
    limit, _ = parameter_threshold(with_parameters(rng)[0])
    held, right = [], []
    for _ in range(10):
        one, slopes, e = with_parameters(rng)
        change = one.parameter_change(
            moved(one, e, [-0.8 * s[:, 1] for s in slopes], 200 * DAY), limit
        )
        began = one.filters[0].times[0] + 200 * DAY
        _, low, high = change.size[0]
        held.append(low < -0.8 < high and change.earliest < began < change.latest)
        right.append(change.parameters[0] == 1)
        assert change.lasts
        assert 1 in change.gauges  # that which it moves most
    assert np.mean(held) >= 0.8
    assert np.mean(right) >= 0.9


def test_a_gauge_that_fails_is_no_parameter_and_a_parameter_no_gauge():
    """Each is told as what it is, and both where both happen."""
    rng = np.random.default_rng(22)
    limit, _ = parameter_threshold(with_parameters(rng)[0])
    for _ in range(5):
        one, slopes, e = with_parameters(rng)
        step = [3.0 * TRUTH.sd * np.ones(len(e[0])), *(np.zeros(len(own)) for own in e[1:])]
        failed = moved(one, e, step, 300 * DAY)
        assert one.parameter_change(failed, limit) is None
        assert (0,) in [change.gauges for change in one.changes(failed, limit)]
        both = moved(one, failed, [1.5 * s[:, 0] for s in slopes], 200 * DAY)
        change = one.parameter_change(both, limit)
        assert change.parameters[0] == 0
        _, effects = one.seen_of(change, 0, [change.size[0][0] * s[:, 0] for s in slopes])
        left = [a - b for a, b in zip(both, effects, strict=True)]
        assert one.parameter_change(left, limit) is None
        assert {c.gauges for c in one.changes(left, limit)} >= {(0,)}


def test_a_pattern_that_is_no_parameter_is_one_of_gauges():
    rng = np.random.default_rng(23)
    one, slopes, e = with_parameters(rng)
    limit, _ = parameter_threshold(one)
    pattern = [
        3.0 * TRUTH.sd * sign * np.ones(len(s))
        for sign, s in zip((1, -1, -1, 1), slopes, strict=True)
    ]
    changed = moved(one, e, pattern, 200 * DAY)
    assert one.parameter_change(changed, limit) is None
    assert len(one.changes(changed, limit)[0].gauges) > 1


def test_parameters_that_move_the_gauges_alike_are_both_named():
    alike = np.column_stack([SHARES[:, 0], SHARES[:, 0] * np.array([1.0, 1.01, 0.99, 1.0])])
    one, slopes, e = with_parameters(np.random.default_rng(24), shares=alike)
    limit, _ = parameter_threshold(one)
    change = one.parameter_change(moved(one, e, [-1.0 * s[:, 0] for s in slopes], 200 * DAY), limit)
    assert sorted(change.parameters) == [0, 1]
    assert min(change.odds) > 0.2
    assert sum(change.odds) == pytest.approx(1.0, abs=0.02)


def test_with_parameters_chance_raises_an_alarm_as_seldom_as_stated():
    """Of all together: gauges, patterns and parameters."""
    rng = np.random.default_rng(25)
    one, *_ = with_parameters(rng)
    alike = np.eye(len(SHARES))
    sound = sound_innovations(one.filters, Correlations(alike, alike), 200, rng)
    limit = one.threshold(2.0 * one.length, sound)
    others = sound_innovations(one.filters, Correlations(alike, alike), 300, rng)
    assert np.mean(one.largest(others) > limit) == pytest.approx(1.0 - np.exp(-0.5), abs=0.12)
