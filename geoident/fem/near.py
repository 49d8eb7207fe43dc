"""What lies near what: points in boxes, points at one place.

Both sort into the cells of a grid, so that what is far apart is never compared.
"""

from __future__ import annotations

from itertools import product

import numpy as np

from geoident.model.arrays import Bools, Floats, Ints

_CELLS = {1: 10_000, 2: 1000, 3: 160}
"""Cells of the grid of `points_in_boxes` along an axis, at most, by the dimension."""

_FINE = 4.0
"""Cells along an axis for each point along it, were the points spread evenly over a surface."""

_IN_A_BOX = 3.0
"""Cells along an axis of a box of usual size: few, since its lines of cells are looked up one by
one, and not one, since it then holds points of a cell far larger than itself."""

_ASIDE = 0.381966
"""Where cells of `pairs_within` begin, in parts of their size: planes of nodes, which lie at round
distances, seldom fall on their borders then."""

_MOST_CELLS = 2.0**20
"""Cells of `pairs_within` along an axis at most: their numbers stay whole in 64 bits."""


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
    if not len(points) or not len(low):
        return np.empty(0, np.int64), np.empty(0, np.int64)
    dim = points.shape[1]
    origin, size = points.min(axis=0), np.ptp(points, axis=0)
    size = np.where(size > 0.0, size, 1.0)
    usual = max(float(np.median((high - low).max(axis=1))), 1e-300)
    most = _FINE * len(points) ** (1 / max(1, dim - 1))
    wanted = min(_IN_A_BOX * min(float(size.max()) / usual, most), most)
    n = int(np.clip(np.ceil(wanted), 1, _CELLS[dim]))

    def cells(x: Floats) -> Ints:
        with np.errstate(over="ignore"):  # of what is far off, which is clipped
            return np.asarray(np.clip((x - origin) / size * n, 0, n - 1), dtype=np.int64)

    flat = np.ravel_multi_index(tuple(cells(points).T), (n,) * dim)
    held = np.bincount(flat, minlength=n**dim)
    apart = np.any((high < origin) | (low > origin + size), axis=1)
    some = np.flatnonzero(~apart)
    first, last = cells(low[some]), cells(high[some]) + 1
    any_ = _count(held.reshape((n,) * dim), first, last) > 0
    some, first, last = some[any_], first[any_], last[any_]
    order, start = np.argsort(flat, kind="stable"), np.concatenate([[0], np.cumsum(held)])
    row, line = _lines(first, last, n)
    along = start[line + first[row, -1]], start[line + last[row, -1]]
    met = np.flatnonzero(along[1] > along[0])
    at = order[_runs(along[0][met], along[1][met])]
    box = some[np.repeat(row[met], (along[1] - along[0])[met])]
    inside = np.ones(len(at), dtype=np.bool_)
    for x, lower, upper in zip(points.T, low.T, high.T, strict=True):
        inside &= (x[at] >= lower[box]) & (x[at] <= upper[box])
    return at[inside], box[inside]


def _count(held: Ints, first: Ints, last: Ints) -> Ints:
    """Points (n,) in blocks of cells from first to before last (n, dim), by cells that hold some.

    Args:
        held: how many points are in each cell.
        first: least cell along each axis.
        last: the one behind the largest.
    """
    dim = held.ndim
    below = np.pad(held, [(1, 0)] * dim)
    for axis in range(dim):  # points in all cells before one
        below = np.cumsum(below, axis=axis)
    count = np.zeros(len(first), dtype=np.int64)
    for ends in product((False, True), repeat=dim):
        corner = tuple(np.where(np.array(ends), last, first).T)
        count += (-1) ** (dim - sum(ends)) * below[corner]
    return count


def _lines(first: Ints, last: Ints, n: int) -> tuple[Ints, Ints]:
    """Rows of blocks of cells, and numbers of cells at which lines along the last axis begin.

    Args:
        first: (m, dim) least cell of each block along each axis.
        last: (m, dim) the one behind the largest.
        n: cells along an axis.
    """
    row, line = np.arange(len(first)), np.zeros(len(first), dtype=np.int64)
    for axis in range(first.shape[1] - 1):
        here = _runs(first[row, axis], last[row, axis])
        many = last[row, axis] - first[row, axis]
        row, line = np.repeat(row, many), np.repeat(line, many) * n + here
    return row, line * n


def _runs(first: Ints, last: Ints) -> Ints:
    """All whole numbers from each first one to before its last one, run after run.

    >>> _runs(np.array([4, 0]), np.array([6, 3]))
    array([4, 5, 0, 1, 2])
    """
    many = last - first
    before = np.cumsum(many) - many
    return np.asarray(np.arange(int(many.sum())) + np.repeat(first - before, many))


def pairs_within(points: Floats, distance: float, cell: float) -> Ints:
    """Pairs (k, 2) of points that are no farther apart than a distance; each pair is there once.

    Args:
        points: (n, dim).
        distance: up to which two are a pair; far less than the distance of most.
        cell: size of the cells in which they are sought, several distances; it changes no pair.

    >>> pairs_within(np.array([[0.0, 0.0], [5.0, 5.0], [0.0, 0.001]]), 0.01, 1.0)
    array([[0, 2]])
    """
    if len(points) < 2:
        return np.empty((0, 2), np.int64)
    origin, extent = points.min(axis=0), float(np.ptp(points, axis=0).max())
    cell = max(cell, extent / _MOST_CELLS, 1e-300)
    x = (points - origin) / cell + _ASIDE
    near = 1.01 * distance / cell
    number, at = _cells_beside(x, near)
    order = np.argsort(number, kind="stable")
    number, at = number[order], at[order]
    found = []
    for apart in range(1, len(at)):  # in the order of cells those of one stand side by side
        same = np.flatnonzero(number[apart:] == number[:-apart])
        if not len(same):
            break
        found.append(np.stack([at[same], at[same + apart]], axis=1))
    pairs = np.concatenate(found) if found else np.empty((0, 2), np.int64)
    close = np.linalg.norm(points[pairs[:, 0]] - points[pairs[:, 1]], axis=1) <= distance
    return np.unique(np.sort(pairs[close], axis=1), axis=0)


def _cells_beside(x: Floats, near: float) -> tuple[Ints, Ints]:
    """Numbers of cells (m,), and points in them or so near to them (m,).

    Args:
        x: (n, dim) coordinates in cells.
        near: how near, in cells.
    """
    own = np.floor(x)
    below, above = x - own <= near, own + 1.0 - x <= near
    width = own.max(axis=0).astype(np.int64) + 3
    numbers, who = [], []
    for step in product((0, -1, 1), repeat=x.shape[1]):
        reached: Bools = np.ones(len(x), dtype=np.bool_)
        for axis, one in enumerate(step):
            if one:
                reached &= (below if one < 0 else above)[:, axis]
        some = np.flatnonzero(reached)
        cell = own[some].astype(np.int64) + np.array(step) + 1
        numbers.append(np.ravel_multi_index(tuple(cell.T), tuple(width)))
        who.append(some)
    return np.concatenate(numbers), np.concatenate(who)
