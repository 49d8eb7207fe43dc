"""Where everything goes in a factorization by fronts, found once for a pattern.

The unknowns are numbered anew, front by front, children first. A front is stored as *strips*: some
columns with all rows from the first of them down, so that of a large triangle little more than
half is stored. The strips of the pivots stay as part of the factor, those of the rows (the update
matrix) are passed on to the parent and lie on one of two stacks, by the depth of the front: those
of the children are always uppermost on the one when the front goes on the other.

Within a front the nodes are put in an order in which what its descendants touch stands together, so
that matrices are passed on as a few rectangles.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise

import numpy as np

from geoident.fem.solvers.fronts.graph import NodeGraph, node_graph
from geoident.fem.solvers.fronts.tree import Front, assembly_tree
from geoident.model.arrays import Ints

BRANCHED = 2.0e9
"""Operations from which on parts of the tree are worked on side by side."""

MOST_BRANCHES = 8

HEAVY = 0.15
"""Part of all operations from which on a branch is divided further."""

LIGHT = 0.02
"""Part of all operations below which a branch is left to whoever does the rest."""

STRIP = 512
"""Columns of a strip at most, about."""


@dataclass(frozen=True)
class Runs:
    """How the rows of an update matrix stand in a front that it is passed on to.

    Args:
        rows: per run first row in the matrix, first row in the front, number of rows; no run
            crosses a border of strips of either.
        ordered: whether rows stand in the front in the order of the matrix.
        place: (h,) place in the front of each row.
    """

    rows: tuple[tuple[int, int, int], ...]
    ordered: bool
    place: Ints


@dataclass(frozen=True)
class FrontLayout:
    """One front.

    Args:
        first: its first pivot.
        width: number s of its pivots.
        rows: (h,) the unknowns below them, ascending.
        starts: first columns of its strips, and its order s + h at last.
        n_panels: number of strips of pivots; the others are of the update matrix.
        children: fronts by number, each with how its rows stand in this one.
        cliques: matrices from outside by number, likewise.
        entries: per strip of pivots places in it (columns one after another), and places in the
            values of the matrix.
        stack: on which stack the update matrix lies, or -1 if it is kept.
        offset: where on the stack it begins.
    """

    first: int
    width: int
    rows: Ints
    starts: tuple[int, ...]
    n_panels: int
    children: tuple[tuple[int, Runs], ...]
    cliques: tuple[tuple[int, Runs], ...]
    entries: tuple[tuple[Ints, Ints], ...]
    stack: int
    offset: int

    @property
    def order(self) -> int:
        """Number of rows and columns of the whole front."""
        return self.width + len(self.rows)

    def shapes(self) -> list[tuple[int, int]]:
        """Rows and columns of its strips."""
        m = self.order
        return [(m - a, b - a) for a, b in zip(self.starts, self.starts[1:], strict=False)]


@dataclass(frozen=True)
class EliminationPlan:
    """All fronts of an elimination.

    Args:
        fronts: children before their parents.
        order: (n,) unknowns of the matrix in the new numbers, those that stay at the end.
        n_eliminated: number of unknowns that are eliminated.
        stacks: numbers that each stack takes, two for every branch and two for the rest.
        panel_size: numbers in the strips of all pivots.
        flops: multiplications and additions of the elimination.
        branches: subtrees of fronts that have nothing to do with each other; the other fronts come
            after all of them.
    """

    fronts: tuple[FrontLayout, ...]
    order: Ints
    n_eliminated: int
    stacks: tuple[int, ...]
    panel_size: int
    flops: float
    branches: tuple[range, ...] = ()

    @property
    def roots(self) -> list[int]:
        """Fronts whose update matrix is kept, by number."""
        return [k for k, front in enumerate(self.fronts) if front.stack < 0 and len(front.rows)]

    @cached_property
    def rest(self) -> Ints:
        """(k,) fronts that stand in no branch, by number."""
        return _rest(self.branches, len(self.fronts))

    @cached_property
    def panel_offsets(self) -> list[int]:
        """Where the pivots of each front begin."""
        sizes = [sum(r * c for r, c in f.shapes()[: f.n_panels]) for f in self.fronts]
        return [0, *np.cumsum(sizes).tolist()]

    @cached_property
    def of_branches(self) -> tuple[BranchRows, ...]:
        """The rows of each branch."""
        return tuple(_branch_rows(self.fronts, branch) for branch in self.branches)


@dataclass(frozen=True)
class BranchRows:
    """The rows that a branch has to do with, and its own numbers for them: first its pivots.

    Args:
        first: its first pivot.
        width: number of its pivots.
        outside: (h,) rows that are no pivots of it, ascending.
        rows: of every front of it, (h_k,) the rows below its pivots in these numbers.
    """

    first: int
    width: int
    outside: Ints
    rows: tuple[Ints, ...]


def _branch_rows(fronts: Sequence[FrontLayout], branch: range) -> BranchRows:
    first, top = fronts[branch[0]].first, fronts[branch[-1]]
    width, outside = top.first + top.width - first, top.rows
    rows = []
    for k in branch:
        mine = fronts[k].rows
        place = width + np.searchsorted(outside, mine)
        rows.append(np.where(mine < first + width, mine - first, place))
    return BranchRows(first, width, outside, tuple(rows))


def _rest(branches: Sequence[range], n: int) -> Ints:
    inside = np.zeros(n, dtype=bool)
    for branch in branches:
        inside[branch.start : branch.stop] = True
    return np.flatnonzero(~inside)


def _branches(parent: Sequence[int], flops: Sequence[float]) -> tuple[range, ...]:
    """Subtrees of about equal work, whatever the number of cores; none where all work is little.

    Args:
        parent: of every front, -1 for none; children come before, those of a subtree together.
        flops: of every front.
    """
    n = len(flops)
    work, size = list(flops), [1] * n
    children: list[list[int]] = [[] for _ in range(n)]
    chosen = []
    for k, up in enumerate(parent):
        if up < 0:
            chosen.append(k)
        else:
            work[up] += work[k]
            size[up] += size[k]
            children[up].append(k)
    total = sum(flops)
    if total < BRANCHED:
        return ()
    while chosen and len(chosen) < MOST_BRANCHES:
        largest = max(chosen, key=work.__getitem__)
        if work[largest] < HEAVY * total or not children[largest]:
            break
        chosen.remove(largest)
        chosen += [k for k in children[largest] if work[k] >= LIGHT * total]
    chosen = sorted(k for k in chosen if work[k] >= LIGHT * total)
    return tuple(range(k - size[k] + 1, k + 1) for k in chosen)


def layout(
    indptr: Ints,
    indices: Ints,
    n_eliminated: int,
    cliques: Sequence[Ints] = (),
    *,
    keep_order: bool = False,
    known: tuple[NodeGraph, list[Front]] | None = None,
) -> EliminationPlan:
    """Plan the elimination of the first unknowns of a matrix.

    Args:
        indptr: (n + 1,) starts of the columns of the lower triangle; those of unknowns that are
            not eliminated are empty.
        indices: (nnz,) rows, ascending, the diagonal first.
        n_eliminated: number of unknowns to be eliminated.
        cliques: (h,) each, unknowns of matrices that are added from outside, each ascending.
        keep_order: leave pivots of a front in their order, which matrices from outside have.
        known: graph and fronts of the matrix; None to find them.
    """
    graph = known[0] if known else node_graph(indptr, indices, n_eliminated, cliques)
    fronts = known[1] if known else assembly_tree(graph)
    parent = _parents(fronts)
    if keep_order:
        for front in fronts:
            front.pivots = np.sort(front.pivots)
    else:
        _order_pivots(fronts, parent)
    nodes = _nodes_in_order(graph, fronts)
    sizes = graph.sizes[nodes]
    offsets = np.arange(int(sizes.sum())) - np.repeat(np.cumsum(sizes) - sizes, sizes)
    order = np.repeat(graph.starts[nodes], sizes) + offsets
    rank = np.empty(len(order), dtype=np.int64)
    rank[order] = np.arange(len(order))
    return _Planner(graph, fronts, parent, order, rank).plan(indptr, indices, cliques)


def _parents(fronts: Sequence[Front]) -> list[int]:
    number = {id(front): k for k, front in enumerate(fronts)}
    parent = [-1] * len(fronts)
    for k, front in enumerate(fronts):
        for child in front.children:
            parent[number[id(child)]] = k
    return parent


def _nodes_in_order(graph: NodeGraph, fronts: Sequence[Front]) -> Ints:
    stay = np.arange(graph.n_eliminated, len(graph.starts) - 1)
    return np.concatenate([*(front.pivots for front in fronts), stay]).astype(np.int64)


def _order_pivots(fronts: Sequence[Front], parent: Sequence[int]) -> None:
    """Put the pivots of every front in an order in which what descendants touch stands together.

    The order of a front is refined by its descendants, the nearest first: each cuts the classes
    that it touches in part, and its part of the first is put at the end of it, of the others at
    the beginning.
    """
    n_nodes = 1 + max((int(front.pivots.max()) for front in fronts), default=-1)
    home = np.empty(n_nodes, dtype=np.int64)
    place = np.empty(n_nodes, dtype=np.int64)
    keys = []
    for k, front in enumerate(fronts):
        front.pivots = np.sort(front.pivots)
        home[front.pivots] = k
        place[front.pivots] = np.arange(len(front.pivots))
        keys.append(np.zeros(len(front.pivots), dtype=np.int64))
    for front in reversed(fronts):
        rows = front.rows[front.rows < n_nodes]
        homes = home[rows]
        cuts = np.flatnonzero(np.diff(homes)) + 1
        for part in np.split(rows, cuts) if len(rows) else []:
            k = int(home[part[0]])
            if len(part) < len(keys[k]):
                keys[k] = _refined(keys[k], place[part])
    for front, key in zip(fronts, keys, strict=True):
        front.pivots = front.pivots[np.argsort(key, kind="stable")]


def _refined(key: Ints, touched: Ints) -> Ints:
    """Classes (p,) 0, 1, ... cut by the places that are touched."""
    inside = np.zeros(len(key), dtype=bool)
    inside[touched] = True
    lowest = key[touched].min()
    # In the first class that is touched the touched part comes last, in the others first.
    second = np.where(key == lowest, inside, ~inside)
    doubled = 2 * key + second
    present = np.zeros(2 * int(key.max()) + 2, dtype=np.int64)
    present[doubled] = 1
    return np.asarray((np.cumsum(present) - 1)[doubled])


class _Planner:
    """Fills in the fronts, which are in their final order."""

    def __init__(
        self, graph: NodeGraph, fronts: Sequence[Front], parent: Sequence[int], order: Ints,
        rank: Ints,
    ) -> None:  # fmt: skip
        self._graph, self._fronts, self._parent = graph, fronts, parent
        self._order, self._rank = order, rank

    def plan(self, indptr: Ints, indices: Ints, cliques: Sequence[Ints]) -> EliminationPlan:
        """All fronts."""
        widths = [front.width for front in self._fronts]
        firsts = (np.cumsum(widths) - widths).tolist()
        n_eliminated = sum(widths)
        rows = [self._rows(front) for front in self._fronts]
        starts = [_strips(f.width, len(r)) for f, r in zip(self._fronts, rows, strict=True)]
        passes: list[list[tuple[int, Runs]]] = [[] for _ in self._fronts]
        for k, up in enumerate(self._parent):
            if up >= 0:
                own = [s - widths[k] for s in starts[k][0] if s >= widths[k]]
                passes[up].append(
                    (k, _runs(rows[k], firsts[up], widths[up], rows[up], own, starts[up][0]))
                )
        entries = self._entries(indptr, indices, firsts, widths, rows, starts)
        branches = _branches(self._parent, [front.flops for front in self._fronts])
        stacks, places = self._stacks(starts, widths, branches)
        made = []
        for k, front in enumerate(self._fronts):
            outside = []
            for number in front.cliques:
                ranks = self._rank[cliques[number]]
                border = _strips(0, len(ranks))[0]
                outside.append(
                    (number, _runs(ranks, firsts[k], widths[k], rows[k], border, starts[k][0]))
                )
            made.append(
                FrontLayout(
                    firsts[k], widths[k], rows[k], tuple(starts[k][0]), starts[k][1],
                    tuple(passes[k]), tuple(outside), entries[k], *places[k],
                )
            )  # fmt: skip
        size = sum(r * c for f in made for r, c in f.shapes()[: f.n_panels])
        flops = sum(front.flops for front in self._fronts)
        return EliminationPlan(
            tuple(made), self._order, n_eliminated, stacks, size, flops, branches
        )

    def _rows(self, front: Front) -> Ints:
        """(h,) rows of a front in new numbers, ascending."""
        starts, sizes = self._graph.starts[front.rows], self._graph.sizes[front.rows]
        offsets = np.arange(int(sizes.sum())) - np.repeat(np.cumsum(sizes) - sizes, sizes)
        return np.sort(self._rank[np.repeat(starts, sizes) + offsets])

    def _entries(
        self, indptr: Ints, indices: Ints, firsts: list[int], widths: list[int],
        rows: list[Ints], starts: list[tuple[list[int], int]],
    ) -> list[tuple[tuple[Ints, Ints], ...]]:  # fmt: skip
        """Per front and strip of pivots where the entries of the matrix go."""
        n = len(indptr) - 1
        column = self._rank[np.repeat(np.arange(n), np.diff(indptr))]
        row = self._rank[indices]
        column, row = np.minimum(column, row), np.maximum(column, row)
        sequence = np.argsort(column, kind="stable")
        column, row = column[sequence], row[sequence]
        found = []
        for k, first in enumerate(firsts):
            border, n_panels = starts[k]
            width, order = widths[k], border[-1]
            strips = []
            for a, b in pairwise(border[: n_panels + 1]):
                low, high = np.searchsorted(column, [first + a, first + b])
                across, down = column[low:high] - first, row[low:high]
                inside = down < first + width
                down = np.where(inside, down - first, width + np.searchsorted(rows[k], down))
                target = (across - a) * (order - a) + down - a
                strips.append((_short(target), _short(sequence[low:high])))
            found.append(tuple(strips))
        return found

    def _stacks(
        self, starts: list[tuple[list[int], int]], widths: list[int], branches: Sequence[range]
    ) -> tuple[tuple[int, ...], list[tuple[int, int]]]:
        """Size of all stacks, and for each front its stack and its place there."""
        n = len(self._fronts)
        sizes: list[int] = []
        places = [(-1, 0)] * n
        for group in (*branches, _rest(branches, n).tolist()):
            for k, (stack, offset) in zip(group, self._stack(starts, group, sizes), strict=True):
                places[k] = stack, offset
        return tuple(sizes), places

    def _stack(
        self, starts: list[tuple[list[int], int]], group: Sequence[int], sizes: list[int]
    ) -> list[tuple[int, int]]:
        """For each front of a group its stack and its place there.

        Args:
            starts: of all fronts, first columns of the strips, and number of strips of pivots.
            group: fronts, children first.
            sizes: of the stacks before; those of two more are added.
        """
        n = len(self._fronts)
        depth = [0] * n
        for k in range(n - 1, -1, -1):
            if self._parent[k] >= 0:
                depth[k] = depth[self._parent[k]] + 1
        top, most = [0, 0], [0, 0]
        places = []
        size = [0] * n
        inside = set(group)
        children: list[list[int]] = [[] for _ in range(n)]
        for k in group:
            if self._parent[k] in inside:
                children[self._parent[k]].append(k)
        for k in group:
            border, n_panels = starts[k]
            m = border[-1]
            size[k] = sum(
                (m - a) * (b - a)
                for a, b in zip(border[n_panels:], border[n_panels + 1 :], strict=False)
            )
            mine = depth[k] % 2
            if self._parent[k] < 0:
                places.append((-1, 0))
            else:
                places.append((len(sizes) + mine, top[mine]))
                top[mine] += size[k]
                most[mine] = max(most[mine], top[mine])
            top[1 - mine] -= sum(size[child] for child in children[k])
        sizes += most
        return places


def _short(places: Ints) -> Ints:
    """Places as integers of 32 bits where these are long enough: half the memory."""
    largest = int(places.max(initial=0))
    return places.astype(np.int32) if largest < np.iinfo(np.int32).max else places


def _strips(width: int, height: int) -> tuple[list[int], int]:
    """First columns of the strips of a front, its order at last; number of strips of pivots."""
    panels = _even(width)
    updates = _even(height)
    return [*panels, *(width + a for a in updates), width + height], len(panels)


def _even(length: int) -> list[int]:
    """Starts of parts of about the same length."""
    n = -(-length // STRIP)
    return [k * length // n for k in range(n)]


def _runs(
    ranks: Ints, first: int, width: int, rows: Ints, own: Sequence[int], starts: Sequence[int]
) -> Runs:
    """How rows stand in a front.

    Args:
        ranks: (h,) rows of the matrix that is passed on.
        first: first pivot of the front.
        width: number of its pivots.
        rows: its rows.
        own: first columns of the strips of the matrix.
        starts: first columns of the strips of the front.
    """
    inside = ranks < first + width
    place = np.where(inside, ranks - first, width + np.searchsorted(rows, ranks))
    cut = np.ones(len(place), dtype=bool)
    cut[1:] = np.diff(place) != 1
    cut |= np.isin(place, starts)
    cut[[s for s in own if s < len(place)]] = True
    at = np.flatnonzero(cut)
    length = np.diff(np.append(at, len(place)))
    runs = tuple(zip(at.tolist(), place[at].tolist(), length.tolist(), strict=True))
    return Runs(runs, bool((np.diff(place) > 0).all()), place)
