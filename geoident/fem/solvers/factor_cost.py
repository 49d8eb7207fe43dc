"""What a sparse Cholesky factorization will cost, told from the pattern alone.

Row i of L has entries in the *row subtree* of i: the paths of the elimination tree from the
neighbours of i before it up to i (Liu, The role of elimination trees in sparse factorization,
1990). So column k has as many entries as there are row subtrees that k is in. In a postorder a row
subtree is known by its leaves, those neighbours whose subtree has no neighbour before it, and by
the nodes where the paths from one leaf and the next meet: the size of the row is added at the
leaves, taken away where they meet and at its end, and summed over every subtree (Gilbert, Ng &
Peyton, An efficient algorithm to compute row and column counts for sparse Cholesky factorization,
1994).

Unknowns of one node have the same neighbours, so this is done node by node, each with as many
unknowns as it has. The counts are exact: our solvers keep the order that they are given.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy.sparse as sp
from scipy.sparse.csgraph import minimum_spanning_tree

from geoident.fem.solvers.direct import LowerPattern
from geoident.model.arrays import Bools, Ints


@dataclass(frozen=True)
class FactorCost:
    """Cost of one factorization.

    Args:
        entries: of L.
        flops: multiplications and additions to find them.
    """

    entries: int
    flops: float


def factor_cost(lower: LowerPattern, node: Ints) -> FactorCost:
    """Cost of factorizing a matrix in the order of its pattern.

    Args:
        lower: pattern of the lower triangle.
        node: (n,) node of each unknown; unknowns of one node stand together.
    """
    if lower.n == 0:
        return FactorCost(0, 0.0)
    first = np.flatnonzero(np.concatenate([[True], node[1:] != node[:-1]]))
    size = np.diff(np.append(first, lower.n))
    # Nodes below each node, by the column of its first unknown.
    ones = np.ones(len(lower.indices), dtype=np.int8)
    columns = sp.csc_array((ones, lower.indices, lower.indptr), shape=(lower.n, lower.n))[:, first]
    of_node = sp.csr_array((np.ones(lower.n), np.arange(lower.n), np.append(first, lower.n)))
    graph = sp.csc_array(sp.tril(of_node @ columns, -1))
    below = _rows_below(graph.indptr.astype(np.int64), graph.indices.astype(np.int64), size)
    height = np.arange(lower.n)  # entries of a column above those of other nodes
    within = np.repeat(first + size, size) - height
    column = within + np.repeat(below, size)
    return FactorCost(int(column.sum()), float((column.astype(np.float64) ** 2).sum()))


def _rows_below(indptr: Ints, nodes: Ints, size: Ints) -> Ints:
    """(n_nodes,) entries of L below the block of each node, in one column.

    Args:
        indptr: (n_nodes + 1,) starts of the columns.
        nodes: nodes below each of them in the matrix.
        size: (n_nodes,) unknowns of each.
    """
    n = len(size)
    above = np.repeat(np.arange(n), np.diff(indptr))
    tree = _Postorder.of(_elimination_tree(above, nodes, n))
    column = tree.place[above]
    sequence = np.argsort(nodes * n + column)
    row, column = nodes[sequence], column[sequence]
    follows = _equals_previous(row)
    before = np.where(follows, np.concatenate([[-1], column[:-1]])[: len(column)], -1)
    is_leaf = tree.first[column] > before
    row, column = row[is_leaf], column[is_leaf]
    # Its size enters at every leaf, and leaves where two branches meet and at the row itself.
    change = np.bincount(column, weights=size[row], minlength=n)
    repeated = np.flatnonzero(_equals_previous(row))
    meeting = tree.meeting(column[repeated - 1], column[repeated])
    change -= np.bincount(meeting, weights=size[row[repeated]], minlength=n)
    rows = np.unique(row)
    change -= np.bincount(tree.place[rows], weights=size[rows], minlength=n)
    total = np.concatenate([[0.0], np.cumsum(change)])
    below = total[1:] - total[tree.first]
    return np.asarray(np.rint(below[tree.place]), dtype=np.int64)


def _elimination_tree(above: Ints, below: Ints, n: int) -> Ints:
    """(n,) parent of each node in the elimination tree; -1 where it has none.

    When nodes are eliminated in their order, node k joins what was found so far exactly where an
    edge of least larger end does: so the minimum spanning tree under the weight max(i, j) has the
    same elimination tree and far fewer edges.

    Args:
        above: (m,) lower end of each edge.
        below: (m,) its other end.
        n: number of nodes.
    """
    edges = sp.csr_array((below + 1.0, (above, below)), shape=(n, n))
    tree = sp.coo_array(minimum_spanning_tree(edges))
    order = np.argsort(tree.col, kind="stable")
    parent, top = [-1] * n, list(range(n))
    for i, k in zip(tree.row[order].tolist(), tree.col[order].tolist(), strict=True):
        r = i
        while top[r] != r:
            top[r] = top[top[r]]
            r = top[r]
        if r != k:
            parent[r] = top[r] = k
    return np.array(parent, dtype=np.int64)


def _equals_previous(values: Ints) -> Bools:
    return np.concatenate([[False], values[1:] == values[:-1]])[: len(values)]


@dataclass(frozen=True)
class _Postorder:
    """A forest whose nodes have places such that every subtree is a run that ends with its root.

    Args:
        place: (n,) place of each node.
        first: (n,) by place, the first place of its subtree.
        parent: (n,) by place, that of its parent; -1 for none.
        depth: (n,) by place, how many are above it.
    """

    place: Ints
    first: Ints
    parent: Ints
    depth: Ints

    @classmethod
    def of(cls, parent: Ints) -> _Postorder:
        """From the parent (n,) of each node, which has a larger number; -1 for none."""
        n, above = len(parent), parent.tolist()
        count = [1] * n
        for k, up in enumerate(above):
            if up >= 0:
                count[up] += count[k]
        places, depths, free, end = [0] * n, [0] * n, [0] * n, n
        for k in range(n - 1, -1, -1):  # each takes the end of what its parent has left
            up = above[k]
            if up < 0:
                places[k], end = end - 1, end - count[k]
            else:
                places[k], depths[k] = free[up] - 1, depths[up] + 1
                free[up] -= count[k]
            free[k] = places[k]
        place = np.array(places, dtype=np.int64)
        first, up, depth = np.empty((3, n), dtype=np.int64)
        first[place] = place - np.array(count, dtype=np.int64) + 1
        up[place] = np.where(parent >= 0, place[parent], -1)
        depth[place] = depths
        return cls(place, first, up, depth)

    def meeting(self, low: Ints, high: Ints) -> Ints:
        """(m,) places of the lowest nodes that are above both of two places.

        Between them stand nodes of one tree below that node, the highest of which are its children.

        Args:
            low: (m,) the smaller places.
            high: (m,) the larger ones, none above its smaller one.
        """
        n = len(self.depth)
        highest = self.depth * n + np.arange(n)
        top = np.empty(len(low), dtype=np.int64)
        level = np.frexp((high - low + 1).astype(np.float64))[1] - 1
        for j in range(int(level.max(initial=-1)) + 1):  # least of runs of 1, 2, 4, ... places
            run = level == j
            a, b = highest[low[run]], highest[high[run] - (1 << j) + 1]
            top[run] = np.minimum(a, b) % n
            highest = np.minimum(highest[: -(1 << j)], highest[1 << j :])
        return self.parent[top]
