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
"""Five are usual; in folded elements Newton's method may not converge."""

_MAP_TOLERANCE = 1e-12
"""Error of a mapped point, in sizes of the element: a hundred roundings of quadratic shapes."""

_ON_BORDER = 1e-6
"""Part of an element's size up to which a point is inside: of those, the first element is taken."""

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
    """Finds points in a mesh; the boxes around the elements are made once.

    >>> corners = np.array([[0.0, 0.0], [4.0, 0.0], [0.0, 2.0]])
    >>> triangle = Mesh(corners, (ElementBlock("tri3", np.array([[0, 1, 2]]), np.array([1])),))
    >>> (site,) = Locator(triangle).sites((1.0, 1.0))
    >>> site.shapes @ corners
    array([1., 1.])
    """

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
        held: list[list[Site]] = [[] for _ in new]
        for (block, span), (low, high) in zip(spans(self._mesh.blocks), self._boxes, strict=True):
            at, row = points_in_boxes(x, low, high)
            for k, site in _sites(self._mesh, block, span.start, row, x[at]):
                held[at[k]].append(site)
        for point, sites in zip(new, held, strict=True):
            sites.sort(key=lambda site: (max(site.outside, _ON_BORDER), site.element))
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

    Lengths are taken from the first node of each element: the difference of large coordinates is
    exact, and so the tolerance can be reached however far from the origin the element lies.

    Args:
        reference: the kind of all elements.
        corners: (n, n_a, dim) nodes of the element of each point, m.
        x: (n, dim) the points, m.

    Returns:
        They map to the point within `_MAP_TOLERANCE` of the size of the element; NaN where the
        method does not converge, far outside an element or where it is folded.

    >>> square = np.array([[[7.0, 1.0], [9.0, 1.0], [9.0, 5.0], [7.0, 5.0]]])
    >>> reference_coordinates(reference_element("quad4"), square, np.array([[8.0, 4.0]]))
    array([[0. , 0.5]])
    """
    x, corners = x - corners[:, 0], corners - corners[:, :1]
    size = np.ptp(corners, axis=1).max(axis=1, initial=0.0)
    centre = reference.nodes[: reference.cell.n_corners].mean(axis=0)
    converged = np.full(x.shape, np.nan)
    rows, xi = np.arange(len(x)), np.tile(centre, (len(x), 1))[:, None]
    for _ in range(_NEWTON_STEPS):
        # A product for each point: what else is looked for changes no bit of it.
        error = (reference.shapes(xi) @ corners[rows])[:, 0] - x[rows]
        mapped = np.abs(error).max(axis=1, initial=0.0) <= _MAP_TOLERANCE * size[rows]
        converged[rows[mapped]] = xi[mapped, 0]
        jacobian = corners[rows].swapaxes(1, 2) @ reference.gradients(xi)[:, 0]
        going = ~mapped & (np.abs(np.linalg.det(jacobian)) > 0.0)
        rows, xi, error = rows[going], xi[going], error[going]
        xi = xi - np.linalg.solve(jacobian[going], error[..., None])[:, None, :, 0]
        near = np.abs(xi).max(axis=(1, 2), initial=0.0) <= _FAR
        rows, xi = rows[near], xi[near]
        if not len(rows):
            break
    return converged


def format_point(point: tuple[float, ...] | Floats) -> str:
    """A point (dim,) for a message.

    >>> format_point((1.0, -2.5))
    '(1, -2.5) m'
    """
    return f"({', '.join(f'{x:.6g}' for x in point)}) m"
