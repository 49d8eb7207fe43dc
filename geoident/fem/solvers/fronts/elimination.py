"""The numbers: fronts are put together, their pivots eliminated, and their rows passed on."""

from __future__ import annotations

import weakref
from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial
from itertools import pairwise

import numpy as np

from geoident.fem.solvers.direct import NotPositiveDefinite
from geoident.fem.solvers.fronts.blas import Dense, Kernels
from geoident.fem.solvers.fronts.layout import EliminationPlan, FrontLayout, Runs
from geoident.fem.solvers.fronts.memory import Memory
from geoident.fem.solvers.fronts.tasks import Work, run_tasks
from geoident.fem.solvers.threads import one_thread
from geoident.model.arrays import Floats, Ints

BLOCK = 1024
"""Rows of what one thread does at once, about."""

Strips = list[Dense]
"""Strips of a matrix, each with its columns and all rows from the first of them down."""


@dataclass(frozen=True)
class Eliminated:
    """A matrix of which the first unknowns are eliminated.

    Args:
        layout: where everything is.
        kernels: of its precision.
        panels: strips of the pivots of every front.
        kept: what is passed on by the roots, by number of the front.
    """

    layout: EliminationPlan
    kernels: Kernels
    panels: tuple[Strips, ...]
    kept: dict[int, Strips]

    def pivots(self) -> Floats:
        """(n_eliminated,) diagonal of D in L D L^T, in the layout's order."""
        found = np.empty(self.layout.n_eliminated)
        at = 0
        for strips in self.panels:
            for strip in strips:
                w = strip.shape[1]
                found[at : at + w] = strip.diagonal().astype(np.float64) ** 2
                at += w
        return found

    def forward(self, x: Dense) -> None:
        """X <- L^-1 X for rows (n, k) in the layout's order, in C order.

        Rows that are not eliminated get what they are changed by.
        """
        kernels = self.kernels
        for front, strips in zip(self.layout.fronts, self.panels, strict=True):
            for strip, a in zip(strips, front.starts, strict=False):
                w, at, inside = strip.shape[1], front.first + a, front.width - a
                mine = x[at : at + w]
                kernels.forward(strip[:w], mine)
                if len(strip) > w:
                    below = kernels.product(strip[w:], mine)
                    x[at + w : at + inside] -= below[: inside - w]
                    x[front.rows] -= below[inside - w :]

    def backward(self, x: Dense) -> None:
        """X <- L^-T X; rows that are not eliminated are given."""
        kernels = self.kernels
        for front, strips in zip(reversed(self.layout.fronts), reversed(self.panels), strict=True):
            rows = x[front.rows]
            starts = front.starts[: len(strips)]
            for strip, a in zip(reversed(strips), reversed(starts), strict=True):
                w, at = strip.shape[1], front.first + a
                mine = x[at : at + w]
                if len(strip) > w:
                    inside = x[at + w : front.first + front.width]
                    below = np.concatenate([inside, rows]) if len(inside) else rows
                    kernels.subtract_transposed(mine, strip[w:], below)
                kernels.backward(strip[:w], mine)


def eliminate(
    plan: EliminationPlan,
    kernels: Kernels,
    values: Dense,
    memory: Memory,
    outside: Sequence[Strips] = (),
) -> Eliminated:
    """Eliminate the unknowns of a matrix.

    Args:
        plan: where everything goes.
        kernels: of the precision.
        values: (nnz,) of the matrix.
        memory: to be used, and given back when the factor is not used any more.
        outside: update matrices that are added.

    Raises:
        NotPositiveDefinite: with the unknown whose pivot is not positive.
    """
    store = memory.take(plan.panel_size, kernels.dtype)
    stacks = [memory.take(size, kernels.dtype) for size in plan.stacks]
    places = _Places(kernels, store, stacks)
    panels: list[Strips] = []
    updates: dict[int, Strips] = {}
    try:
        _eliminate_all(plan, kernels, values, outside, places, panels, updates)
    except NotPositiveDefinite:
        memory.give(store, *stacks)
        raise
    memory.give(*stacks)
    found = Eliminated(plan, kernels, tuple(panels), updates)
    weakref.finalize(found, memory.give, store).atexit = False
    return found


def _eliminate_all(
    plan: EliminationPlan,
    kernels: Kernels,
    values: Dense,
    outside: Sequence[Strips],
    places: _Places,
    panels: list[Strips],
    updates: dict[int, Strips],
) -> None:
    """Eliminate front by front; fills in the panels, and what the roots pass on."""
    with one_thread():
        for number, front in enumerate(plan.fronts):
            strips = places.strips(front)
            for strip, (target, source) in zip(strips, front.entries, strict=False):
                strip.reshape(-1, order="F")[target] = values[source]
            for child, runs in front.children:
                pass_on(updates.pop(child), runs, strips, front)
            for clique, runs in front.cliques:
                pass_on(outside[clique], runs, strips, front)
            failed = _eliminate(kernels, strips, front)
            if failed is not None:
                raise NotPositiveDefinite(int(plan.order[front.first + failed]))
            panels.append(strips[: front.n_panels])
            if len(front.rows):
                updates[number] = strips[front.n_panels :]


