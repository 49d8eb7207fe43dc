"""Innovations of sound gauges, simulated: what chance does (theory 16.4).

The innovations of one gauge are independent. Those of several are not: they share errors of one
day, and much more what lasts and drifts, since an effect that the model lacks moves many gauges. So
the errors themselves are drawn, correlated between gauges, and go through the filters.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from geoident.identify.in_time.innovations import Filter
from geoident.identify.in_time.noise import PROCESSES, Noise, TimeCovariance
from geoident.model.arrays import Floats, Ints
from geoident.model.in_service import DAY, YEAR

_COMMON, _SHRUNK = 20, 0.8
"""Times that two gauges must have in common for their correlation, and what is kept of it."""

_LEAST = 0.05
"""Eigenvalue of a correlation."""


@dataclass(frozen=True)
class FittedErrors:
    """The errors of a gauge's fitted readings, divided.

    Args:
        times: (m,) s.
        white: (m,) what each reading has by itself, SI.
        slow: (m,) what lasts or drifts, SI.
    """

    times: Floats
    white: Floats
    slow: Floats

    @classmethod
    def of(cls, noise: Noise, times: Floats, residual: Floats) -> FittedErrors:
        """The most likely division of residuals (m,), SI."""
        white = noise.white**2 * TimeCovariance(noise, times).solve(residual)
        return cls(times, white, residual - white)


@dataclass(frozen=True)
class Correlations:
    """How errors of n gauges go together.

    Args:
        white: (n, n) errors of one day.
        slow: (n, n) errors that last, drifts and errors of coefficients.
    """

    white: Floats
    slow: Floats

    @classmethod
    def of(cls, errors: Sequence[FittedErrors]) -> Correlations:
        """Those of fitted errors."""
        n = len(errors)
        white, slow = np.eye(n), np.eye(n)
        days = [own.times // DAY for own in errors]
        for i, one in enumerate(errors):
            for j, other in enumerate(errors[:i]):
                _, a, b = np.intersect1d(days[i], days[j], return_indices=True)
                white[i, j] = white[j, i] = _correlation(one.white[a], other.white[b])
                both = (one.times >= other.times[0]) & (one.times <= other.times[-1])
                there = np.interp(one.times[both], other.times, other.slow)
                slow[i, j] = slow[j, i] = _correlation(one.slow[both], there)
        return cls(positive(white), positive(slow))

    def of_innovations(self, gauges: Ints, white: Floats, sd: Floats) -> Floats:
        """The correlation (k, k) of innovations of one day.

        Args:
            gauges: (k,) their numbers; innovations of one gauge are independent.
            white: (k,) standard deviation of what each reading has by itself, SI.
            sd: (k,) that of the innovations, SI.
        """
        own = white / sd
        rest = np.sqrt(np.maximum(1.0 - own**2, 0.0))
        pairs = np.ix_(gauges, gauges)
        R = self.white[pairs] * np.outer(own, own) + self.slow[pairs] * np.outer(rest, rest)
        R[(gauges[:, None] == gauges) & ~np.eye(len(gauges), dtype=np.bool_)] = 0.0
        return np.asarray(R)


def _correlation(a: Floats, b: Floats) -> float:
    """Of errors (k,), less what so few would have by chance."""
    if len(a) < _COMMON or not (a.any() and b.any()):
        return 0.0
    return _SHRUNK * float(a @ b / np.sqrt((a @ a) * (b @ b)))


def positive(R: Floats) -> Floats:
    """The correlation (n, n) with eigenvalues that are not too small: pairs may contradict."""
    values, vectors = np.linalg.eigh(R)
    if values[0] >= _LEAST:
        return R
    R = (vectors * np.maximum(values, _LEAST)) @ vectors.T
    size = np.sqrt(np.diag(R))
    return np.asarray(R / np.outer(size, size))


def sound_innovations(
    filters: Sequence[Filter],
    together: Correlations,
    number: int,
    rng: np.random.Generator,
    likely: Sequence[Sequence[Noise]] | None = None,
    shared: Sequence[Ints] = (),
) -> list[Floats]:
    """(m, number) simulated innovations of each gauge, in which nothing changes.

    Args:
        filters: one for each gauge.
        together: how their errors go together.
        number: of simulated periods.
        rng: random numbers.
        likely: noises of each gauge, one of which each period has; None for those of the filters.
        shared: of each gauge, numbers of the terms whose coefficients all gauges have in common;
            empty for none.
    """
    moments, places = _moments([f.times for f in filters])
    white, slow = (
        np.asarray(np.linalg.cholesky(R), dtype=np.float64) for R in (together.white, together.slow)
    )
    n = len(filters)

    def draws(root: Floats, length: int) -> Floats:
        """(n, length, number), correlated between gauges."""
        return (root @ rng.standard_normal((n, length * number))).reshape(n, length, number)

    given = likely if likely is not None else [[f.state.noise] for f in filters]
    chosen = [[own[k] for k in rng.integers(len(own), size=number)] for own in given]
    parts = [[(a.white, a.lasting, a.time, a.drift) for a in own] for own in chosen]
    own_error, lasting, fades, drift = np.array(parts).transpose(2, 0, 1)  # each (n, number)
    independent = draws(slow, max(len(f.state.mean) for f in filters))
    first_terms = shared or [np.zeros(0, dtype=np.int64)] * n
    common = rng.standard_normal((len(first_terms[0]), number))
    start = [
        f.state.drawn(np.vstack([common, own[: len(f.state.mean) - len(common)]]), first)
        for f, own, first in zip(filters, independent, first_terms, strict=True)
    ]
    x, s = np.stack([one[-PROCESSES:] for one in start], axis=1)  # each (n, number)
    errors = [
        f.columns @ first[:-PROCESSES] + size * own[place]
        for f, size, first, own, place in zip(
            filters, own_error, start, draws(white, len(moments)), places, strict=True
        )
    ]
    before = np.array([f.state.time for f in filters])
    row = [0] * n
    for moment in moments:
        elapsed = np.maximum(moment - before, 0.0)[:, None]
        phi = np.exp(-elapsed / fades)
        eps, eta = draws(slow, 2).transpose(1, 0, 2)
        x = phi * x + lasting * np.sqrt(1.0 - phi**2) * eps
        s = s + drift * np.sqrt(elapsed / YEAR) * eta
        before = np.maximum(before, moment)
        for i, place in enumerate(places):
            if row[i] < len(place) and moments[place[row[i]]] == moment:
                errors[i][row[i]] += x[i] + s[i]
                row[i] += 1
    return [f.effects(own) for f, own in zip(filters, errors, strict=True)]


def _moments(times: Sequence[Floats]) -> tuple[Floats, list[Ints]]:
    """Moments of all gauges (k,), s, and which of them each gauge's times (m,) are.

    What gauges read on one day is one moment; each of several readings of a day is one of its own.
    """
    days = [own // DAY for own in times]
    ordinals = [np.arange(len(own)) - np.searchsorted(own, own) for own in days]
    most = 1 + max(int(own.max()) for own in ordinals)
    own = [day + ordinal / most for day, ordinal in zip(days, ordinals, strict=True)]
    moments = np.unique(np.concatenate(own))
    return moments * DAY, [np.searchsorted(moments, one) for one in own]
