"""Changes of gauges and of the structure, from innovations (theory 16.4).

A step or a drift of one gauge that begins at a time t0 adds a known pattern g to its innovations,
in an unknown size a. The generalized likelihood ratio for it is

    z^2 ,    z = sum g e / sqrt(sum g^2) ,      a = sum g e / sum g^2 ,    sd(a) = 1 / sqrt(sum g^2)

over the innovations since t0; z is standard normal where nothing has changed. At each date the
largest over all t0 of a window counts. For all n gauges together, whose z of a change have the
correlation R, a change of any pattern over the gauges at one t0 has

    z^T R^-1 z less its largest term, at most chi-squared with n - 1 degrees of freedom,

so that one gauge that fails is no change of the structure. R follows from simulated innovations in
which nothing changes, for steps and drifts of some age: sums over longer times are more alike.

Both are compared by their surprise, -log10 of the probability that chance does as much at one date
and one t0. The threshold of it follows from the same simulations: it is passed, by any gauge or by
all together, once in a stated time on the average.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.special import chdtrc

from geoident.identify.in_time.innovations import Filter
from geoident.model.arrays import Bools, Floats, Ints
from geoident.model.in_service import DAY, YEAR

WINDOW = 2.0 * YEAR
"""How far back changes are sought, s."""

KINDS = ("step", "drift")

_NEAR = 4.0
"""Steps between possible beginnings by which changes that are one may differ."""

_PART = 2.0
"""Of z from which on a gauge shows a change of several."""

_MOST_DATES = 120
"""Dates of a period at which changes are sought; of more, some."""

_MOST_BEGINNINGS = 40
"""Times at which a change may begin within the window."""

_LEAST_CHANCE = 1e-300
"""Below it floating-point numbers have no probability."""

_AT_A_TIME = 20
"""Simulated periods of which z is kept at once."""

_KEPT = 0.95
"""What is kept of simulated correlations."""

_AGES = np.array([0.1, 0.25, 0.5, 1.0]) * YEAR
"""Ages of changes, s, between which gauges have one correlation."""


@dataclass(frozen=True)
class Change:
    """A change that innovations show.

    Args:
        kind: ``step`` or ``drift``.
        gauges: numbers of the gauges that show it.
        shown: day whose readings show it first, s.
        since: when it most likely began, s.
        earliest: beginning of the 95 % interval of that, s.
        latest: its end, s.
        size: of each of these gauges, SI; of a drift by year.
        sd: standard deviation of each.
        odds: probability that it is of this kind, and not a drift in place of a step or a step in
            place of a drift.
        surprise: of the innovations since.
        lasts: the last reading still shows it.
    """

    kind: str
    gauges: tuple[int, ...]
    shown: float
    since: float
    earliest: float
    latest: float
    size: tuple[float, ...]
    sd: tuple[float, ...]
    odds: float
    surprise: float
    lasts: bool

    def explains(self, other: Change) -> bool:
        """Whether that of a gauge may be a part of this change of several."""
        near = WINDOW / _MOST_BEGINNINGS * _NEAR
        together = other.earliest - near <= self.latest and self.earliest <= other.latest + near
        return together and set(other.gauges) <= set(self.gauges)


class Detector:
    """Looks for changes in the readings of several gauges over a period.

    Args:
        filters: one for each gauge, over its readings of the period.
        together: of another detector of these gauges, (2 a, n, n) the correlation of z of steps
            and drifts of each age; None for independent gauges.
    """

    def __init__(self, filters: Sequence[Filter], together: Floats | None = None) -> None:
        self.filters = filters
        n, classes = len(filters), len(KINDS) * (len(_AGES) + 1)
        self.together = np.tile(np.eye(n), (classes, 1, 1)) if together is None else together
        self._roots = np.linalg.cholesky(self.together)
        days = np.unique(np.concatenate([f.times for f in filters]) // DAY) * DAY + DAY
        self.dates = _some(days, _MOST_DATES)
        step = WINDOW / _MOST_BEGINNINGS
        first = days[0] - DAY
        later = np.arange(first, days[-1], step)
        self.begun: Floats = later if len(later) > 1 else np.array([first])
        self._patterns = [self._pattern(f) for f in filters]
        self._until = [np.searchsorted(f.times, self.dates) for f in filters]
        old = self.dates[:, None] - self.begun[None, :]
        self._recent = np.tile(old <= WINDOW + step, len(KINDS))
        age = np.searchsorted(_AGES, old)
        # (k, 2 c) which correlation each date and change has
        self._class = np.hstack([age + kind * (len(_AGES) + 1) for kind in range(len(KINDS))])
        # (k, 2 c) sums of g^2; 0 where no reading is since
        self._weight = [
            _squares(g, ends) for g, ends in zip(self._patterns, self._until, strict=True)
        ]

    def _pattern(self, f: Filter) -> Floats:
        """(m, 2 c) what steps and drifts of size 1 that begin at each time do to innovations."""
        since = f.times[:, None] - self.begun[None, :]
        changed = since > 0.0
        return f.effects(np.hstack([changed.astype(float), np.where(changed, since / YEAR, 0.0)]))

    def z(self, innovations: Sequence[Floats]) -> Floats:
        """(n, k, 2 c, s) of each gauge, date and change; 0 where no reading can show it.

        Args:
            innovations: of each gauge, (m, s).
        """
        parts = []
        for g, ends, weight, e in zip(
            self._patterns, self._until, self._weight, innovations, strict=True
        ):
            first = np.concatenate([[0], ends[:-1]])
            sums = [g[i:j].T @ e[i:j] for i, j in zip(first, ends, strict=True)]
            seen = weight > 0.0
            root = np.sqrt(np.where(seen, weight, 1.0))
            parts.append(np.where(seen[..., None], np.cumsum(sums, axis=0), 0.0) / root[..., None])
        return np.stack(parts)

    def changes(self, e: Sequence[Floats], threshold: float) -> list[Change]:
        """What has changed in the period: of single gauges, or of several at once.

        Args:
            e: (m,) innovations of each gauge.
            threshold: the surprise from which on it is no chance.
        """
        columns = self.z([own[:, None] for own in e])
        single, together = (surprise[..., 0] for surprise in self.surprises(columns))
        last = [surprise[..., 0, 0] for surprise in self._surprises(columns[:, -1:])]
        z = columns[..., 0]
        alone = [
            self._change(e, z[i : i + 1], z[i] ** 2, single[i], float(last[0][i]), threshold, [i])
            for i in range(len(z))
            if (single[i] > threshold).any()
        ]
        if len(z) < 2 or not (together > threshold).any():
            return alone
        squares = (self._white(z) ** 2).sum(axis=0)
        several = self._change(e, z, squares, together, float(last[1]), threshold, range(len(z)))
        return [several, *(one for one in alone if not several.explains(one))]

    def _change(
        self,
        e: Sequence[Floats],
        z: Floats,
        squares: Floats,
        surprise: Floats,
        last: float,
        threshold: float,
        gauges: Sequence[int],
    ) -> Change:
        """The change of some gauges that the last date shows, or else the date that shows it most.

        A change that is neither a step nor a drift leaves innovations too large: what tells its
        date and size then counts as much less.

        Args:
            e: (m,) innovations of every gauge.
            z: (n, k, 2 c) of these gauges.
            squares: (k, 2 c) in favour of each change, of these gauges together.
            surprise: (k,) of them, at each date, of what began in the window.
            last: at the last date, of whatever began in the period.
            threshold: the surprise from which on it is no chance.
            gauges: their numbers.
        """
        lasts = bool(last > threshold)
        at = len(surprise) - 1 if lasts else int(np.argmax(surprise))
        best = int(np.argmax(squares[at]))
        kind, first = divmod(best, len(self.begun))
        same = slice(kind * len(self.begun), (kind + 1) * len(self.begun))
        showing = [i for i in range(len(gauges)) if len(gauges) == 1 or abs(z[i, at, best]) > _PART]
        own = [gauges[i] for i in showing]
        excess = self._excess([e[i] for i in own], z[showing, at, best], own, at, best)
        likelihood = np.exp(0.5 * (squares[at] - squares[at, best]) / excess)
        odds = likelihood[same] / likelihood[same].sum()
        low, high = np.searchsorted(np.cumsum(odds), [0.025, 0.975])
        sizes = []
        for i in showing:  # over all that may be its beginning
            weight = self._weight[gauges[i]][at, same]
            a = z[i, at, same] / np.sqrt(np.where(weight > 0.0, weight, 1.0))
            mean = float(odds @ a)
            each = np.divide(odds, weight, out=np.zeros_like(odds), where=weight > 0.0)
            variance = excess * each.sum() + odds @ (a - mean) ** 2
            sizes.append((mean, float(np.sqrt(variance))))
        apart = 0.5 * WINDOW / _MOST_BEGINNINGS  # beginnings between those that are tried
        return Change(
            kind=KINDS[kind],
            gauges=tuple(gauges[i] for i in showing),
            shown=float(
                self.dates[self._shown(surprise > threshold, float(self.begun[low]))] - DAY
            ),
            since=float(self.begun[first]),
            earliest=float(self.begun[low]) - apart,
            latest=float(self.begun[min(high, len(odds) - 1)]) + apart,
            size=tuple(size for size, _ in sizes),
            sd=tuple(sd for _, sd in sizes),
            odds=float(likelihood[same].sum() / likelihood.sum()),
            surprise=float(last if lasts else surprise[at]),
            lasts=lasts,
        )

    def _excess(
        self, e: Sequence[Floats], z: Floats, gauges: Sequence[int], at: int, change: int
    ) -> float:
        """Mean square of the innovations that a change leaves since it began; at least one.

        Args:
            e: (m,) innovations of some gauges.
            z: (n,) in favour of the change, of these.
            gauges: their numbers.
            at: number of the date.
            change: its number.
        """
        left = []
        for innovations, own, gauge in zip(e, z.tolist(), gauges, strict=True):
            rows = slice(0, self._until[gauge][at])
            g = self._patterns[gauge][rows, change]
            size = own / np.sqrt(max(self._weight[gauge][at, change], np.finfo(float).tiny))
            left.append((innovations[rows] - size * g)[g != 0.0] ** 2)
        return max(1.0, float(np.mean(np.concatenate(left))))

    def _shown(self, seen: Bools, earliest: float) -> int:
        """Number of the first date that shows a change which began at the earliest then."""
        after = seen & (self.dates > earliest)
        return int(np.argmax(after if after.any() else seen))

    def surprises(self, z: Floats) -> tuple[Floats, Floats]:
        """Of single gauges (n, k, s) and of all together (k, s), at each date.

        Changes count that began within the window before it.
        """
        return self._surprises(np.where(self._recent[..., None], z, 0.0))

    def _surprises(self, z: Floats) -> tuple[Floats, Floats]:
        single = _surprise(np.max(z**2, axis=2), 1)
        white = self._white(z) ** 2
        without_largest = white.sum(axis=0) - white.max(axis=0)
        return single, _surprise(np.max(without_largest, axis=1), max(len(z) - 1, 1))

    def _white(self, z: Floats) -> Floats:
        """R^(-1/2) z, of the last dates."""
        white = np.empty_like(z)
        classes = self._class[-z.shape[1] :]
        for number, root in enumerate(self._roots):
            own = classes == number
            white[:, own] = np.linalg.solve(root, z[:, own].reshape(len(z), -1)).reshape(
                z[:, own].shape
            )
        return white

    def correlated(self, innovations: Sequence[Floats]) -> Detector:
        """The detector with the correlations of simulated innovations (m, s) of each gauge."""
        n = len(self.filters)
        sums = np.zeros_like(self.together)
        for z in self._batches(innovations):
            for number in range(len(sums)):
                own = z[:, (self._class == number) & self._recent].reshape(n, -1)
                sums[number] += own @ own.T
        size = np.sqrt(np.einsum("cii->ci", sums))
        size[size == 0.0] = 1.0
        R = sums / (size[:, :, None] * size[:, None, :])
        R = _KEPT * R + (1.0 - _KEPT) * np.eye(n)
        np.einsum("cii->ci", R)[:] = 1.0
        return Detector(self.filters, R)

    def _batches(self, innovations: Sequence[Floats]) -> Iterator[Floats]:
        for first in range(0, innovations[0].shape[1], _AT_A_TIME):
            yield self.z([own[:, first : first + _AT_A_TIME] for own in innovations])

    def largest(self, innovations: Sequence[Floats]) -> Floats:
        """(s,) the largest surprise of periods with innovations (m, s) of each gauge."""
        most = []
        for z in self._batches(innovations):
            single, together = self.surprises(z)
            several = together.max(axis=0) if len(z) > 1 else 0.0
            most.append(np.maximum(single.max(axis=(0, 1)), several))
        return np.concatenate(most)

    def first_seen(self, innovations: Sequence[Floats], threshold: float) -> Floats:
        """(s,) time from the beginning of the period to the first date that shows a change, s.

        Infinite where none does.

        Args:
            innovations: (m, s) of each gauge.
            threshold: the surprise from which on it is no chance.
        """
        delays = []
        since = np.append(self.dates - self.begun[0], np.inf)
        for z in self._batches(innovations):
            single, together = self.surprises(z)
            seen = (single > threshold).any(axis=0)
            if len(z) > 1:
                seen |= together > threshold
            never = np.ones((1, seen.shape[1]), dtype=np.bool_)
            delays.append(since[np.argmax(np.vstack([seen, never]), axis=0)])
        return np.concatenate(delays)

    @property
    def length(self) -> float:
        """Of the period, s."""
        return float(self.dates[-1] - self.begun[0])

    def threshold(self, between: float, innovations: Sequence[Floats]) -> float:
        """The surprise that chance passes once in a stated time.

        Args:
            between: two false alarms, s, on the average.
            innovations: (m, s) simulated, of each gauge, in which nothing changes.
        """
        without = np.exp(-self.length / between)
        return float(np.quantile(self.largest(innovations), without))


def _squares(g: Floats, ends: Ints) -> Floats:
    """(k, c) sums of the squares of the first rows of g (m, c), up to some ends (k,)."""
    sums = np.vstack([np.zeros(g.shape[1]), np.cumsum(g**2, axis=0)])
    return np.asarray(sums[ends])


def _surprise(chi_squared: Floats, freedom: int) -> Floats:
    chance = np.maximum(chdtrc(freedom, chi_squared), _LEAST_CHANCE)
    return np.asarray(-np.log10(chance))


def _some(values: Floats, most: int) -> Floats:
    """At most so many of some values, the last among them."""
    if len(values) <= most:
        return values
    return np.asarray(values[np.unique(np.linspace(0, len(values) - 1, most).round().astype(int))])
