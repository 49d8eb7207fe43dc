"""Planes that no strain point reaches: how far their parameters could come down unnoticed.

Where n^T sigma stays below k everywhere and always, a smaller k, down to the largest n^T sigma,
gives the same response to the last digit. So k is known to be at least that and no more: the
*bound information* of planes that are not violated. A search uses it to bring such planes as near
as can be, where they bite as soon as their neighbours give way.
"""

from __future__ import annotations

import numpy as np

from geoident.model.arrays import Bools, Floats
from geoident.model.certificate import Activity

_PART = 1e-12
"""A derivative below this part of the largest is none."""


def strengths(activity: Activity, scaling: Floats) -> Bools:
    """Parameters (n,) whose growth moves planes away, and brings none nearer.

    Args:
        activity: the planes.
        scaling: dp/dx (n,), SI.
    """
    slopes = activity.slopes * scaling
    least = _PART * np.abs(slopes).max(initial=0.0)
    return np.asarray((slopes > least).any(axis=0) & ~(slopes < -least).any(axis=0))


def unreached(activity: Activity, jacobian: Floats) -> Bools:
    """Parameters (n,) that act on planes only, none of which any strain point reaches.

    Args:
        activity: the planes.
        jacobian: (g, n) derivatives of the readings there, in any scaling of the readings.
    """
    idle = (activity.points.sum(axis=1) == 0)[:, None]
    moved = np.abs(activity.slopes) > _PART * np.abs(activity.slopes).max(initial=0.0)
    silent = np.linalg.norm(jacobian, axis=0) == 0.0
    return np.asarray(moved.any(axis=0) & (idle | ~moved).all(axis=0) & silent)


def headroom(activity: Activity) -> Floats:
    """By how much (n,), SI, each parameter alone can fall before a point reaches one of its planes.

    The distances are linear in a strength. 0 where a plane is reached, infinite where no strain
    point has the material or the parameter moves no plane outwards.
    """
    gap = np.maximum(activity.distances - activity.reached, 0.0)
    gap[activity.points.sum(axis=1) > 0] = 0.0
    slopes = activity.slopes
    with np.errstate(divide="ignore", invalid="ignore"):
        room = np.where(slopes > 0.0, gap[:, None] / slopes, np.inf)
    return np.asarray(room.min(axis=0, initial=np.inf), dtype=np.float64)
