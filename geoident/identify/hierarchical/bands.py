"""Bands of the readings of a section that took no part (theory 15).

What is not known of the parameters of the section (of the law, of its scatter about it) may be
large, so readings are not taken to be linear in it. Along each principal axis of the covariance of
its parameters the readings are known at three points with their derivatives, and between them by
cubic polynomials (Hermite), beyond them by tangents; effects of different axes add up. Parameters
are drawn from their distribution, cut at the bounds, and the errors of the readings are added.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from geoident.errors import ModelError
from geoident.identify.hierarchical.knowledge import FurtherSection, second_moment
from geoident.model.arrays import Floats

_REACH = 2.0
"""Standard deviations at which the readings are computed beside the estimate."""

_HALVINGS = 3
"""How often the way along an axis is halved where the model has no solution at its end."""

_DRAWS = 20000
"""An end of a 95 % interval has then a standard error of 0.02 standard deviations."""

_SEED = 14
"""Of the draws: the same input gives the same result."""

_NO_WAY = 1e-6
"""Standard deviations: where a bound leaves less room, there is no second point along an axis."""

SectionEvaluation = Callable[[list[Floats]], list[tuple[Floats, Floats] | None]]
"""Readings (g,) and Jacobians (g, n) at some parameters (n,), SI; None where there are none."""


@dataclass(frozen=True)
class ReadingBands:
    """Where the readings (g,) of a section are expected, SI.

    Args:
        computed: at the parameters that are expected.
        lower95: lower end of the 95 % band.
        upper95: upper end.
    """

    computed: Floats
    lower95: Floats
    upper95: Floats


def reading_bands(
    section: FurtherSection,
    evaluate: SectionEvaluation,
    sd: Floats,
    of_model: Floats | None = None,
    common: Floats | None = None,
) -> ReadingBands:
    """Bands of readings.

    Args:
        section: the distribution of its parameters.
        evaluate: the model of the section.
        sd: (g,) standard deviations of what gauges add to readings, SI.
        of_model: (g,) those of the error of the model at the parameters that are expected, SI; they
            grow with the readings. None for none.
        common: (g, r) what the last r parameters, of which the model does not know, add to the
            readings in parts of these. None for none.

    Raises:
        ModelError: the model has no solution at the parameters that are expected.
    """
    from scipy.interpolate import CubicHermiteSpline  # noqa: PLC0415 - 0.3 s, only projects use it

    weights, means, scaling = section.weights, section.means, section.scaling
    C = second_moment(weights, means - weights @ means, section.covariances)
    n = len(C) - (0 if common is None else common.shape[1])
    variances, vectors = np.linalg.eigh(C[:n, :n])
    kept = variances > 1e-12 * max(float(variances.max(initial=0.0)), 1e-12)
    axes, sizes = np.zeros((len(C), np.count_nonzero(kept))), np.sqrt(variances[kept])
    axes[:n] = vectors[:, kept]
    x = scaling.to_scaled(section.values)

    def place(k: int, t: float) -> tuple[float, Floats]:
        """Where t standard deviations along axis k end, at a bound at the latest: t, parameters."""
        step = t * sizes[k] * axes[:, k]
        moving = np.abs(step) > 1e-12
        room = np.where(step > 0.0, scaling.upper - x, scaling.lower - x)[moving] / step[moving]
        part = float(np.clip(room.min(initial=1.0), 0.0, 1.0))
        return t * part, scaling.away(section.values, part * step)

    ends = [(k, t) for k in range(len(sizes)) for t in (-_REACH, _REACH)]
    answers = evaluate([section.values[:n], *(place(k, t)[1][:n] for k, t in ends)])
    if answers[0] is None:
        raise ModelError("The model has no solution at the parameters that are expected.")
    v0, J0 = answers[0]
    draws = _draws(section, rng := np.random.default_rng(_SEED))
    values = np.tile(v0, (len(draws), 1))
    for k, (axis, size) in enumerate(zip(axes.T, sizes, strict=True)):
        # t in standard deviations along the axis, the readings there and their derivatives by t
        knots = [(0.0, v0, J0 @ (scaling.dp_dx(section.values) * axis * size)[:n])]
        for (_, end), first in zip(ends[2 * k :][:2], answers[1 + 2 * k :][:2], strict=True):
            t, answer = end, first
            for _ in range(_HALVINGS):
                if answer is None:
                    t *= 0.5
                    (answer,) = evaluate([place(k, t)[1][:n]])
            at, p = place(k, t)
            if answer is not None and abs(at) >= _NO_WAY:
                slope = answer[1] @ (scaling.dp_dx(p) * axis * size)[:n]
                knots.append((at, answer[0], slope))
        knots.sort(key=lambda knot: knot[0])
        places, v, slopes = (np.array(column) for column in zip(*knots, strict=True))
        drawn = (draws @ axis) / size
        if len(knots) == 1:
            values += drawn[:, None] * slopes[0]
            continue
        spline = CubicHermiteSpline(places, v, slopes)
        inside = np.clip(drawn, places[0], places[-1])
        values += spline(inside) - v0 + spline(inside, 1) * (drawn - inside)[:, None]
    if common is not None:
        factor = 1.0 + common @ section.values[n:]
        values = values * (factor + draws[:, n:] @ common.T)
        v0 = v0 * factor
    if of_model is not None:
        grown = np.divide(values, v0, out=np.ones_like(values), where=v0 != 0.0)
        sd = np.hypot(sd, of_model * grown)
    values += sd * rng.normal(size=values.shape)
    low, high = np.quantile(values, [0.025, 0.975], axis=0)
    return ReadingBands(v0, np.minimum(low, v0), np.maximum(high, v0))


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
    return np.asarray(np.clip(x + np.concatenate(parts), scaling.lower, scaling.upper) - x)
