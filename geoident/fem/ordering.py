"""A fill-reducing order of the nodes: geometric nested dissection.

A separator splits the nodes in two halves that share no element; it is eliminated after both
[George, 1973]. Here a half is what stands on one side of a plane across a coordinate axis. Let the
nodes of a part be sorted along the axis, and let lo(i), hi(i) be the lowest and highest position
among node i and its neighbours. If the plane is put before position c, the separator is

    R(c) = {i : lo(i) < c <= pos(i)},  or  L(c) = {i : pos(i) < c <= hi(i)},

whichever is smaller, and

    |R(c)| = #{lo < c} - c,   |L(c)| = c - #{hi < c}

are prefix sums: the sizes of the separators of *all* planes cost no more than that of one. So the
best plane of every axis is found exactly. All parts of one depth are split at once, by array
operations over the active nodes; there is no recursion.

Nothing here depends on the geometry being good: coincident points, slivers, a flat mesh in space
and unconnected nodes only change how small the separators come out.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from geoident.model.arrays import Floats, Ints

Integers = npt.NDArray[np.integer]
"""Integers of any width: places in an array are kept short, for the cache."""

LEAF = 8
"""Parts of so many nodes are not split further."""

MARGIN = 0.15
"""Share of a part's nodes that must stand on either side of the plane."""


def nested_dissection(points: Floats, indptr: Ints, indices: Ints) -> Ints:
    """Order in which to eliminate the nodes so that the factor has little fill.

    Args:
        points: (n_nodes, dim) coordinates.
        indptr: (n_nodes + 1,) starts of the rows of the symmetric node graph.
        indices: (n_edges,) neighbours of each node; whether a node is its own neighbour is no
            matter.

    Returns:
        (n_nodes,) node indices, a permutation: ``order[0]`` is eliminated first.
    """
    n = points.shape[0]
    order = np.empty(n, dtype=np.int64)
    ranks = _ranks(points)
    level = _whole(n, indptr, indices)
    while level.nodes.size:
        cut = _best_cut(level, ranks)
        level = _divide(level, cut, order)
    return order


@dataclass(frozen=True)
class _Level:
    """The parts of one depth, one after another.

    Args:
        nodes: (a,) the active nodes, those of one part together.
        starts: (parts + 1,) where each part begins in ``nodes``.
        slots: (parts,) where each part begins in the final order.
        indptr, indices: graph of the active nodes by their place in ``nodes``, each node its own
            neighbour; no edge joins two parts.
    """

    nodes: Ints
    starts: Ints
    slots: Ints
    indptr: Ints
    indices: Integers

    @property
    def sizes(self) -> Ints:
        return np.diff(self.starts)


@dataclass(frozen=True)
class _Cut:
    """A plane for every part.

    Args:
        position: (a,) of each active node in its part along the axis, counted through all parts.
        side: (a,) 0 before the plane, 1 behind it, 2 separator.
        cost: (parts,) what the plane costs; infinite for a part that is not to be split.
    """

    position: Integers
    side: Integers
    cost: Floats


def _ranks(points: Floats) -> Ints:
    """(dim, n_nodes) rank of each node along each axis, ties by the axes that follow."""
    n, dim = points.shape
    ranks = np.empty((dim, n), dtype=np.int64)
    for axis in range(dim):
        keys = [points[:, (axis + k) % dim] for k in range(dim)]
        ranks[axis, np.lexsort(keys[::-1])] = np.arange(n)
    return ranks


def _whole(n: int, indptr: Ints, indices: Ints) -> _Level:
    """The level with one part, the whole mesh."""
    counts = np.diff(indptr)
    rows = np.repeat(np.arange(n), counts)
    loops = np.arange(n)
    ends = np.asarray(indptr[1:], dtype=np.int64)
    # Each node's own entry is put after its neighbours: no row is then empty.
    with_loops = np.empty(len(indices) + n, dtype=np.int32)
    with_loops[np.arange(len(indices)) + rows] = indices
    with_loops[ends + loops] = loops
    starts = np.concatenate([[0], ends + loops + 1])
    return _Level(loops, np.array([0, n]), np.array([0]), starts, with_loops)


