"""How noisy computed readings are, from a few of them on a line, and which step follows from it.

A program prints so many digits, iterates to a tolerance, meshes anew. Differences of order k of
values at equal distances lose what is smooth and keep the noise, whose variance they multiply by
(2k)! / (k!)^2 (Hamming; Moré and Wild, SIAM J. Sci. Comput. 33, 2011).
"""

from __future__ import annotations

import math

import numpy as np

from geoident.model.arrays import Floats

POINTS = 7
"""Values on the line: differences up to the sixth order."""
ROUNDING = 1e-15
"""Relative noise of numbers that are all digits."""
_AGREE = 4.0
"""Ratio of the estimates of three successive orders up to which they are of the noise alone."""
LARGEST_STEP = 0.1
"""Relative step at most: beyond, differences tell little of derivatives, however noisy."""


def noise_of(values: Floats) -> Floats:
    """Standard deviation (m,) of the noise of m quantities.

    Args:
        values: (k, m) of each at k points at equal distances on a line.

    >>> grid = np.arange(7.0)[:, None]
    >>> float(noise_of(np.exp(0.001 * grid))[0]) < 1e-14
    True
    """
    levels, table = [], values
    for order in range(1, len(values)):
        table = np.diff(table, axis=0)
        gain = math.factorial(2 * order) / math.factorial(order) ** 2
        levels.append(np.sqrt(np.mean(table**2, axis=0) / gain))
    by_order = np.stack(levels)
    result = by_order[-1].copy()  # an upper bound where no three orders agree
    for start in range(len(by_order) - 3, -1, -1):
        three = by_order[start : start + 3]
        agree = three.max(axis=0) <= _AGREE * three.min(axis=0)
        result[agree] = three[0][agree]  # the lowest order that has lost what is smooth
    return np.asarray(np.maximum(result, ROUNDING * np.abs(values).max(axis=0)))


def steps_of(noise: Floats, values: Floats, weights: Floats) -> tuple[float, float]:
    """Relative steps of forward and of central differences that balance noise and curvature.

    Of a quantity of size s and noise e that changes as a power of the parameter, a forward
    difference with the step h is wrong by about 2 e / h + h s / 2, a central one by
    e / h + h^2 s / 6.

    Args:
        noise: (m,) of the quantities.
        values: (m,) the quantities.
        weights: (m,) 1 / standard deviation of their readings.

    >>> [round(h, 6) for h in steps_of(np.array([1e-8]), np.array([1.0]), np.array([1.0]))]
    [0.0002, 0.003107]
    """
    size = float(np.linalg.norm(weights * values))
    part = float(np.linalg.norm(weights * noise)) / size if size > 0.0 else ROUNDING
    part = max(part, ROUNDING)
    forward, central = 2.0 * math.sqrt(part), (3.0 * part) ** (1.0 / 3.0)
    return min(forward, LARGEST_STEP), min(central, LARGEST_STEP)


def line_of(p: Floats, sizes: Floats, lower: Floats, upper: Floats, spacing: float) -> list[Floats]:
    """Points (n,) on a line from p, inside the bounds.

    Args:
        p: (n,) where it begins.
        sizes: (n,) of the parameters; 0 for those that stay.
        lower: (n,) bounds.
        upper: (n,) bounds.
        spacing: relative distance of two points.
    """
    reach = (POINTS - 1) * spacing * sizes
    sign = np.where(p + reach <= upper, 1.0, -1.0)
    fits = (p + sign * reach >= lower) & (p + sign * reach <= upper)
    step = np.where(fits, sign * spacing * sizes, 0.0)
    return [p + k * step for k in range(POINTS)]
