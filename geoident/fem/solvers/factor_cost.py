"""What a sparse Cholesky factorization will cost, told from the pattern alone.

Column k of L has entries at its own neighbours below it and wherever the columns that it follows in
the elimination tree have them (George & Liu, Computer solution of large sparse positive definite
systems, 1981, ch. 5):

    struct(k) = ( adj(k) union struct(c) over the children c of k ) minus {k},
    parent(k) = min struct(k).

Unknowns of one node have the same neighbours, so this is done node by node, each with as many
unknowns as it has. The counts are exact: our solvers keep the order that they are given.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from geoident.fem.solvers.direct import LowerPattern
from geoident.model.arrays import Bools, Ints


@dataclass(frozen=True)
class FactorCost:
    """Cost of one factorization.

    Args:
        entries: of L.
        flops: multiplications and additions to find them.
        lasting: part of these for the unknowns that last (`LowerPattern.lasting`).
    """

    entries: int
    flops: float
    lasting: float = 0.0


def factor_cost(lower: LowerPattern, node: Ints) -> FactorCost:
    """Cost of factorizing a matrix in the order of its pattern.

    Args:
        lower: pattern of the lower triangle.
        node: (n,) node of each unknown; unknowns of one node stand together.
    """
    if lower.n == 0:
        return FactorCost(0, 0.0)
    starts = np.concatenate([[True], node[1:] != node[:-1]])
    first = np.flatnonzero(starts)
    size = np.diff(np.append(first, lower.n))
    below = _rows_below(*_node_columns(lower, starts, first), size)
    height = np.arange(lower.n)  # entries of a column above those of other nodes
    within = np.repeat(first + size, size) - height
    column = within + np.repeat(below, size)
    flops = column.astype(np.float64) ** 2
    return FactorCost(int(column.sum()), float(flops.sum()), float(flops[: lower.lasting].sum()))


def _node_columns(lower: LowerPattern, starts: Bools, first: Ints) -> tuple[Ints, Ints]:
    """Nodes below each node in its first column: starts of the columns, and the nodes.

    Args:
        lower: the pattern.
        starts: (n,) the first unknowns of nodes.
        first: (n_nodes,) the same by number.
    """
    node_of = np.cumsum(starts) - 1
    counts = lower.indptr[first + 1] - lower.indptr[first]
    above = np.repeat(np.arange(len(first)), counts)
    before = np.cumsum(counts) - counts
    nodes = node_of[lower.indices[np.arange(len(above)) + (lower.indptr[first] - before)[above]]]
    fresh = nodes > above
    fresh[1:] &= (nodes[1:] != nodes[:-1]) | (above[1:] != above[:-1])
    indptr = np.concatenate([[0], np.cumsum(np.bincount(above[fresh], minlength=len(first)))])
    return indptr, nodes[fresh]


def _rows_below(indptr: Ints, nodes: Ints, size: Ints) -> Ints:
    """(n_nodes,) entries of L below the block of each node, in one column.

    Most nodes follow one other, and have no neighbour that it does not have: then only the other
    itself is less, and its rows need not be looked through again.
    """
    n = len(indptr) - 1
    below = [0] * n
    sizes, ends = size.tolist(), indptr.tolist()
    seen = np.full(n, -1, dtype=np.int64)  # the last for which a node was among the rows
    waiting: list[list[Ints]] = [[] for _ in range(n)]
    marked, last = -1, nodes[:0]  # of which all rows of the node before are marked; these rows
    for k in range(n):
        own, parts = nodes[ends[k] : ends[k + 1]], waiting[k]
        waiting[k] = []
        if len(parts) == 1 and parts[0] is last:
            new = own[seen[own] != marked]
            rows, count = parts[0][1:], below[k - 1] - sizes[k]
            if len(new):
                seen[new] = marked
                rows, count = np.sort(np.concatenate([rows, new])), count + int(size[new].sum())
        else:
            rows, marked = _union(k, own, parts, seen), k
            count = int(size[rows].sum())
        below[k], last = count, rows
        if len(rows):
            waiting[int(rows[0])].append(rows)
    return np.array(below, dtype=np.int64)


def _union(k: int, own: Ints, parts: list[Ints], seen: Ints) -> Ints:
    """Rows below node k, ascending: its neighbours and the rows of those that it follows."""
    seen[k] = k
    found = []
    for part in (own, *parts):
        new = part[seen[part] != k]
        seen[new] = k
        found.append(new)
    return found[0] if len(found) == 1 else np.sort(np.concatenate(found))
