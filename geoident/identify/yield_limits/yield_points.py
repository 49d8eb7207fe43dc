"""A point with its yield planes, of which those that no strain point reaches are brought near.

Where n^T sigma stays below k everywhere and always, a smaller k, down to the largest n^T sigma,
gives the same response to the last digit. So k is known to be at least that and no more. A search
brings such planes as near as can be: they yield as soon as their neighbours give way.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from geoident.identify.least_squares.acceptance import Iterate
from geoident.identify.least_squares.descent import Evaluator
from geoident.identify.problem.outcome import History
from geoident.identify.problem.problem import Discrepancy
from geoident.identify.problem.responses import YieldSystem
from geoident.model.arrays import Bools, Floats
from geoident.model.yielding import Activity

CLOSE = 1e-6
"""An unreached plane is kept this far, relative, from where it is reached."""

_NO_SLOPE = 1e-12
"""A derivative of a plane below this part of the largest counts as zero."""


@dataclass(frozen=True)
class YieldIterate(Iterate):
    """A point with its yield planes, those that no strain point reaches as near as can be.

    Args:
        unreached: (n,) strengths whose planes no strain point reaches.
        activity: the planes at the point that was evaluated, before they were brought near.
    """

    unreached: Bools
    activity: Activity


def yield_evaluator(
    discrepancy: Discrepancy, history: History, model: YieldSystem
) -> Evaluator[YieldIterate]:
    """An evaluator that brings unreached planes near.

    Args:
        discrepancy: of the problem.
        history: is told of every point that is recorded.
        model: of the problem.
    """
    scaling = discrepancy.scaling

    def brought_near(point: Iterate) -> YieldIterate:
        activity = model.activity(point.p)
        idle = unreached(activity, point.linearization.jacobian)
        room = headroom(activity) - CLOSE * np.abs(point.p)
        near = idle & np.isfinite(room) & (room > 0.0)
        x = scaling.to_scaled(np.where(near, point.p - np.where(near, room, 0.0), point.p))
        return YieldIterate(x, scaling.to_natural(x), point.linearization, idle, activity)

    return Evaluator(discrepancy, history, brought_near)


def strengths(activity: Activity, scaling: Floats) -> Bools:
    """Parameters (n,) whose growth moves planes away, and brings none nearer.

    Args:
        activity: the planes.
        scaling: dp/dx (n,), SI.
    """
    slopes = activity.slopes * scaling
    least = _NO_SLOPE * np.abs(slopes).max(initial=0.0)
    return np.asarray((slopes > least).any(axis=0) & ~(slopes < -least).any(axis=0))


def unreached(activity: Activity, jacobian: Floats) -> Bools:
    """Parameters (n,) that act on planes only, none of which any strain point reaches.

    Args:
        activity: the planes.
        jacobian: (g, n) derivatives of the readings there, in any scaling of the readings.
    """
    idle = (activity.points.sum(axis=1) == 0)[:, None]
    moved = np.abs(activity.slopes) > _NO_SLOPE * np.abs(activity.slopes).max(initial=0.0)
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
