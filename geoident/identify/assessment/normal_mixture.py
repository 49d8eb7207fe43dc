"""Quantiles of mixtures of a few normal distributions.

Where what is known depends on something else that is not known, an accuracy, a scatter between
sections, which of several minima holds, it is normal at each of its values and a mixture of these
normals over all of them.
"""

from __future__ import annotations

import numpy as np
from scipy.special import ndtr

from geoident.model.arrays import Floats

_FAR = 10.0
"""Standard deviations from every mean within which a quantile of 2.5 % surely is."""

_ACCURATE = 1e-13
"""Error of a probability, or length of a bracket by the largest end, at which a search ends."""

_MOST_STEPS = 200
"""Of a search: every third halves the bracket, so 66 halvings at least, and 45 reach rounding."""


def mixture_interval(weight: Floats, mean: Floats, sd: Floats) -> tuple[Floats, Floats]:
    """The 2.5 and 97.5 % quantiles of mixtures of K normal distributions.

    Args:
        weight: (K,) with the sum one.
        mean: (K, ...).
        sd: (K, ...).

    Returns:
        Lower and upper ends, both (...); NaN where a mean or standard deviation is not finite.

    >>> low, high = mixture_interval(np.array([0.5, 0.5]), np.array([0.0, 8.0]), np.ones(2))
    >>> float(low.round(3)), float(high.round(3))  # beyond either only one of the two is left
    (-1.645, 9.645)
    """
    known = np.isfinite(mean).all(axis=0) & np.isfinite(sd).all(axis=0)
    w = weight.reshape(-1, *(1,) * (mean.ndim - 1))
    m, s = np.where(known, mean, 0.0), np.where(known, np.maximum(sd, 1e-300), 1.0)
    first, last = (m - _FAR * s).min(axis=0), (m + _FAR * s).max(axis=0)
    tolerance = _ACCURATE * np.maximum(np.abs(first), np.abs(last))

    def quantile(p: float) -> Floats:
        # Newton's method within a bracket, which every third step halves: normals of one mixture
        # may differ by orders of magnitude, and beside a narrow one Newton's steps are short
        low, high = first, last
        x, done = 0.5 * (low + high), np.zeros(first.shape, dtype=np.bool_)
        for step in range(_MOST_STEPS):
            z = (x - m) / s
            excess = (w * ndtr(z)).sum(axis=0) - p
            low, high = np.where(excess > 0.0, low, x), np.where(excess > 0.0, x, high)
            done = done | (np.abs(excess) <= _ACCURATE) | (high - low <= tolerance)
            if done.all():
                break
            with np.errstate(over="ignore", under="ignore", divide="ignore", invalid="ignore"):
                density = (w * np.exp(-0.5 * z**2) / s).sum(axis=0) / np.sqrt(2.0 * np.pi)
                newton = x - excess / density
            inside = (low < newton) & (newton < high) & (step % 3 < 2)
            x = np.where(done, x, np.where(inside, newton, 0.5 * (low + high)))
        return np.where(known, x, np.nan)

    return quantile(0.025), quantile(0.975)
