"""What lies near what: points in boxes, points at one place, by scipy's trees of points."""

from __future__ import annotations

import numpy as np
from scipy.spatial import KDTree

from geoident.model.arrays import Floats, Ints

_MARGIN = 1e-12
"""By how much boxes are searched beyond half their size, in parts of the largest coordinate."""


def points_in_boxes(points: Floats, low: Floats, high: Floats) -> tuple[Ints, Ints]:
    """Pairs (k,), (k,) of a point and a box that holds it, its border included.

    Args:
        points: (m, dim).
        low: (n, dim) least coordinates of the boxes.
        high: (n, dim) largest ones.

    >>> square = np.array([[0.0, 0.0]]), np.array([[1.0, 1.0]])
    >>> points_in_boxes(np.array([[0.5, 2.0], [1.0, 0.3]]), *square)
    (array([1]), array([0]))
    """
    nothing = np.empty(0, dtype=np.int64)
    if not len(points) or not len(low):
        return nothing, nothing
    tree, middle = KDTree(points), 0.5 * low + 0.5 * high
    margin = _MARGIN * max(float(np.abs(points).max()), 1e-280)
    reach = (0.5 * high - 0.5 * low).max(axis=1) + margin
    # Mostly few boxes hold a point, and only these are worth a list.
    nearest, _ = tree.query(middle, p=np.inf, distance_upper_bound=2.0 * reach.max())
    some = np.flatnonzero(nearest <= reach)
    held = tree.query_ball_point(middle[some], reach[some], p=np.inf, return_sorted=True)
    box = np.repeat(some, [len(inner) for inner in held])
    at = np.concatenate([nothing, *(np.array(inner, dtype=np.int64) for inner in held)])
    inside = ((points[at] >= low[box]) & (points[at] <= high[box])).all(axis=1)
    return at[inside], box[inside]


def pairs_within(points: Floats, distance: float) -> Ints:
    """Pairs (k, 2) of points that are no farther apart than a distance; each pair is there once.

    Args:
        points: (n, dim).
        distance: up to which two are a pair.

    >>> pairs_within(np.array([[0.0, 0.0], [5.0, 5.0], [0.0, 0.001]]), 0.01)
    array([[0, 2]])
    """
    if len(points) < 2:
        return np.empty((0, 2), dtype=np.int64)
    pairs = KDTree(points).query_pairs(distance, output_type="ndarray")
    return np.unique(np.sort(pairs, axis=1), axis=0).astype(np.int64)
