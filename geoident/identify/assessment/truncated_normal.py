"""The normal posterior truncated at the bounds, and its linear functions (theory 6.3).

With the model linearised at the estimate, the posterior of the scaled parameters x is normal within
the bounds and zero outside. Written from the estimate, dx = x - x^,

    dx = mean + F xi ,   xi ~ N(0, 1) independent ,   lower <= dx <= upper .

Only bounds that the normal reaches matter. Let F_R be the rows of their parameters and
F_R^T = Q U its QR decomposition: of xi only the components y = Q^T xi are truncated, by the
triangular system U^T y, one after the other (Genz 1992): given y_1 .. y_(j-1), y_j lies between
two numbers, drawn through its distribution function, and the product of the probabilities of these
intervals is the weight of the draw; the mean weight is the probability of the box. What F xi has
beside stays normal:

    dx = shift_k + G xi   with the weight w_k ,   shift_k = mean + F Q y_k ,   G = F (1 - Q Q^T) .

A linear function a dx, with a normal error e of its own, is drawn as a shift_k + |a G, e| z_k. The
points (y_k, z_k) are Sobol's, not random: the same input gives the same numbers. Ends of 95 %
intervals are thus known to 0.1 % of their width as a rule, and to 1 % at worst.

The 95 % interval is the shortest: symmetric where no bound is near (then it is that of the normal,
without draws), one-sided, from the bound on, where the density is highest on it.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from scipy.special import log_ndtr, ndtr, ndtri, ndtri_exp

from geoident.model.arrays import Floats, Ints
from geoident.model.results.bands import NORMAL_95

REACHED = 3.0
"""A bound farther than this, in standard deviations, is not reached: one in 700."""

LOG2_DRAWS = 14
"""16 384 draws: with a quarter of them ends of intervals are off by up to 2 % of their width."""

CUTS_NOTHING = 5.0
"""Standard deviations beyond which a bound takes less than a millionth of the probability away."""

_LOG2_POINTS = 12
"""Of points for the probability of a box, which is then known to a thousandth."""

_SAME_MEANS = 1e-9
"""Spread of means, in standard deviations, below which a mixture of normals is one normal."""

_TAILS = np.linspace(0.0, 0.05, 51)
"""Probabilities below the lower end, among which that of the shortest interval is sought."""

_NEAR_SHORTEST = 1.05
"""Widths, by the shortest, through which a parabola gives the shortest: single widths scatter."""

_NO_TAIL = 2.5e-3
"""Probability beyond the end of an interval that is none: it ends with what is possible, ..."""

_CLOSE = 0.05
"""... if it is as close to that, in widths of the interval."""

_BEND_POINTS = 33
"""Points at which it is asked how far a bend moves the others towards their bounds."""

_BLOCK = 2_000_000
"""Numbers in a table of draws that is made at once (16 MB)."""

_DEPENDENT = 1e-12
"""Part of a row of the triangle below which its last entry is rounding: the others give it."""

_JITTER = 1e-12
"""Added to a correlation matrix, so that rounding cannot make it indefinite."""

_POSITIVE_ROOM = 1e-16
"""Least probability, by its bound, of an interval between two numbers that rounding makes equal."""


@dataclass(frozen=True)
class Summary:
    """Intervals and variances of l linear functions of the deviations from the estimate.

    Args:
        rms: (l,) root of the mean square: the deviation from zero, which stands for the estimate.
        lower95: (l,) lower end of the shortest 95 % interval.
        upper95: (l,) its upper end.
        shift_variance: (l,) variance of their means, from one draw to another.
        own_sd: (l,) standard deviation of what is normal at every draw, own errors included.
    """

    rms: Floats
    lower95: Floats
    upper95: Floats
    shift_variance: Floats
    own_sd: Floats


@dataclass(frozen=True)
class Posterior:
    """Weighted draws of n scaled parameters, each with a normal part of one covariance.

    Args:
        shift: (n, K) deviations from the estimate; K is one where no bound is reached.
        weight: (K,) with the sum one.
        factor: (n, q) G: around each draw the parameters are normal with the covariance G G^T.
        normal: (K,) standard normal numbers that go with the draws, for what is normal beside.
    """

    shift: Floats
    weight: Floats
    factor: Floats
    normal: Floats

    @property
    def covariance(self) -> Floats:
        """Mean squares and products of the deviations from the estimate, (n, n)."""
        return np.asarray(self.factor @ self.factor.T + (self.shift * self.weight) @ self.shift.T)

    def products(self, rows: Floats, deviation: Callable[[slice], Floats] | None = None) -> Floats:
        """Mean squares and products of functions of the deviations from the estimate, (l, l).

        Args:
            rows: (l, n) their coefficients, where they are linear.
            deviation: of some rows, what they deviate from linear (l', K) at the draws.
        """
        mean = rows @ self.shift
        if deviation is not None:
            mean = mean + deviation(slice(None))
        normal = rows @ self.factor
        return np.asarray(normal @ normal.T + (mean * self.weight) @ mean.T)

    def pick(self, order: Ints) -> Posterior:
        """The same of some parameters, by their numbers (k,), whatever the others are."""
        return replace(self, shift=self.shift[order], factor=self.factor[order])

    def summary(
        self,
        rows: Floats,
        sd: Floats | None = None,
        *,
        limits: tuple[Floats, Floats] | None = None,
        deviation: Callable[[slice], Floats] | None = None,
    ) -> Summary:
        """Linear functions of the deviations from the estimate, each with an error of its own.

        Args:
            rows: (l, n) their coefficients.
            sd: (l,) standard deviation of the errors; None for none.
            limits: (l,), (l,) of what is possible; None for no limits.
            deviation: of some rows, what they deviate from linear (l', K) at the draws.
        """
        own = np.sqrt(np.sum((rows @ self.factor) ** 2, axis=1) + (0.0 if sd is None else sd**2))
        rms, variance, low, high, tail = (np.empty(len(rows)) for _ in range(5))
        size = max(1, _BLOCK // len(self.weight))
        for block in (slice(first, first + size) for first in range(0, len(rows), size)):
            mean = rows[block] @ self.shift
            if deviation is not None:
                mean = mean + deviation(block)
            centre = mean @ self.weight
            variance[block] = (mean - centre[:, None]) ** 2 @ self.weight
            rms[block] = np.sqrt(mean**2 @ self.weight + own[block] ** 2)
            low[block], high[block], tail[block] = self._shortest(mean, centre, own[block])
        if limits is not None:
            close = _CLOSE * (high - low)
            from_limit = (low - limits[0] < close) & (tail <= _NO_TAIL)
            to_limit = (limits[1] - high < close) & (_TAILS[-1] - tail <= _NO_TAIL)
            low = np.where(from_limit, limits[0], np.maximum(low, limits[0]))
            high = np.where(to_limit, limits[1], np.minimum(high, limits[1]))
        return Summary(rms, low, high, variance, own)

    def _shortest(self, mean: Floats, centre: Floats, own: Floats) -> tuple[Floats, Floats, Floats]:
        """Shortest 95 % intervals of quantities with means (l, K) and a normal part (l,).

        Returns:
            Lower and upper ends (l,), (l,), and the probability (l,) below the lower end.
        """
        low, high = centre - NORMAL_95 * own, centre + NORMAL_95 * own
        tail = np.full(len(mean), 0.5 * _TAILS[-1])
        varies = np.abs(mean - centre[:, None]).max(axis=1) > _SAME_MEANS * own
        for i in np.flatnonzero(varies).tolist():
            drawn = mean[i] + own[i] * self.normal
            order = np.argsort(drawn)
            drawn, weight = drawn[order], self.weight[order]
            below = np.cumsum(weight) - 0.5 * weight
            width = np.interp(_TAILS + 0.95, below, drawn) - np.interp(_TAILS, below, drawn)
            tail[i] = _lowest(_TAILS, width)
            low[i], high[i] = np.interp([tail[i], tail[i] + 0.95], below, drawn)
        return low, high, tail


def _lowest(t: Floats, width: Floats) -> float:
    """Where the width (m,) is least over t (m,): by a parabola, unless it is at an end of t."""
    k = int(np.argmin(width))
    near = width <= _NEAR_SHORTEST * width[k]
    if 0 < k < len(t) - 1 and np.count_nonzero(near) > 3:
        square, slope, _ = np.polyfit(t[near], width[near], 2)
        if square > 0.0:
            return float(np.clip(-0.5 * slope / square, t[near][0], t[near][-1]))
    return float(t[k])


def truncated_normal(
    mean: Floats,
    factor: Floats,
    lower: Floats,
    upper: Floats,
    *,
    always: int | None = None,
    bend: Callable[[Floats], Floats] | None = None,
) -> Posterior:
    """A normal density truncated at bounds.

    Args:
        mean: (n,) of the normal, from the estimate.
        factor: (n, q) F, covariance F F^T; a row of zeros for what is fixed.
        lower: (n,) lower bounds from the estimate, -inf for none.
        upper: (n,) upper bounds.
        always: number of a variable whose bounds count first, near or not.
        bend: of its values (K,) to what the means of all given it have beside (n, K), zero of
            itself; its bounds are finite.

    A half normal: its 95 % interval begins at the bound and ends at the 97.5 % quantile of the
    whole one.

    >>> half = truncated_normal(np.zeros(1), np.eye(1), np.zeros(1), np.full(1, np.inf))
    >>> interval = half.summary(np.eye(1), limits=(np.zeros(1), np.full(1, np.inf)))
    >>> interval.lower95.tolist(), interval.upper95.round(2).tolist()
    ([0.0], [1.96])
    """
    sd = np.sqrt(np.sum(factor**2, axis=1))
    least, most = mean, mean
    if always is not None and bend is not None:
        beside = bend(np.linspace(lower[always], upper[always], _BEND_POINTS))
        least, most = mean + beside.min(axis=1), mean + beside.max(axis=1)
    reached = (sd > 0.0) & ((least - lower < REACHED * sd) | (upper - most < REACHED * sd))
    if always is not None:
        reached[always] = True
    R = np.flatnonzero(reached)
    if not len(R):
        return Posterior(mean[:, None], np.ones(1), factor, np.zeros(1))
    inside = ndtr((upper[R] - mean[R]) / sd[R]) - ndtr((lower[R] - mean[R]) / sd[R])
    if always is not None:
        inside[always == R] = -1.0
    # the variables that bounds truncate most come first
    R = R[np.argsort(inside, kind="stable")][: factor.shape[1]]
    Q, U = np.linalg.qr(factor[R].T)
    u = _sobol(len(R) + 1, LOG2_DRAWS)
    moved = None if bend is None else lambda first: bend(mean[always] + first)[R]
    y, log_weight = _conditioned(U.T, lower[R] - mean[R], upper[R] - mean[R], u[1:], moved)
    weight = np.exp(log_weight - log_weight.max())
    shift = mean[:, None] + factor @ Q @ y
    if always is not None and bend is not None:
        shift += bend(shift[always])
    shift[R] = np.clip(shift[R], lower[R, None], upper[R, None])
    return Posterior(shift, weight / weight.sum(), factor - factor @ Q @ Q.T, ndtri(u[0]))


def log_probability_within(mean: Floats, covariance: Floats, lower: Floats, upper: Floats) -> float:
    """Logarithm of the probability that a normal vector lies between two.

    In contrast to `scipy.stats.multivariate_normal.cdf` also where the probability is below 1e-308.

    Args:
        mean: (n,).
        covariance: (n, n), positive definite.
        lower: (n,) lowest values; may be infinite.
        upper: (n,) highest values.
    """
    sd = np.sqrt(np.diag(covariance))
    a, b = (lower - mean) / sd, (upper - mean) / sd
    R = np.flatnonzero((a > -CUTS_NOTHING) | (b < CUTS_NOTHING))
    if not len(R):
        return 0.0
    _, alone = _between(a[R], b[R], np.full(len(R), 0.5))
    R = R[np.argsort(alone, kind="stable")]  # the most truncated first: the others then vary little
    if len(R) == 1:
        return float(alone[0])
    correlation = (covariance / np.outer(sd, sd))[np.ix_(R, R)]
    L = np.linalg.cholesky(correlation + _JITTER * np.eye(len(R)))
    _, log_weight = _conditioned(L, a[R], b[R], _sobol(len(R), _LOG2_POINTS))
    top = float(log_weight.max())
    return top + float(np.log(np.mean(np.exp(log_weight - top))))


def _sobol(d: int, log2_count: int) -> Floats:
    """Points (d, 2^log2_count) that fill the unit cube evenly, none on its faces."""
    from scipy.stats import qmc  # noqa: PLC0415 - a quarter of a second, and many fits need none

    points = qmc.Sobol(d, scramble=False).random_base2(log2_count)
    return np.asarray(points.T + 0.5 / 2**log2_count, dtype=np.float64)


def _conditioned(
    L: Floats,
    lower: Floats,
    upper: Floats,
    u: Floats,
    moved: Callable[[Floats], Floats] | None = None,
) -> tuple[Floats, Floats]:
    """Points y (r, K) of independent normals under lower <= L y <= upper, one given the other.

    Args:
        L: (r, r) lower triangular.
        lower: (r,) bounds.
        upper: (r,) bounds.
        u: (r, K) at which parts of their probabilities, in the unit cube.
        moved: of the first of L y (K,) to what all have beside L y (r, K), of the first nothing.

    Returns:
        The points, and the logarithms (K,) of their weights, whose mean is the probability.
    """
    y, log_weight, beside = np.zeros(u.shape), np.zeros(u.shape[1]), np.zeros(u.shape)
    for j, row in enumerate(L):
        before = row[:j] @ y[:j] + beside[j]
        size = np.copysign(max(abs(row[j]), _DEPENDENT * float(np.linalg.norm(row))), row[j])
        a, b = np.sort([(lower[j] - before) / size, (upper[j] - before) / size], axis=0)
        y[j], log_p = _between(a, b, u[j])
        log_weight += log_p
        if j == 0 and moved is not None:
            beside = moved(row[0] * y[0])
    return y, log_weight


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
    log_p = log_high + np.log1p(-np.minimum(ratio, 1.0 - _POSITIVE_ROOM))
    z = np.clip(z, low, high)
    return np.where(upper, -z, z), log_p
