"""Which element holds a point, and the shape functions there.

A point on the border of several elements has several *sites*; which of them can be used depends on
which elements are present, so all are returned, the best first. A point just outside a curved wall
that straight elements cut off is taken by the nearest element, up to `REACH` of its size.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from geoident.fem.elements import ReferenceElement, reference_element
from geoident.model.arrays import Bools, Floats, Ints
from geoident.model.mesh import ElementBlock, Mesh, spans

REACH = 0.1
"""How far outside an element a point may lie to be taken by it, in parts of its size."""

_SPARE = 1e-6
"""What is not decided by reference coordinates that are less exact, in parts of the size."""

_NEWTON_STEPS = 25

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
            self._known[point] = self._find(point)
        return self._known[point]

    def _find(self, point: tuple[float, ...]) -> tuple[Site, ...]:
        x = np.asarray(point, dtype=np.float64)
        found: list[Site] = []
        for (block, span), (low, high) in zip(spans(self._mesh.blocks), self._boxes, strict=True):
            near = np.flatnonzero((x[0] >= low[:, 0]) & (x[0] <= high[:, 0]))
            near = near[np.all((x >= low[near]) & (x <= high[near]), axis=1)]
            found += [
                site
                for e in _within_reach(self._mesh, block, near, x)
                if (site := _site(self._mesh, block, int(e), span.start, x)) is not None
            ]
        return tuple(sorted(found, key=lambda site: (max(site.outside, 1e-6), site.element)))

    def best(self, point: tuple[float, ...], present: Bools) -> Site | None:
        """The best of the elements that hold a point (dim,), m, and are present (n_elements,)."""
        return next((site for site in self.sites(point) if present[site.element]), None)


def _boxes(mesh: Mesh, block: ElementBlock) -> tuple[Floats, Floats]:
    corners = mesh.points[block.nodes]
    low, high = corners.min(axis=1), corners.max(axis=1)
    margin = 2 * REACH * (high - low).max(axis=1, keepdims=True)
    return low - margin, high + margin


def _within_reach(mesh: Mesh, block: ElementBlock, rows: Ints, x: Floats) -> Ints:
    """Elements of a block (n,) without those that a point (dim,) is surely out of reach of.

    Of the boxes that hold a point few elements do, and those are looked at one by one.
    """
    if len(rows) < 2:
        return rows
    reference = reference_element(block.kind)
    corners = mesh.points[block.nodes[rows]]
    xi = reference_coordinates(reference, corners, np.tile(x, (len(rows), 1)))
    outside = (xi @ reference.walls[:, :-1].T + reference.walls[:, -1]).max(axis=1)
    return np.asarray(rows[outside <= REACH + _SPARE])


def _site(mesh: Mesh, block: ElementBlock, e: int, first: int, x: Floats) -> Site | None:
    reference = reference_element(block.kind)
    nodes = block.nodes[e]
    xi = _inverse_map(reference, mesh.points[nodes], x)
    if xi is None:
        return None
    outside = reference.outside(xi)
    if outside > REACH:
        return None
    local = reference.gradients(xi[None])[0]
    gradients = local @ np.linalg.inv(mesh.points[nodes].T @ local)
    return Site(first + e, nodes, reference.shapes(xi[None])[0], gradients, outside)


def _inverse_map(reference: ReferenceElement, corners: Floats, x: Floats) -> Floats | None:
    """Reference coordinates of a point by Newton's method; None where it does not converge."""
    xi = reference.nodes[: reference.cell.n_corners].mean(axis=0)
    size = np.ptp(corners, axis=0).max()
    for _ in range(_NEWTON_STEPS):
        error = reference.shapes(xi[None])[0] @ corners - x
        if np.abs(error).max() <= 1e-13 * size:
            return np.asarray(xi)
        jacobian = corners.T @ reference.gradients(xi[None])[0]
        try:
            xi = xi - np.linalg.solve(jacobian, error)
        except np.linalg.LinAlgError:
            return None
        if np.abs(xi).max() > _FAR:
            return None
    return np.asarray(xi) if np.abs(error).max() <= 1e-9 * size else None


def reference_coordinates(reference: ReferenceElement, x: Floats, points: Floats) -> Floats:
    """Reference coordinates (n, dim) of points, each in an element of its own; NaN for none.

    Args:
        reference: the kind of all elements.
        x: (n, n_a, dim) their nodes, m.
        points: (n, dim) m.
    """
    start = reference.nodes[: reference.cell.n_corners].mean(axis=0)
    found = np.full(points.shape, np.nan)
    size = np.ptp(x, axis=1).max(axis=1)
    open_, xi = np.arange(len(points)), np.tile(start, (len(points), 1))
    for _ in range(_NEWTON_STEPS):
        error = np.einsum("na,nai->ni", reference.shapes(xi), x[open_]) - points[open_]
        met = np.abs(error).max(axis=1) <= 1e-9 * size[open_]
        found[open_[met]] = xi[met]
        jacobian = np.einsum("nai,naj->nij", x[open_], reference.gradients(xi))
        stays = ~met & (np.abs(np.linalg.det(jacobian)) > 0.0)
        open_, xi, error, jacobian = open_[stays], xi[stays], error[stays], jacobian[stays]
        xi = xi - np.linalg.solve(jacobian, error[..., None])[..., 0]
        near = np.abs(xi).max(axis=1, initial=0.0) <= _FAR
        open_, xi = open_[near], xi[near]
        if not len(open_):
            break
    return found


def format_point(point: tuple[float, ...] | Floats) -> str:
    """A point (dim,) for a message.

    >>> format_point((1.0, -2.5))
    '(1, -2.5) m'
    """
    return f"({', '.join(f'{x:.6g}' for x in point)}) m"
