"""A constant that grows with depth or stress, at the strain points of its material."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from geoident.fem.location import format_point
from geoident.model.arrays import Floats, Ints
from geoident.model.dual import Dual, ParameterPoint
from geoident.model.ground import Growth
from geoident.model.parameter import Values


@dataclass(frozen=True, eq=False)
class PointGrowth:
    """A constant at the strain points of its material.

    Args:
        growth: as the case says it.
        points: (q,) numbers of the strain points of all ground that is ever of the material,
            ascending.
        positions: (q, dim) their coordinates, m.
        names: parameters that its values may depend on.
        value: its values (q,) at parameters, Pa.
        typical: a number of its size, Pa, at which matrices are scaled; it depends on no parameter.
        n_outside: points beside the footprint of the surface from which depth is counted.
    """

    growth: Growth
    points: Ints
    positions: Floats
    names: frozenset[str]
    value: Callable[[ParameterPoint], Dual]
    typical: float
    n_outside: int = 0


def not_positive(one: PointGrowth, values: Values) -> str | None:
    """Where a constant is not positive at parameter values, half a sentence; None for nowhere."""
    with np.errstate(all="ignore"):
        found = one.value(ParameterPoint(values, ())).value
    if np.isfinite(found).all() and found.min() > 0.0:
        return None
    worst = int(np.argmin(np.where(np.isfinite(found), found, -np.inf)))
    number, where = found[worst], format_point(one.positions[worst])
    return f"{one.growth.words}: it is {number:.4g} Pa at {where}, where it must be positive"
