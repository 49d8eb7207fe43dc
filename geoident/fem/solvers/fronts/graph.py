"""The graph of a matrix by nodes, its elimination tree and what hangs together in it.

Unknowns that follow each other and have the same neighbours are one *node* (mostly the two or three
displacements of a mesh node). The elimination tree of the nodes (Liu 1990) is found on a spanning
tree of the graph: when unknowns are eliminated in their order, node k joins what was found so far
exactly where an edge of least larger end does, so the minimum spanning tree under the weight
max(i, j) has the same elimination tree and far fewer edges.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
import scipy.sparse as sp
from scipy.sparse.csgraph import minimum_spanning_tree

from geoident.model.arrays import Bools, Ints


@dataclass(frozen=True)
class NodeGraph:
    """A matrix, of which the first unknowns are to be eliminated, by nodes.

    Args:
        starts: (n_nodes + 1,) first unknown of each node.
        n_eliminated: number of nodes that are eliminated; the rest are rows only.
        indptr: (n_eliminated + 1,) starts of the eliminated nodes in ``indices``.
        indices: (n_edges,) nodes below each of them in the matrix, ascending.
        cliques: (k,) each, nodes, ascending, that are coupled by what was eliminated before.
    """

    starts: Ints
    n_eliminated: int
    indptr: Ints
    indices: Ints
    cliques: tuple[Ints, ...]

    @cached_property
    def sizes(self) -> Ints:
        """(n_nodes,) number of unknowns of each node."""
        return np.diff(self.starts)

    def below(self, node: int) -> Ints:
        """(k,) nodes below an eliminated one in the matrix."""
        return self.indices[self.indptr[node] : self.indptr[node + 1]]


def node_graph(
    indptr: Ints, indices: Ints, n_eliminated: int, cliques: Sequence[Ints] = ()
) -> NodeGraph:
    """The graph by nodes.

    Args:
        indptr: (n + 1,) starts of the columns of the lower triangle; of the unknowns that are not
            eliminated the columns are empty.
        indices: (nnz,) rows, ascending, the diagonal first.
        n_eliminated: number of unknowns to be eliminated, the first.
        cliques: (k,) each, sets of unknowns, ascending, that are coupled beside the matrix.
    """
    n = len(indptr) - 1
    same = _like_the_next(indptr, indices, n_eliminated)
    for clique in cliques:
        member = np.zeros(n, dtype=bool)
        member[clique] = True
        same[:-1] &= member[1:] == member[:-1]
    first = np.concatenate([[True], ~same[:-1]]) if n else np.zeros(0, dtype=bool)
    node_of = np.cumsum(first) - 1
    starts = np.append(np.flatnonzero(first), n)
    n_nodes = int(node_of[n_eliminated - 1]) + 1 if n_eliminated else 0
    column = np.repeat(np.arange(n), np.diff(indptr))
    mine = first[column]
    above, below = node_of[column[mine]], node_of[indices[mine]]
    fresh = below > above
    fresh[1:] &= (below[1:] != below[:-1]) | (above[1:] != above[:-1])
    above, below = above[fresh], below[fresh]
    ends = np.searchsorted(above, np.arange(n_nodes + 1))
    coupled = tuple(np.unique(node_of[clique]) for clique in cliques)
    return NodeGraph(starts, n_nodes, ends, below, coupled)


def elimination_tree(graph: NodeGraph) -> Ints:
    """(n_eliminated,) parent of each node; -1 where none is eliminated after it."""
    n = len(graph.starts) - 1
    tails = [np.repeat(np.arange(graph.n_eliminated), np.diff(graph.indptr))]
    heads = [graph.indices]
    for clique in graph.cliques:  # a path through a clique has the elimination tree of the clique
        tails.append(clique[:-1])
        heads.append(clique[1:])
    low, high = np.concatenate(tails), np.concatenate(heads)
    edges = sp.csr_array((np.ones(low.size), (low, high)), shape=(n, n))
    weights = sp.csr_array((edges.indices + 1.0, edges.indices, edges.indptr), shape=(n, n))
    tree = sp.coo_array(minimum_spanning_tree(weights))
    order = np.argsort(tree.col, kind="stable")
    parent, top = [-1] * n, list(range(n))
    for i, k in zip(tree.row[order].tolist(), tree.col[order].tolist(), strict=True):
        r = i
        while top[r] != r:
            top[r] = top[top[r]]
            r = top[r]
        if r != k:
            parent[r] = k
            top[r] = k
    found = np.array(parent[: graph.n_eliminated], dtype=np.int64)
    return np.where(found < graph.n_eliminated, found, -1)


def _like_the_next(indptr: Ints, indices: Ints, n_eliminated: int) -> Bools:
    """(n,) whether the column of the next unknown has the rows of this one but for its diagonal."""
    n = len(indptr) - 1
    counts = np.diff(indptr)
    same = np.zeros(n, dtype=bool)
    if n_eliminated < 2:
        return same
    k = np.arange(n_eliminated - 1)
    last = np.minimum(indptr[k] + 1, len(indices) - 1)
    k = k[(counts[k] == counts[k + 1] + 1) & (indices[last] == k + 1)]
    if k.size:
        length = counts[k + 1]
        offsets = np.arange(length.sum()) - np.repeat(np.cumsum(length) - length, length)
        next_column = indices[np.repeat(indptr[k + 1], length) + offsets]
        equal = indices[np.repeat(indptr[k] + 1, length) + offsets] == next_column
        same[k] = np.logical_and.reduceat(equal, np.cumsum(length) - length)
    return same
