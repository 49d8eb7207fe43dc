"""Changes of gauges and of the structure, from innovations (theory 16.4).

A step or a drift of one gauge that begins at a time t0 adds a known pattern g to its innovations,
in an unknown size a. The generalized likelihood ratio for it is

    z^2 ,    z = sum g e / sqrt(sum g^2) ,      a = sum g e / sum g^2 ,    sd(a) = 1 / sqrt(sum g^2)

over the innovations since t0; z is standard normal where nothing has changed. At each date the
largest over all t0 of a window counts. For all n gauges together, whose z of a change have the
correlation R, a change of any pattern over the gauges at one t0 has

    z^T R^-1 z less its largest term, at most chi-squared with n - 1 degrees of freedom,

so that one gauge that fails is no change of the structure. A parameter that changes by a adds a g
to all gauges at once, with w = sqrt(sum g^2) of each

    a = w^T R^-1 z / w^T R^-1 w ,      sd(a) = 1 / sqrt(w^T R^-1 w) .

R follows from simulated innovations in which nothing changes, for changes of each kind and of some
age: sums over longer times are more alike.

All are compared by their surprise, -log10 of the probability that chance does as much at one date
and one t0. The threshold of it follows from the same simulations: it is passed, by any gauge, by
any parameter or by all together, once in a stated time on the average.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from copy import copy
from dataclasses import dataclass

import numpy as np
from scipy.special import chdtrc, logsumexp, ndtr, softmax

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

_AT_A_TIME, _KEPT_AT_ONCE = 20, 20_000_000
"""Simulated periods of which z is kept at once, and numbers of them at most."""

_HALVED = 60
"""Times that an interval is halved in which a quantile lies."""

_AS_WELL = 0.05
"""Probability of another parameter from which on it is named."""

_ALL, _LAST = slice(None), slice(-1, None)
"""Dates."""

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


@dataclass(frozen=True)
class ParameterChange:
    """A change of a parameter, which all gauges share.

    Args:
        parameters: numbers of those that it may be, the most probable one first.
        odds: probability of each; what is left is that of changes of gauges.
        size: of each, with the lower and the upper end of its 95 % interval.
        gauges: numbers of the gauges that show it.
        shown: from when on it was seen, s.
        since: when it most likely began, s.
        earliest: beginning of the 95 % interval of that, s.
        latest: its end, s.
        surprise: of the innovations since.
        lasts: the last reading still shows it.
        at: number of the date that shows it.
    """

    parameters: tuple[int, ...]
    odds: tuple[float, ...]
    size: tuple[tuple[float, float, float], ...]
    gauges: tuple[int, ...]
    shown: float
    since: float
    earliest: float
    latest: float
    surprise: float
    lasts: bool
    at: int


class Detector:
    """Looks for changes in the readings of several gauges over a period.

    Args:
        filters: one for each gauge, over its readings of the period.
        together: of another detector of these gauges, (kinds * a, n, n) the correlation of z of
            steps, drifts and parameters of each age; None for independent gauges.
        parameters: what each of h parameters that rises by 1 does to the readings of each gauge,
            (m, h), SI; empty for none.
    """

    def __init__(
        self,
        filters: Sequence[Filter],
        together: Floats | None = None,
        parameters: Sequence[Floats] = (),
    ) -> None:
        self.filters, self._parameters = filters, parameters
        self._number = parameters[0].shape[1] if parameters else 0
        kinds = len(KINDS) + self._number
        n, classes = len(filters), kinds * (len(_AGES) + 1)
        self.together = np.tile(np.eye(n), (classes, 1, 1)) if together is None else together
        days = np.unique(np.concatenate([f.times for f in filters]) // DAY) * DAY + DAY
        self.dates = _some(days, _MOST_DATES)
        step = WINDOW / _MOST_BEGINNINGS
        first = days[0] - DAY
        later = np.arange(first, days[-1], step)
        self.begun: Floats = later if len(later) > 1 else np.array([first])
        self._patterns = [self._pattern(i) for i in range(n)]
        self._until = [np.searchsorted(f.times, self.dates) for f in filters]
        old = self.dates[:, None] - self.begun[None, :]
        self._recent = np.tile(old <= WINDOW + step, kinds)
        age = np.searchsorted(_AGES, old)
        # (k, kinds * c) which correlation each date and change has; -1 before it begins
        self._class = np.hstack(
            [np.where(old > 0.0, age + kind * (len(_AGES) + 1), -1) for kind in range(kinds)]
        )
        # (k, kinds * c) sums of g^2; 0 where no reading is since
        self._weight = [
            _squares(g, ends) for g, ends in zip(self._patterns, self._until, strict=True)
        ]
        self._of_gauges = len(KINDS) * len(self.begun)
        self._weigh()

    def _weigh(self) -> None:
        """Prepare what follows from the correlations."""
        self._whiten = np.linalg.inv(np.linalg.cholesky(self.together))  # R^(-1/2) of each class
        self._shares = np.zeros((len(self.filters), len(self.dates), 0))
        if self._parameters:
            w = np.sqrt(np.stack([own[:, self._of_gauges :] for own in self._weight]))
            self._shares = self._white(w[..., None], first=self._of_gauges)[..., 0]
        self._precision = (self._shares**2).sum(axis=0)  # 1 / sd(a)^2

    def _pattern(self, gauge: int) -> Floats:
        """(m, kinds * c) what changes of size 1 that begin at each time do to innovations."""
        f = self.filters[gauge]
        since = f.times[:, None] - self.begun[None, :]
        changed = since > 0.0
        parts = [changed.astype(float), np.where(changed, since / YEAR, 0.0)]
        if self._parameters:
            parts += [changed * own[:, None] for own in self._parameters[gauge].T]
        return f.effects(np.hstack(parts))

    def z(self, innovations: Sequence[Floats]) -> Floats:
        """(n, k, kinds * c, s) of each gauge, date and change; 0 where no reading can show it.

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
        single, together, _ = (part[..., 0] for part in self._surprises(self._in_window(columns)))
        last = [part[..., 0, 0] for part in self._surprises(columns[:, -1:], _LAST)]
        z = columns[:, :, : self._of_gauges, 0]
        alone = [
            self._change(e, z[i : i + 1], z[i] ** 2, single[i], float(last[0][i]), threshold, [i])
            for i in range(len(z))
            if (single[i] > threshold).any()
        ]
        if len(z) < 2 or not (together > threshold).any():
            return alone
        squares = (self._white(z[..., None])[..., 0] ** 2).sum(axis=0)
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
            z: (n, k, 2 c) of these gauges, for steps and drifts.
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
        earliest, latest = self._interval(odds)
        sizes = []
        for i in showing:  # over all that may be its beginning
            weight = self._weight[gauges[i]][at, same]
            a = z[i, at, same] / np.sqrt(np.where(weight > 0.0, weight, 1.0))
            mean = float(odds @ a)
            each = np.divide(odds, weight, out=np.zeros_like(odds), where=weight > 0.0)
            variance = excess * each.sum() + odds @ (a - mean) ** 2
            sizes.append((mean, float(np.sqrt(variance))))
        return Change(
            kind=KINDS[kind],
            gauges=tuple(gauges[i] for i in showing),
            shown=float(self.dates[self._shown(surprise > threshold, earliest)] - DAY),
            since=float(self.begun[first]),
            earliest=earliest,
            latest=latest,
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

    def _interval(self, odds: Floats) -> tuple[float, float]:
        """95 % interval, s, of a beginning with probabilities (c,)."""
        low, high = np.searchsorted(np.cumsum(odds), [0.025, 0.975])
        apart = 0.5 * WINDOW / _MOST_BEGINNINGS  # beginnings between those that are tried
        latest = float(self.begun[min(high, len(odds) - 1)])
        return float(self.begun[low]) - apart, latest + apart

    def _shown(self, seen: Bools, earliest: float) -> int:
        """Number of the first date that shows a change which began at the earliest then."""
        after = seen & (self.dates > earliest)
        return int(np.argmax(after if after.any() else seen))

    def surprise(self, z: Floats) -> Floats:
        """(k, s) the largest of any change at each date, of those that began in its window."""
        single, together, parameters = self._squares(self._in_window(z))
        alone = np.maximum(single.max(axis=0), parameters.max(axis=0, initial=0.0))
        return np.maximum(_surprise(alone, 1), _surprise(together, max(len(z) - 1, 1)))

    def _in_window(self, z: Floats) -> Floats:
        return np.where(self._recent[..., None], z, 0.0)

    def _surprises(self, z: Floats, at: slice = _ALL) -> tuple[Floats, Floats, Floats]:
        """Of single gauges (n, k, s), of all together (k, s), and of parameters (h, k, s).

        Args:
            z: (n, k, kinds * c, s).
            at: the k dates.
        """
        single, together, parameters = self._squares(z, at)
        several = _surprise(together, max(len(z) - 1, 1))
        return _surprise(single, 1), several, _surprise(parameters, 1)

    def _squares(self, z: Floats, at: slice = _ALL) -> tuple[Floats, Floats, Floats]:
        """The same in chi-squared: of together n - 1, of the others one degree of freedom."""
        single = np.max(z[:, :, : self._of_gauges] ** 2, axis=2)
        white = self._white(z, at)
        squares = white[:, :, : self._of_gauges] ** 2
        together = np.max(squares.sum(axis=0) - squares.max(axis=0), axis=1)
        shared = self._shared(white, at) ** 2
        k, _, s = shared.shape
        by_parameter = shared.reshape(k, self._number, len(self.begun), s).max(axis=2)
        return single, together, by_parameter.swapaxes(0, 1)

    def _white(self, z: Floats, at: slice = _ALL, first: int = 0) -> Floats:
        """R^(-1/2) z, at some dates, of the changes from a first number on."""
        white = np.zeros_like(z)
        classes = self._class[at, first : first + z.shape[2]]
        for number in np.unique(classes[classes >= 0]):
            own = classes == number
            chosen = z[:, own]
            white[:, own] = (self._whiten[number] @ chosen.reshape(len(z), -1)).reshape(
                chosen.shape
            )
        return white

    def _shared(self, white: Floats, at: slice = _ALL) -> Floats:
        """(k, h c, s) z of changes of parameters, from R^(-1/2) z of all changes of the gauges."""
        sums = np.einsum("nkc,nkcs->kcs", self._shares[:, at], white[:, :, self._of_gauges :])
        precision = self._precision[at, :, None]
        return np.asarray(sums / np.sqrt(np.where(precision > 0.0, precision, 1.0)))

    def parameter_change(self, e: Sequence[Floats], threshold: float) -> ParameterChange | None:
        """The change of a parameter that explains the period better than those of gauges do.

        All that pass the threshold are judged by their likelihoods over all beginnings; a change of
        any pattern over the gauges pays for its sizes as in the criterion of Schwarz. A gauge that
        explains it better is taken out, and what is left is judged again.

        Args:
            e: (m,) innovations of each gauge.
            threshold: the surprise from which on it is no chance.
        """
        left, n = list(e), len(self.filters)
        for _ in range(n if self._number else 0):
            columns = self.z([own[:, None] for own in left])
            passing = self._surprises(self._in_window(columns))
            every = np.vstack([passing[0], passing[1][None], passing[2]])[..., 0]
            surprise = every[n + 1 :].max(axis=0, initial=0.0)
            if not (surprise > threshold).any():
                return None
            last = self._surprises(columns[:, -1:], _LAST)
            lasts = max(float(part.max()) for part in last) > threshold
            at = len(self.dates) - 1 if lasts else int(np.argmax(every.max(axis=0)))
            z = columns[:, at, :, 0]
            likely = self._twice_log_likelihoods(z, at)
            chance = ~(every[: n + 1] > threshold).any(axis=1)
            likely[: len(KINDS) * (n + 1)][np.repeat(chance, len(KINDS))] = -np.inf
            best, begun = divmod(int(np.argmax(likely)), len(self.begun))
            if best >= len(KINDS) * (n + 1):
                return self._likeliest_parameter(
                    left, z, likely, at, surprise, float(last[2].max()), threshold
                )
            gauge, kind = divmod(best, len(KINDS))
            if gauge == n:
                return None
            change = kind * len(self.begun) + begun
            size = z[gauge, change] / np.sqrt(self._weight[gauge][at, change])
            left[gauge] = left[gauge] - size * self._patterns[gauge][:, change]
        return None

    def _twice_log_likelihoods(self, z: Floats, at: int) -> Floats:
        """(2 n + 2 + h, c) in favour of steps and drifts of each gauge, of all, and of parameters.

        Args:
            z: (n, kinds * c) of each gauge at a date.
            at: number of the date.
        """
        n, c = len(z), len(self.begun)
        date = slice(at, at + 1)
        white = self._white(z[:, None, :, None], date)
        shared = self._shared(white, date)[0, :, 0] ** 2
        white = white[:, 0, : self._of_gauges, 0]
        alone = np.zeros((n, self._of_gauges))
        for change, number in enumerate(self._class[at, : self._of_gauges]):
            root = self._whiten[number]
            alone[:, change] = (root.T @ white[:, change]) ** 2 / (root**2).sum(axis=0)
        alone[[own[at, : self._of_gauges] == 0.0 for own in self._weight]] = 0.0
        several = (white**2).sum(axis=0).reshape(len(KINDS), c)
        read = sum(
            np.maximum(ends[at] - np.searchsorted(f.times, self.begun, side="right"), 0)
            for f, ends in zip(self.filters, self._until, strict=True)
        )
        several -= (n - 1) * np.log(np.maximum(read / n, 1.0))
        likely = np.vstack([alone.reshape(-1, c), several, shared.reshape(-1, c)])
        likely[:, read == 0] = -np.inf
        return likely

    def _likeliest_parameter(
        self,
        e: Sequence[Floats],
        z: Floats,
        likely: Floats,
        at: int,
        surprise: Floats,
        last: float,
        threshold: float,
    ) -> ParameterChange:
        """The change of the likeliest parameter, and of others that it may be as well.

        Args:
            e: (m,) innovations of each gauge.
            z: (n, kinds * c) of each at a date.
            likely: see `_twice_log_likelihoods`; of a parameter at most.
            at: number of the date.
            surprise: (k,) of parameters, at each date, of what began in the window.
            last: at the last date, of whatever began in the period.
            threshold: the surprise from which on it is no chance.
        """
        n, c = len(self.filters), len(self.begun)
        date, before = slice(at, at + 1), len(likely) - self._number
        best, first = divmod(int(np.argmax(likely)), c)
        column = len(KINDS) * c + (best - before) * c + first
        precision = np.where(self._precision[at] > 0.0, self._precision[at], np.inf)
        shared = self._shared(self._white(z[:, None, :, None], date), date)[0, :, 0]
        size = (shared / np.sqrt(precision)).reshape(-1, c)
        variance = (1.0 / precision).reshape(-1, c)
        root = np.sqrt([own[at, column] for own in self._weight])
        alone = size[best - before, first] * root
        excess = self._excess(e, alone, range(n), at, column)
        evidence = logsumexp(0.5 * likely / excess, axis=1)
        probability = np.exp(evidence - logsumexp(evidence))[before:]
        odds = softmax(0.5 * likely[before:] / excess, axis=1)
        order = [
            int(h) for h in np.argsort(-probability)
            if h == best - before or probability[h] > _AS_WELL
        ]  # fmt: skip
        order.sort(key=lambda h: h != best - before)
        earliest, latest = self._interval(odds[best - before])
        lasts = last > threshold
        return ParameterChange(
            parameters=tuple(order),
            odds=tuple(probability[order].tolist()),
            size=tuple(_quantiles(odds[h], size[h], np.sqrt(excess * variance[h])) for h in order),
            gauges=tuple(np.flatnonzero(np.abs(alone) > _PART).tolist()),
            shown=float(self.dates[self._shown(surprise > threshold, earliest)] - DAY),
            since=float(self.begun[first]),
            earliest=earliest,
            latest=latest,
            surprise=last if lasts else float(surprise[at]),
            lasts=lasts,
            at=at,
        )

    def seen_of(
        self, change: ParameterChange, parameter: int, motions: Sequence[Floats]
    ) -> tuple[float, list[Floats]]:
        """The size that motions since a change would have, and what they do to innovations (m,).

        Args:
            change: when it began, and the date that shows it.
            parameter: number of the one that is taken to have changed.
            motions: (m,) of the readings of each gauge, SI.
        """
        begun = int(np.searchsorted(self.begun, change.since))
        column = self._of_gauges + parameter * len(self.begun) + begun
        effects, z = [], []
        for i, (f, motion) in enumerate(zip(self.filters, motions, strict=True)):
            since = np.where(f.times > change.since, motion, 0.0)
            effects.append(f.effects(since[:, None])[:, 0])
            rows, weight = slice(0, self._until[i][change.at]), self._weight[i][change.at, column]
            sums = float(self._patterns[i][rows, column] @ effects[i][rows])
            z.append(sums / np.sqrt(weight) if weight > 0.0 else 0.0)
        white = self._whiten[self._class[change.at, column]] @ z
        shares = self._shares[:, change.at, column - self._of_gauges]
        return float(shares @ white / (shares @ shares)), effects

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
        other = copy(self)
        other.together = R
        other._weigh()
        return other

    def _batches(self, innovations: Sequence[Floats]) -> Iterator[Floats]:
        numbers = len(self.filters) * self._class.size
        together = max(1, min(_AT_A_TIME, _KEPT_AT_ONCE // numbers))
        for first in range(0, innovations[0].shape[1], together):
            yield self.z([own[:, first : first + together] for own in innovations])

    def largest(self, innovations: Sequence[Floats]) -> Floats:
        """(s,) the largest surprise of periods with innovations (m, s) of each gauge."""
        return np.concatenate([self.surprise(z).max(axis=0) for z in self._batches(innovations)])

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
            seen = self.surprise(z) > threshold
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


def _quantiles(odds: Floats, mean: Floats, sd: Floats) -> tuple[float, float, float]:
    """Median, and ends of the 95 % interval, of a mixture of normal distributions (c,)."""
    known = odds > 0.0
    odds, mean, sd = odds[known], mean[known], sd[known]
    parts = np.array([0.5, 0.025, 0.975])
    low, high = (np.full(3, f(mean + side * 10.0 * sd)) for f, side in ((np.min, -1), (np.max, 1)))
    for _ in range(_HALVED):
        middle = 0.5 * (low + high)
        below = ndtr((middle[:, None] - mean) / sd) @ odds < parts
        low, high = np.where(below, middle, low), np.where(below, high, middle)
    median, lower, upper = middle.tolist()
    return median, lower, upper


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
