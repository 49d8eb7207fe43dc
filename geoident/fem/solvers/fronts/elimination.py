"""The numbers: fronts are put together, their pivots eliminated, and their rows passed on."""

from __future__ import annotations

import weakref
from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial
from itertools import pairwise

import numpy as np

from geoident.fem.solvers.direct import NotPositiveDefinite
from geoident.fem.solvers.fronts.blas import Dense, Kernels, Panel
from geoident.fem.solvers.fronts.layout import EliminationPlan, FrontLayout, Runs
from geoident.fem.solvers.fronts.memory import Memory
from geoident.fem.solvers.fronts.tasks import Runner, Work, run_alone, run_tasks
from geoident.fem.solvers.threads import one_thread
from geoident.model.arrays import Floats, Ints

BLOCK = 1024
"""Rows of what one thread does at once, about."""

ZEROS = 1 << 21
"""Numbers that one thread sets to zero at once."""

Strips = list[Dense]
"""Strips of a matrix, each with its columns and all rows from the first of them down."""


@dataclass(frozen=True)
class Eliminated:
    """A matrix of which the first unknowns are eliminated.

    Args:
        layout: where everything is.
        kernels: of its precision.
        panels: those of the pivots of every front.
        kept: what is passed on by the roots, by number of the front.
    """

    layout: EliminationPlan
    kernels: Kernels
    panels: tuple[Sequence[Panel], ...]
    kept: dict[int, Strips]

    def pivots(self) -> Floats:
        """(n_eliminated,) diagonal of D in L D L^T, in the layout's order."""
        found = np.empty(self.layout.n_eliminated)
        at = 0
        for panels in self.panels:
            for panel in panels:
                w = panel.strip.shape[1]
                found[at : at + w] = panel.strip.diagonal().astype(np.float64) ** 2
                at += w
        return found

    def forward(self, x: Dense, run: Runner = run_alone) -> None:
        """X <- L^-1 X for rows (n, k) in the layout's order, in C order.

        Rows that are not eliminated get what they are changed by.

        Args:
            x: (n, k), changed in place.
            run: does the tasks.
        """
        plan = self.layout
        found: list[Dense] = [x[:0]] * len(plan.branches)
        run([partial(self._forward_branch, b, x, found) for b in range(len(plan.branches))])
        for branch, changed in zip(plan.of_branches, found, strict=True):
            x[branch.outside] += changed
        for k in plan.rest.tolist():
            self._forward(k, x, plan.fronts[k].first, plan.fronts[k].rows)

    def _forward_branch(self, number: int, x: Dense, found: list[Dense]) -> None:
        branch = self.layout.of_branches[number]
        first, w = branch.first, branch.width
        z = np.zeros((w + len(branch.outside), x.shape[1]), dtype=x.dtype)
        z[:w] = x[first : first + w]
        for k, rows in zip(self.layout.branches[number], branch.rows, strict=True):
            self._forward(k, z, self.layout.fronts[k].first - first, rows)
        x[first : first + w] = z[:w]
        found[number] = z[w:]

    def _forward(self, number: int, x: Dense, first: int, rows: Ints) -> None:
        """One front, whose pivots begin at a row of x."""
        kernels, front = self.kernels, self.layout.fronts[number]
        for panel, a in zip(self.panels[number], front.starts, strict=False):
            w, at, inside = panel.strip.shape[1], first + a, front.width - a
            below = kernels.forward(panel, x[at : at + w])
            x[at + w : at + inside] += below[: inside - w]
            x[rows] += below[inside - w :]

    def backward(self, x: Dense, run: Runner = run_alone) -> None:
        """X <- L^-T X; rows that are not eliminated are given.

        Args:
            x: (n, k), changed in place.
            run: does the tasks.
        """
        plan = self.layout
        for k in plan.rest[::-1].tolist():
            self._backward(k, x, plan.fronts[k].first, plan.fronts[k].rows)
        run([partial(self._backward_branch, b, x) for b in range(len(plan.branches))])

    def _backward_branch(self, number: int, x: Dense) -> None:
        branch = self.layout.of_branches[number]
        first, w = branch.first, branch.width
        z = np.concatenate([x[first : first + w], x[branch.outside]])
        fronts = zip(reversed(self.layout.branches[number]), reversed(branch.rows), strict=True)
        for k, rows in fronts:
            self._backward(k, z, self.layout.fronts[k].first - first, rows)
        x[first : first + w] = z[:w]

    def _backward(self, number: int, x: Dense, first: int, rows: Ints) -> None:
        kernels, front, panels = self.kernels, self.layout.fronts[number], self.panels[number]
        below = x[rows]
        starts = front.starts[: len(panels)]
        for panel, a in zip(reversed(panels), reversed(starts), strict=True):
            w, at = panel.strip.shape[1], first + a
            inside = x[at + w : first + front.width]
            given = np.concatenate([inside, below]) if len(inside) else below
            kernels.backward(panel, x[at : at + w], given)


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
    stacked = memory.take(sum(plan.stacks), kernels.dtype)
    stacks = np.split(stacked[: sum(plan.stacks)], np.cumsum(plan.stacks)[:-1])
    work = _Elimination(plan, kernels, values, outside, _Places(plan, kernels, store, stacks))
    try:
        work.run()
    except NotPositiveDefinite:
        memory.give(store, stacked)
        raise
    memory.give(stacked)
    panels = tuple([Panel(strip) for strip in strips] for strips in work.panels)
    found = Eliminated(plan, kernels, panels, work.updates)
    weakref.finalize(found, memory.give, store).atexit = False
    return found


