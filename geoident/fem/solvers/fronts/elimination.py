"""The numbers: fronts are put together, their pivots eliminated, and their rows passed on."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from geoident.fem.solvers.direct import NotPositiveDefinite
from geoident.fem.solvers.fronts.blas import Array, Kernels
from geoident.fem.solvers.fronts.layout import FrontLayout, Layout, Runs
from geoident.model.arrays import Floats

Strips = list[Array]
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

    layout: Layout
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

    def forward(self, x: Array) -> None:
        """X <- L^-1 X for rows (n, k) in the layout's order, in C order.

        Rows that are not eliminated get what they are changed by.
        """
        for front, strips in zip(self.layout.fronts, self.panels, strict=True):
            for strip, a in zip(strips, front.starts, strict=False):
                w = strip.shape[1]
                at = front.first + a
                mine = x[at : at + w]
                self.kernels.forward(strip[:w], mine)
                here = front.width - a - w
                if here:
                    x[at + w : at + w + here] -= strip[w : w + here] @ mine
                if len(front.rows):
                    x[front.rows] -= strip[w + here :] @ mine

    def backward(self, x: Array) -> None:
        """X <- L^-T X; rows that are not eliminated are given."""
        for front, strips in zip(reversed(self.layout.fronts), reversed(self.panels), strict=True):
            below = x[front.rows]
            for strip, a in zip(
                reversed(strips), reversed(front.starts[: len(strips)]), strict=True
            ):
                w = strip.shape[1]
                at = front.first + a
                mine = x[at : at + w]
                here = front.width - a - w
                if here:
                    mine -= strip[w : w + here].T @ x[at + w : at + w + here]
                if len(below):
                    mine -= strip[w + here :].T @ below
                self.kernels.backward(strip[:w], mine)


def eliminate(
    plan: Layout, kernels: Kernels, values: Array, outside: Sequence[Strips] = ()
) -> Eliminated:
    """Eliminate the unknowns of a matrix.

    Args:
        plan: where everything goes.
        kernels: of the precision.
        values: (nnz,) of the matrix.
        outside: update matrices that are added.

    Raises:
        NotPositiveDefinite: with the unknown whose pivot is not positive.
    """
    dtype = kernels.dtype
    store = np.empty(plan.panel_size, dtype=dtype)
    stacks = [np.empty(size, dtype=dtype) for size in plan.stacks]
    panels: list[Strips] = []
    updates: dict[int, Strips] = {}
    at = 0
    for number, front in enumerate(plan.fronts):
        shapes = front.shapes()
        strips: Strips = []
        for shape, (target, source) in zip(shapes, front.entries, strict=False):
            size = shape[0] * shape[1]
            flat = store[at : at + size]
            flat.fill(0.0)
            flat[target] = values[source]
            strips.append(flat.reshape(shape, order="F"))
            at += size
        offset = front.offset
        memory = stacks[front.stack] if front.stack >= 0 else None
        for shape in shapes[front.n_panels :]:
            size = shape[0] * shape[1]
            if memory is None:
                strips.append(np.zeros(shape, dtype=dtype, order="F"))
            else:
                flat = memory[offset : offset + size]
                flat.fill(0.0)
                strips.append(flat.reshape(shape, order="F"))
                offset += size
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
    return Eliminated(plan, kernels, tuple(panels), updates)


def _eliminate(kernels: Kernels, strips: Strips, front: FrontLayout) -> int | None:
    """Eliminate the pivots of a front; the place of one that is not positive, or None."""
    for j in range(front.n_panels):
        panel, a = strips[j], front.starts[j]
        w = panel.shape[1]
        good = kernels.factorize(panel[:w])
        if good < w:
            return a + good
        kernels.divide(panel[w:], panel[:w])
        for strip, b in zip(strips[j + 1 :], front.starts[j + 1 :], strict=False):
            v, at = strip.shape[1], b - a
            across = panel[at : at + v]
            kernels.subtract_square(strip[:v], across)
            kernels.subtract_product(strip[v:], panel[at + v :], across)
    return None


def pass_on(update: Strips, runs: Runs, strips: Strips, front: FrontLayout) -> None:
    """Add an update matrix to a front."""
    starts = front.starts
    strip_of = np.searchsorted(starts, [p for _, p, _ in runs.rows], side="right") - 1
    own = 0
    j, source = 0, update[0]
    for r, (a, p, n) in enumerate(runs.rows):
        while a - own >= source.shape[1]:
            own += source.shape[1]
            j += 1
            source = update[j]
        i = int(strip_of[r])
        q = starts[i]
        goal = strips[i][:, p - q : p - q + n]
        given = source[:, a - own : a - own + n]
        for c, d, size in runs.rows[r:]:
            goal[d - q : d - q + size] += given[c - own : c - own + size]
