"""Which unknowns are eliminated together: the assembly tree.

A *front* is a dense matrix: some unknowns that are eliminated in it, its pivots, and the unknowns
below them that they are coupled to, its rows. Fronts are found on the elimination tree of nodes:

- a subtree of few nodes is one front, a leaf;
- a chain, in which each node has one child beside leaves, is cut where rows come in;
- a front is merged with its parent where what this adds, operations on zeros, is less than what it
  costs to pass a matrix on.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field

import numpy as np

from geoident.fem.solvers.fronts.graph import NodeGraph, elimination_tree
from geoident.model.arrays import Ints

LEAF = 60
"""Nodes of a subtree that is eliminated as one front."""

CALL = 2.0e6
"""Operations that take as long as the calls for one front."""

PASS = 24.0
"""Operations that take as long as passing on one entry of a matrix."""


@dataclass(eq=False)
class Front:
    """A front, in nodes of the graph.

    Args:
        pivots: (w,) nodes that are eliminated.
        rows: (h,) nodes below that they are coupled to, ascending.
        width: unknowns of the pivots.
        height: unknowns of the rows.
        children: fronts that pass their matrices on to this one.
        cliques: matrices from outside that are passed on to this one, by number.
    """

    pivots: Ints
    rows: Ints
    width: int
    height: int
    children: list[Front] = field(default_factory=list)
    cliques: list[int] = field(default_factory=list)

    @property
    def flops(self) -> float:
        """Multiplications and additions of the elimination."""
        return front_flops(self.width, self.width + self.height)


def front_flops(width: float, order: float) -> float:
    """Operations to eliminate so many unknowns from a dense symmetric matrix: sum of columns^2."""
    rest = order - width
    return (order * (order + 1) * (2 * order + 1) - rest * (rest + 1) * (2 * rest + 1)) / 6.0


def flops_at_most(unknowns: int, *, plane: bool) -> float:
    """Operations that a factorization by nested dissection hardly exceeds.

    In cubes of quadratic elements they are 17 to 25 n^2, in squares up to 60 n^1.5.

    Args:
        unknowns: of the matrix.
        plane: whether its nodes lie in a plane.
    """
    return 150.0 * float(unknowns) ** 1.5 if plane else 25.0 * float(unknowns) ** 2


def entries_at_most(unknowns: int) -> int:
    """Entries that a factor by nested dissection hardly exceeds, what lasts first or not.

    In cubes of quadratic elements they are 22 to 26 n^4/3, in squares fewer.

    Args:
        unknowns: of the matrix.
    """
    return int(60.0 * float(unknowns) ** (4.0 / 3.0))


def assembly_tree(graph: NodeGraph) -> list[Front]:
    """The fronts that eliminate a matrix, children before their parents."""
    fronts = []
    for root in _Chains(graph).roots():
        for front in _postorder(root):
            _merge_children(front)
        fronts += _postorder(root)
    return fronts


def elimination_flops(
    indptr: Ints, indices: Ints, order: Ints, size: int, first: int
) -> tuple[float, float]:
    """Operations to eliminate the first nodes of a symmetric graph, and then the rest.

    Args:
        indptr: (n_nodes + 1,) starts of the rows of the graph.
        indices: (n_edges,) neighbours of each node.
        order: (n_nodes,) order of elimination.
        size: unknowns of each node.
        first: how many nodes are the first.
    """
    rank = np.empty(len(order), dtype=np.int64)
    rank[order] = np.arange(len(order))
    tail, head = rank[np.repeat(np.arange(len(order)), np.diff(indptr))], rank[indices]
    below = head > tail
    tail, head = tail[below], head[below]
    sequence = np.lexsort((head, tail))
    tail, head = tail[sequence], head[sequence]
    starts = np.arange(0, size * (len(order) + 1), size)
    ends = np.searchsorted(tail, np.arange(first + 1))
    fronts = assembly_tree(NodeGraph(starts, first, ends, head[: ends[-1]], ()))
    cliques = tuple(front.rows - first for front in _roots(fronts) if len(front.rows))
    more = tail >= first
    ends = np.searchsorted(tail[more], np.arange(first, len(order) + 1))
    rest = NodeGraph(
        starts[: len(order) - first + 1], len(order) - first, ends, head[more] - first, cliques
    )
    return sum(f.flops for f in fronts), sum(f.flops for f in assembly_tree(rest))


def _roots(fronts: Sequence[Front]) -> list[Front]:
    below = {id(child) for front in fronts for child in front.children}
    return [front for front in fronts if id(front) not in below]


class _Chains:
    """Makes fronts of leaves and chains of the elimination tree."""

    def __init__(self, graph: NodeGraph) -> None:
        self._graph, self._sizes = graph, graph.sizes
        parent = elimination_tree(graph)
        n = graph.n_eliminated
        self._parent: list[int] = parent.tolist()
        self._count = [1] * n
        self._children: list[list[int]] = [[] for _ in range(n)]
        for k, up in enumerate(self._parent):
            if up >= 0:
                self._count[up] += self._count[k]
                self._children[up].append(k)
        self._waiting: list[list[Front]] = [[] for _ in range(n)]
        self._cliques: list[list[int]] = [[] for _ in range(n)]
        for number, clique in enumerate(graph.cliques):
            if len(clique):
                self._cliques[int(clique[0])].append(number)

    def roots(self) -> list[Front]:
        """The roots of all fronts."""
        found = []
        for k, up in enumerate(self._parent):
            if not self._ends_a_front(k, up):
                continue
            made = self._chain(k) if self._count[k] > LEAF else self._leaf(k)
            if up >= 0:
                self._waiting[up].append(made)
            else:
                found.append(made)
        return found

    def _large_children(self, k: int) -> list[int]:
        return [child for child in self._children[k] if self._count[child] > LEAF]

    def _ends_a_front(self, k: int, up: int) -> bool:
        if up < 0:
            return True
        if self._count[k] <= LEAF:
            return self._count[up] > LEAF
        return len(self._large_children(up)) != 1

    def _leaf(self, top: int) -> Front:
        """A small subtree as one front."""
        nodes, pending = [], [top]
        while pending:
            k = pending.pop()
            nodes.append(k)
            pending += self._children[k]
        nodes.sort()
        cliques = [number for k in nodes for number in self._cliques[k]]
        parts = [self._graph.below(k) for k in nodes]
        found = np.concatenate([*parts, *(self._graph.cliques[c] for c in cliques)])
        return self._front(np.array(nodes), np.unique(found[found > top]), [], cliques)

    def _chain(self, end: int) -> Front:
        """The topmost of the fronts of the chain that ends at a node."""
        chain = [end]
        while len(below := self._large_children(chain[-1])) == 1:
            chain.append(below[0])
        chain.reverse()
        rows, first = self._appearances(chain)
        place = np.searchsorted(chain, rows)
        inside = np.minimum(place, len(chain) - 1)
        leaves = np.where(np.asarray(chain)[inside] == rows, inside, len(chain))
        widths = self._sizes[chain]
        seen = np.cumsum(np.bincount(first, weights=self._sizes[rows], minlength=len(chain)))
        piece: Front | None = None
        for a, b in _cuts(widths, seen):
            there = rows[(first < b) & (leaves >= b)]
            children = [front for k in chain[a:b] for front in self._waiting[k]]
            cliques = [number for k in chain[a:b] for number in self._cliques[k]]
            lower = [] if piece is None else [piece]
            piece = self._front(np.array(chain[a:b]), there, lower + children, cliques)
        assert piece is not None
        return piece

    def _appearances(self, chain: list[int]) -> tuple[Ints, Ints]:
        """Nodes (r,) in columns of a chain or in it, and from which place in it on (r,)."""
        parts, places = [np.array(chain[:1])], [0]
        for t, k in enumerate(chain):
            for found in (
                self._graph.below(k),
                *(front.rows for front in self._waiting[k]),
                *(self._graph.cliques[number] for number in self._cliques[k]),
            ):
                parts.append(found)
                places.append(t)
        place = np.repeat(places, [len(part) for part in parts])
        # Of equal nodes `unique` gives the first, which is that of the lowest place.
        rows, at = np.unique(np.concatenate(parts), return_index=True)
        return rows, place[at]

    def _front(self, pivots: Ints, rows: Ints, children: list[Front], cliques: list[int]) -> Front:
        width, height = int(self._sizes[pivots].sum()), int(self._sizes[rows].sum())
        return Front(pivots, rows, width, height, children, cliques)


def _cuts(widths: Ints, seen: Ints) -> Iterator[tuple[int, int]]:
    """Pieces of a chain that become fronts.

    Args:
        widths: (t,) unknowns of its nodes.
        seen: (t,) unknowns in any column so far, those of the chain included.
    """
    start, exact, done = 0, 0.0, 0.0
    until = np.cumsum(widths).tolist()
    sizes, reach = widths.tolist(), seen.tolist()
    for k, size in enumerate(sizes):
        own = front_flops(size, reach[k] - until[k] + size)
        merged = front_flops(until[k] - done, reach[k] - done)
        height = reach[k - 1] - until[k - 1] if k else 0.0
        if k > start and merged - exact - own > CALL + PASS * 0.5 * height**2:
            yield start, k
            start, exact, done = k, 0.0, until[k - 1]
        exact += own
    yield start, len(sizes)


def _merge_children(front: Front) -> None:
    """Merge a front with those of its children for which that is cheaper."""
    kept = []
    for child in front.children:
        width = front.width + child.width
        more = front_flops(width, width + front.height) - front.flops - child.flops
        if more > CALL + PASS * 0.5 * child.height**2:
            kept.append(child)
            continue
        front.pivots = np.concatenate([child.pivots, front.pivots])
        front.width = width
        front.cliques = child.cliques + front.cliques
        kept += child.children
    front.children = kept


def _postorder(root: Front) -> list[Front]:
    """A front and all below it, children first."""
    found, pending = [], [root]
    while pending:
        front = pending.pop()
        found.append(front)
        pending += front.children
    found.reverse()
    return found