class _Elimination:
    """The elimination of a matrix, front by front: first all branches, then the rest.

    Args:
        plan: where everything goes.
        kernels: of the precision.
        values: (nnz,) of the matrix.
        outside: update matrices that are added.
        places: of the fronts.

    Attributes:
        panels: strips of the pivots of every front.
        updates: what is passed on, by front, until it is.
    """

    def __init__(
        self, plan: EliminationPlan, kernels: Kernels, values: Dense, outside: Sequence[Strips],
        places: _Places,
    ) -> None:  # fmt: skip
        self._plan, self._kernels, self._values = plan, kernels, values
        self._outside, self._places = outside, places
        self.panels: list[Strips] = [[]] * len(plan.fronts)
        self.updates: dict[int, Strips] = {}

    def run(self) -> None:
        """Eliminate all.

        Raises:
            NotPositiveDefinite: with the unknown.
        """
        plan = self._plan
        with one_thread():
            run_tasks([partial(self._some, branch, run_alone) for branch in plan.branches])
            self._some(plan.rest.tolist(), run_tasks)

    def _some(self, fronts: Sequence[int], run: Runner) -> None:
        plan, kernels, values = self._plan, self._kernels, self._values
        for number in fronts:
            front = plan.fronts[number]
            strips = self._places.strips(number, run)
            for strip, (target, source) in zip(strips, front.entries, strict=False):
                strip.reshape(-1, order="F")[target] = values[source]
            for child, runs in front.children:
                pass_on(self.updates.pop(child), runs, strips, front)
            for clique, runs in front.cliques:
                pass_on(self._outside[clique], runs, strips, front)
            failed = _eliminate(kernels, strips, front, run)
            if failed is not None:
                raise NotPositiveDefinite(int(plan.order[front.first + failed]))
            self.panels[number] = strips[: front.n_panels]
            if len(front.rows):
                self.updates[number] = strips[front.n_panels :]


class _Places:
    """Where fronts lie: the pivots one after another, update matrices on stacks."""

    def __init__(
        self, plan: EliminationPlan, kernels: Kernels, store: Dense, stacks: Sequence[Dense]
    ) -> None:
        self._plan, self._dtype, self._store, self._stacks = plan, kernels.dtype, store, stacks

    def strips(self, number: int, run: Runner) -> Strips:
        """The strips of a front, zero."""
        front = self._plan.fronts[number]
        shapes = front.shapes()
        n = front.n_panels
        made = self._part(self._store, self._plan.panel_offsets[number], shapes[:n], run)
        if front.stack >= 0:
            return made + self._part(self._stacks[front.stack], front.offset, shapes[n:], run)
        return made + [np.zeros(shape, dtype=self._dtype, order="F") for shape in shapes[n:]]

    @staticmethod
    def _part(memory: Dense, at: int, shapes: Sequence[tuple[int, int]], run: Runner) -> Strips:
        found, end = [], at + sum(rows * columns for rows, columns in shapes)
        run([partial(memory[a : min(a + ZEROS, end)].fill, 0.0) for a in range(at, end, ZEROS)])
        for rows, columns in shapes:
            flat = memory[at : at + rows * columns]
            found.append(flat.reshape((rows, columns), order="F"))
            at += rows * columns
        return found


def _eliminate(kernels: Kernels, strips: Strips, front: FrontLayout, run: Runner) -> int | None:
    """Eliminate the pivots of a front; the place of one that is not positive, or None.

    What is large is divided into blocks of rows, always the same, each of which is a task.
    """
    for j in range(front.n_panels):
        panel, a = strips[j], front.starts[j]
        w = panel.shape[1]
        good = kernels.factorize(panel[:w])
        if good < w:
            return a + good
        run(
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
        run(tasks)
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