def _best_cut(level: _Level, ranks: Ints) -> _Cut:
    """For every part the best plane of all axes."""
    cuts = [_cut_along(level, rank) for rank in ranks]
    best = cuts[0]
    part = np.repeat(np.arange(len(level.sizes)), level.sizes)
    for cut in cuts[1:]:
        better = cut.cost < best.cost
        mask = better[part]
        best = _Cut(
            np.where(mask, cut.position, best.position),
            np.where(mask, cut.side, best.side),
            np.where(better, cut.cost, best.cost),
        )
    return best


def _cut_along(level: _Level, rank: Ints) -> _Cut:
    """For every part the best plane across one axis."""
    a = level.nodes.size
    part = np.repeat(np.arange(len(level.sizes)), level.sizes)
    position = np.empty(a, dtype=np.int32)
    position[np.argsort(part * rank.size + rank[level.nodes])] = np.arange(a)
    around = position[level.indices]
    lo = np.minimum.reduceat(around, level.indptr[:-1])
    hi = np.maximum.reduceat(around, level.indptr[:-1])
    places = np.arange(a)
    behind = np.cumsum(np.bincount(lo + 1, minlength=a + 1))[:a] - places
    before = places - np.cumsum(np.bincount(hi + 1, minlength=a + 1))[:a]
    costs = _costs(level, part, np.minimum(behind, before))
    cost = np.minimum.reduceat(costs, level.starts[:-1])
    hits = np.flatnonzero(costs == cost[part])
    plane = hits[np.searchsorted(hits, level.starts[:-1])]
    c = plane[part]
    side = (position >= c).astype(np.int8)
    uses_behind = (behind <= before)[c]
    separator = np.where(uses_behind, (lo < c) & (position >= c), (position < c) & (hi >= c))
    side[separator & np.isfinite(cost)[part]] = 2
    return _Cut(position, side, cost)


def _costs(level: _Level, part: Ints, separator: Ints) -> Floats:
    """(a,) cost of the plane before each position: separator over the product of the halves."""
    left = np.arange(level.nodes.size) - level.starts[:-1][part]
    size = level.sizes[part]
    right = size - left
    margin = np.maximum(MARGIN * size, 1)
    allowed = (left >= margin) & (right >= margin) & (size > LEAF)
    costs = np.full(left.size, np.inf)
    costs[allowed] = (separator[allowed] + 0.01) / (left[allowed] * right[allowed])
    return costs


def _divide(level: _Level, cut: _Cut, order: Ints) -> _Level:
    """Write the separators and the leaves to the order; return the halves as parts."""
    parts = level.sizes.size
    part = np.repeat(np.arange(parts), level.sizes)
    leaf = ~np.isfinite(cut.cost)
    side = np.where(leaf[part], 2, cut.side)
    key = part * 3 + side
    sequence = np.argsort(key * np.int64(level.nodes.size) + cut.position)
    sizes = np.bincount(key, minlength=3 * parts).reshape(parts, 3)
    begins = level.slots[:, None] + np.cumsum(sizes, axis=1) - sizes
    key = key[sequence]
    firsts = np.cumsum(sizes.ravel()) - sizes.ravel()
    slot = begins.ravel()[key] + np.arange(key.size) - firsts[key]
    done = key % 3 == 2
    order[slot[done]] = level.nodes[sequence[done]]
    stays = sequence[~done]
    halves = sizes[:, :2].ravel()
    used = halves > 0
    return _restrict(level, stays, halves[used], begins[:, :2].ravel()[used])


def _restrict(level: _Level, stays: Ints, sizes: Ints, slots: Ints) -> _Level:
    """The level of some of the nodes, in the sequence given."""
    a = level.nodes.size
    place = np.full(a, -1, dtype=np.int32)
    place[stays] = np.arange(stays.size)
    counts = np.diff(level.indptr)[stays]
    ends = np.cumsum(counts)
    gather = np.repeat(level.indptr[stays] - ends + counts, counts) + np.arange(counts.sum())
    columns = place[level.indices[gather]]
    keep = columns >= 0
    kept = np.concatenate([[0], np.cumsum(keep)])
    indptr = np.concatenate([[0], kept[ends]])
    starts = np.concatenate([[0], np.cumsum(sizes)])
    return _Level(level.nodes[stays], starts, slots, indptr, columns[keep])
