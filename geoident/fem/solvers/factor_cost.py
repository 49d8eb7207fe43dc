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
    below = _rows_below(_node_columns(lower, starts), size)
    height = np.arange(lower.n)  # entries of a column above those of other nodes
    within = np.repeat(first + size, size) - height
    column = within + np.repeat(below, size)
    flops = column.astype(np.float64) ** 2
    return FactorCost(int(column.sum()), float(flops.sum()), float(flops[: lower.lasting].sum()))


def _node_columns(lower: LowerPattern, starts: Bools) -> list[Ints]:
    """Nodes below each node in its first column; starts (n,) are the first unknowns of nodes."""
    node_of = np.cumsum(starts) - 1
    column = np.repeat(np.arange(lower.n), np.diff(lower.indptr))
    mine = starts[column]
    above, nodes = node_of[column[mine]], node_of[lower.indices[mine]]
    fresh = nodes > above
    fresh[1:] &= (nodes[1:] != nodes[:-1]) | (above[1:] != above[:-1])
    above, nodes = above[fresh], nodes[fresh]
    ends = np.searchsorted(above, np.arange(1, int(node_of[-1]) + 1))
    return np.split(nodes, ends)


def _rows_below(columns: list[Ints], size: Ints) -> Ints:
    """(n_nodes,) entries of L below the block of each node, in one column."""
    n = len(columns)
    below = np.zeros(n, dtype=np.int64)
    seen = np.full(n, -1, dtype=np.int64)
    waiting: list[list[Ints]] = [[] for _ in range(n)]
    for k in range(n):
        seen[k] = k
        parts = []
        for found in (columns[k], *waiting[k]):
            new = found[seen[found] != k]
            seen[new] = k
            parts.append(new)
        waiting[k] = []
        struct = np.concatenate(parts) if len(parts) > 1 else parts[0]
        if len(struct):
            below[k] = size[struct].sum()
            waiting[struct.min()].append(struct)
    return below
