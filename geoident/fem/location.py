"""Which element holds a point, and the shape functions there.

A point on the border of several elements has several *sites*; which of them can be used depends on
which elements are present, so all are returned, the best first. A point just outside a curved wall
that straight elements cut off is taken by the nearest element, up to `REACH` of its size.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass

import numpy as np

from geoident.fem.elements import ReferenceElement, reference_element
from geoident.fem.near import points_in_boxes
from geoident.model.arrays import Bools, Floats, Ints
from geoident.model.mesh import ElementBlock, Mesh, spans

REACH = 0.1
"""How far outside an element a point may lie to be taken by it, in parts of its size."""

_NEWTON_STEPS = 25
"""Five are usual; folded elements, where Newton's method has no end, are given up after these."""

_MET = 1e-13
"""Error of a mapped point, in sizes of the element, that is rounding."""

_AT_LAST = 1e-9
"""The same after the last step, where rounding of large coordinates keeps it from being smaller."""

_FAR = 10.0
"""Reference coordinates beyond which Newton's method gives up."""


@dataclass(frozen=True)
class Site:
    """A point seen from one element.

    Args:
        element: element index.
        nodes: (n_a,) nodes of the element.
        shapes: (n_a,) shape functions at the point.
        gradients: (n_a, dim) their derivatives by the coordinates there, 1/m.
        outside: how far outside the element the point lies, in parts of its size; <= 0 inside.
    """

    element: int
    nodes: Ints
    shapes: Floats
    gradients: Floats
    outside: float


class Locator:
    """Finds points in a mesh; the boxes around the elements are made once."""

    def __init__(self, mesh: Mesh) -> None:
        self._mesh = mesh
        self._boxes = [_boxes(mesh, block) for block in mesh.blocks]
        self._known: dict[tuple[float, ...], tuple[Site, ...]] = {}

    def sites(self, point: tuple[float, ...]) -> tuple[Site, ...]:
        """The elements that hold a point (dim,), m, the best first; empty if there is none."""
        if point not in self._known:  # a place is asked for by each of its channels
            self.find((point,))
        return self._known[point]

    def find(self, points: Iterable[tuple[float, ...]]) -> None:
        """Find several points (dim,), m, together, before `sites` is asked for them."""
        new = [point for point in dict.fromkeys(points) if point not in self._known]
        x = np.array(new, dtype=np.float64).reshape(len(new), self._mesh.dim)
        found: list[list[Site]] = [[] for _ in new]
        for (block, span), (low, high) in zip(spans(self._mesh.blocks), self._boxes, strict=True):
            at, row = points_in_boxes(x, low, high)
            for k, site in _sites(self._mesh, block, span.start, row, x[at]):
                found[at[k]].append(site)
        for point, sites in zip(new, found, strict=True):
            sites.sort(key=lambda site: (max(site.outside, 1e-6), site.element))
            self._known[point] = tuple(sites)

    def best(self, point: tuple[float, ...], present: Bools) -> Site | None:
        """The best of the elements that hold a point (dim,), m, and are present (n_elements,)."""
        return next((site for site in self.sites(point) if present[site.element]), None)


def _boxes(mesh: Mesh, block: ElementBlock) -> tuple[Floats, Floats]:
    corners = mesh.points[block.nodes]
    low, high = corners.min(axis=1), corners.max(axis=1)
    margin = 2 * REACH * (high - low).max(axis=1, keepdims=True)
    return low - margin, high + margin


def _sites(
    mesh: Mesh, block: ElementBlock, first: int, rows: Ints, x: Floats
) -> Iterator[tuple[int, Site]]:
    """Which of some points lie in elements of a block: their numbers, and the sites there.

    Args:
        mesh: the mesh.
        block: of one kind.
        first: index of its first element.
        rows: (n,) of the elements in the block.
        x: (n, dim) the point that is looked for in each, m.
    """
    reference = reference_element(block.kind)
    corners = mesh.points[block.nodes[rows]]
    xi = reference_coordinates(reference, corners, x)
    outside = (reference.walls[:, :-1] @ xi[..., None])[..., 0] + reference.walls[:, -1]
    outside = outside.max(axis=1, initial=-np.inf)
    within = np.flatnonzero(outside <= REACH)  # not where it is NaN
    xi, corners = xi[within, None], corners[within]
    local = reference.gradients(xi)[:, 0]
    gradients = local @ np.linalg.inv(corners.swapaxes(1, 2) @ local)
    shapes = reference.shapes(xi)[:, 0]
    for n, k in enumerate(within):
        e = int(rows[k])
        yield int(k), Site(first + e, block.nodes[e], shapes[n], gradients[n], float(outside[k]))


def reference_coordinates(reference: ReferenceElement, corners: Floats, x: Floats) -> Floats:
    """Reference coordinates (n, dim) of points, each in an element of its own, by Newton's method.

    Each point has products of its own, so that the bits do not depend on what else is looked for.

    Args:
        reference: the kind of all elements.
        corners: (n, n_a, dim) nodes of the element of each point, m.
        x: (n, dim) the points, m.

    Returns:
        They map to the point within `_MET` of the size of the element, within `_AT_LAST` after the
        last step; NaN where they do not, far outside an element or where it is folded.
    """
    start = reference.nodes[: reference.cell.n_corners].mean(axis=0)
    found = np.full(x.shape, np.nan)
    size = np.ptp(corners, axis=1).max(axis=1, initial=0.0)
    open_, xi = np.arange(len(x)), np.tile(start, (len(x), 1))[:, None]
    for step in range(_NEWTON_STEPS):
        error = (reference.shapes(xi) @ corners[open_])[:, 0] - x[open_]
        off = np.abs(error).max(axis=1, initial=0.0)
        met = off <= _MET * size[open_]
        found[open_[met]] = xi[met, 0]
        jacobian = corners[open_].swapaxes(1, 2) @ reference.gradients(xi)[:, 0]
        stays = ~met & (np.abs(np.linalg.det(jacobian)) > 0.0)
        open_, xi, error = open_[stays], xi[stays], error[stays]
        xi = xi - np.linalg.solve(jacobian[stays], error[..., None])[:, None, :, 0]
        near = np.abs(xi).max(axis=(1, 2), initial=0.0) <= _FAR
        open_, xi, off = open_[near], xi[near], off[stays][near]
        if step + 1 == _NEWTON_STEPS:
            last = off <= _AT_LAST * size[open_]
            found[open_[last]] = xi[last, 0]
        if not len(open_):
            break
    return found


def format_point(point: tuple[float, ...] | Floats) -> str:
    """A point (dim,) for a message.

    >>> format_point((1.0, -2.5))
    '(1, -2.5) m'
    """
    return f"({', '.join(f'{x:.6g}' for x in point)}) m"
