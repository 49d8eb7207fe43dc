"""The cut-off of tension, and what it shares with shear surfaces: circles and directions.

The largest principal stress is limited to T: over all directions a, a^T sigma a <= T. In a section
that is m + r <= T, with Mohr's circle by a polygon, and zz <= T. In a solid directions a are spread
evenly.
"""

from __future__ import annotations

from functools import lru_cache

import numpy as np

from geoident.fem.yielding.law import YieldPlanes
from geoident.forward.yielding.even_directions import spread_directions
from geoident.forward.yielding.smooth_distance import polygon_shrinkage, principal_values, shrinkage
from geoident.model.arrays import Floats
from geoident.model.dual import Dual, ParameterPoint
from geoident.model.yielding import Fit

MEAN = np.array([0.5, 0.5, 0.0, 0.0])
"""Mean of xx and yy, of the stresses of a section."""

AXIAL = np.array([0.0, 0.0, 1.0, 0.0])
"""The stress normal to a section."""

PRESSURE = np.array([1.0, 1.0, 1.0, 0.0, 0.0, 0.0]) / 3
"""The mean stress of a solid."""

_FEWEST = 12  # directions that enclose all deviators well


def circle(sides: int, fit: Fit) -> Floats:
    """Directions (sides, 4) whose largest product with a stress stands for r.

    The first takes (xx - yy) / 2; equally spaced, so that the mirror images of x and y are there.
    """
    angle = 2 * np.pi * np.arange(sides) / sides
    zero = np.zeros(sides)
    unit = np.stack([np.cos(angle) / 2, -np.cos(angle) / 2, zero, np.sin(angle)], axis=1)
    return np.asarray(unit / polygon_shrinkage(sides, fit))


def angle_names(sides: int) -> list[str]:
    """Directions of the larger stress, from x towards y, of the planes of `circle`."""
    return [f"{180 * n / sides:g} deg" for n in range(sides)]


def products(a: Floats, b: Floats) -> Floats:
    """What takes a^T sigma b from the six components of a stress: (..., 6) from (..., 3) twice."""
    shear = [a[..., i] * b[..., j] + a[..., j] * b[..., i] for i, j in ((0, 1), (1, 2), (0, 2))]
    return np.concatenate([a * b, np.stack(shear, axis=-1)], axis=-1)


def cut_off(limit: Dual, point: ParameterPoint, n_strain: int, count: int, fit: Fit) -> YieldPlanes:
    """The planes that limit principal stresses.

    Args:
        limit: T, Pa.
        point: for numbers that depend on nothing.
        n_strain: 4 or 6.
        count: sides of the polygon of a section, or least number of directions in a solid.
        fit: how they lie.
    """
    normals = _in_section(count, fit) if n_strain < 6 else _in_solid(count, fit)
    names = tuple(f"tension {n}" for n in range(1, 1 + len(normals)))
    if n_strain < 6:
        names = (*(f"tension {angle}" for angle in angle_names(count)), "tension axial")
    distances = Dual(np.repeat(limit.columns[None], len(normals), axis=0))
    return YieldPlanes(point.constant(normals), distances, names=names)


def _in_section(sides: int, fit: Fit) -> Floats:
    return np.concatenate([MEAN + circle(sides, fit), AXIAL[None]])


@lru_cache(maxsize=32)
def _in_solid(count: int, fit: Fit) -> Floats:
    both = spread_directions(2 * max(count, _FEWEST))
    half = both[_upper(both)]
    deviators = products(half, half) - PRESSURE
    kappa = shrinkage(fit, deviators, lambda x: principal_values(x)[:, 2])
    return PRESSURE + deviators / kappa


def _upper(vectors: Floats) -> Floats:
    """Which of vectors and their opposites to keep: the first component that counts is positive."""
    signs = np.where(np.abs(vectors) > 1e-9, np.sign(vectors), 0.0)
    return np.asarray(signs @ np.array([9.0, 3.0, 1.0]) > 0)
