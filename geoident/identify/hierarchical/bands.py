"""Bands of the readings of a section that took no part (theory 15).

What is not known of the parameters of the section (of the law, of its scatter about it) may be
large, so readings are not taken to be linear in it. Along each principal axis of the covariance of
its parameters the readings are known at three points with their derivatives, and between them by
cubic polynomials (Hermite); effects of different axes add up. Parameters are drawn from their
distribution, cut at the bounds, and the errors of the readings are added.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from geoident.errors import ModelError
from geoident.identify.hierarchical.knowledge import FurtherSection
from geoident.identify.problem.scaling import Scaling
from geoident.model.arrays import Floats

_REACH = 2.0
"""Standard deviations at which the readings are computed beside the estimate."""

_HALVINGS = 3
_DRAWS = 20000
_SEED = 14
"""Of the draws: the same input gives the same result."""

SectionEvaluation = Callable[[list[Floats]], list[tuple[Floats, Floats] | None]]
"""Readings (g,) and Jacobians (g, n) at some parameters (n,), SI; None where there are none."""


@dataclass(frozen=True)
class ReadingBands:
    """Where the readings (g,) of a section are expected, SI.

    Args:
        computed: at the parameters that are expected.
        median: of the distribution.
        sd: root of the mean square deviation from ``computed``, with the errors of the readings.
        lower95: lower end of the 95 % band.
        upper95: upper end.
    """

    computed: Floats
    median: Floats
    sd: Floats
    lower95: Floats
    upper95: Floats


def reading_bands(section: FurtherSection, evaluate: SectionEvaluation, sd: Floats) -> ReadingBands:
    """Bands of readings.

    Args:
        section: what is known of its parameters.
        evaluate: the model of the section.
        sd: (g,) errors of the readings, SI.

    Raises:
        ModelError: the model has no solution at the parameters that are expected.
    """
    axes, sizes = _principal(section)
    axis = _Axes(section, axes, sizes)
    ends = [(k, sign) for k in range(len(sizes)) for sign in (-1.0, 1.0)]
    at = evaluate([section.values, *(axis.point(k, sign * _REACH) for k, sign in ends)])
    if at[0] is None:
        raise ModelError("The model has no solution at the parameters that are expected.")
    v0, J0 = at[0]
    rng = np.random.default_rng(_SEED)
    draws = _draws(section, rng)
    t = (draws @ axes) / sizes if len(sizes) else np.zeros((len(draws), 0))
    values = np.tile(v0, (len(draws), 1))
    for k in range(len(sizes)):
        sides = [axis.side(evaluate, at[1 + ends.index((k, sign))], k, sign) for sign in (-1, 1)]
        values += _along(t[:, k], axis.slope(J0, k, section.values), v0, sides)
    values += sd * rng.normal(size=values.shape)
    low, median, high = np.quantile(values, [0.025, 0.5, 0.975], axis=0)
    rms = np.sqrt(np.mean((values - v0) ** 2, axis=0))
    return ReadingBands(v0, median, rms, np.minimum(low, v0), np.maximum(high, v0))


def _principal(section: FurtherSection) -> tuple[Floats, Floats]:
    """Axes (n, m) of the covariance of a section, and standard deviations (m,) along them."""
    weights, means = section.weights, section.means
    mean = weights @ means
    C = np.einsum("j,jab->ab", weights, section.covariances)
    C = C + np.einsum("j,ja,jb->ab", weights, means - mean, means - mean)
    values, vectors = np.linalg.eigh(C)
    kept = values > 1e-12 * max(float(values.max(initial=0.0)), 1e-12)
    return vectors[:, kept], np.sqrt(values[kept])


def _draws(section: FurtherSection, rng: np.random.Generator) -> Floats:
    """Draws (m, n) of the parameters on their scales from `section.values`, within the bounds."""
    counts = rng.multinomial(_DRAWS, section.weights)
    parts = []
    for j in np.flatnonzero(counts):
        values, vectors = np.linalg.eigh(section.covariances[j])
        root = vectors * np.sqrt(np.maximum(values, 0.0))
        unit = rng.normal(size=(counts[j], root.shape[1]))
        parts.append(section.means[j] + unit @ root.T)
    scaling = section.scaling
    x = scaling.to_scaled(section.values)
    drawn = np.concatenate(parts)
    return np.asarray(np.clip(x + drawn, scaling.lower, scaling.upper) - x)


@dataclass(frozen=True)
class _Side:
    """The readings at the end of an axis: where, what, and their slope along it."""

    t: float
    v: Floats
    slope: Floats


@dataclass(frozen=True)
class _Axes:
    """Ways from what is expected along the principal axes."""

    section: FurtherSection
    axes: Floats
    sizes: Floats

    @property
    def _scaling(self) -> Scaling:
        return self.section.scaling

    def point(self, k: int, t: float) -> Floats:
        """Parameters (n,), SI, at t standard deviations along an axis, within the bounds."""
        step = self.axes[:, k] * self.sizes[k] * self.reach(k, t)
        return self._scaling.away(self.section.values, step)

    def reach(self, k: int, t: float) -> float:
        """The part of t standard deviations along an axis that is within the bounds."""
        scaling, step = self._scaling, self.axes[:, k] * self.sizes[k] * t
        x = scaling.to_scaled(self.section.values)
        room = np.where(step > 0.0, scaling.upper - x, scaling.lower - x)
        moving = np.abs(step) > 1e-12
        with np.errstate(divide="ignore", invalid="ignore"):
            parts = np.where(moving, room / np.where(moving, step, 1.0), np.inf)
        return t * float(np.clip(parts.min(initial=np.inf), 0.0, 1.0))

    def slope(self, J: Floats, k: int, p: Floats) -> Floats:
        """Derivatives (g,) of readings by standard deviations along an axis, at p (n,)."""
        direction = self._scaling.slope(p) * self.axes[:, k] * self.sizes[k]
        return np.asarray(J @ direction)

    def side(
        self, evaluate: SectionEvaluation, found: tuple[Floats, Floats] | None, k: int, sign: float
    ) -> _Side | None:
        """What is known at an end of an axis, nearer where the model has no solution there."""
        t = sign * _REACH
        for _ in range(_HALVINGS):
            if found is not None or t == 0.0:
                break
            t *= 0.5
            (found,) = evaluate([self.point(k, t)])
        reached = self.reach(k, t)
        if found is None or abs(reached) < 1e-6:
            return None
        v, J = found
        return _Side(reached, v, self.slope(J, k, self.point(k, t)))


def _along(t: Floats, slope: Floats, v0: Floats, sides: list[_Side | None]) -> Floats:
    """Changes (m, g) of readings at t (m,) along an axis."""
    found = t[:, None] * slope
    for side, beyond in zip(sides, (t < 0.0, t > 0.0), strict=True):
        if side is None:
            continue
        u = (t[beyond] / side.t)[:, None]
        gain, first, last = side.v - v0, slope * side.t, side.slope * side.t
        inside = u * first + u**2 * (3 * gain - 2 * first - last) + u**3 * (first + last - 2 * gain)
        outside = gain + (u - 1.0) * last
        found[beyond] = np.where(u <= 1.0, inside, outside)
    return np.asarray(found)
