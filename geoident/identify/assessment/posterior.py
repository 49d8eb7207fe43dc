"""The normal posterior cut at the bounds, and what linear functions of it are (theory 6.3).

With the model linearised at the estimate, the posterior of the scaled parameters x is normal within
the bounds and zero outside. Written from the estimate, dx = x - x^,

    dx = mean + F xi ,   xi ~ N(0, 1) independent ,   lower <= dx <= upper .

Only bounds that the normal reaches matter. Let F_R be the rows of their parameters and
F_R^T = Q U its QR decomposition: of xi only the components y = Q^T xi are cut, by the
triangular system U^T y, one after the other (Genz 1992): given y_1 .. y_(j-1), y_j lies between
two numbers, drawn through its distribution function, and the product of the probabilities of the
intervals is the weight of the draw. What F xi has beside is normal as ever. So the cut normal is a
mixture of K normals of one covariance,

    dx = shift_k + G xi   with the weight w_k ,   shift_k = mean + F Q y_k ,   G = F (1 - Q Q^T) ,

and so is every linear function of it, with or without a normal error of its own. The points y_k are
those of a lattice, not random: the same input gives the same numbers. With one bound they are a
quadrature by midpoints; with several an interval holds 95 +- 1 % and is at most 3 % too wide.

The 95 % interval is the shortest: symmetric where no bound is near, one-sided, from the bound on,
where the density is highest on it.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.special import log_ndtr, ndtr, ndtri_exp

from geoident.identify.primes import first_primes
from geoident.model.arrays import Floats, Ints
from geoident.model.results.bands import NORMAL_95

REACHED = 3.0
"""A bound farther than this, in standard deviations, is not reached: one in 700."""

POINTS = 512
"""Of the lattice for one bound; four times as many for several."""

_MOST_POINTS = 65536
_FEW = 200
"""Effective number of points below which more are taken."""

_BEYOND = 1e-8
"""Probability of the tails that are left out."""

_COVERED = 0.95
_GRID = 65
_MOST_STEPS = 180
"""Towards a quantile: three times as many as would halve what lies between two ends to _SAME."""

_SAME = 1e-13
"""Part of the ends between which a quantile is sought: what lies closer together is the same."""

_NEARLY = 1e6
"""Times that: a shorter step goes a little beyond the quantile, so that the ends meet about it."""

_PEAK = 1.0 / np.sqrt(2.0 * np.pi)

_COARSE = 0.1
"""Probability between two points of a grid from which on it is halved there: of normals that are
far apart, or of very different widths."""

_ROUNDS, _SPLIT = 30, 12
"""Times that so many cells of the most probability are halved there."""
_GRAIN = 0.02
"""Distance between points, in standard deviations, over which they are smeared."""
_NO_TAIL = 2.5e-3
"""Probability beyond the end of an interval that is none: it ends with what is possible, ..."""

_CLOSE = 0.05
"""... if it is as close to that, in widths of the interval."""
_TOGETHER = 2_000_000
"""Entries of a table that is made at once (16 MB)."""


@dataclass(frozen=True)
class NormalMixture:
    """l quantities, each of which is a mixture of K normals with common weights.

    Args:
        mean: (l, K).
        sd: (l, K) or (l, 1).
        weight: (K,) with the sum one.
        grain: (l, K) over which normals are smeared besides where the ends of intervals are sought,
            since they stand for all between them; None for a part of how far they are apart.
    """

    mean: Floats
    sd: Floats
    weight: Floats
    grain: Floats | None = None

    @classmethod
    def joined(cls, parts: Sequence[tuple[float, NormalMixture]]) -> NormalMixture:
        """One of several mixtures of the same quantities, each with a probability."""
        whole = [(p, m.mean, np.broadcast_to(m.sd, m.mean.shape), m.weight) for p, m in parts]
        return cls(
            np.concatenate([mean for _, mean, _, _ in whole], axis=1),
            np.concatenate([sd for _, _, sd, _ in whole], axis=1),
            np.concatenate([p * weight for p, _, _, weight in whole]),
            np.concatenate([np.broadcast_to(m._grain(), m.mean.shape) for _, m in parts], axis=1),
        )

    def _grain(self) -> Floats:
        """(l, K) or (l, 1) over which the normals are smeared."""
        if self.grain is not None:
            return self.grain
        squares = self.mean**2 @ self.weight - (self.mean @ self.weight) ** 2
        return np.asarray(_GRAIN * np.sqrt(np.maximum(squares, 0.0))[:, None])

    def _of(self, rows: slice | Ints) -> NormalMixture:
        """Some of the quantities."""
        grain = None if self.grain is None else self.grain[rows]
        return NormalMixture(self.mean[rows], self.sd[rows], self.weight, grain)

    @property
    def centre(self) -> Floats:
        """Expected values (l,)."""
        return np.asarray(self.mean @ self.weight)

    @property
    def rms(self) -> Floats:
        """Root of the mean square (l,): the deviation from zero, which stands for the estimate."""
        return np.asarray(np.sqrt((self.mean**2 + self.sd**2) @ self.weight))

    def below(self, t: Floats) -> Floats:
        """Probability (l, m) of being below t (l, m)."""
        sd = np.broadcast_to(np.maximum(self.sd, 1e-300), self.mean.shape)
        with np.errstate(over="ignore"):
            z = (t[:, :, None] - self.mean[:, None, :]) / sd[:, None, :]
        return np.asarray(ndtr(z) @ self.weight)

    def quantile(self, p: Floats, low: Floats, high: Floats) -> Floats:
        """Where the probability of being below is p (l,); an end where it is so beyond that.

        Newton's method between ends that close in on it. Normals of one mixture may differ by
        orders of magnitude in size: a step that leaves the ends, or is not half of the last one,
        halves what is between them instead. It ends where the ends meet, not with a small step:
        beside a very narrow normal any step is small.

        Args:
            p: (l,) probabilities.
            low: (l,) ends from which on it is sought.
            high: (l,) ends up to which it is sought.
        """
        sd, same = np.maximum(self.sd, 1e-300), _SAME * np.maximum(np.abs(low), np.abs(high))
        low = np.where(self.below(high[:, None])[:, 0] <= p, high, low)
        high = np.where(self.below(low[:, None])[:, 0] >= p, low, high)
        at, change = 0.5 * (low + high), high - low
        done = np.zeros(len(p), dtype=bool)
        for _ in range(_MOST_STEPS):
            with np.errstate(over="ignore", divide="ignore", invalid="ignore"):
                z = (at[:, None] - self.mean) / sd
                above = ndtr(z) @ self.weight - p
                to = at - above / (_PEAK * ((np.exp(-0.5 * z**2) / sd) @ self.weight))
            low, high = np.where(above > 0.0, low, at), np.where(above > 0.0, at, high)
            done |= (high - low <= 4.0 * same) | (above == 0.0)
            if done.all():
                break
            step = np.abs(to - at)
            newton = (low <= to) & (to <= high) & (step <= np.maximum(0.5 * change, same))
            change = np.where(newton, step, 0.5 * (high - low))
            beyond = np.clip(to - np.sign(above) * same, low, high)
            to = np.where(change <= _NEARLY * same, beyond, to)
            to = np.where(newton, to, 0.5 * (low + high))
            at = np.where(done, at, to)  # whatever other quantities still need
        return at

    def interval(
        self, lower: Floats | None = None, upper: Floats | None = None
    ) -> tuple[Floats, Floats]:
        """Ends (l,), (l,) of the shortest interval that holds 95 %.

        Args:
            lower: (l,) below which there is nothing, -inf for no such limit; None for none at all.
            upper: (l,) above which there is nothing.
        """
        low, high = np.empty(len(self.mean)), np.empty(len(self.mean))
        size = max(1, _TOGETHER // (_GRID * self.mean.shape[1]))
        for first in range(0, len(self.mean), size):
            rows = slice(first, first + size)
            part = self._of(rows)
            low[rows], high[rows] = part._interval()
        if lower is not None:
            close = low - lower < _CLOSE * (high - low)
            open_end = close & (self.below(low[:, None])[:, 0] <= _NO_TAIL)
            low = np.where(open_end, lower, np.maximum(low, lower))
        if upper is not None:
            close = upper - high < _CLOSE * (high - low)
            open_end = close & (self.below(high[:, None])[:, 0] >= 1.0 - _NO_TAIL)
            high = np.where(open_end, upper, np.minimum(high, upper))
        return low, high

    def _interval(self) -> tuple[Floats, Floats]:
        centre = self.mean @ self.weight
        own = np.sqrt(self.sd**2 @ (self.weight if self.sd.shape[1] > 1 else np.ones(1)))
        low, high = centre - NORMAL_95 * own, centre + NORMAL_95 * own
        spread = np.abs(self.mean - centre[:, None]).max(axis=1)
        uneven = np.abs(self.sd - own[:, None]).max(axis=1)
        mixed = np.flatnonzero(np.maximum(spread, uneven) > 1e-9 * own)
        if len(mixed):
            part = self._of(mixed)
            low[mixed], high[mixed] = part._shortest()
        return low, high

    def _shortest(self) -> tuple[Floats, Floats]:
        """The same where a normal distribution will not do."""
        weighty = self.weight > 1e-12
        mean, weight = self.mean[:, weighty], self.weight[weighty] / self.weight[weighty].sum()
        smeared = np.hypot(self.sd, self._grain())
        sd = np.broadcast_to(smeared, self.mean.shape)[:, weighty]
        part = NormalMixture(mean, sd, weight)
        grid = part._grid()
        F = part.below(grid)
        low, high = part._between(grid, F)
        coarse = np.flatnonzero(np.diff(F, axis=1).max(axis=1) > _COARSE)
        if len(coarse):
            those = part._of(coarse)
            low[coarse], high[coarse] = those._between(*those._halved(grid[coarse], F[coarse]))
        return low, high

    def _between(self, grid: Floats, F: Floats) -> tuple[Floats, Floats]:
        """Ends of the shortest interval, of the probabilities F (l, m) below a grid (l, m)."""
        tails = np.linspace(0.0, 1.0 - _COVERED, 51)
        width = np.empty((len(grid), len(tails)))
        for i in range(len(grid)):
            low = np.interp(tails, F[i], grid[i])
            width[i] = np.interp(tails + _COVERED, F[i], grid[i]) - low
        tail = tails[np.argmin(width, axis=1)]
        row, ends = np.arange(len(grid)), []
        for p in (tail, tail + _COVERED):
            cell = np.clip(np.sum(p[:, None] > F, axis=1), 1, grid.shape[1] - 1)
            ends.append(self.quantile(p, grid[row, cell - 1], grid[row, cell]))
        return ends[0], ends[1]

    def _halved(self, grid: Floats, F: Floats) -> tuple[Floats, Floats]:
        """A grid (l, m) and F on it, dense where the probability is."""
        for _ in range(_ROUNDS):
            most = np.argpartition(-np.diff(F, axis=1), _SPLIT, axis=1)[:, :_SPLIT]
            low, high = (np.take_along_axis(grid, most + k, axis=1) for k in (0, 1))
            middle = 0.5 * (low + high)
            grid = np.concatenate([grid, middle], axis=1)
            F = np.concatenate([F, self.below(middle)], axis=1)
            order = np.argsort(grid, axis=1, kind="stable")
            grid, F = (np.take_along_axis(one, order, axis=1) for one in (grid, F))
        return grid, F

    def _grid(self) -> Floats:
        """Values (l, m) from end to end, dense where the means of the normals begin and end."""
        first = (self.mean - 5.0 * self.sd).min(axis=1)
        last = (self.mean + 5.0 * self.sd).max(axis=1)
        even = first[:, None] + np.linspace(0.0, 1.0, _GRID) * (last - first)[:, None]
        order = np.argsort(self.mean, axis=1)
        mean = np.take_along_axis(self.mean, order, axis=1)
        sd = np.take_along_axis(self.sd, order, axis=1)
        F = np.cumsum(self.weight[order], axis=1)
        ends = []
        for tail in (*np.linspace(0.0, 0.06, 11), *np.linspace(0.94, 1.0, 11)):
            k = np.minimum(np.sum(tail > F, axis=1), F.shape[1] - 1)[:, None]
            ends.append(np.take_along_axis(mean, k, axis=1))
        little = np.take_along_axis(sd, np.zeros_like(order[:, :1]), axis=1)
        spaced = little * np.array([-3.0, -2.0, -1.0, 1.0, 2.0, 3.0])
        grid = np.concatenate([even, *ends, ends[0] + spaced, ends[-1] + spaced], axis=1)
        return np.sort(grid, axis=1)


@dataclass(frozen=True)
class Posterior:
    """The cut normal of n scaled parameters as a mixture of normals of one covariance.

    Args:
        shift: (n, K) means, from the estimate.
        weight: (K,) with the sum one.
        factor: (n, q) G: each normal has the covariance G G^T.
    """

    shift: Floats
    weight: Floats
    factor: Floats

    @property
    def covariance(self) -> Floats:
        """Mean squares and products of the deviations from the estimate, (n, n)."""
        return np.asarray(self.factor @ self.factor.T + (self.shift * self.weight) @ self.shift.T)

    def of(self, rows: Floats, sd: Floats) -> NormalMixture:
        """Linear functions of the deviations from the estimate, each with an error of its own.

        Args:
            rows: (l, n) their coefficients.
            sd: (l,) standard deviation of the error; zero for none.
        """
        own = np.sqrt(np.sum((rows @ self.factor) ** 2, axis=1) + sd**2)
        return NormalMixture(rows @ self.shift, own[:, None], self.weight)

    def pick(self, order: Ints) -> Posterior:
        """The same of some parameters, by their numbers (k,), whatever the others are."""
        return replace(self, shift=self.shift[order], factor=self.factor[order])


def cut_normal(
    mean: Floats, factor: Floats, lower: Floats, upper: Floats, *, always: int | None = None
) -> Posterior:
    """A normal density that is cut at bounds.

    Args:
        mean: (n,) of the normal, from the estimate.
        factor: (n, q) F, covariance F F^T; a row of zeros for what is fixed.
        lower: (n,) lower bounds from the estimate, -inf for none.
        upper: (n,) upper bounds.
        always: number of a variable whose bounds count first, near or not.
    """
    sd = np.sqrt(np.sum(factor**2, axis=1))
    reached = (sd > 0.0) & ((mean - lower < REACHED * sd) | (upper - mean < REACHED * sd))
    if always is not None:
        reached[always] = True
    R = np.flatnonzero(reached)
    if not len(R):
        return Posterior(mean[:, None], np.ones(1), factor)
    room = ndtr((upper[R] - mean[R]) / sd[R]) - ndtr((lower[R] - mean[R]) / sd[R])
    if always is not None:
        room[always == R] = -1.0
    R = R[np.argsort(room, kind="stable")][: factor.shape[1]]  # what is cut most comes first
    Q, U = np.linalg.qr(factor[R].T)
    points = POINTS if len(R) == 1 else 4 * POINTS
    while True:
        y, weight = _lattice(U.T, lower[R] - mean[R], upper[R] - mean[R], points)
        if points >= _MOST_POINTS or 1.0 / np.sum(weight**2) >= _FEW:
            break
        points *= 4
    shift = mean[:, None] + factor @ Q @ y
    shift[R] = np.clip(shift[R], lower[R, None], upper[R, None])
    return Posterior(shift, weight, factor - factor @ Q @ Q.T)


def _lattice(L: Floats, lower: Floats, upper: Floats, points: int) -> tuple[Floats, Floats]:
    """Points y (r, K) with weights (K,) of independent normals under lower <= L y <= upper.

    Args:
        L: (r, r) lower triangular.
        lower: (r,) bounds.
        upper: (r,) bounds.
        points: K.
    """
    r = len(L)
    k = np.arange(points) + 0.5
    y = np.zeros((r, points))
    y[0], log_weight = _midpoints(lower[0] / L[0, 0], upper[0] / L[0, 0], k / points)
    for j, prime in enumerate(first_primes(r - 1), start=1):
        u = np.modf(k * np.sqrt(prime))[0]
        before, size = L[j, :j] @ y[:j], L[j, j]
        size = np.copysign(max(abs(size), 1e-12 * float(np.linalg.norm(L[j]))), size)
        ends = np.sort([(lower[j] - before) / size, (upper[j] - before) / size], axis=0)
        y[j], log_p = _between(ends[0], ends[1], u)
        log_weight += log_p
    weight = np.exp(log_weight - log_weight.max())
    return y, weight / weight.sum()


def _midpoints(a: float, b: float, part: Floats) -> tuple[Floats, Floats]:
    """Points (K,) of a standard normal variable between a and b, with logarithms of weights."""
    ends, low, high = np.array([_BEYOND, 1.0 - _BEYOND]), *sorted((a, b))
    (first, last), _ = _between(np.full(2, low), np.full(2, high), ends)
    if low > first - 0.1 * (last - first):
        first = low  # the slices begin at the bound
    if high < last + 0.1 * (last - first):
        last = high
    y = first + part * (last - first)
    return y, -0.5 * (y**2 - y[np.argmin(np.abs(y))] ** 2)


def _between(a: Floats, b: Floats, u: Floats) -> tuple[Floats, Floats]:
    """A standard normal variable between a and b (K,), at the part u (K,) of its probability.

    And the logarithm of that probability. Computed in the lower tail, by logarithms: exact however
    far the two numbers are from zero.
    """
    upper = a > 0.0
    low, high = np.where(upper, -b, a), np.where(upper, -a, b)
    part = np.where(upper, 1.0 - u, u)
    log_high = log_ndtr(high)
    ratio = np.exp(np.minimum(log_ndtr(low) - log_high, 0.0))
    z = ndtri_exp(np.minimum(log_high + np.log(part + (1.0 - part) * ratio), -1e-300))
    log_p = log_high + np.log1p(-np.minimum(ratio, 1.0 - 1e-16))
    z = np.clip(z, low, high)
    return np.where(upper, -z, z), log_p