class _Places:
    """Where fronts lie: the pivots one after another, update matrices on two stacks."""

    def __init__(self, kernels: Kernels, store: Dense, stacks: Sequence[Dense]) -> None:
        self._dtype, self._store, self._stacks = kernels.dtype, store, stacks
        self._at = 0

    def strips(self, front: FrontLayout) -> Strips:
        """The strips of a front, zero."""
        shapes = front.shapes()
        n = front.n_panels
        made = self._part(self._store, self._at, shapes[:n])
        self._at += sum(rows * columns for rows, columns in shapes[:n])
        if front.stack >= 0:
            return made + self._part(self._stacks[front.stack], front.offset, shapes[n:])
        return made + [np.zeros(shape, dtype=self._dtype, order="F") for shape in shapes[n:]]

    def _part(self, memory: Dense, at: int, shapes: Sequence[tuple[int, int]]) -> Strips:
        found = []
        for rows, columns in shapes:
            flat = memory[at : at + rows * columns]
            flat.fill(0.0)
            found.append(flat.reshape((rows, columns), order="F"))
            at += rows * columns
        return found


def _eliminate(kernels: Kernels, strips: Strips, front: FrontLayout) -> int | None:
    """Eliminate the pivots of a front; the place of one that is not positive, or None.

    What is large is divided into blocks of rows, always the same, each of which one thread does.
    """
    for j in range(front.n_panels):
        panel, a = strips[j], front.starts[j]
        w = panel.shape[1]
        good = kernels.factorize(panel[:w])
        if good < w:
            return a + good
        run_tasks(
            [partial(kernels.divide, panel[w + c : w + d], panel[:w]) for c, d in _blocks(panel, w)]
        )
        tasks: list[Work] = []
        for strip, b in zip(strips[j + 1 :], front.starts[j + 1 :], strict=False):
            v, at = strip.shape[1], b - a
            across, lower, below = panel[at : at + v], strip[v:], panel[at + v :]
            tasks.append(partial(kernels.subtract_square, strip[:v], across))
            tasks += [
                partial(kernels.subtract_product, lower[c:d], below[c:d], across)
                for c, d in _blocks(strip, v)
            ]
        run_tasks(tasks)
    return None


def _blocks(strip: Dense, width: int) -> list[tuple[int, int]]:
    """Blocks of the rows of a strip below its square."""
    length = strip.shape[0] - width
    n = -(-length // BLOCK)
    return [(k * length // n, (k + 1) * length // n) for k in range(n)]


def pass_on(update: Strips, runs: Runs, strips: Strips, front: FrontLayout) -> None:
    """Add an update matrix to a front: rows stand together in runs, so by rectangles.

    Args:
        update: its strips.
        runs: how its rows stand in the front.
        strips: of the front, changed in place.
        front: the front.
    """
    if not runs.ordered:
        _pass_on_unordered(update, runs.place, strips, front)
        return
    strip_of = (np.searchsorted(front.starts, [p for _, p, _ in runs.rows], "right") - 1).tolist()
    own, j = 0, 0
    for r, (a, p, n) in enumerate(runs.rows):
        while a - own >= update[j].shape[1]:
            own += update[j].shape[1]
            j += 1
        q = front.starts[strip_of[r]]
        goal = strips[strip_of[r]][:, p - q : p - q + n]
        given = update[j][:, a - own : a - own + n]
        for c, d, size in runs.rows[r:]:
            goal[d - q : d - q + size] += given[c - own : c - own + size]


def _pass_on_unordered(update: Strips, place: Ints, strips: Strips, front: FrontLayout) -> None:
    """Add an update matrix whose rows stand in a front in another order."""
    sequence = np.argsort(place)
    n = len(place)
    full = np.zeros((n, n), dtype=update[0].dtype)
    at = 0
    for strip in update:
        w = strip.shape[1]
        full[at:, at : at + w] = strip
        at += w
    lower = np.tril(full)
    whole = (lower + np.tril(lower, -1).T)[np.ix_(sequence, sequence)]
    goal = place[sequence]
    for strip, (q, end) in zip(strips, pairwise(front.starts), strict=True):
        mine = np.flatnonzero((goal >= q) & (goal < end))
        if len(mine):
            below = np.arange(mine[0], n)
            strip[np.ix_(goal[below] - q, goal[mine] - q)] += whole[np.ix_(below, mine)]
