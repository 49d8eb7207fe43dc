"""False alarms come as often as stated, and changes are seen sooner than by simple rules."""

import numpy as np
import pytest
from support.in_time import DAY, TRUTH, B, covariance, effects

from geoident.identify.in_time.detection import Detector
from geoident.identify.in_time.innovations import Filter
from geoident.identify.in_time.regression import TimeRegression
from geoident.identify.in_time.simulation import Correlations, sound_innovations

YEAR = 365.25 * DAY
EVERY = 12.0 * DAY


def gauge(rng, years, before=6.0):
    """State after six years, and the readings and effects of the years after."""
    t = np.arange(0.0, (before + years) * YEAR, EVERY)
    y = effects(t) @ B + np.linalg.cholesky(covariance(TRUTH, t)) @ rng.standard_normal(len(t))
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
