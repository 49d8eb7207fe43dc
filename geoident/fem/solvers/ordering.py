"""A fill-reducing order of the nodes: geometric nested dissection.

A separator splits the nodes in two halves that share no element; it is eliminated after both
[George, 1973]. Here a half is what stands on one side of a plane across a coordinate axis. Let the
nodes of a part be sorted along the axis, and let lo(i), hi(i) be the lowest and highest position
among node i and its neighbours. If the plane is put before position c, each of

    R(c) = {i : lo(i) < c <= pos(i)},    |R(c)| = #{lo < c} - c,
    L(c) = {i : pos(i) < c <= hi(i)},    |L(c)| = c - #{hi < c}

separates. The sizes are prefix sums, so those of *all* planes cost no more than one, and the
best plane of every axis is found exactly. Across that plane the separator is then made the
smallest one, which may take nodes of both sides: a vertex cover of the edges that cross.

All parts of one depth are split at once, by array operations over the active nodes. Nothing depends
on the geometry being good: coincident points, slivers, a flat mesh in space and unconnected nodes
only change how small the separators come out.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
import numpy.typing as npt
import scipy.sparse as sp
from scipy.sparse.csgraph import breadth_first_order, maximum_bipartite_matching

from geoident.model.arrays import Bools, Floats, Ints

Integers = npt.NDArray[np.integer]
"""Integers of any width: places in an array are kept short, for the cache."""

LEAF = 16
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
        level = _divide(level, _best_cut(level, ranks), order)
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
    indices: Ints

    @cached_property
    def sizes(self) -> Ints:
        """(parts,) number of nodes of each part."""
        return np.diff(self.starts)

    @cached_property
    def part(self) -> Ints:
        """(a,) the part of each active node."""
        return np.repeat(np.arange(self.sizes.size), self.sizes)


@dataclass(frozen=True)
class _Cut:
    """A plane for every part.

    Args:
        position: (a,) of each active node in its part along the axis, counted through all parts.
        highest: (a,) highest position among each node and its neighbours.
        plane: (parts,) first position behind the plane.
        cost: (parts,) what the plane costs; infinite for a part that is not to be split.
    """

    position: Integers
    highest: Integers
    plane: Integers
    cost: Floats


def _ranks(points: Floats) -> Ints:
    """(dim, n_nodes) rank of each node along each axis; ties by their numbers."""
    n, dim = points.shape
    ranks = np.empty((dim, n), dtype=np.int64)
    for axis in range(dim):
        ranks[axis, np.argsort(points[:, axis], kind="stable")] = np.arange(n)
    return ranks


def _whole(n: int, indptr: Ints, indices: Ints) -> _Level:
    """The level with one part, the whole mesh."""
    counts = np.diff(indptr)
    rows = np.repeat(np.arange(n), counts)
    loops = np.arange(n)
    ends = np.asarray(indptr[1:], dtype=np.int64)
    # Each node's own entry is put after its neighbours: no row is then empty.
    with_loops = np.empty(len(indices) + n, dtype=np.int64)
    with_loops[np.arange(len(indices)) + rows] = indices
    with_loops[ends + loops] = loops
    starts = np.concatenate([[0], ends + loops + 1])
    return _Level(loops, np.array([0, n]), np.array([0]), starts, with_loops)


def _best_cut(level: _Level, ranks: Ints) -> _Cut:
    """For every part the best plane of all axes."""
    best, *others = [_cut_along(level, rank) for rank in ranks]
    for cut in others:
        better = cut.cost < best.cost
        best = _Cut(
            np.where(better[level.part], cut.position, best.position),
            np.where(better[level.part], cut.highest, best.highest),
            np.where(better, cut.plane, best.plane),
            np.where(better, cut.cost, best.cost),
        )
    return best


def _cut_along(level: _Level, rank: Ints) -> _Cut:
    """For every part the best plane across one axis."""
    places = np.arange(level.nodes.size)
    position = np.empty(level.nodes.size, dtype=np.int32)
    position[np.argsort(level.part * rank.size + rank[level.nodes])] = places
    lo, hi = _reach(level, position)
    behind = np.cumsum(np.bincount(lo + 1, minlength=places.size + 1))[:-1] - places
    before = places - np.cumsum(np.bincount(hi + 1, minlength=places.size + 1))[:-1]
    costs = _costs(level, np.minimum(behind, before))
    cost = np.minimum.reduceat(costs, level.starts[:-1])
    cheapest = np.flatnonzero(costs == cost[level.part])
    plane = cheapest[np.searchsorted(cheapest, level.starts[:-1])]
    return _Cut(position, hi, plane, cost)


def _reach(level: _Level, position: Integers) -> tuple[Integers, Integers]:
    """(a,) lowest and highest position among each node and its neighbours."""
    around = position.take(level.indices)
    firsts = level.indptr[:-1]
    return np.minimum.reduceat(around, firsts), np.maximum.reduceat(around, firsts)


def _sides(level: _Level, cut: _Cut) -> Integers:
    """(a,) 0 for a node before the plane of its part, 1 behind it, 2 in the separator.

    All nodes of a part that is not split are called separator.
    """
    c = cut.plane[level.part]
    behind = cut.position >= c
    side = np.where(np.isfinite(cut.cost)[level.part], behind, 2)
    front = np.flatnonzero((side == 0) & (cut.highest >= c))
    if front.size:
        gather, counts = _entries(level, front)
        edge, ends = np.repeat(np.arange(front.size), counts), level.indices[gather]
        crosses = behind[ends]
        back, column = np.unique(ends[crosses], return_inverse=True)
        in_front, in_back = _cover(edge[crosses], column, front.size, back.size)
        side[front[in_front]] = 2
        side[back[in_back]] = 2
    return side


def _cover(row: Ints, column: Ints, n_rows: int, n_columns: int) -> tuple[Bools, Bools]:
    """Fewest rows and columns that touch all edges of a bipartite graph [Koenig, 1931].

    From a maximum matching: what an alternating path from an unmatched row reaches leaves its
    columns, the rest its rows. Given the edges across a plane these are the fewest nodes that
    separate the halves, often a third less than the nodes of one side.

    Args:
        row: (edges,) row of each edge.
        column: (edges,) column of each edge.
        n_rows: number of rows.
        n_columns: number of columns.

    Returns:
        (n_rows,) and (n_columns,) whether each is in the cover.
    """
    graph = _boolean(row, column, (n_rows, n_columns))
    match = maximum_bipartite_matching(graph, perm_type="column")
    matched, free = np.flatnonzero(match >= 0), np.flatnonzero(match < 0)
    start = n_rows + n_columns
    tails = np.concatenate([row, n_rows + match[matched], np.full(free.size, start)])
    heads = np.concatenate([n_rows + column, matched, free])
    paths = _boolean(tails, heads, (start + 1, start + 1))
    reached = np.zeros(start + 1, dtype=bool)
    reached[breadth_first_order(paths, start, return_predecessors=False)] = True
    return ~reached[:n_rows], reached[n_rows:start]


def _boolean(row: Ints, column: Ints, shape: tuple[int, int]) -> sp.csr_array[np.int8]:
    return sp.csr_array((np.ones(row.size, dtype=np.int8), (row, column)), shape=shape)


def _costs(level: _Level, separator: Ints) -> Floats:
    """(a,) cost of the plane before each position: separator over the product of the halves."""
    left = np.arange(level.nodes.size) - level.starts[:-1][level.part]
    size = level.sizes[level.part]
    right = size - left
    margin = np.maximum(MARGIN * size, 1)
    allowed = (left >= margin) & (right >= margin) & (size > LEAF)
    costs = np.full(left.size, np.inf)
    costs[allowed] = (separator[allowed] + 0.01) / (left[allowed] * right[allowed])
    return costs


def _divide(level: _Level, cut: _Cut, order: Ints) -> _Level:
    """Write the separators and the leaves to the order; return the halves as parts."""
    key = level.part * 3 + _sides(level, cut)
    sequence = np.argsort(key * level.nodes.size + cut.position)
    sizes = np.bincount(key, minlength=3 * level.sizes.size).reshape(-1, 3)
    slots = level.slots[:, None] + np.cumsum(sizes, axis=1) - sizes
    key = key[sequence]
    firsts = np.cumsum(sizes) - sizes.ravel()
    slot = slots.ravel()[key] + np.arange(key.size) - firsts[key]
    done = key % 3 == 2
    order[slot[done]] = level.nodes[sequence[done]]
    halves = sizes[:, :2].ravel()
    return _restrict(level, sequence[~done], halves[halves > 0], slots[:, :2].ravel()[halves > 0])


def _restrict(level: _Level, stays: Ints, sizes: Ints, slots: Ints) -> _Level:
    """The level of some of the nodes, in the sequence given."""
    a = level.nodes.size
    place = np.full(a, -1, dtype=np.int32)
    place[stays] = np.arange(stays.size)
    gather, counts = _entries(level, stays)
    columns = place.take(level.indices.take(gather))
    keep = columns >= 0
    kept = np.add.reduceat(keep, np.cumsum(counts) - counts, dtype=np.int64)
    indptr = np.concatenate([[0], np.cumsum(kept)])
    starts = np.concatenate([[0], np.cumsum(sizes)])
    return _Level(level.nodes[stays], starts, slots, indptr, columns[keep].astype(np.int64))


def _entries(level: _Level, rows: Ints) -> tuple[Ints, Ints]:
    """Places in ``indices`` of all entries of some rows, and how many each row has."""
    counts = np.diff(level.indptr)[rows]
    ends = np.cumsum(counts)
    offsets = np.repeat(level.indptr[rows] - ends + counts, counts)
    return offsets + np.arange(offsets.size), counts
